"""The application in a real browser: a drag moves picture and volume, and what one sees is what the session says.

Panels and controls are those of the studio, whose own tests look at them; here it is that they work without a kernel.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser.app_tab import PATIENCE, Tab, app_of_a_cube, wait_until
from browser.hosts import box_at_rest
from browser.studio_layout import GROUPS, choose, lasting_faults, tab_titles
from numpy.typing import NDArray
from running_app import RunningApp
from studio_driver import crash, walk

from deformnb.app.application import Application
from deformnb.datasets import PHANTOMS
from deformnb.document.json_format import from_json
from deformnb.io import read_volume
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Polygon
from deformnb.rbf.rigid import RigidPart
from deformnb.widgets.boxes import Fold, Tabs

pytestmark = pytest.mark.needs_browser


@pytest.fixture
def fresh(app: RunningApp) -> RunningApp:
    """The application as it was at the start."""

    def begin() -> None:
        session = app.session
        session.editing.deformation = type(session.editing.deformation)()
        session.editing.past = type(session.editing.past)()
        session.editing.edit_step(0)
        session.set_view("+y")
        session.pictures.method = "mip"
        app.studio.view.shows = "deformed"
        app.studio.editor.show_grid = True
        app.studio.view.set_camera(session.editing.plane.normal, -np.asarray(session.editing.plane.v))

    app.application.thread.call(begin).result(30)
    app.wait_idle()
    return app


@pytest.fixture
def tab(browser: Any, fresh: RunningApp) -> Iterator[Tab]:
    opened = Tab(browser, fresh)
    yield opened
    opened.close()


RAMP = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 16 16 16\nencoding: raw\n"
DROP = """([name, text]) => {
  const stage = document.querySelector('.dnb-ed-stage'), dataTransfer = new DataTransfer();
  dataTransfer.items.add(new File([text], name));
  for (const type of ['dragenter', 'dragover', 'drop']) {
    stage.dispatchEvent(new DragEvent(type, { bubbles: true, cancelable: true, dataTransfer }));
  }
}"""


def _middle(image: NDArray[np.float64]) -> NDArray[np.float64]:
    """Place of the cube in a picture: column and row of its middle, as shares of the height."""
    bright = image > 150
    assert bright.sum() > 200
    rows, columns = np.nonzero(bright)
    return np.array([columns.mean(), rows.mean()]) / image.shape[0]


def _assert_similar(image: NDArray[np.float64], wanted: NDArray[np.float64]) -> None:
    """The same but for shades: Chromium enlarges a canvas that has been read a little differently."""
    change = np.abs(image - wanted)
    assert change.mean() < 0.3
    assert change.max() < np.abs(wanted - np.roll(wanted, 1, axis=1)).max() / 3  # what a pixel to the side would do


def test_a_drag_moves_the_picture_and_the_volume_and_undo_brings_them_back(tab: Tab) -> None:
    tab.add_in_the_middle()
    flat, solid = tab.picture(), tab.volume()
    tab.drag(4, 60, -30)
    tab.wait_for_points(5, 1)
    deformed = tab.wait_deformed(solid)
    for before, after in ((flat, tab.picture()), (solid, deformed)):
        moved = _middle(after) - _middle(before)
        assert moved[0] > 0.03  # to the right
        assert moved[1] < -0.01  # and up
    backward = tab.app.session.editing.points.displacement[4]
    np.testing.assert_allclose(backward < 0, [True, False])  # b points down
    tab.page.locator(".dnb-head").get_by_role("button", name="Undo: ").click()
    tab.wait_for_points(5, 0)
    _assert_similar(tab.picture(), flat)
    assert np.abs(_middle(tab.volume()) - _middle(solid)).max() < 0.002
    tab.page.locator(".dnb-head").get_by_role("button", name="Redo: ").click()
    tab.wait_for_points(5, 1)
    assert _middle(tab.volume())[0] - _middle(solid)[0] > 0.03


def test_the_volume_follows_while_the_mouse_is_down_and_a_page_that_goes_leaves_nothing(tab: Tab) -> None:
    tab.add_in_the_middle()
    before = tab.volume()
    x, y = tab.point(4)
    tab.page.mouse.move(x, y)
    tab.page.mouse.down()
    tab.page.mouse.move(x + 60, y, steps=5)
    wait_until(lambda: _middle(tab.volume())[0] - _middle(before)[0] > 0.03)
    assert not tab.app.session.editing.points.displacement.any()  # Python has not heard of it
    tab.page.reload()
    tab.wait_drawn()
    tab.wait_for_points(5, 0)
    assert np.abs(_middle(tab.volume()) - _middle(before)).max() < 0.002


def test_a_rigid_part_is_dragged_and_the_volume_and_its_numbers_follow(tab: Tab) -> None:
    session = tab.app.session
    low, high = session.editing.points.source.min(axis=0), session.editing.points.source.max(axis=0)
    middle, reach = (low + high) / 2, (high - low) / 4
    corners = middle + reach * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    tab.app.application.thread.call(
        lambda: session.editing.edit_parts([RigidPart(Polygon(corners), name="cube")])
    ).result(30)
    tab.app.wait_idle()
    before = tab.volume()
    tab.page.locator(".dnb-ed-shape-inside").wait_for(state="attached")
    k = tab.page.evaluate("() => document.querySelector('.dnb-editor').deformnb.parts.viewport.view.k")
    corner = tab.page.evaluate("""() => { const page = document.querySelector('.dnb-editor').deformnb.parts;
        const box = page.stage.element.getBoundingClientRect(), { region } = page.points.shapes.parts[0];
        const [a, b] = page.viewport.toView(region.vertices[0]);
        return [box.left + a, box.top + b]; }""")
    x, y = np.array(corner) + 0.3 * k * reach
    tab.page.mouse.click(x, y)
    tab.page.mouse.move(x, y)
    tab.page.mouse.down()
    tab.page.mouse.move(x + 60, y, steps=5)
    wait_until(lambda: _middle(tab.volume())[0] - _middle(before)[0] > 0.03)
    assert session.editing.step.parts[0].motion is None  # Python has not heard of it
    tab.page.mouse.up()
    wait_until(lambda: session.editing.step.parts[0].motion is not None)
    np.testing.assert_allclose(session.editing.step.parts[0].motion.shift, (60 / k, 0), atol=1e-6)
    choose(tab.page, "Rigid parts and cuts")
    tab.page.get_by_text(f"shifted {60 / k:.1f}, 0.0").wait_for(state="attached")  # a narrow panel has no room for it


def test_undo_is_heard_wherever_the_focus_is_but_where_text_is_written(tab: Tab) -> None:
    tab.add_in_the_middle()
    tab.drag(4, 40, 0)
    tab.wait_for_points(5, 1)
    tab.page.keyboard.press("Control+z")  # in the editor
    tab.wait_for_points(5, 0)
    choose(tab.page, "Depth")
    tab.page.keyboard.press("Control+Shift+z")
    tab.wait_for_points(5, 1)
    choose(tab.page, "Points")
    tab.page.locator(".dnb-pt-place").fill("3, 4")
    tab.page.keyboard.press("Control+z")  # of what was written
    choose(tab.page, "Check")
    tab.page.keyboard.press("Control+z")
    tab.wait_for_points(5, 0)
    tab.page.keyboard.press("Control+y")
    tab.wait_for_points(5, 1)


def test_a_page_that_is_loaded_again_shows_the_same(tab: Tab) -> None:
    tab.add_in_the_middle()
    tab.drag(4, 60, 0)
    tab.wait_for_points(5, 1)
    flat, solid = tab.picture(), tab.volume()
    assert tab.app.server.token not in tab.page.url  # out of sight of a classroom
    tab.page.reload()
    tab.wait_drawn()
    tab.wait_for_points(5, 1)
    _assert_similar(tab.picture(), flat)
    assert np.abs(_middle(tab.volume()) - _middle(solid)).max() < 0.002


def test_without_the_password_the_page_stays_empty(browser: Any, fresh: RunningApp) -> None:
    for query in ("", "?secret=wslink-secret", "?secret=x&sessionURL=ws://evil.example/ws"):
        context = browser.new_context()
        page = context.new_page()
        page.goto(f"http://{fresh.name}/index.html{query}")
        page.get_by_text("There is no session for this page").wait_for(timeout=PATIENCE)
        assert page.locator(".dnb-editor, .dnb-studio-panel").count() == 0
        context.close()


def test_two_tabs_show_one_session(browser: Any, tab: Tab) -> None:
    other = Tab(browser, tab.app)
    tab.add_in_the_middle()
    tab.drag(4, 60, 0)
    other.wait_for_points(5, 1)
    other.wait_deformed(np.zeros_like(other.volume()) + 255)
    other.page.locator(".dnb-head").get_by_role("button", name="Undo: ").click()
    tab.wait_for_points(5, 0)
    choose(other.page, "Interpolation")
    other.page.get_by_label("Kernel", exact=True).select_option("Gaussian")
    choose(tab.page, "Interpolation")
    tab.page.wait_for_function("""() => [...document.querySelectorAll('.dnb-studio-panel select')].some(
      (menu) => menu.selectedOptions[0]?.text === 'Gaussian')""")
    assert tab.app.session.editing.step.kernel == "gaussian"
    other.close()


def test_the_keyboard_moves_a_slider(tab: Tab) -> None:
    tab.add_in_the_middle()
    tab.drag(4, 40, 0)
    tab.wait_for_points(5, 1)
    once = _middle(tab.volume())[0]
    thumb = tab.page.locator(".widget-slider:has(> label:text-is('Strength')) .noUi-handle")
    thumb.focus()
    for _ in range(10):
        thumb.press("ArrowLeft")
    wait_until(lambda: tab.app.session.editing.step.strength < 0.95)
    wait_until(lambda: once - _middle(tab.volume())[0] > 0.001)


def test_another_side_shows_another_picture(tab: Tab) -> None:
    before = tab.page.evaluate("document.querySelector('.dnb-editor').deformnb.model.get('raster').shape")
    tab.page.locator(".dnb-pane-head").get_by_label("Side").select_option("from above (-z)")
    tab.page.wait_for_function(
        """(before) => {
        const { picture: { painter }, model } = document.querySelector('.dnb-editor').deformnb.parts;
        return model.get('raster').shape[0] !== before[0] && painter.source?.raster.shape[0] !== before[0]; }""",
        arg=before,
        timeout=PATIENCE,
    )
    assert before == [28, 32]
    assert tab.page.evaluate("document.querySelector('.dnb-editor').deformnb.model.get('raster').shape") == [24, 32]


def test_files_are_saved_downloaded_and_opened(browser: Any, tmp_path: Path) -> None:
    with RunningApp(app_of_a_cube(tmp_path)) as app:
        tab = Tab(browser, app)
        tab.add_in_the_middle()
        tab.drag(4, 40, 0)
        tab.wait_for_points(5, 1)
        before = app.session.editing.points
        tab.page.keyboard.press("Control+s")
        saved = tmp_path / "cube_nii.json"
        wait_until(saved.exists)
        assert from_json(saved.read_text(encoding="utf-8")).steps[0].points == before
        assert json.loads(saved.read_text(encoding="utf-8"))["volume"]["name"] == "cube.nii"
        tab.page.get_by_role("button", name="Export").click()
        with tab.page.expect_download(timeout=PATIENCE) as waiting:
            tab.page.get_by_role("button", name="Download").click()
        waiting.value.save_as(tmp_path / "result.nii.gz")
        np.testing.assert_array_equal(
            read_volume(tmp_path / "result.nii.gz").values, app.session.results.volume().values
        )
        tab.page.locator(".dnb-ed-stage").focus()
        tab.page.keyboard.press("Control+z")
        tab.wait_for_points(5, 0)
        with tab.page.expect_file_chooser() as choosing:
            tab.page.get_by_role("button", name="Open", exact=True).click()
        choosing.value.set_files(saved)
        tab.wait_for_points(5, 1)
        assert app.session.editing.points == before
        tab.page.evaluate(DROP, ["mark.fcsv", "# CoordinateSystem = LPS\n1,10,9,12,0,0,0,1,1,1,0,nose,,\n"])
        tab.wait_for_points(6, 1)
        assert app.session.editing.points.names[-1] == "nose"
        tab.page.evaluate(DROP, ["scan.zip", "PK"])
        tab.page.get_by_text("scan.zip is no file that can be opened here").wait_for()
        first = app.session
        tab.page.evaluate(DROP, ["ramp.nrrd", f"{RAMP}\n{''.join(chr(1 + k % 120) for k in range(16**3))}"])
        tab.page.get_by_text("Open ramp.nrrd in place of cube.nii?").wait_for()
        tab.page.locator(".dnb-studio-messages").get_by_role("button", name="Open", exact=True).click()
        wait_until(lambda: app.session is not first)
        tab.page.wait_for_function("document.title === 'ramp - deformnb'", timeout=PATIENCE)
        tab.wait_drawn()
        tab.wait_for_points(4, 0)
        tab.page.get_by_role("button", name="History").click()
        tab.page.get_by_role("button", name="Back to cube.nii").click()
        tab.wait_drawn()
        tab.wait_for_points(6, 1)
        assert app.session is first
        tab.close()
        assert tab.errors == []


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("width", "scheme"), [(1280, "dark"), (1280, "light"), (390, "light")])
def test_it_fits_its_window_in_light_and_dark(browser: Any, fresh: RunningApp, width: int, scheme: str) -> None:
    tab = Tab(browser, fresh, scheme=scheme, size=(width, 800))
    page = tab.page
    assert tab_titles(page) == list(GROUPS)
    assert lasting_faults(page, ".dnb-it-scroller, .dnb-pt-scroller") == []
    box = page.locator(".dnb-studio").bounding_box()
    assert (box["x"], box["y"], box["width"]) == (0, 0, width)
    assert box["height"] == 800 or width < 820  # there the panel stands below, and the page scrolls
    seen = page.evaluate("() => document.documentElement.scrollWidth")
    assert seen == width
    shade = np.mean(_channels(page, ".dnb-studio-panel"))
    assert shade > 200 if scheme == "light" else shade < 60
    page.get_by_role("button", name="Light or dark").click()
    wait_until(lambda: (np.mean(_channels(page, ".dnb-studio-panel")) < 60) == (scheme == "light"))
    tab.close()


def _channels(page: Any, part: str) -> list[float]:
    colour = page.locator(part).evaluate("(e) => getComputedStyle(e).backgroundColor")
    return [float(n) for n in colour.strip("rgba()").split(",")[:3]]


_OPERATED = {
    "button",
    "checkbox",
    "combobox",
    "img",
    "image",
    "link",
    "listbox",
    "menuitem",
    "radio",
    "searchbox",
    "slider",
    "spinbutton",
    "switch",
    "tab",
    "textbox",
}


def test_everything_is_reached_by_tab_and_has_a_name(tab: Tab) -> None:
    names = set()
    tab.page.evaluate("document.activeElement.blur()")
    for _ in range(110):
        tab.page.keyboard.press("Tab")
        names.add(
            tab.page.evaluate("""() => { const at = document.activeElement;
          const label = at.labels?.[0]?.innerText || at.closest('.jupyter-widgets')?.querySelector('label')?.innerText;
          return at.getAttribute('aria-label') || label || at.title || at.innerText; }""")
        )
    text = "\n".join(str(name) for name in names)
    for wanted in (
        "Save",
        "History",
        "Export",
        "Light or dark",
        "Add points",
        "control points",
        "Side",
        "Kernel",
        "Strength",
    ):
        assert wanted in text, wanted
    reader = tab.page.context.new_cdp_session(tab.page)
    for title in ("Shape", "Depth", "View", "Animate", "Check"):
        tab.page.get_by_role("tab", name=title, exact=True).click()
        tab.page.wait_for_function("document.querySelectorAll('.noUi-handle:not([aria-label])').length === 0")
        nodes = [node for node in reader.send("Accessibility.getFullAXTree")["nodes"] if not node["ignored"]]
        names = [(node["role"]["value"], node.get("name", {}).get("value", "").strip()) for node in nodes]
        operated = [(role, name) for role, name in names if role in _OPERATED]
        assert len(operated) > 40, title
        assert not [role for role, name in operated if not name], title


def test_keys_fold_a_section(tab: Tab) -> None:
    tab.page.get_by_role("tab", name="Shape", exact=True).click()
    heading = tab.page.get_by_role("button", name="Points", exact=True)
    was_open = heading.get_attribute("aria-expanded") == "true"  # a section stays as a test before has left it
    for key, opens in (("Enter", not was_open), (" ", was_open)):
        heading.press(key)
        tab.page.wait_for_function(
            "([heading, wanted]) => heading.ariaExpanded === wanted", arg=[heading.element_handle(), str(opens).lower()]
        )
        tab.page.locator(".dnb-pt-bar").wait_for(state="visible" if opens else "hidden")


def test_the_session_goes_on_without_a_page(browser: Any, fresh: RunningApp) -> None:
    tab = Tab(browser, fresh)
    tab.close()
    points = fresh.session.editing.points
    moved = ControlPoints.from_arrays(points.source, points.source + np.array([3.0, 0.0]))
    fresh.application.thread.call(lambda: fresh.session.editing.edit_points(moved)).result(30)
    tab = Tab(browser, fresh)
    tab.wait_for_points(4, 4)
    assert tab.page.evaluate(
        "document.querySelector('.dnb-editor').deformnb.parts.points.list[0].target[0]"
    ) == pytest.approx(float(moved.target[0, 0]))
    tab.close()


def test_what_was_lost_is_offered_and_restored(browser: Any, tmp_path: Path) -> None:
    volume = PHANTOMS["bar"].make((12, 12, 24))
    lost = Application(volume, side="+y", folder=tmp_path)
    lost.session.editing.edit_points(lost.session.editing.points.add([10.0, 5.0], [12.0, 7.0]))
    wanted = lost.session.editing.points
    crash(lost.studio.parts.bar.recovery.autosave)
    lost.close()
    with RunningApp(Application(volume, side="+y", folder=tmp_path)) as app:
        page = browser.new_page(viewport={"width": 1024, "height": 700})
        page.goto(app.server.url)
        page.get_by_text("was not saved (5 points, 1 step).").wait_for(timeout=PATIENCE)
        page.get_by_role("button", name="Restore").click()
        wait_until(lambda: app.session.editing.points == wanted)
        page.close()


@pytest.mark.nightly
@pytest.mark.needs_gl
def test_vtk_draws_the_volume_if_asked(browser: Any, tmp_path: Path) -> None:
    with RunningApp(app_of_a_cube(tmp_path, viewer="vtk")) as app:
        tab = Tab(browser, app, viewer="vtk")
        tab.page.wait_for_function("document.querySelector('.dnb-view')?.deformnb?.isFull", timeout=2 * PATIENCE)

        def view_pixels() -> NDArray[np.float64]:
            return tab.image("() => document.querySelector('.dnb-view canvas').toDataURL().split(',')[1]")

        before = _middle(view_pixels())
        tab.add_in_the_middle()
        tab.drag(4, 60, 0)
        tab.wait_for_points(5, 1)
        wait_until(lambda: _middle(view_pixels())[0] - before[0] > 0.03)
        tab.close()


def test_one_pane_takes_the_place_of_both_and_gives_it_back(tab: Tab) -> None:
    picture, volume = (tab.page.locator(f".dnb-pane-{name}") for name in ("picture", "volume"))
    whole, before = tab.page.locator(".dnb-studio-panes").bounding_box(), volume.bounding_box()
    tab.page.get_by_role("button", name="Only the volume").click()
    picture.wait_for(state="hidden")
    alone = volume.bounding_box()
    foot = float(tab.page.locator(".dnb-studio-panes").evaluate("(e) => parseFloat(getComputedStyle(e).paddingBottom)"))
    assert alone["height"] == whole["height"] - foot
    assert alone["width"] * alone["height"] > 1.5 * before["width"] * before["height"]
    wait_until(lambda: tab.size[0] >= alone["width"] - 2)  # the canvas goes with it
    volume.locator(".dnb-pane-head").dblclick(position={"x": alone["width"] - 120, "y": 14})
    picture.wait_for(state="visible")
    assert volume.bounding_box() == before
    picture.locator(".dnb-pane-alone[aria-pressed]").press("Enter")
    volume.wait_for(state="hidden")
    assert picture.locator(".dnb-pane-alone[aria-pressed]").get_attribute("aria-pressed") == "true"


def test_the_panel_has_the_width_the_tab_and_the_sections_in_which_it_was_left(tab: Tab) -> None:
    page, tabs = tab.page, next(box for box in walk(tab.app.studio) if isinstance(box, Tabs))
    sections = {box.title: box for box in walk(tabs) if isinstance(box, Fold)}
    splitter = page.get_by_role("separator", name="Width of the panel")
    splitter.press("ArrowLeft")
    assert splitter.get_attribute("aria-valuenow") == "320"
    assert page.locator(".dnb-studio-panel").bounding_box()["width"] == pytest.approx(320, abs=1)
    choose(page, "Points")
    choose(page, "Depth")
    page.wait_for_function(
        """() => { const kept = decodeURIComponent(document.cookie);
      return kept.includes('"tab":"Depth"') && kept.includes('"Points":true'); }""",
        timeout=PATIENCE,
    )
    page.goto("about:blank")

    def reset_tabs() -> None:  # as those of a new studio are
        tabs.choose(0)
        sections["Points"].choose(None)

    tab.app.application.thread.call(reset_tabs).result(30)
    page.goto(tab.app.server.url)
    page.get_by_role("tab", name="Depth", selected=True).wait_for(timeout=PATIENCE)
    wait_until(lambda: tabs.selected == 1 and sections["Points"].is_open)
    assert sections["Steps"].is_open
    assert splitter.get_attribute("aria-valuenow") == "320"


def test_tabs_and_sections_are_used_by_keys_and_say_that_python_is_busy(browser: Any, tmp_path: Path) -> None:
    with RunningApp(app_of_a_cube(tmp_path)) as app:
        page = Tab(browser, app).page
        page.get_by_role("tab", name="Shape").focus()
        page.keyboard.press("ArrowLeft")  # from the first to the last
        page.get_by_role("tab", name="Check", selected=True).wait_for()
        assert page.evaluate("document.activeElement.textContent") == "Check"
        page.get_by_role("tabpanel", name="Check").get_by_text("Round trip").first.wait_for(timeout=PATIENCE)
        page.keyboard.press("Home")
        release = threading.Event()
        busy = app.application.thread.call(lambda: release.wait(60))
        section = page.get_by_role("button", name="Points", exact=True)
        section.press("Enter")
        page.get_by_role("button", name="Points", exact=True, expanded=True).wait_for()  # while Python answers nothing
        assert not release.is_set()
        page.get_by_role("status").get_by_text("Waiting for Python").filter(visible=True).wait_for(timeout=PATIENCE)
        release.set()
        assert busy.result(60)
        page.locator(".dnb-pt-scroller").wait_for(timeout=PATIENCE)
        page.get_by_text("Waiting for Python").filter(visible=True).first.wait_for(state="hidden", timeout=PATIENCE)
        section.press(" ")
        page.locator(".dnb-pt-scroller").wait_for(state="hidden")


@pytest.mark.nightly
@pytest.mark.parametrize("width", [1280, 860, 620, 390])
def test_the_status_line_has_room_for_its_advice_and_moves_nothing(browser: Any, fresh: RunningApp, width: int) -> None:
    tab = Tab(browser, fresh, size=(width, 760))
    page, seen = tab.page, set()

    def add(what: str, region: dict[str, Any]) -> None:
        page.evaluate(
            """([what, region]) =>
            document.querySelector('.dnb-editor').deformnb.parts.tools.shapes.add(what, region)""",
            [what, region],
        )

    add("parts", {"kind": "polygon", "vertices": [[22, 20], [26, 20], [26, 24]]})
    page.locator(".dnb-studio-start > *").first.wait_for(state="hidden")  # the examples go with the first edit
    stage = box_at_rest(page.locator(".dnb-ed-stage").first)

    def look() -> None:
        page.evaluate("() => document.querySelector('.dnb-editor').deformnb.frames.drawNow()")
        notes = page.locator(".dnb-ed-status > .dnb-messages").first
        seen.add(notes.inner_text())
        assert notes.evaluate("(e) => e.scrollHeight <= e.clientHeight + 1"), notes.inner_text()
        assert page.locator(".dnb-ed-stage").first.bounding_box() == stage

    try:
        look()
        for command in ("add", "select", "move", "grow", "wand", "part", "cut", "fixed"):
            page.evaluate("(c) => document.querySelector('.dnb-editor').deformnb.commands.run(c, null)", command)
            look()
        page.keyboard.press("Escape")
        for what, region in (
            ("parts", {"kind": "polygon", "vertices": [[10, 8], [18, 8], [18, 16]]}),
            ("parts", {"kind": "half_space", "point": [4, 4], "normal": [0, -1]}),
            ("cuts", {"kind": "line", "vertices": [[6, 0], [6, 30]]}),
        ):
            add(what, region)
            look()
        assert len(seen) >= 9
        assert tab.errors == []
    finally:
        tab.close()
