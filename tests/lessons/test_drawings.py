"""The figures of the first lesson: they show Thompson's own drawings with their nodes, and follow what a pupil does."""

from __future__ import annotations

import io
import json
import re
from base64 import b64decode

import numpy as np
import pytest
from PIL import Image

import deformnb as dn
from deformnb.datasets import PLATE_SOURCE, thompson_grid
from deformnb.errors import DeformError
from deformnb.session.session import Session
from deformnb_lessons import GOAL_NODES, LESSONS, lesson_carp, lesson_start
from deformnb_lessons.command import lesson_notebook
from deformnb_lessons.drawing_parts import Drawing, Table, rule_nodes
from deformnb_lessons.drawings import DRAWINGS, fish_task
from deformnb_lessons.explorers import GrownFigure, RuleExplorer


def test_the_notebooks_draw_every_figure_and_no_other() -> None:
    text = "".join(lesson_notebook(name).read_text("utf-8") for name in LESSONS)
    assert set(re.findall(r'lesson\.draw\(\\"(\w+)\\"', text)) == set(DRAWINGS)
    with pytest.raises(DeformError, match="choose one of plates, place"):
        LESSONS["fish"].draw("plate")


def test_each_drawing_is_a_picture_with_a_description() -> None:
    for name in ("plates", "place", "rules", "shear", "simple", "goal"):
        drawing = LESSONS["coordinates"].draw(name)
        assert isinstance(drawing, Drawing)
        data, more = drawing._repr_mimebundle_()
        assert more["image/png"]["alt"] == data["text/plain"] == repr(drawing)
        image = np.asarray(Image.open(io.BytesIO(drawing.png())).convert("L"))
        assert image.std() > 10
        dn.set_language("de")
        assert repr(LESSONS["coordinates"].draw(name)) != repr(drawing)
        dn.set_language(None)


def test_the_first_figure_of_the_lesson_is_his_two_drawings_with_their_nodes_and_source() -> None:
    cells = json.loads(lesson_notebook("coordinates").read_text("utf-8"))["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    assert code[1] == 'lesson.draw("plates")'
    figure = LESSONS["coordinates"].draw("plates").figure
    for axes, name in zip(figure.axes, ("Polyprion", "Antigonia"), strict=True):
        (dots,) = axes.lines
        nodes = thompson_grid(name).nodes
        np.testing.assert_array_equal(dots.get_xydata(), nodes.reshape(-1, 2))
        image = axes.images[0].get_array()
        left, _right, _bottom, top = axes.images[0].get_extent()
        # The nodes are on the printed lines: darker than the drawing is on average.
        grey = np.array([_darkest(image, *(np.rint(node - (left, top)).astype(int))) for node in nodes.reshape(-1, 2)])
        assert np.mean(grey < image.mean() / 2) > 0.9
    assert figure.get_supxlabel() == PLATE_SOURCE


def _darkest(image: np.ndarray, a: int, b: int) -> float:
    return float(image[max(0, b - 2) : b + 3, max(0, a - 2) : a + 3].min())


def test_the_table_has_the_places_to_which_the_points_of_the_studio_go() -> None:
    table = LESSONS["fish"].draw("nodes")
    assert isinstance(table, Table)
    points = fish_task().grids(lesson_carp()).points.take(GOAL_NODES)
    assert [row[0] for row in table.rows] == list(points.names)
    assert "(436, 14)" in table._repr_html_()
    assert [float(x) for row in table.rows for x in row[2].strip("()").split(", ")] == list(
        points.target.round().reshape(-1)
    )


def test_sliders_bend_the_grid_by_the_rules_of_the_lesson() -> None:
    explorer = RuleExplorer()
    square = explorer.children[-1].value
    explorer.shear.value = 0.5
    sheared = explorer.children[-1].value
    explorer.taper.value = -0.5
    assert len({square, sheared, explorer.children[-1].value}) == 3
    start, bent = rule_nodes(0, 0), rule_nodes(0.5, 0)
    np.testing.assert_allclose(bent[..., 0], start[..., 0] + 0.5 * start[..., 1])
    high = np.ptp(rule_nodes(0, -0.5)[..., 1], axis=0)
    assert high[-1] == pytest.approx(high[0] / 2)
    assert "image/png" in explorer._repr_mimebundle_()


def test_the_areas_are_drawn_when_the_button_is_pressed_and_a_hint_before_anything_is_dragged() -> None:
    carp = lesson_carp()
    session = Session(carp, lesson_start("fish", carp))
    shown = GrownFigure(session)
    shown.button.click()
    picture = shown.children[-1]
    assert "Nothing has been dragged" in shown.note.value
    assert picture.value == ""
    session.editing.edit_points(fish_task().grids(carp).points.take(GOAL_NODES))
    shown.button.click()
    assert shown.note.value == ""
    assert 'alt="Colours:' in picture.value
    png = b64decode(picture.value.split("base64,")[1].split('"')[0])
    image = np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)
    green = (image[..., 1] > image[..., 0] + 30) & (image[..., 1] > image[..., 2] + 15)
    assert green.sum() > 500, "the middle has grown"
    with pytest.raises(DeformError, match="figure is of a studio"):
        GrownFigure(7)
