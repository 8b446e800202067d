"""Edits of key frames: the list stays in order, and points of two key frames are never mistaken for each other."""

from __future__ import annotations

from dataclasses import replace

import pytest

from deformnb.document.deformation import Deformation
from deformnb.document.edits import (
    add_key,
    document_at_key,
    free_time,
    is_now,
    key_at,
    move_key,
    remove_key,
    repeat_key,
    update_key,
)
from deformnb.errors import DeformError
from deformnb.rbf.points import ControlPoints
from deformnb.volume.volume import Grid

POINTS = ControlPoints.from_arrays([[1.0, 1.0], [6.0, 1.0], [3.0, 6.0]])


def document(points: ControlPoints = POINTS) -> Deformation:
    return Deformation.from_picture_points(Grid((8, 8, 8)), "+y", points)


def edited(deformation: Deformation, points: ControlPoints) -> Deformation:
    return deformation.with_step(0, deformation.steps[0].with_points(points))


def times(deformation: Deformation) -> list[float]:
    return [key.time for key in deformation.keyframes]


def test_key_frames_keep_what_the_document_was() -> None:
    first = add_key(document())
    moved = edited(first, POINTS.move(2, [3, 4]))
    both = add_key(moved)
    assert times(both) == [0, 1]
    assert both.keyframes[0].steps == first.steps
    assert both.keyframes[1].steps == moved.steps
    assert (is_now(both, 0), is_now(both, 1)) == (False, True)
    assert free_time(both) == 2
    between = add_key(both, 0.5)
    assert times(between) == [0, 0.5, 1]
    assert key_at(between, 0.5004) == 1
    assert times(add_key(between, 0.5004)) == [0, 0.5, 1]  # the same moment: it is replaced
    assert update_key(both, 0).keyframes[0].steps == moved.steps
    assert times(remove_key(between, 1)) == [0, 1]


def test_a_key_frame_moves_past_others_but_not_onto_one() -> None:
    keys = add_key(add_key(add_key(document())))
    marked = update_key(edited(keys, POINTS.move(0, [2, 2])), 0)
    moved = move_key(marked, 0, 1.5)
    assert times(moved) == [1, 1.5, 2]
    assert moved.keyframes[1].steps == marked.keyframes[0].steps
    assert times(move_key(marked, 1, 1.0)) == [0, 1, 2]
    with pytest.raises(DeformError, match="at 2 s already"):
        move_key(marked, 0, 2.0)
    with pytest.raises(DeformError, match="from 0 on"):
        move_key(marked, 0, -1.0)
    assert times(repeat_key(marked, 0)) == [0, 1, 2, 3]
    assert repeat_key(marked, 0).keyframes[3].steps == marked.keyframes[0].steps


def test_points_that_are_added_at_one_key_frame_are_no_points_of_another() -> None:
    keys = add_key(document())
    later = edited(keys, POINTS.add([5.0, 5.0]).add([2.0, 2.0]))  # ids 3 and 4
    both = add_key(later)
    back = document_at_key(both, 0)
    assert back.steps[0].points.ids == (0, 1, 2)
    assert is_now(back, 0)
    assert back.steps[0].points.add([7.0, 7.0]).ids == (0, 1, 2, 5)
    named = replace(back, name="other")
    assert document_at_key(named, 1).name == "other"


@pytest.mark.parametrize("edit", [update_key, remove_key, document_at_key, is_now, repeat_key])
def test_key_frames_that_are_not_there(edit: object) -> None:
    with pytest.raises(DeformError, match="no key frame 3; there are 1"):
        edit(add_key(document()), 2)  # type: ignore[operator]
