"""TIFF stacks: one file of many pages, or a folder of pages."""

from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from format_table import bound

from deformnb.errors import VolumeFileError
from deformnb.io import (
    describe_file,
    open_series,
    read_channels,
    read_volume,
    write_channels,
    write_series,
    write_volume,
)
from deformnb.io.volumes.tiff import read_header
from deformnb.volume.channels import Channels
from deformnb.volume.units import ratio
from deformnb.volume.volume import Grid, Volume

tifffile = pytest.importorskip("tifffile")

STACK = np.random.default_rng(0).integers(0, 200, (5, 33, 47)).astype(np.uint16)


def refuse(path: Path, words: str) -> None:
    with pytest.raises(VolumeFileError, match=words) as caught:
        read_volume(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("dtype", ["uint8", "int8", "uint16", "int16", "uint32", "int32", "float32", "float64"])
@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("big", [False, True])
def test_every_type_and_byte_order(dtype: str, order: str, big: bool, tmp_path: Path) -> None:
    values = STACK.astype(dtype)
    tifffile.imwrite(tmp_path / "a.tif", values, byteorder=order, bigtiff=big, photometric="minisblack", metadata=None)
    read = read_volume(tmp_path / "a.tif")
    np.testing.assert_array_equal(read.values, values)
    assert read.dtype.name == ("int32" if dtype == "uint32" else dtype)
    assert "the distance of slices" in read.notes[0]
    np.testing.assert_array_equal(read_volume(tmp_path / "a.tif", stride=3).values, values[::3, ::3, ::3])
    assert read_volume(tmp_path / "a.tif", spacing=(1, 2, 3)).grid.spacing == (1, 2, 3)


@pytest.mark.parametrize("compression", [None, "zlib", "adobe_deflate", "lzw", "packbits"])
@pytest.mark.parametrize("predictor", [False, True])
@pytest.mark.parametrize("layout", [{"rowsperstrip": 10}, {"rowsperstrip": 33}, {"tile": (16, 32)}])
def test_strips_tiles_and_packing(compression: str | None, predictor: bool, layout: dict, tmp_path: Path) -> None:
    if compression in ("lzw", "packbits") or predictor:
        pytest.importorskip("imagecodecs")
    if predictor and compression in (None, "packbits"):
        pytest.skip("a predictor only goes with deflate and LZW")
    tifffile.imwrite(
        tmp_path / "a.tiff",
        STACK,
        compression=compression,
        predictor=predictor,
        metadata=None,
        photometric="minisblack",
        byteorder=">",
        **layout,
    )
    np.testing.assert_array_equal(read_volume(tmp_path / "a.tiff").values, STACK)


def test_stacks_of_imagej(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    tifffile.imwrite(
        path,
        STACK,
        imagej=True,
        byteorder=">",
        resolution=(2.0, 4.0),
        metadata={"axes": "ZYX", "spacing": 3, "unit": "um"},
    )
    read = read_volume(path)
    assert read.grid.spacing == (0.5, 0.25, 3.0)
    assert (read.grid.unit, read.notes) == ("\u00b5m", ())
    np.testing.assert_array_equal(read.values, STACK)
    whole = path.read_bytes()
    # beyond 4 GiB ImageJ writes one page and all voxels behind it; the same with a chain cut after the first page
    first = struct.unpack_from(">I", whole, 4)[0]
    count = struct.unpack_from(">H", whole, first)[0]
    alone = bytearray(whole)
    struct.pack_into(">I", alone, first + 2 + 12 * count, 0)
    path.write_bytes(bytes(alone))
    np.testing.assert_array_equal(read_volume(path).values, STACK)
    path.write_bytes(bytes(alone[: STACK.nbytes // 2]))
    refuse(path, "cut short|5 slices")
    short = bytearray(whole)
    second = struct.unpack_from(">I", whole, first + 2 + 12 * count)[0]
    struct.pack_into(">I", short, second + 2 + 12 * struct.unpack_from(">H", whole, second)[0], 0)
    path.write_bytes(bytes(short))
    refuse(path, "claims 5 slices but it has 2 pages")
    for axes in ("CYX", "TYX"):
        tifffile.imwrite(path, STACK, imagej=True, metadata={"axes": axes})
        refuse(path, f"holds 5 {'channels' if axes == 'CYX' else 'moments'}")


def test_stacks_of_ome(tmp_path: Path) -> None:
    path = tmp_path / "a.ome.tif"
    sizes = {"axes": "ZYX", "PhysicalSizeX": 0.5, "PhysicalSizeY": 0.25, "PhysicalSizeZ": 3.0}
    tifffile.imwrite(path, STACK, metadata=sizes, photometric="minisblack")
    read = read_volume(path)
    assert read.grid.spacing == (0.5, 0.25, 3.0)
    assert (read.grid.unit, read.notes) == ("\u00b5m", ())
    tifffile.imwrite(path, STACK, metadata={"axes": "CYX"}, photometric="minisblack")
    refuse(path, "holds 5 channels")


def test_a_pipe_or_a_folder_in_the_place_of_a_slice_is_refused(tmp_path: Path) -> None:
    for number in range(3):
        tifffile.imwrite(tmp_path / f"{number}.tif", STACK[number])
    for make in (os.mkfifo, os.mkdir):
        (tmp_path / "1.tif").rmdir() if (tmp_path / "1.tif").is_dir() else (tmp_path / "1.tif").unlink()
        make(tmp_path / "1.tif")
        refuse(tmp_path, "1.tif: this is not a plain file")


def test_ome_names_of_other_files_are_not_followed(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "secret.tif", STACK[:1])
    text = (
        '<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06"><Image ID="Image:0">'
        '<Pixels ID="Pixels:0" DimensionOrder="XYZCT" Type="uint16" SizeX="47" SizeY="33" SizeZ="2" SizeC="1" '
        'SizeT="1"><TiffData IFD="0" FirstZ="1"><UUID FileName="secret.tif">urn:uuid:1</UUID></TiffData></Pixels>'
        "</Image></OME>"
    )
    tifffile.imwrite(tmp_path / "a.tif", STACK[3], description=text, metadata=None)
    refuse(tmp_path / "a.tif", "claims 2 slices .* one part of a set of files")


def test_a_folder_of_slices_in_natural_order(tmp_path: Path) -> None:
    for number in range(5):
        tifffile.imwrite(tmp_path / f"Slice{number + 8}.{'tif' if number % 2 else 'TIFF'}", STACK[number])
    (tmp_path / "notes.txt").write_text("not a slice", encoding="utf-8")
    read = read_volume(tmp_path)
    np.testing.assert_array_equal(read.values, STACK)
    assert "5 files in the order Slice8.TIFF ... Slice12.TIFF" in read.notes[0]
    assert read.name == tmp_path.name
    assert describe_file(tmp_path).file_bytes > STACK.nbytes
    tifffile.imwrite(tmp_path / "Slice99.tif", STACK[0, :, :-1])
    refuse(tmp_path, "page 6 has")
    tifffile.imwrite(tmp_path / "Slice99.tif", STACK)
    refuse(tmp_path, "5 pages")


@pytest.mark.parametrize(
    ("values", "options", "words"),
    [
        (np.zeros((33, 47), np.complex64), {}, "bits|format"),
        (np.zeros((33, 47, 4), np.uint8), {"photometric": "separated"}, "colours"),
        (np.zeros((33, 47, 3), np.uint8), {"photometric": "cielab"}, "colours"),
        (np.zeros((8, 33, 47), np.uint8), {"volumetric": True, "tile": (16, 16, 16)}, "each of its pages is a volume"),
    ],
)
def test_pixels_that_are_no_voxels(values: np.ndarray, options: dict, words: str, tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", values, **options)
    refuse(tmp_path / "a.tif", words)


def test_pages_that_differ_or_run_in_a_circle(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    with tifffile.TiffWriter(path) as writer:
        writer.write(STACK[0], metadata=None)
        writer.write(STACK[0, :10], metadata=None)
    refuse(path, r"page 2 has \(10, 47\)")
    tifffile.imwrite(path, STACK[0], metadata=None, byteorder="<")
    data = bytearray(path.read_bytes())
    first = struct.unpack_from("<I", data, 4)[0]
    count = struct.unpack_from("<H", data, first)[0]
    struct.pack_into("<I", data, first + 2 + 12 * count, first)
    path.write_bytes(bytes(data))
    refuse(path, "circle")


@pytest.mark.parametrize("compression", [None, "zlib", "lzw", "packbits"])
def test_a_file_cut_anywhere_is_refused(compression: str | None, tmp_path: Path) -> None:
    if compression in ("lzw", "packbits"):
        pytest.importorskip("imagecodecs")
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, STACK[:2], compression=compression, metadata=None, photometric="minisblack")
    whole = path.read_bytes()
    with tifffile.TiffFile(path) as file:
        end = max(a + b for page in file.pages for a, b in zip(page.dataoffsets, page.databytecounts, strict=True))
    for length in [*range(0, end, 97), end - 1]:
        path.write_bytes(whole[:length])
        refuse(path, ".")


def test_a_strip_that_unpacks_to_more_is_not_unpacked(tmp_path: Path) -> None:
    import tracemalloc

    path = tmp_path / "a.tif"
    bomb = zlib.compress(bytes(2**26))
    tifffile.imwrite(
        path, iter([bomb]), shape=(33, 47), dtype=np.uint16, compression="zlib", metadata=None, rowsperstrip=33
    )
    tracemalloc.start()
    refuse(path, "or more")
    assert tracemalloc.get_traced_memory()[1] < 2**20
    tracemalloc.stop()


def test_lzw_and_packbits_bombs(tmp_path: Path) -> None:
    imagecodecs = pytest.importorskip("imagecodecs")
    for name, encode in (("lzw", imagecodecs.lzw_encode), ("packbits", imagecodecs.packbits_encode)):
        for size in (33 * 47 * 2 - 1, 33 * 47 * 2 + 1, 2**16):
            tifffile.imwrite(
                tmp_path / "a.tif",
                iter([bytes(encode(bytes(size)))]),
                shape=(33, 47),
                dtype=np.uint16,
                compression=name,
                metadata=None,
                rowsperstrip=33,
            )
            refuse(tmp_path / "a.tif", "should have 3102 bytes")


def test_packing_without_its_package_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("imagecodecs")
    tifffile.imwrite(tmp_path / "a.tif", STACK, compression="lzw", photometric="minisblack")
    monkeypatch.setitem(__import__("sys").modules, "imagecodecs", None)
    with pytest.raises(ImportError, match="pip install imagecodecs"):
        read_volume(tmp_path / "a.tif")


def field_place(data: bytes, tag: int) -> int:
    """Offset of the entry of a field of the first page, in a little-endian file that is no BigTIFF."""
    first = struct.unpack_from("<I", data, 4)[0]
    count = struct.unpack_from("<H", data, first)[0]
    places = range(first + 2, first + 2 + 12 * count, 12)
    return next(at for at in places if struct.unpack_from("<H", data, at)[0] == tag)


@pytest.mark.parametrize(("tag", "name"), [(339, "sample format"), (317, "predictor"), (282, "resolution")])
@pytest.mark.parametrize(
    ("part", "number", "words"), [(2, 200, "field {} has the unknown type 200"), (4, 0, "lacks the field {}")]
)
def test_a_damaged_field_does_not_count_as_absent(
    tag: int, name: str, part: int, number: int, words: str, tmp_path: Path
) -> None:
    if (name, part) == ("resolution", 4):
        pytest.skip("a resolution without a value is one of 1, as ImageJ writes where it knows none")
    pytest.importorskip("imagecodecs")
    path = tmp_path / "a.tif"
    tifffile.imwrite(
        path,
        STACK[0].astype(np.int16) - 100,
        byteorder="<",
        compression="zlib",
        predictor=True,
        metadata=None,
        resolution=(2.0, 4.0),
    )
    data = bytearray(path.read_bytes())
    struct.pack_into("<H", data, field_place(data, tag) + part, number)
    path.write_bytes(bytes(data))
    refuse(path, words.format(tag))


def test_deflated_voxels_without_their_check_sum_are_refused(tmp_path: Path) -> None:
    packed = zlib.compress(STACK[0].tobytes())
    options = {"shape": (33, 47), "dtype": np.uint16, "compression": "zlib", "metadata": None, "rowsperstrip": 33}
    tifffile.imwrite(tmp_path / "a.tif", iter([packed]), byteorder="<", **options)
    np.testing.assert_array_equal(read_volume(tmp_path / "a.tif").values[0], STACK[0])
    tifffile.imwrite(tmp_path / "a.tif", iter([packed[:-4]]), byteorder="<", **options)
    refuse(tmp_path / "a.tif", "should have 3102 bytes but the data end before their check sum")


def test_fields_shared_by_many_pages_take_no_memory(tmp_path: Path) -> None:
    import tracemalloc

    # 100 pages of one voxel, and the horizontal resolution of each is the same mebibyte
    path, pages, count = tmp_path / "a.tif", 100, 2**20
    entries = [(256, 3, 1, 1), (257, 3, 1, 1), (258, 3, 1, 8), (273, 4, 1, 8), (279, 4, 1, 1)]
    size = 2 + 12 * (len(entries) + 1) + 4
    end = 8 + pages * size
    data = struct.pack("<2sHI", b"II", 42, 8)
    for page in range(1, pages + 1):
        data += struct.pack("<H", len(entries) + 1)
        data += b"".join(struct.pack("<HHII", *entry) for entry in [*entries, (282, 1, count, end)])
        data += struct.pack("<I", 8 + page * size if page < pages else 0)
    path.write_bytes(data + bytes(count))
    tracemalloc.start()
    assert read_volume(path, max_bytes=2**24).shape == (100, 1, 1)
    assert tracemalloc.get_traced_memory()[1] < 2**23
    tracemalloc.stop()


def test_of_a_strip_with_too_many_plain_bytes_only_what_is_needed_is_read(tmp_path: Path) -> None:
    import tracemalloc

    path = tmp_path / "a.tif"
    tifffile.imwrite(path, STACK[0], byteorder="<", metadata=None, rowsperstrip=33)
    data = bytearray(path.read_bytes())
    struct.pack_into("<HII", data, field_place(data, 279) + 2, 4, 1, 2**26)
    path.write_bytes(bytes(data) + bytes(2**26))
    tracemalloc.start()
    refuse(path, "should have 3102 bytes but has 3103 or more")
    assert tracemalloc.get_traced_memory()[1] < 2**22
    tracemalloc.stop()


def test_pages_that_go_while_they_are_read_are_missed(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, STACK, metadata=None, photometric="minisblack")
    header = read_header(path)
    tifffile.imwrite(path, STACK[:3], metadata=None, photometric="minisblack")
    with pytest.raises(VolumeFileError, match="had 5 pages and now has 3"):
        list(header.blocks())
    tifffile.imwrite(path, STACK[:, :1], metadata=None, photometric="minisblack")
    with pytest.raises(VolumeFileError, match=r"page 1 has \(1, 47\)"):
        list(header.blocks())


def test_white_is_zero_and_colour_tables_are_said(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", STACK.astype(np.uint8), photometric="miniswhite", metadata=None)
    assert any("white" in note for note in read_volume(tmp_path / "a.tif").notes)
    table = np.zeros((3, 256), np.uint16)
    tifffile.imwrite(tmp_path / "b.tif", STACK.astype(np.uint8), photometric="palette", colormap=table, metadata=None)
    assert any("colour table" in note for note in read_volume(tmp_path / "b.tif").notes)


@pytest.mark.parametrize("predictor", [False, True])
def test_a_tile_far_larger_than_its_picture_counts_as_memory(predictor: bool, tmp_path: Path) -> None:
    import tracemalloc

    if predictor:
        pytest.importorskip("imagecodecs")
    path, side = tmp_path / "a.tif", 4096
    tifffile.imwrite(
        path,
        np.zeros((64, 64), np.uint16),
        tile=(side, side),
        compression="zlib",
        predictor=predictor,
        metadata=None,
        photometric="minisblack",
    )
    assert path.stat().st_size < side**2 / 10
    tracemalloc.start()
    with pytest.raises(VolumeFileError, match="MiB of memory but the limit is 20"):
        read_volume(path, max_bytes=20 * 2**20)
    assert tracemalloc.get_traced_memory()[1] < 2**20
    tracemalloc.reset_peak()
    assert read_volume(path, max_bytes=110 * 2**20).shape == (1, 64, 64)
    assert tracemalloc.get_traced_memory()[1] < 110 * 2**20
    tracemalloc.stop()


@pytest.mark.parametrize(
    "options",
    [
        {"ome": True, "photometric": "minisblack", "metadata": {"axes": "TZCYX"}},
        {"imagej": True},
        {"ome": True, "photometric": "minisblack", "metadata": {"axes": "TZCYX"}, "compression": "zlib"},
    ],
    ids=["ome", "imagej", "ome packed"],
)
def test_channels_and_moments_in_the_order_of_the_file(options: dict[str, Any], tmp_path: Path) -> None:
    values = np.arange(2 * 4 * 3 * 5 * 7, dtype=np.uint16).reshape(2, 4, 3, 5, 7)  # [t, z, c, y, x]
    tifffile.imwrite(tmp_path / "a.tif", values, **options)
    moments = list(open_series(tmp_path / "a.tif"))
    assert np.array_equal(np.stack([channels.values for channels in moments]), np.moveaxis(values, 2, -1))


def test_the_other_order_of_ome_and_its_names_and_colours(tmp_path: Path) -> None:
    values = np.arange(2 * 3 * 4 * 5 * 7, dtype=np.uint16).reshape(2, 3, 4, 5, 7)  # [c, t, z, y, x]
    names = ["DAPI", "a & b"]
    tifffile.imwrite(
        tmp_path / "a.ome.tif",
        values,
        photometric="minisblack",
        metadata={"axes": "CTZYX", "Channel": {"Name": names, "Color": [-16776961, 16711935]}, "TimeIncrement": 0.5},
    )
    series = open_series(tmp_path / "a.ome.tif")
    assert series.layout.duration == 0.5
    moments = list(series)
    assert moments[0].names == ("DAPI", "a & b")
    assert moments[0].colours == ((1, 0, 0), (0, 1, 0))  # 0xFF0000FF with a sign, 0x00FF00FF
    assert np.array_equal(np.stack([channels.values for channels in moments]), np.moveaxis(values, 0, -1))


@pytest.mark.parametrize(
    "options", [{}, {"compression": "zlib", "predictor": True}, {"tile": (16, 16)}], ids=["plain", "predicted", "tiled"]
)
@pytest.mark.parametrize("parts", [3, 4])
def test_a_photograph_as_tiff_in_colour_and_grey(parts: int, options: dict[str, Any], tmp_path: Path) -> None:
    values = np.random.default_rng(0).integers(0, 255, (33, 47, parts)).astype(np.uint8)
    tifffile.imwrite(tmp_path / "a.tif", values, photometric="rgb", **options)
    photo = read_channels(tmp_path / "a.tif")
    assert photo.kind == ("rgb" if parts == 3 else "rgba")
    assert np.array_equal(photo.values[0], values)
    grey = read_volume(tmp_path / "a.tif")
    assert np.array_equal(grey.values, photo.brightness().values)
    assert "its colours became grey values" in grey.notes


def test_channels_that_do_not_divide_the_pages_are_refused(tmp_path: Path) -> None:
    tifffile.imwrite(
        tmp_path / "b.tif",
        np.zeros((5, 33, 47), np.uint8),
        photometric="minisblack",
        metadata=None,
        description="ImageJ=1.53\nimages=5\nchannels=2\n",
    )
    with pytest.raises(VolumeFileError, match="5 images, but 2 channels of 1 slices"):
        read_channels(tmp_path / "b.tif")


@pytest.mark.parametrize(
    ("shape", "axes", "t", "c"),
    [
        ((5, 33, 47), None, 1, 1),
        ((5, 33, 47), "QYX", 1, 1),
        ((5, 33, 47), "ZYX", 1, 1),
        ((5, 33, 47), "CYX", 1, 5),
        ((5, 33, 47), "TYX", 5, 1),
        ((2, 5, 33, 47), "TZYX", 2, 1),
        ((2, 5, 33, 47), "ZCYX", 1, 5),
        ((2, 3, 5, 33, 47), "TZCYX", 2, 5),
        ((2, 3, 5, 33, 47), "CTZYX", 3, 2),
        ((1, 5, 1, 33, 47), None, 1, 1),
    ],
)
@pytest.mark.parametrize("one_page", [False, True])
def test_arrays_of_tifffile_in_many_pages_or_one(
    shape: tuple[int, ...], axes: str | None, t: int, c: int, one_page: bool, tmp_path: Path
) -> None:
    values = np.arange(np.prod(shape), dtype=np.int32).reshape(shape)
    tifffile.imwrite(
        tmp_path / "a.tif", values, photometric="minisblack", truncate=one_page, metadata={"axes": axes} if axes else {}
    )
    series = open_series(tmp_path / "a.tif")
    assert (series.layout.frames, series.layout.channels) == (t, c)
    found = np.array([[channel.values for channel in moment] for moment in series])
    order = "".join(axis for axis in axes or "ZYX" if axis in "TCZYX") if axes != "QYX" else "ZYX"
    expected = values.reshape([n for n in shape if n > 1]).transpose([order.index(a) for a in "TCZYX" if a in order])
    np.testing.assert_array_equal(found.reshape(expected.shape), expected)


def test_axes_without_names_are_told(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", np.zeros((2, 5, 33, 47), np.uint8), photometric="minisblack")
    notes = open_series(tmp_path / "a.tif").notes
    assert "its axes of 2 x 5 pages, of no name, were taken as moments, slices" in notes


def test_colours_of_one_page_with_a_shape(tmp_path: Path) -> None:
    values = np.random.default_rng(1).integers(0, 255, (4, 33, 47, 3)).astype(np.uint8)
    tifffile.imwrite(tmp_path / "a.tif", values, photometric="rgb", truncate=True)
    np.testing.assert_array_equal(read_channels(tmp_path / "a.tif").values, values)


def test_of_several_images_of_ome_the_first_is_read(tmp_path: Path) -> None:
    with tifffile.TiffWriter(tmp_path / "a.tif", ome=True) as writer:
        writer.write(STACK, photometric="minisblack", metadata={"axes": "ZYX"})
        writer.write(STACK[:2, :9], photometric="minisblack", metadata={"axes": "ZYX"})
    read = read_volume(tmp_path / "a.tif")
    np.testing.assert_array_equal(read.values, STACK)
    assert "the file holds 2 images, of which the first was read" in read.notes


def test_ome_tiff_is_read_by_other_programs_as_it_was_written(tmp_path: Path) -> None:
    path, grid = tmp_path / "a.ome.tif", Grid((4, 5, 6), (0.5, 1.25, 3.0), (1.0, 2.0, 3.0), unit="mm")
    values = np.random.default_rng(3).integers(0, 60000, (4, 5, 6, 2)).astype(np.uint16)
    stained = Channels.from_array(values, grid, ('"nuclei" & <DNA>', "actin"), ((0, 0, 1), (1, 0.2, 0)))
    write_channels(stained, path)
    with tifffile.TiffFile(path) as file:
        assert (file.is_ome, file.series[0].axes) == (True, "CZYX")
        np.testing.assert_array_equal(file.asarray(), np.moveaxis(values, -1, 0))
        [pixels] = ElementTree.fromstring(file.ome_metadata).iterfind(".//{*}Pixels")
    assert [pixels.get(f"PhysicalSize{axis}") for axis in "XYZ"] == ["0.5", "1.25", "3.0"]
    assert {pixels.get(f"PhysicalSize{axis}Unit") for axis in "XYZ"} == {"mm"}
    assert [(one.get("Name"), one.get("Color")) for one in pixels.iterfind("{*}Channel")] == [
        ('"nuclei" & <DNA>', str(0x0000FFFF)),
        ("actin", str(0xFF3300FF - 2**32)),
    ]
    read = read_channels(path)
    assert (read.names, read.colours, read.grid) == (stained.names, stained.colours, grid)
    np.testing.assert_array_equal(read.values, values)


@pytest.mark.parametrize("unit", ["mm", "\u00b5m", "nm", "m", ""])
@pytest.mark.parametrize("moments", [1, 3])
def test_simpleitk_reads_pages_and_lengths_of_pixels(unit: str, moments: int, tmp_path: Path) -> None:
    sitk = pytest.importorskip("SimpleITK")
    limit = bound("volumes", "tiff", "SimpleITK, lengths of pixels along x and y")
    path, grid = tmp_path / "a.ome.tif", Grid((4, 5, 6), (0.3, 1.234567, 3.0), (1.0, 2.0, 3.0), unit=unit)
    values = np.random.default_rng(3).integers(0, 60000, (moments, 4, 5, 6)).astype(np.uint16)
    if moments == 1:
        write_volume(Volume(values[0], grid), path)
    else:
        write_series((Volume(one, grid) for one in values), path, moments)
    image = sitk.ReadImage(str(path))
    np.testing.assert_array_equal(sitk.GetArrayFromImage(image).reshape(values.shape), values)
    lengths = np.array(grid.spacing[:2]) * ratio(unit, "mm")
    np.testing.assert_allclose(image.GetSpacing()[:2], lengths, rtol=limit)
    # What no field of TIFF states and ITK does not take from OME, as the documentation says of it.
    assert (image.GetSpacing()[2], image.GetOrigin()) == (1.0, (0.0, 0.0, 0.0))
    with tifffile.TiffFile(path) as file:
        [pixels] = ElementTree.fromstring(file.ome_metadata).iterfind(".//{*}Pixels")
        resolution = [np.divide(*file.pages[0].tags[f"{axis}Resolution"].value) for axis in "XY"]
        assert file.pages[0].tags["ResolutionUnit"].value == 3  # centimetre
    stated = [(float(pixels.get(f"PhysicalSize{axis}")), pixels.get(f"PhysicalSize{axis}Unit")) for axis in "XYZ"]
    assert stated == [(length, unit or "reference frame") for length in grid.spacing]
    np.testing.assert_allclose(10 / np.array(resolution), lengths, rtol=1e-9)
    assert open_series(path).grid == grid


@pytest.mark.parametrize("kind", ["channels", "rgb", "rgba"])
def test_moments_of_ome_tiff_come_back(kind: str, tmp_path: Path) -> None:
    values = np.random.default_rng(4).integers(0, 250, (3, 2, 5, 6, {"rgba": 4}.get(kind, 3))).astype(np.uint8)
    write_series((Channels.from_array(one, kind=kind) for one in values), tmp_path / "a.tif", 3, duration=0.5)
    read = list(open_series(tmp_path / "a.tif"))
    assert [one.kind for one in read] == [kind] * 3
    np.testing.assert_array_equal([one.values for one in read], values)
    assert open_series(tmp_path / "a.tif").layout.duration == 0.5


def test_damaged_annotations_of_ours_are_named(tmp_path: Path) -> None:
    write_volume(Volume.from_array(STACK), tmp_path / "a.tif")
    content = (tmp_path / "a.tif").read_bytes()
    assert b"1.0 0.0 0.0 0.0 1.0" in content
    (tmp_path / "a.tif").write_bytes(content.replace(b"1.0 0.0 0.0 0.0 1.0", b"1.0 0.0 0.0 0.0 7.0"))
    refuse(tmp_path / "a.tif", "annotations of deformnb are damaged")
