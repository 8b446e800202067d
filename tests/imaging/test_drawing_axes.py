"""Drawing into axes of a figure of one's own: all functions that make a figure can, and the figure stays as it was."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from test_entrances import public

import deformnb as dn
from deformnb.errors import DeformError
from deformnb.imaging import drawing, figures, thompson

VOLUME = dn.Volume.from_array(np.random.default_rng(1).integers(0, 255, (6, 20, 24)).astype(np.uint8))
PICTURE = dn.project(VOLUME, "+z")
POINTS = dn.ControlPoints.from_arrays([[4, 4], [18, 5], [9, 15]], [[4, 4], [18, 6], [10, 15]])
DEFORMATION = dn.Deformation.from_picture_points(VOLUME, "+z", POINTS)

DRAWN: dict[str, tuple[int, Callable[[Any], Any]]] = {
    "draw_pictures": (
        2,
        lambda axes: dn.draw_pictures([PICTURE] * 2, points=[POINTS, None], titles=["a", "b"], ax=axes),
    ),
    "draw_grids": (2, lambda axes: dn.draw_grids(DEFORMATION, PICTURE, overlay="area", title="carp", axes=axes)),
    "draw_figure": (
        3,
        lambda axes: figures.draw_figure(
            [[figures.Panel(PICTURE, "one"), figures.Panel(PICTURE, points=POINTS)], [figures.Panel(box=(0, 2, 0, 1))]],
            axes=axes,
        ),
    ),
}
"""Functions that draw into axes, with the number of these."""

PAGES = {
    "answers_figure": "a page for a printer, of its size",
    "worksheet_figure": "a page for a printer, of its size",
}
"""Functions that make a figure and take no axes, and why."""


def state(figure: Figure) -> Any:
    """Properties of the figure itself and not of its axes."""
    return (
        tuple(figure.get_size_inches()),
        figure.get_facecolor(),
        [place.get_position().bounds for place in figure.axes],
        [text.get_text() for text in figure.texts],
        len(figure.artists) + len(figure.lines) + len(figure.patches),
        figure.get_dpi(),
    )


def test_every_function_that_makes_a_figure_takes_axes_or_says_why_not() -> None:
    found = {}
    for one in [*public(), *(getattr(m, n) for m in (drawing, figures, thompson) for n in dir(m) if n[0] == "d")]:
        if inspect.isfunction(one) and re.search(r"\bFigure\b", str(inspect.signature(one).return_annotation)):
            found[one.__name__] = {"ax", "axes"} & set(inspect.signature(one).parameters)
    assert {name for name, axes in found.items() if axes} == set(DRAWN)
    assert {name for name, axes in found.items() if not axes} == set(PAGES)


@pytest.mark.parametrize("name", DRAWN)
def test_a_figure_of_ones_own_stays_as_it_was(name: str) -> None:
    count, draw = DRAWN[name]
    figure = Figure(figsize=(5, 3), facecolor="pink")
    axes = figure.subplots(1, count + 1)
    figure.suptitle("a title of my own")
    before = state(figure)
    found = draw(axes[:count])
    figure.draw_without_rendering()
    assert found is figure
    assert state(figure)[:2] == before[:2]
    assert state(figure)[3:] == before[3:]
    for one, box in zip(axes, before[2], strict=True):
        assert one.get_position(original=True).bounds == box
    assert all(one.has_data() for one in axes[:count] if name != "draw_figure" or one is not axes[2])
    assert not axes[count].has_data()


@pytest.mark.parametrize("name", DRAWN)
def test_a_part_of_a_figure_is_drawn_into(name: str) -> None:
    count, draw = DRAWN[name]
    figure = Figure()
    part = figure.subfigures(1, 2)[0]
    assert draw(part.subplots(1, count)) is figure


def test_one_picture_takes_one_axes() -> None:
    place = Figure().subplots()
    assert dn.draw_pictures(PICTURE, ax=place) is place.figure
    assert len(place.images) == 1


def test_the_pictures_are_those_of_a_figure_of_our_own() -> None:
    figure = Figure()
    axes = figure.subplots(1, 2)
    dn.draw_grids(DEFORMATION, PICTURE, axes=axes)
    own = dn.draw_grids(DEFORMATION, PICTURE)
    ours, given = (one.axes[0].images[0].get_array() for one in (own, figure))
    np.testing.assert_array_equal(ours, given)


@pytest.mark.parametrize("name", DRAWN)
def test_other_axes_are_refused_in_a_sentence(name: str) -> None:
    count, draw = DRAWN[name]
    with pytest.raises(DeformError, match=f"{count} axes are needed"):
        draw(list(Figure().subplots(1, count + 1)))
    with pytest.raises(DeformError, match="axes of Matplotlib are needed"):
        draw("left")


def test_axes_and_a_path_exclude_each_other(tmp_path: Path) -> None:
    with pytest.raises(DeformError, match="its savefig"):
        dn.draw_pictures(PICTURE, ax=Figure().subplots(), path=tmp_path / "a.png")
