"""Deformations in files: whole, refused in one sentence, and described for people."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from deformnb.document.deformation import Deformation, Step, VolumeReference
from deformnb.document.json_format import LONGEST_DOCUMENT, to_json
from deformnb.errors import DeformError, FileChangedError, VolumeFileError
from deformnb.io.documents import describe_document, read_deformation, write_deformation
from deformnb.io.files.atomic import guard_writes
from deformnb.rbf.points import ControlPoints
from deformnb.session.session import Session
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume

FLAT = ControlPoints.from_arrays([[0, 0], [5, 0], [2, 4]], [[0, 0], [6, 0], [2, 5]])
SOLID = ControlPoints.from_arrays(np.eye(3).tolist(), (2 * np.eye(3)).tolist())
PLANE = Plane((0, 0, 0), (1, 0, 0), (0, 0, -1))


def document() -> Deformation:
    volume = Volume(np.arange(60, dtype=np.uint8).reshape(3, 4, 5), Grid((3, 4, 5), (0.390625, 1, 0.78125)), "carp")
    steps = (
        Step((FLAT,), PLANE, name="bend"),
        Step((SOLID,), None, support=7.5, strength=0.5, enabled=False),
        Step((FLAT, FLAT), PLANE, extrusion="interpolate", knots=(0, 0.25)),
        Step((FLAT,), PLANE, extrusion="modulate", curve="sin(pi*z)"),
        Step((FLAT,), PLANE, extrusion="modulate", curve=(0.0, 1.0)),
    )
    return Deformation(steps, "many steps", VolumeReference.of(volume))


def refusal(path: Path) -> str:
    with pytest.raises(DeformError) as caught:
        read_deformation(path)
    message = str(caught.value)
    assert "\n" not in message
    assert message.isprintable()
    return message


# ---- there and back --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["a.json", "with spaces, é and 鯉.json", "no suffix"])
def test_what_is_written_is_read(name: str, tmp_path: Path) -> None:
    write_deformation(document(), tmp_path / name)
    again = read_deformation(tmp_path / name)
    assert to_json(again) == to_json(document())
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_a_path_may_be_a_string(tmp_path: Path) -> None:
    write_deformation(document(), str(tmp_path / "a.json"))
    assert to_json(read_deformation(str(tmp_path / "a.json"))) == to_json(document())


def test_only_what_this_process_has_read_or_written_is_replaced_unasked(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_bytes(b"a letter")
    with pytest.raises(FileChangedError, match=r"a\.json was there before, and was neither opened nor saved here"):
        write_deformation(document(), path, overwrite=False)
    assert path.read_bytes() == b"a letter"
    write_deformation(document(), path)
    write_deformation(Deformation(), path, overwrite=False)  # a cell that runs again
    theirs = to_json(document())
    path.write_text(theirs, encoding="utf-8")
    with pytest.raises(FileChangedError, match="changed by someone else"):
        write_deformation(Deformation(), path, overwrite=False)
    assert path.read_text(encoding="utf-8") == theirs
    write_deformation(read_deformation(path), path, overwrite=False)
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


def test_of_two_that_make_a_file_at_once_the_second_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.json"

    @contextmanager
    def too_late() -> Iterator[None]:  # both have seen that there is none
        path.write_bytes(b"theirs")
        yield

    with guard_writes(too_late), pytest.raises(FileChangedError):
        write_deformation(document(), path, overwrite=False)
    assert path.read_bytes() == b"theirs"
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


def test_a_failing_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_deformation(document(), path)
    before = path.read_bytes()
    bad = Deformation(extra={"later": float("nan")})  # JSON has no NaN
    with pytest.raises(ValueError, match="JSON"):
        write_deformation(bad, path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(VolumeFileError, match="no folder"):
        write_deformation(document(), tmp_path / "missing" / "a.json")


# ---- refusals --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "match"),
    [
        (b"", "empty"),
        (b"   \n", "empty"),
        (b"{", "not complete JSON"),
        (b"\xff\xfe", "UTF-8"),
        (b"[]", "not a JSON object"),
        (b"{}", "not a deformnb document"),
        (b'{"format": "deformnb-deformation", "version": "9.0"}', "update deformnb"),
        (b'{"format": "deformnb-deformation", "version": "1.0", "steps": 3}', "steps"),
        (b"\x89PNG\r\n\x1a\n\0\0", ""),
        (b"[" * 100000, "nested"),
        (b"{" + b" " * LONGEST_DOCUMENT, "characters long"),
    ],
)
def test_damaged_files_are_named_with_what_is_wrong(content: bytes, match: str, tmp_path: Path) -> None:
    path = tmp_path / "session.json"
    path.write_bytes(content)
    message = refusal(path)
    assert message.startswith("session.json: ")
    assert match in message


def test_every_cut_is_noticed(tmp_path: Path) -> None:
    whole = to_json(document()).encode()
    path = tmp_path / "session.json"
    for length in range(0, len(whole.rstrip()) - 1, max(1, len(whole) // 60)):
        path.write_bytes(whole[:length])
        assert "session.json" in refusal(path)


def test_missing_files_folders_and_pipes_are_named(tmp_path: Path) -> None:
    assert "there is no file" in refusal(tmp_path / "missing.json")
    assert "is a folder" in refusal(tmp_path)
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    assert "loop" in refusal(tmp_path / "loop")
    assert "nul" in refusal(tmp_path / "nul\0byte")
    assert "long" in refusal(tmp_path / ("long" * 100))
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe")  # reading it would block for ever
        assert "not an ordinary file" in refusal(tmp_path / "pipe")


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="everything is permitted to root")
def test_a_file_without_permission_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_deformation(document(), path)
    path.chmod(0)
    assert "cannot be read" in refusal(path)


def test_an_error_of_the_disk_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.json"
    write_deformation(document(), path)

    def fail(*_: object, **__: object) -> None:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(Path, "open", fail)
    assert refusal(path).endswith("cannot be read: Input/output error.")


def test_names_cannot_control_the_terminal(tmp_path: Path) -> None:
    assert "\\x1b" in refusal(tmp_path / "\x1b[31mred\n.json")


# ---- for people ------------------------------------------------------------------------------------------------------


def test_a_document_is_described(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_deformation(document(), path)
    rows = describe_document(path)
    assert rows["name"] == "many steps"
    assert rows["made on"].startswith("carp, 5 x 4 x 3 voxels (x, y, z) of 0.390625 x 1 x 0.78125, sha256 ")
    assert rows["step 1"].startswith("bend: 3 control points on the plane with normal (0.0, 1.0, 0.0), wendland_c2")
    assert "in space" in rows["step 2"]
    assert "support 7.5" in rows["step 2"]
    assert "strength 0.5, switched off" in rows["step 2"]
    assert "3 + 3 control points" in rows["step 3"]
    assert "interpolate at depths 0, 0.25" in rows["step 3"]
    assert "modulate by sin(pi*z)" in rows["step 4"]
    assert "modulate by a table" in rows["step 5"]
    assert len(rows) == 9


def test_an_empty_document_is_described(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_deformation(Deformation(), path)
    assert describe_document(path) == {"file": str(path), "kind": "deformation", "name": "(none)"}


def test_texts_from_a_document_cannot_control_the_terminal(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    evil = "\x1b[2Jgone\n<script>"
    volume = VolumeReference(evil, (1, 1, 1), (1, 1, 1), "0" * 64)
    write_deformation(Deformation((Step((FLAT,), PLANE, name=evil),), evil, volume), path)
    for text in describe_document(path).values():
        assert text.isprintable()
    assert "<script>" in describe_document(path)["name"]  # shown unchanged: a terminal runs no scripts


def test_stages_are_described() -> None:
    rows = describe_document(Path(__file__).parents[1] / "fixtures" / "document_1.2.json")
    assert "strength 1, in 6 stages" in rows["step 1"]
    assert "stages" not in rows["step 2"]


def test_rigid_parts_cuts_and_key_frames_are_described() -> None:
    rows = describe_document(Path(__file__).parents[1] / "fixtures" / "document_1.1.json")
    assert "1 control points" not in rows["step 2"]
    assert "2 rigid part(s) (ground, a half space; bone, a mask that moves, switched off)" in rows["step 1"]
    assert "2 cut(s) by the rule paper (midline, a line; a polygon, switched off)" in rows["step 1"]
    assert rows["mode"].startswith("blend: ")
    assert rows["animation"] == "2 key frames at 0, 1.5 s"


@pytest.mark.parametrize(
    ("name", "wanted"),
    [
        ("drag.tfm", "drag.json"),
        ("drag.h5", "drag.json"),
        ("a.b.XFM", "a.b.json"),
        ("points.mrk.json", "points.json"),
        ("v.npy.json", "v.json"),
        ("out.nii.gz", "out.json"),
        ("out.NRRD", "out.json"),
        ("drag.json.gz", "drag.json"),
    ],
)
def test_no_document_is_written_under_the_suffix_of_another_kind_of_file(
    name: str, wanted: str, tmp_path: Path
) -> None:
    with pytest.raises(VolumeFileError, match=f"name it {wanted}") as caught:
        write_deformation(Deformation(), tmp_path / name)
    assert ("write_volume" in str(caught.value)) == name.startswith("out")
    assert not list(tmp_path.iterdir())


def test_a_session_and_its_studio_write_no_document_under_another_suffix(tmp_path: Path) -> None:
    session = Session(Volume.from_array(np.arange(64.0).reshape(4, 4, 4)))
    with pytest.raises(VolumeFileError, match=r"name it drag\.json"):
        session.save(tmp_path / "drag.h5")
    assert session.files.saved is None
    assert session.files.path is None
    assert not list(tmp_path.iterdir())
