"""Exercises of the second lesson: interpolation and kernels."""

from __future__ import annotations

import numpy as np

from deformnb_lessons.exercises import AbstractExercise, Choice, Numbers
from deformnb_lessons.moved_animal import ROUNDED, MovedAnimal, reached
from deformnb_lessons.studio_tasks import StudioTask

LIFT = 20.0
"""Millimetres that the back is lifted at least in the exercise "local"."""

STILL = 1.0
"""Millimetres that the head moves at most there."""

BACK = (150.0, 400.0)
"""Extent of the back of the lesson's carp: a_min and a_max on the picture from the left."""

HEAD = 100.0
"""The head of the lesson's carp ends at this a, from the left."""


def _lift_fault(animal: MovedAnimal) -> str:
    """Fault of a back that is lifted while the head stays; empty if there is none."""
    edge = animal.upper_edge
    back = edge[(edge[:, 0] > BACK[0]) & (edge[:, 0] < BACK[1])]
    lifted = max(0.0, reached(-animal.displacement_of(back)[:, 1]))  # b grows downwards
    if lifted < LIFT - ROUNDED:
        return (
            f"The upper edge of the back is lifted by {lifted:.0f} mm. Drag a point of that edge up, until it "
            f"is {LIFT:g} mm or more."
        )
    lengths = np.linalg.norm(animal.moved - animal.places, axis=1)
    farthest = float(lengths[animal.places[:, 0] < HEAD].max())
    if farthest > STILL:
        if any(step.trend != "none" and step.support is not None for step in animal.steps):
            return (
                f"The head moves by up to {farthest:.1f} mm. The trend moves the picture as a whole: choose None "
                "for Trend in the panel (Shape), or put more points on the head."
            )
        return (
            f"The head moves by up to {farthest:.1f} mm. Make the support radius smaller in the panel (Shape), or "
            "put points on the head: a point that is not dragged stays."
        )
    return ""


_ROUNDED = "These are the right numbers, but rounded too much. Give both with two decimals."

EXERCISES: dict[str, AbstractExercise] = {
    "between": Numbers(
        "At a = 0 the displacement is 10 mm and at a = 100 it is 50 mm. How large is it on a straight line at a = 25?",
        "10 and a quarter of the difference of 10 and 50.",
        20,
        0.5,
        "25 is a quarter of 100. Add a quarter of the difference of 10 and 50 to 10.",
        (
            (30, "That is in the middle, at a = 50."),
            (12.5, "That is a quarter of 50. The line begins at 10, not at 0."),
            (40, "That is at a = 75: count from a = 0."),
            (10, "That is the step from 10. Add it."),
        ),
    ),
    "kernel": Numbers(
        "Wendland's kernel is (1 - s)^4 (4 s + 1), with s the distance divided by the support radius. How large is it "
        "half-way, at s = 1/2?",
        "3/16: half-way to its end the kernel is already below a fifth.",
        0.1875,
        0.003,
        "Put s = 1/2 into both brackets: (1/2)^4 times 3.",
        (
            (0.0625, "That is (1/2)^4. Multiply it by 4 s + 1."),
            (0.5, "The kernel is no straight line: put s = 1/2 into the formula."),
            (1.5, "That is 1/2 times 3. The first bracket has the power 4."),
        ),
    ),
    "weights": Numbers(
        "Two points half a support radius apart: the first is dragged by 10 mm, the second stays. Which weights?",
        "The second weight is negative: it takes back what the first point would do to the second.",
        (10.36, -1.94),
        0.03,
        "Solve w1 + 0.1875 w2 = 10 and 0.1875 w1 + w2 = 0.",
        (
            ((10, 0), "The second point would move by 10 times 0.1875, which is 1.9 mm, and it should stay."),
            ((10, -1.88), "The second weight reaches the first point too: solve both equations together."),
            ((-1.94, 10.36), "These are the right numbers in the other order."),
            *((rounded, _ROUNDED) for rounded in ((10.4, -1.9), (10.4, -1.94), (10.36, -1.9), (10, -2), (10.4, -2))),
            ((10.36, 1.94), "Look at the sign of the second: 0.1875 w1 + w2 = 0."),
        ),
    ),
    "support": Numbers(
        "One point is dragged. Another place, 120 mm away, must stay exactly where it is. How large may the "
        "support radius be?",
        "At the support radius the kernel is 0, and beyond it too: 120 mm is the largest, and any smaller one will do.",
        120,
        0.0,
        "At which s does (1 - s)^4 (4 s + 1) become 0?",
        ((240, "240 mm is the diameter. At 120 mm, half-way, the kernel is still 0.19."),),
        at_most=True,
    ),
    "compact": Choice(
        "Which of these kernels are 0 beyond a distance?",
        "Wendland's kernels end at their support radius. The others reach everywhere.",
        ("wendland_c2", "wendland_c4", "thin_plate", "gaussian", "multiquadric", "cubic"),
        ("wendland_c2", "wendland_c4"),
        {
            "thin_plate": "The thin plate spline, r^2 log r, even grows with the distance.",
            "gaussian": "The Gaussian becomes very small, but never 0.",
            "multiquadric": "The multiquadric, the root of 1 + r^2, grows with the distance.",
            "cubic": "r^3 grows with the distance.",
        },
    ),
    "local": StudioTask(
        f"Lift the back of the carp by {LIFT:g} mm or more, so that its head moves by {STILL:g} mm at most.",
        "The back is lifted, and the head stays where it was.",
        _lift_fault,
    ),
}
"""Exercises by name."""
