"""Registry of volume formats: one function to read, one to write."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Float3, Progress, Spacing
from deformnb.checks import is_finite, short_value
from deformnb.errors import DeformError, UnknownKindError, VolumeFileError
from deformnb.io.files import zarr_copy
from deformnb.io.files.addresses import input_path, split_progress
from deformnb.io.files.atomic import check_target
from deformnb.io.files.errors import Damage, fail, human_bytes, printable
from deformnb.io.files.memory import default_limit
from deformnb.io.files.objects import copied_from_disk, copied_to_disk, is_open_file, name_for
from deformnb.io.files.paths import as_path, regular_file
from deformnb.io.volumes import dicom, images, metaimage, nifti, nrrd, ome_zarr, raw, tiff, vti
from deformnb.io.volumes.dicom import UnevenSlices
from deformnb.io.volumes.headers import SINGLE, Header
from deformnb.volume.channels import luma
from deformnb.volume.known_spacings import known_spacing
from deformnb.volume.units import check_unit
from deformnb.volume.volume import (
    NIFTI_UNITS,
    Grid,
    PyramidLevel,
    Volume,
    VolumeLike,
    as_spacing,
    as_volume,
    voxel_checksum,
)

Writer = Callable[[Volume, Path, bool, Progress | None], None]


@dataclass(frozen=True)
class Format:
    """One kind of volume file.

    Parameters
    ----------
    suffixes : endings of file names, lower case, the usual one first.
    header : reads everything but the voxels.
    write : writes (volume, path, overwrite, progress), None where a format is only read.
    description : for people.
    folder_marks : for a format that is a folder: names of files of which each such folder has one.
    units : of lengths in which it is written; None for any. A volume in another one is written in millimetres, which
        programs mean where a format has no room for a unit, or where they do not read it (NRRD).

    Examples
    --------
    >>> FORMATS["nrrd"].suffixes
    ('.nrrd', '.nhdr')
    """

    suffixes: tuple[str, ...]
    header: Callable[[Path], Header]
    write: Writer | None
    description: str
    folder_marks: tuple[str, ...] = ()
    units: tuple[str, ...] | None = ("mm",)

    def written_unit(self, unit: str) -> str:
        """The unit in which lengths of this one are written; an unknown unit stays unknown.

        Examples
        --------
        >>> FORMATS["tiff"].written_unit("nm"), FORMATS["nifti"].written_unit("nm")
        ('nm', 'mm')
        """
        return unit if not unit or self.units is None or unit in self.units else "mm"


FORMATS: dict[str, Format] = {
    "nifti": Format(
        (".nii.gz", ".nii"), nifti.read_header, nifti.write, "NIfTI-1 and NIfTI-2 in one file", units=tuple(NIFTI_UNITS)
    ),
    "nrrd": Format((".nrrd", ".nhdr"), nrrd.read_header, nrrd.write, "NRRD, attached or detached"),
    "metaimage": Format((".mha", ".mhd"), metaimage.read_header, metaimage.write, "MetaImage, attached or detached"),
    "vti": Format((".vti",), vti.read_header, vti.write, "VTK image data (XML)"),
    "numpy": Format(
        (".npy",), raw.read_npy_header, raw.write_npy, "NumPy array, with a side file .npy.json", units=None
    ),
    "raw": Format((".raw",), raw.read_raw_header, raw.write_raw, "plain voxels with a side file .raw.json", units=None),
    "zarr": Format(
        (ome_zarr.ZARR_SUFFIX,),
        ome_zarr.read_header,
        ome_zarr.write,
        "OME-Zarr pyramid, a folder",
        zarr_copy.MARKS,
        None,
    ),
    "tiff": Format(
        tiff.TIFF_SUFFIXES,
        tiff.read_header,
        tiff.write,
        "TIFF stack (written as OME-TIFF), or a folder of slices",
        units=None,
    ),
    "image": Format(images.IMAGE_SUFFIXES, images.read_header, images.write, "picture, as a volume of one slice"),
    "dicom": Format(dicom.DICOM_SUFFIXES, dicom.read_header, None, "DICOM slice, or a folder with a series"),
}
"""All formats by name. A new one is one row: suffixes, a header reader, a writer or None."""

# First bytes of formats, to recognise a file with another suffix.
_MARKS = {
    b"NRRD000": "nrrd",
    b"\x93NUMPY": "numpy",
    b"II*\0": "tiff",
    b"MM\0*": "tiff",
    b"ObjectType": "metaimage",
    b"<VTKFile": "vti",
    b"\x1f\x8b": "nifti",
    b"\x89PNG": "image",
    b"\xff\xd8\xff": "image",
}

_LESS = "read fewer voxels with stride=2"


@dataclass(frozen=True)
class FileDescription:
    """Description of a file without its voxels.

    Parameters
    ----------
    name : of the file.
    format : its description in :data:`FORMATS`.
    grid : where its voxels are.
    dtype : type of the voxels, scaling included; 64-bit integers become int32 or float64 only when they are loaded.
    is_labels : True if the file states that voxels are names of regions.
    file_bytes : on disk (of a folder: of its own files).
    memory_bytes : of the loaded voxels.
    notes : remarks.
    value_range : smallest and largest finite value, None if the voxels were not read.
    moments, channels : number of volumes of this grid that the file has; one moment and one channel of most.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "small.nrrd"
    >>> write_volume(Volume.from_array(np.arange(24, dtype=np.uint8).reshape(2, 3, 4)), file)
    >>> describe_file(file, voxels=True).value_range
    (0.0, 23.0)
    """

    name: str
    format: str
    grid: Grid
    dtype: np.dtype[Any]
    is_labels: bool
    file_bytes: int
    memory_bytes: int
    notes: tuple[str, ...]
    value_range: tuple[float, float] | None = None
    moments: int = 1
    channels: int = 1

    def rows(self) -> dict[str, str]:
        """The same for people, as a table of texts."""
        z, y, x = self.grid.shape
        table = {
            "file": self.name,
            "kind": self.format,
            "voxels (x, y, z)": f"{x} x {y} x {z}",
            "type": str(self.dtype),
            "spacing": " x ".join(f"{s:.6g}" for s in self.grid.spacing) + (self.grid.unit and f" {self.grid.unit}"),
            "origin": ", ".join(f"{o:.6g}" for o in self.grid.origin),
            "axes point to": self.grid.orientation,
            "labels": "yes" if self.is_labels else "no",
            "size": f"{human_bytes(self.file_bytes)} on disk, {human_bytes(self.memory_bytes)} in memory",
        }
        if self.value_range is not None:
            table["values"] = f"{self.value_range[0]:g} to {self.value_range[1]:g}"
        return {**table, **{f"note {k + 1}": note for k, note in enumerate(self.notes)}}


def supported_suffixes() -> str:
    """The suffixes that can be read, for messages."""
    return ", ".join(suffix for entry in FORMATS.values() for suffix in entry.suffixes)


def find_format(path: Path, *, writing: bool = False) -> tuple[str, Format]:
    """Name and row of the format of a path, by its suffix.

    Raises
    ------
    VolumeFileError
        If there is none, or it cannot be written; with the kinds that can.
    """
    lower = path.name.lower()
    for name, entry in FORMATS.items():
        if lower.endswith(entry.suffixes):
            if writing and entry.write is None:
                raise fail(path, f"{entry.description} is read but not written; write {_writable()}.")
            return name, entry
    if writing:
        raise fail(path, f"its suffix belongs to no kind of volume file; write {_writable()}.")
    if dicom.is_dicom(path):  # scanners often write names without a suffix
        return "dicom", FORMATS["dicom"]
    with regular_file(path).open("rb") as file:
        start = file.read(64).lstrip()
    likely = next((name for mark, name in _MARKS.items() if start.startswith(mark)), None)
    why = f"this is no known kind of volume file; known are {supported_suffixes()} and folders of slices."
    if likely is not None:
        why += f" It looks like {FORMATS[likely].description}: rename it to end in {FORMATS[likely].suffixes[0]}."
    raise UnknownKindError(str(fail(path, why)))


def _writable() -> str:
    return ", ".join(suffix for entry in FORMATS.values() if entry.write for suffix in entry.suffixes)


def existing_path(path: str | os.PathLike[str] | Any, progress: Progress | None = None) -> Path:
    """The path of a file or a folder that is there, or was copied from its address; VolumeFileError else.

    Parameters
    ----------
    progress : of the copy.
    """
    place = input_path(path, progress)
    try:
        place.stat()
    except FileNotFoundError as error:
        raise fail(place, f"there is no such file in {printable(place.absolute().parent)}.") from error
    except (OSError, ValueError, RuntimeError) as error:  # permissions, a NUL, a name too long, a loop of links
        raise VolumeFileError(f"{printable(path)}: it cannot be opened ({printable(error)}).") from error
    return place


def read_any_header(
    path: Path, series: str | int | None = None, uneven_slices: UnevenSlices = "refuse"
) -> tuple[str, Header]:
    """Name of the format, and the header, of a file or a folder that is there."""
    if path.is_dir():
        if dicom.dicom_files(path):
            return "dicom", dicom.read_header(path, series, uneven_slices)
        if ome_zarr.is_zarr(path):
            return "zarr", ome_zarr.read_header(path)
        if any(file.suffix.lower() in tiff.TIFF_SUFFIXES for file in path.iterdir()):
            return "tiff", tiff.read_folder_header(path)
        raise fail(path, "this folder holds neither a DICOM series nor TIFF slices nor Zarr arrays; name a file.")
    name, entry = find_format(path)
    regular_file(path)
    return name, dicom.read_header(path, series, uneven_slices) if name == "dicom" else entry.header(path)


def read_volume(
    path: str | os.PathLike[str] | BinaryIO,
    *,
    name: str | None = None,
    series: str | int | None = None,
    spacing: Spacing | None = None,
    is_labels: bool | None = None,
    stride: int = 1,
    max_bytes: int | None = None,
    level: int | None = None,
    uneven_slices: UnevenSlices = "refuse",
    progress: Progress | None = None,
    unit: str | None = None,
    suffix: str | None = None,
) -> Volume:
    """Read a volume file or a folder of slices.

    Parameters
    ----------
    path : a file of one of :data:`FORMATS`, or a folder with a DICOM series or TIFF slices; or its address (https, s3,
        zip and others of fsspec), from which it is copied into the user's cache first; or an open file of bytes.
    name : of the volume; by default the file's name without its suffix.
    series : which DICOM series, if there are several (its number, UID or description).
    spacing : (x, y, z) instead of the file's; origin and direction are those of the file. By default the file's, but
        for a public volume whose files are known to be wrong (:mod:`deformnb.volume.known_spacings`); a note reports
        it.
    is_labels : voxels are names of regions; by default as in the file, else only bool voxels are, and a note is added
        where whole numbers look like labels.
    stride : read every n-th voxel along each axis.
    max_bytes : refuse a volume that takes more memory; by default 60 % of the free memory, in containers too. Of a
        pyramid (OME-Zarr) the finest level that takes no more is read, and a note names it.
    level : the level of a pyramid to be read, 0 for the finest; by default the finest that fits.
    uneven_slices : of a DICOM series: "refuse" one with missing or unevenly spaced slices or a tilted gantry, or
        "resample" it linearly onto a straight, even grid, with a note.
    progress : receives the share done, 0 to 1; may raise Cancelled.
    unit : of the lengths, for a file that states none or a wrong one: a symbol or a name of
        :data:`~deformnb.volume.units.UNITS`. By default that of the file; numbers are not converted in any case.
    suffix : of an open file, by which its format is known (".nii.gz"); by default that of its name.

    Raises
    ------
    VolumeFileError
        If the file is missing, damaged, cut short, no volume, or too large; nothing is loaded then.
    MissingPackageError
        If a package that the format needs is not installed.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> write_volume(Volume.from_array(np.eye(3), spacing=(1, 2, 3)), folder / "a.nrrd")
    >>> read_volume(folder / "a.nrrd").grid.spacing
    (1.0, 2.0, 3.0)
    """
    if is_open_file(path):
        with copied_to_disk(path, name_for(path, suffix)) as copy:
            return read_volume(
                copy,
                name="" if name is None and suffix is not None else name,
                series=series,
                spacing=spacing,
                is_labels=is_labels,
                stride=stride,
                max_bytes=max_bytes,
                level=level,
                uneven_slices=uneven_slices,
                progress=progress,
                unit=unit,
            )
    copied, progress = split_progress(path, progress)
    place = existing_path(path, copied)
    step = _check_stride(stride)
    spacing = _check_spacing(spacing)
    given_unit = None if unit is None else check_unit(unit)
    with Damage(place, _LESS):
        kind, header = read_any_header(place, series, uneven_slices)
        header = header if given_unit is None else replace_unit(header, given_unit)
        if header.layout.frames == 1 and header.layout.kind != "channels":
            header = grey_header(header)
        if not header.layout.is_single:
            raise fail(
                place,
                f"a volume is one channel at one moment, and this file holds {header.layout}. "
                "dn.io.read_channels(path) reads them, and deformnb warp deforms them all.",
            )
        number = _choose_level(header, level, step, max_bytes)
        pyramid, header = header.levels, _level_header(header, number, level is None)
        grid, notes = header.grid(spacing)
        _check_memory(header, step, max_bytes)
        labels = header.is_labels if is_labels is None else is_labels
        loaded = Volume.from_array(_load(header, step, progress), is_labels=labels)
        if spacing is None:
            grid, notes = _right_spacing(grid, notes, header, loaded.values if step == 1 else None)
    grid = replace(grid, shape=loaded.shape, spacing=tuple(step * s for s in grid.spacing))  # type: ignore[arg-type]
    if step > 1:
        notes += (f"every {step}. voxel along each axis was read",)
    found = None
    if len(pyramid) > 1 and spacing is None:  # with strides the grid is that of no level
        found = PyramidLevel(
            place, number, tuple(one.grid()[0] for one in pyramid), partial(ome_zarr.checksum, place), id(loaded.values)
        )
    return Volume(
        loaded.values,
        grid,
        plain_name(place, kind) if name is None else name,
        loaded.is_labels,
        header.notes + notes + loaded.notes,
        found,
    )


def write_volume(
    volume: VolumeLike,
    path: str | os.PathLike[str] | BinaryIO,
    *,
    overwrite: bool = True,
    progress: Progress | None = None,
    suffix: str | None = None,
) -> None:
    """Write a volume; the suffix chooses the format. It is written atomically.

    Parameters
    ----------
    volume : the voxels and their grid; bool voxels become uint8 except in .npy and .raw, lengths in a unit that the
        format cannot state become millimetres.
    path : ends in a suffix of a writable row of :data:`FORMATS`; or an open file, of a format that is one file.
    overwrite : whether an existing file may be replaced.
    progress : receives the share done, 0 to 1; may raise Cancelled.
    suffix : of an open file, by which its format is known (".nii.gz"); by default that of its name.

    Raises
    ------
    VolumeFileError
        If the folder is missing or read-only, the disk is full, or the format cannot hold the volume.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "small.nrrd"
    >>> write_volume(Volume.from_array(np.zeros((2, 3, 4), np.uint8)), file)
    >>> read_volume(file).shape
    (2, 3, 4)
    """
    if is_open_file(path):
        with copied_from_disk(path, name_for(path, suffix)) as copy:
            write_volume(volume, copy, progress=progress)
        return
    place, volume = as_path(path), as_volume(volume)
    _, entry = find_format(place, writing=True)
    check_target(place, overwrite=overwrite, folder_marks=entry.folder_marks)
    assert entry.write is not None
    entry.write(volume.to_unit(entry.written_unit(volume.grid.unit)), place, overwrite, progress)


def describe_file(
    path: str | os.PathLike[str],
    *,
    series: str | int | None = None,
    voxels: bool = False,
    progress: Progress | None = None,
) -> FileDescription:
    """Describe a volume file; reads its header alone unless the range of values is requested with ``voxels``.

    (The voxels are read too where the header is that of a volume in :mod:`deformnb.volume.known_spacings`.)

    Raises
    ------
    VolumeFileError
        As :func:`read_volume` does.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "small.nrrd"
    >>> write_volume(Volume.from_array(np.zeros((2, 3, 4), np.uint8)), file)
    >>> describe_file(file).grid.shape
    (2, 3, 4)
    """
    place = existing_path(path)
    with Damage(place, _LESS):
        kind, header = read_any_header(place, series)
        grid, notes = _right_spacing(*header.grid(), header)
        files = place.rglob("*") if kind == "zarr" else place.iterdir() if place.is_dir() else [place]
        sizes = [file.stat().st_size for file in files if file.is_file()]
    layout = header.layout
    volume = read_volume(place, series=series, progress=progress) if voxels and layout.is_single else None
    notes += () if layout.is_single else (f"the file holds {layout}, each as large as stated here",)
    dtype = header.loaded_dtype if volume is None else volume.dtype
    return FileDescription(
        printable(place.name),
        FORMATS[kind].description,
        grid,
        dtype,
        bool(header.is_labels),
        sum(sizes),
        grid.size * dtype.itemsize * layout.frames * layout.channels,
        header.notes + notes if volume is None else volume.notes,
        None if volume is None else volume.value_range,
        layout.frames,
        layout.channels,
    )


def replace_unit(header: Header, unit: str) -> Header:
    """The header with the same numbers in another unit."""
    return replace(header, unit=unit, levels=tuple(replace(level, unit=unit) for level in header.levels))


def grey_header(header: Header) -> Header:
    """The header of colours as that of grey values, with a note."""

    def blocks() -> Iterator[NDArray[Any]]:
        with closing(header.blocks()) as found:  # type: ignore[type-var]  # generators can be closed
            for block in found:
                yield luma([block[..., part] for part in range(3)])

    return replace(header, layout=SINGLE, blocks=blocks, notes=(*header.notes, "its colours became grey values"))


def _right_spacing(
    grid: Grid, notes: tuple[str, ...], header: Header, voxels: NDArray[Any] | None = None
) -> tuple[Grid, tuple[str, ...]]:
    """The grid of a file with its true spacing and a note, if its header is known to be wrong.

    Parameters
    ----------
    voxels : all of them, if they have been read.
    """

    def checksum() -> str:
        whole = _load(header, 1, None) if voxels is None else voxels
        return voxel_checksum(header.loaded_dtype, header.shape, whole)

    known = known_spacing(grid, header.loaded_dtype, checksum)
    return (grid, notes) if known is None else (replace(grid, spacing=known.spacing, unit="mm"), (*notes, known.note))


def plain_name(path: Path, kind: str) -> str:
    """The name of a file without the suffix of its format."""
    suffix = next((s for s in FORMATS[kind].suffixes if path.name.lower().endswith(s)), "")
    return path.name[: len(path.name) - len(suffix)] or path.name


def _check_stride(stride: int) -> int:
    if isinstance(stride, bool) or not isinstance(stride, (int, np.integer)) or not 1 <= stride < 2**63:
        raise DeformError(f"stride must be a whole number from 1 on, got {short_value(stride)}.")
    return int(stride)


def _check_spacing(spacing: Spacing | None) -> Float3 | None:
    # An override is the caller's own: a negative one is a mistake, not a flipped file.
    return None if spacing is None else Grid((1, 1, 1), as_spacing(spacing)).spacing


def _strided_shape(shape: tuple[int, int, int], stride: int) -> tuple[int, int, int]:
    return (-(-shape[0] // stride), -(-shape[1] // stride), -(-shape[2] // stride))


def _memory(header: Header, stride: int) -> int:
    nz, ny, nx = _strided_shape(header.shape, stride)
    dtype = header.loaded_dtype
    # These are cast after loading: the old and the new array exist together.
    per_voxel = dtype.itemsize + {"int64": 8, "uint64": 8, "uint32": 8, "float16": 4}.get(dtype.name, 0)
    return nz * ny * nx * per_voxel + header.working_bytes


def _choose_level(header: Header, level: int | None, stride: int, max_bytes: int | None) -> int:
    """The number of the level of a pyramid that is read, by default of the finest that fits; 0 of other files."""
    last = len(header.levels) - 1
    if level is not None:
        if isinstance(level, bool) or not isinstance(level, int | np.integer) or not 0 <= level <= max(0, last):
            raise fail(header.path, f"it has the levels 0 to {max(0, last)}, got level={short_value(level)}.")
        return int(level)
    limit = _limit(max_bytes)
    return next((k for k, one in enumerate(header.levels) if _memory(one, stride) <= limit), 0)


def _level_header(header: Header, number: int, is_noted: bool) -> Header:
    """The header of one level of a pyramid, with a note if it is a coarser one; of other files the header itself."""
    chosen = header.levels[number] if header.levels else header
    if not (number and is_noted):
        return chosen
    last = len(header.levels) - 1
    nz, ny, nx = header.shape
    note = (
        f"level {number} of {last} of the pyramid was read: the finest of {nx} x {ny} x {nz} voxels takes more "
        "memory than allowed; deformnb.chunked.warp, deformnb warp and the studio's export at full resolution "
        "deform that one in parts"
    )
    return replace(chosen, notes=(*chosen.notes, note))


def _limit(max_bytes: int | None) -> int:
    if max_bytes is not None and not is_finite(max_bytes):
        raise DeformError(f"max_bytes must be a number of bytes, got {short_value(max_bytes)}.")
    return default_limit() if max_bytes is None else int(max_bytes)


def _check_memory(header: Header, stride: int, max_bytes: int | None) -> None:
    limit = _limit(max_bytes)
    needed = _memory(header, stride)
    if needed <= limit:
        return
    fitting = next((n for n in range(stride + 1, max(header.shape) + 1) if _memory(header, n) <= limit), None)
    advice = f"read it with stride={fitting}, or raise max_bytes." if fitting else "raise max_bytes."
    whose = "60 % of the free memory" if max_bytes is None else "max_bytes"
    raise fail(
        header.path, f"needs {human_bytes(needed)} of memory but the limit is {human_bytes(limit)} ({whose}); {advice}"
    )


def _load(header: Header, stride: int, progress: Progress | None) -> NDArray[Any]:
    """The voxels [z, y, x], scaled, every ``stride``-th along each axis."""
    shape = header.shape[::-1] if header.transposed else header.shape
    out = np.empty(_strided_shape(shape, stride), header.loaded_dtype)
    start = 0
    with closing(header.blocks()) as blocks:  # type: ignore[type-var]  # generators can be closed
        for block in blocks:
            first = -start % stride
            part = header.scaled(block[first::stride, ::stride, ::stride])
            at = (start + first) // stride
            out[at : at + len(part)] = part
            start += len(block)
            if progress is not None:
                progress(start / shape[0])
    return out.T if header.transposed else out
