"""Arguments in the wrong order, or of another kind, are refused in a sentence wherever a document is made or asked."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import deformnb as dn
from deformnb.document.deformation import VolumeReference
from deformnb.document.step_checks import required_stages, safe_strength, step_quality
from deformnb.errors import DeformError

GRID = dn.Grid((4, 5, 6))
VOLUME = dn.Volume(np.arange(120, dtype=np.uint8).reshape(4, 5, 6), GRID)
POINTS = dn.ControlPoints.from_arrays([[1, 1], [4, 1], [1, 3]], [[1, 1], [4, 1], [1, 4]])
DOCUMENT = dn.Deformation.from_picture_points(VOLUME, "+z", POINTS)
STEP = DOCUMENT.steps[0]
PLANE = dn.Plane.from_view(VOLUME, "+z")
MESH = dn.warping.isosurface(VOLUME, 50.5)
MARKS = dn.warping.Landmarks([[1, 2, 3]])

SWAPPED: dict[str, Callable[[], Any]] = {
    "write_volume": lambda: dn.write_volume("v", VOLUME),
    "write_mesh": lambda: dn.write_mesh("m.stl", MESH),
    "write_landmarks": lambda: dn.write_landmarks("a.csv", MARKS),
    "write_transform": lambda: dn.write_transform("a.tfm", DOCUMENT, VOLUME),
    "write_deformation": lambda: dn.write_deformation("a.json", DOCUMENT),  # type: ignore[arg-type]
    "warp": lambda: dn.warp(DOCUMENT, VOLUME),
    "warp_mesh": lambda: dn.warp_mesh(DOCUMENT, MESH, VOLUME),
    "on_picture": lambda: dn.Deformation.from_picture_points("+z", VOLUME, POINTS),
    "apply": lambda: DOCUMENT.apply(DOCUMENT),
    "then": lambda: DOCUMENT.then(VOLUME),
    "Step": lambda: dn.Step(PLANE, (POINTS,)),
    "Keyframe": lambda: dn.Keyframe(DOCUMENT.steps, 0),
    "Session": lambda: dn.Session(DOCUMENT, VOLUME),
    "extrude": lambda: dn.rbf.extrude(VOLUME, PLANE, [dn.fit_rbf(POINTS)], dn.rbf.replicate()),
    "replay": lambda: dn.session.replay([VOLUME], DOCUMENT, "out"),
    "with_step": lambda: DOCUMENT.with_step(POINTS, 0),
    "without_step": lambda: DOCUMENT.without_step("a"),
    "move_step": lambda: DOCUMENT.move_step("a", 0),
    "scaled": lambda: DOCUMENT.scaled("a"),
    "with_points": lambda: STEP.with_points(VOLUME),
    "with_points of a key": lambda: STEP.with_points(POINTS, "a"),
    "field of a step": lambda: STEP.field("a"),
    "to_json": lambda: dn.document.to_json(VOLUME),
    "as_python": lambda: dn.document.as_python(VOLUME, DOCUMENT),
    "transplanted": lambda: dn.document.transplant(VOLUME, DOCUMENT),
    "Animation": lambda: dn.Animation(VOLUME),
    "safe_strength": lambda: safe_strength(VOLUME, STEP),
    "stages_needed": lambda: required_stages(VOLUME, STEP),
    "step_quality": lambda: step_quality(VOLUME, STEP),
    "own_grid": lambda: DOCUMENT.own_grid("a"),
    "edit_points": lambda: dn.Session(VOLUME).editing.edit_points(VOLUME, "x"),
    "edit_step": lambda: dn.Session(VOLUME).editing.edit_step("a"),
    "from_landmarks": lambda: dn.ControlPoints.from_landmarks(MARKS, VOLUME),
    "thompson_score": lambda: dn.datasets.thompson_score(VOLUME, DOCUMENT),
    "reference": lambda: VolumeReference.of(DOCUMENT),
}


@pytest.mark.parametrize("name", SWAPPED)
def test_what_is_of_another_kind_is_refused_in_a_sentence(
    name: str, tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DeformError):
        SWAPPED[name]()
    assert not list(tmp_path.iterdir())


def test_a_volume_counts_as_its_grid_in_all_of_a_document() -> None:
    assert DOCUMENT.own_grid(VOLUME) == GRID  # type: ignore[arg-type]
    assert GRID.is_like(VOLUME)  # type: ignore[arg-type]
    assert STEP.field(VOLUME).dim == 3  # type: ignore[arg-type]
    assert DOCUMENT.notes(VOLUME) == DOCUMENT.notes(GRID)  # type: ignore[arg-type]


def test_what_is_of_the_same_idea_works() -> None:
    assert dn.warp(VOLUME.values, DOCUMENT).shape == GRID.shape
    assert dn.warp_mesh(MESH, DOCUMENT, VOLUME).faces.shape == MESH.faces.shape
    assert dn.Volume.from_array(VOLUME.values, 0.5).grid.spacing == (0.5, 0.5, 0.5)
    stained = dn.volume.Channels((VOLUME, VOLUME))
    assert isinstance(DOCUMENT.apply(stained), dn.volume.Channels)


def test_control_points_are_written_as_pairs_of_landmarks(tmp_path: Any) -> None:
    points = dn.ControlPoints.from_arrays([[1, 2, 3]], [[4, 5, 6]], names=["tip"])
    dn.write_landmarks(points, tmp_path / "pairs.csv")
    again = dn.read_landmarks(tmp_path / "pairs.csv")
    assert again.points.tolist() == [[1, 2, 3]]
    assert again.fixed is not None
    assert again.fixed.tolist() == [[4, 5, 6]]
