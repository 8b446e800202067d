"""Pictures and their place in space: an oriented plane and the raster of the pixels.

A :class:`Plane` has picture coordinates (a, b): ``a`` runs to the right of the picture (along ``u``), ``b`` runs
down it (along ``v``). The normal ``n = u x v`` points away from the viewer, into the picture, so depth ``c``
grows from front to back. All lengths are physical (the unit of the volume); no axis is ever a voxel count.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._entrances import DISPLAYS
from deformnb._typing import Float3
from deformnb.checks import check_fields, finite_array, finite_number
from deformnb.errors import DeformError
from deformnb.volume.array_protocol import AbstractValues
from deformnb.volume.colour_maps import ColourMapName, colour_table
from deformnb.volume.views import VIEWS, ViewName
from deformnb.volume.volume import ORTHONORMAL_TOLERANCE, Grid, VolumeLike, as_finest_grid, as_grid

SAME_DIRECTION = 1e-6
"""Largest difference of the unit vectors of two pictures of one side: cameras of front ends are rounded in their turns,
and over a volume of a thousand voxels so much is a thousandth of one."""

# Up of the picture for each viewing axis: the head (superior, +z) is up in side and front views; an axial picture has
# the front of the patient (-y) up. Radiologists expect exactly this.
_UP = {"x": (0.0, 0.0, 1.0), "y": (0.0, 0.0, 1.0), "z": (0.0, -1.0, 0.0)}


def _triple(value: ArrayLike, what: str) -> Float3:
    x, y, z = finite_array(value, (3,), f"{what} must be three finite numbers (x, y, z)").tolist()
    return x, y, z


@dataclass(frozen=True)
class Raster:
    """A regular grid of pixel centres in picture coordinates.

    Parameters
    ----------
    shape : (nv, nu), rows and columns.
    spacing : (du, dv), physical distance of neighbouring pixel centres along u and along v.
    origin : (a, b) of the centre of pixel [0, 0].

    Examples
    --------
    >>> Raster((2, 3), (0.5, 1.0), (10.0, 20.0)).box
    (9.75, 11.25, 19.5, 21.5)
    """

    shape: tuple[int, int]
    spacing: tuple[float, float]
    origin: tuple[float, float]

    def __post_init__(self) -> None:
        check_fields(self)
        if min(self.shape) < 1:
            raise DeformError(f"a raster needs at least one row and one column, got shape {self.shape}.")
        if not all(np.isfinite(s) and s > 0 for s in self.spacing):
            raise DeformError(f"pixel spacing must be two positive lengths, got {self.spacing}.")
        if not np.isfinite(self.origin).all():
            raise DeformError(f"the origin of a raster must be finite, got {self.origin}.")

    @property
    def columns(self) -> NDArray[np.float64]:
        """The coordinate a of every column, shape (nu,)."""
        return self.origin[0] + self.spacing[0] * np.arange(self.shape[1], dtype=np.float64)

    @property
    def rows(self) -> NDArray[np.float64]:
        """The coordinate b of every row, shape (nv,)."""
        return self.origin[1] + self.spacing[1] * np.arange(self.shape[0], dtype=np.float64)

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Outer edges (a_min, a_max, b_min, b_max): half a pixel beyond the outermost centres."""
        (du, dv), (a0, b0), (nv, nu) = self.spacing, self.origin, self.shape
        return (a0 - du / 2, a0 + (nu - 0.5) * du, b0 - dv / 2, b0 + (nv - 0.5) * dv)

    @property
    def diagonal(self) -> float:
        """Length of the diagonal of the box."""
        a0, a1, b0, b1 = self.box
        return float(np.hypot(a1 - a0, b1 - b0))

    def points(self) -> NDArray[np.float64]:
        """All pixel centres, shape (nv, nu, 2)."""
        a, b = np.meshgrid(self.columns, self.rows)
        return np.stack([a, b], axis=-1)


@dataclass(frozen=True)
class Slices:
    """Parallel slices through a volume, see :meth:`Plane.slices`.

    Parameters
    ----------
    first : depth c of the first one, in front.
    spacing : distance of neighbours.
    count : how many there are.
    """

    first: float
    spacing: float
    count: int

    def __post_init__(self) -> None:
        check_fields(self)
        if not (self.spacing > 0 and self.count >= 1):
            raise DeformError(f"slices are one or more, a positive length apart, got {self}.")

    def depth(self, index: int) -> float:
        """Depth c of a slice, counted from 0; of the first or last one where there is none."""
        return self.first + self.spacing * min(max(index, 0), self.count - 1)

    def index(self, depth: float) -> int:
        """The slice nearest to a depth c."""
        return min(max(round((depth - self.first) / self.spacing), 0), self.count - 1)


@dataclass(frozen=True)
class Plane:
    """An oriented plane in space: picture coordinates (a, b) and depth c.

    ``point = origin + a u + b v + c n`` with ``n = u x v``.

    Parameters
    ----------
    origin : the point (x, y, z) with picture coordinates (0, 0).
    u, v : orthogonal unit vectors, right and down on the picture.

    Raises
    ------
    DeformError
        If the vectors are not orthonormal within 1e-6.

    Examples
    --------
    >>> plane = Plane((0, 0, 0), (1, 0, 0), (0, 0, -1))
    >>> plane.normal
    (0.0, 1.0, 0.0)
    >>> plane.to_plane([3.0, 5.0, -2.0]).tolist()
    [3.0, 2.0, 5.0]
    """

    origin: Float3
    u: Float3
    v: Float3

    def __post_init__(self) -> None:
        for name in ("origin", "u", "v"):
            object.__setattr__(self, name, _triple(getattr(self, name), f"plane {name}"))
        with np.errstate(over="ignore", invalid="ignore"):  # numbers from a file may be anything
            gram = np.array([self.u, self.v]) @ np.array([self.u, self.v]).T
        if not np.allclose(gram, np.eye(2), atol=1e-6):
            raise DeformError(
                f"plane vectors must be orthogonal and of length 1, got u = {self.u}, v = {self.v}; "
                "use Plane.from_normal(origin, normal) to have them made."
            )

    @property
    def normal(self) -> Float3:
        """n = u x v, away from the viewer."""
        return _triple(np.cross(self.u, self.v) + 0.0, "normal")

    @cached_property
    def frame(self) -> NDArray[np.float64]:
        """Rows u, v, n; shape (3, 3). ``frame @ vector`` gives plane components, ``components @ frame`` the vector."""
        frame = np.array([self.u, self.v, self.normal])
        frame.flags.writeable = False
        return frame

    def to_plane(self, points: ArrayLike) -> NDArray[np.float64]:
        """Plane coordinates (a, b, c) of points (..., 3) in space."""
        away = np.asarray(points, dtype=np.float64) - np.array(self.origin)
        return np.einsum("...k,mk->...m", away, self.frame)  # BLAS takes seven times as long for such thin matrices

    def from_plane(self, coordinates: ArrayLike) -> NDArray[np.float64]:
        """Points (..., 3) in space of plane coordinates (..., 2) or (..., 3)."""
        c = np.asarray(coordinates, dtype=np.float64)
        return np.array(self.origin) + c @ self.frame[: c.shape[-1]]

    def shifted(self, depth: float) -> Plane:
        """The parallel plane ``depth`` further along the normal."""
        return Plane(_triple(np.array(self.origin) + depth * np.array(self.normal), "origin"), self.u, self.v)

    @classmethod
    def from_view(cls, grid: Grid | VolumeLike, view: ViewName = "+y", depth: float | None = None) -> Plane:
        """The plane of a picture of ``grid`` seen along one of its axes.

        Parameters
        ----------
        grid : a volume or its grid.
        view : one of :data:`VIEWS`; for a rotated grid, the voxel axis nearest to that direction is taken.
        depth : position along the viewing direction, from the first slice; default is the middle slice.

        Notes
        -----
        The origin is at the centre of the voxel that is left-most and top-most in the picture, so a picture of the
        grid has its pixel [0, 0] at (a, b) = (0, 0).
        """
        grid = as_finest_grid(grid)
        if view not in VIEWS:
            raise DeformError(f"unknown view {view!r}; choose one of {', '.join(VIEWS)}.")
        axis = view[1]
        toward = np.eye(3)["xyz".index(axis)] * (1.0 if view[0] == "+" else -1.0)
        direction = np.asarray(grid.direction)
        n = _nearest_column(direction, toward)
        n = n / np.linalg.norm(n)
        v = -_nearest_column(direction, np.array(_UP[axis]), without=n)
        v = v - (v @ n) * n  # a grid may be four digits off right angles, a plane may not
        v = v / np.linalg.norm(v)
        u = np.cross(v, n)
        corners = grid.corners(centres=True)
        start = [float((corners @ w).min()) for w in (u, v, n)]
        length = float((corners @ n).max()) - start[2]
        c = start[2] + (length / 2 if depth is None else float(depth))
        origin = start[0] * u + start[1] * v + c * n
        return cls(_triple(origin + 0.0, "origin"), _triple(u + 0.0, "u"), _triple(v + 0.0, "v"))

    @classmethod
    def from_normal(cls, origin: ArrayLike, normal: ArrayLike, up: ArrayLike | None = None) -> Plane:
        """The plane through a point with a given viewing direction.

        Parameters
        ----------
        origin : (x, y, z) of picture coordinates (0, 0).
        normal : viewing direction, any length but zero.
        up : direction that should point up in the picture; default is the head (+z), or -y for a view along z.
        """
        n = np.array(_triple(normal, "normal"))
        if np.linalg.norm(n) < 1e-12:
            raise DeformError("the normal of a plane must not be zero.")
        n /= np.linalg.norm(n)
        if up is None:
            up = _UP["z"] if abs(n[2]) > 0.999 else _UP["x"]
        down = -np.array(_triple(up, "up"))
        down = down - (down @ n) * n
        if np.linalg.norm(down) < 1e-9:
            raise DeformError("up must not be parallel to the normal of the plane.")
        v = down / np.linalg.norm(down)
        u = np.cross(v, n)
        return cls(_triple(origin, "origin"), _triple(u + 0.0, "u"), _triple(v + 0.0, "v"))

    @classmethod
    def from_camera(cls, grid: Grid | VolumeLike, direction: ArrayLike, up: ArrayLike | None = None) -> Plane:
        """The plane of a picture of ``grid`` from any camera: through its middle, or that of a side seen straight.

        Parameters
        ----------
        grid : a volume or its grid.
        direction, up : of the camera, as of :meth:`from_normal`.

        Examples
        --------
        >>> grid = Grid((4, 5, 6))
        >>> Plane.from_camera(grid, (0, 2, 0), (0, 0, 1)) == Plane.from_view(grid, "+y")
        True
        >>> Plane.from_camera(grid, (1, 1, 0)).origin
        (2.5, 2.0, 1.5)
        """
        grid = as_finest_grid(grid)
        plane = cls.from_normal(grid.center, direction, up)
        sides = (cls.from_view(grid, view) for view in VIEWS)
        return next((side for side in sides if side.has_same_directions(plane)), plane)

    def has_same_directions(self, other: Plane) -> bool:
        """Check whether both pictures are seen along the same direction, with the same side up."""
        return bool(np.abs(self.frame - other.frame).max() < SAME_DIRECTION)

    def turned_directions(
        self, up: float = 0.0, right: float = 0.0, roll: float = 0.0
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Direction of view and up vector of a viewer who moves around the picture's axes, in this order.

        Parameters
        ----------
        up : degrees about the axis to the right: more of the object is seen from above.
        right : degrees about the axis down the picture: more of it is seen from the right.
        roll : degrees about the direction of view: the picture turns clockwise.

        Examples
        --------
        >>> front = Plane((0, 0, 0), (1, 0, 0), (0, 0, -1))
        >>> direction, _ = front.turned_directions(right=90)
        >>> (direction.round(9) + 0.0).tolist()
        [-1.0, 0.0, 0.0]
        """
        u, v, n = np.array(self.frame)
        for name, angle in (("up", up), ("right", right), ("roll", roll)):
            turn = finite_number(angle, "the angles of a turn are degrees")
            c, s = np.cos(np.deg2rad(turn)), np.sin(np.deg2rad(turn))
            if name == "up":
                v, n = c * v - s * n, c * n + s * v
            elif name == "right":
                u, n = c * u + s * n, c * n - s * u
            else:
                u, v = c * u - s * v, c * v + s * u
        return n, -v

    def depth_range(self, grid: Grid | VolumeLike) -> tuple[float, float]:
        """Smallest and largest depth c of the voxel centres of ``grid``: zeta = 0 and 1 of an extrusion."""
        c = self.to_plane(as_finest_grid(grid).corners(centres=True))[:, 2]
        return float(c.min()), float(c.max())

    def slices(self, grid: Grid | VolumeLike) -> Slices:
        """The slices of ``grid`` along the normal: its layers of voxels; oblique ones at the smallest voxel size.

        Examples
        --------
        >>> grid = Grid((4, 5, 6), (1.0, 1.0, 2.5))
        >>> Plane.from_view(grid, "+z").slices(grid)
        Slices(first=-3.75, spacing=2.5, count=4)
        """
        grid = as_grid(grid)
        first, last = self.depth_range(grid)
        cosines = np.abs(np.asarray(grid.direction).T @ np.array(self.normal))
        is_along = np.sort(cosines)[-2] <= 2 * ORTHONORMAL_TOLERANCE
        spacing = grid.spacing[int(cosines.argmax())] if is_along else min(grid.spacing)
        return Slices(first, spacing, int((last - first) / spacing + 1e-6) + 1)


def _nearest_column(
    direction: NDArray[np.float64], toward: NDArray[np.float64], without: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """The signed column of ``direction`` nearest to ``toward``, not counting the column parallel to ``without``."""
    score = direction.T @ toward
    if without is not None:
        score = np.where(np.abs(direction.T @ without) > 0.5, 0.0, score)
    k = int(np.argmax(np.abs(score)))
    sign = 1.0 if score[k] >= 0 else -1.0
    return np.asarray(sign * direction[:, k], dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Picture(AbstractValues):
    """A picture and its raster; for NumPy and ``plt.imshow`` it is its values, for a notebook's cell a PNG.

    Two pictures are equal if all of these fields are.

    Parameters
    ----------
    values : (nv, nu) grey values, or (nv, nu, 4) float32 red, green, blue (times alpha) and alpha.
    plane, raster : where its pixels are in space.
    method : name of the projection.
    window : values shown as black and white.
    grid : of the volume that is seen; None if the picture is of none.
    unit : of the grey values, such as "HU"; empty if that is not known.
    colour_map : colours of the grey values, a name of :data:`~deformnb.volume.colour_maps.COLOUR_MAPS`.

    Examples
    --------
    >>> plane = Plane((0, 0, 0), (1, 0, 0), (0, 1, 0))
    >>> grey = np.array([[0, 100], [200, 255]], np.uint8)
    >>> Picture(grey, plane, Raster((2, 2), (1.0, 1.0), (0.0, 0.0)), "slice", (0.0, 200.0)).rgb8()[1].tolist()
    [[255, 255, 255], [255, 255, 255]]
    """

    values: NDArray[Any]
    plane: Plane
    raster: Raster
    method: str
    window: tuple[float, float]
    grid: Grid | None = None
    unit: str = ""
    colour_map: ColourMapName = "grey"

    def __repr__(self) -> str:
        high, wide = self.values.shape[:2]
        low, white = self.window
        kind = "coloured" if self.values.ndim == 3 else f"{self.values.dtype.name} from {low:.6g} to {white:.6g}"
        return (
            f"<Picture: {self.method}, {wide} x {high} pixels (right, down) of "
            f"{' x '.join(f'{s:.6g}' for s in self.raster.spacing)}, {kind}>"
        )

    def __eq__(self, other: object) -> bool:
        return self.equals(other) if isinstance(other, Picture) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.about())

    def grey(self) -> NDArray[np.float32]:
        """(nv, nu) in [0, 1], black to white of the window; luminance over black for a coloured picture."""
        if self.values.ndim == 3:
            luminance = np.array((0.2126, 0.7152, 0.0722), dtype=np.float32)
            return np.asarray(np.clip(self.values[..., :3] @ luminance, 0, 1), dtype=np.float32)
        low, high = self.window
        # In 64 bits: neighbouring float64 or int32 values of a narrow window may be one number in 32.
        return np.clip((self.values.astype(np.float64) - low) / (high - low), 0, 1).astype(np.float32)

    def rgb8(self, background: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> NDArray[np.uint8]:
        """(nv, nu, 3) uint8 over a background colour."""
        if self.values.ndim == 2:
            return colour_table(self.colour_map)[(self.grey() * 255 + 0.5).astype(np.uint8)]
        color = self.values[..., :3] + (1 - self.values[..., 3:]) * np.asarray(background, dtype=np.float32)
        return (np.clip(color, 0, 1) * 255 + 0.5).astype(np.uint8)

    def _repr_png_(self) -> bytes:
        png: bytes = DISPLAYS["as_png"](self)
        return png

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """(a_min, a_max, b_max, b_min): matplotlib's ``imshow(..., extent=..., origin="upper")``."""
        a0, a1, b0, b1 = self.raster.box
        return (a0, a1, b1, b0)
