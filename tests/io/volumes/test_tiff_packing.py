"""Pixels of TIFF files in every packing that tifffile writes, as tifffile itself reads them, and errors."""

from __future__ import annotations

import pickle
import struct
import time
import tracemalloc
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import pytest
import tifffile

from deformnb.chunked import open_volume
from deformnb.errors import VolumeFileError
from deformnb.io import read_channels, read_volume
from deformnb.io.files.codecs import unpack_picture

CHANCE = np.random.default_rng(0)
GREY = np.cumsum(CHANCE.integers(0, 5, (3, 40, 48)), axis=2).astype(np.uint8)
COLOURS = np.stack([GREY, GREY[:, ::-1], GREY[..., ::-1]], axis=-1)
DEEP = GREY.astype(np.uint16) * 200
SIGNED = DEEP.astype(np.int32) - 20000
FINE = DEEP / np.float32(7)

# compression, with the pictures that it holds
CODECS: dict[str, tuple[np.ndarray, ...]] = {
    "none": (GREY, DEEP, SIGNED, FINE, COLOURS),
    "deflate": (GREY, DEEP, SIGNED, FINE, COLOURS),
    "lzw": (GREY, DEEP, FINE, COLOURS),
    "packbits": (GREY, COLOURS),
    "zstd": (GREY, DEEP, FINE, COLOURS),
    "lzma": (GREY, DEEP, FINE, COLOURS),
    "jpeg": (GREY, COLOURS),
    "jpeg2000": (GREY, DEEP, COLOURS),
    "lerc": (GREY, DEEP, FINE),
    "png": (GREY, DEEP, COLOURS),
    "jpegxl": (GREY, DEEP, COLOURS),
    "webp": (COLOURS,),
}
PARTS: dict[str, dict[str, Any]] = {"strips": {"rowsperstrip": 16}, "tiles": {"tile": (16, 32)}}


def compare(path: Path) -> None:
    """The file as tifffile reads it."""
    expected = tifffile.imread(path)
    with tifffile.TiffFile(path) as file:
        page = file.pages[0]
        planar = page.samplesperpixel > 1 and page.planarconfig == 2
    if planar:
        expected = np.moveaxis(expected, -3, -1)
    if expected.ndim == 4:
        np.testing.assert_array_equal(read_channels(path).values, expected)
    else:
        np.testing.assert_array_equal(read_volume(path).values, expected[None] if expected.ndim == 2 else expected)


@pytest.mark.parametrize("parts", PARTS)
@pytest.mark.parametrize(("codec", "values"), [(codec, values) for codec, all_ in CODECS.items() for values in all_])
def test_every_packing_is_read_as_tifffile_reads_it(codec: str, values: np.ndarray, parts: str, tmp_path: Path) -> None:
    is_colour = values.ndim == 4
    tifffile.imwrite(
        tmp_path / "a.tif",
        values,
        compression=None if codec == "none" else codec,
        metadata=None,
        photometric="rgb" if is_colour else "minisblack",
        **PARTS[parts],
    )
    compare(tmp_path / "a.tif")


@pytest.mark.parametrize("parts", PARTS)
@pytest.mark.parametrize("codec", [None, "zlib", "lzw", "png"])
def test_parts_of_pages_are_those_of_the_whole(codec: str | None, parts: str, tmp_path: Path) -> None:
    tifffile.imwrite(
        tmp_path / "a.tif", DEEP, compression=codec, metadata=None, photometric="minisblack", **PARTS[parts]
    )
    source = pickle.loads(pickle.dumps(open_volume(tmp_path / "a.tif")))  # as it is sent to another process
    whole, row, column = slice(0, 3), slice(39, 40), slice(47, 48)
    for part in (
        (whole,) * 3,
        (slice(1, 2), slice(15, 17), slice(31, 48)),
        (whole, row, slice(0, 48)),
        (slice(2, 3), slice(0, 40), column),
        (slice(0, 0), slice(3, 4), slice(5, 9)),
    ):
        np.testing.assert_array_equal(source.read(part), DEEP[part])


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("codec", ["deflate", "lzw", "zstd", "lzma"])
@pytest.mark.parametrize(
    "values",
    [GREY, DEEP, SIGNED, FINE, FINE.astype("f2"), FINE.astype("f8"), COLOURS],
    ids=lambda values: f"{values.dtype} {values.ndim}",
)
def test_predictors_are_undone(values: np.ndarray, codec: str, order: str, tmp_path: Path) -> None:
    tifffile.imwrite(
        tmp_path / "a.tif",
        values,
        compression=codec,
        predictor=True,
        byteorder=order,
        metadata=None,
        photometric="rgb" if values.ndim == 4 else "minisblack",
        tile=(16, 32),
    )
    compare(tmp_path / "a.tif")


def test_differences_of_floats_are_those_of_their_bits(tmp_path: Path) -> None:
    values = CHANCE.normal(size=(9, 13)).astype(np.float32)
    data = imagecodecs.zlib_encode(imagecodecs.delta_encode(values, axis=-1).tobytes())
    fields = [
        (256, 3, 1, 13),
        (257, 3, 1, 9),
        (258, 3, 1, 32),
        (259, 3, 1, 8),
        (262, 3, 1, 1),
        (273, 4, 1, 8),
        (278, 3, 1, 9),
        (279, 4, 1, len(data)),
        (317, 3, 1, 2),
        (339, 3, 1, 3),
    ]
    (tmp_path / "a.tif").write_bytes(ifd(fields, data))
    np.testing.assert_array_equal(read_volume(tmp_path / "a.tif").values[0], values)
    compare(tmp_path / "a.tif")


@pytest.mark.parametrize("codec", [None, "zlib", "jpeg"])
def test_planes_of_colours(codec: str | None, tmp_path: Path) -> None:
    planes = np.moveaxis(COLOURS, -1, 1)
    tifffile.imwrite(
        tmp_path / "a.tif",
        planes,
        photometric="rgb",
        planarconfig="separate",
        compression=codec,
        metadata=None,
        rowsperstrip=16,
    )
    compare(tmp_path / "a.tif")
    assert codec == "jpeg" or np.array_equal(read_channels(tmp_path / "a.tif").values, COLOURS)


def test_samples_that_are_no_colours_are_channels(tmp_path: Path) -> None:
    values = CHANCE.integers(0, 255, (2, 20, 24, 5)).astype(np.uint8)
    tifffile.imwrite(tmp_path / "a.tif", values, photometric="minisblack", planarconfig="contig", metadata=None)
    found = read_channels(tmp_path / "a.tif")
    assert found.kind == "channels"
    np.testing.assert_array_equal(found.values, values)


@pytest.mark.parametrize("bits", [1, 2, 4, 6, 10, 12, 14, 20, 24])
@pytest.mark.parametrize("packed", [False, True])
def test_numbers_of_few_bits(bits: int, packed: bool, tmp_path: Path) -> None:
    dtype = np.dtype("u1" if bits <= 8 else "u2" if bits <= 16 else "u4")
    values = CHANCE.integers(0, 2**bits, (9, 13)).astype(dtype)
    rows = [np.packbits([int(bit) for number in row for bit in f"{number:0{bits}b}"]) for row in values]
    data = np.concatenate(rows).tobytes()
    data = imagecodecs.lzw_encode(data) if packed else data
    fields = [
        (256, 3, 1, 13),
        (257, 3, 1, 9),
        (258, 3, 1, bits),
        (259, 3, 1, 5 if packed else 1),
        (262, 3, 1, 1),
        (273, 4, 1, 8),
        (278, 3, 1, 9),
        (279, 4, 1, len(data)),
    ]
    (tmp_path / "a.tif").write_bytes(ifd(fields, data))
    np.testing.assert_array_equal(read_volume(tmp_path / "a.tif").values[0], values)
    compare(tmp_path / "a.tif")


def ifd(fields: list[tuple[int, int, int, int]], data: bytes) -> bytes:
    """A little-endian file of one page: its fields (number, type, count, value) with the data at byte 8."""
    at = 8 + len(data) + len(data) % 2
    entries = b"".join(struct.pack("<HHII", *field) for field in sorted(fields))
    head = struct.pack("<2sHI", b"II", 42, at) + data.ljust(at - 8, b"\0")
    return head + struct.pack("<H", len(fields)) + entries + bytes(4)


@pytest.mark.parametrize("reversed_bits", [False, True])
def test_order_of_bits_and_halves_of_floats(reversed_bits: bool, tmp_path: Path) -> None:
    values = CHANCE.integers(0, 255, (9, 13)).astype(np.uint8)
    data = imagecodecs.bitorder_decode(values.tobytes()) if reversed_bits else values.tobytes()
    fields = [
        (256, 3, 1, 13),
        (257, 3, 1, 9),
        (258, 3, 1, 8),
        (262, 3, 1, 1),
        (266, 3, 1, 1 + reversed_bits),
        (273, 4, 1, 8),
        (278, 3, 1, 9),
        (279, 4, 1, len(data)),
    ]
    (tmp_path / "a.tif").write_bytes(ifd(fields, data))
    np.testing.assert_array_equal(read_volume(tmp_path / "a.tif").values[0], values)
    fields = [
        (256, 3, 1, 3),
        (257, 3, 1, 1),
        (258, 3, 1, 24),
        (262, 3, 1, 1),
        (273, 4, 1, 8),
        (278, 3, 1, 1),
        (279, 4, 1, 9),
        (339, 3, 1, 3),
    ]
    data = b"".join(imagecodecs.float24_encode(np.array([n], np.float32), byteorder="<") for n in (1.5, -2.25, 1024))
    (tmp_path / "b.tif").write_bytes(ifd(fields, data))
    assert read_volume(tmp_path / "b.tif").values.ravel().tolist() == [1.5, -2.25, 1024]


def test_fax_is_read(tmp_path: Path) -> None:
    pillow = pytest.importorskip("PIL.Image")
    values = CHANCE.integers(0, 2, (9, 16)).astype(bool)
    for codec in ("group3", "group4"):
        pillow.fromarray(values).save(tmp_path / "a.tif", compression=codec)
        expected = np.array(pillow.open(tmp_path / "a.tif"))
        np.testing.assert_array_equal(read_volume(tmp_path / "a.tif").values[0], expected)


def test_jpeg_xr_whose_decoder_may_end_python_is_refused(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", GREY, compression="jpegxr", metadata=None, photometric="minisblack")
    with pytest.raises(VolumeFileError, match="JPEG XR, whose decoder ends Python"):
        read_volume(tmp_path / "a.tif")


def test_previews_and_masks_are_no_slices(tmp_path: Path) -> None:
    with tifffile.TiffWriter(tmp_path / "a.tif") as writer:
        for plane in GREY:
            writer.write(plane, metadata=None)
            writer.write(plane[::4, ::4], subfiletype=1, metadata=None)
    read = read_volume(tmp_path / "a.tif")
    np.testing.assert_array_equal(read.values, GREY)
    assert "3 pages that are smaller copies or masks of others were left out" in read.notes


BOMBS = {
    "zstd": imagecodecs.zstd_encode,
    "lzma": imagecodecs.lzma_encode,
    "deflate": imagecodecs.zlib_encode,
    "lzw": imagecodecs.lzw_encode,
    "packbits": imagecodecs.packbits_encode,
}


@pytest.mark.parametrize("codec", BOMBS)
@pytest.mark.parametrize("size", [40 * 48 - 1, 40 * 48 + 1, 2**26])
def test_bytes_of_another_number_are_refused_and_not_unpacked(codec: str, size: int, tmp_path: Path) -> None:
    bomb = bytes(BOMBS[codec](bytes(size)))
    tifffile.imwrite(
        tmp_path / "a.tif",
        iter([bomb]),
        shape=(40, 48),
        dtype=np.uint8,
        compression=codec,
        metadata=None,
        rowsperstrip=40,
    )
    tracemalloc.start()
    with pytest.raises(VolumeFileError, match=r"should have 1920 bytes but .*(has|unpacked)"):
        read_volume(tmp_path / "a.tif")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < len(bomb) + 2**24  # of LZMA the dictionary of its usual setting takes 8 MiB


PICTURES = ["jpeg8", "jpeg2k", "png", "lerc", "jpegls", "jpegxl"]


@pytest.mark.parametrize("codec", PICTURES)
def test_pictures_of_another_size_or_type_are_refused_before_they_are_unpacked(codec: str) -> None:
    coded = getattr(imagecodecs, f"{codec}_encode")(np.zeros((1500, 1500), np.uint8))
    began = time.process_time()
    for shape in ((40, 48), (1500, 1500, 3)):
        with pytest.raises(ValueError, match=r"shape|picture|parts"):
            unpack_picture(codec, coded, shape, np.dtype("u1"))
    # reading the header takes microseconds, unpacking tenths of a second
    assert time.process_time() - began < 0.05
    with pytest.raises(ValueError, match="dtype"):
        unpack_picture(codec, coded, (1500, 1500), np.dtype("u2"))


@pytest.mark.parametrize("codec", PICTURES)
def test_cut_pictures_are_refused(codec: str) -> None:
    coded = bytes(getattr(imagecodecs, f"{codec}_encode")(CHANCE.integers(0, 255, (64, 64)).astype(np.uint8)))
    for length in (0, 3, 12, 30, len(coded) // 2):
        with pytest.raises(ValueError, match=r"."):
            unpack_picture(codec, coded[:length], (64, 64), np.dtype("u1"))
