"""Displacements of compositions at listed places, and by the program of a GPU, against the fields themselves."""

from __future__ import annotations

import numpy as np
import pytest

from deformnb.document.deformation import Deformation, Step
from deformnb.rbf.cuts import Cut
from deformnb.rbf.fields import AbstractField, links_of
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import HalfSpace, Line
from deformnb.rbf.rigid import RigidPart
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid
from deformnb.warping.exact_places import ExactPlaces

GRID = Grid((7, 9, 8), (1.0, 1.25, 0.8), (100.0, -40.0, 7.0))
FRONT, TOP = Plane.from_view(GRID, "+y"), Plane.from_view(GRID, "+z")
A, B = FRONT.to_plane(np.array(GRID.center))[:2]
ENDS = ((A, B - 9), (A + 0.5, B), (A - 1, B + 2))


def drag(dim: int, seed: int) -> ControlPoints:
    rng = np.random.default_rng(seed)
    centre = np.array(GRID.center) if dim == 3 else np.array([A, B])
    target = centre + 3 * rng.uniform(-1, 1, (6, dim))
    return ControlPoints.from_arrays(target + 0.3 * rng.normal(size=(6, dim)), target)


STEPS: dict[str, tuple[Step, ...]] = {
    "space": (Step((drag(3, 1),), support=20.0),),
    "stages": (Step((drag(3, 2),), support=20.0, stages=3), Step((drag(2, 3),), TOP, support=20.0)),
    "modulated": (Step((drag(2, 4),), FRONT, support=20.0, extrusion="modulate", curve="z*z"),),
    "cut": (Step((drag(2, 5),), FRONT, cuts=(Cut(Line(ENDS)),)), Step((drag(3, 6),), support=20.0)),
    "cut that stops": (Step((drag(2, 7),), FRONT, cuts=(Cut(Line(ENDS, (False, True))),)), Step((drag(2, 8),), TOP)),
    "part": (Step((drag(3, 9),), parts=(RigidPart(HalfSpace((98.5, -35.0, 9.0), (1.0, 0.2, 0.1))),)),),
}


def field_of(name: str) -> tuple[AbstractField, np.ndarray, np.ndarray, np.ndarray]:
    field = Deformation(STEPS[name]).field(GRID)
    index = np.stack(np.meshgrid(*map(np.arange, GRID.shape), indexing="ij"), axis=-1)[..., ::-1]
    places = GRID.index_to_point(index).reshape(-1, 3)
    return field, places, *field.displacement_and_opacity(places)


@pytest.mark.parametrize("name", STEPS)
def test_listed_places_are_moved_by_the_field(name: str) -> None:
    field, places, wanted, share = field_of(name)
    d, opacity = ExactPlaces(links_of(field), GRID)(places.T)
    np.testing.assert_allclose(d.T, wanted, atol=1e-4)
    np.testing.assert_allclose(opacity, share, atol=1e-4)


@pytest.mark.parametrize("name", ["stages", "modulated", "cut", "cut that stops"])
def test_the_program_of_a_gpu_moves_a_lattice_by_the_field(name: str) -> None:
    field, _, wanted, share = field_of(name)
    d, opacity = ExactPlaces(links_of(field), GRID).evaluate_on_gpu(GRID)
    np.testing.assert_allclose(np.stack(list(map(np.asarray, d)), -1).reshape(-1, 3), wanted, atol=1e-4)
    if opacity is None:
        assert (share == 1).all()
    else:
        np.testing.assert_allclose(opacity.ravel(), share, atol=1e-4)
