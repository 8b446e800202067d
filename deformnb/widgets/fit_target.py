"""What a session shall become alike: another volume, or what another session made of this one; and how it is shown."""

from __future__ import annotations

import os
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.errors import DeformError
from deformnb.fields import AbstractField
from deformnb.grey_images import GreyImage, Pictured
from deformnb.io.documents import read_deformation
from deformnb.io.formats import FORMATS, read_volume
from deformnb.picture import project
from deformnb.plane import Picture, Raster
from deformnb.session import Session
from deformnb.volume import Volume
from deformnb.warp import warp, warp_picture
from deformnb.warp_plan import Progress

NO_TARGET = "no target"
GIVEN = "given"
"""Keys of :meth:`FitTarget.choices` that are no file: nothing, and the volume that the studio was given."""

_DOCUMENT = ".json"
_MOST_FILES = 200
# Pixels of each preview along the longer side.
PREVIEW = 260
# A target that shares less than this part of the volume's box lies elsewhere.
_LEAST_SHARED = 0.2


class FitTarget:
    """The target of a session.

    Parameters
    ----------
    session : what is deformed.
    folder : where volumes and sessions lie that can be chosen.
    given : a volume that can be chosen first.

    Attributes
    ----------
    key : what is chosen; volume : the target, None for none; note : what is to be said of where it lies.
    """

    def __init__(self, session: Session, folder: str | PathLike[str], given: Volume | None = None) -> None:
        self._session, self._folder, self._given = session, Path(folder), given
        self._seen: tuple[float, list[tuple[str, str]]] | None = None
        self._pictured: tuple[Any, Pictured] | None = None
        self.key, self.note = NO_TARGET, ""
        self.volume: Volume | None = None

    def choices(self) -> list[tuple[str, str]]:
        """(words, key) of all that can be chosen; the folder is read again when it has changed."""
        try:
            changed = self._folder.stat().st_mtime
            if self._seen is None or self._seen[0] != changed:
                self._seen = (changed, [(name, name) for name in sorted(_readable(self._folder))[:_MOST_FILES]])
            files = self._seen[1]
        except OSError:
            files = []
        given = [] if self._given is None else [(f"{self._given.name or 'volume'} (given)", GIVEN)]
        found = [("choose a volume or a session", NO_TARGET), *given, *files]
        if self.key not in [key for _, key in found]:
            found.append((f"{self.key} (no longer in the folder)", self.key))  # it is still the target
        return found

    def choose(self, key: str, progress: Progress | None = None) -> None:
        """Take another target: it may be read and warped, which takes time.

        Raises
        ------
        DeformError
            If it is none of the choices, or cannot be read.
        """
        if key not in [known for _, known in self.choices()]:
            raise DeformError(f"{key!r:.80} is no longer in the folder; choose another target.")
        if key == NO_TARGET:
            self.key, self.volume, self.note = key, None, ""
            return
        found = self._given if key == GIVEN else self._read(self._folder / key, progress)
        assert found is not None
        self.volume, self.note = _laid(found, self._session.volume)
        self.key = key

    def _read(self, path: Path, progress: Progress | None) -> Volume:
        if path.suffix.lower() != _DOCUMENT:
            return read_volume(path)
        made, volume = read_deformation(path), self._session.volume
        return replace(warp(volume, made.field(volume.grid), progress=progress), name=path.stem)

    def pair(self) -> tuple[Pictured, Pictured]:
        """What is deformed and what it shall look like: pictures of the same side, or volumes for points in space."""
        target, session = self.volume, self._session
        if target is None:
            raise DeformError("choose a target first: a volume, or the session file of another result.")
        if session.step.plane is None:
            return session.base(), target
        moving = session.picture()
        slice_at = session.depth if session.method == "slice" else None
        key = (id(target), moving.plane, session.method, slice_at, session.transfer_function)
        if self._pictured is None or self._pictured[0] != key:
            colours = session.transfer_function if session.method in ("composite", "shaded") else None
            made = project(target, moving.plane, session.method, transfer=colours, depth=slice_at)
            self._pictured = (key, made)
        return moving, self._pictured[1]


def _readable(folder: Path) -> list[str]:
    suffixes = (*(s for entry in FORMATS.values() for s in entry.suffixes), _DOCUMENT)
    with os.scandir(folder) as found:
        return [f.name for f in found if f.name.lower().endswith(suffixes) and not f.name.startswith(".")
                and f.is_file()]


def _laid(target: Volume, volume: Volume) -> tuple[Volume, str]:
    """A target that lies elsewhere in space, moved to where the volume is; and a note of that."""
    low, high = (np.stack([_box(v)[k] for v in (target, volume)]) for k in (0, 1))
    shared = np.clip(high.min(axis=0) - low.max(axis=0), 0, None).prod()
    if shared >= _LEAST_SHARED * (high[1] - low[1]).prod():
        return target, ""
    shift = np.asarray(volume.grid.center) - np.asarray(target.grid.center)
    x, y, z = (np.asarray(target.grid.origin) + shift).tolist()
    return (replace(target, grid=replace(target.grid, origin=(x, y, z))),
            "The target lies elsewhere in space; it was laid middle on middle.")


def _box(volume: Volume) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    corners = volume.grid.corners()
    return corners.min(axis=0), corners.max(axis=0)


def compared(moving: Picture, fixed: Picture,
             map_now: AbstractField) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The deformed moving picture and the fixed one as grey values of one size, with square pixels."""
    a0, a1, b0, b1 = moving.raster.box
    d = max(a1 - a0, b1 - b0) / PREVIEW
    shape = (max(1, round((b1 - b0) / d)), max(1, round((a1 - a0) / d)))
    shown = Raster(shape, (d, d), (a0 + d / 2, b0 + d / 2))
    now = warp_picture(moving.grey(), moving.raster, map_now, output=shown, fill=0.0)
    return now.astype(np.float64), GreyImage.of(fixed).at(shown.points())


def ghost(moving: Picture, fixed: Picture) -> NDArray[np.uint8]:
    """The fixed picture on the pixels of the moving one, (nv, nu, 3): laid over an editor it fills the same box."""
    grey = (GreyImage.of(fixed).at(moving.raster.points()) * 255 + 0.5).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)


def blended(now: NDArray[np.float64], fixed: NDArray[np.float64], share: float) -> NDArray[np.uint8]:
    """Both as one picture, (v, 2 u + gap, 3): faded from one to the other, and green (now) over magenta (target).

    Where the two agree the second is grey; green and magenta differ for the colour-blind too.
    """
    left = np.repeat(((1 - share) * now + share * fixed)[..., None], 3, axis=2)
    right = np.stack([fixed, now, fixed], axis=2)
    gap = np.full((len(now), 6, 3), 0.5)
    return (np.clip(np.concatenate([left, gap, right], axis=1), 0, 1) * 255 + 0.5).astype(np.uint8)
