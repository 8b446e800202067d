"""One rule for paths: every public function that is given one refuses an address that it does not read, by its scheme.

The parameters are found by their annotations, so that a new one cannot be missed.
"""

from __future__ import annotations

import inspect
import io
import os
import re
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from test_entrances import public
from test_replacing import DEFORMATION, GRID, MOMENTS, REFUSERS, SHIFT, VOLUME, WRITERS

import deformnb as dn
from deformnb.errors import DeformError, VolumeFileError
from deformnb.io.files.paths import address_of, format_address, named_path
from deformnb.session.autosave import Autosave
from deformnb.session.autosave_store import saved_sessions
from deformnb.widgets.studio.panels.thompson import ThompsonPanel

LABELS = dn.Volume(np.arange(8, dtype=np.uint8).reshape(2, 2, 2) % 3, dn.Grid((2, 2, 2)), is_labels=True)

ADDRESS = "gopher://host/scans/"


def _closed(make: Callable[[], Any]) -> None:
    make().close()


def _writer(name: str) -> Callable[[Any], Any]:
    suffixes, write = WRITERS[name]
    return lambda path: write(path(suffixes[0]))


def _refuser(name: str) -> Callable[[Any], Any]:
    suffix, write = REFUSERS[name]
    return lambda path: write(path(suffix))


def _move_markups(target: Any) -> None:
    with TemporaryDirectory() as folder:
        dn.write_landmarks([[1, 2, 3]], f"{folder}/in.fcsv")
        dn.io.warp_markups(f"{folder}/in.fcsv", target, SHIFT)


CALLS: dict[str, Callable[[Any], Any]] = {
    "session.session.Session(deformation)": lambda path: dn.Session(VOLUME, path(".json")),
    "session.session.Session.save(path)": _refuser("Session.save"),
    "session.session.Session.open(path)": lambda path: dn.Session(VOLUME).open(path(".json")),
    "widgets.studio.studio.Studio(deformation)": lambda path: _closed(lambda: dn.Studio(VOLUME, path(".json"))),
    "widgets.studio.studio.Studio(folder)": lambda path: _closed(lambda: dn.Studio(VOLUME, folder=path(""))),
    "widgets.studio.studio.Studio.save(path)": _refuser("Studio.save"),
    "widgets.studio.studio.Studio.load(path)": lambda path: _studio(lambda studio: studio.load(path(".json"))),
    "widgets.studio.studio.Studio.open_volume(deformation)": lambda path: _studio(
        lambda studio: studio.open_volume(VOLUME, path(".json"))
    ),
    "widgets.studio.studio.Studio.export(path)": _refuser("Studio.export"),
    "widgets.studio.studio.Studio.export_html(path)": _refuser("Studio.export_html"),
    "widgets.studio.studio.Studio.embed(path)": _refuser("Studio.embed"),
    "imaging.thompson.draw_grids(path)": _writer("draw_grids"),
    "imaging.drawing.draw_pictures(path)": _writer("draw_pictures"),
    "imaging.render.render_pair(path)": _writer("render_pair"),
    "io.documents.read_deformation(path)": lambda path: dn.read_deformation(path(".json")),
    "io.landmarks.formats.read_landmarks(path)": lambda path: dn.read_landmarks(path(".fcsv")),
    "io.meshes.formats.read_mesh(path)": lambda path: dn.read_mesh(path(".ply")),
    "io.transforms.formats.read_transform(path)": lambda path: dn.read_transform(path(".tfm")),
    "io.transforms.formats.describe_transform(path)": lambda path: dn.io.describe_transform(path(".tfm")),
    "io.volumes.formats.read_volume(path)": lambda path: dn.read_volume(path(".nrrd")),
    "io.volumes.formats.describe_file(path)": lambda path: dn.io.describe_file(path(".nrrd")),
    "io.volumes.series.is_series(path)": lambda path: dn.io.is_series(path(".nrrd")),
    "io.volumes.series.open_series(path)": lambda path: dn.io.open_series(path(".nrrd")),
    "io.volumes.series.read_channels(path)": lambda path: dn.io.read_channels(path(".nrrd")),
    "io.volumes.label_names.read_label_names(path)": lambda path: dn.io.read_label_names(path(".nrrd")),
    "io.volumes.label_names.write_segmentation(path)": lambda path: dn.io.write_segmentation(
        LABELS, path(".seg.nrrd"), "like.seg.nrrd"
    ),
    "io.volumes.label_names.write_segmentation(like)": lambda path: dn.io.write_segmentation(
        LABELS, "a.seg.nrrd", path(".seg.nrrd")
    ),
    "io.documents.write_deformation(path)": _writer("write_deformation"),
    "io.landmarks.formats.write_landmarks(path)": _writer("write_landmarks"),
    "io.landmarks.markups.warp_markups(source)": lambda path: dn.io.warp_markups(path(".fcsv"), "b.fcsv", SHIFT),
    "io.landmarks.markups.warp_markups(target)": lambda path: _move_markups(path(".mrk.json")),
    "io.meshes.formats.write_mesh(path)": _writer("write_mesh"),
    "io.movies.write_movie(path)": _writer("write_movie"),
    "io.transforms.formats.write_transform(path)": _writer("write_transform"),
    "io.transforms.formats.write_transform(inverse)": lambda path: dn.write_transform(
        SHIFT, "there.nrrd", GRID, inverse=path(".nrrd")
    ),
    "io.volumes.formats.write_volume(path)": _writer("write_volume"),
    "io.volumes.series.write_channels(path)": _writer("write_channels"),
    "io.volumes.series.write_series(path)": _writer("write_series"),
    "io.files.atomic.atomic_write(path)": lambda path: dn.io.atomic_write(path(".bin")).__enter__(),
    "deformnb_lessons.worksheets.write_answers(path)": _writer("write_answers"),
    "deformnb_lessons.pages.write_lesson_page(path)": _writer("write_lesson_page"),
    "deformnb_lessons.worksheets.write_worksheet(path)": _writer("write_worksheet"),
    "chunked.unpacking.unpack(path)": lambda path: dn.chunked.unpack(path(".nrrd"), "a.zarr"),
    "chunked.unpacking.unpack(target)": lambda path: dn.chunked.unpack(_written(), path(".zarr")),
    "datasets.darcy.custom_grid(nodes)": lambda path: dn.datasets.custom_grid(path(".csv")),
    "datasets.registry.fetch(folder)": lambda path: dn.datasets.fetch("lobster", folder=path("")),
    "datasets.registry.find(folder)": lambda path: dn.datasets.load("lobster", folder=path("")),
    "datasets.registry.load(folder)": lambda path: dn.datasets.load("lobster", folder=path("")),
    "session.autosave.Autosave(folder)": lambda path: Autosave(dn.Session(VOLUME), folder=path("")),
    "session.autosave_store.saved_sessions(folder)": lambda path: saved_sessions(VOLUME, path("")),
    "session.batch.replay(inputs)": lambda path: dn.session.replay(DEFORMATION, [path(".nrrd")], "out"),
    "session.batch.replay(folder)": lambda path: dn.session.replay(DEFORMATION, [_written()], path("")),
    "session.series.warp_series(source)": lambda path: dn.session.warp_series(path(".nrrd"), SHIFT, "a.nrrd"),
    "session.series.warp_series(target)": lambda path: _warp_moments(path(".nrrd")),
    "widgets.inputs.drawing_pair.DrawingPair.take(path)": lambda path: _take(path(".png")),
    "widgets.embedded_page.EmbeddedPage.write(path)": _refuser("EmbeddedPage.write"),
    "widgets.studio.panels.thompson.ThompsonPanel(folder)": lambda path: _closed(
        lambda: ThompsonPanel(dn.Session(VOLUME), folder=path(""))
    ),
    "widgets.file_pages.write_file_page(path)": _writer("write_file_page"),
    "widgets.standalone.write_standalone(path)": _writer("write_standalone"),
    "widgets.file_pages.write_thompson_page(path)": _writer("write_thompson_page"),
}
"""A call for each parameter that takes a path, given a function that makes one with a suffix."""

ANY: dict[str, Callable[[Any], Any]] = {
    "volume": lambda path: dn.project(path(".nrrd")),
    "channels": lambda path: dn.imaging.project_channels(path(".nrrd")),
    "grid": lambda path: dn.warp(VOLUME, SHIFT, output=path(".nrrd")),
    "mesh": lambda path: dn.warp_mesh(path(".ply"), SHIFT),
    "landmarks": lambda path: dn.warp_landmarks(path(".fcsv"), SHIFT),
    "studio": lambda path: _closed(lambda: dn.Studio(path(".nrrd"))),
    "source of chunks": lambda path: dn.chunked.open_volume(path(".zarr")),
    "target of chunks": lambda path: dn.chunked.warp(VOLUME, SHIFT, path(".zarr")),
}
"""Parameters for which a path is one of several things."""

OF_PROGRAMS = {"chunked.sources.LargeVolume(path)", "io.volumes.series.Series(path)"}
"""Of classes that readers make; the path is that of a file which has been opened."""


def _studio(call: Callable[[dn.Studio], Any]) -> None:
    studio = dn.Studio(VOLUME)
    try:
        call(studio)
    finally:
        studio.close()


def _written() -> str:
    dn.write_volume(VOLUME, "in.nrrd")
    return "in.nrrd"


def _warp_moments(target: Any) -> None:
    dn.io.write_series(MOMENTS, "in.nrrd", 2)
    dn.session.warp_series("in.nrrd", SHIFT, target)


def _take(path: Any) -> None:
    pair = dn.widgets.DrawingPair(dn.project(VOLUME, "+z"))
    try:
        pair.take(path, lambda _: None)
    finally:
        pair.close()


def test_every_path_has_its_call() -> None:
    found = set()
    for one in public():
        try:
            parameters = inspect.signature(one).parameters.values()
        except (TypeError, ValueError):
            continue
        found |= {
            f"{one.__module__.removeprefix('deformnb.')}.{one.__qualname__}({given.name})"
            for given in parameters
            if re.search(r"\bPath(Like)?\b", str(given.annotation)) and "Callable" not in str(given.annotation)
        }
    assert found - OF_PROGRAMS == set(CALLS)


@pytest.mark.parametrize("kind", [str, Path])
@pytest.mark.parametrize("name", [*CALLS, *ANY])
def test_an_address_is_refused_by_its_scheme(
    name: str, kind: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DeformError) as caught:
        (CALLS | ANY)[name](lambda suffix: kind(f"{ADDRESS}a{suffix}"))
    assert "gopher" in str(caught.value)
    assert str(tmp_path) not in str(caught.value)
    assert not any("gopher" in file.name for file in tmp_path.rglob("*"))


NO_PATHS: dict[str, Callable[[str], Any]] = {
    "number": lambda _: 3,
    "open file of text": lambda _: io.StringIO("a"),
    "long name": lambda suffix: "a" * 300 + suffix,
}


@pytest.mark.parametrize("wrong", NO_PATHS)
@pytest.mark.parametrize("name", CALLS)
def test_what_names_no_file_is_refused(name: str, wrong: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DeformError):
        CALLS[name](NO_PATHS[wrong])


@pytest.mark.parametrize(
    ("given", "address"),
    [
        ("carp.nrrd", ""),
        ("a/b:c/d.nrrd", ""),
        ("C:/scans/carp.nrrd", ""),
        ("C:\\scans\\carp.nrrd", ""),
        ("//server/share/carp.nrrd", ""),
        ("https://host/carp.nrrd?raw=1", "https://host/carp.nrrd?raw=1"),
        ("HTTPS://host/carp.nrrd", "https://host/carp.nrrd"),
        (Path("https://host/carp.nrrd"), "https://host/carp.nrrd"),
        ("s3://scans/carp.zarr", "s3://scans/carp.zarr"),
        ("zip://carp.nrrd::/scans/all.zip", "zip://carp.nrrd::/scans/all.zip"),
        ("file:///scans/carp.nrrd", "file:///scans/carp.nrrd"),
        ("FILE:/scans/carp.nrrd", "file:///scans/carp.nrrd"),
        ("file://localhost/scans/carp.nrrd", "file:///scans/carp.nrrd"),
        ("file://other/carp.nrrd", "file://other/carp.nrrd"),
        (Path("file:///scans/carp.nrrd"), "file:///scans/carp.nrrd"),
        ("memory:///carp.nrrd", "memory:///carp.nrrd"),
        ("https://", "https://"),
        ("simplecache::https://host/carp.nrrd", "simplecache::https://host/carp.nrrd"),
        ("scan::1.nrrd", ""),
        (3, ""),
        (np.zeros(2), ""),
        (b"https://host/carp.nrrd", ""),
    ],
)
def test_addresses_are_told_from_names_of_files(given: Any, address: str) -> None:
    assert address_of(given) == address


def test_a_message_shows_no_password() -> None:
    assert format_address("https://anna:secret@host:80/a@b.nrrd") == "https://host:80/a@b.nrrd"
    assert format_address("zip://a@b::https://anna:secret@host/c.zip") == "zip://b::https://host/c.zip"


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("", "an empty text names no file"),
        (b"", "an empty text names no file"),
        ("https:///carp.nrrd", "names no server"),
        ("https://[host/carp.nrrd", "is no address"),
        ("https://host:99999/carp.nrrd", "is no address"),
        ("zip://carp.nrrd", "no archive; add its path"),
        pytest.param(
            "file://scans/carp.nrrd",
            "of the machine 'scans'.*file:///folder/carp.nrrd",
            marks=pytest.mark.skipif(os.name == "nt", reason="a shared folder of Windows"),
        ),
    ],
)
def test_an_address_that_cannot_be_is_refused_by_name(given: Any, words: str) -> None:
    with pytest.raises(VolumeFileError, match=words):
        dn.read_volume(given)


def test_paths_of_bytes_and_addresses_of_files_are_read_and_written(tmp_path: Path) -> None:
    dn.write_volume(VOLUME, (tmp_path / "the carp.nrrd").as_uri())
    assert dn.read_volume(os.fsencode(tmp_path / "the carp.nrrd")).name == "the carp"


def test_the_name_of_a_file_at_an_address_has_its_ending() -> None:
    assert named_path("https://host/scans/marks.fcsv?raw=1").name == "marks.fcsv"
    assert named_path("zip://in/marks.fcsv::/all.zip").name == "marks.fcsv"
    assert os.fspath(named_path("marks.fcsv")) == "marks.fcsv"
