"""Warp of large volumes: the voxels are those of the warp in memory, for any source and after any failure."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deformnb as dn
from deformnb import Cancelled, ControlPoints, Cut, Deformation, DeformError, Grid, Line, Volume, chunked
from deformnb.chunked import blocks, sources, warper
from deformnb.chunked.warper import parse_bytes
from deformnb.errors import VolumeFileError
from deformnb.rbf.fields import Affine

SHAPE = (21, 40, 37)
CHUNKS = (16, 16, 16)


@pytest.fixture(scope="module")
def volume() -> Volume:
    values = np.random.default_rng(0).integers(10, 250, SHAPE).astype(np.uint8)
    return Volume.from_array(values, (1.0, 1.0, 1.5), (3.0, 4.0, 5.0))


# No round numbers: a place on the border itself may be on either side of it.
POINTS = ControlPoints.from_arrays([[8, 8], [28, 28], [20, 10]], [[12.1, 8.2], [26.3, 31.1], [20, 16.2]])
SPACE = Deformation.from_space_points(
    ControlPoints.from_arrays(
        [[10, 14, 12], [35, 30, 30], [20, 40, 10], [38, 8, 33]],
        [[14, 14, 14], [33, 34, 27], [20, 35, 12], [38, 12, 30]],
    )
)


def assert_same(found: Any, wanted: Volume, share: float = 1e-3) -> None:
    """Equal but for a rounding of values at a half."""
    difference = np.abs(np.asarray(found).astype(int) - wanted.values.astype(int))
    assert difference.max() <= 1
    assert np.mean(difference > 0) < share


@pytest.mark.parametrize(
    "kind",
    [
        "replicated",
        "space",
        pytest.param("cut", marks=pytest.mark.nightly),
        pytest.param("modulated cut", marks=pytest.mark.nightly),
        pytest.param("composed", marks=pytest.mark.nightly),
    ],
)
@pytest.mark.parametrize("method", ["linear", pytest.param("cubic", marks=pytest.mark.nightly)])
def test_the_voxels_are_those_of_the_warp_in_memory(kind: str, method: str, volume: Volume) -> None:
    cut = Cut(Line([(17.3, -60.0), (17.3, 80.0)]))
    flat = Deformation.from_picture_points(volume, "+z", POINTS)
    document = {
        "replicated": flat,
        "space": SPACE,
        "composed": flat.then(SPACE),
        "cut": Deformation.from_picture_points(volume, "+z", POINTS, cuts=(cut,)),
        "modulated cut": Deformation.from_picture_points(volume, "+z", POINTS, cuts=(cut,), extrusion="modulate"),
    }[kind]
    found = chunked.warp(volume, document, Volume, chunks=CHUNKS, method=method)
    # Compositions are interpolated to a hundredth of a voxel, from nodes that are others in each block.
    assert_same(found, dn.warp(volume, document, method=method), 1e-2 if kind == "composed" else 1e-3)
    assert found.grid == volume.grid


def test_a_cut_is_seen_alike_in_a_small_part_of_a_result(volume: Volume) -> None:
    # The displacement is longer than the part is wide: the distances to the cut were read off a table that ended there.
    cut = Cut(Line([(17.3, -60.0), (17.3, 80.0)]))
    points = ControlPoints.from_arrays([[8, 8], [28, 28]], [[22, 8], [9, 28]])
    field = Deformation.from_picture_points(
        volume, "+z", points, cuts=(cut,), extrusion="modulate", trend="translation"
    ).field(volume)
    whole = dn.warp(volume, field)
    part = volume.grid.crop((4, 10, 12), (8, 6, 6))
    assert_same(dn.warp(volume, field, output=part), Volume(whole.values[4:12, 10:16, 12:18], part))


def test_a_pyramid_of_labels_has_no_value_that_nobody_drew(tmp_path: Path) -> None:
    values = (np.random.default_rng(1).integers(0, 3, (9, 20, 21)) * 7).astype(np.uint8)
    labels = Volume.from_array(values, is_labels=True)
    found = chunked.warp(labels, SPACE, tmp_path / "labels.zarr", levels=3, chunks=(8, 8, 8))
    assert found.is_labels
    assert [grid.shape for grid in found.levels] == [(9, 20, 21), (5, 10, 11), (3, 5, 6)]
    np.testing.assert_array_equal(np.asarray(found), dn.warp(labels, SPACE).values)
    for level in range(3):
        one = dn.read_volume(tmp_path / "labels.zarr", level=level)
        assert set(np.unique(one.values)) <= {0, 7, 14}


def write_source(kind: str, folder: Path, volume: Volume) -> Any:
    values = volume.values
    if kind == "npy":
        dn.write_volume(volume, folder / "a.npy")
        return folder / "a.npy"
    if kind == "memory map":
        np.save(folder / "m.npy", values)
        return np.load(folder / "m.npy", mmap_mode="r")
    if kind == "hdf5":
        h5py = pytest.importorskip("h5py")
        with h5py.File(folder / "a.h5", "w") as file:
            file.create_dataset("scan", data=values, chunks=(4, 8, 8), compression="gzip")
        return f"{folder / 'a.h5'}::scan"
    if kind == "tiff":
        tifffile = pytest.importorskip("tifffile")
        tifffile.imwrite(folder / "a.tif", values, photometric="minisblack", compression="zlib")
        return folder / "a.tif"
    if kind == "dask":
        return pytest.importorskip("dask.array").from_array(values, chunks=(8, 16, 16))
    zarr = pytest.importorskip("zarr")
    return zarr.create_array(str(folder / "plain"), data=values, chunks=(8, 8, 8), zarr_format=int(kind[-1]))


@pytest.mark.parametrize("kind", ["npy", "memory map", "hdf5", "tiff", "dask", "zarr 2", "zarr 3"])
def test_every_kind_of_source_is_read_in_parts(kind: str, volume: Volume, tmp_path: Path) -> None:
    source = chunked.open_volume(write_source(kind, tmp_path, volume), grid=volume.grid)
    assert (source.shape, source.dtype) == (SHAPE, np.uint8)
    part = (slice(3, 9), slice(11, 30), slice(0, 5))
    np.testing.assert_array_equal(source.read(part), volume.values[part])
    assert source.smallest() == volume.values.min()


@pytest.mark.parametrize("version", ["0.4", "0.5"])
def test_another_reader_finds_the_same_voxels_at_the_same_places(version: str, volume: Volume, tmp_path: Path) -> None:
    ngff_zarr = pytest.importorskip("ngff_zarr")
    shift = Affine(np.eye(3), np.array([1.5, 0.0, 0.0]))
    chunked.warp(volume, shift, tmp_path / "a.zarr", chunks=CHUNKS, levels=2, version=version)
    images = ngff_zarr.from_ngff_zarr(str(tmp_path / "a.zarr"), version=version).images
    assert_same(images[0].data, dn.warp(volume, shift))
    assert images[0].scale == {"x": 1.0, "y": 1.0, "z": 1.5}
    assert images[1].scale == {"x": 2.0, "y": 2.0, "z": 3.0}
    assert images[1].translation == {"x": 3.5, "y": 4.5, "z": 5.75}


def test_a_cancelled_job_goes_on_with_what_is_missing(
    volume: Volume, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target, computed = tmp_path / "a.zarr", []
    original = blocks.BlockWarp.__call__

    def counted(job: blocks.BlockWarp, number: int) -> Any:
        computed.append(number)
        return original(job, number)

    monkeypatch.setattr(blocks.BlockWarp, "__call__", counted)

    def stop(share: float) -> None:
        if len(computed) >= 5:
            raise Cancelled

    with pytest.raises(Cancelled):
        chunked.warp(volume, SPACE, target, chunks=CHUNKS, progress=stop, workers=1)
    assert not target.exists()
    first = set(computed)
    assert 0 < len(first) < 18
    with pytest.raises(DeformError, match="unfinished result of another source"):
        chunked.warp(volume, SPACE.scaled(0.5), target, chunks=CHUNKS)
    computed.clear()
    found = chunked.warp(volume, SPACE, target, chunks=CHUNKS, workers=1)
    assert len(first & set(computed)) <= 1  # at most the block in work
    assert first | set(computed) == set(range(18))
    assert_same(found, dn.warp(volume, SPACE))
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.zarr"]
    with pytest.raises(VolumeFileError, match="exists already"):
        chunked.warp(volume, SPACE, target, chunks=CHUNKS)


class Counted:
    """A source in chunks of 4 x 5 x 6 voxels that records its reads."""

    shape, dtype, chunks = (11, 13, 17), np.dtype(np.uint8), (4, 5, 6)

    def __init__(self) -> None:
        self.values = np.random.default_rng(3).integers(0, 255, self.shape).astype(np.uint8)
        self.parts: list[tuple[slice, slice, slice]] = []

    def read(self, part: tuple[slice, slice, slice]) -> Any:
        self.parts.append(part)
        return self.values[part]

    def identity(self) -> str:
        return "counted"


@pytest.mark.parametrize(("limit", "most"), [(12 * 15 * 18, 27), (500, 10**9), (0, 10**9)])
def test_a_chunk_is_unpacked_once_while_it_is_kept(limit: int, most: int) -> None:
    reader, rng = Counted(), np.random.default_rng(4)
    cache = sources.ChunkCache(sources.LargeVolume(reader, Grid(reader.shape)), limit)
    for _ in range(60):
        ends = [np.sort(rng.choice(n + 1, 2, replace=False)) for n in reader.shape]
        part = tuple(slice(int(a), int(b)) for a, b in ends)
        out = np.empty(blocks.part_shape(part), np.uint8)
        cache.read_into(part, out)
        np.testing.assert_array_equal(out, reader.values[part])
        assert cache.bytes <= limit
    assert len(reader.parts) <= most


def test_a_chunk_that_cannot_be_read_is_tried_again() -> None:
    reader = Counted()
    cache, whole = sources.ChunkCache(sources.LargeVolume(reader, Grid(reader.shape)), 10**6), (slice(0, 4),) * 3
    values, reader.values = reader.values, None  # type: ignore[assignment]
    with pytest.raises(TypeError):
        cache.read_into(whole, np.empty((4, 4, 4), np.uint8))
    assert cache.bytes == 0
    reader.values = values
    out = np.empty((4, 4, 4), np.uint8)
    cache.read_into(whole, out)
    np.testing.assert_array_equal(out, values[whole])


def test_all_blocks_have_one_compiled_shape(volume: Volume) -> None:
    field = SPACE.field(volume)
    job, _ = blocks.plan_blocks(
        sources.open_volume(volume),
        field,
        volume.grid,
        method="linear",
        fill=0,
        background=0,
        block=CHUNKS,
        memory=2**30,
        workers=1,
    )
    shapes = {job.window_volume(part).shape for part in job.parts if part is not None}
    assert shapes == {job.window}
    assert len({blocks.part_shape(part) for part in job.parts if part is not None}) > 1


def test_blocks_become_smaller_where_the_memory_is_little(volume: Volume) -> None:
    source, field = sources.open_volume(volume), SPACE.field(volume)
    options: dict[str, Any] = {"method": "linear", "fill": 0, "background": 0, "block": SHAPE, "workers": 8}
    large, many = blocks.plan_blocks(source, field, volume.grid, memory=2**30, **options)
    small, one = blocks.plan_blocks(source, field, volume.grid, memory=2**20, **options)
    assert (len(large.blocks), many) == (1, 8)
    assert len(small.blocks) > 1
    assert small.bytes_each * one <= 2**20
    with pytest.raises(DeformError, match="memory allows"):
        blocks.plan_blocks(source, field, volume.grid, memory=10_000, **options)


def test_a_document_does_not_depend_on_the_level_it_was_made_on(tmp_path: Path) -> None:
    z, y, x = np.indices((32, 48, 40)).astype(float)
    smooth = Volume.from_array((100 + 50 * np.sin(x / 6) * np.cos(y / 7) + z).astype(np.float32), (0.5, 0.5, 0.5))
    chunked.warp(smooth, Affine(np.eye(3), np.zeros(3)), tmp_path / "a.zarr", levels=2, fill=0)
    coarse = dn.read_volume(tmp_path / "a.zarr", level=1)
    assert coarse.shape == (16, 24, 20)
    document = Deformation.from_picture_points(
        coarse, "+z", ControlPoints.from_arrays([[6, 6], [12, 18]], [[8, 6], [12, 15]])
    )
    dn.write_deformation(document, tmp_path / "d.json")
    found = chunked.warp(tmp_path / "a.zarr", dn.read_deformation(tmp_path / "d.json"), Volume, fill=0)
    fine = dn.warp(smooth, document.field(coarse), fill=0)
    assert_same(found, fine)


def test_what_is_not_finite_counts_as_background() -> None:
    values = np.full((4, 5, 6), 3.0, np.float32)
    values[1, 2, 3], values[0, 0, 0] = np.nan, 1.0
    found = chunked.warp(values, Affine(np.eye(3), np.zeros(3)), Volume)
    assert found.values[1, 2, 3] == 1.0


def test_wide_labels_are_kept_and_too_wide_ones_refused() -> None:
    values = np.array([[[1, 2**31 - 1, 5]]], np.uint64)
    still = Affine(np.eye(3), np.zeros(3))
    source = chunked.open_volume(values, is_labels=True)
    assert chunked.warp(source, still, Volume).values.tolist() == [[[1, 2**31 - 1, 5]]]
    with pytest.raises(DeformError, match="beyond those of int32"):
        chunked.warp(chunked.open_volume(values + 9, is_labels=True), still, Volume)


@pytest.mark.parametrize(
    ("words", "given"),
    [
        ("memory is", {"memory": "two"}),
        ("memory is", {"memory": -1}),
        ("workers must", {"workers": 0}),
        ("chunks are", {"chunks": (1, 2)}),
        ("unknown method", {"method": "best"}),
        ("version", {"version": "9"}),
    ],
    ids=["text", "negative", "workers", "chunks", "method", "version"],
)
def test_options_that_fit_nothing_are_refused(
    words: str, given: dict[str, Any], volume: Volume, tmp_path: Path
) -> None:
    with pytest.raises(DeformError, match=words):
        chunked.warp(volume, SPACE, tmp_path / "a.zarr", **given)
    assert not (tmp_path / "a.zarr").exists()


def test_text_of_memory() -> None:
    assert [parse_bytes(text) for text in ("2 GB", "1GiB", "500mb", "7")] == [2 * 10**9, 2**30, 5 * 10**8, 7]


def test_a_dask_array_is_computed_when_it_is_asked_for(volume: Volume) -> None:
    pytest.importorskip("dask")
    lazy = warper.warp(volume, SPACE, chunks=CHUNKS)
    assert lazy.shape == SHAPE
    assert_same(lazy[3:9, :20, 5:].compute(), Volume(dn.warp(volume, SPACE).values[3:9, :20, 5:], Grid((6, 20, 32))))


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore")  # of distributed, about the worker that is killed
def test_a_cluster_whose_worker_is_killed_completes_the_result(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    values = np.random.default_rng(0).integers(0, 250, (64, 96, 96)).astype(np.uint8)
    volume = Volume.from_array(values)
    dn.write_volume(volume, tmp_path / "in.zarr")
    done: list[float] = []
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        victim = next(iter(client.run(os.getpid).values()))

        def kill(share: float) -> None:
            done.append(share)
            if len(done) == 10:
                os.kill(victim, signal.SIGKILL)

        found = chunked.warp(
            tmp_path / "in.zarr", SPACE, tmp_path / "out.zarr", chunks=(16, 16, 16), client=client, progress=kill
        )
    assert done[-1] == 1.0
    assert_same(found, dn.warp(volume, SPACE))


def test_the_job_of_an_unfinished_folder_is_plain_json(volume: Volume, tmp_path: Path) -> None:
    def stop(share: float) -> None:
        if share > 0:
            raise Cancelled

    with pytest.raises(Cancelled):
        chunked.warp(volume, SPACE, tmp_path / "a.zarr", chunks=CHUNKS, progress=stop)
    job = json.loads((tmp_path / ".a.zarr.unfinished" / "job.json").read_text(encoding="utf-8"))
    assert job["target"] == "a.zarr"
