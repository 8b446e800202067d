"""A disk without room, for tests of what writes files."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

import jax
import pytest


@contextmanager
def full_disk(limit: int) -> Iterator[None]:
    """Within this no file grows beyond a number of bytes; skips the test where the system has no such limit.

    JAX writes no compiled function to its cache meanwhile: a file cut short there would be found by later runs.
    """
    if sys.platform == "win32":
        pytest.skip("file size limits are POSIX")
    import resource  # Python itself ignores the signal of a write beyond the limit

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    least = jax.config.jax_persistent_cache_min_compile_time_secs  # type: ignore[attr-defined]
    jax.config.update("jax_persistent_cache_min_compile_time_secs", float("inf"))
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        jax.config.update("jax_persistent_cache_min_compile_time_secs", least)
