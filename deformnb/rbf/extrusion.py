"""Extrusion of a map from the plane into space: one formula for the paper's three rules (section 3.2), and for time.

``D3(x) = sum_k w_k(zeta) [u D_u,k(a, b) + v D_v,k(a, b)]`` with plane coordinates (a, b, c) of x and
``zeta = clamp((c - c0) / (c1 - c0), 0, 1)``. Replication has one map with w = 1, modulation one map with w = f(zeta),
interpolation K maps with hat functions. The field is lazy: no map of three dimensions is ever stored (192 MiB at
256^3), and the warp evaluates the sum where it needs it.

The curve f(z) may be given in a small, safe expression language: ``z``, ``sin(pi*z)``, ``4*z*(1-z)``, ``min(1, 3*z)``.
The text is parsed, checked node by node against a white list and evaluated on an array; nothing of it ever reaches
``eval``, no name but those below exists, and its length, depth and powers are bounded.
"""

from __future__ import annotations

import ast
import operator
import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._jax import full_precision, jnp, pytree
from deformnb.checks import short_value
from deformnb.errors import DeformError
from deformnb.rbf.cuts import Decoupled
from deformnb.rbf.fields import AbstractField, Blended, Identity
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, VolumeLike

LONGEST_FORMULA = 200
DEEPEST_FORMULA = 20
LARGEST_POWER = 64.0

# NumPy numbers: Python's raise ZeroDivisionError and OverflowError, and (-pi)^0.5 is complex.
FRONT_ONLY = "max(0,min(1,(0.7-z)/0.3))"
"""The curve of depth that leaves the back as it is: 1 in the front 40 % of the depth, 0 in the last 30 %."""

FORMULA_CONSTANTS = {"pi": np.float64(np.pi), "e": np.float64(np.e)}
FUNCTIONS: dict[str, tuple[Callable[..., Any], int]] = {
    "sin": (np.sin, 1),
    "cos": (np.cos, 1),
    "tan": (np.tan, 1),
    "exp": (np.exp, 1),
    "log": (np.log, 1),
    "sqrt": (np.sqrt, 1),
    "abs": (np.abs, 1),
    "min": (np.minimum, 2),
    "max": (np.maximum, 2),
}
"""Functions by name, with their number of arguments."""

# A product as on paper: 2z, 3 sin(z), (1+z) z. With brackets alone it parses as a call: z(1-z).
_PRODUCT = re.compile(rf"(\d[\d.]*(?:e[+-]?\d+)?|\bz|\bpi|\))\s*(z\b|pi\b|(?:{'|'.join(FUNCTIONS)})\(|\()")

_OPERATORS: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}


def evaluate(text: str, z: ArrayLike) -> NDArray[np.float64]:
    """The value of an expression in z.

    Parameters
    ----------
    text : numbers, ``z``, ``pi``, ``e``, + - * / ^ (or **), parentheses and :data:`FUNCTIONS`; at most 200 characters.
    z : array of any shape.

    Returns
    -------
    float64 array of z's shape.

    Raises
    ------
    DeformError
        If the text is anything else, or gives a value that is not finite; the message names the z.

    Examples
    --------
    >>> evaluate("4*z*(1-z)", [0.0, 0.5, 1.0]).tolist()
    [0.0, 1.0, 0.0]
    """
    values = np.asarray(z, dtype=np.float64)
    tree = _parse(text)
    with np.errstate(all="ignore"):
        result = np.broadcast_to(np.asarray(_value(tree, values, 0, text), dtype=np.float64), values.shape)
    bad = ~np.isfinite(result)
    if bad.any():
        raise DeformError(f"the curve {text!r} is not finite at z = {values[bad].flat[0]:.6g}; change it there.")
    return np.array(result)


def _parse(text: str) -> ast.expr:
    if not isinstance(text, str) or not text.strip():
        raise DeformError("the curve is empty; write for example z or sin(pi*z).")
    if len(text) > LONGEST_FORMULA:
        raise DeformError(f"the curve has {len(text)} characters; at most {LONGEST_FORMULA} are allowed.")
    try:
        return ast.parse(text.strip().replace("^", "**"), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise DeformError(f"the curve {text!r} is not a formula; {_advice(text)}.") from None


def _advice(text: str) -> str:
    """Advice on the correct expression."""
    product = _PRODUCT.search(text)
    if product is None:
        return "write for example z or sin(pi*z)"
    left, right = product[1].replace(")", "(...)"), product[2].replace("(", "(...)")
    return f"write every product with *, such as {left}*{right}"


def _value(node: ast.expr, z: NDArray[np.float64], depth: int, text: str) -> Any:
    if depth > DEEPEST_FORMULA:
        raise DeformError(f"the curve {text!r} is nested too deeply.")
    match node:
        case ast.Constant(value=bool()):
            pass
        case ast.Constant(value=int() | float() as number):
            return np.float64(number)
        case ast.Name(id="z"):
            return z
        case ast.Name(id=name) if name in FORMULA_CONSTANTS:
            return FORMULA_CONSTANTS[name]
        case ast.UnaryOp(op=op, operand=operand) if type(op) in _OPERATORS:
            return _OPERATORS[type(op)](_value(operand, z, depth + 1, text))
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
            a, b = _value(left, z, depth + 1, text), _value(right, z, depth + 1, text)
            if isinstance(op, ast.Pow) and np.abs(b).max(initial=0.0) > LARGEST_POWER:
                raise DeformError(f"the curve {text!r} has a power above {LARGEST_POWER:g}.")
            return _OPERATORS[type(op)](a, b)
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if name in FUNCTIONS:
            function, arity = FUNCTIONS[name]
            if len(args) != arity:
                raise DeformError(f"{name} in the curve {text!r} takes {arity} argument(s), not {len(args)}.")
            return function(*(_value(a, z, depth + 1, text) for a in args))
        case ast.Call(func=ast.Name(id="z" | "pi" | "e") | ast.BinOp() | ast.Constant() | ast.Call()):
            raise DeformError(f"the curve {text!r} is not a formula; {_advice(text)}.")
        case _:
            pass
    raise DeformError(
        f"the curve {text!r} may only use numbers, z, pi, e, + - * / ^ and {', '.join(FUNCTIONS)}; "
        f"{ast.unparse(node)!r} is something else."
    )


# Knots of a curve given as a formula or a function: linear interpolation between them errs by f''/8 (1/1024)^2, 1.2e-6
# for sin(pi z), which moves nothing by more than a thousandth of a voxel.
CURVE_KNOTS = 1025

# A curve that takes longer than this for all its knots would block every edit.
_SLOWEST_CURVE = 1.0

# Not of the clock: a busy machine makes no curve too slow. Python in a browser has no times of threads.
_thread_time = getattr(time, "thread_time", time.process_time)

Weights = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Knots (m,) in [0, 1], rising, and weights (K, m) of the K maps at the knots."""


def replicate() -> Weights:
    """The same displacement on every slice: D3(x, y, z) = D(x, y).

    >>> knots, weights = replicate()
    >>> weights.tolist()
    [[1.0, 1.0]]
    """
    return np.array([0.0, 1.0]), np.ones((1, 2))


def modulate(curve: str | ArrayLike | Callable[[NDArray[np.float64]], ArrayLike] = "z") -> Weights:
    """A displacement modulated by depth: D3(x, y, z) = f(z) D(x, y).

    Parameters
    ----------
    curve : a formula in z (see :mod:`deformnb.rbf.extrusion`), a function of an array of z, or an array of at least two
        values at equal steps; z runs from 0 at the first slice to 1 at the last.

    Raises
    ------
    DeformError
        If the curve is not finite everywhere, has the wrong shape, raises, or takes longer than a second.

    Examples
    --------
    >>> knots, weights = modulate([0, 1, 0])
    >>> np.asarray(weights).tolist()
    [[0.0, 1.0, 0.0]]
    """
    if isinstance(curve, str):
        z = np.linspace(0.0, 1.0, CURVE_KNOTS)
        return z, evaluate(curve, z)[None]
    if callable(curve):
        return _tabulate(curve)
    try:
        values = np.array(curve, dtype=np.float64)
    except (TypeError, ValueError):
        raise DeformError(f"the curve must be a formula, a function or an array of numbers, got {curve!r}.") from None
    if values.ndim != 1 or len(values) < 2 or not np.isfinite(values).all():
        raise DeformError("an array as curve needs at least two finite values in one row.")
    return np.linspace(0.0, 1.0, len(values)), values[None]


def _tabulate(function: Callable[[NDArray[np.float64]], ArrayLike]) -> Weights:
    z = np.linspace(0.0, 1.0, CURVE_KNOTS)
    start = _thread_time()
    try:
        values = np.asarray(function(z)).astype(np.float64, casting="same_kind")  # no complex numbers
    except Exception as error:
        raise DeformError(f"the curve raised {type(error).__name__}: {error}") from error
    if _thread_time() - start > _SLOWEST_CURVE:
        raise DeformError(f"the curve took longer than {_SLOWEST_CURVE:g} s for {CURVE_KNOTS} values; simplify it.")
    if values.shape not in ((), z.shape) or not np.isfinite(values).all():
        raise DeformError("the curve must return one finite number for every z of the array it is given.")
    return z, np.array(np.broadcast_to(values, z.shape))[None]


def interpolate(knots: ArrayLike) -> Weights:
    """K displacements at K depths, linear in between and constant beyond the outermost.

    Parameters
    ----------
    knots : (K,) different values of zeta in [0, 1], rising.

    Examples
    --------
    >>> knots, weights = interpolate([0.2, 0.8])
    >>> np.asarray(weights).shape[0]
    2
    """
    at = np.array(knots, dtype=np.float64)
    if at.ndim != 1 or len(at) < 1 or not np.isfinite(at).all() or at.min() < 0 or at.max() > 1:
        raise DeformError(f"knots must be numbers from 0 (first slice) to 1 (last), got {knots!r}.")
    if (np.diff(at) <= 0).any():
        raise DeformError(f"knots must rise, each one larger than the one before, got {at.tolist()}.")
    if len(at) == 1:
        return np.array([0.0, 1.0]), np.ones((1, 2))
    return at, np.eye(len(at))


ExtrusionName: TypeAlias = Literal["replicate", "modulate", "interpolate"]
"""Names of the extrusion rules."""

EXTRUSIONS: dict[str, Callable[..., Weights]] = {
    "replicate": replicate,
    "modulate": modulate,
    "interpolate": interpolate,
}
"""All extrusion rules by name; the first is the default."""


@pytree(data_fields=["maps", "knots", "weights"], meta_fields=["plane", "depth"])
@dataclass(frozen=True, eq=False, repr=False)
class Extrusion(AbstractField):
    """A field in space made of fields over one plane.

    Parameters
    ----------
    plane : the plane of the picture; its normal is the direction of extrusion.
    depth : (c0, c1), the depths along the normal where zeta is 0 and 1 (first and last slice).
    maps : K fields of dimension 2 over the plane.
    knots : (m,) values of zeta, rising; weights : (K, m) weight of each map at the knots, linear in between.

    Examples
    --------
    >>> from deformnb.rbf.fields import Identity
    >>> from deformnb.volume.plane import Plane
    >>> knots, weights = modulate("z")
    >>> field = Extrusion(Plane((0, 0, 0), (1, 0, 0), (0, 1, 0)), (0.0, 9.0), (Identity(2),), knots, weights)
    >>> field.weights_at(np.array([-1.0, 4.5, 20.0])).tolist()
    [[0.0, 0.5, 1.0]]
    """

    plane: Plane
    depth: tuple[float, float]
    maps: tuple[AbstractField, ...]
    knots: Any
    weights: Any

    def __post_init__(self) -> None:
        shape = getattr(self.weights, "shape", None)
        if isinstance(self.weights, np.ndarray) and shape != (len(self.maps), len(self.knots)):
            raise DeformError(f"{len(self.maps)} maps and {len(self.knots)} knots do not fit weights of shape {shape}.")
        if isinstance(self.weights, np.ndarray) and any(m.dim != 2 for m in self.maps):
            raise DeformError("an extrusion needs maps over a plane, of dimension 2.")
        if not self.depth[0] <= self.depth[1]:  # NaN as well
            raise DeformError(f"the depth of an extrusion runs from front to back, got {self.depth}.")

    @property
    def dim(self) -> int:
        return 3

    @property
    def is_identity(self) -> bool:
        return all(m.is_identity for m in self.maps)

    @property
    def is_replication(self) -> bool:
        """True if no weight changes with depth."""
        w = np.asarray(self.weights)
        return bool((w == w[:, :1]).all())

    @property
    def is_plain(self) -> bool:
        """True for the rule "replicate": one map, the same on every slice."""
        return len(self.maps) == 1 and bool((np.asarray(self.weights) == 1).all())

    def zeta(self, c: Any) -> Any:
        """Relative depth in [0, 1] of depths c along the normal; 0 for a volume of one slice."""
        c0, c1 = self.depth
        return np.clip((c - c0) / (c1 - c0), 0.0, 1.0) if c1 > c0 else np.zeros_like(c)

    def weights_at(self, c: NDArray[np.float64]) -> NDArray[np.float64]:
        """Weights (K, ...) of the maps at depths c (...)."""
        z = self.zeta(np.asarray(c, dtype=np.float64))
        return np.stack([np.interp(z, self.knots, w) for w in np.asarray(self.weights)])

    @full_precision
    def jax_displacement(self, points: Any) -> Any:
        frame = jnp.asarray(self.plane.frame)
        abc = (jnp.asarray(points) - jnp.asarray(self.plane.origin)) @ frame.T
        c0, c1 = self.depth
        z = jnp.clip((abc[..., 2] - c0) / (c1 - c0), 0.0, 1.0) if c1 > c0 else jnp.zeros_like(abc[..., 2])
        total = sum(
            jnp.interp(z, jnp.asarray(self.knots), jnp.asarray(w))[..., None] * m.jax_displacement(abc[..., :2])
            for m, w in zip(self.maps, self.weights, strict=True)
        )
        return total @ frame[:2]

    def displacement(self, points: ArrayLike) -> NDArray[np.float64]:
        abc = self.plane.to_plane(points)
        depth = abc[..., 2]
        weights = self.weights_at(depth[..., :1] if self.is_replication and depth.ndim else depth)
        total = sum(w[..., None] * m.displacement(abc[..., :2]) for m, w in zip(self.maps, weights, strict=True))
        return np.einsum("...m,mk->...k", total, self.plane.frame[:2])  # BLAS: as in Plane.to_plane

    def slopes_at(self, c: NDArray[np.float64]) -> NDArray[np.float64]:
        """Derivatives (K, ...) of the weights by depth c (...), per unit of length.

        At a knot the side of growing depth counts, at the last one the side before it; beyond the ends they are zero.
        """
        c0, c1 = self.depth
        at, knots = np.asarray(c, dtype=np.float64), np.asarray(self.knots, dtype=np.float64)
        w = np.asarray(self.weights, dtype=np.float64)
        if not c1 > c0 or len(knots) < 2:
            return np.zeros((len(w), *at.shape))
        z = (at - c0) / (c1 - c0)
        slopes = np.diff(w, axis=1) / np.diff(knots) / (c1 - c0)
        piece = np.clip(np.searchsorted(knots, z, side="right") - 1, 0, len(knots) - 2)
        within = (z >= knots[0]) & (z <= knots[-1]) & (z >= 0) & (z <= 1)
        return np.where(within, slopes[:, piece], 0.0)

    def jacobian(self, points: ArrayLike) -> NDArray[np.float64]:
        """``u, v (sum_k w_k J_k) (u, v)^T + (sum_k w_k' D_k) n^T``: the derivative of the maps, and of the weights."""
        abc = self.plane.to_plane(points)
        ab, c = abc[..., :2], abc[..., 2]
        weights, slopes = self.weights_at(c), self.slopes_at(c)
        inner = np.zeros((*c.shape, 2, 3))
        for m, w, slope in zip(self.maps, weights, slopes, strict=True):
            inner[..., :2] += w[..., None, None] * m.jacobian(ab)
            if slope.any():
                inner[..., 2] += slope[..., None] * m.displacement(ab)
        return np.asarray(self.plane.frame[:2].T @ inner @ self.plane.frame)

    def lattice_jacobians(self, rows: ArrayLike, columns: ArrayLike) -> NDArray[np.float32]:
        frame = self.plane.frame.astype(np.float32)
        r, c = self.lines(rows, columns)
        depth = r[2][:, None] + c[2][None, :]
        inner = np.zeros((2, 3, *depth.shape), dtype=np.float32)
        for m, w, slope in zip(self.maps, self.weights_at(depth), self.slopes_at(depth), strict=True):
            inner[:, :2] += w.astype(np.float32) * m.lattice_jacobians(r[:2], c[:2])
            if slope.any():
                inner[:, 2] += slope.astype(np.float32) * m.lattice_values(r[:2], c[:2], 1.0)
        return np.einsum("am,abrc,bk->mkrc", frame[:2], inner, frame, optimize=True)

    def lines(self, rows: ArrayLike, columns: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Rows and columns of an outer sum in coordinates (a, b, c) of the plane."""
        frame = self.plane.frame
        first = frame @ (np.asarray(rows, dtype=np.float64) - np.asarray(self.plane.origin)[:, None])
        return first, frame @ np.asarray(columns, dtype=np.float64)

    def lattice_values(self, rows: ArrayLike, columns: ArrayLike, resolution: float) -> NDArray[np.float32]:
        frame = self.plane.frame
        r, c = self.lines(rows, columns)
        depth = r[2][:, None] + c[2][None, :]
        weights = self.weights_at(depth[:1, :1] if self.is_replication else depth)
        total = np.zeros((2, r.shape[1], c.shape[1]), dtype=np.float32)
        for m, w in zip(self.maps, weights, strict=True):
            total += w.astype(np.float32) * m.lattice_values(r[:2], c[:2], resolution)
        return np.einsum("mk,mrc->krc", frame[:2].astype(np.float32), total)

    def components_on_grid(self, grid: Grid) -> NDArray[np.float32]:
        axis = self.axis_of(grid)
        if axis is None:
            return super().components_on_grid(grid)
        # The plane is parallel to the grid: evaluate each map on one slice and spread it along the normal.
        flat = grid.crop((0, 0, 0), tuple(1 if k == axis else n for k, n in enumerate(grid.shape)))  # type: ignore[arg-type]
        step = np.zeros((grid.shape[axis], 3))
        step[:, 2 - axis] = np.arange(grid.shape[axis])
        weights = self.weights_at(self.plane.to_plane(grid.index_to_point(step))[:, 2])
        along = [1, 1, 1]
        along[axis] = -1
        total = np.zeros((2, *grid.shape), dtype=np.float32)
        for m, w in zip(self.maps, weights, strict=True):
            slice_field = Extrusion(self.plane, self.depth, (m,), *replicate())
            one = AbstractField.components_on_grid(slice_field, flat)
            total = total + w.reshape(along).astype(np.float32) * np.einsum("mk,kzyx->mzyx", self.plane.frame[:2], one)
        return np.einsum("mk,mzyx->kzyx", self.plane.frame[:2], total).astype(np.float32)

    def axis_of(self, grid: Grid) -> int | None:
        """The array axis of ``grid`` (0 z, 1 y, 2 x) along which the plane's normal runs; None if it is oblique."""
        return _parallel_axis(self.plane, grid, 1e-6)


def _parallel_axis(plane: Plane, grid: Grid, sine: float) -> int | None:
    direction, normal = np.asarray(grid.direction), np.asarray(plane.normal)
    along = np.abs(direction.T @ normal)
    k = int(along.argmax())
    # A sine below 1e-6 moves nothing by more than a thousandth of a voxel over 1000 voxels. The axis itself counts too:
    # the columns of a direction may be four digits off right angles.
    sines = np.linalg.norm(np.delete(along, k)), np.linalg.norm(np.cross(direction[:, k], normal))
    return 2 - k if max(sines) < sine else None


def unchanging_axes(field: AbstractField, grid: Grid, sine: float = 1e-6) -> frozenset[int]:
    """The array axes of ``grid`` along which a field in space is certainly the same, so that one slice represents all.

    Parameters
    ----------
    sine : of the angle between the normal of a replication and an axis, at most.
    """
    if isinstance(field, Identity):
        return frozenset(range(3))
    if isinstance(field, Extrusion):
        plane, parts = field.plane, []
        if not field.is_replication:
            return frozenset()
    elif isinstance(field, Decoupled) and field.plane is not None:
        plane, parts = field.plane, list(field.fields)
    elif isinstance(field, Blended) or len(field.steps) > 1:
        common = [unchanging_axes(f, grid, sine) for f in (field.fields if isinstance(field, Blended) else field.steps)]
        return frozenset.intersection(*common)
    else:
        return frozenset()
    own = _parallel_axis(plane, grid, sine)
    return frozenset(() if own is None else (own,)).intersection(*(unchanging_axes(f, grid, sine) for f in parts))


def extrude(plane: Plane, grid: Grid | VolumeLike, maps: Sequence[AbstractField], weights: Weights) -> Extrusion:
    """Extrude fields over a plane through the slices of ``grid``: zeta runs from its first slice to its last.

    Examples
    --------
    >>> from deformnb.rbf.fields import Identity
    >>> from deformnb.volume.volume import Grid
    >>> grid = Grid((4, 4, 4), (1.0, 1.0, 1.0))
    >>> extrude(Plane.from_view(grid, "+y"), grid, [Identity(2)], modulate("z")).dim
    3
    """
    if not isinstance(plane, Plane):
        raise DeformError(
            f"a Plane is needed to extrude from, got {short_value(plane)}; Plane.from_view(volume, view) makes one."
        )
    return Extrusion(plane, plane.depth_range(grid), tuple(maps), *weights)
