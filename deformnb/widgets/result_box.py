"""The box of the result in the studio: as the volume, with a margin, or as large as deformed matter needs.

What is dragged out of the box is cut off everywhere: in the view, in the result, in whatever is written. So after each
edit the studio's thread looks whether that happens, makes the box anew where it shall be as large as needed, and warns
where it shall not: below the picture, for that is where it is seen, with a button that makes the box larger.
"""

from __future__ import annotations

import contextlib
import weakref
from collections.abc import Callable
from typing import Any

import ipywidgets as ipw

from deformnb.deformation import Deformation
from deformnb.errors import DeformError
from deformnb.field_of_view import grown
from deformnb.io.headers import human_bytes
from deformnb.session import Session
from deformnb.volume import Grid
from deformnb.widgets.controls import Guard, Panel, button, fill, menu, row
from deformnb.widgets.studio_words import as_html
from deformnb.widgets.worker import Worker

CHOICES = {"as the volume": "volume", "as large as needed": "needed", "with a margin": "margin"}
"""What the result's box may be, in words and by name."""

_OWN = ("a box of its own", "own")  # that somebody gave by code

LARGER = ("Make the box larger", "As large as needed, now and after every edit: then nothing is cut off")
"""The way out that stands beside the warning: its name and what it does."""

# Of the longest edge of the volume: the margin that is proposed.
_MARGIN = 0.1


class ResultBox(Panel):
    """A row of controls for :attr:`Session.output <deformnb.session.Session.output>`; it stands in another panel.

    Parameters
    ----------
    worker : the studio's thread.

    Attributes
    ----------
    warning : a line that is seen while something is cut off, with the way out; it stands below the pictures.
    follows : whether the box is as large as needed after every edit; it then belongs to the edit, and goes with it.
    """

    def __init__(self, session: Session, guard: Guard, worker: Worker) -> None:
        super().__init__(session, guard)
        self._worker = worker
        self.follows = self._is_asked = False
        self._known: Deformation | None = None
        self._left: tuple[str, ...] = ()
        self._length = float(f"{_MARGIN * max(session.volume.grid.lengths):.1g}")
        self.margin = ipw.BoundedFloatText(
            value=self._length, min=0.0, max=4 * session.volume.grid.diagonal, step=1.0, continuous_update=False,
            description="mm", layout=ipw.Layout(width="120px"), style={"description_width": "28px"},
            tooltip="Added on every side of the volume, in whole voxels")
        self.words = ipw.HTML("", layout=ipw.Layout(flex="1 1 200px", min_width="0"))  # a label would cut long words
        self._told = ipw.HTML("", layout=ipw.Layout(flex="0 1 auto", min_width="0"))
        self._larger = button(*LARGER, self._make_larger)
        self.warning = row(self._told, self._larger)
        self.choice = self.add(menu("Result box", self._options(),
                                    "What can be seen, and what the result holds: matter dragged out of this box is "
                                    "cut off"), self._chosen, self._choose)
        self.choice.layout.max_width = "280px"
        self.add(self.margin, lambda: self._length, self._grow)
        self.box = row(self.choice, self.margin, self.words)
        self.refresh()

    # -- what is chosen ------------------------------------------------------------------------------------------------

    def _chosen(self) -> str:
        output = self.session.output
        if self._is_asked or (self.follows and output is not None):
            return "needed"
        if output is None:
            return "volume"
        return "own" if self._margin_of(output) is None else "margin"

    def _options(self) -> list[tuple[str, str]]:
        return [*CHOICES.items(), *([_OWN] if self._chosen() == "own" else [])]

    def _margin_of(self, output: Grid) -> float | None:
        """The margin that makes this box; None if there is none."""
        grid = self.session.volume.grid
        index = -grid.point_to_index(output.origin)
        for length in (self._length, *(abs(index) * grid.spacing).tolist()):
            if grown(grid, length) == output:
                return float(length)
        return None

    def _choose(self, what: str) -> None:
        self.follows = self._is_asked = what == "needed"
        if what == "needed":
            self._ask()
        elif what == "margin":
            self._grow(self._length)
        elif what == "volume":
            self.session.output = None

    def _make_larger(self) -> None:
        self.guard(lambda: self._choose("needed"))
        self.refresh()

    def _grow(self, length: float) -> None:
        self._length = float(length)
        self.follows = False
        self.session.grow(self._length)

    def arrange(self) -> None:
        output = self.session.output
        if output is None and not self._is_asked:
            self.follows = False  # it was taken back
        chosen = self._chosen()
        if chosen == "margin" and output is not None:
            self._length = self._margin_of(output) or self._length
        fill(self.choice, self._options())
        self.margin.layout.display = "" if chosen == "margin" else "none"
        if self._known is not self.session.deformation:
            self._known = self.session.deformation
            self._ask()
        self._tell_size()

    def _tell_size(self) -> None:
        grid, volume = self.session.box, self.session.volume
        size = " x ".join(map(str, grid.shape[::-1]))
        facts = [f"{size} voxels (x, y, z), {human_bytes(grid.size * volume.dtype.itemsize)}"]
        if self._left:
            facts.append(f"cut off at the {_listed(self._left)}")
        self.words.value = "; ".join(facts)
        self._told.value = as_html(cut_off_text(self._left))
        self._larger.layout.display = "none" if self.follows else ""  # then it is as large as it may be
        self.warning.layout.display = "" if self._left else "none"

    # -- in the studio's thread ----------------------------------------------------------------------------------------

    def _ask(self) -> None:
        if not self._worker.is_closed:
            self._worker.latest("result box", _weakly(self))

    def _fit(self) -> None:
        self.session.fit_output()

    def look(self) -> None:
        """Make the box as large as is needed, or look what it cuts off; takes a moment."""
        session = self.session
        if self._is_asked:
            self.guard(self._fit)
            self._is_asked = False
        elif self.follows and session.output is not None:
            session.fit_output(joins=True)
        self._left = session.sides_left()
        self.refresh()


def cut_off_text(sides: tuple[str, ...]) -> str:
    """A warning of what is cut off at these sides of the box; empty for none.

    Examples
    --------
    >>> cut_off_text(("left side (L)", "top (S)"))
    'Matter leaves the box at the left side (L) and top (S), and is cut off there.'
    """
    return f"Matter leaves the box at the {_listed(sides)}, and is cut off there." if sides else ""


def _listed(sides: tuple[str, ...]) -> str:
    return " and ".join([", ".join(sides[:-1]), sides[-1]]) if len(sides) > 1 else sides[0]


def _weakly(box: ResultBox) -> Callable[[], None]:
    held: Any = weakref.ref(box)

    def look() -> None:
        alive = held()
        if alive is not None:
            with contextlib.suppress(DeformError):  # of an edit that has already said it
                alive.look()
    return look
