"""Exercises of the first half of the first lesson: coordinates and grids.

The slope and the angle of *Sternoptyx* are those of its outer columns as read from Thompson's figure 374 (1917); he
himself prints 70 degrees.
"""

from __future__ import annotations

from deformnb_lessons.exercises import AbstractExercise, Choice, Numbers

EXERCISES: dict[str, AbstractExercise] = {
    "eye": Numbers(
        "Which node of Polyprion's grid is nearest to its eye?",
        "The eye is next to r2 c1, and so is the eye of Antigonia: the lines pass through the same parts of both.",
        (2, 1),
        0.1,
        "Find the eye, then follow the two nearest lines: the row to its number at the left, the column to its number "
        "above.",
        (
            ((1, 2), "The row comes first: its number is at the left."),
            ((3, 2), "Rows and columns are counted from 0."),
            ((2, 2), "The row is right. Columns are counted from 0."),
            ((3, 1), "The column is right. That row passes through the mouth."),
            ((2, 0), "The row is right. That column is in front of the mouth."),
        ),
        labels=("row", "column"),
    ),
    "place": Numbers(
        "A point at (120, 80) is dragged 30 mm to the right and 20 mm up. Where is it now?",
        "a grows to the right and b grows down, so a displacement up is subtracted.",
        (150, 60),
        0.5,
        "Add the displacement to the place: one sum for a, to the right, and one for b, downwards.",
        (
            ((150, 100), "b grows downwards on a picture: a displacement up makes b smaller."),
            ((60, 150), "The order is (a, b): first to the right, then down."),
            ((30, -20), "That is the displacement. Where does it arrive?"),
            ((30, 20), "That is how far it goes. Where does it arrive?"),
            ((90, 60), "To the right makes a larger."),
        ),
        labels=("a", "b"),
    ),
    "cells": Numbers(
        "Thompson's grid of Polyprion has 7 rows of 8 nodes. How many cells does it have?",
        "6 x 7: there is one cell fewer than nodes in each direction.",
        42,
        0.1,
        "Draw two rows of three nodes. How many cells are between them?",
        (
            (56, "56 is the number of nodes. A row of 8 nodes has only 7 cells between them."),
            (72, "A row of 8 nodes has one cell fewer than nodes, not one more."),
            (48, "Cells are counted in both directions: one fewer in each."),
            (49, "Cells are counted in both directions: one fewer in each."),
        ),
    ),
    "shear": Numbers(
        "How far to the right does a column of Sternoptyx go for each pixel down?",
        "The columns lean to the left by about a third of a pixel for each pixel down.",
        -0.345,
        0.035,
        "Take a column: divide how far it goes to the right by how far it goes down.",
        (
            (0.345, "The size is right. From top to bottom, does the column go to the right or to the left?"),
            (-2.9, "That is how far it goes down for each pixel to the left. Divide the other way round."),
            (2.9, "Divide the other way round, and look at the sign."),
            (-93, "That is the shift to the left over the whole height. Divide it by the height."),
            (-89, "That is the shift to the left over the whole height. Divide it by the height."),
        ),
    ),
    "angle": Numbers(
        "Which angle do rows and columns of Sternoptyx enclose, in degrees?",
        "About 71 degrees. Thompson wrote 70, for the same drawing.",
        71,
        2,
        "The column and a line straight down enclose an angle whose tangent is the slope. It is not that one.",
        (
            (19, "That is how far the column leans from straight down. Rows are at right angles to straight down."),
            (109, "That is the larger one of the two angles. Give the smaller one."),
            (90, "That is the angle in Argyropelecus, before the shear."),
            (1.24, "That is in radians. 180 degrees are pi."),
        ),
    ),
    "taper": Numbers(
        "A taper makes heights 1 + t a times as large, where a is 0 at the head and 1 at the tail. "
        "Which t makes the tail end half as high?",
        "1 + t = 1/2 at a = 1.",
        -0.5,
        0.01,
        "Put a = 1 into 1 + t a. The result should be one half.",
        (
            (0.5, "This makes the tail end 1.5 times as high."),
            (2, "This makes the tail end 3 times as high."),
            (-2, "1 - 2 is negative: this turns the tail end upside down."),
        ),
    ),
    "polar": Numbers(
        "A node has the radius 5 and the angle 90 degrees, measured from the direction a towards b. What are its "
        "(a, b)?",
        "(5 cos 90, 5 sin 90): straight down on a picture.",
        (0, 5),
        0.05,
        "a = r cos(angle), b = r sin(angle). What are cosine and sine of 90 degrees?",
        (
            ((5, 0), "That is the angle 0. a = r cos(angle), b = r sin(angle)."),
            ((0, -5), "From a towards b: that is downwards on a picture, where b is positive."),
            ((5, 90), "These are radius and angle. a = r cos(angle), b = r sin(angle)."),
            ((-2.24, 4.47), "The sine of 90 is that of 90 radians in most programs. Change degrees to radians first."),
        ),
        labels=("a", "b"),
    ),
    "pairs": Choice(
        "Which animals does a shear with stretching make, to within the 2 pixels of reading?",
        "Only the first pair is so simple. It moves nodes by 31 pixels, and the best such map leaves 1.4.",
        ("Sternoptyx", "Pseudopriacanthus", "Scorpaena", "Antigonia", "Orthagoriscus"),
        ("Sternoptyx",),
        {
            "Pseudopriacanthus": "A shear with stretching leaves 26 pixels of Pseudopriacanthus. "
            "A taper helps it more.",
            "Scorpaena": "A shear with stretching leaves 17 pixels of Scorpaena. Look at the table again.",
            "Antigonia": "A shear with stretching leaves 27 pixels of Antigonia. Look at the table again.",
            "Orthagoriscus": "Straight lines stay straight under a shear. The columns of Orthagoriscus are round.",
        },
    ),
}
"""Exercises by name."""
