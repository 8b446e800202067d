"""Tissue that leaves the box, found in the browser from its outline, is where a whole warp of the picture shows it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from js.test_rbf import as_json
from js.test_regions import part_data
from numpy.typing import NDArray
from scripts import run_script

from deformnb.document.json_regions import region_to_data
from deformnb.rbf.cuts import Decoupled
from deformnb.rbf.fit_settings import FitSettings
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import AbstractRegion, Line, Mask, Polygon
from deformnb.rbf.rigid import RigidMotion, RigidPart
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.foreground import LEAVES, picture_side_names, silhouette

MODULES = ("maths/rbf.ts", "maths/cuts.ts", "maths/tissue_extent.ts")
WIDE, HIGH = 120, 80
BOX = [-0.5, WIDE - 0.5, -0.5, HIGH - 0.5]
CORNERS = [[0, 0], [WIDE - 1, 0], [WIDE - 1, HIGH - 1], [0, HIGH - 1]]
FAR = 160  # pixels around the picture in which the whole warp is searched


def fish(middle: tuple[float, float] = (60.0, 40.0)) -> NDArray[np.bool_]:
    """An oval body with a narrow tail."""
    b, a = np.mgrid[:HIGH, :WIDE]
    body = ((a - middle[0]) / 28) ** 2 + ((b - middle[1]) / 14) ** 2 < 1
    tail = (a > middle[0] + 20) & (a < middle[0] + 40) & (abs(b - middle[1]) < (a - middle[0] - 18) / 3)
    return np.asarray(body | tail)


def excess(tissue: NDArray[np.bool_], field: Any) -> NDArray[np.float64]:
    """Distances beyond the sides of the box at which a whole warp shows tissue, in pixels."""
    b, a = np.mgrid[-FAR : HIGH + FAR, -FAR : WIDE + FAR]
    at = np.stack([a, b], axis=-1).reshape(-1, 2).astype(float)
    moves = field.displacement_and_opacity(at)[0] if isinstance(field, Decoupled) else field.displacement(at)
    j, i = np.rint(at + moves).astype(int).T
    inside = (i >= 0) & (j >= 0) & (i < HIGH) & (j < WIDE)
    seen = at[inside][tissue[i[inside], j[inside]]]
    (a0, b0), (a1, b1) = seen.min(axis=0), seen.max(axis=0)
    return np.array([BOX[0] - a0, a1 - BOX[1], BOX[2] - b0, b1 - BOX[3]])


def drag(by: tuple[float, float], at: tuple[float, float] = (60.0, 40.0)) -> ControlPoints:
    return ControlPoints.from_arrays([*CORNERS, at], [*CORNERS, np.add(at, by)])


def check(points: ControlPoints, given: dict[str, Any], tissue: NDArray[np.bool_], **shapes: Any) -> set[int]:
    """Compare the sides; those at which tissue is about as far out as counts may be in either."""
    cuts: list[AbstractRegion] = shapes.get("cuts", [])
    parts: list[RigidPart] = shapes.get("parts", [])
    fits = FitSettings(**given).fits(points, parts, cuts)
    field = (
        Decoupled(tuple(fits.values()), tuple(fits), tuple(cuts), softness=1.0) if cuts else next(iter(fits.values()))
    )
    mask = region_to_data(Mask(tissue, Raster((HIGH, WIDE), (1.0, 1.0), (0.0, 0.0))))
    settings = {
        **given,
        "cuts": [{"region": region_to_data(region)} for region in cuts],
        "parts": [part_data(part) for part in parts],
    }
    main = """({ points, settings, mask, box }) =>
      exceededSides(layeredFit(points, settings), mask, box,
        { pixel: [1, 1], targets: points.map((p) => p.target) })"""
    sides = set(run_script(MODULES, main, {"points": as_json(points), "settings": settings, "mask": mask, "box": BOX}))
    beyond, most = excess(tissue, field), 1 + LEAVES * np.array([WIDE, WIDE, HIGH, HIGH])
    assert sides <= set(np.flatnonzero(beyond > most - 1.5).tolist())
    assert sides >= set(np.flatnonzero(beyond > most + 1.5).tolist())
    return sides


@pytest.mark.parametrize(
    ("by", "sides"),
    [
        ((0, 0), set()),
        ((8, 0), set()),
        ((-75, 0), {0}),
        ((85, 0), {1}),
        ((0, -60), {2}),
        ((0, 60), {3}),
        ((90, 70), {1, 3}),
    ],
)
@pytest.mark.parametrize("trend", ["none", "affine", "translation"])
def test_the_sides_are_those_of_a_whole_warp(by: tuple[float, float], sides: set[int], trend: str) -> None:
    found = check(drag(by), {"trend": trend, "support": 250.0}, fish())
    if trend == "none":
        assert found == sides


@pytest.mark.parametrize("kernel", ["gaussian", "wendland_c2"])
def test_a_fish_that_is_dragged_out_as_a_whole_is_found(kernel: str) -> None:
    whole = ControlPoints.from_arrays([[60.0, 40.0]], [[60.0 + 150, 40.0]])
    assert check(whole, {"kernel": kernel, "trend": "translation", "support": 100.0}, fish()) == {1}


def test_rigid_parts_cuts_and_stages_are_followed() -> None:
    part = RigidPart(
        Polygon([(20, 15), (105, 15), (105, 65), (20, 65)]), RigidMotion(((1.0, 0.0), (0.0, 1.0)), (0.0, 45.0))
    )
    assert check(drag((0, 0), (5, 40)), {"support": 60.0}, fish(), parts=[part]) == {3}
    line = Line([(60, -50), (60, 200)])
    apart = ControlPoints.from_arrays([[50, 40], [70, 40]], [[0, 40], [75, 40]])
    assert check(apart, {"trend": "translation", "support": 90.0}, fish(), cuts=[line]) == {0}
    assert check(drag((-75, 0)), {"support": 250.0, "stages": 4}, fish()) == {0}


def test_maps_that_fold_show_what_comes_out_of_them() -> None:
    assert 1 in check(drag((100, 0)), {"support": 60.0, "kernel": "gaussian"}, fish())


def test_no_fit_and_no_tissue_leave_nothing() -> None:
    mask = region_to_data(Mask(np.zeros((8, 8), bool), Raster((8, 8), (1.0, 1.0), (0.0, 0.0))))
    main = """({ mask, points }) => [null, layeredFit(points, {})].map((layered) =>
      exceededSides(layered, mask, [0, 8, 0, 8], { pixel: [1, 1], targets: points.map((p) => p.target) }))"""
    assert run_script(MODULES, main, {"mask": mask, "points": as_json(drag((200, 0)))}) == [[], []]


def test_the_mask_of_most_pixels_is_that_of_the_package() -> None:
    rng = np.random.default_rng(3)
    values = np.zeros((1, 300, 410), np.uint8)
    values[0, 50:200, 60:300] = 200
    values[0][rng.random((300, 410)) < 0.02] = 255  # specks
    volume = Volume(values, Grid((1, 300, 410)))
    mask = silhouette(volume, Plane.from_view(volume.grid, "+z"))
    main = """async ({ pixels, raster }) => { const mask = await coarseMask(Uint8Array.from(pixels), raster);
      return { ...mask, pixels: Array.from(maskPixels(mask)) }; }"""
    raster = {"shape": [300, 410], "spacing": [1, 1], "origin": [0, 0]}
    pixels = (values[0] > 0).astype(int).ravel().tolist()
    found = run_script((*MODULES, "maths/regions.ts"), main, {"pixels": pixels, "raster": raster})
    assert isinstance(mask.lattice, Raster)
    assert (tuple(found["shape"]), found["spacing"], found["origin"]) == (
        mask.lattice.shape,
        list(mask.lattice.spacing),
        list(mask.lattice.origin),
    )
    assert found["pixels"] == mask.values.astype(int).ravel().tolist()
    assert picture_side_names(Plane.from_view(volume.grid, "+z"), None)[0] == "left side"
