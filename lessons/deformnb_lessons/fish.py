"""Exercises of the second half of the first lesson: a carp bent into a boarfish."""

from __future__ import annotations

from deformnb_lessons.exercises import AbstractExercise, Choice, Numbers
from deformnb_lessons.studio_tasks import FishTask

GOAL_NODES = [8 * row + column for row in (0, 3, 6) for column in (0, 2, 4, 7)]
"""The nodes of Polyprion's grid, row by row, that are the points of the exercise "antigonia"."""

EXERCISES: dict[str, AbstractExercise] = {
    "displacement": Numbers(
        "A node is dragged from (518, 19) to (436, 14). What is its displacement?",
        "436 - 518 = -82 and 14 - 19 = -5: to the left and a little up.",
        (-82, -5),
        0.5,
        "Subtract the place where it starts from the place where it ends: one difference for a, one for b.",
        (
            ((82, 5), "The size is right. Subtract the start from the end, not the end from the start."),
            ((82, -5), "It goes to the left, and a grows to the right: look at the sign of the first number."),
            ((-82, 5), "It goes up, and b grows downwards: look at the sign of the second number."),
            ((-5, -82), "The order is (a, b): first to the right, then down."),
            ((436, 14), "That is where it ends. How far is that from where it starts?"),
        ),
        labels=("a", "b"),
    ),
    "antigonia": FishTask(
        "Turn the carp into Antigonia, the boarfish: drag the points to Thompson's nodes.",
        "That is a boarfish.",
        "Polyprion",
        "Antigonia",
        65,
    ),
    "grown": Choice(
        "Both grids cover the same area. Which third of Antigonia is larger than that of Polyprion?",
        "The cells of the middle have become 1.3 times as large on average, and one of the belly 3 times.",
        ("head", "middle", "tail"),
        ("middle",),
        {
            "head": "The cells of the head have nearly the same area as before: 0.99 times on average.",
            "tail": "The tail has become smaller: its cells have 0.7 times the area on average.",
        },
    ),
}
"""Exercises by name."""
