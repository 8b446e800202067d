"""Writing from the studio's tab: a cancelled export frees the panel immediately and leaves no file."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from studio_driver import a_drag, a_volume, drag, get_notice, panel, wait_for

from deformnb.io.files.atomic import atomic_write
from deformnb.io.volumes.formats import read_volume, write_volume
from deformnb.session.exports import export
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets import Studio
from deformnb.widgets.studio.head import volume_facts
from deformnb.widgets.studio.panels import files as module


@pytest.fixture
def studio(tmp_path: Path) -> Iterator[Studio]:
    made = Studio(a_volume(), folder=tmp_path)
    made.wait()
    drag(made, a_drag(made))
    yield made
    made.close()


@pytest.mark.parametrize("moment", ["before it writes", "when all is written"])
def test_a_cancelled_file_frees_the_panel_at_once_and_never_comes(
    studio: Studio, tmp_path: Path, moment: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, go_on, ended = (threading.Event() for _ in range(3))

    def stubborn(frozen: Any, path: Path, progress: Any, **options: Any) -> Path:
        if path.suffix != ".png":
            return export(frozen, path, progress=progress, **options)
        try:
            if moment == "before it writes":  # it does not check, and is not asked
                begun.set()
                go_on.wait(60)
            with atomic_write(path) as stream:
                stream.write(b"late")
                begun.set()
                go_on.wait(60)
            return path
        finally:
            ended.set()

    monkeypatch.setattr(module, "export", stubborn)
    files = panel(studio, "Export")
    (tmp_path / "ball.png").write_bytes(b"older")
    studio.session.files.known.remember(tmp_path / "ball.png")  # as if it was written here before
    files.name.value = "ball.png"
    files.write.click()
    assert begun.wait(60)
    assert files.write.disabled
    assert not files.writing.cancel.disabled
    files.writing.cancel.click()
    assert not files.write.disabled
    assert not files.download.disabled
    assert files.writing.cancel.disabled
    assert files.writing.bar.layout.display == "none"
    assert files.writing.message.value == "Stopped; ball.png was not written."
    files.name.value = "ball.py"
    files.write.click()  # while the other still works
    wait_for(lambda: files.writing.message.value.startswith("Wrote ball.py"))
    go_on.set()
    assert ended.wait(60)
    wait_for(lambda: sorted(p.name for p in tmp_path.iterdir()) == ["ball.png", "ball.py"])
    assert (tmp_path / "ball.png").read_bytes() == b"older"
    assert files.writing.message.value.startswith("Wrote ball.py")  # no message of an export that nobody awaits


def test_a_file_that_takes_its_place_is_not_cancelled(
    studio: Studio, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    landing, go_on = threading.Event(), threading.Event()

    def slow_disk(frozen: Any, path: Path, progress: Any, **options: Any) -> Path:
        with atomic_write(path) as stream:
            stream.write(b"whole")
        landing.set()
        assert go_on.wait(60)
        return path

    monkeypatch.setattr(module, "export", slow_disk)
    files = panel(studio, "Export")
    files.name.value = "ball.png"
    files.write.click()
    assert landing.wait(60)
    files.writing.cancel.click()
    assert "Stopped" not in files.writing.message.value  # for it is there
    go_on.set()
    wait_for(lambda: files.writing.message.value.startswith("Wrote ball.png"))


def test_copying_says_which_line_to_fill_in(studio: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    files, sent = panel(studio, "Export"), []
    monkeypatch.setattr(files.writing.file_transfer, "send", lambda content, buffers=None: sent.append(content))
    files.copy.click()
    studio.session.files.source = 'dn.read_volume("ball.nrrd")'
    files.copy.click()
    unknown, known = sent
    assert "line 3" in unknown["note"]
    line = unknown["text"].splitlines()[2]
    assert line.startswith('volume = dn.read_volume("volume.nii.gz")  # write it first: dn.write_volume(volume, ')
    assert "put your own volume here" in line
    assert known["note"] == ""
    assert known["text"].splitlines()[2] == 'volume = dn.read_volume("ball.nrrd")'


def test_a_page_has_the_title_and_the_text_that_are_written_for_it(studio: Studio, tmp_path: Path) -> None:
    files = panel(studio, "Export")
    assert not files.page.box.is_visible
    assert files.page.title.value == studio.volume.name
    files.kind.value = next(value for _, value in files.kind.options if value.endswith(".html"))
    assert files.page.box.is_visible
    files.name.value, files.page.title.value, files.page.text.value = "page.html", "A < B", "Drag the <tail>."
    files.write.click()
    files.page.title.value = "of the next one"
    wait_for(lambda: files.writing.message.value.startswith("Wrote page.html"))
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "<title>A &lt; B</title>" in page
    assert '<h1 translate="no">A &lt; B</h1>' in page
    assert "Drag the &lt;tail&gt;." in page


def test_a_level_of_a_pyramid_is_named_and_exported_at_full_resolution(tmp_path: Path) -> None:
    pytest.importorskip("zarr")
    values = np.random.default_rng(2).integers(10, 250, (8, 9, 300)).astype(np.uint8)
    write_volume(Volume(values, Grid(values.shape), "tissue"), tmp_path / "in.zarr")
    studio = Studio(read_volume(tmp_path / "in.zarr", level=1), folder=tmp_path)
    try:
        files = panel(studio, "Export")
        assert files.level.is_visible
        assert "level 1" in files.level.children[0].value
        assert "300 x 9 x 8 voxels" in files.level.children[0].value
        assert "level 1" in volume_facts(studio.volume)
        files.level.children[1].click()
        wait_for(lambda: files.writing.message.value.startswith("Wrote in_deformed.zarr"))
        assert_array_equal(read_volume(tmp_path / "in_deformed.zarr", level=0).values, values)
        files.download.click()
        assert "a browser cannot take over" in get_notice(studio)
    finally:
        studio.close()


def test_a_volume_that_is_no_coarser_level_has_no_export_of_a_finer_one(studio: Studio) -> None:
    assert not panel(studio, "Export").level.is_visible
