"""NumPy arrays (.npy) and raw voxels (.raw), with a JSON side file for the rest of the header.

``name.raw`` needs ``name.raw.json``; ``name.npy`` may have ``name.npy.json``, and without it has spacing 1. The side
file is JSON::

    {"format": "deformnb volume", "version": 1, "shape": [56, 324, 301], "dtype": "uint8", "byte_order": "little",
     "offset": 0, "spacing": [1.0, 1.0, 1.4], "origin": [0, 0, 0], "direction": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
     "unit": "mm", "is_labels": false, "crc32": 305419896}

Shape is z, y, x; spacing and origin are x, y, z, in the unit. For raw voxels only "shape" and "dtype" are needed
("byte_order" too if a voxel has several bytes); "crc32", if given, must be that of the voxels' bytes.
"""

from __future__ import annotations

import ast
import json
import math
import re
import struct
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from deformnb._typing import Progress
from deformnb.errors import DeformError
from deformnb.io.files.addresses import copy_neighbour
from deformnb.io.files.atomic import atomic_write, check_target
from deformnb.io.files.errors import fail, printable
from deformnb.io.volumes.headers import Geometry, Header, VoxelBlocks, volume_shape
from deformnb.io.volumes.voxels import Source, check_bytes, slabs_of_bytes
from deformnb.volume.units import parse_unit
from deformnb.volume.volume import Volume, cast

_FORMAT = "deformnb volume"
_VERSION = 1
_SIDE_BYTES = 2**16
_NPY_HEADER_BYTES = 2**16
_TYPE = re.compile(r"(bool|u?int(8|16|32|64)|float(16|32|64))")
_DESCRIPTION = re.compile(r"[<>|=]?[?biufcSUVOMm][0-9]{0,8}(\[[a-zA-Z0-9]+\])?")

_EXAMPLE = '{"shape": [nz, ny, nx], "dtype": "uint8", "spacing": [x, y, z]}'


def _side_path(path: Path) -> Path:
    return path.with_name(path.name + ".json")


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is not a number")


def _side_file(path: Path) -> dict[str, Any] | None:
    """The side file of a volume, None if there is none."""
    side = _side_path(path)
    copy_neighbour(path, side.name, _SIDE_BYTES)
    if not side.is_file():
        return None
    with side.open("rb") as file:
        data = file.read(_SIDE_BYTES + 1)
    if len(data) > _SIDE_BYTES:
        raise fail(side, f"this side file is longer than {_SIDE_BYTES} bytes; it is not one.")
    try:
        fields = json.loads(data.decode("utf-8"), parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise fail(side, f"this side file is not JSON ({printable(error)}).") from error
    if not isinstance(fields, dict):
        raise fail(side, f"this side file should look like {_EXAMPLE}.")
    version = fields.get("version", _VERSION)
    if fields.get("format", _FORMAT) != _FORMAT or not isinstance(version, int) or not (1 <= version <= _VERSION):
        raise fail(side, f"this side file is of another format or newer than version {_VERSION}.")
    return fields


def _numbers(side: Path, fields: dict[str, Any], name: str, shape: tuple[int, ...]) -> Any:
    try:
        array = np.asarray(fields[name])
        if array.shape != shape or array.dtype.kind not in "iuf":
            raise ValueError
        return array.astype(np.float64).tolist()
    except (ValueError, OverflowError, RecursionError) as error:
        many = " x ".join(map(str, shape))
        raise fail(side, f"the field '{name}' should be {many} numbers but is {printable(fields[name])}.") from error


def _geometry(side: Path, fields: dict[str, Any]) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Entries of a side file beyond type and shape, as arguments of Header, and a note on an unknown unit."""
    known: dict[str, Any] = {}
    place: dict[str, Any] = {}
    for name, shape in (("spacing", (3,)), ("origin", (3,)), ("direction", (3, 3))):
        if name in fields:
            rows = _numbers(side, fields, name, shape)
            place[name] = tuple(tuple(row) if isinstance(row, list) else row for row in rows)
    if "is_labels" in fields:
        if not isinstance(fields["is_labels"], bool):
            raise fail(side, "the field 'is_labels' should be true or false.")
        known["is_labels"] = fields["is_labels"]
    unit, notes = parse_unit(fields.get("unit", ""))
    return known | {"geometry": Geometry(**place, is_anatomical="direction" in place), "unit": unit}, notes


def _shape(side: Path, fields: dict[str, Any]) -> list[int]:
    shape = fields.get("shape")
    whole = isinstance(shape, list) and all(isinstance(n, int) and not isinstance(n, bool) for n in shape)
    if not isinstance(shape, list) or not whole or not 1 <= len(shape) <= 8:
        raise fail(side, f"the field 'shape' should be [nz, ny, nx] but is {printable(shape)}.")
    return shape


def read_raw_header(path: Path) -> Header:
    """Read the side file of a .raw file."""
    side = _side_path(path)
    fields = _side_file(path)
    if fields is None:
        raise fail(
            path,
            f"raw voxels need a file {printable(side.name)} next to them that describes them, for example {_EXAMPLE}.",
        )
    sizes = _shape(side, fields)[::-1]
    name, order = fields.get("dtype"), fields.get("byte_order")
    if not isinstance(name, str) or not _TYPE.fullmatch(name):
        raise fail(side, f"the field 'dtype' should be a type such as uint8 or float32 but is {printable(name)}.")
    dtype = np.dtype(name)
    if order not in ("little", "big") and (dtype.itemsize > 1 or order is not None):
        raise fail(side, f'the field \'byte_order\' should be "little" or "big" but is {printable(order)}.')
    offset = fields.get("offset", 0)
    if not isinstance(offset, int) or isinstance(offset, bool) or offset < 0:
        raise fail(side, f"the field 'offset' should be a number of bytes but is {printable(offset)}.")
    shape, notes = volume_shape(side, sizes, dtype.itemsize)
    dtype = dtype.newbyteorder(">" if order == "big" else "<")
    blocks = _verify(path, fields, Source(path, offset).blocks(shape, dtype))
    known, unit_notes = _geometry(side, fields)
    return Header(path, shape, dtype, blocks, notes=notes + unit_notes, **known)


def _verify(path: Path, fields: dict[str, Any], blocks: VoxelBlocks) -> VoxelBlocks:
    """The same blocks; at their end their CRC must be that of the side file, if it has one."""
    if "crc32" not in fields:
        return blocks

    return check_bytes(
        blocks,
        fields["crc32"],
        lambda crc: fail(
            path,
            f"its voxels are not those that {printable(_side_path(path).name)} describes (CRC {crc}, "
            f"expected {printable(fields['crc32'])}). Write both again, or remove the line crc32.",
        ),
    )


def read_npy_header(path: Path) -> Header:
    """Header of a NumPy file, with the geometry of its side file if there is one; never unpickles."""
    with path.open("rb") as file:
        start = file.read(12)
        if start[:6] != b"\x93NUMPY" or len(start) < 12 or start[6] not in (1, 2, 3):
            raise fail(path, "this is not a NumPy file (version 1 to 3).")
        size, begin = (
            (struct.unpack("<H", start[8:10])[0], 10) if start[6] == 1 else (struct.unpack("<I", start[8:12])[0], 12)
        )
        if size > _NPY_HEADER_BYTES:
            raise fail(path, f"its header claims {size} bytes; real ones have about a hundred.")
        file.seek(begin)
        text = file.read(size)
    if len(text) < size:
        raise fail(path, f"its header should have {size} bytes but the file has {len(text)}: it is cut short.")
    dtype, fortran, sizes = _npy_fields(path, text)
    shape, notes = volume_shape(path, sizes[::-1], dtype.itemsize)
    blocks = Source(path, begin + size).blocks(shape[::-1] if fortran else shape, dtype)
    header = Header(path, shape, dtype, blocks, transposed=fortran, notes=notes)
    fields = _side_file(path)
    if fields is None:
        return header
    side = _side_path(path)
    if "shape" in fields and _shape(side, fields) != list(shape):
        raise fail(
            path,
            f"it has shape {shape} but its side file {printable(side.name)} has {_shape(side, fields)}. "
            "Remove the side file if the array is new.",
        )
    if fields.get("dtype", dtype.name) != dtype.name or fields.get("byte_order", "little") not in ("little", "big"):
        raise fail(
            path,
            f"its voxels are {dtype.name}, but its side file {printable(side.name)} has dtype "
            f"{printable(fields.get('dtype'), 40)} and byte_order {printable(fields.get('byte_order'), 40)}. "
            "Remove the side file if the array is new.",
        )
    known, unit_notes = _geometry(side, fields)
    return replace(header, blocks=_verify(path, fields, blocks), notes=notes + unit_notes, **known)


def _npy_fields(path: Path, text: bytes) -> tuple[np.dtype[Any], bool, list[int]]:
    try:
        fields = ast.literal_eval(text.decode("latin1").strip())  # constants only: nothing is called
        descr, fortran, shape = fields["descr"], fields["fortran_order"], fields["shape"]
    except (ValueError, SyntaxError, KeyError, TypeError, IndexError, RecursionError, MemoryError) as error:
        raise fail(path, "its header is not that of a NumPy file; it is damaged.") from error
    if not isinstance(descr, str) or not _DESCRIPTION.fullmatch(descr):
        raise fail(path, f"structured voxels ({printable(descr)}) are not supported; save one field of the array.")
    whole = isinstance(shape, tuple) and all(isinstance(n, int) and not isinstance(n, bool) for n in shape)
    if not isinstance(fortran, bool) or not whole:
        raise fail(path, f"its header is damaged: shape {printable(shape)}, fortran_order {printable(fortran)}.")
    try:
        dtype = np.dtype(descr)
        cast(np.zeros((1, 1, 1), dtype))  # complex, object and text are refused by name, before anything is read
    except (TypeError, DeformError) as error:
        raise fail(
            path, str(error) if isinstance(error, DeformError) else f"unknown type {printable(descr)}."
        ) from error
    if len(shape) < 2:
        raise fail(path, f"a volume has three axes [z, y, x] but this array has shape {shape}; reshape it first.")
    return dtype, fortran, list(shape)


def write_raw(volume: Volume, path: Path, overwrite: bool, progress: Progress | None) -> None:
    """Write plain little-endian voxels and their side file."""
    _write_with_side_file(volume, path, b"", overwrite, progress)


def write_npy(volume: Volume, path: Path, overwrite: bool, progress: Progress | None) -> None:
    """Write a NumPy file and a side file with the geometry, which NumPy's format cannot hold."""
    dtype = volume.dtype.newbyteorder("<")
    fields = f"{{'descr': {dtype.str!r}, 'fortran_order': False, 'shape': {volume.shape!r}, }}"
    fields += " " * (-(len(fields) + 11) % 64) + "\n"  # voxels begin at a multiple of 64 bytes, as NumPy writes them
    header = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(fields)) + fields.encode("latin1")
    _write_with_side_file(volume, path, header, overwrite, progress)


def _write_with_side_file(
    volume: Volume, path: Path, header: bytes, overwrite: bool, progress: Progress | None
) -> None:
    side = _side_path(path)
    check_target(side, overwrite=overwrite)
    dtype = volume.dtype.newbyteorder("<")
    needed = math.prod(volume.shape) * dtype.itemsize + len(header)
    with (
        atomic_write(side, overwrite=overwrite) as text,
        atomic_write(path, overwrite=overwrite, needed=needed) as file,
    ):
        file.write(header)
        crc = 0
        for piece in slabs_of_bytes(volume.values, dtype, progress):
            crc = zlib.crc32(piece, crc)
            file.write(piece)
        text.write(_side_text(volume, crc))
        text.flush()


def _side_text(volume: Volume, crc: int) -> bytes:
    grid = volume.grid
    fields = {
        "format": _FORMAT,
        "version": _VERSION,
        "shape": volume.shape,
        "dtype": volume.dtype.name,
        "byte_order": "little",
        "spacing": grid.spacing,
        "origin": grid.origin,
        "direction": grid.direction,
        **({"unit": grid.unit} if grid.unit else {}),
        "is_labels": volume.is_labels,
        "crc32": crc,
    }
    lines = ",\n".join(f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in fields.items())
    return f"{{\n{lines}\n}}\n".encode()
