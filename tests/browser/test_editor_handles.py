"""Drawing of the points of the editor: their arrows, their radii, and their colours in colour blindness."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from browser.editor_page import PAGE, EditorOnPage
from numpy.typing import NDArray
from PIL import Image

from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Picture
from deformnb.widgets.editor.editor import Editor

pytestmark = pytest.mark.needs_browser

EYES = ("none", "protanopia", "deuteranopia", "tritanopia", "achromatopsia")


def numbers(page: EditorOnPage, element: str) -> NDArray[np.float64]:
    """The places in a path of the first arrow."""
    text = page.js(f"document.querySelector('.dnb-ed-arrows {element}').getAttribute('d')")
    return np.array(
        [float(word) for word in text.replace("M", " ").replace("L", " ").replace("Z", " ").split()]
    ).reshape(-1, 2)


def to_stage(page: EditorOnPage, place: Any) -> NDArray[np.float64]:
    return np.array(page.js(f"{PAGE}.viewport.toView([{place[0]}, {place[1]}])"))


# ---- the arrow ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("to", [(100, 25), (40, 25), (70, 60), (95, -5)])
def test_an_arrow_leads_from_where_a_feature_was_to_where_it_shall_be(
    open_editor: Any, picture: Picture, to: Any
) -> None:
    page = open_editor(Editor(picture, ControlPoints.from_arrays([[70.0, 25]], [to])))
    source, target = to_stage(page, (70, 25)), to_stage(page, to)
    length = np.hypot(*(target - source))
    along = (target - source) / length
    line, head = numbers(page, ".dnb-ed-arrow"), numbers(page, ".dnb-ed-arrow-head")
    assert line[0] == pytest.approx(source + 5 * along, abs=0.02)  # from the rim of the ring
    assert line[1] == pytest.approx(target - 15 * along, abs=0.02)  # to the foot of the head
    assert head[0] == pytest.approx(target - 7.5 * along, abs=0.02)  # whose tip is at the rim of the disc
    assert (head[1] + head[2]) / 2 == pytest.approx(target - 16 * along, abs=0.02)
    assert np.hypot(*(head[1] - head[2])) == pytest.approx(9, abs=0.02)
    assert np.array_equal(numbers(page, ".dnb-ed-arrow-case"), line)


def test_an_arrow_follows_the_hand_and_goes_where_there_is_no_room(open_editor: Any, picture: Picture) -> None:
    page = open_editor(Editor(picture, ControlPoints.from_arrays([[70.0, 25]])))
    shown = "document.querySelector('.dnb-ed-arrows > g').getAttribute('visibility')"
    ring = "document.querySelector('.dnb-ed-source').getAttribute('visibility')"
    assert page.js(f"[{shown}, {ring}]") == ["hidden", "hidden"]
    x, y = page.to_screen((70, 25))
    page.page.mouse.move(x, y)
    page.page.mouse.down()
    page.page.mouse.move(x + 9, y, steps=3)
    page.wait(f"{ring} === 'visible'")
    assert page.js(shown) == "hidden"  # ring and disc touch
    page.page.mouse.move(x + 16, y, steps=2)
    page.wait(f"{shown} === 'visible'")
    page.wait("document.querySelector('.dnb-ed-arrow-head').getAttribute('d') === ''")  # no room for a head
    page.page.mouse.move(x + 60, y + 25, steps=3)
    page.wait("document.querySelector('.dnb-ed-arrow-head').getAttribute('d') !== ''")
    at = to_stage(page, (70, 25)) + np.array([60, 25])
    page.wait(f"!{PAGE}.frames.request")
    assert numbers(page, ".dnb-ed-arrow-head")[0] == pytest.approx(at - 7.5 * np.array([60, 25]) / 65, abs=0.05)
    page.page.mouse.up()


# ---- how far points reach -------------------------------------------------------------------------------------------


def circles(page: EditorOnPage) -> list[tuple[float, float, float]]:
    return [
        tuple(c)
        for c in page.js("""[...document.querySelectorAll(".dnb-ed-radius")]
        .filter((c) => c.getAttribute("visibility") === "visible")
        .map((c) => ["cx", "cy", "r"].map((name) => Number(c.getAttribute(name))))""")
    ]


def test_the_circle_is_where_a_point_ceases_to_move_anything(open_editor: Any, picture: Picture) -> None:
    editor = Editor(
        picture, ControlPoints.from_arrays([[70.0, 25]], [[74.0, 27]]), support=30.0, trend="none", show_radius=True
    )
    page, at = open_editor(editor), np.array([74.0, 27])
    ((cx, cy, r),) = circles(page)
    assert (cx, cy) == pytest.approx(to_stage(page, at), abs=0.06)
    assert r == pytest.approx(30 * page.js(f"{PAGE}.viewport.view.k"), abs=0.06)
    rim = at + 30 * np.array([[1, 0], [-1, 0], [0, 1], [0, -1], [0.6, 0.8]])
    assert np.abs(editor.fit().displacement(at + 1.001 * (rim - at))).max() == 0
    assert np.abs(editor.fit().displacement(at + 0.9 * (rim - at))).min() > 0


def test_a_point_with_a_radius_of_its_own_shows_that(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    editor = Editor(picture, points.edit(1, radius=17.0).edit(2, active=False), support=40.0)
    page = open_editor(editor)
    assert circles(page) == []
    page.page.locator(".dnb-ed-stage").focus()
    page.page.keyboard.press("r")
    page.wait_settled()
    k = page.js(f"{PAGE}.viewport.view.k")
    assert sorted(r for *_, r in circles(page)) == pytest.approx([17 * k, 40 * k, 40 * k, 40 * k], abs=0.06)
    page.page.mouse.click(*page.to_screen(points.target[1]))
    page.wait_settled()
    ((cx, cy, r),) = circles(page)  # of what is selected only
    assert [cx, cy] == pytest.approx(to_stage(page, points.target[1]), abs=0.06)
    assert r == pytest.approx(17 * k, abs=0.06)


# ---- colours --------------------------------------------------------------------------------------------------------


def simulate_vision(page: EditorOnPage, eyes: str) -> NDArray[np.float64]:
    """The page as it looks to such eyes: red, green and blue of its pixels."""
    cdp = page.page.context.new_cdp_session(page.page)
    cdp.send("Emulation.setEmulatedVisionDeficiency", {"type": eyes})
    image = Image.open(io.BytesIO(page.page.screenshot())).convert("RGB")
    cdp.detach()
    return np.asarray(image).astype(np.float64)


def patch(image: NDArray[np.float64], place: tuple[float, float], half: int = 9) -> NDArray[np.float64]:
    x, y = (round(v) for v in place)
    return image[y - half : y + half + 1, x - half : x + half + 1]


def brightness(colour: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of sRGB, from 0 for black to 1 for white, as contrast is told by."""
    linear = np.where(colour <= 10.3, colour / 3294.6, ((colour / 255 + 0.055) / 1.055) ** 2.4)
    return linear @ np.array([0.2126, 0.7152, 0.0722])


@pytest.mark.sampled(3)
@pytest.mark.parametrize("grey", [20, 128, 235])
def test_handles_are_told_apart_by_form_whatever_colours_are_seen(
    open_editor: Any, picture: Picture, grey: int
) -> None:
    plain = Picture(np.full_like(picture.values, grey), picture.plane, picture.raster, "mip", (0.0, 255.0))
    points = ControlPoints.from_arrays([[30.0, -10], [100, 60], [35, 55]], [[70.0, -10], [100, 60], [35, 55]])
    page = open_editor(Editor(plain, points.edit(1, active=False), density=0, overlay="none"))
    # Where the disc of a point is, where its ring is, where a point is that is off, and where nothing is.
    places = [page.to_screen(at) for at in ([70, -10], [30, -10], [100, 60], [70, 25])]
    images = {eyes: simulate_vision(page, eyes) for eyes in EYES}
    assert all(np.abs(images[eyes] - images["none"]).max() > 20 for eyes in EYES[1:])  # they are simulated
    for eyes, image in images.items():
        light = [brightness(patch(image, place)) for place in places]
        for k in range(4):
            for j in range(k):
                ratio = (np.maximum(light[j], light[k]) + 0.05) / (np.minimum(light[j], light[k]) + 0.05)
                assert (ratio > 2).sum() >= 25, (eyes, j, k)  # so many pixels of a handle differ much
        for k in range(3):  # each has lines that stand out from one another, whatever lies behind it
            assert (light[k].max() + 0.05) / (light[k].min() + 0.05) > 3, (eyes, k)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("eyes", EYES)
def test_what_is_selected_has_a_ring_that_all_eyes_see(
    open_editor: Any, picture: Picture, points: ControlPoints, eyes: str
) -> None:
    page = open_editor(Editor(picture, points, density=0))
    place = page.to_screen(points.target[0])
    before = patch(simulate_vision(page, eyes), place, 14)
    page.editor.selected = [0]
    page.wait_settled()
    after = patch(simulate_vision(page, eyes), place, 14)
    y, x = np.mgrid[-14:15, -14:15]
    ring = np.abs(np.hypot(x, y) - 11) < 0.8
    assert (brightness(after)[ring] > 0.6).mean() > 0.7
    assert (brightness(after)[ring] - brightness(before)[ring]).mean() > 0.3


def test_regions_differ_by_form_as_well_as_by_colour(open_editor: Any, picture: Picture) -> None:
    page = open_editor(Editor(picture))
    points = ControlPoints.from_arrays([[30.0 + 10 * k, 25.0] for k in range(8)])
    page.editor.points = points
    page.wait_settled()
    forms = page.js(f"""[0, 1, 2, 3, 4, 5, 6, 7].map((k) => {{
        const parts = {PAGE}.layers.handles.byId.get(3);
        {PAGE}.tools.shapes.markOf = () => k;
        {PAGE}.frames.drawNow();
        return parts.forms[1].getAttribute("d"); }})""")  # of one point, so of one place
    assert len(set(forms)) == 8  # the first is the plain disc
    assert forms[0] == ""
    assert all(form.startswith("M") and form.endswith("Z") for form in forms[1:])


def test_points_at_rest_cost_no_layout_of_text_and_no_transform(open_editor: Any, picture: Picture) -> None:
    page = open_editor(Editor(picture, ControlPoints.from_arrays(np.random.default_rng(3).uniform(20, 60, (40, 2)))))
    laid_out = "[...document.querySelectorAll('.dnb-ed-points text')].filter((t) => t.getClientRects().length).length"
    page.page.mouse.move(0, 0)
    assert page.js(laid_out) == 0
    shown = """[...document.querySelectorAll('.dnb-ed-points *')].filter((e) => e.getClientRects().length
      && (e.hasAttribute('transform') || getComputedStyle(e).filter !== 'none')).length"""
    assert page.js(shown) == 0
    page.page.locator("[data-id='7'] .dnb-ed-hit").hover()
    assert page.js(laid_out) == 1
    assert page.page.locator("[data-id='7'] .dnb-ed-name").is_visible()
    assert page.page.locator("[data-id='8'] .dnb-ed-name").is_hidden()
