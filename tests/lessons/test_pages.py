"""The pictures of the lessons: what each begins with, and what a notebook makes of it."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from deformnb.datasets import PHANTOMS
from deformnb.errors import DeformError
from deformnb_lessons import GOAL_NODES, LESSONS, FishTask, lesson_carp, lesson_start, write_lesson_page
from deformnb_lessons.command import lesson_notebook


@pytest.mark.parametrize("name", LESSONS)
def test_a_lesson_begins_with_points_that_were_not_dragged_and_its_notebook_takes_them(name: str) -> None:
    (step,) = lesson_start(name, lesson_carp()).steps
    assert not step.points.displacement.any()
    cells = json.loads(lesson_notebook(name).read_text("utf-8"))["cells"]
    code = "".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    assert re.findall(r'lesson_start\("(\w+)", carp\)', code) == [name]


def test_the_points_of_the_first_lesson_are_nodes_by_which_the_carp_becomes_a_boarfish() -> None:
    carp, task = lesson_carp(), LESSONS["fish"].exercises["antigonia"]
    assert isinstance(task, FishTask)
    (step,) = lesson_start("fish", carp).steps
    nodes = task.grids(carp).source_nodes.reshape(-1, 2)
    np.testing.assert_allclose(step.points.source, nodes[GOAL_NODES])


def test_the_page_of_a_lesson_lets_a_drag_fold(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    carp = PHANTOMS["fish"].make((16, 32, 16))
    monkeypatch.setattr("deformnb_lessons.pages.lesson_carp", lambda: carp)
    write_lesson_page("folding", tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text("utf-8")
    assert '"stop_at_folds":false' in text
    assert '"stop_at_folds":true' not in text


def test_an_unknown_lesson_is_refused_with_the_known() -> None:
    with pytest.raises(DeformError, match="choose one of coordinates, fish, kernels, affine, folding"):
        lesson_start("kernel", lesson_carp())
