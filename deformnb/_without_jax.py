"""The part of JAX that the formulas of this package use, in NumPy: it stands in its place where JAX is not installed.

Nothing is compiled or traced. Loops of ``lax`` are loops of Python, whose turns work on large arrays; derivatives are
those of :mod:`deformnb._dual_numbers`. What is not here says that it needs JAX, and the command that installs it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from itertools import product
from types import SimpleNamespace
from typing import Any

import numpy as np

from deformnb._dual_numbers import Dual, jvp
from deformnb.errors import raise_missing_jax

__all__ = ["FORMS"]


class _Part(SimpleNamespace):
    """A module of JAX as far as there is a form in NumPy."""

    _name: str
    _beside: Any = None

    def __getattr__(self, attribute: str) -> Any:
        if attribute.startswith("__"):
            raise AttributeError(attribute)
        if self._beside is not None and hasattr(self._beside, attribute):
            return getattr(self._beside, attribute)
        return raise_missing_jax(f"{self._name}.{attribute}")


# ---- arrays ----------------------------------------------------------------------------------------------------------


def _asarray(values: Any, dtype: Any = None) -> Any:
    if isinstance(values, Dual):
        return values if dtype is None else values.astype(dtype)
    return np.asarray(values, dtype)


jnp = _Part(_name="jax.numpy", _beside=np, asarray=_asarray, array=_asarray)


def _map_coordinates(values: Any, coordinates: Sequence[Any], order: int, mode: str) -> Any:
    """Samples interpolated linearly, and beyond the outermost by these."""
    if (order, mode) != (1, "nearest"):
        raise_missing_jax(f"jax.scipy.ndimage.map_coordinates of order {order}, {mode}")
    total: Any = 0.0
    lower = [jnp.asarray(np.floor(x)) for x in coordinates]
    for corner in product((0, 1), repeat=len(coordinates)):
        weight: Any = 1.0
        at = []
        for x, low, upper, n in zip(coordinates, lower, corner, values.shape, strict=True):
            weight = weight * ((x - low) if upper else (1 - (x - low)))
            at.append(np.clip(low + upper, 0, n - 1).astype(np.intp))
        total = total + weight * values[tuple(at)]
    return total


# ---- trees of arrays -------------------------------------------------------------------------------------------------

_KINDS: dict[type, tuple[Callable[[Any], tuple[Sequence[Any], Any]], Callable[[Any, Sequence[Any]], Any]]] = {}
"""Of registered classes: from an object to its parts and the rest, and back."""


def _register_dataclass(kind: type, data_fields: Sequence[str], meta_fields: Sequence[str]) -> None:
    def take_apart(tree: Any) -> tuple[Sequence[Any], Any]:
        return [getattr(tree, name) for name in data_fields], tuple(getattr(tree, name) for name in meta_fields)

    def make(rest: Any, parts: Sequence[Any]) -> Any:
        return kind(**dict(zip(data_fields, parts, strict=True)), **dict(zip(meta_fields, rest, strict=True)))

    _KINDS[kind] = take_apart, make


def _register_class(kind: Any) -> None:
    _KINDS[kind] = kind.tree_flatten, kind.tree_unflatten


def _parts_of(tree: Any) -> tuple[Sequence[Any], Any, Callable[[Any, Sequence[Any]], Any]] | None:
    """The parts of a tree, the rest, and a function of both that makes it; None for a leaf."""
    if type(tree) in _KINDS:
        take_apart, make = _KINDS[type(tree)]
        return *take_apart(tree), make
    if tree is None:
        return (), None, lambda _, __: None
    if isinstance(tree, dict):
        keys = sorted(tree)
        return [tree[key] for key in keys], tuple(keys), lambda names, parts: dict(zip(names, parts, strict=True))
    if isinstance(tree, tuple) and hasattr(tree, "_fields"):
        return tree, None, lambda _, parts: type(tree)(*parts)
    if isinstance(tree, list | tuple):
        return tree, None, lambda _, parts: type(tree)(parts)
    return None


def _flatten(tree: Any) -> tuple[list[Any], Any]:
    """Leaves and structure of a tree; structures are equal where all but the leaves is."""
    parts = _parts_of(tree)
    if parts is None:
        return [tree], "*"
    leaves, structures = [], []
    for part in parts[0]:
        own, structure = _flatten(part)
        leaves += own
        structures.append(structure)
    return leaves, (type(tree), parts[1], tuple(structures))


def _map(function: Callable[..., Any], tree: Any, *others: Any) -> Any:
    parts = _parts_of(tree)
    if parts is None:
        return function(tree, *others)
    rest = [_parts_of(other)[0] for other in others]  # type: ignore[index]
    return parts[2](parts[1], [_map(function, *each) for each in zip(parts[0], *rest, strict=True)])


def _stack(trees: Sequence[Any]) -> Any:
    return _map(lambda *leaves: np.stack(leaves), *trees)


def _entries(tree: Any) -> list[Any]:
    """The entries of a tree of arrays along their first axis."""
    return [_map(lambda leaf, k=k: leaf[k], tree) for k in range(len(_flatten(tree)[0][0]))]


# ---- loops -----------------------------------------------------------------------------------------------------------


def _scan(function: Callable[[Any, Any], tuple[Any, Any]], start: Any, over: Any) -> tuple[Any, Any]:
    found = []
    for each in _entries(over):
        start, one = function(start, each)
        found.append(one)
    return start, _stack(found)


def _fori_loop(first: int, stop: int, body: Callable[[int, Any], Any], value: Any) -> Any:
    for k in range(int(first), int(stop)):
        value = body(k, value)
    return value


def _dynamic_slice(array: Any, start: Sequence[Any], sizes: Sequence[int]) -> Any:
    return array[tuple(slice(int(a), int(a) + n) for a, n in zip(start, sizes, strict=True))]


def _dynamic_update_slice(array: Any, part: Any, start: Sequence[Any]) -> Any:
    array[tuple(slice(int(a), int(a) + n) for a, n in zip(start, part.shape, strict=True))] = part
    return array


lax = _Part(
    _name="jax.lax",
    scan=_scan,
    map=lambda function, over: _stack([function(each) for each in _entries(over)]),
    fori_loop=_fori_loop,
    dynamic_slice=_dynamic_slice,
    dynamic_update_slice=_dynamic_update_slice,
    optimization_barrier=lambda tree: tree,
    stop_gradient=lambda x: x.value if isinstance(x, Dual) else x,
)


# ---- functions of functions ------------------------------------------------------------------------------------------


class _CustomDerivative:
    """A function of one array whose derivative is given."""

    def __init__(self, function: Callable[[Any], Any]) -> None:
        self._function = function

    def defjvp(self, rule: Callable[[Any, Any], tuple[Any, Any]]) -> None:
        """Take the derivative from a rule of primals and tangents, as that of ``jax.custom_jvp``."""
        self._rule = rule

    def __call__(self, x: Any) -> Any:
        return Dual(*self._rule((x.value,), (x.tangent,))) if isinstance(x, Dual) else self._function(x)


def _vmap(function: Callable[..., Any]) -> Callable[..., Any]:
    return lambda *arrays: _stack([function(*each) for each in zip(*arrays, strict=True)])


_HOST = SimpleNamespace(platform="cpu", id=0, device_kind="cpu", memory_stats=lambda: None)


def _local_devices(backend: str | None = None) -> list[Any]:
    return [_HOST]


def _jit(function: Callable[..., Any], **_options: Any) -> Callable[..., Any]:
    return function


_TREES = _Part(
    _name="jax.tree",
    map=_map,
    flatten=_flatten,
    leaves=lambda tree: _flatten(tree)[0],
    structure=lambda tree: _flatten(tree)[1],
    tree_flatten=_flatten,
    tree_leaves=lambda tree: _flatten(tree)[0],
    register_dataclass=_register_dataclass,
    register_pytree_node_class=_register_class,
)

jax = _Part(
    _name="jax",
    Array=np.ndarray,
    numpy=jnp,
    lax=lax,
    tree=_TREES,
    tree_util=_TREES,
    scipy=_Part(_name="jax.scipy", ndimage=_Part(_name="jax.scipy.ndimage", map_coordinates=_map_coordinates)),
    custom_jvp=_CustomDerivative,
    config=_Part(_name="jax.config", jax_default_device=None),
    default_device=lambda device: nullcontext(),
    devices=_local_devices,
    local_devices=_local_devices,
    jit=_jit,
    jvp=jvp,
    vmap=_vmap,
)

FORMS = {"jax": jax, "jax.numpy": jnp, "jax.lax": lax}
"""The forms in NumPy of modules of JAX, by the names of these."""
