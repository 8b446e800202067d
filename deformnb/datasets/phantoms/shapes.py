"""Solids as signed distance functions: the primitives from which every phantom is built.

A solid has a box and a (approximately signed) distance: negative inside, positive outside, in the unit of the
phantom (mm). Distances only have to be right within about one voxel of the surface and in sign elsewhere, which
is why ellipsoids and lofts may use the first-order formula ``d = (rho - 1) / |grad rho|``.

Coordinates come as three float32 arrays that broadcast against one another, of shapes (1, 1, nx), (1, ny, 1) and
(nz, 1, 1), so a solid that does not depend on x is evaluated on a slice and costs a slice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._typing import Float3

Float32s = NDArray[np.float32]
SolidBox = tuple[Float3, Float3]

FAR = np.float32(1e6)
"""Distance written where a solid was not evaluated; beyond any phantom (metres in mm)."""


class Solid(Protocol):
    """Anything with a box and a signed distance."""

    @property
    def box(self) -> SolidBox:
        """Lowest and highest (x, y, z) the solid reaches."""

    def distance(self, x: Float32s, y: Float32s, z: Float32s) -> Float32s:
        """Signed distance at broadcasting coordinates."""


def smooth_curve(knots: ArrayLike, values: ArrayLike, t: ArrayLike) -> NDArray[np.float64]:
    """Monotone cubic through (knots, values), values (n,) or (n, k); constant beyond the ends.

    Slopes are harmonic means of the neighbouring secants (Fritsch and Butland 1984), so an outline given by a dozen
    numbers neither overshoots nor shows the corners that ``np.interp`` would leave on a body.
    """
    k, v = np.asarray(knots, dtype=np.float64), np.asarray(values, dtype=np.float64)
    column = v[:, None] if v.ndim == 1 else v
    step = np.diff(k)[:, None]
    secant = np.diff(column, axis=0) / step
    slope = np.zeros_like(column)
    product = secant[:-1] * secant[1:]
    rising = product > 0
    slope[1:-1] = np.where(rising, 2 * product / np.where(rising, secant[:-1] + secant[1:], 1.0), 0.0)
    slope[0], slope[-1] = secant[0], secant[-1]
    q = np.clip(np.asarray(t, dtype=np.float64), k[0], k[-1])
    i = np.clip(np.searchsorted(k, q, side="right") - 1, 0, len(k) - 2)
    h, s = step[i, 0][..., None], ((q - k[i]) / step[i, 0])[..., None]
    out = (
        (1 + 2 * s) * (1 - s) ** 2 * column[i]
        + s * (1 - s) ** 2 * h * slope[i]
        + s**2 * (3 - 2 * s) * column[i + 1]
        + s**2 * (s - 1) * h * slope[i + 1]
    )
    return np.asarray(out[..., 0] if v.ndim == 1 else out)


def path(points: ArrayLike, count: int) -> NDArray[np.float64]:
    """``count`` points along the smooth curve through ``points`` (n, 3), by chord length."""
    p = np.asarray(points, dtype=np.float64)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    return smooth_curve(length, p, np.linspace(0.0, length[-1], count))


@dataclass(frozen=True)
class Ellipsoid:
    """Ellipsoid; ``axes`` are the three unit vectors (rows) of its radii, default x, y, z."""

    center: Float3
    radii: Float3
    axes: tuple[Float3, Float3, Float3] | None = None

    @property
    def box(self) -> SolidBox:
        r = np.asarray(self.radii)
        reach = r if self.axes is None else np.sqrt(((np.asarray(self.axes) * r[:, None]) ** 2).sum(axis=0))
        return _triple(np.asarray(self.center) - reach), _triple(np.asarray(self.center) + reach)

    def distance(self, x: Float32s, y: Float32s, z: Float32s) -> Float32s:
        local: Sequence[Float32s] = [p - np.float32(c) for p, c in zip((x, y, z), self.center, strict=True)]
        if self.axes is not None:
            local = [_dot(axis, local) for axis in self.axes]
        inverse = [np.float32(1 / r) for r in self.radii]
        unit = [p * w for p, w in zip(local, inverse, strict=True)]
        rho = np.sqrt(unit[0] ** 2 + unit[1] ** 2 + unit[2] ** 2 + np.float32(1e-8))
        slope = [u * w for u, w in zip(unit, inverse, strict=True)]
        tiny = np.float32(1e-8 * float(np.mean(np.square(inverse))))  # for the centre to be inside
        return np.asarray(rho * (rho - 1) / np.sqrt(slope[0] ** 2 + slope[1] ** 2 + slope[2] ** 2 + tiny))


@dataclass(frozen=True)
class Tube:
    """Round rod through ``points`` (n, 3) whose radius runs through ``radii`` (one, or n)."""

    points: tuple[Float3, ...]
    radii: tuple[float, ...]

    @property
    def box(self) -> SolidBox:
        p, r = np.asarray(self.points), self._all_radii[:, None]
        return _triple((p - r).min(axis=0)), _triple((p + r).max(axis=0))

    @property
    def _all_radii(self) -> NDArray[np.float64]:
        return np.broadcast_to(np.asarray(self.radii, dtype=np.float64), (len(self.points),))

    def distance(self, x: Float32s, y: Float32s, z: Float32s) -> Float32s:
        r = self._all_radii
        out = np.full(np.broadcast_shapes(x.shape, y.shape, z.shape), FAR)
        for a, b, ra, rb in zip(self.points[:-1], self.points[1:], r[:-1], r[1:], strict=True):
            along = np.subtract(b, a, dtype=np.float64)
            inverse = np.float32(1 / max(float(along @ along), 1e-12))
            local = [p - np.float32(c) for p, c in zip((x, y, z), a, strict=True)]
            t = np.clip(_dot(along, local) * inverse, 0, 1)
            gap = [p - t * np.float32(w) for p, w in zip(local, along, strict=True)]
            d = np.sqrt(gap[0] ** 2 + gap[1] ** 2 + gap[2] ** 2) - (np.float32(ra) + t * np.float32(rb - ra))
            np.minimum(out, d, out=out)
        return out


@dataclass(frozen=True)
class Loft:
    """A body swept along one axis: at each station an ellipse (power 2) or rounded box (power 4).

    ``stations`` has rows (t, centre u, centre v, radius u, radius v); t runs along ``axis`` and u, v are the other two
    axes in the order x, y, z. Rows are joined by a monotone cubic.
    """

    axis: str
    stations: tuple[tuple[float, float, float, float, float], ...]
    power: int = 2

    @cached_property
    def _fine(self) -> NDArray[np.float64]:
        s = np.asarray(self.stations, dtype=np.float64)
        t = np.linspace(s[0, 0], s[-1, 0], 400)
        return np.column_stack([t, smooth_curve(s[:, 0], s[:, 1:], t)])

    @property
    def box(self) -> SolidBox:
        f = self._fine
        low = [f[0, 0], (f[:, 1] - f[:, 3]).min(), (f[:, 2] - f[:, 4]).min()]
        high = [f[-1, 0], (f[:, 1] + f[:, 3]).max(), (f[:, 2] + f[:, 4]).max()]
        order = {"x": (0, 1, 2), "y": (1, 0, 2), "z": (1, 2, 0)}[self.axis]
        return _triple(np.array([low[i] for i in order])), _triple(np.array([high[i] for i in order]))

    def distance(self, x: Float32s, y: Float32s, z: Float32s) -> Float32s:
        t, u, v = {"x": (x, y, z), "y": (y, x, z), "z": (z, x, y)}[self.axis]
        f = self._fine
        cu, cv, ru, rv = (np.interp(t, f[:, 0], f[:, k]).astype(np.float32) for k in (1, 2, 3, 4))
        inverse_u, inverse_v = 1 / np.maximum(ru, np.float32(1e-3)), 1 / np.maximum(rv, np.float32(1e-3))
        a, b = np.square((u - cu) * inverse_u), np.square((v - cv) * inverse_v)
        tiny = np.float32(1e-8)
        if self.power == 2:
            rho = np.sqrt(a + b + tiny)
            d = rho * (rho - 1) / np.sqrt(a * inverse_u**2 + b * inverse_v**2 + tiny * inverse_u * inverse_v)
        else:
            rho = np.sqrt(np.sqrt(a * a + b * b + tiny * tiny))
            slope = np.sqrt(a**3 * inverse_u**2 + b**3 * inverse_v**2 + tiny**3 * inverse_u * inverse_v)
            d = rho**3 * (rho - 1) / slope
        beyond = np.maximum(np.float32(f[0, 0]) - t, t - np.float32(f[-1, 0]))
        return np.asarray(np.maximum(d, beyond))


@dataclass(frozen=True)
class Sheet:
    """A flat plate (a fin, a tail fan): a polygon in the plane (origin, u, v), ``thickness`` across."""

    outline: tuple[tuple[float, float], ...]
    thickness: float
    origin: Float3 = (0.0, 0.0, 0.0)
    u: Float3 = (0.0, 1.0, 0.0)
    v: Float3 = (0.0, 0.0, 1.0)

    @property
    def box(self) -> SolidBox:
        o = np.asarray(self.outline, dtype=np.float64)
        p = np.asarray(self.origin) + o[:, :1] * np.asarray(self.u) + o[:, 1:] * np.asarray(self.v)
        return _triple(p.min(axis=0) - self.thickness / 2), _triple(p.max(axis=0) + self.thickness / 2)

    def distance(self, x: Float32s, y: Float32s, z: Float32s) -> Float32s:
        local = [p - np.float32(c) for p, c in zip((x, y, z), self.origin, strict=True)]
        across = np.abs(_dot(np.cross(self.u, self.v), local)) - np.float32(self.thickness / 2)
        return np.asarray(np.maximum(across, _polygon(self.outline, _dot(self.u, local), _dot(self.v, local))))


@dataclass(frozen=True)
class Block:
    """A box with faces along the axes and edges rounded by ``rounding``."""

    low: Float3
    high: Float3
    rounding: float = 0.0

    @property
    def box(self) -> SolidBox:
        return self.low, self.high

    def distance(self, x: Float32s, y: Float32s, z: Float32s) -> Float32s:
        r = np.float32(self.rounding)
        q = [
            np.abs(p - np.float32((a + b) / 2)) - np.float32((b - a) / 2) + r
            for p, a, b in zip((x, y, z), self.low, self.high, strict=True)
        ]
        outside = np.sqrt(sum(np.square(np.maximum(c, 0)) for c in q))
        return np.asarray(outside + np.minimum(np.maximum(q[0], np.maximum(q[1], q[2])), 0) - r)


@dataclass(frozen=True)
class Blend:
    """Smooth union: solids flow into one another over about ``width`` (polynomial minimum, Quilez)."""

    solids: tuple[Solid, ...]
    width: float

    @cached_property
    def box(self) -> SolidBox:
        lows, highs = zip(*(s.box for s in self.solids), strict=True)
        return _triple(np.min(lows, axis=0) - self.width / 4), _triple(np.max(highs, axis=0) + self.width / 4)

    def distance(self, x: Float32s, y: Float32s, z: Float32s) -> Float32s:
        # Far from a solid the minimum does not feel it, so each is evaluated only near its own box; the field
        # is cut off at twice the width, where nothing is drawn any more.
        cap = np.float32(2 * self.width)
        out = np.full(np.broadcast_shapes(x.shape, y.shape, z.shape), cap)
        k = np.float32(self.width)
        for solid in self.solids:
            at = window(solid.box, float(cap), x, y, z)
            if at is None:
                continue
            here, near = out[at[0], at[1], at[2]], solid.distance(x[..., at[2]], y[:, at[1]], z[at[0]])
            h = np.maximum(k - np.abs(here - near), 0)
            out[at[0], at[1], at[2]] = np.minimum(here, near) - h * h / (4 * k)
        return out


@dataclass(frozen=True)
class Both:
    """Intersection of solids. Those in ``minus`` are taken away."""

    solids: tuple[Solid, ...]
    minus: tuple[Solid, ...] = ()

    @property
    def box(self) -> SolidBox:
        lows, highs = zip(*(s.box for s in self.solids), strict=True)
        return _triple(np.max(lows, axis=0)), _triple(np.min(highs, axis=0))

    def distance(self, x: Float32s, y: Float32s, z: Float32s) -> Float32s:
        out = self.solids[0].distance(x, y, z)
        for solid in self.solids[1:]:
            out = np.maximum(out, solid.distance(x, y, z))
        for solid in self.minus:
            out = np.maximum(out, -solid.distance(x, y, z))
        return out


@dataclass(frozen=True)
class Shell:
    """The crust of a solid: from ``depth`` below its surface, ``thickness`` further in."""

    solid: Solid
    thickness: float
    depth: float = 0.0

    @property
    def box(self) -> SolidBox:
        return self.solid.box

    def distance(self, x: Float32s, y: Float32s, z: Float32s) -> Float32s:
        middle = np.float32(self.depth + self.thickness / 2)
        return np.asarray(np.abs(self.solid.distance(x, y, z) + middle) - np.float32(self.thickness / 2))


def window(box: SolidBox, margin: float, x: Float32s, y: Float32s, z: Float32s) -> tuple[slice, slice, slice] | None:
    """Slices (z, y, x) of the coordinates within ``margin`` of a box; None if there are none."""
    slices = []
    for k, line in ((2, z), (1, y), (0, x)):
        a, b = np.searchsorted(line.ravel(), [box[0][k] - margin, box[1][k] + margin])
        if a >= b:
            return None
        slices.append(slice(int(a), int(b)))
    return slices[0], slices[1], slices[2]


def _triple(value: NDArray[np.float64]) -> Float3:
    return (float(value[0]), float(value[1]), float(value[2]))


def _dot(vector: ArrayLike, parts: Sequence[Float32s]) -> Float32s:
    """Sum of vector components times coordinates, leaving out zeros so that the result stays as small as it can."""
    terms = [p * np.float32(w) for p, w in zip(parts, np.asarray(vector, dtype=np.float64), strict=True) if w != 0]
    return np.asarray(sum(terms[1:], terms[0]))


def _polygon(outline: Sequence[tuple[float, float]], a: Float32s, b: Float32s) -> Float32s:
    """Exact signed distance to a closed polygon: nearest edge, sign by crossings of a ray."""
    best = np.full(np.broadcast_shapes(a.shape, b.shape), FAR)
    inside = np.zeros(best.shape, dtype=bool)
    for (a0, b0), (a1, b1) in zip(outline, [*outline[1:], outline[0]], strict=True):
        ea, eb = np.float32(a1 - a0), np.float32(b1 - b0)
        pa, pb = a - np.float32(a0), b - np.float32(b0)
        t = np.clip((pa * ea + pb * eb) / np.maximum(ea * ea + eb * eb, np.float32(1e-12)), 0, 1)
        np.minimum(best, np.square(pa - t * ea) + np.square(pb - t * eb), out=best)
        if b0 != b1:
            crosses = ((pb >= 0) != (b - np.float32(b1) >= 0)) & (pa < pb * (ea / eb))
            inside ^= crosses
    return np.asarray(np.where(inside, -1, 1).astype(np.float32) * np.sqrt(best))
