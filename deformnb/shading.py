"""Light through layers of values, front to back: colours and opacities, slopes that are lit, faces that were cut."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import lax
from numpy.typing import NDArray

from deformnb.compilation import compiled

_AMBIENT, _DIFFUSE, _GLOSS, _POWER = 0.35, 0.75, 0.35, 24


def _light_layers(state: Any, layers: Any, count: Any, table: Any, limits: Any, spacing: Any, light: Any, start: Any,
                  faces: Any, *, shaded: bool) -> Any:
    """Front to back: C += (1 - A) alpha c, A += (1 - A) alpha, over layers [1 + n, v, u] of values.

    ``start`` is the number of the first one; ``faces`` (see :func:`deformnb.sight.faces_of`, or None) cut off.
    """
    scale = (table.shape[0] - 1) / (limits[1] - limits[0])

    def add(k: Any, total: Any) -> Any:
        here = layers[k + 1].astype(jnp.float32)
        rgba = table[jnp.clip((here - limits[0]) * scale + 0.5, 0, table.shape[0] - 1).astype(jnp.int32)]
        color, alpha = rgba[..., :3], rgba[..., 3:]
        bright = _shade(layers, k, spacing, light, limits) if shaded else None
        if faces is not None:
            held, bare, glow = _beside(faces, start + k, here.shape)
            alpha = jnp.where(held[..., None], alpha, 0)
            bright = None if bright is None else bright + bare * (glow - bright)
        color = color if bright is None else color * bright[..., None]
        share = (1 - total[..., 3:]) * alpha
        return total + share * jnp.concatenate([color, jnp.ones_like(alpha)], axis=-1)

    return lax.fori_loop(0, count, add, state)


def _shade(layers: Any, k: Any, spacing: Any, light: Any, limits: Any) -> Any:
    """Brightness by Blinn and Phong, lit from both sides; 0.8 where the gradient says nothing.

    Outside the volume is background, so that where a body is cut off its face is lit like any surface.
    """
    before, after = layers[k].astype(jnp.float32), layers[k + 2].astype(jnp.float32)
    here = jnp.pad(layers[k + 1].astype(jnp.float32), 1, constant_values=limits[0])
    g = jnp.stack([(after - before) / spacing[0], (here[2:, 1:-1] - here[:-2, 1:-1]) / spacing[1],
                   (here[1:-1, 2:] - here[1:-1, :-2]) / spacing[2]], axis=-1)
    size = jnp.sqrt(jnp.sum(g * g, axis=-1))
    lamp = jnp.stack([light[2], light[1], light[0]])
    half = lamp + jnp.array([-1.0, 0.0, 0.0])
    half = half / jnp.sqrt(jnp.sum(half * half))
    n = g / jnp.maximum(size, 1e-6)[..., None]
    lit = _AMBIENT + _DIFFUSE * jnp.abs(n @ lamp) + _GLOSS * jnp.abs(n @ half) ** _POWER
    # An even region has no surface: fade to plain colour where the slope is below a hundredth of the range per voxel.
    sure = jnp.clip(size * jnp.min(spacing) / (0.02 * (limits[1] - limits[0])), 0, 1)
    return sure * lit + (1 - sure) * 0.8


def _beside(faces: Any, layer: Any, shape: tuple[int, int]) -> tuple[Any, Any, Any]:
    """Of places in a layer: whether they are within all faces, how near to one that is seen, and that one's light."""
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
    """How bright faces with these normals (..., 3) along u, v and n of a picture are; ``light`` leads to the lamp.

    Examples
    --------
    >>> glow_of(np.array([[0.0, 0.0, 1.0]]), np.array([0.0, 0.0, -1.0])).round(2)
    array([1.45], dtype=float32)
    """
    half = light + np.array([0.0, 0.0, -1.0])
    half = half / np.linalg.norm(half)
    lit = _AMBIENT + _DIFFUSE * np.abs(normals @ light) + _GLOSS * np.abs(normals @ half) ** _POWER
    return np.asarray(lit, np.float32)


composite = compiled(_light_layers, static_argnames="shaded")
