"""Figures of several panels: where things are drawn, and how a grid splits along a cut."""

from __future__ import annotations

from typing import Any

import numpy as np
import oracle
import pytest

from deformnb.document.deformation import Step
from deformnb.errors import DeformError
from deformnb.imaging.drawing import STYLES
from deformnb.imaging.figures import (
    CUT_COLOUR,
    SIDE_COLOURS,
    Panel,
    deform_lines,
    draw_figure,
    picture_field,
    rectangular_grid,
    trim,
)
from deformnb.rbf.cuts import Cut, Decoupled
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Line, Polygon
from deformnb.rbf.rigid import RigidPart
from deformnb.volume.plane import Picture, Plane, Raster
from deformnb.volume.volume import Grid

GRID = Grid((4, 4, 20))
PLANE = Plane.from_view(GRID, "+y")
MIDDLE = Cut(Line([(10, 9), (10, 0)]))  # upwards: its left is inside
PULL = ControlPoints.from_arrays([[2, 1], [2, 3], [17, 1], [17, 3]], [[1, 1], [1, 3], [19, 1], [19, 3]])


def pixels(figure: Any) -> np.ndarray:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].astype(int)


def near(image: np.ndarray, color: str, tolerance: int = 40) -> np.ndarray:
    wanted = [int(color[k : k + 2], 16) for k in (1, 3, 5)]
    return np.abs(image - wanted).sum(axis=-1) < tolerance


def at(figure: Any, axes: Any, place: tuple[float, float]) -> tuple[int, int]:
    """Row and column of a place of a panel in the drawn figure."""
    x, y = axes.transData.transform(place)
    return round(figure.bbox.height - y), round(x)


# ---- arrangement -----------------------------------------------------------------------------------------------------


def test_panels_of_a_row_are_equally_high_and_fill_it() -> None:
    figure = draw_figure([[Panel(box=(0, 3, 0, 1)), Panel(box=(0, 1, 0, 1))], [Panel(box=(0, 9, 0, 1))]])
    first, second, third = (axes.get_position() for axes in figure.axes)
    oracle.assert_close(first.height, second.height, atol=1e-9)
    assert first.x1 < second.x0
    assert third.y1 < first.y0
    oracle.assert_close((second.x1 - first.x0) * 7.5, 7.3, atol=1e-9)
    oracle.assert_close((third.x1 - third.x0) * 7.5, 7.3, atol=1e-9)


def test_letters_run_on_through_the_rows() -> None:
    panel = Panel(box=(0, 1, 0, 1), caption="$x$")
    figure = draw_figure([[panel, panel], [panel]])
    assert [axes.texts[0].get_text() for axes in figure.axes] == ["(a) $x$", "(b) $x$", "(c) $x$"]
    plain = draw_figure([[panel]], lettered=False)
    assert plain.axes[0].texts[0].get_text() == "$x$"


def test_a_row_is_no_higher_than_asked_for() -> None:
    figure = draw_figure([[Panel(box=(0, 1, 0, 4))]], tallest=2.0)
    (axes,) = figure.axes
    oracle.assert_close(axes.get_position().height * figure.get_figheight(), 2.0, atol=1e-9)


def test_a_figure_is_written(tmp_path: Any) -> None:
    draw_figure([[Panel(box=(0, 1, 0, 1))]], path=tmp_path / "figure.png")
    assert (tmp_path / "figure.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: draw_figure([]), "at least one row"),
        (lambda: draw_figure([[]]), "at least one panel"),
        (lambda: draw_figure([[Panel(box=(0, 1, 0, 1))]], style="neon"), "unknown style"),
        (Panel, "needs a box or a grid"),
        (lambda: Panel(np.zeros((4, 4), np.uint8)), "array \\(height, width, 3\\)"),
        (lambda: Panel(box=(0, 1, 0, 1), at="nowhere"), "points are shown at"),
    ],
)
def test_what_cannot_be_drawn_is_said(make: Any, words: str) -> None:
    with pytest.raises(DeformError, match=words):
        make()


# ---- drawing ---------------------------------------------------------------------------------------------------------


def test_points_have_the_colour_of_their_side() -> None:
    figure = draw_figure([[Panel(points=PULL, at="target", cuts=(MIDDLE,), box=(0, 20, -1, 5))]], lettered=False)
    image, (axes,) = pixels(figure), figure.axes
    for place, color in (
        ((1, 1), SIDE_COLOURS[1]),
        ((1, 3), SIDE_COLOURS[1]),
        ((19, 1), SIDE_COLOURS[0]),
        ((19, 3), SIDE_COLOURS[0]),
    ):
        assert near(image[at(figure, axes, place)], color)


def test_the_line_of_a_cut_is_yellow_through_the_whole_panel() -> None:
    figure = draw_figure([[Panel(cuts=(MIDDLE,), box=(0, 20, -5, 15))]], lettered=False)
    image, (axes,) = pixels(figure), figure.axes
    yellow = near(image, CUT_COLOUR)
    for b in (-4, 4, 14):
        row, column = at(figure, axes, (10, b))
        assert yellow[row, column - 1 : column + 2].any()
        assert not yellow[row, : column - 4].any()
        assert not yellow[row, column + 5 :].any()


def test_the_line_of_a_cut_that_stops_is_drawn_to_its_tip() -> None:
    cut = Cut(Line([(10, 15), (10, 2)], stops=(False, True)))
    figure = draw_figure([[Panel(cuts=(cut,), box=(0, 20, -5, 15))]], lettered=False)
    image, (axes,) = pixels(figure), figure.axes
    yellow = near(image, CUT_COLOUR)
    for b, is_drawn in ((14, True), (3, True), (1, False), (-4, False)):
        row, column = at(figure, axes, (10, b))
        assert yellow[row, column - 1 : column + 2].any() == is_drawn


def test_rigid_parts_are_shaded() -> None:
    part = RigidPart(Polygon([(2, 1), (6, 1), (6, 4), (2, 4)]))
    figure = draw_figure([[Panel(parts=(part,), box=(0, 20, -1, 5))]], lettered=False)
    image, (axes,) = pixels(figure), figure.axes
    paper = near(image, STYLES["paper"].paper, 10)
    assert not paper[at(figure, axes, (4, 2.5))]
    assert paper[at(figure, axes, (9, 2.5))]


def test_a_picture_and_an_image_lie_where_they_should() -> None:
    values = np.zeros((10, 20), np.uint8)
    values[2:4, 15:18] = 255  # centred at a = 16, b = 2.5
    picture = Picture(values, PLANE, Raster((10, 20), (1.0, 1.0), (0.0, 0.0)), "mip", (0, 255))
    image = np.zeros((10, 20, 3), np.uint8)
    image[2:4, 15:18] = (255, 0, 0)
    figure = draw_figure([[Panel(picture)], [Panel(image)]])
    drawn = pixels(figure)
    first, second = figure.axes
    assert near(drawn[at(figure, first, (16, 2.5))], STYLES["paper"].bright)
    assert near(drawn[at(figure, first, (5, 7))], STYLES["paper"].dark)
    assert near(drawn[at(figure, second, (16, 2.5))], "#FF0000")
    assert near(drawn[at(figure, second, (5, 7))], "#000000")


def test_trimmed_images_keep_their_rows_together() -> None:
    one, two = np.zeros((2, 40, 60, 3), np.uint8)
    one[10:20, 5:9] = 200
    two[12:30, 40:50] = 200
    first, second = trim([one, two], margin=0.0)
    assert first.shape == (20, 4, 3)
    assert second.shape == (20, 10, 3)
    assert trim([np.zeros((4, 4, 3), np.uint8)])[0].shape == (4, 4, 3)


# ---- grids -----------------------------------------------------------------------------------------------------------


def test_a_grid_has_its_lines_on_the_box() -> None:
    lines = rectangular_grid((1, 5, 2, 4), 4, 2)
    assert len(lines) == 3 + 5
    assert lines[0].tolist() == [[1, 2], [2, 2], [3, 2], [4, 2], [5, 2]]
    assert lines[-1].tolist() == [[5, 2], [5, 3], [5, 4]]


def test_lines_move_with_the_matter() -> None:
    shift = ControlPoints.from_arrays([[0, 0], [4, 0], [0, 4]], [[1, 2], [5, 2], [1, 6]])
    field = picture_field(Step((shift,), PLANE), GRID)
    (line,) = deform_lines([[[0, 0], [4, 4]]], field, parts=2)
    oracle.assert_close(line, [[1, 2], [3, 4], [5, 6]], atol=1e-5)


def test_a_grid_splits_along_a_cut() -> None:
    field = picture_field(Step((PULL,), PLANE, cuts=(MIDDLE,), trend="translation"), GRID)
    assert isinstance(field, Decoupled)
    left, right, beside = deform_lines([[[0, 2], [20, 2]], [[4, 0], [4, 3]]], field)
    oracle.assert_close(left[[0, -1]], [[-1, 2], [9, 2]], atol=1e-4)
    oracle.assert_close(right[[0, -1]], [[12, 2], [22, 2]], atol=1e-4)
    oracle.assert_close(beside[[0, -1]], [[3, 0], [3, 3]], atol=1e-4)


def test_the_papers_rule_hides_what_crosses_the_line() -> None:
    both = ControlPoints.from_arrays([[2, 1], [17, 1]], [[5, 1], [20, 1]])  # all to the right by 3
    step = Step((both,), PLANE, cuts=(MIDDLE,), trend="translation", cut_rule="paper")
    left, right = deform_lines([[[0, 2], [20, 2]]], picture_field(step, GRID), parts=200)
    oracle.assert_close([left[0, 0], left[-1, 0]], [3, 10], atol=0.2)
    oracle.assert_close([right[0, 0], right[-1, 0]], [13, 23], atol=0.2)


def test_points_in_space_deform_no_picture() -> None:
    step = Step((ControlPoints.from_arrays([[0, 0, 0]], [[1, 0, 0]]),))
    with pytest.raises(DeformError, match="no picture"):
        picture_field(step, GRID)
