"""Eqs. 7 and 8: every region has a separate fit, and the visible tissue at a cut."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import oracle
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from deformnb._jax import float64
from deformnb.errors import DeformError
from deformnb.rbf.cuts import CUT_RULES, MOST_CUTS, Cut, Decoupled, sides_of
from deformnb.rbf.extrusion import extrude, modulate
from deformnb.rbf.fields import AbstractField, Identity
from deformnb.rbf.fit_settings import FitSettings
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import AbstractRegion, HalfSpace, Line, Mask, Polygon
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.volume import Grid

MIDDLE = Line([(50, 90), (50, 10)])  # inside is a < 50
ACROSS = HalfSpace((0, 40), (0, 1))  # inside is b < 40
BENT = Line([(60, 90), (40, 50), (62, 20)])
HOLE = Polygon([(30, 30), (70, 28), (75, 66), (50, 48), (28, 70)])
DISC = np.hypot(*np.meshgrid(np.arange(50) - 22, np.arange(40) - 19)) < 13
BLOB = Mask(DISC, Raster((40, 50), (2.0, 2.5), (0.0, 0.0)))
CUTS: dict[str, tuple[AbstractRegion, ...]] = {
    "straight": (MIDDLE,),
    "bent": (BENT,),
    "polygon": (HOLE,),
    "mask": (BLOB,),
    "crossing": (MIDDLE, ACROSS),
    "three": (BENT, ACROSS, HOLE),
    "the same twice": (MIDDLE, MIDDLE),
}
SUPPORT = 60.0


def scattered(size: float = 8.0, n: int = 4) -> ControlPoints:
    rng = np.random.default_rng(9)
    source = np.stack(np.meshgrid(np.linspace(8, 92, n), np.linspace(12, 88, n)), axis=-1).reshape(-1, 2)
    return ControlPoints.from_arrays(source, source + rng.normal(0, size, source.shape))


def places(n: int = 300) -> NDArray[np.float64]:
    return np.random.default_rng(1).uniform(0, 100, (n, 2))


def fitted(
    points: ControlPoints, regions: Sequence[AbstractRegion], rule: str = "source", softness: float = 1.0
) -> Decoupled:
    fits = FitSettings(support=SUPPORT).fits(points, cuts=regions)
    return Decoupled(tuple(fits.values()), tuple(fits), tuple(regions), rule=rule, softness=softness)


def pushed(left: float, right: float, regions: Sequence[AbstractRegion] = (MIDDLE,), **options: Any) -> Decoupled:
    """Each side of the middle moved along a, as a whole; None of it bends."""
    points = ControlPoints.from_arrays([[20, 50], [80, 50]], [[20 + left, 50], [80 + right, 50]])
    return fitted(points, regions, **options)


def line_of(n: int = 100_000) -> NDArray[np.float64]:
    """The middles of n equal parts of a way across, none of them on the cut."""
    return np.stack([(np.arange(n) + 0.5) * 100 / n, np.full(n, 33.0)], axis=-1)


def width(opacity: NDArray[np.float64]) -> float:
    """Share of that path that is transparent."""
    return 100 * float(np.mean(1 - opacity))


# ---- Eq. 7 -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", CUTS)
def test_every_region_has_a_fit_of_its_own_points(name: str) -> None:
    regions, points = CUTS[name], scattered()
    fits = FitSettings(support=SUPPORT).fits(points, cuts=regions)
    found: dict[tuple[bool, ...], list[int]] = {}
    for k, x in enumerate(points.source):
        found.setdefault(tuple(bool(r.signed_distance(x) < 0) for r in regions), []).append(points.ids[k])
    assert {side: list(fit.ids) for side, fit in fits.items()} == found
    for side, ids in found.items():
        own = points.take([points.index(k) for k in ids])
        oracle.assert_close(fits[side].displacement(own.target), own.displacement, atol=1e-9)


def test_switched_off_points_make_no_region() -> None:
    points = scattered().edit(0, active=False)
    chosen = [k for k in range(len(points)) if points.active[k]]
    fits = FitSettings(support=SUPPORT).fits(points, cuts=[MIDDLE])
    assert sorted(k for fit in fits.values() for k in fit.ids) == [points.ids[k] for k in chosen]
    assert FitSettings().fits(ControlPoints.empty(2), cuts=[MIDDLE]) == {}


# ---- Eq. 8 -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [0.0, 2.0, 8.0])
@pytest.mark.parametrize("name", CUTS)
def test_the_paper_s_rule_is_the_paper_s(name: str, size: float) -> None:
    regions, points = CUTS[name], scattered(size)
    fits = FitSettings(support=SUPPORT).fits(points, cuts=regions)
    numbers = {side: k for k, side in enumerate(fits)}

    def region(x: Any) -> Any:
        side = tuple(bool(r.signed_distance(x) < 0) for r in regions)
        return numbers.get(side, str(side))

    maps = {numbers[side]: fit.displacement for side, fit in fits.items()}
    field = Decoupled(tuple(fits.values()), tuple(fits), regions, rule="paper", softness=1e-9)
    d, a = field.displacement_and_opacity(places())
    for x, found, opacity in zip(places(), d, a, strict=True):
        oracle.assert_close(found, oracle.equation_7(x, region, maps), atol=1e-12)
        assert opacity == oracle.equation_8(x, region, maps)


@pytest.mark.parametrize("size", [2.0, 8.0, 30.0])
@pytest.mark.parametrize("name", CUTS)
def test_the_source_rule_shows_what_any_region_has_brought(name: str, size: float) -> None:
    """Literally: the own region if its tissue is there, else any whose tissue is there, else nothing."""
    regions, points = CUTS[name], scattered(size)
    fits = FitSettings(support=SUPPORT).fits(points, cuts=regions)
    field = Decoupled(tuple(fits.values()), tuple(fits), regions, softness=1e-9)
    d, a = field.displacement_and_opacity(places())
    for x, found, opacity in zip(places(), d, a, strict=True):
        side = tuple(bool(r.signed_distance(x) < 0) for r in regions)
        own = fits[side].displacement(x) if side in fits else np.zeros(2)
        wanted = (
            [own]
            if tuple(bool(r.signed_distance(x + own) < 0) for r in regions) == side
            else [
                f.displacement(x)
                for s, f in fits.items()
                if tuple(bool(r.signed_distance(x + f.displacement(x)) < 0) for r in regions) == s
            ]
        )
        assert opacity == (len(wanted) > 0)
        if wanted:
            assert min(np.abs(found - w).max() for w in wanted) < 1e-12


@pytest.mark.parametrize("size", [0.0, 5.0, 30.0])
@pytest.mark.parametrize("name", CUTS)
def test_the_source_rule_shows_something_wherever_the_paper_s_does(name: str, size: float) -> None:
    paper, source = (fitted(scattered(size), CUTS[name], rule, 1e-9) for rule in ("paper", "source"))
    seen = paper.opacity(places()) == 1
    assert (source.opacity(places())[seen] == 1).all()
    oracle.assert_close(source.displacement(places())[seen], paper.displacement(places())[seen])


# ---- closed, opened, closed over -------------------------------------------------------------------------------------


@pytest.mark.parametrize("softness", [1e-3, 1.0, 7.0])
@pytest.mark.parametrize("rule", CUT_RULES)
@pytest.mark.parametrize("name", CUTS)
def test_a_cut_that_nothing_pulls_is_not_seen(name: str, rule: str, softness: float) -> None:
    """Exactly, for any shape and number of cuts, also where only some regions have points."""
    points = scattered(0.0)
    for some in (points, points.take([0, 1, 5]), points.take([10]), ControlPoints.empty(2)):
        field = fitted(some, CUTS[name], rule, softness)
        at = np.concatenate([places(), [[50, 40], [50, 33], [40, 50], [30, 30], [7, 40]]])
        d, a = field.displacement_and_opacity(at)
        assert (a == 1).all()
        assert (d == 0).all()


@pytest.mark.parametrize("rule", CUT_RULES)
@pytest.mark.parametrize(("left", "right"), [(-3.0, 3.0), (-6.0, 0.0), (0.0, 4.5)])
def test_an_opened_cut_is_a_gap_of_the_way_it_is_pulled(rule: str, left: float, right: float) -> None:
    field, at = pushed(left, right, rule=rule), line_of()
    a, x = field.opacity(at), at[:, 0]
    assert (a[(x >= 50 + left + 0.5) & (x <= 50 + right - 0.5)] == 0).all()
    assert (a[(x <= 50 + left - 0.5) | (x >= 50 + right + 0.5)] == 1).all()
    assert width(a) == pytest.approx(right - left, abs=1e-6)
    d = field.displacement(at)[:, 0]
    solid = np.abs(x - 50 - (left + right) / 2) > (right - left) / 2 + 1
    oracle.assert_close(d[solid], np.where(x < 50, -left, -right)[solid], atol=1e-9)


@pytest.mark.parametrize("rule", CUT_RULES)
def test_a_closed_cut_covers(rule: str) -> None:
    """Both sides pushed over the line: each place shows its own side, and nothing is transparent."""
    field, at = pushed(4.0, -3.0, rule=rule), line_of(10_000)
    assert (field.opacity(at) == 1).all()
    oracle.assert_close(field.displacement(at)[:, 0], np.where(at[:, 0] < 50, -4.0, 3.0), atol=1e-9)


@pytest.mark.parametrize("shift", [5.0, -2.0])
def test_moving_both_sides_together_moves_the_picture(shift: float) -> None:
    """The rule "source" is the pure shift; the paper's leaves a false gap as wide as the shift."""
    source, paper = (pushed(shift, shift, rule=rule) for rule in ("source", "paper"))
    at = line_of()
    d, a = source.displacement_and_opacity(at)
    assert (a == 1).all()
    oracle.assert_close(d, np.broadcast_to([-shift, 0.0], d.shape), atol=1e-9)
    gap = width(paper.opacity(at))
    assert gap == pytest.approx(abs(shift), abs=1.0)  # but for the pixel on the line itself
    low, high = sorted((50.0, 50 + shift))
    assert (paper.opacity(at)[(at[:, 0] > low + 0.5) & (at[:, 0] < high - 0.5)] == 0).all()


def test_four_quarters_pulled_apart_leave_a_cross() -> None:
    source = np.array([[25, 20], [75, 20], [25, 70], [75, 70.0]])
    field = fitted(ControlPoints.from_arrays(source, source + 3 * np.sign(source - [50, 40])), (MIDDLE, ACROSS))
    assert len(field.fields) == 4
    d, a = field.displacement_and_opacity(places(4000))
    dx, dy = np.abs(places(4000) - [50, 40]).T
    assert (a[(dx < 2.5) | (dy < 2.5)] == 0).all()
    solid = (dx > 3.5) & (dy > 3.5)
    assert (a[solid] == 1).all()
    oracle.assert_close(d[solid], -3 * np.sign(places(4000) - [50, 40])[solid], atol=1e-9)


def test_a_region_without_points_stays() -> None:
    points = ControlPoints.from_arrays([[20, 50]], [[14, 50]])
    for rule in CUT_RULES:
        at = [[70, 20], [51, 80], [45, 10], [30, 10], [50, 50]]
        d, a = fitted(points, (MIDDLE,), rule).displacement_and_opacity(at)
        assert d[:2].tolist() == [[0, 0], [0, 0]]
        assert a[:4].tolist() == [1, 1, 0, 1]
        oracle.assert_close(d[3], [6, 0], atol=1e-9)
    covered = fitted(ControlPoints.from_arrays([[20, 50]], [[26, 50]]), (MIDDLE,))
    d, a = covered.displacement_and_opacity([[53, 20], [70, 20], [49, 20]])
    assert (a == 1).all()
    assert d[:2].tolist() == [[0, 0], [0, 0]]  # tissue there is in front of moved tissue


def test_points_on_the_line_belong_to_the_outside() -> None:
    assert sides_of([MIDDLE], [[50.0, 20.0], [49.9, 20.0], [50.1, 7.0]]).tolist() == [[False], [True], [False]]
    fits = FitSettings().fits(ControlPoints.from_arrays([[50, 30]], [[55, 30]]), cuts=[MIDDLE])
    assert list(fits) == [(False,)]


@given(st.floats(-9, 9), st.floats(-9, 9), st.sampled_from(list(CUT_RULES)))
def test_opacity_is_a_share_whichever_way_the_cut_is_drawn(left: float, right: float, rule: str) -> None:
    one, other = pushed(left, right, rule=rule), pushed(left, right, (Line(MIDDLE.vertices[::-1]),), rule=rule)
    at = line_of(500)
    a = one.opacity(at)
    assert ((a >= 0) & (a <= 1)).all()
    oracle.assert_close(a, other.opacity(at), atol=1e-9)


# ---- the same by every method ---------------------------------------------------------------------------------


@pytest.mark.sampled(3)
@pytest.mark.parametrize("rule", CUT_RULES)
@pytest.mark.parametrize("name", ["bent", "crossing", "mask"])
def test_jax_and_rasters_say_what_points_say(name: str, rule: str) -> None:
    field = fitted(scattered(), CUTS[name], rule)
    d, a = field.displacement_and_opacity(places())
    sure = (a == 0) | (a == 1)
    with float64():
        found = np.asarray(jax.jit(lambda f, x: f(x))(field, jnp.asarray(places())))
    if rule == "source":
        sure &= a > 0
    oracle.assert_close(found[sure], d[sure], atol=1e-9)
    raster = Raster((21, 26), (3.9, 4.7), (1.3, 0.4))
    values, opacity = field.lattice_values_and_opacity(
        np.stack([np.zeros(21), raster.rows]), np.stack([raster.columns, np.zeros(26)]), 1.0
    )
    assert opacity is not None
    wanted, wanted_a = field.displacement_and_opacity(raster.points())
    oracle.assert_close(opacity, wanted_a, atol=1e-4)
    shown = wanted_a > 1e-3
    oracle.assert_close(np.moveaxis(values, 0, -1)[shown], wanted[shown], atol=1e-4)
    oracle.assert_close(field.sample_on_raster(raster), values)


def test_on_a_plane_in_space_the_cut_is_looked_up_in_the_picture() -> None:
    grid = Grid((8, 100, 100), (1.0, 1.0, 2.0), (30.0, -20.0, 7.0))
    plane = Plane.from_view(grid, "+z")
    flat = pushed(-4.0, 4.0)
    fields = tuple(extrude(plane, grid, [f], modulate("z")) for f in flat.fields)
    space = Decoupled(fields, flat.sides, flat.regions, plane, softness=1.0)
    assert (space.dim, space.has_cuts) == (3, True)
    z0, z1 = plane.depth_range(grid)
    for zeta in (0.0, 0.5, 1.0):
        depth = z0 + zeta * (z1 - z0)
        at = plane.origin + np.c_[line_of(10_000), np.full(10_000, depth)] @ plane.frame
        assert width(space.opacity(at)) == pytest.approx(8 * zeta, abs=1e-3)


def test_cuts_in_space() -> None:
    points = ControlPoints.from_arrays([[1, 2, 3], [1, 2, -3]], [[1, 2, 5], [1, 2, -4]])
    fits = FitSettings().fits(points, cuts=[HalfSpace((0, 0, 0), (0, 0, 1))])
    field = Decoupled(tuple(fits.values()), tuple(fits), (HalfSpace((0, 0, 0), (0, 0, 1)),), softness=0.1)
    d, a = field.displacement_and_opacity([[9, 9, 2.5], [9, 9, 1.5], [0, 0, -0.5], [0, 0, -2.0]])
    assert a.tolist() == [1, 0, 0, 1]
    oracle.assert_close(d[[0, 3]], [[0, 0, -2], [0, 0, 1]], atol=1e-9)


# ---- errors -------------------------------------------------------------------------------------------------


def still(n: int = 1) -> tuple[AbstractField, ...]:
    return (Identity(2),) * n


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Decoupled(still(), ((True,),), (MIDDLE,), rule="both"), "unknown rule 'both' of cuts"),
        (lambda: Decoupled((), (), ()), "one to 8 cuts"),
        (lambda: Decoupled((), (), (MIDDLE,) * (MOST_CUTS + 1)), "got 9"),
        (lambda: Decoupled(still(2), ((True,),), (MIDDLE,)), "its region"),
        (lambda: Decoupled(still(), ((True, False),), (MIDDLE,)), "a side of every cut"),
        (lambda: Decoupled(still(), ((True,),), (MIDDLE,), softness=0.0), "softness"),
        (lambda: Decoupled(still(), ((True,),), (MIDDLE,), softness=np.nan), "softness"),
        (lambda: Cut("line"), "a cut needs a region, got str"),  # type: ignore[arg-type]
    ],
)
def test_what_is_no_cut_is_refused(make: Any, message: str) -> None:
    with pytest.raises(DeformError, match=message):
        make()
