"""Warnings of a map that is applied: folds in tissue, tissue that leaves the box, and nothing where all is well."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import deformnb as dn
from deformnb.document.deformation import Deformation, Step, VolumeReference
from deformnb.errors import DeformWarning
from deformnb.rbf.fields import AbstractField
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.kernels import KERNELS
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Line, Polygon
from deformnb.rbf.rigid import RigidMotion, RigidPart
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.map_checks import fold_note, map_notes
from deformnb.warping.warper import warp

SIDE = 40
BODY = Volume.from_array(np.pad(np.random.default_rng(0).integers(100, 200, (20, 20, 20)).astype(np.uint8), 10))
EMPTY = ControlPoints.from_arrays(np.zeros((0, 2)), np.zeros((0, 2)))
FAR = ControlPoints.from_arrays([[15, 15]], [[25, 15]])
NEAR = ControlPoints.from_arrays([[15, 15]], [[18, 15]])


def flat_map(points: ControlPoints, **options: Any) -> Deformation:
    return Deformation.from_picture_points(BODY, "+z", points, **{"support": 10.0, "trend": "none", **options})


def applied(deformation: Deformation, volume: Volume = BODY) -> list[str]:
    """The warnings of a deformation, which are notes of its result too."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = deformation.apply(volume)
    assert all(issubclass(one.category, DeformWarning) and one.filename == __file__ for one in caught)
    texts = [str(one.message) for one in caught]
    assert len(set(texts)) == len(texts)
    assert set(texts) <= set(result.notes)
    return texts


SQUARE = Polygon([(12, 12), (20, 12), (20, 20), (12, 20)])
BESIDE = Polygon([(21, 12), (29, 12), (29, 20), (21, 20)])


def turned(degrees: float) -> RigidMotion:
    return RigidMotion.turn(degrees, (16, 16))


CASES: dict[str, tuple[Callable[[], Deformation], str]] = {
    "one point dragged as far as its radius": (lambda: flat_map(FAR), "folds"),
    "a curve of depth that multiplies by five": (lambda: flat_map(NEAR, extrusion="modulate", curve="5*z"), "folds"),
    "parts of the same tissue with two motions": (
        lambda: flat_map(EMPTY, parts=(RigidPart(SQUARE, turned(10)), RigidPart(SQUARE, turned(20)))),
        "parts 1 and 2 hold the same tissue",
    ),
    "a part within another": (
        lambda: flat_map(
            EMPTY,
            parts=(
                RigidPart(SQUARE, turned(5), name="femur"),
                RigidPart(Polygon([(14, 14), (18, 14), (18, 18), (14, 18)]), turned(-5), name="marrow"),
            ),
        ),
        "parts femur and marrow hold the same tissue",
    ),
    "parts pushed through each other": (
        lambda: flat_map(EMPTY, parts=(RigidPart(SQUARE, RigidMotion.turn(0, (0, 0), (6, 0))), RigidPart(BESIDE))),
        "pushed into each other",
    ),
    "tissue moved out of the box": (
        lambda: flat_map(ControlPoints.from_arrays([[15, 15]], [[35, 15]]), trend="translation"),
        "high x side",
    ),
    "a radius below a voxel": (
        lambda: flat_map(ControlPoints.from_arrays([[15, 15]], [[15.1, 15]]), support=0.4),
        "smaller than a voxel",
    ),
    "a radius of its own below a voxel": (
        lambda: flat_map(ControlPoints.from_arrays([[15, 15]], [[15.1, 15]]).edit(0, radius=0.4)),
        "smaller than a voxel",
    ),
    "a cut beside the volume": (
        lambda: flat_map(NEAR, cuts=(dn.Cut(Line([(500, 0), (500, 9)]), "incision"),)),
        "cut incision is outside",
    ),
    "a slit beside the volume whose line goes on through it": (
        lambda: flat_map(NEAR, cuts=(dn.Cut(Line([(90, 20), (60, 20)], stops=(True, True))),)),
        "cut 1 is outside",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_what_is_probably_a_mistake_is_a_warning_and_a_note(name: str) -> None:
    make, words = CASES[name]
    assert any(words in text for text in applied(make())), name


GOOD: dict[str, Callable[[], Deformation]] = {
    "a short drag": lambda: flat_map(NEAR),
    "a long drag in stages": lambda: flat_map(FAR, stages=8),
    "a curve that ends at one": lambda: flat_map(NEAR, extrusion="modulate", curve="z"),
    "parts side by side": lambda: flat_map(
        EMPTY, parts=(RigidPart(SQUARE, turned(3)), RigidPart(Polygon([(24, 12), (29, 12), (29, 20), (24, 20)])))
    ),
    "parts that share an edge": lambda: flat_map(
        EMPTY, parts=(RigidPart(SQUARE), RigidPart(Polygon([(20, 12), (29, 12), (29, 20), (20, 20)])))
    ),
    "two names of one motion": lambda: flat_map(
        EMPTY,
        parts=(RigidPart(SQUARE, turned(5)), RigidPart(Polygon([(14, 14), (18, 14), (18, 18), (14, 18)]), turned(5))),
    ),
    "a switched off part": lambda: flat_map(
        EMPTY, parts=(RigidPart(SQUARE), RigidPart(SQUARE, turned(9), enabled=False))
    ),
    "a cut through the middle": lambda: flat_map(NEAR, cuts=(dn.Cut(Line([(22, 0), (22, 40)])),)),
    "a fold in air": lambda: flat_map(ControlPoints.from_arrays([[-8, 3]], [[3, 3]])),
    "nothing": lambda: Deformation(()),
}


@pytest.mark.parametrize("name", GOOD)
def test_nothing_is_said_of_what_is_right(name: str) -> None:
    assert applied(GOOD[name]()) == []


def test_a_document_of_another_grid_says_so_and_one_of_the_same_does_not() -> None:
    made = replace(flat_map(NEAR), volume=VolumeReference.of(BODY))
    assert applied(made) == []
    wider = Volume.from_array(np.pad(BODY.values, ((0, 0), (0, 0), (0, 4))))
    assert any("made on another volume" in text for text in applied(made, wider))
    coarser = replace(BODY, grid=replace(BODY.grid, spacing=(2.0, 2.0, 2.0)))
    assert any("at another place or of another size" in text for text in applied(made, coarser))


@pytest.mark.parametrize(
    "values",
    [np.zeros((9, 9, 9), np.uint8), np.full((9, 9, 9), np.nan, np.float32), np.full((9, 9, 9), 7, np.int16)],
    ids=["zero", "NaN", "seven"],
)
def test_a_volume_without_contrast_says_so(values: Any) -> None:
    volume = Volume(values, Grid((9, 9, 9)))
    assert any("there is nothing to see in this volume" in text for text in applied(flat_map(NEAR), volume))
    assert any("there is nothing to see" in note for note in Volume.from_array(values).notes)


def test_values_between_labels_that_are_not_declared_are_counted() -> None:
    labels = np.kron(np.random.default_rng(1).integers(0, 9, (5, 5, 5)) * 13, np.ones((8, 8, 8), int)).astype(np.int16)
    drag = Deformation.from_space_points(
        ControlPoints.from_arrays([[20, 20, 20]], [[23.3, 20, 20]]), support=30.0, trend="none"
    )
    undecided = Volume.from_array(labels)
    with pytest.warns(DeformWarning, match="values that no voxel had were made up") as caught:
        made = drag.apply(undecided)
    count = len(set(np.unique(made.values)) - set(np.unique(labels)))
    assert count > 0
    assert str(caught[0].message).startswith(f"{count} values that")
    plain = Volume(labels, Grid(labels.shape))
    assert any(note.startswith(f"{count} values") for note in drag.apply(plain).notes)
    assert not any("made up" in note for note in drag.apply(undecided.mark_labels(True)).notes)
    assert not any("made up" in note for note in drag.apply(BODY).notes)


def test_a_large_volume_says_the_same(tmp_path: Any) -> None:
    with pytest.warns(DeformWarning, match="The map folds"):
        made = dn.chunked.warp(BODY, flat_map(FAR), tmp_path / "a.zarr")
    assert any("The map folds" in note for note in made.notes)


def test_the_warning_speaks_the_language_that_was_chosen() -> None:
    dn.set_language("de")
    try:
        with pytest.warns(DeformWarning, match="Die Abbildung faltet"):
            flat_map(FAR).apply(BODY)
    finally:
        dn.set_language(None)


# ---- folds, by an oracle ---------------------------------------------------------------------------------------------


def least_determinant(field: AbstractField, box: Grid, nodes: int) -> float:
    """The smallest determinant by central differences of displacements, at the nodes of a dense lattice."""
    lines = [np.linspace(0, n - 1, nodes if n > 1 else 1) for n in box.shape[::-1]]
    x = box.index_to_point(np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3))
    h, j = 1e-4, np.zeros((len(x), 3, 3))
    for k in range(3):
        step = h * np.eye(3)[k]
        j[:, :, k] = (field.displacement(x + step) - field.displacement(x - step)) / (2 * h)
    return float(np.linalg.det(np.eye(3) + j).min())


@given(
    seed=st.integers(0, 10**6),
    reach=st.floats(1.0, 14.0),
    kernel=st.sampled_from([name for name, kind in KERNELS.items() if kind.order < 3]),
)
def test_folds_are_named_where_they_are_and_only_there(seed: int, reach: float, kernel: str) -> None:
    """On a body that fills its box, with few points on a picture: the determinant is that of the picture's map."""
    rng = np.random.default_rng(seed)
    full = Volume(np.full((6, 40, 40), 150, np.uint8), Grid((6, 40, 40)))
    full.values[0, 0, 0] = 0
    x = rng.uniform(4, 36, (4, 2))
    points = ControlPoints.from_arrays(x, x + rng.normal(0, reach / 2, (4, 2)))
    field = Step((points,), Plane.from_view(full, "+z"), kernel=kernel, support=25.0).field(full.grid)
    dense = least_determinant(field, replace(full.grid, shape=(1, 40, 40)), 81)
    assume(abs(dense) > 0.05)  # a fold of a corner of a cell is missed by one of the two
    assert bool(fold_note(full, field, full.grid)) == (dense < 0)


def test_a_fold_narrower_than_the_nodes_is_found_beside_its_point() -> None:
    """A drag of 3 with a radius of 4 voxels in a volume of 200: between nodes that are 8 apart."""
    values = np.full((200, 200, 200), 150, np.uint8)
    values[0] = 0
    volume = Volume(values, Grid((200, 200, 200)))
    for place in itertools.product((51.3, 120.0), repeat=3):
        narrow = fit_rbf(ControlPoints.from_arrays([place], [np.add(place, (3, 0, 0))]), support=4.0, trend="none")
        assert "The map folds: det J is -0.5" in fold_note(volume, narrow, volume.grid)  # 1 - 2.109 x 3 / 4


def test_steps_fold_where_one_of_them_does_though_the_product_is_small() -> None:
    once = Step((FAR,), Plane.from_view(BODY, "+z"), support=10.0, trend="none")
    squeeze = Step(
        (ControlPoints.from_arrays([[0, 0], [30, 0], [0, 30]], [[0, 0], [15, 0], [0, 30]]),),
        Plane.from_view(BODY, "+z"),
    )
    for steps in ((once, squeeze), (squeeze, once)):
        assert map_notes(BODY, Deformation(steps).field(BODY.grid), BODY.grid)
    assert not map_notes(BODY, Deformation((squeeze,)).field(BODY.grid), BODY.grid)


def test_sides_that_were_cropped_by_request_are_not_named() -> None:
    shift = fit_rbf(ControlPoints.from_arrays([[0, 0, 0]], [[12.0, 0, 0]]), trend="translation")
    half = BODY.grid.crop((0, 0, 0), (SIDE, SIDE, SIDE // 2))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warp(BODY, shift, output=half)
    with pytest.warns(DeformWarning, match="high x side"):
        warp(BODY, shift)


def test_what_lies_outside_a_signed_distance_is_not_cut_off() -> None:
    distance = dn.warping.signed_distance(dn.warping.isosurface(BODY, 100.0, inside="above"), BODY.grid)
    shift = fit_rbf(ControlPoints.from_arrays([[0, 0, 0]], [[4.0, 0, 0]]), trend="translation")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        dn.warp(distance, shift, fill=distance.value_range[1])
    with pytest.warns(DeformWarning, match="leaves the box"):
        dn.warp(distance, shift)
