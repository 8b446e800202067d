"""A deformation applied to a file of channels, colours or moments in time, from file to file, moment by moment."""

from __future__ import annotations

import os
from collections.abc import Iterator
from itertools import islice
from typing import Any

from deformnb._typing import Progress
from deformnb.document.animation import Animation
from deformnb.errors import DeformError
from deformnb.io.files.memory import check_room
from deformnb.io.volumes.series import Series, open_series, write_series
from deformnb.rbf.fields import AbstractField, HasField
from deformnb.volume.channels import Channels
from deformnb.warping.warper import deform_volumes

# Moments that one evaluation of the map moves together: as many as fit into this, and one at least.
_TOGETHER_BYTES = 2**27


def warp_series(
    source: Series | str | os.PathLike[str],
    field: AbstractField | HasField | Animation,
    target: str | os.PathLike[str],
    *,
    overwrite: bool = False,
    progress: Progress | None = None,
    **options: Any,
) -> None:
    """Deform every channel at every moment of a file, and write them to another file.

    Parameters
    ----------
    source : the file, or the series that :func:`deformnb.io.open_series` has opened.
    field : the map of all moments, a field in space or a Deformation; or an Animation, whose duration is stretched to
        that of the series: the first moment has its beginning, the last one its end.
    target : file to write, see :func:`deformnb.io.write_series`.
    overwrite : whether an existing file may be replaced.
    progress : called with the finished share from 0 to 1; may raise Cancelled.
    options : ``output``, ``fill``, ``method`` and ``step`` of :func:`deformnb.warp`.

    Raises
    ------
    VolumeFileError
        If a file cannot be read or written, or the target's format cannot hold the content of the source.
    DeformError
        As :func:`deformnb.warp`.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import numpy as np
    >>> from deformnb.rbf.fields import Affine
    >>> from deformnb.io import read_channels, write_channels
    >>> folder = Path(tempfile.mkdtemp())
    >>> photo = np.zeros((3, 4, 3), np.uint8)
    >>> photo[1, 2] = (200, 100, 50)
    >>> write_channels(Channels.from_array(photo, kind="rgb"), folder / "photo.png")
    >>> warp_series(folder / "photo.png", Affine(np.eye(3), np.array([1.0, 0, 0])), folder / "moved.png")
    >>> read_channels(folder / "moved.png").values[0, 1, 1].tolist()
    [200, 100, 50]
    """
    series = source if isinstance(source, Series) else open_series(source)
    output = options.get("output") or getattr(field, "output", None) or series.grid
    moved = _warp_moments(series, field, output, options)
    write_series(moved, target, len(series), duration=series.layout.duration, overwrite=overwrite, progress=progress)


def _warp_moments(series: Series, field: Any, output: Any, options: dict[str, Any]) -> Iterator[Channels]:
    count, moments = len(series), iter(series)
    together = 1
    if not isinstance(field, Animation):
        size = max(series.grid.size, getattr(output, "grid", output).size) * series.layout.channels
        together = max(1, _TOGETHER_BYTES // (2 * size * series.dtype.itemsize))
    number = 0
    while group := list(islice(moments, together)):
        check_room(group[0][0], getattr(output, "grid", output))
        of_now = field.at(field.duration * number / max(1, count - 1)) if isinstance(field, Animation) else field
        volumes = [volume for channels in group for volume in channels]
        done = iter(deform_volumes(volumes, of_now, **options))
        for channels in group:
            yield channels.with_volumes(list(islice(done, len(channels))))
        number += len(group)
    if number != count:
        raise DeformError(f"{series.path.name} ended after {number} of {count} moments.")
