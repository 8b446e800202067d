"""Orthogonal slices of a deformed volume, with the geometry that a front end needs to draw points in them.

A slice of a deformation in space takes its voxels from other slices, so the three pictures are made here, each by
warping the volume onto the lattice of that one slice: a few milliseconds, and the same voxels as in the whole deformed
volume.
"""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb.analysis.folds import Folds, find_folds, jacobian_determinant
from deformnb.checks import check_window
from deformnb.document.json_regions import region_to_data
from deformnb.imaging.projection import ProjectionName, project
from deformnb.rbf.cuts import Cut
from deformnb.rbf.fields import AbstractField, Identity
from deformnb.rbf.regions import HalfSpace
from deformnb.volume.colour_maps import COLOUR_MAPS, ColourMapName, colour_table
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.transfer import TransferFunction, levels
from deformnb.volume.views import ViewName
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.foreground import coarse_tissue
from deformnb.warping.warper import Warper
from deformnb.widgets.messages.editors import SliceProjection
from deformnb.widgets.packed_volume import packed_volume, unit_of

PANES: dict[ViewName, str] = {"+z": "axial", "+y": "coronal", "-x": "sagittal"}
"""Viewing directions of the three pictures and what radiologists call them; a nose points up or to the left."""

SLICE_PROJECTIONS = get_args(SliceProjection)
"""Projections of the pictures: a slice, or all of the volume seen from that side."""

# Voxels of the volume that a projection warps while something moves, and at rest: 40 ms and a third of a second.
_MAXIMUM, _LIGHT = (96**3, 192**3), (64**3, 128**3)
_LARGEST_SIDE = 2048
# Nodes along the longest side of the lattice on which folds are looked for.
_FOLD_NODES, _QUICK_FOLD_NODES = 24, 12  # at rest, and while points move: a few milliseconds
_SHAPE_PIXELS = 192  # along the longer side, of cuts on a slice
_FLAT, _FAINT = 0.1, 0.15  # a cut that leaves a slice no faster, by length, covers much of it and is tinted as faintly
_DETS, _QUICK_DETS = 96, 48  # along the longer side of a slice, of det J at rest and while something moves
_OPAQUE = 0.5  # accumulated in front of a place: there the surface of a composite picture is


@dataclass(frozen=True)
class Pane:
    """Plane and lattice of one of the pictures.

    Parameters
    ----------
    name : of the picture.
    plane : of the first slice; depth runs along its normal.
    box : (a0, a1, b0, b1, c0, c1), outer faces of the volume in the plane's coordinates.
    spacing : of voxels along u, v and the normal.
    lengths : their unit, as it is shown.
    is_anatomical : whether the sides of a patient are known.
    """

    name: str
    plane: Plane
    box: tuple[float, ...]
    spacing: tuple[float, float, float]
    lengths: str = ""
    is_anatomical: bool = True

    @classmethod
    def of(cls, grid: Grid, view: ViewName) -> Pane:
        """The picture of a volume seen along one of its axes."""
        plane = Plane.from_view(grid, view, depth=0.0)
        corners = plane.to_plane(grid.corners())
        low, high = corners.min(axis=0), corners.max(axis=0)
        axes = np.abs(plane.frame @ np.asarray(grid.direction)).argmax(axis=1)
        u, v, n = (float(grid.spacing[k]) for k in axes)
        box = tuple(float(x) for pair in zip(low, high, strict=True) for x in pair)
        return cls(PANES[view], plane, box, (u, v, n), unit_of(grid), grid.is_anatomical)

    @property
    def depths(self) -> tuple[float, float]:
        """Of the middles of the first and of the last slice."""
        return self.box[4] + self.spacing[2] / 2, self.box[5] - self.spacing[2] / 2

    def raster(self, most: int) -> Raster:
        """Square pixels over the picture, as fine as the voxels but at most so many along a side."""
        a0, a1, b0, b1 = self.box[:4]
        d = max(min(self.spacing[:2]), max(a1 - a0, b1 - b0) / most)
        nu, nv = (max(1, round(length / d)) for length in (a1 - a0, b1 - b0))
        du, dv = (a1 - a0) / nu, (b1 - b0) / nv
        return Raster((nv, nu), (du, dv), (a0 + du / 2, b0 + dv / 2))

    def lattice(self, depth: float, most: int) -> Grid:
        """The voxels of one slice."""
        raster = self.raster(most)
        origin = self.plane.from_plane([*raster.origin, depth])
        direction = tuple(tuple(float(x) for x in row) for row in self.plane.frame.T)
        return Grid((1, *raster.shape), (*raster.spacing, self.spacing[2]), tuple(origin), direction)  # type: ignore[arg-type]

    def depth_of(self, place: ArrayLike) -> float:
        """Depth of a place in space, at most on the last slice."""
        return float(np.clip(self.plane.to_plane(place)[2], *self.depths))

    def behind(self, place: ArrayLike) -> HalfSpace:
        """All that lies behind the slice through a place."""
        x, y, z = np.asarray(place, dtype=np.float64).tolist()
        u, v, w = self.plane.normal
        return HalfSpace((x, y, z), (-u, -v, -w))

    def info(self) -> dict[str, Any]:
        """Geometry of the pane for the front end."""
        plane = self.plane
        return {
            "name": self.name,
            "origin": list(plane.origin),
            "u": list(plane.u),
            "v": list(plane.v),
            "n": list(plane.normal),
            "box": list(self.box),
            "depths": list(self.depths),
            "spacing": list(self.spacing),
            "lengths": self.lengths,
            "anatomical": self.is_anatomical,
        }


@dataclass(frozen=True, eq=False)
class Shown:
    """One picture as the front end gets it.

    Parameters
    ----------
    values : uint8 (nv, nu) or (nv, nu, 3).
    raster : of its pixels.
    depths : of projections, the depth that is seen at each pixel, float32 (nv, nu).
    cuts : of slices, uint8 (n, m) over the same box: how much of each place is on a cut.
    dets : of slices that fold, det J at the middles of (n, m) pixels over the same box, where no front end knows it.
    """

    values: NDArray[np.uint8]
    raster: Raster
    depths: NDArray[np.float32] | None = None
    cuts: NDArray[np.uint8] | None = None
    dets: NDArray[np.float32] | None = None

    def message(self) -> tuple[dict[str, Any], list[bytes]]:
        """Message about the pane, and its buffers."""
        raster = self.raster
        about = {
            "shape": list(raster.shape),
            "spacing": list(raster.spacing),
            "origin": list(raster.origin),
            "channels": 1 if self.values.ndim == 2 else 3,
            "hasDepths": self.depths is not None,
            "cuts": None if self.cuts is None else list(self.cuts.shape),
            "dets": None if self.dets is None else list(self.dets.shape),
        }
        parts = [self.values, None if self.depths is None else self.depths.astype("<f4"), self.cuts, self.dets]
        return about, [np.ascontiguousarray(part).tobytes() for part in parts if part is not None]


class SpacePictures:
    """A volume made ready to be seen in three pictures.

    Parameters
    ----------
    window : values that are black and white; default is from the background to the densest tissue.
    transfer : colours and opacities of composite pictures.
    colour_map : of slices, a name of :data:`~deformnb.volume.colour_maps.COLOUR_MAPS`.
    """

    def __init__(
        self,
        volume: Volume,
        transfer: TransferFunction,
        window: tuple[float, float] | None = None,
        colour_map: ColourMapName = COLOUR_MAPS[0],
    ) -> None:
        self._colours = None if colour_map == COLOUR_MAPS[0] else colour_table(colour_map)
        self.volume, self.transfer, self.colour_map = volume, transfer, colour_map
        self.panes = tuple(Pane.of(volume.grid, view) for view in PANES)
        self.window = _window(volume) if window is None else check_window(window)
        self._coarser: dict[int, Volume] = {}
        self._projected: tuple[Any, dict[int, Shown]] = ((), {})

    def slice(self, index: int, field: AbstractField | None, place: ArrayLike, most: int) -> Shown:
        """One slice of the deformed volume through a place."""
        pane = self.panes[index]
        lattice = pane.lattice(pane.depth_of(place), most)
        values = Warper(self.volume, output=lattice)(Identity(3) if field is None else field).values[0]
        greys = _grey(values, *self.window)
        return Shown(greys if self._colours is None else self._colours[greys], pane.raster(most))

    def projection(self, index: int, field: AbstractField | None, method: ProjectionName, *, is_quick: bool) -> Shown:
        """All of the deformed volume seen from one side; from fewer voxels if it is to be quick."""
        limit = (_MAXIMUM if method == "mip" else _LIGHT)[0 if is_quick else 1]
        key = (id(field), method, limit)
        if self._projected[0] != (key, field):
            warped = self._coarse(limit) if field is None else Warper(self._coarse(limit), step=2)(field)
            self._projected = ((key, field), {k: self._project(warped, k, method) for k in range(len(self.panes))})
        return self._projected[1][index]

    def _coarse(self, limit: int) -> Volume:
        if limit not in self._coarser:
            shown = packed_volume(self.volume, limit, _LARGEST_SIDE, self.window)
            low, high = self.window
            values = shown.volume.values.astype(np.float32) * np.float32((high - low) / 255) + np.float32(low)
            self._coarser[limit] = Volume(values, shown.volume.grid, self.volume.name)
        return self._coarser[limit]

    def _project(self, volume: Volume, index: int, method: ProjectionName) -> Shown:
        plane = self.panes[index].plane
        picture = project(volume, plane, method, transfer=self.transfer)
        values = picture.rgb8() if picture.values.ndim == 3 else _grey(picture.values, *self.window)
        layers, depths = _layers(volume, plane)
        if method == "mip":
            seen = layers.argmax(axis=0)
        else:  # where half of the light has been stopped; where nothing stops it, at the brightest
            alphas = np.clip(self.transfer(layers.reshape(-1))[:, 3].reshape(layers.shape), 0, 0.9999)
            thickness = abs(depths[1] - depths[0]) / self.transfer.unit if len(depths) > 1 else 1.0
            passed = np.cumsum(np.log1p(-alphas) * thickness, axis=0) < np.log1p(-_OPAQUE)
            seen = np.where(passed.any(axis=0), passed.argmax(axis=0), layers.argmax(axis=0))
        return Shown(values, picture.raster, depths[seen].astype(np.float32))


def _layers(volume: Volume, plane: Plane) -> tuple[NDArray[Any], NDArray[np.float64]]:
    """The voxels as [depth, v, u] of a plane along their axes, and the depths."""
    cosines = plane.frame[[2, 1, 0]] @ np.asarray(volume.grid.direction)
    best = np.abs(cosines).argmax(axis=1)
    layers = volume.values.transpose([2 - int(k) for k in best])
    layers = layers[tuple(slice(None, None, 1 if cosines[row, k] > 0 else -1) for row, k in enumerate(best))]
    corners = plane.to_plane(volume.grid.corners(centres=True))[:, 2]
    return layers, np.linspace(corners.min(), corners.max(), len(layers))


def cuts_on(pane: Pane, depth: float, cuts: Sequence[Cut]) -> NDArray[np.uint8] | None:
    """Coverage of a slice by cuts, in shares of 255, uint8 (n, m); None if there are none."""
    regions = [cut.region for cut in cuts if cut.enabled]
    if not regions:
        return None
    raster = pane.raster(_SHAPE_PIXELS)
    points = raster.points()
    x = pane.plane.from_plane(np.concatenate([points, np.full((*raster.shape, 1), depth)], axis=-1))
    shares, pixel = np.zeros(raster.shape), max(raster.spacing)
    for region in regions:
        far = region.signed_distance(x)
        rows, columns = np.gradient(far, *raster.spacing[::-1])
        strength = np.where(np.hypot(rows, columns) > _FLAT, 1.0, _FAINT)
        shares = np.maximum(shares, strength * np.clip(1.3 - np.abs(far) / pixel, 0, 1))
    return (shares * 255 + 0.5).astype(np.uint8)


def dets_on(pane: Pane, depth: float, field: AbstractField, *, is_quick: bool) -> NDArray[np.float32] | None:
    """det J on a slice, float32 (n, m); None if it folds nowhere there."""
    found = jacobian_determinant(field, pane.lattice(depth, _QUICK_DETS if is_quick else _DETS))[0]
    return None if found.min() > 0 else np.asarray(found, dtype="<f4")


def tissue_mask(volume: Volume) -> dict[str, Any]:
    """The voxels of tissue, of which folds count, as documents hold a mask; fewer than the volume has."""
    if volume not in _MASKS:
        _MASKS[volume] = region_to_data(coarse_tissue(volume, _TISSUE_VOXELS))
    return _MASKS[volume]


_MASKS: weakref.WeakKeyDictionary[Volume, dict[str, Any]] = weakref.WeakKeyDictionary()
_TISSUE_VOXELS = 64  # along each axis: a fold is wider


def _window(volume: Volume) -> tuple[float, float]:
    low, high = volume.value_range
    if not (volume.is_labels or volume.dtype == np.bool_):
        low, _, _, high = levels(volume)
    return low, high if high > low else low + max(1.0, abs(low)) * 1e-6


def _grey(values: NDArray[Any], low: float, high: float) -> NDArray[np.uint8]:
    scaled = (values.astype(np.float32) - np.float32(low)) * np.float32(255 / (high - low))
    return np.clip(scaled + 0.5, 0, 255).astype(np.uint8)


def slice_folds(field: AbstractField, grid: Grid, *, is_quick: bool = False) -> Folds:
    """The smallest factor by which a field stretches volumes, where that is, and the share of places where it folds.

    On a coarse lattice: it finds folds of a tenth of the volume, not those between two nodes. A quick one is for points
    that move.

    Examples
    --------
    >>> slice_folds(Identity(3), Grid((20, 20, 20))).share
    0.0
    """
    lengths = np.asarray(grid.spacing) * np.asarray(grid.shape[::-1])
    counts = np.maximum(3, np.round((_QUICK_FOLD_NODES if is_quick else _FOLD_NODES) * lengths / lengths.max())).astype(
        int
    )
    spacing = lengths / counts
    first = grid.index_to_point((spacing / np.asarray(grid.spacing) - 1) / 2)
    lattice = replace(
        grid, shape=(int(counts[2]), int(counts[1]), int(counts[0])), spacing=tuple(spacing), origin=tuple(first)
    )
    return find_folds(field, lattice)
