"""Edits of the key frames of a document: each returns the next document, or refuses and says why.

A key frame keeps the steps of the document as they were when it was made. The document itself goes on: a key frame is
changed by going to it (:func:`at_key`), editing, and taking what has become of it (:func:`update_key`).
"""

from __future__ import annotations

from dataclasses import replace

from deformnb.control_points import ControlPoints
from deformnb.deformation import Deformation, Keyframe, Step
from deformnb.errors import DeformError

APART = 1e-3
"""Seconds between two key frames at least; what is nearer counts as the same moment."""

_PAUSE = 1.0  # seconds after the last key frame, where the next one comes if nothing else is said


def free_time(deformation: Deformation) -> float:
    """Where the next key frame comes: at 0, or one second after the last."""
    keys = deformation.keyframes
    return keys[-1].time + _PAUSE if keys else 0.0


def key_at(deformation: Deformation, time: float) -> int | None:
    """The number of the key frame at a moment; None if there is none."""
    return next((k for k, key in enumerate(deformation.keyframes) if abs(key.time - time) < APART), None)


def add_key(deformation: Deformation, time: float | None = None) -> Deformation:
    """One more key frame of the document as it is now; one that is there already is replaced.

    Parameters
    ----------
    time : in seconds; default is :func:`free_time`.

    Examples
    --------
    >>> twice = add_key(add_key(Deformation()))
    >>> [key.time for key in twice.keyframes]
    [0.0, 1.0]
    """
    at = free_time(deformation) if time is None else float(time)
    here = key_at(deformation, at)
    if here is not None:
        return update_key(deformation, here)
    return _with_keys(deformation, (*deformation.keyframes, Keyframe(at, deformation.steps)))


def update_key(deformation: Deformation, index: int) -> Deformation:
    """The document's steps of now in the place of those of a key frame."""
    keys = _checked(deformation, index)
    return _with_keys(deformation, (*keys[:index], replace(keys[index], steps=deformation.steps), *keys[index + 1 :]))


def remove_key(deformation: Deformation, index: int) -> Deformation:
    """Without a key frame."""
    keys = _checked(deformation, index)
    return _with_keys(deformation, (*keys[:index], *keys[index + 1 :]))


def move_key(deformation: Deformation, index: int, time: float) -> Deformation:
    """A key frame at another moment; it may pass others."""
    keys = _checked(deformation, index)
    moved = replace(keys[index], time=float(time))
    there = key_at(deformation, moved.time)
    if there not in (None, index):
        raise DeformError(f"there is a key frame at {keys[there or 0].time:g} s already; remove it or choose another "
                          "moment.")
    return _with_keys(deformation, (*keys[:index], moved, *keys[index + 1 :]))


def repeat_key(deformation: Deformation, index: int) -> Deformation:
    """The same steps once more, one second after the last key frame: so a loop is closed."""
    steps = _checked(deformation, index)[index].steps
    return _with_keys(deformation, (*deformation.keyframes, Keyframe(free_time(deformation), steps)))


def at_key(deformation: Deformation, index: int) -> Deformation:
    """The document as it was at a key frame, to be edited."""
    return with_steps(deformation, _checked(deformation, index)[index].steps)


def with_steps(deformation: Deformation, steps: tuple[Step, ...]) -> Deformation:
    """The document with the steps of another moment.

    Points that are added then get ids that no key frame knows: points of two key frames are the same by their ids.
    """
    every = [key.steps for key in deformation.keyframes] + [deformation.steps]
    return replace(deformation, steps=tuple(
        replace(step, maps=tuple(_with_fresh_ids(points, [m for others in every if k < len(others)
                                                          for m in others[k].maps]) for points in step.maps))
        for k, step in enumerate(steps)))


def _with_fresh_ids(points: ControlPoints, others: list[ControlPoints]) -> ControlPoints:
    return replace(points, next_id=max([points.next_id, *(m.next_id for m in others)]))


def is_now(deformation: Deformation, index: int) -> bool:
    """Whether a key frame is what the document is now."""
    steps = _checked(deformation, index)[index].steps
    return with_steps(deformation, steps).steps == with_steps(deformation, deformation.steps).steps


def _checked(deformation: Deformation, index: int) -> tuple[Keyframe, ...]:
    keys = deformation.keyframes
    if not 0 <= index < len(keys):
        raise DeformError(f"there is no key frame {index + 1}; there are {len(keys)}.")
    return keys


def _with_keys(deformation: Deformation, keys: tuple[Keyframe, ...]) -> Deformation:
    return replace(deformation, keyframes=tuple(sorted(keys, key=lambda key: key.time)))
