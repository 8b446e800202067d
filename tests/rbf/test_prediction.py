"""The choice of the fit that predicts best: points left out are unused, and the choice does not depend on them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import root

from deformnb.errors import Cancelled, DeformError
from deformnb.rbf.fit_settings import FitSettings
from deformnb.rbf.forward import ForwardFit
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.prediction import (
    Candidate,
    ChosenFit,
    blocks_of,
    choose_fit,
    describe_settings,
    usual_candidates,
)

Array = NDArray[np.float64]


def nodes(rows: int = 5, columns: int = 6, step: float = 20.0) -> Array:
    """Nodes of a grid, a little aside, so that no two heights are equal."""
    rng = np.random.default_rng(rows)
    grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2) * step
    return np.asarray(grid + rng.normal(0, 0.4, grid.shape))


def bent(noise: float = 0.3) -> ControlPoints:
    source = nodes()
    rng = np.random.default_rng(7)
    return ControlPoints.from_arrays(
        source, source + 6 * np.sin(source[:, ::-1] / 35) + rng.normal(0, noise, source.shape)
    )


def miss_without(points: ControlPoints, block: Array, settings: FitSettings) -> Array:
    """Squared distances of left-out targets from where a new fit brings their sources; by SciPy's root finder."""
    rest = points.take(np.setdiff1d(np.arange(len(points)), block))
    fit = settings.fit(rest)
    found = []
    for k in block:
        source, target = points.source[k], points.target[k]
        if isinstance(fit, ForwardFit):
            y = source + fit.forward.displacement(source)
        else:
            y = root(lambda y, s=source: y + fit.displacement(y) - s, target, tol=1e-12).x
        found.append(float(((y - target) ** 2).sum()))
    return np.array(found)


@pytest.mark.parametrize("direction", ["backward", "forward"])
@pytest.mark.parametrize(
    ("kernel", "trend", "smoothing"),
    [
        ("thin_plate", "affine", 0.0),
        ("cubic", "quadratic", 1e-3),
        ("linear", "affine", 1e-2),
        ("wendland_c2", "similarity", 0.0),
    ],
)
def test_errors_are_those_of_fits_without_the_points(direction: str, kernel: str, trend: str, smoothing: float) -> None:
    points = bent()
    settings = FitSettings(kernel=kernel, trend=trend, smoothing=smoothing, support=1.0, direction=direction)
    [row] = choose_fit(points, candidates=[Candidate(settings)]).tried
    parts = [[np.array([k]) for k in range(len(points))], blocks_of(points.source, 3), blocks_of(points.source, 2)]
    if trend == "similarity":  # each fit is made, of some points only
        parts[0] = [parts[0][k] for k in np.linspace(0, len(points) - 1, 24).astype(int)]
    for found, blocks in zip((row.leave_one_out, row.eighths, row.quarters), parts, strict=True):
        squares = np.concatenate([miss_without(points, block, row.settings) for block in blocks])
        assert found == pytest.approx(np.sqrt(squares.mean()), rel=1e-5)


def test_the_maps_that_made_the_points_are_found() -> None:
    source = nodes(6, 7)
    quadratic = ControlPoints.from_arrays(source, source + np.column_stack([source[:, 1] ** 2, source[:, 0] * 8]) / 300)
    for points, direction in (
        (quadratic, "forward"),
        (ControlPoints.from_arrays(quadratic.target, quadratic.source), "backward"),
    ):
        chosen = choose_fit(points)
        assert (chosen.settings.trend, chosen.settings.direction) == ("quadratic", direction)
        assert chosen.tried[0].error < 2e-7 * 182  # no error, of points that are as wide
    turned = ControlPoints.from_arrays(source, source @ [[0.9, 0.2], [-0.3, 1.1]] + 5)
    assert (
        describe_settings(choose_fit(turned).settings) == "backward, thin_plate, affine trend"
    )  # the plainest of equals


def test_noise_is_smoothed() -> None:
    source = nodes(8, 9)
    noisy = ControlPoints.from_arrays(source, source + np.random.default_rng(0).normal(0, 4, source.shape))
    assert choose_fit(noisy).settings.smoothing > 0


def test_the_table_has_every_candidate_once_with_the_best_first() -> None:
    chosen = choose_fit(bent())
    assert len(chosen.tried) == len(usual_candidates(2))
    assert len({row.settings for row in chosen.tried}) == len(chosen.tried)
    assert chosen.settings == chosen.tried[0].settings
    free = [row.score for row in chosen.tried if not row.folds and not row.why]
    assert free[1:] == sorted(free[1:])
    assert free[0] <= 1.05 * min(free)
    assert chosen.fit.displacement(bent().target).shape == (30, 2)
    shown = repr(chosen).splitlines()
    assert len(shown) == 2 + len(chosen.tried)
    assert chosen._repr_html_().count("<tr>") == 1 + len(chosen.tried)


def test_maps_that_fold_are_taken_only_if_all_do() -> None:
    points = bent()
    swapped = points.target.copy()
    swapped[[7, 9]] = swapped[[9, 7]]
    chosen = choose_fit(replace(points, target=swapped))
    plain = [row for row in chosen.tried if not row.why]
    if plain[0].folds:
        assert all(row.folds for row in plain)
        assert "every fit that was tried folds between the control points" in chosen.notes
    held = choose_fit(
        replace(points, target=swapped),
        candidates=[
            Candidate(FitSettings(kernel="thin_plate", support=1.0)),
            Candidate(FitSettings(kernel="thin_plate", support=1.0, smoothing=100.0), 50.0),
        ],
    )
    assert not held.tried[0].folds
    assert held.tried[0].score > held.tried[1].score


@pytest.mark.parametrize("angle", [17.0, 90.0, 200.0])
def test_the_choice_knows_no_axes_no_unit_and_no_order(angle: float) -> None:
    points = bent()
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    turn, scale = np.array([[c, -s], [s, c]]), 1e-3
    order = np.random.default_rng(3).permutation(len(points))
    mirror = np.diag([1.0, -1.0])
    few = [c for c in usual_candidates(2) if c.settings.smoothing == 0][:6]
    before = choose_fit(points, candidates=few)
    for matrix in (turn, turn @ mirror):
        moved = ControlPoints.from_arrays(
            scale * points.source[order] @ matrix.T + 7, scale * points.target[order] @ matrix.T + 7
        )
        after = choose_fit(moved, candidates=few)
        for a, b in zip(before.tried, after.tried, strict=True):
            assert b.settings.kernel == a.settings.kernel
            assert b.settings.direction == a.settings.direction
            assert b.settings.support == pytest.approx(scale * float(a.settings.support or 0), rel=1e-9)
            assert b.error == pytest.approx(scale * a.error, rel=1e-4)


def test_blocks_are_neighbours_of_equal_number() -> None:
    places = nodes(7, 9)
    for halvings in (1, 2, 3):
        blocks = blocks_of(places, halvings)
        assert np.array_equal(np.sort(np.concatenate(blocks)), np.arange(len(places)))
        assert {len(block) for block in blocks} <= {len(places) // 2**halvings, -(-len(places) // 2**halvings)}
        spread = np.mean([places[block].std(axis=0).prod() for block in blocks])
        assert spread < 2 * places.std(axis=0).prod() / 2**halvings


def test_several_sets_are_judged_together_and_large_ones_by_some_points() -> None:
    both = choose_fit([bent(), bent(2.0)], candidates=usual_candidates(2)[:2])
    one = choose_fit(bent(), candidates=usual_candidates(2)[:2])
    assert both.tried[0].error > one.tried[0].error
    source = np.random.default_rng(1).uniform(0, 300, (400, 2))
    many = ControlPoints.from_arrays(source, source + 5 * np.sin(source / 40))
    chosen = choose_fit(many, candidates=usual_candidates(2)[:1])
    assert chosen.notes == ("the fits are judged by 150 of 400 control points",)


def test_in_space_and_beside_points_that_are_thin() -> None:
    rng = np.random.default_rng(2)
    source = rng.uniform(0, 50, (25, 3))
    chosen = choose_fit(ControlPoints.from_arrays(source, source + 4 * np.sin(source[:, [1, 2, 0]] / 20)))
    assert isinstance(chosen, ChosenFit)
    assert np.isfinite(chosen.tried[0].score)
    row = np.column_stack([np.linspace(0, 90, 12), 0.2 * rng.normal(size=12)])
    thin = choose_fit(
        ControlPoints.from_arrays(row, row + [[0, 1]] * np.sin(row[:, :1] / 20)), candidates=usual_candidates(2)[:2]
    )
    assert np.isfinite(thin.tried[0].score)


def test_too_few_points_get_the_default_and_a_note() -> None:
    points = ControlPoints.from_arrays([[0, 0], [9, 0], [0, 9]], [[1, 0], [9, 2], [0, 9]])
    chosen = choose_fit(points)
    assert chosen.settings == FitSettings()
    assert chosen.notes == ("3 control points are too few to leave some of them out; this is the default fit",)
    assert "too few" in repr(chosen)
    with pytest.raises(DeformError, match="no active control point"):
        choose_fit(ControlPoints.empty())
    with pytest.raises(DeformError, match="candidates are a list"):
        choose_fit(bent(), candidates=["thin_plate"])  # type: ignore[list-item]
    with pytest.raises(DeformError, match="none of the 1 candidates"):
        choose_fit(bent().take(range(8)), candidates=[Candidate(FitSettings(trend="quadratic", support=1.0))])


def test_twins_do_not_give_each_other_away() -> None:
    points = bent()
    doubled = ControlPoints.from_arrays(
        np.concatenate([points.source, points.source]), np.concatenate([points.target, points.target])
    )
    few = usual_candidates(2)[:2]
    assert choose_fit(doubled, candidates=few).tried == choose_fit(points, candidates=few).tried


def test_it_can_be_stopped() -> None:
    def stop(share: float) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        choose_fit(bent(), progress=stop)


def test_a_fold_far_from_all_points_is_none_between_them() -> None:
    source = nodes(5, 7)
    parabola = ControlPoints.from_arrays(source, source + np.column_stack([source[:, 0] ** 2 / 300, 0 * source[:, 0]]))
    fit = FitSettings(kernel="cubic", trend="quadratic", direction="forward").fit(parabola)  # folds at x = -150
    assert not fit.folds_between_points()
    assert not [note for note in fit.notes if "fold" in note]
