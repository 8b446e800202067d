"""Landmark files in the panel of points: what is opened becomes points, and what is saved reads back as the same."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from uploads import upload_file
from widgets.studio.panels.test_steps_history import Guarded

from deformnb.datasets import PHANTOMS
from deformnb.io.landmarks.formats import LANDMARK_FORMATS, read_landmarks, write_landmarks
from deformnb.session.session import Session
from deformnb.warping.points import Landmarks
from deformnb.widgets.studio.panels.landmarks import LandmarkFiles


class Bench:
    """The row with a session, and what it hands to the browser."""

    def __init__(self) -> None:
        self.session = Session(PHANTOMS["bar"].make((12, 16, 20)), view="+y")
        self.guard = Guarded()
        self.row = LandmarkFiles(self.session, self.guard)
        self.downloads: list[tuple[str, bytes]] = []
        self.row.file_transfer.download = lambda *file: self.downloads.append(file)  # type: ignore[method-assign]

    def open(self, name: str, content: bytes) -> None:
        upload_file(self.row.upload, name, content)


@pytest.mark.parametrize("kind", LANDMARK_FORMATS)
def test_what_is_saved_is_opened_again(kind: str, tmp_path: Path) -> None:
    row, bench = LANDMARK_FORMATS[kind], Bench()
    suffix = row.suffix
    points = bench.session.editing.points.add([40.0, 30.0], [50.0, 30.0], name="nose")
    bench.session.editing.edit_points(points)
    bench.row.kind.value = suffix
    bench.row.save.click()
    [(name, content)] = bench.downloads
    assert name == f"bar_phantom{suffix}"
    (tmp_path / name).write_bytes(content)
    assert read_landmarks(tmp_path / name).names == (points.names if row.has_names else ("",) * 5)
    other = Bench()
    other.open(name, content)
    added = other.session.editing.points.take(range(4, 9))
    np.testing.assert_allclose(added.source, points.source, atol=1e-6)
    wanted = points.target if row.has_fixed else points.source
    np.testing.assert_allclose(added.target, wanted, atol=1e-6)
    assert "5 landmarks of" in other.session.editing.notice


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("marks.odt", b"x", "no kind of landmark file"),
        ("marks.fcsv", b"\xff\xfe", "marks.fcsv"),
        ("../../marks.csv", b"a,true,1,2", "marks.csv"),
        ("marks.mrk.json", b"{}", "markups"),
    ],
)
def test_what_is_no_landmark_file_is_said_and_changes_nothing(name: str, content: bytes, words: str) -> None:
    bench = Bench()
    before = bench.session.editing.deformation
    bench.open(name, content)
    assert words in bench.guard.errors[-1]
    assert bench.session.editing.deformation is before


def test_nothing_is_saved_where_there_are_no_points() -> None:
    bench = Bench()
    bench.session.editing.edit_points(bench.session.editing.points.remove(*bench.session.editing.points.ids))
    bench.row.save.click()
    assert "no points to save" in bench.guard.errors[-1]
    assert bench.downloads == []


def test_landmarks_of_a_scan_in_slicer_lie_where_its_voxels_do(tmp_path: Path) -> None:
    bench = Bench()
    grid = bench.session.volume.grid
    place: Any = grid.index_to_point(np.array([3.0, 5.0, 7.0]))
    write_landmarks(Landmarks([place], ("mark",)), tmp_path / "mark.mrk.json")
    bench.open("mark.mrk.json", (tmp_path / "mark.mrk.json").read_bytes())
    np.testing.assert_allclose(
        bench.session.editing.points.source[-1], bench.session.editing.plane.to_plane(place)[:2], atol=1e-6
    )
