"""NIfTI-1 and NIfTI-2 in one file (.nii, .nii.gz).

One rule decides the place of the voxels: the sform if its code is above 0, else the qform if its code is above 0, else
the voxel sizes alone with the axes right, anterior, superior (methods 3, 2 and 1 of the standard). NIfTI is RAS: x and
y change sign on reading and writing. Source: the headers nifti1.h and nifti2.h of the NIfTI standard.
"""

from __future__ import annotations

import math
import struct
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._deferred import scipy
from deformnb._typing import Float3, Progress
from deformnb.errors import VolumeFileError
from deformnb.io.files.errors import fail
from deformnb.io.files.streams import take
from deformnb.io.volumes.headers import SINGLE, Geometry, Header, Layout, check_layout, triple, volume_shape
from deformnb.io.volumes.voxels import Source, layout_blocks, write_packed
from deformnb.volume.volume import IDENTITY, LPS_TO_RAS, NIFTI_UNITS, Grid, Matrix3, Volume

_TYPES = {2: "u1", 4: "i2", 8: "i4", 16: "f4", 64: "f8", 256: "i1", 512: "u2", 768: "u4", 1024: "i8", 1280: "u8"}
_CODES = {np.dtype(name): code for code, name in _TYPES.items()} | {np.dtype(bool): 2}
_REFUSED = {
    1: "single bits",
    32: "complex numbers",
    1536: "128-bit floats",
    1792: "complex numbers",
    2048: "complex numbers",
}
_COLOURS = {128: "rgb", 2304: "rgba"}  # of one byte for each part, one after the other

LABEL_INTENT = 1002  # NIFTI_INTENT_LABEL: voxels are names of regions
_CHANNELS_NAME = b"channels"  # intent_name of channels that are no vector: NIfTI has no other intent for them
_VECTOR_INTENT = 1007  # NIFTI_INTENT_VECTOR: the fifth axis are parts of one voxel
_DISPLACEMENT_INTENT = 1006  # NIFTI_INTENT_DISPVECT: vectors of displacements
_VECTOR_INTENTS = (_DISPLACEMENT_INTENT, _VECTOR_INTENT)
_UNITS = {code: unit for unit, code in NIFTI_UNITS.items()}
_LARGEST = 32767  # NIfTI-1 stores sizes in 16 bits
FIRST_VOXEL = 352

# Extensions (text of other programs) may precede the voxels; more than this is no extension but a damaged header.
MOST_EXTENSIONS = 2**26


@dataclass(frozen=True)
class _Fields:
    """The fields in use, of either version."""

    dim: tuple[int, ...]
    pixdim: tuple[float, ...]
    datatype: int
    vox_offset: float
    scaling: tuple[float, float]
    codes: tuple[int, int]  # qform, sform
    quatern: tuple[float, ...]  # b, c, d and the offsets of x, y, z
    srow: tuple[float, ...]
    intent: int
    intent_name: bytes
    units: int
    order: str
    bits: int


def _fields(path: Path, data: bytes) -> _Fields:
    for order in "<>":
        size = struct.unpack_from(order + "i", data)[0] if len(data) >= 4 else 0
        at = _reader(data, order)
        if size == 348 and len(data) >= 352:
            if data[344:347] not in (b"n+1", b"ni1"):
                raise fail(
                    path,
                    "this is Analyze 7.5 or a damaged NIfTI file (no NIfTI mark at byte 344); "
                    "Analyze does not state which side is left. Convert it to NIfTI first.",
                )
            if data[344:347] == b"ni1":
                raise fail(path, "this is the header of a pair .hdr and .img; save both as one .nii file.")
            return _Fields(
                at("8h", 40),
                at("8f", 76),
                at("h", 70)[0],
                at("f", 108)[0],
                at("2f", 112),
                at("2h", 252),
                at("6f", 256),
                at("12f", 280),
                at("h", 68)[0],
                _name(data, 328),
                data[123],
                order,
                at("h", 72)[0],
            )
        if size == 540 and len(data) >= 544:
            if data[4:7] != b"n+2":
                raise fail(path, "this is a damaged NIfTI-2 file or the header of a pair (no n+2 mark at byte 4).")
            return _Fields(
                at("8q", 16),
                at("8d", 104),
                at("h", 12)[0],
                float(at("q", 168)[0]),
                at("2d", 176),
                at("2i", 344),
                at("6d", 352),
                at("12d", 400),
                at("i", 504)[0],
                _name(data, 508),
                at("i", 500)[0] & 255,
                order,
                at("h", 14)[0],
            )
    raise fail(
        path,
        f"this is not a NIfTI file: it has {len(data)} bytes where a header should be, or the header's "
        "own size is neither 348 nor 540.",
    )


def _name(data: bytes, offset: int) -> bytes:
    return data[offset : offset + 16].partition(b"\0")[0]


def _reader(data: bytes, order: str) -> Any:
    return lambda form, offset: struct.unpack_from(order + form, data, offset)


def _stored_fields(path: Path) -> tuple[_Fields, bool]:
    """The fields of a file, and whether it is packed."""
    with path.open("rb") as file:
        packed = file.read(2) == b"\x1f\x8b"  # the content of the file counts, not its name
    source = Source(path, encoding="gzip" if packed else "raw")
    with closing(source.open()) as stream:
        return _fields(path, take(stream, 544)), packed


def has_ras_vectors(path: Path) -> bool:
    """Check whether the vectors of a file have components in RAS, as displacements have; ITK stores others in LPS."""
    return _stored_fields(path)[0].intent == _DISPLACEMENT_INTENT


def read_header(path: Path) -> Header:
    """Geometry, type and place of the voxels of a NIfTI file."""
    fields, packed = _stored_fields(path)
    if fields.datatype in _REFUSED:
        raise fail(path, f"its voxels are {_REFUSED[fields.datatype]}; save one real number per voxel.")
    colours = _COLOURS.get(fields.datatype)
    if fields.datatype not in _TYPES and not colours:
        raise fail(path, f"the field 'datatype' is {fields.datatype}, which NIfTI does not define.")
    dtype = np.dtype(fields.order + _TYPES.get(fields.datatype, "u1"))
    axes = fields.dim[0]
    if not 1 <= axes <= 7:
        raise fail(path, f"the field 'dim' starts with {axes} axes; a volume has 3.")
    sizes, notes = _sizes(list(fields.dim[1 : 1 + axes]))
    layout = _layout(path, sizes, colours, fields)
    shape, more = volume_shape(path, sizes[:3], dtype.itemsize)
    notes += more
    offset = _offset(path, fields.vox_offset)
    source = Source(path, skip=offset, encoding="gzip") if packed else Source(path, offset)
    slope, intercept, scale_notes = _scaling(path, fields.scaling)
    bits = 8 * dtype.itemsize * (len(colours) if colours else 1)
    if fields.bits != bits:
        notes += (f"bitpix is {fields.bits}, and voxels of this datatype have {bits} bits, which counts",)
    affine, place_notes = _affine(path, fields)
    spacing = triple(list(fields.pixdim[1:4]))
    direction, origin = _qform(path, fields) if affine is None else (IDENTITY, (0.0, 0.0, 0.0))
    code = fields.units & 7
    if code not in _UNITS:
        notes += (f"the code {code} of its unit of lengths is none of NIfTI; its numbers stay as they are",)
    blocks = layout_blocks(source, shape, dtype, layout)
    return Header(
        path,
        shape,
        dtype,
        blocks,
        Geometry(spacing, origin, direction, affine, is_anatomical=max(fields.codes) > 0),
        slope,
        intercept,
        is_labels=True if fields.intent == LABEL_INTENT else None,
        notes=notes + scale_notes + place_notes,
        layout=layout,
        unit=_UNITS.get(code, ""),
    )


def _sizes(sizes: list[int]) -> tuple[list[int], tuple[str, ...]]:
    """The sizes of the axes; a 0 behind those of a volume means that there is no such axis."""
    last = next((k for k in range(3, len(sizes)) if sizes[k] == 0), len(sizes))
    if last < len(sizes) and not any(sizes[last:]):
        return sizes[:last], (f"the header counts {len(sizes)} axes, of which the last have size 0; {last} were read",)
    return sizes, ()


def _layout(path: Path, sizes: list[int], colours: str | None, fields: _Fields) -> Layout:
    """Moments along the fourth axis or channels along the fifth; ITK, ANTs and FSL write vectors so."""
    frames, channels = (*sizes[3:5], 1, 1)[:2]
    if any(size != 1 for size in sizes[5:]) or (channels > 1 and (frames > 1 or colours)):
        volume_shape(path, sizes, 1)  # which lists the axes
    duration = fields.pixdim[4] if len(fields.pixdim) > 4 and math.isfinite(fields.pixdim[4]) else 0.0
    if colours:
        return check_layout(path, Layout(frames, len(colours), colours, interleaved=True, duration=duration))
    is_vector = channels > 1 and fields.intent in _VECTOR_INTENTS and fields.intent_name != _CHANNELS_NAME
    return check_layout(path, Layout(frames, channels, duration=duration, is_vector=is_vector))


def _offset(path: Path, offset: float) -> int:
    if not (math.isfinite(offset) and offset == int(offset) and FIRST_VOXEL <= offset <= MOST_EXTENSIONS):
        raise fail(path, f"the field 'vox_offset' is {offset}; it should be a whole number from {FIRST_VOXEL} on.")
    return int(offset)


def _scaling(path: Path, scaling: tuple[float, float]) -> tuple[float, float, tuple[str, ...]]:
    """Slope and intercept of the values, and a remark where they are not used."""
    slope, intercept = scaling
    if slope == 0 or math.isnan(slope):  # "not scaled" in the standard, and in nibabel
        unused = not (intercept == 0 or math.isnan(intercept))
        note = f"scl_slope is {slope:g}, so the values are not scaled and scl_inter {intercept:g} is not used"
        return 1.0, 0.0, (note,) if unused else ()
    if not (math.isfinite(slope) and math.isfinite(intercept)):
        raise fail(path, f"the fields 'scl_slope' and 'scl_inter' are {slope} and {intercept}; they must be finite.")
    return slope, intercept, ()


def _affine(path: Path, fields: _Fields) -> tuple[NDArray[np.float64] | None, tuple[str, ...]]:
    """The sform as an LPS affine if it counts, and remarks on the place of the volume."""
    qform_code, sform_code = fields.codes
    notes = tuple(
        f"the {name}_code {code} is none that NIfTI defines; it counts as {'a' if code > 0 else 'no'} place"
        for name, code in zip(("qform", "sform"), fields.codes, strict=True)
        if not 0 <= code <= 5
    )
    if sform_code <= 0:
        if qform_code > 0:
            turned = fields.pixdim[0]
            return None, notes if turned in (-1.0, 1.0) else (
                *notes,
                f"pixdim[0] is {turned:g}, neither -1 nor 1: its sign counts, and 0 as 1",
            )
        unplaced = "the file states no place of the volume: its axes were taken as right, anterior, superior"
        return None, (*notes, unplaced)
    affine = np.vstack([np.reshape(fields.srow, (3, 4)), [0, 0, 0, 1]]).astype(np.float64)
    if not np.isfinite(affine).all():
        raise fail(path, f"the sform (srow_x, srow_y, srow_z) is not finite: {affine[:3].tolist()}.")
    if not affine[:3, :3].any() and qform_code > 0:  # programs that know no sform leave zeros under a code
        return None, (*notes, "the sform is all zeros; the qform is used")
    differs = _difference(path, fields, affine)
    return LPS_TO_RAS @ affine, (*notes, differs) if differs else notes


def _difference(path: Path, fields: _Fields, affine: NDArray[np.float64]) -> str:
    """A remark on other places that the file states besides its sform, if they differ."""
    if fields.codes[0] <= 0:
        same = np.allclose(np.linalg.norm(affine[:3, :3], axis=0), fields.pixdim[1:4], rtol=1e-3)
        sizes = _number_list(fields.pixdim[1:4])
        return "" if same else f"the voxel sizes {sizes} are not those of the sform, which is used"
    try:
        direction, origin = _qform(path, fields)
    except VolumeFileError:
        return "the qform is damaged; the sform is used"
    matrix = np.asarray(direction) * np.asarray(fields.pixdim[1:4])
    both = LPS_TO_RAS @ np.column_stack([np.vstack([matrix, [0, 0, 0]]), [*origin, 1]])
    # float32 numbers and quaternions with four digits differ by this much without meaning anything else
    same = np.allclose(both, affine, rtol=1e-3, atol=1e-2 * float(np.abs(affine[:3, :3]).max()))
    return "" if same else "the file holds two different places (qform and sform); the sform is used"


def _number_list(numbers: tuple[float, ...]) -> str:
    return ", ".join(f"{number:g}" for number in numbers)


def _qform(path: Path, fields: _Fields) -> tuple[Matrix3, Float3]:
    """Direction and origin in LPS of the qform, or of the bare axes if it does not count."""
    if fields.codes[0] <= 0:
        return ((-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)), (0.0, 0.0, 0.0)
    b, c, d, x, y, z = fields.quatern
    length = math.sqrt(b * b + c * c + d * d)
    if not math.isfinite(length):
        raise fail(path, f"the qform's quaternion is not finite: {fields.quatern[:3]}.")
    if length > 1.001:
        raise fail(path, f"the qform's quaternion has the length {length:g}, and that of a rotation is at most 1.")
    if length > 1:  # rounding of a turn by 180 degrees; the standard scales it back too
        b, c, d = b / length, c / length, d / length
    a = math.sqrt(max(0.0, 1 - (b * b + c * c + d * d)))
    turn = np.array(
        [
            [a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
            [2 * (b * c + a * d), a * a + c * c - b * b - d * d, 2 * (c * d - a * b)],
            [2 * (b * d - a * c), 2 * (c * d + a * b), a * a + d * d - b * b - c * c],
        ]
    )
    turn[:, 2] *= -1 if fields.pixdim[0] < 0 else 1
    rows: Matrix3 = tuple(tuple(row) for row in (LPS_TO_RAS[:3, :3] @ turn).tolist())  # type: ignore[assignment]
    return rows, (-x, -y, z)


def series_header(path: Path, volume: Volume, layout: Layout) -> bytes:
    """The header of channels or moments like this volume; the fifth axis are channels, the fourth moments."""
    if layout.channels > 1 and layout.frames > 1 and layout.kind == "channels":
        raise fail(
            path,
            "NIfTI holds the channels of all moments one after the other, which cannot be written moment "
            "by moment; write .nrrd or .mha.",
        )
    if layout.kind != "channels" and volume.dtype != np.uint8:
        raise fail(path, f"colours in NIfTI are bytes, and these are {volume.dtype}; write .nrrd or .mha.")
    check_size(path, volume, max(layout.frames, layout.channels))
    return _packed_header(volume, layout)


def check_size(path: Path, volume: Volume, most: int = 1) -> None:
    """Refuse volumes that NIfTI-1 cannot hold: more than its 16 bits along an axis, lengths beyond float32."""
    longest = max(*volume.shape, most)
    if longest > _LARGEST:
        raise fail(
            path,
            f"NIfTI-1 has at most {_LARGEST} voxels along an axis, this volume has {longest}; write .nrrd instead.",
        )
    check_float32(path, volume.grid)


def _packed_header(volume: Volume, layout: Layout = SINGLE) -> bytes:
    grid = volume.grid
    is_colour = layout.kind != "channels"
    channels = 1 if is_colour else layout.channels
    code = next(code for code, kind in _COLOURS.items() if kind == layout.kind) if is_colour else _CODES[volume.dtype]
    intent = _VECTOR_INTENT if channels > 1 else LABEL_INTENT if volume.is_labels else 0
    axes = 5 if channels > 1 else 4 if layout.frames > 1 else 3
    affine = LPS_TO_RAS @ grid.affine
    turn = LPS_TO_RAS[:3, :3] @ np.asarray(grid.direction)
    flip = -1.0 if np.linalg.det(turn) < 0 else 1.0
    header = bytearray(FIRST_VOXEL)

    def put(form: str, offset: int, *values: float) -> None:
        struct.pack_into("<" + form, header, offset, *values)

    put("i", 0, 348)
    put("8h", 40, axes, *volume.shape[::-1], layout.frames, channels, 1, 1)
    put("3h", 68, intent, code, 8 * volume.dtype.itemsize * (layout.channels if is_colour else 1))
    put("8f", 76, flip, *grid.spacing, layout.duration, 0, 0, 0)
    put("3f", 108, FIRST_VOXEL, 1, 0)
    put("B", 123, NIFTI_UNITS[grid.unit] + 8 * (layout.frames > 1))  # and seconds
    put("2h", 252, 1, 1)
    put("6f", 256, *_quaternion(turn * [1, 1, flip]), *affine[:3, 3])
    put("12f", 280, *affine[:3].ravel())
    if channels > 1:
        header[328 : 328 + len(_CHANNELS_NAME)] = _CHANNELS_NAME
    header[344:348] = b"n+1\0"
    return bytes(header)


def _quaternion(turn: NDArray[np.float64]) -> tuple[float, float, float]:
    """b, c, d of the unit quaternion with a >= 0 of a rotation matrix."""
    b, c, d, a = scipy.spatial.transform.Rotation.from_matrix(turn).as_quat()
    sign = -1.0 if a < 0 else 1.0
    return sign * b, sign * c, sign * d


def write(volume: Volume, path: Path, overwrite: bool, progress: Progress | None) -> None:
    """Write NIfTI-1; sform and qform are the same, lengths in a unit of NIfTI, bool becomes uint8."""
    check_size(path, volume)
    encoding = "gzip" if path.suffix.lower() == ".gz" else "raw"
    write_packed(volume, path, _packed_header(volume), encoding, overwrite, progress)


def check_float32(path: Path, grid: Grid) -> None:
    """Refuse lengths that the float32 numbers of NIfTI-1 would turn into zero or infinity."""
    with np.errstate(over="ignore", under="ignore"):
        lengths, origin = (np.asarray(v).astype(np.float32) for v in (grid.spacing, grid.origin))
        if not (np.isfinite(lengths).all() and (lengths > 1e-37).all() and np.isfinite(origin).all()):
            raise fail(
                path,
                f"the spacing {grid.spacing} or origin {grid.origin} does not fit into NIfTI-1; write .nrrd instead.",
            )
