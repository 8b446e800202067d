"""Rendering: both renderers draw one body the same way up, and a machine without OpenGL loses nothing but speed."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import oracle
import pytest
from PIL import Image

from deformnb.datasets import PHANTOMS
from deformnb.errors import Cancelled, DeformError
from deformnb.imaging import vtk_volume as module
from deformnb.imaging.camera import Camera
from deformnb.imaging.render import (
    RENDERERS,
    find_renderer,
    image_places,
    render_pair,
    render_volume,
    save_image,
)
from deformnb.imaging.vtk_volume import gl_status
from deformnb.volume.plane import Plane
from deformnb.volume.transfer import TransferFunction, as_transfer
from deformnb.volume.volume import Grid, Volume

BACKENDS = ["core", pytest.param("vtk", marks=pytest.mark.needs_gl)]
WHITE = TransferFunction(((0, 1, 1, 1),), ((0, 0), (50, 0.9), (255, 0.9)))
DIRECTIONS = {"LPS": np.eye(3), "RAS": np.diag([-1.0, -1, 1]), "PIR": np.array([[0, 0, -1.0], [1, 0, 0], [0, -1, 0]])}


def balls(direction: Any = None, spacing: Any = (0.8, 1.0, 1.3)) -> tuple[Volume, np.ndarray]:
    """Three balls that no mirror or turn maps onto themselves, and their centres in space, the largest first."""
    matrix = np.eye(3) if direction is None else direction
    grid = Grid((24, 30, 36), spacing, (10, -20, 5), tuple(map(tuple, matrix.tolist())))
    k, j, i = np.meshgrid(*map(np.arange, grid.shape), indexing="ij")
    points = grid.index_to_point(np.stack([i, j, k], -1))
    centres = grid.index_to_point(np.array([[9, 8, 7], [27, 11, 14], [16, 23, 18]]))
    values = np.zeros(grid.shape)
    for centre, radius in zip(centres, (5.5, 3.5, 2.0), strict=True):
        values = np.maximum(values, np.clip(radius + 0.5 - np.linalg.norm(points - centre, axis=-1), 0, 1))
    return Volume((200 * values).astype(np.uint8), grid), centres


def brightness(image: np.ndarray) -> np.ndarray:
    return image.astype(float).mean(axis=2)


def middle(image: np.ndarray) -> np.ndarray:
    """Mean (column, row) of the foreground."""
    weight = (brightness(image) > 40).astype(float)
    rows, columns = np.indices(weight.shape)
    return np.array([(weight * columns).sum(), (weight * rows).sum()]) / weight.sum()


# ---- the picture -----------------------------------------------------------------------------------------------------


@pytest.mark.sampled(6)
@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("direction", DIRECTIONS)
def test_up_left_and_right_are_those_of_the_plane(backend: str, direction: str) -> None:
    size, height = (160, 120), 60.0
    for look, up in (((0, 1, 0), (0, 0, 1)), ((-1, 0.3, 0.2), (0, 0, 1)), ((0.3, 0.2, 1), (0, -1, 0.4))):
        volume, centres = balls(DIRECTIONS[direction])
        plane = Plane.from_normal(volume.grid.center, look, up)
        for k, centre in enumerate(centres):  # one ball alone at a time
            index = np.stack(np.meshgrid(*map(np.arange, volume.shape), indexing="ij"), -1)[..., ::-1]
            near = np.linalg.norm(volume.grid.index_to_point(index) - centre, axis=-1) < (6.5, 4.5, 3.0)[k]
            alone = Volume(np.where(near, volume.values, np.uint8(0)), volume.grid)
            image = render_volume(
                alone, transfer=WHITE, direction=look, up=up, height=height, size=size, backend=backend
            )
            a, b, _ = plane.to_plane(centre)
            pixel = np.array([size[0] / 2 + a * size[1] / height, size[1] / 2 + b * size[1] / height]) - 0.5
            oracle.assert_close(middle(image), pixel, atol=0.8)  # a pixel; half a voxel is 0.8 of one here


@pytest.mark.needs_gl
@pytest.mark.parametrize("look", [(0.4, 1.0, -0.3), (-1, 0.2, 0.3)])
def test_both_renderers_draw_the_same_picture(look: tuple[float, float, float]) -> None:
    volume = PHANTOMS["fish"].make((48, 96, 40))
    core, vtk = (render_volume(volume, direction=look, size=(200, 160), backend=b) for b in ("core", "vtk"))
    a, b = brightness(core), brightness(vtk)
    assert np.corrcoef(a.ravel(), b.ravel())[0, 1] > 0.97
    for turned in (b[::-1], b[:, ::-1], b[::-1, ::-1]):
        assert np.corrcoef(a.ravel(), turned.ravel())[0, 1] < 0.9  # the comparison would notice
    assert 0.8 < b.mean() / a.mean() < 1.25  # VTK's lamp is at the camera, ours above the viewer's shoulder
    mask = (a > 25) & (b > 25)
    assert 2 * mask.sum() / ((a > 25).sum() + (b > 25).sum()) > 0.93


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_faces_the_viewer_is_bright_and_even(backend: str) -> None:
    k, j, i = np.indices((40, 40, 40)) - 19.5
    body = np.clip(16 - np.sqrt(k * k + j * j + i * i), 0, 1) * 200
    image = render_volume(
        Volume(body.astype(np.float32), Grid(body.shape)),
        transfer=WHITE,
        direction=(0, 1, 0),
        up=(0, 0, 1),
        height=40,
        size=(160, 160),
        backend=backend,
    )
    centre = brightness(image)[65:95, 65:95]  # within 14 degrees of facing the viewer
    assert centre.min() > 180
    assert np.ptp(centre) < 60


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("direction", ["RAS", "PIR"])
def test_light_falls_on_matter_and_not_on_the_order_of_its_voxels(backend: str, direction: str) -> None:
    """A body in space, stored along other axes, is equally lit: VTK does not turn slopes with an image's direction."""

    def rendering(axes: np.ndarray) -> np.ndarray:
        grid = Grid((40, 40, 40), origin=tuple(axes @ np.full(3, -19.5)), direction=tuple(map(tuple, axes.tolist())))
        x, y, z = np.moveaxis(grid.index_to_point(np.stack(np.indices(grid.shape)[::-1], -1)), -1, 0)
        body = np.clip(15 - np.sqrt((x / 1.1) ** 2 + y * y + (z / 0.8) ** 2), 0, 1) * 200
        return brightness(
            render_volume(
                Volume(body.astype(np.float32), grid),
                transfer=WHITE,
                direction=(0.3, 1, -0.2),
                height=40,
                size=(120, 120),
                backend=backend,
            )
        )

    expected, turned = rendering(np.eye(3)), rendering(DIRECTIONS[direction])
    assert expected.max() > 200
    assert np.abs(expected - turned).mean() < 1
    assert np.abs(expected - turned).max() < 40  # at the rim


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_default_shows_the_whole_box_and_no_more(backend: str) -> None:
    volume = Volume.from_array(np.full((10, 20, 30), 200, np.uint8), spacing=(1, 1, 2.0))
    values = volume.values.copy()
    values[0, 0, 0] = 0  # else the volume is constant
    volume = Volume(values, volume.grid)
    image = render_volume(volume, transfer=WHITE, direction=(0, 1, 0), size=(90, 90), backend=backend)
    rows, columns = (np.flatnonzero((brightness(image) > 60).any(axis=axis)) for axis in (1, 0))
    for found, length in ((columns, 30), (rows, 20)):
        wanted = length / 30 / 1.02 * 90
        # VTK fades out over half a voxel more than the box, up to 3 pixels on each side.
        assert abs(len(found) - wanted) <= 6
        assert abs(found.mean() - 44.5) <= 1


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("size", [(1, 1), (1, 40), (40, 1), (17, 5)])
def test_pictures_of_any_size(backend: str, size: tuple[int, int]) -> None:
    image = render_volume(balls()[0], size=size, backend=backend, background=(0.2, 0.4, 0.6))
    assert image.shape == (size[1], size[0], 3)
    assert image.dtype == np.uint8


@pytest.mark.parametrize("backend", BACKENDS)
def test_background_is_where_nothing_is(backend: str) -> None:
    image = render_volume(balls()[0], size=(60, 45), backend=backend, background=(0.2, 0.4, 0.6))
    oracle.assert_close(image[0, 0], [51, 102, 153], atol=1)
    assert (np.abs(image.astype(int) - [51, 102, 153]).max(axis=2) <= 1).mean() > 0.3


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("dtype", ["bool", "int8", "uint16", "int16", "int32", "float32", "float64"])
def test_every_type_of_voxel_looks_alike(backend: str, dtype: str) -> None:
    volume, _ = balls()
    solid = (volume.values > 100).astype(np.uint8)
    step = TransferFunction(((0, 1, 1, 1),), ((0, 0), (1, 0.5)))
    one, other = (
        render_volume(Volume(v, volume.grid), transfer=step, size=(40, 30), backend=backend)
        for v in (solid, solid.astype(dtype))
    )
    # Between voxels integers are rounded and numbers are not: edges differ, the bodies do not.
    assert np.corrcoef(brightness(one).ravel(), brightness(other).ravel())[0, 1] > 0.9


@pytest.mark.parametrize("backend", BACKENDS)
def test_voxels_that_are_not_finite_are_background(backend: str) -> None:
    volume, _ = balls()
    dirty = volume.values.astype(np.float32)
    clean = dirty.copy()
    dirty[3, 3, 3], clean[3, 3, 3], dirty[20, 25, 30], clean[20, 25, 30] = np.nan, 0, np.inf, 0
    one, other = (render_volume(Volume(v, volume.grid), size=(40, 30), backend=backend) for v in (clean, dirty))
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    "values",
    [
        np.zeros((4, 5, 6), np.uint8),
        np.full((4, 5, 6), np.nan, np.float32),
        np.full((1, 1, 1), 7.0),
        np.arange(30, dtype=np.uint8).reshape(1, 5, 6),
        np.arange(30, dtype=np.uint8).reshape(5, 6, 1),
    ],
    ids=["zero", "nan", "one voxel", "one slice", "one column"],
)
def test_poor_volumes_are_drawn(backend: str, values: np.ndarray) -> None:
    assert render_volume(Volume.from_array(values), size=(20, 15), backend=backend).shape == (15, 20, 3)


@pytest.mark.parametrize("look", [(0, 0, 1), (0, 0, -1)])
def test_looking_along_z_needs_no_up(look: tuple[float, float, float]) -> None:
    image = render_volume(balls()[0], transfer=WHITE, direction=look, size=(60, 45), backend="core")
    same = render_volume(balls()[0], transfer=WHITE, direction=look, up=(0, -1, 0), size=(60, 45), backend="core")
    np.testing.assert_array_equal(image, same)


def test_close_up_is_a_part_of_the_whole() -> None:
    volume, _ = balls()
    whole = render_volume(volume, transfer=WHITE, height=40, size=(160, 160), backend="core")
    part = render_volume(volume, transfer=WHITE, height=20, size=(80, 80), backend="core")
    # The same pixels cover half the length; samples are at the same places.
    assert np.corrcoef(brightness(whole[40:120, 40:120]).ravel(), brightness(part).ravel())[0, 1] > 0.99


# ---- choices ---------------------------------------------------------------------------------------------------------


def test_unknown_renderer_lists_the_choices() -> None:
    with pytest.raises(DeformError, match=r"unknown renderer 'povray'.*auto, vtk or core"):
        render_volume(balls()[0], backend="povray")


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"size": (0, 10)}, "size"),
        ({"size": (10, -1)}, "size"),
        ({"size": (10.5, 20)}, "size"),
        ({"size": (10,)}, "size"),
        ({"height": 0.0}, "height"),
        ({"height": -3.0}, "height"),
        ({"height": np.nan}, "height"),
        ({"direction": (0, 0, 0)}, "normal"),
        ({"direction": (0, 1, np.nan)}, "normal"),
        ({"up": (0.4, 1.0, -0.3)}, "up"),
    ],
)
def test_senseless_views_are_refused(options: dict[str, Any], match: str) -> None:
    with pytest.raises(DeformError, match=match):
        render_volume(balls()[0], backend="core", **options)


@pytest.mark.parametrize("backend", BACKENDS)
def test_progress_ends_at_one(backend: str) -> None:
    seen: list[float] = []
    render_volume(balls()[0], size=(20, 15), backend=backend, progress=seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == 1


# ---- OpenGL that is not there ----------------------------------------------------------------------------------------


@pytest.fixture
def no_gl(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A machine where the trial process crashes, as VTK does without OpenGL."""
    monkeypatch.setattr(module, "_PROBE", "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)")
    gl_status.cache_clear()
    yield
    gl_status.cache_clear()


@pytest.mark.usefixtures("no_gl")
def test_a_dying_trial_is_an_answer() -> None:
    works, found, remedy = gl_status()
    assert not works
    assert "OpenGL" in found
    assert "libegl1" in remedy
    assert find_renderer("auto") == "core"
    image = render_volume(balls()[0], size=(20, 15))
    np.testing.assert_array_equal(image, render_volume(balls()[0], size=(20, 15), backend="core"))
    with pytest.raises(DeformError, match=r"OpenGL.*libegl1"):
        render_volume(balls()[0], backend="vtk")


@pytest.mark.parametrize("failure", [OSError("no such program"), subprocess.TimeoutExpired("python", 60)])
def test_a_trial_that_cannot_start_or_hangs_is_an_answer(failure: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise failure

    gl_status.cache_clear()
    monkeypatch.setattr(module.subprocess, "run", fail)
    assert gl_status()[0] is False
    gl_status.cache_clear()


@pytest.mark.usefixtures("no_gl")
def test_a_missing_interpreter_is_an_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module.sys, "executable", "/nonexistent/python")
    assert gl_status()[0] is False


def test_the_trial_is_made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    first = gl_status()
    monkeypatch.setattr(module.subprocess, "run", lambda *_, **__: pytest.fail("tried again"))
    assert gl_status() == first


# ---- pairs -----------------------------------------------------------------------------------------------------------


def test_a_pair_has_one_scale() -> None:
    small = balls()[0]
    grown = small.grid.resampled(margin=(8.0, 10.0, 13.0))
    start = np.round(grown.point_to_index(small.grid.origin)).astype(int)[::-1]
    values = np.zeros(grown.shape, np.uint8)
    values[tuple(slice(s, s + n) for s, n in zip(start, small.shape, strict=True))] = small.values
    image = render_pair(
        small,
        Volume(values, grown),
        transfer=WHITE,
        size=(160, 120),
        backend="core",
        captions=("", ""),
        background=(0, 0, 0),
    )
    left, right = np.split(image, 2, axis=1)
    # The same body in more empty space: same place, same size.
    assert np.corrcoef(brightness(left).ravel(), brightness(right).ravel())[0, 1] > 0.98
    oracle.assert_close(middle(left), middle(right), atol=0.5)


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    "caption", ["", "carp", "鯉", "two\nlines", "<script>alert(1)</script>", "long " * 60, "\x1b[31m"]
)
def test_captions_are_written_as_they_are(caption: str) -> None:
    volume, _ = balls()
    plain = render_pair(volume, volume, size=(200, 150), backend="core", captions=("", ""))
    image = render_pair(volume, volume, size=(200, 150), backend="core", captions=(caption, ""))
    assert image.shape == plain.shape
    changed = np.abs(image.astype(int) - plain).max(axis=2) > 3
    assert changed.any() == bool(caption)
    assert not changed[:, changed.shape[1] // 2 :].any()  # nothing reaches into the other half
    assert not changed[: changed.shape[0] // 2].any()


def test_a_pair_is_written_as_png(tmp_path: Path) -> None:
    path = tmp_path / "pair with spaces é.png"
    volume, _ = balls()
    image = render_pair(volume, volume, size=(60, 45), backend="core", path=path)
    with Image.open(path) as file:
        assert file.format == "PNG"
        np.testing.assert_array_equal(np.asarray(file), image)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_a_stopped_pair_leaves_the_old_picture(tmp_path: Path) -> None:
    path = tmp_path / "pair.png"
    path.write_bytes(b"old")
    volume, _ = balls()
    shares: list[float] = []

    def stop(share: float) -> None:
        shares.append(share)
        if share > 0.5:
            raise Cancelled

    with pytest.raises(Cancelled):
        render_pair(volume, volume, size=(60, 45), backend="core", path=path, progress=stop)
    assert shares == sorted(shares)
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["pair.png"]


def test_nothing_visible_is_still_a_picture() -> None:
    empty = Volume.from_array(np.zeros((4, 4, 4), np.uint8))
    nothing = TransferFunction(((0, 1, 1, 1),), ((0, 0),))
    assert render_pair(empty, empty, transfer=nothing, size=(40, 30), backend="core").shape == (30, 80, 3)


def test_an_image_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    with pytest.raises(DeformError, match="no folder"):
        save_image(np.zeros((2, 2, 3), np.uint8), tmp_path / "missing" / "a.png")
    with pytest.raises(TypeError):
        save_image(np.zeros((2, 2, 3)), tmp_path / "a.png")
    assert list(tmp_path.iterdir()) == []


def test_renderers_are_listed() -> None:
    assert set(RENDERERS) == {"vtk", "core"}
    assert find_renderer("core") == "core"


@pytest.mark.parametrize("direction", [(1, 0.9, -0.2), (0, 1, 0), (0, 0, -1)])
def test_places_of_points_on_a_picture(direction: tuple[float, float, float]) -> None:
    values = np.zeros((24, 24, 24), np.uint8)
    values[17:20, 4:7, 8:11] = 255
    volume = Volume.from_array(values, spacing=(1, 1.5, 2), origin=(-30, 5, 7))
    view: dict[str, Any] = {"direction": direction, "size": (200, 160), "height": 70.0}
    image = render_volume(volume, backend="core", **view).sum(axis=2)
    rows, columns = np.nonzero(image > image.max() / 4)
    seen = (np.ptp(columns) / 2 + columns.min(), np.ptp(rows) / 2 + rows.min())
    wanted = image_places(volume.grid.index_to_point([9, 5, 18]), volume.grid, **view)
    np.testing.assert_allclose(wanted, seen, atol=1.5)


@pytest.mark.needs_gl
def test_a_hot_voxel_does_not_change_what_vtk_draws() -> None:
    grid = Grid((24, 24, 24))
    values = np.broadcast_to(np.linspace(0, 100, 24, dtype=np.float32), grid.shape).copy()
    narrow = TransferFunction(
        ((0, 0, 0, 0.2), (50, 1, 0.5, 0), (100, 1, 1, 1)), ((0, 0), (30, 0), (32, 0.3), (100, 0.6))
    )
    look = {"transfer": narrow, "direction": (0, 0, 1), "up": (0, -1, 0), "size": (96, 96), "backend": "vtk"}
    plain = render_volume(Volume(values, grid), **look).astype(int)
    assert plain.mean() > 40
    for hot in (1e6, -1e6):
        spotted = values.copy()
        spotted[1, 1, 1] = hot
        other = render_volume(Volume(spotted, grid), **look).astype(int)
        apart = np.abs(other - plain).max(axis=2) > 2
        assert apart.mean() < 0.03, hot  # the voxel itself, and its neighbours' light


@pytest.mark.needs_gl
@pytest.mark.parametrize("node", [(1000, 1000), (1000, 1001), (2000, 2000.5)])
def test_a_jump_of_opacity_is_where_it_belongs_in_vtk(node: tuple[float, float]) -> None:
    values = np.broadcast_to(np.linspace(0, 4000, 101, dtype=np.float32), (4, 101, 101)).copy()
    function = TransferFunction(((0, 1, 1, 1),), ((0, 0), (node[0], 0), (node[1], 0.9), (4000, 0.9)))
    rows = [
        render_volume(
            Volume.from_array(values),
            transfer=function,
            direction=(0, 0, -1),
            up=(0, -1, 0),
            size=(202, 202),
            height=101.0,
            backend=b,
        )[100].max(axis=-1)
        > 60
        for b in ("vtk", "core")
    ]
    edges = [np.flatnonzero(np.diff(row[4:-4].astype(int))) for row in rows]
    assert len(edges[0]) == len(edges[1]) == 1
    assert abs(int(edges[0][0]) - int(edges[1][0])) <= 2  # of 202 pixels: a voxel


@pytest.mark.needs_gl
@pytest.mark.parametrize("transfer", [((0, 0), (1e6, 1)), ((0, 0), (50, 0.5), (50, 0.9)), ((0, 0), (5e-4, 1))])
def test_vtk_is_given_no_table_longer_than_it_makes(transfer: Any, capfd: pytest.CaptureFixture[str]) -> None:
    values = np.random.default_rng(0).uniform(0, 100, (12, 12, 12)).astype(np.float32)
    values[3, 3, 3] = 1e6
    function = TransferFunction(((0, 1, 1, 1), (0, 0.5, 1, 1)), transfer)
    render_volume(Volume.from_array(values), transfer=function, size=(32, 32), backend="vtk")
    assert "texture size" not in capfd.readouterr().err


@pytest.mark.needs_gl
def test_nor_where_voxels_are_exchanged_for_some_of_another_range(capfd: pytest.CaptureFixture[str]) -> None:
    values = np.random.default_rng(0).integers(0, 200, (12, 12, 12)).astype(np.uint8)
    wide, narrow = Volume.from_array(values), Volume.from_array(values // 2)
    renderer = RENDERERS["vtk"](as_transfer("specimen", wide), (32, 32))
    camera = Camera(Plane((5.5, 5.5, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)), 14.0)
    for volume in (wide, narrow, wide):
        renderer(volume, camera)
    renderer.close()
    assert "texture size" not in capfd.readouterr().err
