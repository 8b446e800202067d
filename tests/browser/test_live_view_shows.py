"""The live view in a real browser: original and deformed, its cube, its background, and an editor's maps."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from browser.live_page import FOLLOWED, LivePage
from PIL import Image

from deformnb.document.deformation import Deformation, Step
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.camera import SHOWS
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.view.field_sender import ShownField
from deformnb.widgets.view.live_view import LiveView

pytestmark = pytest.mark.needs_browser

GRID = Grid((28, 28, 28))
PLANE = Plane.from_view(GRID, "+y")
VIEW = "document.querySelector('.dnb-view').deformnb"


@pytest.fixture
def page(browser: Any) -> Iterator[LivePage]:
    """A page that must not complain."""
    opened = LivePage(browser)
    yield opened
    assert opened.errors == []
    opened.close()


def block() -> Volume:
    """A block, thin along z, that lies nearer to the side L and the head."""
    k, j, i = np.indices(GRID.shape)
    inside = (abs(k - 17) < 4) & (abs(j - 14) < 6) & (abs(i - 16) < 7)
    return Volume((200 * inside).astype(np.uint8), GRID, "block")


def moved(by: float) -> ControlPoints:
    return ControlPoints.from_arrays([[14.0, 14.0]], [[14.0 + by, 14.0]])


def extrusion(by: float) -> Any:
    return Deformation.from_picture_points(GRID, PLANE, moved(by), trend="translation").field(GRID)


def open_view(page: LivePage, **options: Any) -> LiveView:
    options = {"transfer": "surface", "width": 240, "height": 180, "settle_ms": 60000, "background": "dark", **options}
    view = LiveView(block(), **options)
    view.set_camera((0, 1, 0))
    page.add(view)
    page.wait_loaded()
    return view


def column(image: np.ndarray) -> float:
    """Middle of the bright pixels, in pixels from the left."""
    return float(np.nonzero(image.max(axis=2) > 64)[1].mean())


def test_side_by_side_are_the_pictures_of_both(page: LivePage) -> None:
    view = open_view(page, shows="side_by_side")
    view.show_deformation(extrusion(5.0))
    view.set_camera((0.3, 1, -0.2))
    both = page.pixels().astype(int)
    assert page.page.locator(".dnb-caption:visible").all_text_contents() == ["original", "deformed"]
    view.width = 120
    page.wait(f"{VIEW}.caster.size[0] === 120")
    halves = []
    for shows in ("original", "deformed"):
        view.shows = shows
        halves.append(page.pixels().astype(int))
    # The grain of the background is not the same at another place: one grey level.
    assert np.abs(both[:, :120] - halves[0]).max() <= 2
    assert np.abs(both[:, 120:] - halves[1]).max() <= 2
    assert column(halves[1].astype(np.uint8)) - column(halves[0].astype(np.uint8)) > 8  # to the right, as in the plane
    assert page.page.locator(".dnb-caption:visible").all_text_contents() == []


@pytest.mark.parametrize("x", [60, 190])
def test_the_mouse_turns_both_in_either_half(page: LivePage, x: int) -> None:
    view = open_view(page, shows="side_by_side")
    mouse = page.page.mouse
    mouse.move(x, 90)
    mouse.down()
    mouse.move(x + 20, 90, steps=3)
    mouse.up()
    page.wait("models.view.saved.length > 0")
    # 20 pixels of 120, the smaller side of one picture.
    angle = 2.6 * 20 / 120
    np.testing.assert_allclose(view.camera["direction"], [np.sin(angle), np.cos(angle), 0], atol=0.02)
    image = page.pixels()
    assert np.abs(image[:, :120].astype(int) - image[:, 120:]).max() <= 2  # nothing is deformed: the same twice


def test_the_zoom_stays_when_something_else_is_shown(page: LivePage) -> None:
    view = open_view(page)
    view.set_camera(zoom=2.0)
    for shows in (*SHOWS, "deformed"):
        view.shows = shows
        page.page.evaluate(f"{VIEW}.writeCamera()")
        assert view.camera["zoom"] == pytest.approx(2.0), shows


def caption(page: LivePage) -> str:
    return str(page.page.text_content(".dnb-caption"))


# How often the caption has changed since it was first asked.
CHANGES = """(window.turned ??= (() => { const seen = { count: 0 };
    new MutationObserver(() => { seen.count += 1; }).observe(document.querySelector(".dnb-caption"),
      { childList: true, characterData: true, subtree: true });
    return seen; })()).count"""


def test_a_line_and_an_opacity_lead_from_the_original_to_the_deformed_volume(page: LivePage) -> None:
    view = open_view(page)
    view.show_deformation(extrusion(5.0))
    images = {}
    for shows in ("original", "deformed", "wipe"):
        view.shows = shows
        page.wait(f"{VIEW}.elements.shows === '{shows}'")
        images[shows] = page.pixels()

    def is_cut_at(image: np.ndarray, x: int) -> bool:
        """Check that it is the original up to this column and the deformed volume from there on, but for rounding."""
        parts = ((image[:, :x], images["original"][:, :x]), (image[:, x:], images["deformed"][:, x:]))
        return all(np.abs(part.astype(int) - wanted).max(initial=0) <= 2 for part, wanted in parts)

    assert not is_cut_at(images["original"], 120)  # the two can be told apart
    assert is_cut_at(images["wipe"], 120)
    line = page.page.locator(".dnb-wipe")
    box = line.bounding_box()
    page.page.mouse.move(box["x"] + 11, box["y"] + 40)
    page.page.mouse.down()
    page.page.mouse.move(box["x"] + 11 + 48, box["y"] + 40, steps=3)
    page.page.mouse.up()
    assert line.get_attribute("aria-valuenow") == "70"
    assert is_cut_at(page.pixels(), 168)
    assert view.camera["direction"] == pytest.approx([0, 1, 0])  # it was not turned
    line.press("Shift+ArrowLeft")
    assert line.get_attribute("aria-valuenow") == "60"
    line.press("Home")
    assert is_cut_at(page.pixels(), 0)
    view.shows = "fade"
    line.wait_for(state="hidden")
    slider = page.page.locator(".dnb-fade input")
    for opacity in (0.25, 1.0, 0.0):
        slider.fill(str(opacity))
        mixed = opacity * images["original"].astype(float) + (1 - opacity) * images["deformed"]
        assert np.abs(page.pixels() - mixed).max() <= 3, opacity
    view.shows = "deformed"
    slider.wait_for(state="hidden")


def test_a_button_saves_the_picture_that_is_seen(page: LivePage) -> None:
    open_view(page)
    seen = page.pixels()
    page.page.get_by_role("button", name="Save a picture").click()
    with page.page.expect_download() as download:
        page.page.get_by_role("button", name="Save PNG").click()
    assert download.value.suggested_filename == "Volume_block.png"
    with Image.open(download.value.path()) as saved:
        assert saved.size == (2 * seen.shape[1], 2 * seen.shape[0])
        halved = np.asarray(saved.convert("RGB").reduce(2), float)
    assert np.abs(halved - seen).mean() < 2
    assert page.page.get_by_role("button", name="Full screen").is_visible()


@pytest.mark.nightly
def test_flicker_alternates_at_one_place_and_can_be_stopped(page: LivePage) -> None:
    view = open_view(page)
    view.show_deformation(extrusion(5.0))
    view.shows = "flicker"
    page.wait(f"{CHANGES} > 2")  # by itself
    page.page.focus(".dnb-canvas")
    page.page.keyboard.press(" ")  # stops it
    page.wait(f"{VIEW}.elements.flicker.timer === 0")
    seen = {caption(page): page.pixels()}
    stopped = page.page.evaluate(CHANGES)
    page.page.evaluate(f"{VIEW}.elements.flicker.turn()")
    seen[caption(page)] = page.pixels()
    assert column(seen["deformed"]) - column(seen["original"]) > 8
    assert page.page.evaluate(CHANGES) == stopped + 1  # ours, and none of its own
    page.page.keyboard.press(" ")
    page.wait(f"{CHANGES} > {stopped + 2}")
    view.shows = "original"
    page.wait("document.querySelector('.dnb-caption').textContent === 'original'")
    assert page.page.evaluate(f"{VIEW}.elements.flicker.timer") == 0


def test_flicker_does_not_move_by_itself_where_motion_is_unwelcome(page: LivePage) -> None:
    page.page.emulate_media(reduced_motion="reduce")
    view = open_view(page, shows="flicker")
    view.show_deformation(extrusion(5.0))
    page.flush()
    assert page.page.evaluate(f"{VIEW}.elements.flicker.timer") == 0
    assert caption(page) == "deformed"
    deformed = page.pixels()
    page.page.mouse.click(100, 90)
    page.wait("document.querySelector('.dnb-caption').textContent === 'original'")
    assert column(deformed) - column(page.pixels()) > 8
    page.page.keyboard.press(" ")
    page.wait("document.querySelector('.dnb-caption').textContent === 'deformed'")
    np.testing.assert_array_equal(page.pixels(), deformed)


def test_the_cube_turns_with_the_camera_and_a_face_looks_from_its_side(page: LivePage) -> None:
    view = open_view(page)
    shown = ".dnb-face:visible text"
    assert page.page.locator(shown).all_text_contents() == ["A"]  # looking along +y, from the front
    view.set_camera((-0.5, 0.7, -0.5))  # from the left, the front and above
    page.wait(FOLLOWED)
    assert set(page.page.locator(shown).all_text_contents()) == {"A", "L", "S"}
    box = {name: page.page.locator(f'.dnb-face:has(text:text-is("{name}"))').bounding_box() for name in "ALS"}
    assert box["L"]["x"] > box["A"]["x"]  # the left side is on the viewer's right
    assert box["S"]["y"] < box["A"]["y"]  # the head is up
    page.page.locator('.dnb-face[data-view="-x"] text').click()
    page.wait("models.view.saved.length > 0")
    np.testing.assert_allclose(view.camera["direction"], [-1, 0, 0], atol=1e-6)
    # One face hides the others: arrows lead to its neighbours.
    page.wait(FOLLOWED)
    assert page.page.locator(".dnb-turn:visible").count() == 4
    page.page.locator(".dnb-turn").nth(2).click()  # upwards
    page.wait("models.view.saved.length > 1")
    np.testing.assert_allclose(view.camera["direction"], [0, 0, -1], atol=1e-6)
    page.wait(FOLLOWED)
    assert page.page.text_content(".dnb-right") == "R"


def test_the_keyboard_reaches_all_six_sides_and_keeps_its_keys(page: LivePage) -> None:
    view = open_view(page)
    names = page.page.eval_on_selector_all(".dnb-bar button", "(all) => all.map((b) => b.getAttribute('aria-label'))")
    assert names == [f"view from {side}" for side in ("the front", "behind", "the left", "the right", "above", "below")]
    page.page.focus(".dnb-canvas")
    for _ in range(3):
        page.page.keyboard.press("Tab")
    assert page.page.evaluate("document.activeElement.textContent") == "L"
    assert page.page.locator(".dnb-bar").bounding_box()["width"] > 100  # out of sight until it has the focus
    page.page.keyboard.press("Enter")
    page.wait("models.view.saved.length > 0")
    np.testing.assert_allclose(view.camera["direction"], [-1, 0, 0], atol=1e-6)
    open_to_lab = """() => [...document.querySelectorAll(".dnb-view button, .dnb-view [tabindex]")]
        .filter((e) => !("lmSuppressShortcuts" in e.dataset)).length"""
    assert page.page.evaluate(open_to_lab) == 0


def test_the_background_follows_the_page(page: LivePage) -> None:
    page.page.emulate_media(color_scheme="light")
    view = open_view(page, background="auto")
    assert page.pixels()[3, 3].min() > 180
    page.page.emulate_media(color_scheme="dark")
    page.wait(f"{VIEW}.elements.root.dataset.background === 'dark'")
    assert page.pixels()[3, 3].max() < 60
    page.page.evaluate("""() => { document.body.style.setProperty("--jp-layout-color1", "rgb(250, 250, 250)");
        document.body.dataset.jpThemeLight = "true"; }""")  # as JupyterLab does
    page.wait(f"{VIEW}.elements.root.dataset.background === 'light'")
    view.background = "dark"
    assert page.pixels()[3, 3].max() < 60


@pytest.mark.parametrize("width", [360, 1280])
def test_nothing_is_cut_off_beside_another_widget(browser: Any, width: int) -> None:
    page = LivePage(browser, (width, 900))
    page.page.add_style_tag(content="#root { display: flex; } #root > .other { flex: 1 1 40%; min-width: 0; }")
    page.page.evaluate("""() => { const other = document.createElement("div"); other.className = "other";
        document.getElementById("root").append(other); }""")
    open_view(page, width=1000, height=700)
    page.wait(f"{VIEW}.caster.size[0] < 1000")
    box = page.page.locator(".dnb-view").bounding_box()
    assert box["x"] + box["width"] <= width
    assert box["width"] > 0.5 * width
    assert box["width"] / box["height"] == pytest.approx(1000 / 700, rel=0.01)
    assert page.page.evaluate("document.documentElement.scrollWidth") == width
    for part in (".dnb-cube", ".dnb-home", ".dnb-right"):
        inner = page.page.locator(part).first.bounding_box()
        assert inner["x"] + inner["width"] <= box["x"] + box["width"], part
    page.close()


LINK = f"{VIEW}.shownField.link"


def followed(page: LivePage) -> tuple[LiveView, Editor]:
    view = open_view(page)
    editor = Editor(None, moved(0.0), trend="translation")
    page.add(editor, "editor", draw=False)
    view.follow(editor, extrusion(0.0))
    page.wait(f"{LINK}.editor")
    return view, editor


def test_an_old_field_does_not_replace_what_the_editor_has_gone_on_to_show(page: LivePage) -> None:
    view, editor = followed(page)
    start = column(page.pixels())
    editor.points = moved(3.0)
    stale = extrusion(3.0)
    field_of_old_points = {"index": 0, "points": editor.get_state("points")["points"]}
    editor.points = moved(6.0)  # the page shows these before Python's field of the ones before arrives
    page.wait(f"{LINK}.count > 1")
    moved_on = column(page.pixels())
    assert moved_on - start > 25
    view.fields.replace(ShownField(stale, followed=field_of_old_points))
    view.fields.offer()
    page.flush()
    assert column(page.pixels()) == pytest.approx(moved_on, abs=0.3)
    count = page.page.evaluate(f"{LINK}.count")
    view.follow(editor, extrusion(6.0))  # of the points that are there: shown as it is, nothing is fitted
    page.wait(f"{LINK}.expected")
    page.flush()
    assert page.page.evaluate(f"{LINK}.count") == count
    assert column(page.pixels()) == pytest.approx(moved_on, abs=0.3)


def test_what_python_shows_is_seen_until_the_editor_moves(page: LivePage) -> None:
    view, editor = followed(page)
    start = column(page.pixels())
    view.show_deformation(extrusion(6.0))  # a slider, say
    page.wait(f"{LINK}.expected === null")
    assert column(page.pixels()) - start > 9
    editor.points = moved(2.0)
    page.wait(f"{LINK}.count > 0")
    assert 9 < column(page.pixels()) - start < 16  # some 6 pixels for each length


def test_another_map_is_followed_without_a_wrong_picture_in_between(page: LivePage) -> None:
    view, editor = followed(page)
    both = Deformation(
        (Step((moved(0.0), moved(6.0)), PLANE, extrusion="interpolate", knots=(0.0, 1.0), trend="translation"),)
    ).field(GRID)
    view.show_deformation(both)
    page.wait(f"{LINK}.expected === null")  # it comes when the one before is on the screen
    expected = page.pixels().astype(int)
    count = page.page.evaluate(f"{LINK}.count")
    view.follow(editor, both, 1)  # the editor still holds the points of map 0
    assert np.abs(page.pixels().astype(int) - expected).max() <= 2
    editor.points = moved(6.0)
    page.wait(f"{LINK}.count > {count}")
    assert np.abs(page.pixels().astype(int) - expected).mean() < 0.3


def test_following_again_and_another_volume_keep_the_connection(page: LivePage) -> None:
    view, editor = followed(page)
    page.page.evaluate(f"() => {{ window.listened = 0; window.kept = {LINK}.bus; }}")
    page.page.evaluate("""() => { const on = models.editor.on;
        models.editor.on = (...all) => { window.listened += 1; return on(...all); }; }""")
    for by in (1.0, 2.0):
        view.follow(editor, extrusion(by))
    view.show(block())
    page.wait_loaded()
    view.follow(editor, extrusion(0.0))
    page.page.evaluate("() => { models.view.fromPython('editor', models.view.get('editor')); }")  # said once more
    page.flush()
    assert page.page.evaluate(f"window.kept === {LINK}.bus && {LINK}.editor !== null")
    assert page.page.evaluate("window.listened") == 0
    start = column(page.pixels())
    editor.points = moved(6.0)
    page.wait(f"{LINK}.count > 0")
    assert column(page.pixels()) - start > 9


def test_a_quick_picture_ends_where_another_volume_is_on_its_way(page: LivePage) -> None:
    open_view(page)
    # The next piece of a picture begins when the GPU has ended one: by then the voxels may be those of no volume yet.
    found = page.page.evaluate(f"""() => {{
      const {{ loop, caster }} = {VIEW}, {{ volume }} = caster.voxels, cast = caster.cast;
      let casts = 0;
      caster.cast = () => {{ casts += 1; }};
      const pieces = [{{ picture: loop.screen.choosePictures([24, 24])[0], tile: [0, 0, 24, 8] }}];
      loop.rush = {{ pieces, size: [24, 24], inputs: [], coarseness: 2, layers: [], start: 0, spent: 0, inFlight: 1 }};
      volume.loaded = false;
      const isWhole = loop.finishPiece(loop.rush, 5), isOver = loop.rush === null;
      volume.loaded = true;
      caster.cast = cast;
      return [isWhole, isOver, casts];
    }}""")
    assert found == [False, True, 0]


def test_fields_come_no_faster_than_the_page_draws_them(page: LivePage) -> None:
    view = open_view(page)
    view.fields.pacer.patience = 60.0
    for k in range(12):
        view.show_deformation(extrusion(0.5 * k))
    assert len(page.outbox) <= 1
    page.wait("models.view.sent.filter((m) => m.type === 'seen').length === 2")
    seqs = page.page.evaluate("models.view.sent.filter((m) => m.type === 'seen').map((m) => m.seq)")
    assert seqs == [1, 2]  # the first and the last
    assert not view.fields.pacer.is_waiting
