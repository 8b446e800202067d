"""Cuts and rigid parts of the step that is edited: a list of them, what each does, and ways to make more."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import ipywidgets as ipw
import numpy as np

from deformnb.cuts import Cut
from deformnb.errors import DeformError
from deformnb.masks import Mask
from deformnb.regions import AbstractRegion, HalfSpace
from deformnb.rigid_parts import RigidPart
from deformnb.session import Session
from deformnb.volume import Volume
from deformnb.widgets.controls import Guard, Panel, button, menu, row
from deformnb.widgets.item_list import ItemList
from deformnb.widgets.part_controls import PartControls, middle_of, turn_and_shift
from deformnb.widgets.shape_messages import followed

# As the editor draws them: a white line, and hatching.
_CUT_LOOK = "linear-gradient(135deg, #39404a 40%, #fff 40% 60%, #39404a 60%)"
_PART_LOOK = "repeating-linear-gradient(45deg, #39404a 0 2.5px, #fff 2.5px 4px)"

_KINDS = {"half_space": "all on one side", "polygon": "closed line", "line": "line", "mask": "mask"}
_RULES = {"source": "wherever its piece has moved to", "paper": "on its own side only (the paper's)"}
_EMPTY = ("Nothing yet. A cut lets the two sides of a line move on their own: draw it across the picture, then drag a "
          "point on each side. A rigid part keeps its form: draw around it.")
_EMPTY_SPACE = ("Nothing yet. In space a part or a cut is the ground, a label (Studio(volume, labels=...)), or made in "
                "Python: studio.session.edit_cuts([...]).")
_MOST_LABELS = 200
_GROUND_AT = 0.1  # share of the picture's height, from below


class ShapesPanel(Panel):
    """Cuts and rigid parts.

    Parameters
    ----------
    editor : on whose picture shapes are drawn.
    labels : a volume of numbered parts to take regions from, names : what the numbers are called.
    """

    title = "Cuts & parts"

    def __init__(self, session: Session, guard: Guard, editor: Any, labels: Volume | None = None,
                 names: Mapping[int, str] | None = None) -> None:
        super().__init__(session, guard)
        self._editor = editor
        self._labels = labels
        self._chosen: tuple[str, int] | None = None
        self._listed: dict[str, tuple[Any, ...]] = {"cut": (), "part": ()}  # what the chosen row is a row of
        self.items = ItemList(label="Cuts and rigid parts", commands=["rename", "remove"], empty=_EMPTY)
        self.items.on_act(self._act)
        self._rule = self.of_step(menu("Show matter", [(text, name) for name, text in _RULES.items()],
                                       "What is seen where the two sides of a cut have been moved over each other"),
                                  "cut_rule")
        self.part = PartControls(session, guard, self._part_index)
        self._drawing = self._draw_buttons()
        ground = button("Ground", "A fixed part: everything below a level stays",
                        lambda: guard(lambda: self._add("part", self._ground(), "ground")))
        more = row(*self._drawing, ground, *self._label_widgets(names or {}))
        self.box = ipw.VBox([self.items, more, row(self._rule), self.part.box])
        editor.observe(self._chosen_in_the_picture, "chosen_shape")
        self.refresh()

    def _draw_buttons(self) -> list[Any]:
        return [button("Draw cut", "Draw a line across the picture; its sides can be dragged apart",
                       lambda: self.guard(lambda: self._editor.draw("cut"))),
                button("Draw rigid part", "Draw around what must keep its form",
                       lambda: self.guard(lambda: self._editor.draw("part")))]

    def _label_widgets(self, names: Mapping[int, str]) -> list[Any]:
        if self._labels is None:
            return []
        present = [int(value) for value in np.unique(self._labels.values) if value != 0][:_MOST_LABELS]
        options = [(names.get(n) or f"label {n}", n) for n in present]
        self._label = ipw.Dropdown(options=options, layout=ipw.Layout(width="150px"), tooltip="Part of the labels")
        add = [button(text, tip, self._taker(what)) for text, tip, what in (
            ("Label as part", "Keep this region rigid", "part"), ("Label as cut", "Cut along its outline", "cut"))]
        return [self._label, *add]

    def _taker(self, what: str) -> Callable[[], Any]:
        return lambda: self.guard(lambda: self._add(what, self._region_of_label(), self._label.label))

    def close(self) -> None:
        """Let go of the label volume and of the picture."""
        self._labels = None
        self._editor.unobserve(self._chosen_in_the_picture, "chosen_shape")

    # -- what is there -------------------------------------------------------------------------------------------------

    def _rows(self) -> list[tuple[str, int]]:
        step = self.session.step
        return [("cut", k) for k in range(len(step.cuts))] + [("part", k) for k in range(len(step.parts))]

    def _part_index(self) -> int | None:
        return self._chosen[1] if self._chosen is not None and self._chosen[0] == "part" else None

    def arrange(self) -> None:
        self._follow()
        rows, step = self._rows(), self.session.step
        self.items.show([_row(what, k, (step.cuts if what == "cut" else step.parts)[k]) for what, k in rows],
                        rows.index(self._chosen) if self._chosen in rows else -1)
        self.items.empty = _EMPTY if step.plane is not None else _EMPTY_SPACE
        self._rule.layout.display = "" if step.cuts else "none"
        self.part.box.layout.display = "" if self._part_index() is not None else "none"
        self.part.refresh()
        for widget in self._drawing:
            widget.layout.display = "none" if step.plane is None else ""

    def _follow(self) -> None:
        """Let the chosen row stay with its shape. The first one is chosen, and none in the place of one that goes."""
        before, self._listed = self._listed, {what: self._shapes(what) for what in ("cut", "part")}
        if self._chosen is not None:
            what, k = self._chosen
            place = followed(before[what], self._listed[what], k)
            self._chosen = None if place is None else (what, place)
        elif len(rows := self._rows()) == 1 and not any(before.values()):
            self._chosen = rows[0]

    def _chosen_in_the_picture(self, change: Any) -> None:
        chosen = change["new"]
        if chosen and self.session.step.plane is not None:  # where it has none, the row stays
            self._choose(chosen["what"].removesuffix("s"), chosen["index"])
            self.refresh()

    def _choose(self, what: str, index: int) -> None:
        """Choose a row of the list as it is now."""
        self._follow()
        self._chosen = (what, index) if index < len(self._listed[what]) else None

    def _act(self, what: str, index: int, value: Any) -> None:
        self._choose(*self._rows()[index])
        self._show_in_the_picture()
        if what == "remove":
            self.guard(self._remove)
        elif what in ("switch", "rename"):
            fields = {"enabled": value} if what == "switch" else {"name": value}
            verb = "rename" if what == "rename" else "switch on" if value else "switch off"
            self.guard(lambda: self._replace(verb, **fields))
        self.refresh()

    def _replace(self, verb: str, **fields: Any) -> None:
        what, k = self._the_chosen()
        shapes = list(self._shapes(what))
        label = f"{verb} {_name(what, k, shapes[k])}"
        shapes[k] = replace(shapes[k], **fields)
        self._edit(what, shapes, label)

    def _remove(self) -> None:
        what, k = self._the_chosen()
        shapes = list(self._shapes(what))
        label = f"remove {_name(what, k, shapes.pop(k))}"
        self._edit(what, shapes, label)

    def _the_chosen(self) -> tuple[str, int]:
        if self._chosen is None:
            raise DeformError("no cut or part is chosen; click on one in the list.")
        return self._chosen

    def _shapes(self, what: str) -> tuple[Any, ...]:
        step = self.session.step
        return step.cuts if what == "cut" else step.parts

    def _edit(self, what: str, shapes: list[Any], label: str) -> None:
        (self.session.edit_cuts if what == "cut" else self.session.edit_parts)(shapes, label)

    # -- more of them --------------------------------------------------------------------------------------------------

    def _add(self, what: str, region: AbstractRegion, name: str) -> None:
        shapes = self._shapes(what)
        made = Cut(region, name) if what == "cut" else RigidPart(region, name=name)
        self._edit(what, [*shapes, made], f"add the {'cut' if what == 'cut' else 'rigid part'} {name}")
        self._choose(what, len(shapes))
        self._show_in_the_picture()
        self.refresh()

    def _show_in_the_picture(self) -> None:
        if self._chosen is not None and self.session.step.plane is not None:
            what, index = self._chosen
            if index < len(getattr(self._editor, f"{what}s")):  # else another picture is still being made
                self._editor.choose(f"{what}s", index)

    def _ground(self) -> HalfSpace:
        """All below a level near the lower edge of the picture, or of the volume."""
        corners = self.session.volume.grid.corners()
        plane = self.session.step.plane
        if plane is None:
            low, high = corners.min(axis=0), corners.max(axis=0)
            middle = (low + high) / 2
            return HalfSpace((middle[0], middle[1], low[2] + _GROUND_AT * (high[2] - low[2])), (0.0, 0.0, 1.0))
        flat = plane.to_plane(corners)[:, :2]
        low, high = flat.min(axis=0), flat.max(axis=0)
        return HalfSpace(((low[0] + high[0]) / 2, high[1] - _GROUND_AT * (high[1] - low[1])), (0.0, -1.0))

    def _region_of_label(self) -> Mask:
        if self._labels is None or self._label.value is None:
            raise DeformError("the label volume has no label to choose; every voxel of it is 0.")
        mask = Mask.from_labels(self._labels, int(self._label.value))
        plane = self.session.step.plane
        return mask if plane is None else mask.silhouette(plane)


def _name(what: str, k: int, shape: Any) -> str:
    return shape.name or f"{what} {k + 1}"


def _row(what: str, k: int, shape: Any) -> dict[str, Any]:
    facts = [what if what == "cut" else "rigid part", _KINDS.get(shape.region.kind, shape.region.kind)]
    return {"name": shape.name, "title": f"{what} {k + 1}", "on": shape.enabled, "id": what,
            "facts": [*facts, _motion_words(shape) if what == "part" else ""],
            "swatch": _CUT_LOOK if what == "cut" else _PART_LOOK}


def _motion_words(part: RigidPart) -> str:
    if part.motion is None:
        return "stays"
    degrees, _, shift = turn_and_shift(part.motion, middle_of(part.region))
    words = [f"turned {degrees:.0f}\u00b0"] if abs(degrees) >= 0.5 else []
    if np.abs(shift).max() >= 0.05:
        words.append(f"shifted {', '.join(f'{round(s, 1) + 0.0:.1f}' for s in shift)}")
    return ", ".join(words) or "is moved"
