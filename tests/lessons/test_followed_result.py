"""A result that follows the studio."""

from __future__ import annotations

import pytest

from deformnb.document.deformation import Deformation
from deformnb.errors import DeformError
from deformnb.session.session import Session
from deformnb_lessons import GOAL_NODES, LESSONS, FishTask, lesson_carp, lesson_start


def test_the_score_rises_with_each_gesture_until_it_is_closed() -> None:
    carp, lesson = lesson_carp(), LESSONS["fish"]
    task = lesson.exercises["antigonia"]
    assert isinstance(task, FishTask)
    goal = task.grids(carp).points.take(GOAL_NODES)
    session = Session(carp, lesson_start("fish", carp))
    followed = lesson.follow("antigonia", session)
    assert not followed.result.right
    assert "<svg" not in followed.value
    session.editing.edit_points(goal.scaled(0.4))
    assert "% of the change" in followed.value
    assert "<svg" in followed.value
    assert not followed.result.right
    session.editing.deformation = Deformation.from_picture_points(carp, "-x", goal)
    assert followed.result.right
    assert followed.result.text == lesson.check("antigonia", session).text
    followed.close()
    session.editing.undo()
    assert followed.result.right, "it follows no more"


@pytest.mark.parametrize("what", [None, 7, "studio"])
def test_what_is_no_studio_is_refused(what: object) -> None:
    with pytest.raises(DeformError, match="follows a studio"):
        LESSONS["fish"].follow("antigonia", what)
    with pytest.raises(DeformError, match="no exercise"):
        LESSONS["fish"].follow("antigony", what)
