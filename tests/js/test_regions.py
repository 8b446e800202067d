"""Regions, rigid parts and cuts in the browser are those of the package."""

from __future__ import annotations

import base64
import zlib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from js.test_rbf import CLOSE, as_json, scattered
from numpy.typing import NDArray
from scripts import run_script

from deformnb.errors import DeformError
from deformnb.rbf.cuts import CUT_RULES, Decoupled
from deformnb.rbf.fields import AbstractField
from deformnb.rbf.fit_settings import FitSettings
from deformnb.rbf.fitting import fit_rigid
from deformnb.rbf.interpolant import FOLDS_WARNING, POOR
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import AbstractRegion, HalfSpace, Line, Mask, Polygon
from deformnb.rbf.rigid import RigidMotion, RigidPart, carry_points
from deformnb.volume.plane import Raster

FILES = ("maths/rbf.ts", "maths/regions.ts", "maths/rigid_stages.ts", "maths/cuts.ts")
SQUARE = [(120, 90), (260, 80), (280, 230), (140, 240)]
HOOK = [(60, 300), (60, 60), (400, 40), (420, 200), (300, 220), (310, 120), (140, 140), (150, 310)]
BENT = [(240, 420), (250, 300), (180, 240), (330, 180), (260, 60)]
SHARP = [(40, 240), (400, 235), (60, 180), (500, 120)]
BLOB = (np.hypot(*np.meshgrid(np.arange(60) - 28, np.arange(40) - 19)) < 13) | (np.arange(60) > 55)
REGIONS: dict[str, AbstractRegion] = {
    "half space": HalfSpace((200, 100), (1, -2)),
    "square": Polygon(SQUARE),
    "reversed": Polygon(SQUARE[::-1]),
    "hook": Polygon(HOOK),
    "line": Line(BENT),
    "sharp line": Line(SHARP),
    "straight line": Line(BENT[:2]),
    "mask": Mask(BLOB, Raster((40, 60), (5.0, 6.0), (100.0, 70.0))),
}


def region_data(region: AbstractRegion) -> dict[str, Any]:
    if isinstance(region, Mask):
        assert isinstance(region.lattice, Raster)
        bits = base64.b64encode(zlib.compress(np.packbits(region.values).tobytes())).decode()
        return {
            "kind": "mask",
            "shape": region.lattice.shape,
            "spacing": region.lattice.spacing,
            "origin": region.lattice.origin,
            "bits": bits,
        }
    if isinstance(region, HalfSpace):
        return {"kind": "half_space", "point": region.point, "normal": region.normal}
    assert isinstance(region, Line | Polygon)
    return {"kind": region.kind, "vertices": region.vertices}


def places(n: int = 500) -> NDArray[np.float64]:
    corners = np.array([*SQUARE, *HOOK, *BENT, *SHARP], float)
    rng = np.random.default_rng(3)
    return np.concatenate([rng.uniform(-100, 600, (n, 2)), corners + rng.normal(0, 2, corners.shape)])


@pytest.mark.parametrize("name", [name for name in REGIONS if name != "mask"])
def test_distances_are_those_of_the_package(name: str) -> None:
    main = """({ data, at }) => { const region = regionOf(data); return [at.map((p) => region.distance(...p)),
      at.map(([a, b]) => region.near(a + 8, b - 6, 10)(a, b))]; }"""
    found = run_script(FILES, main, {"data": region_data(REGIONS[name]), "at": places().tolist()})
    oracle = REGIONS[name].signed_distance(places())
    assert np.abs(np.array(found) - oracle).max() < 1e-6


def test_masks_are_those_of_the_package() -> None:
    mask = REGIONS["mask"]
    found = np.array(
        run_script(
            FILES,
            "({ data, at }) => at.map((p) => regionDistance(data)(...p))",
            {"data": region_data(mask), "at": places().tolist()},
        )
    )
    oracle = mask.signed_distance(places())
    assert np.array_equal(found < 0, oracle < 0)
    near = np.abs(oracle) < 12
    assert near.sum() > 30
    assert np.abs(found - oracle)[near].max() < 5e-3  # a thousandth of a pixel
    assert np.abs(found - oracle).max() < 2  # farther away several pixels are equally near, and either may be taken


@pytest.mark.parametrize("value", [False, True])
def test_empty_and_full_masks_are_those_of_the_package(value: bool) -> None:
    raster = Raster((3, 4), (1.0, 2.0), (0.0, 0.0))
    mask = Mask(np.full(raster.shape, value), raster)
    found = run_script(
        FILES,
        "({ data, at }) => at.map((p) => regionDistance(data)(...p))",
        {"data": region_data(mask), "at": places().tolist()},
    )
    np.testing.assert_allclose(found, mask.signed_distance(places()), rtol=1e-6)


def test_masks_of_every_packing_are_read() -> None:
    rng = np.random.default_rng(0)
    noise = rng.random((300, 211)) < 0.5
    packed = np.packbits(noise).tobytes()
    dynamic = np.packbits(np.repeat(noise, 3, axis=1)[:, :211]).tobytes()
    texts = [*(zlib.compress(packed, k) for k in (0, 1, 9)), zlib.compress(dynamic, 9), zlib.compress(b"\x7f" * 9)]
    main = "(texts) => texts.map((bits) => Array.from(inflate(Uint8Array.from(atob(bits), (c) => c.charCodeAt(0)))))"
    found = run_script(FILES, main, [base64.b64encode(text).decode() for text in texts])
    assert [bytes(row) for row in found] == [zlib.decompress(text) for text in texts]


@pytest.mark.parametrize(
    ("vertices", "is_closed"),
    [
        ([(0, 0), (100, 0), (0, 50), (100, 60)], True),
        ([(0, 0), (100, 0), (100, 100), (50, -20)], False),
        ([(0, 0), (10, 0)], True),
        ([(0, 0)], False),
        ([(0, 0), (50, 0), (20, 0), (20, 30)], True),
        ([(0, 0), (100, 0), (100, 60), (40, 60), (40, 20)], False),
        (SQUARE, True),
        (HOOK, True),
        (BENT, False),
        (SHARP, False),
    ],
)
def test_what_crosses_itself_is_refused_here_and_there(vertices: list[tuple[float, float]], is_closed: bool) -> None:
    data = {"kind": "polygon" if is_closed else "line", "vertices": vertices}
    fault = run_script(FILES, "(data) => regionFault(data)", data)
    try:
        (Polygon if is_closed else Line)(vertices)  # type: ignore[arg-type]
    except DeformError:
        assert fault.endswith(".")
    else:
        assert fault == ""


def part_data(part: RigidPart) -> dict[str, Any]:
    motion = None if part.motion is None else {"matrix": part.motion.matrix, "shift": part.motion.shift}
    return {
        "region": region_data(part.region),
        "motion": motion,
        "weight": part.weight,
        "reach": part.reach,
        "name": part.name,
        "enabled": part.enabled,
    }


FIXED = RigidPart(Polygon([(10, 10), (60, 10), (60, 400), (10, 400)]), name="wall")
TURNED = RigidPart(Polygon([(400, 150), (480, 150), (480, 260), (400, 260)]), RigidMotion.turn(20, (440, 200), (5, 9)))
PARTS = {
    "none": [],
    "fixed": [FIXED],
    "off": [RigidPart(FIXED.region, enabled=False)],
    "turned": [TURNED],
    "two": [FIXED, TURNED],
    "with a reach": [RigidPart(FIXED.region, reach=15.0), TURNED],
    "as in the paper": [
        RigidPart(FIXED.region, weight="distance"),
        RigidPart(TURNED.region, TURNED.motion, "distance"),
    ],
    "ground": [RigidPart(HalfSpace((0, 400), (0, -1)))],
}


def free_points() -> ControlPoints:
    rng = np.random.default_rng(2)
    source = np.array([[120, 60], [300, 70], [150, 200], [290, 210], [320, 330], [130, 350], [30, 200], [600, 380.0]])
    return ControlPoints.from_arrays(source, source + rng.normal(0, 12, source.shape) * (source[:, :1] > 50))


@pytest.mark.parametrize("strength", [1.0, 0.4, -1.5])
@pytest.mark.parametrize("name", list(PARTS))
def test_fits_beside_rigid_parts_are_those_of_the_package(name: str, strength: float) -> None:
    points, parts = free_points(), PARTS[name]
    main = """({ points, parts, settings, at, raster }) => { const fit = rigidFit(points, parts, settings);
      return { at: at.map((p) => fieldAt(fit, ...p)), map: Array.from(fieldOnRaster(fit, raster)),
        notes: fit.notes }; }"""
    raster = {"shape": [5, 7], "spacing": [70, 80], "origin": [13, 21]}
    found = run_script(
        FILES,
        main,
        {
            "points": as_json(points),
            "parts": [part_data(p) for p in parts],
            "settings": {"strength": strength, "support": 300.0},
            "at": places(200).tolist(),
            "raster": raster,
        },
    )
    fit: AbstractField = fit_rigid(points.scaled(strength), [p.scaled(strength) for p in parts], support=300.0)
    assert np.abs(np.array(found["at"]) - fit.displacement(places(200))).max() < CLOSE
    oracle = fit.sample_on_raster(Raster((5, 7), (70.0, 80.0), (13.0, 21.0)))
    assert np.abs(np.array(found["map"]).reshape(5, 7, 2) - np.moveaxis(oracle, 0, -1)).max() < 1e-3
    assert found["notes"] == [note for note in fit.notes if note not in (FOLDS_WARNING, POOR)]  # type: ignore[attr-defined]


def test_a_point_in_a_part_that_asks_for_something_else_is_refused_alike() -> None:
    points = free_points().move(6, [44.0, 210.0])
    main = """({ points, parts }) => { const held = findConflicts(points, parts);
      try { rigidFit(points, parts); } catch (e) { return [e.message, held[0].point.id, held[0].part.name]; } }"""
    message, held, name = run_script(FILES, main, {"points": as_json(points), "parts": [part_data(FIXED)]})
    with pytest.raises(DeformError) as caught:
        fit_rigid(points, [FIXED])
    assert (message.replace('"', "'"), held, name) == (str(caught.value).replace('"', "'"), 6, "wall")


@pytest.mark.parametrize("strength", [1.0, 0.5, -0.7])
def test_the_points_that_a_part_carries_go_with_it_here_and_there(strength: float) -> None:
    bent = replace(TURNED, motion=RigidMotion.turn(75, (410, 180), (-30, 4)))
    inside = np.array([[410.0, 160], [470, 240], [440, 200]])
    points = free_points()
    for place in inside:
        points = points.add(place, TURNED.motion(place))  # type: ignore[misc]
    points = points.edit(points.ids[-1], active=False)
    main = """({ points, before, after, settings }) => { const moved = carryPoints(points, before, after);
      const fit = rigidFit(moved, [after], settings);
      return [moved.map(({ target }) => target), findConflicts(moved, [after], settings.strength).length,
        fieldAt(fit, 450, 300)]; }"""
    found, held, at = run_script(
        FILES,
        main,
        {
            "points": as_json(points),
            "before": part_data(TURNED),
            "after": part_data(bent),
            "settings": {"strength": strength, "support": 300.0},
        },
    )
    moved = carry_points(points, [TURNED], [bent])
    np.testing.assert_allclose(found, moved.target, atol=1e-9)
    assert np.linalg.norm(moved.target[8:10] - points.target[8:10], axis=1).min() > 5
    np.testing.assert_array_equal(moved.target[[*range(8), 10]], points.target[[*range(8), 10]])
    fit = FitSettings(strength=strength, support=300.0).fit(moved, [bent])
    assert held == 0
    np.testing.assert_allclose(at, fit.displacement([450.0, 300.0]), atol=1e-3)


def test_a_layered_fit_without_cuts_is_the_fit() -> None:
    points = as_json(scattered())
    main = """(points) => { const layered = layeredFit(points, {}), fit = rbfFit(points, {});
      return [placeOf(layered, 33, 44, 1), [...rbfAt(fit, 33, 44), 1, 0], layered.fits.length, layered.fit !== null];
    }"""
    found, oracle, count, is_plain = run_script(FILES, main, points)
    assert (found, count, is_plain) == (oracle, 1, True)


CUTS: dict[str, list[AbstractRegion]] = {
    "a line": [REGIONS["line"]],
    "a polygon": [REGIONS["square"]],
    "two": [REGIONS["line"], HalfSpace((0, 200), (0, 1))],
    "three": [REGIONS["line"], REGIONS["square"], REGIONS["half space"]],
    "a region without points": [Polygon([(700, 700), (720, 700), (710, 720)]), REGIONS["line"]],
}


def pulled(size: float = 25.0) -> ControlPoints:
    rng = np.random.default_rng(9)
    source = np.stack(np.meshgrid([70, 190, 330, 450], [60, 180, 320]), axis=-1).reshape(-1, 2).astype(float)
    return ControlPoints.from_arrays(source, source + rng.normal(0, size, source.shape))


@pytest.mark.parametrize("rule", list(CUT_RULES))
@pytest.mark.parametrize("with_parts", [False, True])
@pytest.mark.parametrize("name", list(CUTS))
def test_what_is_seen_beside_cuts_is_that_of_the_package(name: str, with_parts: bool, rule: str) -> None:
    parts = [RigidPart(Polygon([(10, 380), (90, 380), (90, 440), (10, 440)]))] if with_parts else []
    points, regions, at = pulled(), CUTS[name], places(1500)
    main = """({ points, settings, at }) => { const layered = layeredFit(points, settings);
      return [at.map(([a, b]) => placeOf(layered, a, b, 6).slice()), layered.fits.map(({ sides }) => sides)]; }"""
    settings = {
        "cuts": [{"region": region_data(r)} for r in regions],
        "cut_rule": rule,
        "support": 200.0,
        "parts": [part_data(p) for p in parts],
    }
    found, sides = run_script(FILES, main, {"points": as_json(points), "settings": settings, "at": at.tolist()})
    fits = FitSettings(support=200.0).fits(points, parts, regions)
    field = Decoupled(tuple(fits.values()), tuple(fits), tuple(regions), rule=rule, softness=6.0)
    assert [tuple(row) for row in sides] == list(fits)
    moves, opacity = field.displacement_and_opacity(at)
    assert 0 < opacity.mean() < 1
    is_seen = opacity > 1e-6  # elsewhere rounding chooses
    assert np.abs(np.array(found)[:, :2] - moves)[is_seen].max() < CLOSE
    assert np.abs(np.array(found)[:, 2] - opacity).max() < 1e-6
