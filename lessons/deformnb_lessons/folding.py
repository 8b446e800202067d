"""Exercises of the fourth lesson: folding, inverses and cutting."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from deformnb._typing import Floats
from deformnb.rbf.regions import Line
from deformnb.warping.points import warp_points
from deformnb_lessons.exercises import AbstractExercise, Choice, Numbers
from deformnb_lessons.moved_animal import ROUNDED, MovedAnimal, reached
from deformnb_lessons.studio_tasks import StudioTask

DRAG = 75.0
"""Millimetres that a part of the carp stays moved at least in the exercise "unfold"."""

OPENING = 10.0
"""Millimetres between the two sides of the cut at least in the exercise "cut"."""

SIDE_MOVES = 2.0
"""Millimetres that each side of it goes away from it at least."""

_OFFSET = 1.0  # millimetres from the line of a cut to the places whose displacements are compared
_PART = 0.05  # of the animal, that is at least on each side of a cut
_REACH = 600.0  # millimetres that a line is continued: longer than the carp
_SAMPLES = 400  # places along each edge of a line


def _fold_fault(animal: MovedAnimal) -> str:
    """Fault of a long drag; empty if there is none."""
    far = reached(np.linalg.norm(animal.moved - animal.places, axis=1))
    if far < DRAG - ROUNDED:
        return (
            f"No part of the carp moves farther than {far:.0f} mm. Keep it at {DRAG:g} mm or more, and remove the fold "
            "by a setting."
        )
    return ""


def _cut_fault(animal: MovedAnimal) -> str:
    """Fault of a cut that is pulled open; empty if there is none."""
    lines = [
        (cut.region, number)
        for number, step in enumerate(animal.steps)
        for cut in step.cuts
        if cut.enabled and isinstance(cut.region, Line)
    ]
    if not lines:
        return (
            "There is no cut yet. Press the scissors next to the picture, click along a line across the carp, then "
            "Enter."
        )
    faults = [_opening_fault(line, number, animal) for line, number in lines]
    return "" if "" in faults else faults[0]


def _opening_fault(line: Line, number: int, animal: MovedAnimal) -> str:
    """Fault of the opening of a line of a step, which lies on the picture as the steps before leave it."""
    before, after = animal.around(number)
    share = float(np.mean(line.signed_distance(warp_points(animal.places, before)[0]) < 0))
    middle, normals = _places_along(line)
    is_crossed = animal.is_tissue(middle + before.displacement(middle))
    if not _PART < share < 1 - _PART or not is_crossed.any():
        return "The cut parts nothing of the carp. Draw it across the carp, from above the back to below the belly."
    middle, normals = middle[is_crossed], normals[is_crossed]
    sides = (middle - _OFFSET * normals, middle + _OFFSET * normals)
    first, second = (
        sign * ((warp_points(side, after)[0] - side) * normals).sum(axis=1)
        for sign, side in zip((-1, 1), sides, strict=True)
    )
    opening, closing = reached(first + second), reached(-first - second)
    if opening < OPENING - ROUNDED:
        more = f"Put a point on each side of the line and drag them away from each other, until it is {OPENING:g} mm."
        if closing > max(opening, ROUNDED):
            return f"The two sides were pushed together, by {closing:.0f} mm. {more}"
        return f"The two sides are {max(0.0, opening):.0f} mm apart. {more}"
    if min(reached(first), reached(second)) < SIDE_MOVES:
        return "Only one side moves away from the cut. Drag a point on the other side away from it too."
    return ""


def _places_along(line: Line) -> tuple[Floats, Floats]:
    """Places (n, 2) along a line and where it continues, and its unit normals there."""
    vertices = np.asarray(line.vertices)
    edges = np.diff(vertices, axis=0)
    units = edges / np.linalg.norm(edges, axis=1)[:, None]
    ends = vertices.copy()
    for end, stops, unit in ((0, line.stops[0], -units[0]), (-1, line.stops[1], units[-1])):
        if not stops:
            ends[end] += _REACH * unit
    share = (np.arange(_SAMPLES) + 0.5)[:, None] / _SAMPLES
    middle = [a + share * (b - a) for a, b in pairwise(ends)]
    normals = units[:, ::-1] * (-1, 1)
    return np.concatenate(middle), np.repeat(normals, _SAMPLES, axis=0)


EXERCISES: dict[str, AbstractExercise] = {
    "inverse": Numbers(
        "A map takes the place x to y = 2 x + 10. Which place arrives at y = 30?",
        "The inverse is x = (y - 10) / 2.",
        10,
        0.1,
        "Solve 30 = 2 x + 10 for x.",
        (
            (70, "That is where x = 30 goes. Which x arrives at 30?"),
            (20, "That is 2 x. Divide it by 2."),
            (5, "Subtract 10 first, then divide by 2."),
        ),
    ),
    "backward": Numbers(
        "The backward displacement at y = 100 is D = -20. At which place does the computer read?",
        "output(100) = input(100 - 20): what was at 80 appears at 100.",
        80,
        0.1,
        "The computer reads at y + D.",
        (
            (120, "D is negative: 100 + (-20)."),
            (-20, "That is D. Where does it read?"),
            (100, "That is where it writes."),
        ),
    ),
    "stretch": Numbers(
        "On a line, 40 arrives at 70 and 60 arrives at 65. How many times as long is the piece between, with its sign?",
        "(65 - 70) / (60 - 40): a quarter as long, and turned over.",
        -0.25,
        0.01,
        "Divide the difference of the new places by that of the old ones, in the same order.",
        (
            (0.25, "What was left is right now. What does this say about the sign?"),
            (-4, "Divide new by old, not old by new."),
            (-5, "That is the new difference. Divide it by the old one."),
            (4, "Divide new by old, and look at the sign."),
        ),
    ),
    "sign": Choice(
        "The determinant of the backward map is -0.4 at a place. What does the tissue do there?",
        "A negative determinant turns tissue over: the map folds.",
        ("grows", "shrinks", "stays", "folds"),
        ("folds",),
        {
            "grows": "Tissue grows where it is between 0 and 1: a small area is looked up and drawn larger.",
            "shrinks": "Tissue shrinks where it is above 1: a large area is looked up and drawn smaller.",
            "stays": "Areas stay as they are where it is 1.",
        },
    ),
    "limit": Numbers(
        "One point, Wendland's kernel, support radius 100 mm, no trend. How far can it be dragged before the map "
        "folds?",
        "The kernel is steepest at a quarter of the radius, where its slope is 135/64 for each radius. So the limit is "
        "64/135 of it, 47.4 mm.",
        47.4,
        2,
        "Change the number in the cell above, and look when the smallest determinant becomes 0.",
        (
            (100, "At 100 mm the smallest determinant is far below 0. Try shorter drags."),
            (50, "Nearly. At 50 mm the smallest determinant is just below 0."),
            (0.47, "That is the share of the support radius. How many millimetres?"),
        ),
    ),
    "unfold": StudioTask(
        f"Remove the fold, and keep the drag of {DRAG:g} mm or more.",
        "As far as before, and nothing folds.",
        _fold_fault,
    ),
    "cut": StudioTask(
        f"Cut the carp and pull the two sides apart by {OPENING:g} mm or more.",
        "A cut lets neighbours part, which no smooth map can.",
        _cut_fault,
    ),
}
"""Exercises by name."""
