"""Sender of the displacements of a live view to its front ends: the newest, as often as they confirm."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

import numpy as np
from msgspec import structs

from deformnb.document.animation import TimeMaps
from deformnb.rbf.fields import AbstractField
from deformnb.volume.plane import Raster
from deformnb.volume.volume import Grid
from deformnb.widgets.messages.points import points_to_json
from deformnb.widgets.messages.record import Seen
from deformnb.widgets.messages.views import FieldMaps, FollowData, MovedData
from deformnb.widgets.packed_volume import PackedVolume
from deformnb.widgets.textures import MAP_SIZE, FieldTextures, field_textures, nodes_along
from deformnb.widgets.view.live_front_ends import Post
from deformnb.widgets.view.space_points import QUICK_SIZE, plain_fit
from deformnb.widgets.view.transport import Pacer


@dataclass(frozen=True, eq=False)
class ShownField:
    """The deformation of a view.

    Parameters
    ----------
    field : backward displacements in space, None for the volume as it is.
    output : the grid whose box is seen, None for the volume's own.
    followed : state of the editor that moves one of its maps, of :func:`~deformnb.widgets.view.base.followed_state`.
    moments : of an animation that a player goes through instead of the field.
    is_quick : in motion, so that a coarser one will do.
    points_editor : the editor of points in space over the view.
    """

    field: AbstractField | None = None
    output: Grid | None = None
    followed: FollowData | None = None
    moments: TimeMaps | None = None
    is_quick: bool = False
    points_editor: Any = None

    def at(self, player: Any) -> AbstractField | None:
        """The field that is seen: the moment of the player, if it plays an animation."""
        return self.field if self.moments is None else self.moments.field(player.time)


class FieldSender:
    """Sends a view's field, as textures, to its front ends.

    Parameters
    ----------
    packed : returns the voxels that are shown, or None.
    post : sends a message to the front ends.
    lock : held while textures are made: the content does not change meanwhile.
    map_size : samples of a displacement map along its longer side.
    space_size : samples along the longest side of a displacement that is no extrusion.

    Attributes
    ----------
    shown : the content to send.
    pacer : when it is sent.
    sent_bytes : of fields so far.

    Examples
    --------
    >>> import threading
    >>> sent = []
    >>> sender = FieldSender(lambda: None, lambda *message: sent.append(message), threading.RLock())
    >>> sender.replace(ShownField())
    >>> sender.offer()
    >>> sent  # no front end has come
    []
    """

    def __init__(
        self,
        packed: Callable[[], PackedVolume | None],
        post: Post,
        lock: AbstractContextManager[Any],
        *,
        map_size: int = MAP_SIZE,
        space_size: int = 64,
    ) -> None:
        self._packed, self._post, self._lock = packed, post, lock
        self.map_size, self.space_size = int(map_size), int(space_size)
        self.shown = ShownField()
        self._maps: FieldTextures | None = None  # of the field, made when a front end requests them
        self._moved: MovedData | None = None  # the points of which front ends make the field while they move
        self._sent_cut: str | None = None  # whose distances all front ends have
        self._has_front_end = False
        self.pacer = Pacer(self._send)
        self.sent_bytes = 0

    def replace(self, shown: ShownField) -> None:
        """Take another field, without sending it: a front end may have made it itself."""
        with self._lock:
            self.shown, self._maps, self._moved = shown, None, None

    def offer(self) -> None:
        """Send the field as soon as the front ends have seen the one before; one that comes later requests it."""
        if self._has_front_end:
            self.pacer.offer()

    def answer(self, view: str | None) -> None:
        """Send the field to a front end that has come, or (None) to all."""
        self._has_front_end = True
        self._send(0, view)

    def confirm(self, message: Seen) -> None:
        """Take a front end's confirmation that it draws a field."""
        self.pacer.confirm(message.seq)

    @property
    def moves_points(self) -> bool:
        """True if front ends make the field of moving points themselves."""
        return self._moved is not None

    def textures(self, field: AbstractField | None, output: Grid | None) -> FieldTextures:
        """Any field in the box of a grid, as it would be sent."""
        shown = self._packed()
        assert shown is not None
        return field_textures(field, shown, output, self.map_size, self.space_size)

    def _send(self, number: int, view: str | None = None) -> None:
        with self._lock:
            packed, followed = self._packed(), self.shown.followed
            if packed is None:
                return
            maps = self._maps = self._maps or self._make_textures(packed)
        cut = maps.content.planar and maps.content.planar["cut"]
        if number and cut and cut["id"] == self._sent_cut:
            maps = maps.without("distances")
        elif view is None:
            self._sent_cut = cut and cut["id"]
        self.sent_bytes += maps.size
        message = FieldMaps(view=view, seq=number, follow=followed, moved=self._moved, **maps.fields())
        self._post(message, maps.buffers)

    def _make_textures(self, packed: PackedVolume) -> FieldTextures:
        shown = self.shown
        if shown.moments is not None:
            return _texture_frames(shown.moments, packed, shown.output, self.map_size)
        quick = min(QUICK_SIZE, self.space_size)
        made = field_textures(
            shown.field, packed, shown.output, self.map_size, quick if shown.is_quick else self.space_size
        )
        points = None if shown.is_quick else plain_fit(shown.field, shown.points_editor)
        if points is not None:
            lattice = made.content.space
            assert lattice is not None
            size = (np.asarray(lattice["shape"]) - 1) * lattice["spacing"]
            self._moved = {"points": points_to_json(points), "shape": nodes_along(size, quick).tolist()}
        return made


def _texture_frames(maps: TimeMaps, shown: PackedVolume, output: Grid | None, map_size: int) -> FieldTextures:
    """Textures of one moment, as of :func:`~deformnb.widgets.textures.field_textures`, with the maps of all.

    Parameters
    ----------
    map_size : samples of a map along its longer side.
    """
    first = field_textures(maps.field(0.0), shown, output, map_size, map_size)
    planar = first.content.planar
    assert planar is not None
    (_, rows, columns), (da, db), (a, b) = planar["shape"], planar["spacing"], planar["origin"]
    raster = Raster((rows, columns), (da, db), (a, b))
    frames = np.stack([np.moveaxis(maps.at(t).sample_on_raster(raster), 0, -1) for t in maps.times.tolist()])
    return FieldTextures(
        structs.replace(first.content, frames={"count": len(maps), "duration": maps.duration}),
        [np.ascontiguousarray(frames, "<f4").tobytes(), first.buffers[1]],
    )
