"""The pictures of the lessons: what each begins with, and what a notebook makes of it."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from deformnb.errors import DeformError
from deformnb_lessons import GOAL_NODES, LESSONS, FishTask, lesson_carp, lesson_start
from deformnb_lessons.command import lesson_notebook


@pytest.mark.parametrize("name", LESSONS)
def test_a_lesson_begins_with_points_that_were_not_dragged_and_its_notebook_takes_them(name: str) -> None:
    (step,) = lesson_start(name, lesson_carp()).steps
    assert not step.points.displacement.any()
    cells = json.loads(lesson_notebook(name).read_text("utf-8"))["cells"]
    code = "".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    assert re.findall(r'lesson_start\("(\w+)", carp\)', code) == [name]


def test_the_points_of_the_first_lesson_are_nodes_by_which_the_carp_becomes_a_boarfish() -> None:
    carp, task = lesson_carp(), LESSONS["coordinates"].exercises["antigonia"]
    assert isinstance(task, FishTask)
    (step,) = lesson_start("coordinates", carp).steps
    nodes = task.grids(carp).source_nodes.reshape(-1, 2)
    np.testing.assert_allclose(step.points.source, nodes[GOAL_NODES])


def test_an_unknown_lesson_is_refused_with_the_known() -> None:
    with pytest.raises(DeformError, match="choose one of coordinates, kernels, affine, folding"):
        lesson_start("kernel", lesson_carp())
