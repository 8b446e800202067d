"""Folds in VTK's own volume shader: tissue that a map inverts is red with stripes, as in the live view.

The code is in the shader only while the maps that it samples invert a cell, which is checked here: a deformation
without folds is drawn by the same shader as ever.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from deformnb._jax import determinant, one_plus
from deformnb.analysis.folds import find_folds
from deformnb.rbf.extrusion import Extrusion, replicate
from deformnb.rbf.fields import AbstractField, DisplacementField
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.messages.views import PlanarData, SpaceData
from deformnb.widgets.textures import FieldTextures

RED = "the map folds: tissue there is red"
UNSEEN = "the map folds; this renderer does not show where"

# Nodes along the longest side where nothing but the field itself can be evaluated.
_NODES = 33

# Changes of slope of the weights of several maps; of more than these a bound must do.
MOST_BENDS = 64

# VTK computes a colour in one place only: of a sample, or of the largest value at the end of a ray. Whether that one is
# turned over must be known before.
REPLACED_FOR_FOLDS = {
    "texture2D(in_colorTransferFunc_0[0],": "dnb_tinted(in_colorTransferFunc_0[0],",
    "g_srcColor = computeColor(scalar, g_srcColor.a);": "dnb_turned = dnb_folded(g_dataPos); "
    "g_srcColor = computeColor(scalar, g_srcColor.a);",
    "l_maxValue.w = scalar.x;": "l_maxValue.w = scalar.x; dnb_turned = dnb_folded(g_dataPos);",
}
"""Replacements in VTK's shader that paint folds."""

# The sign of a determinant is the same in coordinates of textures. No step leads out of the visible box, where the maps
# are constant; next to a cut the map of the visible region continues.
_GLSL = """
float dnb_turned = 0.0;

float dnb_folded(vec3 q)
{
  vec3 way = 1.0 - 2.0 * step(dnb_high, q + dnb_fold_step), h = way * dnb_fold_step, at = %(at)s;
  vec3 u = %(u)s - at, v = %(v)s - at, w = %(w)s - at;
  return step(way.x * way.y * way.z * dot(cross(u, v), w), 0.0);
}

vec4 dnb_tinted(sampler2D colors, vec2 at)
{
  vec4 color = texture2D(colors, at);
  float stripe = step(mod(gl_FragCoord.x + gl_FragCoord.y + dnb_fold_row, 9.0), 2.2);
  vec3 red = mix(mix(color.rgb, vec3(0.827, 0.184, 0.184), 0.72), vec3(1.0, 0.78, 0.78), 0.55 * stripe);
  return vec4(mix(color.rgb, red, dnb_turned), color.a);
}
"""


def fold_glsl(has_cuts: bool) -> str:
    """The functions, behind those that sample a displacement."""
    look = "dnb_look({}, dnb_home)" if has_cuts else "dnb_warp({})"
    places = {"at": "q", "u": "q + vec3(h.x, 0.0, 0.0)", "v": "q + vec3(0.0, h.y, 0.0)", "w": "q + vec3(0.0, 0.0, h.z)"}
    return _GLSL % {name: look.format(place) for name, place in places.items()}


def fold_step(maps: FieldTextures, lattice: Grid) -> float:
    """Distance between samples of displacements: a length over which the samples show a slope."""
    planar, space = maps.content.planar, maps.content.space
    return max(
        min(lattice.spacing),
        min(planar["spacing"]) if planar is not None else 0.0,
        min(space["spacing"]) / 2 if space is not None else 0.0,
    )


# ---- whether it folds ------------------------------------------------------------------------------------------------


def maps_fold(maps: FieldTextures) -> bool:
    """Check whether maps invert a cell, at one of two opposite corners, at any weight that they have.

    Of a region next to a cut hidden cells count too. Not for maps with cuts of earlier steps.

    Examples
    --------
    >>> from deformnb.widgets.vtk.scene import frame_of
    >>> from deformnb.widgets.textures import field_textures
    >>> volume, field = mirrored_block()
    >>> maps_fold(field_textures(field, frame_of(volume), None, 64, 16))
    True
    """
    planar, space = maps.content.planar, maps.content.space
    return (planar is not None and _planar_folds(planar, maps)) or (space is not None and _space_folds(space, maps))


def _planar_folds(about: PlanarData, maps: FieldTextures) -> bool:
    count, rows, columns = about["shape"]
    regions = len(about["cut"]["sides"]) if about["cut"] is not None else 1
    samples = np.frombuffer(maps.buffer("maps"), "<f4").reshape(regions, count // regions, rows, columns, 2)
    weights = _bends(np.frombuffer(maps.buffer("weights"), "<f4").reshape(count // regions, -1))
    for slopes in _slopes(samples, about["spacing"]):
        steep = np.sqrt((slopes**2).sum(axis=(0, 1)).max(axis=(-2, -1)))  # (regions, maps)
        for a, b in zip(weights.T[:-1], weights.T[1:], strict=True):
            # Displacements smaller than the distance of neighbours turn nothing over.
            near = steep @ np.maximum(np.abs(a), np.abs(b)) >= 1
            if near.any() and (weights.shape[1] > MOST_BENDS or _turned_between(slopes[:, :, near], a, b)):
                return True
    return False


def _bends(weights: NDArray[np.float32]) -> NDArray[np.float32]:
    """The weights (maps, knots) at the knots where one of them changes its slope; of one map its least and its most."""
    if len(weights) == 1:
        return np.array([[weights.min(), weights.max()]])
    bent = np.abs(np.diff(weights, 2, axis=1)).max(axis=0, initial=0.0) > 1e-6
    return weights[:, np.concatenate([[True], bent, [True]])]


def _turned_between(slopes: NDArray[np.float32], a: NDArray[np.float32], b: NDArray[np.float32]) -> bool:
    """Check whether anything is inverted by weights from a to b: the determinant is a parabola in between."""
    one = one_plus(np.einsum("mnrkyx,k->mnryx", slopes, a))
    way = np.einsum("mnrkyx,k->mnryx", slopes, b - a)
    start, bow = determinant(one), determinant(way)
    tilt = one[0, 0] * way[1, 1] + one[1, 1] * way[0, 0] - one[0, 1] * way[1, 0] - one[1, 0] * way[0, 1]
    least = np.minimum(start, start + tilt + bow)
    inside = (tilt < 0) & (2 * bow > -tilt)
    least = np.where(inside, start - tilt**2 / (4 * np.where(inside, bow, 1.0)), least)
    return bool((~(least > 0)).any())


def _space_folds(about: SpaceData, maps: FieldTextures) -> bool:
    samples = np.frombuffer(maps.buffer("space"), "<f4").reshape(*about["shape"][::-1], 3)
    return any(
        bool(((slopes**2).sum(axis=(0, 1)) >= 1).any() and (~(determinant(one_plus(slopes)) > 0)).any())
        for slopes in _slopes(samples, about["spacing"])
    )


def _slopes(samples: NDArray[np.float32], spacing: list[float]) -> Iterator[NDArray[np.float32]]:
    """Derivatives [m, k, ...] of displacements (..., dim) in every cell: at its first corner, and at its last."""
    dim = samples.shape[-1]
    steps = [np.diff(samples, axis=-2 - k) / np.float32(spacing[k]) for k in range(dim)]
    for side in (slice(None, -1), slice(1, None)):
        at = [
            (..., *(slice(None) if axis == k else side for axis in reversed(range(dim))), slice(None))
            for k in range(dim)
        ]
        yield np.stack([np.moveaxis(step[where], -1, 0) for step, where in zip(steps, at, strict=True)], axis=1)


# ---- the folds of a scene -------------------------------------------------------------------------------------------


class Folding:
    """Folds of a scene, searched for at most once for each deformation and only on request.

    Parameters
    ----------
    works : checks with a picture whether the shader shows folds; default: it is taken to.

    Attributes
    ----------
    show : whether folds should be seen; False at first.
    """

    def __init__(self, works: Callable[[], bool] | None = None) -> None:
        self.show = False
        self._works = works
        self.set(None)

    def set(self, maps: FieldTextures | None, field: AbstractField | None = None, grid: Grid | None = None) -> None:
        """Set the current deformation: maps of a shader, or else a field, sampled on a grid."""
        self._maps, self._field, self._grid = maps, field, grid
        self._found: bool | None = None

    @property
    def _folds(self) -> bool:
        if self._found is None:
            if self._maps is not None:
                self._found = maps_fold(self._maps)
            else:
                self._found = (
                    self._field is not None
                    and self._grid is not None
                    and (find_folds(self._field, _coarse(self._grid)).least <= 0)
                )
        return self._found

    @property
    def is_red(self) -> bool:
        """True if the shader has something to paint red."""
        return self.show and self._maps is not None and self._folds and (self._works is None or self._works())

    @property
    def remark(self) -> str:
        """Remark for people on the deformed picture, or an empty text."""
        if not self.show or not self._folds:
            return ""
        return RED if self.is_red else UNSEEN


def _coarse(grid: Grid) -> Grid:
    size = np.asarray(grid.lengths)
    counts = np.maximum(2, np.ceil(_NODES * size / size.max())).astype(int)[::-1]
    return grid.resampled(shape=(int(counts[0]), int(counts[1]), int(counts[2])))


# ---- whether VTK shows it --------------------------------------------------------------------------------------------


def mirrored_block() -> tuple[Volume, AbstractField]:
    """A block whose right half is mirrored, and so turned over."""
    grid = Grid((8, 16, 16))
    volume = Volume(np.full(grid.shape, 200, np.uint8), grid)
    plane = Plane.from_view(grid, "+z")
    raster = Raster((2, 3), (8.0, 16.0), (float(plane.to_plane(grid.corners())[:, 0].min()), 0.0))
    samples = np.zeros((2, 3, 2))
    samples[:, 2, 0] = -16.0
    return volume, Extrusion(plane, plane.depth_range(grid), (DisplacementField(samples, raster),), *replicate())
