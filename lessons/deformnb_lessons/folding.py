"""Exercises of the fourth lesson: folding, inverses and cutting."""

from __future__ import annotations

import numpy as np

from deformnb.analysis.folds import find_folds
from deformnb.document.deformation import Step
from deformnb.imaging.figures import picture_field
from deformnb.rbf.regions import Line
from deformnb.session.session import Session
from deformnb.warping.points import warp_points
from deformnb_lessons.exercises import AbstractExercise, Choice, Numbers
from deformnb_lessons.studio_tasks import StudioTask

DRAG = 75.0
"""Millimetres that a point stays dragged at least in the exercise "unfold"."""

OPENING = 10.0
"""Millimetres between the two sides of the cut at least in the exercise "cut"."""

_OFFSET = 1.0  # millimetres from the line of a cut to the places whose displacements are compared


def _fold_fault(session: Session, step: Step) -> str:
    """Fault of a long drag without a fold; empty if there is none."""
    far = step.strength * float(np.linalg.norm(step.points.displacement[step.points.active], axis=1).max(initial=0.0))
    if far < DRAG:
        return f"The longest drag is {far:.0f} mm. Keep it at {DRAG:g} mm or more, and remove the fold in another way."
    least = find_folds(picture_field(step, session.volume.grid), session.pictures.picture().raster).least
    if least <= 0:
        return (
            f"The map still folds: its smallest determinant is {least:.2f}. Make the support radius larger in the "
            "panel (Shape): a longer bump is less steep."
        )
    return ""


def _cut_fault(session: Session, step: Step) -> str:
    """Fault of a cut that is pulled open; empty if there is none."""
    lines = [cut.region for cut in step.cuts if cut.enabled and isinstance(cut.region, Line)]
    if not lines:
        return (
            "There is no cut yet. Press the scissors next to the picture, click along a line across the carp, then "
            "Enter."
        )
    opening = max(_opening(line, session, step) for line in lines)
    if opening < OPENING:
        return (
            f"The two sides are {max(opening, 0):.0f} mm apart. Put a point on each side of the line and drag them "
            f"away from each other, until it is {OPENING:g} mm."
        )
    return ""


def _opening(line: Line, session: Session, step: Step) -> float:
    """Largest distance by which places on both sides of a line are separated."""
    vertices = np.asarray(line.vertices)
    ways = np.diff(vertices, axis=0)
    normals = ways[:, ::-1] * (-1, 1) / np.linalg.norm(ways, axis=1)[:, None]
    share = np.linspace(0.1, 0.9, 9)[:, None, None]
    middle = vertices[:-1] + share * ways
    sides = np.stack([middle - _OFFSET * normals, middle + _OFFSET * normals])
    moved, found = warp_points(sides, picture_field(step, session.volume.grid))
    apart = np.linalg.norm(moved[1] - moved[0], axis=-1) - 2 * _OFFSET
    return float(apart[found.all(axis=0)].max(initial=0.0))


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
        "Change the way in the cell above, and look when the smallest determinant becomes 0.",
        (
            (100, "At 100 mm the smallest determinant is far below 0. Try shorter ways."),
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
