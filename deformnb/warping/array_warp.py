"""The warp of an array within functions that JAX compiles, differentiates and maps."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from deformnb._jax import HAS_JAX, check_process, jax, jnp
from deformnb.checks import short_value
from deformnb.errors import DeformError, raise_missing_jax
from deformnb.volume import sampling
from deformnb.volume.sampling import SamplingName
from deformnb.volume.volume import Grid
from deformnb.warping import planning, xla_call

_TYPES = ("uint8", "int8", "uint16", "int16", "float32")


def warp_array(
    values: Any,
    displacements: Any,
    grid: Grid,
    *,
    output: Grid | None = None,
    fill: float = 0.0,
    method: SamplingName = "linear",
) -> Any:
    """The deformed voxels as an array of JAX: ``out(x) = values(x + d(x))``.

    Stands inside ``jax.jit``, ``grad``, ``jvp`` and ``vmap``, for example to register one scan with another by descent
    along a gradient. On a processor the voxels are read by the compiled loops through ``jax.ffi``, on one thread; on a
    GPU, and for derivatives, by operations of JAX. :func:`~deformnb.warping.warper.warp` is faster outside of compiled
    functions and checks its input.

    Parameters
    ----------
    values : (nz, ny, nx) voxels of uint8, int8, uint16, int16 or float32.
    displacements : (3, nz, ny, nx) backward displacements along x, y, z in the units of the grid, at the voxels of the
        output. One that is not finite leads outside.
    grid : of the voxels.
    output : the grid of the result; default is ``grid``.
    fill : value of places more than half a voxel outside.
    method : "linear" or "nearest".

    Returns
    -------
    (nz, ny, nx) voxels of the output in the type of ``values``. The derivative is that of linear interpolation within
    the cells; it is zero for integers, which are rounded, outside, and for "nearest".

    Raises
    ------
    DeformError
        If shapes do not fit, the type is another one, or the method needs more than the neighbours of a place; where
        JAX is not installed.

    Examples
    --------
    >>> import jax, jax.numpy as jnp
    >>> grid = Grid((1, 1, 4), (1.0, 1.0, 1.0))
    >>> ramp = jnp.array([[[0.0, 10.0, 20.0, 30.0]]])
    >>> d = jnp.zeros((3, 1, 1, 4)).at[0].set(0.5)
    >>> warp_array(ramp, d, grid).tolist()
    [[[5.0, 15.0, 25.0, 0.0]]]
    >>> jax.grad(lambda d: warp_array(ramp, d, grid).sum())(d)[0].tolist()
    [[[10.0, 10.0, 10.0, 0.0]]]
    """
    if not HAS_JAX:
        raise_missing_jax("warp_array, which stands in functions that JAX compiles and differentiates,")
    check_process()
    output = grid if output is None else output
    values, d = jnp.asarray(values), jnp.asarray(displacements, jnp.float32)
    if values.shape != grid.shape or d.shape != (3, *output.shape):
        raise DeformError(
            f"voxels {values.shape} of a grid {grid.shape} and displacements {d.shape} of an output {output.shape} do "
            "not fit; displacements are (3, nz, ny, nx)."
        )
    if values.dtype.name not in _TYPES:
        raise DeformError(f"voxels of type {values.dtype} cannot be warped here; use one of {', '.join(_TYPES)}.")
    if method not in ("linear", "nearest"):
        raise DeformError(f"method must be 'linear' or 'nearest' here, got {short_value(method)}.")
    at = _places(grid, output)
    if not at.is_near(values.shape) or values.size > sampling.LARGEST_INT32:
        raise DeformError("an axis of 2^21 voxels, or 2^31 in all, are too many here; use warp.")
    value = float(planning.as_voxel(fill, np.dtype(values.dtype.name)))
    return _differentiable(grid, output, value, method, xla_call.can_call())(values, d)


@lru_cache(maxsize=32)
def _places(grid: Grid, output: Grid) -> planning.Places:
    return planning.places(grid, output, "float32")


@lru_cache(maxsize=32)
def _differentiable(grid: Grid, output: Grid, fill: float, method: str, has_loops: bool) -> Callable[[Any, Any], Any]:
    """Of voxels and displacements: read by the compiled loops where there are some, differentiated by JAX."""
    at = _places(grid, output)

    def plain(values: Any, d: Any) -> Any:
        return sampling.read_displaced(
            values,
            tuple(d),
            at.matrix,
            at.whole,
            at.part,
            np.asarray(fill, values.dtype),
            shape=grid.shape,
            method=method,
            compute="float32",
            index="int32",
            is_straight=at.is_straight,
        )

    def compiled(values: Any, d: Any) -> Any:
        return xla_call.general(values, d, method, fill, at.whole, at.part, at.matrix, is_straight=at.is_straight)

    @jax.custom_jvp
    def read(values: Any, d: Any) -> Any:
        return jax.lax.platform_dependent(values, d, cpu=compiled, default=plain)

    @read.defjvp
    def derivative(primals: Any, tangents: Any) -> Any:
        return read(*primals), jax.jvp(plain, primals, tangents)[1]

    return read if has_loops else plain
