"""The player in a page, with real keys and a real mouse, and a view that follows it without the kernel."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from browser.live_page import LivePage

from deformnb.document.animation import Animation
from deformnb.document.deformation import Deformation, Keyframe
from deformnb.imaging.projection import project
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.inputs.player import Player
from deformnb.widgets.view.live_view import LiveView

pytestmark = pytest.mark.needs_browser

SIZE = (240, 180)
GRID = Grid((24, 30, 36), (1.5, 1.0, 1.0))
# The core warps voxel by voxel and looks at the result; on a finer grid that is what the card makes at every sample.
FINE = GRID.resampled(spacing=0.75)
PAGE = "document.querySelector('.dnb-player').deformnb"
VIEW = "document.querySelector('.dnb-view').deformnb"


def arm() -> tuple[Volume, Animation]:
    """A bar whose right half turns up by 60 degrees within two seconds."""
    k, j, i = (a / n for a, n in zip(np.indices(GRID.shape), GRID.shape, strict=True))
    inside = 1 - np.maximum(np.abs(i - 0.5) / 0.4, np.maximum(np.abs(k - 0.5) / 0.14, np.abs(j - 0.5) / 0.2))
    volume = Volume(np.clip(100 + 800 * inside, 0, 200).astype(np.uint8), GRID, "bar")
    rest = ControlPoints.from_arrays([[4, 14], [4, 20], [10, 14], [10, 20], [17, 17], [24, 17], [31, 15], [31, 19.0]])
    c, s = np.cos(np.radians(-60)), np.sin(np.radians(-60))
    target = rest.source.copy()
    target[5:] = (target[5:] - (17, 17)) @ np.array([[c, s], [-s, c]]) + (17, 17)
    bent = ControlPoints.from_arrays(rest.source, target)
    steps = [Deformation.from_picture_points(GRID, "+y", p).steps for p in (rest, bent)]
    return volume, Animation(Deformation(steps[1], keyframes=(Keyframe(0.0, steps[0]), Keyframe(2.0, steps[1]))))


def js(page: LivePage, expression: str) -> Any:
    return page.page.evaluate(f"() => {{ const p = {PAGE}; return {expression}; }}")


def open_player(page: LivePage, **traits: Any) -> Player:
    player = Player(**{"duration": 2.0, "marks": [0.0, 0.5, 2.0], **traits})
    page.add(player, "player")
    page.wait("document.querySelector('.dnb-player') && !document.querySelector('.dnb-player').deformnb.frame")
    return player


def settled(page: LivePage) -> None:
    page.frames()
    page.wait(f"!{PAGE}.frame")


def read_out(page: LivePage) -> str:
    return str(page.page.locator(".dnb-pl-time").inner_text())


def test_it_plays_to_the_end_and_python_hears_of_it(page: LivePage) -> None:
    player = open_player(page, duration=0.6, marks=[0.0, 0.6], sync_ms=100.0)
    heard: list[float] = []
    player.observe(lambda change: heard.append(change["new"]), "time")
    page.page.get_by_role("button", name="Play (Space)").click()
    page.wait(f"{PAGE}.clock.isPlaying || {PAGE}.clock.time > 0", passing=True)
    page.wait(f"!{PAGE}.clock.isPlaying")
    settled(page)
    assert (player.time, player.is_playing) == (0.6, False)  # exactly where it rests
    assert heard == sorted(heard)
    assert 1 <= len(heard) <= 9  # a few times a second, and not at every picture; a busy machine draws few
    assert read_out(page) == "0.60 / 0.60 s"
    assert page.errors == []


def test_keys_and_buttons_go_through_the_moments(page: LivePage) -> None:
    player = open_player(page, step=0.1)
    page.page.locator(".dnb-pl-track").focus()
    for keys, wanted in (
        (["ArrowRight"], 0.1),
        (["ArrowRight", "ArrowUp"], 0.3),
        (["Shift+ArrowRight"], 1.3),
        (["ArrowLeft"], 1.2),
        (["End"], 2.0),
        (["PageUp"], 0.5),
        (["PageUp"], 0.0),
        (["PageDown", "PageDown"], 2.0),
        (["Home", "ArrowLeft"], 0.0),
    ):
        for key in keys:
            page.page.keyboard.press(key)
        settled(page)
        assert player.time == pytest.approx(wanted), keys
    player.speed = 0.05  # or a busy machine would pass the next key frame
    settled(page)
    page.page.keyboard.press(" ")
    page.wait(f"{PAGE}.clock.isPlaying", passing=True)
    page.page.keyboard.press(" ")
    page.wait(f"!{PAGE}.clock.isPlaying")
    settled(page)
    assert not player.is_playing
    assert player.time == pytest.approx(js(page, "p.clock.time"))
    page.page.get_by_role("button", name="Next key frame (Page down)").click()
    settled(page)
    assert player.time == 0.5
    track = page.page.get_by_role("slider")
    assert track.get_attribute("aria-valuetext") == "0.50 of 2.00 seconds"
    assert page.page.locator(".dnb-pl-here").count() == 1
    assert page.errors == []


def test_the_bar_is_scrubbed_and_holds_on_to_key_frames(page: LivePage) -> None:
    player = open_player(page)
    box = page.page.locator(".dnb-pl-rail").bounding_box()
    y = box["y"] + box["height"] / 2
    page.page.mouse.move(box["x"] + 0.5 * box["width"], y)
    page.page.mouse.down()
    page.page.mouse.move(box["x"] + 0.75 * box["width"], y, steps=8)
    page.page.mouse.up()
    settled(page)
    assert player.time == pytest.approx(1.5, abs=0.02)
    page.page.mouse.click(box["x"] + 0.25 * box["width"] + 4, y)
    settled(page)
    assert player.time == 0.5
    assert page.errors == []


def test_speed_and_loop_are_chosen_and_python_can_do_all_of_it(page: LivePage) -> None:
    player = open_player(page)
    page.page.get_by_label("Speed").select_option("2")
    page.page.get_by_label("What comes after the end").select_option("swing")
    settled(page)
    assert (player.speed, player.loop) == (2.0, "swing")
    player.time = 1.25
    settled(page)
    assert read_out(page) == "1.25 / 2.00 s"
    player.speed, player.loop, player.duration = 0.7, "loop", 1.0
    settled(page)
    assert page.page.get_by_label("Speed").input_value() == "0.7"
    assert read_out(page) == "1.00 / 1.00 s"
    player.is_playing = True
    page.wait(f"{PAGE}.clock.isPlaying", passing=True)
    player.is_playing = False
    page.wait(f"!{PAGE}.clock.isPlaying")
    assert page.errors == []


def test_two_views_of_a_player_show_one_clock(page: LivePage) -> None:
    player = open_player(page)
    page.draw("player")
    page.page.locator(".dnb-pl-track").nth(1).focus()
    page.page.keyboard.press("End")
    settled(page)
    assert page.page.locator(".dnb-pl-time").all_inner_texts() == ["2.00 / 2.00 s"] * 2
    assert player.time == 2.0
    page.page.evaluate("() => models.player.cleanups[0]()")
    page.page.keyboard.press("Home")
    settled(page)
    assert player.time == 0.0  # the view that is left tells Python
    page.page.evaluate("() => models.player.cleanups[1]()")
    assert page.page.evaluate("() => globalThis[Symbol.for('deformnb.widgets')].size") == 0
    assert page.errors == []


@pytest.mark.parametrize(("width", "scheme"), [(900, "light"), (330, "dark")])
def test_nothing_is_cut_off(page: LivePage, width: int, scheme: str) -> None:
    page.page.set_viewport_size({"width": width, "height": 400})
    page.page.emulate_media(color_scheme=scheme)
    open_player(page, duration=123.4, marks=[0.0, 123.4])
    settled(page)
    cut = page.page.evaluate("""() => [...document.querySelectorAll('.dnb-player *')].filter((e) =>
        e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).display !== 'inline' && e.clientWidth > 1
        && !(e instanceof SVGElement) && !e.closest('.dnb-pl-rail')).map((e) => e.className)""")
    assert cut == []
    inside = page.page.evaluate("() => document.querySelector('.dnb-pl-choices').getBoundingClientRect().right")
    assert inside <= width


def silhouette(image: np.ndarray) -> np.ndarray:
    return np.asarray(image.max(axis=2) > 64)


def dice(a: np.ndarray, b: np.ndarray) -> float:
    return 2 * float((a & b).sum()) / float(a.sum() + b.sum())


def test_a_view_follows_the_player_and_its_pixels_are_the_cores(page: LivePage) -> None:
    volume, animation = arm()
    player = Player(animation, sync_ms=100.0)
    view = LiveView(volume, transfer="surface", width=SIZE[0], height=SIZE[1], settle_ms=60000, background="dark")
    page.add(view, "view")
    page.add(player, "player")
    page.wait_loaded()
    maps = animation.stack(GRID)
    view.set_camera((0, 1, 0))
    view.play(maps, player, output=FINE)
    page.wait(f"{VIEW}.shownField.times.frames && {VIEW}.shownField.times.bus")
    messages, size = view.stats()["messages"], view.stats()["field_bytes"]
    assert size >= maps.values.shape[0] * 8 * 8 * 8
    seen = []
    for time in (0.0, 0.7, 1.3, 2.0):
        player.time = time
        page.wait(f"{VIEW}.shownField.times.time === {time}")
        live, still = silhouette(page.pixels()), silhouette(view.still(SIZE))
        assert dice(live, still) > 0.96, time
        core = LiveView(volume, transfer="surface", width=SIZE[0], height=SIZE[1], background="dark")
        core.set_camera((0, 1, 0))
        core.show_deformation(animation.field(time, GRID), output=FINE)
        assert dice(live, silhouette(core.still(SIZE))) > 0.955, time  # solved for at this moment
        seen.append(live)
    assert dice(seen[0], seen[3]) < 0.85
    # Played in the page: every picture is another one, and no message and no byte goes either way for the view.
    player.speed = 0.25  # or a busy machine would come to its end
    page.page.locator(".dnb-pl-track").focus()
    page.page.keyboard.press(" ")
    page.wait(f"{PAGE}.clock.time > 0.4", passing=True)
    page.page.keyboard.press(" ")
    settled(page)
    assert view.stats()["messages"] == messages
    assert view.stats()["field_bytes"] == size
    assert 0.4 < player.time < 2.0
    assert dice(silhouette(page.pixels()), silhouette(view.still(SIZE))) > 0.96
    # Whatever else is shown ends it.
    view.show_deformation(None)
    page.wait(f"!{VIEW}.shownField.times.frames && !{VIEW}.field.planar")
    still = page.pixels()
    player.time = 2.0
    page.frames()
    assert (page.pixels() == still).all()
    assert page.errors == []


@pytest.mark.nightly
def test_a_view_that_is_drawn_later_and_a_player_that_is_not_drawn(page: LivePage) -> None:
    volume, animation = arm()
    player = Player(animation)
    view = LiveView(volume, transfer="surface", width=SIZE[0], height=SIZE[1], settle_ms=60000, background="dark")
    view.play(animation.stack(GRID, 7), player)
    player.time = 2.0
    page.add(player, "player", draw=False)
    page.add(view, "view")
    page.wait_loaded()
    page.wait(f"{VIEW}.shownField.times.frames && {VIEW}.shownField.times.player")
    view.set_camera((0, 1, 0))
    assert dice(silhouette(page.pixels()), silhouette(view.still(SIZE))) > 0.95
    end = silhouette(page.pixels())
    player.time = 0.0
    page.wait(f"{VIEW}.shownField.times.time === 0")
    assert dice(silhouette(page.pixels()), end) < 0.85
    assert page.errors == []


def test_what_is_dragged_is_seen_at_once_also_after_playing(page: LivePage) -> None:
    volume, animation = arm()
    step, plane = animation.keyframes[0].steps[0], Plane.from_view(GRID, "+y")
    editor = Editor(project(volume, plane), step.points)
    view = LiveView(volume, transfer="surface", width=SIZE[0], height=SIZE[1], settle_ms=60000, background="dark")
    player = Player(animation)
    page.add(editor, "editor", draw=False)
    page.add(player, "player")
    page.add(view, "view")
    page.wait_loaded()
    view.set_camera((0, 1, 0))
    view.follow(editor, Deformation((step,)).field(GRID))
    page.wait(f"{VIEW}.shownField.link.editor && {VIEW}.field.planar")
    view.play(animation.stack(GRID), player)
    player.time = 2.0
    page.wait(f"{VIEW}.shownField.times.frames && {VIEW}.shownField.times.time === 2")
    bent = silhouette(page.pixels())
    editor.points = step.points.move(5, step.points.target[5] + (0, 4))
    page.wait(f"{VIEW}.shownField.link.count > 0")
    dragged = silhouette(page.pixels())
    assert dice(dragged, bent) < 0.9
    reference = LiveView(volume, transfer="surface", width=SIZE[0], height=SIZE[1], background="dark")
    reference.set_camera((0, 1, 0))
    reference.show_deformation(Deformation((step.with_points(editor.points),)), output=FINE)
    assert dice(dragged, silhouette(reference.still(SIZE))) > 0.93
    player.time = 1.9  # and the player goes on from where it is
    page.wait(f"{VIEW}.shownField.times.time === 1.9")
    assert dice(silhouette(page.pixels()), bent) > 0.95
    assert page.errors == []
