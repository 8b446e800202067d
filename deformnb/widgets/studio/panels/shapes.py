"""Shapes panel: cuts and rigid parts of the edited step, the properties of each, and controls to add more.

Menus and sliders set the motion of the chosen rigid part and the range of its influence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._deferred import scipy
from deformnb.errors import DeformError
from deformnb.rbf.cuts import Cut
from deformnb.rbf.regions import AbstractRegion, HalfSpace, Line, Mask
from deformnb.rbf.rigid import RigidMotion, RigidPart, carry_points, without_conflicts
from deformnb.session.session import Session
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets import basic_widgets as basic
from deformnb.widgets.boxes import column, row
from deformnb.widgets.editor.space_slices import PANES, Pane
from deformnb.widgets.inputs.item_list import ItemList
from deformnb.widgets.messages.shapes import track_index
from deformnb.widgets.studio.controls import Guard, Panel, button, menu, slider, widget_of
from deformnb.widgets.studio.panels.labels import LabelChooser

_STATES = {"fixed": "stays where it is", "moved": "is moved"}
_WEIGHTS = {"saturated": "smooth step", "distance": "distance (the paper's)"}
_AXES = np.eye(3)


@lru_cache(maxsize=32)
def middle_of(region: AbstractRegion) -> tuple[float, ...]:
    """The middle of a region: that of its pixels or voxels, or the place on the boundary of a half space.

    Examples
    --------
    >>> from deformnb.rbf.regions import Polygon
    >>> middle_of(Polygon([(0, 0), (4, 0), (4, 2), (0, 2)]))
    (2.0, 1.0)
    """
    if isinstance(region, HalfSpace):
        return region.point
    if isinstance(region, Mask):
        places = np.argwhere(region.values)[:, ::-1].mean(axis=0)  # x first
        lattice: Any = region.lattice
        if isinstance(lattice, Grid):
            return tuple(lattice.index_to_point(places).tolist())
        return tuple((np.asarray(lattice.origin) + places * np.asarray(lattice.spacing)).tolist())
    v = np.asarray(region.vertices)  # type: ignore[attr-defined]
    after = np.roll(v, -1, axis=0)
    cross = v[:, 0] * after[:, 1] - after[:, 0] * v[:, 1]
    return tuple((((v + after) * cross[:, None]).sum(axis=0) / (3.0 * cross.sum())).tolist())


def pivot_of(part: RigidPart) -> tuple[float, ...]:
    """The place about which a part is turned: its own, or the middle of its region."""
    return part.pivot or middle_of(part.region)


def turn_and_shift(motion: RigidMotion | None, middle: Sequence[float]) -> tuple[float, int, NDArray[np.float64]]:
    """A motion as a turn about a place and a shift: degrees, the axis that is nearest (0 x, 1 y, 2 z), the shift.

    Examples
    --------
    >>> degrees, axis, shift = turn_and_shift(RigidMotion.turn(30, (1, 2), (3, 4)), (1, 2))
    >>> round(degrees), axis, shift.round(9).tolist()
    (30, 2, [3.0, 4.0])
    """
    if motion is None:
        return 0.0, 2, np.zeros(len(middle))
    matrix = np.eye(3)
    matrix[: motion.dim, : motion.dim] = motion.matrix
    vector = scipy.spatial.transform.Rotation.from_matrix(matrix).as_rotvec(degrees=True)
    axis = int(np.abs(vector).argmax()) if vector.any() else 2
    degrees = float(np.copysign(np.linalg.norm(vector), vector[axis]))
    return degrees, axis, motion([middle])[0] - np.asarray(middle)


def edit_parts(
    session: Session,
    editor: Any,
    parts: Sequence[RigidPart],
    label: str,
    kind: str | None = None,
    *,
    slides: bool = False,
) -> None:
    """Give the step other rigid parts; where points contradict them, the picture offers choices for the points.

    Parameters
    ----------
    editor : shows the picture; None where there is none for questions.
    label, kind, slides : as of :meth:`~deformnb.session.editing.Editing.edit_parts`.

    Raises
    ------
    DeformError
        If that makes no deformation, or not before there is an answer.
    """
    try:
        session.editing.edit_parts(parts, label, kind, slides=slides)
    except DeformError:
        points = carry_points(session.editing.points, session.editing.step.parts, parts)
        if editor is None or session.editing.step.plane is None or without_conflicts(points, parts) == points:
            raise
        editor.propose(parts, label)
        raise DeformError(
            "control points in a rigid part require another movement than the part's: the user decides about them."
        ) from None


class PartControls(Panel):
    """Controls of the chosen rigid part.

    Parameters
    ----------
    index : gives the chosen part of the step, None for none.
    editor : shows the choices for points that contradict a part; None for no question.
    """

    def __init__(self, session: Session, guard: Guard, index: Any, editor: Any = None) -> None:
        super().__init__(session, guard)
        self._index = index
        self._editor = editor
        reach = 0.5 * session.volume.grid.diagonal
        self._axis = 2
        state = self.add(
            menu(
                "Part",
                [(text, name) for name, text in _STATES.items()],
                "A part that is moved rotates and shifts as a whole; the tissue around it bends",
            ),
            lambda: "fixed" if self.part is None or self.part.motion is None else "moved",
            self._set_state,
        )
        weight = self.add(
            menu(
                "Influence by",
                [(text, name) for name, text in _WEIGHTS.items()],
                "How the deformation fades towards the part",
            ),
            lambda: "saturated" if self.part is None else self.part.weight,
            lambda value: self._write("change the weight of", weight=value),
        )
        self._angle = self._slider("Turn", 180.0, "Degrees about the pivot", "turn", ".1f")
        self._axes = self.add(
            menu("About", [("x (left)", "0"), ("y (back)", "1"), ("z (up)", "2")], "Axis of the turn"),
            lambda: str(self._motion_parameters()[1]),
            self._set_axis,
        )
        names = (("Right", "Down"), ("x", "y", "z"))
        self._shifts = [
            [
                self._slider(f"Shift {name.lower()}", reach, f"Length along {name.lower()}", k, ".1f")
                for k, name in enumerate(group)
            ]
            for group in names
        ]
        self._places = [[self._number(f"Pivot {name.lower()}", k) for k, name in enumerate(group)] for group in names]
        self._reach = self.add(
            slider(
                "Reach",
                0.0,
                reach,
                reach / 200,
                "Distance beyond which the part has no effect; 0 takes that of the nearest control point",
                ".1f",
            ),
            lambda: min((self.part and self.part.reach) or 0.0, reach),
            lambda value: self._write("change the reach of", "reach", reach=value or None),
        )
        of_plane, of_space = ([*self._shifts[k], *self._places[k]] for k in (0, 1))
        self._moving = [self._angle, self._axes, *of_plane, *of_space]
        self.box = column(row(state, weight, self._reach), row(*self._moving))
        self.refresh()

    def _slider(self, text: str, most: float, tip: str, what: str | int, form: str) -> Any:
        step = float(10.0 ** np.floor(np.log10(most / 500)))  # a round one, so that typed values stay unchanged
        most = step * float(np.ceil(most / step))
        made = slider(text, -most, most, step, tip, form)
        if isinstance(what, str):
            return self.add(
                made,
                lambda: float(np.clip(self._motion_parameters()[0], -most, most)),
                lambda value: self._move("turn", degrees=value),
            )
        return self.add(made, lambda: self._shift(what, most), lambda value: self._move("shift", shift=(what, value)))

    def _number(self, text: str, k: int) -> Any:
        made = basic.FloatText(
            description=text,
            step=1.0,
            layout=basic.layout(width="180px"),
            continuous_update=False,
            style={"description_width": "80px"},
            tooltip="The place that a turn leaves where it is; turn and shift stay as they are",
        )
        return self.add(made, lambda: self._pivot(k), lambda value: self._set_pivot(k, value))

    def _pivot(self, k: int) -> float:
        about = self._about()
        return round(about[k], 3) if k < len(about) else 0.0

    def _about(self) -> tuple[float, ...]:
        """The pivot of the part that is chosen."""
        return () if self.part is None else pivot_of(self.part)

    def _set_pivot(self, k: int, value: float) -> None:
        part, about = self.part, list(self._about())
        if part is None or k >= len(about) or not np.isfinite(value):
            return
        degrees, _, shift = self._motion_parameters()
        about[k] = float(value)
        self._move("move the pivot of", degrees=degrees, to=shift, pivot=tuple(about))

    @property
    def part(self) -> RigidPart | None:
        """The part that is chosen."""
        index, parts = self._index(), self.session.editing.step.parts
        return parts[index] if index is not None and index < len(parts) else None

    def _motion_parameters(self) -> tuple[float, int, NDArray[np.float64]]:
        part = self.part
        if part is None:
            return 0.0, self._axis, np.zeros(3)
        degrees, axis, shift = turn_and_shift(part.motion, self._about())
        return degrees, axis if degrees else self._axis, shift

    def _shift(self, k: int, most: float) -> float:
        shift = self._motion_parameters()[2]
        return float(np.clip(shift[k], -most, most)) if k < len(shift) else 0.0

    def _set_state(self, state: str) -> None:
        if self.part is not None:
            middle = self._about()
            still = RigidMotion.turn(0.0, middle, axis=_AXES[self._axis] if len(middle) == 3 else None)
            self._write("move" if state == "moved" else "fix", motion=still if state == "moved" else None)

    def _set_axis(self, value: str) -> None:
        self._axis = int(value)
        self._move("turn", axis=self._axis)

    def _move(
        self,
        verb: str,
        degrees: float | None = None,
        axis: int | None = None,
        shift: tuple[int, float] | None = None,
        to: NDArray[np.float64] | None = None,
        pivot: tuple[float, ...] | None = None,
    ) -> None:
        if self.part is None:
            return
        middle = pivot or self._about()
        old_degrees, old_axis, new_shift = self._motion_parameters()
        if to is not None:  # the shift of before, which the new pivot would read otherwise
            new_shift = to
        if shift is not None:
            new_shift[shift[0]] = shift[1]
        about = _AXES[old_axis if axis is None else axis] if len(middle) == 3 else None
        motion = RigidMotion.turn(old_degrees if degrees is None else degrees, middle, new_shift, about)
        slider = f"shift {shift[0]}" if shift else "turn" if degrees is not None and to is None else None
        self._write(verb, slider, motion=motion, pivot=pivot or self.part.pivot)

    def _write(self, verb: str, kind: str | None = None, **fields: Any) -> None:
        index, parts = self._index(), list(self.session.editing.step.parts)
        if index is None or index >= len(parts):
            return
        parts[index] = replace(parts[index], **fields)
        name = parts[index].name or f"part {index + 1}"
        edit_parts(
            self.session,
            self._editor,
            parts,
            f"{verb} {name}",
            f"{kind} {index}" if kind else None,
            slides=kind is not None,
        )

    def arrange(self) -> None:
        part = self.part
        is_moved = part is not None and part.motion is not None
        in_space = part is not None and part.region.dim == 3
        for widget in self._moving:
            of_space = widget is self._axes or widget in (*self._shifts[1], *self._places[1])
            of_plane = widget in (*self._shifts[0], *self._places[0])
            shown = is_moved and (in_space or not of_space) and not (in_space and of_plane)
            basic.set_visible(widget, shown)


# As the editor draws them: a white line, and hatching.
_CUT_LOOK = "linear-gradient(135deg, #39404a 40%, #fff 40% 60%, #39404a 60%)"
_PART_LOOK = "repeating-linear-gradient(45deg, #39404a 0 2.5px, #fff 2.5px 4px)"

_ENDS = {
    "go on to the border": (False, False),
    "first end here": (True, False),
    "last end here": (False, True),
    "both ends here": (True, True),
}

_KINDS = {"half_space": "all on one side", "polygon": "closed line", "line": "line", "mask": "mask"}
_EMPTY = (
    "Nothing yet. A cut lets the two sides of a line move separately: draw it across the picture, then drag a "
    "point on each side. A rigid part stays undeformed: draw around it."
)
_EMPTY_SPACE = (
    "Nothing yet. In space a rigid part is drawn in the slices, a cut and a fixed side lie at the large slice, and a "
    "label can be either. The wand needs a picture: choose a side over it."
)
_FIXED_AT = 0.1  # share of the picture's height, from below


class ShapesPanel(Panel):
    """Cuts and rigid parts.

    Parameters
    ----------
    editors : ``plane`` is the editor on whose picture shapes are drawn, ``current`` that of the step being edited.
    labels : a volume of numbered parts to take regions from, names : the names of the numbers.
    folder : where other label volumes are opened by name.
    """

    title = "Rigid parts and cuts"

    def __init__(
        self,
        session: Session,
        guard: Guard,
        editors: Any,
        labels: Volume | None = None,
        names: Mapping[int, str] | None = None,
        folder: str | PathLike[str] = ".",
    ) -> None:
        super().__init__(session, guard)
        self._editors, self._editor = editors, editors.plane
        self._followed: list[Any] = []  # editors in which shapes are chosen
        self._chosen: tuple[str, int] | None = None
        self._listed: dict[str, tuple[Any, ...]] = {"cut": (), "part": ()}  # the list of the chosen row
        self.items = ItemList(label="Cuts and rigid parts", commands=["rename", "remove"], empty=_EMPTY)
        self.items.on_act(self._act)
        self._rule = self.bind_step(widget_of("cut_rule"), "cut_rule")
        self._ends = self.add(
            menu(
                "Cut's ends",
                [(text, text) for text in _ENDS],
                "A cut that ends here closes at its tip and is whole beyond it; in the picture a "
                "double-click on an end does the same",
            ),
            self._ends_of,
            self._set_ends,
        )
        self.part = PartControls(session, guard, self._part_index, self._editor)
        self._drawing = self._draw_buttons()
        self._cut_slice = button(
            "Cut at the slice",
            "What lies before the large slice and what lies behind it can be dragged apart",
            lambda: guard(lambda: self.add_regions("cut", [("cut at a slice", self._behind_slice())])),
        )
        fixed = button(
            "Fixed side",
            "All below a level stays fixed; in space, all behind the large slice",
            lambda: guard(lambda: self.add_regions("part", [("fixed side", self._fixed_side())])),
        )
        self.labels = LabelChooser(session, guard, self.add_regions, folder, labels, names)
        more = row(*self._drawing, self._cut_slice, fixed)
        self.box = column(self.items, more, self.labels.box, row(self._ends, self._rule), self.part.box)
        self.refresh()

    def _draw_buttons(self) -> list[Any]:
        return [
            button(
                "Draw cut",
                "Draw a line across the picture; its sides can be dragged apart",
                lambda: self.guard(lambda: self._editor.draw("cut")),
            ),
            button(
                "Draw rigid part",
                "Draw around the tissue that stays rigid",
                lambda: self.guard(lambda: self._editor.draw("part")),
            ),
        ]

    def close(self) -> None:
        """Let go of the label volume and of the picture."""
        self.labels.close()
        for editor in self._followed:
            editor.unobserve(self._follow_choice, "chosen_shape")

    # -- contents ------------------------------------------------------------------------------------------------------

    def _rows(self) -> list[tuple[str, int]]:
        step = self.session.editing.step
        return [("cut", k) for k in range(len(step.cuts))] + [("part", k) for k in range(len(step.parts))]

    def _part_index(self) -> int | None:
        return self._chosen[1] if self._chosen is not None and self._chosen[0] == "part" else None

    def _line(self) -> Line | None:
        """The line of the chosen cut, if it is one."""
        what, k = self._chosen or ("", 0)
        region = (
            self.session.editing.step.cuts[k].region
            if what == "cut" and k < len(self.session.editing.step.cuts)
            else None
        )
        return region if isinstance(region, Line) else None

    def _ends_of(self) -> str:
        line = self._line()
        return next(text for text, stops in _ENDS.items() if stops == (line.stops if line else (False, False)))

    def _set_ends(self, text: str) -> None:
        line = self._line()
        if line is not None:
            self._replace("change the ends of", region=replace(line, stops=_ENDS[text]))

    def arrange(self) -> None:
        self._follow()
        self._follow_editor(self._editors.current)
        rows, step = self._rows(), self.session.editing.step
        self.items.show(
            [_row(what, k, (step.cuts if what == "cut" else step.parts)[k]) for what, k in rows],
            rows.index(self._chosen) if self._chosen in rows else -1,
        )
        self.items.empty = _EMPTY if step.plane is not None else _EMPTY_SPACE
        basic.set_visible(self._rule, step.cuts)
        basic.set_visible(self._ends, self._line() is not None)
        basic.set_visible(self.part.box, self._part_index() is not None)
        self.part.refresh()
        self.labels.refresh()
        for widget in self._drawing:
            basic.set_visible(widget, step.plane is not None)
        basic.set_visible(self._cut_slice, step.plane is None)

    def _follow(self) -> None:
        """Let the chosen row stay with its shape. The first one is chosen, and none in the place of one that goes."""
        before, self._listed = self._listed, {what: self._shapes(what) for what in ("cut", "part")}
        if self._chosen is not None:
            what, k = self._chosen
            place = track_index(before[what], self._listed[what], k)
            self._chosen = None if place is None else (what, place)
        elif len(rows := self._rows()) == 1 and not any(before.values()):
            self._chosen = rows[0]

    def _follow_editor(self, editor: Any) -> None:
        """Follow the choice in an editor, also that from before."""
        if editor in self._followed:
            return
        self._followed.append(editor)
        editor.observe(self._follow_choice, "chosen_shape")
        if chosen := editor.chosen_shape:
            self._choose(chosen["what"].removesuffix("s"), chosen["index"])

    def _follow_choice(self, change: Any) -> None:
        chosen = change["new"]
        if chosen and change["owner"] is self._editors.current:  # where it has none, the row stays
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
        what, k = self._get_chosen()
        shapes = list(self._shapes(what))
        label = f"{verb} {_name(what, k, shapes[k])}"
        shapes[k] = replace(shapes[k], **fields)
        self._edit(what, shapes, label)

    def _remove(self) -> None:
        what, k = self._get_chosen()
        shapes = list(self._shapes(what))
        label = f"remove {_name(what, k, shapes.pop(k))}"
        self._edit(what, shapes, label)

    def _get_chosen(self) -> tuple[str, int]:
        if self._chosen is None:
            raise DeformError("no cut or part is chosen; click on one in the list.")
        return self._chosen

    def _shapes(self, what: str) -> tuple[Any, ...]:
        step = self.session.editing.step
        return step.cuts if what == "cut" else step.parts

    def _edit(self, what: str, shapes: list[Any], label: str) -> None:
        if what == "cut":
            self.session.editing.change(label, cuts=shapes)
        else:
            edit_parts(self.session, self._editor, shapes, label)

    # -- more of them --------------------------------------------------------------------------------------------------

    def add_regions(self, what: str, regions: Sequence[tuple[str, AbstractRegion]]) -> None:
        """Make cuts or parts of regions with names, in one edit."""
        shapes, words = self._shapes(what), "cut" if what == "cut" else "rigid part"
        made = [Cut(region, name) if what == "cut" else RigidPart(region, name=name) for name, region in regions]
        names = ", ".join(name for name, _ in regions)
        self._edit(what, [*shapes, *made], f"add the {words}{'s' if len(made) > 1 else ''} {names}")
        self._choose(what, len(shapes))
        self._show_in_the_picture()
        self.refresh()

    def _show_in_the_picture(self) -> None:
        if self._chosen is not None:
            (what, index), editor = self._chosen, self._editors.current
            if index < len(getattr(editor, f"{what}s")):  # else another picture is still being made
                editor.choose(f"{what}s", index)

    def _fixed_side(self) -> HalfSpace:
        """All below a level near the lower edge of the picture; in space, all behind the large slice."""
        plane = self.session.editing.step.plane
        if plane is None:
            return self._behind_slice()
        flat = plane.to_plane(self.session.volume.grid.corners())[:, :2]
        low, high = flat.min(axis=0), flat.max(axis=0)
        return HalfSpace(((low[0] + high[0]) / 2, high[1] - _FIXED_AT * (high[1] - low[1])), (0.0, -1.0))

    def _behind_slice(self) -> HalfSpace:
        """All behind the large slice of a step in space, of the first one where none is large."""
        editor = self._editors.current
        return Pane.of(editor.volume.grid, list(PANES)[max(0, editor.large_slice)]).behind(editor.cursor)


def _name(what: str, k: int, shape: Any) -> str:
    return shape.name or f"{what} {k + 1}"


def _row(what: str, k: int, shape: Any) -> dict[str, Any]:
    facts = [what if what == "cut" else "rigid part", _KINDS.get(shape.region.kind, shape.region.kind)]
    more = _motion_words(shape) if what == "part" else _end_words(shape)
    return {
        "name": shape.name,
        "title": f"{what} {k + 1}",
        "on": shape.enabled,
        "id": what,
        "facts": [*facts, more],
        "swatch": _CUT_LOOK if what == "cut" else _PART_LOOK,
    }


def _end_words(cut: Cut) -> str:
    stops = cut.region.stops if isinstance(cut.region, Line) else (False, False)
    return next(text for text, ends in _ENDS.items() if ends == stops) if any(stops) else ""


def _motion_words(part: RigidPart) -> str:
    if part.motion is None:
        return "stays"
    degrees, _, shift = turn_and_shift(part.motion, pivot_of(part))
    words = [f"turned {degrees:.0f}\u00b0"] if abs(degrees) >= 0.5 else []
    if np.abs(shift).max() >= 0.05:
        words.append(f"shifted {', '.join(f'{round(s, 1) + 0.0:.1f}' for s in shift)}")
    return ", ".join(words) or "is moved"
