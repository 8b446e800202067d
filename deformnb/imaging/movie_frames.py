"""Movies of a deformation that comes and goes, or of an animation of key frames.

Frames are made by the renderer one by one; the files are in formats that any browser or slide show plays.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from deformnb._deferred import scipy
from deformnb._typing import Image
from deformnb.checks import real_array, short_value
from deformnb.document.animation import Animation
from deformnb.document.deformation import Deformation, Step
from deformnb.errors import DeformError
from deformnb.imaging.camera import Camera, fitting_height
from deformnb.imaging.render import RENDERERS, CoreRenderer, RendererName, VtkRenderer, find_renderer
from deformnb.io.movies import MOVIES, write_movie
from deformnb.volume.plane import Plane
from deformnb.volume.transfer import PresetName, TransferFunction, as_transfer
from deformnb.volume.volume import Grid, Volume, VolumeLike, as_grid, as_volume
from deformnb.warping.warper import Warper

__all__ = [
    "FRAME_CONTENTS",
    "MOVIES",
    "Frames",
    "animation_frames",
    "deformation_frames",
    "orbit",
    "swing",
    "write_movie",
]


FrameContent: TypeAlias = Literal["after", "pair"]
"""Names of the contents of a frame."""

FRAME_CONTENTS: tuple[FrameContent, ...] = get_args(FrameContent)
"""Contents of a frame: the deformed volume alone, or the volume as it was to its left."""

_BACKGROUND = (0.06, 0.065, 0.08)

# A moment that no animation has: the volume as it was given.
_BEFORE = -1.0


def swing(count: int, *, to: float = 1.0) -> tuple[float, ...]:
    """Strengths from 0 to ``to`` and back, slow at both ends; the one after the last would be the first again.

    Examples
    --------
    >>> swing(4)
    (0.0, 0.5, 1.0, 0.5)
    """
    if not (isinstance(count, int | np.integer) and count >= 1):
        raise DeformError(f"a movie has a whole number of frames, at least 1, got {count!r}.")
    turn = 2 * np.pi * np.arange(count) / count
    return tuple((to * (0.5 - 0.5 * np.cos(turn)).round(12)).tolist())


def orbit(
    count: int, direction: ArrayLike = (0.4, 1.0, -0.3), *, axis: ArrayLike = (0.0, 0.0, 1.0), degrees: float = 360.0
) -> tuple[tuple[float, float, float], ...]:
    """Directions of a camera that goes around a volume in ``count`` equal steps.

    Parameters
    ----------
    direction : of the first frame.
    axis : to turn about; it should point up in the picture.
    degrees : the whole angle; it is not reached, so that the movie loops to its first frame.

    Examples
    --------
    >>> [tuple(round(c) for c in d) for d in orbit(4, (0, 1, 0))]
    [(0, 1, 0), (-1, 0, 0), (0, -1, 0), (1, 0, 0)]
    """
    swing(count)  # refuses an invalid number of frames
    _, _, up = Plane.from_normal((0, 0, 0), axis).frame  # refuses an invalid direction
    turned = scipy.spatial.transform.Rotation.from_rotvec(
        np.radians(degrees * np.arange(count) / count)[:, None] * up
    ).apply(np.asarray(direction, dtype=float))
    return tuple((x, y, z) for x, y, z in turned.tolist())


class Frames(Iterator[Image]):
    """Pictures made one by one, with their number; see :func:`deformation_frames`."""

    def __init__(self, images: Iterator[Image], count: int) -> None:
        self._images, self._left = images, count

    def __next__(self) -> Image:
        image = next(self._images)
        self._left -= 1
        return image

    def __length_hint__(self) -> int:
        return self._left

    def close(self) -> None:
        """Release the resources of the renderer, before the last frame too."""
        close = getattr(self._images, "close", None)
        if close is not None:
            close()


def deformation_frames(
    volume: VolumeLike,
    deformation: Deformation | Step,
    *,
    strengths: int | Sequence[float] = 48,
    directions: ArrayLike = (0.4, 1.0, -0.3),
    up: ArrayLike | None = None,
    size: tuple[int, int] = (640, 480),
    transfer: TransferFunction | PresetName | None = None,
    shows: FrameContent = "after",
    output: Grid | VolumeLike | None = None,
    background: tuple[float, float, float] = _BACKGROUND,
    backend: RendererName = "auto",
) -> Frames:
    """Pictures of a volume whose control points are dragged all the way and back.

    Each frame solves for the points as far as they are dragged then: halfway is no mixture of two pictures.

    Parameters
    ----------
    deformation : or a single step.
    strengths : a strength for each frame, as in :meth:`scaled`; a number is that of
        the frames of a :func:`swing` from 0 to 1 and back.
    directions : viewing direction, one for all frames or one for each (see :func:`orbit`). The scale is the same
        in all frames.
    up : direction that points up in the picture; default is +z, or -y for a view along z.
    size : (width, height) of a frame in pixels, of one half for "pair".
    transfer : colours and opacities, or the name of a preset of the volume before; default is "specimen".
    shows : one of :data:`FRAME_CONTENTS`.
    output : the grid of the result (the field of view); default is the volume's.
    background : red, green and blue in [0, 1].
    backend : a name of :data:`~deformnb.imaging.render.RENDERERS`, or "auto".

    Returns
    -------
    Frames, an iterator of (height, width, 3) uint8. Nothing is computed before the first is requested, and one thread
    must request all.

    Raises
    ------
    DeformError
        Immediately if the lists do not fit together or a choice is unknown, later if the points cannot be fitted.

    Examples
    --------
    >>> from deformnb.rbf.points import ControlPoints
    >>> volume = Volume.from_array(np.eye(8, dtype=np.uint8) * np.full((8, 1, 1), 200, np.uint8))
    >>> points = ControlPoints.from_arrays([[1, 1], [6, 1], [3, 6]], [[1, 1], [6, 1], [3, 4]])
    >>> deformation = Deformation.from_picture_points(volume, "+z", points)
    >>> frames = deformation_frames(volume, deformation, strengths=4, size=(32, 24), backend="core")
    >>> [frame.shape for frame in frames]
    [(24, 32, 3), (24, 32, 3), (24, 32, 3), (24, 32, 3)]
    """
    chosen = swing(int(strengths)) if isinstance(strengths, int | np.integer) else _numbers(strengths)
    if isinstance(deformation, Step):
        deformation = Deformation((deformation,))
    if not isinstance(deformation, Deformation):
        raise DeformError(f"a Deformation is needed, got {short_value(deformation)}.")
    return _frames(
        volume, deformation.scaled, 0.0, chosen, directions, up, size, transfer, shows, output, background, backend
    )


def animation_frames(
    volume: VolumeLike,
    animation: Animation | Deformation,
    *,
    fps: float = 24.0,
    times: Sequence[float] | None = None,
    directions: ArrayLike = (0.4, 1.0, -0.3),
    up: ArrayLike | None = None,
    size: tuple[int, int] = (640, 480),
    transfer: TransferFunction | PresetName | None = None,
    shows: FrameContent = "after",
    output: Grid | VolumeLike | None = None,
    background: tuple[float, float, float] = _BACKGROUND,
    backend: RendererName = "auto",
) -> Frames:
    """Pictures of the animation of a document's key frames; each frame solves for the points of its moment.

    Parameters
    ----------
    animation : or a document with key frames.
    fps : pictures a second, of one round of the animation.
    times : the moments of the pictures in seconds instead; also in another order, or twice.
    directions, up, size, transfer, shows, output, background, backend : as for :func:`deformation_frames`.

    Examples
    --------
    >>> from deformnb.rbf.points import ControlPoints
    >>> from deformnb.document.deformation import Keyframe
    >>> volume = Volume.from_array(np.eye(8, dtype=np.uint8) * np.full((8, 1, 1), 200, np.uint8))
    >>> sets = [ControlPoints.from_arrays([[1, 1], [6, 1], [3, 6]], [[1, 1], [6, 1], [3, b]]) for b in (6, 4)]
    >>> keys = [Keyframe(t, Deformation.from_picture_points(volume, "+z", p).steps) for t, p in enumerate(sets)]
    >>> animation = Animation(Deformation(keyframes=keys))
    >>> len([*animation_frames(volume, animation, fps=2, size=(32, 24), backend="core")])
    3
    """
    if isinstance(animation, Deformation):
        animation = Animation(animation)
    if not isinstance(animation, Animation):
        raise DeformError(f"an Animation is needed, or a Deformation with key frames, got {short_value(animation)}.")
    moments = animation.times(fps) if times is None else tuple(map(animation.moment, _numbers(times, "times")))

    def document(moment: float) -> Deformation:
        return Deformation() if moment == _BEFORE else animation.at(moment)

    return _frames(
        volume, document, _BEFORE, moments, directions, up, size, transfer, shows, output, background, backend
    )


def _frames(
    volume: VolumeLike,
    document: Callable[[float], Deformation],
    before: float,
    moments: Sequence[float],
    directions: ArrayLike,
    up: ArrayLike | None,
    size: tuple[int, int],
    transfer: TransferFunction | PresetName | None,
    shows: FrameContent,
    output: Grid | VolumeLike | None,
    background: tuple[float, float, float],
    backend: RendererName,
) -> Frames:
    """Pictures of the documents of some moments; at the moment ``before`` the volume is as it was."""
    if not isinstance(shows, str) or shows not in FRAME_CONTENTS:
        raise DeformError(f"frames cannot show {short_value(shows)}; choose {' or '.join(FRAME_CONTENTS)}.")
    volume = as_volume(volume)
    grid = volume.grid if output is None else as_grid(output)
    planes = _planes(grid, directions, up, len(moments))
    function = as_transfer(transfer, volume)
    renderer = RENDERERS[find_renderer(backend)](function, size, background)  # refuses a wrong size or renderer
    shown = list(zip(moments, planes, strict=True))
    images = _images(volume, document, shown, grid, renderer, size, before, shows == "pair")
    return Frames(images, len(moments))


def _numbers(given: Sequence[float], what: str = "strengths") -> tuple[float, ...]:
    try:
        chosen = tuple(float(s) for s in given)
    except (TypeError, ValueError):
        kinds = "a number of frames or a list of numbers" if what == "strengths" else "a list of numbers"
        raise DeformError(f"{what} are {kinds}, got {given!r:.60}.") from None
    if not chosen or not np.isfinite(chosen).all():
        raise DeformError(f"{what} must be finite numbers, one for each frame and at least one.")
    return chosen


def _planes(grid: Grid, directions: ArrayLike, up: ArrayLike | None, count: int) -> list[Plane]:
    looks = real_array(directions)
    if looks is None:
        raise DeformError(f"directions are numbers, got {short_value(directions)}.")
    if looks.shape not in ((3,), (count, 3)):
        raise DeformError(
            f"directions are one direction, or one for each of the {count} frames, got an array of shape {looks.shape}."
        )
    return [Plane.from_normal(grid.center, look, up) for look in np.broadcast_to(looks, (count, 3))]


def _images(
    volume: Volume,
    document: Callable[[float], Deformation],
    views: list[tuple[float, Plane]],
    grid: Grid,
    renderer: CoreRenderer | VtkRenderer,
    size: tuple[int, int],
    before: float,
    is_pair: bool,
) -> Iterator[Image]:
    height = max(fitting_height(grid, plane, size) for _, plane in views)
    warper, volumes = Warper(volume, output=grid), dict[float, Volume]()
    # In the second half the same pictures come again, as long as the camera does not move.
    left, kept = Counter(views), dict[tuple[float, Plane], Image]()

    def deformed(moment: float) -> Volume:
        if moment not in volumes:
            for other in [m for m in volumes if m != before]:  # cached are the last and the one that is not deformed
                del volumes[other]
            volumes[moment] = warper(document(moment).field(volume.grid))
        return volumes[moment]

    def draw(moment: float, plane: Plane) -> Image:
        key = (moment, plane)
        image = kept.pop(key, None)
        if image is None:
            image = renderer(deformed(moment), Camera(plane, height))
        left[key] -= 1
        if left[key] > 0:
            kept[key] = image
        return image

    if is_pair:
        left.update((before, plane) for _, plane in views)
    try:
        for moment, plane in views:
            if is_pair:
                yield np.concatenate([draw(before, plane), draw(moment, plane)], axis=1)
            else:
                yield draw(moment, plane).copy()  # a caller that paints on a frame must not change a later one
    finally:
        renderer.close()
