"""Textures of cuts equal the core's displacements, region by region, in Python and in the front end. No browser."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scripts import run_script

from deformnb.document.deformation import Deformation, Step
from deformnb.document.json_regions import cut_to_data
from deformnb.rbf.cuts import OPAQUE, Cut, Decoupled
from deformnb.rbf.extrusion import Extrusion
from deformnb.rbf.fields import AbstractField, Composed
from deformnb.rbf.fit_settings import FitSettings
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import HalfSpace, Line, Polygon
from deformnb.rbf.rigid import RigidPart
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.packed_volume import PackedVolume, packed_volume
from deformnb.widgets.textures import (
    MOST_MAPS,
    FieldTextures,
    count_maps,
    cut_chain,
    cut_plane,
    cut_raster,
    differ_in_one_map,
    field_textures,
    space_layers,
    with_still_regions,
)
from deformnb.widgets.view.base import PlanarFit, Refit, with_map

GRID = Grid((12, 20, 30), (1.5, 1.0, 1.2), (5.0, -7.0, 30.0))
PLANE = Plane.from_view(GRID, "+y")
A, B = PLANE.to_plane(GRID.center)[:2]
CUT = Cut(Line(((A - 1.0, B - 5.0), (A + 1.0, B + 5.0))))
BESIDE = Cut(Polygon(((A + 6, B - 4), (A + 12, B - 4), (A + 12, B + 4), (A + 6, B + 4))))
POINTS = ControlPoints.from_arrays(
    [[A - 9, B], [A - 5, B + 2], [A + 4, B - 6]], [[A - 12, B], [A - 7, B], [A + 5, B - 6]]
)


def packed() -> PackedVolume:
    return packed_volume(Volume(np.zeros(GRID.shape, np.uint8), GRID), 10**6, 2048, window=(0.0, 1.0))


def step(**options: Any) -> Step:
    return Step(**{"maps": (POINTS,), "plane": PLANE, "trend": "translation", "cuts": (CUT,), **options})


def textures_of(field: AbstractField) -> FieldTextures:
    return field_textures(field, packed(), None, 64, 16)


def node_places(content: dict[str, Any], shape: list[int]) -> np.ndarray:
    b, a = np.meshgrid(
        *(content["origin"][k] + content["spacing"][k] * np.arange(shape[-1 - k]) for k in (1, 0)), indexing="ij"
    )
    return np.stack([a, b], axis=-1)


def test_every_region_has_its_maps_and_one_without_points_stays() -> None:
    field = step(cuts=(CUT, BESIDE)).field(GRID)
    assert isinstance(field, Decoupled)
    maps = textures_of(field)
    planar = maps.content.planar
    # Left of the line, right of it, and the box on the right; its fourth combination is nowhere in the picture.
    assert planar["cut"]["sides"] == [[False, False], [True, False], [True, True]]
    layers = np.frombuffer(maps.buffer("maps"), "<f4").reshape(planar["shape"] + [2])
    nodes = node_places(planar, planar["shape"])
    for side, layer in zip(planar["cut"]["sides"], layers, strict=True):
        moved = dict(zip(field.sides, field.fields, strict=True)).get(tuple(side))
        wanted = 0.0 if moved is None else moved.maps[0].displacement(nodes)
        np.testing.assert_allclose(layer, np.broadcast_to(wanted, layer.shape), atol=1e-4)


def test_distances_are_those_of_the_cuts_around_the_whole_picture() -> None:
    maps = textures_of(step(cuts=(CUT, BESIDE), cut_rule="paper").field(GRID))
    cut = maps.content.planar["cut"]
    far = np.frombuffer(maps.buffer("distances"), "<f4").reshape(cut["shape"])
    nodes = node_places(cut, cut["shape"])
    for layer, one in zip(far, (CUT, BESIDE), strict=True):
        np.testing.assert_allclose(layer, one.region.signed_distance(nodes), atol=1e-4)
    box = PLANE.to_plane(GRID.corners())[:, :2]
    assert (nodes.min(axis=(0, 1)) < box.min(axis=0)).all()
    assert (nodes.max(axis=(0, 1)) > box.max(axis=0)).all()
    assert max(cut["shape"]) == 512
    assert cut["rule"] == "paper"
    assert maps.content.planar["softness"] == step(cuts=(CUT, BESIDE)).field(GRID).softness  # type: ignore[attr-defined]


def test_distances_keep_their_name_while_only_points_move() -> None:
    first = textures_of(step().field(GRID))
    moved = textures_of(replace(step(), maps=(POINTS.move(0, [A - 15, B]),)).field(GRID))
    other = textures_of(step(cuts=(BESIDE,)).field(GRID))
    names = [m.content.planar["cut"]["id"] for m in (first, moved, other)]
    assert names[0] == names[1] != names[2]
    less = first.without("distances")
    assert less.content.buffers == ["maps", "weights"]
    assert less.size < first.size / 2
    assert less.buffer("maps") == first.buffer("maps")


def test_keys_of_interpolation_are_cut_each() -> None:
    field = step(maps=(POINTS, POINTS.take([0])), extrusion="interpolate", knots=(0.0, 1.0)).field(GRID)
    maps = textures_of(field)
    assert count_maps(field) == 2
    assert maps.content.planar["shape"][0] == 4
    assert len(maps.buffer("weights")) == 2 * 1025 * 4
    layers = np.abs(np.frombuffer(maps.buffer("maps"), "<f4").reshape(2, 2, -1)).max(axis=2) > 0.1
    moves = dict(zip(map(tuple, maps.content.planar["cut"]["sides"]), layers.tolist(), strict=True))
    assert sorted(moves.values()) == [[True, False], [True, True]]  # the second key has a point on one side only


def test_what_is_no_cut_extrusion_is_sampled_in_space() -> None:
    in_space = Step(
        (ControlPoints.from_arrays(GRID.corners(), GRID.corners() * 1.01),),
        None,
        cuts=(Cut(HalfSpace(GRID.center, (1.0, 0.2, 0.0))),),
    )
    content = textures_of(in_space.field(GRID)).content
    assert content.planar is None
    assert content.space["cut"]["regions"] == 2
    assert not content.coarse
    assert cut_plane(in_space.field(GRID), MOST_MAPS) is None
    plane = cut_plane(step().field(GRID), MOST_MAPS)
    assert plane is not None
    assert with_still_regions(plane, GRID, 1) is None  # more regions than may be sent


def test_cuts_without_points_move_nothing() -> None:
    maps = textures_of(Decoupled((), (), (CUT.region,), PLANE))
    assert maps.content.planar["cut"]["sides"] == [[False], [True]]
    assert not np.frombuffer(maps.buffer("maps"), "<f4").any()


@pytest.mark.parametrize(
    ("rule", "stops"), [("source", (False, False)), ("paper", (False, False)), ("source", (True, True))]
)
def test_layers_in_space_choose_as_the_core_does(rule: str, stops: tuple[bool, bool]) -> None:
    """By the rule of the shader, at places between which nothing is interpolated."""
    bend = Deformation.from_picture_points(GRID, "-z", _drags("-z")).steps[0]
    before = Deformation.from_picture_points(GRID, "+x", _drags("+x")).steps[0]
    cut = replace(CUT, region=replace(CUT.region, stops=stops))
    field = Deformation((before, step(cut_rule=rule, cuts=(cut,)), bend)).field(GRID)
    chain = cut_chain(field)
    assert chain is not None
    assert chain.is_exact
    assert (len(chain.later), len(chain.earlier)) == (1, 1)
    points = np.random.default_rng(0).uniform(GRID.corners().min(axis=0), GRID.corners().max(axis=0), (4000, 3))
    layers = space_layers(chain, points)
    assert layers is not None
    soft = chain.cut.softness
    own = layers.depths[..., 0].argmax(axis=0)
    each = np.arange(len(points))
    cover = np.clip(0.5 + layers.moves[..., 3] / soft, 0, 1)
    mine = cover[own, each]
    best = np.where(mine >= 0.5, own, np.where(cover.max(axis=0) > mine, cover.argmax(axis=0), own))
    seen = np.minimum(1, cover.sum(axis=0))
    if rule == "paper":
        best, seen = own, np.minimum(1, mine / np.clip(0.5 + layers.depths[own, each, 0] / soft, 0, 1))
    d, opacity = field.displacement_and_opacity(points)
    np.testing.assert_allclose(np.where(seen > OPAQUE, 1.0, seen), opacity, atol=1e-9)
    assert 10 < (opacity < 0.5).sum() < 2000
    clear = opacity > 0.99
    np.testing.assert_allclose(layers.moves[best, each, :3][clear], d[clear], atol=1e-9)


def _drags(view: str) -> ControlPoints:
    at = Plane.from_view(GRID, view).to_plane(GRID.center)[:2]
    source = at + np.array([[-4.0, -3.0], [4.0, -2.0], [0.0, 4.0]])
    return ControlPoints.from_arrays(source, source + np.array([[1.0, 0.5], [-0.5, 1.0], [0.3, -1.0]]))


def test_several_early_cuts_are_said_to_be_rough() -> None:
    other = step(cuts=(BESIDE,))
    bend = Deformation.from_picture_points(GRID, "-z", _drags("-z")).steps[0]
    assert not textures_of(Deformation((step(), bend)).field(GRID)).content.coarse
    assert not textures_of(Deformation((step(), other)).field(GRID)).content.coarse  # the last one is sent as it is
    assert textures_of(Deformation((step(), other, bend)).field(GRID)).content.coarse


def test_a_refit_divides_the_points_by_the_editors_cuts() -> None:
    bend = Deformation.from_picture_points(GRID, "-z", _drags("-z")).steps[0]
    start = Deformation((bend, step(cuts=(), extrusion="modulate", curve="z"))).field(GRID)
    part = RigidPart(HalfSpace((A + 11.0, B), (-1.0, 0.0)))
    how = PlanarFit(FitSettings(trend="translation"), (part,), (CUT,), "paper", softness=1.25, lone=9.0)
    made = Refit(start, 0)(POINTS, how)
    assert isinstance(made, Composed)
    assert isinstance(made.then, Decoupled)
    lone = replace(step(cut_rule="paper", parts=(part,), extrusion="modulate", curve="z"), support=9.0)
    wanted = Deformation((bend, lone)).field(GRID)
    assert (made.then.rule, made.then.softness) == ("paper", 1.25)
    again = Refit(start, 0)(POINTS, replace(how, settings=replace(how.settings, support=9.0)))
    points = np.random.default_rng(1).uniform(GRID.corners().min(axis=0), GRID.corners().max(axis=0), (300, 3))
    np.testing.assert_allclose(again.displacement(points), wanted.displacement(points), atol=1e-9)
    back = Refit(made, 0)(POINTS, replace(how, cuts=()))
    assert isinstance(back, Composed)
    assert isinstance(back.then, Extrusion)
    following = Refit(start, 0)
    kinds = [type(getattr(following(POINTS, replace(how, cuts=cuts)), "then", None)) for cuts in ((), how.cuts, ())]
    assert kinds == [Extrusion, Decoupled, Extrusion]  # a cut that is drawn or removed is taken in


def test_a_map_is_replaced_in_every_region_and_others_are_left() -> None:
    two = step(maps=(POINTS, POINTS), extrusion="interpolate", knots=(0.0, 1.0)).field(GRID)
    one = step(maps=(POINTS.move(0, [A - 20, B]),)).field(GRID)
    assert isinstance(two, Decoupled)
    assert isinstance(one, Decoupled)
    flat = Decoupled(tuple(f.maps[0] for f in one.fields), one.sides, one.regions)  # type: ignore[attr-defined]
    made = with_map(two, 1, flat)
    assert isinstance(made, Decoupled)
    for old, new, other in zip(two.fields, made.fields, one.fields, strict=True):
        assert isinstance(new, Extrusion)
        assert new.maps[0] is old.maps[0]  # type: ignore[attr-defined]
        assert new.maps[1] is other.maps[0]  # type: ignore[attr-defined]
    elsewhere = Decoupled(flat.fields, flat.sides, (BESIDE.region,))
    assert with_map(two, 1, elsewhere) is two  # how the other map would be divided nobody knows here


def test_a_page_that_divides_the_map_itself_needs_nothing() -> None:
    whole, cut = step(cuts=()).field(GRID), step().field(GRID)
    assert differ_in_one_map(0, cut, step(cuts=(BESIDE,)).field(GRID))
    assert differ_in_one_map(0, whole, cut)
    keys = {"maps": (POINTS, POINTS), "extrusion": "interpolate", "knots": (0.0, 1.0)}
    assert not differ_in_one_map(0, step(**keys).field(GRID), step(**keys, cut_rule="paper").field(GRID))
    assert not differ_in_one_map(0, cut, step(plane=Plane.from_view(GRID, "-y")).field(GRID))


_FILES = (
    "maths/cuts.ts",
    "maths/regions.ts",
    "maths/rigid_stages.ts",
    "view/follow_editor.ts",
    "view/volume_loader.ts",
    "webgl/region_bits.ts",
)


@pytest.mark.parametrize("stops", [(False, False), (True, False)])
def test_the_page_builds_the_layers_that_python_sends(stops: tuple[bool, bool]) -> None:
    cut = replace(CUT, region=replace(CUT.region, stops=stops))
    maps = textures_of(step(cuts=(cut, BESIDE), support=9.0).field(GRID))
    plain = textures_of(step(cuts=(), support=9.0).field(GRID)).content.planar
    points = [
        {
            "id": int(POINTS.ids[k]),
            "source": POINTS.source[k].tolist(),
            "target": POINTS.target[k].tolist(),
            "active": True,
            "weight": 1.0,
        }
        for k in range(len(POINTS))
    ]
    settings = {
        "kernel": "wendland_c2",
        "support": 9.0,
        "trend": "translation",
        "smoothing": 0,
        "strength": 1,
        "lone_support": 9.0,
        "cuts": [cut_to_data(cut), cut_to_data(BESIDE)],
        "cut_rule": "source",
        "parts": [],
    }
    main = """({ base, points, settings, mapSize }) => {
      base.maps = new Float32Array(base.shape[0] * base.shape[1] * base.shape[2] * 2);
      const layered = layeredFit(points, settings), made = withLayers(base, layered, settings, 0);
      const again = withLayers(made, layered, settings, 0);
      const none = withLayers({ ...base, shape: [2, ...base.shape.slice(1)] }, layered, settings, 0);
      return { shape: made.shape, cut: { ...made.cut, distances: [...made.cut.distances] }, maps: [...made.maps],
        same: again.cut.distances === made.cut.distances, none }; }"""
    made = run_script(_FILES, main, {"base": plain, "points": points, "settings": settings})
    wanted = maps.content.planar
    assert made["same"]
    assert made["none"] is None  # other maps would have to be divided too
    assert made["shape"] == wanted["shape"]
    assert sorted(made["cut"]["sides"]) == sorted(wanted["cut"]["sides"])
    assert made["cut"]["shape"] == wanted["cut"]["shape"]
    np.testing.assert_allclose(made["cut"]["origin"], wanted["cut"]["origin"])
    np.testing.assert_allclose(made["cut"]["distances"], np.frombuffer(maps.buffer("distances"), "<f4"), atol=1e-4)
    layers, others = (
        np.reshape(m, (wanted["shape"][0], -1)) for m in (made["maps"], np.frombuffer(maps.buffer("maps"), "<f4"))
    )
    order = [made["cut"]["sides"].index(side) for side in wanted["cut"]["sides"]]
    np.testing.assert_allclose(layers[order], others, atol=1e-3)


def test_the_raster_of_distances_reaches_around_both_boxes() -> None:
    field = step(cuts=()).field(GRID)
    assert isinstance(field, Extrusion)
    part = GRID.crop((2, 2, 2), (3, 3, 3))
    whole, small = cut_raster(field, part, GRID), cut_raster(field, GRID, GRID)
    np.testing.assert_allclose(whole.box, small.box)
