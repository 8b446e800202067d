"""The page about Thompson's grids on a phone and on a screen, by fingers and by a mouse, without a network."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser.test_editor_touch import Fingers
from browser.test_standalone_page import EDITOR, Opened
from browser.test_touch_drags import drag_quickly
from browser.visible_words import COLLECT, foreign_words, visible_texts
from PIL import Image

from deformnb.datasets import thompson_grid, thompson_map, thompson_pairs, thompson_score
from deformnb.imaging.projection import project
from deformnb.io import read_deformation, read_volume
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.warping.points import warp_points
from deformnb.widgets.file_pages import write_thompson_page
from deformnb.words import word_table

pytestmark = pytest.mark.needs_browser

PAGE = "document.body.deformnb"
FIRST = ("Polyprion", "Antigonia capros")
PHONE = {"size": (390, 844), "has_touch": True, "is_mobile": True}
SCREEN: dict[str, Any] = {"size": (1280, 800)}
VIEW = "document.querySelector('.dnb-view').deformnb"
ROWS = ("on the upper side", "in the middle", "on the lower side")
COLUMNS = ("of the head", "of the body", "of the tail")
SMALLEST = 44  # CSS pixels of what a finger presses


class ThompsonPage(Opened):
    """The page, with the steps that a user takes."""

    def __init__(self, browser: Any, path: Path, *, size: tuple[int, int], init: str = "", **options: Any) -> None:
        super().__init__(browser, path, size, init, accept_downloads=True, **options)
        self.is_phone = "has_touch" in options
        self.fingers = Fingers(self.page) if self.is_phone else None
        self.wait_step("morph")

    def wait_step(self, step: str) -> None:
        self.wait(f"document.body.dataset.shown === '{step}'")
        if step in ("morph", "drag", "growth"):
            self.wait_settled()

    def press(self, selector: str) -> None:
        place = self.page.locator(selector).filter(visible=True).first
        (place.tap if self.is_phone else place.click)()

    def go(self, step: str) -> None:
        self.press(f".dnb-th-tab[data-step={step}]")
        self.wait_step(step)

    def choose(self, pair: tuple[str, str]) -> None:
        self.page.locator("select[name=pair]").select_option(label=" → ".join(pair))
        self.wait(f"{PAGE}.drawing.pair.second.name === '{pair[1]}'")
        self.wait_step(self.js(f"{PAGE}.state.step"))

    def places(self) -> list[tuple[list[float], list[float]]]:
        """Of each point that is dragged, its place and that of its goal, on the screen."""
        found = self.js(f"""(() => {{
            const parts = {EDITOR}, {{ pair }} = {PAGE}.drawing;
            const box = document.querySelector('.dnb-ed-stage').getBoundingClientRect();
            const on = ([a, b]) => {{
              const [x, y] = parts.viewport.toView([a, b]);
              return [x + box.left, y + box.top];
            }};
            const goals = pair.target.flat(), sources = pair.source.flat();
            return parts.points.list.map((p) => {{
              const k = sources.findIndex((s) => s[0] === p.source[0] && s[1] === p.source[1]);
              return [on(p.target), on(goals[k])];
            }});
        }})()""")
        return [(a, b) for a, b in found]

    def drag_point(self, number: int) -> None:
        """Drag a point to its goal, as fast as a hand does."""
        (x, y), (p, q) = self.places()[number]
        if self.fingers:
            drag_quickly(self.fingers, (x, y), (p - x, q - y), 0.24)
        else:
            self.page.mouse.move(x, y)
            self.page.mouse.down()
            self.page.mouse.move(p, q, steps=8)
            self.page.mouse.up()
        self.wait_settled()

    def score(self) -> int:
        return int(self.page.locator(".dnb-th-report").inner_text().split(" %")[0])


@pytest.fixture
def thompson(browser: Any, tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[ThompsonPage]:
    options = getattr(request, "param", PHONE)
    path = tmp_path / "thompson.html"
    write_thompson_page(path)
    page = ThompsonPage(browser, path, **options)
    yield page
    page.context.close()
    assert page.errors == []
    assert [url for url in page.requests if not url.startswith(("blob:", "data:", "file:"))] == []


def placed(pair: tuple[str, str]) -> Any:
    """A pair on the first drawing, in pixels of its scan."""
    nodes = thompson_grid(pair[0]).nodes.reshape(-1, 2)
    (a0, b0), (a1, b1) = nodes.min(axis=0), nodes.max(axis=0)
    return thompson_map(*pair, box=(a0, a1, b0, b1), scale="area")


def test_the_slider_takes_each_node_of_the_first_grid_exactly_to_the_second(thompson: ThompsonPage) -> None:
    assert thompson.js(f"{PAGE}.state.share") == 0
    thompson.press(".dnb-th-play")
    thompson.wait(f"{PAGE}.state.share === 1", timeout=60)
    thompson.wait_settled()
    for pair in thompson_pairs():
        thompson.choose(pair)
        thompson.js(
            "{ const s = document.querySelector('input[name=share]'); s.value = 1; "
            "s.dispatchEvent(new Event('input')); }"
        )
        thompson.wait_settled()
        pair_on_page = f"{PAGE}.drawing.pair"
        source, target = (np.array(thompson.js(f"{pair_on_page}.{name}.flat()")) for name in ("source", "target"))
        moved = np.array(thompson.js(f"{PAGE}.drawing.page.displacements({pair_on_page}.target.flat())"))
        np.testing.assert_allclose(target + moved, source, atol=1e-6)
        grids = placed(pair)
        np.testing.assert_allclose(target - source, (grids.target_nodes - grids.source_nodes).reshape(-1, 2), atol=1e-6)


@pytest.mark.parametrize("thompson", [PHONE, SCREEN], ids=["phone", "screen"], indirect=True)
def test_twelve_drags_draw_the_animal_and_the_score_is_that_of_the_package(thompson: ThompsonPage) -> None:
    thompson.go("drag")
    assert thompson.score() == 0
    scrolled, scores = thompson.js("scrollY"), [0]
    for number in range(12):
        thompson.drag_point(number)
        scores.append(thompson.score())
    assert scores == sorted(scores)
    assert scores[-1] > 95
    assert thompson.js("scrollY") == scrolled
    text = thompson.page.locator(".dnb-th-report").inner_text()
    assert "You have drawn this animal" in text
    # All crossings, by the package: the same points, fitted by the same spline.
    reached = np.array(thompson.js(f"{PAGE}.drawing.page.points.map((p) => p.target)"))
    sources = np.array(thompson.js(f"{PAGE}.drawing.page.points.map((p) => p.source)"))
    fit = fit_rbf(ControlPoints.from_arrays(sources, reached), kernel="thin_plate", trend="affine")
    nodes = np.array(thompson.js(f"{PAGE}.drawing.pair.source"))
    moved, found = warp_points(nodes, fit)
    grids = placed(FIRST)
    shift = nodes[0, 0] - grids.source_nodes[0, 0]
    wanted = thompson_score(np.where(found[..., None], moved, nodes) - shift, grids).percent
    assert abs(int(text.split("your points: ")[1].split(" %")[0]) - wanted) <= 1
    thompson.press(".dnb-th-buttons button:has-text('Undo')")
    thompson.wait(f"document.querySelector('.dnb-th-score').value === {scores[-2]}")


def test_the_worst_node_is_marked_on_both_drawings(thompson: ThompsonPage) -> None:
    thompson.go("drag")
    gaps = [np.hypot(a[0] - b[0], a[1] - b[1]) for a, b in thompson.places()]
    worst = int(np.argmax(gaps)) + 1
    assert f"Point {worst} is farthest" in thompson.page.locator(".dnb-th-report").inner_text()
    assert thompson.page.locator(".dnb-th-worst text").all_text_contents() == [str(worst)]
    assert thompson.js(f"{PAGE}.drawing.page.editor.get('marked')") == [worst - 1]


def test_what_was_done_survives_a_reload_and_start_again_forgets_it(thompson: ThompsonPage) -> None:
    thompson.go("drag")
    thompson.drag_point(0)
    score = thompson.score()
    assert score > 0
    thompson.page.reload()
    thompson.wait_step("drag")
    assert thompson.score() == score
    thompson.press(".dnb-th-buttons button:has-text('Start again')")
    thompson.wait_step("morph")
    thompson.go("drag")
    assert thompson.score() == 0


def test_a_copy_has_the_work_in_it_and_is_a_page_of_its_own(
    browser: Any, thompson: ThompsonPage, tmp_path: Path
) -> None:
    thompson.go("drag")
    thompson.drag_point(5)
    thompson.js("{ delete Navigator.prototype.canShare; }")
    with thompson.page.expect_download() as download:
        thompson.press(".dnb-th-buttons button:has-text('Share as a file')")
    path = tmp_path / "copy.html"
    download.value.save_as(path)
    copy = Opened(browser, path, (390, 844), "")
    copy.wait("document.body.dataset.shown === 'drag'")
    assert copy.js(f"{PAGE}.state.dragged") == thompson.js(f"{PAGE}.state.dragged")
    copy.wait("document.querySelector('.dnb-th-report').textContent.length > 10")
    assert copy.page.locator(".dnb-th-report").inner_text() == thompson.page.locator(".dnb-th-report").inner_text()
    assert copy.errors == []
    copy.context.close()


def test_a_finger_turns_the_carp_that_the_grid_has_bent(thompson: ThompsonPage) -> None:
    thompson.press(".dnb-th-play")
    thompson.wait(f"{PAGE}.state.share === 1", timeout=60)
    thompson.go("carp")
    thompson.wait("document.querySelector('.dnb-view')?.deformnb.caster?.isReady", timeout=60)
    thompson.wait(f"{VIEW}.field")
    before = thompson.js(f"{PAGE}.carp.page.view.get('camera').direction")
    box = thompson.page.locator(".dnb-th .dnb-canvas").bounding_box()
    assert thompson.fingers
    drag_quickly(thompson.fingers, (box["x"] + 120, box["y"] + 160), (70, 60))
    thompson.wait(f"String({PAGE}.carp.page.view.get('camera').direction) !== '{','.join(map(str, before))}'")
    assert thompson.js("scrollY") == 0
    points = thompson.js(f"{PAGE}.carp.page.points")
    assert len(points) == thompson_grid("Polyprion").nodes[..., 0].size
    assert thompson.js(f"{PAGE}.carp.page.editor.get('settings').strength") == 1


@pytest.mark.parametrize("thompson", [PHONE, SCREEN], ids=["phone", "screen"], indirect=True)
def test_the_slider_is_below_the_carp_that_has_the_whole_screen(thompson: ThompsonPage) -> None:
    thompson.go("carp")
    thompson.wait("document.querySelector('.dnb-view')?.deformnb.caster?.isReady", timeout=60)
    thompson.press(".dnb-full")
    thompson.wait("document.fullscreenElement?.contains(document.querySelector('input[name=share]'))")
    slider = thompson.page.locator("input[name=share]")
    box, height = slider.bounding_box(), thompson.js("innerHeight")
    assert box["height"] >= SMALLEST
    assert box["y"] + box["height"] <= height
    thompson.js("document.querySelector('.dnb-th .dnb-canvas').focus()")
    for _ in range(20):
        if thompson.js("document.activeElement.name === 'share'"):
            break
        thompson.page.keyboard.press("Tab")
    thompson.page.keyboard.press("End")
    assert thompson.js(f"[{PAGE}.state.share, {PAGE}.carp.page.editor.get('settings').strength]") == [1, 1]
    thompson.page.evaluate("() => document.exitFullscreen()")
    thompson.wait("document.querySelector('.dnb-th-slider').nextElementSibling?.matches('.dnb-th-goal')")


def test_the_slider_is_there_again_after_own_pictures(thompson: ThompsonPage) -> None:
    thompson.go("own")
    assert thompson.page.locator(".dnb-th-slider").filter(visible=True).count() == 0
    for step in ("morph", "carp"):
        thompson.go(step)
        thompson.page.locator(".dnb-th-slider").wait_for(state="visible")
        thompson.go("own")
    thompson.press(".dnb-th-buttons button:has-text('Start again')")
    thompson.wait_step("morph")
    thompson.page.locator(".dnb-th-slider").wait_for(state="visible")


def test_each_scan_is_decoded_once_and_each_sheet_written_once(browser: Any, tmp_path: Path) -> None:
    path = tmp_path / "thompson.html"
    write_thompson_page(path)
    count = """window.counts = { decoded: 0, written: 0 };
      const decode = createImageBitmap, { prototype } = HTMLCanvasElement, write = prototype.toBlob;
      window.createImageBitmap = (...given) => { counts.decoded += 1; return decode(...given); };
      prototype.toBlob = function (...given) { counts.written += 1; return write.apply(this, given); };"""
    page = ThompsonPage(browser, path, init=count, **PHONE)
    # Two scans, and the sheet of the first drawing by its editor.
    assert page.js("counts") == {"decoded": 3, "written": 2}
    page.go("drag")
    page.go("morph")
    assert page.js("counts") == {"decoded": 5, "written": 2}
    page.choose(("Diodon", "Orthagoriscus"))  # on one scan
    assert page.js("counts") == {"decoded": 7, "written": 4}
    page.choose(("Polyprion", "Scorpaena"))  # on scans that were there
    assert page.js("counts") == {"decoded": 8, "written": 6}
    page.context.close()
    assert page.errors == []


def test_the_sentence_about_growth_is_true_of_each_pair(thompson: ThompsonPage) -> None:
    thompson.go("growth")
    for pair in thompson_pairs():
        thompson.choose(pair)
        words = thompson.page.locator(".dnb-th-report").inner_text()
        grids = placed(pair)
        areas = []
        for nodes in (grids.source_nodes, grids.target_nodes):
            p, q, r, s = nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, 1:], nodes[1:, :-1]
            areas.append(abs((r - p)[..., 0] * (s - q)[..., 1] - (r - p)[..., 1] * (s - q)[..., 0]) / 2)
        rows, columns = areas[0].shape
        i = (3 * (np.arange(rows) + 0.5) / rows).astype(int)
        j = (3 * (np.arange(columns) + 0.5) / columns).astype(int)
        whole = areas[1].sum() / areas[0].sum()
        times = np.array(
            [
                [areas[1][i == a][:, j == b].sum() / areas[0][i == a][:, j == b].sum() / whole for b in range(3)]
                for a in range(3)
            ]
        )
        for value, kind in ((times.max(), "most"), (times.min(), "least")):
            a, b = np.argwhere(times == value)[0]
            assert f"grown {kind} {ROWS[a]} {COLUMNS[b]}: {value:.1f} times" in words


@pytest.mark.parametrize("thompson", [PHONE, SCREEN], ids=["phone", "screen"], indirect=True)
def test_a_grid_on_a_photograph_maps_it_and_the_session_replays_on_the_file(
    thompson: ThompsonPage, tmp_path: Path
) -> None:
    pixels = np.full((900, 1400, 3), 250, np.uint8)
    pixels[200:700, 300:1100] = (90, 140, 60)  # a leaf of one colour
    Image.fromarray(pixels).save(tmp_path / "leaf.png")
    thompson.go("own")
    own = thompson.page.locator(".dnb-grid-own")
    own.nth(0).locator("input[type=file]").set_input_files(tmp_path / "leaf.png")
    thompson.wait("document.querySelectorAll('.dnb-gd-svg').length === 1")
    thompson.press(".dnb-grid-own:nth-child(2) button:has-text('Use Antigonia')")
    thompson.wait("document.querySelectorAll('.dnb-gd-svg').length === 2")
    thompson.wait("document.querySelectorAll('.dnb-grid-own:nth-child(1) .dnb-cv-node').length === 56")
    thompson.press("button:has-text('Show the map')")
    thompson.wait_settled()
    result = f"{PAGE}.own.result"
    thompson.wait(f"{result}.page")
    source, target = (np.array(thompson.js(f"{result}.pair.{name}.flat()")) for name in ("source", "target"))
    moved = np.array(thompson.js(f"{result}.page.displacements({result}.pair.target.flat())"))
    np.testing.assert_allclose(target + moved, source, atol=1e-6)
    with thompson.page.expect_download() as download:
        thompson.press("button:has-text('Download session')")
    download.value.save_as(tmp_path / "leaf.json")
    step = read_deformation(tmp_path / "leaf.json").steps[0]
    picture = project(read_volume(tmp_path / "leaf.png"), step.plane)
    nodes = step.points.source
    a0, a1, b0, b1 = picture.raster.box
    assert a0 < 300 - 30 < nodes[:, 0].min() < 310
    assert 1090 < nodes[:, 0].max() < 1130 < a1
    assert b0 < 180 < nodes[:, 1].min() < 210
    assert 690 < nodes[:, 1].max() < 720 < b1
    with thompson.page.expect_download() as download:
        thompson.press("button:has-text('Download picture')")
    assert download.value.suggested_filename == "leaf deformed.png"
    thompson.page.reload()
    thompson.wait_step("own")
    thompson.wait("document.querySelectorAll('.dnb-gd-svg').length === 2")


def test_a_grid_that_folds_is_named_and_makes_no_map(thompson: ThompsonPage) -> None:
    thompson.go("own")
    for number, name in ((1, "Polyprion"), (2, "Antigonia")):
        thompson.press(f".dnb-grid-own:nth-child({number}) button:has-text('Use {name}')")
        thompson.wait(f"document.querySelectorAll('.dnb-gd-svg').length === {number}")
    show = thompson.page.locator("button:has-text('Show the map')")
    thompson.wait("!document.querySelector('.dnb-grid-pair-foot .dnb-th-next').disabled")
    assert thompson.fingers
    corner, last = (thompson.page.locator(".dnb-grid-own:nth-child(1) .dnb-cv-node").nth(n) for n in (0, 55))
    last.scroll_into_view_if_needed()
    (x, y), (p, q) = (
        (b["x"] + b["width"] / 2, b["y"] + b["height"] / 2) for b in (corner.bounding_box(), last.bounding_box())
    )
    drag_quickly(thompson.fingers, (x, y), (0.9 * (p - x), 0.9 * (q - y)), 0.4)
    thompson.wait("document.querySelector('.dnb-th-report').textContent.startsWith('The grid on Polyprion folds')")
    assert show.is_disabled()
    thompson.press(".dnb-grid-own:nth-child(1) button:has-text('Undo')")
    thompson.wait("!document.querySelector('.dnb-grid-pair-foot .dnb-th-next').disabled")


@pytest.mark.parametrize("thompson", [PHONE, SCREEN], ids=["phone", "screen"], indirect=True)
def test_no_press_beside_a_point_adds_one_or_moves_the_drawing(thompson: ThompsonPage) -> None:
    thompson.go("drag")
    view = thompson.js(f"({{...{EDITOR}.viewport.view}})")
    box = thompson.page.locator(".dnb-ed-stage").bounding_box()
    x, y = box["x"] + 0.35 * box["width"], box["y"] + 0.6 * box["height"]
    if thompson.fingers:
        for _ in range(2):
            thompson.fingers.tap((x, y))
        thompson.fingers.swipe((x, y), (0, -120))
        thompson.wait("scrollY > 40")
    else:
        thompson.page.mouse.dblclick(x, y)
        thompson.page.mouse.wheel(0, 200)
    thompson.page.locator(".dnb-ed-target").first.focus()
    for key in ("Delete", "a", "Insert", "l"):
        thompson.page.keyboard.press(key)
    thompson.wait_settled()
    assert len(thompson.js(f"{EDITOR}.points.list")) == 12
    assert thompson.js(f"({{...{EDITOR}.viewport.view}})") == view
    thompson.page.keyboard.press("ArrowUp")
    thompson.wait(f"{EDITOR}.points.list[0].target[1] < {EDITOR}.points.list[0].source[1]")


def test_a_file_that_is_no_picture_is_refused_and_nothing_is_lost(thompson: ThompsonPage, tmp_path: Path) -> None:
    (tmp_path / "notes.png").write_bytes(b"no picture")
    thompson.go("own")
    thompson.page.locator(".dnb-grid-own").nth(0).locator("input[type=file]").set_input_files(tmp_path / "notes.png")
    thompson.wait("!document.querySelector('.dnb-page-alert').hidden")
    assert "notes" in thompson.page.locator(".dnb-page-alert").inner_text()
    assert thompson.js(f"{PAGE}.state.own") == [None, None]
    box = thompson.page.locator(".dnb-page-alert").bounding_box()
    assert 0 <= box["y"] < box["y"] + box["height"] <= 844  # it is seen, wherever the page is scrolled to


@pytest.mark.parametrize("step", ["morph", "drag", "carp", "growth", "own"])
def test_what_a_finger_presses_is_large_enough(thompson: ThompsonPage, step: str) -> None:
    thompson.go(step)
    buttons = ".dnb-page-header button, .dnb-th > * button, .dnb-th select, .dnb-th input[type=range]"
    small = thompson.js(f"""[...document.querySelectorAll('{buttons}')]
      .filter((e) => e.offsetParent && !e.closest('.dnb-view'))
      .map((e) => [e.textContent || e.name, e.getBoundingClientRect()])
      .filter(([, box]) => box.height < {SMALLEST} || box.width < {SMALLEST}).map(([name]) => name)""")
    assert small == []


def test_all_is_there_in_german(browser: Any, tmp_path: Path) -> None:
    path = tmp_path / "thompson.html"
    write_thompson_page(path, language="de")
    page = ThompsonPage(browser, path, init=f"({COLLECT})()", **PHONE)
    assert page.page.title() == "Wie aus einem Fisch ein anderer wird"
    for step in ("drag", "growth", "own", "carp", "morph"):
        page.go(step)
    page.page.wait_for_timeout(100)  # until the last frame has been recorded
    assert foreign_words(visible_texts(page.page), word_table("de"), ["olfersii", "Mola mola", "EN", "English"]) == []
    with page.page.expect_event("load"):
        page.press(".dnb-th-language")
    page.wait("document.title === 'How one fish becomes another'")
    page.wait_step("morph")
    assert page.js("document.documentElement.lang") == "en"
    page.context.close()
    assert page.errors == []


def test_without_a_place_to_store_anything_all_steps_work(browser: Any, tmp_path: Path) -> None:
    path = tmp_path / "thompson.html"
    write_thompson_page(path)
    init = "Object.defineProperty(window, 'localStorage', { get() { throw new DOMException('no', 'SecurityError'); } })"
    page = ThompsonPage(browser, path, init=init, **PHONE)
    for step in ("drag", "carp", "growth", "own", "morph"):
        page.go(step)
    assert json.dumps(page.js(f"{PAGE}.state")).count("morph") == 1
    assert page.page.locator(".dnb-page-alert").is_hidden()
    page.context.close()
    assert page.errors == []
