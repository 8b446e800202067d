"""Exports of a session to files: volume, rendering, drawing, movie, script, document.

Each export works on the document of the moment at which it began; edits that come meanwhile do not touch it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

from deformnb._typing import Image, Progress
from deformnb.chunked.sources import open_volume
from deformnb.chunked.store import discard_unfinished
from deformnb.chunked.warper import warp as warp_in_parts
from deformnb.document.animation import Animation
from deformnb.document.deformation import Deformation
from deformnb.errors import Cancelled, DeformError
from deformnb.imaging.display import DisplaySettings, ViewRenderer
from deformnb.imaging.drawing import draw_pictures
from deformnb.imaging.movie_frames import Frames, animation_frames, deformation_frames, swing, write_movie
from deformnb.imaging.render import render_volume
from deformnb.io.files.atomic import atomic_write, check_target
from deformnb.io.files.memory import check_room
from deformnb.io.files.paths import as_path
from deformnb.io.files.zarr_copy import MARKS
from deformnb.io.volumes.formats import write_volume
from deformnb.io.volumes.ome_zarr import ZARR_SUFFIX
from deformnb.io.volumes.series import write_channels
from deformnb.rbf.fields import AbstractField, Identity
from deformnb.session.files import Files
from deformnb.session.pictures import PictureSettings
from deformnb.session.session import Session
from deformnb.volume.channels import Channels
from deformnb.volume.colour_maps import ColourMapName
from deformnb.volume.transfer import TransferFunction
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.warper import Warper, warp, warp_all

_RENDERING = (1600, 1200)
_BAND = 64  # rows of a picture between two checks for cancellation
_FRAME = (640, 480)
_FRAMES = 48
_FPS = 24.0
_FASTEST = 120.0

LARGEST_PICTURE = 8192
"""Pixels along a side of a rendering at most."""


@dataclass(frozen=True)
class Frozen:
    """A session as it was when an export began.

    Parameters
    ----------
    volume, channels : that are deformed.
    document : the deformation with its view state and the checksum of its volume, as it is saved.
    picture, window, colour_map : how drawings show it.
    transfer, seen : how renderings and movies show it.
    files : of the session, which it may replace.
    size : (width, height) of renderings and movies in pixels.
    fps : pictures a second of movies.
    overwrite : whether any file may be replaced.
    """

    volume: Volume
    channels: Channels | None
    deformation: Deformation
    document: Deformation
    picture: PictureSettings
    window: tuple[float, float] | None
    colour_map: ColourMapName
    transfer: TransferFunction
    seen: DisplaySettings
    files: Files
    size: tuple[int, int] | None = None
    fps: float = _FPS
    overwrite: bool = False

    @classmethod
    def of(
        cls,
        session: Session,
        seen: DisplaySettings | Mapping[str, Any] | None = None,
        *,
        size: tuple[int, int] | None = None,
        fps: float = _FPS,
    ) -> Frozen:
        """A session at this moment.

        Parameters
        ----------
        seen : the state of a view, or its camera alone.
        size : (width, height) of renderings and movies in pixels.
        fps : pictures a second of movies.
        """
        pictures = session.pictures
        return cls(
            session.volume,
            session.channels,
            session.editing.deformation,
            session.document(),
            pictures.settings,
            pictures.window,
            pictures.colour_map,
            pictures.transfer_function,
            DisplaySettings.of(seen),
            session.files,
            _check_size(size),
            _check_rate(fps),
        )

    @property
    def output(self) -> Grid | None:
        """The grid of the result in voxels as large as the volume's; None is the volume's own."""
        box = self.deformation.output
        return None if box is None else self.volume.to_own_resolution(box)

    @property
    def field(self) -> AbstractField:
        """The displacement of the whole document."""
        return self.deformation.field(self.volume)

    def deformed_volume(self, progress: Progress) -> Volume:
        """The deformed volume.

        Raises
        ------
        DeformError
            If there is no memory for it.
        """
        check_room(self.volume, self.output)
        return warp(self.volume, self.field, output=self.output, progress=progress)

    def deformed_channels(self, progress: Progress) -> Channels:
        """The deformed channels, all by one map."""
        assert self.channels is not None
        check_room(self.volume, self.output)
        return self.channels.with_volumes(
            warp_all(self.channels.volumes, self.field, output=self.output, progress=progress)
        )

    def scene(self, size: tuple[int, int], *, once: bool = False) -> ViewRenderer | None:
        """Renderer of the volume as it is seen, many times or once; None where only a camera is known."""
        make = (self.seen.still if once else None) or self.seen.scene
        return None if make is None else make(self.volume, self.transfer, size, self.seen)


def _check_size(size: Any) -> tuple[int, int] | None:
    if size is None:
        return None
    try:
        width, height = (int(n) for n in size)
        is_right = (width, height) == tuple(size) and 16 <= min(width, height) <= max(width, height) <= LARGEST_PICTURE
    except (TypeError, ValueError):
        is_right = False
    if not is_right:
        raise DeformError(
            f"the size of a picture is (width, height) in whole pixels from 16 to {LARGEST_PICTURE}, got {size!r:.60}."
        )
    return width, height


def _check_rate(fps: Any) -> float:
    if isinstance(fps, bool) or not isinstance(fps, int | float) or not 0 < fps <= _FASTEST:
        raise DeformError(f"a movie has more than 0 and at most {_FASTEST:g} pictures a second, got {fps!r:.60}.")
    return float(fps)


@dataclass(frozen=True)
class Export:
    """A row of :data:`EXPORTS`.

    Parameters
    ----------
    title : for a menu.
    suffixes : of file names it writes; the first is proposed.
    write : (frozen, path, progress).
    folder_marks : of exports that are folders, as those of a :class:`~deformnb.io.volumes.formats.Format`.
    """

    title: str
    suffixes: tuple[str, ...]
    write: Callable[[Frozen, Path, Progress], None]
    folder_marks: tuple[str, ...] = ()


def _volume(it: Frozen, path: Path, progress: Progress) -> None:
    """The deformed volume; of channels all of them."""

    def first_half(share: float) -> None:
        progress(0.5 * share)

    def second_half(share: float) -> None:
        progress(0.5 + 0.5 * share)

    if it.channels is not None:
        write_channels(it.deformed_channels(first_half), path, progress=second_half)
    else:
        write_volume(it.deformed_volume(first_half), path, progress=second_half)


def _full_resolution(it: Frozen, path: Path, progress: Progress) -> None:
    """The finest level of the volume's pyramid, deformed block by block; of a volume that has none its own voxels."""
    volume, level = it.volume, it.volume.level
    source = volume if level is None else open_volume(level.path, name=volume.name, is_labels=volume.is_labels)
    try:
        warp_in_parts(source, it.deformation, path, overwrite=it.overwrite, progress=progress)
    except Cancelled:
        discard_unfinished(path)
        raise


def _write_rendering(it: Frozen, path: Path, progress: Progress) -> None:
    from PIL import Image

    image = _draw_view(it, progress) if it.seen.scene is not None else _draw_camera(it, progress)
    progress(0.9)
    with atomic_write(path) as stream:
        Image.fromarray(image).save(stream, format="PNG")


def _draw_view(it: Frozen, progress: Progress) -> Image:
    size = it.size or _RENDERING
    progress(0.0)
    scene = it.scene(size, once=True)
    assert scene is not None
    try:
        progress(0.05)
        scene.set_field(it.field, it.output)
        progress(0.1)
        image = scene.render(bands=max(1, size[1] // _BAND), progress=lambda share: progress(0.1 + 0.75 * share))
        assert image is not None  # only a picture that is cancelled is None
        return image
    finally:
        scene.close()


def _draw_camera(it: Frozen, progress: Progress) -> Image:
    return render_volume(
        it.deformed_volume(lambda share: progress(0.5 * share)),
        transfer=it.transfer,
        direction=it.seen.camera["direction"],
        up=it.seen.camera["up"],
        size=it.size or _RENDERING,
    )


def _write_drawing(it: Frozen, path: Path, progress: Progress) -> None:
    step = next((s for s in reversed(it.deformation.steps) if s.plane == it.picture.plane), None)
    points = None if step is None else step.points

    def first_part(share: float) -> None:
        progress(0.6 * share)

    if it.channels is not None and it.picture.displays:
        channels = it.channels
        if it.output is not None:
            channels = channels.with_volumes(warp_all(channels.volumes, Identity(3), output=it.output))
        drawn = [it.picture.picture_of_channels(one) for one in (channels, it.deformed_channels(first_part))]
    else:
        original = it.volume if it.output is None else Warper(it.volume, output=it.output)(Identity(3))
        drawn = [it.picture.picture(one) for one in (original, it.deformed_volume(first_part))]
        drawn = [replace(one, window=it.window or one.window, colour_map=it.colour_map) for one in drawn]
    progress(0.8)
    draw_pictures(drawn, points=[None, points], titles=["before", "after"], path=path)


def _movie(it: Frozen, path: Path, progress: Progress) -> None:
    """The animation of the key frames, or a deformation without any that comes and goes."""
    write_movie(path, movie_frames(it), it.fps, progress=lambda done, total: progress(done / max(total, 1)))


def movie_frames(it: Frozen, fps: float | None = None) -> Frames:
    """The pictures of a session's movie, as they are seen.

    Parameters
    ----------
    fps : of the animation, if the document has key frames; default is that of ``it``.
    """
    size = it.size or _FRAME
    animation = Animation(it.deformation) if it.deformation.keyframes else None
    rate = it.fps if fps is None else fps
    if it.seen.scene is None:
        looks: dict[str, Any] = {
            "directions": it.seen.camera["direction"],
            "up": it.seen.camera["up"],
            "size": size,
            "transfer": it.transfer,
            "output": it.output,
        }
        if animation is not None:
            return animation_frames(it.volume, animation, fps=rate, **looks)
        return deformation_frames(it.volume, it.deformation, strengths=_FRAMES, **looks)
    moments = swing(_FRAMES) if animation is None else animation.times(rate)
    make = it.deformation.scaled if animation is None else animation.at
    return Frames(_draw_moments(it, moments, lambda moment: make(moment).field(it.volume), size), len(moments))


def _draw_moments(
    it: Frozen, moments: Sequence[float], field_at: Callable[[float], AbstractField], size: tuple[int, int]
) -> Iterator[Image]:
    """Pictures of one scene; a moment that comes again is not drawn again."""
    left, kept = Counter(moments), dict[float, Image]()
    scene = it.scene(size)
    assert scene is not None
    try:
        for moment in moments:
            image = kept.pop(moment, None)
            if image is None:
                scene.set_field(field_at(moment), it.output)
                image = scene.render()
                assert image is not None
            left[moment] -= 1
            if left[moment] > 0:
                kept[moment] = image
            yield image.copy()  # a caller that paints on it must not paint on one to come
    finally:
        scene.close()


def _script(it: Frozen, path: Path, progress: Progress) -> None:
    with atomic_write(path) as stream:
        stream.write(it.files.code(it.deformation).encode("utf-8"))


def _document(it: Frozen, path: Path, progress: Progress) -> None:
    it.files.write(it.document, path, overwrite=it.overwrite)


EXPORTS: dict[str, Export] = {
    "volume": Export(
        "Deformed volume",
        (".nii.gz", ".nrrd", ".mha", ".vti", ".npy", ".nii", ".nhdr", ".mhd", ".ome.tif", ".ome.tiff", ".tif", ".tiff"),
        _volume,
    ),
    "full resolution": Export("Deformed volume at full resolution", (ZARR_SUFFIX,), _full_resolution, MARKS),
    "rendering": Export("Rendering", (".png",), _write_rendering),
    "drawing": Export("Picture before and after", (".svg", ".pdf"), _write_drawing),
    "movie": Export("Movie", (".gif", ".mp4", ".webp"), _movie),
    "script": Export("Python script", (".py",), _script),
    "document": Export("Session", (".json",), _document),
}
"""Kinds of files by name; the suffix of a path chooses one."""


def export_for(path: str | PathLike[str]) -> Export:
    """The export that a path's suffix selects.

    Raises
    ------
    DeformError
        If there is none, with those that there are.
    """
    name = as_path(path).name.lower()
    for export in EXPORTS.values():
        if name.endswith(export.suffixes):
            return export
    known = "; ".join(f"{e.title.lower()} {', '.join(e.suffixes[:3])}" for e in EXPORTS.values())
    raise DeformError(f"the suffix of {as_path(path).name!r} belongs to no kind of file; write one of: {known}.")


def export(
    session: Session | Frozen,
    path: str | PathLike[str],
    *,
    camera: Mapping[str, Any] | None = None,
    seen: DisplaySettings | None = None,
    size: tuple[int, int] | None = None,
    fps: float = _FPS,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Path:
    """Write a session as a file; its suffix selects the content.

    Parameters
    ----------
    camera : direction and up of renderings and movies, as a view's ``camera``.
    seen : all that a view shows instead, as its method ``seen`` returns it.
    size : (width, height) of renderings and movies in pixels; default is 1600 x 1200, and 640 x 480 for movies.
    fps : pictures a second of movies.
    overwrite : replace any file; else only one that the session has opened or written and nobody has changed.

    Raises
    ------
    DeformError
        If the suffix is unknown, or the file cannot be written or must not be replaced; it is untouched then.
    Cancelled
        If ``progress`` raises it.
    """
    frozen = session if isinstance(session, Frozen) else Frozen.of(session, seen or camera, size=size, fps=fps)
    place = as_path(path)
    writer = export_for(place)
    check_target(place, overwrite=overwrite or not writer.folder_marks, folder_marks=writer.folder_marks)  # before work
    if overwrite:
        frozen = replace(frozen, overwrite=True)
    with frozen.files.known.writing(place, overwrite=overwrite):
        writer.write(frozen, place, progress or _silent)
    return place


def _silent(_share: float) -> None:
    """Progress that is not shown."""
