"""Readers of files, and conversions of other packages' objects, for all functions that take a volume.

A volume may be given by the path of its file, or as an image of another package, wherever one is required. The modules
that take one import neither: they use this registry, in which the root package has put the readers by name.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

READERS: dict[str, Callable[..., Any]] = {}
"""Readers of paths, by the type of the result: "volume", "channels", "mesh" or "grid"."""

CONVERSIONS: dict[str, Callable[..., Any]] = {}
"""By their names in :mod:`deformnb.volume.converters`: "one_volume", "several_channels", "grid_of", "states_place"."""
