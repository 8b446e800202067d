"""NRRD, attached (.nrrd) and detached (.nhdr).

The spaces LPS, RAS and LAS are distinguished; without a space the axes are taken as LPS.
Source: the definition of the NRRD file format of the Teem library.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Progress
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
    triple,
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
from deformnb.volume.units import common_unit, parse_unit
from deformnb.volume.volume import Volume

_TYPES = {
    "i1": ("signed char", "int8", "int8_t"),
    "u1": ("uchar", "unsigned char", "uint8", "uint8_t"),
    "i2": ("short", "short int", "signed short", "signed short int", "int16", "int16_t"),
    "u2": ("ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"),
    "i4": ("int", "signed int", "int32", "int32_t"),
    "u4": ("uint", "unsigned int", "uint32", "uint32_t"),
    "i8": ("longlong", "long long", "long long int", "signed long long", "signed long long int", "int64", "int64_t"),
    "u8": ("ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t"),
    "f4": ("float",),
    "f8": ("double",),
}
_DTYPES = {name: dtype for dtype, names in _TYPES.items() for name in names}
_NAMES = {"i1": "int8", "u1": "uint8", "i2": "int16", "u2": "uint16", "i4": "int32", "f4": "float", "f8": "double"}
_ENCODINGS = {
    "raw": "raw",
    "gzip": "gzip",
    "gz": "gzip",
    "bzip2": "bzip2",
    "bz2": "bzip2",
    "ascii": "text",
    "text": "text",
    "txt": "text",
    "hex": "hex",
}

# Signs that turn each space into left-posterior-superior; spaces that name no patient are not converted.
_SPACES = {
    "left-posterior-superior": (1.0, 1.0, 1.0),
    "lps": (1.0, 1.0, 1.0),
    "right-anterior-superior": (-1.0, -1.0, 1.0),
    "ras": (-1.0, -1.0, 1.0),
    "left-anterior-superior": (1.0, -1.0, 1.0),
    "las": (1.0, -1.0, 1.0),
    "scanner-xyz": (1.0, 1.0, 1.0),
    "3d-right-handed": (1.0, 1.0, 1.0),
    "3d-left-handed": (1.0, 1.0, 1.0),
}

_SPACES_OF_PATIENTS = re.compile(r"anterior|posterior|^(lps|ras|las)$")

# Axes of these kinds are places; an axis of any other kind (colours, vectors, tensors, time) is not.
_VECTORS = {"vector", "covariant-vector", "normal", "2-vector", "3-vector", "4-vector", "3-gradient", "3-normal"}
_PLACES = {"domain", "space", "???", "none"}

_LABELS_KEY = "deformnb_labels"  # NRRD has no field for voxels that are names of regions; hence a key of deformnb
_CHANNELS_KEY = "deformnb_channels"  # nor for the names of channels


class _Text(NamedTuple):
    """A header: fields, key/value pairs, comments, where it ends, and the list of data files at its end."""

    fields: dict[str, str]
    keys: dict[str, str]
    comments: str
    end: int
    files: str


def _fields(path: Path) -> _Text:
    with path.open("rb") as file:
        data = file.read(HEADER_BYTES)
    if not data.startswith(b"NRRD000"):
        raise fail(path, "this is not a NRRD file: it does not begin with NRRD000.")
    end = re.search(rb"\r?\n\r?\n", data)
    if end is None and (len(data) == HEADER_BYTES or path.suffix.lower() != ".nhdr"):
        raise fail(path, "its header has no end (an empty line); it is cut short or damaged.")
    text = data[: end.start() if end else len(data)].decode("utf-8", "replace")
    text, files = _split_file_list(text)
    fields: dict[str, str] = {}
    keys: dict[str, str] = {}
    comments: list[str] = []
    for line in text.splitlines()[1:]:
        if line.startswith("#"):
            comments.append(line)
        if line.startswith("#") or not line.strip():
            continue
        key, assign, value = line.partition(":=")
        if assign and ": " not in key:
            keys[key.strip()] = value.strip()
            continue
        name, colon, value = line.partition(":")
        name = name.strip().lower().replace(" ", "")
        if not colon or name in fields:
            why = "appears twice" if colon else "is neither 'field: value' nor 'key:=value'"
            raise fail(path, f"the header's line '{printable(line)}' {why}.")
        fields[name] = value.strip()
    return _Text(fields, keys, "\n".join(comments), end.end() if end else len(data), files)


def _split_file_list(text: str) -> tuple[str, str]:
    """A header up to a list of data files, and the list."""
    found = re.search(r"^data ?file:\s*LIST\b[^\n]*\n?", text, re.MULTILINE | re.IGNORECASE)
    return (text[: found.end()], text[found.end() :]) if found else (text, "")


def read_header(path: Path) -> Header:
    """Geometry, type and place of the voxels of a NRRD file."""
    fields, keys, comments, end, files = _fields(path)
    for name in ("dimension", "type", "sizes", "encoding"):
        if name not in fields:
            raise fail(path, f"its header lacks the field '{name}'.")
    dtype = _dtype(path, fields)
    dimension = integers(path, "dimension", fields["dimension"], 1)[0]
    if not 1 <= dimension <= 16:
        raise fail(path, f"the field 'dimension' is {dimension}; a volume has 3.")
    sizes = integers(path, "sizes", fields["sizes"], dimension)
    axes, layout = _places(path, fields, sizes)
    layout = check_layout(path, parse_channels(layout, keys.get(_CHANNELS_KEY, "")))
    shape, notes = volume_shape(path, [sizes[axis] for axis in axes], dtype.itemsize)
    source = _source(path, fields, end, files, sizes, dtype)
    unit, factors, unit_notes = _unit(path, fields, axes)
    affine = _affine(path, fields, axes, dimension, factors)
    notes += affine.pop("notes", ())
    # A segmentation of 3D Slicer holds the numbers of segments, although no field of NRRD states it.
    labels = True if keys.get(_LABELS_KEY) == "yes" or "Segment0_LabelValue" in keys else None
    crc = stated_crc(comments, fields.get("datafile", ""))
    blocks = layout_blocks(source, shape, dtype, layout, lambda s, whole: check_blocks(s, whole, dtype, crc, path))
    return Header(
        path,
        shape,
        dtype,
        blocks,
        is_labels=labels,
        notes=notes + unit_notes,
        layout=layout,
        unit=unit,
        geometry=Geometry(**affine, is_anatomical=_is_of_patient(fields)),
    )


def _is_of_patient(fields: Mapping[str, str]) -> bool:
    """Check whether the axes of the space are those of a patient."""
    space = fields.get("space", "").lower()
    return space in _SPACES and _SPACES_OF_PATIENTS.search(space) is not None


def segment_keys(path: Path) -> dict[str, str]:
    """The keys of a segmentation of 3D Slicer, such as Segment0_Name and Segment0_Color; empty for other files."""
    return {key: value for key, value in _fields(path).keys.items() if re.match(r"Segment(\d+|ation)_", key)}


def segment_names(path: Path) -> dict[int, str]:
    """Names of the labels of a segmentation of 3D Slicer (.seg.nrrd); empty for other NRRD files.

    Parameters
    ----------
    path : of the file, whose keys Segment0_LabelValue, Segment0_Name and so on are read.
    """
    keys, names = _fields(path).keys, {}
    for key, value in keys.items():
        found = re.fullmatch(r"(Segment\d+)_LabelValue", key)
        if found and value.isdecimal() and keys.get(f"{found[1]}_Name"):
            names[int(value)] = keys[f"{found[1]}_Name"]
    return names


def _dtype(path: Path, fields: dict[str, str]) -> np.dtype[Any]:
    name = " ".join(fields["type"].lower().split())
    if name not in _DTYPES:
        raise fail(path, f"the voxel type '{printable(fields['type'])}' is not supported; save one number per voxel.")
    dtype = np.dtype(_DTYPES[name])
    endian = fields.get("endian", "").lower()
    is_text = _ENCODINGS.get(fields["encoding"].lower()) == "text"
    if dtype.itemsize > 1 and not is_text and endian not in ("little", "big"):
        raise fail(
            path, f"the field 'endian' is '{printable(endian)}' but must be little or big for {dtype.name} voxels."
        )
    return dtype.newbyteorder(">" if endian == "big" else "<")


def _places(path: Path, fields: dict[str, str], sizes: list[int]) -> tuple[list[int], Layout]:
    """Indices of the axes x, y and z, and the channels and moments along the others.

    The parts of a voxel are along the first axis, moments along the last.
    """
    kinds = named = fields["kinds"].lower().split() if "kinds" in fields else ["domain"] * len(sizes)
    if "spacedirections" in fields:
        vectors = _vectors(path, "space directions", fields["spacedirections"])
        if len(vectors) != len(sizes):
            raise fail(path, f"the field 'space directions' has {len(vectors)} vectors for {len(sizes)} axes.")
        kinds = (
            [kind if vector is not None else "list" for kind, vector in zip(kinds, vectors, strict=False)]
            if len(kinds) == len(sizes)
            else kinds
        )
    if len(kinds) != len(sizes):
        raise fail(path, f"the field 'kinds' names {len(kinds)} axes but there are {len(sizes)}.")
    other = [axis for axis, kind in enumerate(kinds) if kind not in _PLACES]
    places = [axis for axis in range(len(sizes)) if axis not in other]
    if len(places) > 3:  # a fourth axis that the file calls a place is the slowest one: moments
        places, other = places[:3], [*other, *places[3:]]
    real = [axis for axis in sorted(other) if sizes[axis] != 1]
    last = len(sizes) - 1
    if min(sizes) < 1:
        volume_shape(path, sizes, 1)  # which refuses it
    is_series = last not in real or last == 0 or kinds[last] in _PLACES | {"time", "list"}
    if not set(real) <= {0, last} or not is_series:
        axes = ", ".join(f"{printable(kind)}: {size}" for kind, size in zip(kinds, sizes, strict=True))
        raise fail(
            path,
            f"a volume has three axes in space but this file has ({axes}). Save one channel or one time "
            "point as a separate file and read that.",
        )
    parts = sizes[0] if 0 in real else 1
    colours = {"rgb-color": 3, "3-color": 3, "rgba-color": 4, "4-color": 4}.get(kinds[0]) if parts > 1 else None
    kind = {3: "rgb", 4: "rgba"}.get(parts, "channels") if colours == parts else "channels"
    moments = sizes[last] if last in real and last > 0 else 1
    return places, Layout(moments, parts, kind, interleaved=parts > 1, is_vector=parts > 1 and named[0] in _VECTORS)


def _vectors(path: Path, field: str, text: str) -> list[list[float] | None]:
    words = re.findall(r"none|\([^()]*\)", text, re.IGNORECASE)
    if re.sub(r"none|\([^()]*\)|\s", "", text, flags=re.IGNORECASE):
        raise fail(path, f"the field '{field}' should be vectors like (1,0,0) but is '{printable(text)}'.")
    return [None if word[0] != "(" else floats(path, field, word[1:-1].replace(",", " ")) for word in words]


def _source(
    path: Path, fields: dict[str, str], end: int, files: str, sizes: list[int], dtype: np.dtype[Any]
) -> Source | SeveralSources:
    encoding = _ENCODINGS.get(fields["encoding"].lower())
    if encoding is None:
        raise fail(path, f"the encoding '{printable(fields['encoding'])}' is not supported; save it as raw or gzip.")
    lines = integers(path, "line skip", fields.get("lineskip", "0"), 1)[0]
    skip = integers(path, "byte skip", fields.get("byteskip", "0"), 1)[0]
    if not (0 <= lines <= HEADER_BYTES and -1 <= skip <= MOST_SKIPPED) or (skip == -1 and encoding != "raw"):
        raise fail(path, f"the fields 'line skip' ({lines}) and 'byte skip' ({skip}) are not usable.")
    total, name = math.prod(sizes) * dtype.itemsize, fields.get("datafile")
    if name is None:
        if path.suffix.lower() == ".nhdr":
            raise fail(path, "its header names no data file.")
        return _part(path, path, end, encoding, lines, skip, total, dtype)
    names, axes = _names(path, name, files)
    if names is None:
        return _part(path, detached_file(path, name), 0, encoding, lines, skip, total, dtype)
    check_share(path, sizes, len(names), axes)
    return SeveralSources(
        path,
        tuple(
            _part(path, detached_file(path, one), 0, encoding, lines, skip, total // len(names), dtype) for one in names
        ),
    )


def _names(path: Path, name: str, files: str) -> tuple[list[str] | None, int | None]:
    """The data files of a set and the axes that each one has; None for one file."""
    words = name.split()
    if words[:1] == ["LIST"]:
        return listed_names(path, files), integers(path, "data file", words[1], 1)[0] if len(words) > 1 else None
    return numbered_names(path, name) if "%" in name else (None, None)


def _part(
    path: Path, target: Path, offset: int, encoding: str, lines: int, skip: int, expected: int, dtype: np.dtype[Any]
) -> Source:
    """The voxels in one file; lines and bytes to skip are those of each file of a set."""
    offset += _skip_lines(path, target, offset, lines)
    if skip == -1:  # the voxels are the last bytes of the file
        offset, skip = max(offset, target.stat().st_size - expected), 0
    if encoding in ("text", "hex"):
        offset, skip = offset + skip, 0
    return Source(target, offset, encoding, skip, dtype if encoding == "text" else None)


def _skip_lines(path: Path, target: Path, offset: int, lines: int) -> int:
    if not lines:
        return 0
    with target.open("rb") as file:
        file.seek(offset)
        data = file.read(HEADER_BYTES)
    ends = [match.end() for match in re.finditer(rb"\n", data)]
    if len(ends) < lines:
        raise fail(path, f"the field 'line skip' is {lines} but the data have fewer lines in their first MiB.")
    return ends[lines - 1]


def _unit(path: Path, fields: dict[str, str], axes: list[int]) -> tuple[str, NDArray[np.float64], tuple[str, ...]]:
    """The unit of lengths, by how much the numbers along the three axes are multiplied to be in it, and notes.

    Units of the space belong to its coordinates, others to the axes of the array. Where a file has neither, one that
    is placed in a patient is in millimetres, as ITK and 3D Slicer mean it.
    """
    name = "spaceunits" if "spaceunits" in fields else "units"
    if name not in fields:
        return "mm" if _is_of_patient(fields) else "", np.ones(3), ()
    words = [quoted or plain for quoted, plain in re.findall(r'"([^"]*)"|(\S+)', fields[name])]
    wanted = list(range(min(3, len(words)))) if name == "spaceunits" else axes[:3]
    if not wanted or max(wanted) >= len(words):
        raise fail(
            path,
            f"the field '{'space units' if name == 'spaceunits' else name}' names {len(words)} units for "
            f"{len(axes)} axes.",
        )
    stated = [parse_unit(words[axis]) for axis in wanted]
    units = [unit for unit, _ in stated]
    unit, factors, notes = common_unit(units + units[:1] * (3 - len(units)))
    return unit, np.array(factors), tuple(dict.fromkeys(note for _, one in stated for note in one)) + notes


def _affine(
    path: Path, fields: dict[str, str], axes: list[int], dimension: int, factors: NDArray[np.float64]
) -> dict[str, Any]:
    """Arguments of :class:`~deformnb.io.volumes.headers.Geometry`, and remarks as "notes"."""
    space = fields.get("space", "").lower()
    if space and space not in _SPACES:
        raise fail(path, f"the space '{printable(space)}' is not supported; save it in left-posterior-superior.")
    signs = np.array(_SPACES.get(space, (1.0, 1.0, 1.0))) * factors
    origin = _vectors(path, "space origin", fields["spaceorigin"])[:1] if "spaceorigin" in fields else []
    corner = _three(path, "space origin", origin[0] if origin else [0.0, 0.0, 0.0])
    if "spacedirections" not in fields:
        known = _spacings(path, fields, axes, dimension, factors)
        return known | ({"origin": triple((signs * corner).tolist())} if origin else {})
    vectors = _vectors(path, "space directions", fields["spacedirections"])
    affine = np.eye(4)
    for column, axis in enumerate(axes[:3]):
        affine[:3, column] = signs * _three(path, "space directions", vectors[axis] or [])
    if len(axes) < 3:  # a single picture: its normal, of length 1
        normal = np.cross(affine[:3, 0], affine[:3, 1])
        affine[:3, 2] = normal / (np.linalg.norm(normal) or 1.0)
    affine[:3, 3] = signs * corner
    return {"affine": affine}


def _three(path: Path, field: str, vector: list[float] | None) -> NDArray[np.float64]:
    if vector is None or len(vector) not in (2, 3, 4):
        raise fail(path, f"the field '{field}' should have vectors of three numbers.")
    return np.array([*vector, 0.0][:3])  # a fourth one is time, of ITK's series


def _spacings(
    path: Path, fields: dict[str, str], axes: list[int], dimension: int, factors: NDArray[np.float64]
) -> dict[str, Any]:
    def per_axis(name: str, shown_name: str, missing: float) -> list[float]:
        if name not in fields:
            return [missing] * 3
        values = floats(path, shown_name, fields[name], dimension)
        return [*(values[axis] for axis in axes), missing, missing][:3]

    spacing = per_axis("spacings", "spacings", 1.0)
    minimum = per_axis("axismins", "axis mins", 0.0)
    centres = fields.get("centers", fields.get("centerings", "")).lower().split()
    if centres and (len(centres) != dimension or not set(centres) <= {"cell", "node", "none", "???"}):
        raise fail(
            path,
            f"the field 'centers' should be {dimension} words, cell or node, but is '{printable(' '.join(centres))}'.",
        )
    # "axis min" is the border of a cell, or the place of a node.
    first = [
        low + (step / 2 if axis < len(centres) and centres[axis] == "cell" else 0.0)
        for low, step, axis in zip(minimum, spacing, [*axes, 99, 99][:3], strict=True)
    ]
    lengths = triple((factors * spacing).tolist())
    if np.isfinite(first).all():
        return {"spacing": lengths, "origin": triple((factors * first).tolist())}
    return {"spacing": lengths, "notes": ("its axis mins are not numbers: the first voxel was put at 0",)}


def write(volume: Volume, path: Path, overwrite: bool, progress: Progress | None) -> None:
    """Write NRRD: gzip in one file, or for .nhdr a header and plain voxels in ``<name>.nhdr.<check sum>.raw``."""
    if path.suffix.lower() == ".nhdr":
        write_pair(
            volume,
            path,
            partial(_header_text, volume, "raw"),
            lambda header: _fields(header).fields.get("datafile"),
            overwrite,
            progress,
        )
    else:
        write_packed(volume, path, _header_text(volume, "gzip"), "gzip", overwrite, progress, header_outside=True)


def series_header(_path: Path, volume: Volume, layout: Layout) -> bytes:
    """The header of channels and moments like this volume: parts of a voxel come first, moments last.

    Moments are of the kind "list", not "time", which ITK takes for a fourth axis in space and refuses.
    """
    return _header_text(volume, "gzip", layout=layout)


def write_segmentation(
    volume: Volume, path: Path, keys: Mapping[str, str], overwrite: bool, progress: Progress | None
) -> None:
    """Write labels with the keys of a segmentation of 3D Slicer (:func:`segment_keys`).

    The box of each segment, which Slicer stores with its number, is computed again.
    """
    known = {
        found[1]: int(value)
        for key, value in keys.items()
        if (found := re.fullmatch(r"(Segment\d+)_LabelValue", key)) and value.isdecimal()
    }
    boxes = {f"{segment}_Extent": _extent(volume, label) for segment, label in known.items()}
    kept = {**keys, **boxes}
    write_packed(
        volume, path, _header_text(volume, "gzip", keys=kept), "gzip", overwrite, progress, header_outside=True
    )


def _extent(volume: Volume, label: int) -> str:
    """First and last index of a label along x, y and z; 0 and -1 where it is not."""
    places = np.nonzero(volume.values == label)
    return " ".join(f"{p.min()} {p.max()}" if len(p) else "0 -1" for p in places[::-1])


def _header_text(
    volume: Volume,
    encoding: str,
    data_file: str | None = None,
    crc: int | None = None,
    *,
    layout: Layout = SINGLE,
    keys: Mapping[str, str] = MappingProxyType({}),
) -> bytes:
    grid = volume.grid
    vectors = " ".join("(" + ",".join(map(repr, column)) + ")" for column in grid.matrix.T.tolist())
    parts, moments = layout.channels > 1, layout.frames > 1
    first = {"rgb": "RGB-color", "rgba": "RGBA-color"}.get(layout.kind, "vector")
    sizes = [layout.channels] * parts + [*volume.shape[::-1]] + [layout.frames] * moments
    lines = [
        "NRRD0005",
        *([] if crc is None else [f"# {detached_proof(crc)}"]),  # a comment: other programs pass keys on to new voxels
        f"type: {_NAMES[stored_dtype(volume).str[1:]]}",
        f"dimension: {len(sizes)}",
        "space: left-posterior-superior",
        "sizes: " + " ".join(map(str, sizes)),
        "space directions: " + "none " * parts + vectors + " none" * moments,
        "kinds: " + f"{first} " * parts + "domain domain domain" + " list" * moments,
        "endian: little",
        f"encoding: {encoding}",
        "space origin: (" + ",".join(map(repr, grid.origin)) + ")",
    ]
    # In millimetres a file states no unit, as ITK and 3D Slicer write it: see _unit.
    lines += [] if grid.unit == "mm" else ["space units: " + " ".join([f'"{grid.unit}"'] * 3)]
    lines += [f"{_LABELS_KEY}:=yes"] if volume.is_labels and not keys else []
    lines += [f"{_CHANNELS_KEY}:={layout_description(layout)}"] if parts else []
    lines += [f"{key}:={value}" for key, value in keys.items()]
    # The data file comes last: in some readers all fields after a detached file's name are lost.
    lines += [f"data file: {data_file}"] if data_file else []
    return ("\n".join(lines) + "\n\n").encode()
