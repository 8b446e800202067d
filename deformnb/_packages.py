"""Optional packages: the commands that install them, and the sentence where one is missing.

Nothing is imported here: the command line and the page of the application look for packages before NumPy is loaded.
"""

from __future__ import annotations

_EXTRAS = {"jax": "jax", "pyvista": "vtk", "trame": "app", "trame_rca": "app", "vtkmodules": "vtk"}
"""Extras of the parts that deformnb has, and deformnb-core has not."""


def install_command(extra: str) -> str:
    """The command that adds an extra, to deformnb-core alone and to all of deformnb.

    Examples
    --------
    >>> install_command("movie")
    'pip install "deformnb-core[movie]"'
    """
    return f'pip install "deformnb-core[{extra}]"'


def describe_missing(package: str) -> str:
    """The sentence that names a missing package, or that of a module in it, and the command that installs it.

    Examples
    --------
    >>> describe_missing("vtkmodules.vtkIOXML")
    'this needs the package vtkmodules, which is not installed: pip install "deformnb-core[vtk]"'
    """
    name = package.partition(".")[0]
    command = install_command(_EXTRAS[name]) if name in _EXTRAS else f"pip install {name}"
    return f"this needs the package {name}, which is not installed: {command}"
