"""Every field of the metadata of every format, dropped, negated, contradicted and changed to invalid values.

A changed field either changes the result, as it changes it for another program, or the file is refused, or a note
states the change: never is a number made up or dropped in silence.
"""

from __future__ import annotations

import json
import re
import shutil
import struct
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import tifffile

from deformnb import DeformError
from deformnb.io import open_series

VALUES = np.random.default_rng(0).integers(-3000, 3000, (4, 5, 6)).astype("<i2")
LPS = np.diag([-1.0, -1.0, 1.0, 1.0])


@dataclass(frozen=True)
class Kind:
    """A format: its fields, the writer of a file of them, and the fields that are irrelevant to voxels and places.

    Parameters
    ----------
    fields : of a good file, by name; None is a field that is absent and may be put in.
    write : (folder, fields) gives the path to be read.
    optional : fields whose absence is the value that they have.
    silent : fields, or (field, mutation), that mean nothing for the voxels and their places, each with the reason.
    peer : (path) gives the voxels [z, y, x] and the affine in LPS of another program.
    """

    fields: dict[str, Any]
    write: Callable[[Path, dict[str, Any]], Path]
    optional: tuple[str, ...] = ()
    silent: tuple[Any, ...] = ()
    peer: Callable[[Path], tuple[np.ndarray, np.ndarray]] | None = None


_NUMBER = re.compile(r"-?[0-9]+(?:[.][0-9]+)?")


def numbers_of(value: Any) -> list[float]:
    """The numbers of a field, which may be text."""
    if isinstance(value, str):
        return [float(found[0]) for found in _NUMBER.finditer(value)]
    if isinstance(value, bool):
        return []
    return [float(number) for number in np.ravel(value) if not isinstance(number, str)]


def with_number(value: Any, place: int, number: float) -> Any:
    """The same field with another number at a place."""
    if isinstance(value, str):
        found = list(_NUMBER.finditer(value))[place]
        whole = number == number and number == int(number)
        return value[: found.start()] + (str(int(number)) if whole else str(number)) + value[found.end() :]
    if isinstance(value, list | tuple):
        flat = np.array(value, dtype=object).ravel()
        kind = int if isinstance(flat[place], int) and number == number else float
        flat[place] = kind(number)
        return flat.reshape(np.shape(value)).tolist()
    return int(number) if isinstance(value, int) and number == number else number


def mutations(value: Any) -> Iterator[tuple[str, Any]]:
    """The changes of a field; a binary one takes those that fit into it."""
    yield "drop", None
    yield "word", "x"
    numbers = numbers_of(value)
    for k, number in enumerate(numbers):
        changes = {"negate": -number, "zero": 0.0, "contradict": number + 1, "huge": 1e15, "nan": float("nan")}
        for how, other in changes.items():
            if other != number:
                yield f"{how} {k}", with_number(value, k, other)
    if numbers and isinstance(value, str):
        yield "more", f"{value} 1"
        yield "fewer", " ".join(value.split()[:-1])
    elif numbers and isinstance(value, list | tuple):
        yield "more", [*value, value[-1]]
        yield "fewer", list(value[:-1])


def text_header(fields: dict[str, Any], form: str) -> str:
    return "".join(form.format(name, value) for name, value in fields.items() if value is not None)


def write_nrrd(folder: Path, fields: dict[str, Any]) -> Path:
    path = folder / "a.nrrd"
    path.write_bytes(f"NRRD0005\n{text_header(fields, '{}: {}' + chr(10))}\n".encode() + VALUES.tobytes())
    return path


def write_meta(folder: Path, fields: dict[str, Any]) -> Path:
    path = folder / "a.mha"
    path.write_bytes((text_header(fields, "{} = {}\n") + "ElementDataFile = LOCAL\n").encode() + VALUES.tobytes())
    return path


def write_raw(folder: Path, fields: dict[str, Any]) -> Path:
    (folder / "a.raw").write_bytes(VALUES.tobytes())
    (folder / "a.raw.json").write_text(json.dumps({k: v for k, v in fields.items() if v is not None}), encoding="utf-8")
    return folder / "a.raw"


def write_npy(folder: Path, fields: dict[str, Any]) -> Path:
    np.save(folder / "a.npy", VALUES)
    (folder / "a.npy.json").write_text(json.dumps({k: v for k, v in fields.items() if v is not None}), encoding="utf-8")
    return folder / "a.npy"


def write_vti(folder: Path, fields: dict[str, Any]) -> Path:
    of = {
        name: " ".join(
            f'{key.partition(".")[2]}="{value}"'
            for key, value in fields.items()
            if key.startswith(f"{name}.") and value is not None
        )
        for name in ("VTKFile", "ImageData", "Piece", "PointData", "DataArray")
    }
    text = " ".join(map(str, VALUES.ravel()))
    (folder / "a.vti").write_text(
        f"<VTKFile {of['VTKFile']}><ImageData {of['ImageData']}><Piece {of['Piece']}><PointData {of['PointData']}>"
        f"<DataArray {of['DataArray']}>{text}</DataArray></PointData></Piece></ImageData></VTKFile>",
        encoding="utf-8",
    )
    return folder / "a.vti"


NIFTI: dict[str, tuple[str, int]] = {
    "dim": ("8h", 40),
    "intent_p": ("3f", 56),
    "intent_code": ("h", 68),
    "datatype": ("h", 70),
    "bitpix": ("h", 72),
    "slice_start": ("h", 74),
    "pixdim": ("8f", 76),
    "vox_offset": ("f", 108),
    "scl_slope": ("f", 112),
    "scl_inter": ("f", 116),
    "slice_end": ("h", 120),
    "slice_code": ("B", 122),
    "xyzt_units": ("B", 123),
    "cal": ("2f", 124),
    "slice_duration": ("f", 132),
    "toffset": ("f", 136),
    "qform_code": ("h", 252),
    "sform_code": ("h", 254),
    "quatern": ("3f", 256),
    "qoffset": ("3f", 268),
    "srow_x": ("4f", 280),
    "srow_y": ("4f", 296),
    "srow_z": ("4f", 312),
}


def write_nifti(folder: Path, fields: dict[str, Any]) -> Path:
    """A field that is dropped has zeros; a word, more and fewer numbers do not fit into a binary one."""
    header = bytearray(352)
    struct.pack_into("<i", header, 0, 348)
    header[344:348] = b"n+1\0"
    for name, (form, offset) in NIFTI.items():
        value = fields[name]
        if value is not None:
            struct.pack_into(f"<{form}", header, offset, *np.ravel(value).tolist())
    (folder / "a.nii").write_bytes(bytes(header) + VALUES.tobytes())
    return folder / "a.nii"


TAGS = {
    "width": (256, 3),
    "height": (257, 3),
    "bits": (258, 3),
    "compression": (259, 3),
    "photometric": (262, 3),
    "fill order": (266, 3),
    "offsets": (273, 4),
    "samples": (277, 3),
    "rows": (278, 3),
    "counts": (279, 4),
    "x resolution": (282, 5),
    "y resolution": (283, 5),
    "planar": (284, 3),
    "resolution unit": (296, 3),
    "predictor": (317, 3),
    "sample format": (339, 3),
}
PIXELS = np.random.default_rng(1).integers(-3000, 3000, (5, 6)).astype("<i2")


def write_tags(folder: Path, fields: dict[str, Any]) -> Path:
    """A page of two strips; every value follows the list of fields."""
    present = {name: value for name, value in fields.items() if value is not None}
    start = 8 + PIXELS.nbytes
    end, entries, extra = start + 2 + 12 * len(present) + 4, b"", b""
    for name, value in sorted(present.items(), key=lambda item: TAGS[item[0]][0]):
        tag, kind = TAGS[name]
        numbers = np.ravel(value).tolist()
        data = struct.pack(f"<{len(numbers)}{'H' if kind == 3 else 'I'}", *numbers)
        if kind == 5 and len(numbers) % 2:
            raise ValueError("a rational has two numbers")
        count = len(numbers) // 2 if kind == 5 else len(numbers)
        place = struct.pack("<I", end + len(extra)) if len(data) > 4 else data.ljust(4, b"\0")
        entries += struct.pack("<HHI", tag, kind, count) + place
        extra += data if len(data) > 4 else b""
    (folder / "a.tif").write_bytes(
        struct.pack("<2sHI", b"II", 42, start)
        + PIXELS.tobytes()
        + struct.pack("<H", len(present))
        + entries
        + bytes(4)
        + extra
    )
    return folder / "a.tif"


def tags_peer(path: Path) -> tuple[np.ndarray, np.ndarray]:
    return tifffile.imread(path), np.eye(4)


def described(folder: Path, text: str) -> Path:
    tifffile.imwrite(
        folder / "a.tif",
        VALUES,
        photometric="minisblack",
        description=text,
        metadata=None,
        resolution=(2.0, 4.0),
        resolutionunit=1,
    )
    return folder / "a.tif"


def write_imagej(folder: Path, fields: dict[str, Any]) -> Path:
    return described(folder, "ImageJ=1.53t\n" + text_header(fields, "{}={}\n"))


def write_ome(folder: Path, fields: dict[str, Any]) -> Path:
    pixels = text_header(fields, '{}="{}" ')
    return described(
        folder,
        '<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06">'
        f'<Image ID="Image:0"><Pixels ID="Pixels:0" {pixels}><TiffData/></Pixels></Image></OME>',
    )


def write_shaped(folder: Path, fields: dict[str, Any]) -> Path:
    return described(folder, json.dumps({k: v for k, v in fields.items() if v is not None}))


def write_ome_zarr(folder: Path, fields: dict[str, Any]) -> Path:
    zarr = pytest.importorskip("zarr")
    path = folder / "a.zarr"
    if path.exists():
        shutil.rmtree(path)
    of = {k: v for k, v in fields.items() if v is not None}
    moved = [{"type": name, name: of[name]} for name in ("scale", "translation") if name in of]
    whole = [{"type": "scale", "scale": of["whole"]}] if "whole" in of else []
    axes = [{"name": name, "type": "space", **({"unit": of["unit"]} if "unit" in of else {})} for name in of["axes"]]
    about = {
        "axes": axes,
        "coordinateTransformations": whole,
        "datasets": [{"path": "0", "coordinateTransformations": moved}],
    }
    group = zarr.create_group(str(path), zarr_format=2, attributes={"multiscales": [{"version": "0.4", **about}]})
    group.create_array("0", shape=VALUES.shape, dtype=VALUES.dtype, chunks=(2, 5, 6))[...] = VALUES
    held = json.loads((path / "0" / ".zarray").read_text(encoding="utf-8"))
    for name in ("shape", "chunks", "dtype", "order", "fill_value"):
        held[name] = of.get(name)
    (path / "0" / ".zarray").write_text(json.dumps(held), encoding="utf-8")
    return path


def write_dicom(folder: Path, fields: dict[str, Any]) -> Path:
    """Three slices; the second one has the fields that are changed."""
    pydicom = pytest.importorskip("pydicom")
    from dicom_series import write_slice

    inner = folder / "series"
    inner.mkdir(exist_ok=True)
    for k in range(3):
        write_slice(
            inner / f"{k}.dcm",
            VALUES[k],
            (1, 2, 3 + 2.5 * k),
            ImageOrientationPatient=[1, 0, 0, 0, 1, 0],
            uid=f"1.2.3.{k}",
        )
    data = pydicom.dcmread(inner / "1.dcm")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, value in fields.items():
            if value is None:
                data.pop(name, None)
            else:
                setattr(data, name, value)
        data.save_as(inner / "1.dcm")
    return inner


def nifti_peer(path: Path) -> tuple[np.ndarray, np.ndarray]:
    nibabel = pytest.importorskip("nibabel")
    image = nibabel.load(path)
    values = np.asanyarray(image.dataobj)
    return values.T, LPS @ image.affine


def itk_peer(path: Path) -> tuple[np.ndarray, np.ndarray]:
    sitk = pytest.importorskip("SimpleITK")
    image = sitk.ReadImage(str(path))
    affine = np.eye(4)
    affine[:3, :3] = np.reshape(image.GetDirection(), (3, 3)) * image.GetSpacing()
    affine[:3, 3] = image.GetOrigin()
    return sitk.GetArrayFromImage(image), affine


def placed(values: np.ndarray, spacing: Any, origin: Any, direction: Any = None) -> tuple[np.ndarray, np.ndarray]:
    affine = np.eye(4)
    turned = np.eye(3) if direction is None else np.asarray(direction, dtype=float)
    affine[:3, :3] = turned * np.asarray(spacing, dtype=float)
    affine[:3, 3] = origin
    return values, affine


def side_peer(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Content of the JSON, read literally."""
    about = json.loads(path.with_name(f"{path.name}.json").read_text(encoding="utf-8"))
    if path.suffix == ".npy":
        values = np.load(path)
    else:
        order = ">" if about["byte_order"] == "big" else "<"
        dtype = np.dtype(about["dtype"]).newbyteorder(order)
        values = np.frombuffer(path.read_bytes()[about.get("offset", 0) :], dtype).reshape(about["shape"])
    return placed(values, about.get("spacing", (1, 1, 1)), about.get("origin", (0, 0, 0)), about.get("direction"))


def vti_peer(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Content of the XML, read literally."""
    root = ElementTree.parse(path).getroot()
    image, array = root[0], root.find(".//DataArray")
    extent = [int(word) for word in image.get("WholeExtent", "").split()]
    types = {"Int8": "i1", "UInt8": "u1", "Int16": "i2", "UInt16": "u2", "Int32": "i4", "Float32": "f4"}
    shape = [high - low + 1 for low, high in zip(extent[::2], extent[1::2], strict=True)][::-1]
    values = np.array(array.text.split(), dtype=float).astype(types[array.get("type")]).reshape(shape)
    spacing, origin = (
        [float(word) for word in image.get(name, missing).split()]
        for name, missing in (("Spacing", "1 1 1"), ("Origin", "0 0 0"))
    )
    direction = np.reshape([float(word) for word in image.get("Direction", "1 0 0 0 1 0 0 0 1").split()], (3, 3))
    return placed(values, spacing, origin + direction @ (np.multiply(spacing, extent[::2])), direction)


def nrrd_peer(path: Path) -> tuple[np.ndarray, np.ndarray]:
    nrrd = pytest.importorskip("nrrd")
    values, header = nrrd.read(str(path))
    spacing = header.get("spacings", np.ones(3))
    first = np.nan_to_num(np.array(header.get("axis mins", np.zeros(3)), dtype=float))
    half = [0.5 if centre == "cell" else 0.0 for centre in header.get("centers", ["node"] * 3)]
    return placed(values.T, spacing, first + half * np.asarray(spacing))


NIFTI_FIELDS = {
    "dim": (3, 6, 5, 4, 1, 1, 1, 1),
    "intent_p": (0.0, 0.0, 0.0),
    "intent_code": 0,
    "datatype": 4,
    "bitpix": 16,
    "slice_start": 0,
    "pixdim": (1.0, 1.5, 2.0, 2.5, 0.0, 0.0, 0.0, 0.0),
    "vox_offset": 352.0,
    "scl_slope": 2.0,
    "scl_inter": 3.0,
    "slice_end": 0,
    "slice_code": 0,
    "xyzt_units": 2,
    "cal": (0.0, 0.0),
    "slice_duration": 0.0,
    "toffset": 0.0,
    "qform_code": 1,
    "sform_code": 0,
    "quatern": (0.5, 0.0, 0.0),
    "qoffset": (4.0, 5.0, 6.0),
    "srow_x": (0.0,) * 4,
    "srow_y": (0.0,) * 4,
    "srow_z": (0.0,) * 4,
}
SFORM = {
    **NIFTI_FIELDS,
    "sform_code": 2,
    "qform_code": 0,
    "srow_x": (1.5, 0.0, 0.0, 7.0),
    "srow_y": (0.0, 2.0, 0.0, 8.0),
    "srow_z": (0.0, 0.0, 2.5, 9.0),
}
_CHANGES = ("negate", "zero", "contradict", "huge", "nan")
# Fields of time, of display and of statistics; the code names the space; sizes and lengths of axes beyond
# dim[0], and a fourth axis of one voxel.
_NIFTI_SILENT = (
    "intent_p",
    "slice_start",
    "slice_end",
    "slice_code",
    "cal",
    "slice_duration",
    "toffset",
    "intent_code",
    ("qform_code", "contradict 0"),
    ("sform_code", "contradict 0"),
    ("dim", "contradict 0"),
    *(("dim", f"{how} {k}") for k in range(4, 8) for how in _CHANGES),
    *(("pixdim", f"{how} {k}") for k in range(4, 8) for how in _CHANGES),
)
_NO_QFORM = ("quatern", "qoffset", *(("pixdim", f"{how} 0") for how in _CHANGES))

KINDS: dict[str, Kind] = {
    "nifti": Kind(
        NIFTI_FIELDS, write_nifti, ("xyzt_units",), (*_NIFTI_SILENT, "srow_x", "srow_y", "srow_z"), nifti_peer
    ),
    "nifti sform": Kind(SFORM, write_nifti, ("xyzt_units",), (*_NIFTI_SILENT, *_NO_QFORM), nifti_peer),
    "nrrd": Kind(
        {
            "type": "short",
            "dimension": "3",
            "space": "left-posterior-superior",
            "sizes": "6 5 4",
            "space directions": "(1.5,0,0) (0,2,0) (0,0,2.5)",
            "kinds": "domain domain domain",
            "endian": "little",
            "encoding": "raw",
            "space origin": "(4,5,6)",
        },
        write_nrrd,
        ("space", "kinds"),
        (("space", "drop"),),
        itk_peer,
    ),
    "nrrd spacings": Kind(
        {
            "type": "short",
            "dimension": "3",
            "sizes": "6 5 4",
            "spacings": "1.5 2 2.5",
            "axis mins": "4 5 6",
            "centers": "node node node",
            "endian": "little",
            "encoding": "raw",
        },
        write_nrrd,
        (),
        (("centers", "drop"),),
        nrrd_peer,
    ),
    "metaimage": Kind(
        {
            "ObjectType": "Image",
            "NDims": "3",
            "BinaryData": "True",
            "BinaryDataByteOrderMSB": "False",
            "CompressedData": "False",
            "TransformMatrix": "0 1 0 1 0 0 0 0 -1",
            "Offset": "4 5 6",
            "CenterOfRotation": "0 0 0",
            "ElementSpacing": "1.5 2 2.5",
            "DimSize": "6 5 4",
            "ElementNumberOfChannels": "1",
            "ElementType": "MET_SHORT",
        },
        write_meta,
        (
            "BinaryData",
            "BinaryDataByteOrderMSB",
            "CompressedData",
            "CenterOfRotation",
            "ElementNumberOfChannels",
            "ObjectType",
        ),
        ("CenterOfRotation",),
        itk_peer,
    ),
    "vti": Kind(
        {
            "VTKFile.type": "ImageData",
            "VTKFile.version": "1.0",
            "VTKFile.byte_order": "LittleEndian",
            "ImageData.WholeExtent": "0 5 0 4 0 3",
            "ImageData.Origin": "4 5 6",
            "ImageData.Spacing": "1.5 2 2.5",
            "ImageData.Direction": "0 1 0 1 0 0 0 0 -1",
            "Piece.Extent": "0 5 0 4 0 3",
            "PointData.Scalars": "density",
            "DataArray.type": "Int16",
            "DataArray.Name": "density",
            "DataArray.NumberOfComponents": "1",
            "DataArray.format": "ascii",
        },
        write_vti,
        ("VTKFile.byte_order", "DataArray.NumberOfComponents", "PointData.Scalars"),
        ("VTKFile.version", ("PointData.Scalars", "drop"), ("DataArray.Name", "drop")),
        vti_peer,
    ),
    "raw": Kind(
        {
            "format": "deformnb volume",
            "version": 1,
            "shape": [4, 5, 6],
            "dtype": "int16",
            "byte_order": "little",
            "offset": 0,
            "spacing": [1.5, 2.0, 2.5],
            "origin": [4.0, 5.0, 6.0],
            "direction": [[0, 1, 0], [1, 0, 0], [0, 0, -1]],
            "is_labels": False,
        },
        write_raw,
        ("format", "version", "offset", "is_labels"),
        (),
        side_peer,
    ),
    "numpy": Kind(
        {
            "format": "deformnb volume",
            "version": 1,
            "shape": [4, 5, 6],
            "dtype": "int16",
            "byte_order": "little",
            "spacing": [1.5, 2.0, 2.5],
            "origin": [4.0, 5.0, 6.0],
            "direction": [[0, 1, 0], [1, 0, 0], [0, 0, -1]],
            "is_labels": False,
        },
        write_npy,
        ("format", "version", "shape", "dtype", "byte_order", "is_labels"),
        (),
        side_peer,
    ),
}

KINDS |= {
    "tiff": Kind(
        {
            "width": [6],
            "height": [5],
            "bits": [16],
            "compression": [1],
            "photometric": [1],
            "fill order": [1],
            "offsets": [8, 44],
            "samples": [1],
            "rows": [3],
            "counts": [36, 24],
            "x resolution": [3, 1],
            "y resolution": [4, 1],
            "planar": [1],
            "resolution unit": [2],
            "predictor": [1],
            "sample format": [2],
        },
        write_tags,
        ("compression", "photometric", "fill order", "samples", "planar", "predictor"),
        (("planar", "contradict 0"),),
        tags_peer,
    ),
    "imagej": Kind(
        {"images": "4", "slices": "4", "unit": "micron", "spacing": "2.5", "channels": "1", "frames": "1"},
        write_imagej,
        ("images", "slices", "channels", "frames"),
    ),
    "ome": Kind(
        {
            "DimensionOrder": "XYZCT",
            "Type": "int16",
            "SizeX": "6",
            "SizeY": "5",
            "SizeZ": "4",
            "SizeC": "1",
            "SizeT": "1",
            "PhysicalSizeX": "1.5",
            "PhysicalSizeY": "2.0",
            "PhysicalSizeZ": "2.5",
            "PhysicalSizeXUnit": "mm",
            "PhysicalSizeYUnit": "mm",
            "PhysicalSizeZUnit": "mm",
        },
        write_ome,
        ("DimensionOrder", "Type", "SizeX", "SizeY", "SizeZ", "SizeC", "SizeT"),
    ),
    "tifffile": Kind(
        {"shape": [4, 5, 6], "axes": "ZYX", "spacing": 2.5, "unit": "mm"},
        write_shaped,
        ("axes", "shape"),
        (("axes", "word"),),
    ),
    "zarr": Kind(
        {
            "axes": ["z", "y", "x"],
            "unit": "millimeter",
            "scale": [2.5, 2.0, 1.5],
            "translation": [6.0, 5.0, 4.0],
            "whole": [1.0, 2.0, 1.0],
            "shape": [4, 5, 6],
            "chunks": [2, 5, 6],
            "dtype": "<i2",
            "order": "C",
            "fill_value": 0,
        },
        write_ome_zarr,
        ("fill_value",),
        ("fill_value",),
    ),
    "dicom": Kind(
        {
            "Rows": 5,
            "Columns": 6,
            "SamplesPerPixel": 1,
            "PhotometricInterpretation": "MONOCHROME2",
            "BitsAllocated": 16,
            "BitsStored": 16,
            "HighBit": 15,
            "PixelRepresentation": 1,
            "PixelSpacing": [1.25, 0.5],
            "ImageOrientationPatient": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0],
            "ImagePositionPatient": [1.0, 2.0, 5.5],
            "RescaleSlope": 1.0,
            "RescaleIntercept": 0.0,
            "NumberOfFrames": 1,
            "SeriesInstanceUID": "1.2.826.0.1.3680043.8.498.1",
        },
        write_dicom,
        (
            "SamplesPerPixel",
            "PhotometricInterpretation",
            "HighBit",
            "BitsStored",
            "RescaleSlope",
            "RescaleIntercept",
            "NumberOfFrames",
        ),
    ),
}


def found_in(path: Path) -> tuple[Any, tuple[str, ...]]:
    """Content of a file in a comparable form, and the notes."""
    series = open_series(path, max_bytes=2**26)
    moments = [channels.values for channels in series]
    state = (
        repr(series.grid),
        series.layout,
        series.dtype,
        [np.asarray(one).tobytes() for one in moments],
        [volume.is_labels for channels in series for volume in channels],
    )
    return (state, moments, series.grid), series.notes


def outcome(kind: Kind, folder: Path, name: str, change: Any) -> str:
    """Outcome for a file with a changed field: "refused", "noted", "changed", "same" or "unwritable"."""
    (good, _, _), notes = found_in(kind.write(folder, kind.fields))
    try:
        path = kind.write(folder, {**kind.fields, name: change})
    except (struct.error, ValueError, TypeError, OverflowError, OSError, KeyError):
        return "unwritable"
    try:
        (now, moments, grid), new_notes = found_in(path)
    except DeformError as error:
        return "refused" if str(error) and "\n" not in str(error) else "refused without a sentence"
    if new_notes != notes:
        return "noted"
    if now == good:
        return "same"
    _compare_with_peer(kind, path, moments, grid)
    return "changed"


def _compare_with_peer(kind: Kind, path: Path, moments: list[np.ndarray], grid: Any) -> None:
    if kind.peer is None:
        return
    try:
        values, affine = kind.peer(path)
    except Exception:  # after any exception the other program does not read the file
        return
    assert len(moments) == 1
    np.testing.assert_allclose(np.squeeze(moments[0]), np.squeeze(values), rtol=1e-6)
    np.testing.assert_allclose(grid.affine, affine, rtol=1e-5, atol=1e-5)


CASES = [
    (kind, name, how)
    for kind, one in KINDS.items()
    for name, value in one.fields.items()
    for how, _ in mutations(value)
]


@pytest.mark.parametrize(("kind", "name", "how"), CASES)
def test_no_field_is_made_up_or_dropped_in_silence(
    kind: str, name: str, how: str, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    one = KINDS[kind]
    change = dict(mutations(one.fields[name]))[how]
    found = outcome(one, tmp_path, name, change)
    record_property("outcome", f"{kind} | {name} | {how} | {found}")
    nothing = name in one.silent or (name, how) in one.silent or (how == "drop" and name in one.optional)
    was_zero = change is None and set(numbers_of(one.fields[name])) == {0.0}  # a binary field cannot be absent
    assert found in ("refused", "noted", "changed", "unwritable") or (found == "same" and (nothing or was_zero))


def table(folder: Path) -> Counter[tuple[str, str]]:
    """The number of outcomes of each format, for people: ``python -c "import test_metadata_mutations"``."""
    return Counter(
        (kind, outcome(KINDS[kind], folder, name, dict(mutations(KINDS[kind].fields[name]))[how]))
        for kind, name, how in CASES
    )
