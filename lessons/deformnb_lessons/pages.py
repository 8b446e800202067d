"""The first picture of each lesson, and the page that shows it without Python.

A notebook of a lesson begins with :func:`lesson_start`; ``deformnb lesson NAME --page`` writes the same picture as one
offline file, for a pupil who has a phone and no JupyterLab.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass

from deformnb.checks import check_choice
from deformnb.document.deformation import Deformation
from deformnb.rbf.points import ControlPoints
from deformnb.volume.views import ViewName
from deformnb.volume.volume import Volume, VolumeLike, as_volume
from deformnb.words import translate
from deformnb_lessons.fish import GOAL_NODES
from deformnb_lessons.lesson import LESSONS
from deformnb_lessons.moved_animal import lesson_carp
from deformnb_lessons.studio_tasks import FishTask

_SIDE: ViewName = "-x"  # from the left, where the head points left
_FRAME = [[0, 20], [508, 20], [508, 178], [0, 178]]  # of the carp itself
_FRAME_NAMES = ["above the head", "above the tail", "below the tail", "below the head"]
_CORNERS = [[0, 0], [508, 0], [508, 197], [0, 197]]


@dataclass(frozen=True)
class _Page:
    """First picture of a lesson, and text and controls of its page."""

    begin: Callable[[Volume], Deformation]
    about: str
    controls: tuple[str, ...]


def lesson_start(name: str, volume: VolumeLike) -> Deformation:
    """The points with which a lesson begins; none has been dragged.

    Parameters
    ----------
    name : a key of :data:`~deformnb_lessons.LESSONS`.
    volume : on whose picture from the left they are, such as :func:`lesson_carp`.

    Raises
    ------
    DeformError
        If there is no such lesson.

    Examples
    --------
    >>> lesson_start("affine", lesson_carp()).steps[0].points.names
    ('head', 'tail')
    """
    check_choice(name, _PAGES, "lesson")
    return _PAGES[name].begin(as_volume(volume))


def write_lesson_page(
    name: str, path: str | os.PathLike[str], *, language: str | None = None, overwrite: bool = True
) -> None:
    """Write a lesson's picture as one offline file in which points can be dragged; it warns when tissue leaves the box.

    Parameters
    ----------
    name : a key of :data:`~deformnb_lessons.LESSONS`.
    path : the file to write; ends in .html.
    language : of the page, a code of :data:`~deformnb.words.LANGUAGES`; default is the one that was chosen.
    overwrite : whether an existing file may be replaced.

    Raises
    ------
    DeformError
        If there is no such lesson, or the file cannot be written.

    Examples
    --------
    >>> write_lesson_page("kernel", "kernel.html")
    Traceback (most recent call last):
    ...
    deformnb.errors.DeformError: unknown lesson 'kernel'; choose one of coordinates, fish, kernels, affine, folding.
    """
    from deformnb.widgets.studio.studio import Studio

    carp = lesson_carp()
    studio = Studio(carp, lesson_start(name, carp), side=_SIDE, language=language)
    studio.editor.stop_at_folds = False  # a pupil should see folds
    try:
        title, about = (translate(text, language) for text in (LESSONS[name].title, _PAGES[name].about))
        studio.export_html(path, title=title, about=about, controls=_PAGES[name].controls, overwrite=overwrite)
    finally:
        studio.close()


def _nodes(volume: Volume) -> Deformation:
    """The nodes of Thompson's grid that a pupil drags to turn the carp into Antigonia."""
    task = LESSONS["fish"].exercises["antigonia"]
    assert isinstance(task, FishTask)
    return Deformation.from_picture_points(volume, _SIDE, task.grids(volume).points.take(GOAL_NODES).reset())


def _frame(volume: Volume) -> Deformation:
    return Deformation.from_picture_points(volume, _SIDE, ControlPoints.from_arrays(_FRAME, names=_FRAME_NAMES))


def _corners(volume: Volume) -> Deformation:
    return Deformation.from_picture_points(volume, _SIDE, ControlPoints.from_arrays(_CORNERS), trend="none")


def _ends(volume: Volume) -> Deformation:
    ends = ControlPoints.from_arrays([[40, 100], [460, 100]], names=["head", "tail"])
    return Deformation.from_picture_points(volume, _SIDE, ends, trend="similarity")


def _one(volume: Volume) -> Deformation:
    return Deformation.from_picture_points(
        volume, _SIDE, ControlPoints.from_arrays([[200, 100]]), trend="none", support=100.0
    )


_PAGES = {
    "coordinates": _Page(
        _frame,
        "Drag the four corners of the carp. Can you make a shear, and a taper?",
        ("strength", "shows", "density", "reset"),
    ),
    "fish": _Page(
        _nodes,
        "Drag the points until the carp is a boarfish: short, and almost as high as long. "
        "Each point has the name of its node.",
        ("strength", "shows", "density", "reset", "download"),
    ),
    "kernels": _Page(
        _corners,
        "The corners hold the picture. Double-click on the back to add a point, and drag it up: how far does it reach?",
        ("strength", "kernel", "shows", "density", "reset"),
    ),
    "affine": _Page(
        _ends,
        "Only its points on head and tail hold this carp. Drag both: it turns and grows as a whole.",
        ("strength", "shows", "density", "reset"),
    ),
    "folding": _Page(
        _one,
        "Drag the point to the right, farther and farther, until the page reports a fold. How far did you get?",
        ("strength", "shows", "density", "reset"),
    ),
}
