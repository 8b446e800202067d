"""Nodes of the grid and strains in the page are those of the package."""

from __future__ import annotations

from typing import Any

import numpy as np
import oracle
import pytest
from js.test_rbf import as_json
from scripts import run_script

from deformnb.analysis.strain import stretches
from deformnb.document.deformation import Step
from deformnb.document.json_regions import region_to_data
from deformnb.imaging.thompson import field_of, make_grids, steps_of
from deformnb.rbf.cuts import Cut
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Line
from deformnb.volume.plane import Picture, Plane, Raster
from deformnb.volume.volume import Grid

FILES = ("maths/cuts.ts", "maths/rigid_stages.ts", "maths/warp_map.ts")
GRID = Grid((40, 8, 60))
PLANE = Plane.from_view(GRID, "+y")
CORNERS = [[0, 0], [59, 0], [0, 39], [59, 39]]
BENT = ControlPoints.from_arrays([*CORNERS, [20, 20], [40, 20]], [*CORNERS, [15, 17], [46, 23]])
CUT = Cut(Line([(29.5, 50), (29.5, -9)]))
PULL = ControlPoints.from_arrays(
    [[5, 5], [5, 30], [25, 20], [50, 5], [50, 30]], [[0, 5], [0, 30], [20, 23], [55, 5], [55, 30]]
)

SETTINGS = {
    "kernel": "wendland_c2",
    "trend": "affine",
    "smoothing": 0,
    "strength": 1,
    "support": None,
    "lone_support": 15,
    "parts": [],
    "cut_rule": "source",
    "cuts": [],
}

MAIN = """({ points, settings, box, cells }) => {
  const layered = layeredFit(points, settings), places = gridPlaces(layered, box, cells, 1e-8);
  const { stretch, angle } = strainsAt(layered, places);
  return { shape: [places.rows, places.columns], source: Array.from(places.source), target: Array.from(places.target),
    isSeen: Array.from(places.isSeen), stretch: Array.from(stretch, (s) => (Number.isNaN(s) ? null : s)),
    angle: Array.from(angle), gain: strainGain({ stretch }) };
}"""


def compute_in_page(points: ControlPoints, cells: int, cuts: list[Cut]) -> dict[str, Any]:
    chosen = Step((points,), PLANE).chosen_support
    assert chosen is not None
    regions = [{"name": "", "enabled": True, "region": region_to_data(c.region)} for c in cuts]
    settings = {**SETTINGS, "chosen_support": chosen.radius, "cuts": regions}
    found = run_script(
        FILES, MAIN, {"points": as_json(points), "settings": settings, "box": [-0.5, 59.5, -0.5, 39.5], "cells": cells}
    )
    return {name: np.array(value, dtype=float) for name, value in found.items()}


@pytest.mark.parametrize(("points", "cuts"), [(BENT, []), (PULL, [CUT])], ids=["whole", "cut"])
def test_nodes_and_strains_are_those_of_the_package(points: ControlPoints, cuts: list[Cut]) -> None:
    raster = Raster((40, 60), (1.0, 1.0), (0.0, 0.0))
    picture = Picture(np.zeros((40, 60), np.uint8), PLANE, raster, "mip", (0.0, 1.0))
    step = Step((points,), PLANE, cuts=tuple(cuts))
    field = field_of(step, steps_of(step, picture, 1.0), picture, 1.0, GRID, 0)
    grids = make_grids(field, picture, 6)
    page = compute_in_page(points, 6, cuts)
    assert page["shape"].astype(int).tolist() == [5, 7]
    oracle.assert_close(page["source"].reshape(5, 7, 2), grids.nodes, atol=1e-9)
    assert page["isSeen"].all()
    oracle.assert_close(page["target"].reshape(5, 7, 2), grids.moved, atol=1e-4)
    away = np.abs(grids.nodes[..., 0] - 29.5) > 1 if cuts else np.ones((5, 7), dtype=bool)  # beside a cut J jumps
    strain = stretches(field, grids.moved)
    oracle.assert_close(page["stretch"].reshape(5, 7, 2)[away], strain.principal[away], atol=1e-4)
    first = np.stack([np.cos(page["angle"]), np.sin(page["angle"])], axis=-1).reshape(5, 7, 2)
    clear = away & (strain.principal[..., 0] - strain.principal[..., 1] > 0.01)
    along = np.abs((first * strain.directions[..., 0, :]).sum(axis=-1))
    oracle.assert_close(along[clear], np.ones(int(clear.sum())), atol=1e-3)
    assert clear.sum() > 10


def test_arms_are_nearly_a_cell_long_by_a_plain_factor() -> None:
    page = compute_in_page(BENT, 6, [])
    strains = np.sort(np.abs(page["stretch"] - 1))
    longest = strains[int(0.95 * (len(strains) - 1))]
    assert page["gain"] * longest <= 0.9
    assert page["gain"] * longest > 0.9 / 2.5
    assert page["gain"] in (0.1, 0.2, 0.5, 1, 2, 5, 10)


def test_where_the_map_folds_and_where_nothing_is_seen_there_is_no_strain() -> None:
    crossing = ControlPoints.from_arrays([*CORNERS, [25, 20], [35, 20]], [*CORNERS, [40, 20], [20, 20]])
    main = """({ points, settings }) => { const places = [30, 20, 5, 5, 5, 5];
      return Array.from(strainsAt(layeredFit(points, settings), { source: places, target: places, isSeen: [1, 1, 0] })
        .stretch, (s) => (Number.isNaN(s) ? null : s)); }"""
    stretch = run_script(FILES, main, {"points": as_json(crossing), "settings": SETTINGS})
    assert [s is None for s in stretch] == [True, True, False, False, True, True]
