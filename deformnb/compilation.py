"""How this package compiles with JAX: float64 only where asked for, results of compilation kept on disk.

The global ``jax_enable_x64`` flag is never touched. The cache folder is set once, at the first compiled call, and
only where the user has not set one; ``DEFORMNB_COMPILATION_CACHE=off`` leaves JAX alone altogether.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Callable
from functools import cache, wraps
from typing import Any

import jax
import platformdirs

# Measured (design notes, speed of XLA on CPU): 512-bit vectors make kernel evaluation 1.9 times and byte gathers 1.1
# times faster where the processor has them; XLA falls back to what there is elsewhere.
_CPU_OPTIONS = {"xla_cpu_prefer_vector_width": 512, "xla_cpu_enable_fast_min_max": True}


@cache
def use_disk_cache() -> str | None:
    """Keep compiled functions on disk between processes; returns the folder in use, or None."""
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
def _accepted_options() -> dict[str, Any] | None:
    """The compiler options, if the default backend takes them (they belong to the CPU compiler)."""
    if jax.default_backend() != "cpu":
        return None
    try:
        jax.jit(lambda x: x + 1, compiler_options=_CPU_OPTIONS)(0.0)
    except Exception:  # an older or newer compiler without one of the options: plain compilation is right too
        return None
    return _CPU_OPTIONS


def compiled(function: Callable[..., Any], **options: Any) -> Callable[..., Any]:
    """``jax.jit`` with this package's compiler options and disk cache, set up at the first call and not at import."""

    @cache
    def executable() -> Any:
        use_disk_cache()
        return jax.jit(function, compiler_options=_accepted_options(), **options)

    @wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        return executable()(*args, **kwargs)

    call.executable = executable  # type: ignore[attr-defined]
    return call


def float64() -> Any:
    """A context in which JAX computes in 64 bits, for this thread only."""
    return jax.enable_x64(True)
