"""DICOM series (read only): slices in separate files or in frames, sorted by position along their common normal.

Nothing is guessed: several series, mixed geometry and double slices are named and refused; so are missing slices and
tilted gantries, unless they are to be resampled (:data:`UNEVEN`). Source: DICOM PS3.3, sections C.7.6.2 (image plane),
C.7.6.16 (functional groups of frames) and C.11.1 (modality rescale).
"""

from __future__ import annotations

import os
import struct
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from deformnb._deferred import ndimage
from deformnb._typing import Float3
from deformnb.errors import DeformError, MissingPackageError, VolumeFileError
from deformnb.io.files.codecs import unpack_picture
from deformnb.io.files.detached import MOST_FILES
from deformnb.io.files.errors import fail, printable
from deformnb.io.volumes.headers import Geometry, Header, triple, volume_shape
from deformnb.volume.volume import Matrix3

DICOM_SUFFIXES = (".dcm", ".dicom", ".ima")

_TAGS = [
    "SOPClassUID",
    "SOPInstanceUID",
    "SeriesInstanceUID",
    "SeriesNumber",
    "SeriesDescription",
    "Rows",
    "Columns",
    "SamplesPerPixel",
    "PhotometricInterpretation",
    "BitsAllocated",
    "BitsStored",
    "HighBit",
    "PixelRepresentation",
    "NumberOfFrames",
    "PixelSpacing",
    "ImageOrientationPatient",
    "ImagePositionPatient",
    "RescaleSlope",
    "RescaleIntercept",
    "SliceThickness",
    "SpacingBetweenSlices",
    "ImagerPixelSpacing",
    "FrameIncrementPointer",
    "GridFrameOffsetVector",
    "SharedFunctionalGroupsSequence",
    "PerFrameFunctionalGroupsSequence",
]

UnevenSlices: TypeAlias = Literal["refuse", "resample"]
"""Names of the rules for uneven slices."""

UNEVEN: tuple[UnevenSlices, ...] = get_args(UnevenSlices)
"""Rules for slices that are missing, unevenly spaced or shifted against each other by a tilted gantry."""

# Transfer syntaxes whose pixels are pictures, by the end of their UID 1.2.840.10008.1.2.4, and their codecs.
_PICTURES = {
    "50": "jpeg8",
    "51": "jpeg8",
    "57": "jpeg8",
    "70": "jpeg8",
    "80": "jpegls",
    "81": "jpegls",
    "90": "jpeg2k",
    "91": "jpeg2k",
    "201": "htj2k",
    "202": "htj2k",
    "203": "htj2k",
}
_PICTURE_UID = "1.2.840.10008.1.2.4."

# A file without the mark begins with a field of the groups 2 or 8, whose first ones are these.
_FIRST_GROUPS, _LAST_FIRST = (2, 8), 0x20
_MOST_FRAMES = 100_000
_DEFLATED = b"1.2.840.10008.1.2.1.99"
_META_BYTES = 4096  # that contain the field of the transfer syntax


# Positions are printed with three to six decimals. One percent of a slice distance is beyond that rounding and far
# below a missing slice; voxels then are at most this much of a slice from their places in the scanner.
_UNEVEN = 0.01

# Orientation cosines are printed with at least four decimals; two slices of one series differ by no more.
_COSINES = 1e-3

# Rounding of positions to 0.001 along each axis, relative to a line whose ends are rounded too.
_ASIDE = 2e-3

# The line of slice positions may lean against the normal by this tangent (0.06 degrees): the rounding of positions of
# 0.001 mm over a few slices. Real gantry tilts are whole degrees.
_TILT = 1e-3


@dataclass(frozen=True)
class _Series:
    """Series that a slice belongs to, as the file names it."""

    uid: str
    number: str
    description: str


@dataclass(frozen=True)
class _Place:
    """Plane of a slice: the directions of its rows and columns, its first pixel and their spacing along x and y."""

    cosines: NDArray[np.float64]
    position: NDArray[np.float64]
    pixel: tuple[float, float]
    thickness: float
    on_detector: bool
    is_assumed: bool = False

    @property
    def normal(self) -> NDArray[np.float64]:
        return np.cross(self.cosines[:3], self.cosines[3:])

    def is_parallel_to(self, other: _Place) -> bool:
        return np.allclose(self.cosines, other.cosines, rtol=0, atol=_COSINES) and np.allclose(
            self.pixel, other.pixel, rtol=1e-3
        )


@dataclass(frozen=True)
class _Slice:
    """Header and pixels of one file."""

    path: Path
    uid: str
    series: _Series
    place: _Place
    shape: tuple[int, int]
    dtype: np.dtype[Any]
    scaling: tuple[float, float]
    inverted: bool
    bits_stored: int
    frames: int = 1
    frame: int = 0


def _pydicom() -> Any:
    try:
        import pydicom
    except ImportError as error:
        message = "DICOM needs the package pydicom, which is not installed: pip install pydicom"
        raise MissingPackageError(message) from error
    return pydicom


def is_dicom(path: Path) -> bool:
    """Check whether a file has the mark of DICOM after its 128 free bytes, or begins with the fields of an old one."""
    try:
        with path.open("rb") as file:
            start = file.read(132)
    except OSError:
        return False
    return start[128:] == b"DICM" or _begins_with_fields(start)


def _begins_with_fields(start: bytes) -> bool:
    if len(start) < 132:
        return False
    group, element, kind, length = struct.unpack_from("<HH2sH", start)
    if group not in _FIRST_GROUPS or element > _LAST_FIRST:
        return False
    if kind in (b"UL", b"UI", b"CS", b"OB", b"SH", b"LO"):
        return bool(length <= 64)
    implicit = struct.unpack_from("<I", start, 4)[0]  # no kind is named: the length of a group, or a text
    text = start[8 : 8 + min(implicit, 64)].rstrip(b"\0")
    return (element == 0 and implicit == 4) or (0 < implicit <= 64 and text.isascii() and text.decode().isprintable())


def dicom_files(folder: Path) -> list[Path]:
    """All DICOM files in a folder and below, in a fixed order; links to folders are not followed."""
    found: list[Path] = []
    seen = 0
    for where, folders, names in os.walk(folder):
        folders.sort()
        for name in sorted(names):
            seen += 1
            if seen > MOST_FILES:
                raise fail(folder, f"it holds more than {MOST_FILES} files; name the folder of the series itself.")
            path = Path(where, name)
            if path.is_file() and is_dicom(path) and name.upper() != "DICOMDIR":
                found.append(path)
    return found


def read_header(path: Path, series: str | int | None = None, uneven_slices: UnevenSlices = "refuse") -> Header:
    """Geometry and type of a series in a folder, or of the slices in one file.

    Parameters
    ----------
    uneven_slices : one of :data:`UNEVEN`.
    """
    if uneven_slices not in UNEVEN:
        raise DeformError(f"uneven_slices is one of {', '.join(UNEVEN)}, got {printable(uneven_slices, 60)}.")
    files = dicom_files(path) if path.is_dir() else [path]
    groups = _groups(path, [one for file in files for one in _read_slices(file)])
    slices, notes = _unique(path, _select(path, groups, series))
    if not path.is_dir() and len(slices) == 1:
        notes += ("one slice was read; name its folder to read the series",)
    return _series_header(path, slices, notes, uneven_slices)


def _read(path: Path, *, pixels: bool) -> Any:
    """A pydicom data set; any exception of pydicom on a damaged file is one error."""
    pydicom = _pydicom()
    if not is_dicom(path):
        raise fail(path, "this is not a DICOM file: it lacks the mark DICM at byte 128.")
    with path.open("rb") as file:
        if _DEFLATED in file.read(_META_BYTES):
            raise fail(path, "it is a deflated DICOM file, which may unpack to any size; save it uncompressed.")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # odd values are checked here, one by one
            data = pydicom.dcmread(
                path, force=True, **({} if pixels else {"stop_before_pixels": True, "specific_tags": _TAGS})
            )
            if "TransferSyntaxUID" not in data.file_meta:  # of a file without the mark: as pydicom found its fields
                uid = pydicom.uid
                data.file_meta.TransferSyntaxUID = (
                    uid.ImplicitVRLittleEndian if data.original_encoding[0] else uid.ExplicitVRLittleEndian
                )
            return data
    except Exception as error:  # pydicom raises some dozen types on damaged files
        why = printable(error) or type(error).__name__
        raise fail(path, f"this is not a DICOM file or it is damaged ({why}).") from error


def _read_slices(path: Path) -> list[_Slice]:
    data = _read(path, pixels=False)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            frames = int(_number(path, data, "NumberOfFrames", 1))
            return [_slice(path, data)] if frames == 1 else _frames(path, data, frames)
    except VolumeFileError:
        raise
    except Exception as error:  # a field may hold anything: text for a number, a list for one value
        raise fail(path, f"a field of its header is damaged ({printable(error) or type(error).__name__}).") from error


def _number(path: Path, data: Any, name: str, missing: float | None = None) -> float:
    value = data.get(name)
    if value is None or value == "":
        if missing is None:
            raise fail(path, f"it lacks the field {name}, so it is no slice of a volume.")
        return missing
    number = float(value)
    if not np.isfinite(number):
        raise fail(path, f"the field {name} is {number}.")
    return number


def _numbers(path: Path, data: Any, name: str, count: int) -> NDArray[np.float64]:
    value = data.get(name)
    array = np.array([float(v) for v in value] if value is not None and not isinstance(value, str) else [])
    if array.shape != (count,) or not np.isfinite(array).all():
        raise fail(path, f"the field {name} should be {count} numbers but is {printable(value)}.")
    return array


def _slice(path: Path, data: Any) -> _Slice:
    samples = int(_number(path, data, "SamplesPerPixel", 1))
    photometric = str(data.get("PhotometricInterpretation", "MONOCHROME2"))
    if samples != 1 or photometric not in ("MONOCHROME1", "MONOCHROME2"):
        raise fail(path, f"its pixels are colours ({printable(photometric)}, {samples} samples); save one channel.")
    bits = int(_number(path, data, "BitsAllocated"))
    stored, high = int(_number(path, data, "BitsStored", bits)), int(_number(path, data, "HighBit", -1))
    if bits not in (8, 16, 32) or not 1 <= stored <= bits or high not in (-1, stored - 1):
        raise fail(path, f"pixels of {stored} of {bits} bits, the highest {high}, are not supported.")
    shape = int(_number(path, data, "Rows")), int(_number(path, data, "Columns"))
    spacing = "PixelSpacing" if data.get("PixelSpacing") or not data.get("ImagerPixelSpacing") else "ImagerPixelSpacing"
    row_step, column_step = _numbers(path, data, spacing, 2)  # between rows first: along y, then along x
    thickness = _number(path, data, "SpacingBetweenSlices", 0) or _number(path, data, "SliceThickness", 0)
    series = (str(data.get(f"Series{name}", "") or "") for name in ("InstanceUID", "Number", "Description"))
    place = _Place(
        _numbers(path, data, "ImageOrientationPatient", 6),
        _numbers(path, data, "ImagePositionPatient", 3),
        (float(column_step), float(row_step)),
        abs(thickness),
        spacing != "PixelSpacing",
    )
    return _Slice(
        path,
        str(data.get("SOPInstanceUID", "")),
        _Series(*series),
        place,
        shape,
        np.dtype(f"{'i' if _number(path, data, 'PixelRepresentation', 0) else 'u'}{bits // 8}"),
        (_number(path, data, "RescaleSlope", 1), _number(path, data, "RescaleIntercept", 0)),
        photometric == "MONOCHROME1",
        stored,
    )


# The fields of a frame and the functional group that holds each, separate or shared by all.
_GROUPS = {
    "ImagePositionPatient": "PlanePositionSequence",
    "ImageOrientationPatient": "PlaneOrientationSequence",
    "PixelSpacing": "PixelMeasuresSequence",
    "SliceThickness": "PixelMeasuresSequence",
    "SpacingBetweenSlices": "PixelMeasuresSequence",
    "RescaleSlope": "PixelValueTransformationSequence",
    "RescaleIntercept": "PixelValueTransformationSequence",
}


class _Frame:
    """The fields of a frame: those of its functional groups, of the groups shared by all frames, else of the file."""

    def __init__(self, data: Any, own: Any) -> None:
        shared = data.get("SharedFunctionalGroupsSequence") or [{}]
        self._places = own, shared[0]
        self._data = data

    def get(self, name: str, missing: Any = None) -> Any:
        """Same as of a data set of pydicom."""
        for place in self._places if name in _GROUPS else ():
            items = place.get(_GROUPS[name])
            if items and items[0].get(name) is not None:
                return items[0].get(name)
        return self._data.get(name, missing)


def _frames(path: Path, data: Any, count: int) -> list[_Slice]:
    """The slices of a file of several frames, whose places are in functional groups, or at one distance."""
    if not 1 <= count <= _MOST_FRAMES:
        raise fail(path, f"it claims {count} frames; the file is damaged.")
    groups = data.get("PerFrameFunctionalGroupsSequence")
    if groups:
        if len(groups) != count:
            raise fail(path, f"it claims {count} frames but describes {len(groups)}; the file is damaged.")
        return [replace(_slice(path, _Frame(data, own)), uid="", frames=count, frame=k) for k, own in enumerate(groups)]
    pointer = str(data.get("FrameIncrementPointer", ""))
    if "0018,106" in pointer:  # FrameTime, FrameTimeVector
        raise fail(path, f"its {count} frames are moments of one slice, and a volume has slices; save one of them.")
    first = _slice(path, data)
    offsets = data.get("GridFrameOffsetVector")
    depths: NDArray[Any]
    if offsets is not None:
        depths = _numbers(path, data, "GridFrameOffsetVector", count)
    elif first.place.thickness > 0:
        depths = first.place.thickness * np.arange(count, dtype=np.float64)
    else:
        raise fail(path, f"its {count} frames have no places and no distance, so they are no slices of a volume.")
    return [
        replace(
            first,
            uid="",
            place=replace(
                first.place, position=first.place.position + depth * first.place.normal, is_assumed=offsets is None
            ),
            frames=count,
            frame=k,
        )
        for k, depth in enumerate(depths)
    ]


def _groups(path: Path, slices: list[_Slice]) -> dict[str, list[_Slice]]:
    """Slices by series and, within a series, by orientation and size; the label is what ``series=`` takes."""
    if not slices:
        raise fail(path, "there are no DICOM files in this folder.")
    by_series: dict[str, list[list[_Slice]]] = {}
    for one in slices:
        parts = by_series.setdefault(one.series.uid, [])
        fitting = next(
            (part for part in parts if part[0].shape == one.shape and part[0].place.is_parallel_to(one.place)), None
        )
        if fitting is None:
            parts.append([one])
        else:
            fitting.append(one)
    numbers = Counter(parts[0][0].series.number for parts in by_series.values())
    groups: dict[str, list[_Slice]] = {}
    for uid, parts in by_series.items():
        number = parts[0][0].series.number
        label = number if number and numbers[number] == 1 else uid
        for index, part in enumerate(parts):
            groups[label if len(parts) == 1 else f"{label}/{index + 1}"] = part
    return groups


def _select(path: Path, groups: dict[str, list[_Slice]], series: str | int | None) -> list[_Slice]:
    if series is None and len(groups) == 1:
        return next(iter(groups.values()))
    chosen = str(series)
    matches = [part for label, part in groups.items() if chosen in (label, part[0].series.uid)]
    matches = matches or [part for part in groups.values() if chosen == part[0].series.description and chosen]
    if series is not None and len(matches) == 1:
        return matches[0]
    kinds = "; ".join(
        f"series={printable(label)!r}: {len(part)} slices of {part[0].shape[1]} x {part[0].shape[0]}, "
        f"'{printable(part[0].series.description, 40)}'"
        for label, part in list(groups.items())[:20]
    )
    why = "it holds several series or geometries" if series is None else f"there is no one series {printable(chosen)!r}"
    raise fail(path, f"{why}; choose one: {kinds}.")


def _unique(path: Path, slices: list[_Slice]) -> tuple[list[_Slice], tuple[str, ...]]:
    """Slices in the order of their positions; copies of one file are dropped, different ones at one place refused."""
    normal = slices[0].place.normal
    ordered = sorted(slices, key=lambda one: (float(one.place.position @ normal), one.path.name))
    kept = ordered[:1]
    for one in ordered[1:]:
        rise = float((one.place.position - kept[-1].place.position) @ normal)
        if rise > 1e-4:  # positions are printed to 0.001 mm at best
            kept.append(one)
        elif not one.uid or one.uid != kept[-1].uid:
            raise fail(
                path,
                f"{_label(kept[-1])} and {_label(one)} are at the same place ({_place(one)}): several "
                "times, echoes or reconstructions are mixed. Keep one of them.",
            )
    dropped = len(slices) - len(kept)
    return kept, (f"{dropped} files that repeat another were left out",) if dropped else ()


def _label(one: _Slice) -> str:
    return printable(one.path.name) + (f" frame {one.frame + 1}" if one.frames > 1 else "")


def _place(one: _Slice) -> str:
    return ", ".join(f"{v:g}" for v in one.place.position)


def _series_header(path: Path, slices: list[_Slice], notes: tuple[str, ...], uneven_slices: UnevenSlices) -> Header:
    first = slices[0]
    height, width = first.shape
    x, y = first.place.cosines[:3], first.place.cosines[3:]
    step, depths, why = _step(slices)
    if why and uneven_slices == "refuse":
        raise fail(path, f'{why} Or read it with uneven_slices="resample".')
    count = round(depths[-1] / step) + 1 if why else len(slices)
    shape, _ = volume_shape(path, [width, height, count], first.dtype.itemsize)
    direction = np.column_stack([x, y, first.place.normal])
    rows: Matrix3 = (triple(direction[0].tolist()), triple(direction[1].tolist()), triple(direction[2].tolist()))
    spacing: Float3 = (*first.place.pixel, step)
    dtype = _result_type(slices)
    notes += _remarks(slices)
    if why:
        notes += (f"{len(slices)} uneven or leaning slices were resampled linearly to {count}, {step:.4g} apart",)

    def blocks() -> Iterator[NDArray[Any]]:
        return _resample(slices, dtype, depths, step, count) if why else _blocks(slices, dtype)

    return Header(
        path,
        shape,
        dtype,
        blocks,
        Geometry(spacing, triple(first.place.position.tolist()), rows, is_anatomical=True),
        notes=notes,
        unit="mm",
        working_bytes=max(2 * one.path.stat().st_size for one in slices) if first.frames > 1 else 0,
    )


def _remarks(slices: list[_Slice]) -> tuple[str, ...]:
    notes: tuple[str, ...] = ()
    first = slices[0]
    if any(one.inverted for one in slices):
        notes += ("the file shows small values as white; the values are unchanged",)
    if any(one.place.is_assumed for one in slices):
        notes += (
            f"its {len(slices)} frames state no places: they were taken as slices {first.place.thickness:g} apart",
        )
    if any(one.place.on_detector for one in slices):
        notes += ("its spacing is that on the detector (ImagerPixelSpacing), which is larger than in the body",)
    if len(slices) == 1 and first.place.thickness <= 0:
        notes += ("a single slice without thickness: spacing 1 was taken along z",)
    return notes


def _step(slices: list[_Slice]) -> tuple[float, NDArray[np.float64], str]:
    """Distance of slices, of uneven ones so that the first and the last do not move; their depths from the first;
    and why they form no straight grid, if they do not.
    """
    if len(slices) == 1:
        return slices[0].place.thickness if slices[0].place.thickness > 0 else 1.0, np.zeros(1), ""
    normal = slices[0].place.normal / (np.linalg.norm(slices[0].place.normal) or 1.0)
    positions = np.array([one.place.position for one in slices])
    depths = positions @ normal
    gaps = np.diff(depths)
    middle = float(np.median(gaps))
    depths = depths - depths[0]
    uneven = np.flatnonzero(np.abs(gaps - middle) > _UNEVEN * middle)
    if uneven.size:
        index = int(uneven[0])
        missing = f", {round(gaps[index] / middle) - 1} missing" if gaps[index] > 1.5 * middle else ""
        return (
            float(depths[-1] / max(1, round(depths[-1] / middle))),
            depths,
            (
                f"its slices are unevenly spaced: {uneven.size} of {gaps.size} gaps differ from {middle:g}; the first, "
                f"after {_label(slices[index])}, is {gaps[index]:g}{missing}. Add the missing files or "
                "take out the extra ones."
            ),
        )
    line = positions[-1] - positions[0]
    lean = float(np.linalg.norm(line - (line @ normal) * normal) / depths[-1])
    step = float(depths[-1] / gaps.size)
    if lean > _TILT:
        return (
            step,
            depths,
            (
                f"its slices lean by {np.degrees(np.arctan(lean)):.1f} degrees (tilted gantry): its voxels form no "
                "straight grid. Resample it first, for example with dcm2niix."
            ),
        )
    aside = np.linalg.norm(positions - positions[0] - np.outer(depths / depths[-1], line), axis=1)
    if aside.max() > max(_ASIDE, _UNEVEN * max(slices[0].place.pixel)):
        return (
            step,
            depths,
            (
                f"its slices are on no straight line: {_label(slices[int(aside.argmax())])} is {aside.max():g} off "
                "that of the first and the last."
            ),
        )
    return step, depths, ""


def _resample(
    slices: list[_Slice], dtype: np.dtype[Any], depths: NDArray[np.float64], step: float, count: int
) -> Iterator[NDArray[Any]]:
    """Slices of a straight, even grid: between two neighbours linearly in depth, and within each plane by its shift."""
    planes = _straighten(slices, dtype, depths)
    below, above, at = next(planes), next(planes, None), 0
    for number in range(count):
        depth = number * step
        while above is not None and depths[at + 1] <= depth + 1e-6 * step:
            below, above, at = above, next(planes, None), at + 1
        plane = below
        if above is not None and depth > depths[at] + 1e-6 * step:
            share = (depth - depths[at]) / (depths[at + 1] - depths[at])
            plane = (1 - share) * below + share * above
        yield (np.rint(plane) if dtype.kind in "iu" else plane).astype(dtype)[None]


def _straighten(slices: list[_Slice], dtype: np.dtype[Any], depths: NDArray[np.float64]) -> Iterator[NDArray[Any]]:
    """The slices, each moved within its plane to where the line along the normal through the first one meets it."""
    first = slices[0]
    for one, depth, block in zip(slices, depths, _blocks(slices, dtype), strict=True):
        away = one.place.position - first.place.position - depth * first.place.normal
        shift = first.place.cosines.reshape(2, 3)[::-1] @ away / first.place.pixel[::-1]  # in rows and columns
        plane = block[0].astype(np.float64)
        if np.abs(shift).max() > 1e-3:
            moved = ndimage.shift(plane, shift, order=1, mode="nearest")
            for axis, (size, by) in enumerate(zip(plane.shape, shift, strict=True)):
                index = np.arange(size) - by  # beyond half a voxel outside there is nothing
                np.moveaxis(moved, axis, 0)[(index < -0.5) | (index > size - 0.5)] = plane.min()
            plane = moved
        yield plane


def _result_type(slices: list[_Slice]) -> np.dtype[Any]:
    """The smallest whole type for values after rescaling, as far as the headers determine it; else float32."""
    stored = slices[0].dtype
    for one in slices:
        if one.dtype != stored:
            stored = np.result_type(stored, one.dtype)
    if all(one.scaling == (1.0, 0.0) for one in slices):
        return stored
    if any(value != int(value) for one in slices for value in one.scaling):
        return np.dtype(np.float32) if stored.itemsize < 4 else np.dtype(np.float64)
    limits = np.iinfo(stored)
    ends = [
        slope * end + intercept
        for slope, intercept in (one.scaling for one in slices)
        for end in (limits.min, limits.max)
    ]
    for name in ("int16", "int32"):
        if np.iinfo(name).min <= min(ends) and max(ends) <= np.iinfo(name).max:
            return np.dtype(name)
    return np.dtype(np.float64)


def _blocks(slices: list[_Slice], dtype: np.dtype[Any]) -> Iterator[NDArray[Any]]:
    path, frames = None, None
    for one in slices:
        if frames is None or one.path != path:
            path, frames = one.path, _pixels(one)
        pixels = frames(one.frame)
        if pixels.shape != one.shape or pixels.dtype.kind not in "iu":
            raise fail(one.path, f"its pixels should be {one.shape} but are {pixels.shape} of {pixels.dtype}.")
        slope, intercept = one.scaling
        if (slope, intercept) != (1.0, 0.0):
            pixels = pixels.astype(np.float64) * slope + intercept
        yield pixels.astype(dtype, copy=False)[None]


def _pixels(one: _Slice) -> Callable[[int], NDArray[Any]]:
    """The function that gives the pixels of a frame of a slice's file."""
    data = _read(one.path, pixels=True)
    expected = one.shape[0] * one.shape[1] * one.dtype.itemsize * one.frames
    try:
        syntax = data.file_meta.TransferSyntaxUID
        compressed, present = syntax.is_compressed, len(data.PixelData)
    except Exception as error:  # as above: anything may be missing
        raise fail(
            one.path, f"it has no pixels, or does not state how they are packed ({printable(error)})."
        ) from error
    if not compressed and present not in (expected, expected + expected % 2):  # an odd length is padded to even
        raise fail(
            one.path,
            f"the header needs {expected} bytes of pixels but the file has {present}: it is cut short or damaged.",
        )
    with _unpacking(one, syntax):
        if syntax.startswith(_PICTURE_UID) and syntax[len(_PICTURE_UID) :] in _PICTURES:
            return _pictures(one, data, _PICTURES[syntax[len(_PICTURE_UID) :]])
        whole = None if compressed else np.asarray(data.pixel_array).reshape(one.frames, *one.shape)

    def frame(number: int) -> NDArray[Any]:
        with _unpacking(one, syntax):
            if whole is not None:
                return whole[number]
            return np.asarray(_pydicom().pixels.pixel_array(data, index=number if one.frames > 1 else None))

    return frame


@contextmanager
def _unpacking(one: _Slice, syntax: Any) -> Iterator[None]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except (MissingPackageError, VolumeFileError):
        raise
    except Exception as error:
        name = printable(getattr(syntax, "name", "unknown"), 60)
        raise fail(one.path, f"its pixels ({name}) could not be unpacked: {printable(error, 400)}") from error


def _pictures(one: _Slice, data: Any, codec: str) -> Callable[[int], NDArray[Any]]:
    """The frames of a file that are coded pictures."""
    pydicom = _pydicom()
    coded = list(pydicom.encaps.generate_frames(data.PixelData, number_of_frames=one.frames))
    if len(coded) != one.frames:
        raise fail(one.path, f"it claims {one.frames} frames but has {len(coded)} coded pictures.")

    def frame(number: int) -> NDArray[Any]:
        with _unpacking(one, data.file_meta.TransferSyntaxUID):
            return _sign_extend(one, _picture(one, codec, bytes(coded[number])))

    return frame


def _picture(one: _Slice, codec: str, coded: bytes) -> NDArray[Any]:
    """A coded picture, whose own header decides on its type: of fewer bits it may be of single bytes."""
    why = ValueError("there is no type of pixels")
    for name in dict.fromkeys((f"u{one.dtype.itemsize}", f"i{one.dtype.itemsize}", "u1", "i1", "u2", "i2")):
        try:
            return unpack_picture(codec, coded, one.shape, np.dtype(name))
        except MissingPackageError:
            raise
        except ValueError as error:
            why = error if "dtype" not in str(error) or name[1] == str(one.dtype.itemsize) else why
            if "dtype" not in str(error):
                break
    raise why


def _sign_extend(one: _Slice, pixels: NDArray[Any]) -> NDArray[Any]:
    """Pixels in the type of the header: codecs without a sign store the lower bits of numbers that have one."""
    found = pixels.astype(one.dtype)
    if one.dtype.kind == "u" or pixels.dtype.kind == "i":
        return found
    left = 8 * one.dtype.itemsize - one.bits_stored
    return np.right_shift(np.left_shift(found, left), left)
