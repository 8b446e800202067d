"""NRRD and MetaImage whose voxels are in several files or are written as text."""

from __future__ import annotations

import bz2
import gzip
import os
import zlib
from pathlib import Path

import numpy as np
import pytest

from deformnb.errors import VolumeFileError
from deformnb.io import open_series, read_volume

VALUES = np.random.default_rng(0).integers(-3000, 3000, (4, 5, 6)).astype("<i2")
NRRD = "NRRD0004\ntype: int16\ndimension: 3\nsizes: 6 5 4\nspacings: 1 1 2\nendian: little\n"
META = "ObjectType = Image\nNDims = 3\nDimSize = 6 5 4\nElementType = MET_SHORT\nElementSpacing = 1 1 2\n"
PACK = {
    "raw": bytes,
    "gzip": gzip.compress,
    "bzip2": bz2.compress,
    "hex": lambda data: data.hex(" ", 7).encode(),
    "ascii": lambda data: ", ".join(map(str, np.frombuffer(data, "<i2"))).encode(),
}


def refuse(path: Path, words: str) -> None:
    with pytest.raises(VolumeFileError, match=words) as caught:
        read_volume(path)
    assert "\n" not in str(caught.value)


def files(folder: Path, encoding: str = "raw", skipped: bytes = b"") -> None:
    for k in range(4):
        (folder / f"s{k + 1}.raw").write_bytes(skipped + PACK[encoding](VALUES[k].tobytes()))


FOUR = "s1.raw\ns2.raw\ns3.raw\ns4.raw\n"
LISTS = {
    "list": f"LIST\n{FOUR}",
    "list of pictures": f"LIST 2\n{FOUR}",
    "list crlf": "LIST\r\ns1.raw\r\ns2.raw\r\ns3.raw\r\ns4.raw\r\n",
    "pattern": "s%d.raw 1 4 1\n",
    "pattern of pictures": "s%d.raw 1 4 1 2\n",
}


@pytest.mark.parametrize("named", LISTS)
@pytest.mark.parametrize("encoding", PACK)
def test_nrrd_in_several_files(named: str, encoding: str, tmp_path: Path) -> None:
    files(tmp_path, encoding)
    (tmp_path / "a.nhdr").write_bytes(f"{NRRD}encoding: {encoding}\ndata file: {LISTS[named]}".encode())
    read = read_volume(tmp_path / "a.nhdr")
    np.testing.assert_array_equal(read.values, VALUES)
    assert read.grid.spacing == (1, 1, 2)


@pytest.mark.parametrize("skip", ["line skip: 1\nbyte skip: 3", "byte skip: -1"])
def test_what_is_skipped_is_skipped_in_each_file(skip: str, tmp_path: Path) -> None:
    files(tmp_path, skipped=b"a line\nabc")
    (tmp_path / "a.nhdr").write_text(f"{NRRD}encoding: raw\n{skip}\ndata file: s%d.raw 4 1 -1\n", encoding="utf-8")
    np.testing.assert_array_equal(read_volume(tmp_path / "a.nhdr").values, VALUES[::-1])


def test_files_of_rows_and_of_half_a_volume(tmp_path: Path) -> None:
    for k, row in enumerate(VALUES.reshape(20, 6)):
        (tmp_path / f"r{k:02d}.raw").write_bytes(row.tobytes())
    (tmp_path / "rows.nhdr").write_text(f"{NRRD}encoding: raw\ndata file: r%02d.raw 0 19 1 1\n", encoding="utf-8")
    np.testing.assert_array_equal(read_volume(tmp_path / "rows.nhdr").values, VALUES)
    (tmp_path / "h0").write_bytes(VALUES[:2].tobytes())
    (tmp_path / "h1").write_bytes(VALUES[2:].tobytes())
    (tmp_path / "halves.nhdr").write_text(f"{NRRD}encoding: raw\ndata file: LIST 3\nh0\nh1\n", encoding="utf-8")
    np.testing.assert_array_equal(read_volume(tmp_path / "halves.nhdr").values, VALUES)


def test_moments_in_several_files(tmp_path: Path) -> None:
    for k in range(4):
        (tmp_path / f"t{k}.raw").write_bytes(VALUES[k].tobytes())
    head = "NRRD0004\ntype: int16\ndimension: 4\nsizes: 6 5 1 4\nkinds: domain domain domain list\nendian: little\n"
    (tmp_path / "a.nhdr").write_text(f"{head}encoding: raw\ndata file: t%d.raw 0 3 1\n", encoding="utf-8")
    moments = [channels[0].values[0] for channels in open_series(tmp_path / "a.nhdr")]
    np.testing.assert_array_equal(moments, VALUES)


@pytest.mark.parametrize(
    ("files_of", "words"),
    [
        ("LIST\ns1.raw\ns2.raw\ns3.raw\n", "need 4 data files of 2 axes, and it names 3"),
        ("LIST\ns1.raw\ns2.raw\ns3.raw\ns4.raw\ns5.raw\n", "need 4 data files of 2 axes, and it names 5"),
        ("LIST\ns1.raw\ns2.raw\ns3.raw\ns3.raw\n", "names a file twice"),
        ("LIST\n", "has 0 names"),
        ("LIST\ns1.raw\ns2.raw\ns3.raw\n../s4.raw\n", "not in the header's own folder"),
        ("LIST\ns1.raw\ns2.raw\ns3.raw\nnone.raw\n", "missing"),
        ("LIST\ns1.raw\ns2.raw\ns3.raw\nshort.raw\n", "60 bytes.*59"),
        ("LIST\ns1.raw\ns2.raw\ns3.raw\nlong.raw\n", "60 bytes.*61"),
        ("LIST\ns1.raw\ns2.raw\ns3.raw\npipe.raw\n", "not a plain file"),
        ("LIST\ns1.raw\ns2.raw\ns3.raw\nfolder.raw\n", "not a plain file"),
        ("s%d.raw 1 4 0\n", "are 0; 1 to"),
        ("s%d.raw 1 999999999 1\n", "are 999999999; 1 to"),
        ("s%d.raw\n", "pattern"),
        ("s%s.raw 1 4 1\n", "pattern"),
        ("s%d%d.raw 1 4 1\n", "pattern"),
        ("s%9999d.raw 1 4 1\n", "pattern"),
        ("s%d.raw 1 4 1 9\n", "9 axes"),
    ],
)
@pytest.mark.parametrize("kind", ["nhdr", "mhd"])
def test_sets_that_are_none(kind: str, files_of: str, words: str, tmp_path: Path) -> None:
    files(tmp_path)
    (tmp_path / "short.raw").write_bytes(bytes(59))
    (tmp_path / "long.raw").write_bytes(bytes(61))
    (tmp_path / "folder.raw").mkdir()
    os.mkfifo(tmp_path / "pipe.raw")
    if kind == "mhd":
        (tmp_path / "a.mhd").write_text(f"{META}ElementDataFile = {files_of}", encoding="utf-8")
    else:
        (tmp_path / "a.nhdr").write_text(f"{NRRD}encoding: raw\ndata file: {files_of}", encoding="utf-8")
    refuse(tmp_path / f"a.{kind}", words)


@pytest.mark.parametrize("named", [name for name in LISTS if "pictures" not in name])
def test_metaimage_in_several_files_as_itk_reads_it(named: str, tmp_path: Path) -> None:
    sitk = pytest.importorskip("SimpleITK")
    files(tmp_path)
    (tmp_path / "a.mhd").write_bytes(f"{META}ElementDataFile = {LISTS[named]}".encode())
    read = read_volume(tmp_path / "a.mhd").values
    np.testing.assert_array_equal(read, VALUES)
    np.testing.assert_array_equal(read, sitk.GetArrayFromImage(sitk.ReadImage(str(tmp_path / "a.mhd"))))


def test_metaimage_of_packed_files_and_of_text(tmp_path: Path) -> None:
    for k in range(4):
        (tmp_path / f"s{k + 1}.raw").write_bytes(zlib.compress(VALUES[k].tobytes()))
    (tmp_path / "a.mhd").write_text(f"{META}CompressedData = True\nElementDataFile = LIST 2D\n{FOUR}", encoding="utf-8")
    np.testing.assert_array_equal(read_volume(tmp_path / "a.mhd").values, VALUES)
    text = " ".join(map(str, VALUES.ravel()))
    (tmp_path / "a.mha").write_text(f"{META}BinaryData = False\nElementDataFile = LOCAL\n{text}\n", encoding="utf-8")
    np.testing.assert_array_equal(read_volume(tmp_path / "a.mha").values, VALUES)


@pytest.mark.parametrize(
    ("encoding", "data", "words"),
    [
        ("ascii", "1 " * 119, "holds 238"),
        ("ascii", "1 " * 121, "holds more"),
        ("ascii", "1 " * 119 + "x", "something else"),
        ("ascii", "1 " * 119 + "40000", "something else"),
        ("ascii", "1 " * 119 + "1.5", "something else"),
        ("ascii", "1" * 300, "too long"),
        ("hex", "00" * 239, "holds 239"),
        ("hex", "00" * 241, "holds more"),
        ("hex", "00" * 239 + "0", "one digit"),
        ("hex", "00" * 239 + "xy", "."),
        ("hex", "", "holds 0"),
    ],
)
def test_text_that_is_no_voxels(encoding: str, data: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "a.nrrd").write_text(f"{NRRD}encoding: {encoding}\n\n{data}", encoding="utf-8")
    refuse(tmp_path / "a.nrrd", words)


def test_floats_and_bytes_as_text(tmp_path: Path) -> None:
    values = np.array([0.1, -1e300, 5e-324, 3.0]).reshape(1, 2, 2)
    for encoding, text in (("ascii", " ".join(map(repr, values.ravel().tolist()))), ("hex", values.tobytes().hex())):
        (tmp_path / "a.nrrd").write_text(
            f"NRRD0004\ntype: double\ndimension: 3\nsizes: 2 2 1\nendian: little\nencoding: {encoding}\n\n{text}\n",
            encoding="utf-8",
        )
        np.testing.assert_array_equal(read_volume(tmp_path / "a.nrrd").values, values)
