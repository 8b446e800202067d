"""Files of several volumes on one grid: channels, colours, and moments in time, read and written moment by moment.

Never more than one moment is in memory, so that a long series needs no more room than a volume of as many channels.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Progress, Spacing
from deformnb.checks import short_value
from deformnb.errors import DeformError
from deformnb.io.files.atomic import atomic_write, check_target
from deformnb.io.files.errors import Damage, fail, human_bytes
from deformnb.io.files.memory import default_limit
from deformnb.io.files.objects import copied_from_disk, copied_to_disk, is_open_file, name_for
from deformnb.io.files.paths import as_path
from deformnb.io.files.streams import compress
from deformnb.io.volumes import images, metaimage, nifti, nrrd, ome_zarr, tiff
from deformnb.io.volumes.formats import (
    existing_path,
    find_format,
    plain_name,
    read_any_header,
    replace_unit,
    write_volume,
)
from deformnb.io.volumes.headers import MOST_MOMENTS, Header, Layout
from deformnb.io.volumes.voxels import stored_dtype
from deformnb.volume.channels import Channels, ChannelsLike, as_channels, usual_names
from deformnb.volume.units import check_unit
from deformnb.volume.volume import Grid, Volume, as_spacing

_HEADERS: dict[str, Callable[[Path, Volume, Layout], bytes]] = {
    "nifti": nifti.series_header,
    "nrrd": nrrd.series_header,
    "metaimage": metaimage.series_header,
}
_INTERLEAVED = {"nrrd", "metaimage"}  # channels of NIfTI are volumes one after the other, its colours are not


@dataclass(frozen=True, eq=False)
class Series:
    """A file of channels and moments that is open for reading: iterate over it to get the Channels of each moment.

    Parameters
    ----------
    path : of the file.
    grid : of every channel at every moment.
    layout : number of moments, number and names of channels, time between moments.
    dtype : of the voxels once read.
    name : of the file without its suffix.
    notes : remarks on the file.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> file = Path(tempfile.mkdtemp()) / "two.nrrd"
    >>> write_channels(Channels.from_array(np.zeros((2, 3, 4, 2), np.uint8)), file)
    >>> open_series(file).layout.channels
    2
    """

    path: Path
    grid: Grid
    layout: Layout
    dtype: np.dtype[Any]
    name: str
    notes: tuple[str, ...]
    _header: Header
    _is_labels: bool

    def __repr__(self) -> str:
        nz, ny, nx = self.grid.shape
        return f"<Series {self.name[:60]!r}: {self.layout}; {nx} x {ny} x {nz} voxels (x, y, z), {self.dtype.name}>"

    def __len__(self) -> int:
        return self.layout.frames

    def __iter__(self) -> Iterator[Channels]:
        kind: Any = self.layout.kind
        names = self.layout.names or (
            usual_names(self.layout.channels, kind) if self.layout.channels > 1 else (self.name,)
        )
        with Damage(self.path, "close other programs"):
            for stack in _stacks(self._header):
                volumes = tuple(
                    Volume(values, self.grid, name, self._is_labels) for name, values in zip(names, stack, strict=True)
                )
                yield Channels(volumes, self.layout.colours, kind, self.name)


def open_series(
    path: str | os.PathLike[str],
    *,
    spacing: Spacing | None = None,
    is_labels: bool | None = None,
    max_bytes: int | None = None,
    unit: str | None = None,
) -> Series:
    """Open a file of channels, colours or moments in time; only its header is read.

    Parameters
    ----------
    path : NIfTI, NRRD or MetaImage with several channels (vectors, RGB, RGBA) or a fourth axis, or a picture; a file of
        one volume is a series of one.
    spacing : (x, y, z) instead of the file's.
    is_labels : voxels are names of regions; by default as in the file.
    max_bytes : refuse a file one moment of which takes more memory; by default 60 % of the free memory.
    unit : of the lengths, instead of the file's.

    Raises
    ------
    VolumeFileError
        If the file is missing, damaged or none, or one moment of it needs more memory than there is.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "beating.nrrd"
    >>> moments = [Channels((Volume.from_array(np.eye(3) * k, name="heart"),)) for k in range(4)]
    >>> write_series(moments, path, 4)
    >>> [float(channels[0].values.max()) for channels in open_series(path)]
    [0.0, 1.0, 2.0, 3.0]
    """
    place = existing_path(path)
    with Damage(place, "close other programs"):
        kind, header = read_any_header(place)
        if kind == "image":
            header = images.read_colour_header(place)
        header = header if unit is None else replace_unit(header, check_unit(unit))
        grid, notes = header.grid(None if spacing is None else as_spacing(spacing))
        dtype = _storable_type(header)
        needed = grid.size * dtype.itemsize * header.layout.channels + header.working_bytes
        limit = default_limit() if max_bytes is None else max_bytes
        if needed > limit:
            whose = "60 % of the free memory" if max_bytes is None else "max_bytes"
            raise fail(
                place,
                f"one moment of it needs {human_bytes(needed)} of memory but the limit is "
                f"{human_bytes(limit)} ({whose}).",
            )
    labels = bool(header.is_labels if is_labels is None else is_labels)
    return Series(place, grid, header.layout, dtype, plain_name(place, kind), header.notes + notes, header, labels)


def read_channels(
    path: str | os.PathLike[str] | BinaryIO,
    *,
    frame: int = 0,
    spacing: Spacing | None = None,
    suffix: str | None = None,
) -> Channels:
    """The channels of a file at one moment; a picture in its colours.

    Parameters
    ----------
    path, spacing : as in :func:`open_series`; or an open file of bytes.
    frame : the moment, counted from 0.
    suffix : of an open file, by which its format is known (".nrrd"); by default that of its name.

    Raises
    ------
    DeformError
        If there is no such moment.
    VolumeFileError
        As :func:`open_series`.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "photo.png"
    >>> write_channels(Channels.from_array(np.full((4, 5, 3), 200, np.uint8), kind="rgb"), path)
    >>> read_channels(path)
    <Channels: red, green, blue; 5 x 4 x 1 voxels (x, y, z), uint8>
    """
    if is_open_file(path):
        with copied_to_disk(path, name_for(path, suffix)) as copy:
            return read_channels(copy, frame=frame, spacing=spacing)
    series = open_series(cast("str", path), spacing=spacing)
    if not isinstance(frame, int) or not 0 <= frame < len(series):
        raise DeformError(f"{series.path.name} has {len(series)} moments, counted from 0, and no moment {frame}.")
    for number, channels in enumerate(series):
        if number == frame:
            return channels
    raise AssertionError("a series ends early only with an error")


def write_channels(
    channels: ChannelsLike,
    path: str | os.PathLike[str] | BinaryIO,
    *,
    overwrite: bool = True,
    progress: Progress | None = None,
    suffix: str | None = None,
) -> None:
    """Write channels to one file: .nrrd, .nii.gz, .nii, .mha, .ome.tif, or colours of one slice to .png, .jpg or .webp.

    Parameters
    ----------
    path : of the file, or an open file.
    overwrite : whether an existing file may be replaced.
    progress : receives the share done, 0 to 1; may raise Cancelled.
    suffix : of an open file, by which its format is known (".nrrd"); by default that of its name.

    Raises
    ------
    VolumeFileError
        If the format cannot hold them, or the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> file = Path(tempfile.mkdtemp()) / "colours.png"
    >>> write_channels(Channels.from_array(np.zeros((1, 3, 4, 3), np.uint8), kind="rgb"), file)
    >>> file.is_file()
    True
    """
    if is_open_file(path):
        with copied_from_disk(path, name_for(path, suffix)) as copy:
            write_channels(channels, copy, progress=progress)
        return
    write_series([as_channels(channels)], cast("str", path), 1, overwrite=overwrite, progress=progress)


def write_series(
    moments: Iterable[ChannelsLike],
    path: str | os.PathLike[str],
    count: int,
    *,
    duration: float = 0.0,
    overwrite: bool = True,
    progress: Progress | None = None,
) -> None:
    """Write moments to one file, each as it comes; the file is written atomically.

    Parameters
    ----------
    moments : the channels of each, equal in grid, type and number.
    path : ends in .nrrd, .nii.gz, .nii, .mha or .ome.tif; for one moment of colours in one slice also .png, .jpg or
        .webp; for one moment of one channel in any suffix of :data:`FORMATS` that is written.
    count : number of moments, which the header states before they are there.
    duration : from one moment to the next, for the header.
    overwrite : whether an existing file may be replaced.
    progress : receives the share done, 0 to 1; may raise Cancelled.

    Raises
    ------
    VolumeFileError
        If the format cannot hold them, or the file cannot be written.
    DeformError
        If the moments differ, or are not as many as stated.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> file = Path(tempfile.mkdtemp()) / "moments.nrrd"
    >>> moment = Channels.from_array(np.zeros((2, 3, 4, 1), np.uint8))
    >>> write_series([moment, moment], file, 2)
    >>> is_series(file)
    True
    """
    target = as_path(path)
    kind, entry = find_format(target, writing=True)
    check_target(target, overwrite=overwrite)
    if isinstance(moments, Volume | Channels | str | os.PathLike) or not isinstance(moments, Iterable):
        raise DeformError(f"moments are a list of channels, got {short_value(moments)}; write_channels writes one.")

    def convert_unit(moment: ChannelsLike) -> Channels:
        channels = as_channels(moment)
        return channels.to_unit(entry.written_unit(channels.grid.unit))

    queue: Iterator[Channels] = map(convert_unit, moments)
    first = next(queue, None)
    if isinstance(count, bool) or not isinstance(count, int | np.integer) or not 1 <= count <= MOST_MOMENTS:
        raise DeformError(
            f"count is the number of moments, a whole number from 1 to {MOST_MOMENTS}, got {short_value(count)}."
        )
    if first is None:
        raise DeformError("there is no moment to write.")
    if count == 1 and (len(first) == 1 or kind == "image"):
        _refuse_more(queue, count)
        if len(first) == 1:
            write_volume(first[0], target, overwrite=overwrite, progress=progress)
        else:
            if first.kind == "channels":
                raise fail(
                    target,
                    f"a picture has the parts of a colour, and these are {len(first)} channels of "
                    "another kind; write .nrrd, .nii.gz, .mha or .ome.tif.",
                )
            images.write_colours(first, target, overwrite)
        return
    if kind == "tiff":
        _write_tiff(
            _chain_items([first], queue),
            target,
            first,
            Layout(count, len(first), first.kind, first.names, first.colours, duration=duration),
            overwrite,
            progress,
        )
        return
    if kind not in _HEADERS or target.suffix.lower() in (".nhdr", ".mhd"):
        raise fail(target, "several channels or moments are written to .nrrd, .nii.gz, .nii, .mha or .ome.tif.")
    layout = Layout(count, len(first), first.kind, first.names, first.colours, duration=duration)
    header = _HEADERS[kind](target, first[0], layout)
    encoding = "gzip" if target.name.lower().endswith((".nrrd", ".gz")) else "raw"
    interleaved = len(first) > 1 and (kind in _INTERLEAVED or first.kind != "channels")
    size = first.grid.size * stored_dtype(first[0]).itemsize * len(first) * count
    queue = _chain_items([first], queue)
    del first
    with atomic_write(target, overwrite=overwrite, needed=size if encoding == "raw" else size // 4) as file:
        pieces = _pieces(queue, count, interleaved, progress)
        if kind == "nrrd":
            file.write(header)
        else:
            pieces = _prepend_header(header, pieces)
        for piece in compress(pieces, encoding):
            file.write(piece)


def _write_tiff(
    queue: Iterator[Channels], target: Path, first: Channels, layout: Layout, overwrite: bool, progress: Progress | None
) -> None:
    """Write moments as the pages of an OME-TIFF file; their colours are together in a page."""
    is_colour = layout.kind != "channels"
    dtype, (_, ny, nx) = stored_dtype(first[0]), first.grid.shape
    page = (ny, nx, len(first)) if is_colour else (ny, nx)

    def pages() -> Iterator[NDArray[Any]]:
        for piece in _pieces(queue, layout.frames, is_colour, progress):
            yield from np.frombuffer(piece, dtype).reshape(-1, *page)

    like = replace(first[0], name=first.name)
    tiff.write_pages(pages(), target, like, layout, overwrite=overwrite)


def _prepend_header(header: bytes, pieces: Iterator[memoryview]) -> Iterator[memoryview]:
    yield memoryview(header)
    yield from pieces


def _chain_items(taken: list[Channels], queue: Iterator[Channels]) -> Iterator[Channels]:
    """Yield the items taken and then the rest; ``itertools.chain`` would hold the former until the end."""
    yield taken.pop()
    yield from queue


def _refuse_more(queue: Iterator[Channels], count: int) -> None:
    if next(queue, None) is not None:
        raise DeformError(f"there are more moments than the {count} that were stated.")


def _pieces(
    queue: Iterator[Channels], count: int, interleaved: bool, progress: Progress | None
) -> Iterator[memoryview]:
    """The bytes of all moments; each is freed before the next one is made."""
    like: tuple[Grid, np.dtype[Any], int] | None = None
    for number in range(count):
        channels = next(queue, None)
        if channels is None:
            raise DeformError(f"there are only {number} of the {count} moments that were stated.")
        now = (channels.grid, channels[0].dtype, len(channels))
        like = like or now
        if now != like:
            raise DeformError(f"moment {number + 1} is not like the first: it is {channels}.")
        dtype, stack = stored_dtype(channels[0]), [volume.values for volume in channels]
        del channels
        for part in [slice(z, z + 1) for z in range(len(stack[0]))] if interleaved else [slice(None)]:
            for slab in [np.stack([s[part] for s in stack], axis=-1)] if interleaved else stack:
                yield np.ascontiguousarray(slab, dtype=dtype).reshape(-1).view(np.uint8).data
        del stack, slab
        if progress is not None:
            progress((number + 1) / count)
    _refuse_more(queue, count)


def _storable_type(header: Header) -> np.dtype[Any]:
    """The type of voxels that a volume stores and the file's values fit, without reading them."""
    dtype = header.loaded_dtype
    larger = {"float16": "float32", "uint32": "float64", "int64": "float64", "uint64": "float64"}.get(dtype.name)
    if dtype.name in ("int64", "uint64"):
        raise fail(
            header.path,
            f"voxels of type {dtype.name} in several channels or moments are not supported; save them in 32 bits.",
        )
    return dtype if larger is None else np.dtype(larger)


def _stacks(header: Header) -> Iterator[NDArray[Any]]:
    """The voxels of each moment: [channel, z, y, x], in native types, scaled."""
    layout, (nz, ny, nx) = header.layout, header.shape
    inner = layout.channels if layout.interleaved else 1
    outer = layout.channels // inner
    dtype = _storable_type(header)
    per_frame = outer * nz
    done = 0
    out = np.empty((layout.channels, nz, ny, nx), dtype)
    with closing(header.blocks()) as blocks:  # type: ignore[type-var]  # generators can be closed
        for block in blocks:
            begin = 0
            while begin < len(block):
                take = min(len(block) - begin, per_frame - done)
                part: NDArray[Any] = block[begin : begin + take]
                if header.is_scaled:
                    part = part.astype(np.float64) * header.slope + header.intercept
                if layout.interleaved:
                    out[:, done : done + take] = np.moveaxis(part, -1, 0)
                else:
                    out.reshape(per_frame, ny, nx)[done : done + take] = part
                begin, done = begin + take, done + take
                if done == per_frame:
                    yield out
                    done = 0
                    out = np.empty_like(out)


def is_series(path: str | os.PathLike[str]) -> bool:
    """Check whether a file holds several channels or moments, or a picture in colours.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> file = Path(tempfile.mkdtemp()) / "two.nrrd"
    >>> write_channels(Channels.from_array(np.zeros((2, 3, 4, 2), np.uint8)), file)
    >>> is_series(file)
    True
    """
    place = existing_path(path)
    if place.is_dir() and not ome_zarr.is_zarr(place):
        return False
    with Damage(place, "close other programs"):
        kind, header = read_any_header(place)
        return not (images.read_colour_header(place) if kind == "image" else header).layout.is_single
