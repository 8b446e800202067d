"""The application in a real browser: a drag moves picture and volume, and what one sees is what the session says."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from browser.app_tab import PATIENCE, Tab, eventually
from browser.hosts import resting
from driven_studio import crash
from numpy.typing import NDArray
from running_app import RunningApp

from deformnb.app.application import Application
from deformnb.datasets import PHANTOMS
from deformnb.document.json_format import from_json
from deformnb.rbf.points import ControlPoints
from deformnb.session.session import Session

pytestmark = pytest.mark.needs_browser


@pytest.fixture
def fresh(app: RunningApp) -> RunningApp:
    """The application as it was at the start."""
    def begin() -> None:
        session = app.application.session
        session.deformation = type(session.deformation)()
        session._history = type(session._history)()
        session.edit_step(0)
        session.set_view("+y")
        session.method = "mip"
        app.application.live.shows = "deformed"
        app.application.act("front")

    app.application.thread.call(begin).result(30)
    return app


@pytest.fixture
def tab(browser: Any, fresh: RunningApp) -> Iterator[Tab]:
    opened = Tab(browser, fresh)
    yield opened
    opened.close()


def _middle(image: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where the cube is in a picture: column and row of its middle, as shares of the height."""
    bright = image > 150
    assert bright.sum() > 200
    rows, columns = np.nonzero(bright)
    return np.array([columns.mean(), rows.mean()]) / image.shape[0]


def _alike(image: NDArray[np.float64], wanted: NDArray[np.float64]) -> None:
    """The same but for shades: Chromium enlarges a canvas that has been read a little differently."""
    change = np.abs(image - wanted)
    assert change.mean() < 0.3
    assert change.max() < np.abs(wanted - np.roll(wanted, 1, axis=1)).max() / 3  # what a pixel to the side would do


def test_a_drag_moves_the_picture_and_the_volume_and_undo_brings_them_back(tab: Tab) -> None:
    tab.add_in_the_middle()
    flat, solid = tab.picture(), tab.volume()
    tab.drag(4, 60, -30)
    tab.says("1 moved")
    deformed = tab.follows(solid)
    for before, after in ((flat, tab.picture()), (solid, deformed)):
        moved = _middle(after) - _middle(before)
        assert moved[0] > 0.03  # to the right
        assert moved[1] < -0.01  # and up
    backward = tab.app.application.session.points.displacement[4]
    np.testing.assert_allclose(backward < 0, [True, False])  # b points down
    tab.page.get_by_role("button", name="Undo: ").click()
    tab.says("0 moved")
    _alike(tab.picture(), flat)
    assert np.abs(_middle(tab.volume()) - _middle(solid)).max() < 0.002
    tab.page.get_by_role("button", name="Redo: ").click()
    tab.says("1 moved")
    assert _middle(tab.volume())[0] - _middle(solid)[0] > 0.03


def test_the_volume_follows_while_the_mouse_is_down(tab: Tab) -> None:
    tab.add_in_the_middle()
    before = tab.volume()
    x, y = tab.point(4)
    tab.page.mouse.move(x, y)
    tab.page.mouse.down()
    tab.page.mouse.move(x + 60, y, steps=5)
    eventually(lambda: _middle(tab.volume())[0] - _middle(before)[0] > 0.03)
    assert not tab.app.application.session.points.displacement.any()  # Python has not heard of it
    tab.page.mouse.up()
    tab.says("1 moved")


def test_keys_of_the_editor_undo_what_the_session_did(tab: Tab) -> None:
    tab.add_in_the_middle()
    tab.drag(4, 40, 0)
    tab.says("1 moved")
    tab.page.locator(".dnb-ed-stage").focus()
    tab.page.keyboard.press("Control+z")
    tab.says("0 moved")
    tab.page.keyboard.press("Control+y")
    tab.says("1 moved")


def test_undo_is_heard_wherever_the_focus_is_but_where_text_is_written(tab: Tab) -> None:
    tab.add_in_the_middle()
    tab.drag(4, 40, 0)
    tab.says("1 moved")
    tab.page.get_by_role("tab", name="Points").click()
    tab.page.keyboard.press("Control+z")
    tab.says("0 moved")
    tab.page.keyboard.press("Control+Shift+z")
    tab.says("1 moved")
    tab.page.locator(".dnb-pt-place").fill("3, 4")
    tab.page.keyboard.press("Control+z")  # of what was written
    tab.page.get_by_role("tab", name="Diagnostics").click()
    tab.page.keyboard.press("Control+z")
    tab.says("0 moved")
    tab.page.keyboard.press("Control+y")
    tab.says("1 moved")


def test_a_page_that_is_loaded_again_shows_the_same(tab: Tab) -> None:
    tab.add_in_the_middle()
    tab.drag(4, 60, 0)
    tab.says("1 moved")
    tab.page.get_by_label("Grid", exact=True).uncheck()
    flat, solid = tab.picture(), tab.volume()
    assert tab.app.server.token not in tab.page.url  # out of sight of a classroom
    tab.page.reload()
    tab.drawn()
    tab.says("1 moved")
    assert tab.page.locator(".dnb-ed-target").count() == 5
    _alike(tab.picture(), flat)
    assert np.abs(_middle(tab.volume()) - _middle(solid)).max() < 0.002


def test_without_the_password_the_page_stays_empty(browser: Any, fresh: RunningApp) -> None:
    for query in ("", "?secret=wslink-secret", "?secret=x&sessionURL=ws://evil.example/ws"):
        context = browser.new_context()
        page = context.new_page()
        page.goto(f"http://{fresh.name}/index.html{query}")
        page.get_by_text("There is no session for this page").wait_for(timeout=PATIENCE)
        assert page.locator(".dnb-editor, .dnb-app-panel").count() == 0
        context.close()


def test_two_tabs_show_one_session(browser: Any, tab: Tab) -> None:
    other = Tab(browser, tab.app)
    tab.add_in_the_middle()
    tab.drag(4, 60, 0)
    other.says("5 points, 1 moved")
    assert np.abs(_middle(tab.volume()) - _middle(other.volume())).max() < 0.002
    other.page.get_by_role("button", name="Undo: ").click()
    tab.says("0 moved")
    assert tab.page.locator(".dnb-ed-target").count() == 5
    other.close()


def test_strength_goes_beyond_and_back_by_the_keyboard(tab: Tab) -> None:
    tab.add_in_the_middle()
    tab.drag(4, 40, 0)
    tab.says("1 moved")
    once = _middle(tab.volume())[0]
    thumb = tab.page.get_by_role("slider", name="Strength")
    thumb.focus()
    thumb.press("Home")
    tab.says("−1.00" if tab.page.locator("text=−1.00").count() else "-1.00", ".dnb-app-panel")
    tab.app.settled()
    tab.page.wait_for_function("document.querySelector('.dnb-editor').deformnb.model.get('settings').strength === -1")
    eventually(lambda: once - _middle(tab.volume())[0] > 0.03)
    assert tab.app.application.session.step.strength == -1.0


def test_one_drag_of_a_slider_is_one_edit_however_slow_it_is(tab: Tab, monkeypatch: pytest.MonkeyPatch) -> None:
    now = 1e6
    monkeypatch.setattr("deformnb.session.history.time", SimpleNamespace(monotonic=lambda: now, time=time.time))
    thumb = tab.page.get_by_role("slider", name="Strength")
    mouse, session = tab.page.mouse, tab.app.application.session
    for toward in (-20, 25):
        thumb.scroll_into_view_if_needed()
        box = resting(thumb)
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        mouse.move(x, y)
        mouse.down()
        before = session.step.strength
        for share in (0.5, 1.0):
            mouse.move(x + share * toward, y)
            eventually(lambda: session.step.strength != before)  # noqa: B023
            before = session.step.strength
            now += 2.0  # longer than what joins edits by itself
        mouse.up()
    undone = []
    for _ in range(2):
        undone.append(session.history["undo"])
        tab.page.get_by_role("button", name="Undo: change strength").click()
        eventually(lambda: session.step.strength != before)  # noqa: B023
        before = session.step.strength
    assert (before, session.history["undo"]) == (1.0, "")


def test_a_menu_changes_the_kernel(tab: Tab) -> None:
    tab.page.get_by_role("combobox", name="Kernel").focus()
    tab.page.keyboard.press("Enter")
    tab.page.get_by_role("option", name="Thin-plate spline").click()
    settings = "document.querySelector('.dnb-editor').deformnb.model.get('settings')"
    tab.page.wait_for_function(f"{settings}.kernel === 'thin_plate'", timeout=PATIENCE)
    assert tab.app.application.session.step.kernel == "thin_plate"
    tab.page.get_by_role("button", name="Undo: change kernel").click()
    tab.page.wait_for_function("document.querySelector('.dnb-app-panel').innerText.includes('Wendland C2')")


def test_another_side_shows_another_picture(tab: Tab) -> None:
    before = tab.page.evaluate("document.querySelector('.dnb-editor').deformnb.model.get('raster').shape")
    tab.page.get_by_role("combobox", name="Side").focus()
    tab.page.keyboard.press("Enter")
    tab.page.get_by_role("option", name="from above").click()
    tab.page.wait_for_function("""(before) => {
        const { painter, model } = document.querySelector('.dnb-editor').deformnb;
        return model.get('raster').shape[0] !== before[0] && painter.source?.raster.shape[0] !== before[0]; }""",
                               arg=before, timeout=PATIENCE)
    assert before == [28, 32]
    assert tab.page.evaluate("document.querySelector('.dnb-editor').deformnb.model.get('raster').shape") == [24, 32]


def test_a_formula_that_is_wrong_is_said_and_stays_to_be_corrected(tab: Tab) -> None:
    tab.page.get_by_role("combobox", name="Extrusion").focus()
    tab.page.keyboard.press("Enter")
    tab.page.get_by_role("option", name="Times a curve f(z)").click()
    formula = tab.page.get_by_label("formula of the curve")
    formula.fill("__import__('os')")
    formula.press("Enter")
    tab.says("the curve", ".dnb-app-inline")
    assert formula.input_value() == "__import__('os')"
    assert tab.app.application.session.step.curve == "z"
    formula.fill("sin(pi*z)")
    formula.press("Enter")
    eventually(lambda: tab.app.application.session.step.curve == "sin(pi*z)")
    assert "the curve" not in tab.page.locator(".dnb-curve-editor").inner_text()


def test_the_session_is_saved_as_a_file(tab: Tab) -> None:
    tab.add_in_the_middle()
    with tab.page.expect_download() as waiting:
        tab.page.get_by_role("button", name="Save").click()
    assert waiting.value.suggested_filename == "cube-session.json"
    text = waiting.value.path().read_text(encoding="utf-8")
    assert len(from_json(text).steps[0].points) == 5
    assert json.loads(text)["volume"]["name"] == "cube.nii"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_fits_a_small_projector_in_light_and_dark(browser: Any, fresh: RunningApp, scheme: str) -> None:
    tab = Tab(browser, fresh, scheme=scheme, size=(1280, 800))
    for name, option in (("Projection", "Slice"), ("Extrusion", "Modulate: times a curve f(z)")):  # needs most room
        tab.page.get_by_role("combobox", name=name).focus()
        tab.page.keyboard.press("Enter")
        tab.page.get_by_role("option", name=option).click()
        tab.page.get_by_role("option").first.wait_for(state="hidden")
    tab.page.locator(".dnb-curve-editor .dnb-cv-line").wait_for()
    tab.page.get_by_role("slider", name="Slice").wait_for()
    parts = tab.page.evaluate("""() => [...document.querySelectorAll(
      '.dnb-app-bar, .dnb-app-half, .dnb-app-panel, .dnb-app-foot, .dnb-editor, .dnb-view, .dnb-app-tabs, '
      + '.dnb-app-part > *')].map((part) => { const { left, top, right, bottom } = part.getBoundingClientRect();
        return [part.className, left, top, right, bottom]; })""")
    assert len(parts) > 18
    for name, left, top, right, bottom in parts:
        assert left >= 0 and top >= 0 and right <= 1280 and bottom <= 800, name  # noqa: PT018
    rows = tab.page.evaluate("""() => new Set([...document.querySelectorAll('.dnb-ed-bar button')].filter(
      (button) => button.offsetWidth).map((button) => button.offsetTop)).size""")
    assert rows == 1  # of tools above the picture
    room = tab.page.evaluate("""() => { const [side, projection] = document.querySelectorAll('.dnb-app-select');
      const label = projection.querySelector('.v-field__outline .v-label');
      return label.getBoundingClientRect().top - side.getBoundingClientRect().bottom; }""")
    assert room >= 0  # its line is higher than its letters
    # A list that closes is still in the way for a moment.
    tab.page.wait_for_function("""() => ['.dnb-app-part', '.dnb-app-tabs', '.dnb-app-half', 'html', '.dnb-app-foot'
      ].flatMap((name) => [...document.querySelectorAll(name)].filter((part) =>
      part.scrollHeight > part.clientHeight + 1 || part.scrollWidth > part.clientWidth + 1)).length === 0""")
    back = tab.page.evaluate("getComputedStyle(document.querySelector('.v-application')).backgroundColor")
    shade = np.mean([float(n) for n in back.strip("rgba()").split(",")[:3]])
    assert shade > 200 if scheme == "light" else shade < 60
    editor = tab.page.evaluate("document.querySelector('.dnb-editor').classList.contains('dnb-dark')")
    assert editor is (scheme == "dark")
    tab.page.get_by_role("button", name="Light or dark").click()
    tab.page.wait_for_function(f"""document.querySelector('.dnb-editor').classList.contains('dnb-dark')
                               !== {str(scheme == 'dark').lower()}""")
    tab.close()


def test_everything_is_reached_by_tab(tab: Tab) -> None:
    names = set()
    tab.page.evaluate("document.activeElement.blur()")
    for _ in range(60):
        tab.page.keyboard.press("Tab")
        names.add(tab.page.evaluate("""() => { const at = document.activeElement, of = at.closest('.v-input');
          const label = of?.querySelector('label')?.innerText;
          return at.getAttribute('aria-label') || at.title || label || at.innerText; }"""))
    text = "\n".join(str(name) for name in names)
    for wanted in ("From the picture's side", "Save", "Light or dark", "Add points", "control points", "Side", "Kernel",
                   "Support radius", "Strength", "Extrusion", "Grid"):
        assert wanted in text, wanted


def test_the_session_goes_on_without_a_page(browser: Any, fresh: RunningApp) -> None:
    tab = Tab(browser, fresh)
    tab.close()
    points = fresh.application.session.points
    moved = ControlPoints.from_arrays(points.source, points.source + np.array([3.0, 0.0]))
    fresh.application.thread.call(lambda: fresh.application.session.edit_points(moved)).result(30)
    fresh.application.thread.call(fresh.application._show).result(30)
    tab = Tab(browser, fresh)
    tab.says("4 points")
    assert tab.page.evaluate("document.querySelector('.dnb-editor').deformnb.points[0].target[0]") == pytest.approx(
        float(moved.target[0, 0]))
    tab.close()


def test_what_was_lost_is_offered_and_restored(browser: Any) -> None:
    volume = PHANTOMS["bar"].make((12, 12, 24))
    lost = Application(Session(volume, view="+y"))
    lost.session.edit_points(lost.session.points.add([10.0, 5.0], [12.0, 7.0]))
    wanted = lost.session.points
    crash(lost.recovery.autosave)
    lost.close()
    with RunningApp(Session(volume, view="+y")) as app:
        page = browser.new_page(viewport={"width": 1024, "height": 700})
        page.goto(app.server.url)
        bar = page.locator(".dnb-app-lost")
        bar.wait_for(timeout=60_000)
        assert "was not saved (5 points, 1 step)." in bar.inner_text()
        bar.get_by_role("button", name="Restore").click()
        bar.wait_for(state="detached", timeout=60_000)
        app.settled()
        assert app.application.session.points == wanted
        page.close()
