"""The lessons: name, title, time, goals, notebook, and the exercises of each.

The exercises of a lesson are in the module of its name; :data:`LESSONS` has all lessons in their order.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from deformnb.checks import short_value
from deformnb.errors import DeformError
from deformnb_lessons import affine, coordinates, folding, kernels
from deformnb_lessons.exercises import AbstractExercise, Result

if TYPE_CHECKING:  # answers are checked without widgets
    from deformnb_lessons.followed_result import FollowedResult


@dataclass(frozen=True)
class Lesson:
    """A lesson and its exercises.

    Parameters
    ----------
    title : in words.
    notebook : its file.
    minutes : that it takes, at least and at most.
    goals : what a pupil can do afterwards.
    exercises : by name.

    Examples
    --------
    >>> LESSONS["coordinates"].check("cells", 56)
    Not yet. 56 is the number of nodes. A row of 8 nodes has only 7 cells between them.
    >>> LESSONS["coordinates"].check("cells", 42).right
    True
    """

    title: str
    notebook: str
    minutes: tuple[int, int]
    goals: tuple[str, ...]
    exercises: Mapping[str, AbstractExercise]

    def check(self, exercise: str, answer: object = None) -> Result:
        """Judge an answer: right or not yet, with a hint that depends on the mistake.

        Parameters
        ----------
        exercise : its name.
        answer : a number, a list of numbers, words, or the studio, as the exercise requires.

        Raises
        ------
        DeformError
            If the lesson has no such exercise.
        """
        return self._exercise(exercise).judge(answer)

    def follow(self, exercise: str, studio: object) -> FollowedResult:
        """A result that judges the studio again after each gesture: the score rises while a pupil drags.

        Parameters
        ----------
        exercise : the name of one that is done in the studio.
        studio : the studio, or its session.

        Returns
        -------
        FollowedResult
            A widget; the last expression of a cell shows it.

        Raises
        ------
        DeformError
            If the lesson has no such exercise, or the object is no studio.
        """
        from deformnb_lessons.followed_result import FollowedResult

        return FollowedResult(self._exercise(exercise), studio)

    def _exercise(self, name: str) -> AbstractExercise:
        if not isinstance(name, str) or name not in self.exercises:
            known = ", ".join(self.exercises)
            raise DeformError(f"this lesson has no exercise {short_value(name)}; it has {known}.")
        return self.exercises[name]


LESSONS: dict[str, Lesson] = {
    "coordinates": Lesson(
        "Coordinates and grids",
        "1_coordinates_and_grids.ipynb",
        (30, 40),
        (
            "read and write places on a picture as two numbers",
            "describe how D'Arcy Thompson compared two animals",
            "recognise a shear, a taper and a polar grid, and say which of his pairs are so simple",
            "turn a carp into a boarfish by dragging, and say where it grew",
        ),
        coordinates.EXERCISES,
    ),
    "kernels": Lesson(
        "Interpolation and kernels",
        "2_interpolation_and_kernels.ipynb",
        (30, 40),
        (
            "interpolate between known values",
            "say what a kernel and its support radius are",
            "solve for the weights of two points",
            "choose a support radius for a purpose",
        ),
        kernels.EXERCISES,
    ),
    "affine": Lesson(
        "Rigid, similar, affine",
        "3_rigid_similar_affine.ipynb",
        (20, 30),
        (
            "distinguish rigid, similar and affine maps by what they preserve",
            "count the numbers of a map and the points that determine it",
            "find how an affine map changes areas",
            "turn a carp without bending it",
        ),
        affine.EXERCISES,
    ),
    "folding": Lesson(
        "Folding, inverses and cutting",
        "4_folding_inverses_and_cutting.ipynb",
        (30, 40),
        (
            "say which place arrives where, and undo a map on a line",
            "explain why the computer looks backwards",
            "recognise a fold by the sign of a determinant, and avoid it",
            "say when a map must be cut",
        ),
        folding.EXERCISES,
    ),
}
"""Lessons by name."""
