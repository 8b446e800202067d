"""The device that computes: a processor, or a GPU that JAX has found.

One choice holds for the process: that of :func:`use_device`, else of the environment variable ``DEFORMNB_DEVICE``, else
"auto", which is JAX's own choice (the first GPU where ``jax[cuda13]`` is installed and finds one). Results
are NumPy arrays and documents are the same on any device: it is no part of either.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
from contextlib import AbstractContextManager, nullcontext
from functools import cache
from importlib import metadata
from typing import Any

from deformnb._deferred import HAS_JAX, is_jax_imported, jax
from deformnb.errors import DeformError, raise_missing_jax

DEVICE_KINDS = ("auto", "cpu", "gpu")
"""Names by which a device is chosen; a number behind a colon, as in "gpu:1", chooses among several of a kind."""

_VARIABLE = "DEFORMNB_DEVICE"

INSTALL = 'pip install -U "jax[cuda13]" (cuda12 for an older driver)'
"""Command that installs JAX's CUDA plugin."""

_chosen: str | None = None


def use_device(name: str) -> None:
    """Compute on a device from now on, in all threads.

    Parameters
    ----------
    name : one of :data:`DEVICE_KINDS`, or with a number, as "gpu:1". The voxels of warpers made before stay on
        their device, so choose first.

    Raises
    ------
    DeformError
        If the name is unknown or there is no such device; the choice before stays.

    Examples
    --------
    >>> use_device("cpu")
    >>> device_name()
    'cpu:0'
    >>> use_device("auto")
    """
    global _chosen  # noqa: PLW0603
    _find_device(name if isinstance(name, str) else repr(name))  # also where it is no text, which might not be hashable
    _chosen = name


def current_device() -> str:
    """The choice in force, a name of :func:`use_device`."""
    return _chosen or os.environ.get(_VARIABLE, "").strip().lower() or "auto"


def device_name() -> str:
    """The device in use, such as "cpu:0" or "gpu:0"."""
    device = device_in_use()
    return f"{device.platform}:{device.id}"


def device_in_use() -> Any:
    """The ``jax.Device`` that computes."""
    name = current_device()
    if name == "auto":
        return jax.config.jax_default_device or _first()  # type: ignore[attr-defined]
    return _find_device(name)


def is_host() -> bool:
    """Check whether arrays are computed in the memory of NumPy's own, so that both can share them.

    JAX is not imported for it where it would find nothing but the processor.
    """
    if not is_jax_imported() and current_device() in ("auto", "cpu", "cpu:0") and _has_only_host():
        return True
    return bool(device_in_use() == _find_device("cpu"))


@cache
def _has_only_host() -> bool:
    """Check without JAX that it would find no other device: no plugin of one, no TPU, and no choice by a variable."""
    chosen = {os.environ.get(name) for name in ("JAX_PLATFORMS", "JAX_PLATFORM_NAME", "JAX_DEFAULT_DEVICE")}
    if chosen - {None, "", "cpu"}:
        return False
    if any(importlib.util.find_spec(name) for name in ("jax_plugins", "libtpu")):
        return False
    return not metadata.entry_points(group="jax_plugins")


def device_context() -> AbstractContextManager[Any]:
    """The context in which JAX computes on the device in use; none where that is JAX's own choice."""
    name = current_device()
    return nullcontext() if name == "auto" else jax.default_device(_find_device(name))


@cache
def _first() -> Any:
    return jax.local_devices()[0]


@cache
def _find_device(name: str) -> Any:
    kind, _, number = name.partition(":")
    if kind not in DEVICE_KINDS or (number and (kind == "auto" or not number.isdecimal())):
        raise DeformError(
            f'unknown device {name!r:.40}; choose one of {", ".join(DEVICE_KINDS)}, or one of several as "gpu:1".'
        )
    if kind == "auto":
        return _first()
    if kind == "gpu" and not HAS_JAX:
        raise_missing_jax("a GPU")
    try:
        devices = jax.local_devices(backend=kind)
    except RuntimeError:  # JAX has none of this kind
        raise DeformError(f"JAX finds no {kind} on this machine{_remedy()}.") from None
    if int(number or 0) >= len(devices):
        raise DeformError(f"there is no {name}: JAX finds {len(devices)} of this kind, numbered from 0.")
    return devices[int(number or 0)]


def _remedy() -> str:
    return f"; there is an NVIDIA GPU that it cannot use without its CUDA plugin: {INSTALL}" if lacks_plugin() else ""


def lacks_plugin() -> bool:
    """Check for an NVIDIA GPU that JAX does not use because it has no CUDA plugin."""
    return has_nvidia_driver() and not any(device.platform == "gpu" for device in jax.devices())


def has_nvidia_driver() -> bool:
    """Check for the driver of an NVIDIA GPU, and for a GPU behind it."""
    folder = "/proc/driver/nvidia/gpus"
    if os.path.isdir(folder):
        return bool(os.listdir(folder))
    return os.name == "nt" and shutil.which("nvidia-smi") is not None


def describe_device(device: Any) -> str:
    """A device in words: its name, its kind, and the memory that JAX may take of it, as far as they are known.

    Parameters
    ----------
    device : a ``jax.Device``.
    """
    facts = [] if device.device_kind == device.platform else [device.device_kind]
    limit = (device.memory_stats() or {}).get("bytes_limit")
    facts += [f"{limit / 1e9:.1f} GB for JAX"] if limit else []
    name = f"{device.platform}:{device.id}"
    return f"{name} ({', '.join(facts)})" if facts else name


def add_device(command: Any) -> None:
    """Add the option ``--device`` to a command of an argument parser; :func:`deformnb.cli.main.main` applies it."""
    command.add_argument(
        "--device",
        metavar="DEVICE",
        help='what computes: cpu, gpu (or "gpu:1", one of several) or '
        "auto, the GPU that JAX finds, else the processor (default $DEFORMNB_DEVICE or auto)",
    )
