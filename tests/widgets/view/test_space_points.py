"""Points in space over a view, without a browser: what Python makes of them, and the rays of the page."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from front_end import deliver
from scripts import run_script
from waiting import wait_for

from deformnb.document.deformation import Deformation, Step
from deformnb.rbf.extrusion import extrude, interpolate, replicate
from deformnb.rbf.fields import AbstractField, DisplacementField, compose
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import HalfSpace
from deformnb.rbf.rigid import RigidPart
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets import LiveView, SpaceEditor, VolumeView
from deformnb.widgets.messages.points import points_to_json
from deformnb.widgets.packed_volume import packed_volume
from deformnb.widgets.textures import field_textures
from deformnb.widgets.view.space_points import MOST_FITTED, QUICK_SIZE

RAYS = ("maths/camera.ts", "maths/space_camera.ts", "view/body.ts", "view/field_samples.ts")
TURNED = ((0.8, -0.6, 0.0), (0.6, 0.8, 0.0), (0.0, 0.0, 1.0))
GRID = Grid((30, 34, 38), (1.0, 1.25, 1.5), (4.0, -7.0, 11.0), TURNED)


@pytest.fixture(scope="module")
def volume() -> Volume:
    values = np.zeros(GRID.shape, np.uint8)
    values[8:22, 9:25, 10:28] = 200
    return Volume(values, GRID, "block")


@pytest.fixture
def points() -> ControlPoints:
    source = np.asarray(GRID.center) + np.array([[0, 0, 0], [8, 3, -4], [-7, -5, 6], [4, 8, 8]])
    return ControlPoints.from_arrays(source, source + np.array([[3, 0, 0], [0, 1, 0], [0, 0, 0], [0, -1, 2.0]]))


@pytest.fixture
def editor(volume: Volume, points: ControlPoints) -> Iterator[SpaceEditor]:
    made = SpaceEditor(volume, points)
    yield made
    made.close()


def open_view(volume: Volume) -> tuple[LiveView, list[dict[str, Any]]]:
    """A live view with a front end that shows everything immediately."""
    view, fields = LiveView(volume), []

    def send(content: Any, buffers: Any = None) -> None:
        if content["type"] == "field":
            fields.append(content)
            if content["seq"]:
                deliver(view, {"type": "seen", "view": "v", "seq": content["seq"]})

    view.send = send  # type: ignore[method-assign]
    deliver(view, {"type": "hello", "view": "v", "largest": 2048})
    fields.clear()
    return view, fields


def send_points(editor: SpaceEditor, points: ControlPoints, phase: str, seq: int) -> None:
    deliver(
        editor,
        {"type": "edit", "sender": "w", "seq": seq, "phase": phase, "kind": "move", "points": points_to_json(points)},
    )


def test_a_view_follows_every_movement_coarsely_and_the_end_finely(
    volume: Volume, editor: SpaceEditor, points: ControlPoints
) -> None:
    view, fields = open_view(volume)
    view.edit_points(editor)
    assert view.points_editor is editor
    assert max(fields[-1]["space"]["shape"]) == 64
    moved = points.move(0, points.target[0] + np.array([5.0, 0, 0]))
    send_points(editor, moved, "move", 1)
    assert max(fields[-1]["space"]["shape"]) == QUICK_SIZE
    x = points.target
    np.testing.assert_allclose(view.fields.shown.field.displacement(x), fit_rbf(moved).displacement(x), atol=1e-12)
    send_points(editor, moved, "end", 2)
    assert max(fields[-1]["space"]["shape"]) == 64
    editor.kernel = "gaussian"
    np.testing.assert_allclose(
        view.fields.shown.field.displacement(x + 2), fit_rbf(moved, kernel="gaussian").displacement(x + 2), atol=1e-9
    )


def test_a_drag_that_is_given_up_ends_in_full(volume: Volume, editor: SpaceEditor, points: ControlPoints) -> None:
    view, fields = open_view(volume)
    view.edit_points(editor)
    send_points(editor, points, "move", 1)
    wait_for(lambda: max(fields[-1]["space"]["shape"]) == 64)


def test_what_cannot_be_fitted_leaves_the_last_picture(
    volume: Volume, editor: SpaceEditor, points: ControlPoints
) -> None:
    view, fields = open_view(volume)
    view.edit_points(editor)
    count, field = len(fields), view.fields.shown.field
    send_points(editor, points.move(1, points.target[0]), "move", 1)
    assert len(fields) == count
    assert view.fields.shown.field is field


def test_a_view_may_show_more_than_the_points(volume: Volume, editor: SpaceEditor, points: ControlPoints) -> None:
    first = Step((ControlPoints.from_arrays([[5.0, 5]], [[9.0, 5]]),), Plane.from_view(GRID, "+y"))
    document = Deformation((first, editor.step()))
    view, _ = open_view(volume)

    def whole(given: ControlPoints) -> AbstractField:
        return document.with_step(1, document.steps[1].with_points(given)).field(GRID)

    view.edit_points(editor, whole)
    moved = points.move(0, points.target[0] + np.array([0, 0, 4.0]))
    send_points(editor, moved, "move", 1)
    x = points.target
    np.testing.assert_allclose(view.fields.shown.field.displacement(x), whole(moved).displacement(x))


def test_an_end_of_it_ends_it(volume: Volume, editor: SpaceEditor, points: ControlPoints) -> None:
    view, fields = open_view(volume)
    view.edit_points(editor)
    view.edit_points(None)
    count = len(fields)
    send_points(editor, points.move(0, [1.0, 2.0, 3.0]), "end", 1)
    assert len(fields) == count
    assert view.points_editor is None


@pytest.mark.nightly
def test_a_view_drawn_in_python_follows_too(volume: Volume, editor: SpaceEditor, points: ControlPoints) -> None:
    view = VolumeView(volume, method="core", width=80, height=64)
    before = view.still((80, 64))
    view.edit_points(editor)
    send_points(editor, points.move(0, points.target[0] + np.array([9.0, 0, 0])), "end", 1)
    assert (view.still((80, 64)) != before).any()
    view.close()


def test_an_editor_keeps_no_view_alive(volume: Volume, editor: SpaceEditor, points: ControlPoints) -> None:
    view = LiveView(volume)
    view.edit_points(editor)
    held = weakref.ref(view)
    editor.points = points.move(0, [1.0, 2.0, 3.0])
    view.edit_points(None)
    view.close()
    del view
    gc.collect()
    assert held() is None or held().points_editor is None  # type: ignore[union-attr]


# ---- what the page makes of moving points itself ---------------------------------------------------------------------


def followed(view: LiveView, sender: str = "w") -> None:
    deliver(view, {"type": "follows", "view": "v", "sender": sender})


def test_a_page_that_fits_the_points_gets_no_field_while_they_move(
    volume: Volume, editor: SpaceEditor, points: ControlPoints
) -> None:
    view, fields = open_view(volume)
    view.edit_points(editor)
    followed(view)
    assert fields[-1]["moved"] == {"points": points_to_json(points), "shape": [28, 31, 32]}
    count, moved = len(fields), points.move(0, points.target[0] + np.array([5.0, 0, 0]))
    send_points(editor, moved, "move", 1)
    assert len(fields) == count
    send_points(editor, moved, "end", 2)
    assert fields[-1]["moved"]["points"] == points_to_json(moved)
    np.testing.assert_allclose(
        view.fields.shown.field.displacement(points.target), fit_rbf(moved).displacement(points.target), atol=1e-12
    )


def test_a_page_in_another_window_gets_every_movement(
    volume: Volume, editor: SpaceEditor, points: ControlPoints
) -> None:
    view, fields = open_view(volume)
    view.edit_points(editor)
    followed(view, "another window")
    send_points(editor, points.move(0, points.target[0] + np.array([5.0, 0, 0])), "move", 1)
    assert max(fields[-1]["space"]["shape"]) == QUICK_SIZE
    deliver(view, {"type": "bye", "view": "v"})
    assert not view.is_moved_in_client("another window")


@pytest.mark.parametrize("kind", ["part", "stages", "before", "many", "document"])
def test_what_a_page_cannot_make_python_makes(volume: Volume, points: ControlPoints, kind: str) -> None:
    part = RigidPart(HalfSpace((-500.0, 0.0, 0.0), (1.0, 0.0, 0.0)))
    before = fit_rbf(points.move(1, points.target[1] + 2.0))
    if kind == "many":
        every = GRID.index_to_point(np.random.default_rng(1).uniform(2, 28, (MOST_FITTED + 1, 3)))
        points = ControlPoints.from_arrays(every, every + 0.1)
    given: dict[str, dict[str, Any]] = {
        "part": {"options": {"parts": (part,)}},
        "stages": {"stages": 3},
        "before": {"before": before},
    }
    made = SpaceEditor(volume, points, **given.get(kind, {}))
    view, fields = open_view(volume)
    view.edit_points(made, (lambda given: compose(before, fit_rbf(given))) if kind == "document" else None)
    followed(view)
    assert fields[-1]["moved"] is None
    send_points(made, points.move(0, points.target[0] + np.array([0.5, 0, 0])), "move", 1)
    assert max(fields[-1]["space"]["shape"]) == QUICK_SIZE
    made.close()


FOLLOWED = """async ({ info, moves, fields, settings }) => {
  const traits = { uid: "e", settings, points: moves[0], seen: {}, lone_support: 9 }, shown = [], said = [];
  const editor = { get: (name) => traits[name], on() {}, off() {}, send() {} };
  const view = { info: () => info, apply: (space) => shown.push(space), move() {}, follows: (s) => said.push(s) };
  const link = new SpaceLink({}, view), bus = busOf(editor);
  await link.follow(editor);
  link.merge({ ...fields[0].space, values: [] }, fields[0].moved);
  const publish = (points, phase) => publishPoints(bus, { origin: "o", points, settings, fit: null, phase });
  publish(moves[1], "move");
  publish(moves[2], "move");
  const early = shown.length;
  link.catchUp();
  publish(moves[0], "end");
  const late = link.merge({ ...fields[0].space, values: [7] }, { ...fields[0].moved, points: moves[1] });
  return { early, sender: said[0] === bus.sender.channel.id, count: link.count, back: shown[1].values.length,
    isOwn: late.values.length > 1, space: { ...shown[0], values: Array.from(shown[0].values) } };
}"""


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"kernel": "quintic", "trend": "quadratic"},
        {"strength": 0.5},
        {"kernel": "gaussian", "trend": "rigid", "smoothing": 0.2},
    ],
)
def test_the_page_makes_the_field_of_moving_points_as_python_does(
    volume: Volume, points: ControlPoints, settings: dict[str, Any]
) -> None:
    """In a volume that is turned and has another spacing along each axis, at the same nodes."""
    made = SpaceEditor(volume, points, **settings)
    view, fields = open_view(volume)
    view.edit_points(made)
    moved = [points, *(points.move(0, points.target[0] + np.array(by)) for by in ([1.0, 0, 0], [2.0, -1.5, 3.0]))]
    state = made.get_state(["settings"])["settings"]
    result = run_script(
        ("view/follow_space.ts", "sync/bus.ts"),
        FOLLOWED,
        {
            "info": packed_volume(volume, 10**6, 2048).info(),
            "settings": state,
            "moves": [points_to_json(each) for each in moved],
            "fields": [{"space": fields[-1]["space"], "moved": fields[-1]["moved"]}],
        },
    )
    field = made.field(moved[2])
    maps = field_textures(field, packed_volume(volume, 10**6, 2048), None, 192, QUICK_SIZE)
    content, values = maps.content.space, np.frombuffer(maps.buffer("space"), "<f4")
    space = result.pop("space")
    assert space["shape"] == content["shape"]
    np.testing.assert_allclose([space["origin"], space["spacing"]], [content["origin"], content["spacing"]], rtol=1e-12)
    assert np.abs(values).max() > 0.5
    np.testing.assert_allclose(space["values"], values, atol=2e-3)  # Python sums in float32 where a voxel allows it
    # One field for two movements; Python's own where the points are again those that it is of.
    assert result == {"early": 0, "sender": True, "count": 2, "back": 0, "isOwn": True}
    made.close()


# ---- rays of the page ------------------------------------------------------------------------------------------------

CAMERA = """({ camera, bend, middle, box, places }) => {
  const made = new Camera();
  made.look(camera.direction, camera.up);
  Object.assign(made, { pan: camera.pan, height: camera.height });
  const seen = new SpaceCamera(made, bend, middle, box);
  return places.map((place) => {
    const { at, depth, scale } = seen.see(place), { start, ray } = seen.ray(at), way = seen.way(place, [7, -3]);
    const there = seen.see(place.map((x, k) => x + way[k])).at;
    return { at, depth, scale, start, ray, way, there, back: seen.toViewer(place),
      along: [0, 1, 2].map((k) => seen.wayAlong([0, 1, 2].map((i) => (i === k ? 1 : 0)), place, [7, -3])) };
  });
}"""


@pytest.mark.parametrize("bend", [0.0, 0.7])
def test_pixels_and_places_belong_together(bend: float) -> None:
    rng = np.random.default_rng(4)
    places, direction = rng.uniform(-30, 30, (6, 3)), np.array([0.3, 0.9, -0.4])
    camera = {"direction": direction.tolist(), "up": [0, 0, 1], "pan": [3, -2], "height": 80}
    box = {"left": 40, "top": 0, "width": 300, "height": 200}
    results = run_script(
        RAYS, CAMERA, {"camera": camera, "bend": bend, "middle": [1, 2, 3], "box": box, "places": places.tolist()}
    )
    ahead = direction / np.linalg.norm(direction)
    for place, r in zip(places, results, strict=True):
        start, ray = np.array(r["start"]), np.array(r["ray"])
        off = np.cross(place - start, ray)
        assert np.linalg.norm(off) < 1e-9  # the ray of its pixel goes through it
        np.testing.assert_allclose(r["there"], np.array(r["at"]) + np.array([7, -3]), atol=1e-9)
        assert abs(np.dot(r["way"], ahead)) < 1e-9  # parallel to the screen
        np.testing.assert_allclose(np.linalg.norm(r["way"]), np.hypot(7, 3) * r["scale"], rtol=1e-9)
        assert np.linalg.norm(np.cross(r["back"], ray)) < 1e-9
        assert np.dot(r["back"], ray) < 0
        for k, way in enumerate(r["along"]):
            assert np.abs(np.delete(way, k)).max() == 0
    if bend == 0:
        np.testing.assert_allclose(results[0]["scale"], 80 / 200)


def test_an_axis_that_is_seen_from_its_end_stands_still() -> None:
    camera = {"direction": [0, 1, 0], "up": [0, 0, 1], "pan": [0, 0], "height": 80}
    box = {"left": 0, "top": 0, "width": 300, "height": 200}
    (result,) = run_script(
        RAYS, CAMERA, {"camera": camera, "bend": 0, "middle": [0, 0, 0], "box": box, "places": [[1, 2, 3]]}
    )
    along = np.array(result["along"])
    np.testing.assert_allclose(along, [[7 * 0.4, 0, 0], [0, 0, 0], [0, 0, 3 * 0.4]], atol=1e-9)


BODY = """({ info, field, values, table, unit, places, rays }) => {
  const body = new Body({ values, info, field, table, unit });
  const origin = (x) => {
    const moved = field.planar ? originByPlane(field.planar, x) : x;
    return field.space ? originInSpace(field.space, moved) : moved;
  };
  return { origins: places.map((p) => origin(body.toFrame(p))), met: rays.map((ray) => body.surface(ray)) };
}"""


def page_body(volume: Volume, field: Any) -> dict[str, Any]:
    """The state of the front end of a live view."""
    shown = packed_volume(volume, 10**6, 2048)
    maps = field_textures(field, shown, None, 192, 64)
    buffers = [np.frombuffer(b, "<f4").tolist() for b in maps.buffers]
    content = {"box": maps.content.box, "planar": None, "space": None}
    if maps.content.planar:
        content["planar"] = {**maps.content.planar, "maps": buffers.pop(0), "weights": buffers.pop(0)}
    if maps.content.space:
        content["space"] = {**maps.content.space, "values": buffers.pop(0)}
    table = [[1, 1, 1, 1.0 if value > 100 else 0.0] for value in range(256)]
    return {
        "info": shown.info(),
        "field": content,
        "values": shown.volume.values.ravel().tolist(),
        "table": np.ravel(table).tolist(),
        "unit": 1.0,
    }


@pytest.mark.parametrize("kind", ["space", "replicated", "interpolated", "both"])
def test_the_page_looks_up_where_the_core_does(volume: Volume, points: ControlPoints, kind: str) -> None:
    plane = Plane.from_view(GRID, "+y")
    flat = [
        fit_rbf(ControlPoints.from_arrays([[10, 8], [30, 9], [20, 20.0]], [[10 + k, 8], [30, 9 - k], [20, 22.0]]))
        for k in (1, 3)
    ]
    in_space = fit_rbf(points)
    fields = {
        "space": in_space,
        "replicated": extrude(plane, GRID, flat[:1], replicate()),
        "interpolated": extrude(plane, GRID, flat, interpolate((0.0, 1.0))),
    }
    fields["both"] = Deformation(
        (Step((points,)), Step((ControlPoints.from_arrays([[10, 8.0]], [[13, 8.0]]),), plane)),
    ).field(GRID)
    places = GRID.index_to_point(np.random.default_rng(2).uniform(3, 26, (12, 3)))
    result = run_script(RAYS, BODY, {**page_body(volume, fields[kind]), "places": places.tolist(), "rays": []})
    turn = np.asarray(GRID.direction)
    expected = (places + fields[kind].displacement(places) - np.asarray(GRID.origin)) @ turn
    np.testing.assert_allclose(result["origins"], expected, atol=0.02)  # between samples a third of a voxel apart


def test_a_ray_meets_the_front_of_the_body_and_of_a_deformed_one(volume: Volume) -> None:
    to_y = np.asarray(GRID.direction)[:, 1]  # along the second axis of the voxels
    start = GRID.index_to_point([18, -20, 15])
    rays = [
        {"start": start.tolist(), "ray": to_y.tolist()},
        {"start": GRID.index_to_point([2, -20, 15]).tolist(), "ray": to_y.tolist()},
    ]
    still, none = run_script(RAYS, BODY, {**page_body(volume, None), "places": [], "rays": rays})["met"]
    assert none is None
    np.testing.assert_allclose(GRID.point_to_index(still), [18, 8.5, 15], atol=1.01)
    moved = DisplacementField(np.broadcast_to(-3.0 * 1.25 * to_y, (*GRID.shape, 3)).copy(), GRID)
    (there, _) = run_script(RAYS, BODY, {**page_body(volume, moved), "places": [], "rays": rays})["met"]
    np.testing.assert_allclose(np.array(there) - np.array(still), 3 * 1.25 * to_y, atol=1.3)
