"""Table of the controls of the application: the kind, the range or choices, and the label of each.

The layout of the client is made from this table, and messages of the client are checked against it.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

from deformnb.errors import DeformError
from deformnb.imaging.picture import PROJECTIONS
from deformnb.rbf.extrusion import EXTRUSIONS
from deformnb.rbf.kernels import KERNELS
from deformnb.rbf.stages import MOST_STAGES
from deformnb.rbf.trends import TRENDS
from deformnb.widgets.camera import SHOWS, SIDES
from deformnb.widgets.studio.diagnostics import OVERLAY_WORDS
from deformnb.widgets.studio.panels.steps import MODES


@dataclass(frozen=True)
class AbstractControl(ABC):
    """One thing to set.

    Parameters
    ----------
    title : shown beside it.
    hint : one sentence for who does not know it.
    """

    title: str
    hint: str = ""

    @abstractmethod
    def checked(self, value: Any) -> Any:
        """The value as Python wants it.

        Raises
        ------
        DeformError
            If the client may not set it to that.
        """


@dataclass(frozen=True)
class Choice(AbstractControl):
    """One of several names; ``titles`` are shown for them."""

    titles: tuple[tuple[str, str], ...] = ()

    def checked(self, value: Any) -> str:
        for name, _ in self.titles:
            if isinstance(value, str) and value == name:
                return name
        raise DeformError(f"{self.title} cannot be that.")


@dataclass(frozen=True)
class Number(AbstractControl):
    """A number between two others; ``unset``, if given, stands for "choose for me" at the low end."""

    low: float = 0.0
    high: float = 1.0
    step: float = 0.01
    unset: str = ""

    def checked(self, value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise DeformError(f"{self.title} is a number.")
        if not self.low <= value <= self.high:
            raise DeformError(f"{self.title} lies between {self.low:g} and {self.high:g}.")
        return float(value)


@dataclass(frozen=True)
class Switch(AbstractControl):
    """On or off."""

    def checked(self, value: Any) -> bool:
        if not isinstance(value, bool):
            raise DeformError(f"{self.title} is on or off.")
        return value


def _titled(names: Any, titles: dict[str, str] | None = None) -> tuple[tuple[str, str], ...]:
    return tuple((name, (titles or {}).get(name) or name.replace("_", " ").capitalize()) for name in names)


_RULES = {"replicate": "The same at every depth", "modulate": "Times a curve f(z)",
          "interpolate": "Between key pictures"}


def control_table(reach: float) -> dict[str, AbstractControl]:
    """All controls by name.

    Parameters
    ----------
    reach : the largest support radius that makes sense: the volume's diagonal.

    Examples
    --------
    >>> control_table(100.0)["kernel"].checked("gaussian")
    'gaussian'
    """
    kernels = {name: kernel.title for name, kernel in KERNELS.items()}
    trends = {name: trend.title[:1].upper() + trend.title[1:] for name, trend in TRENDS.items()}
    pictures = {name: projection.title for name, projection in PROJECTIONS.items()}
    step = 10 ** math.floor(math.log10(reach / 200)) if reach > 0 else 0.01
    return {
        "view": Choice("Side", "Where the picture is seen from; each side has points of its own",
                       tuple(SIDES.items())),
        "method": Choice("Projection", "How depth becomes a picture", _titled(PROJECTIONS, pictures)),
        "depth": Number("Slice at", "0 in front, 1 at the back", 0.0, 1.0, 0.005),
        "kernel": Choice("Kernel", "How the pull of a point fades with distance", _titled(KERNELS, kernels)),
        "trend": Choice("Trend", "What points far apart agree on", _titled(TRENDS, trends)),
        "support": Number("Reach", "How far a point pulls", 0.0, math.ceil(reach / step) * step, step, unset="auto"),
        "smoothing": Number("Smoothing", "0 meets every point; more lets them miss", 0.0, 1.0, 0.01),
        "extrusion": Choice("Rule", "What the picture's displacement becomes in space",
                            _titled(EXTRUSIONS, _RULES)),
        "strength": Number("Strength", "0 undeformed, 1 as dragged, −1 the opposite way", -1.0, 3.0, 0.05),
        "mode": Choice("Steps are done", "One after the other is what hands would do; added up blends them",
                       _titled(MODES, {name: text[:1].upper() + text[1:] for name, text in MODES.items()})),
        "projection": Choice("Volume as", "How the volume is drawn",
                             (("shaded", "Shaded"), ("composite", "Translucent"), ("mip", "Maximum"))),
        "show_net": Switch("Net", "A grid that bends with the picture"),
        "drag_net": Switch("Drag the net", "Its nodes can be dragged: each becomes a point"),
        "show_radius": Switch("Circles", "How far each point reaches"),
        "shows": Choice("Show", "The volume before and after", _titled(SHOWS)),
        "overlay": Choice("On the picture", "What is laid over the picture; V goes through them there",
                          tuple((name, text[:1].upper() + text[1:]) for text, name in OVERLAY_WORDS)),
        "stages": Number("Stages", "Small maps done one after the other; more fold later and take longer",
                         1, MOST_STAGES, 1),
        "keep_free": Switch("Keep fold-free", "After every edit, choose the stages that leave no fold"),
        "show_folds": Switch("Folds in the volume", "Red stripes on matter that is shown twice"),
    }


ACTIONS = ("undo", "redo", "reset", "save", "front", "beside", "restore", "skip", "delete", "take_back", "unfold",
           "stop_file", "take_anyway", "forget_file", "fit_box", "own_box", "take_hold", "add_step")
"""Actions that a client may request by name."""

NUMBERED = ("go_to", "look_at")
"""Actions that a client may request by name and number: a state of the history, a control point."""
