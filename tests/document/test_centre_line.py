"""Straightening along a centre line: a bar bent along a known arc becomes the bar again."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scripts import run_script

import deformnb as dn
from deformnb.document.centre_line import straighten, straightened_places
from deformnb.document.deformation import Step
from deformnb.document.edits import initial_step
from deformnb.document.step_checks import step_folds
from deformnb.errors import DeformError
from deformnb.rbf.cuts import Cut
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Line
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume

GRID = Grid((4, 120, 200))
PLANE = Plane.from_view(GRID, "+z")
LENGTH, HALF = 120.0, 9.0


def arc(angle: float, middle: Any = (100.0, 45.0), count: int = 200) -> np.ndarray:
    """An arc of circle of the same length for every angle, level in its middle."""
    radius = LENGTH / angle
    at = angle * np.linspace(-0.5, 0.5, count)
    return np.asarray(middle) + radius * np.stack([np.sin(at), 1 - np.cos(at)], axis=1)


def bent_bar(angle: float) -> np.ndarray:
    """The bar of half width HALF around the arc, [v, u], from the literal polar coordinates of each pixel."""
    radius = LENGTH / angle
    v, u = np.mgrid[: GRID.shape[1], : GRID.shape[2]]
    x, y = u - 100.0, v - 45.0 - radius
    away, along = np.hypot(x, y) - radius, np.arctan2(x, -y)
    return (np.abs(away) <= HALF) & (np.abs(along) <= angle / 2)


def straight_bar() -> np.ndarray:
    v, u = np.mgrid[: GRID.shape[1], : GRID.shape[2]]
    return (np.abs(v - 45) <= HALF) & (np.abs(u - 100) <= LENGTH / 2)


@pytest.mark.parametrize("angle", [0.5, 1.0, 1.6, 2.2])
def test_a_bar_bent_along_an_arc_becomes_straight_again(angle: float) -> None:
    bent = np.repeat(bent_bar(angle)[None], GRID.shape[0], axis=0)
    step = straighten(initial_step(PLANE, GRID), arc(angle), HALF)
    volume = Volume(bent.astype(np.uint8) * 200, GRID)
    found = dn.warp(volume, step.field(GRID)).values[1] > 100
    expected = straight_bar()
    assert (found != expected).sum() <= 0.08 * expected.sum()  # two thirds of a pixel along the outline
    widths = found[:, 50:151].sum(axis=0)
    assert np.abs(widths - (2 * HALF + 1)).max() <= 2  # widths stay
    tissue = found[None].repeat(GRID.shape[0], axis=0)

    def is_tissue(x: np.ndarray) -> np.ndarray:
        i, j, k = np.clip(np.rint(x).astype(int), 0, np.array(GRID.shape[::-1]) - 1).T
        return np.asarray(bent[k, j, i])

    assert tissue.any()
    assert step_folds(step, GRID, None, is_tissue).least > 0.1


def test_a_straight_line_moves_nothing() -> None:
    places, targets = straightened_places([[10, 20], [60, 40], [110, 60]], 8.0)
    assert targets == pytest.approx(places, abs=1e-9)


def test_the_targets_are_straight_and_as_long() -> None:
    _, targets = straightened_places(arc(2.0), HALF)
    middle = targets[1::3]
    assert np.ptp(middle[:, 1]) < 1e-6
    assert np.ptp(middle[:, 0]) == pytest.approx(LENGTH, rel=5e-3)


def s_curve(count: int = 200) -> np.ndarray:
    """A whole period of a sine across the middle of the picture, slanted in its middle and level between its ends."""
    at = np.linspace(0, 1, count)
    return np.stack([40 + 120 * at, 60 + 22 * np.sin(2 * np.pi * at)], axis=1)


def test_an_s_lies_in_the_direction_of_its_ends() -> None:
    _, targets = straightened_places(s_curve(), HALF)
    assert np.ptp(targets[1::3, 1]) < 1e-6
    assert targets[13] == pytest.approx([100, 60], abs=0.1)


def test_a_nearly_closed_line_takes_the_direction_of_its_middle() -> None:
    _, targets = straightened_places(arc(6.0), HALF)  # its ends are 3 % of the line from each other
    assert np.ptp(targets[1::3, 1]) < 1e-6


def test_points_in_the_way_of_the_straight_line_go() -> None:
    start = initial_step(PLANE, GRID)
    held = start.with_points(start.points.add([23, 60], [23, 60], name="end").add([23, 20], [23, 20], name="away"))
    step = straighten(held, s_curve(), HALF)
    assert "away" in step.points.names
    assert "end" not in step.points.names
    assert step_folds(step, GRID, None).least > 0


def test_a_jittery_stroke_gives_nearly_the_same() -> None:
    rng = np.random.default_rng(1)
    drawn = arc(1.5, count=150)
    _, steady = straightened_places(drawn, HALF)
    _, shaky = straightened_places(drawn + rng.normal(0, 0.6, drawn.shape), HALF)
    assert np.linalg.norm(shaky - steady, axis=1).max() < 6


def test_the_inner_side_ends_before_the_centre_of_curvature() -> None:
    places, _ = straightened_places(arc(2.4, count=400), 200.0)  # wider than the radius of 50
    inner = np.linalg.norm(places - [100.0, 45.0 + LENGTH / 2.4], axis=1)
    assert inner.min() > 5


@pytest.mark.parametrize("line", [arc(0.7, count=37), arc(2.0, count=37), arc(6.0, count=90), s_curve(50)])
def test_the_front_end_makes_the_same_points(line: np.ndarray) -> None:
    found = run_script(
        ("maths/centre_line.ts",),
        "({ line, width }) => straightenedPlaces(line, width)",
        {"line": line.tolist(), "width": HALF},
    )
    places, targets = straightened_places(line, HALF)
    assert np.array([pair["from"] for pair in found]) == pytest.approx(places, abs=0.02)
    assert np.array([pair["to"] for pair in found]) == pytest.approx(targets, abs=0.05)


def test_it_follows_what_is_seen_and_replaces_free_points_along_the_line() -> None:
    start = initial_step(PLANE, GRID)
    shifted = start.with_points(start.points.add([100, 45], [100, 55]).add([100, 100], [100, 100]))
    step = straighten(shifted, arc(0.4, middle=(100.0, 55.0)), HALF)
    assert step.points.ids[:5] == (0, 1, 2, 3, 5)
    names = list(step.points.names)
    at = names.index("line 14")
    assert step.points.source[at] == pytest.approx([100, 45], abs=0.2)


@pytest.mark.parametrize(
    ("change", "line", "width", "words"),
    [
        ({}, [[0, 0]], None, "two or more"),
        ({}, [[3, 3], [3, 3]], None, "all the same"),
        ({}, [[3, 3], [9, 3]], -1.0, "positive length"),
        ({"cuts": (Cut(Line(((0.0, 0.0), (9.0, 9.0)))),)}, [[3, 3], [9, 3]], None, "without cuts"),
    ],
)
def test_what_is_no_line_is_refused(change: dict[str, Any], line: Any, width: float | None, words: str) -> None:
    with pytest.raises(DeformError, match=words):
        straighten(replace(initial_step(PLANE, GRID), **change), line, width)
    with pytest.raises(DeformError, match="on a picture"):
        straighten(Step((ControlPoints.empty(3),)), [[0, 0], [1, 1]])
