"""The determinants and the tissue by which the front end stops drags in space, against those of Python."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scripts import run_script

from deformnb.document.deformation import Step
from deformnb.rbf.fit_settings import FitSettings
from deformnb.rbf.points import ControlPoints
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.editor.space_editor import SpaceEditor
from deformnb.widgets.editor.space_slices import Pane, tissue_mask

SETTINGS = {"support": 30.0, "trend": "affine", "smoothing": 0, "strength": 1, "stages": 1}


def some_points(rng: np.random.Generator, pull: float) -> ControlPoints:
    source = rng.uniform(0, 40, (12, 3))
    return ControlPoints.from_arrays(source, source + rng.normal(0, pull, source.shape))


def as_json(points: ControlPoints) -> list[dict[str, Any]]:
    return [
        {"id": k, "source": s.tolist(), "target": t.tolist(), "active": True, "weight": 1}
        for k, (s, t) in enumerate(zip(points.source, points.target, strict=True))
    ]


def area(polygon: list[float]) -> float:
    """By the shoelace formula."""
    x, y = np.reshape(polygon, (-1, 2)).T
    return float(abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2)


@pytest.mark.parametrize(
    ("kernel", "trend"), [("wendland_c2", "affine"), ("gaussian", "none"), ("wendland_c4", "quadratic")]
)
def test_determinants_are_those_of_python(kernel: str, trend: str) -> None:
    rng = np.random.default_rng(3)
    points, places = some_points(rng, 2.0), rng.uniform(-5, 45, (50, 3))
    settings = {**SETTINGS, "kernel": kernel, "trend": trend}
    field = FitSettings(kernel=kernel, support=30.0, trend=trend).fit(points)
    main = """({ points, places, settings }) => {
      const fit = rbfFit(points, settings, 3);
      return places.map((place) => detInSpace(fit, place));
    }"""
    data = {"points": as_json(points), "places": places.tolist(), "settings": settings}
    found = run_script(("maths/space_folds.ts", "maths/rbf.ts"), main, data)
    expected = np.linalg.det(np.eye(3) + np.asarray(field.jacobian(places)))
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-8)


def slice_of(points: ControlPoints, settings: dict[str, Any], depth: float, main: str) -> Any:
    """Result of an expression of a ``SliceMap`` of points, on a raster of a coronal slice of a turned volume."""
    grid = Grid((20, 30, 40), (1.5, 1.2, 1.0), (-5.0, 45.0, -3.0), ((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    pane = Pane.of(grid, "+y")
    a0, a1, b0, b1, *_ = pane.box
    raster = {"shape": [61, 81], "origin": [a0, b0], "spacing": [(a1 - a0) / 80, (b1 - b0) / 60]}
    script = f"""({{ points, settings, pane, depth, raster }}) => {{
      const slice = new SliceMap(spaceFits(points, settings), pane, depth);
      return {main};
    }}"""
    data = {"points": as_json(points), "settings": settings, "pane": pane.info(), "depth": depth, "raster": raster}
    found = run_script(("maths/space_slice.ts", "maths/space_stages.ts"), script, data)

    def place(ab: Any) -> Any:
        return pane.plane.from_plane(np.column_stack([np.reshape(ab, (-1, 2)), np.full(np.size(ab) // 2, depth)]))

    return found, place, pane


def test_the_outline_of_a_fold_on_a_slice_is_where_the_determinant_is_zero() -> None:
    points = some_points(np.random.default_rng(3), 9.0)
    settings = {**SETTINGS, "kernel": "wendland_c2"}
    pieces, place, pane = slice_of(points, settings, 6.3, "slice.folds(raster, 1e7)")
    field = FitSettings(kernel="wendland_c2", support=30.0, trend="affine").fit(points)

    def det(ab: Any) -> Any:
        return np.linalg.det(np.eye(3) + np.asarray(field.jacobian(place(ab))))

    ends = np.reshape(pieces["edge"], (-1, 2))
    a0, a1, b0, b1, *_ = pane.box
    inside = (np.abs(ends - [a0, b0]).min(axis=1) > 1e-6) & (np.abs(ends - [a1, b1]).min(axis=1) > 1e-6)
    assert inside.sum() > 40
    assert np.abs(det(ends[inside])).max() < 0.02  # linear in a quarter of a cell
    a, b = np.meshgrid(np.linspace(a0, a1, 401), np.linspace(b0, b1, 401))
    folded = (det(np.stack([a, b], axis=-1)) <= 0).mean() * (a1 - a0) * (b1 - b0)
    assert sum(area(piece) for piece in pieces["fill"]) == pytest.approx(folded, rel=0.03)
    calm, *_ = slice_of(points.scaled(0.02), settings, 6.3, "slice.folds(raster, 1e7)")
    assert calm is None


def test_the_grid_on_a_slice_is_the_tissue_that_was_on_its_planes() -> None:
    points = some_points(np.random.default_rng(3), 2.0)
    settings = {**SETTINGS, "kernel": "wendland_c2"}
    lines, place, pane = slice_of(points, settings, 6.3, "slice.gridLines(raster, 10)")
    field = FitSettings(kernel="wendland_c2", support=30.0, trend="affine").fit(points)
    a0, a1, b0, b1, c0, c1 = pane.box
    size = max(a1 - a0, b1 - b0, c1 - c0) / 10
    levels = [np.linspace(low, high, round((high - low) / size) + 1) for low, high in ((a0, a1), (b0, b1))]
    assert len(lines) == sum(map(len, levels))
    assert [line["isEdge"] for line in lines] == [k in (0, len(some) - 1) for some in levels for k in range(len(some))]
    for line, (axis, level) in zip(lines, [(k, x) for k in (0, 1) for x in levels[k]], strict=True):
        if not line["runs"]:
            assert line["isEdge"]  # all of that face has moved off the slice
            continue
        at = place(line["runs"])
        was = pane.plane.to_plane(at + np.asarray(field.displacement(at)))
        assert np.abs(was[:, axis] - level).max() < 0.02


def test_stages_in_space_are_those_of_python() -> None:
    points, places = some_points(np.random.default_rng(3), 6.0), np.random.default_rng(5).uniform(-5, 45, (40, 3))
    settings = {**SETTINGS, "kernel": "wendland_c2", "stages": 3, "strength": 0.8}
    main = """({ points, places, settings }) => {
      const fits = spaceFits(points, settings);
      return places.map((place) => [detOfFits(fits, place), sourceOfFits(fits, place)]);
    }"""
    data = {"points": as_json(points), "places": places.tolist(), "settings": settings}
    found = run_script(("maths/space_folds.ts", "maths/space_stages.ts"), main, data)
    field = Step((points,), None, kernel="wendland_c2", support=30.0, stages=3, strength=0.8).field(Grid((8, 8, 8)))
    expected = np.linalg.det(np.eye(3) + np.asarray(field.jacobian(places)))
    np.testing.assert_allclose([det for det, _ in found], expected, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose([at for _, at in found], places + field.displacement(places), atol=1e-5)


def test_the_mask_holds_all_tissue_and_little_else() -> None:
    rng = np.random.default_rng(4)
    turned = ((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    grid = Grid((20, 90, 150), (1.0, 1.2, 1.5), (-20.0, 10.0, 5.0), turned)
    z, y, x = np.indices(grid.shape)
    places = grid.index_to_point(np.stack([x, y, z], axis=-1).astype(float))
    far = np.linalg.norm(places - np.asarray(grid.center), axis=-1)
    volume = Volume(np.where(far < 9, 200, 0).astype(np.uint8), grid)
    asked = np.asarray(grid.center) + rng.uniform(-18, 18, (400, 3))
    main = "({ mask, places }) => { const test = tissueOfMask(mask); return places.map(test); }"
    data = {"mask": tissue_mask(volume), "places": asked.tolist()}
    found = np.array(run_script(("maths/space_folds.ts",), main, data))
    distance = np.linalg.norm(asked - np.asarray(grid.center), axis=1)
    assert found[distance < 9].all()
    assert not found[distance > 9 + 2 * 3 * 1.5 * np.sqrt(3)].any()
    assert found.sum() < len(found) / 2


def test_an_editor_says_which_maps_the_front_end_may_check() -> None:
    volume = Volume.from_array(np.pad(np.full((8, 8, 8), 200, np.uint8), 6))
    editor = SpaceEditor(volume, some_points(np.random.default_rng(5), 1.0))
    assert editor.tissue["kind"] == "mask"
    editor.before = FitSettings(support=30.0).fit(some_points(np.random.default_rng(6), 1.0))
    assert editor.tissue == {}  # all of what was deformed before counts
    editor.before = None
    assert editor.tissue["kind"] == "mask"
    shapes: dict[str, Any] = {"cuts": (), "parts": ()}
    editor.options = shapes
    assert editor.tissue["kind"] == "mask"
    editor.close()
