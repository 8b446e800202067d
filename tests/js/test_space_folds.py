"""The determinants and the tissue by which the front end stops drags in space, against those of Python."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scripts import run_script

from deformnb.rbf.fit_settings import FitSettings
from deformnb.rbf.points import ControlPoints
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.editor.space_editor import SpaceEditor
from deformnb.widgets.editor.space_slices import tissue_mask

SETTINGS = {"support": 30.0, "trend": "affine", "smoothing": 0, "strength": 1, "stages": 1}


def some_points(rng: np.random.Generator, pull: float) -> ControlPoints:
    source = rng.uniform(0, 40, (12, 3))
    return ControlPoints.from_arrays(source, source + rng.normal(0, pull, source.shape))


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
    given = [
        {"id": k, "source": s.tolist(), "target": t.tolist(), "active": True, "weight": 1}
        for k, (s, t) in enumerate(zip(points.source, points.target, strict=True))
    ]
    data = {"points": given, "places": places.tolist(), "settings": settings}
    found = run_script(("maths/space_folds.ts", "maths/rbf.ts"), main, data)
    expected = np.linalg.det(np.eye(3) + np.asarray(field.jacobian(places)))
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-8)


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
