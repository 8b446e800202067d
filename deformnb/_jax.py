"""JAX: imported at its first use, float64 only where requested, a compilation cache on disk; algebra of small matrices.

Modules take ``jax``, ``jnp`` and ``lax`` from here, which import JAX when something is first computed: half a second
that a notebook's first picture need not wait for. :func:`pytree` registers a dataclass, now or once JAX is there.

Where JAX is not installed, the three are those of :mod:`deformnb._without_jax`, and :func:`jit` leaves a function as it
is: the same formulas are then computed by NumPy. Whatever needs to know asks :data:`HAS_JAX`.

The global ``jax_enable_x64`` flag is never touched. The cache folder is set once, at the first compiled call, and
only where the user has not set one; ``DEFORMNB_COMPILATION_CACHE=off`` leaves JAX alone altogether.

The functions on 2 x 2 and 3 x 3 matrices are closed forms for very many of them: NumPy's own take five to fifty times
as long for these. All matrices have their rows and columns on the first two axes, ``a[m, k, ...]``, and vectors their
components on the first one: every entry is then a separate array, and nothing is gathered.
"""

from __future__ import annotations

import os
import platform
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache, partial, wraps
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import platformdirs
from numpy.typing import NDArray

from deformnb import devices
from deformnb._deferred import HAS_JAX, call_after_jax, deferred_jax, is_jax_imported, jax
from deformnb.errors import Cancelled, DeformError

if TYPE_CHECKING:
    import jax.numpy as jnp
    from jax import lax
else:
    jnp, lax = deferred_jax("jax.numpy"), deferred_jax("jax.lax")

__all__ = [
    "ENDING",
    "HAS_JAX",
    "adjugate",
    "as_numpy",
    "blockwise",
    "check_process",
    "determinant",
    "double_precision",
    "each",
    "float64",
    "full_precision",
    "is_traced",
    "jax",
    "jit",
    "jnp",
    "lax",
    "namespace_of",
    "one_plus",
    "pytree",
    "pytree_node",
    "use_disk_cache",
    "value_and_slopes",
    "with_derivative",
]

_Class = TypeVar("_Class", bound=type)


def pytree(data_fields: Sequence[str], meta_fields: Sequence[str] = ()) -> Callable[[_Class], _Class]:
    """Register a dataclass as a JAX pytree, as ``jax.tree_util.register_dataclass`` does, once JAX is imported.

    Parameters
    ----------
    data_fields : names of the fields that are arrays or pytrees.
    meta_fields : names of the others; they must be hashable.
    """

    def register(kind: _Class) -> _Class:
        call_after_jax(lambda: jax.tree_util.register_dataclass(kind, data_fields, meta_fields))
        return kind

    return register


def pytree_node(kind: _Class) -> _Class:
    """Register a class that has ``tree_flatten`` and ``tree_unflatten`` as a JAX pytree, once JAX is imported."""
    call_after_jax(lambda: jax.tree_util.register_pytree_node_class(kind))
    return kind


def with_derivative(function: Callable[[Any], Any], rule: Callable[[Any, Any], Any]) -> Callable[[Any], Any]:
    """A function of one array with a custom derivative: ``jax.custom_jvp``, made at the first call.

    Parameters
    ----------
    rule : from primals and tangents, tuples of one array, to the value and its tangent.
    """

    @cache
    def build() -> Any:
        own = jax.custom_jvp(function)
        own.defjvp(rule)
        return own

    @wraps(function)
    def call(x: Any) -> Any:
        return build()(x)

    return call


def full_precision(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function that JAX computes with products of matrices as exact as their type.

    NVIDIA's GPUs round the factors of float32 products to 11 bits (TF32) unless set otherwise: a displacement of 10 mm
    is then wrong by 0.003 mm and its derivatives by 1 per cent (seen on an H200).
    """

    @wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        with jax.default_matmul_precision("highest"):
            return function(*args, **kwargs)

    return call if HAS_JAX else function


def is_traced(*trees: Any) -> bool:
    """True if a number in these arrays, lists or pytrees is followed by JAX: within ``jit``, ``grad`` or ``vmap``.

    >>> is_traced(np.ones(3)), bool(jax.vmap(lambda x: x * is_traced(x))(np.ones(3)).all())
    (False, True)
    """
    if not is_jax_imported():
        return False
    return any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(trees))


def namespace_of(*arrays: Any) -> Any:
    """The module that computes with these: NumPy, where all are its own arrays or numbers, else ``jax.numpy``.

    A formula that both can follow is written once by it, and NumPy computes it with few numbers before a compiled
    function starts.

    >>> namespace_of(np.ones(2), 1.0) is np, namespace_of(jax.numpy.ones(2)) is jax.numpy
    (True, True)
    """
    return np if all(isinstance(a, _OF_NUMPY) for a in arrays) else jax.numpy


_OF_NUMPY = (np.ndarray, np.generic, float, int)


def double_precision(function: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """A function of one point (dim,) for points (..., dim) of any floating type, computed in 64 bits within.

    The result has the type of the points. So it does in a user's own ``jit``, ``grad`` or ``vmap``, where JAX computes
    in 32 bits and is not switched. Each derivative is that of the function in 64 bits, for JAX differentiates outside
    of the context in which the function was followed.

    Parameters
    ----------
    function : in pure JAX, of one point in 64 bits.

    Examples
    --------
    >>> away = double_precision(lambda x: (x + 1e9) - 1e9)
    >>> x = np.array([[0.5, 0.25]], np.float32)
    >>> away(x).tolist(), str(away(x).dtype)
    ([[0.5, 0.25]], 'float32')
    """

    def within(x: Any) -> Any:
        with jax.enable_x64(True):
            flat = x.reshape(-1, x.shape[-1]).astype(jnp.float64)
            found = jax.vmap(function)(flat)
            return found.reshape(*x.shape[:-1], *found.shape[1:]).astype(x.dtype)

    def rule(primals: tuple[Any], tangents: tuple[Any]) -> tuple[Any, Any]:
        (x,), (dx,) = primals, tangents
        slopes = double_precision(jax.jacfwd(function))(x)  # (..., components, dim)
        components = (1,) * (slopes.ndim - x.ndim)
        return call(x), (slopes * dx.reshape(*x.shape[:-1], *components, x.shape[-1])).sum(axis=-1)

    call = with_derivative(within, rule)
    return call


# Measured (design notes, speed of XLA on CPU): 512-bit vectors make kernel evaluation 1.9 times and byte gathers 1.1
# times faster where the processor has them; XLA falls back to what there is elsewhere.
_CPU_OPTIONS = {"xla_cpu_prefer_vector_width": 512, "xla_cpu_enable_fast_min_max": True}
# A call that is one part of the work on a pool of threads stays on one thread: shared out once more among XLA's own
# threads it waits for both halves (two threads on two processors: 10 to 17 per cent longer).
_ONE_THREAD = {"xla_disable_hlo_passes": "cpu-parallel-task-assigner"}

_LARGE = 2**18  # bytes from which on arrays come from a GPU through pinned memory


@cache
def use_disk_cache() -> str | None:
    """Cache compiled functions on disk between processes; returns the folder in use, or None."""
    if os.environ.get("DEFORMNB_COMPILATION_CACHE", "").lower() == "off":
        return None
    present = jax.config.jax_compilation_cache_dir  # type: ignore[attr-defined]
    if present:
        return str(present)
    # A cached CPU program holds machine code: one folder for each kind of machine that may share the home folder.
    folder = platformdirs.user_cache_path("deformnb") / "jax" / f"{jax.__version__}-{platform.machine()}"
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    return str(folder)


@cache
def _takes_options(platform: str) -> bool:
    """Check whether the compiler of a platform takes the options above: they are those of the CPU's."""
    if platform != "cpu":
        return False
    try:
        with jax.default_device(jax.local_devices(backend="cpu")[0]):
            jax.jit(lambda x: x + 1, compiler_options=_CPU_OPTIONS | _ONE_THREAD)(0.0)
    except Exception:  # an older or newer compiler without one of the options: plain compilation is right too
        return False
    return True


_is_forked = False  # from a process that had computed before


def _prepare_child() -> None:
    """Prepare a forked child: it has JAX's locks, but none of the threads that would release them."""
    global _is_forked  # noqa: PLW0603
    _is_forked = True


@cache
def _watch_forks() -> None:
    """Mark, from the first use of JAX on, the children that this process makes by fork."""
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=_prepare_child)


ENDING = threading.Event()
"""Set when the process ends: from then on only the main thread begins to compute."""


def check_process() -> None:
    """Refuse to compute where JAX would hang or crash.

    Raises
    ------
    DeformError
        In a child made by ``fork`` after its parent has computed, where JAX would wait for ever; with the remedy.
    Cancelled
        In a thread of a process that ends: the interpreter would abort a compilation in the middle, and the process
        with it.
    """
    if ENDING.is_set() and threading.current_thread() is not threading.main_thread():
        raise Cancelled("the process ends.")
    if not HAS_JAX:
        return
    _watch_forks()
    if _is_forked:
        raise DeformError(
            "this process was made by fork from one that had used JAX already, and computing "
            'here would hang for ever; start processes with multiprocessing.get_context("spawn"), or '
            'ProcessPoolExecutor(mp_context=multiprocessing.get_context("spawn")).'
        )


def jit(
    function: Callable[..., Any], *, donated: str | Sequence[str] = (), on_one_thread: bool = False, **options: Any
) -> Callable[..., Any]:
    """``jax.jit`` with this package's compiler options and disk cache, set up at the first call and not at import.

    It computes on the device in use (:mod:`deformnb.devices`).

    Parameters
    ----------
    donated : names of arguments whose memory the result may take, where that is not NumPy's. The caller must not use
        them again.
    on_one_thread : for parts of work that a pool of threads shares: XLA on the CPU shares none of a call out again.
    """

    @cache
    def program(platform: str, is_host: bool) -> Any:
        use_disk_cache()
        chosen = _CPU_OPTIONS | (_ONE_THREAD if on_one_thread else {}) if _takes_options(platform) else None
        return jax.jit(
            full_precision(function),
            compiler_options=chosen,
            donate_argnames=None if is_host else donated,
            **options,
        )

    def executable() -> Any:
        return program(devices.device_in_use().platform, devices.is_host())

    @wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        check_process()
        if not HAS_JAX:
            with np.errstate(all="ignore"):  # as JAX, which does not warn
                return function(*args, **kwargs)
        with devices.device_context():
            return executable()(*args, **kwargs)

    call.executable = executable  # type: ignore[attr-defined]
    return call


def value_and_slopes(function: Callable[[Any], Any], places: Any) -> tuple[Any, Any]:
    """A function of places (n, dim), each by itself, and its derivatives: arrays (n, ...) and (n, ..., dim).

    Examples
    --------
    >>> [part.tolist() for part in value_and_slopes(lambda x: x[..., 0] * x[..., 1], np.array([[2.0, 3.0]]))]
    [[6.0], [[3.0, 2.0]]]
    """
    if HAS_JAX:
        slopes, values = jax.vmap(jax.jacfwd(lambda x: (function(x),) * 2, has_aux=True))(places)
        return values, slopes
    units = np.broadcast_to(np.eye(places.shape[1])[:, None], (places.shape[1], *places.shape))
    found = [jax.jvp(function, (places,), (unit,)) for unit in units]
    return found[0][0], np.stack([tangent for _, tangent in found], axis=-1)


def each(function: Callable[[Any], Any], of: Any) -> Any:
    """The results of a function for each entry of arrays along their first axis, stacked, in a :func:`jit` one.

    A processor does one after the other, so that the data of an entry stay in its cache (``lax.map``); a GPU does all
    in parallel (``jax.vmap``), for its work between two launches must be large.
    """
    return lax.map(function, of) if devices.is_host() else jax.vmap(function)(of)


def as_numpy(array: Any) -> NDArray[Any]:
    """An array of JAX in NumPy's memory, read-only: shared with a processor, copied from a GPU.

    Through memory that the system does not move (pinned), 16 MB take 0.7 ms from an H200 instead of 3.6.
    """
    if isinstance(array, np.ndarray) or devices.is_host() or array.nbytes < _LARGE:
        return np.asarray(array)
    return np.asarray(jax.device_put(array, array.sharding.with_memory_kind("pinned_host")))


# Places of a block, where there are few and where there are many, and blocks in one call of the latter.
_FEW, _MANY, _BLOCKS = 64, 2048, 8


def blockwise(function: Callable[..., Any], **options: Any) -> Callable[..., Any]:
    """A compiled function of many places, in 64 bits, compiled for two sizes and not for each number of places.

    A processor takes one block of places after the other, so that their arrays stay in its cache, and none that is
    empty; a GPU takes all in parallel.

    Parameters
    ----------
    function : from any pytree and places (dim, m) to a pytree of arrays (..., m).
    options : of :func:`jit`.

    Returns
    -------
    The function of the pytree and places (dim, n) of NumPy, to NumPy's arrays (..., n).

    Examples
    --------
    >>> blockwise(lambda a, places: a * places.sum(axis=0))(2.0, np.ones((3, 5))).tolist()
    [6.0, 6.0, 6.0, 6.0, 6.0]
    """

    def compute(fixed: Any, blocks: Any, count: Any, **chosen: Any) -> Any:
        one = partial(function, fixed, **chosen)
        if not devices.is_host():
            return jax.vmap(one)(blocks)

        def add(k: Any, out: Any) -> Any:
            found = one(lax.dynamic_index_in_dim(blocks, k, keepdims=False))
            return jax.tree.map(lambda whole, part: lax.dynamic_update_index_in_dim(whole, part, k, 0), out, found)

        return lax.fori_loop(
            0,
            count,
            add,
            jax.tree.map(
                lambda part: jnp.zeros((len(blocks), *part.shape), part.dtype), jax.eval_shape(one, blocks[0])
            ),
        )

    evaluate = jit(compute, on_one_thread=True, **options)
    in_numpy = jit(function)

    def together(fixed: Any, places: NDArray[Any], **chosen: Any) -> Any:
        n = places.shape[1]
        if not HAS_JAX:
            return in_numpy(fixed, places, **chosen)
        size, most = (_FEW, 1) if n <= _FEW else (_MANY, _BLOCKS)
        count = max(1, -(-n // size))
        with float64():
            found = evaluate(fixed, _split_in_blocks(places, size, most), np.int32(count), **chosen)
        return jax.tree.map(
            lambda part: np.moveaxis(np.asarray(part)[:count], 0, -2).reshape(*part.shape[1:-1], -1)[..., :n], found
        )

    def call(fixed: Any, places: NDArray[Any], **chosen: Any) -> Any:
        most = _MANY * _BLOCKS
        parts = [
            together(fixed, places[:, start : start + most], **chosen)
            for start in range(0, max(places.shape[1], 1), most)
        ]
        return parts[0] if len(parts) == 1 else jax.tree.map(lambda *of: np.concatenate(of, axis=-1), *parts)

    return call


def _split_in_blocks(places: NDArray[Any], size: int, most: int) -> NDArray[Any]:
    """Places (dim, n) in blocks (most, dim, size); the last place fills up the last of those that hold any."""
    dim, n = places.shape
    blocks, (whole, rest) = np.zeros((most, dim, size), places.dtype), divmod(n, size)
    blocks[:whole] = places[:, : whole * size].reshape(dim, whole, size).swapaxes(0, 1)
    if rest:
        blocks[whole, :, :rest] = places[:, whole * size :]
        blocks[whole, :, rest:] = places[:, -1:]
    return blocks


@contextmanager
def float64() -> Iterator[None]:
    """A context in which JAX computes in 64 bits, on the device in use, for this thread only."""
    check_process()
    if not HAS_JAX:
        yield
        return
    with devices.device_context(), jax.enable_x64(True):
        yield


def determinant(a: NDArray[Any]) -> NDArray[Any]:
    """Determinants (...) of matrices (dim, dim, ...), dim 2 or 3, in their own precision.

    >>> float(determinant(np.array([[1.0, 2.0], [3.0, 4.0]])))
    -2.0
    """
    if len(a) == 2:
        return np.asarray(a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0])
    c = _cofactors_of_row(a, 0)
    return np.asarray(a[0, 0] * c[0] + a[0, 1] * c[1] + a[0, 2] * c[2])


def adjugate(a: NDArray[Any]) -> NDArray[Any]:
    """The matrices (dim, dim, ...) that give the determinant times the unit matrix when multiplied by a."""
    if len(a) == 2:
        return np.stack([np.stack([a[1, 1], -a[0, 1]]), np.stack([-a[1, 0], a[0, 0]])])
    return np.stack([np.stack(_cofactors_of_row(a, m)) for m in range(3)], axis=1)


def _cofactors_of_row(a: NDArray[Any], m: int) -> list[NDArray[Any]]:
    p, q = a[(m + 1) % 3], a[(m + 2) % 3]
    return [p[(k + 1) % 3] * q[(k + 2) % 3] - p[(k + 2) % 3] * q[(k + 1) % 3] for k in range(3)]


def one_plus(a: NDArray[Any]) -> NDArray[Any]:
    """A copy with 1 added to the diagonal: from the derivative of a displacement to that of the map."""
    out = np.array(a)
    for k in range(len(out)):
        out[k, k] += 1
    return out
