"""The application's page while its program is starting, has ended, and is back: a real process that is killed."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser.app_tab import PATIENCE, cube, wait_until

from deformnb.io import write_volume

pytestmark = pytest.mark.needs_browser

DRAWN = """document.querySelector('.dnb-editor')?.deformnb?.parts.picture.painter.source
    && document.querySelector('.dnb-view')?.deformnb?.caster?.isReady && !document.querySelector('.dnb-start')"""
POINTS = "document.querySelector('.dnb-editor').deformnb.parts.points.list.map(({ target }) => target)"
CAMERA = "document.querySelector('.dnb-view').deformnb.camera.direction"


class Program:
    """``deformnb app`` in a process."""

    def __init__(self, path: Path, folder: Path) -> None:
        self._path, self._folder = path, folder
        self.process: subprocess.Popen[str]

    def start(self) -> str:
        """Start it; returns its address."""
        with (self._folder / "log.txt").open("a", encoding="utf-8") as log:
            self.process = self._launch(log)
        assert self.process.stdout is not None
        return self.process.stdout.readline().strip()

    def _launch(self, log: Any) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-m", "deformnb", "app", "--no-browser", "--side", "+y", str(self._path)],
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
            env={**os.environ, "DEFORMNB_STATE": str(self._folder / "state")},
            cwd=self._folder,
        )

    def kill(self) -> None:
        self.process.kill()
        self.process.wait(60)
        if self.process.stdout is not None:
            self.process.stdout.close()


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[[str], Program]]:
    """Function that makes the program of a file with this name."""
    made: list[Program] = []

    def make(name: str) -> Program:
        made.append(Program(tmp_path / name, tmp_path))
        return made[-1]

    yield make
    for program in made:
        if hasattr(program, "process"):
            program.kill()


def drag_new_point(page: Any, share: float, by: tuple[float, float]) -> None:
    """Add a point at this share of the picture's width, and drag it by so many pixels."""
    box = page.locator(".dnb-ed-stage").bounding_box()
    x, y = box["x"] + box["width"] * share, box["y"] + box["height"] / 2
    before = len(page.evaluate(POINTS))
    page.mouse.dblclick(x, y)
    page.wait_for_function(f"{POINTS}.length === {before + 1}")
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + by[0], y + by[1], steps=5)
    page.mouse.up()


def test_a_page_outlives_its_program_and_goes_on_with_the_next(
    browser: Any, start: Callable[[str], Program], tmp_path: Path
) -> None:
    write_volume(cube(), tmp_path / "cube.nii")
    program = start("cube.nii")
    page = browser.new_page(viewport={"width": 1000, "height": 640})
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    address = program.start()
    page.goto(address)
    page.wait_for_selector(".dnb-start")  # the studio cannot be there yet
    page.wait_for_function("document.querySelector('.dnb-start-name')?.textContent === 'cube.nii'", timeout=PATIENCE)
    page.wait_for_function(DRAWN, timeout=PATIENCE)
    drag_new_point(page, 0.5, (20, 10))
    page.wait_for_function("document.querySelector('.dnb-editor').deformnb.sender.isBehind() === false")
    edited = page.evaluate(POINTS)
    assert len(edited) == 5
    sessions = tmp_path / "state" / "sessions"
    wait_until(lambda: any(f"{edited[4][0]:.6f}"[:-2] in path.read_text("utf-8") for path in sessions.glob("*.json")))

    program.kill()
    bar = page.locator(".dnb-restore")
    page.wait_for_selector(".dnb-restore-gone", timeout=PATIENCE)
    assert "The last edit was autosaved at" in bar.inner_text()
    assert "this page continues automatically" in bar.inner_text()
    assert page.evaluate(POINTS) == edited
    assert page.locator(".dnb-view canvas").first.is_visible()
    before = page.evaluate(CAMERA)
    box = page.locator(".dnb-view canvas").first.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 60, y + 10, steps=5)
    page.mouse.up()
    page.wait_for_function(f"JSON.stringify({CAMERA}) !== {str(before).replace(' ', '')!r}")
    turned = page.evaluate(CAMERA)
    page.wait_for_function("document.querySelector('.dnb-ed-stage')")
    drag_new_point(page, 0.4, (-10, 15))
    held = page.evaluate(POINTS)
    assert len(held) == 6

    assert program.start().split("/index")[0] == address.split("/index")[0]
    page.wait_for_function(
        "document.querySelector('.dnb-app-notice:not([hidden])')?.textContent === "
        "'deformnb is back, and the session goes on.'",
        timeout=PATIENCE,
    )
    assert page.locator(".dnb-studio").count() == 1
    page.wait_for_function("document.querySelector('.dnb-editor').deformnb.sender.isBehind() === false")
    np.testing.assert_allclose(page.evaluate(POINTS), held)
    assert not bar.is_visible()  # nothing is offered: the session goes on
    page.wait_for_function(f"{CAMERA}.every((x, k) => Math.abs(x - {turned}[k]) < 1e-6)")
    page.locator(".dnb-head-undo").click()  # what was held came as an edit
    page.wait_for_function(f"{POINTS}.length === 5")
    np.testing.assert_allclose(page.evaluate(POINTS), edited)
    assert errors == []
    page.close()


def test_a_file_that_cannot_be_read_is_said_on_the_page(
    browser: Any, start: Callable[[str], Program], tmp_path: Path
) -> None:
    (tmp_path / "broken.nii").write_bytes(b"no volume")
    program = start("broken.nii")
    page = browser.new_page()
    page.goto(program.start())
    page.wait_for_selector(".dnb-start-failed", timeout=PATIENCE)
    assert "broken.nii" in page.locator(".dnb-start-text").inner_text()
    assert program.process.wait(PATIENCE / 1000) == 2
    page.close()


def test_a_page_of_another_session_is_not_let_in(browser: Any, start: Callable[[str], Program], tmp_path: Path) -> None:
    write_volume(cube(), tmp_path / "cube.nii")
    program = start("cube.nii")
    address = program.start()
    page = browser.new_page()
    page.goto(address.replace("secret=", "secret=another"))
    page.wait_for_function("document.body.innerText.includes('There is no session for this page')", timeout=PATIENCE)
    page.close()
