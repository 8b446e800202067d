"""Two grids side by side, as D'Arcy Thompson drew them: the picture on a regular net, and what became of both.

Area expansion and principal strains can be laid over the second one. The figure is for print: saved as SVG or PDF the
nets, arrows and words stay vectors and text, and only the pictures are pixels.
"""

from __future__ import annotations

from os import PathLike
from typing import TYPE_CHECKING

import numpy as np

from deformnb.deformation import Deformation, Step
from deformnb.drawing import STYLES, save_figure
from deformnb.errors import DeformError
from deformnb.fields import AbstractField
from deformnb.plane import Picture
from deformnb.quality import affine_split, bending_energy
from deformnb.thompson_net import field_of, landmarks_of, make_grids, steps_of
from deformnb.thompson_sheet import OVERLAYS, Sheet
from deformnb.volume import Grid

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH = 7.2
"""Inches of a figure: two columns of a journal."""


def draw_grids(what: Step | Deformation | AbstractField, picture: Picture, *, lines: int = 12, overlay: str = "none",
               magnify: float = 1.0, grid: Grid | None = None, key: int = 0, landmarks: bool = True,
               title: str | None = None, unit: str = "mm", style: str = "paper", width: float = WIDTH,
               path: str | PathLike[str] | None = None) -> Figure:
    """The picture on a regular net, and the deformed picture on the deformed net.

    Parameters
    ----------
    what : a step on the picture's plane, a deformation whose steps all lie there, or any field of dimension 2.
    picture : as it was before.
    lines : cells of the net along the longer side of the picture.
    overlay : a name of :data:`OVERLAYS`: "area" colours how matter grows (green) and shrinks (purple), "strain" draws
        crosses along the principal directions, solid where matter is stretched and dashed where it is pressed.
    magnify : how many times as far everything is dragged: 0 the original, 1 as it is, 2 exaggerated, -1 the opposite.
        The points of a step are fitted anew, exactly; a field given as such is multiplied.
    grid : of the volume, which tells the reach of a point that has none of its own; default is that of the picture.
    key : which set of control points of a step, for the rule "interpolate".
    landmarks : whether control points are drawn, with arrows to where they went.
    title : default is the name of the step, and what is known of its fit.
    unit : of lengths.
    style : a name of :data:`~deformnb.drawing.STYLES`; width : of the figure, inches.
    path : where to write a PNG, PDF or SVG, in place of an older file; nothing is written without it.

    Returns
    -------
    matplotlib Figure, not known to pyplot; its ``savefig`` keeps text as text. Its ``grids`` is a
        :class:`~deformnb.thompson_net.Grids`, the numbers that are drawn.

    Raises
    ------
    DeformError
        For an unknown name, a step on another plane or in space, or a fit that is not possible when magnified.

    Examples
    --------
    >>> from deformnb.fields import Identity
    >>> from deformnb.plane import Plane, Raster
    >>> raster = Raster((20, 30), (1.0, 1.0), (0.0, 0.0))
    >>> plane = Plane((0, 0, 0), (1, 0, 0), (0, 1, 0))
    >>> picture = Picture(np.zeros((20, 30), np.uint8), plane, raster, "mip", (0.0, 1.0))
    >>> draw_grids(Identity(2), picture, lines=6).grids.nodes.shape
    (5, 7, 2)
    """
    for name, value, known in (("overlay", overlay, OVERLAYS), ("style", style, tuple(STYLES))):
        if value not in known:
            raise DeformError(f"unknown {name} {value!r}; choose one of {', '.join(known)}.")
    if not np.isfinite(magnify):
        raise DeformError(f"magnify must be a finite number, got {magnify}.")
    steps = steps_of(what, picture, magnify)
    grids = make_grids(field_of(what, steps, picture, magnify, grid, key), picture, lines)
    sheet = Sheet(picture, grids, overlay, STYLES[style], width)
    sheet.draw(landmarks_of(steps, key) if landmarks else None, unit, steps[0].strength if len(steps) == 1 else magnify)
    sheet.write_title(_title(title, steps, key))
    if path is not None:
        save_figure(sheet.figure, path)
    return sheet.figure


def _title(title: str | None, steps: tuple[Step, ...], key: int) -> list[str]:
    if title is not None or len(steps) != 1:
        return [title] if title else []
    return [text for text in (steps[0].name, _facts(steps[0], key)) if text]


def _facts(step: Step, key: int) -> str:
    """What is known of the fit of a step: how many landmarks, how much of it is affine, how much it bends."""
    points = landmarks_of((step,), key)
    assert points is not None
    facts = [f"{len(points)} landmark{'' if len(points) == 1 else 's'}"]
    if len(points) > points.dim + 1 and points.displacement.any():
        share, _ = affine_split(points)
        facts += [f"{100 * share:.0f} % of the drags affine", f"bending energy {bending_energy(points):.3g}"]
    return ", ".join(facts)
