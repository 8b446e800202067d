"""All moments of an animation as a page reads them: maps over one plane, one behind the other."""

from __future__ import annotations

import numpy as np

from deformnb.plane import Raster
from deformnb.time_maps import TimeMaps
from deformnb.volume import Grid
from deformnb.widgets.card_maps import CardMaps, card_maps
from deformnb.widgets.shown_volume import ShownVolume


def card_frames(maps: TimeMaps, shown: ShownVolume, output: Grid | None, map_size: int) -> CardMaps:
    """What :func:`~deformnb.widgets.card_maps.card_maps` says of one moment, with the maps of all.

    Parameters
    ----------
    map_size : samples of a map along its longer side.
    """
    first = card_maps(maps.field(0.0), shown, output, map_size, map_size)
    planar = first.content["planar"]
    (_, rows, columns), (da, db), (a, b) = planar["shape"], planar["spacing"], planar["origin"]
    raster = Raster((rows, columns), (da, db), (a, b))
    frames = np.stack([np.moveaxis(maps.at(t).on_raster(raster), 0, -1) for t in maps.times.tolist()])
    return CardMaps({**first.content, "frames": {"count": len(maps), "duration": maps.duration}},
                    [np.ascontiguousarray(frames, "<f4").tobytes(), first.buffers[1]])
