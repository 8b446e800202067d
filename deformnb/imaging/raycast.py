"""Ray casting on the CPU: front-to-back compositing of layers, gradient shading, clipped faces, perspective.

The layers are those that a viewer in front of a plane sees of a volume, one behind the other, clipped and in
perspective. A perspective needs no ray of its own: a layer twice as far from the eye is looked up twice as wide, and
the parallel composite of these layers is the picture that the eye sees.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deformnb._jax import compiled, jnp, lax
from deformnb.checks import check_fields
from deformnb.errors import DeformError
from deformnb.rbf.fields import Identity
from deformnb.volume.clip import ClipBox
from deformnb.volume.plane import Plane
from deformnb.volume.sampling import aligned_empty
from deformnb.volume.transfer import TransferFunction
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.warper import Warper

_AMBIENT, _DIFFUSE, _GLOSS, _POWER = 0.35, 0.75, 0.35, 24

LAMP = np.array([-0.35, -0.45, -0.82], np.float32) / np.linalg.norm([-0.35, -0.45, -0.82]).astype(np.float32)
"""The direction to the lamp along u, v and n of a picture: above the viewer's left shoulder. Pure headlight looks flat,
light from far aside leaves half in the dark."""


class Knots(NamedTuple):
    """A transfer function for the compiled code: its nodes and what changes from each to the next one.

    Parameters
    ----------
    values : (n,) where segments begin.
    inverse : (n,) 1 over the length of each; the last ones are endless and have 0.
    first : (4,) red, green, blue and alpha up to the first value.
    change : (n, 4) of each segment.
    power : thickness of a layer over the thickness that the alphas are meant for.
    """

    values: NDArray[np.float32]
    inverse: NDArray[np.float32]
    first: NDArray[np.float32]
    change: NDArray[np.float32]
    power: np.float32


# Up to so many segments are added up for each sample, which processors do for many samples at once: with 8 a composite
# takes 1.4 times as long as by the nearest entry of a table, and half as long as by interpolation in one. Beyond, each
# sample finds its own.
_ADDED = 32
_DIGITS = 2.0**23
_LARGEST = 1e30
_LEAST = np.float32(2.0**-100)  # processors take what is much smaller for 0
_AMBIENT_STEP = 4  # samples from one of the ambient light to the next: its cells are about as large
_EACH = 2  # their number is a multiple of this, so that few programs are compiled


def knots(transfer: TransferFunction, thickness: float, low: float = 0.0, scale: float = 1.0) -> Knots:
    """A transfer function, exactly, for values ``(v - low) * scale`` and layers of some thickness.

    A layer of another thickness than ``transfer.unit`` stops ``1 - (1 - alpha)^(thickness / unit)`` of the light, so
    that a picture does not get darker with finer sampling.
    """
    at, rgba = transfer.knots()
    # Multiples of 2^-23 up to 1 are added without an error: what is opaque stays so, whatever comes before it.
    rgba = np.round(rgba * _DIGITS) / _DIGITS
    values = _rounded_up((at - low) * scale)
    length = np.diff(values, append=np.float32(np.inf))
    # A jump is a segment of one step of a float32, which ends at its value: there holds what comes after it.
    jumps = length == 0
    length[jumps] = np.maximum(np.spacing(np.abs(values[jumps])), _LEAST)
    values[jumps] -= length[jumps]
    inverse = np.zeros_like(length)
    ends = np.isfinite(length)
    inverse[ends] = 1 / np.maximum(length[ends], _LEAST)
    short = ends & (np.where(ends, length, 0) * inverse < 1)
    inverse[short] = np.nextafter(inverse[short], np.float32(np.inf))  # a segment is whole at its end
    spare = -len(values) % _EACH
    return Knots(
        np.pad(values, (0, spare), mode="edge"),
        np.pad(inverse, (0, spare)),
        rgba[0].astype(np.float32),
        np.pad(np.diff(rgba, axis=0, append=rgba[-1:]), ((0, spare), (0, 0))).astype(np.float32),
        np.float32(thickness / transfer.unit),
    )


def _rounded_up(values: NDArray[np.float64]) -> NDArray[np.float32]:
    """A float32 is at or beyond a value if it is at or beyond this."""
    near = np.clip(values, -_LARGEST, _LARGEST).astype(np.float32)
    return np.where(near < values, np.nextafter(near, np.float32(np.inf)), near)


def _colour(v: Any, transfer: Any) -> tuple[Any, Any, Any, Any]:
    """Red, green, blue and alpha of values (v, u), each as a plane."""

    def within(start: Any, inverse: Any) -> Any:
        return jnp.clip((v - start) * inverse, 0, 1)

    count = transfer.values.shape[0]
    if count <= _ADDED:
        planes = [jnp.full(v.shape, transfer.first[c]) for c in range(4)]
        for k in range(count):
            t = within(transfer.values[k], transfer.inverse[k])
            planes = [plane + t * transfer.change[k, c] for c, plane in enumerate(planes)]
    else:
        at = jnp.maximum(jnp.searchsorted(transfer.values, v, side="right", method="scan") - 1, 0)
        starts = transfer.first + jnp.cumsum(transfer.change, axis=0) - transfer.change
        t = within(transfer.values[at], transfer.inverse[at])
        planes = [starts[at, c] + t * transfer.change[at, c] for c in range(4)]
    red, green, blue, alpha = planes
    return red, green, blue, -jnp.expm1(transfer.power * jnp.log1p(-jnp.clip(alpha, 0, 1)))


def _light_layers(
    state: Any,
    layers: Any,
    count: Any,
    transfer: Any,
    limits: Any,
    spacing: Any,
    light: Any,
    start: Any,
    faces: Any,
    ambience: Any,
    *,
    shaded: bool,
) -> Any:
    """Front to back: C += (1 - A) alpha c, A += (1 - A) alpha, over layers [1 + n, v, u] of values.

    ``limits`` are the value beyond the sides and the width of the range of values; ``start`` is the number of the first
    layer; ``faces`` (see :func:`deformnb.imaging.raycast.faces_of`, or None) cut off; ``ambience`` (see
    :func:`deformnb.imaging.raycast.ambience_beside`, or None) is the light that reaches each place.
    """

    def add(k: Any, total: Any) -> Any:
        here = layers[k + 1].astype(jnp.float32)
        *colors, alpha = _colour(here, transfer)
        ambient = 1.0 if ambience is None else _between(ambience, k)
        bright = _shade(layers, k, spacing, light, limits, ambient) if shaded else None
        if faces is not None:
            held, bare, glow = _beside(faces, start + k, here.shape)
            alpha = jnp.where(held, alpha, 0)
            bright = None if bright is None else bright + bare * (glow - bright)
        share = (1 - total[3]) * alpha
        lit = share if bright is None else share * bright
        return (*(sum_ + lit * color for sum_, color in zip(total[:3], colors, strict=True)), total[3] + share)

    return jnp.stack(lax.fori_loop(0, count, add, tuple(state[..., c] for c in range(4))), axis=-1)


def _shade(layers: Any, k: Any, spacing: Any, light: Any, limits: Any, ambient: Any) -> Any:
    """Brightness by Blinn and Phong, lit from both sides; 0.8 where the gradient vanishes and all ambient light comes.

    Outside the volume is background, so that where a body is cut off its face is lit like any surface.
    """
    before, after = layers[k].astype(jnp.float32), layers[k + 2].astype(jnp.float32)
    here = jnp.pad(layers[k + 1].astype(jnp.float32), 1, constant_values=limits[0])
    g = jnp.stack(
        [
            (after - before) / spacing[0],
            (here[2:, 1:-1] - here[:-2, 1:-1]) / spacing[1],
            (here[1:-1, 2:] - here[1:-1, :-2]) / spacing[2],
        ],
        axis=-1,
    )
    size = jnp.sqrt(jnp.sum(g * g, axis=-1))
    lamp = jnp.stack([light[2], light[1], light[0]])
    half = lamp + jnp.array([-1.0, 0.0, 0.0])
    half = half / jnp.sqrt(jnp.sum(half * half))
    n = g / jnp.maximum(size, 1e-6)[..., None]
    # What ambient light does not reach the lamp reaches less, for it is no point; shares as in the live view's shader.
    lit = ambient * (_AMBIENT + _GLOSS * jnp.abs(n @ half) ** _POWER) + (0.42 + 0.58 * ambient) * _DIFFUSE * jnp.abs(
        n @ lamp
    )
    # An even region has no surface: fade to plain colour where the slope is below a hundredth of the range per voxel.
    sure = jnp.clip(size * jnp.min(spacing) / (0.02 * limits[1]), 0, 1)
    return sure * lit + (1 - sure) * 0.8 * (0.3 + 0.7 * ambient)


def _between(ambience: Any, layer: Any) -> Any:
    """The ambient light of a layer of a block, interpolated between every :data:`_AMBIENT_STEP`-th one."""
    before = layer // _AMBIENT_STEP
    share = (layer - before * _AMBIENT_STEP) / _AMBIENT_STEP
    return ambience[before] + share * (ambience[before + 1] - ambience[before])


def _beside(faces: Any, layer: Any, shape: tuple[int, int]) -> tuple[Any, Any, Any]:
    """Masks of places within all faces, their nearness to a face that is seen, and the light of that face."""
    step, (a0, b0, c0) = faces["step"], faces["first"]
    c = c0 + step * layer
    wide = 1 + c * faces["bend"]
    a, b = wide * (a0 + step * jnp.arange(shape[1])), wide * (b0 + step * jnp.arange(shape[0]))[:, None]
    held, bare, glow = jnp.ones(shape, bool), jnp.zeros(shape, jnp.float32), jnp.zeros(shape, jnp.float32)
    for k in range(faces["planes"].shape[0]):
        u, v, n, offset = faces["planes"][k]
        depth = u * a + v * b + (n * c + offset)
        held &= depth >= 0
        near = jnp.clip(1.5 - depth * faces["nearness"][k], 0, 1) * (faces["nearness"][k] > 0)
        glow = jnp.where(near > bare, faces["glow"][k], glow)
        bare = jnp.maximum(bare, near)
    return held, bare, glow


def glow_of(normals: NDArray[np.float64], light: NDArray[Any]) -> NDArray[np.float32]:
    """Brightness of faces with these normals (..., 3) along u, v and n of a picture; ``light`` leads to the lamp.

    Examples
    --------
    >>> glow_of(np.array([[0.0, 0.0, 1.0]]), np.array([0.0, 0.0, -1.0])).round(2)
    array([1.45], dtype=float32)
    """
    half = light + np.array([0.0, 0.0, -1.0])
    half = (half / np.linalg.norm(half)).astype(normals.dtype)
    lit = _AMBIENT + _DIFFUSE * np.abs(normals @ light) + _GLOSS * np.abs(normals @ half) ** _POWER
    return np.asarray(lit, np.float32)


composite = compiled(_light_layers, donated="state", static_argnames="shaded")  # the next state takes its place


LayerBlocks: TypeAlias = Iterator[tuple[NDArray[Any], int]]

_NEAREST = 0.02  # of the distance of the eye: what is nearer to it is not seen


@dataclass(frozen=True)
class PerspectiveCamera:
    """A perspective camera in front of a plane's origin.

    Parameters
    ----------
    distance : from the plane; what lies in the plane has its true size.
    width, height : lengths of what is seen of the plane.
    """

    distance: float
    width: float
    height: float

    def __post_init__(self) -> None:
        check_fields(self)
        if not min(self.distance, self.width, self.height) > 0:
            raise DeformError(f"the distance, width and height of a camera are positive lengths, got {self}.")

    def lattice(self, grid: Grid, plane: Plane, spacing: float) -> Grid:
        """Samples along a plane's axes as wide as what is seen of it, and as deep as ``grid`` before the eye."""
        depths = plane.to_plane(grid.corners())[:, 2]
        near, far = max(float(depths.min()), (_NEAREST - 1) * self.distance), float(depths.max())
        wide, tall, deep = (
            max(1, int(np.ceil(length / spacing - 1e-9))) for length in (self.width, self.height, far - near)
        )
        first = [-(wide - 1) / 2 * spacing, -(tall - 1) / 2 * spacing, (near + far - (deep - 1) * spacing) / 2]
        axes = tuple(map(tuple, plane.frame.T))
        return Grid(
            (deep, tall, wide),
            (spacing,) * 3,
            tuple(plane.from_plane(first)),
            axes,  # type: ignore[arg-type]
            grid.unit,
        )

    def layer(self, lattice: Grid, plane: Plane, k: int) -> Grid:
        """The places of a layer of the lattice: wider the farther it is."""
        a, b, depth = plane.to_plane(lattice.index_to_point([0, 0, k]))
        share = max(_NEAREST, 1 + depth / self.distance)
        d = lattice.spacing[0]
        return replace(
            lattice,
            shape=(1, *lattice.shape[1:]),
            spacing=(d * share, d * share, d),
            origin=tuple(plane.from_plane([a * share, b * share, depth])),
        )


def blocks(
    volume: Volume,
    lattice: Grid,
    layers: int,
    margin: int,
    plane: Plane,
    part: ClipBox | None = None,
    eye: PerspectiveCamera | None = None,
) -> LayerBlocks:
    """Blocks of layers, the last one as large as the others: one compiled function resamples all of them.

    Parameters
    ----------
    lattice : along the axes of ``plane``.
    layers : in one block.
    margin : layers before and behind each block.
    part : outside of it is background.
    eye : sees the layers, which are then wider the farther they are.
    """
    if eye is not None:
        volume = _aligned(volume)
    for k in range(0, lattice.shape[0], layers):
        first, count = k - margin, layers + 2 * margin
        if eye is None:
            values = _seen(volume, lattice.crop((first, 0, 0), (count, *lattice.shape[1:])), part)
        else:
            values = np.concatenate([_seen(volume, eye.layer(lattice, plane, first + n), part) for n in range(count)])
        yield values, min(layers, lattice.shape[0] - k)


def ambience_of(light: Volume, lattice: Grid, plane: Plane, eye: PerspectiveCamera | None) -> NDArray[np.float32]:
    """Ambient light at every fourth sample of a lattice along each axis.

    Parameters
    ----------
    light : see :func:`deformnb.imaging.occlusion.ambient_light`; outside of it all light comes.
    """
    deep, tall, wide = ((n - 1) // _AMBIENT_STEP + 2 for n in lattice.shape)  # one beyond the last sample
    few = replace(lattice, shape=(deep, tall, wide), spacing=(_AMBIENT_STEP * lattice.spacing[0],) * 3)
    if eye is None:
        return np.asarray(Warper(light, output=few, fill=1.0)(Identity(3)).values, np.float32)
    layers = [eye.layer(few, plane, k) for k in range(deep)]
    return np.concatenate([Warper(light, output=layer, fill=1.0)(Identity(3)).values for layer in layers]).astype(
        np.float32
    )


def ambience_beside(ambience: NDArray[np.float32], start: int, layers: NDArray[Any]) -> NDArray[np.float32]:
    """Ambient light at every pixel of every fourth layer of a block, and of the next one.

    Parameters
    ----------
    ambience : of :func:`ambience_of`.
    start : number of the block's first layer, a multiple of 4.
    layers : [1 + n + 1, v, u] of the block.
    """
    first, count = start // _AMBIENT_STEP, (len(layers) - 2) // _AMBIENT_STEP + 1
    # A block may go on behind the last layer.
    made: NDArray[Any] = np.take(ambience, range(first, first + count), axis=0, mode="clip")
    share = np.arange(_AMBIENT_STEP, dtype=np.float32) / _AMBIENT_STEP
    for axis, n in ((1, layers.shape[1]), (2, layers.shape[2])):
        made = np.moveaxis(made, axis, -1)
        fine = made[..., :-1, None] + share * np.diff(made)[..., None]
        made = np.moveaxis(fine.reshape(*made.shape[:-1], -1)[..., :n], -1, axis)
    return np.ascontiguousarray(made)


def faces_of(
    part: ClipBox, lattice: Grid, plane: Plane, eye: PerspectiveCamera | None, light: NDArray[Any]
) -> dict[str, Any]:
    """The faces of a part for :func:`deformnb.imaging.raycast.composite`, in coordinates of the plane.

    Returns
    -------
    dict
        ``planes`` (6, 4): how far within it a place (a, b, c, 1) is; ``nearness`` (6,): 1 over the depth, along n, to
        which it is lit, 0 of one that is not seen; ``glow`` (6,): how brightly; and where the lattice begins.
    """
    points, inward = part.sides()
    normals = inward @ plane.frame.T
    offsets = ((np.asarray(plane.origin) - points) * inward).sum(axis=-1)
    d = lattice.spacing[0]
    deep = 2 * max(d, min(part.grid.spacing))  # as the live view lights them: wholly for a voxel, then less and less
    # Depth within a face that is 1 deep along n is its slope deep: seen at all only if it looks to the viewer.
    slope = np.maximum(normals[:, 2], 0.0)
    first = plane.to_plane(lattice.origin)
    return {
        "planes": np.column_stack([normals, offsets]).astype(np.float32),
        "nearness": np.where(slope > 1e-3, 1 / (deep * np.maximum(slope, 1e-3)), 0).astype(np.float32),
        "glow": glow_of(normals, light),
        "first": tuple(np.float32(c) for c in first),
        "step": np.float32(d),
        "bend": np.float32(0.0 if eye is None else 1 / eye.distance),
    }


def _seen(volume: Volume, lattice: Grid, part: ClipBox | None) -> NDArray[Any]:
    seen = Warper(volume, output=lattice)(Identity(3))
    return (
        seen.values
        if part is None
        else np.where(part.holds(lattice), seen.values, volume.dtype.type(volume.background))
    )


def _aligned(volume: Volume) -> Volume:
    """The volume where JAX shares its memory: it is looked at layer by layer, and must not be copied for each."""
    values = aligned_empty(volume.shape, volume.dtype)
    values[...] = volume.finite_values
    return replace(volume, values=values)
