"""DICOM series (read only): one slice per file, sorted by position along their common normal.

Nothing is guessed: several series, mixed geometry, missing or double slices and tilted gantries are named and refused.
Source: DICOM PS3.3, section C.7.6.2 (image plane) and C.11.1 (modality rescale).
"""

from __future__ import annotations

import os
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Float3
from deformnb.errors import DeformError, MissingPackageError, VolumeFileError
from deformnb.io.headers import Header, fail, shown, triple, volume_shape
from deformnb.volume.volume import Matrix3

SUFFIXES = (".dcm", ".dicom", ".ima")

_TAGS = [
    "SOPClassUID", "SOPInstanceUID", "SeriesInstanceUID", "SeriesNumber", "SeriesDescription", "Rows", "Columns",
    "SamplesPerPixel", "PhotometricInterpretation", "BitsAllocated", "BitsStored", "HighBit", "PixelRepresentation",
    "NumberOfFrames", "PixelSpacing", "ImageOrientationPatient", "ImagePositionPatient", "RescaleSlope",
    "RescaleIntercept", "SliceThickness", "SpacingBetweenSlices",
]
_DEFLATED = "1.2.840.10008.1.2.1.99"

_MOST_FILES = 50_000

# Positions are printed with three to six decimals. One percent of a slice distance is beyond that rounding and far
# below a missing slice; voxels then lie at most this much of a slice from where the scanner put them.
_UNEVEN = 0.01

# Orientation cosines are printed with at least four decimals; two slices of one series differ by no more.
_COSINES = 1e-3

# The line of slice positions may lean against the normal by this tangent (0.06 degrees): the rounding of positions of
# 0.001 mm over a few slices. Real gantry tilts are whole degrees.
_TILT = 1e-3


@dataclass(frozen=True)
class _Slice:
    """Header and pixels of one file."""

    path: Path
    uid: str
    series: str
    number: str
    description: str
    shape: tuple[int, int]
    pixel: tuple[float, float]
    cosines: NDArray[np.float64]
    position: NDArray[np.float64]
    dtype: np.dtype[Any]
    scaling: tuple[float, float]
    thickness: float
    inverted: bool

    @property
    def normal(self) -> NDArray[np.float64]:
        return np.cross(self.cosines[:3], self.cosines[3:])

    def alike(self, other: _Slice) -> bool:
        return (self.shape == other.shape and np.allclose(self.cosines, other.cosines, rtol=0, atol=_COSINES)
                and np.allclose(self.pixel, other.pixel, rtol=1e-3))


def _pydicom() -> Any:
    try:
        import pydicom
    except ImportError as error:
        message = "DICOM needs the package pydicom, which is not installed: pip install pydicom"
        raise MissingPackageError(message) from error
    return pydicom


def is_dicom(path: Path) -> bool:
    """Check whether a file has the mark of DICOM after its 128 free bytes."""
    try:
        with path.open("rb") as file:
            return file.read(132)[128:] == b"DICM"
    except OSError:
        return False


def dicom_files(folder: Path) -> list[Path]:
    """All DICOM files in a folder and below, in a fixed order; links to folders are not followed."""
    found: list[Path] = []
    seen = 0
    for where, folders, names in os.walk(folder):
        folders.sort()
        for name in sorted(names):
            seen += 1
            if seen > _MOST_FILES:
                raise fail(folder, f"it holds more than {_MOST_FILES} files; name the folder of the series itself.")
            path = Path(where, name)
            if path.is_file() and is_dicom(path) and name.upper() != "DICOMDIR":
                found.append(path)
    return found


def read_header(path: Path, series: str | int | None = None) -> Header:
    """Geometry and type of a series in a folder, or of one slice."""
    files = dicom_files(path) if path.is_dir() else [path]
    groups = _groups(path, [_read_slice(file) for file in files])
    slices, notes = _unique(path, _select(path, groups, series))
    if not path.is_dir():
        notes += ("one slice was read; name its folder to read the series",)
    return _series_header(path, slices, notes)


def _read(path: Path, *, pixels: bool) -> Any:
    """A pydicom data set; whatever pydicom raises on a damaged file is one error."""
    pydicom = _pydicom()
    if not is_dicom(path):
        raise fail(path, "this is not a DICOM file: it lacks the mark DICM at byte 128.")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # odd values are checked here, one by one
            meta = pydicom.filereader.read_file_meta_info(path)
            if str(meta.get("TransferSyntaxUID", "")) == _DEFLATED:
                raise fail(path, "it is a deflated DICOM file, which may unpack to any size; save it uncompressed.")
            if pixels:
                return pydicom.dcmread(path)
            return pydicom.dcmread(path, stop_before_pixels=True, specific_tags=_TAGS)
    except VolumeFileError:
        raise
    except Exception as error:  # pydicom raises some dozen types on damaged files
        why = shown(error) or type(error).__name__
        raise fail(path, f"this is not a DICOM file or it is damaged ({why}).") from error


def _read_slice(path: Path) -> _Slice:
    data = _read(path, pixels=False)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return _slice(path, data)
    except VolumeFileError:
        raise
    except Exception as error:  # a field may hold anything: text for a number, a list for one value
        raise fail(path, f"a field of its header is damaged ({shown(error) or type(error).__name__}).") from error


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
        raise fail(path, f"the field {name} should be {count} numbers but is {shown(value)}.")
    return array


def _slice(path: Path, data: Any) -> _Slice:
    samples = int(_number(path, data, "SamplesPerPixel", 1))
    photometric = str(data.get("PhotometricInterpretation", "MONOCHROME2"))
    if samples != 1 or photometric not in ("MONOCHROME1", "MONOCHROME2"):
        raise fail(path, f"its pixels are colours ({shown(photometric)}, {samples} samples); save one channel.")
    frames = int(_number(path, data, "NumberOfFrames", 1))
    if frames > 1:
        raise fail(path, f"it holds {frames} frames in one file (enhanced DICOM), which is not supported; "
                         "convert it to NIfTI first, for example with dcm2niix.")
    bits = int(_number(path, data, "BitsAllocated"))
    if bits not in (8, 16, 32):
        raise fail(path, f"pixels of {bits} bits are not supported.")
    shape = int(_number(path, data, "Rows")), int(_number(path, data, "Columns"))
    row_step, column_step = _numbers(path, data, "PixelSpacing", 2)  # between rows first: along y, then along x
    thickness = _number(path, data, "SpacingBetweenSlices", 0) or _number(path, data, "SliceThickness", 0)
    return _Slice(
        path, str(data.get("SOPInstanceUID", "")), str(data.get("SeriesInstanceUID", "")),
        str(data.get("SeriesNumber", "") or ""), str(data.get("SeriesDescription", "") or ""), shape,
        (float(column_step), float(row_step)), _numbers(path, data, "ImageOrientationPatient", 6),
        _numbers(path, data, "ImagePositionPatient", 3),
        np.dtype(f"{'i' if _number(path, data, 'PixelRepresentation', 0) else 'u'}{bits // 8}"),
        (_number(path, data, "RescaleSlope", 1), _number(path, data, "RescaleIntercept", 0)), abs(thickness),
        photometric == "MONOCHROME1",
    )


def _groups(path: Path, slices: list[_Slice]) -> dict[str, list[_Slice]]:
    """Slices by series and, within a series, by orientation and size; the label is what ``series=`` takes."""
    if not slices:
        raise fail(path, "there are no DICOM files in this folder.")
    by_series: dict[str, list[list[_Slice]]] = {}
    for one in slices:
        parts = by_series.setdefault(one.series, [])
        fitting = next((part for part in parts if part[0].alike(one)), None)
        if fitting is None:
            parts.append([one])
        else:
            fitting.append(one)
    numbers = Counter(parts[0][0].number for parts in by_series.values())
    groups: dict[str, list[_Slice]] = {}
    for uid, parts in by_series.items():
        number = parts[0][0].number
        label = number if number and numbers[number] == 1 else uid
        for index, part in enumerate(parts):
            groups[label if len(parts) == 1 else f"{label}/{index + 1}"] = part
    return groups


def _select(path: Path, groups: dict[str, list[_Slice]], series: str | int | None) -> list[_Slice]:
    if series is None and len(groups) == 1:
        return next(iter(groups.values()))
    chosen = str(series)
    matches = [part for label, part in groups.items() if chosen in (label, part[0].series)]
    matches = matches or [part for part in groups.values() if chosen == part[0].description and chosen]
    if series is not None and len(matches) == 1:
        return matches[0]
    kinds = "; ".join(f"series={shown(label)!r}: {len(part)} slices of {part[0].shape[1]} x {part[0].shape[0]}, "
                      f"'{shown(part[0].description, 40)}'" for label, part in list(groups.items())[:20])
    why = "it holds several series or geometries" if series is None else f"there is no one series {shown(chosen)!r}"
    raise fail(path, f"{why}; choose one: {kinds}.")


def _unique(path: Path, slices: list[_Slice]) -> tuple[list[_Slice], tuple[str, ...]]:
    """Slices in the order of their positions; copies of one file are dropped, different ones at one place refused."""
    normal = slices[0].normal
    ordered = sorted(slices, key=lambda one: (float(one.position @ normal), one.path.name))
    kept = ordered[:1]
    for one in ordered[1:]:
        if float((one.position - kept[-1].position) @ normal) > 1e-4:  # positions are printed to 0.001 mm at best
            kept.append(one)
        elif not one.uid or one.uid != kept[-1].uid:
            raise fail(path, f"{shown(kept[-1].path.name)} and {shown(one.path.name)} lie at the same place "
                             f"({_place(one)}): several times, echoes or reconstructions are mixed. Keep one of them.")
    dropped = len(slices) - len(kept)
    return kept, (f"{dropped} files that repeat another were left out",) if dropped else ()


def _place(one: _Slice) -> str:
    return ", ".join(f"{v:g}" for v in one.position)


def _series_header(path: Path, slices: list[_Slice], notes: tuple[str, ...]) -> Header:
    first = slices[0]
    height, width = first.shape
    shape, _ = volume_shape(path, [width, height, len(slices)], first.dtype.itemsize)
    x, y = first.cosines[:3], first.cosines[3:]
    step, more = _step(path, slices)
    direction = np.column_stack([x, y, first.normal])
    rows: Matrix3 = (triple(direction[0].tolist()), triple(direction[1].tolist()), triple(direction[2].tolist()))
    spacing: Float3 = (*first.pixel, step)
    dtype = _result_type(slices)
    if first.inverted:
        more += ("the file shows small values as white; the values are kept as they are",)
    return Header(path, shape, dtype, lambda: _blocks(slices, dtype), spacing, triple(first.position.tolist()), rows,
                  notes=notes + more)


def _step(path: Path, slices: list[_Slice]) -> tuple[float, tuple[str, ...]]:
    """Distance of neighbouring slices, which must be even and straight."""
    if len(slices) == 1:
        if slices[0].thickness > 0:
            return slices[0].thickness, ()
        return 1.0, ("a single slice without thickness: spacing 1 was taken along z",)
    normal = slices[0].normal / (np.linalg.norm(slices[0].normal) or 1.0)
    positions = np.array([one.position for one in slices])
    depths = positions @ normal
    gaps = np.diff(depths)
    middle = float(np.median(gaps))
    uneven = np.flatnonzero(np.abs(gaps - middle) > _UNEVEN * middle)
    if uneven.size:
        index = int(uneven[0])
        missing = f", {round(gaps[index] / middle) - 1} missing" if gaps[index] > 1.5 * middle else ""
        raise fail(path, f"its slices are unevenly spaced: {uneven.size} of {gaps.size} gaps differ from {middle:g}; "
                         f"the first, after {shown(slices[index].path.name)}, is {gaps[index]:g}{missing}. Add the "
                         "missing files or take out the extra ones.")
    line = positions[-1] - positions[0]
    lean = float(np.linalg.norm(line - (line @ normal) * normal) / (depths[-1] - depths[0]))
    if lean > _TILT:
        raise fail(path, f"its slices lean by {np.degrees(np.arctan(lean)):.1f} degrees (tilted gantry): its voxels "
                         "form no straight grid. Resample it first, for example with dcm2niix.")
    return float((depths[-1] - depths[0]) / gaps.size), ()


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
    ends = [slope * end + intercept for slope, intercept in (one.scaling for one in slices)
            for end in (limits.min, limits.max)]
    for name in ("int16", "int32"):
        if np.iinfo(name).min <= min(ends) and max(ends) <= np.iinfo(name).max:
            return np.dtype(name)
    return np.dtype(np.float64)


def _blocks(slices: list[_Slice], dtype: np.dtype[Any]) -> Iterator[NDArray[Any]]:
    for one in slices:
        pixels = _pixels(one)
        slope, intercept = one.scaling
        if (slope, intercept) != (1.0, 0.0):
            pixels = (pixels.astype(np.float64) * slope + intercept)
        yield pixels.astype(dtype, copy=False)[None]


def _pixels(one: _Slice) -> NDArray[Any]:
    data = _read(one.path, pixels=True)
    expected = one.shape[0] * one.shape[1] * one.dtype.itemsize
    try:
        compressed = data.file_meta.TransferSyntaxUID.is_compressed
        present = len(data.PixelData)
    except Exception as error:  # as above: anything may be missing
        raise fail(one.path, f"it has no pixels, or does not state how they are packed ({shown(error)}).") from error
    if not compressed and present not in (expected, expected + expected % 2):  # an odd length is padded to even
        raise fail(one.path, f"the header needs {expected} bytes of pixels but the file has {present}: it is cut "
                             "short or damaged.")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            pixels = np.asarray(data.pixel_array)
    except DeformError:
        raise
    except Exception as error:
        name = shown(getattr(data.file_meta.TransferSyntaxUID, "name", "unknown"), 60)
        raise fail(one.path, f"its pixels ({name}) could not be unpacked: {shown(error, 400)}") from error
    if pixels.shape != one.shape or pixels.dtype.kind not in "iu":
        raise fail(one.path, f"its pixels should be {one.shape} but are {pixels.shape} of {pixels.dtype}.")
    return pixels
