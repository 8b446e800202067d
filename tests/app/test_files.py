"""Files that a page takes home and brings along: written here, handed out once asked for, gone at the end."""

from __future__ import annotations

import asyncio
import json
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from running_app import PATIENCE, RunningApp, connected, heard, status_of

from deformnb.app.application import REQUESTS, Application
from deformnb.app.files import DOWNLOADS, suffix_of
from deformnb.datasets.phantoms import PHANTOMS
from deformnb.errors import DeformError
from deformnb.io import read_volume
from deformnb.session.exports import EXPORTS, Seen
from deformnb.session.session import Session
from deformnb.volume.volume import Volume
from deformnb.widgets.camera import checked_camera


def until(condition: Callable[[], Any]) -> None:
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, "it did not come true"
        time.sleep(0.01)


def bar() -> Session:
    session = Session(PHANTOMS["bar"].make((12, 16, 20)), view="+y", transfer="bone")
    session.edit_points(session.points.move(0, session.points.target[0] + 2.0))
    return session


@pytest.fixture
def app() -> Iterator[Application]:
    made = Application(bar())
    yield made
    made.close()


def written(app: Application, kind: str) -> Path:
    app.write(kind, "page")
    until(lambda: not app.files.state["busy"])
    path = app.files.path(app.files.state["key"])
    assert path is not None, app.files.state["message"]
    return path


def test_what_can_be_asked_for_is_what_can_be_exported() -> None:
    assert set(DOWNLOADS) - {"page"} == set(EXPORTS) - {"document"}
    assert suffix_of("page") == ".html"
    assert {"stop_file", "take_anyway", "forget_file"} < set(REQUESTS)


def test_the_volume_that_is_written_is_the_deformed_one(app: Application, tmp_path: Path) -> None:
    path = written(app, "volume")
    assert path.name == "bar_phantom_deformed.nii.gz"
    assert path.parent.stat().st_mode & 0o077 == 0  # nobody else may look
    np.testing.assert_array_equal(read_volume(path).values, app.session.result().values)
    assert app.files.state["page"] == "page"


@pytest.mark.parametrize(("kind", "begins"), [
    ("script", b"import deformnb"), ("page", b"<!doctype html>"), ("drawing", b"<?xml"), ("rendering", b"\x89png")])
def test_each_kind_is_written(app: Application, kind: str, begins: bytes) -> None:
    path = written(app, kind)
    assert path.name == f"bar_phantom{suffix_of(kind)}"
    assert path.read_bytes()[:40].lower().startswith(begins)


def test_what_went_well_is_said_for_a_while_or_until_something_else_is(app: Application, monkeypatch: pytest.MonkeyPatch
                                                                       ) -> None:
    written(app, "script")
    assert "goes to the downloads" in app.files.state["message"]
    app.set("kernel", "gaussian")
    assert app.state()["files"]["message"] == ""
    assert app.files.state["key"]  # it can still be fetched
    monkeypatch.setattr("deformnb.app.files._BRIEFLY", 0.1)
    written(app, "script")
    until(lambda: not app.files.state["message"])
    app.open(app.document())
    until(lambda: not app.files.state["message"])
    monkeypatch.setattr("deformnb.app.files.export", lambda *given, **options: 1 / 0)
    app.write("script", "page")
    until(lambda: not app.files.state["busy"])
    time.sleep(0.3)
    app.set("kernel", "cubic")
    assert "could not be written" in app.files.state["message"]  # that is for its user to close


def test_one_file_at_a_time_and_the_next_takes_it_away(app: Application, monkeypatch: pytest.MonkeyPatch) -> None:
    first = written(app, "script")
    key = app.files.state["key"]
    go, seen = threading.Event(), []

    def slow(frozen: Any, path: Path, progress: Callable[[float], None]) -> None:
        for share in (0.1, 0.5):
            progress(share)
            seen.append(app.files.state["share"])
        assert go.wait(PATIENCE)
        progress(0.9)

    monkeypatch.setattr("deformnb.app.files.export", slow)
    app.write("movie", "page")
    until(lambda: len(seen) == 2)
    assert seen == [0.1, 0.5]
    assert not first.exists()
    assert app.files.path(key) is None
    app.write("script", "page")
    assert "still being written" in app.error
    app.act("stop_file")
    go.set()
    until(lambda: not app.files.state["busy"])
    assert app.files.state["message"] == "Stopped; bar_phantom.gif was not written."
    assert app.files.state["key"] == ""


def test_what_goes_wrong_is_said(app: Application, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*given: Any, **options: Any) -> None:
        raise OSError("no room left")

    monkeypatch.setattr("deformnb.app.files.export", fail)
    app.write("volume", "page")
    until(lambda: not app.files.state["busy"])
    assert app.files.state["message"] == "bar_phantom_deformed.nii.gz could not be written: OSError: no room left"
    assert app.state()["latency"] == ""  # it was no edit
    app.act("forget_file")
    assert app.state()["files"]["message"] == ""


def test_nothing_is_left_behind(app: Application) -> None:
    path = written(app, "script")
    app.close()
    assert not path.parent.exists()


def test_a_session_that_is_brought_along_can_be_undone(app: Application) -> None:
    text, before = app.document(), app.session.deformation
    app.act("reset")
    assert app.session.deformation != before
    app.open(text)
    assert app.session.deformation.steps == before.steps
    assert app.editor.points == app.session.points
    app.act("undo")
    assert not app.session.points.displacement.any()


def test_a_session_of_another_volume_is_asked_about(app: Application) -> None:
    other = Session(Volume.from_array(np.arange(6 * 7 * 8, dtype=np.uint8).reshape(6, 7, 8)), view="+y")
    other.edit_points(other.points.move(1, other.points.target[1] + 1.0))
    made = Application(other)
    text, before = made.document(), app.session.deformation
    made.close()
    app.open(text)
    assert app.session.deformation == before
    assert app.state()["files"]["doubt"]
    app.act("take_anyway")
    assert app.session.points == other.points
    assert app.state()["files"]["doubt"] == ""
    app.act("take_anyway")  # there is nothing to take any more
    assert app.session.points == other.points


@pytest.mark.parametrize("text", ["", "{}", "[1", json.dumps({"format": "deformnb", "version": 99})])
def test_what_is_no_session_is_refused(app: Application, text: str) -> None:
    before = app.session.deformation
    app.open(text)
    assert app.error
    assert app.session.deformation == before


def test_a_page_is_told_where_its_file_is_and_nobody_else_finds_it() -> None:
    async def talk() -> Any:
        async with connected(running) as page:
            for given in (("document", "p"), ("volume", "p" * 65), (["volume"], "p")):
                await page.call("deformnb.write", *given)
            await page.call("deformnb.take", 7)
            assert running.server.dropped == 4
            await page.call("deformnb.write", "script", "p")
            ready = await heard(page, lambda m: (m.get("result", {}).get("files") or {}).get("key"))
            return ready["result"]["files"]

    with RunningApp(bar()) as running:
        files = asyncio.run(talk())
        assert (files["name"], files["page"]) == ("bar_phantom.py", "p")
        with status_of(running, f"/deformnb/file/{files['key']}") as (status, headers, text):
            assert status == 200
            assert headers["Content-Disposition"] == 'attachment; filename="bar_phantom.py"'
            assert "Deformation" in text
        other = "y" if files["key"].endswith("x") else "x"
        for wrong in (files["key"][:-1] + other, "x", "..%2f..%2fetc%2fpasswd"):
            with status_of(running, f"/deformnb/file/{wrong}") as (status, _, text):
                assert status == 404
        with status_of(running, f"/deformnb/file/{files['key']}", Origin="http://evil.example") as (status, _, _text):
            assert status == 403


def test_a_page_is_written_as_it_is_seen_and_nobody_else_is_turned(app: Application,
                                                                   monkeypatch: pytest.MonkeyPatch) -> None:
    cameras = []
    monkeypatch.setattr("deformnb.widgets.standalone.write_standalone",
                        lambda path, editor, view, **options: cameras.append(view.camera))
    here, elsewhere = app.live.camera, checked_camera({"direction": [1, 0, 0]})
    app.files._seen = lambda: Seen(camera=elsewhere)  # by a page that gets pictures
    app.write("page", "page")
    until(lambda: not app.files.state["busy"])
    assert cameras == [elsewhere]
    assert app.live.camera == here


def test_two_that_speak_at_once_do_not_take_back_each_others_words(app: Application) -> None:
    has_begun, may_end = threading.Event(), threading.Event()

    class Slow(dict[str, Any]):
        """Is read while somebody else speaks."""

        def keys(self) -> Any:
            has_begun.set()
            may_end.wait(0.5)
            return super().keys()

        def __iter__(self) -> Any:
            return super().__iter__()

    app.files.state = Slow(app.files.state)
    writer = threading.Thread(target=lambda: app.files._report(share=0.5))
    writer.start()
    assert has_begun.wait(PATIENCE)
    app.files._report(doubt="?")
    may_end.set()
    writer.join()
    assert (app.files.state["share"], app.files.state["doubt"]) == (0.5, "?")


def test_unknown_kinds_are_refused(app: Application) -> None:
    with pytest.raises(DeformError):
        app.files.write("document", "page")


def test_a_box_that_fits_what_was_dragged_out_is_seen_and_can_be_left(app: Application) -> None:
    app.session.edit_points(app.session.points.move(0, app.session.points.target[0] + [60.0, 0.0]))
    app.act("fit_box")
    output = app.session.output
    assert output is not None
    assert "voxels" in app.state()["box"]
    assert app.live._output == output
    app.act("own_box")
    assert app.session.output is None
    assert app.state()["box"] == ""
