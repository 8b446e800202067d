"""Frames of movies that the page of a live view draws, against its own screenshots and Python's pictures."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from browser.live_page import LivePage

from deformnb.document.deformation import Deformation
from deformnb.rbf.points import ControlPoints
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.messages.views import MoviePiece
from deformnb.widgets.view.live_view import LiveView
from deformnb.widgets.view.page_scene import PageGoneError, PageScene
from deformnb.widgets.view.stills import display_scene

pytestmark = pytest.mark.needs_browser

GRID = Grid((24, 28, 32))
SIZE = (160, 120)


def bar() -> Volume:
    z, y, x = np.indices(GRID.shape)
    flesh, bone = (z - 12) ** 2 + (y - 14) ** 2 < 80, (abs(z - 12) < 4) & (abs(y - 14) < 5) & (abs(x - 16) < 12)
    values = 60 * flesh + 140 * bone
    return Volume(values.astype(np.uint8), GRID, "bar")


def bent(by: float) -> Deformation:
    corners = [[1.0, 1.0], [30.0, 1.0], [1.0, 22.0], [30.0, 22.0]]
    points = ControlPoints.from_arrays([*corners, [16.0, 12.0]], [*corners, [16.0, 12.0 + by]])
    return Deformation.from_picture_points(GRID, "+y", points)


def run_in_thread(page: LivePage, work: Callable[[], Any]) -> Any:
    """Return or raise the result of the work, while the page is served."""
    done: list[Any] = []

    def run() -> None:
        try:
            done.append(work())
        except Exception as error:
            done.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    page.wait_until(lambda: done)
    thread.join()
    if isinstance(done[0], Exception):
        raise done[0]
    return done[0]


def open_view(page: LivePage) -> LiveView:
    view = LiveView(bar(), width=SIZE[0], height=SIZE[1], settle_ms=60000, background="dark")
    view.set_camera((1.0, 1.0, -0.5), zoom=1.3)
    page.add(view)
    page.wait_loaded()
    return view


def scene_of(view: LiveView, size: tuple[int, int] = SIZE) -> PageScene:
    return view.page_scene(view.source.volume, view.source.transfer, size, view.settings())


def test_a_frame_is_the_screenshot_of_its_moment_whatever_is_done_to_the_view(page: LivePage) -> None:
    view = open_view(page)
    assert view.has_client()
    assert not view.has_client(by_card=True)  # these tests draw without one
    pictures = []
    for by in (0.0, 6.0):
        view.show_deformation(bent(by))
        page.wait_answered()
        pictures.append(page.pixels())
    scene = scene_of(view)
    view.set_camera((-1.0, 0.2, 0.0), zoom=0.8)  # after the movie began
    view.projection = "mip"
    frames = []
    for by in (6.0, 0.0):
        scene.set_field(bent(by).field(GRID))
        frames.append(run_in_thread(page, scene.render))
    np.testing.assert_array_equal(frames, pictures[::-1])
    assert np.abs(frames[0].astype(int) - frames[1]).max() > 50
    scene.close()
    page.wait("!document.querySelector('.dnb-view').deformnb.movies.movie")


@pytest.mark.nightly
def test_a_large_frame_comes_in_pieces_and_is_near_what_python_draws(page: LivePage) -> None:
    view = open_view(page)
    seen, size = view.settings(), (800, 600)
    pieces: list[int] = []
    scene = scene_of(view, size)
    take = scene.receive

    def counted(message: MoviePiece, piece: Any) -> None:
        pieces.append(len(piece))
        take(message, piece)

    scene.receive = counted  # type: ignore[method-assign]
    scene.set_field(bent(6.0).field(GRID))
    frame = run_in_thread(page, scene.render).astype(float)
    assert max(pieces) <= 2**18 < sum(pieces)
    core = display_scene(bar(), view.source.transfer, size, seen, "core")
    core.set_field(bent(6.0).field(GRID))
    still = np.asarray(core.render()).astype(float)
    # The lamps are not quite alike, nor are soft edges and the ground: what is seen is, and about as bright.
    is_body, is_still = (np.abs(image - image[2, 2]).max(axis=2) > 40 for image in (frame, still))
    assert (is_body != is_still).mean() < 0.04 < 0.1 < is_body.mean()
    apart = (frame - still)[is_body & is_still]  # the ground of the page is darker towards the corners
    assert abs(apart.mean()) < 8
    assert np.abs(apart).mean() < 18


def test_a_page_that_closes_or_fails_ends_the_wait(page: LivePage) -> None:
    view = open_view(page)
    scene = scene_of(view, (64, 64))
    page.page.evaluate("document.querySelector('.dnb-view').deformnb.voxels.values = null")  # as while it comes
    with pytest.raises(PageGoneError, match="the volume has not come"):
        run_in_thread(page, scene.render)
    scene = scene_of(view)
    page.page.evaluate("models.view.cleanups.forEach((f) => f())")
    with pytest.raises(PageGoneError, match="closed"):
        run_in_thread(page, scene.render)
    with pytest.raises(PageGoneError, match="no page"):
        scene_of(view)
