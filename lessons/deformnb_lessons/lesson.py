"""The lessons: name, title, time, goals, notebook, and the exercises of each.

The exercises of a lesson are in the module of its name; :data:`LESSONS` has all lessons in their order.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from deformnb.checks import check_choice, short_value
from deformnb.errors import DeformError
from deformnb_lessons import affine, coordinates, fish, folding, kernels
from deformnb_lessons.exercises import AbstractExercise, Result

if TYPE_CHECKING:  # answers are checked without widgets
    from deformnb_lessons.followed_result import FollowedResult
    from deformnb_lessons.questions import Question


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

    @property
    def time(self) -> str:
        """The minutes in words.

        Examples
        --------
        >>> LESSONS["coordinates"].time, LESSONS["kernels"].time
        ('30 minutes', '30 to 40 minutes')
        """
        least, most = self.minutes
        return f"{least} minutes" if least == most else f"{least} to {most} minutes"

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

    def ask(self, exercise: str) -> Question:
        """Boxes for an answer, and a button that judges it: no code is typed.

        Parameters
        ----------
        exercise : the name of one whose answer is numbers or words.

        Returns
        -------
        Question
            A widget; the last expression of a cell shows it.

        Raises
        ------
        DeformError
            If the lesson has no such exercise, or it is done in the studio.
        """
        from deformnb_lessons.questions import Question

        return Question(self._exercise(exercise))

    def draw(self, drawing: str, *what: Any) -> Any:
        """A figure of the lesson, so that its notebook needs one line.

        Parameters
        ----------
        drawing : a key of :data:`~deformnb_lessons.drawings.DRAWINGS`.
        what : of which it is, such as the studio.

        Raises
        ------
        DeformError
            If there is no such figure.
        """
        from deformnb_lessons.drawings import DRAWINGS

        check_choice(drawing, DRAWINGS, "drawing")
        return DRAWINGS[drawing](*what)

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
        "1a_coordinates_and_grids.ipynb",
        (30, 30),
        (
            "read and write places on a picture as two numbers",
            "describe how D'Arcy Thompson compared two animals",
            "recognise a shear, a taper and a polar grid, and say which of his pairs are so simple",
        ),
        coordinates.EXERCISES,
    ),
    "fish": Lesson(
        "Bending a fish",
        "1b_bending_a_fish.ipynb",
        (30, 30),
        (
            "describe a drag by its displacement",
            "turn a carp into a boarfish by dragging",
            "say where it grew and where it shrank",
        ),
        fish.EXERCISES,
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
