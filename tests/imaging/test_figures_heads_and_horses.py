"""The numbers behind figure 6 of the paper, as its notebook makes them: a morphed head, a horse on fixed legs."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from oracle import assert_close
from scipy.ndimage import map_coordinates

from deformnb.warping.mesh import isosurface

NOTEBOOK = Path(__file__).resolve().parents[2] / "notebooks" / "07_heads_and_horses.ipynb"


def run_cells(size: int, *, real: bool) -> dict[str, Any]:
    """All names of the notebook after its cells, without the rendered pictures."""
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    names: dict[str, Any] = {}
    for cell in cells:
        text = "".join(cell["source"])
        if cell["cell_type"] == "code" and "pair(" not in text:
            text = text.replace("%matplotlib inline", "").replace("size = 128", f"size = {size}")
            exec(text.replace("real = False", f"real = {real}"), names)
    assert names["size"] == size
    assert names["real"] is real
    return names


@pytest.fixture(scope="module", params=["phantoms", pytest.param("real data", marks=pytest.mark.nightly)])
def figure(request: pytest.FixtureRequest, real_data: Callable[[str], Path]) -> dict[str, Any]:
    if request.param == "phantoms":
        return run_cells(64, real=False)
    folder = real_data("horse.ply").parent
    real_data("head_ct.nii.gz")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DEFORMNB_DATA", str(folder))
        return run_cells(64, real=True)


@pytest.mark.sampled(2)
def test_the_head_is_where_its_points_are(figure: dict[str, Any]) -> None:
    points, field, voxel = figure["head_points"], figure["morph"].field(figure["head"].grid), 1.0
    assert_close(points.target + field.displacement(points.target), points.source, atol=1e-3 * voxel)
    assert figure["smallest_factor"](field, figure["morphed"].grid) > 0.3


def test_the_head_has_grown_and_its_neck_has_not_moved(figure: dict[str, Any]) -> None:
    head, morphed, skin = figure["head"], figure["morphed"], figure["skin"]
    before, after = (isosurface(v, skin, inside="above").box for v in (head, morphed))
    high, long = before[1, 2] - before[0, 2], before[1, 1] - before[0, 1]
    voxel = max(head.grid.spacing)
    assert after[1, 2] - before[1, 2] == pytest.approx(0.2 * high, abs=2 * voxel)  # the point on top
    assert after[1, 1] - before[1, 1] == pytest.approx(0.14 * long, abs=0.02 * long)  # and that at the back
    field = figure["morph"].field(head.grid)
    neck = figure["head_points"].source[-12:-8]
    assert_close(field.displacement(neck), np.zeros((4, 3)), atol=1e-6)


def test_the_legs_of_the_horse_are_fixed(figure: dict[str, Any]) -> None:
    mesh, field, knees, voxel = (figure[name] for name in ("mesh", "field", "knees", "voxel"))
    legs = mesh.points[mesh.points[:, 2] < knees]
    assert len(legs) > 500
    assert np.abs(field.displacement(legs)).max() == 0
    moved = figure["direct"].points - mesh.points
    assert_close(moved[mesh.points[:, 2] < knees], 0 * legs, atol=0.1 * voxel)
    # In the volume too: below the plane each voxel is unchanged.
    horse, raised = figure["horse"], figure["raised"]
    i, j, k = np.round(raised.grid.point_to_index(horse.grid.origin)).astype(int)
    nz, ny, nx = horse.shape
    low = horse.grid.origin[2] + np.arange(nz) * voxel < knees
    assert low.sum() > 10
    there = raised.values[k : k + nz, j : j + ny, i : i + nx]
    assert_close(there[low], horse.values[low], atol=1e-3 * voxel)


def test_the_targets_are_reached_and_nothing_folds(figure: dict[str, Any]) -> None:
    points, field, voxel = figure["points"], figure["field"], figure["voxel"]
    assert_close(points.target + field.displacement(points.target), points.source, atol=1e-3 * voxel)
    assert figure["smallest_factor"](field, figure["room"], 2) > 0.05
    assert figure["raise_head"].notes(figure["horse"].grid) == ()


def test_the_displacement_is_smooth_above_the_plane(figure: dict[str, Any]) -> None:
    """On a line up through the chest: value, slope and curvature begin at 0 on the plane, without a jump anywhere."""
    field, knees, length = figure["field"], figure["knees"], figure["length"]
    low, _ = figure["mesh"].box
    z = knees + np.linspace(-0.02, 0.4, 2101) * length[2]
    x, y = low[0] + 0.5 * length[0], low[1] + 0.8 * length[1]
    d = field.displacement(np.stack([np.full_like(z, x), np.full_like(z, y), z], axis=-1))[:, 2]
    step = z[1] - z[0]
    slope, curvature = np.diff(d) / step, np.diff(d, 2) / step**2
    assert (d[z < knees] == 0).all()
    assert np.abs(d).max() > 0.05 * length[2]
    assert np.abs(np.diff(slope)).max() < 0.01
    assert np.abs(np.diff(curvature)).max() < 0.02 * np.abs(curvature).max()


def test_both_ways_end_at_the_same_surface(figure: dict[str, Any]) -> None:
    raised, direct, surface, voxel = (figure[name] for name in ("raised", "direct", "surface", "voxel"))
    assert direct.notes == ()
    assert surface.is_closed
    # The deformed distance is no distance any more, but 0 on the surface: divided by its slope it is one nearby.
    at = raised.grid.point_to_index(direct.points)
    slopes = np.gradient(raised.values, voxel)
    value, *slope = (map_coordinates(array, at.T[::-1], order=1) for array in (raised.values, *slopes))
    off = np.abs(value) / np.maximum(np.sqrt(sum(s * s for s in slope)), 0.5)
    assert np.percentile(off, 99) < 0.5 * voxel
    assert off.max() < 1.5 * voxel  # ears are thinner than a voxel
    assert surface.enclosed == pytest.approx(abs(direct.enclosed), rel=0.03)


@pytest.mark.sampled(2)
def test_the_head_of_the_horse_is_up(figure: dict[str, Any]) -> None:
    mesh, direct, length, drag = figure["mesh"], figure["direct"], figure["length"], figure["drag"]
    risen = (direct.box[1, 2] - mesh.box[1, 2]) / length[2]
    assert risen == pytest.approx(drag[0, 2], abs=0.08)
    assert direct.box[0, 2] == mesh.box[0, 2]
