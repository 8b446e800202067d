"""Report of the requirements that work on this machine, with the packages to install for the rest."""

from __future__ import annotations

import importlib.metadata
import os
import platform
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from deformnb import __version__
from deformnb._packages import install_command


@dataclass(frozen=True)
class Check:
    """One line of the report: a part, whether it works, the finding, and the cure where it does not."""

    part: str
    works: bool
    found: str
    remedy: str = ""


OPTIONAL = {
    "pyvista": ("drawing by VTK, objects of pyvista and VTK, VTP files to write", "vtk"),
    "jax": ("GPUs, registration, maps as functions of JAX", "jax"),
    "trame-rca": ('application: "deformnb app"', "app"),
    "SimpleITK": ("SimpleITK objects", "formats"),
    "nibabel": ("nibabel objects", "formats"),
    "h5py": ("transforms in HDF5", "formats"),
    "pydicom": ("DICOM series", "formats"),
    "zarr": ("OME-Zarr, volumes larger than memory, transforms as OME-NGFF", "large"),
    "dask": ("blocks of a volume as arrays of dask", "large"),
    "xarray": ("xarray's arrays", "interop"),
    "pandas": ("points as tables", "interop"),
    "imageio-ffmpeg": ("MP4 movies", "movie"),
    "jupyterlab": ("notebooks in the browser", "notebook"),
    "argcomplete": ("completion of commands in a shell", "completion"),
}
"""Optional packages: purpose and extra of each."""

REQUIRED = (
    "numpy",
    "scipy",
    "matplotlib",
    "ipywidgets",
    "anywidget",
    "pooch",
    "pillow",
    "tifffile",
    "imagecodecs",
)


def doctor() -> list[Check]:
    """Check this machine; takes a few seconds and changes nothing.

    Examples
    --------
    >>> from deformnb.cli.doctor import doctor
    >>> doctor()[0].part
    'Python'
    """
    checks = [
        Check(
            "Python",
            True,
            f"{platform.python_version()} on {platform.system()} {platform.machine()}, {os.cpu_count()} cores",
        )
    ]
    checks += [check_package(name) for name in REQUIRED]
    checks += [
        _safe_check("computing", check_jax),
        _safe_check("devices", _devices),
        _safe_check("compiled loops", check_loops),
        _safe_check("compilation cache", check_cache),
        _safe_check("OpenGL (VTK)", check_gl),
    ]
    checks += [check_optional(name) for name in OPTIONAL]
    return checks


def report(checks: list[Check]) -> str:
    """The checks as a table of plain text."""
    wide = max(len(c.part) for c in checks)
    lines = []
    for c in checks:
        lines.append(f"{'ok     ' if c.works else 'missing'}  {c.part:{wide}}  {c.found}")
        if not c.works and c.remedy:
            lines.append(f"{'':9}{'':{wide}}  -> {c.remedy}")
    return "\n".join(lines)


def as_records(checks: list[Check]) -> dict[str, Any]:
    """The checks as values of JSON; a remedy is None where the part works."""
    rows = [{**asdict(check), "remedy": None if check.works else check.remedy or None} for check in checks]
    return {"deformnb": __version__, "checks": rows}


def _version(name: str) -> str | None:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def check_package(name: str) -> Check:
    """Check that a required package is installed."""
    version = _version(name)
    return Check(name, version is not None, version or "not installed", f"pip install {name}")


def check_optional(name: str) -> Check:
    """Check for an optional package."""
    use, extra = OPTIONAL[name]
    version = _version(name)
    found = f"{version} ({use})" if version else f"not installed: no {use}"
    return Check(name, version is not None, found, install_command(extra))


def _safe_check(part: str, check: Callable[[], Check]) -> Check:
    """A broken installation can raise anything; the report must still come out."""
    try:
        return check()
    except Exception as error:
        return Check(part, False, f"{type(error).__name__}: {error}", "reinstall the package it names")


def check_jax() -> Check:
    """Check that a small fit is exact."""
    import numpy as np

    from deformnb.devices import device_name
    from deformnb.rbf.fitting import fit_rbf
    from deformnb.rbf.points import ControlPoints

    points = ControlPoints.from_arrays(np.eye(3, 2), np.diag([1.5, 1.0, 1.0])[:, :2])
    exact = bool(np.abs(fit_rbf(points).displacement([1.5, 0.0]) - [-0.5, 0.0]).max() < 1e-12)
    return Check(
        "computing",
        exact,
        f"on {device_name()}; float64 solve {'exact' if exact else 'WRONG'}",
        "reinstall jax and jaxlib of one version",
    )


def _devices() -> Check:
    from deformnb._deferred import HAS_JAX

    if not HAS_JAX:
        return Check("devices", True, "the processor, by NumPy and compiled loops; GPUs need JAX")
    import jax

    from deformnb.devices import INSTALL, describe_device, lacks_plugin

    found = ", ".join(describe_device(device) for device in jax.local_devices())
    if lacks_plugin():
        return Check("devices", False, f"{found}; an NVIDIA GPU is there, but JAX has no CUDA plugin", INSTALL)
    return Check("devices", True, found)


def check_loops() -> Check:
    """Check for compiled loops over voxels, and which of them this processor can run."""
    from deformnb._deferred import HAS_JAX
    from deformnb.native import library

    level = library.level()
    if level == "off":
        reader = "JAX" if HAS_JAX else "NumPy"
        why = library.why_absent()
        remedy = "unset it" if library.levels() else "install a wheel of this platform, or a C compiler before building"
        return Check("compiled loops", False, f"none, so {reader} reads the voxels: {why}", remedy)
    return Check("compiled loops", True, f"level {level} of {', '.join(library.levels())}")


def check_cache() -> Check:
    """Check where compiled functions are stored."""
    from deformnb._deferred import HAS_JAX
    from deformnb._jax import use_disk_cache

    if not HAS_JAX:
        return Check("compilation cache", True, "none: without JAX nothing is compiled")
    folder = use_disk_cache()
    if folder is None:
        return Check("compilation cache", True, "switched off by DEFORMNB_COMPILATION_CACHE=off")
    parent = folder
    while parent and not os.path.isdir(parent):
        parent = os.path.dirname(parent)
    place = parent or "/"
    return Check(
        "compilation cache",
        os.access(place, os.W_OK),
        folder,
        f"make {place} writable, or set JAX_COMPILATION_CACHE_DIR; without it every start compiles again",
    )


def check_gl() -> Check:
    """Check that VTK draws off screen."""
    from deformnb.imaging.vtk_volume import gl_status

    works, reason, remedy = gl_status()
    return Check("OpenGL (VTK)", works, reason, remedy)
