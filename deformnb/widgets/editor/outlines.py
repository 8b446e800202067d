"""Outline of the tissue on an editor's picture: the front end compares it with the box, where the points move it."""

from __future__ import annotations

import weakref
from typing import Any

from deformnb.document.json_regions import region_to_data
from deformnb.volume.plane import Picture, Plane
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.foreground import picture_side_names, picture_silhouette, silhouette

_FOUND: weakref.WeakKeyDictionary[Volume, tuple[Plane, dict[str, Any]]] = weakref.WeakKeyDictionary()


def outline_of_volume(volume: Volume, plane: Plane, box: Grid | None = None) -> dict[str, Any]:
    """The tissue of a volume at any depth on a picture, and the names of the picture's four sides; the last is cached.

    Parameters
    ----------
    box : of the result; default is what the editor draws, its picture and what it has ``beyond`` that.

    Returns
    -------
    What :attr:`Editor.outline` holds: ``{"tissue": a mask as documents hold it, "sides": four names}``.
    """
    found = _FOUND.get(volume)
    if found is None or found[0] != plane:
        tissue = region_to_data(silhouette(volume, plane))
        found = plane, {"tissue": tissue, "sides": list(picture_side_names(plane, volume.grid))}
        _FOUND[volume] = found
    if box is None:
        return found[1]
    a, b, _ = plane.to_plane(box.corners()).T
    return {**found[1], "box": [a.min(), a.max(), b.min(), b.max()]}


def outline_of_picture(picture: Picture) -> dict[str, Any]:
    """The same of what a picture shows."""
    return {
        "tissue": region_to_data(picture_silhouette(picture)),
        "sides": list(picture_side_names(picture.plane, picture.grid)),
    }
