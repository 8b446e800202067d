"""How one rigid part moves, and how far it is felt: menus and sliders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import ipywidgets as ipw
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from deformnb.masks import Mask
from deformnb.regions import AbstractRegion, HalfSpace
from deformnb.rigid_motion import RigidMotion
from deformnb.rigid_parts import RigidPart
from deformnb.session import Session
from deformnb.volume import Grid
from deformnb.widgets.controls import Guard, Panel, menu, row, slider

_STATES = {"fixed": "stays where it is", "moved": "is moved"}
_WEIGHTS = {"saturated": "smooth step", "distance": "distance (the paper's)"}
_AXES = np.eye(3)


@lru_cache(maxsize=32)
def middle_of(region: AbstractRegion) -> tuple[float, ...]:
    """The place about which a part is turned: the middle of its matter, or the place on the boundary of a half space.

    Examples
    --------
    >>> from deformnb.regions import Polygon
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
    vector = Rotation.from_matrix(matrix).as_rotvec(degrees=True)
    axis = int(np.abs(vector).argmax()) if vector.any() else 2
    degrees = float(np.copysign(np.linalg.norm(vector), vector[axis]))
    return degrees, axis, motion([middle])[0] - np.asarray(middle)


class PartControls(Panel):
    """What the rigid part that is chosen does.

    Parameters
    ----------
    index : tells which part of the step is chosen, None for none.
    """

    def __init__(self, session: Session, guard: Guard, index: Any) -> None:
        super().__init__(session, guard)
        self._index = index
        reach = 0.5 * session.volume.grid.diagonal
        self._axis = 2
        state = self.add(menu("Part", [(text, name) for name, text in _STATES.items()],
                              "A part that is moved turns and shifts as a whole; what is around it bends"),
                         lambda: "fixed" if self.part is None or self.part.motion is None else "moved", self._set_state)
        weight = self.add(menu("Felt by", [(text, name) for name, text in _WEIGHTS.items()],
                               "How the deformation fades towards the part"),
                          lambda: "saturated" if self.part is None else self.part.weight,
                          lambda value: self._write("change the weight of", weight=value))
        self._pivots: dict[AbstractRegion, tuple[float, ...]] = {}  # chosen by hand; else the middle
        self._angle = self._slider("Turn", 180.0, "Degrees about the pivot", "turn", ".1f")
        self._axes = self.add(menu("About", [("x (left)", "0"), ("y (back)", "1"), ("z (up)", "2")],
                                   "Axis of the turn"), lambda: str(self._of_motion()[1]), self._set_axis)
        names = (("Right", "Down"), ("x", "y", "z"))
        self._shifts = [[self._slider(f"Shift {name.lower()}", reach, f"Length along {name.lower()}", k, ".1f")
                         for k, name in enumerate(group)] for group in names]
        self._places = [[self._number(f"Pivot {name.lower()}", k) for k, name in enumerate(group)] for group in names]
        self._reach = self.add(slider("Reach", 0.0, reach, reach / 200, "Distance at which the part is no longer felt; "
                                      "0 leaves that to the nearest control point", ".1f"),
                               lambda: min((self.part and self.part.reach) or 0.0, reach),
                               lambda value: self._write("change the reach of", "reach", reach=value or None))
        of_plane, of_space = ([*self._shifts[k], *self._places[k]] for k in (0, 1))
        self._moving = [self._angle, self._axes, *of_plane, *of_space]
        self.box = ipw.VBox([row(state, weight, self._reach), row(*self._moving)])
        self.refresh()

    def _slider(self, text: str, most: float, tip: str, what: str | int, form: str) -> Any:
        step = float(10.0 ** np.floor(np.log10(most / 500)))  # a round one, so that what is typed stays as it is
        most = step * float(np.ceil(most / step))
        made = slider(text, -most, most, step, tip, form)
        if isinstance(what, str):
            return self.add(made, lambda: float(np.clip(self._of_motion()[0], -most, most)),
                            lambda value: self._move("turn", degrees=value))
        return self.add(made, lambda: self._shift(what, most), lambda value: self._move("shift", shift=(what, value)))

    def _number(self, text: str, k: int) -> Any:
        made = ipw.FloatText(description=text, step=1.0, layout=ipw.Layout(width="180px"), continuous_update=False,
                             style={"description_width": "80px"}, tooltip="The place that a turn leaves where it is")
        return self.add(made, lambda: self._pivot(k), lambda value: self._set_pivot(k, value))

    def _pivot(self, k: int) -> float:
        about = self._about()
        return round(about[k], 3) if k < len(about) else 0.0

    def _about(self) -> tuple[float, ...]:
        """The pivot of the part that is chosen."""
        region = None if self.part is None else self.part.region
        return () if region is None else self._pivots.get(region) or middle_of(region)

    def _set_pivot(self, k: int, value: float) -> None:
        part, about = self.part, list(self._about())
        if part is None or k >= len(about) or not np.isfinite(value):
            return
        degrees, _, shift = self._of_motion()
        about[k] = float(value)
        self._pivots[part.region] = tuple(about)
        self._move("turn", degrees=degrees, to=shift)

    @property
    def part(self) -> RigidPart | None:
        """The part that is chosen."""
        index, parts = self._index(), self.session.step.parts
        return parts[index] if index is not None and index < len(parts) else None

    def _of_motion(self) -> tuple[float, int, NDArray[np.float64]]:
        part = self.part
        if part is None:
            return 0.0, self._axis, np.zeros(3)
        degrees, axis, shift = turn_and_shift(part.motion, self._about())
        return degrees, axis if degrees else self._axis, shift

    def _shift(self, k: int, most: float) -> float:
        shift = self._of_motion()[2]
        return float(np.clip(shift[k], -most, most)) if k < len(shift) else 0.0

    def _set_state(self, state: str) -> None:
        if self.part is not None:
            middle = self._about()
            still = RigidMotion.turn(0.0, middle, axis=_AXES[self._axis] if len(middle) == 3 else None)
            self._write("move" if state == "moved" else "fix", motion=still if state == "moved" else None)

    def _set_axis(self, value: str) -> None:
        self._axis = int(value)
        self._move("turn", axis=self._axis)

    def _move(self, verb: str, degrees: float | None = None, axis: int | None = None,
              shift: tuple[int, float] | None = None, to: NDArray[np.float64] | None = None) -> None:
        if self.part is None:
            return
        middle = self._about()
        old_degrees, old_axis, new_shift = self._of_motion()
        if to is not None:  # the shift of before, which the new pivot would read otherwise
            new_shift = to
        if shift is not None:
            new_shift[shift[0]] = shift[1]
        about = _AXES[old_axis if axis is None else axis] if len(middle) == 3 else None
        motion = RigidMotion.turn(old_degrees if degrees is None else degrees, middle, new_shift, about)
        slider = f"shift {shift[0]}" if shift else "turn" if degrees is not None and to is None else None
        self._write(verb, slider, motion=motion)

    def _write(self, verb: str, kind: str | None = None, **fields: Any) -> None:
        index, parts = self._index(), list(self.session.step.parts)
        if index is None or index >= len(parts):
            return
        parts[index] = replace(parts[index], **fields)
        name = parts[index].name or f"part {index + 1}"
        self.session.edit_parts(parts, f"{verb} {name}", f"{kind} {index}" if kind else None,
                                slides=kind is not None)

    def arrange(self) -> None:
        part = self.part
        is_moved = part is not None and part.motion is not None
        in_space = part is not None and part.region.dim == 3
        for widget in self._moving:
            of_space = widget is self._axes or widget in (*self._shifts[1], *self._places[1])
            of_plane = widget in (*self._shifts[0], *self._places[0])
            shown = is_moved and (in_space or not of_space) and not (in_space and of_plane)
            widget.layout.display = "" if shown else "none"
