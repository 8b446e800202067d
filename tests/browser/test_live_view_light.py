"""The normals by which the GPU lights deformed tissue, pixel by pixel, against those of the package's fields."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from browser.live_page import LivePage
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from deformnb.document.deformation import Deformation, Step
from deformnb.rbf.fields import AbstractField
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Plane
from deformnb.volume.transfer import TransferFunction
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.view.live_view import LiveView

pytestmark = pytest.mark.needs_browser

GRID = Grid((40, 40, 40), (1.5, 1.5, 1.5))
CENTER, RADIUS = np.array([29.0, 29.0, 29.0]), 16.0
SOLID = TransferFunction(((0, 1, 1, 1),), ((0, 0), (99, 0), (101, 0.98), (255, 0.98)))
LIT = "rgba.rgb = lit(rgba.rgb, g, light, clamp((t - nearT) / (.6 * reach), 0., 1.));"
# What is written into the picture instead of a colour: the direction in which matter gets denser. Above three quarters
# the view approaches white slowly.
AS_COLOUR = "rgba.rgb = .75 * (g / max(length(g), 1e-6) * .5 + .5);"


def ball() -> Volume:
    """A ball whose value is 100 on its surface and rises steadily inwards."""
    x = GRID.index_to_point(np.stack(np.meshgrid(*map(np.arange, GRID.shape), indexing="ij"), -1)[..., ::-1])
    depth = RADIUS - np.linalg.norm(x - CENTER, axis=-1)
    return Volume(np.clip(100 + 15 * depth, 0, 255).astype(np.uint8), GRID, "ball")


def points(dim: int, move: Any) -> ControlPoints:
    """Corners of a square or a cube around the ball, moved by a function."""
    source = np.array(list(np.ndindex(*(2,) * dim)), dtype=float) * 30 + 14
    return ControlPoints.from_arrays(source, source + move(source))


def sheared(p: NDArray[Any]) -> NDArray[Any]:
    return np.stack([0.6 * (p[:, 1] - 29), 0 * p[:, 0], *(() if p.shape[1] == 2 else (0.35 * (p[:, 0] - 29),))], -1)


def fields() -> dict[str, Deformation]:
    front, above, oblique = (
        Plane.from_view(GRID, "+y"),
        Plane.from_view(GRID, "-z"),
        Plane.from_normal(GRID.center, (1, 2, -0.7)),
    )
    flat = points(2, sheared)
    centred = ControlPoints.from_arrays(flat.source - 29, flat.target - 29)  # an oblique plane begins in the middle
    bend = ControlPoints.from_arrays(
        [[29.0, 29.0], [8.0, 8.0], [50.0, 8.0], [8.0, 50.0], [50.0, 50.0]],
        [[37.0, 25.0], [8.0, 8.0], [50.0, 8.0], [8.0, 50.0], [50.0, 50.0]],
    )
    first = Step((flat,), above)
    return {
        "a shear": Deformation.from_picture_points(GRID, above, flat),
        "a bump": Deformation.from_picture_points(GRID, front, bend),
        "an oblique plane": Deformation.from_picture_points(GRID, oblique, centred),
        "less with depth": Deformation.from_picture_points(GRID, front, bend, extrusion="modulate", curve="1 - z"),
        "two planes": Deformation((first, Step((bend,), front))),
        "in space": Deformation.from_space_points(points(3, sheared)),
    }


@pytest.fixture(scope="module")
def view_on_page(browser: Any) -> Iterator[tuple[LivePage, LiveView]]:
    page = LivePage(browser)
    view = LiveView(
        ball(),
        transfer=SOLID,
        width=160,
        height=160,
        settle_ms=60000,
        background="dark",
        show_folds=False,
        space_size=96,
    )
    module = view.get_state("_esm")["_esm"]
    assert module.count(LIT) == 1
    view.set_trait("_esm", module.replace(LIT, AS_COLOUR))
    view.set_camera((0, 1, 0))
    page.add(view)
    page.wait_loaded()
    yield page, view
    page.close()


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", list(fields()))
def test_deformed_matter_is_lit_by_its_own_normals(view_on_page: tuple[LivePage, LiveView], name: str) -> None:
    page, view = view_on_page
    field = fields()[name].field(GRID)
    view.show_deformation(field)
    page.wait("document.querySelector('.dnb-view').deformnb.field")
    picture = page.pixels().astype(float)
    scale = page.page.evaluate(
        "(({ camera, caster }) => camera.height / caster.size[1])(document.querySelector('.dnb-view').deformnb)"
    )
    right, up = (np.arange(160) + 0.5 - 80) * scale, (79.5 - np.arange(160)) * scale
    x, hit = surface(field, right, up)
    undeformed, normal = gradients(field, x)
    facing = hit & (normal[:, 1] > 0.45)  # where a pixel of another place makes no great difference
    shown = picture.reshape(-1, 3) / (0.75 * 255) * 2 - 1
    angle, without = degrees(shown, normal)[facing], degrees(undeformed, normal)[facing]
    assert facing.sum() > 1500
    assert np.median(without) > 4.5  # so much does the deformation turn the surface here
    # A byte of the gradient counts 1/127 of the steepest, and one of the colour half a degree.
    assert np.median(angle) < 2.2
    assert np.percentile(angle, 95) < 6
    assert page.errors == []


def surface(field: AbstractField, right: NDArray[Any], up: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """First intersections (rays, 3) of rays along +y with the deformed ball, and a mask of the rays that have one."""
    across = np.stack(np.meshgrid(right, up), -1).reshape(-1, 2) + np.asarray(GRID.center)[[0, 2]]
    steps = np.arange(0.0, 59.0, 1.0)
    inside = np.stack([depth(field, at(across, y)) > 0 for y in steps])
    hit, first = inside.any(axis=0), inside.argmax(axis=0)
    low, high = steps[np.maximum(first - 1, 0)], steps[first]
    for _ in range(12):
        middle = (low + high) / 2
        deep = depth(field, at(across, middle)) > 0
        low, high = np.where(deep, low, middle), np.where(deep, middle, high)
    return at(across, high), hit & (first > 0)


def at(across: NDArray[Any], y: Any) -> NDArray[Any]:
    return np.stack([across[:, 0], np.broadcast_to(y, len(across)), across[:, 1]], -1)


def depth(field: AbstractField, x: NDArray[Any]) -> NDArray[Any]:
    return np.asarray(RADIUS - np.linalg.norm(x + field.displacement(x) - CENTER, axis=-1))


def gradients(field: AbstractField, x: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Into the ball, as it was where the matter comes from, and as the deformation has turned it: its Jacobian."""
    before = CENTER - (x + field.displacement(x))
    after = np.einsum("nij,ni->nj", np.eye(3) + field.jacobian(x), before)
    return tuple(g / np.linalg.norm(g, axis=1, keepdims=True) for g in (before, after))  # type: ignore[return-value]


def degrees(a: NDArray[Any], b: NDArray[Any]) -> NDArray[Any]:
    cosine = (a * b).sum(axis=1) / np.maximum(np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1), 1e-9)
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("coarseness", [1.0, 2.6])
def test_a_surface_between_voxels_is_lit_without_grain_at_rest_and_in_motion(browser: Any, coarseness: float) -> None:
    rows, columns, slices = np.meshgrid(*[np.arange(48) - 23.5] * 3, indexing="ij")
    inside = rows**2 + columns**2 + slices**2 < 20**2
    inside &= ~((np.arange(48) % 7 == 0) & (rows**2 + columns**2 + slices**2 < 17**2))  # a structure below the surface
    volume = Volume(np.where(inside, 200, 0).astype(np.uint8), Grid((48, 48, 48)), "ball")
    page = LivePage(browser, (300, 360))
    page.add(LiveView(volume, transfer="surface", width=240, height=240, settle_ms=60000, background="dark"))
    page.wait_loaded()
    bright = (
        np.array(
            page.page.evaluate(
                """(coarseness) => {
        const { loop } = document.querySelector(".dnb-view").deformnb, { gl } = loop.caster.gpu, size = 120;
        for (const p of loop.screen.pictures(size, size)) loop.caster.cast("coarse0", size, size, p, { coarseness });
        loop.caster.present("coarse0", 1);
        const bytes = new Uint8Array(4 * 240 * 240);
        gl.readPixels(0, 0, 240, 240, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
        return Array.from(bytes); }""",
                coarseness,
            ),
            float,
        )
        .reshape(240, 240, 4)[..., :3]
        .mean(axis=-1)
    )
    inner = bright[80:160, 80:160]  # the middle of the ball
    smooth = uniform_filter(inner, 9)
    assert inner.mean() > 60
    assert np.abs(inner - smooth)[8:-8, 8:-8].mean() < 4  # 2.0 and 2.5; 5.1 and 5.5 by slopes of the voxels themselves
    assert page.errors == []
    page.close()


def test_a_pit_is_darker_than_the_face_around_it_in_the_page_and_in_a_still(page: LivePage) -> None:
    z, y, x = np.indices(GRID.shape)
    pit = np.hypot(x - 20, z - 20) < 6
    body = np.where((y > 10) & ~(pit & (y < 30)), 200, 0).astype(np.uint8)
    view = LiveView(Volume(body, GRID), transfer=SOLID, width=120, height=120, settle_ms=60000, background="dark")
    view.set_camera((0, 1, 0), zoom=1.3)
    page.add(view)
    page.wait_loaded()
    shares = []
    for picture in (page.pixels, lambda: view.still((120, 120))):
        with_light = {}
        for is_on in (True, False):
            view.ambient_occlusion = is_on
            with_light[is_on] = picture().astype(float).mean(axis=2)
        share = with_light[True] / with_light[False]
        shares.append((share[55:65, 55:65].mean(), share[55:65, 20:26].mean()))
    for floor, face in shares:
        assert floor < 0.75 < 0.9 < face
    np.testing.assert_allclose(*shares, atol=0.1)  # the lamps of the two are not quite alike
