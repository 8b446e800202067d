"""The panel of fitting: targets are chosen in a folder, points find their places, an edit meanwhile wins."""

from __future__ import annotations

import io
import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from deformed_pictures import texture
from PIL import Image
from studio_driver import panel, wait_for
from widgets.studio.panels.test_steps_history import Guarded

import deformnb as dn
from deformnb.document.deformation import Deformation
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.support import lone_support
from deformnb.session.session import Session
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets import Studio
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.studio.editors import show_step
from deformnb.widgets.studio.panels.registration import FitPanel, blend_pictures
from deformnb.widgets.studio.panels.target import GIVEN, NO_TARGET, FitTarget

SHAPE = (48, 4, 48)
GRID = Grid(SHAPE, (1.0, 1.0, 1.0))
VALUES = (250 * texture((48, 48), scales=(2.0, 4.0))[:, None, :] * np.ones(SHAPE)).astype(np.uint8)
VOLUME = Volume(VALUES, GRID, "subject")


def _document() -> Deformation:
    """Corners held, five points dragged by up to 3 on the picture from the front."""
    session = Session(VOLUME, view="+y")
    session.editing.change(support="box_diagonal")
    points = session.editing.points
    for source, drag in (
        ((16, 16), (2, 1)),
        ((31, 15), (-1, 2)),
        ((16, 31), (1, -3)),
        ((32, 32), (2, -1)),
        ((24, 24), (0, 1)),
    ):
        points = points.add(source, np.add(source, drag))
    session.editing.edit_points(points)
    return session.editing.deformation


TRUE = _document()
TARGET = Volume(dn.warp(VOLUME, TRUE.field(GRID)).values, GRID, "target")


def finish(panel: FitPanel) -> None:
    """Wait until all that was begun in the panel's thread is done and shown, and no preview waits to be made."""
    wait_for(lambda: not panel.thread.is_wanted)
    panel.thread.call(lambda: None).result(90)  # behind the present work of the thread


class Bench:
    """A panel with a session and an editor that follows it, as a studio wires them."""

    def __init__(self, folder: Path, target: Volume | None = None, volume: Volume = VOLUME) -> None:
        self.session = Session(volume, view="+y")
        self.session.editing.change(support="box_diagonal")
        points = TRUE.steps[0].points.reset()
        for k in range(4):
            points = points.edit(k, locked=True)
        self.session.editing.edit_points(points)
        self.guard = Guarded()
        self.editor = Editor(self.session.pictures.picture(), self.session.editing.points)
        self.editor.lone_support = lone_support(GRID)
        self.panel = FitPanel(self.session, self.guard, SimpleNamespace(current=self.editor), folder, target)
        self.session.editing.observe(self.follow, "deformation")

    def follow(self, _change: Any = None) -> None:
        show_step(self.editor, self.session)
        self.panel.refresh()

    def press(self, text: str) -> None:
        """Press a button and wait for its end."""
        self.panel.buttons[text].click()
        self.wait()

    def choose(self, key: str) -> None:
        self.panel.choice.value = key
        self.wait()

    def wait(self) -> None:
        finish(self.panel)

    def misses(self) -> Any:
        return np.linalg.norm(self.session.editing.points.target - TRUE.steps[0].points.target, axis=1)

    @property
    def message_text(self) -> str:
        return str(self.panel.message.value)


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    made = Bench(tmp_path, TARGET)
    yield made
    made.panel.close()


def test_without_a_target_nothing_can_be_pressed(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    assert bench.panel.choice.value == NO_TARGET
    assert all(made.disabled for made in bench.panel.buttons.values())
    assert "Choose the target of the volume" in bench.message_text
    bench.panel.close()


def test_what_only_jax_can_do_is_not_offered_without_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deformnb.widgets.studio.panels.registration.HAS_JAX", False)
    bench = Bench(tmp_path, TARGET)
    disabled = {text: made.tooltip for text, made in bench.panel.buttons.items() if made.disabled}
    assert disabled == {"Fit all points": "This needs JAX, which is not installed: pip install jax"}
    bench.panel.close()


def test_fit_all_points_finds_them_again_as_one_edit(bench: Bench) -> None:
    before = bench.session.editing.points
    assert bench.misses().max() > 3
    bench.press("Fit all points")
    assert bench.misses().max() < 0.5
    assert bench.session.editing.history["undo"] == "fit all points"
    assert "Similarity" in bench.message_text
    assert "5 points moved" in bench.message_text
    bench.session.editing.undo()
    assert bench.session.editing.points == before
    assert not bench.guard.errors


def test_selected_points_snap_and_what_was_left_is_named(bench: Bench) -> None:
    bench.press("Snap selected points")
    assert "no point is selected" in bench.guard.errors.pop()
    bench.editor.selected = [0, 6]
    bench.press("Snap selected points")
    assert "1 of 2 points snapped" in bench.message_text
    assert "Left because it is locked: 0 (corner)." in bench.message_text
    assert bench.misses()[6] < 1 < 2 < bench.misses()[7]
    assert bench.session.editing.history["undo"] == "snap selected points"


def _round(width: float, height: float) -> Volume:
    z, _, x = np.mgrid[:48, :4, :48]
    return Volume((250 * np.clip(8 * (1 - np.hypot((x - 24) / width, (z - 22) / height)), 0, 1)).astype(np.uint8), GRID)


def test_points_are_put_on_the_outline_and_slide_there(tmp_path: Path) -> None:
    bench = Bench(tmp_path, _round(20, 12), _round(15, 15))
    bench.panel.count.value = 8
    bench.press("Points along the outline")
    points = bench.session.editing.points
    assert [name for name in points.names if name.startswith("outline")] == [f"outline {k}" for k in range(1, 9)]
    assert "8 points put on the outline" in bench.message_text
    bench.press("Slide along the outline")
    assert "8 points slid" in bench.message_text
    assert (bench.session.editing.points.target[:9] == points.target[:9]).all()
    found = bench.session.editing.points.target[9:] - [24.0, 25.0]  # of the picture, whose b runs down
    assert np.abs(np.hypot(found[:, 0] / 19.0, found[:, 1] / 11.4) - 1).max() < 0.1
    bench.panel.close()


def test_sliding_without_points_on_the_outline_is_refused(bench: Bench) -> None:
    bench.press("Slide along the outline")
    assert "no point is on the outline yet" in bench.guard.errors[0]


def test_an_edit_meanwhile_wins(bench: Bench) -> None:
    begun, edited = threading.Event(), threading.Event()

    def slow(_change: Any) -> None:
        begun.set()
        edited.wait(30)

    bench.panel.progress.bar.observe(slow, "value")
    bench.panel.buttons["Fit all points"].click()
    assert begun.wait(60)
    moved = bench.session.editing.points.move(8, [20.0, 20.0])
    bench.session.editing.edit_points(moved)
    edited.set()
    bench.wait()
    assert bench.session.editing.points == moved
    assert "discarded" in bench.message_text


def test_stop_leaves_everything_as_it_was(bench: Bench) -> None:
    before = bench.session.editing.deformation
    bench.panel.progress.bar.observe(lambda _: bench.panel.progress.stop.click(), "value")
    bench.press("Fit all points")
    assert bench.message_text.endswith("Stopped; nothing was changed.</div>")
    assert bench.session.editing.deformation is before
    assert not bench.panel.buttons["Fit all points"].disabled


def test_what_the_fit_does_not_know_is_refused(bench: Bench) -> None:
    bench.session.editing.change(strength=0.5)
    bench.press("Fit all points")
    assert "set Strength to 1" in bench.guard.errors.pop()
    bench.session.editing.change(strength=1.0, cuts=(dn.Cut(dn.Line([(10.0, 10.0), (30.0, 12.0)])),))
    bench.press("Fit all points")
    assert "cuts and rigid parts" in bench.guard.errors.pop()


def test_a_volume_and_a_session_of_the_folder_can_be_chosen(tmp_path: Path) -> None:
    dn.write_volume(TARGET, tmp_path / "bent.nrrd")
    dn.write_deformation(TRUE, tmp_path / "bent.json")
    (tmp_path / "notes.txt").write_text("no volume", encoding="utf-8")
    bench = Bench(tmp_path)
    assert [key for _, key in bench.panel.choice.options] == [NO_TARGET, "bent.json", "bent.nrrd"]
    for key in ("bent.json", "bent.nrrd"):
        bench.choose(key)
        assert not bench.panel.buttons["Fit all points"].disabled
        assert (bench.panel.target.volume.values == TARGET.values).all()  # type: ignore[union-attr]
    (tmp_path / "bent.json").unlink()
    (tmp_path / "broken.nrrd").write_bytes(b"NRRD0004\nnonsense")
    bench.panel.refresh()
    assert [key for _, key in bench.panel.choice.options] == [NO_TARGET, "bent.nrrd", "broken.nrrd"]
    bench.choose("broken.nrrd")
    assert bench.panel.choice.value == "bent.nrrd"  # what cannot be read is not chosen
    assert len(bench.guard.errors) == 1
    (tmp_path / "bent.nrrd").unlink()
    bench.panel.refresh()
    assert bench.panel.choice.value == "bent.nrrd"  # and is still there to be fitted to
    assert bench.panel.choice.options[-1] == ("bent.nrrd (no longer in the folder)", "bent.nrrd")
    bench.choose(NO_TARGET)
    assert bench.panel.buttons["Fit all points"].disabled
    bench.panel.close()


def test_a_target_elsewhere_in_space_is_laid_middle_on_middle(tmp_path: Path) -> None:
    far = Volume(TARGET.values, Grid(SHAPE, (1.0, 1.0, 1.0), (500.0, 0.0, -90.0)), "far")
    target = FitTarget(Session(VOLUME, view="+y"), tmp_path, far)
    target.choose(GIVEN)
    assert "middles coincide" in target.note
    moving, fixed = target.pair()
    assert np.allclose(fixed.raster.origin, moving.raster.origin)  # type: ignore[union-attr]


def test_the_preview_shows_both_pictures(bench: Bench) -> None:
    wait_for(lambda: len(bench.panel.preview.image.value) > 0)
    first = bench.panel.preview.image.value
    shown = np.asarray(Image.open(io.BytesIO(first)))
    assert shown.shape == (260, 526, 3)
    assert (shown[..., 0] == shown[..., 2]).all()  # magenta
    bench.panel.preview.blend.value = 1.0
    wait_for(lambda: bench.panel.preview.image.value != first)
    finish(bench.panel)
    second = np.asarray(Image.open(io.BytesIO(bench.panel.preview.image.value)))
    assert (second[:, 266:] == shown[:, 266:]).all()
    assert (second[:, :260, 0] == shown[:, 266:, 0]).all()  # the left is the target now


def test_the_target_is_laid_over_the_editor_on_request(bench: Bench) -> None:
    wait_for(lambda: len(bench.panel.preview.image.value) > 0)
    assert bench.editor.ghost == b""
    bench.panel.preview.over.value = 0.4
    wait_for(lambda: bench.editor.ghost_opacity == 0.4)
    laid = np.asarray(Image.open(io.BytesIO(bench.editor.ghost)))
    fixed = bench.panel.target.pair()[1].grey()  # type: ignore[union-attr]
    assert np.abs(laid[..., 0] - 255.0 * fixed).max() <= 1
    bench.choose(NO_TARGET)
    assert bench.editor.ghost_opacity == 0


def test_green_over_magenta() -> None:
    now, goal = np.array([[1.0, 0.0]]), np.array([[0.0, 0.5]])
    picture = blend_pictures(now, goal, 0.25)
    assert picture[0, :2].tolist() == [[191] * 3, [32] * 3]
    assert picture[0, -2:].tolist() == [[0, 255, 0], [128, 0, 128]]


@pytest.mark.nightly
def test_points_in_space_are_fitted_to_the_volume(tmp_path: Path) -> None:
    values = (250 * texture((24, 24, 24), scales=(2.0, 3.0))).astype(np.uint8)
    volume = Volume(values, Grid((24, 24, 24)), "cube")
    source = np.stack(np.meshgrid(*[[7.0, 16.0]] * 3), axis=-1).reshape(-1, 3)
    true = ControlPoints.from_arrays(source, source + np.array([1.5, -1.0, 0.5]))
    target = dn.warp(volume, dn.fit_rbf(true))
    studio = Studio(volume, Deformation.from_space_points(true.reset()), target=target, folder=tmp_path)
    fit = panel(studio, "Match to another picture")
    assert fit.choice.value == GIVEN
    assert fit.buttons["Points along the outline"].disabled
    fit.buttons["Fit all points"].click()
    finish(fit)
    found = studio.session.editing.points.target
    studio.close()
    assert np.linalg.norm(found - true.target, axis=1).max() < 0.3


def test_a_studio_hands_its_target_on_and_ends_its_thread(tmp_path: Path) -> None:
    studio = Studio(VOLUME, target=TARGET.values, folder=tmp_path)
    fit = panel(studio, "Match to another picture")
    assert fit.target.volume.grid == GRID
    studio.close()
    assert fit.thread.is_closed
