"""MetaImage, attached (.mha) and detached (.mhd).

The rows of TransformMatrix are the directions of the x, y and z index in LPS. Source: the MetaIO documentation and what
SimpleITK reads and writes.
"""

from __future__ import annotations

import math
import re
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from deformnb._typing import Float3, Progress
from deformnb.io.files.detached import (
    check_share,
    detached_file,
    detached_proof,
    listed_names,
    numbered_names,
    stated_crc,
)
from deformnb.io.files.errors import fail, printable
from deformnb.io.files.texts import floats, integers
from deformnb.io.volumes.headers import (
    HEADER_BYTES,
    MOST_SKIPPED,
    SINGLE,
    Geometry,
    Header,
    Layout,
    check_layout,
    layout_description,
    parse_channels,
    volume_shape,
)
from deformnb.io.volumes.voxels import (
    SeveralSources,
    Source,
    check_blocks,
    layout_blocks,
    stored_dtype,
    write_packed,
    write_pair,
)
from deformnb.volume.units import parse_unit
from deformnb.volume.volume import Matrix3, Volume

_TYPES = {
    "MET_CHAR": "i1",
    "MET_UCHAR": "u1",
    "MET_SHORT": "i2",
    "MET_USHORT": "u2",
    "MET_INT": "i4",
    "MET_UINT": "u4",
    "MET_LONG": "i4",
    "MET_ULONG": "u4",
    "MET_LONG_LONG": "i8",
    "MET_ULONG_LONG": "u8",
    "MET_FLOAT": "f4",
    "MET_DOUBLE": "f8",
}
_NAMES = {
    "i1": "MET_CHAR",
    "u1": "MET_UCHAR",
    "i2": "MET_SHORT",
    "u2": "MET_USHORT",
    "i4": "MET_INT",
    "f4": "MET_FLOAT",
    "f8": "MET_DOUBLE",
}

# MetaImage has no field for voxels that are names of regions, nor for a checksum; a comment, which every reader
# preserves or ignores, can.
_LABELS = "deformnb labels"
_CHANNELS = "deformnb channels "


def _fields(path: Path) -> tuple[dict[str, str], int]:
    """Fields by lower-case name, and where the header ends: after the line ElementDataFile."""
    with path.open("rb") as file:
        data = file.read(HEADER_BYTES)
    fields: dict[str, str] = {}
    start = 0
    while start < len(data):
        end = data.find(b"\n", start)
        line = data[start : end if end >= 0 else len(data)].decode("utf-8", "replace").strip()
        start = end + 1 if end >= 0 else len(data)
        if not line:
            continue
        name, equals, value = line.partition("=")
        key = name.strip().lower()
        if not equals or key in fields:
            why = "appears twice" if equals else "is not 'Name = value'"
            raise fail(path, f"this is not a MetaImage file or damaged: the line '{printable(line)}' {why}.")
        fields[key] = value.strip()
        if key == "elementdatafile":
            return fields, start
    raise fail(path, "its header has no line ElementDataFile; it is cut short or damaged.")


def _flag(path: Path, fields: dict[str, str], name: str, missing: bool) -> bool:
    value = fields.get(name.lower())
    if value is None:
        return missing
    if value.lower() not in ("true", "false", "1", "0"):
        raise fail(path, f"the field '{name}' should be True or False but is '{printable(value)}'.")
    return value.lower() in ("true", "1")


def read_header(path: Path) -> Header:
    """Geometry, type and place of the voxels of a MetaImage file."""
    fields, end = _fields(path)
    for name in ("NDims", "DimSize", "ElementType"):
        if name.lower() not in fields:
            raise fail(path, f"its header lacks the field '{name}'.")
    kind = fields.get("objecttype", "Image")
    if kind.lower() != "image":
        raise fail(path, f"its ObjectType is '{printable(kind)}', and a volume is an Image.")
    dimension = integers(path, "NDims", fields["ndims"], 1)[0]
    if not 1 <= dimension <= 10:
        raise fail(path, f"the field 'NDims' is {dimension}; a volume has 3.")
    channels = integers(path, "ElementNumberOfChannels", fields.get("elementnumberofchannels", "1"), 1)[0]
    dtype = _dtype(path, fields)
    sizes = integers(path, "DimSize", fields["dimsize"], dimension)
    if any(size != 1 for size in sizes[4:]):
        volume_shape(path, sizes, dtype.itemsize)  # which lists the axes
    shape, notes = volume_shape(path, sizes[:3], dtype.itemsize)
    comment = fields.get("comment", "")
    duration = (
        floats(path, "ElementSpacing", fields["elementspacing"], dimension)[3]
        if (dimension > 3 and "elementspacing" in fields)
        else 0.0
    )
    layout = check_layout(
        path,
        Layout(
            (*sizes[3:4], 1)[0],
            channels,
            interleaved=channels > 1,
            duration=duration if math.isfinite(duration) else 0.0,
        ),
    )
    layout = parse_channels(layout, comment.partition(_CHANNELS)[2])
    source = _source(path, fields, end, sizes, dtype.itemsize * channels, dtype)
    labels = True if comment.split(";")[0] == _LABELS else None
    spacing, origin, direction = _geometry(path, fields, dimension)
    # ITK, whose format this is, means millimetres and never writes the field.
    unit, unit_notes = parse_unit(fields.get("distanceunits", "mm"))
    notes += unit_notes
    crc = stated_crc(comment, fields["elementdatafile"])
    blocks = layout_blocks(source, shape, dtype, layout, lambda s, whole: check_blocks(s, whole, dtype, crc, path))
    return Header(
        path,
        shape,
        dtype,
        blocks,
        Geometry(spacing, origin, direction, is_anatomical="?" not in fields.get("anatomicalorientation", "?")),
        is_labels=labels,
        notes=notes,
        layout=layout,
        unit=unit,
    )


def _dtype(path: Path, fields: dict[str, str]) -> np.dtype[Any]:
    name = fields["elementtype"].upper()
    if name not in _TYPES:
        raise fail(path, f"the ElementType '{printable(name)}' is not supported; save one number per voxel.")
    big = _flag(path, fields, "BinaryDataByteOrderMSB", _flag(path, fields, "ElementByteOrderMSB", False))
    return np.dtype(_TYPES[name]).newbyteorder(">" if big else "<")


def _source(
    path: Path, fields: dict[str, str], end: int, sizes: list[int], pixel: int, dtype: np.dtype[Any]
) -> Source | SeveralSources:
    """The source of the voxels.

    Parameters
    ----------
    pixel : bytes of all channels of a voxel.
    """
    name, total = fields["elementdatafile"], math.prod(sizes) * pixel
    if name.upper() == "LOCAL":
        return _part(path, fields, path, end, total, dtype)
    names, axes = _names(path, name, end)
    if names is None:
        return _part(path, fields, detached_file(path, name), 0, total, dtype)
    check_share(path, sizes, len(names), axes)
    return SeveralSources(
        path, tuple(_part(path, fields, detached_file(path, one), 0, total // len(names), dtype) for one in names)
    )


def _names(path: Path, name: str, end: int) -> tuple[list[str] | None, int | None]:
    """The data files of a set and the axes that each one has; None for one file."""
    found = re.fullmatch(r"LIST(?:\s+([0-9])D?)?", name.strip(), re.IGNORECASE)
    if found is None:
        return numbered_names(path, name) if "%" in name else (None, None)
    with path.open("rb") as file:
        file.seek(end)
        text = file.read(HEADER_BYTES).decode("utf-8", "replace")
    return listed_names(path, text), int(found[1]) if found[1] else None


def _part(path: Path, fields: dict[str, str], target: Path, offset: int, expected: int, dtype: np.dtype[Any]) -> Source:
    """The voxels in one file; the bytes to skip are those of each file of a set."""
    skip = integers(path, "HeaderSize", fields.get("headersize", "0"), 1)[0]
    packed, is_text = _flag(path, fields, "CompressedData", False), not _flag(path, fields, "BinaryData", True)
    if not -1 <= skip <= MOST_SKIPPED or ((packed or is_text) and skip) or (packed and is_text):
        raise fail(path, f"the field 'HeaderSize' is {skip}, which is not usable here.")
    if skip == -1:  # the voxels are the last bytes of the file
        offset = max(offset, target.stat().st_size - expected)
    else:
        offset += skip
    return Source(target, offset, "gzip" if packed else "text" if is_text else "raw", 0, dtype if is_text else None)


def _geometry(path: Path, fields: dict[str, str], dimension: int) -> tuple[Float3, Float3, Matrix3]:
    def first(*names: str) -> str | None:
        return next((name for name in names if name.lower() in fields), None)

    def vector(name: str | None, missing: float) -> Float3:
        values = [] if name is None else floats(path, name, fields[name.lower()], dimension)
        padded = [*values, missing, missing, missing]
        return padded[0], padded[1], padded[2]

    spacing = vector(first("ElementSpacing", "ElementSize"), 1.0)
    origin = vector(first("Offset", "Position", "Origin"), 0.0)
    matrix = np.eye(max(3, dimension))
    name = first("TransformMatrix", "Rotation", "Orientation")
    if name is not None:
        values = floats(path, name, fields[name.lower()], dimension * dimension)
        matrix[:dimension, :dimension] = np.reshape(values, (dimension, dimension)).T
    rows: Matrix3 = tuple(tuple(row) for row in matrix[:3, :3].tolist())  # type: ignore[assignment]
    return spacing, origin, rows


def write(volume: Volume, path: Path, overwrite: bool, progress: Progress | None) -> None:
    """Write MetaImage: one file with plain voxels, or for .mhd a header and ``<name>.mhd.<check sum>.raw``.

    Not compressed: the header would need the compressed size before the voxels are packed.
    """
    if path.suffix.lower() == ".mhd":
        write_pair(
            volume,
            path,
            partial(_header_text, volume),
            lambda header: _fields(header)[0]["elementdatafile"],
            overwrite,
            progress,
        )
    else:
        write_packed(volume, path, _header_text(volume, "LOCAL"), "raw", overwrite, progress)


def series_header(_path: Path, volume: Volume, layout: Layout) -> bytes:
    """The header of channels and moments like this volume: a fourth axis is time, channels are parts of a voxel."""
    return _header_text(volume, "LOCAL", layout=layout)


def _header_text(volume: Volume, data_file: str, crc: int | None = None, layout: Layout = SINGLE) -> bytes:
    def words(values: Any) -> str:
        return " ".join(map(repr, values))

    grid, moments = volume.grid, layout.frames > 1
    axes = 4 if moments else 3
    matrix = np.eye(axes)
    matrix[:3, :3] = np.transpose(grid.direction)
    comments = [_LABELS] * volume.is_labels + ([] if crc is None else [detached_proof(crc)])
    comments += [_CHANNELS + layout_description(layout)] if layout.channels > 1 else []
    lines = [
        "ObjectType = Image",
        f"NDims = {axes}",
        *(["Comment = " + ";".join(comments)] if comments else []),
        "BinaryData = True",
        "BinaryDataByteOrderMSB = False",
        "CompressedData = False",
        "TransformMatrix = " + words(matrix.ravel().tolist()),
        "Offset = " + words((*grid.origin, 0.0)[:axes]),
        "ElementSpacing = " + words((*grid.spacing, layout.duration or 1.0)[:axes]),
        "DimSize = " + words((*volume.shape[::-1], layout.frames)[:axes]),
        *([] if grid.unit == "mm" else [f"DistanceUnits = {grid.unit or '?'}"]),  # without one ITK means millimetres
        *([f"ElementNumberOfChannels = {layout.channels}"] if layout.channels > 1 else []),
        f"ElementType = {_NAMES[stored_dtype(volume).str[1:]]}",
        f"ElementDataFile = {data_file}",
    ]
    return ("\n".join(lines) + "\n").encode()
