"""The figures of the first lesson; a notebook shows each by ``lesson.draw``."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from deformnb._typing import Floats
from deformnb.datasets import thompson_grid, thompson_map, thompson_pairs
from deformnb.imaging.figures import Panel, draw_figure
from deformnb.imaging.projection import project
from deformnb.words import translate
from deformnb_lessons.drawing_parts import (
    NODES,
    Drawing,
    Table,
    credit,
    draw_nodes,
    draw_plate,
    draw_rules,
    draw_squares,
    new_figure,
)
from deformnb_lessons.exercises import localized
from deformnb_lessons.explorers import GrownFigure, RuleExplorer
from deformnb_lessons.fish import EXERCISES, GOAL_NODES
from deformnb_lessons.moved_animal import SIDE, lesson_carp
from deformnb_lessons.studio_tasks import FishTask

# ---- lesson 1a -------------------------------------------------------------------------------------------------------


def draw_plates() -> Drawing:
    """Polyprion next to Antigonia, as Thompson drew them, with the nodes of their grids."""
    figure = new_figure(8.2, 4.4)
    for axes, name in zip(figure.subplots(1, 2, width_ratios=(1.35, 1)), ("Polyprion", "Antigonia"), strict=True):
        draw_plate(axes, name)
        draw_nodes(axes, thompson_grid(name).nodes)
    credit(figure)
    return Drawing(figure, "Polyprion and Antigonia, each with its grid of 7 rows and 8 columns, as Thompson drew them")


def draw_place() -> Drawing:
    """The carp on squared paper, with a point."""
    picture = project(lesson_carp(), SIDE, "mip")
    figure = new_figure(8.2, 3.9)
    axes = figure.subplots()
    axes.imshow(picture.values, cmap="gray_r", extent=(*picture.raster.box[:2], *picture.raster.box[:1:-1]), alpha=0.75)
    draw_squares(axes, (0, 500, 0, 200), 10, every=10)
    axes.plot(120, 80, "o", color=NODES, markersize=7)
    axes.annotate("(120, 80)", (120, 80), (8, 8), textcoords="offset points", color=NODES, weight="bold")
    axes.xaxis.tick_top()
    axes.xaxis.set_label_position("top")
    axes.set(xlabel=translate("a, to the right, in mm"), ylabel=translate("b, down, in mm"))
    return Drawing(figure, "The carp on squared paper, and a point at (120, 80)")


def draw_shear() -> Drawing:
    """Argyropelecus next to Sternoptyx, with the ends of two columns in pixels."""
    figure = new_figure(8.2, 3.4)
    names = ("Argyropelecus", "Sternoptyx")
    for axes, name in zip(figure.subplots(1, 2, width_ratios=(0.9, 1)), names, strict=True):
        draw_plate(axes, name)
    nodes = thompson_grid("Sternoptyx").nodes
    for column, side in ((0, 1), (6, -1)):
        ends = nodes[[0, -1], column]
        axes.plot(*ends.T, "o-", color=NODES, markersize=6, linewidth=1.5)
        for (a, b), down in zip(ends, (1, -1), strict=True):
            axes.annotate(
                f"({a:g}, {b:g})",
                (a, b),
                (9 * side, -12 * down),
                textcoords="offset points",
                ha="left" if side > 0 else "right",
                va="center",
                color=NODES,
                fontsize=9,
                bbox={"facecolor": "white", "edgecolor": "none", "pad": 1},
            )
    credit(figure)
    return Drawing(
        figure,
        "Argyropelecus and Sternoptyx, as Thompson drew them, with the places of the ends of the first and the last "
        "column of Sternoptyx",
    )


def draw_simple() -> Drawing:
    """The distances that remain in each of Thompson's pairs after the best shear, and the best with a taper."""
    names, left = _distances_left()
    figure = new_figure(7.4, 3.3)
    axes = figure.subplots()
    words = ("nothing", "a shear with stretching", "and a taper")
    for k, (word, color) in enumerate(zip(words, ("#bbbbbb", "#0072b2", "#009e73"), strict=True)):
        bars = axes.barh(np.arange(len(names)) + 0.26 * (k - 1), left[:, k], 0.24, color=color, label=translate(word))
        axes.bar_label(bars, [localized(f"{value:.1f}") for value in left[:, k]], padding=3, fontsize=8)
    axes.axvline(2, color=NODES, linestyle="--", linewidth=1.2, label=translate("error of reading"))
    axes.set_yticks(range(len(names)), names, style="italic")
    axes.set_xlabel(translate("mean distance of the nodes from Thompson's, in pixels"))
    axes.invert_yaxis()
    axes.legend(fontsize=8, loc="upper right")
    return Drawing(
        figure, "Bars for five animals: how far their nodes are from Thompson's after a shear, and after a taper too"
    )


@cache
def _distances_left() -> tuple[list[str], Floats]:
    """Species (n) of the pairs, and (n, 3) mean distances in pixels: of nothing, of a shear, of a shear and a taper."""
    names, rows = [], []
    for first, second in thompson_pairs():
        pair = thompson_map(first, second, scale="area")
        pixels = np.ptp(pair.source.nodes.reshape(-1, 2), axis=0)
        start, goal = ((nodes * pixels).reshape(-1, 2) for nodes in (pair.source_nodes, pair.target_nodes))
        a, b = start.T
        row = [np.linalg.norm(goal - start, axis=1).mean()]
        for columns in ([1 + 0 * a, a, b], [1 + 0 * a, a, b, a * b]):
            terms = np.transpose(columns)
            best = terms @ np.linalg.lstsq(terms, goal)[0]
            row.append(np.linalg.norm(goal - best, axis=1).mean())
        names.append(second.split()[0])
        rows.append(row)
    return names, np.array(rows)


# ---- lesson 1b -------------------------------------------------------------------------------------------------------


def fish_task() -> FishTask:
    """The exercise in which the carp becomes Antigonia."""
    task = EXERCISES["antigonia"]
    assert isinstance(task, FishTask)
    return task


def draw_goal() -> Drawing:
    """The carp on Polyprion's grid, and the goal, with the nodes that are points of the studio."""
    carp = lesson_carp()
    grids, picture = fish_task().grids(carp), project(carp, SIDE, "mip")
    before, goal = grids.polylines()
    panels = [
        Panel(picture, translate("the carp on Polyprion's grid"), before),
        Panel(picture, translate("the goal: Antigonia's grid"), goal),
    ]
    figure = draw_figure([panels], lettered=False)
    for axes, nodes in zip(figure.axes, (grids.source_nodes, grids.target_nodes), strict=True):
        draw_nodes(axes, nodes.reshape(-1, 2)[GOAL_NODES])
    return Drawing(figure, "The carp on the grid of Polyprion, and the grid of Antigonia over it, both with 12 nodes")


def list_nodes() -> Table:
    """The 12 points of the studio: from where to where each goes."""
    points = fish_task().grids(lesson_carp()).points.take(GOAL_NODES)
    return Table(
        ["node", "from", "to"],
        [
            [name, *(f"({a:.0f}, {b:.0f})" for a, b in ends)]
            for name, *ends in zip(points.names, points.source, points.target, strict=True)
        ],
    )


DRAWINGS: dict[str, Callable[..., Any]] = {
    "plates": draw_plates,
    "place": draw_place,
    "rules": draw_rules,
    "sliders": RuleExplorer,
    "shear": draw_shear,
    "simple": draw_simple,
    "goal": draw_goal,
    "nodes": list_nodes,
    "grown": GrownFigure,
}
"""Figures of :meth:`~deformnb_lessons.Lesson.draw` by name."""
