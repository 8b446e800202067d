"""The target of a session: another volume, or the result of another session, which is chosen from a folder."""

from __future__ import annotations

from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Progress
from deformnb.errors import DeformError
from deformnb.imaging.projection import project
from deformnb.io.documents import read_deformation
from deformnb.io.volumes.formats import read_volume
from deformnb.registration.optimise import Pictured
from deformnb.session.session import Session
from deformnb.volume.volume import Volume
from deformnb.warping.warper import warp
from deformnb.widgets.studio.panels.folder import FolderFiles

NO_TARGET = "no target"
GIVEN = "given"
"""Keys of :meth:`FitTarget.choices` that are no file: nothing, and the volume that the studio was given."""

_DOCUMENT = ".json"
# A target that shares less than this part of the volume's box is elsewhere.
_LEAST_SHARED = 0.2


class FitTarget:
    """The target of a session.

    Parameters
    ----------
    session : to deform.
    folder : of volumes and sessions that can be chosen.
    given : a volume that can be chosen first.

    Attributes
    ----------
    key : the selection; volume : the target, None for none; note : a remark on its place.
    """

    def __init__(self, session: Session, folder: str | PathLike[str], given: Volume | None = None) -> None:
        self._session, self._files, self._given = session, FolderFiles(folder, _DOCUMENT), given
        self._pictured: tuple[Any, Pictured] | None = None
        self.key, self.note = NO_TARGET, ""
        self.volume: Volume | None = None

    def offer(self, volume: Volume) -> None:
        """Take a volume as the one that can be chosen first."""
        self._given = volume

    def choices(self) -> list[tuple[str, str]]:
        """(words, key) of all that can be chosen."""
        files = [(name, name) for name in self._files.names()]
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
        found = self._given if key == GIVEN else self._read(self._files.folder / key, progress)
        assert found is not None
        self.volume, self.note = _align_target(found, self._session.volume)
        self.key = key

    def _read(self, path: Path, progress: Progress | None) -> Volume:
        if path.suffix.lower() != _DOCUMENT:
            return read_volume(path)
        made, volume = read_deformation(path), self._session.volume
        return replace(warp(volume, made.field(volume), progress=progress), name=path.stem)

    def pair(self) -> tuple[Pictured, Pictured]:
        """Moving and fixed image: pictures of the same side, or volumes for points in space."""
        target, session = self.volume, self._session
        if target is None:
            raise DeformError("choose a target first: a volume, or the session file of another result.")
        if session.editing.step.plane is None:
            return session.pictures.base(), target
        moving = session.pictures.picture()
        slice_at = session.pictures.depth if session.pictures.method == "slice" else None
        key = (id(target), moving.plane, session.pictures.method, slice_at, session.pictures.transfer_function)
        if self._pictured is None or self._pictured[0] != key:
            colours = session.pictures.transfer_function if session.pictures.method in ("composite", "shaded") else None
            made = project(target, moving.plane, session.pictures.method, transfer=colours, depth=slice_at)
            self._pictured = (key, made)
        return moving, self._pictured[1]


def _align_target(target: Volume, volume: Volume) -> tuple[Volume, str]:
    """A target that is elsewhere in space, moved to the volume; and a note of that."""
    low, high = (np.stack([_box(v)[k] for v in (target, volume)]) for k in (0, 1))
    shared = np.clip(high.min(axis=0) - low.max(axis=0), 0, None).prod()
    if shared >= _LEAST_SHARED * (high[1] - low[1]).prod():
        return target, ""
    shift = np.asarray(volume.grid.center) - np.asarray(target.grid.center)
    x, y, z = (np.asarray(target.grid.origin) + shift).tolist()
    return (
        replace(target, grid=replace(target.grid, origin=(x, y, z))),
        "The target is at another place in space; it was moved so that the middles coincide.",
    )


def _box(volume: Volume) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    corners = volume.grid.corners()
    return corners.min(axis=0), corners.max(axis=0)
