"""Rays that skip empty space: the picture stays the same to the last bit, whatever else the shader does."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from widgets.vtk.test_scene import GRID, cut_step, deformation, shape_without_symmetry

from deformnb.document.deformation import Deformation
from deformnb.widgets.vtk import shader as vtk_warp
from deformnb.widgets.vtk.scene import VtkScene
from deformnb.widgets.vtk.shader import SKIP_EMPTY

pytestmark = pytest.mark.needs_gl

SHOWN: dict[str, Any] = {
    "nothing": None,
    "one map": deformation("replicate", GRID),
    "three maps": deformation("interpolate", GRID),
    "in space": deformation("in space", GRID),
    "a cut": Deformation((cut_step(GRID, 6.0),)),
    "a cut of the paper": Deformation((cut_step(GRID, 6.0, "paper"),)),
}


def pictures(shown: Any, **options: Any) -> list[Any]:
    scene = VtkScene(shape_without_symmetry(), (120, 90), transfer="surface", method="texture", **options)
    try:
        scene.set_field(shown)
        small = scene.render(scale=0.5, coarseness=2.0)
        scene.set_camera({"direction": (0.2, 1.0, -0.4), "zoom": 2.5, "perspective": True})
        return [small, scene.render(bands=3)]
    finally:
        scene.close()


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", SHOWN)
def test_the_picture_is_the_same_to_the_last_bit(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    quick = pictures(SHOWN[name])
    monkeypatch.setattr(vtk_warp, "SKIP_EMPTY", "")
    monkeypatch.setattr(vtk_warp, "REPLACED_FOR_EMPTY", {})
    for ours, theirs in zip(quick, pictures(SHOWN[name]), strict=True):
        assert theirs.max() > 100
        np.testing.assert_array_equal(ours, theirs)


def test_what_is_behind_the_loop_is_executed_where_something_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """The red of a picture counts how often a ray comes behind the loop; without it that is once for every sample."""
    picture = pictures(SHOWN["one map"])[0]
    monkeypatch.setattr(vtk_warp, "REPLACED_FOR_EMPTY", {})
    counts = []
    for skip in (SKIP_EMPTY, ""):
        monkeypatch.setattr(vtk_warp, "SKIP_EMPTY", f"{skip} g_fragColor.r += 1.0 / 255.0; ")
        counted = pictures(SHOWN["one map"])[0][..., 0]
        counts.append(float((counted - picture[..., 0].astype(float)).mean()))
    assert 0 < counts[0] < 0.5 * counts[1]


@pytest.mark.parametrize(("projection", "is_there"), [("shaded", True), ("composite", False), ("mip", False)])
def test_only_slopes_are_worth_it(projection: str, is_there: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = pictures(None, projection=projection)[0]
    monkeypatch.setattr(vtk_warp, "SKIP_EMPTY", "break; ")
    assert (pictures(None, projection=projection)[0] == plain).all() == (not is_there)
