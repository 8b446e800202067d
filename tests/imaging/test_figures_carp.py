"""Figure 3 of the paper: the carp on D'Arcy Thompson's grids."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import oracle
import pytest

from deformnb.datasets import PHANTOMS, load, thompson_map, thompson_pairs
from deformnb.document.deformation import Deformation
from deformnb.imaging.demo import field_of_view, subject_box
from deformnb.imaging.figures import picture_field
from deformnb.imaging.projection import project
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Volume
from deformnb.warping.points import warp_points

FISH = PHANTOMS["fish"].make((64, 128, 64), noise=0)
SIDE = Plane.from_view(FISH.grid, "-x")


def two_pixels(grids: object) -> float:
    """Reading precision of the nodes, in millimetres of the picture: the smaller of both directions."""
    size = [np.ptp(n.reshape(-1, 2), axis=0) for n in (grids.source_nodes, grids.source.nodes)]  # type: ignore[attr-defined]
    return float(2 * (size[0] / size[1]).min())


@pytest.mark.parametrize(("source", "target"), thompson_pairs())
def test_the_nodes_land_on_thompsons(source: str, target: str) -> None:
    grids = thompson_map(source, target, box=subject_box(project(FISH, SIDE)), scale="area")
    step = Deformation.from_picture_points(FISH.grid, SIDE, grids.points).steps[0]
    landed, found = warp_points(grids.points.source, picture_field(step, FISH.grid))
    assert found.all()
    miss = np.linalg.norm(landed - grids.points.target, axis=1).max()
    assert miss < 0.01 * two_pixels(grids)


def deep_and_long(volume: Volume) -> tuple[float, float]:
    """Height and length of the region brighter than half of soft tissue, on the picture from the side."""
    a0, a1, b0, b1 = subject_box(project(volume, Plane.from_view(volume.grid, "-x")), margin=0.0)
    return b1 - b0, a1 - a0


def check_it_becomes_deep(fish: Volume) -> None:
    plane = Plane.from_view(fish.grid, "-x")
    grids = thompson_map("Polyprion", "Antigonia", box=subject_box(project(fish, plane)), scale="area")
    deformation = Deformation.from_picture_points(fish.grid, plane, grids.points)
    after = deformation.apply(fish, output=field_of_view(fish.grid, plane, grids))
    (height, length), (deep, long) = deep_and_long(fish), deep_and_long(after)
    assert deep / long > 1.6 * height / length, (deep, long, height, length)


def test_the_carp_becomes_deep_and_short() -> None:
    check_it_becomes_deep(FISH)


def test_the_papers_own_carp_becomes_deep_and_short(real_data: Callable[[str], Path]) -> None:
    carp = load("carp", folder=real_data("carp.nii.gz").parent)
    coarse = replace(
        carp,
        values=np.ascontiguousarray(carp.values[::4, ::4, ::4]),
        grid=replace(carp.grid, shape=(64, 128, 64), spacing=tuple(4 * s for s in carp.grid.spacing)),
    )
    check_it_becomes_deep(coarse)


def test_modulated_the_displacement_grows_smoothly_from_zero_through_the_body() -> None:
    grids = thompson_map("Polyprion", "Antigonia", box=subject_box(project(FISH, SIDE)), scale="area")
    whole = Deformation.from_picture_points(FISH.grid, SIDE, grids.points)
    smooth = replace(whole.steps[0], extrusion="modulate", curve="sin(pi*z)")
    near, far = SIDE.depth_range(FISH.grid)
    places = SIDE.from_plane(np.array([[200.0, 60.0, c] for c in np.linspace(near, far, 65)]))
    full = whole.field(FISH.grid).displacement(places)
    grown = Deformation((smooth,)).field(FISH.grid).displacement(places)
    oracle.assert_close(full, np.broadcast_to(full[0], full.shape), atol=1e-9)
    oracle.assert_close(grown, full * np.sin(np.pi * np.linspace(0, 1, 65))[:, None], atol=1e-3 * np.abs(full).max())
    assert np.abs(grown[[0, -1]]).max() < 1e-6
