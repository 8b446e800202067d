"""Modules that are imported at their first use: JAX (of :mod:`deformnb._jax`) and scipy, a second of a start.

A name such as ``jnp`` of this package is a proxy of the module and imports it when an attribute is first accessed, in
any thread; no other module of the package imports JAX or scipy. Public names of packages are deferred by
``lazy_loader``; its lazy modules would not do here, for they are in :data:`sys.modules` before they are loaded, where
scipy checks whether JAX is in use. What has to be done as soon as JAX is there, such as the registration of pytrees, is
done by the import itself, whichever module imports JAX. Where JAX is not installed, :mod:`deformnb._without_jax` takes
its place.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
import threading
from collections.abc import Callable, Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import TYPE_CHECKING, Any

__all__ = ["HAS_JAX", "Deferred", "call_after_jax", "deferred_jax", "is_jax_imported", "jax", "ndimage", "scipy"]


def _is_installed(name: str) -> bool:
    try:
        return importlib.util.find_spec(name) is not None
    except (ImportError, ValueError):  # refused by a finder; a module that is set to None
        return False


HAS_JAX = _is_installed("jax") and _is_installed("jaxlib")
"""JAX is installed; else NumPy computes by the same formulas, and what JAX alone can do is refused by name."""


class Deferred:
    """A module that is imported when an attribute of it is accessed.

    Parameters
    ----------
    name : of the module.
    load : returns what stands in its place; default imports it.

    Examples
    --------
    >>> decimal = Deferred("decimal")
    >>> decimal.Decimal("0.1") + 1
    Decimal('1.1')
    """

    def __init__(self, name: str, load: Callable[[str], Any] = importlib.import_module) -> None:
        self._name, self._load = name, load

    def __getattr__(self, attribute: str) -> Any:
        # Not cached: importlib finds a loaded module in a third of a microsecond, and tests may replace its attributes.
        return getattr(self._load(self._name), attribute)

    def __repr__(self) -> str:
        return f"<deferred module {self._name!r}>"


def deferred_jax(name: str) -> Any:
    """A module of JAX, or what stands in its place where it is not installed."""

    def load(name: str) -> Any:
        from deformnb import _without_jax

        return _without_jax.FORMS[name]

    return Deferred(name) if HAS_JAX else Deferred(name, load)


class _AfterImport(MetaPathFinder):
    """Calls that follow the import of a module. Python calls it first to locate the module."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._lock = threading.Lock()
        self._waiting: list[Callable[[], object]] | None = []

    def add(self, function: Callable[[], object]) -> None:
        """Call a function when the module has been imported, immediately if it has."""
        with self._lock:
            if self._waiting is not None:
                self._waiting.append(function)
                return
        function()

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name != self._name:
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(name)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def exec_module(module: ModuleType) -> None:
                execute(module)
                self.run()

            spec.loader.exec_module = exec_module  # type: ignore[method-assign]
        return spec

    def run(self) -> None:
        """Call what waits."""
        with self._lock:
            waiting, self._waiting = self._waiting or [], None
        for function in waiting:
            function()


_JAX = _AfterImport("jax")
if "jax" in sys.modules:
    importlib.import_module("jax")  # whole: another thread may be importing it
    _JAX.run()
else:
    sys.meta_path.insert(0, _JAX)


def call_after_jax(function: Callable[[], object]) -> None:
    """Call a function once JAX has been imported, by any thread; immediately if it has, and where there is none."""
    if HAS_JAX:
        _JAX.add(function)
    else:
        function()


def is_jax_imported() -> bool:
    """Check whether JAX has been imported; where it has not, work that NumPy can do is done by NumPy."""
    return HAS_JAX and "jax" in sys.modules


if TYPE_CHECKING:
    import jax
    import scipy
    from scipy import ndimage
else:
    jax = deferred_jax("jax")
    scipy, ndimage = Deferred("scipy"), Deferred("scipy.ndimage")  # scipy itself imports its parts at their first use
