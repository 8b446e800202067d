"""The lessons: every exercise passes right answers only, and its notebook asks it and tells its solution."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deformnb as dn
import deformnb_lessons
from deformnb.datasets import PHANTOMS, thompson_grid
from deformnb.errors import DeformError
from deformnb.session.session import Session
from deformnb_lessons import LESSONS, Choice, FishTask, Lesson, Numbers, Result, StudioTask, lesson_carp, lesson_start

NOTEBOOKS = Path(deformnb_lessons.__file__).parent / "notebooks"
ALL = [(lesson, name) for lesson in LESSONS for name in LESSONS[lesson].exercises]

NEVER: list[Any] = [
    None,
    "",
    "  ",
    [],
    (),
    {},
    set(),
    [None],
    [None, None],
    True,
    float("nan"),
    [float("nan")] * 2,
    "x",
    ["x"],
    b"42",
    object(),
    1j,
    [[]],
    np.array([]),
    np.array(None),
    10**400,
    print,
]
"""Answers of no exercise."""

RIGHT: dict[str, list[Any]] = {
    "eye": [[2, 1], (2, 1)],
    "displacement": [[-82, -5], (-82.0, -5.2)],
    "grown": ["middle", ["Middle"]],
    "place": [[150, 60], (150.2, 60), np.array([150, 60])],
    "cells": [42, 42.0, np.int64(42)],
    "shear": [-93 / 261.5, -89 / 261.5, -0.335],
    "angle": [70, 71, 72.5],
    "taper": [-0.5, -1 / 2],
    "polar": [[0, 5], [3.1e-16, 5.0]],
    "pairs": ["sternoptyx", ["Sternoptyx"]],
    "between": [20],
    "kernel": [3 / 16, 0.19],
    "weights": [[10.36, -1.94], [10.3644, -1.9433]],
    "support": [120, 119.8, 60, 1],
    "compact": [["wendland_c2", "wendland_c4"], {"wendland_c4", "wendland_c2"}],
    "distances": ["rigid", [" Rigid"]],
    "turn": [[-10, 30]],
    "freedom": [[3, 4, 6]],
    "area": [1, 1.0],
    "points": [3],
    "inverse": [10],
    "backward": [80],
    "stretch": [-0.25],
    "sign": ["folds"],
    "limit": [47, 47.4, 6400 / 135],
}

WRONG: dict[str, list[Any]] = {
    "eye": [[1, 2], [3, 2], [2, 2], [3, 1], [2, 0], [0, 0], 2, "r2 c1"],
    "displacement": [[82, 5], [82, -5], [-82, 5], [-5, -82], [436, 14], [0, 0], -82],
    "grown": ["head", "tail", ["head", "middle"], ["head", "middle", "tail"], "belly"],
    "place": [[150, 100], [60, 150], [30, -20], [90, 60], [150], [150, 60, 0], 150, "150, 60"],
    "cells": [56, 72, 49, 48, "42", [42], -42, False],
    "shear": [0.35, -2.9, 0, -93, "-0.35", -0.2],
    "angle": [19, 109, 90, 1.24, 71 * np.pi / 180],
    "taper": [0.5, 2, -2, 0, "-1/2"],
    "polar": [[5, 0], [0, -5], [5, 90], 5, [0, 0]],
    "pairs": [
        ["sternoptyx", "antigonia"],
        "antigonia",
        "carp",
        ["sternoptyx", ""],
        ["sternoptyx", 3],
        ["sternoptyx", "pseudopriacanthus", "scorpaena", "antigonia", "orthagoriscus"],
    ],
    "between": [30, 12.5, 40, 10, "20"],
    "kernel": [0.0625, 0.5, 1.5, 0],
    "weights": [[10, 0], [-1.94, 10.36], [10.36], 10.36, [10.4, -1.9], [10, -2]],
    "support": [120.3, 240, 0, -120, [120]],
    "compact": [
        "wendland_c2",
        ["wendland_c2", "wendland_c4", "gaussian"],
        ["thin_plate"],
        ["wendland_c2"] * 2,
        "wendland_c2, wendland_c4",
    ],
    "distances": ["similar", "affine", "shear", ["rigid", "shear"], ["rigid", "similar", "affine", "shear"], "turn"],
    "turn": [[10, -30], [-30, -10], [10, 30], [30, -10], [30, 10], -10],
    "freedom": [[1, 2, 4], [3, 4, 4], [6, 4, 3], [3, 4], 3, [0, 0, 0]],
    "area": [2, 0.5, 2.5, 0, "1", [1]],
    "points": [6, 2, 4, 0, [3], "3"],
    "inverse": [70, 20, 5, "10"],
    "backward": [120, -20, 100, 0],
    "stretch": [0.25, -4, -5, 4, 0],
    "sign": ["grows", "shrinks", "stays", ["shrinks", "folds"], -0.4],
    "limit": [100, 50, 0.47, 0, 40],
}


def lesson_of(name: str) -> Lesson:
    return next(LESSONS[lesson] for lesson, known in ALL if known == name)


@pytest.mark.parametrize(("lesson", "name"), ALL)
def test_no_empty_answer_and_none_of_another_kind_passes(lesson: str, name: str) -> None:
    for answer in NEVER:
        result = LESSONS[lesson].check(name, answer)
        assert not result.right
        assert len(result.text) > 20


@pytest.mark.parametrize("name", RIGHT)
def test_right_answers_pass_and_wrong_ones_get_a_hint(name: str) -> None:
    for answer in RIGHT[name]:
        assert lesson_of(name).check(name, answer).right, answer
    hints = []
    for answer in WRONG[name]:
        result = lesson_of(name).check(name, answer)
        assert not result.right, answer
        hints.append(result.text)
    assert len(set(hints)) >= 3, "hints depend on what is wrong"


def test_every_exercise_has_right_and_wrong_answers_here_or_is_done_in_the_studio() -> None:
    names = [name for _, name in ALL]
    assert len(names) == len(set(names))
    plain = {name for lesson, name in ALL if isinstance(LESSONS[lesson].exercises[name], Numbers | Choice)}
    assert plain == set(RIGHT) == set(WRONG)
    assert all(isinstance(lesson_of(name).exercises[name], StudioTask | FishTask) for name in set(names) - plain)


def test_a_known_mistake_is_no_right_answer_and_each_wrong_choice_has_a_hint() -> None:
    for lesson, name in ALL:
        asked = LESSONS[lesson].exercises[name]
        if isinstance(asked, Numbers):
            for wrong, hint in asked.mistakes:
                assert asked.judge(wrong) == Result(False, hint), (name, wrong)
        if isinstance(asked, Choice):
            assert set(asked.mistakes) == set(asked.among) - set(asked.right)


def test_the_answers_about_sternoptyx_are_those_of_its_nodes() -> None:
    ways = thompson_grid("Sternoptyx").nodes[-1] - thompson_grid("Sternoptyx").nodes[0]
    lesson = LESSONS["coordinates"]
    for k in ways[:, 0] / ways[:, 1]:
        assert lesson.check("shear", k).right
        assert lesson.check("angle", 90 - np.degrees(np.arctan(-k))).right


def test_the_weights_solve_the_equations() -> None:
    points = dn.ControlPoints.from_arrays([[0, 0], [50, 0]], [[10, 0], [50, 0]])
    fit = dn.fit_rbf(points, support=100, trend="none")
    assert LESSONS["kernels"].check("kernel", (1 - 0.5) ** 4 * 3).right
    assert fit.displacement([[10.0, 0.0]])[0, 0] == pytest.approx(-10, abs=1e-4)
    assert LESSONS["kernels"].check("weights", np.linalg.solve([[1, 0.1875], [0.1875, 1]], [10, 0])).right


# ---- in the studio ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def carp() -> dn.Volume:
    return PHANTOMS["fish"].make((32, 64, 32))


def test_a_fish_is_scored_by_the_share_of_the_change(carp: dn.Volume) -> None:
    lesson = LESSONS["fish"]
    points = lesson.exercises["antigonia"].grids(carp).points  # type: ignore[attr-defined]
    points = points.take([8 * row + column for row in (0, 3, 6) for column in (0, 2, 4, 7)])
    session = Session(carp, dn.Deformation.from_picture_points(carp, "-x", points.reset()), view="-x")
    texts = []
    for answer in (points.reset(), points.scaled(0.3), points.scaled(-0.5)):
        session.editing.edit_points(answer)
        result = lesson.check("antigonia", session)
        assert not result.right
        texts.append(result.text)
    assert "Nothing has been dragged" in texts[0]
    assert "% is enough" in texts[1]
    assert "farther away than at the start" in texts[2]
    session.editing.edit_points(points)
    done = lesson.check("antigonia", session)
    assert done.right
    assert "Your fish: 7" in done.text
    assert "should go" in done.text
    assert "<svg" in done._repr_html_()
    assert "from the left" in lesson.check("antigonia", Session(carp, view="+y")).text


def test_rounded_weights_are_not_precise_enough_and_it_says_so() -> None:
    for answer in ([10.4, -1.9], [10.4, -1.94], [10.36, -1.9], [10, -2]):
        assert "rounded too much" in LESSONS["kernels"].check("weights", answer).text


# ---- lessons and results ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", LESSONS)
def test_the_notebook_asks_every_exercise_and_hides_its_solutions(name: str) -> None:
    lesson = LESSONS[name]
    cells = json.loads((NOTEBOOKS / lesson.notebook).read_text("utf-8"))["cells"]
    text = "\n".join("".join(cell["source"]) for cell in cells)
    assert f'LESSONS["{name}"]' in text
    assert f"**Time:** {lesson.time}." in text
    assert lesson.title.lower() in text.partition("\n")[0].lower()
    for goal in lesson.goals:
        assert goal in " ".join(text.split())
    asked = re.findall(r'lesson\.(?:check|ask|follow)\("(\w+)"', text)
    assert sorted(asked) == sorted(lesson.exercises)
    assert ("lesson.check" in text) == ("no programming" not in text), "what is no programming is answered in boxes"
    assert text.count("<details>") == text.count("</details>") >= len(asked) - 4
    shown = [cell for cell in cells if cell["cell_type"] == "code" and "answer = " in "".join(cell["source"])]
    assert all("answer = None" in "".join(cell["source"]) for cell in shown)


def test_unknown_exercises_are_refused_with_the_known() -> None:
    for name in ("", None, "sheer", 3):
        with pytest.raises(DeformError, match="eye, place, cells"):
            LESSONS["coordinates"].check(name, 1)  # type: ignore[arg-type]


def test_a_result_says_in_words_what_it_is_and_shows_no_foreign_markup() -> None:
    wrong = Result(False, "<script>alert(1)</script>")
    assert not wrong
    assert "<script>" not in wrong._repr_html_()
    assert "Not yet." in wrong._repr_html_()
    assert "Right." in Result(True, "So it is.")._repr_html_()
    assert "Your turn." in Result(False, "Give a number.", is_open=True)._repr_html_()


@pytest.mark.parametrize("name", LESSONS)
def test_what_was_not_answered_is_not_judged(name: str) -> None:
    lesson = LESSONS[name]
    carp = lesson_carp()
    for exercise, task in lesson.exercises.items():
        begin = Session(carp, lesson_start(name, carp)) if isinstance(task, StudioTask | FishTask) else None
        for answer in (None, begin):
            result = lesson.check(exercise, answer)
            assert (result.right, result.is_open) == (False, True), exercise
