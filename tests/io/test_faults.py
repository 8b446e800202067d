"""Damaged, hostile and odd files: one sentence that names the file and the reason, and nothing loaded."""

from __future__ import annotations

import bz2
import gzip
import json
import os
import re
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from deformnb import DeformError, Volume
from deformnb.errors import VolumeFileError
from deformnb.io import FORMATS, available_memory, describe_file, read_volume, write_volume

FILES = [
    s
    for kind, entry in FORMATS.items()
    if entry.write and kind != "image" and not entry.folder_marks
    for s in entry.suffixes
]


ANY = "."  # any message: which field is found wrong first does not matter


def small_volume(dtype: str = "int16") -> Volume:
    return Volume.from_array(np.arange(120).reshape(4, 5, 6).astype(dtype), (1, 2, 3), (4, 5, 6))


def refuse(path: Path, words: str, **options: object) -> str:
    """Reading raises one error that begins with the file's name, has the words, and is one line."""
    with pytest.raises(VolumeFileError, match=words) as caught:
        read_volume(path, **options)  # type: ignore[arg-type]
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 900
    assert message.isprintable()
    return message


def nrrd(path: Path, header: str, data: bytes = bytes(240)) -> Path:
    """A NRRD file of 6 x 5 x 4 int16 with some lines changed or added."""
    lines = {"type": "short", "dimension": "3", "sizes": "6 5 4", "endian": "little", "encoding": "raw"}
    for line in header.splitlines():
        name, _, value = line.partition(": ")
        lines[name] = value
    text = "NRRD0005\n" + "".join(f"{name}: {value}\n" for name, value in lines.items() if value != "-") + "\n"
    path.write_bytes(text.encode() + data)
    return path


def meta(path: Path, header: str, data: bytes = bytes(240)) -> Path:
    lines = {"ObjectType": "Image", "NDims": "3", "DimSize": "6 5 4", "ElementType": "MET_SHORT"}
    for line in header.splitlines():
        name, _, value = line.partition(" = ")
        lines[name] = value
    target = lines.pop("ElementDataFile", "LOCAL")
    text = "".join(f"{name} = {value}\n" for name, value in lines.items() if value != "-")
    path.write_bytes((text + f"ElementDataFile = {target}\n").encode() + data)
    return path


def nifti(path: Path, changes: dict[int, tuple[str, tuple[float, ...]]], data: bytes | None = None) -> Path:
    write_volume(small_volume(), path)
    content = bytearray(path.read_bytes())
    for offset, (form, values) in changes.items():
        struct.pack_into("<" + form, content, offset, *values)
    path.write_bytes(bytes(content) if data is None else bytes(content[:352]) + data)
    return path


# -- rows 16, 17, 19: sizes and truncation ---------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", FILES)
def test_a_file_cut_anywhere_is_refused(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a{suffix}"
    write_volume(small_volume(), path)
    files = [file for file in sorted(tmp_path.iterdir()) if file.suffix != ".json"]
    for file in files:
        whole = file.read_bytes()
        # VTI ends with closing tags behind the voxels, and a text header may lose its last line end unharmed
        needed = len(whole) - {".vti": 32, ".nhdr": 2, ".mhd": 1}.get(file.suffix, 0)
        for length in range(0, needed, 7):
            file.write_bytes(whole[:length])
            refuse(path, re.escape(path.name) if file == path else ANY)
        file.write_bytes(whole[: needed - 1])
        refuse(path, ANY)
        file.write_bytes(whole)
    assert read_volume(path).shape == (4, 5, 6)


@pytest.mark.parametrize("suffix", [s for s in FILES if not s.endswith((".vti", ".nii.gz", ".nrrd", ".tif", ".tiff"))])
def test_both_numbers_are_in_the_message(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a{suffix}"
    write_volume(small_volume(), path)
    data = next(tmp_path.glob("*hd*.raw")) if suffix in (".nhdr", ".mhd") else path
    whole = data.read_bytes()
    data.write_bytes(whole[:-5])
    refuse(path, "240 bytes.*235")
    data.write_bytes(whole + b"12345")
    refuse(path, "240 bytes.*245")


@pytest.mark.parametrize("pack", [gzip.compress, bz2.compress])
def test_packed_voxels_of_another_length(pack, tmp_path: Path) -> None:
    encoding = "encoding: " + ("gzip" if pack is gzip.compress else "bzip2")
    refuse(nrrd(tmp_path / "a.nrrd", encoding, pack(bytes(235))), "240 bytes.*235")
    refuse(nrrd(tmp_path / "a.nrrd", encoding, pack(bytes(241))), "240 bytes.*more")
    assert read_volume(nrrd(tmp_path / "a.nrrd", encoding, pack(bytes(240)))).values.max() == 0


def test_a_wrong_check_sum_is_noticed(tmp_path: Path) -> None:
    data = bytearray(gzip.compress(bytes(240)))
    data[-5] ^= 1
    refuse(nrrd(tmp_path / "a.nrrd", "encoding: gzip", bytes(data)), "cannot be read")
    packed = bytearray(zlib.compress(bytes(240)))
    packed[-1] ^= 1
    refuse(meta(tmp_path / "a.mha", "CompressedData = True", bytes(packed)), "cannot be read")
    write_volume(small_volume(), tmp_path / "a.raw")
    content = bytearray((tmp_path / "a.raw").read_bytes())
    content[7] ^= 1
    (tmp_path / "a.raw").write_bytes(bytes(content))
    refuse(tmp_path / "a.raw", "CRC")


def test_gzip_of_several_members_and_with_padding_is_whole(tmp_path: Path) -> None:
    values = np.arange(120, dtype="<i2")
    data = gzip.compress(values[:50].tobytes()) + gzip.compress(b"") + gzip.compress(values[50:].tobytes()) + bytes(99)
    read = read_volume(nrrd(tmp_path / "a.nrrd", "encoding: gzip", data))
    np.testing.assert_array_equal(read.values.ravel(), values)
    refuse(nrrd(tmp_path / "a.nrrd", "encoding: gzip", data + b"x"), "cannot be read")


# -- row 18: bombs ---------------------------------------------------------------------------------------------------


def test_a_bomb_is_not_unpacked(tmp_path: Path) -> None:
    import tracemalloc

    bomb = gzip.compress(bytes(2**26))  # 64 MiB behind 240 bytes
    files = [
        nrrd(tmp_path / "a.nrrd", "encoding: gzip", bomb),
        meta(tmp_path / "a.mha", "CompressedData = True", zlib.compress(bytes(2**26))),
    ]
    nifti(tmp_path / "a.nii", {}, bytes(2**26))
    (tmp_path / "b.nii.gz").write_bytes(gzip.compress((tmp_path / "a.nii").read_bytes()))
    for path in [*files, tmp_path / "b.nii.gz"]:
        tracemalloc.start()
        refuse(path, "240 bytes.*more")
        assert tracemalloc.get_traced_memory()[1] < 8 * 2**20  # a block and its copies, not 64 MiB
        tracemalloc.stop()


def test_a_claim_that_deflate_cannot_meet_is_refused_before_memory_is_taken(tmp_path: Path) -> None:
    path = nrrd(tmp_path / "a.nrrd", "encoding: gzip\nsizes: 100000 1000 1000", gzip.compress(bytes(240)))
    refuse(path, "200000000000 bytes.*compressed")


# -- rows 6, 10, 12-15: limits of headers -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ("sizes: 6 5 -4", "at least 1 voxel"),
        ("sizes: 6 5 0", "at least 1 voxel"),
        ("sizes: 6 5", "3 whole numbers"),
        ("sizes: 6 5 four", "whole numbers"),
        ("sizes: 6 5 99999999999999999999999", "whole numbers"),
        ("sizes: 4294967296 4294967296 4294967296", "more memory than any machine"),
        ("dimension: 99", "dimension"),
        ("dimension: -", "lacks the field 'dimension'"),
        ("type: block", "voxel type 'block'"),
        ("endian: -", "endian"),
        ("encoding: text", "too long for a number|something else"),
        ("encoding: hex", "hexadecimal|one digit|holds"),
        ("spacings: 1 0 1", "spacing must be positive"),
        ("spacings: 1 nan 1", "spacing must be three finite"),
        ("space: left-posterior-superior\nspace directions: (1,0,0) (0,0,0) (0,0,1)", "singular"),
        ("space: left-posterior-superior\nspace directions: (1,0,0) (0,nan,0) (0,0,1)", "finite"),
        ("space: left-posterior-superior\nspace directions: (1,0,0) (0.5,1,0) (0,0,1)", "sheared"),
        ("space: left-posterior-superior\nspace directions: (1,0,0) (0,1,0)", "2 vectors for 3 axes"),
        ("space: left-posterior-superior\nspace directions: (1,0,0) what (0,0,1)", "vectors like"),
        ("space: mars", "space 'mars'"),
        ("kinds: domain domain RGB-color", "RGB-color|rgb-color"),
        ("kinds: domain domain", "kinds"),
        ("dimension: 4\nsizes: 2 5 4 3\nkinds: vector domain domain domain", "holds vectors of 2 components"),
        ("dimension: 4\nsizes: 5 4 3 2", "holds 2 moments"),
        ("dimension: 4\nsizes: 5 2 4 3\nkinds: domain vector domain domain", "vector: 2"),
        ("dimension: 5\nsizes: 5 4 3 2 1\nkinds: domain domain domain time list", "time: 2"),
        ("byte skip: -5", "byte skip"),
        ("byte skip: 10", "230"),
        ("line skip: 999999", "line skip"),
        ("data file: LIST", "has 0 names"),
        ("data file: a%03d.raw 1 9 1", "need 4 data files of 2 axes, and it names 9"),
    ],
)
def test_nrrd_headers(header: str, words: str, tmp_path: Path) -> None:
    refuse(nrrd(tmp_path / "a.nrrd", header), words)


def test_nrrd_without_an_end_or_with_nonsense(tmp_path: Path) -> None:
    (tmp_path / "a.nrrd").write_bytes(b"NRRD0004\ntype: short\n" * 100)
    refuse(tmp_path / "a.nrrd", "no end")
    (tmp_path / "a.nrrd").write_bytes(b"NRRD0004\n" + b"x" * 2**21)
    refuse(tmp_path / "a.nrrd", "no end")
    (tmp_path / "a.nrrd").write_bytes(b"NRRD0004\nnonsense\n\n")
    refuse(tmp_path / "a.nrrd", "neither")
    (tmp_path / "a.nrrd").write_bytes(b"NRRD0004\ntype: short\ntype: short\n\n")
    refuse(tmp_path / "a.nrrd", "twice")


@pytest.mark.parametrize(
    ("header", "spacing", "corner", "orientation"),
    [
        ("spacings: 1 -2 3", (1, 2, 3), (0, 0, 0), "LAS"),
        ("spacings: 1 2 3\naxis mins: 10 20 30", (1, 2, 3), (10, 20, 30), "LPS"),
        ("spacings: 1 2 3\naxis mins: 10 20 30\ncenterings: cell cell cell", (1, 2, 3), (10.5, 21, 31.5), "LPS"),
        (
            "space: right-anterior-superior\nspace directions: (1,0,0) (0,2,0) (0,0,3)\nspace origin: (10,20,30)",
            (1, 2, 3),
            (-10, -20, 30),
            "RAS",
        ),
        (
            "space: LAS\nspace directions: (1,0,0) (0,2,0) (0,0,3)\nspace origin: (10,20,30)",
            (1, 2, 3),
            (10, -20, 30),
            "LAS",
        ),
        ("space dimension: 3\nspace directions: (0,0,1) (1,0,0) (0,-2,0)", (1, 1, 2), (0, 0, 0), "SLA"),
        (
            "dimension: 4\nsizes: 1 6 5 4\nspace: LPS\nspace directions: none (1,0,0) (0,2,0) (0,0,3)",
            (1, 2, 3),
            (0, 0, 0),
            "LPS",
        ),
        (
            "dimension: 4\nsizes: 1 6 5 4\nkinds: scalar domain domain domain\nspacings: nan 1 2 3",
            (1, 2, 3),
            (0, 0, 0),
            "LPS",
        ),
        ("dimension: 4\nsizes: 6 5 4 1", (1, 1, 1), (0, 0, 0), "LPS"),
        (
            "Type: signed short int\n# a comment: here\nmeasurement frame: (1,0,0) (0,1,0) (0,0,1)\nbyte skip: -1",
            (1, 1, 1),
            (0, 0, 0),
            "LPS",
        ),
    ],
)
def test_nrrd_places(header: str, spacing: object, corner: object, orientation: str, tmp_path: Path) -> None:
    header = header.replace("Type: ", "type: ")
    volume = read_volume(nrrd(tmp_path / "a.nrrd", header))
    assert volume.shape == (4, 5, 6)
    assert volume.grid.spacing == spacing
    assert volume.grid.origin == corner
    assert volume.grid.orientation == orientation
    assert any("flipped" in note for note in volume.notes) == ("-2 3" in header)


def test_nrrd_with_lines_to_skip_and_two_axes(tmp_path: Path) -> None:
    values = np.arange(120, dtype="<i2")
    path = nrrd(tmp_path / "a.nrrd", "line skip: 2\nbyte skip: 3", b"one\ntwo\nxyz" + values.tobytes())
    np.testing.assert_array_equal(read_volume(path).values.ravel(), values)
    path = nrrd(tmp_path / "b.nrrd", "byte skip: -1", b"anything at all" + values.tobytes())
    np.testing.assert_array_equal(read_volume(path).values.ravel(), values)
    path = nrrd(
        tmp_path / "c.nrrd",
        "dimension: 2\nsizes: 12 10\nspace dimension: 2\nspace directions: (1,0) (0,2)\nspace origin: (3,4)",
        values.tobytes(),
    )
    picture = read_volume(path)
    assert picture.shape == (1, 10, 12)
    assert picture.grid.spacing == (1, 2, 1)
    assert "one slice" in picture.notes[0]


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ("DimSize = 6 5 -4", "at least 1 voxel"),
        ("DimSize = 6 5", "3 whole numbers"),
        ("DimSize = 99999999 99999999 99999999", "more memory than any machine"),
        ("NDims = 0", "NDims"),
        ("NDims = 4\nDimSize = 5 4 3 2", "holds 2 moments"),
        ("NDims = 5\nDimSize = 5 4 3 1 2", "5th: 2"),
        ("ElementType = MET_STRING", "MET_STRING"),
        ("ElementNumberOfChannels = 3", "needs 720 bytes"),
        ("ElementNumberOfChannels = 0", "0 channels"),
        ("ElementNumberOfChannels = 9999", "9999 channels"),
        ("BinaryData = False", "something else|too long"),
        ("BinaryData = perhaps", "True or False"),
        ("ElementSpacing = 1 0 1", "spacing must be positive"),
        ("ElementSpacing = 1 inf 1", "spacing must be three finite"),
        ("Offset = 1 nan 1", "origin must be three finite"),
        ("TransformMatrix = 0 0 0 0 0 0 0 0 0", "orthonormal"),
        ("TransformMatrix = 1 0 0 0 1 0", "9 numbers"),
        ("CompressedData = True", "cannot be read"),
        ("HeaderSize = -2", "HeaderSize"),
        ("ElementDataFile = LIST", "need 4 data files of 2 axes"),
        ("ElementDataFile = slice%03d.raw 1 4 1", "missing"),
    ],
)
def test_metaimage_headers(header: str, words: str, tmp_path: Path) -> None:
    refuse(meta(tmp_path / "a.mha", header), words)


def test_metaimage_odds_and_ends(tmp_path: Path) -> None:
    values = np.arange(120)
    header = "ElementByteOrderMSB = True\nHeaderSize = -1\nElementSize = 1 2 3\nPosition = 4 5 6"
    path = meta(tmp_path / "a.mha", header, values.astype(">i2").tobytes())
    volume = read_volume(path)
    np.testing.assert_array_equal(volume.values.ravel(), values)
    assert (volume.grid.spacing, volume.grid.origin) == ((1, 2, 3), (4, 5, 6))
    assert volume.dtype.isnative
    (tmp_path / "b.mha").write_bytes(b"NDims = 3\nNDims = 3\n")
    refuse(tmp_path / "b.mha", "twice")
    (tmp_path / "b.mha").write_bytes(b"hello\n")
    refuse(tmp_path / "b.mha", "not a MetaImage")
    assert read_volume(meta(tmp_path / "c.mha", "ElementSpacing = 1 1 -2")).grid.orientation == "LPI"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({0: ("i", (347,))}, "not a NIfTI"),
        ({344: ("4s", (b"\0\0\0\0",))}, "Analyze"),
        ({344: ("4s", (b"ni1\0",))}, "pair"),
        ({40: ("h", (0,))}, "'dim' starts with 0"),
        ({40: ("h", (9,))}, "'dim' starts with 9"),
        ({42: ("h", (-6,))}, "at least 1 voxel"),
        ({44: ("h", (0,))}, "at least 1 voxel"),
        ({40: ("5h", (4, 6, 5, 2, 2))}, "holds 2 moments"),
        ({40: ("6h", (5, 6, 5, 1, 2, 2))}, "t: 2, 5th: 2"),
        ({42: ("h", (7,))}, "280 bytes.*240"),
        ({70: ("h", (128,))}, "needs 360 bytes"),
        ({70: ("h", (32,))}, "complex"),
        ({70: ("h", (3,))}, "'datatype' is 3"),
        ({108: ("f", (0,))}, "vox_offset"),
        ({108: ("f", (np.nan,))}, "vox_offset"),
        ({108: ("f", (1e30,))}, "vox_offset"),
        ({112: ("2f", (np.inf, 0))}, "scl_slope"),
        ({112: ("2f", (2, np.nan))}, "scl_inter"),
        ({280: ("f", (np.nan,))}, "sform"),
        ({280: ("4f", (0, 0, 0, 0)), 296: ("4f", (0, 0, 0, 0))}, "singular"),
        ({284: ("f", (0.5,))}, "sheared"),
        ({254: ("h", (0,)), 80: ("f", (0,))}, "spacing must be positive"),
        ({254: ("h", (0,)), 80: ("f", (np.nan,))}, "spacing must be three finite"),
        ({254: ("h", (0,)), 256: ("f", (np.nan,))}, "quaternion"),
    ],
)
def test_nifti_headers(changes: dict, words: str, tmp_path: Path) -> None:
    refuse(nifti(tmp_path / "a.nii", changes), words)


def test_nifti_scaling(tmp_path: Path) -> None:
    values = small_volume().values.astype(float)
    for slope, intercept in ((2.0, -7.0), (0.1, 0.0), (1.0, 3.0)):
        read = read_volume(nifti(tmp_path / "a.nii", {112: ("2f", (slope, intercept))}))
        assert read.dtype == np.float32
        np.testing.assert_allclose(read.values, values * np.float32(slope) + intercept, rtol=1e-6)
        assert describe_file(tmp_path / "a.nii").dtype == np.float32
    for slope in (0.0, np.nan, 1.0):
        assert read_volume(nifti(tmp_path / "a.nii", {112: ("2f", (slope, 0))})).dtype == np.int16
    big = small_volume("int32")
    big.values[0, 0, 0] = 2**30 + 1  # float32 cannot hold it
    write_volume(big, tmp_path / "b.nii")
    content = bytearray((tmp_path / "b.nii").read_bytes())
    struct.pack_into("<2f", content, 112, 1, 1)
    (tmp_path / "b.nii").write_bytes(bytes(content))
    assert read_volume(tmp_path / "b.nii").values[0, 0, 0] == 2**30 + 2


def test_nifti_remarks(tmp_path: Path) -> None:
    volume = read_volume(nifti(tmp_path / "a.nii", {292: ("f", (50,))}))
    assert "two different places" in volume.notes[0]
    assert read_volume(nifti(tmp_path / "a.nii", {123: ("B", (3,))})).grid.unit == "\u00b5m"
    assert "none of NIfTI" in read_volume(nifti(tmp_path / "a.nii", {123: ("B", (4,))})).notes[0]
    negative = read_volume(nifti(tmp_path / "a.nii", {254: ("h", (0,)), 88: ("f", (-3,))}))
    assert "flipped" in negative.notes[0]
    assert negative.grid.orientation == "LPI"
    assert negative.grid.spacing == (1, 2, 3)
    with pytest.raises(DeformError, match="at most 32767"):
        write_volume(Volume.from_array(np.zeros((1, 1, 32768), np.uint8)), tmp_path / "long.nii")
    with pytest.raises(DeformError, match="no number in float32"):
        write_volume(Volume.from_array(np.zeros((1, 1, 3), np.uint8), spacing=(1e-50, 1, 1)), tmp_path / "small.nii")


def test_the_callers_spacing_rescues_a_file_with_none(tmp_path: Path) -> None:
    path = nrrd(tmp_path / "a.nrrd", "spacings: 0 nan 1")
    refuse(path, "spacing")
    assert read_volume(path, spacing=(1, 2, 3)).grid.spacing == (1, 2, 3)
    with pytest.raises(DeformError, match="positive"):
        read_volume(path, spacing=(1, -2, 3))


def test_big_endian_voxels_that_are_not_finite_are_counted(tmp_path: Path) -> None:
    values = np.ones(120, ">f4")
    values[[3, 50]] = np.nan, np.inf
    volume = read_volume(nrrd(tmp_path / "a.nrrd", "type: float\nendian: big", values.tobytes()))
    assert volume.dtype == np.dtype("f4")
    assert volume.notes == ("2 voxels are not finite, shown as background",)


# -- VTI -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b"<?xml", b'<!DOCTYPE a [<!ENTITY b "c">]><?xml', "document type"),
        (b"<VTKFile", b'<!DOCTYPE a [<!ENTITY b "c">]><VTKFile', "document type"),
        (b'type="ImageData"', b'type="PolyData"', "its type is 'PolyData'"),
        (b"<ImageData", b"<Polydata", "damaged XML|not VTK image data"),
        (b"0 5 0 4 0 3", b"0 5 0 4 0 2", "180 bytes.*240"),
        (b'Extent="0 5 0 4 0 3">', b'Extent="0 5 0 4 0 2">', "pieces"),
        (b'WholeExtent="0 5 0 4 0 3"', b"", "WholeExtent"),
        (b'Int16"', b'String"', "'String'"),
        (b'offset="0"', b'offset="1"', ANY),
        (b"vtkZLibDataCompressor", b"vtkZipDataCompressor", "Zip"),
        (b"UInt64", b"UInt16", "UInt16"),
        (b"UInt64", b"UInt32", ANY),
        (b"LittleEndian", b"BigEndian", ANY),
        (b"LittleEndian", b"PDP", "byte_order"),
        (b'Spacing="1.0 2.0 3.0"', b'Spacing="1.0 0.0 3.0"', "spacing must be positive"),
        (b'Spacing="1.0 2.0 3.0"', b'Spacing="1.0 nan 3.0"', "spacing must be three finite"),
        (b'Direction="1.0 ', b'Direction="2.0 ', "orthonormal"),
        (b'Name="values"', b'Name="values" NumberOfComponents="3"', "components"),
        (b"<PointData", b"<FieldData", "damaged XML"),
        (b"   _", b"   x", "do not begin with _"),
        (b"<Piece", b"<a><a><a><a><a><a><a><a><a><a><a><a><a><a><a><a><a><a><a><a><a><a><Piece", "nesting"),
        (b"<Piece", b"<a/>" * 10_001 + b"<Piece", "tags"),
    ],
)
def test_vti_headers(old: bytes, new: bytes, words: str | None, tmp_path: Path) -> None:
    write_volume(small_volume(), tmp_path / "a.vti")
    content = (tmp_path / "a.vti").read_bytes()
    assert old in content
    (tmp_path / "a.vti").write_bytes(content.replace(old, new))
    if words is None:
        assert read_volume(tmp_path / "a.vti").shape == (4, 5, 6)
    else:
        refuse(tmp_path / "a.vti", words)


def test_vti_with_wrong_counts_before_the_voxels(tmp_path: Path) -> None:
    write_volume(small_volume(), tmp_path / "a.vti")
    content = (tmp_path / "a.vti").read_bytes()
    start = content.index(b"   _") + 4
    for counts in (
        (2**63, 2**20, 240, 50),
        (1, 2**20, 241, 50),
        (240, 1, 0, 50),
        (1, 0, 240, 50),
        (1, 2**40, 240, 50),
        (1, 2**20, 240, 2**60),
        (1, 2**20, 240, 3),
    ):
        changed = content[:start] + struct.pack("<4Q", *counts) + content[start + 32 :]
        (tmp_path / "a.vti").write_bytes(changed)
        refuse(tmp_path / "a.vti", ANY)


# -- row 20: detached data -------------------------------------------------------------------------------------------


def detached_header(path: Path, name: str) -> Path:
    """A header that names a data file."""
    if path.suffix == ".nhdr":
        return nrrd(path, f"data file: {name}", b"")
    return meta(path, f"ElementDataFile = {name}", b"")


@pytest.mark.parametrize(
    "name",
    [
        "/etc/hostname",
        "../secret",
        "sub/../../secret",
        "..\\secret",
        "C:\\secret",
        "C:secret",
        "//server/secret",
        "\\\\server\\secret",
        "link",
        "folder/link2",
        "missing",
        "folder",
        "a\0b",
        ".",
        "",
        "pipe",
        "file:///etc/hostname",
    ],
)
@pytest.mark.parametrize("kind", ["nhdr", "mhd"])
def test_detached_data_only_from_the_headers_own_folder(name: str, kind: str, tmp_path: Path) -> None:
    own = tmp_path / "own"
    (own / "folder").mkdir(parents=True)
    (tmp_path / "secret").write_bytes(b"s" * 240)
    (own / "link").symlink_to(tmp_path / "secret")
    (own / "folder" / "link2").symlink_to(tmp_path / "secret")
    os.mkfifo(own / "pipe")
    path = own / f"a.{kind}"
    detached_header(path, name)
    refuse(path, "data file|plain file|whole numbers")


@pytest.mark.parametrize("kind", ["nhdr", "mhd"])
def test_detached_data_in_the_folder_or_below(kind: str, tmp_path: Path) -> None:
    (tmp_path / "below").mkdir()
    for name in ("a b.bin", "below/c.bin"):
        (tmp_path / name).write_bytes(np.arange(120, dtype="<i2").tobytes())
        path = tmp_path / f"x.{kind}"
        detached_header(path, name)
        assert read_volume(path).values[-1, -1, -1] == 119
    itself = tmp_path / f"self.{kind}"
    detached_header(itself, itself.name)
    refuse(itself, "itself")
    with pytest.raises(DeformError, match="name"):
        write_volume(small_volume(), tmp_path / f"a%d.{kind}")


# -- .npy and .raw ---------------------------------------------------------------------------------------------------


def test_a_pickle_in_disguise_is_never_opened(tmp_path: Path) -> None:
    marker = tmp_path / "marker"

    class Evil:
        def __reduce__(self) -> tuple[object, ...]:
            return Path.touch, (marker,)

    np.save(tmp_path / "a.npy", np.array([[[Evil()]]], dtype=object), allow_pickle=True)
    refuse(tmp_path / "a.npy", "object")
    assert not marker.exists()


@pytest.mark.parametrize(
    ("header", "words"),
    [
        (b"{'descr': '<i2', 'fortran_order': False, 'shape': (4, 5, 6)}", None),
        (b"{'descr': '<i2', 'fortran_order': False, 'shape': (4, 5, -6)}", "at least 1"),
        (b"{'descr': '<i2', 'fortran_order': False, 'shape': (4, 5, 6, 1)}", "axes|at least|cut|bytes"),
        (b"{'descr': '<i2', 'fortran_order': False, 'shape': (120,)}", "three axes"),
        (b"{'descr': '<i2', 'fortran_order': False, 'shape': (4, 5, 10**99)}", "not that of a NumPy file"),
        (
            b"{'descr': '<i2', 'fortran_order': False, 'shape': (4, 5, 99999999999999999999999999)}",
            "more memory than any",
        ),
        (b"{'descr': '<c16', 'fortran_order': False, 'shape': (4, 5, 6)}", "complex"),
        (b"{'descr': '<U2', 'fortran_order': False, 'shape': (4, 5, 6)}", "text"),
        (b"{'descr': [('a', '<i2')], 'fortran_order': False, 'shape': (4, 5, 6)}", "structured"),
        (b"{'descr': '<q9', 'fortran_order': False, 'shape': (4, 5, 6)}", "structured|unknown"),
        (b"{'descr': '<i2', 'fortran_order': 1, 'shape': (4, 5, 6)}", "damaged"),
        (b"{'descr': '<i2', 'shape': (4, 5, 6)}", "not that of a NumPy file"),
        (b"__import__('os').system('true')", "not that of a NumPy file"),
        (b"(" * 9000, "not that of a NumPy file"),
        (b"[" * 60000, "not that of a NumPy file"),
    ],
)
def test_numpy_headers(header: bytes, words: str | None, tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    path.write_bytes(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + bytes(240))
    if words is None:
        assert read_volume(path).dtype == np.int16
    else:
        refuse(path, words)


def test_numpy_versions_and_types(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    header = b"{'descr': '>i8', 'fortran_order': False, 'shape': (1, 1, 2)}"
    path.write_bytes(b"\x93NUMPY\x02\x00" + struct.pack("<I", len(header)) + header + struct.pack(">2q", 1, 2**40))
    volume = read_volume(path)
    assert volume.dtype == np.float64
    assert volume.values.ravel().tolist() == [1, 2**40]
    path.write_bytes(b"\x93NUMPY\x02\x00" + struct.pack("<I", 2**31) + header)
    refuse(path, "header claims")
    path.write_bytes(b"\x93NUMPY\x09\x00" + struct.pack("<I", 100) + header)
    refuse(path, "version")


@pytest.mark.parametrize(
    ("side", "words"),
    [
        (None, "need a file a.raw.json"),
        ("", "not JSON"),
        ("[1]", "should look like"),
        ("[" * 60000, "not JSON"),
        ('{"shape": [4, 5, 6]', "not JSON"),
        ('{"shape": [4, 5, 6], "dtype": "int16", "byte_order": "little", "spacing": [1, NaN, 1]}', "NaN"),
        ('{"shape": [4, 5, 6], "dtype": "int16", "byte_order": "little", "spacing": [1, 1e999, 1]}', "finite"),
        ('{"shape": [4, 5, 6], "dtype": "int16", "byte_order": "little", "spacing": [1, 1]}', "3 numbers"),
        ('{"shape": [4, 5, 6], "dtype": "int16", "byte_order": "little", "spacing": "1 1 1"}', "3 numbers"),
        ('{"shape": [4, 5, 6], "dtype": "int16", "byte_order": "little", "direction": [1, 0, 0]}', "3 x 3 numbers"),
        ('{"shape": [4, 5, 6], "dtype": "int16", "byte_order": "little", "is_labels": "yes"}', "is_labels"),
        ('{"shape": [4, 5, 6], "dtype": "int16", "byte_order": "little", "version": 2}', "newer"),
        ('{"shape": [4, 5, 6], "dtype": "int16", "byte_order": "little", "format": "other"}', "another format"),
        ('{"shape": [4, 5, 6], "dtype": "int16", "byte_order": "little", "offset": -3}', "offset"),
        ('{"shape": [4, 5, 6], "dtype": "int16", "byte_order": "little", "offset": 3}', "240 bytes.*237"),
        ('{"shape": [4, 5, 6], "dtype": "int16"}', "byte_order"),
        ('{"shape": [4, 5, 6], "dtype": "O"}', "dtype"),
        ('{"shape": [4, 5, 6], "dtype": 3}', "dtype"),
        ('{"shape": [4, 5, 6.5], "dtype": "uint8"}', "shape"),
        ('{"shape": [4, 5, true], "dtype": "uint8"}', "shape"),
        ('{"shape": 6, "dtype": "uint8"}', "shape"),
        ('{"dtype": "uint8"}', "shape"),
        ('{"shape": [4, 5, 0], "dtype": "uint8"}', "at least 1"),
        ('{"shape": [2, 4, 5, 6], "dtype": "uint8"}', "t: 2"),
        ('{"shape": [4, 5, 6], "dtype": "uint8"}', "120 bytes.*240"),
        ('{"shape": [4, 5, 6], "dtype": "int16", "byte_order": "little", "x": "' + "y" * 70000 + '"}', "longer than"),
    ],
)
def test_side_files(side: str | None, words: str, tmp_path: Path) -> None:
    (tmp_path / "a.raw").write_bytes(bytes(240))
    if side is not None:
        (tmp_path / "a.raw.json").write_text(side, encoding="utf-8")
    with pytest.raises(VolumeFileError, match=words):
        read_volume(tmp_path / "a.raw")


def test_raw_voxels_with_the_least_description(tmp_path: Path) -> None:
    (tmp_path / "a.raw").write_bytes(np.arange(-3, 120, dtype=">i2").tobytes())
    side = {"shape": [4, 5, 6], "dtype": "int16", "byte_order": "big", "offset": 6, "spacing": [1, 1, -2]}
    (tmp_path / "a.raw.json").write_text(json.dumps(side), encoding="utf-8")
    volume = read_volume(tmp_path / "a.raw")
    np.testing.assert_array_equal(volume.values.ravel(), np.arange(120))
    assert volume.grid.orientation == "LPI"


def test_a_numpy_file_that_no_longer_fits_its_side_file(tmp_path: Path) -> None:
    write_volume(small_volume(), tmp_path / "a.npy")
    np.save(tmp_path / "a.npy", np.zeros((2, 2, 2)))
    refuse(tmp_path / "a.npy", "side file")
    np.save(tmp_path / "a.npy", np.zeros((4, 5, 6)))
    refuse(tmp_path / "a.npy", "float64, but its side file")
    np.save(tmp_path / "a.npy", np.zeros((4, 5, 6), np.int16))
    refuse(tmp_path / "a.npy", "CRC")
    (tmp_path / "a.npy.json").unlink()
    assert read_volume(tmp_path / "a.npy").grid.spacing == (1, 1, 1)


# -- row 23: not a volume --------------------------------------------------------------------------------------------


def test_what_is_no_volume_file(tmp_path: Path) -> None:
    refuse(tmp_path / "missing.nii", "no such file")
    refuse(tmp_path / "no folder" / "a.nii", "no such file")
    (tmp_path / "a.txt").write_text("hello", encoding="utf-8")
    assert ".nii.gz" in refuse(tmp_path / "a.txt", "no known kind")
    nrrd(tmp_path / "b.dat", "")
    refuse(tmp_path / "b.dat", "looks like NRRD.*rename")
    (tmp_path / "folder").mkdir()
    refuse(tmp_path / "folder", "neither a DICOM series nor TIFF")
    (tmp_path / "folder.nii").mkdir()
    refuse(tmp_path / "folder.nii", "neither")
    os.mkfifo(tmp_path / "pipe.nii")
    refuse(tmp_path / "pipe.nii", "not a plain file")
    (tmp_path / "loop.nii").symlink_to(tmp_path / "loop.nii")
    refuse(tmp_path / "loop.nii", "cannot be opened")
    for bad in ("a\0b.nii", "x" * 300 + ".nii"):
        with pytest.raises(VolumeFileError):
            read_volume(tmp_path / bad)
    for suffix in (suffix for entry in FORMATS.values() for suffix in entry.suffixes):
        path = tmp_path / f"empty{suffix}"
        path.write_bytes(b"")
        refuse(path, ANY)
        path.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 4)
        refuse(path, ANY)


def test_names_are_only_text(tmp_path: Path) -> None:
    for name in ("<script>alert(1)<script>", "a b c", "żółw 🐢", "\x1b[31mred\nline"):
        path = tmp_path / f"{name}.nrrd"
        write_volume(small_volume(), path)
        assert read_volume(path).name == name
        path.write_bytes(path.read_bytes()[:-9])
        assert "\x1b" not in refuse(path, ANY)
    refuse(nrrd(tmp_path / "a.nrrd", "space: \x1b]0;owned\x07"), r"\\x1b")


# -- rows 7, 88: memory ----------------------------------------------------------------------------------------------


def test_a_volume_beyond_the_limit_is_refused_with_numbers_and_a_stride(tmp_path: Path) -> None:
    path = tmp_path / "a.nrrd"
    write_volume(Volume.from_array(np.zeros((40, 40, 40), np.float64)), path)
    message = refuse(path, r"500.0 KiB.*limit is 97.7 KiB", max_bytes=100_000)
    stride = int(re.search(r"stride=(\d+)", message)[1])
    assert stride == 2
    assert read_volume(path, max_bytes=100_000, stride=stride).shape == (20, 20, 20)
    refuse(path, "raise max_bytes", max_bytes=1)


def test_a_sparse_file_larger_than_the_machine_is_refused(tmp_path: Path) -> None:
    side = 4 * int(np.cbrt(available_memory())) + 1
    path = nrrd(tmp_path / "a.nrrd", f"type: uchar\nsizes: {side} {side} {side}", b"")
    with path.open("r+b") as file:
        try:
            file.truncate(path.stat().st_size + side**3)
        except OSError:
            pytest.skip("the file system has no sparse files of this size")
    refuse(path, r"60 % of the free memory\); read it with stride=\d")
    assert describe_file(path).memory_bytes == side**3
