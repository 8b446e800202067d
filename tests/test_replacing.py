"""One rule of replacing files: what is called "write_..." or "draw_..." replaces, atomically; all else refuses.

The functions are found by their names and parameters, so that a new one cannot be missed.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from full_disk import full_disk
from test_entrances import public

import deformnb as dn
import deformnb_lessons
from deformnb.errors import DeformError
from deformnb.rbf.fields import Affine
from deformnb.widgets.embedded_page import EmbeddedPage

resource = pytest.importorskip("resource")  # of POSIX: files that may not grow stand for a disk that is full

GRID = dn.Grid((12, 24, 24), (1.0, 1.0, 2.0))
NOISE = np.random.default_rng(4).integers(0, 255, GRID.shape).astype(np.uint8)  # which no packing makes small
VOLUME = dn.Volume(NOISE, GRID)
POINTS = dn.ControlPoints.from_arrays(*(np.random.default_rng(k).uniform(2, 20, (200, 2)) for k in (1, 2)))
MARKS = dn.warping.Landmarks(np.random.default_rng(5).uniform(0, 20, (500, 3)))
DEFORMATION = dn.Deformation.from_picture_points(VOLUME, "+z", POINTS, trend="none", support=3.0, smoothing=1.0)
SHIFT = Affine(np.eye(3), np.array([1.0, 0.0, 0.0]))
WAVE = dn.rbf.DisplacementField(np.random.default_rng(6).normal(size=(*GRID.shape, 3)), GRID)
FRAMES = [np.random.default_rng(k).integers(0, 255, (32, 32, 3)).astype(np.uint8) for k in range(4)]
COLOURS = dn.volume.Channels.from_array(np.stack([NOISE[:1]] * 3, axis=-1), kind="rgb")
MOMENTS = [dn.volume.Channels((VOLUME,))] * 2
MESH = dn.warping.isosurface(VOLUME, 100.5)
PICTURE = dn.project(VOLUME, "+z")


def _segmentation(path: Path, **options: Any) -> None:
    like = path.with_name("like.seg.nrrd")
    if not like.exists():
        pytest.importorskip("SimpleITK")
        labels = dn.Volume((NOISE > 100).astype(np.uint8), GRID, is_labels=True)
        dn.write_volume(labels, like)
        data = like.read_bytes().replace(
            b"encoding:", b"Segment0_ID:=a\nSegment0_Name:=a\nSegment0_LabelValue:=1\nSegment0_Layer:=0\nencoding:", 1
        )
        like.write_bytes(data)
    labels = dn.Volume(NOISE, GRID, is_labels=True)
    dn.io.write_segmentation(labels, path, like, **options)


def _page(path: Path, **options: Any) -> None:
    view = dn.widgets.LiveView(VOLUME)
    editor = dn.widgets.Editor(PICTURE, points=POINTS)
    try:
        dn.widgets.write_standalone(path, editor, view, **options)
    finally:
        view.close()
        editor.close()


WRITERS: dict[str, tuple[tuple[str, ...], Callable[..., Any]]] = {
    "write_volume": (
        (".nii.gz", ".nrrd", ".mha", ".ome.tif", ".zarr", ".npy", ".raw", ".vti", ".nhdr", ".mhd"),
        lambda path, **o: dn.write_volume(VOLUME, path, **o),
    ),
    "write_channels": ((".png", ".nrrd"), lambda path, **o: dn.io.write_channels(COLOURS, path, **o)),
    "write_series": ((".nrrd", ".ome.tif"), lambda path, **o: dn.io.write_series(MOMENTS, path, 2, **o)),
    "write_segmentation": ((".seg.nrrd",), _segmentation),
    "write_landmarks": ((".csv", ".mrk.json", ".fcsv"), lambda path, **o: dn.write_landmarks(MARKS, path, **o)),
    "write_mesh": ((".ply", ".stl", ".vtp", ".obj"), lambda path, **o: dn.write_mesh(MESH, path, **o)),
    "write_transform": (
        (".tfm", ".h5", ".nrrd", ".nii.gz", ".zarr", ".vti"),
        lambda path, **o: dn.write_transform(WAVE, path, GRID, **o),
    ),
    "write_deformation": ((".json",), lambda path, **o: dn.write_deformation(DEFORMATION, path, **o)),
    "write_movie": ((".gif", ".webp"), lambda path, **o: dn.write_movie(path, FRAMES, **o)),
    "write_standalone": ((".html",), _page),
    "write_file_page": ((".html",), dn.widgets.write_file_page),
    "write_thompson_page": ((".html",), dn.widgets.write_thompson_page),
    "write_lesson_page": ((".html",), lambda path, **o: deformnb_lessons.write_lesson_page("affine", path, **o)),
    "write_worksheet": (
        (".pdf", ".png"),
        lambda path, **o: deformnb_lessons.write_worksheet("affine", path, **o),
    ),
    "write_answers": ((".svg",), deformnb_lessons.write_answers),
    "draw_pictures": ((".png",), lambda path: dn.draw_pictures([PICTURE], path=path)),
    "draw_grids": ((".png",), lambda path: dn.draw_grids(DEFORMATION, PICTURE, grid=GRID, path=path)),
    "render_pair": (
        (".png",),
        lambda path: dn.imaging.render_pair(VOLUME, VOLUME, size=(64, 48), backend="core", path=path),
    ),
}
"""Functions that replace, with suffixes to try."""


def _replay(path: Path, **options: Any) -> None:
    source = path.with_name("in") / path.name
    source.parent.mkdir(exist_ok=True)
    dn.write_volume(VOLUME, source)
    [done] = dn.session.replay(dn.Deformation(), [source], path.parent, **options)
    if done.state != "done":
        raise DeformError(done.message)


def _series(path: Path, **options: Any) -> None:
    source = path.with_name("in.nrrd")
    dn.io.write_series(MOMENTS, source, 2)
    dn.session.warp_series(source, SHIFT, path, **options)


def _unpacked(path: Path, **options: Any) -> None:
    dn.write_volume(VOLUME, path.with_name("in.nrrd"))
    dn.chunked.unpack(path.with_name("in.nrrd"), path, **options)


def _markups(path: Path, **options: Any) -> None:
    source = path.with_name(f"in{path.name[path.name.index('.') :]}")
    dn.write_landmarks(MARKS, source)
    dn.io.warp_markups(source, path, SHIFT, **options)


def _studio(call: Callable[[dn.Studio], Any]) -> None:
    studio = dn.Studio(VOLUME)
    try:
        call(studio)
    finally:
        studio.close()


REFUSERS: dict[str, tuple[str, Callable[..., Any]]] = {
    "Session.save": (".json", lambda path, **o: dn.Session(VOLUME).save(path, **o)),
    "Studio.save": (".json", lambda path, **o: _studio(lambda studio: studio.save(path, **o))),
    "Studio.export": (".nrrd", lambda path, **o: _studio(lambda studio: studio.export(path, **o))),
    "Studio.export_html": (".html", lambda path, **o: _studio(lambda studio: studio.export_html(path, **o))),
    "Studio.embed": (".html", lambda path, **o: _studio(lambda studio: studio.embed(path, **o))),
    "EmbeddedPage.write": (".html", lambda path, **o: EmbeddedPage("<p>A carp</p>", "A carp").write(path, **o)),
    "replay": (".nrrd", _replay),
    "warp_markups": (".mrk.json", _markups),
    "warp_series": (".nrrd", _series),
    "warp": (".zarr", lambda path, **o: dn.chunked.warp(VOLUME, SHIFT, path, **o)),
    "unpack": (".zarr", _unpacked),
}
"""Functions that replace a file only with ``overwrite=True``."""


def test_every_function_that_writes_has_its_row_and_the_default_of_its_name() -> None:
    found: dict[bool, set[str]] = {True: set(), False: set()}
    for one in public():
        try:
            parameters = inspect.signature(one).parameters
        except (TypeError, ValueError):
            continue
        name = one.__qualname__
        if name == "atomic_write":
            continue
        if name.startswith(("write_", "draw_")) or name == "render_pair":
            assert "overwrite" not in parameters or parameters["overwrite"].default is True, name
            found[True].add(name)
        elif "overwrite" in parameters:
            assert parameters["overwrite"].default is False, name
            found[False].add(name)
    assert found[True] == set(WRITERS)
    assert found[False] == set(REFUSERS)


CASES = [(name, suffix) for name, (suffixes, _) in WRITERS.items() for suffix in suffixes]


def _content(folder: Path) -> dict[str, bytes]:
    return {str(file.relative_to(folder)): file.read_bytes() for file in sorted(folder.rglob("*")) if file.is_file()}


def _old(name: str, suffix: str, folder: Path) -> Path:
    """A file or a folder of the kind, with another content."""
    path = folder / f"a{suffix}"
    if suffix == ".zarr":
        (dn.write_volume(dn.Volume(NOISE[:2, :2, :2], dn.Grid((2, 2, 2))), path))
    else:
        path.write_bytes(b"old")
    return path


@pytest.mark.parametrize(("name", "suffix"), CASES)
def test_a_writer_replaces(name: str, suffix: str, tmp_path: Path) -> None:
    path, (_, write) = _old(name, suffix, tmp_path), WRITERS[name]
    before = _content(path) if path.is_dir() else path.read_bytes()
    write(path)
    after = _content(path) if path.is_dir() else path.read_bytes()
    assert after != before
    assert not [entry.name for entry in tmp_path.iterdir() if entry.name.startswith(".")]


@pytest.mark.parametrize(("name", "suffix"), CASES)
def test_a_writer_that_fails_leaves_the_old_file_and_nothing_else(name: str, suffix: str, tmp_path: Path) -> None:
    path, (_, write) = _old(name, suffix, tmp_path), WRITERS[name]
    if name == "write_segmentation":
        write(path)  # makes the one beside it, too
    elif suffix in (".png", ".html", ".pdf", ".svg"):
        write(tmp_path / f"first{suffix}")  # what is compiled, and fonts that are looked up, is kept in files
        (tmp_path / f"first{suffix}").unlink()
    before = _content(tmp_path)
    with full_disk(500), pytest.raises(DeformError):
        write(path)
    assert _content(tmp_path) == before
    assert sorted(entry.name for entry in tmp_path.iterdir()) == sorted({Path(k).parts[0] for k in before})


@pytest.mark.parametrize("suffix", [".tfm", ".h5", ".nrrd", ".nii.gz", ".nii", ".mha"])
@pytest.mark.parametrize("missing", [1, 8, 1000])
def test_a_transform_without_its_last_bytes_replaces_nothing(suffix: str, missing: int, tmp_path: Path) -> None:
    """ITK does not notice that they found no room."""
    path, whole = _old("write_transform", suffix, tmp_path), tmp_path / f"whole{suffix}"
    dn.write_transform(WAVE, whole, GRID)
    with full_disk(whole.stat().st_size - missing), pytest.raises(DeformError, match=r"older file of this name|ITK"):
        dn.write_transform(WAVE, path, GRID)
    assert path.read_bytes() == b"old"


@pytest.mark.parametrize("name", [name for name in WRITERS if name.startswith("write_")])
def test_a_writer_refuses_where_it_is_told_to(name: str, tmp_path: Path) -> None:
    suffixes, write = WRITERS[name]
    path = _old(name, suffixes[0], tmp_path)
    with pytest.raises(DeformError, match=r"overwrite|exists already|was there before"):
        write(path, overwrite=False)
    assert path.read_bytes() == b"old"


@pytest.mark.parametrize("name", REFUSERS)
def test_what_is_no_writer_refuses_and_replaces_where_it_is_told_to(name: str, tmp_path: Path) -> None:
    suffix, write = REFUSERS[name]
    path = _old(name, suffix, tmp_path)
    before = _content(path) if path.is_dir() else path.read_bytes()
    with pytest.raises(DeformError):
        write(path)
    assert before == (_content(path) if path.is_dir() else path.read_bytes())
    write(path, overwrite=True)
    assert before != (_content(path) if path.is_dir() else path.read_bytes())
