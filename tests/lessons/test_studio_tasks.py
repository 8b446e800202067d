"""Exercises in the studio: ten wrong deeds of each stay unsolved with a hint, and the right ones solve it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

import deformnb as dn
from deformnb.session.session import Session
from deformnb.words import translate
from deformnb_lessons import GOAL_NODES, LESSONS, FishTask, Result, StudioTask, lesson_carp

Way = tuple[tuple[float, float], tuple[float, float]]

CORNERS: list[Way] = [(place, place) for place in ((0, 0), (508, 0), (508, 197), (0, 197))]
ALL = {name: lesson for lesson in LESSONS.values() for name in lesson.exercises}
TASKS = [name for name in ALL if isinstance(ALL[name].exercises[name], StudioTask | FishTask)]


@dataclass(frozen=True)
class Deed:
    """A deed of a pupil in a studio: points from where to where, on one side, and settings of the step.

    ``words`` are in the hint; ``other`` are points of a second step, on the side ``other_view`` or in space.
    """

    words: str
    ways: Sequence[Way]
    view: str = "-x"
    settings: dict[str, Any] = field(default_factory=dict)
    changes: dict[str, Any] = field(default_factory=dict)
    other: Sequence[Way] = ()
    other_view: str = "-x"
    other_settings: dict[str, Any] = field(default_factory=dict)

    def session(self, carp: dn.Volume) -> Session:
        made = dn.Deformation.from_picture_points(carp, self.view, _points(self.ways), **self.settings)
        made = replace(made, steps=(replace(made.steps[0], **self.changes),))
        if self.other_view == "space":
            made = made.then(dn.Deformation.from_space_points(dn.ControlPoints.from_arrays([[0] * 3], [[20, 0, 0]])))
        elif self.other:
            more = dn.Deformation.from_picture_points(carp, self.other_view, _points(self.other), **self.other_settings)
            made = made.then(more)
        return Session(carp, made, view=self.view)


def _points(ways: Sequence[Way]) -> dn.ControlPoints:
    return dn.ControlPoints.from_arrays([source for source, _ in ways], [target for _, target in ways])


# A hand that is drawn back and forth over a place: a fold of some millimetres.
SPECK: list[Way] = [((300, 100), (312, 100)), ((304, 100), (300, 100))]
OTHER: list[Way] = [((300.0, 100.0), (320.0, 100.0))]


def _lift(source: tuple[float, float], target: tuple[float, float], *more: Way, **settings: Any) -> dict[str, Any]:
    return {
        "ways": [*CORNERS, (source, target), *more],
        "settings": {"trend": "none", "support": 120.0, **settings},
    }


HEAD: list[Way] = [((a, b), (a, b)) for a, b in ((20, 100), (60, 80), (60, 130), (95, 60), (95, 100), (95, 150))]


def _turned(degrees: float, factor: float = 1, shift: float = 0) -> list[Way]:
    c, s = factor * np.cos(np.radians(degrees)), factor * np.sin(np.radians(degrees))
    ends = ((40.0, 100.0), (460.0, 100.0))
    return [((a, b), (250 + c * (a - 250) + shift, 100 - s * (a - 250))) for a, b in ends]


def _cut(
    *ways: Way, line: Sequence[tuple[float, float]] | None = ((250, 5), (250, 190)), **more: Any
) -> dict[str, Any]:
    cuts = [] if line is None else [dn.Cut(dn.Line(tuple(line)), "across", enabled=more.pop("enabled", True))]
    return {"ways": [*CORNERS, *ways], "changes": {"cuts": cuts, **more}}


def _pull(left: float, right: float, down: float = 0) -> list[Way]:
    return [((220, 100), (220 + left, 100 - down)), ((280, 100), (280 + right, 100 + down))]


def _goal(share: float = 1.0, order: int = 1) -> list[Way]:
    task = ALL["antigonia"].exercises["antigonia"]
    assert isinstance(task, FishTask)
    points = task.grids(lesson_carp()).points.take(GOAL_NODES).scaled(share)
    return list(zip(map(tuple, points.source), map(tuple, points.target[::order]), strict=True))


def _half(source: tuple[float, float], target: tuple[float, float]) -> tuple[float, float]:
    return (source[0] + target[0]) / 2, (source[1] + target[1]) / 2


UNFOLD = {"trend": "none", "support": 175.0}

_RIGID = {"trend": "rigid"}
_LOCAL = {"trend": "none", "support": 120.0}

RIGHT: dict[str, list[Deed]] = {
    "antigonia": [
        Deed("", _goal()),
        Deed("", _goal(0.95)),
        Deed("", _goal(0.5), other=[(_half(*pair), pair[1]) for pair in _goal()]),
    ],
    "local": [
        Deed("", **_lift((250, 30), (250, 5))),
        Deed("", **_lift((250, 25), (250, 5))),
        Deed("", **_lift((250, 60), (250, 20))),
        Deed("", **_lift((250, 30), (250, 5), *HEAD, support=None)),
        Deed("", **_lift((250, 30), (250, 18)), other=[((250, 18), (250, 4))], other_settings=_LOCAL),
    ],
    "turned": [
        *(Deed("", _turned(degrees), settings={"trend": "rigid"}) for degrees in (18, -18, 15)),
        Deed("", _turned(9), settings=_RIGID, other=_turned(8), other_settings=_RIGID),
    ],
    "unfold": [
        Deed("", [((200, 100), (280, 100))], settings=UNFOLD),
        Deed("", [((200, 100), (275, 100))], settings=UNFOLD),
        Deed("", [((300, 100), (220, 100))], settings={"trend": "none", "support": 240.0}),
        Deed("", [((200, 100), (240, 100))], settings=_LOCAL, other=[((240, 100), (280, 100))], other_settings=_LOCAL),
    ],
    "cut": [
        Deed("", **_cut(*_pull(-30, 30))),
        Deed("", **_cut(*_pull(-30, 30), line=((250, 190), (250, 5)))),
        Deed("", **_cut(*_pull(-30, 5))),
        Deed("", **_cut(*_pull(-30, 30)), other=_turned(12), other_settings=_RIGID),
    ],
}

WRONG: dict[str, list[Deed]] = {
    "antigonia": [
        Deed("Nothing has been", _goal(0)),
        Deed("% is enough", _goal(0.3)),
        Deed("% is enough", _goal(0.6)),
        Deed("farther away", _goal(-0.5)),
        Deed("farther away", _goal(order=-1)),
        Deed("from the left", _goal(), view="+x"),
        Deed("from the left", _goal(), view="+y"),
        Deed("Nothing has been", _goal(), changes={"enabled": False}),
        Deed("every depth", _goal(), changes={"extrusion": "modulate"}),
        Deed("on another side", _goal(), other=OTHER, other_view="+y"),
        Deed("% is enough", _goal(), changes={"strength": 0.4}),
        Deed("folds", [*_goal(), *SPECK]),
        Deed("", [((5000, 100), (5080, 100))]),
        Deed("", [(a, (b[0], b[1] + 3000)) for a, b in _goal()]),
    ],
    "local": [
        Deed("Nothing has been", CORNERS),
        Deed("lifted by 9 mm", **_lift((250, 30), (250, 20))),
        Deed("head moves", **_lift((250, 30), (250, 0), support=None)),
        Deed("choose None for Trend", **_lift((250, 30), (250, 0), trend="affine")),
        Deed("lifted by 0 mm", **_lift((250, 170), (250, 140))),
        Deed("lifted by 0 mm", **_lift((450, 20), (450, -30))),
        Deed("lifted by 0 mm", **_lift((250, 30), (250, 80))),
        Deed("", **_lift((250, 30), (250, -3000))),
        Deed("folds", **_lift((250, 30), (250, 5), *SPECK)),
        Deed("folds", **_lift((250, 60), (250, 0))),
        Deed("Nothing has been", **_lift((250, 30), (250, 5)), changes={"enabled": False}),
        Deed("lifted by", **_lift((250, 30), (250, 5)), changes={"strength": 0.4}),
        Deed("from the left", **_lift((250, 30), (250, 5)), view="+x"),
        Deed("head moves", **_lift((250, 30), (250, 5)), other=OTHER, other_settings=_RIGID),
        Deed("in space", **_lift((250, 30), (250, 5)), other=OTHER, other_view="space"),
        Deed("on another side", **_lift((250, 30), (250, 5)), other=OTHER, other_view="+y"),
        Deed("every depth", **_lift((250, 30), (250, 5)), changes={"extrusion": "modulate"}),
    ],
    "turned": [
        Deed("Nothing has been", _turned(0), settings={"trend": "rigid"}),
        Deed("by 6 degrees", _turned(6), settings={"trend": "rigid"}),
        Deed("Lengths become 0.80 to 0.80", _turned(18, 0.8), settings={"trend": "similarity"}),
        Deed("Lengths become", _turned(0, 1.3), settings={"trend": "similarity"}),
        Deed("bent", _turned(18), settings={"trend": "none"}),
        Deed("left the picture", _turned(18, shift=3000), settings={"trend": "rigid"}),
        Deed("by 0 degrees", _turned(0, shift=30), settings={"trend": "rigid"}),
        Deed("", [*_turned(18), *CORNERS], settings={"trend": "rigid"}),
        Deed("folds", [*_turned(0), ((250, 150), (250, 50))], settings={"trend": "affine_exact"}),
        Deed("folds", [*_turned(18), *SPECK], settings={"trend": "rigid", "support": 20.0}),
        Deed("Nothing has been", _turned(18), settings={"trend": "rigid"}, changes={"enabled": False}),
        Deed("", _turned(18), settings={"trend": "rigid"}, changes={"strength": 0.5}),
        Deed("from the left", _turned(18), settings={"trend": "rigid"}, view="+x"),
        Deed("by 3 degrees", _turned(18), settings=_RIGID, other=_turned(-15), other_settings=_RIGID),
        Deed("on another side", _turned(18), settings={"trend": "rigid"}, other=OTHER, other_view="+y"),
    ],
    "unfold": [
        Deed("Nothing has been", [((200, 100), (200, 100))], settings=UNFOLD),
        Deed("folds", [((200, 100), (280, 100))], settings={"trend": "none", "support": 100.0}),
        Deed("folds", [((200, 100), (280, 100))], settings={"trend": "none", "support": 160.0}),
        Deed("farther than 40 mm", [((200, 100), (240, 100))], settings=UNFOLD),
        Deed("farther than 0 mm", [((5000, 100), (5080, 100))], settings=UNFOLD),
        Deed("farther than", [((200, 100), (240, 100)), ((5000, 100), (5080, 100))], settings=UNFOLD),
        Deed("farther than", [((20, 10), (20, -70))], settings=UNFOLD),
        Deed("", [((200, 100), (3200, 100))], settings=UNFOLD),
        Deed("farther than 40", [((200, 100), (280, 100))], settings=UNFOLD, changes={"strength": 0.5}),
        Deed("Nothing has been", [((200, 100), (280, 100))], settings=UNFOLD, changes={"enabled": False}),
        Deed("folds", [((200, 100), (280, 100)), ((330, 100), (350, 100)), ((334, 100), (330, 100))], settings=UNFOLD),
        Deed("from the left", [((200, 100), (280, 100))], settings=UNFOLD, view="+x"),
        Deed(
            "farther than",
            [((200, 100), (280, 100))],
            settings=UNFOLD,
            other=[((280, 100), (220, 100))],
            other_settings=UNFOLD,
        ),
        Deed("in space", [((200, 100), (280, 100))], settings=UNFOLD, other=OTHER, other_view="space"),
    ],
    "cut": [
        Deed("Nothing has been", **_cut()),
        Deed("no cut yet", **_cut(*_pull(-30, 30), line=None)),
        Deed("no cut yet", **_cut(*_pull(-30, 30), enabled=False)),
        Deed("parts nothing", **_cut(*_pull(-30, 30), line=((700, 0), (700, 190)))),
        Deed("parts nothing", **_cut(*_pull(-30, 30), line=((0, 5), (500, 5)))),
        Deed("together, by", **_cut(*_pull(60, -60))),
        Deed("together, by", **_cut(*_pull(20, -20))),
        Deed("0 mm apart", **_cut(*_pull(0, 0, 30))),
        Deed("Only one side", **_cut(*_pull(-30, 0))),
        Deed("Only one side", **_cut(*_pull(0, 30))),
        Deed("mm apart", **_cut(*_pull(-3, 3))),
        Deed("Put a point on each side", **_cut(((5000, 100), (5080, 100)))),
        Deed("folds", **_cut(*_pull(-30, 30), *[((a + 60, b), (c + 60, d)) for (a, b), (c, d) in SPECK])),
        Deed("in space", **_cut(*_pull(-30, 30)), other=OTHER, other_view="space"),
        Deed("on another side", **_cut(*_pull(-30, 30)), other=OTHER, other_view="+x"),
    ],
}


@pytest.fixture(scope="module")
def carp() -> dn.Volume:
    return lesson_carp()


def _check(name: str, deed: Deed, carp: dn.Volume) -> Result:
    return ALL[name].check(name, deed.session(carp))


def test_every_exercise_in_the_studio_has_right_deeds_and_ten_wrong_ones() -> None:
    assert set(RIGHT) == set(WRONG) == set(TASKS)
    assert all(len(WRONG[name]) >= 10 for name in TASKS)


@pytest.mark.parametrize("name", TASKS)
def test_right_deeds_solve_an_exercise(name: str, carp: dn.Volume) -> None:
    for deed in RIGHT[name]:
        result = _check(name, deed, carp)
        assert result.right, (deed, result.text)


@pytest.mark.parametrize("name", TASKS)
def test_wrong_deeds_leave_an_exercise_unsolved_and_say_what_is_wrong(name: str, carp: dn.Volume) -> None:
    hints = []
    for deed in WRONG[name]:
        result = _check(name, deed, carp)
        assert not result.right, (deed, result.text)
        assert deed.words in result.text, (deed, result.text)
        assert translate(result.text, "de") != result.text, result.text
        hints.append(result.text)
    assert len(set(hints)) >= 5, hints
