"""Folds in the live view: red where the core's determinant says so, on what is seen, and nowhere else."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from browser.live_page import LivePage
from browser.pane_messages import message_text
from numpy.typing import NDArray

from deformnb.analysis.folds import jacobian_determinant
from deformnb.document.deformation import Deformation, Step
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.view.live_view import LiveView

pytestmark = pytest.mark.needs_browser

GRID = Grid((24, 40, 48), (1.5, 1.5, 1.5))
PLANE = Plane.from_view(GRID, "-z")
SIZE = (288, 240)


def slab() -> Volume:
    """All matter, so that every ray meets some."""
    values = np.zeros(GRID.shape, np.uint8)
    values[4:-4] = 200
    return Volume(values, GRID, "slab")


def pulled(by: float) -> ControlPoints:
    """A point left of the middle that is taken to the right, past one that stays as the corners do."""
    corners = PLANE.to_plane(GRID.corners())[:, :2]
    low, high = corners.min(axis=0), corners.max(axis=0)
    ends = [[0.05, 0.05], [0.95, 0.05], [0.05, 0.95], [0.95, 0.95]]
    at = low + (high - low) * np.array([*ends, [0.3, 0.45], [0.62, 0.62]])
    target = at.copy()
    target[4, 0] += by * (high[0] - low[0])
    return ControlPoints.from_arrays(at, target)


FAR, SHORT = 0.45, 0.08


def open_view(page: LivePage, **options: Any) -> LiveView:
    view = LiveView(
        slab(),
        **{
            "transfer": "bone",
            "width": SIZE[0],
            "height": SIZE[1],
            "settle_ms": 60000,
            "background": "dark",
            "projection": "composite",
            **options,
        },
    )
    page.add(view)
    page.wait_loaded()
    view.set_camera(PLANE.normal, [-c for c in PLANE.v])
    return view


def red(page: LivePage) -> NDArray[np.bool_]:
    r, g, b = np.moveaxis(page.pixels().astype(int), -1, 0)
    return np.asarray((r > g + 40) & (r > b + 40))


def places(page: LivePage) -> NDArray[np.float64]:
    """Place on the plane that each pixel shows, by the camera of the page; without perspective."""
    own = "document.querySelector('.dnb-view').deformnb"
    camera = page.page.evaluate(f"() => {own}.camera.forAspect({own}.camera.aspect)")
    height, width = SIZE[1], SIZE[0]
    a, b = np.meshgrid((np.arange(width) + 0.5) / width * 2 - 1, 1 - (np.arange(height) + 0.5) / height * 2)
    frame = np.array(camera["eye"]) + a[..., None] * np.array(camera["right"]) + b[..., None] * np.array(camera["up"])
    return PLANE.to_plane(frame + np.asarray(GRID.origin))[..., :2]


def tissue_mask(page: LivePage) -> NDArray[np.bool_]:
    at, corners = places(page), PLANE.to_plane(GRID.corners())[:, :2]
    low, high = corners.min(axis=0) + 3, corners.max(axis=0) - 3
    return np.asarray(((at > low) & (at < high)).all(axis=-1))


def expected(page: LivePage, deformation: Deformation) -> NDArray[np.float64]:
    (step,) = deformation.steps
    return np.asarray(jacobian_determinant(step.fits(GRID)[0], places(page)))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("projection", ["composite", "shaded", "mip"])
def test_what_folds_is_red_at_its_place(page: LivePage, projection: str) -> None:
    view = open_view(page, projection=projection)
    deformation = Deformation.from_picture_points(GRID, PLANE, pulled(FAR))
    view.show_deformation(deformation)
    painted, seen, det = red(page), tissue_mask(page), expected(page, deformation)
    assert (det <= 0)[seen].sum() > 500
    sure = seen & (np.abs(det) > 0.08)
    assert (painted == (det <= 0))[sure].mean() > 0.985
    assert "red" in message_text(page.page)
    assert page.errors == []


def test_what_does_not_fold_has_no_red_and_no_cost(page: LivePage) -> None:
    view = open_view(page)
    deformation = Deformation.from_picture_points(GRID, PLANE, pulled(SHORT))
    view.show_deformation(deformation)
    assert not red(page).any()
    assert expected(page, deformation)[tissue_mask(page)].min() > 0
    programs = page.page.evaluate("() => Object.keys(document.querySelector('.dnb-view').deformnb.caster.gpu.programs)")
    assert not any("FOLDS" in name for name in programs)
    assert message_text(page.page) == ""


def test_the_trait_switches_it_off_and_on(page: LivePage) -> None:
    view = open_view(page)
    view.show_deformation(Deformation.from_picture_points(GRID, PLANE, pulled(FAR)))
    count = red(page).sum()
    assert count > 500
    view.show_folds = False
    assert not red(page).any()
    view.show_folds = True
    assert red(page).sum() == count


def test_the_original_has_no_folds(page: LivePage) -> None:
    view = open_view(page)
    view.show_deformation(Deformation.from_picture_points(GRID, PLANE, pulled(FAR)))
    assert red(page).any()
    view.shows = "original"
    assert not red(page).any()


def test_only_the_depths_where_the_weight_folds_are_red(page: LivePage) -> None:
    view = open_view(page)
    # The weight grows with the depth: at the side of the plane there is none, and at the other all of it.
    view.show_deformation(Deformation.from_picture_points(GRID, PLANE, pulled(FAR), extrusion="modulate", curve="z"))
    near = red(page)
    view.set_camera([-c for c in PLANE.normal], [-c for c in PLANE.v])
    far = red(page)
    assert (near.any(), far.sum() > 500) == (False, True)
    view.show_deformation(
        Deformation.from_picture_points(GRID, PLANE, pulled(FAR), extrusion="modulate", curve="0.1*z")
    )
    assert not red(page).any()
    assert not page.page.evaluate("() => document.querySelector('.dnb-view').deformnb.caster.folds")


@pytest.mark.nightly
def test_a_fold_in_space_is_red_too(page: LivePage) -> None:
    view = open_view(page)
    corners = GRID.corners()
    low, high = corners.min(axis=0), corners.max(axis=0)
    middle = (low + high) / 2
    source = np.array([*corners, middle + np.array([-12, 0, 0]), middle + np.array([4, 0, 0])])
    for by, is_red in ((22.0, True), (3.0, False)):
        target = source.copy()
        target[8, 0] += by
        deformation = Deformation.from_space_points(ControlPoints.from_arrays(source, target))
        view.show_deformation(deformation)
        assert red(page).any() == is_red
        x = np.stack(np.meshgrid(*(np.linspace(a, b, 15) for a, b in zip(low, high, strict=True))), axis=-1)
        assert (jacobian_determinant(deformation.field(GRID), x).min() <= 0) == is_red


def test_stages_take_the_red_away(page: LivePage) -> None:
    view = open_view(page)
    view.show_deformation(Deformation((Step((pulled(FAR),), PLANE, stages=16),)))
    assert not red(page).any()


def test_an_editor_that_is_dragged_makes_the_red_come_and_go(page: LivePage) -> None:
    view = open_view(page)
    editor = Editor(None, pulled(SHORT), raster=None)
    page.add(editor, "editor")
    view.follow(editor, Deformation.from_picture_points(GRID, PLANE, pulled(SHORT)).field(GRID))
    assert not red(page).any()
    editor.points = pulled(FAR)
    page.wait("document.querySelector('.dnb-view').deformnb.caster.folds")
    assert red(page).sum() > 500
    editor.stages = 16
    page.wait("!document.querySelector('.dnb-view').deformnb.caster.folds")
    assert not red(page).any()
