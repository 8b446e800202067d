"""Worksheets of the lessons for printing, a page of A4 each, and one page with all answers for the teacher."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from deformnb.checks import check_choice
from deformnb.datasets import PLATE_SOURCE
from deformnb.imaging.drawing import save_figure
from deformnb.io.files.atomic import check_target
from deformnb.io.files.paths import as_path
from deformnb.words import translate
from deformnb_lessons.drawing_parts import NODES, draw_grid, draw_nodes, draw_numbers, draw_plate, draw_squares
from deformnb_lessons.drawings import fish_task
from deformnb_lessons.fish import GOAL_NODES
from deformnb_lessons.lesson import LESSONS
from deformnb_lessons.moved_animal import lesson_carp

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH, HEIGHT = 210.0, 297.0
"""A page of A4, in millimetres."""

_MARGIN = 15.0  # millimetres
_INCH = 25.4
_POINT = _INCH / 72
_LEADING = 1.35  # from line to line, of the size of the letters
_GAP = 3.0  # millimetres between blocks
_INK = "#202020"
_BLANK = re.compile(r" (?=[_,)])|(?<=_) (?=mm)")  # no line ends within a blank and what belongs to it


@dataclass(frozen=True)
class Task:
    """One question of a worksheet.

    Parameters
    ----------
    text : the question; "____" is a blank.
    answer : for the teacher.
    lines : blank lines below it.
    """

    text: str
    answer: str
    lines: int = 0


@dataclass(frozen=True)
class Drawn:
    """A figure of a worksheet.

    Parameters
    ----------
    height : in millimetres.
    draw : draws on as many axes as there are widths.
    widths : of the axes, relative to each other.
    head, foot : millimetres above it for titles, and below it for the labels of an axis.
    """

    height: float
    draw: Callable[..., None]
    widths: tuple[float, ...] = (1.0,)
    head: float = 0.0
    foot: float = 0.0


class Sheet:
    """A page that is filled from top to bottom.

    Parameters
    ----------
    title : of the page.
    language : of the text, None for the one that was chosen.
    size : of the letters, points.
    """

    def __init__(self, title: str, language: str | None, size: float = 10.0) -> None:
        from matplotlib.figure import Figure

        self.figure: Figure = Figure(figsize=(WIDTH / _INCH, HEIGHT / _INCH), facecolor="white")
        self._language, self._size, self.down = language, size, _MARGIN
        self.write(title, size=15, weight="bold")

    def write(self, text: str, *, size: float | None = None, indent: float = 0.0, **style: Any) -> None:
        """Write a text in lines of the width of the page."""
        size = size or self._size
        left = _MARGIN + indent
        joined = _BLANK.sub("\u00a0", translate(text, self._language))
        for line in _wrapped(joined, WIDTH - _MARGIN - left, size):
            self.down += size * _POINT * _LEADING
            self._text(left, self.down, line, size, **style)
        self.down += _GAP / 2

    def rule(self, count: int) -> None:
        """Draw blank lines to write on."""
        for _ in range(count):
            self.down += 9
            self._line(_MARGIN, WIDTH - _MARGIN, self.down)
        self.down += _GAP

    def draw(self, drawn: Drawn) -> None:
        """Draw a figure over the width of the page."""
        self.down += _GAP + drawn.head
        room, left = WIDTH - 2 * _MARGIN - 6.0 * (len(drawn.widths) - 1), _MARGIN
        axes = []
        for width in (room * share / sum(drawn.widths) for share in drawn.widths):
            bottom = HEIGHT - self.down - drawn.height
            axes.append(self.figure.add_axes((left / WIDTH, bottom / HEIGHT, width / WIDTH, drawn.height / HEIGHT)))
            left += width + 6.0
        drawn.draw(*axes)
        self.down += drawn.height + drawn.foot + _GAP

    def _text(self, left: float, down: float, text: str, size: float, **style: Any) -> None:
        self.figure.text(
            left / WIDTH, 1 - down / HEIGHT, text, fontsize=size, color=_INK, parse_math=False, va="baseline", **style
        )

    def _line(self, left: float, right: float, down: float) -> None:
        from matplotlib.lines import Line2D

        height = 1 - down / HEIGHT
        self.figure.add_artist(Line2D([left / WIDTH, right / WIDTH], [height] * 2, color="#999", linewidth=0.5))

    def write_foot(self, text: str) -> None:
        """Write a small line at the bottom of the page."""
        self._text(_MARGIN, HEIGHT - 8, translate(text, self._language), 6.5)


def _wrapped(text: str, width: float, size: float) -> list[str]:
    """Lines of a text that are no wider than this, in millimetres."""
    from matplotlib.font_manager import FontProperties, findfont, get_font

    font = get_font(findfont(FontProperties()))
    font.set_size(size, 72)

    def length(line: str) -> float:
        font.set_text(line)
        return float(font.get_width_height()[0]) / 64 * _POINT

    lines = [""]
    for word in text.split(" "):
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and length(longer) > width:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


# ---- figures ---------------------------------------------------------------------------------------------------------


def _two_plates(first: Axes, second: Axes) -> None:
    for axes, name in ((first, "Polyprion"), (second, "Antigonia")):
        draw_plate(axes, name)


def _squares_for_a_shear(axes: Axes) -> None:
    a, b = np.meshgrid(np.linspace(60, 120, 7), np.linspace(10, 50, 5))
    draw_squares(axes, (0, 180, 0, 60), 5, every=2)
    nodes = np.dstack([a, b])
    draw_grid(axes, nodes, linewidth=1.2)
    draw_numbers(axes, nodes)
    axes.set(xlim=(0, 180), ylim=(60, 0))
    axes.set_axis_off()


def _squares_for_the_fish(axes: Axes) -> None:
    grids = fish_task().grids(lesson_carp())
    draw_squares(axes, (-20, 540, -50, 250), 10)
    draw_grid(axes, grids.source_nodes, color="#777", linewidth=0.8)
    draw_nodes(axes, grids.source_nodes.reshape(-1, 2)[GOAL_NODES])
    for name, place in zip(grids.points.take(GOAL_NODES).names, grids.points.take(GOAL_NODES).source, strict=True):
        axes.annotate(name, place, (2, 2), textcoords="offset points", fontsize=5.5, color=NODES)
    axes.set(xticks=range(0, 501, 50), yticks=range(-50, 251, 50))
    axes.xaxis.tick_top()
    axes.tick_params(labelsize=6, length=2)


def _table_of_nodes(axes: Axes) -> None:
    points = fish_task().grids(lesson_carp()).points.take(GOAL_NODES)
    names = [f"{name}: ({a:.0f}, {b:.0f})" for name, (a, b) in zip(points.names, points.target, strict=True)]
    for k, text in enumerate(names):
        axes.text(k % 4 / 4, 1 - (k // 4 + 0.5) / 3, text, fontsize=9, va="center", color=_INK)
    axes.set_axis_off()


def _squares_for_a_bump(axes: Axes) -> None:
    axes.set(xlim=(-100, 150), ylim=(-3, 11))
    axes.axhline(0, color=_INK, linewidth=0.9)
    axes.set(xticks=range(-100, 151, 25), yticks=range(-2, 11, 2), xlabel="mm", ylabel="mm")
    axes.tick_params(labelsize=7)
    axes.grid(color="#7fa7c9", linewidth=0.4)


FISH_OUTLINE = np.array([[0, 2], [2, 0.5], [5, 1], [7, 0], [7, 4], [5, 3], [2, 3.5], [0, 2]])
"""A fish of seven straight lines, which pupils can move corner by corner."""


def _squares_for_maps(axes: Axes) -> None:
    draw_squares(axes, (-10, 26, -2, 16), 1, every=2)
    axes.plot(*FISH_OUTLINE.T, color=_INK, linewidth=1.4)
    axes.axhline(0, color=_INK, linewidth=0.8)
    axes.axvline(0, color=_INK, linewidth=0.8)
    axes.text(25.4, -0.3, "a", fontsize=9)
    axes.text(0.3, 15.7, "b", fontsize=9)
    axes.set(xlim=(-10, 26), ylim=(16, -2), xticks=range(-10, 26, 2), yticks=range(0, 16, 2))
    axes.tick_params(labelsize=6, length=2)


def _squares_for_a_fold(axes: Axes) -> None:
    draw_squares(axes, (-120, 120, -120, 120), 10, every=5)
    axes.plot([-120, 120], [-120, 120], color="#777", linewidth=1, linestyle="--")
    axes.set(aspect="auto", xlim=(-120, 120), ylim=(-120, 120), xlabel="y, mm", ylabel="y + D, mm")
    axes.set(xticks=range(-100, 101, 50), yticks=range(-100, 101, 50))
    axes.tick_params(labelsize=7)


# ---- the sheets ------------------------------------------------------------------------------------------------------

WORKSHEETS: dict[str, tuple[Task | Drawn, ...]] = {
    "coordinates": (
        Drawn(78, _two_plates, (1.35, 1), head=5),
        Task(
            "1. Which node is nearest? Polyprion's eye: r__ c__. Its mouth: r__ c__. The end of its lower jaw, "
            "the root of the tail fin and the tip of the belly fin: mark the same three in both drawings.",
            "Eye r2 c1, mouth r3 c0. Each mark is in the same cell of both grids.",
        ),
        Task("2. How many cells has the grid? ______", "6 x 7 = 42."),
        Task(
            "3. A point at (120, 80) is dragged 30 mm to the right and 20 mm up. Where is it now? ( ______ , ______ )",
            "(150, 60): b grows downwards.",
        ),
        Task(
            "4. Draw this grid after a shear with k = -1/2: row 0 stays, and each row below goes to the left by "
            "half of its depth. Then draw a fish in both.",
            "Rows 0 to 4 move by 0, 1, 2, 3 and 4 small squares to the left: the lowest by 20 mm, that is half "
            "of 40 mm.",
        ),
        Drawn(62, _squares_for_a_shear),
        Task(
            "5. Which of these is a shear, which a taper: Sternoptyx, Pseudopriacanthus? And Antigonia?",
            "Sternoptyx is a shear, Pseudopriacanthus nearly a taper, Antigonia neither.",
            1,
        ),
    ),
    "fish": (
        Task(
            "1. Thompson's 12 nodes go to these places. Mark each, draw an arrow to it, and join the marks: rows "
            "and columns of Antigonia. One small square is 10 mm.",
            "The grid of Antigonia, as in his drawing.",
        ),
        Drawn(18, _table_of_nodes),
        Drawn(96, _squares_for_the_fish),
        Task(
            "2. The displacement of r0 c7: ( ______ , ______ ). Of r3 c2: ( ______ , ______ ). Which node goes "
            "farthest? ________",
            "r0 c7: (-82, -5); r3 c2: (5, 11). Farthest goes r6 c0, by 89 mm, and r0 c0 by 88 mm.",
        ),
        Task(
            "3. Count small squares in the part between columns 2 and 4: before ______, after ______. In the "
            "part between columns 4 and 7: before ______, after ______. What has grown, and what has shrunk?",
            "Between columns 2 and 4 about 235 before and 280 after; between columns 4 and 7 about 350 before "
            "and 315 after (with straight lines between the marks). The middle has grown, the tail has shrunk.",
            1,
        ),
        Task(
            "4. Would an animal grow like that? What does the bent grid show, and what does it not show?",
            "It compares two adult forms, everywhere at once. It shows no growth of one animal, and no cause.",
            2,
        ),
    ),
    "kernels": (
        Task(
            "1. Wendland's kernel is \u03c6 = (1 - s)\u2074 (4 s + 1), with s = r / 100 mm, and 0 beyond 100 mm. "
            "Compute: \u03c6(0) = ______, \u03c6(25 mm) = ______, \u03c6(50 mm) = ______, \u03c6(75 mm) = "
            "______, \u03c6(100 mm) = ______",
            "In this order 1, 0.633, 0.1875, 0.016 and 0.",
        ),
        Task(
            "2. Two points are 50 mm apart. The first is dragged by 10 mm, the second stays. The weights solve "
            "w\u2081 + 0.1875 w\u2082 = 10 and 0.1875 w\u2081 + w\u2082 = 0. w\u2081 = ______, w\u2082 = ______",
            "w1 = 10.36 and w2 = -1.94.",
            2,
        ),
        Task(
            "3. Draw the bump of the first point, at 0 mm, the bump of the second, at 50 mm, and their sum. "
            "Which two places do you know before?",
            "The sum passes through (0, 10) and (50, 0). The first bump is 10.36 high, the second -1.94 deep.",
        ),
        Drawn(120, _squares_for_a_bump, foot=9),
        Task(
            "4. A place 120 mm away must stay. How large may the support radius be? ______ mm",
            "120 mm at most.",
        ),
        Task(
            "5. What changes when a third point is added in between?",
            "The sum passes through that one too, and all three weights are new.",
            1,
        ),
    ),
    "affine": (
        Task(
            "1. Turn the fish by 90 degrees about (0, 0), clockwise as you look at it: a' = -b, b' = a. Draw it. "
            "Which lengths change? ______________",
            "Its corners are (-2, 0), (-0.5, 2), (-1, 5), (0, 7), (-4, 7), (-3, 5), (-3.5, 2). No length changes.",
        ),
        Task(
            "2. Shift the fish that you drew by 24 to the right. Where is the tip of its head? ( ______ , ______ )",
            "(22, 0).",
        ),
        Task(
            "3. Draw the first fish after a' = 2 a + b, b' = b / 2, and shift it down by 10. How many times as "
            "large is its area? ______",
            "Once: 2 times 1/2 minus 1 times 0 is 1. Its corners are (2, 11), (4.5, 10.25), (11, 10.5), (14, "
            "10), (18, 12), (13, 11.5), (7.5, 11.75).",
        ),
        Drawn(90, _squares_for_maps, foot=4),
        Task(
            "4. How many numbers has a rigid map? ______ A similar one? ______ An affine one? ______ How many "
            "dragged points determine an affine map? ______",
            "3, 4, 6; 3 points.",
        ),
        Task(
            "5. What stays the same under all three kinds of maps? Give two examples.",
            "Straight lines stay straight, parallel lines stay parallel, ratios along a line stay.",
            2,
        ),
    ),
    "folding": (
        Task(
            "1. On a line, 40 arrives at 70 and 60 arrives at 65. How many times as long is the piece between, "
            "with its sign? ______ What does the sign say?",
            "(65 - 70) / (60 - 40) = -1/4. The piece is turned over.",
            1,
        ),
        Task(
            "2. A point is dragged by 80 mm to the right, with a support radius of 100 mm. The computer reads at "
            "y + D, with D = -80 \u03c6 and \u03c6 = 1; 0.63; 0.19; 0.02; 0 at 0, 25, 50, 75 and 100 mm on both "
            "sides. Compute y + D:",
            "At -100, -75, ... 100 mm: -100, -76, -65, -76, -80, -26, 35, 74, 100 mm.",
        ),
        Task(
            "y = -100: _____ -75: _____ -50: _____ -25: _____ 0: _____ 25: _____ 50: _____ 75: _____ 100: _____",
            "",
        ),
        Task(
            "3. Draw the curve. Where does it fall? There the map folds. The dashed line is the map that moves "
            "nothing.",
            "It falls from -50 to 0 mm: there the same tissue is read again, in reverse.",
        ),
        Drawn(110, _squares_for_a_fold, foot=9),
        Task(
            "4. Draw it for 20 mm too. Does it fall anywhere? ______ How far can the point be dragged? ______ mm",
            "No. Up to 64/135 of the support radius, 47 mm.",
        ),
        Task(
            "5. The determinant at a place is -0.4. What does the tissue do there? And at 0.4?",
            "It folds. At 0.4 it grows.",
            1,
        ),
    ),
}
"""Questions and figures of each lesson's sheet, by the lesson's name, in their order on the page."""


def worksheet_figure(name: str, language: str | None = None) -> Figure:
    """A lesson's worksheet as a figure of A4.

    Parameters
    ----------
    name : a key of :data:`~deformnb_lessons.LESSONS`.
    language : a code of :data:`~deformnb.words.LANGUAGES`; default is the one that was chosen.

    Raises
    ------
    DeformError
        If there is no such lesson.

    Examples
    --------
    >>> [round(float(length), 2) for length in worksheet_figure("affine").get_size_inches()]
    [8.27, 11.69]
    """
    return _sheet(name, language).figure


def _sheet(name: str, language: str | None) -> Sheet:
    check_choice(name, WORKSHEETS, "lesson")
    sheet = Sheet(_heading(name, language), language)
    sheet.write("Name: ______________________________      Date: ______________", size=9)
    for part in WORKSHEETS[name]:
        if isinstance(part, Drawn):
            sheet.draw(part)
        else:
            sheet.write(part.text)
            sheet.rule(part.lines)
    if name == "coordinates":
        sheet.write_foot(PLATE_SOURCE)
    return sheet


def _heading(name: str, language: str | None) -> str:
    number = LESSONS[name].notebook.split("_")[0]
    return f"{translate('Lesson', language)} {number}: {translate(LESSONS[name].title, language)}"


def answers_figure(language: str | None = None) -> Figure:
    """The answers to all worksheets, for the teacher, as a figure of A4.

    Examples
    --------
    >>> [round(float(length), 2) for length in answers_figure().get_size_inches()]
    [8.27, 11.69]
    """
    sheet = Sheet("Answers to the worksheets", language, size=8.5)
    for name, parts in WORKSHEETS.items():
        sheet.write(_heading(name, language), size=10, weight="bold")
        tasks = [part for part in parts if isinstance(part, Task) and part.answer]
        for number, task in enumerate(tasks, start=1):
            sheet.write(f"{number}. {translate(task.answer, language)}", indent=4)
    return sheet.figure


def write_worksheet(
    name: str, path: str | os.PathLike[str], *, language: str | None = None, overwrite: bool = True
) -> None:
    """Write a lesson's worksheet as a PDF (or PNG, SVG).

    Parameters
    ----------
    name, language : as of :func:`worksheet_figure`.
    path : the file to write.
    overwrite : whether an existing file may be replaced.

    Raises
    ------
    DeformError
        If there is no such lesson, or the file cannot be written.

    Examples
    --------
    >>> write_worksheet("kernel", "kernel.pdf")
    Traceback (most recent call last):
    ...
    deformnb.errors.DeformError: unknown lesson 'kernel'; choose one of coordinates, fish, kernels, affine, folding.
    """
    check_target(path, overwrite=overwrite)
    save_figure(worksheet_figure(name, language), as_path(path))


def write_answers(path: str | os.PathLike[str], *, language: str | None = None, overwrite: bool = True) -> None:
    """Write the answers to all worksheets as a PDF (or PNG, SVG).

    Parameters
    ----------
    path : the file to write.
    language : as of :func:`worksheet_figure`.
    overwrite : whether an existing file may be replaced.

    Raises
    ------
    DeformError
        If the file cannot be written.

    Examples
    --------
    >>> write_answers("answers.xyz")
    Traceback (most recent call last):
    ...
    deformnb.errors.DeformError: ...
    """
    check_target(path, overwrite=overwrite)
    save_figure(answers_figure(language), as_path(path))
