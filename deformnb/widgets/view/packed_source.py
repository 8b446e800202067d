"""The voxels of a live view as its front ends get them: packed, few enough, in the levels that the colours need."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from deformnb.errors import DeformError
from deformnb.volume.transfer import PresetName, TransferFunction, as_transfer
from deformnb.volume.volume import Volume
from deformnb.widgets.messages.views import Chunk, ChunkRequest
from deformnb.widgets.packed_volume import (
    PackedVolume,
    Pieces,
    fine_window,
    is_fine_enough,
    packed_volume,
    whole_window,
)
from deformnb.widgets.view.live_front_ends import Post

_LARGEST_TEXTURE = 2048  # along an axis of a texture, until a front end reports less


class PackedSource:
    """A volume, its colours, and its voxels in pieces that front ends request.

    Parameters
    ----------
    post : sends a message to the front ends.
    limit : voxels that are sent at most.
    transfer : a transfer function or the name of a preset, of the volume that comes first.

    Attributes
    ----------
    volume : as it was given, or None.
    wanted_transfer : a transfer function or the name of a preset; transfer : the colours that it means for the volume.
    sent_bytes : of voxels so far.

    Notes
    -----
    Not locked: :class:`~deformnb.widgets.LiveView` changes it while it holds its lock, and takes the content once.

    Examples
    --------
    >>> source = PackedSource(lambda message, buffers: None, limit=4, transfer="bone")
    >>> source.put(Volume.from_array(np.eye(3, dtype=np.uint8)[None]), None)
    >>> source.ready().volume.shape
    (1, 2, 2)
    """

    def __init__(self, post: Post, *, limit: int, transfer: TransferFunction | PresetName) -> None:
        self._post = post
        self._limit, self._largest = int(limit), _LARGEST_TEXTURE
        self.wanted_transfer = transfer
        self._window: tuple[float, float] | None = None
        self._pieces: Pieces | None = None
        self._after_upload: Callable[[], None] | None = None
        self.volume: Volume | None = None
        self.transfer: TransferFunction | None = None
        self.sent_bytes = 0

    @property
    def voxels(self) -> PackedVolume | None:
        """The packed voxels, None before the first volume."""
        pieces = self._pieces
        return None if pieces is None else pieces.volume

    def ready(self) -> PackedVolume:
        """The packed voxels; DeformError before the first volume."""
        voxels = self.voxels
        if voxels is None:
            raise DeformError("the view shows no volume yet; call show(volume) first.")
        return voxels

    def put(self, volume: Volume, window: tuple[float, float] | None, *, all_values: bool = False) -> None:
        """Pack another volume.

        Parameters
        ----------
        window : values that are resolved; None for those that the colours need.
        all_values : resolve all values independent of the colours, as a maximum projection shows them.
        """
        function = as_transfer(self.wanted_transfer, volume)
        values = whole_window(volume)
        narrow = None if all_values or window is not None else fine_window(function, volume, values)
        voxels = packed_volume(volume, self._limit, self._largest, narrow or window)
        if narrow is not None:
            voxels = replace(voxels, share=(narrow[1] - narrow[0]) / (values[1] - values[0]))
        self.volume, self._window, self._pieces = volume, window, Pieces(voxels)

    def needs_repacking(self, *, all_values: bool = False) -> bool:
        """Check whether the colours need other levels than the voxels have."""
        volume, voxels, function = self.volume, self.voxels, self.transfer
        if volume is None or voxels is None or function is None or self._window is not None:
            return False
        values = whole_window(volume)
        if all_values:
            return voxels.window != values
        return not is_fine_enough(function, volume, voxels.window, values)

    def restrict(self, largest: int, voxels: int) -> bool:
        """Take the limits of a GPU: voxels along an axis and in all. Returns whether the volume exceeds them."""
        if largest >= self._largest and voxels >= self._limit:
            return False
        self._largest, self._limit = min(largest, self._largest), min(voxels, self._limit)
        grid = None if self.voxels is None else self.voxels.volume.grid
        return grid is not None and (max(grid.shape) > largest or grid.size > voxels)

    def repack(self, *, all_values: bool = False) -> None:
        """Pack the same volume again, by the limits and the colours of now."""
        if self.volume is not None:
            self.put(self.volume, self._window, all_values=all_values)

    def set_transfer(self, transfer: TransferFunction | PresetName) -> tuple[TransferFunction, bytes] | None:
        """Take other colours.

        Returns
        -------
        tuple of TransferFunction and bytes, or None before the first volume
            The colours of this volume, and their table over the levels of the voxels, float32.
        """
        self.wanted_transfer = transfer
        if self.volume is None or self.voxels is None:
            return None
        function = self.transfer = as_transfer(self.wanted_transfer, self.volume)
        table = function.table(*self.voxels.window)  # alphas as they are: the front end fits them
        return function, np.ascontiguousarray(table, "<f4").tobytes()

    def send(self, message: ChunkRequest) -> None:
        """Send a front end the piece that it requests, if it is one of the present volume."""
        pieces = self._pieces  # taken once: a cell may show another volume meanwhile
        if pieces is None or message.id != pieces.volume.id:
            return  # of a volume that was shown before: the front end will notice
        index = message.index
        if index >= pieces.volume.chunks:
            raise DeformError(f"the pieces of the volume are between 0 and {pieces.volume.chunks - 1}, not {index}.")
        start, packed = pieces[index]
        self.sent_bytes += len(packed)
        self._post(Chunk(view=message.view, id=pieces.volume.id, index=index, start=start), [packed])
        if index == pieces.volume.chunks - 1:
            self.finish_upload()

    def call_after_upload(self, function: Callable[[], None]) -> None:
        """Call a function once when a front end has been sent all voxels, or when Python draws for one.

        A thread that imports modules or compiles delays the pieces of the volume.
        """
        self._after_upload = function

    def finish_upload(self) -> None:
        """Call what waits until a front end has all voxels."""
        function, self._after_upload = self._after_upload, None
        if function is not None:
            function()
