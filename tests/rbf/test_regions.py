"""Signed distances against literal formulas, sampled boundaries and other tests of inside and outside."""

from __future__ import annotations

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import oracle
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray
from skimage.measure import points_in_poly

from deformnb._jax import float64
from deformnb.errors import DeformError
from deformnb.rbf.regions import LARGEST_SHAPE, AbstractRegion, HalfSpace, Line, Polygon

SQUARE = [(12.0, 9.0), (26.0, 8.0), (28.0, 23.0), (14.0, 24.0)]
HOOK = [(6.0, 30.0), (6.0, 6.0), (40.0, 4.0), (42.0, 20.0), (30.0, 22.0), (31.0, 12.0), (14.0, 14.0), (15.0, 31.0)]
SPIKE = [(0.0, 0.0), (60.0, 0.01), (0.0, 0.02)]
NOTCH = [(0.0, 0.0), (40.0, 0.0), (40.0, 30.0), (20.005, 30.0), (20.0, 2.0), (19.995, 30.0), (0.0, 30.0)]
STAR = [
    ((20 if k % 2 else 3) * math.cos(k * math.pi / 9), (20 if k % 2 else 3) * math.sin(k * math.pi / 9))
    for k in range(18)
]
POLYGONS = {
    "square": SQUARE,
    "hook": HOOK,
    "spike": SPIKE,
    "notch": NOTCH,
    "star": STAR,
    "straight corners": [(0.0, 0.0), (10.0, 0.0), (20.0, 0.0), (20.0, 20.0), (10.0, 20.0), (0.0, 20.0)],
}
LINES = {
    "straight": [(24.0, 42.0), (25.0, 3.0)],
    "bent": [(24.0, 42.0), (25.0, 30.0), (18.0, 24.0), (33.0, 18.0), (26.0, 6.0)],
    "sharp": [(4.0, 24.0), (40.0, 23.5), (6.0, 18.0), (50.0, 12.0)],
    "arch": [(10.0, 40.0), (10.0, 10.0), (30.0, 10.0), (30.0, 40.0)],
}
SHAPES: dict[str, AbstractRegion] = {
    **{name: Polygon(v) for name, v in POLYGONS.items()},
    **{f"{n} line": Line(v) for n, v in LINES.items()},
    **{f"{n} reversed": Polygon(v[::-1]) for n, v in POLYGONS.items()},
    "half plane": HalfSpace((3, 8), (1, -2)),
    "half space": HalfSpace((3, 8, -4), (1, -2, 7)),
}

IN_JAX = ["hook", "spike", "star reversed", "sharp line", "arch line", "half plane", "half space"]  # each is compiled


def places(dim: int = 2, n: int = 400, seed: int = 0) -> NDArray[np.float64]:
    return np.random.default_rng(seed).uniform(-25, 65, (n, dim))


def near_corners(vertices: Any, size: float = 1e-3) -> NDArray[np.float64]:
    """Places around every corner, where the sign is won or lost."""
    angles = np.linspace(0, 2 * np.pi, 16, endpoint=False) + 0.1
    ring = size * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return (np.asarray(vertices)[:, None] + ring).reshape(-1, 2)


def to_segment(p: Any, a: Any, b: Any, low: float = 0.0, high: float = 1.0) -> float:
    """The distance to the places a + t (b - a), t from low to high, literally."""
    ex, ey = b[0] - a[0], b[1] - a[1]
    t = ((p[0] - a[0]) * ex + (p[1] - a[1]) * ey) / (ex * ex + ey * ey)
    t = max(low, min(high, t))
    return math.hypot(p[0] - a[0] - t * ex, p[1] - a[1] - t * ey)


def unsigned(vertices: Any, p: Any, is_closed: bool) -> float:
    n = len(vertices)
    if is_closed:
        return min(to_segment(p, vertices[k], vertices[(k + 1) % n]) for k in range(n))
    return min(
        to_segment(p, vertices[k], vertices[k + 1], -math.inf if k == 0 else 0.0, math.inf if k == n - 2 else 1.0)
        for k in range(n - 1)
    )


def crosses_left_of(vertices: Any, p: Any) -> bool:
    """Even-odd rule, edge by edge: whether a ray to the right leaves the polygon."""
    inside = False
    for (ax, ay), (bx, by) in zip(vertices, [*vertices[1:], vertices[0]], strict=True):
        if (ay > p[1]) != (by > p[1]) and p[0] < ax + (p[1] - ay) * (bx - ax) / (by - ay):
            inside = not inside
    return inside


def closed_far_away(vertices: Any, far: float = 1e5) -> list[tuple[float, float]]:
    """A line as the polygon on its inner side: its ends lengthened and joined around the left side of the picture."""
    v = np.asarray(vertices, dtype=float)
    first, last = v[0] - v[1], v[-1] - v[-2]
    begin = v[0] + far * first / np.linalg.norm(first)
    end = v[-1] + far * last / np.linalg.norm(last)
    # With b downwards the left of (1, 0) is (0, -1): go round from the end to the begin in that direction.
    a, b = (math.atan2(*(p - v[0])[::-1]) for p in (end, begin))
    turn = (a - b) % (2 * math.pi)
    around = [
        (v[0][0] + 2 * far * math.cos(a - t * turn), v[0][1] + 2 * far * math.sin(a - t * turn))
        for t in np.linspace(0, 1, 40)
    ]
    return [tuple(begin), *map(tuple, v.tolist()), tuple(end), *around]  # type: ignore[list-item]


# ---- distances and signs ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", POLYGONS)
def test_a_polygon_is_measured_to_its_edges_and_signed_by_crossings(name: str) -> None:
    vertices = POLYGONS[name]
    at = np.concatenate([places(), near_corners(vertices), near_corners(vertices, 3.0)])
    wanted = [(-1 if crosses_left_of(vertices, p) else 1) * unsigned(vertices, p, True) for p in at]
    oracle.assert_close(Polygon(vertices).signed_distance(at), wanted, atol=1e-12)
    oracle.assert_close(Polygon(vertices[::-1]).signed_distance(at), wanted, atol=1e-12)
    assert (points_in_poly(at, vertices) == (np.array(wanted) < 0)).all()  # the oracle itself


@pytest.mark.parametrize("name", LINES)
def test_a_line_goes_on_for_ever_and_is_inside_on_the_left(name: str) -> None:
    vertices = LINES[name]
    at = np.concatenate([places(), 20 * places(), near_corners(vertices)])
    wanted = [(-1 if crosses_left_of(closed_far_away(vertices), p) else 1) * unsigned(vertices, p, False) for p in at]
    oracle.assert_close(Line(vertices).signed_distance(at), wanted, atol=1e-9)
    oracle.assert_close(Line(vertices[::-1]).signed_distance(at), np.negative(wanted), atol=1e-9)


def test_left_is_the_left_hand_on_a_picture() -> None:
    """Drawn to the right, the region above (smaller b) is inside."""
    assert Line([(0, 5), (1, 5)]).signed_distance([[7, 4], [7, 9], [-30, 5]]).tolist() == [-1.0, 4.0, 0.0]


@pytest.mark.parametrize("name", SHAPES)
def test_no_distance_grows_faster_than_the_way(name: str) -> None:
    region = SHAPES[name]
    p = np.concatenate([places(region.dim), 0.3 * places(region.dim, seed=1)])
    q = p + np.random.default_rng(2).normal(0, 1, p.shape) * np.logspace(-6, 1, len(p))[:, None]
    rise = np.abs(region.signed_distance(p) - region.signed_distance(q))
    assert (rise <= np.linalg.norm(p - q, axis=1) * (1 + 1e-9) + 1e-12).all()


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", IN_JAX)
def test_jax_says_what_numpy_says(name: str) -> None:
    region, at = SHAPES[name], places(SHAPES[name].dim)
    if isinstance(region, Polygon):
        at = np.concatenate([at, near_corners(region.vertices)])
    with float64():
        found = np.asarray(jax.jit(lambda r, x: r(x))(region, jnp.asarray(at)))
    oracle.assert_close(found, region.signed_distance(at), atol=1e-11)
    single = np.asarray(jax.jit(lambda r, x: r(x))(region, jnp.asarray(at, jnp.float32)))
    oracle.assert_close(single, region.signed_distance(np.float32(at)), atol=4e-5)
    assert region.signed_distance(at.reshape(-1, 2, region.dim)).shape == (len(at) // 2, 2)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", IN_JAX)
def test_gradients_are_finite_everywhere_and_of_length_one_off_the_boundary(name: str) -> None:
    region = SHAPES[name]
    at = places(region.dim, 60)
    on_it = np.array(region.vertices if isinstance(region, Polygon | Line) else [region.point])
    with float64():
        slope = jax.jit(jax.vmap(jax.grad(lambda x: region(x))))(jnp.asarray(np.concatenate([on_it, at])))  # noqa: PLW0108
    assert np.isfinite(slope).all()
    oracle.assert_close(np.linalg.norm(slope[len(on_it) :], axis=1), 1.0, atol=1e-9)


@pytest.mark.parametrize("offset", [(4e6, -3e6), (0.0, 0.0)])
@pytest.mark.parametrize("turned", [1, -1])
def test_a_polygon_far_from_the_origin_knows_its_inside(offset: tuple[float, float], turned: int) -> None:
    moved = Polygon((np.array(HOOK[::turned]) + offset).tolist())
    at = places()
    oracle.assert_close(moved.signed_distance(at + offset), Polygon(HOOK).signed_distance(at), atol=1e-8)
    centre = jnp.asarray(np.array([10.0, 25.0]) + offset, jnp.float32)
    assert jax.jit(moved.__call__)(centre) < 0


@given(angle=st.floats(0, 6.3), a=st.floats(-50, 50), b=st.floats(-50, 50))
def test_a_half_plane_is_the_line_along_its_edge(angle: float, a: float, b: float) -> None:
    normal = np.array([math.cos(angle), math.sin(angle)])
    forward = np.array([normal[1], -normal[0]])  # the normal is on the right of this, so that left is inside
    start = np.array([a, b])
    line = Line([tuple(start), tuple(start + 3 * forward)])
    half = HalfSpace((a, b), tuple(7 * normal))
    oracle.assert_close(half.signed_distance(places()), line.signed_distance(places()), atol=1e-10)


def test_a_half_space_in_space() -> None:
    half = HalfSpace((1, 2, 3), (0, 3, 4))
    assert half.dim == 3
    assert half.signed_distance([1, 2, 8]) == pytest.approx(4.0)
    assert half.signed_distance([9, -3, 3]) == pytest.approx(-3.0)
    assert HalfSpace(half.point, half.normal) == half


@given(st.lists(st.tuples(st.integers(-8, 8), st.integers(-8, 8)), min_size=3, max_size=7), st.integers(0, 99))
def test_any_polygon_that_is_accepted_has_the_inside_of_the_even_odd_rule(
    corners: list[tuple[int, int]], seed: int
) -> None:
    try:
        polygon = Polygon(corners)
    except DeformError:
        assume(False)
    at = np.random.default_rng(seed).uniform(-9, 9, (60, 2))
    wanted = [(-1 if crosses_left_of(corners, p) else 1) * unsigned(corners, p, True) for p in at]
    oracle.assert_close(polygon.signed_distance(at), wanted, atol=1e-12)


@given(st.lists(st.tuples(st.integers(-8, 8), st.integers(-8, 8)), min_size=2, max_size=6), st.integers(0, 99))
def test_any_line_that_is_accepted_has_two_sides(corners: list[tuple[int, int]], seed: int) -> None:
    """The sign changes nowhere but on the line: along any path that avoids it the side is constant."""
    try:
        line = Line(corners)
    except DeformError:
        assume(False)
    rng = np.random.default_rng(seed)
    p = rng.uniform(-60, 60, (200, 2))
    d = line.signed_distance(p)
    q = p + 0.999 * np.abs(d)[:, None] * np.array([[math.cos(t), math.sin(t)] for t in rng.uniform(0, 7, 200)])
    assert ((line.signed_distance(q) < 0) == (d < 0)).all()


def test_a_place_on_the_boundary_is_at_distance_zero_and_not_inside() -> None:
    for region in (Polygon([(0, 0), (4, 0), (4, 4), (0, 4)]), Line([(0, 0), (4, 0)]), HalfSpace((0, 0), (0, 1))):
        at = region.signed_distance([[0.0, 0.0], [2.0, 0.0], [4.0, 0.0]])
        assert (at == 0).all()
        assert not (at < 0).any()


# ---- errors -------------------------------------------------------------------------------------------------

REFUSED: dict[str, tuple[Any, str]] = {
    "loop": (lambda: Polygon([(0, 0), (10, 0), (0, 5), (10, 6)]), "edges 2 and 4 meet"),
    "touches itself": (lambda: Polygon([(0, 0), (10, 0), (10, 10), (5, 0), (0, 10)]), "meet"),
    "same place twice": (lambda: Polygon([(0, 0), (0, 0), (4, 4), (4, 0)]), "are the same; remove one"),
    "closed twice": (lambda: Polygon([(0, 0), (4, 0), (4, 4), (0, 0)]), "are the same; remove one"),
    "spike of no width": (lambda: Polygon([(0, 0), (10, 0), (5, 0), (5, 5)]), "straight back at its place 2"),
    "no area": (lambda: Polygon([(0, 0), (5, 5), (10, 10)]), "straight back"),
    "line there and back": (lambda: Line([(0, 0), (10, 0), (5, 0)]), "straight back at its place 2"),
    "line with a loop": (lambda: Line([(0, 0), (10, 0), (10, 10), (5, -5)]), "crosses itself"),
    "ends that meet": (lambda: Line([(0, 0), (10, 0), (10, 6), (5, 4)]), "ends go on"),
    "ends that meet far away": (lambda: Line([(10, 0), (0, 0), (0, 10), (10, 9.9)]), "edges 1 and 3 meet"),
    "ends on one line": (lambda: Line([(0, 0), (-1, 0), (-1, 5), (9, 5), (9, 0), (8, 0)]), "meet"),
    "two corners": (lambda: Polygon([(0, 0), (1, 1)]), "3 to 512"),
    "one place": (lambda: Line([(0, 0)]), "2 to 512"),
    "in space": (lambda: Polygon([(0, 0, 0), (1, 0, 0), (1, 1, 0)]), "2 coordinates"),
    "too many": (lambda: Line([(k, 0) for k in range(LARGEST_SHAPE + 1)]), "2 to 512"),
    "not a number": (lambda: Line([(0, 0), (1, math.nan)]), "finite"),
    "huge": (lambda: Line([(0, 0), (1, 2e15)]), "1e15"),
    "words": (lambda: Polygon("abc"), "corners of a polygon"),  # type: ignore[arg-type]
    "nothing": (lambda: Line(None), "places of a line"),  # type: ignore[arg-type]
    "no normal": (lambda: HalfSpace((0, 0), (0, 0)), "must not be zero"),
    "two dimensions at once": (lambda: HalfSpace((0, 0), (0, 0, 1)), "half space"),
    "half space of one dimension": (lambda: HalfSpace((0,), (1,)), "2 or 3 coordinates"),
    "half space of nothing": (lambda: HalfSpace(None, 3), "half space"),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_has_no_inside_is_refused_with_a_reason(case: str) -> None:
    make, message = REFUSED[case]
    with pytest.raises(DeformError, match=message):
        make()


def test_parallel_ends_of_a_line_never_meet() -> None:
    """Rounding of their directions must not let them."""
    for angle in np.linspace(0, 3, 50):
        c, s = math.cos(angle), math.sin(angle)
        v = np.array([(7.3, 0), (0, 0), (0, 5.1), (9.7, 5.1)]) @ np.array([[c, s], [-s, c]])
        assert Line(v.tolist()).dim == 2


def test_regions_with_equal_places_are_equal_and_can_be_keys() -> None:
    assert Polygon(SQUARE) == Polygon(np.array(SQUARE)) != Polygon(SQUARE[::-1])  # type: ignore[arg-type]
    assert Line(SQUARE[:2]) != Line(SQUARE[1::-1])
    edges = HalfSpace((0, 0), (2, 0)), HalfSpace((0, 0), (1, 0))
    assert len({Polygon(SQUARE), Polygon(SQUARE), Line(SQUARE[:2]), *edges}) == 3
