"""JupyterLab, a real mouse and a kernel that is killed: the page says so, and the next studio gives the edit back."""

from __future__ import annotations

import re
import time
from typing import Any

import pytest
from browser.hosts import SMALL_STUDIO, Lab, box_at_rest
from browser.pane_messages import message_script

pytestmark = pytest.mark.needs_browser

EDITOR = "document.querySelector('.dnb-editor')?.deformnb?.parts"


def at(page: Any, a: float, b: float) -> tuple[float, float]:
    """Place on the screen of a place of the picture in millimetres."""
    page.locator(".dnb-ed-stage").scroll_into_view_if_needed()
    box = box_at_rest(page.locator(".dnb-ed-stage"))
    x, y, k = page.evaluate(f"() => [{EDITOR}.viewport.view.x, {EDITOR}.viewport.view.y, {EDITOR}.viewport.view.k]")
    return box["x"] + x + k * a, box["y"] + y + k * b


def ready(page: Any) -> None:
    page.wait_for_function(f"document.querySelector('.dnb-editor') && {EDITOR}.picture.painter.source", timeout=120_000)


def points(page: Any) -> Any:
    return page.evaluate(f"() => {EDITOR}.points.list.map(({{ source, target }}) => [source, target])")


@pytest.mark.nightly
def test_a_view_that_was_loaded_too_slowly_says_so_when_it_opens(lab: Lab, browser: Any) -> None:
    page = browser.new_page(viewport={"width": 1280, "height": 1000})
    # anywidget waits two seconds for the module of a model; here it has no time at all, as on a machine too busy.
    page.add_init_script("""const timeout = AbortSignal.timeout;
        AbortSignal.timeout = (ms) => timeout(ms === 2000 ? 0 : ms);""")
    lab.open_notebook(page, [SMALL_STUDIO], "slow.ipynb")
    page.wait_for_function(f"{message_script('.dnb-editor')}.endsWith('run the cell again')", timeout=60_000)
    page.close()


@pytest.mark.nightly
def test_what_a_killed_kernel_held_comes_back(lab: Lab, browser: Any) -> None:
    page = browser.new_page(viewport={"width": 1280, "height": 1000})
    lab.open_notebook(page, [SMALL_STUDIO])
    ready(page)
    bar = page.locator(".dnb-restore")
    assert not bar.is_visible()
    page.mouse.dblclick(*at(page, 20, 20))
    page.wait_for_function(f"{EDITOR}.points.list.length === 5")
    page.mouse.move(*at(page, 20, 20))
    page.mouse.down()
    page.mouse.move(*at(page, 26, 23), steps=5)
    page.mouse.up()
    end = time.monotonic() + 60
    while lab.run(page, "print(studio.editor.points.target[4, 0] > 25)").strip() != "True":
        assert time.monotonic() < end, "the drag has not reached the kernel"
    assert lab.run(page, "studio.parts.bar.recovery.autosave.flush()") == ""
    edited = points(page)
    assert edited[4][1][0] > edited[4][0][0] + 4
    page.evaluate("""() => { jupyterapp.shell.currentWidget.sessionContext.session.kernel.requestExecute(
        { code: "import os, signal; os.kill(os.getpid(), signal.SIGKILL)", store_history: false }); }""")
    page.wait_for_function("document.querySelector('.dnb-restore-gone')", timeout=60_000)
    assert "The kernel was restarted. Run the cell again. The session autosaved at" in bar.inner_text()
    assert page.locator(".dnb-restore-button").filter(visible=True).count() == 0
    # Nothing is displaced by ipywidgets' marks of broken links, and picture and volume are as alive as before.
    page.wait_for_function("document.querySelectorAll('.dnb-studio .jupyter-widgets-disconnected').length > 20")
    assert (
        page.evaluate("""() => [...document.querySelectorAll('.jupyter-widgets-disconnected')]
        .filter((element) => !['none', '""'].includes(getComputedStyle(element, '::before').content)).length""")
        == 0
    )
    assert page.locator(".dnb-ed-stage").bounding_box()["height"] > 100

    # JupyterLab tells of the kernel's end too, sooner or later.
    page.add_locator_handler(page.locator(".jp-Dialog"), lambda: page.keyboard.press("Escape"))
    page.wait_for_function(
        "jupyterapp.shell.currentWidget.sessionContext.session?.kernel?.status === 'idle'", timeout=60_000
    )
    page.mouse.move(*at(page, 26, 23))
    page.mouse.down()
    page.mouse.move(*at(page, 22, 27), steps=5)
    page.mouse.up()
    assert points(page)[4][1][1] > edited[4][1][1] + 2
    lab.run_all(page)
    page.wait_for_selector(".dnb-restore:not(.dnb-restore-gone)", state="visible", timeout=120_000)
    ready(page)
    assert "was not saved (5 points, 1 step)." in bar.inner_text()
    assert len(points(page)) == 4
    page.get_by_role("button", name="Restore").click()
    page.wait_for_function(f"{EDITOR}.points.list.length === 5", timeout=60_000)
    assert points(page) == edited
    bar.wait_for(state="hidden")
    page.evaluate("() => { jupyterapp.shell.currentWidget.sessionContext.session.kernel.restart(); }")
    page.wait_for_function("document.querySelector('.dnb-restore-gone')", timeout=60_000)  # its user's own restart
    page.close()


@pytest.mark.nightly
def test_an_unsaved_notebook_can_be_loaded_again_twice(lab: Lab, browser: Any) -> None:
    page = browser.new_page(viewport={"width": 1280, "height": 1000})
    page.on("dialog", lambda dialog: dialog.accept())  # the browser asks whether to leave what is not saved
    failures: list[str] = []
    page.on("console", lambda message: failures.extend(re.findall("Failed to initialize.*", message.text)))
    lab.open_notebook(page, [SMALL_STUDIO], "unsaved.ipynb")
    ready(page)
    for _ in range(2):
        page.reload(timeout=60_000)
        lab.wait_until_open(page)
        lab.run_all(page)  # the notebook's file has no outputs; the kernel has the widgets of the cells before
        ready(page)
        page.mouse.dblclick(*at(page, 20, 20))
        page.wait_for_function(f"{EDITOR}.points.list.length === 5")
        assert page.get_by_text("Failed to initialize model").count() == 0
        end = time.monotonic() + 60
        while lab.run(page, "print(len(studio.editor.points))").strip() != "5":
            assert time.monotonic() < end, "the point has not reached the kernel"
    assert not failures
    page.close()
