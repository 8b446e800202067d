"""Examples of a deformation for any volume: each is one edit of a session that shows the use of a tool.

Each sets control points around the foreground of the picture, along its principal axes
(:func:`~deformnb.imaging.demo.subject_axes`) or in its box (:func:`~deformnb.imaging.demo.subject_box`), in place of
those of the step being edited, so that one undo reverts everything.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deformnb.datasets.darcy import thompson_map
from deformnb.document.deformation import Step
from deformnb.document.edits import initial_step
from deformnb.errors import DeformError
from deformnb.imaging.demo import subject_axes, subject_box
from deformnb.rbf.cuts import Cut
from deformnb.rbf.extrusion import FRONT_ONLY
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Line
from deformnb.session.opening import show_opening
from deformnb.session.session import Session
from deformnb.volume.plane import Picture

_BEND = 1.0  # radians: the angle between the ends of the bent subject
_SAG = 0.12  # of half of the subject's length: how far all is moved back to stay in the middle
_INCISION = 0.6  # of half of the subject's length: how far the incision reaches from the middle
_WIDENING = 0.22  # of half of the subject's width: how far either side is moved outwards
_ELONGATED = 1.7  # length by width from which on a body is like a fish: carps have 3, an abdomen 1.4, a head 1.2
_OPENING = 0.42  # of half of the subject's width: how far either side of the incision is moved


@dataclass(frozen=True)
class Example:
    """A deformation to try.

    Parameters
    ----------
    title, tooltip : of its button.
    make : the step from an untouched one and its picture.
    elongation : least and largest length by width of the subjects on the picture that it fits.
    """

    title: str
    tooltip: str
    make: Callable[[Step, Picture], Step]
    elongation: tuple[float, float] = (1.0, math.inf)


def _shorten_axes(picture: Picture) -> tuple[NDArray[np.float64], ...]:
    """The axes of the subject, shortened so that no corner of the box along them is outside the picture."""
    middle, long, short = subject_axes(picture)
    a0, a1, b0, b1 = picture.raster.box
    room = np.minimum(middle - (a0, b0), (a1, b1) - middle)
    share = min(1.0, float((room / (np.abs(long) + np.abs(short))).min()))
    return middle, share * long, share * short


def bend(step: Step, picture: Picture) -> Step:
    """Bend the subject to an arc of a circle with a middle line of the same length: points on three lines."""
    middle, long, short = _shorten_axes(picture)
    size = np.linalg.norm(long)
    along, across = long / size, short / np.linalg.norm(short)
    u, v = (grid.ravel()[:, None] for grid in np.meshgrid(size * np.linspace(-1, 1, 5), (-1.0, 0.0, 1.0)))
    v = v * np.linalg.norm(short)
    radius = 2 * size / _BEND
    angle = u / radius
    source = middle + u * along + v * across
    target = middle + (radius - v) * np.sin(angle) * along + (radius - (radius - v) * np.cos(angle)) * across
    return step.with_points(ControlPoints.from_arrays(source, target - _SAG * size * across))


def open_cut(step: Step, picture: Picture) -> Step:
    """An incision along the subject that stops inside it at both ends and in its depth, pulled open.

    A point on either side is moved away from the cut; points around it hold the rest.
    """
    middle, long, short = _shorten_axes(picture)
    held = [
        middle + sign * place
        for sign in (-1, 1)
        for place in (0.9 * long, 0.95 * short, 0.55 * long + 0.8 * short, 0.55 * long - 0.8 * short)
    ]
    source = np.array([*held, middle - 0.1 * short, middle + 0.1 * short])
    target = source + np.array([[0.0, 0.0]] * len(held) + [-_OPENING * short, _OPENING * short])
    points = step.points
    for place, moved in zip(source, target, strict=True):
        points = points.add(place, moved)
    vertices = tuple((float(a), float(b)) for a, b in (middle - _INCISION * long, middle + _INCISION * long))
    cut = Cut(Line(vertices, stops=(True, True)), "incision")
    return replace(step.with_points(points), cuts=(cut,), extrusion="modulate", curve=FRONT_ONLY)


def thompson(step: Step, picture: Picture) -> Step:
    """Transform Thompson's grid of Polyprion, on the subject, into that of Antigonia (1917, Figs. 377, 380)."""
    grids = thompson_map("Polyprion", "Antigonia", box=subject_box(picture), frame=picture.raster.box)
    return step.with_points(
        ControlPoints.from_arrays(grids.source_nodes.reshape(-1, 2), grids.target_nodes.reshape(-1, 2))
    )


def widen(step: Step, picture: Picture) -> Step:
    """Move both sides of the subject outwards by the same amount; its middle line and its ends stay."""
    a0, a1, b0, b1 = subject_box(picture)
    middle, half = np.array([a0 + a1, b0 + b1]) / 2, np.array([a1 - a0, b1 - b0]) / 2
    held = [(u, v) for u in (-1.3, 0.0, 1.3) for v in (-1.1, 1.1)] + [(0.0, 0.0)]
    sides = [(-0.7, 0.0), (0.7, 0.0)]
    source = middle + np.array(held + sides) * half
    moved = np.array([(0.0, 0.0)] * len(held) + [(-_WIDENING, 0.0), (_WIDENING, 0.0)]) * half
    return step.with_points(ControlPoints.from_arrays(source, source + moved))


ExampleName: TypeAlias = Literal["bend", "widen", "open", "thompson"]
"""Names of the examples."""

EXAMPLES: dict[ExampleName, Example] = {
    "bend": Example("Bend it", "Bend the subject to an arc", bend, (1.25, math.inf)),
    "widen": Example("Widen it", "Move both sides outwards by the same amount", widen, (1.0, _ELONGATED)),
    "open": Example("Cut it open", "An incision in front, and two points that pull it open", open_cut),
    "thompson": Example(
        "Thompson's fish",
        "The grid by which D'Arcy Thompson turned one fish into another",
        thompson,
        (_ELONGATED, math.inf),
    ),
}
"""Examples by name."""


def fitting_examples(session: Session) -> tuple[str, ...]:
    """Names of the examples that fit what the picture of a session shows; none for a step in space.

    Examples
    --------
    >>> from deformnb.datasets.phantoms import PHANTOMS
    >>> fitting_examples(Session(PHANTOMS["head"].make((24, 24, 24)), view="+y"))
    ('bend', 'widen', 'open')
    """
    if session.editing.step.plane is None:
        return ()
    a0, a1, b0, b1 = session.pictures.subject_box
    elongation = max(a1 - a0, b1 - b0) / min(a1 - a0, b1 - b0)
    return tuple(name for name, one in EXAMPLES.items() if one.elongation[0] <= elongation <= one.elongation[1])


def apply_example(session: Session, name: ExampleName) -> None:
    """Replace the step that is edited by an example, as one edit.

    Raises
    ------
    DeformError
        For an unknown name, for a step in space, and where nothing is seen on the picture.

    Examples
    --------
    >>> from deformnb.datasets.phantoms import PHANTOMS
    >>> session = Session(PHANTOMS["fish"].make((16, 32, 16)))
    >>> apply_example(session, next(iter(EXAMPLES)))
    >>> bool(session.editing.points.displacement.any())
    True
    """
    if name not in EXAMPLES:
        raise DeformError(f"unknown example {name!r}; choose one of {', '.join(EXAMPLES)}.")
    plane = session.editing.step.plane
    if plane is None:
        raise DeformError(
            "the examples are for a picture, and this step has its points in space: choose another step, or add one."
        )
    example = EXAMPLES[name]
    begun = replace(initial_step(plane, session.editing.grid), name=session.editing.step.name)
    step = example.make(begun, session.pictures.picture())
    session.editing.edit_document(
        session.editing.deformation.with_step(session.editing.index, step), f"example: {example.title.lower()}"
    )
    if step.cut_regions:
        show_opening(session)
