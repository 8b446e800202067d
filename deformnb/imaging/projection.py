"""Projections of a volume: slice, maximum intensity projection (MIP), mean, composite, from any side.

The light goes along the normal of a plane, front to back. Seen along an axis of the volume a pixel is exactly a column
of voxels; an oblique view resamples the volume trilinearly onto a lattice that is parallel to the picture, block by
block.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Progress
from deformnb.checks import check_choice, finite_number, short_value
from deformnb.errors import DeformError
from deformnb.imaging.raycast import (
    Faces,
    Layers,
    PerspectiveCamera,
    Shader,
    corners_of_blocks,
    light_sampler,
    windows_of,
)
from deformnb.volume.channels import ChannelDisplay, ChannelsLike, as_channels
from deformnb.volume.clip import ClipBox
from deformnb.volume.plane import Picture, Plane, Raster
from deformnb.volume.transfer import PresetName, TransferFunction, as_transfer, is_hounsfield, typical_range
from deformnb.volume.views import ViewName
from deformnb.volume.volume import ORTHONORMAL_TOLERANCE, Grid, Volume, VolumeLike, as_volume
from deformnb.warping.planning import run_parts

# Pixels of a picture that a thread makes at a time: NumPy's calls cost more than the work where there are few.
_PIXELS = 2**15
# Of the pixels are black, and as many of those brighter than black white: noise and a few bright spots.
SATURATED = 0.005
# Hounsfield units beyond enamel and cortical bone: metal, at which scanners of 12 bits end (3071).
METAL = 3000.0


@dataclass(frozen=True)
class Projection:
    """One way to make a picture of layers, front to back.

    Parameters
    ----------
    name, title : in code and in menus.
    seen : rows [v, u] of a picture of layers; None for a slice, and where light passes through.
    whole : all layers [depth, v, u] in one array, faster.
    is_light : whether light passes through, in the colours of a transfer function.
    """

    name: str
    title: str
    seen: Callable[[Layers, slice], NDArray[Any]] | None = None
    whole: Callable[[NDArray[Any]], NDArray[Any]] | None = None
    is_light: bool = False


def _largest(layers: Layers, rows: slice) -> NDArray[Any]:
    found = layers.values(0, rows, slice(0, layers.shape[2]))
    for k in range(1, layers.shape[0]):
        height, width = layers.window(k, rows)
        within = found[height.start - rows.start : height.stop - rows.start, width]
        np.maximum(within, layers.values(k, height, width), out=within)
    return found  # outside of the windows is background, the smallest value


def _mean(layers: Layers, rows: slice) -> NDArray[Any]:
    columns = slice(0, layers.shape[2])
    total = sum(layers.values(k, rows, columns).astype(np.float64) for k in range(layers.shape[0]))
    return np.asarray(total / layers.shape[0], dtype=np.float32)


def _integer_mean(values: NDArray[Any]) -> NDArray[Any]:
    kind = np.float32 if values.dtype.kind != "f" else values.dtype
    return np.asarray(values.mean(axis=0, dtype=kind), dtype=np.float32)


ProjectionName: TypeAlias = Literal["mip", "slice", "mean", "composite", "shaded"]
"""Names of the projections."""

PROJECTIONS: dict[str, Projection] = {
    p.name: p
    for p in (
        Projection("mip", "Maximum (MIP)", _largest, lambda values: values.max(axis=0)),
        Projection("slice", "Slice"),
        Projection("mean", "Mean", _mean, _integer_mean),
        Projection("composite", "Composite", is_light=True),
        Projection("shaded", "Shaded composite", is_light=True),
    )
}
"""All projections by name; the first is the default."""


ChannelProjectionName: TypeAlias = Literal["mip", "slice", "mean"]
"""Names of the projections of channels."""

OF_CHANNELS: tuple[ChannelProjectionName, ...] = get_args(ChannelProjectionName)
"""Projections that channels have in their colours; the others have colours and opacities of a transfer function."""


def project(
    volume: VolumeLike,
    view: ViewName | Plane = "+y",
    method: ProjectionName = "mip",
    *,
    transfer: TransferFunction | PresetName | None = None,
    depth: float | None = None,
    spacing: float | None = None,
    part: ClipBox | None = None,
    eye: PerspectiveCamera | None = None,
    ambience: VolumeLike | None = None,
    progress: Progress | None = None,
) -> Picture:
    """A picture of a volume.

    Parameters
    ----------
    volume : the volume to project; voxels that are not finite count as background.
    view : one of :data:`~deformnb.volume.views.VIEWS`, or any plane: its u points right, its v down, its normal away.
    method : a name of :data:`PROJECTIONS`.
    transfer : colours and opacities of "composite" and "shaded", or the name of a preset; default is "specimen".
    depth : place of a "slice" along the normal, from the plane; default is the plane itself (the middle of the volume
        for a view by name).
    spacing : pixel size of an oblique view; default is the smallest voxel size.
    part : outside of it is background, and where it cuts through a body its face is lit.
    eye : the camera of a perspective; a slice has none.
    ambience : light that reaches each place, for "shaded"; see :func:`~deformnb.imaging.occlusion.ambient_light`.
        Default is all of it everywhere.
    progress : called with the finished share from 0 to 1.

    Raises
    ------
    DeformError
        For an unknown method, a slice outside the volume, or a plane that is not one.

    Examples
    --------
    >>> volume = Volume(np.arange(24, dtype=np.uint8).reshape(2, 3, 4), Grid((2, 3, 4)))
    >>> project(volume, "+z").values.tolist()
    [[12, 13, 14, 15], [16, 17, 18, 19], [20, 21, 22, 23]]
    """
    check_choice(method, PROJECTIONS, "projection")
    volume = as_volume(volume)
    light = None if ambience is None else as_volume(ambience)
    plane = Plane.from_view(volume, view) if isinstance(view, str) else view
    for name, given, kind in (
        ("view", plane, Plane),
        ("part", part, ClipBox),
        ("eye", eye, PerspectiveCamera),
        ("ambience", light, Volume),
    ):
        if not isinstance(given, kind) and (given is not None or kind is Plane):
            raise DeformError(f"{name} must be a {kind.__name__}, got {short_value(given)}.")
    depth = None if depth is None else finite_number(depth, "the depth of a slice must be a length")
    how = PROJECTIONS[method]
    shader = Shader.from_volume(volume, as_transfer(transfer, volume), method == "shaded") if how.is_light else None
    if spacing is None and part is None and eye is None and ambience is None and voxel_order(volume.grid, plane):
        picture = _project_voxels(volume, plane, how, shader, depth, progress)
    else:
        picture = _project_lattice(volume, plane, how, shader, depth, spacing, part, eye, light, progress)
    if progress is not None:
        progress(1.0)
    if picture.values.ndim == 3:
        return picture
    return replace(picture, window=_window(picture.values, volume), unit="HU" if is_hounsfield(volume) else "")


def project_channels(
    channels: ChannelsLike,
    view: ViewName | Plane = "+y",
    method: ChannelProjectionName = "mip",
    *,
    displays: Sequence[ChannelDisplay] | None = None,
    depth: float | None = None,
    progress: Progress | None = None,
) -> Picture:
    """A picture of channels in their colours, added up.

    Parameters
    ----------
    channels : to project, each separately.
    view, method, depth, progress : as of :func:`project`; the method is one of :data:`OF_CHANNELS`.
    displays : colours, windows and visibility, as of :meth:`Channels.composite
        <deformnb.volume.channels.Channels.composite>`.

    Raises
    ------
    DeformError
        As :func:`project`, and for a method that makes colours.

    Examples
    --------
    >>> from deformnb.volume.channels import Channels
    >>> stained = Channels.from_array(np.eye(4, dtype=np.uint8)[None, :, :, None] * np.array([9, 0], np.uint8))
    >>> project_channels(stained, "+z").rgb8()[0, 0].tolist()
    [0, 255, 0]
    """
    channels = as_channels(channels)
    check_choice(method, OF_CHANNELS, "projection of channels")
    given = channels.displays() if displays is None else displays
    pictures: list[Picture] = []
    for k, volume in enumerate(channels):
        pictures.append(project(volume, view, method, depth=depth))
        if progress is not None:
            progress((k + 1) / len(channels))
    values = channels.composite([picture.values for picture in pictures], given)
    return replace(pictures[0], values=values, window=(0.0, 1.0), unit="")


def _window(values: NDArray[Any], volume: Volume) -> tuple[float, float]:
    """The automatic window of a grey picture.

    Black is the 0.5 percentile of the pixels, white the 99.5 percentile of those brighter than black: where much of a
    picture is background, white follows the subject alone. Values outside of the volume's
    :func:`~deformnb.volume.transfer.typical_range` does not count, such as the padding of a scanner, nor in Hounsfield
    units values brighter than any tissue: an implant covers more of a projection than it has voxels. Of labels, and
    where all pixels are equal, black is the smallest value of the volume.
    """
    lowest, highest = typical_range(volume)
    if is_hounsfield(volume):
        highest = min(highest, METAL)
    shown = values[(values >= lowest) & (values <= highest)].astype(np.float64)
    is_even = volume.is_labels or not shown.size or shown.min() == shown.max()
    low = volume.background if is_even else float(np.quantile(shown, SATURATED))
    subject = shown[shown > low]
    high = float(np.quantile(subject, 1 - SATURATED)) if subject.size else low
    # One grey level of the type, or one step of a float, where everything is equal: never a window without width.
    return low, high if high > low else low + max(1.0, abs(low)) * (1.0 if values.dtype.kind != "f" else 1e-6)


def voxel_order(grid: Grid, plane: Plane) -> list[tuple[int, int]] | None:
    """Array axis and sign of depth, v and u if the plane is along the voxel axes, else None."""
    cosines = plane.frame[[2, 1, 0]] @ np.asarray(grid.direction)
    best = np.abs(cosines).argmax(axis=1)
    # Cosines near 1 do not resolve small turns (0.2 degrees: 1 - 6e-6, yet 2 voxels at the edge of 512), those near
    # 0 do. A plane along the axes of a grid that is square only within its tolerance may be twice that off them.
    aside = cosines.copy()
    aside[[0, 1, 2], best] = 0
    if sorted(best) != [0, 1, 2] or np.abs(aside).max() > 2 * ORTHONORMAL_TOLERANCE:
        return None
    return [(2 - int(k), 1 if cosines[row, k] > 0 else -1) for row, k in enumerate(best)]


def _project_voxels(
    volume: Volume, plane: Plane, how: Projection, shader: Shader | None, depth: float | None, progress: Progress | None
) -> Picture:
    order = voxel_order(volume.grid, plane)
    assert order is not None
    turned = volume.finite_values.transpose([axis for axis, _ in order])
    turned = turned[tuple(slice(None, None, sign) for _, sign in order)]  # [depth, v, u], a view
    dn, dv, du = (volume.grid.spacing[2 - axis] for axis, _ in order)
    corner = plane.to_plane(volume.grid.corners(centres=True)).min(axis=0)
    raster = Raster((turned.shape[1], turned.shape[2]), (du, dv), (float(corner[0]), float(corner[1])))
    if shader is not None:
        layers = Layers(turned.shape, (dn, dv, du), lambda k, rows, columns: turned[k, rows, columns])
        values = _render(layers, shader.composite, progress)
    elif how.whole is not None:
        values = how.whole(turned)
    else:
        axis, sign = order[0]
        values = turned[::sign][_slice_number(volume.grid, plane, axis, depth or 0.0)]
    return Picture(np.ascontiguousarray(values), plane, raster, how.name, (0.0, 1.0), volume.grid)


def _slice_number(grid: Grid, plane: Plane, axis: int, depth: float) -> int:
    """The voxels along an array axis that a slice goes through; between two, the later ones, from both sides."""
    at = float(grid.point_to_index(plane.from_plane([0.0, 0.0, depth]))[2 - axis])
    index, count = math.floor(at + 0.5 + 1e-9), grid.shape[axis]  # the middle between two is rarely met exactly
    if not 0 <= index < count:
        raise DeformError(f"the slice would be number {index} of {count}: outside the volume. Choose another depth.")
    return index


def _render(layers: Layers, seen: Callable[[Layers, slice], NDArray[Any]], progress: Progress | None) -> NDArray[Any]:
    """Render layers in blocks of rows."""
    tall, wide = layers.shape[1:]
    step = max(1, _PIXELS // wide)
    parts = [slice(k, min(k + step, tall)) for k in range(0, tall, step)]
    found: dict[int, NDArray[Any]] = {}
    run_parts(parts, lambda rows: found.update({rows.start: seen(layers, rows)}), progress)
    return np.concatenate([found[rows.start] for rows in parts])


def _project_lattice(
    volume: Volume,
    plane: Plane,
    how: Projection,
    shader: Shader | None,
    depth: float | None,
    spacing: float | None,
    part: ClipBox | None,
    eye: PerspectiveCamera | None,
    ambience: Volume | None,
    progress: Progress | None,
) -> Picture:
    """An oblique view, through a lattice parallel to the picture."""
    lattice = plane_lattice(volume.grid, plane, spacing)
    if eye is not None and how.name != "slice":
        lattice = eye.lattice(volume.grid, plane, lattice.spacing[0])
    d = lattice.spacing[0]
    low = plane.to_plane(lattice.origin)
    raster = Raster(lattice.shape[1:], (d, d), (float(low[0]), float(low[1])))
    whole = ClipBox.whole(volume.grid)
    held = (whole,) if part is None else (whole, part)
    if shader is not None:
        if part is None and voxel_order(volume.grid, plane) is None:
            part = whole  # where the volume ends slopes are a staircase, seen aslant
        shader = replace(
            shader,
            faces=None if part is None else Faces.from_part(part, plane, d),
            ambience=None if ambience is None else light_sampler(ambience, plane),
        )
        values = _light(volume, lattice, plane, shader, eye, progress)
    elif how.seen is not None:
        blocks = corners_of_blocks(volume.finite_values > volume.background, volume.grid)
        windows = windows_of(blocks, lattice, plane, eye)
        is_read = how.name == "mip" and part is None and eye is None  # the largest of rounded values is that rounded
        read = Layers.read_rounded(volume, lattice, windows) if is_read else None
        layers = read or Layers.from_lattice(volume, lattice, plane, held=held, eye=eye, windows=windows)
        values = _round(_render(layers, how.seen, progress), volume, how)
    else:
        depths = plane.to_plane(volume.grid.corners())[:, 2]
        near, far = float(depths.min()), float(depths.max())
        if not near <= (depth or 0.0) <= far:
            raise DeformError(f"the slice at depth {depth or 0.0:g} is outside the volume ({near:g} to {far:g}).")
        at = tuple(plane.from_plane([low[0], low[1], depth or 0.0]))
        one = replace(lattice, shape=(1, *lattice.shape[1:]), origin=at)
        layers = Layers.from_lattice(volume if part is None else part.mask_outside(volume), one, plane, held=(whole,))
        values = _round(layers.values(0, slice(0, lattice.shape[1]), slice(0, lattice.shape[2])), volume, how)
    return Picture(np.ascontiguousarray(values), plane, raster, how.name, (0.0, 1.0), volume.grid)


def _round(values: NDArray[Any], volume: Volume, how: Projection) -> NDArray[Any]:
    """Values in the type of the volume; means are not rounded."""
    if how.name == "mean" or volume.dtype.kind == "f":
        return values
    return np.rint(values).astype(volume.dtype)


def _light(
    volume: Volume,
    lattice: Grid,
    plane: Plane,
    shader: Shader,
    eye: PerspectiveCamera | None,
    progress: Progress | None,
) -> NDArray[np.float32]:
    """A picture by light, of which only the part is computed where something may be seen."""
    out = np.zeros((*lattice.shape[1:], 4), np.float32)
    windows = windows_of(shader.visible_blocks(volume), lattice, plane, eye)
    (met,) = np.nonzero(windows[:, 1])
    if len(met):
        n = slice(int(met[0]), int(met[-1]) + 1)
        (top, _, left, _), (_, bottom, _, right) = windows[met].min(axis=0), windows[met].max(axis=0)
        seen = lattice.crop((n.start, int(top), int(left)), (n.stop - n.start, int(bottom - top), int(right - left)))
        held = (ClipBox.whole(volume.grid),) if shader.faces is None else ()
        layers = Layers.from_lattice(
            volume, seen, plane, held=held, eye=eye, is_smooth=True, windows=windows[n] - [top, top, left, left]
        )
        out[top:bottom, left:right] = _render(layers, shader.composite, progress)
    return out


def plane_lattice(grid: Grid, plane: Plane, spacing: float | None = None) -> Grid:
    """A grid with axes u, v, n of a plane that covers ``grid``, with voxels of one size (default: its smallest)."""
    wanted = "the pixel size must be a positive length"
    d = min(grid.spacing) if spacing is None else finite_number(spacing, wanted)
    if d <= 0:
        raise DeformError(f"{wanted}, got {spacing}.")
    corners = plane.to_plane(grid.corners())
    low, high = corners.min(axis=0), corners.max(axis=0)
    count = np.maximum(1, np.ceil((high - low) / d - 1e-9)).astype(int)
    first = (low + high) / 2 - d * (count - 1) / 2
    shape = (int(count[2]), int(count[1]), int(count[0]))
    axes = tuple(map(tuple, plane.frame.T))
    return Grid(shape, (d, d, d), tuple(plane.from_plane(first)), axes, grid.unit)  # type: ignore[arg-type]
