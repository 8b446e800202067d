"""OME-Zarr in the forms of its specification and of other writers, and folders that claim missing data."""

from __future__ import annotations

import json
import os
import time
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deformnb import DeformError, Volume
from deformnb.chunked import open_volume
from deformnb.io import is_series, open_series, read_channels, read_volume, write_volume

zarr = pytest.importorskip("zarr")

VALUES = np.random.default_rng(0).integers(0, 250, (6, 8, 10)).astype(np.uint8)
SIZES = {"t": 2, "c": 3, "z": 6, "y": 8, "x": 10}
SPACING = {"t": 0.5, "c": 1.0, "z": 3.0, "y": 2.0, "x": 1.0}
KINDS = {"t": "time", "c": "channel", "z": "space", "y": "space", "x": "space"}


def about(axes: str, *, whole: Any = None, **changes: Any) -> dict[str, Any]:
    """The metadata of a pyramid of one level."""
    scales = [
        {"type": "scale", "scale": [SPACING[axis] for axis in axes]},
        {"type": "translation", "translation": [10.0 * SPACING[axis] for axis in axes]},
    ]
    return {
        "axes": [
            {"name": axis, "type": KINDS[axis], **({"unit": "millimeter"} if KINDS[axis] == "space" else {})}
            for axis in axes
        ],
        "datasets": [{"path": "0", "coordinateTransformations": scales}],
        **({"coordinateTransformations": whole} if whole else {}),
        **changes,
    }


def store(
    path: Path,
    axes: str,
    *,
    version: str = "0.5",
    meta: dict[str, Any] | None = None,
    values: Any = None,
    **options: Any,
) -> np.ndarray:
    """A pyramid with axes in this order; returns its voxels."""
    values = (
        np.random.default_rng(1).integers(0, 250, [SIZES[axis] for axis in axes]).astype(np.uint8)
        if (values is None)
        else values
    )
    scales = [about(axes) if meta is None else meta]
    attributes = (
        {"ome": {"version": "0.5", "multiscales": scales}}
        if version == "0.5"
        else {"multiscales": [{"version": version, **scales[0]}]}
    )
    number = 3 if version == "0.5" else 2
    group = zarr.create_group(str(path), zarr_format=number, attributes=attributes)
    options = {"chunks": tuple(min(4, n) for n in values.shape), **options}
    array = group.create_array("0", shape=values.shape, dtype=values.dtype, **options)
    array[...] = values
    return values


@pytest.mark.parametrize("axes", ["yx", "zyx", *map("".join, permutations("zyx"))])
@pytest.mark.parametrize("version", ["0.4", "0.5"])
def test_axes_in_space_in_any_order(axes: str, version: str, tmp_path: Path) -> None:
    values = store(tmp_path / "a.zarr", axes, version=version)
    expected = values.transpose([axes.index(axis) for axis in "zyx" if axis in axes])
    read = read_volume(tmp_path / "a.zarr")
    np.testing.assert_array_equal(read.values, expected if expected.ndim == 3 else expected[None])
    depth = 3.0 if "z" in axes else 1.0
    assert read.grid.spacing == (1, 2, depth)
    assert read.grid.origin == (10, 20, 30 if "z" in axes else 0)
    part = (slice(0, 1), slice(2, 7), slice(3, 9))
    np.testing.assert_array_equal(open_volume(tmp_path / "a.zarr").read(part), read.values[part])


@pytest.mark.parametrize("axes", ["czyx", "tzyx", "tczyx", "zyxc", "ctzyx", "tcyx"])
@pytest.mark.parametrize("version", ["0.4", "0.5"])
def test_channels_and_moments(axes: str, version: str, tmp_path: Path) -> None:
    values = store(tmp_path / "a.zarr", axes, version=version)
    expected = values.transpose([axes.index(axis) for axis in "tczyx" if axis in axes])
    expected = expected.reshape([SIZES[axis] if axis in axes else 1 for axis in "tczyx"])
    assert is_series(tmp_path / "a.zarr")
    series = open_series(tmp_path / "a.zarr")
    assert (series.layout.frames, series.layout.channels) == expected.shape[:2]
    found = [[channel.values for channel in moment] for moment in series]
    np.testing.assert_array_equal(found, expected)
    assert series.layout.duration == (0.5 if "t" in axes else 0)
    assert series.grid.spacing == (1, 2, 3 if "z" in axes else 1)
    last = read_channels(tmp_path / "a.zarr", frame=expected.shape[0] - 1)
    np.testing.assert_array_equal(last[0].values, expected[-1, 0])
    with pytest.raises(DeformError, match="read_channels"):
        read_volume(tmp_path / "a.zarr")
    with pytest.raises(DeformError, match=r"moments|channels"):
        open_volume(tmp_path / "a.zarr")


def test_one_channel_at_one_moment_is_a_volume_with_names_and_colours_else(tmp_path: Path) -> None:
    store(tmp_path / "one.zarr", "tczyx", values=VALUES[None, None])
    np.testing.assert_array_equal(read_volume(tmp_path / "one.zarr").values, VALUES)
    meta = {"omero": {"channels": [{"label": "DAPI", "color": "0000FF"}, {"label": "GFP", "color": "00FF00"}]}}
    for version, where in (("0.4", ".zattrs"), ("0.5", "zarr.json")):
        path = tmp_path / f"{version}.zarr"
        store(path, "czyx", version=version, values=np.stack([VALUES, VALUES + 1]))
        held = json.loads((path / where).read_text(encoding="utf-8"))
        (held if version == "0.4" else held["attributes"]["ome"]).update(meta)
        (path / where).write_text(json.dumps(held), encoding="utf-8")
        channels = read_channels(path)
        assert channels.names == ("DAPI", "GFP")
        assert channels.colours == ((0, 0, 1), (0, 1, 0))


def test_transformations_of_the_pyramid_follow_those_of_the_level(tmp_path: Path) -> None:
    whole = [{"type": "scale", "scale": [2, 2, 10]}, {"type": "translation", "translation": [1, 2, 3]}]
    store(tmp_path / "a.zarr", "zyx", meta=about("zyx", whole=whole))
    read = read_volume(tmp_path / "a.zarr")
    assert read.grid.spacing == (10, 4, 6)
    assert read.grid.origin == (10 * 10 + 3, 20 * 2 + 2, 30 * 2 + 1)


@pytest.mark.parametrize(
    "options",
    [
        {"chunks": (2, 4, 5), "shards": (6, 8, 10)},
        {"compressors": [zarr.codecs.GzipCodec()]},
        {"compressors": None},
        {"compressors": [zarr.codecs.ZstdCodec()]},
        {"compressors": [zarr.codecs.BloscCodec()]},
        {"chunk_key_encoding": {"name": "v2", "separator": "."}},
        {"chunk_key_encoding": {"name": "default", "separator": "."}},
    ],
    ids=["shards", "gzip", "plain", "zstd", "blosc", "names of version 2", "names of version 3"],
)
def test_shards_codecs_and_names_of_chunks(options: dict[str, Any], tmp_path: Path) -> None:
    store(tmp_path / "a.zarr", "zyx", values=VALUES, **options)
    read = read_volume(tmp_path / "a.zarr")
    np.testing.assert_array_equal(read.values, VALUES)
    assert read.notes == ()


@pytest.mark.parametrize("separator", "/.")
def test_version_2_with_both_separators_and_old_consolidated_metadata(separator: str, tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    store(path, "zyx", version="0.4", values=VALUES, chunk_key_encoding={"name": "v2", "separator": separator})
    zarr.consolidate_metadata(str(path))
    held = json.loads((path / ".zattrs").read_text(encoding="utf-8"))
    held["multiscales"][0]["datasets"][0]["coordinateTransformations"][0]["scale"] = [7, 7, 7]
    (path / ".zattrs").write_text(json.dumps(held), encoding="utf-8")
    read = read_volume(path)
    np.testing.assert_array_equal(read.values, VALUES)
    assert read.grid.spacing == (7, 7, 7)


def test_old_versions_without_axes_or_with_names_alone(tmp_path: Path) -> None:
    for version, axes in (("0.1", None), ("0.3", ["t", "c", "z", "y", "x"])):
        meta = about("tczyx")
        del meta["axes"]
        store(
            tmp_path / version,
            "tczyx",
            version=version,
            values=VALUES[None, None],
            meta={**meta, **({"axes": axes} if axes else {})},
        )
        assert read_volume(tmp_path / version).grid.spacing == (1, 2, 3)
    meta = {**about("zyx"), "datasets": [{"path": "0"}]}
    store(tmp_path / "bare", "zyx", version="0.3", values=VALUES, meta=meta)
    assert "the metadata state no spacing: 1 along each axis was taken" in read_volume(tmp_path / "bare").notes


def test_sets_of_images_are_named(tmp_path: Path) -> None:
    path = tmp_path / "set.zarr"
    zarr.create_group(str(path), zarr_format=2, attributes={"bioformats2raw.layout": 3})
    store(path / "0", "zyx", version="0.4", values=VALUES)
    (path / "OME").mkdir()
    (path / "OME" / "METADATA.ome.xml").write_text("<OME/>", encoding="utf-8")
    read = read_volume(path)
    np.testing.assert_array_equal(read.values, VALUES)
    assert "the image 0 of the set was read" in read.notes
    store(path / "1", "zyx", version="0.4", values=VALUES)
    for name, attributes, words in (
        ("set.zarr", None, "a set of 2 images .0, 1.; name one, such as set.zarr/0"),
        ("plate.zarr", {"plate": {"wells": [{"path": "B/3"}]}}, "plate of 1 wells.*plate.zarr/B/3/0"),
        ("well.zarr", {"well": {"images": [{"path": "0"}, {"path": "1"}]}}, "well of 2 images.*well.zarr/0"),
        ("labels.zarr", {"labels": ["cells", "dots"]}, "labels cells, dots; name one, such as labels.zarr/cells"),
        ("none.zarr", {}, "no multiscales"),
    ):
        if attributes is not None:
            zarr.create_group(str(tmp_path / name), zarr_format=2, attributes=attributes)
        with pytest.raises(DeformError, match=words):
            read_volume(tmp_path / name)


@pytest.mark.nightly
def test_what_ngff_zarr_writes(tmp_path: Path) -> None:
    ngff = pytest.importorskip("ngff_zarr")
    values = np.random.default_rng(2).integers(0, 250, (32, 40, 48)).astype(np.uint16)
    image = ngff.to_ngff_image(
        values,
        dims=("z", "y", "x"),
        scale={"z": 3.0, "y": 2.0, "x": 1.0},
        translation={"z": 30.0, "y": 20.0, "x": 10.0},
    )
    scales = ngff.to_multiscales(image, scale_factors=[2], chunks=16)
    for version in ("0.4", "0.5"):
        ngff.to_ngff_zarr(str(tmp_path / version), scales, version=version)
        read = read_volume(tmp_path / version)
        np.testing.assert_array_equal(read.values, values)
        assert read.grid.spacing == (1, 2, 3)
        assert read.grid.origin == (10, 20, 30)
        assert read_volume(tmp_path / version, level=1).shape == (16, 20, 24)


def test_missing_chunks_are_the_fill_value_with_a_note(tmp_path: Path) -> None:
    store(tmp_path / "a.zarr", "zyx", values=VALUES + 1, fill_value=7)
    (tmp_path / "a.zarr" / "0" / "c" / "0" / "1" / "2").unlink()
    expected = VALUES + 1
    expected[:4, 4:, 8:] = 7
    read = read_volume(tmp_path / "a.zarr")
    np.testing.assert_array_equal(read.values, expected)
    assert read.notes == ("1 of 12 chunks are not there: their voxels have the fill value 7",)
    for k in range(2):
        for file in (tmp_path / "a.zarr" / "0" / "c" / "1" / str(k)).iterdir():
            file.unlink()
    expected[4:] = 7
    read = read_volume(tmp_path / "a.zarr")
    np.testing.assert_array_equal(read.values, expected)
    assert read.notes == ("7 of 12 chunks are not there: their voxels have the fill value 7",)


@pytest.mark.parametrize("chunks", [(4, 5, 6), (1, 1, 1)])
def test_claims_of_many_small_chunks_are_refused_at_once(chunks: tuple[int, int, int], tmp_path: Path) -> None:
    store(tmp_path / "a.zarr", "zyx", values=VALUES, chunks=chunks)
    path = tmp_path / "a.zarr" / "0" / "zarr.json"
    held = json.loads(path.read_text(encoding="utf-8"))
    held["shape"] = [1000, 1000, 1000]
    path.write_text(json.dumps(held), encoding="utf-8")
    began = time.monotonic()
    for read in (read_volume, open_volume):
        with pytest.raises(DeformError, match=r"has \d+ chunks of .*, which would be read for hours"):
            read(tmp_path / "a.zarr")
    assert time.monotonic() - began < 20  # an hour before


def test_a_claim_without_any_chunk_is_filled_and_not_looked_for(tmp_path: Path) -> None:
    store(tmp_path / "a.zarr", "zyx", values=VALUES, chunks=(1, 64, 64))
    path = tmp_path / "a.zarr" / "0" / "zarr.json"
    held = json.loads(path.read_text(encoding="utf-8"))
    held["shape"], held["fill_value"] = [3000, 64, 64], 3
    path.write_text(json.dumps(held), encoding="utf-8")
    began = time.monotonic()
    read = read_volume(tmp_path / "a.zarr")
    assert (read.values[6:] == 3).all()
    assert "2994 of 3000 chunks" in read.notes[0]
    assert time.monotonic() - began < 20  # sequentially zarr searches them for minutes


@pytest.mark.parametrize("what", ["chunk", "zarr.json", "0/zarr.json", "array"])
def test_pipes_and_folders_are_not_waited_for(what: str, tmp_path: Path) -> None:
    store(tmp_path / "a.zarr", "zyx", values=VALUES)
    places = {"chunk": "0/c/0/0/0", "array": "0/c/1/1/1"}
    path = tmp_path / "a.zarr" / places.get(what, what)
    path.unlink()
    if what == "array":
        path.mkdir()
    else:
        os.mkfifo(path)
    with pytest.raises(DeformError):
        read_volume(tmp_path / "a.zarr")
    if what == "chunk":
        with pytest.raises(DeformError, match="no plain file"):
            open_volume(tmp_path / "a.zarr").read((slice(0, 4),) * 3)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"axes": [{"name": "z", "type": "time"}, {"name": "y"}, {"name": "x"}]}, "axes should be z, y, x in space"),
        ({"axes": [{"name": "y"}, {"name": "y"}, {"name": "x"}]}, "axes should be"),
        ({"axes": [{"name": "a", "type": "space"}, {"name": "y"}, {"name": "x"}]}, "axes should be"),
        ({"axes": [{"name": "q"}, {"name": "y"}, {"name": "x"}]}, "has q: 6"),
        ({"axes": [{"name": "y"}, {"name": "x"}]}, "3 axes and its metadata name 2"),
        ({"axes": None}, "axes should be 2 to 5"),
        ({"datasets": [{"path": "../0"}]}, "not in its own folder"),
        ({"datasets": [{"path": "0", "coordinateTransformations": [{"type": "scale", "scale": [1, 1]}]}]}, "3 numbers"),
        (
            {"datasets": [{"path": "0", "coordinateTransformations": [{"type": "scale", "scale": [1, 0, 1]}]}]},
            "spacing",
        ),
        (
            {"datasets": [{"path": "0", "coordinateTransformations": [{"type": "scale", "scale": [1, "2", 1]}]}]},
            "3 numbers",
        ),
        ({"datasets": [{"path": "0", "coordinateTransformations": [{"type": "affine"}]}]}, "affine"),
        ({"datasets": []}, "1 to 32"),
    ],
)
def test_metadata_that_are_none(changes: dict[str, Any], words: str, tmp_path: Path) -> None:
    store(tmp_path / "a.zarr", "zyx", values=VALUES, meta={**about("zyx"), **changes})
    with pytest.raises(DeformError, match=words):
        read_volume(tmp_path / "a.zarr")


def test_a_lost_chunk_of_background_is_noticed(tmp_path: Path) -> None:
    values = np.zeros((200, 8, 8), np.uint8)
    values[0, 0, 0] = 1
    write_volume(Volume.from_array(values), tmp_path / "a.zarr")
    assert read_volume(tmp_path / "a.zarr").notes == ()
    last = next(file for file in (tmp_path / "a.zarr" / "0" / "c" / "3").rglob("*") if file.is_file())
    last.unlink()
    assert "1 of 4 chunks" in read_volume(tmp_path / "a.zarr").notes[0]


def test_levels_of_another_extent_are_named(tmp_path: Path) -> None:
    write_volume(Volume.from_array(np.arange(4800, dtype=np.int32).reshape(300, 4, 4)), tmp_path / "a.zarr")
    assert read_volume(tmp_path / "a.zarr", level=1).notes == ()
    path = tmp_path / "a.zarr" / "zarr.json"
    held = json.loads(path.read_text(encoding="utf-8"))
    coarse = held["attributes"]["ome"]["multiscales"][0]["datasets"][1]
    coarse["coordinateTransformations"][0]["scale"] = [1.0, 2.0, 2.0]
    path.write_text(json.dumps(held), encoding="utf-8")
    assert "level 1 of the pyramid has another extent" in read_volume(tmp_path / "a.zarr").notes[0]
