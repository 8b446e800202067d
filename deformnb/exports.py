"""What can be made of a session as a file: volume, rendering, drawing, movie, script, document.

Each export works on the document of the moment at which it began; edits that come meanwhile do not touch it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

from deformnb.animation import Animation
from deformnb.deformation import Deformation
from deformnb.drawing import draw_pictures
from deformnb.errors import DeformError
from deformnb.io.atomic import atomic_write, check_target
from deformnb.io.formats import write_volume
from deformnb.io.headers import human_bytes
from deformnb.io.memory import available_memory
from deformnb.movie import Frames, animation_frames, deformation_frames, write_movie
from deformnb.picture import Picture, project
from deformnb.plane import Plane
from deformnb.render import render_volume
from deformnb.script import as_python
from deformnb.session import Session
from deformnb.transfer import TransferFunction
from deformnb.volume import Volume
from deformnb.warp import warp

Progress = Callable[[float], None]
"""Called with the finished share from 0 to 1; raises :class:`~deformnb.errors.Cancelled` to stop."""

_RENDERING = (1600, 1200)
_FRAME = (640, 480)
_FRAMES = 48
_FPS = 24.0
_HOME = {"direction": (0.4, 1.0, -0.3), "up": None, "zoom": 1.0}


@dataclass(frozen=True)
class Frozen:
    """A session as it was when an export began.

    Parameters
    ----------
    camera : direction, up and zoom of a view, for renderings and movies.
    save : writes a document to a path, as :meth:`Session.save <deformnb.session.Session.save>`.
    """

    volume: Volume
    deformation: Deformation
    document: Deformation
    plane: Plane
    method: str
    depth: float | None
    transfer: TransferFunction
    camera: dict[str, Any]
    save: Callable[..., None]

    @classmethod
    def of(cls, session: Session, camera: dict[str, Any] | None = None) -> Frozen:
        """A session at this moment."""
        depth = session.depth if session.method == "slice" else None
        return cls(session.volume, session.deformation, session.document(), session.plane, session.method, depth,
                   session.transfer_function, {**_HOME, **(camera or {})}, session.save)


@dataclass(frozen=True)
class Export:
    """A row of :data:`EXPORTS`.

    Parameters
    ----------
    title : for a menu.
    suffixes : of file names it writes; the first is proposed.
    write : (frozen, path, progress).
    """

    title: str
    suffixes: tuple[str, ...]
    write: Callable[[Frozen, Path, Progress], None]


def _volume(it: Frozen, path: Path, progress: Progress) -> None:
    needed, free = it.volume.values.nbytes, available_memory()
    if needed > free:  # else the system would end the process, and with it the session
        raise DeformError(f"the deformed volume takes {human_bytes(needed)} and {human_bytes(free)} are free; "
                          "close something else, or read the volume with a stride.")
    field = it.deformation.field(it.volume.grid)
    deformed = warp(it.volume, field, progress=lambda share: progress(0.5 * share))
    write_volume(deformed, path, progress=lambda share: progress(0.5 + 0.5 * share))


def _rendering(it: Frozen, path: Path, progress: Progress) -> None:
    from PIL import Image

    field = it.deformation.field(it.volume.grid)
    deformed = warp(it.volume, field, progress=lambda share: progress(0.5 * share))
    image = render_volume(deformed, transfer=it.transfer, direction=it.camera["direction"], up=it.camera["up"],
                          size=_RENDERING)
    progress(0.9)
    with atomic_write(path) as stream:
        Image.fromarray(image).save(stream, format="PNG")


def _drawing(it: Frozen, path: Path, progress: Progress) -> None:
    step = next((s for s in reversed(it.deformation.steps) if s.plane == it.plane), None)
    points = None if step is None else step.points
    before, after = (_projected(it, volume) for volume in (
        it.volume, warp(it.volume, it.deformation.field(it.volume.grid), progress=lambda share: progress(0.6 * share))))
    progress(0.8)
    draw_pictures([before, after], points=[None, points], titles=["before", "after"], path=path)


def _projected(it: Frozen, volume: Volume) -> Picture:
    colours = it.transfer if it.method in ("composite", "shaded") else None
    return project(volume, it.plane, it.method, transfer=colours, depth=it.depth)


def _movie(it: Frozen, path: Path, progress: Progress) -> None:
    """The animation of the key frames, or a deformation without any that comes and goes."""
    write_movie(path, movie_frames(it), _FPS, progress=lambda done, total: progress(done / max(total, 1)))


def movie_frames(it: Frozen, fps: float = _FPS) -> Frames:
    """The pictures of a session's movie, seen by its camera.

    Parameters
    ----------
    fps : of the animation, if the document has key frames.
    """
    looks: dict[str, Any] = {"directions": it.camera["direction"], "up": it.camera["up"], "size": _FRAME,
                             "transfer": it.transfer}
    if it.deformation.keyframes:
        return animation_frames(it.volume, Animation(it.deformation), fps=fps, **looks)
    return deformation_frames(it.volume, it.deformation, strengths=_FRAMES, **looks)


def _script(it: Frozen, path: Path, progress: Progress) -> None:
    with atomic_write(path) as stream:
        stream.write(as_python(it.deformation, it.volume.grid).encode("utf-8"))


def _document(it: Frozen, path: Path, progress: Progress) -> None:
    it.save(path, document=it.document)


EXPORTS: dict[str, Export] = {
    "volume": Export("Deformed volume", (".nii.gz", ".nrrd", ".mha", ".vti", ".npy", ".nii", ".nhdr", ".mhd"), _volume),
    "rendering": Export("Rendering", (".png",), _rendering),
    "drawing": Export("Picture before and after", (".svg", ".pdf"), _drawing),
    "movie": Export("Movie", (".gif", ".mp4", ".webp"), _movie),
    "script": Export("Python script", (".py",), _script),
    "document": Export("Session", (".json",), _document),
}
"""Kinds of files by name; the suffix of a path chooses one."""


def export_for(path: str | PathLike[str]) -> Export:
    """The export that a path's suffix asks for.

    Raises
    ------
    DeformError
        If there is none, with those that there are.
    """
    name = Path(path).name.lower()
    for export in EXPORTS.values():
        if name.endswith(export.suffixes):
            return export
    known = "; ".join(f"{e.title.lower()} {', '.join(e.suffixes[:3])}" for e in EXPORTS.values())
    raise DeformError(f"the end of {Path(path).name!r} says no kind of file; write one of: {known}.")


def export(session: Session | Frozen, path: str | PathLike[str], *, camera: dict[str, Any] | None = None,
           progress: Progress | None = None) -> Path:
    """Write a session as a file; its suffix chooses what is written.

    Parameters
    ----------
    camera : direction and up of renderings and movies, as a view's ``camera``.

    Raises
    ------
    DeformError
        If the suffix says nothing, or the file cannot be written; an old file is untouched then.
    Cancelled
        If ``progress`` raises it.
    """
    frozen = session if isinstance(session, Frozen) else Frozen.of(session, camera)
    place = Path(path)
    writer = export_for(place)
    check_target(place)  # before the long work
    writer.write(frozen, place, progress or _silent)
    return place


def _silent(_share: float) -> None:
    """Nobody watches."""
