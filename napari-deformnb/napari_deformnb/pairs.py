"""Pairs of points as two layers of napari that have the same points in the same order, and the lines between them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal, TypeAlias

import numpy as np
from napari.layers import Points, Vectors
from napari.layers.base import ActionType
from numpy.typing import NDArray

from deformnb import ControlPoints, Plane
from napari_deformnb import drawing
from napari_deformnb.subject import Subject

Side: TypeAlias = Literal["source", "target"]
"""The two places of a pair."""

SIDES: tuple[Side, ...] = ("source", "target")
"""Both, in the order of their layers."""

COLOURS = {"source": "#ff9d2e", "target": "#37d0ff", "lines": "#ffffff"}
"""Colours of the layers: those of the package's editors on a dark picture."""

_DONE = (ActionType.ADDED, ActionType.REMOVED, ActionType.CHANGED)
_NEW = -1  # the id of a point that a layer has and the set not yet
_SHARE = 40  # of the longest side of the picture, which is one point in size


class PairLayers:
    """The layers "source" and "target" of one set of control points, and a layer of lines from one to the other.

    Parameters
    ----------
    viewer : to which they are added.
    subject : the layer that is deformed, at whose place they are.
    name : in front of the names of the layers.
    on_edit : called with a side after its layer was edited: a point moved, added, removed.
    on_move : called with a side while its points are dragged.
    """

    def __init__(
        self, viewer: Any, subject: Subject, name: str, on_edit: Callable[[Side], None], on_move: Callable[[Side], None]
    ) -> None:
        self.subject, self.depth = subject, 0.0
        self._on_edit, self._on_move = on_edit, on_move
        self._is_writing = False
        place, longest = subject.place(), max(subject.grid.shape[3 - subject.ndim :])
        size = max(1.0, longest / _SHARE)
        self.lines = Vectors(
            np.zeros((0, 2, subject.ndim)),
            name=f"{name}: drags",
            edge_color=COLOURS["lines"],
            edge_width=size / 6,
            vector_style="arrow",
            **place,
        )
        self.sides: dict[Side, Points] = {
            side: Points(
                np.zeros((0, subject.ndim)),
                name=f"{name}: {side}s",
                features={"pair": np.zeros(0, int), "name": np.zeros(0, dtype=object)},
                feature_defaults={"pair": _NEW, "name": ""},
                face_color="transparent" if side == "source" else COLOURS[side],
                border_color=COLOURS[side],
                border_width=0.15,
                symbol="disc" if side == "target" else "ring",
                size=size,
                **place,
            )
            for side in SIDES
        }
        self._last = {side: layer.data.copy() for side, layer in self.sides.items()}
        for layer in self.layers:
            viewer.add_layer(layer)
        for side, layer in self.sides.items():
            layer.events.data.connect(lambda event, side=side: self._data_event(side, event))
            layer.events.set_data.connect(lambda _event, side=side: self._refresh_event(side))

    @property
    def layers(self) -> tuple[Any, ...]:
        """All layers, from the lowest to the highest."""
        return (self.lines, *self.sides.values())

    def write(self, points: ControlPoints, plane: Plane | None) -> None:
        """Show a set of control points; what is shown already stays as it is, with its selection."""
        self._is_writing = True
        try:
            for side, layer in self.sides.items():
                places = drawing.to_layer(self.subject, plane, getattr(points, side), self.depth)
                same = layer.data.shape == places.shape and np.allclose(layer.data, places, rtol=0, atol=1e-9)
                if not same:
                    chosen = {k for k in layer.selected_data if k < len(places)}
                    layer.data = places
                    layer.selected_data = chosen
                ids, names = layer.features["pair"].tolist(), layer.features["name"].tolist()
                if ids != list(points.ids) or names != list(points.names):
                    layer.features = {"pair": np.array(points.ids, int), "name": np.array(points.names, object)}
                layer.feature_defaults = {"pair": _NEW, "name": ""}
                self._last[side] = layer.data.copy()
            self.draw_lines()
        finally:
            self._is_writing = False

    def draw_lines(self) -> None:
        """Draw the lines anew, from the sources to the targets as the layers have them."""
        source, target = (self.sides[side].data for side in SIDES)
        if len(source) == len(target):
            self.lines.data = np.stack([source, target - source], axis=1)

    def set_depth(self, depth: float, points: ControlPoints, plane: Plane | None) -> None:
        """Show points of a plane on another slice: what is drawn on one holds for all."""
        if depth != self.depth:
            self.depth = depth
            self.write(points, plane)

    def read(self, points: ControlPoints, plane: Plane | None, side: Side) -> tuple[ControlPoints, list[int]]:
        """The set of control points after an edit of one layer.

        Parameters
        ----------
        points : before it.
        plane : of the points.
        side : of the layer.

        Returns
        -------
        The points that are left, at their places in the layer, and the rows of the layer that are new.
        """
        layer = self.sides[side]
        places = drawing.from_layer(self.subject, plane, layer.data)
        before = drawing.to_layer(self.subject, plane, getattr(points, side), self.depth)
        ids, rows, new = layer.features["pair"].tolist(), dict[int, int](), list[int]()
        for row, number in enumerate(ids):
            if number in points.ids and number not in rows:
                rows[int(number)] = row
            else:
                new.append(row)
        left = points.remove(*(number for number in points.ids if number not in rows))
        kept = [points.index(number) for number in left.ids]
        moved = getattr(left, side).copy()
        for k, number in enumerate(left.ids):
            row = rows[number]
            if not np.array_equal(layer.data[row], before[kept[k]]):  # else the place is the very one of the set
                moved[k] = places[row]
        places_of: dict[str, Any] = {side: np.where(left.locked[:, None], getattr(left, side), moved)}
        return replace(left, **places_of), new

    def places(self, plane: Plane | None, side: Side) -> NDArray[np.float64]:
        """Coordinates of control points of one layer as it is now."""
        return drawing.from_layer(self.subject, plane, self.sides[side].data)

    def _data_event(self, side: Side, event: Any) -> None:
        if not self._is_writing and getattr(event, "action", None) in _DONE:
            self._last[side] = self.sides[side].data.copy()
            self._on_edit(side)

    def _refresh_event(self, side: Side) -> None:
        """A refresh of a layer: napari moves the points of a drag without an event of its own."""
        layer = self.sides[side]
        if self._is_writing or layer.data.shape != self._last[side].shape:
            return  # points that come or go have an event
        if not np.array_equal(layer.data, self._last[side]):
            self._last[side] = layer.data.copy()
            self.draw_lines()
            self._on_move(side)
