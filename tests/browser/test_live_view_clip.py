"""A live view that is cut open: the core's picture, on all six sides, in the deformed volume, with a lit face."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from browser.live_page import LivePage

from deformnb.document.deformation import Deformation
from deformnb.rbf.points import ControlPoints
from deformnb.volume.clip import WHOLE
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.view.live_view import LiveView

pytestmark = pytest.mark.needs_browser

SIZE = (200, 150)
TURNED = ((0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0))
GRID = Grid((30, 36, 24), (1.5, 1.0, 2.0), (5.0, -7.0, 30.0), TURNED)
OBLIQUE = (-0.6, 0.7, 0.4)
HALVES = [((0.0, 0.45), 0), ((0.55, 1.0), 0), ((0.0, 0.45), 1), ((0.55, 1.0), 1), ((0.0, 0.45), 2), ((0.55, 1.0), 2)]


def body() -> Volume:
    """A large ball with a smaller one at its side, of one value each."""
    k, j, i = (a / n for a, n in zip(np.indices(GRID.shape), GRID.shape, strict=True))
    ball = np.sqrt((k - 0.5) ** 2 + (j - 0.5) ** 2 + (i - 0.5) ** 2) / 0.42
    ear = np.sqrt((k - 0.8) ** 2 + (j - 0.75) ** 2 + (i - 0.2) ** 2) / 0.16
    return Volume((np.clip(8 * (1 - np.minimum(ball, ear)), 0, 1) * 200).astype(np.uint8), GRID, "body")


def bent() -> Deformation:
    plane = Plane.from_view(GRID, "+y")
    corners = plane.to_plane(GRID.corners())[:, :2]
    source = corners.min(axis=0) + np.ptp(corners, axis=0) * np.array([[0.3, 0.3], [0.7, 0.3], [0.5, 0.8], [0.2, 0.7]])
    move = np.array([[3.0, 1.0], [-2.0, 2.0], [3.0, -2.0], [1.0, 3.0]])
    return Deformation.from_picture_points(GRID, plane, ControlPoints.from_arrays(source, source + move))


def cut(axis: int, pair: tuple[float, float]) -> list[tuple[float, float]]:
    return [pair if k == axis else (0.0, 1.0) for k in range(3)]


def silhouette(image: np.ndarray) -> np.ndarray:
    return np.asarray(image.max(axis=2) > 64)


def dice(a: np.ndarray, b: np.ndarray) -> float:
    return 2 * float((a & b).sum()) / max(1.0, float(a.sum() + b.sum()))


def deform(page: LivePage, view: LiveView, deformation: Deformation | None) -> None:
    """Shows it, and waits until the page does: a newer field waits for the one before it."""
    view.show_deformation(deformation)
    for _ in range(1000):
        page.flush()
        if view.fields.pacer.is_idle:
            return
        page.page.wait_for_timeout(30)
    raise TimeoutError("the page has not confirmed the field")


@pytest.fixture(scope="module")
def shared(browser: Any) -> Iterator[tuple[LivePage, LiveView]]:
    """One page and one view: each test leaves it whole."""
    page = LivePage(browser)
    view = LiveView(body(), transfer="surface", width=SIZE[0], height=SIZE[1], settle_ms=60000, background="dark")
    page.add(view)
    page.wait_loaded()
    yield page, view
    assert page.errors == []
    page.close()


@pytest.fixture
def clip_page(shared: tuple[LivePage, LiveView]) -> Iterator[tuple[LivePage, LiveView]]:
    page, view = shared
    deform(page, view, None)
    view.projection, view.shows, view.clip = "shaded", "deformed", WHOLE
    view.set_camera(OBLIQUE, perspective=False)
    yield page, view
    view.clip = WHOLE


@pytest.mark.sampled(6)
@pytest.mark.parametrize(("pair", "axis"), HALVES)
@pytest.mark.parametrize("deformed", [False, True], ids=["as it is", "deformed"])
def test_a_half_is_the_cores_half(clip_page: Any, pair: tuple[float, float], axis: int, deformed: bool) -> None:
    page, view = clip_page
    deform(page, view, bent() if deformed else None)
    view.clip = cut(axis, pair)
    live, still = silhouette(page.pixels()), silhouette(view.still(SIZE))
    # The body is some 100 pixels across; the other half would share little more than the cut face.
    assert dice(live, still) > 0.96
    view.clip = cut(axis, (1 - pair[1], 1 - pair[0]))
    assert dice(silhouette(page.pixels()), still) < 0.93


def test_only_rays_through_the_cut_change(clip_page: Any) -> None:
    page, view = clip_page
    whole = page.pixels().astype(int)
    view.clip = cut(2, (0.0, 0.8))  # away with the top, seen from below and beside
    live = page.pixels().astype(int)
    changed = np.abs(live - whole).max(axis=2) > 6
    assert 0.01 < changed.mean() < 0.35
    still = silhouette(view.still(SIZE))
    view.clip = WHOLE
    gone = silhouette(whole.astype(np.uint8)) & ~still
    assert changed[gone].mean() > 0.8  # what is cut away has changed
    same = page.pixels().astype(int)
    assert np.abs(same - whole).max() <= 2  # and comes back as it was


@pytest.mark.parametrize("deformed", [False, True], ids=["as it is", "deformed"])
def test_a_cut_face_is_lit_evenly_and_brighter_than_the_inside(clip_page: Any, deformed: bool) -> None:
    page, view = clip_page
    deform(page, view, bent() if deformed else None)
    along = np.asarray(GRID.direction).T @ np.asarray(OBLIQUE)
    axis = int(np.abs(along).argmax())
    view.clip = cut(axis, (0.5, 1.0) if along[axis] > 0 else (0.0, 0.5))
    live = page.pixels().astype(float).mean(axis=2)
    middle = live[SIZE[1] // 2 - 8 : SIZE[1] // 2 + 8, SIZE[0] // 2 - 8 : SIZE[0] // 2 + 8]
    assert middle.mean() > 110  # an inside in its own shade is at 60
    assert middle.std() < 6
    still = view.still(SIZE).astype(float).mean(axis=2)
    assert abs(still[75, 100] - middle.mean()) < 60


def test_a_maximum_is_that_of_what_is_left(clip_page: Any) -> None:
    page, view = clip_page
    view.projection = "mip"
    deform(page, view, bent())
    view.clip = cut(0, (0.3, 0.7))
    live, still = page.pixels().astype(int), view.still(SIZE).astype(int)
    inside = silhouette(still.astype(np.uint8)) & silhouette(live.astype(np.uint8))
    assert dice(silhouette(live.astype(np.uint8)), silhouette(still.astype(np.uint8))) > 0.95
    assert np.abs(live - still)[inside].mean() < 6


def test_original_and_deformed_are_cut_at_the_same_place(clip_page: Any) -> None:
    page, view = clip_page
    deform(page, view, bent())
    view.shows = "side_by_side"
    view.clip = cut(1, (0.0, 0.5))
    live, still = silhouette(page.pixels()), silhouette(view.still(SIZE))
    assert dice(live, still) > 0.95
    view.shows = "original"
    assert dice(silhouette(page.pixels()), silhouette(view.still(SIZE))) > 0.95


@pytest.mark.nightly
def test_a_perspective_is_the_same_in_a_still(clip_page: Any) -> None:
    page, view = clip_page
    parallel = silhouette(page.pixels())
    view.set_camera(OBLIQUE, perspective=True)
    for clip in (WHOLE, cut(1, (0.4, 1.0))):
        view.clip = clip
        live, still = silhouette(page.pixels()), silhouette(view.still(SIZE))
        assert dice(live, still) > 0.96
        if clip == WHOLE:
            assert dice(live, parallel) < 0.95


def test_a_point_is_put_on_what_is_seen(clip_page: Any) -> None:
    page, view = clip_page
    view.set_camera((0, 1, 0))
    page.pixels()
    place = """(() => { const page = document.querySelector('.dnb-view').deformnb, { values, info, caster } = page;
      const body = new (page.spacePoints.body?.constructor ?? Object)({ values, info, field: page.field,
        table: caster.voxels.table.rgba, unit: caster.voxels.table.unit, clip: caster.clip });
      return body.surface({ start: info.views.home && %s, ray: [0, 1, 0] }); })()"""
    start = [float(c) for c in np.asarray(GRID.center) - [0, 100, 0]]
    whole = page.page.evaluate(place % start)
    along = np.asarray(GRID.direction).T @ np.array([0.0, 1.0, 0.0])
    axis = int(np.abs(along).argmax())
    view.clip = cut(axis, (0.5, 1.0) if along[axis] > 0 else (0.0, 0.5))
    half = page.page.evaluate(place % start)
    assert whole[1] < half[1]
    assert half[1] == pytest.approx(GRID.center[1], abs=2.5)
