"""The live view's Python: messages, refusals and stills; and the arrays of its front end. No browser."""

from __future__ import annotations

import asyncio
import gzip
import io
import json
import logging
import threading
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import traitlets
from front_end import deliver
from PIL import Image
from scipy.ndimage import convolve1d, map_coordinates
from scripts import run_script
from waiting import PATIENCE, wait_for

from deformnb.document.deformation import Deformation, Step
from deformnb.errors import DeformError
from deformnb.rbf.extrusion import Extrusion
from deformnb.rbf.fields import AbstractField, Composed, DisplacementField, Identity, compose
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Plane
from deformnb.volume.transfer import TransferFunction, preset
from deformnb.volume.views import VIEWS
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.camera import HOME, checked_camera
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.image_encoding import as_png
from deformnb.widgets.messages.views import ChunkRequest
from deformnb.widgets.packed_volume import packed_volume
from deformnb.widgets.textures import field_textures
from deformnb.widgets.view import stills
from deformnb.widgets.view.base import AbstractView
from deformnb.widgets.view.live_view import LiveView
from deformnb.widgets.view.transport import Pacer

TURNED = ((0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0))
GRID = Grid((10, 20, 12), (1.5, 1.0, 2.0), (5.0, -7.0, 30.0), TURNED)


def ball(grid: Grid = GRID, dtype: str = "uint8") -> Volume:
    k = np.indices(grid.shape)[::-1] - (np.array(grid.shape[::-1]) - 1).reshape(3, 1, 1, 1) / 2
    r = np.sqrt((k**2).sum(axis=0))
    return Volume(np.clip(40 * (4.5 - r), 0, 200).astype(dtype), grid, "ball")


def points(grid: Grid, plane: Plane, seed: int = 0, size: float = 2.0) -> ControlPoints:
    rng = np.random.default_rng(seed)
    corners = plane.to_plane(grid.corners())[:, :2]
    source = corners.min(axis=0) + np.ptp(corners, axis=0) * rng.uniform(0.1, 0.9, (5, 2))
    return ControlPoints.from_arrays(source, source + rng.normal(0, size, (5, 2)))


class Recorded(LiveView):
    """A view whose messages are recorded instead of sent."""

    def send(self, content: Any, buffers: Any = None) -> None:
        self.__dict__.setdefault("out", []).append((content, list(buffers or [])))

    def say(self, content: Any, buffers: list[Any] | None = None) -> list[tuple[Any, list[bytes]]]:
        """Answers of the view to a message of a front end."""
        self.__dict__["out"] = []
        deliver(self, content, buffers or [])
        return list(self.__dict__["out"])


def table_of(view: LiveView) -> np.ndarray:
    return np.frombuffer(view.table, "<f4").reshape(-1, 4)


def test_the_view_keeps_the_contract_of_all_views() -> None:
    view = Recorded()
    assert isinstance(view, AbstractView)
    with pytest.raises(DeformError, match="no volume yet"):
        view.still()
    with pytest.raises(DeformError, match="no volume yet"):
        view.show_deformation(None)


def test_the_pieces_put_together_are_the_voxels() -> None:
    volume = ball(Grid((40, 300, 200)))
    view = Recorded()
    view.show(volume, window=(0.0, 255.0))  # the bytes as they are
    info = view.volume_info
    assert info["chunks"] == 2
    whole = np.zeros(volume.grid.size, np.uint8)
    for index in range(info["chunks"]):
        ((content, (packed,)),) = view.say({"type": "chunk", "view": "a", "id": info["id"], "index": index})
        voxels = np.frombuffer(gzip.decompress(packed), np.uint8)
        whole[content["start"] : content["start"] + len(voxels)] = voxels
        assert (content["type"], content["view"], content["index"]) == ("chunk", "a", index)
    np.testing.assert_array_equal(whole.reshape(volume.shape), volume.values)
    assert view.stats()["volume_bytes"] > 0


def test_a_saved_notebook_holds_no_voxels_and_no_maps() -> None:
    rng = np.random.default_rng(0)
    volume = Volume(rng.integers(0, 255, (64, 64, 64)).astype(np.uint8), Grid((64, 64, 64)))
    view = Recorded(volume)
    plane = Plane.from_view(volume.grid, "+y")
    view.show_deformation(Deformation.from_picture_points(volume.grid, plane, points(volume.grid, plane)))
    state = {k: v for k, v in view.get_state().items() if k not in ("_esm", "_css")}
    size = sum(len(v) if isinstance(v, bytes) else len(json.dumps(v, default=str)) for v in state.values())
    assert size < 12_000  # of which the table of colours is 4096; the voxels are 262144


def test_a_page_that_comes_late_gets_the_deformation() -> None:
    view = Recorded(ball())
    field = Deformation.from_picture_points(GRID, "+y", points(GRID, Plane.from_view(GRID, "+y")))
    view.show_deformation(field)
    ((content, buffers),) = view.say({"type": "hello", "view": "b", "largest": 2048, "renderer": "", "software": True})
    assert content["type"] == "field"
    assert content["view"] == "b"
    k, rows, columns = content["planar"]["shape"]
    assert len(buffers[0]) == k * rows * columns * 8


def test_work_waits_until_a_page_has_the_voxels_or_has_them_drawn_in_python() -> None:
    view, done = Recorded(ball()), []
    view.source.call_after_upload(lambda: done.append("sent"))
    view.say({"type": "hello", "view": "a", "largest": 2048, "renderer": "", "software": True})
    assert done == []
    info = view.volume_info
    for _twice in range(2):
        for index in range(info["chunks"]):
            view.say({"type": "chunk", "view": "a", "id": info["id"], "index": index})
    assert done == ["sent"]
    view.source.call_after_upload(lambda: done.append("drawn in Python"))
    view.say({"type": "hello", "view": "a", "largest": 0, "renderer": "", "software": True})
    assert done[1:] == ["drawn in Python"]


@pytest.mark.parametrize(
    "message",
    [
        None,
        [],
        "hello",
        {},
        {"type": "nothing"},
        {"type": []},
        {"type": "chunk"},
        {"type": "chunk", "view": 3},
        {"type": "chunk", "view": "a" * 201},
        {"type": "hello", "view": "a"},
        {"type": "hello", "view": "a", "largest": 1e3},
        {"type": "hello", "view": "a", "largest": -1},
        {"type": "still"},
        {"type": "screenshot", "view": "a", "id": 1},
        {"type": "screenshot", "view": "a", "id": "x"},
        {"type": "_chunk", "view": "a"},
        {"type": "movie_piece", "view": "a", "id": "x", "index": 1, "offset": 0, "size": 1},
    ],
)
def test_a_wrong_message_is_logged_and_dropped(message: Any, caplog: pytest.LogCaptureFixture) -> None:
    view = Recorded(ball())
    with caplog.at_level(logging.WARNING):
        assert view.say(message) == []
    assert "dropped" in caplog.text


def test_a_piece_that_does_not_exist_is_refused_and_one_of_an_old_volume_ignored(caplog: Any) -> None:
    view = Recorded(ball())
    with caplog.at_level(logging.WARNING):
        assert view.say({"type": "chunk", "view": "a", "id": view.volume_info["id"], "index": 1}) == []
    assert "between 0 and 0" in caplog.text
    caplog.clear()
    assert view.say({"type": "chunk", "view": "a", "id": "old", "index": 0}) == []
    assert caplog.text == ""


def test_a_piece_that_is_asked_for_while_a_cell_shows_another_volume_does_not_get_into_that() -> None:
    old, new = (Volume(np.full((6, 5, 4), value, np.uint8), Grid((6, 5, 4))) for value in (3, 7))
    view = Recorded(old)
    view.show(old, window=(0.0, 255.0))

    class Requested(str):
        """An id; when it is compared, which is between request and answer, a cell shows the other volume."""

        __slots__ = ()
        __hash__ = str.__hash__

        def __ne__(self, other: object) -> bool:
            cell = threading.Thread(target=lambda: view.show(new, window=(0.0, 255.0)))
            cell.start()
            cell.join(PATIENCE)
            return str.__ne__(self, other)

    values = []
    for kind in (Requested, str):
        name = kind(view.volume_info["id"])
        before = len(view.__dict__.get("out", []))
        view.take_message(ChunkRequest(view="a", id=name, index=0))
        ((content, (packed,)),) = [
            (content, buffers) for content, buffers in view.__dict__["out"][before:] if content["type"] == "chunk"
        ]
        assert content["id"] == str(name)
        values.append(set(gzip.decompress(packed)))
    assert values == [{3}, {7}]


def test_what_a_page_measured_is_kept_where_it_is_a_number() -> None:
    view = Recorded(ball())
    view.say({"type": "stats", "view": "a", "drag_ms": 12.5, "full_ms": None, "evil": 1})
    assert view.stats()["drag_ms"] == 12.5
    assert not {"full_ms", "scale", "evil"} & set(view.stats())
    for wrong in ("x", float("nan"), True):
        view.say({"type": "stats", "view": "a", "drag_ms": 99.0, "full_ms": wrong})
        assert view.stats()["drag_ms"] == 12.5


def test_a_smaller_card_gets_a_smaller_volume() -> None:
    view = Recorded(ball(Grid((4, 300, 5))))
    view.show_deformation(
        Deformation.from_picture_points(
            view.source.volume.grid,
            "+z",
            points(view.source.volume.grid, Plane.from_view(view.source.volume.grid, "+z")),
        )
    )
    answers = view.say({"type": "hello", "view": "a", "largest": 128, "renderer": "", "software": True})
    assert view.volume_info["shape"] == [5, 100, 4]
    assert view.volume_info["note"] == "shown at 1/3 along y"
    assert answers[-1][0]["planar"] is not None


def test_a_card_with_too_little_memory_gets_fewer_voxels_and_the_same_deformation() -> None:
    view = Recorded(ball(Grid((20, 30, 40))))
    view.show_deformation(
        Deformation.from_picture_points(
            view.source.volume.grid,
            "+z",
            points(view.source.volume.grid, Plane.from_view(view.source.volume.grid, "+z")),
        )
    )
    view.say({"type": "hello", "view": "a", "largest": 2048})
    fine = view.volume_info["id"]
    for voxels, shape in ((20 * 30 * 40, [40, 30, 20]), (12_000, [20, 30, 20]), (6_000, [20, 15, 20])):
        answers = view.say({"type": "hello", "view": "a", "largest": 2048, "voxels": voxels})
        assert view.volume_info["shape"] == shape
        assert answers[-1][0]["planar"] is not None
    assert view.volume_info["id"] != fine
    assert view.volume_info["note"] == "shown at 1/2 along x, 1/2 along y"
    view.show(ball(Grid((20, 20, 20))))  # another one is no larger either
    assert int(np.prod(view.volume_info["shape"])) <= 6000
    assert view.say({"type": "hello", "view": "a", "largest": 2048, "voxels": 0}) == []  # dropped


def test_averages_and_geometry_of_what_is_shown_smaller() -> None:
    rng = np.random.default_rng(1)
    grid = Grid((5, 7, 9), (0.5, 1.0, 2.0), (3, 4, 5), TURNED)
    volume = Volume(rng.integers(0, 1000, grid.shape).astype(np.int16), grid)
    shown = packed_volume(volume, 80, 2048, window=(0.0, 1000.0))
    assert shown.factors == (3, 2, 1)  # always along the axis where voxels are closest
    assert shown.note == "shown at 1/3 along x, 1/2 along y"
    first = volume.values[0, 0:2, 0:3].astype(float).mean() * 255 / 1000
    last = volume.values[4, 6:7, 6:9].astype(float).mean() * 255 / 1000
    assert abs(shown.volume.values[0, 0, 0] - first) <= 0.501  # rounded to a byte
    assert abs(shown.volume.values[4, 3, 2] - last) <= 0.501
    np.testing.assert_allclose(shown.volume.grid.index_to_point([0, 0, 0]), volume.grid.index_to_point([1.0, 0.5, 0]))
    assert shown.box() == {"low": [-0.75, -1.0, -1.0], "high": [3.75, 6.0, 9.0]}  # from the first centre


@pytest.mark.parametrize(
    ("shape", "limit", "largest"),
    [
        ((1, 1, 1), 1, 1),
        ((7, 5, 3), 1, 2048),
        ((9, 400, 3), 10**6, 64),
    ],
)
def test_the_limits_hold(shape: tuple[int, int, int], limit: int, largest: int) -> None:
    shown = packed_volume(Volume(np.zeros(shape, np.float32), Grid(shape)), limit, largest)
    assert shown.volume.grid.size <= limit
    assert max(shown.volume.shape) <= largest


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "values",
    [
        np.zeros((3, 4, 5), bool),
        np.full((3, 4, 5), 7, np.int16),
        np.full((3, 4, 5), np.nan),
        np.ones((1, 1, 1)),
    ],
)
def test_any_volume_can_be_shown(values: Any) -> None:
    view = Recorded(Volume.from_array(values))
    assert view.still((32, 24)).shape == (24, 32, 3)


def test_values_become_bytes_by_the_window() -> None:
    volume = Volume(np.array([[[-5.0, 0.0, 5.0, 10.0, 99.0, np.nan]]]), Grid((1, 1, 6)))
    shown = packed_volume(volume, 100, 2048, window=(0.0, 10.0))
    assert shown.volume.values.ravel().tolist() == [0, 0, 128, 255, 255, 0]
    with pytest.raises(DeformError, match="two rising numbers"):
        packed_volume(volume, 100, 2048, window=(3.0, 3.0))


def _at(content: Any, maps: bytes, weights: bytes, x: np.ndarray) -> np.ndarray:
    """The GPU's displacements from the maps at places (n, 3) of its frame, by the formula of the shader."""
    planar, plane = content.planar, content.planar["plane"]
    k, rows, columns = planar["shape"]
    grid = np.frombuffer(maps, "<f4").reshape(k, rows, columns, 2).astype(np.float64)
    table = np.frombuffer(weights, "<f4").reshape(k, -1)
    a, b, c = (np.dot(x - plane["origin"], plane[name]) for name in "uvn")
    col, row = (a - planar["origin"][0]) / planar["spacing"][0], (b - planar["origin"][1]) / planar["spacing"][1]
    i, j = np.clip(col.astype(int), 0, columns - 2), np.clip(row.astype(int), 0, rows - 2)
    s, t = (col - i)[:, None], (row - j)[:, None]
    c0, c1 = planar["depth"]
    zeta = np.clip((c - c0) / (c1 - c0), 0, 1)
    total = np.zeros((len(x), 2))
    for m, w in zip(grid, table, strict=True):
        d = (1 - t) * ((1 - s) * m[j, i] + s * m[j, i + 1]) + t * ((1 - s) * m[j + 1, i] + s * m[j + 1, i + 1])
        total += np.interp(zeta, np.linspace(0, 1, table.shape[1]), w)[:, None] * d
    return total[:, :1] * plane["u"] + total[:, 1:] * plane["v"]


@pytest.mark.parametrize("view", [*VIEWS, "oblique"])
@pytest.mark.parametrize("rule", ["replicate", "modulate", "interpolate"])
def test_the_card_knows_the_displacement_of_an_extrusion(view: str, rule: str) -> None:
    shown = packed_volume(ball(), 10**6, 2048)
    plane = Plane.from_normal(GRID.center, (1, 2, -0.7)) if view == "oblique" else Plane.from_view(GRID, view)
    sets = tuple(points(GRID, plane, seed) for seed in range(3 if rule == "interpolate" else 1))
    of_rule: dict[str, Any] = {"modulate": {"curve": "sin(pi*z)"}, "interpolate": {"knots": (0.0, 0.3, 1.0)}}
    options = of_rule.get(rule, {})
    field = Deformation((Step(sets, plane, extrusion=rule, **options),)).field(GRID)
    message = field_textures(field, shown, None, 256, 32)
    rng = np.random.default_rng(2)
    x = GRID.index_to_point(rng.uniform(0, np.array(GRID.shape[::-1]) - 1, (200, 3)))
    got = _at(message.content, *message.buffers, shown.to_frame(x))
    expected = field.displacement(x) @ shown.frame.T
    # Interpolation between samples 0.15 apart of bumps some 10 wide and 2 high: h^2/8 times a second derivative of 0.1.
    np.testing.assert_allclose(got, expected, atol=2e-3)


def test_what_is_no_extrusion_is_sampled_in_space() -> None:
    shown = packed_volume(ball(), 10**6, 2048)
    rng = np.random.default_rng(3)
    field = DisplacementField(rng.normal(0, 1, (2, 2, 2, 3)), Grid((2, 2, 2), (20.0, 30.0, 25.0), (0.0, -20.0, 10.0)))
    content, (samples,) = (message := field_textures(field, shown, None, 64, 40)).content, message.buffers
    about = content.space
    assert about is not None
    nx, ny, nz = about["shape"]
    values = np.frombuffer(samples, "<f4").reshape(nz, ny, nx, 3)
    at = np.array([3, 7, 2])
    place = np.asarray(about["origin"]) + at * about["spacing"]
    x = GRID.index_to_point(place / np.asarray(GRID.spacing))
    np.testing.assert_allclose(values[at[2], at[1], at[0]], shown.frame @ field.displacement(x), atol=1e-5)  # float32
    low = np.asarray(about["origin"])
    high = low + (np.array([nx, ny, nz]) - 1) * about["spacing"]
    np.testing.assert_allclose([low, high], [content.box["low"], content.box["high"]], atol=1e-9)


@pytest.mark.nightly
def test_of_a_composition_the_last_extrusion_stays_one() -> None:
    shown, plane = packed_volume(ball(), 10**6, 2048), Plane.from_view(GRID, "+y")
    steps = [Deformation.from_picture_points(GRID, plane, points(GRID, plane, k)).field(GRID) for k in (1, 2)]
    both = field_textures(compose(*steps), shown, None, 64, 16)
    assert both.content.planar is not None
    assert both.content.space is not None
    # The steps before are looked up at displaced places: they are known that far beyond the box.
    assert both.content.space["origin"][0] < both.content.box["low"][0]
    none: list[AbstractField | None] = [None, Identity(3)]
    for field in none:
        assert field_textures(field, shown, None, 64, 16).buffers == []
    odd = field_textures(Composed(steps[0], DisplacementField.sample(steps[1], GRID)), shown, None, 64, 16)
    assert (odd.content.planar, len(odd.buffers)) == (None, 1)


def test_only_fields_in_space_and_extrusions_to_be_edited() -> None:
    view, plane = Recorded(ball()), Plane.from_view(GRID, "+y")
    fit = Deformation.from_picture_points(GRID, plane, points(GRID, plane)).steps[0].fits(GRID)[0]
    with pytest.raises(DeformError, match="extrude"):
        view.show_deformation(fit)
    field = Deformation.from_picture_points(GRID, plane, points(GRID, plane)).field(GRID)
    assert isinstance(field, Extrusion)
    with pytest.raises(DeformError, match="no map 1"):
        view.follow(None, field, 1)
    with pytest.raises(DeformError, match="does not end with one"):
        view.follow(view, DisplacementField.sample(field, GRID))


NARROW = TransferFunction(((1000, 0, 0, 0), (1600, 1, 1, 1)), ((1000, 0), (1600, 0.5)))


def ramp() -> Volume:
    """Whole numbers from 0 to 4095, each once."""
    return Volume(np.arange(4096, dtype=np.int16).reshape(16, 16, 16), Grid((16, 16, 16)))


def levels_within(view: LiveView, low: int, high: int) -> int:
    assert view.source.voxels is not None
    return len(np.unique(view.source.voxels.volume.values.ravel()[low : high + 1]))


def test_a_narrow_transfer_function_gets_finer_levels_when_it_has_come_to_rest() -> None:
    view = Recorded(ramp())
    whole = view.source.voxels.window  # type: ignore[union-attr]
    assert levels_within(view, 1000, 1600) < 45
    first = view.volume_info["id"]
    view.set_transfer(NARROW)
    wait_for(lambda: view.volume_info["id"] != first)
    view.repack()  # nothing is left to do, once the thread that does it has ended
    low, high = view.source.voxels.window  # type: ignore[union-attr]
    assert (low, high) == pytest.approx((970, 1630))
    assert levels_within(view, 1000, 1600) > 225
    assert view.volume_info["note"] == "finer greys from 970 to 1630"
    assert view.volume_info["share"] == pytest.approx(660 / (whole[1] - whole[0]))
    np.testing.assert_allclose(table_of(view), NARROW(np.linspace(low, high, len(table_of(view)))), atol=1e-6)
    second = view.volume_info["id"]
    view.set_transfer(replace(NARROW, opacities=((1020, 0), (1500, 0.5))))
    assert not view.source.needs_repacking()  # it will do
    view.set_transfer("specimen")
    wait_for(lambda: view.volume_info["id"] != second)
    view.repack()
    assert view.source.voxels.window == whole  # type: ignore[union-attr]
    assert view.volume_info["note"] == ""


def test_colours_that_change_while_the_levels_do_are_those_of_the_new_levels(monkeypatch: Any) -> None:
    values = np.arange(4000, dtype=np.int16).reshape(10, 20, 20)
    view = LiveView(Volume.from_array(values), transfer=TransferFunction(((0, 0, 0, 0),), ((0, 0), (4000, 1))))
    narrow = TransferFunction(((1000, 0, 0, 0), (1600, 1, 1, 1)), ((1000, 0), (1600, 1)))
    has_table, may_go_on, tabulated = threading.Event(), threading.Event(), TransferFunction.table

    def slow(function: TransferFunction, *given: Any) -> Any:
        table = tabulated(function, *given)
        if threading.current_thread() is user:
            has_table.set()
            may_go_on.wait(PATIENCE)
        return table

    monkeypatch.setattr(TransferFunction, "table", slow)
    user, timer = threading.Thread(target=view.set_transfer, args=(narrow,)), threading.Thread(target=view.repack)
    user.start()
    assert has_table.wait(PATIENCE)
    timer.start()
    timer.join(0.3)  # it waits for the user, or else is done before
    may_go_on.set()
    for thread in (user, timer):
        thread.join(PATIENCE)
    assert view.volume_info["note"] == "finer greys from 970 to 1630"
    assert view.table == np.ascontiguousarray(tabulated(narrow, 970.0, 1630.0), "<f4").tobytes()
    view.close()


def test_finer_levels_from_the_start_and_where_there_are_none() -> None:
    view = Recorded(ramp(), transfer=NARROW)
    assert view.source.voxels.window == pytest.approx((970, 1630))  # type: ignore[union-attr]
    plane = Plane.from_view(view.source.volume.grid, "+y")
    view.show_deformation(
        Deformation.from_picture_points(view.source.volume.grid, plane, points(view.source.volume.grid, plane))
    )
    field = view.fields.shown.field
    view.projection = "mip"  # which shows all values
    wait_for(lambda: view.source.voxels.share == 1.0)  # type: ignore[union-attr]
    view.repack()
    assert view.source.voxels.share == 1.0  # type: ignore[union-attr]
    assert view.fields.shown.field is field
    view.show(ramp(), window=(0.0, 4000.0))  # the user's own choice
    view.projection = "shaded"
    assert not view.source.needs_repacking()
    flat = Recorded(ball(), transfer=TransferFunction(((90, 0, 0, 0), (99, 1, 1, 1)), ((90, 0), (99, 1))))
    assert flat.source.voxels.share == 1.0  # type: ignore[union-attr]  # bytes are distinct as they are


def test_colours_are_those_of_the_values() -> None:
    view = Recorded(ball(dtype="int16"))
    ramp = TransferFunction(((0, 0, 0, 0), (200, 1, 0.5, 0)), ((0, 0), (200, 0.8)), unit=3.0)
    view.set_transfer(ramp)
    table = table_of(view)
    low, high = view.source.voxels.window  # type: ignore[union-attr]
    np.testing.assert_allclose(table, ramp(np.linspace(low, high, len(table))), atol=1e-6)
    assert view.unit == 3.0
    with pytest.raises(DeformError, match="unknown transfer function"):
        view.set_transfer("gold")
    np.testing.assert_array_equal(table_of(view), table)  # the old one stays


def test_the_camera_is_set_and_kept() -> None:
    view = Recorded(ball())
    view.set_camera((0, 2, 0), zoom=2)
    assert view.camera["direction"] == [0.0, 1.0, 0.0]
    assert view.camera["zoom"] == 2.0
    view.set_camera(up=(1, 5, 0))
    assert view.camera["up"] == [1.0, 0.0, 0.0]
    view.show(ball())
    assert view.camera["zoom"] == 2.0
    for wrong in ({"zoom": 0}, {"zoom": float("nan")}, {"direction": (0, 0, 0)}):
        with pytest.raises(DeformError):
            view.set_camera(**wrong)  # type: ignore[arg-type]


def test_a_still_shows_the_deformed_volume_from_the_camera() -> None:
    view = Recorded(ball(Grid((24, 24, 24))), transfer="surface")
    view.set_camera((0, 1, 0))
    size = (100, 80)

    def middle() -> np.ndarray:
        rows, columns = np.nonzero(view.still(size).max(axis=2) > 60)
        return np.array([columns.mean(), rows.mean()])

    before = middle()
    np.testing.assert_allclose(before, [49.5, 39.5], atol=0.6)  # pixels, of a ball on a lattice
    plane = Plane.from_view(Grid((24, 24, 24)), "+y")
    moved = ControlPoints.from_arrays([[12.0, 12.0]], [[16.0, 9.0]])  # to the right and up
    view.show_deformation(Deformation.from_picture_points(view.source.volume.grid, plane, moved, trend="translation"))
    right, down = middle() - before
    assert right > 5
    assert down < -4
    view.camera = {**view.camera, "pan": [4.0, 3.0]}  # the view follows the ball
    np.testing.assert_allclose(middle(), before, atol=1.2)
    view.projection = "mip"
    np.testing.assert_allclose(middle(), before, atol=1.2)


@pytest.mark.nightly
def test_a_screenshot_without_a_page_is_the_still() -> None:
    view = Recorded(ball(), width=80, height=64)
    image = asyncio.run(view.screenshot(timeout=0.01))
    np.testing.assert_array_equal(image, view.still())


def test_a_screenshot_of_a_page_arrives() -> None:
    view, picture = Recorded(ball()), np.arange(4 * 5 * 3, dtype=np.uint8).reshape(4, 5, 3)

    async def take() -> np.ndarray:
        waiting = asyncio.create_task(view.screenshot())
        await asyncio.sleep(0)
        content, _ = view.__dict__["out"][-1]
        view.say({"type": "screenshot", "view": "a", "id": content["id"]}, [memoryview(as_png(picture))])
        return await waiting

    np.testing.assert_array_equal(asyncio.run(take()), picture)


# -- what is shown ---------------------------------------------------------------------------------------------------


def bent(view: LiveView) -> Deformation:
    return Deformation.from_picture_points(
        view.source.volume.grid, "+y", ControlPoints.from_arrays([[12.0, 12.0]], [[17.0, 9.0]]), trend="translation"
    )


def test_a_still_shows_the_original_the_deformed_or_both() -> None:
    view = Recorded(ball(Grid((24, 24, 24))), transfer="surface", background="dark")
    view.set_camera((0, 1, 0))
    size, half = (120, 60), (60, 60)
    original = view.still(half)
    view.show_deformation(bent(view))
    deformed = view.still(half)
    assert (original != deformed).any()
    view.shows = "side_by_side"
    both = view.still(size)
    np.testing.assert_array_equal(both[:, :60], original)
    np.testing.assert_array_equal(both[:, 60:], deformed)
    view.shows = "original"
    np.testing.assert_array_equal(view.still(half), original)
    view.shows = "flicker"
    np.testing.assert_array_equal(view.still(half), deformed)
    with pytest.raises(DeformError, match=r"cannot show 'both'; choose one of deformed, original"):
        view.shows = "both"
    assert view.shows == "flicker"


def test_readers_without_a_front_end_see_a_picture() -> None:
    volume = ball(Grid((24, 24, 24)))
    view = Recorded(volume, transfer="surface", background="light")
    view.set_camera((0, 1, 0))
    bundle = view._repr_mimebundle_()
    data = bundle[0] if isinstance(bundle, tuple) else bundle
    assert "application/vnd.jupyter.widget-view+json" in data
    image = np.asarray(Image.open(io.BytesIO(data["image/png"])).convert("RGB")).astype(int)
    assert image.shape == (420, 560, 3)
    np.testing.assert_allclose(image[5, 5], np.round(255 * np.array(stills.BACKGROUNDS["light"])), atol=1)
    # The same picture as a still of that size, but for the fewer pixels it was made of.
    assert np.abs(image - view.still((560, 420)).astype(int)).mean() < 3
    assert (image[200:220, 270:290, 2] - image[5, 5, 2]).max() < -20  # the ball is in the middle, and less blue
    assert "image/png" not in LiveView()._repr_mimebundle_()  # nothing to be seen yet, and no error


def test_the_picture_for_readers_is_made_anew_when_something_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []
    monkeypatch.setattr("deformnb.widgets.view.live_view.preview_png", lambda scene: made.append(scene.shows) or b"png")
    view = Recorded(ball(Grid((24, 24, 24))))
    for _ in range(3):
        assert view.preview_png() == b"png"
    assert len(made) == 1
    changes = [
        lambda: view.set_camera(zoom=2),
        lambda: view.show_deformation(bent(view)),
        lambda: setattr(view, "shows", "side_by_side"),
        lambda: setattr(view, "background", "light"),
        lambda: view.set_transfer("bone"),
        lambda: setattr(view, "projection", "mip"),
        lambda: view.show(ball(Grid((24, 24, 24)))),
    ]
    for count, change in enumerate(changes, 2):
        change()
        view.preview_png()
        view.preview_png()
        assert len(made) == count


def test_a_broken_picture_does_not_keep_the_widget_from_being_shown(monkeypatch: Any, caplog: Any) -> None:
    monkeypatch.setattr("deformnb.widgets.view.live_view.preview_png", lambda scene: 1 / 0)
    with caplog.at_level(logging.ERROR):
        assert "image/png" not in Recorded(ball())._repr_mimebundle_()
    assert "could not be drawn" in caplog.text


@pytest.mark.nightly
def test_the_background_is_the_pages_where_one_is_there() -> None:
    view = Recorded(ball())
    assert view.background == "auto"
    assert view.still((32, 24))[0, 0].max() < 60
    view.say({"type": "hello", "view": "a", "largest": 2048, "background": "light"})
    assert view.still((32, 24))[0, 0].min() > 200
    view.say({"type": "hello", "view": "a", "largest": 2048, "background": "pink"})
    assert view.still((32, 24))[0, 0].min() > 200
    view.background = "dark"
    assert view.still((32, 24))[0, 0].max() < 60


# -- the camera ------------------------------------------------------------------------------------------------------


def test_two_views_are_turned_together() -> None:
    one, two = Recorded(ball()), Recorded(ball(Grid((8, 9, 7))))
    link = traitlets.link((one, "camera"), (two, "camera"))
    seen: list[Any] = []
    two.observe(lambda change: seen.append(change["new"]["direction"]), "camera")
    one.set_camera((0, 1, 0), zoom=2)
    assert two.camera == one.camera
    two.set_state({"camera": {**two.camera, "direction": [1.0, 0, 0], "pan": [3, 4.5]}})  # as a front end sends it
    assert one.camera["direction"] == [1.0, 0.0, 0.0]
    assert one.camera["pan"] == [3.0, 4.5]
    assert seen == [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]
    link.unlink()


def test_a_camera_is_completed_and_checked() -> None:
    assert checked_camera({}) == HOME
    assert checked_camera({"direction": (0, 0, 2)})["up"] == [0.0, -1.0, 0.0]  # not parallel to the direction
    view = Recorded(ball())
    before = view.camera
    for wrong in (
        {"direction": [0, 0, 0]},
        {"direction": "abc"},
        {"up": [1, 2]},
        {"zoom": float("inf")},
        {"zoom": -1},
        {"pan": [0, None]},
        {"direction": [0, 1, 0], "up": [0, 2, 0]},
        {"speed": 3},
        [1, 2],
        None,
    ):
        with pytest.raises(DeformError):
            view.camera = wrong
    assert view.camera == before


def test_a_page_decides_on_little(caplog: pytest.LogCaptureFixture) -> None:
    view = Recorded(ball())
    info, camera = view.volume_info, view.camera
    with caplog.at_level(logging.WARNING):
        view.set_state({"volume_info": {}, "table": b"", "camera": {"zoom": "x"}, "shows": 3, "no": 1})
        view.set_state({"projection": "mip"})
    assert (view.volume_info, view.camera, view.shows, view.projection) == (info, camera, "deformed", "mip")
    assert caplog.text.count("was dropped") == 5


# -- fields on their way ---------------------------------------------------------------------------------------------


def fields_of(view: Recorded) -> list[dict[str, Any]]:
    return [content for content, _ in view.__dict__.get("out", []) if content["type"] == "field"]


def test_the_newest_field_follows_when_the_page_has_seen_the_last() -> None:
    view = Recorded(ball())
    view.fields.pacer.patience = 60.0
    fields = [
        Deformation.from_picture_points(GRID, "+y", points(GRID, Plane.from_view(GRID, "+y"), k)) for k in range(6)
    ]
    view.show_deformation(fields[0])
    assert fields_of(view) == []  # no front end has requested it yet
    view.say({"type": "hello", "view": "a", "largest": 2048})
    view.__dict__["out"] = []
    for field in fields[1:]:
        view.show_deformation(field)
    assert [content["seq"] for content in fields_of(view)] == [1]
    assert view.fields.pacer.is_waiting
    assert view.say({"type": "seen", "view": "a", "seq": 0}) == []  # a number that was never sent
    ((content, buffers),) = view.say({"type": "seen", "view": "a", "seq": 1})
    expected = field_textures(fields[-1].field(GRID), view.source.voxels, None, 192, 64)  # type: ignore[arg-type]
    assert content["seq"] == 2
    assert buffers == expected.buffers  # the newest, and none in between
    assert view.say({"type": "seen", "view": "a", "seq": 2}) == []
    assert not view.fields.pacer.is_waiting


def test_a_page_that_confirms_nothing_gets_the_newest_field_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    sent, came = [], threading.Event()

    def send(number: int) -> None:
        sent.append(number)
        if number == 2:
            came.set()

    monkeypatch.setattr("deformnb.widgets.view.transport.time", SimpleNamespace(monotonic=lambda: 100.0))
    pacer = Pacer(send, patience=0.5)
    for _ in range(6):  # all offers come before that
        pacer.offer()
    assert came.wait(PATIENCE)
    assert sent == [1, 2]


def test_what_waits_is_not_sent_once_its_widget_is_closed() -> None:
    sent: list[int] = []
    pacer = Pacer(sent.append, patience=60.0)
    pacer.offer()
    pacer.offer()
    assert pacer.is_waiting
    pacer.close()
    assert not pacer.is_waiting
    pacer.confirm(1)
    pacer.offer()
    assert sent == [1]


def test_a_field_says_which_points_its_maps_are_of() -> None:
    view, plane = Recorded(ball()), Plane.from_view(GRID, "+y")
    given = points(GRID, plane)
    editor = Editor(None, given)
    field = Deformation.from_picture_points(GRID, plane, given).field(GRID)
    view.follow(editor, field)
    ((content, _),) = view.say({"type": "hello", "view": "a", "largest": 2048})
    assert content["follow"]["index"] == 0
    assert [p["target"] for p in content["follow"]["points"]] == given.target.tolist()
    changes: list[str] = []
    view.observe(lambda change: changes.append(change["name"]), ["editor", "editor_map"])
    view.follow(editor, field)
    assert changes == []
    view.show_deformation(field)
    ((content, _),) = view.say({"type": "hello", "view": "a", "largest": 2048})
    assert content["follow"] is None
    view.show(ball())
    assert view.editor is editor


def test_what_cannot_be_followed_changes_nothing() -> None:
    view, plane = Recorded(ball()), Plane.from_view(GRID, "+y")
    field = Deformation.from_picture_points(GRID, plane, points(GRID, plane)).field(GRID)
    view.show_deformation(field)
    with pytest.raises(DeformError, match="no map 1"):
        view.follow(Editor(), field, 1)
    assert view.fields.shown.field is field
    assert view.editor is None


# -- the arrays of volume_blocks.js ----------------------------------------------------------------------------------


def rough() -> np.ndarray:
    rng = np.random.default_rng(4)
    values = np.zeros((19, 30, 26), np.uint8)
    values[3:5, 20:22, 2:6] = rng.integers(100, 255, (2, 2, 4))
    values[12, 25, 25] = 90
    return values


@pytest.mark.parametrize(("z0", "z1"), [(2, 7), (0, 9), (0, 1), (8, 9)])
def test_gradients_are_central_differences_of_the_smoothed_volume_in_physical_units(z0: int, z1: int) -> None:
    values, spacing = rough()[:9, 15:24, :8], (1.0, 2.0, 0.5)
    values[:, 0, 0], values[8, 4, 4] = 50, 200  # at edges too
    got = run_script(
        ("webgl/volume_blocks.ts",),
        """({ values, shape, spacing, z0, z1 }) =>
        Array.from(new GradientSlabs(Uint8Array.from(values), shape, spacing, 3).slab(z0, z1))""",
        {"values": values.ravel().tolist(), "shape": list(values.shape[::-1]), "spacing": spacing, "z0": z0, "z1": z1},
    )
    rgba = np.array(got).reshape(z1 - z0, *values.shape[1:], 4)
    np.testing.assert_array_equal(rgba[..., 3], values[z0:z1])
    smooth = values.astype(float)
    for axis in range(3):
        smooth = convolve1d(smooth, np.array([1, 4, 6, 4, 1]) / 16, axis=axis, mode="nearest")
    padded = np.pad(smooth, 1, constant_values=3)
    g = (
        np.stack(
            [
                (padded[1:-1, 1:-1, 2:] - padded[1:-1, 1:-1, :-2]) / 2 * 0.5 / spacing[0],
                (padded[1:-1, 2:, 1:-1] - padded[1:-1, :-2, 1:-1]) / 2 * 0.5 / spacing[1],
                (padded[2:, 1:-1, 1:-1] - padded[:-2, 1:-1, 1:-1]) / 2 * 0.5 / spacing[2],
            ],
            axis=-1,
        )
        * 127
        / 64
    )
    g *= np.minimum(1, 127 / np.maximum(np.abs(g).max(axis=-1, keepdims=True), 1e-9))
    np.testing.assert_allclose(rgba[..., :3] - 128, g[z0:z1], atol=0.51)  # rounded to a byte


BLOCK = 4  # voxels along the edge of a block of the volume


def test_rings_of_cells_are_empty_and_no_fewer() -> None:
    rng = np.random.default_rng(6)
    filled = rng.random((7, 12, 9)) > 0.995
    rings = run_script(
        ("webgl/volume_blocks.ts", "webgl/empty_space.ts"),
        """({ values, size }) =>
        Array.from(emptyRings(Uint8Array.from(values), size))""",
        {"values": filled.ravel().astype(int).tolist(), "size": list(filled.shape[::-1])},
    )
    at = np.argwhere(filled)
    assert 0 < len(at) < 10
    for index, ring in zip(np.ndindex(*filled.shape), rings, strict=True):
        assert ring == np.abs(at - index).max(axis=1).min()


def test_extremes_of_blocks_hold_what_interpolation_mixes_in() -> None:
    values = rough()
    got = run_script(
        ("webgl/volume_blocks.ts",),
        """({ values, shape }) => {
        const { size, low, high } = blockExtremes(Uint8Array.from(values), shape);
        return { size, low: Array.from(low), high: Array.from(high) }; }""",
        {"values": values.ravel().tolist(), "shape": list(values.shape[::-1])},
    )
    counts = [-(-n // BLOCK) for n in values.shape]
    assert got["size"] == counts[::-1]
    for index in np.ndindex(*counts):
        part = values[tuple(slice(max(0, BLOCK * n - 1), BLOCK * (n + 1) + 1) for n in index)]
        assert np.reshape(got["low"], counts)[index] == part.min()
        assert np.reshape(got["high"], counts)[index] == part.max()


@pytest.mark.sampled(10)
@pytest.mark.parametrize("name", ["replicate", "modulate", "oblique", "in space", "two planes"])
@pytest.mark.parametrize("is_largest", [False, True])
@pytest.mark.parametrize("voxels", [8, 16])
def test_no_cell_is_thought_emptier_than_the_places_that_its_own_come_from(
    name: str, is_largest: bool, voxels: int
) -> None:
    grid = Grid((40, 44, 36), (1.5, 1.0, 2.0))
    plane, oblique = Plane.from_view(grid, "+y"), Plane.from_normal(grid.center, (1, 2, -0.7))
    rng = np.random.default_rng(11)
    source = grid.index_to_point(rng.uniform(6, 30, (6, 3)))
    twice = Deformation.from_picture_points(grid, plane, points(grid, plane, size=3.0))
    field = {
        "replicate": twice,
        "modulate": Deformation.from_picture_points(
            grid, plane, points(grid, plane, size=4.0), extrusion="modulate", curve="sin(pi*z)"
        ),
        "oblique": Deformation.from_picture_points(grid, oblique, points(grid, oblique, size=3.0)),
        "in space": Deformation.from_space_points(ControlPoints.from_arrays(source, source + rng.normal(0, 3, (6, 3)))),
        "two planes": twice.then(
            Deformation.from_space_points(ControlPoints.from_arrays(source, source + rng.normal(0, 3, (6, 3)))).steps[0]
        ),
    }[name].field(grid)
    values = np.zeros(grid.shape, np.uint8)
    values[8:14, 20:30, 15:22] = rng.integers(40, 255, (6, 10, 7))
    shown = packed_volume(Volume(values, grid), 10**6, 2048)
    message = field_textures(field, shown, None, 128, 48)
    buffers = {
        n: np.frombuffer(b, "<f4").tolist() for n, b in zip(message.content.buffers, message.buffers, strict=True)
    }
    got = run_script(
        ("webgl/volume_blocks.ts", "webgl/region_bits.ts", "webgl/empty_space.ts"),
        """(given) => {
        const { values, shape, spacing, box, alphas, planar, space, toMap, isLargest, voxels } = given;
        const extremes = blockExtremes(Uint8Array.from(values), shape);
        const blocks = isLargest ? extremes.high : blockOpacities(extremes, alphas);
        const cast = planar && { ...planar, maps: Float32Array.from(planar.maps), count: 1, toMap,
          weights: Float32Array.from(planar.weights) };
        const inSpace = space && { ...space, values: Float32Array.from(space.values) };
        const { size, cells } = emptyCells({ box, shape, spacing, extremes, pairs: blockPairs(blocks, extremes.size),
          beyond: 0, isLargest, voxels }, { planar: cast, space: inSpace && { ranges: new SpaceRanges(inSpace) } });
        return { size, cells: Array.from(cells) }; }""",
        {
            "values": values.ravel().tolist(),
            "shape": list(grid.shape[::-1]),
            "spacing": list(grid.spacing),
            "box": message.content.box,
            "alphas": np.where(np.arange(256) > 30, 0.1, 0.0).tolist(),
            "isLargest": is_largest,
            "voxels": voxels,
            **_maps_for_cells(message.content, buffers),
        },
    )
    cells = np.reshape(got["cells"], (*got["size"][::-1], 2))
    at = rng.uniform(-0.5, np.array(grid.shape[::-1]) - 0.5, (30_000, 3))
    places = grid.index_to_point(at)
    origin = grid.point_to_index(places + field(places))
    inside = ((origin > -0.5) & (origin < np.array(grid.shape[::-1]) - 0.5)).all(axis=1)
    seen = np.where(inside, map_coordinates(values.astype(float), origin[:, ::-1].T, order=1, mode="nearest"), 0.0)
    own = cells[tuple(((at + 0.5) // voxels).astype(int)[:, ::-1].T)]
    if is_largest:
        assert (own[:, 1] >= seen - 1e-3).all()
    else:
        assert (own[seen > 32] == [0, -(-255 * 0.1 // 0.25)]).all()
        assert ((own[:, 0] == 0) == (own[:, 1] > 0)).all()
    # Not so careful that nothing is skipped: cells are some five times as wide as the tissue's share of them.
    assert (0.4 if voxels == 8 else 0.1) < (cells[..., 0] > 0).mean() < 1


def _maps_for_cells(content: Any, buffers: dict[str, list[float]]) -> dict[str, Any]:
    """The fields of a message as the ray caster's own preparations leave them, as far as cells need them."""
    planar, space, to_map = content.planar, content.space, None
    if planar:
        knots, (rows, columns) = len(buffers["weights"]), planar["shape"][1:]
        (a, b), (first, last) = planar["spacing"], planar["depth"]
        lengths = np.array([a * columns, b * rows, (last - first) * knots / max(1, knots - 1)])
        starts = [planar["origin"][0] - a / 2, planar["origin"][1] - b / 2, first - lengths[2] / knots / 2]
        axes = np.array([planar["plane"][n] for n in "uvn"]) / lengths[:, None]
        offset = -axes @ np.asarray(planar["plane"]["origin"]) - starts / lengths
        to_map = {"matrix": axes.T.tolist(), "offset": offset.tolist()}
        planar = {**planar, "maps": buffers["maps"], "weights": buffers["weights"]}
    return {"planar": planar, "toMap": to_map, "space": space and {**space, "values": buffers["space"]}}


@pytest.mark.parametrize("each", [1, 2, 8])
def test_a_block_is_filled_by_what_lies_between_two_bytes(each: int) -> None:
    values = np.full((8, 8, 24), 10, np.uint8)
    values[..., 16:] = 13
    alphas = np.zeros(255 * each + 1)
    alphas[12 * each - each // 2] = 0.5  # at 12, or half-way between 11 and 12 where the table has an entry there
    opacities = run_script(
        ("webgl/volume_blocks.ts",),
        """({ values, shape, alphas }) =>
        Array.from(blockOpacities(blockExtremes(Uint8Array.from(values), shape), alphas))""",
        {"values": values.ravel().tolist(), "shape": [24, 8, 8], "alphas": alphas.tolist()},
    )
    counts = np.reshape(opacities, (2, 2, 6))  # voxel 15 and 16, on both sides of the change, are in the fourth block
    assert (counts[..., :3] == 0).all()
    assert (counts[..., 3:5] == 255).all()
    assert (counts[..., 5] == 0).all()
    rgba = np.repeat(alphas, 4).tolist()
    byte = run_script(
        ("webgl/volume_blocks.ts",),
        "({ rgba, byte }) => opacityOfByte(Float32Array.from(rgba), byte)",
        {"rgba": rgba, "byte": 12},
    )
    assert byte == alphas[12 * each]


def test_the_preset_of_the_whole_volume_is_used() -> None:
    volume = ball(Grid((64, 64, 64)))
    view = Recorded(volume, limit=1000, transfer="bone")
    assert view.source.transfer == preset("bone", volume)
