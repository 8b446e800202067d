"""Animations: key frames of a document, and the frames between them.

Between two key frames the control points move as rigidly as they can and the displacement is solved for again: a blend
of the two displacements themselves would shrink what turns, by cos(angle / 2) halfway.

All moments of an animation can be stored in one array whose third axis is time (section 5 of the paper, Fig. 5). A
displacement in space for every time step would be expensive. Each comes from one over a plane by replication, so the
maps of all time steps are stored one behind the other, as ONE map of three dimensions, and time is looked up in it as a
depth would be.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from deformnb.checks import check_fields, finite_number
from deformnb.document.deformation import EASINGS, LOOPS, Deformation, EasingName, Keyframe, LoopName, Step
from deformnb.document.motion_paths import StepPath, one_map, step_paths
from deformnb.errors import DeformError
from deformnb.rbf.extrusion import Extrusion, Weights
from deformnb.rbf.fields import AbstractField, DisplacementField
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.volume import Grid


@dataclass(frozen=True, eq=False)
class TimeMaps:
    """Backward displacements over a plane at equal steps of time.

    Parameters
    ----------
    values : (T, nv, nu, 2) float32, components a, b, physical units; the first at time 0, the last at ``duration``.
    raster : of the samples on the plane.
    plane : the plane of the picture.
    depth : depths of the first and the last slice along the plane's normal, as in
        :class:`~deformnb.rbf.extrusion.Extrusion`.
    weights : knots and weights along the normal; of replication, or of a curve that does not change with time.
    duration : seconds.

    Notes
    -----
    Frame k is the moment k duration / (T - 1). Between two frames the maps are blended linearly; before the first and
    after the last nothing changes.

    Examples
    --------
    >>> from deformnb.rbf.extrusion import replicate
    >>> plane, raster = Plane((0, 0, 0), (1, 0, 0), (0, 1, 0)), Raster((8, 8), (1.0, 1.0), (0.0, 0.0))
    >>> maps = TimeMaps(np.zeros((5, 8, 8, 2), np.float32), raster, plane, (0.0, 9.0), replicate(), 2.0)
    >>> maps.position(0.0), maps.position(1.0), maps.position(9.0)
    (0.0, 2.0, 4.0)
    """

    values: NDArray[np.float32]
    raster: Raster
    plane: Plane
    depth: tuple[float, float]
    weights: Weights
    duration: float

    def __post_init__(self) -> None:
        if self.values.ndim != 4 or not len(self.values) or self.values.shape[1:] != (*self.raster.shape, 2):
            raise DeformError(
                f"maps over time have the shape (T, {self.raster.shape[0]}, {self.raster.shape[1]}, 2), "
                f"got {self.values.shape}."
            )
        if not (np.isfinite(self.duration) and self.duration >= 0):
            raise DeformError(f"the duration must be seconds from 0 on, got {self.duration}.")

    def __len__(self) -> int:
        return len(self.values)

    @property
    def times(self) -> NDArray[np.float64]:
        """The moment of every frame in seconds."""
        return np.linspace(0.0, self.duration, len(self))

    @property
    def nbytes(self) -> int:
        """Size of the array."""
        return int(self.values.nbytes)

    def full_bytes(self, grid: Grid) -> int:
        """Size of the same frames as displacements of every voxel of a grid, in float32."""
        return len(self) * 3 * 4 * int(np.prod(grid.shape))

    def position(self, time: float) -> float:
        """Time as a fractional number of frames, clamped to the first and the last."""
        last = len(self) - 1
        return float(np.clip(time / self.duration * last, 0, last)) if self.duration > 0 else 0.0

    def at(self, time: float) -> DisplacementField:
        """The map over the plane at a moment, blended from the two frames next to it."""
        p = self.position(time)
        k = min(int(p), len(self) - 2) if len(self) > 1 else 0
        share = np.float32(p - k)
        if share == 0:
            return DisplacementField(self.values[k], self.raster)
        return DisplacementField((1 - share) * self.values[k] + share * self.values[k + 1], self.raster)

    def field(self, time: float) -> Extrusion:
        """The displacement in space at a moment."""
        return Extrusion(self.plane, self.depth, (self.at(time),), *self.weights)


def covering_raster(plane: Plane, grid: Grid, size: int | None = None) -> Raster:
    """Nodes over all of a plane that the box of a grid covers, the outermost on its edges.

    Parameters
    ----------
    size : nodes along the longer side; default is one for every voxel.
    """
    at = plane.to_plane(grid.corners())[:, :2]
    low, extent = at.min(axis=0), np.maximum(np.ptp(at, axis=0), 1e-9 * grid.diagonal)
    pitch = min(grid.spacing) if size is None else float(extent.max()) / max(1, size - 1)
    nu, nv = (max(2, int(np.ceil(round(float(e) / pitch, 6))) + 1) for e in extent)
    return Raster((nv, nu), (float(extent[0]) / (nu - 1), float(extent[1]) / (nv - 1)), (float(low[0]), float(low[1])))


MOST_MOVIE_FRAMES = 4096
"""Of a stack: a longer one is no texture of any GPU."""

# Frames between two key frames where time passes unevenly: a linear blend lags behind by 1/300 of the path.
_SMOOTH_FRAMES = 16


@dataclass(frozen=True)
class Animation:
    """The key frames of a document in motion.

    Parameters
    ----------
    deformation : has :attr:`~deformnb.document.deformation.Deformation.keyframes`.
    easing : a name of :data:`~deformnb.document.deformation.EASINGS`; default is the document's.
    loop : a name of :data:`LOOPS`, default is the document's; with "loop" the last key frame should be
        as the first.

    Notes
    -----
    Steps are matched by their place in the list and points by their ids; see
    :mod:`deformnb.document.motion_paths` for those that only one of two key frames has. :attr:`notes` names the
    settings that switch because there is nothing between.

    Examples
    --------
    A quarter turn: halfway the point is on the circle, not on the chord.

    >>> from deformnb.rbf.points import ControlPoints
    >>> from deformnb.volume.plane import Plane
    >>> rest = ControlPoints.from_arrays([[0, 0], [8, 0], [16, 0]])
    >>> turned = ControlPoints.from_arrays(rest.source, [[0, 0], [0, 8], [0, 16]])
    >>> keys = [Keyframe(t, (Step((p,), Plane((0, 0, 0), (1, 0, 0), (0, 1, 0))),)) for t, p in ((0, rest), (2, turned))]
    >>> animation = Animation(Deformation(keyframes=keys))
    >>> animation.at(1.0).steps[0].points.target[2].round(3).tolist()
    [11.314, 11.314]
    """

    deformation: Deformation
    easing: EasingName | Literal[""] = ""
    loop: LoopName | Literal[""] = ""

    def __post_init__(self) -> None:
        check_fields(self)
        for name in ("easing", "loop"):
            object.__setattr__(self, name, getattr(self, name) or getattr(self.deformation, name))
        if self.easing not in EASINGS:
            raise DeformError(f"unknown easing {self.easing!r}; choose one of {', '.join(EASINGS)}.")
        if self.loop not in LOOPS:
            raise DeformError(f"unknown loop {self.loop!r}; choose one of {', '.join(LOOPS)}.")
        if not self.deformation.keyframes:
            raise DeformError("the document has no key frames, so there is nothing to animate; add at least one.")

    @property
    def keyframes(self) -> tuple[Keyframe, ...]:
        """The key frames, their times rising."""
        return self.deformation.keyframes

    @property
    def duration(self) -> float:
        """The time of the last key frame in seconds; the first one counts from 0."""
        return self.keyframes[-1].time

    @cached_property
    def _paths(self) -> list[list[StepPath]]:
        return [step_paths(a.steps, b.steps) for a, b in pairwise(self.keyframes)]

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the settings that switch at a key frame because they cannot be interpolated."""
        return tuple(
            f"at {after.time:g} s {note}: it switches there."
            for after, paths in zip(self.keyframes[1:], self._paths, strict=True)
            for path in paths
            for note in path.notes
        )

    def moment(self, t: float) -> float:
        """The time between 0 and the duration that is shown at t, by the loop.

        >>> from deformnb.document.deformation import Keyframe
        >>> swinging = Animation(Deformation(keyframes=(Keyframe(2.0, ()),)), loop="swing")
        >>> [swinging.moment(t) for t in (-1, 0.5, 2.5, 4.5)]
        [1.0, 0.5, 1.5, 0.5]
        """
        length = self.duration
        t = finite_number(t, "a moment must be a finite number of seconds")
        if self.loop == "once" or length == 0:
            return float(np.clip(t, 0.0, length))
        if self.loop == "loop":
            return length if t == length else float(t % length)
        around = float(t % (2 * length))
        return around if around <= length else 2 * length - around

    def at(self, t: float) -> Deformation:
        """The document at a moment: at a key frame its steps unchanged, else the blend of two.

        Parameters
        ----------
        t : seconds; before the first key frame that one holds, after the last one the loop decides.
        """
        return replace(self.deformation, steps=self._steps(self.moment(t)), keyframes=())

    def _steps(self, t: float) -> tuple[Step, ...]:
        times = [key.time for key in self.keyframes]
        k = int(np.searchsorted(times, t, side="right")) - 1
        if k < 0 or k == len(times) - 1 or t == times[k]:
            return self.keyframes[max(k, 0)].steps
        share = EASINGS[self.easing]((t - times[k]) / (times[k + 1] - times[k]))
        return tuple(path.at(share) for path in self._paths[k])

    def field(self, t: float, grid: Grid) -> AbstractField:
        """The displacement in space at a moment, solved for then."""
        return self.at(t).field(grid)

    def times(self, fps: float) -> tuple[float, ...]:
        """The moments of the pictures of one round; a loop ends just before it would begin again.

        >>> swinging = Animation(Deformation(keyframes=(Keyframe(1.0, ()),)), loop="swing")
        >>> swinging.times(2)
        (0.0, 0.5, 1.0, 0.5)
        """
        wanted = "a movie has between 0.01 and 1000 frames a second"
        if not 0.01 <= finite_number(fps, wanted) <= 1000:
            raise DeformError(f"{wanted}, got {fps}.")
        length = self.duration * (2 if self.loop == "swing" else 1)
        count = max(1, round(length * fps))
        if self.loop == "once" and length > 0:
            return tuple(np.linspace(0.0, length, count + 1).tolist())
        return tuple(round(self.moment(k * length / count), 12) for k in range(count))

    # -- one array for all moments -------------------------------------------------------------------------------------

    def frame_count(self, degrees: float = 10.0) -> int:
        """The number of frames at equal steps that lets nothing turn by more than ``degrees`` from one to the next.

        If possible every key frame is one of them.
        """
        if not degrees > 0:
            raise DeformError(f"frames are a positive angle apart, got {degrees}.")
        paces = np.diff([EASINGS[self.easing](t) for t in np.linspace(0, 1, 101)]).max() * 100
        step = np.inf
        for (a, b), paths in zip(pairwise(self.keyframes), self._paths, strict=True):
            turn = np.degrees(max((path.turn for path in paths), default=0.0)) * paces
            parts = max(turn / degrees, 1.0 if self.easing == "linear" else _SMOOTH_FRAMES)
            step = min(step, (b.time - a.time) / parts)
        if self.duration == 0:
            return 1
        least = max(1, int(np.ceil(self.duration / step - 1e-9)))
        if least >= MOST_MOVIE_FRAMES:
            raise DeformError(
                f"{least + 1} frames are more than {MOST_MOVIE_FRAMES}; let them be further apart than "
                f"{degrees:g} degrees."
            )
        shares = np.array([key.time for key in self.keyframes]) / self.duration
        fits = (
            n
            for n in range(least, min(2 * least + 8, MOST_MOVIE_FRAMES))
            if np.abs(shares * n - np.round(shares * n)).max() < 1e-6
        )
        return next(fits, least) + 1

    def stack(
        self,
        grid: Grid,
        frames: int | None = None,
        *,
        raster: Raster | None = None,
        size: int | None = None,
        degrees: float = 10.0,
        output: Grid | None = None,
    ) -> TimeMaps:
        """The maps of all moments as ONE array whose third axis is time.

        Parameters
        ----------
        grid : of the volume.
        frames : their number; default is :meth:`frame_count` of ``degrees``.
        raster : samples of a map; default covers the grid with one for every voxel, or with ``size`` along its longer
            side.
        output : the grid whose box is seen, which the maps cover; default is that of the volume.

        Raises
        ------
        DeformError
            Unless the animation is one step on one plane, without cuts and without key pictures in depth.
        """
        count = self.frame_count(degrees) if frames is None else int(frames)
        if not 1 <= count <= MOST_MOVIE_FRAMES:
            raise DeformError(f"a stack has 1 to {MOST_MOVIE_FRAMES} frames, got {count}.")
        plane, weights = self._common(grid)
        lattice = raster or covering_raster(plane, grid if output is None else output, size)
        values = np.empty((count, *lattice.shape, 2), np.float32)
        for k, t in enumerate(np.linspace(0.0, self.duration, count).tolist()):
            step = one_map(self._steps(t))
            values[k] = 0 if step is None else np.moveaxis(step.fits(grid)[0].sample_on_raster(lattice), 0, -1)
        return TimeMaps(values, lattice, plane, plane.depth_range(grid), weights, self.duration)

    def _common(self, grid: Grid) -> tuple[Plane, Weights]:
        """The plane, and the weights in depth, that all moments share."""
        used = [step for key in self.keyframes if (step := one_map(key.steps)) is not None]
        if not used:
            raise DeformError("no key frame has a step in use, so there is nothing to store.")
        (plane, *planes), (weights, *others) = [s.plane for s in used], [s.weights() for s in used]
        same = all(np.array_equal(a, b) for w in others for a, b in zip(weights, w, strict=True))
        if plane is None or any(p != plane for p in planes) or not same:
            raise DeformError(
                "maps over time are on one plane with one rule of extrusion; the key frames differ "
                "in that. Render the frames one by one."
            )
        return plane, weights
