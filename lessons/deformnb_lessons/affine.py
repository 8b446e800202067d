"""Exercises of the third lesson: rigid, similar and affine maps."""

from __future__ import annotations

import numpy as np

from deformnb_lessons.exercises import AbstractExercise, Choice, Numbers
from deformnb_lessons.moved_animal import ROUNDED, MovedAnimal
from deformnb_lessons.studio_tasks import StudioTask

TURN = 15.0
"""Degrees by which the carp is turned at least in the exercise "turned"."""

STRETCH = 0.05
"""Largest share by which it may become longer or shorter there."""

BENT = 5.0
"""Millimetres by which its places may differ from a straight map."""


def _turn_fault(animal: MovedAnimal) -> str:
    """Fault of a rotation of the carp that preserves its form; empty if there is none."""
    places, moved = animal.places, animal.moved
    terms = np.column_stack([places, np.ones(len(places))])
    best = np.linalg.lstsq(terms, moved)[0]
    linear = best[:2].T
    bent = float(np.linalg.norm(moved - terms @ best, axis=1).max())
    if bent > BENT:
        return (
            f"The carp is bent: places are up to {bent:.0f} mm from where a straight map takes them. Choose Rigid "
            "for Trend in the panel (Shape), and let no point hold a corner."
        )
    long = np.linalg.svd(linear, compute_uv=False)
    if np.abs(long - 1).max() > STRETCH:
        return (
            f"Lengths become {long[1]:.2f} to {long[0]:.2f} times as long, and a turn preserves them. Keep both points "
            "as far apart as they were, and choose Rigid for Trend in the panel (Shape)."
        )
    degrees = abs(float(np.degrees(np.arctan2(linear[1, 0] - linear[0, 1], linear[0, 0] + linear[1, 1]))))
    if degrees < TURN - ROUNDED:
        return f"The carp is turned by {degrees:.0f} degrees. {TURN:g} or more are required."
    return ""


EXERCISES: dict[str, AbstractExercise] = {
    "distances": Choice(
        "Which maps preserve all distances?",
        "Only rigid maps do: turns and shifts.",
        ("rigid", "similar", "affine", "shear"),
        ("rigid",),
        {
            "similar": "A similar map may make everything twice as large, and distances too.",
            "affine": "An affine map may stretch in one direction only.",
            "shear": "A shear preserves areas and the rows, but slanted lines become longer or shorter.",
        },
    ),
    "turn": Numbers(
        "A quarter turn about (0, 0), clockwise as you look at the picture. Where does (30, 10) go?",
        "What was to the right is below now, and what was below is to the left.",
        (-10, 30),
        0.5,
        "Draw it: 30 to the right and 10 down. After the turn, what points to the right points down.",
        (
            ((10, -30), "That is the turn in the other direction, anticlockwise. Remember that b grows downwards."),
            ((-30, -10), "That is half a turn."),
            ((10, 30), "That is a reflection: it exchanges a and b. Look at the sign of a."),
            ((30, -10), "That is a reflection at a horizontal line."),
        ),
    ),
    "freedom": Numbers(
        "How many numbers describe a rigid, a similar and an affine map of the plane?",
        "An angle and a shift; a scale as well; four numbers of a matrix and a shift.",
        (3, 4, 6),
        0.1,
        "A shift takes two numbers. What is added for a turn, for a scale, for a matrix?",
        (
            ((1, 2, 4), "The shift is missing: two more numbers for each."),
            ((3, 4, 4), "The matrix of an affine map has four numbers, and its shift two more."),
            ((6, 4, 3), "These are the right numbers in the other order."),
        ),
    ),
    "points": Numbers(
        "How many dragged points determine an affine map of the plane, if they do not lie on one line?",
        "Each point gives two equations, and there are six numbers.",
        3,
        0.1,
        "Count: how many numbers has the map, and how many equations does one point give?",
        (
            (6, "Six is how many numbers there are. Each point gives two equations."),
            (2, "Two points give four equations. That is enough for a similar map."),
            (4, "Four points give eight equations, and there are only six numbers."),
        ),
    ),
    "area": Numbers(
        "a' = 2 a + b and b' = b / 2. How many times as large does an area become?",
        "2 times 1/2 minus 1 times 0: twice as long, half as high, and the shear changes no area.",
        1,
        0.02,
        "Take the determinant of the matrix: product of one diagonal minus product of the other.",
        (
            (2, "It becomes twice as long. How high?"),
            (0.5, "It becomes half as high. How long?"),
            (2.5, "That is the sum of the diagonal. Take the product."),
            (0, "The product of the other diagonal is 1 times 0. Subtract that."),
        ),
    ),
    "turned": StudioTask(
        f"Turn the whole carp by {TURN:g} degrees or more, so that its form is preserved.",
        "It is turned, and every distance is preserved.",
        _turn_fault,
    ),
}
"""Exercises by name."""
