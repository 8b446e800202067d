"""Exercises that are done in the studio: the studio itself is the argument of the check."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from deformnb.datasets import ThompsonMap, thompson_map, thompson_score
from deformnb.datasets.grid_score import GridScore
from deformnb.errors import DeformError
from deformnb.imaging.demo import subject_box
from deformnb.imaging.projection import project
from deformnb.session.session import Session
from deformnb.volume.views import ViewName
from deformnb.volume.volume import VolumeLike
from deformnb.words import translate
from deformnb_lessons.exercises import AbstractExercise, Result
from deformnb_lessons.moved_animal import NOTHING_DRAGGED, SIDE, MovedAnimal, steps_fault

_NEAR = 0.5  # percent of the change, and pixels of the drawing: a smaller drag was accidental


def session_of(answer: object) -> Session | None:
    """The session of a studio, or of itself; None for anything else."""
    found = getattr(answer, "session", answer)
    return found if isinstance(found, Session) else None


def _not_yet(session: Session, hint: str) -> Result:
    """The result of a studio that is not as it should be: nothing is judged where nobody has edited."""
    is_untouched = hint in (NOTHING_DRAGGED, _DRAG_NODES) or len(session.editing.history_tree()) == 1
    return Result(False, hint, is_open=is_untouched)


@dataclass(frozen=True)
class StudioTask(AbstractExercise):
    """A task in the studio.

    Parameters
    ----------
    question, praise : see :class:`AbstractExercise`.
    fault : hint to a deficit of the animal as the steps move it; an empty text if there is none. Folds in tissue are
        judged before: no exercise allows them.

    Examples
    --------
    >>> task = StudioTask("Drag a point.", "Dragged.", lambda animal: "Drag one.")
    >>> task.judge(None)
    Your turn. Give the studio itself, as in lesson.check("name", studio): its cell has to be run first.
    """

    fault: Callable[[MovedAnimal], str]

    def judge(self, answer: object) -> Result:
        session = session_of(answer)
        if session is None:
            return self._open(_GIVE) if answer is None else self._no(_GIVE)
        try:
            missing = steps_fault(session)
            if not missing:
                animal = MovedAnimal.of(session)
                missing = animal.fault() or self.fault(animal)
        except DeformError as error:
            missing = str(error)
        return _not_yet(session, missing) if missing else self._yes()


_DRAG_NODES = "Nothing has been dragged yet. Drag the points to where their nodes belong, and check again."
_GIVE = 'Give the studio itself, as in lesson.check("name", studio): its cell has to be run first.'


@dataclass(frozen=True)
class FishTask(AbstractExercise):
    """Thompson's transformation, done in the studio.

    Parameters
    ----------
    question, praise : see :class:`AbstractExercise`.
    source, target : the pair of animals.
    percent : share of the transformation that must be done.
    """

    source: str
    target: str
    percent: float

    def grids(self, volume: VolumeLike, side: ViewName = SIDE) -> ThompsonMap:
        """The pair of grids on the visible part of a volume, as it will be scored.

        Examples
        --------
        >>> from deformnb.datasets import PHANTOMS
        >>> task = FishTask("", "", "Polyprion", "Antigonia", 65)
        >>> task.grids(PHANTOMS["fish"].make((16, 32, 16))).source_nodes.shape
        (7, 8, 2)
        """
        return thompson_map(self.source, self.target, box=subject_box(project(volume, side, "mip")), scale="area")

    def judge(self, answer: object) -> Result:
        session = session_of(answer)
        if session is None:
            return self._open(_GIVE) if answer is None else self._no(_GIVE)
        grids = self.grids(session.volume)
        try:
            missing = steps_fault(session)
            if missing:
                return _not_yet(session, _DRAG_NODES if missing == NOTHING_DRAGGED else missing)
            animal = MovedAnimal.of(session)
            score = thompson_score(animal.field, grids)
        except DeformError as error:
            return self._no(str(error))
        if abs(score.percent) < _NEAR and np.abs(score.before - score.distances).max() < _NEAR:
            return _not_yet(session, _DRAG_NODES)
        drawing = grids_svg(score, grids)
        verdict = f"Your fish: {score}. {_advice(score)}"
        if score.percent >= self.percent:
            if fault := animal.fault():
                return Result(False, f"{verdict} {fault}", drawing)
            return Result(True, f"{verdict} {self.praise}", drawing)
        more = f"{self.percent:g} % is enough for a boarfish."
        if score.percent < 0:
            more = (
                "Your grid is farther away than at the start: are some points exchanged? Ctrl+Z in the studio goes "
                "back."
            )
        return Result(False, f"{verdict} {more}", drawing)


def _advice(score: GridScore) -> str:
    """Direction in which the worst node should go, in words."""
    row, column = score.worst
    right, down = score.missing[row, column]
    ways = ((down, ("{:.0f} mm up", "{:.0f} mm down")), (right, ("{:.0f} mm left", "{:.0f} mm right")))
    parts = [words[int(way > 0)].format(abs(way)) for way, words in ways if abs(way) >= 1]
    return f"Node r{row} c{column} should go {' and '.join(parts)} still." if parts else "No node is a millimetre away."


def grids_svg(score: GridScore, grids: ThompsonMap) -> str:
    """Thompson's grid, dashed, and the bent one over it, with a circle where they differ most."""
    places = np.concatenate([score.reached.reshape(-1, 2), grids.target_nodes.reshape(-1, 2)])
    low, size = places.min(axis=0), np.ptp(places, axis=0)
    edge = 0.05 * size.max()

    def lines(nodes: np.ndarray, style: str) -> str:
        drawn = (" ".join(f"{a:.1f},{b:.1f}" for a, b in line) for line in [*nodes, *nodes.transpose(1, 0, 2)])
        return "".join(
            f'<polyline points="{line}" fill="none" {style} vector-effect="non-scaling-stroke"/>' for line in drawn
        )

    a, b = score.reached[score.worst]
    box = f"{low[0] - edge:.1f} {low[1] - edge:.1f} {size[0] + 2 * edge:.1f} {size[1] + 2 * edge:.1f}"
    words = translate(
        "Thompson's grid dashed in orange, yours in blue, and a circle around the node that is farthest away"
    )
    return (
        f'<svg viewBox="{box}" role="img" aria-label="{words}" '
        f'style="width: 100%; max-width: 420px; max-height: 420px; background: #fff"><title>{words}</title>'
        + lines(grids.target_nodes, 'stroke="#d55e00" stroke-width="1.5" stroke-dasharray="5 3"')
        + lines(score.reached, 'stroke="#0072b2" stroke-width="1.5"')
        + f'<circle cx="{a:.1f}" cy="{b:.1f}" r="{edge:.1f}" fill="none" stroke="#000" stroke-width="1.5" '
        'vector-effect="non-scaling-stroke"/></svg>'
    )
