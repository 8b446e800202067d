"""Headers of volume files: shape, type and place of the voxels, before any voxel is read.

Headers are read by this package's own short parsers with bounds on everything, because common readers crash, hang or
load garbage in silence when a header is wrong. Text of a header is only ever text.
"""

from __future__ import annotations

import csv
import json
import lzma
import math
import os
import re
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Float3
from deformnb.errors import Cancelled, DeformError, VolumeFileError
from deformnb.volume.volume import IDENTITY, Grid, Matrix3

HEADER_BYTES = 2**20
"""Longest text header that is read. Real ones have a few kB; scanners' private fields stay below 100 kB."""

# Sizes are Python integers, so nothing overflows; this many bytes no machine has (an exbibyte).
_TOO_MANY_BYTES = 2**60

_INTEGER = re.compile(r"[+-]?[0-9]{1,19}")

Blocks = Callable[[], Iterator[NDArray[Any]]]

# More channels or moments than this are no channels but a damaged header, or another kind of axis.
MOST_FRAMES = 1_000_000
"""Moments of a file."""
_MOST_CHANNELS = 1024


@dataclass(frozen=True)
class Layout:
    """What a file holds beside the three axes of a volume: channels, moments in time, or both.

    Parameters
    ----------
    frames : number of moments.
    channels : number of channels, or of the parts of a colour.
    kind : a key of :data:`~deformnb.volume.channels.KINDS`.
    names : of the channels; empty where the file has none.
    colours : of the channels; empty where the file has none.
    interleaved : blocks come as [some z, y, x, channel], frame by frame; else as [some z, y, x], of each frame all
        slices of its first channel, then those of the second, and so on.
    duration : from one frame to the next; 0 if the file does not say.
    is_vector : the file says that its channels are the components of vectors.
    """

    frames: int = 1
    channels: int = 1
    kind: str = "channels"
    names: tuple[str, ...] = ()
    colours: tuple[Float3, ...] = ()
    interleaved: bool = False
    duration: float = 0.0
    is_vector: bool = False

    @property
    def is_single(self) -> bool:
        """True for one volume."""
        return self.frames == 1 and self.channels == 1

    def __str__(self) -> str:
        parts = [f"{self.frames} moments"] * (self.frames > 1)
        if self.kind != "channels":
            parts.append("colours")
        elif self.is_vector:
            parts.append(f"vectors of {self.channels} components")
        elif self.channels > 1:
            parts.append(f"{self.channels} channels")
        return " of ".join(parts) or "one volume"


SINGLE = Layout()
"""The layout of one volume."""


def layout_description(layout: Layout) -> str:
    """Kind, names and colours of the channels as one line of JSON, for a comment in a header."""
    return json.dumps({"kind": layout.kind, "names": layout.names, "colours": layout.colours})


def described_layout(layout: Layout, text: str) -> Layout:
    """The layout with what such a line says of its channels, where it is one that fits; else as it is."""
    try:
        found = json.loads(text) if text else {}
        colours = tuple(triple([min(1.0, max(0.0, float(part))) for part in colour]) for colour in found["colours"])
        names = tuple(shown(name) for name in found["names"])
        if layout.channels == {"rgb": 3, "rgba": 4}.get(
            found["kind"], layout.channels if found["kind"] == "channels" else 0
        ):
            layout = replace(layout, kind=found["kind"], is_vector=False)
    except (ValueError, TypeError, KeyError, IndexError, RecursionError):
        return layout
    return replace(
        layout,
        names=names if len(names) == layout.channels else (),
        colours=colours if len(colours) == layout.channels else (),
    )


def checked_layout(path: Path, layout: Layout) -> Layout:
    """The layout, if its numbers can be; VolumeFileError else."""
    if not (1 <= layout.channels <= _MOST_CHANNELS and 1 <= layout.frames <= MOST_FRAMES):
        raise fail(
            path,
            f"it has {layout.frames} moments and {layout.channels} channels, more than can be; the header "
            "is damaged, or it holds something else than channels or times.",
        )
    return layout


@dataclass(frozen=True)
class Header:
    """All that is known of a volume file without reading its voxels.

    Parameters
    ----------
    path : the file (or the folder of a series).
    shape : (nz, ny, nx).
    dtype : voxel type as stored, byte order included.
    blocks : opens the file and yields the voxels in order, as arrays of whole slices in the stored type.
    spacing, origin, direction : as in the file, in LPS; a spacing may be negative or wrong until :meth:`grid`.
    affine : 4 x 4 LPS map of indices (i, j, k), for files that have one instead of the three.
    slope, intercept : voxels mean ``slope * stored + intercept``.
    transposed : blocks come along x, as [x, y, z].
    is_labels : as in the file, None if it is not stated.
    notes : remarks for a status line.
    working_bytes : memory that reading takes beside the voxels: a page, a packed and an unpacked strip or tile.
    layout : channels and moments; the shape is that of one channel at one moment, the blocks are those of all.
    levels : headers of all resolutions of a pyramid, this one the first; empty for other files.
    unit : of lengths, a symbol of :data:`~deformnb.volume.units.UNITS`; "" where the file states none.
    """

    path: Path
    shape: tuple[int, int, int]
    dtype: np.dtype[Any]
    blocks: Blocks
    spacing: Float3 = (1.0, 1.0, 1.0)
    origin: Float3 = (0.0, 0.0, 0.0)
    direction: Matrix3 = IDENTITY
    affine: NDArray[np.float64] | None = None
    slope: float = 1.0
    intercept: float = 0.0
    transposed: bool = False
    is_labels: bool | None = None
    notes: tuple[str, ...] = ()
    working_bytes: int = 0
    layout: Layout = SINGLE
    levels: tuple[Header, ...] = ()
    unit: str = ""

    @property
    def is_scaled(self) -> bool:
        """True if stored numbers differ from the values that they mean."""
        return (self.slope, self.intercept) != (1.0, 0.0)

    @property
    def loaded_dtype(self) -> np.dtype[Any]:
        """Native type of the voxels once loaded; scaled ones become float32, or float64 where 24 bits are too few."""
        return np.result_type(self.dtype, np.float32) if self.is_scaled else self.dtype.newbyteorder("=")

    def scaled(self, stored: NDArray[Any]) -> NDArray[Any]:
        """The values that stored numbers mean; float64 if they are scaled."""
        return stored.astype(np.float64) * self.slope + self.intercept if self.is_scaled else stored

    def grid(self, spacing: Float3 | None = None) -> tuple[Grid, tuple[str, ...]]:
        """Grid of the voxels, with another spacing if given, and remarks; a negative spacing flips its direction."""
        notes: tuple[str, ...] = ()
        try:
            if self.affine is not None:
                grid = Grid.from_affine(self.shape, self.affine, self.unit)
                return (grid if spacing is None else replace(grid, spacing=spacing)), notes
            lengths, direction, notes = straighten(self.spacing if spacing is None else spacing, self.direction)
            return Grid(self.shape, lengths, self.origin, direction, self.unit), notes
        except DeformError as error:
            raise fail(self.path, str(error)) from error


def straighten(spacing: Float3, direction: Matrix3) -> tuple[Float3, Matrix3, tuple[str, ...]]:
    """The same axes with positive spacing: the sign moves into the column of direction; with a remark if one moved."""
    lengths = np.asarray(spacing, dtype=np.float64)
    if lengths.shape != (3,) or not (lengths < 0).any():
        return spacing, direction, ()
    flips = np.where(lengths < 0, -1.0, 1.0)
    turned = np.asarray(direction, dtype=np.float64) * flips
    named = " and ".join(axis for axis, flip in zip("xyz", flips, strict=True) if flip < 0)
    positive = (float(abs(lengths[0])), float(abs(lengths[1])), float(abs(lengths[2])))
    rows: Matrix3 = tuple(tuple(row) for row in turned.tolist())  # type: ignore[assignment]
    return positive, rows, (f"the spacing along {named} is negative in the file: the axis is flipped instead",)


def shown(text: object, limit: int = 120) -> str:
    r"""Text from outside made fit for a message: no control characters, no end of line, not too long.

    Examples
    --------
    >>> print(shown("a\x1b[31m b"))
    a\x1b[31m b
    """
    try:
        plain = str(text)
    except ValueError:  # Python writes no whole number of more than 4300 digits
        plain = "a number of thousands of digits"
    if len(plain) > limit:
        plain = plain[:limit] + "..."
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "replace").decode() for c in plain)


def fail(path: Path, why: str) -> VolumeFileError:
    """The error with the file and the reason."""
    return VolumeFileError(f"{shown(path.name or path)}: {why}")


# What damaged files and failing disks raise below this level; anything else is a case that nobody has foreseen.
_DAMAGE = (
    OSError,
    EOFError,
    zlib.error,
    lzma.LZMAError,
    struct.error,
    csv.Error,
    MemoryError,
    OverflowError,
    ValueError,
    RecursionError,
)


UNFORESEEN = "for a reason that deformnb does not know"
"""Words of a message about an error that no reader has foreseen."""


class Damage:
    """Turns what the parsers of a file raise into the one error that names the file.

    Parameters
    ----------
    path : the file.
    advice : what to do where there is not enough memory for it.
    """

    def __init__(self, path: Path, advice: str) -> None:
        self._path, self._advice = path, advice

    def __enter__(self) -> None:
        """Nothing to prepare."""

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, MemoryError):
            raise fail(self._path, f"there is not enough memory for it; {self._advice}.") from error
        if isinstance(error, _DAMAGE) and not isinstance(error, DeformError):
            why = (
                "its text is not UTF-8"
                if isinstance(error, UnicodeError)
                else shown(error).rstrip(".") or type(error).__name__
            )
            raise fail(self._path, f"it cannot be read: {why}.") from error
        if isinstance(error, DeformError) and not isinstance(error, (VolumeFileError, ImportError)):
            raise fail(self._path, str(error)) from error
        if isinstance(error, Exception) and not isinstance(error, (DeformError, Cancelled, Warning)):
            raise fail(
                self._path,
                f"it cannot be read, {UNFORESEEN} ({type(error).__name__}: {shown(error)}); please "
                "report it with the file.",
            ) from error


@contextmanager
def unpacking(path: Path) -> Iterator[None]:
    """Turn what packed data raise, which can be anything where they are damaged, into an error that names the file."""
    try:
        yield
    except (MemoryError, DeformError):
        raise
    except Exception as error:
        raise fail(path, f"it cannot be read: {shown(error) or type(error).__name__}.") from error


def human_bytes(count: int) -> str:
    """A number of bytes for people.

    Examples
    --------
    >>> human_bytes(3 * 2**30)
    '3.0 GiB'
    """
    size = float(count)
    for unit in ("bytes", "KiB", "MiB", "GiB", "TiB", "PiB"):
        if size < 1024:
            return f"{size:.0f} {unit}" if unit == "bytes" else f"{size:.1f} {unit}"
        size /= 1024
    return f"{size:.0f} EiB"


def integers(path: Path, field: str, text: str, count: int | None = None) -> list[int]:
    """The whole numbers of a header's field; of any size, never wrapped."""
    words = text.split()
    if (count is not None and len(words) != count) or len(words) > 100 or not all(map(_INTEGER.fullmatch, words)):
        expected = "whole numbers" if count is None else f"{count} whole number{'s' * (count != 1)}"
        raise fail(path, f"the field '{field}' should be {expected} but is '{shown(text)}'.")
    return [int(word) for word in words]


def floats(path: Path, field: str, text: str, count: int | None = None) -> list[float]:
    """The numbers of a header's field; NaN and infinity are for the caller to refuse."""
    words = text.split()
    try:
        numbers = [float(word) for word in words[:100]]
    except ValueError:
        numbers = []
    if len(numbers) != (len(words) if count is None else count):
        expected = "numbers" if count is None else f"{count} number{'s' * (count != 1)}"
        raise fail(path, f"the field '{field}' should be {expected} but is '{shown(text)}'.")
    return numbers


def triple(values: list[float]) -> Float3:
    """Three floats as a tuple."""
    return values[0], values[1], values[2]


def volume_shape(path: Path, sizes: list[int], itemsize: int) -> tuple[tuple[int, int, int], tuple[str, ...]]:
    """(nz, ny, nx) of the sizes along x, y, z and beyond, and a remark for a single picture.

    Raises
    ------
    VolumeFileError
        For a size below one, more than three real axes (listed), or more bytes than there can be.
    """
    if not sizes or min(sizes) < 1:
        raise fail(path, f"every size must be at least 1 voxel, but the sizes along x, y, z are {sizes}.")
    real = list(sizes)
    while len(real) > 3 and real[-1] == 1:
        real.pop()
    if len(real) > 3:
        names = ("x", "y", "z", "t", "5th", "6th", "7th")
        axes = ", ".join(f"{name}: {size}" for name, size in zip(names, real, strict=False))
        raise fail(
            path,
            f"a volume has three axes but this file has {len(real)} ({axes}). Save one time point or one "
            "channel as a file of its own and read that.",
        )
    notes = ("a 2-D image was taken as a volume of one slice",) if len(sizes) < 3 else ()
    nx, ny, nz = (*real, 1, 1)[:3]
    if math.prod(real) * itemsize >= _TOO_MANY_BYTES:
        raise fail(path, f"the sizes {real} need more memory than any machine has; the header is damaged.")
    return (nz, ny, nx), notes


def as_path(path: str | os.PathLike[str]) -> Path:
    """The path that a name means, ``~`` included; VolumeFileError for what names no file."""
    try:
        return Path(path).expanduser()
    except (TypeError, RuntimeError) as error:
        raise VolumeFileError(f"{shown(path)}: this is not the path of a file ({shown(error)}).") from error


def regular_file(path: Path) -> Path:
    """The path if it is a plain file; a pipe would wait for ever and a device has no end."""
    try:
        if path.is_file():
            return path
        exists = path.exists()
    except (OSError, ValueError) as error:
        raise VolumeFileError(f"{shown(path)!r} is not a usable path ({shown(error)}).") from error
    raise fail(
        path, "this is not a plain file." if exists else f"there is no such file in {shown(path.absolute().parent)}."
    )


def detached_file(header: Path, name: str) -> Path:
    """The data file that a header names, which must lie in the header's own folder or below it.

    Anything else is refused: a header from elsewhere could otherwise show any file of this machine as voxels.
    """
    plain = name.strip()
    parts = re.split(r"[/\\]", plain)
    if not plain or "\0" in plain or ".." in parts or not parts[0] or os.path.isabs(plain) or ":" in parts[0]:
        raise fail(
            header,
            f"its data file '{shown(plain)}' is not in the header's own folder, so it is not read. "
            "Put both files into one folder and name it without a path.",
        )
    target = header.parent.joinpath(*parts)
    try:
        inside = target.resolve().is_relative_to(header.parent.resolve())
    except (OSError, RuntimeError, ValueError) as error:
        raise fail(header, f"its data file '{shown(plain)}' is not a usable name ({error}).") from error
    if not inside:
        raise fail(header, f"its data file '{shown(plain)}' is a link out of the header's own folder; it is not read.")
    if not target.exists():
        raise fail(header, f"its data file '{shown(plain)}' is missing; it belongs next to the header.")
    if target.resolve() == header.resolve():
        raise fail(header, "it names itself as its data file.")
    return regular_file(target)


# Real sets have a file for each slice.
_MOST_FILES = 50_000
_PATTERN = re.compile(r"(.*%0?[0-9]{0,2}d\S*)\s+(-?[0-9]{1,9})\s+(-?[0-9]{1,9})(?:\s+(-?[0-9]{1,9}))?(?:\s+([0-9]+))?")


def numbered_names(header: Path, pattern: str) -> tuple[list[str], int | None]:
    """The names of a set of files that a header gives as a pattern: ``slice%03d.raw first last step``.

    Returns
    -------
    tuple
        Names in their order, and the number of axes that each file has, where the header states it behind the step.

    Raises
    ------
    VolumeFileError
        If it is no such pattern, or one of too many files.

    Examples
    --------
    >>> numbered_names(Path("a.nhdr"), "s%02d.raw 8 12 2")
    (['s08.raw', 's10.raw', 's12.raw'], None)
    """
    found = _PATTERN.fullmatch(pattern.strip())
    name = found[1] if found else ""
    if found is None or name.count("%") != 1:
        raise fail(
            header,
            f"its data file '{shown(pattern)}' should be a name, or a pattern of names with the first "
            "and the last number and a step, such as slice%03d.raw 1 20 1.",
        )
    first, last, step = int(found[2]), int(found[3]), int(found[4] or 1)
    numbers = range(first, last + (1 if step > 0 else -1), step) if step else range(0)
    if not 1 <= len(numbers) <= _MOST_FILES:
        raise fail(
            header,
            f"its data files from {first} to {last} by {step} are {len(numbers)}; 1 to {_MOST_FILES} can be read.",
        )
    return [name % number for number in numbers], int(found[5]) if found[5] else None


def listed_names(header: Path, text: str) -> list[str]:
    """The names of a set of files that a header lists, one a line up to its end."""
    names = [line.strip() for line in text.splitlines() if line.strip()]
    if not 1 <= len(names) <= _MOST_FILES:
        raise fail(header, f"its list of data files has {len(names)} names; 1 to {_MOST_FILES} can be read.")
    if len(set(names)) < len(names):
        raise fail(header, "its list of data files names a file twice.")
    return names


def check_share(header: Path, sizes: list[int], files: int, axes: int | None) -> None:
    """Refuse a set of files that are not as many as the sizes of the header require.

    Parameters
    ----------
    sizes : along all axes of the file, the one that changes fastest first.
    axes : how many of these each file has; by default all but the last.
    """
    inner = len(sizes) - 1 if axes is None else axes
    wanted = math.prod(sizes[inner:])
    fits = files == wanted if inner < len(sizes) else sizes[-1] % files == 0
    if not 1 <= inner <= len(sizes) or not fits:
        raise fail(header, f"its sizes {sizes} need {wanted} data files of {inner} axes, and it names {files}.")


def detached_name(header: Path, crc: int) -> str:
    """Name of the file of voxels that goes with a header we write; it cannot clash with another format's file.

    Parameters
    ----------
    crc : CRC-32 of the voxels' bytes: other voxels get another name.

    Raises
    ------
    VolumeFileError
        For a name that a text header cannot hold: it would be read back as another name, or as more fields.
    """
    name = f"{header.name}.{crc:08x}.raw"
    if not name.isprintable() or "%" in name or name != name.strip():
        raise fail(
            header,
            "a header with a detached data file cannot have this name; leave out '%', line ends and "
            "spaces at the ends, or write everything into one file (.nrrd, .mha).",
        )
    return name


def is_detached_name(header: Path, name: str) -> bool:
    """Check whether :func:`detached_name` gives such a name to a data file of this header."""
    return re.fullmatch(re.escape(header.name) + r"\.[0-9a-f]{8}\.raw", name) is not None


def detached_proof(crc: int) -> str:
    """The comment in a header that we write with the checksum of its data file."""
    return f"deformnb data crc32 {crc:08x}"


def proven_crc(comments: str, data_file: str) -> int | None:
    """The checksum of the data file in a header's comments; None if there is none.

    A program that reads our header and writes other voxels may keep the comments, but gives the data file a name of
    its own; so a check sum counts only for a file that has it in its name.
    """
    found = re.search(r"deformnb data crc32 ([0-9a-f]{8})\b", comments)
    return int(found[1], 16) if found is not None and data_file.endswith(f".{found[1]}.raw") else None
