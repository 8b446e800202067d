"""Readers of files, and conversions of other packages' objects, for wherever a volume is wanted.

A volume may be given by the path of its file, or as an image of another package, wherever one is wanted. The modules
that want one know neither: they look here, where the root package, which knows all, has put what does it, by name.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

READERS: dict[str, Callable[..., Any]] = {}
"""By what is read: "volume", "channels", "mesh" or "grid". Each takes a path."""

CONVERSIONS: dict[str, Callable[..., Any]] = {}
"""By their names in :mod:`deformnb.volume.converters`: "one_volume", "several_channels", "grid_of", "states_place"."""
