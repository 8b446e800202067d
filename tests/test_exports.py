"""Files made of a session: each read back, and nothing left where one is stopped."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from deformnb import exports
from deformnb.deformation import Keyframe
from deformnb.errors import Cancelled, DeformError, VolumeFileError
from deformnb.exports import EXPORTS, Frozen, export, export_for
from deformnb.io.documents import read_deformation
from deformnb.io.formats import FORMATS, read_volume
from deformnb.opening import as_deformation, as_volume, best_view
from deformnb.session import Session
from deformnb.volume import Grid, Volume


@pytest.fixture
def session() -> Session:
    z, y, x = np.mgrid[:12, :14, :20]
    values = (200 * ((z - 6) ** 2 / 25 + (y - 7) ** 2 / 36 + (x - 10) ** 2 / 81 < 1)).astype(np.uint8)
    made = Session(Volume(values, Grid((12, 14, 20), (1.0, 1.0, 2.0)), "egg"))
    made.edit_points(made.points.add([8.0, 6.0], [11.0, 6.0]))
    return made


def test_a_document_with_key_frames_is_exported_as_its_animation(session: Session, tmp_path: Path,
                                                                 monkeypatch: pytest.MonkeyPatch) -> None:
    from PIL import Image

    monkeypatch.setattr("deformnb.exports._FRAME", (64, 48))
    moved, rest = session.deformation, session.deformation.blended(0)
    session.deformation = replace(moved, keyframes=(Keyframe(0.0, rest.steps), Keyframe(0.25, moved.steps)))
    shares: list[float] = []
    path = export(session, tmp_path / "swim.gif", camera={"direction": (0, 1, 0)}, progress=shares.append)
    with Image.open(path) as gif:
        assert gif.n_frames == 7  # 0.25 s at 24 frames a second, with both ends
    assert len(shares) == 7


def test_every_writable_format_of_volumes_is_a_suffix_of_the_export() -> None:
    writable = {suffix for entry in FORMATS.values() if entry.write is not None for suffix in entry.suffixes}
    assert writable - {".raw"} <= set(EXPORTS["volume"].suffixes)  # .raw needs no place in a menu


@pytest.mark.parametrize("suffix", [s for s in EXPORTS["volume"].suffixes if s not in (".nii", ".nhdr", ".mhd")])
def test_a_volume_comes_back(session: Session, tmp_path: Path, suffix: str) -> None:
    path = export(session, tmp_path / f"egg{suffix}")
    assert_array_equal(read_volume(path).values, session.result().values)


def test_document_and_script_come_back(session: Session, tmp_path: Path) -> None:
    assert read_deformation(export(session, tmp_path / "egg.json")).steps == session.deformation.steps
    text = export(session, tmp_path / "egg.py").read_text(encoding="utf-8")
    scope: dict[str, Any] = {}
    exec(text.replace('dn.read_volume("volume.nii.gz")', "volume"), scope | {"volume": session.volume}, scope)
    assert scope["deformation"] == session.deformation


@pytest.mark.parametrize("name", ["egg.png", "egg.svg", "egg.pdf", "egg.gif"])
def test_pictures_are_written(session: Session, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deformnb.exports._RENDERING", (160, 120))
    monkeypatch.setattr("deformnb.exports._FRAME", (64, 48))
    monkeypatch.setattr("deformnb.exports._FRAMES", 4)
    shares: list[float] = []
    path = export(session, tmp_path / name, camera={"direction": (0, 1, 0)}, progress=shares.append)
    start = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF", ".gif": b"GIF8"}[path.suffix]
    assert path.read_bytes().startswith(start)
    assert shares == sorted(shares)
    if path.suffix == ".png":
        from PIL import Image

        image = np.asarray(Image.open(path).convert("L")).astype(int)
        assert image.shape == (120, 160)
        assert image.std() > 10


@pytest.mark.parametrize("name", ["egg.nrrd", "egg.png", "egg.gif"])
def test_a_cancelled_export_leaves_nothing(session: Session, tmp_path: Path, name: str) -> None:
    def stop(_share: float) -> None:
        raise Cancelled("enough.")

    with pytest.raises(Cancelled):
        export(session, tmp_path / name, progress=stop)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", [e.suffixes[0] for e in EXPORTS.values()])
def test_what_cannot_be_written_is_said_before_the_work(session: Session, tmp_path: Path, suffix: str) -> None:
    (tmp_path / f"folder{suffix}").mkdir()
    worked: list[float] = []
    for name, words in ((f"none/a{suffix}", "there is no folder"), (f"folder{suffix}", "this is a folder")):
        with pytest.raises(VolumeFileError, match=words):
            export(session, tmp_path / name, progress=worked.append)
    assert worked == []


def test_a_result_beyond_the_memory_is_refused_with_numbers(session: Session, tmp_path: Path,
                                                             monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exports, "available_memory", lambda: 3000)
    with pytest.raises(DeformError, match=r"takes 3.3 KiB and 2.9 KiB are free"):
        export(session, tmp_path / "egg.nrrd")
    assert list(tmp_path.iterdir()) == []


def test_an_export_knows_nothing_of_later_edits(session: Session, tmp_path: Path) -> None:
    frozen, before = Frozen.of(session), session.result().values
    session.change(strength=-1.0)
    assert_array_equal(read_volume(export(frozen, tmp_path / "egg.nrrd")).values, before)
    assert not np.array_equal(session.result().values, before)


def test_a_suffix_that_says_nothing_is_refused_with_those_that_do(session: Session, tmp_path: Path) -> None:
    with pytest.raises(DeformError, match=r"movie \.gif"):
        export(session, tmp_path / "egg.exe")
    assert export_for("a/b/EGG.NII.GZ") is EXPORTS["volume"]


# -- what a session begins with ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("axis", "view"), [(0, "-z"), (1, "+y"), (2, "-x")])
def test_the_first_picture_shows_the_broad_side(axis: int, view: str) -> None:
    values = np.zeros((20, 20, 20), np.uint8)
    cut: list[Any] = [slice(2, 18)] * 3
    cut[axis] = slice(9, 11)
    values[tuple(cut)] = 150
    assert best_view(Volume.from_array(values)) == view


def test_what_is_given_is_opened(session: Session, tmp_path: Path) -> None:
    assert as_volume(session.volume) is session.volume
    assert as_volume(session.volume.values.tolist()).shape == session.volume.shape
    assert_array_equal(as_volume(str(export(session, tmp_path / "egg.nrrd"))).values, session.result().values)
    assert as_deformation(None) is None
    opened = as_deformation(export(session, tmp_path / "egg.json"))
    assert opened is not None
    assert opened.steps == session.deformation.steps
