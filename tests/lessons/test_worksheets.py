"""The worksheets: each is one page, nothing runs over its edge, all of it is translated, and its answers are right."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from deformnb.datasets import thompson_grid
from deformnb.errors import DeformError
from deformnb.words import LANGUAGES, translate
from deformnb_lessons import (
    GOAL_NODES,
    LESSONS,
    answers_figure,
    lesson_carp,
    worksheet_figure,
    write_answers,
    write_worksheet,
)
from deformnb_lessons.drawings import fish_task
from deformnb_lessons.worksheets import FISH_OUTLINE, HEIGHT, WIDTH, WORKSHEETS, Drawn, Task

EDGE = 10 / WIDTH
PAGES = [(name, code) for name in (*LESSONS, "answers") for code in LANGUAGES]


def _figure(name: str, code: str) -> Figure:
    return answers_figure(code) if name == "answers" else worksheet_figure(name, code)


def _answers(name: str) -> str:
    return " ".join(part.answer for part in WORKSHEETS[name] if isinstance(part, Task))


@pytest.mark.parametrize(("name", "code"), PAGES)
def test_a_sheet_is_within_the_edges_of_one_page_and_no_text_covers_another(name: str, code: str) -> None:
    figure = _figure(name, code)
    renderer = FigureCanvasAgg(figure).get_renderer()
    size = np.array([figure.bbox.width, figure.bbox.height])
    boxes = [text.get_window_extent(renderer).get_points() / size for text in figure.texts if text.get_text().strip()]
    assert len(boxes) > 8
    for low, high in boxes:
        assert low[0] > EDGE
        assert high[0] < 1 - EDGE
        assert low[1] > 5 / HEIGHT
    drawn = [axes.get_tightbbox(renderer).get_points() / size for axes in figure.axes]
    for (left, bottom), (right, top) in drawn:
        assert 0 < left < right < 1 - EDGE / 2
        over = [box for box in boxes if box[0][1] < top - 1e-3 and box[1][1] > bottom + 1e-3 and box[1][0] > left]
        assert not [box for box in over if box[0][0] < right], "a figure covers a text"


@pytest.mark.parametrize("name", LESSONS)
def test_every_question_and_answer_is_translated(name: str) -> None:
    for part in WORKSHEETS[name]:
        for text in (part.text, part.answer) if isinstance(part, Task) else ():
            if re.search(r"[^\W\d_]{3}", text):
                assert translate(text, "de") != text, text
                assert translate(text, "de").count("____") == text.count("____"), text
                assert not re.search(r"\d\.\d", translate(text, "de")), text


def test_each_lesson_has_a_sheet_with_a_figure_and_places_to_fill_in() -> None:
    assert list(WORKSHEETS) == list(LESSONS)
    for parts in WORKSHEETS.values():
        assert any(isinstance(part, Drawn) for part in parts)
        asked = [part for part in parts if isinstance(part, Task)]
        assert sum("____" in part.text or part.lines > 0 for part in asked) >= 3


def test_the_first_sheet_has_his_drawings_and_the_second_his_nodes() -> None:
    first, second = worksheet_figure("coordinates").axes[:2]
    for axes, name in ((first, "Polyprion"), (second, "Antigonia")):
        assert axes.images[0].get_array().shape == ({"Polyprion": (361, 449), "Antigonia": (400, 307)}[name]), (
            "his plate"
        )
        assert axes.get_title() == thompson_grid(name).species
    places = [text.get_text() for text in worksheet_figure("fish").axes[0].texts]
    points = fish_task().grids(lesson_carp()).points.take(GOAL_NODES)
    assert places == [f"{name}: ({a:.0f}, {b:.0f})" for name, (a, b) in zip(points.names, points.target, strict=True)]


def test_numbers_of_the_answers_are_computed_again() -> None:
    s = np.arange(5) / 4
    kernel = (1 - s) ** 4 * (4 * s + 1)
    assert "1, 0.633, 0.1875, 0.016 and 0" in _answers("kernels")
    np.testing.assert_allclose(kernel, [1, 0.633, 0.1875, 0.016, 0], atol=5e-4)
    weights = np.linalg.solve([[1, 0.1875], [0.1875, 1]], [10, 0])
    assert "w1 = {:.2f} and w2 = {:.2f}".format(*weights) in _answers("kernels")
    y = np.arange(-100, 101, 25)
    read = y - 80 * kernel[np.abs(y) // 25]
    assert ", ".join(f"{value:.0f}" for value in read) in _answers("folding")
    assert y[np.flatnonzero(np.diff(read) < 0)].tolist() == [-50, -25], "it falls from -50 to 0"
    a, b = FISH_OUTLINE[:-1].T
    turned = np.column_stack([-b, a])
    assert _places(turned) in _answers("affine")
    assert _places(np.column_stack([2 * a + b, b / 2 + 10])) in _answers("affine")
    assert _places(np.add(turned[:1], (24, 0))) + "." in _answers("affine")
    grids = fish_task().grids(lesson_carp())
    points = grids.points.take(GOAL_NODES)
    displacements = points.target.round() - points.source.round()
    assert f"r0 c7: {_places(displacements[3:4])}; r3 c2: {_places(displacements[5:6])}" in _answers("fish")
    farthest = np.linalg.norm(points.displacement, axis=1).argsort()
    assert [points.names[k] for k in farthest[-2:]] == ["r0 c0", "r6 c0"]
    said = [int(count) for count in re.findall(r"about (\d+) before and (\d+)", _answers("fish")) for count in count]
    both = (grids.source_nodes, grids.target_nodes)
    counted = [_area(nodes, *columns) / 100 for columns in ((2, 4), (4, 7)) for nodes in both]
    np.testing.assert_allclose(said, counted, rtol=0.02)


def _places(corners: np.ndarray) -> str:
    return ", ".join(f"({x:g}, {y:g})" for x, y in corners + 0.0)


def _area(nodes: np.ndarray, first: int, last: int) -> float:
    x, y = np.array([*nodes[[0], [first]], *nodes[[0, 3, 6], last], *nodes[[6, 3], first]]).T
    return float(abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2)


def test_a_sheet_is_written_as_a_pdf_of_one_page(tmp_path: Path) -> None:
    write_worksheet("affine", tmp_path / "affine.pdf", language="de")
    write_answers(tmp_path / "answers.pdf")
    for path in tmp_path.glob("*.pdf"):
        data = path.read_bytes()
        assert data.startswith(b"%PDF")
        assert len(re.findall(rb"/Type\s*/Page\b", data)) == 1
        assert re.search(rb"/MediaBox \[ 0 0 595\.\d+ 841\.\d+ \]", data), "A4"
        assert len(data) < 200_000
    with pytest.raises(DeformError, match="choose one of coordinates, fish"):
        write_worksheet("carp", tmp_path / "carp.pdf")
