"""Wand of a studio: region growing from a click, in the picture or through the depth of the volume.

The selection becomes a rigid part or a cut.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._deferred import ndimage
from deformnb._typing import Progress
from deformnb._weak import weakly
from deformnb.document.json_regions import region_to_data
from deformnb.errors import Cancelled, DeformError
from deformnb.rbf.cuts import sides_of
from deformnb.rbf.regions import AbstractRegion, Mask
from deformnb.session.session import Session
from deformnb.volume.plane import Picture
from deformnb.volume.region_growing import connected_threshold
from deformnb.volume.transfer import levels
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.messages.editors import WandRequest
from deformnb.widgets.studio.controls import Guard
from deformnb.widgets.studio.panels.labels import TakeRegions
from deformnb.widgets.worker import Worker

_FEWEST = 4  # pixels of a region
_ROUND = 1.0  # pixels: the Gaussian that smooths an outline once


class Wand:
    """Answers the wand of an editor.

    Parameters
    ----------
    session : on whose picture the wand is used.
    editor : shows the preview.
    worker : does what takes a moment.
    guard : makes parts and cuts, and shows errors of that.
    take : makes them of regions.
    """

    def __init__(self, session: Session, editor: Editor, worker: Worker, guard: Guard, take: TakeRegions) -> None:
        self._session, self._editor, self._worker, self._guard, self._take = session, editor, worker, guard, take
        self._request: WandRequest | None = None
        self._region: Mask | None = None

        def is_open(_wand: Wand) -> bool:
            return not worker.is_closed

        editor.on_wand(weakly(self, Wand._take_request, is_open))
        self._observer = weakly(self, Wand._forget, is_open)
        session.editing.observe(self._observer, ["deformation", "index", "key"])
        session.pictures.observe(self._observer, ["method", "depth"])
        self._show()

    def close(self) -> None:
        """Stop following the session."""
        self._session.editing.unobserve(self._observer, ["deformation", "index", "key"])
        self._session.pictures.unobserve(self._observer, ["method", "depth"])

    def _show(self, **facts: Any) -> None:
        self._editor.wand = {"region": None, "words": "", "share": 1.0, **facts}

    def _forget(self, _change: Any = None) -> None:
        if self._request is not None:
            self._request = self._region = None
            self._show()

    def _take_request(self, message: WandRequest) -> None:
        if message.what == "preview":
            self._request = message
            self._worker.latest("wand", weakly(self, Wand._preview))
        elif message.what == "stop":
            self._forget()
        else:
            self._guard(lambda: self._make(message.what))

    def _make(self, what: str) -> None:
        region = self._region
        if region is None:
            raise DeformError("click on the picture with the wand first.")
        step = self._session.editing.step
        name = f"region {len(step.parts) + len(step.cuts) + 1}"
        self._take(what, [(name, region)])
        self._forget()
        self._show(words=f"{name} is a {'cut' if what == 'cut' else 'rigid part'}. Click on the next one; Esc ends")

    def _preview(self) -> None:
        request = self._request
        if request is None:
            return
        shown = 0.0

        def progress(share: float) -> None:
            nonlocal shown
            if self._request is not request:
                raise Cancelled("another place was clicked.")
            if share - shown > 0.05:
                shown = share
                self._show(words="Selecting ...", share=share)

        try:
            region, words, pieces = select_region(self._session, request, progress)
        except Cancelled:
            return
        except DeformError as error:
            self._region = None
            self._show(words=str(error), failed=True)
            return
        if self._request is request:
            self._region = region
            self._show(region=region_to_data(region), words=words, pieces=pieces)


def select_region(session: Session, request: WandRequest, progress: Progress | None = None) -> tuple[Mask, str, int]:
    """The region of a click on the picture with the changes of the request, its range and size in words, and the number
    of its pieces.

    Raises
    ------
    DeformError
        Where nothing can be selected: outside the picture, in air, on a picture of colours, or in too narrow a range.
    """
    picture = session.pictures.picture()
    if picture.values.ndim == 3:
        raise DeformError(
            "This picture shows colours, which have no range of values: choose a slice, the maximum or "
            "the mean over the picture."
        )
    raster = picture.raster
    at = np.round((np.asarray(request.place) - raster.origin) / raster.spacing).astype(int)
    column, line = int(at[0]), int(at[1])
    if not (0 <= line < raster.shape[0] and 0 <= column < raster.shape[1]):
        raise DeformError("This is outside the picture: click on the subject.")
    value, seed = float(picture.values[line, column]), (0, line, column)
    values: NDArray[Any] = picture.values[None]
    if request.through:
        volume = session.pictures.base()
        values, seed = volume.values, _voxel(session, picture, request.place, value)
        value = float(values[seed])
    low = -np.inf if request.rule == "darker" else value - request.tolerance
    high = np.inf if request.rule == "brighter" else value + request.tolerance
    if not np.isfinite(value):
        raise DeformError("There is no value here: click on the subject.")
    mask = connected_threshold(values, seed, low, high, progress)
    flat = (
        Mask(mask[0], raster)
        if not request.through
        else Mask(mask, session.pictures.base().grid).silhouette(picture.plane)
    )
    filled = ndimage.binary_fill_holes(flat.values)
    sides = sum(bool(edge.any()) for edge in (filled[0], filled[-1], filled[:, 0], filled[:, -1]))
    if value < levels(session.volume)[1] and sides >= 3:
        raise DeformError("This is air or padding around the body: click on tissue, or lower the tolerance.")
    if filled.sum() < _FEWEST:
        count = int(filled.sum())
        raise DeformError(f"Only {count} pixel{'' if count == 1 else 's'} hang together here: raise the tolerance.")
    changed = change_region(filled if request.fill else flat.values, request.smooth, request.grow)
    if changed.sum() < _FEWEST:
        raise DeformError("Nothing is left of the region: shrink or smooth it less.")
    numbers, sizes = pieces_of(Mask(changed, flat.lattice), session.editing.step.cut_regions)
    share = float(sizes.max() / sizes.sum())
    if request.largest:
        changed, sizes = numbers == sizes.argmax() + 1, sizes.max(keepdims=True)
    words = _words(picture, low, high, int(changed.sum()) * float(np.prod(flat.lattice.spacing)))
    if len(sizes) > 1:
        words += f"; {len(sizes)} pieces, the largest has {100 * share:.0f} %"
    return Mask(changed, flat.lattice), words, len(sizes)


def change_region(values: NDArray[np.bool_], smooth: int = 0, grow: int = 0) -> NDArray[np.bool_]:
    """A region of pixels smoothed so many times, then grown by so many pixels, or shrunk below 0.

    Once smoothed is rounded by a Gaussian of a pixel, which keeps straight edges where they are.

    Examples
    --------
    >>> square = np.zeros((9, 9), bool)
    >>> square[3:6, 3:6] = True
    >>> int(change_region(square, grow=1).sum()), int(change_region(square, grow=-1).sum())
    (21, 1)
    """
    for _ in range(smooth):
        values = ndimage.gaussian_filter(values.astype(np.float32), _ROUND, mode="nearest") > 0.5
    if grow:
        margin = np.pad(values, abs(grow), mode="edge")  # tissue that a picture cuts off goes on
        change = ndimage.binary_dilation if grow > 0 else ndimage.binary_erosion
        margin = change(margin, iterations=abs(grow))
        values = margin[abs(grow) : -abs(grow), abs(grow) : -abs(grow)]
    return np.asarray(values, dtype=bool)


def pieces_of(region: Mask, cuts: Sequence[AbstractRegion] = ()) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """The pieces of a region on a picture: their numbers at its pixels, from 1, and their sizes in pixels.

    Parameters
    ----------
    cuts : what a cut parts counts as two pieces.
    """
    values = region.values
    rows, columns = np.nonzero(values)
    places = np.stack([columns, rows], axis=1) * np.array(region.lattice.spacing) + np.array(region.lattice.origin)
    own = np.zeros(len(places), np.int64)
    for k, row in enumerate(sides_of(cuts, places).T if cuts else ()):
        own += row.astype(np.int64) << k
    numbers, count = np.zeros(values.shape, np.int32), 0
    for side in np.unique(own):
        there = np.zeros(values.shape, bool)
        there[rows[own == side], columns[own == side]] = True
        found, more = ndimage.label(there, np.ones((3, 3)))
        numbers[there] = found[there] + count
        count += more
    return numbers, np.bincount(numbers.ravel(), minlength=count + 1)[1:]


def _voxel(session: Session, picture: Picture, place: tuple[float, float], value: float) -> tuple[int, int, int]:
    """Index of the voxel that is seen at a place: in the slice, or on the ray the one with the pixel's value."""
    volume, plane = session.pictures.base(), picture.plane
    slices = plane.slices(volume.grid)
    is_slice = session.pictures.method == "slice"
    depths = [session.pictures.depth] if is_slice else [slices.depth(k) for k in range(slices.count)]
    points = plane.from_plane([(*place, depth) for depth in depths])
    index = np.round(volume.grid.point_to_index(points)).astype(int)[:, ::-1]
    index = index[((index >= 0) & (index < volume.shape)).all(axis=1)]
    if not len(index):
        raise DeformError("There is no voxel here: click on the subject.")
    found = index[np.argmin(np.abs(volume.values[tuple(index.T)].astype(np.float64) - value))]
    return int(found[0]), int(found[1]), int(found[2])


def _words(picture: Picture, low: float, high: float, area: float) -> str:
    unit = f" {picture.unit}" if picture.unit else ""
    of_range = (
        f"from {low:.4g}" if np.isinf(high) else f"up to {high:.4g}" if np.isinf(low) else f"{low:.4g} to {high:.4g}"
    )
    size = f"{area:.3g}" if area < 1000 else f"{area:.0f}"
    length = "" if picture.grid is None else picture.grid.unit
    return f"{of_range}{unit}, " + (f"{size} {length}\u00b2" if length else f"{size} pixels")
