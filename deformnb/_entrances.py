"""Readers of files, conversions of other packages' objects, and outputs in a notebook's cell, for all that need them.

A volume may be given by the path of its file, or as an image of another package, wherever one is required. The modules
that take one import neither: they use this registry, in which the root package has put the readers by name. It has the
functions that draw objects in a cell, too, which the mathematics does not import.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

READERS: dict[str, Callable[..., Any]] = {}
"""Readers of paths, by the type of the result: "volume", "channels", "mesh" or "grid"."""

CONVERSIONS: dict[str, Callable[..., Any]] = {}
"""By their names in :mod:`deformnb.volume.converters`: "one_volume", "several_channels", "grid_of", "states_place",
"from_xarray" and "to_xarray"."""

DISPLAYS: dict[str, Callable[..., Any]] = {}
"""By their names in :mod:`deformnb.imaging.cell_output`: "as_html", "as_png" and "plot_volume"."""


class AbstractCellOutput:
    """Object that a notebook's cell shows as a small picture or a table."""

    def _repr_html_(self) -> str:
        html: str = DISPLAYS["as_html"](self)
        return html
