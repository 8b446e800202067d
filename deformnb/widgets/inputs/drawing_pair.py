"""Two drawings that become a pair: a grid is put on each, and the one is deformed into the other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from deformnb._typing import Progress
from deformnb.checks import short_value
from deformnb.datasets.darcy import ScaleName, ThompsonMap, thompson_map
from deformnb.errors import DeformError
from deformnb.imaging.projection import project
from deformnb.io import read_volume
from deformnb.io.volumes.images import IMAGE_SUFFIXES
from deformnb.volume.plane import Picture
from deformnb.widgets import basic_widgets as basic
from deformnb.widgets.boxes import Boxes, column, line
from deformnb.widgets.inputs.file_input import FileInput
from deformnb.widgets.inputs.grid_drawing import MOST_LINES, GridDrawing

ShowError = Callable[[Callable[[], None]], bool]
"""Runs a request and shows its errors; False after one."""

_SAME = "Both grids have the same lines: a node belongs to the same part of the body on both, such as the eye."


class DrawingPair(Boxes):
    """Grids on two drawings, side by side: corners and nodes are dragged to the same parts of both animals.

    Parameters
    ----------
    first : the picture that will be deformed, or a drawing with its grid.
    second : the target, also a picture or a drawing; None lets the user open one. Drawings are closed with the pair.
    rows, columns : lines of both grids, to begin with; default is those of a drawing, else 5 and 7.
    guard : runs requests of the user and shows errors; default shows them below the drawings.

    Attributes
    ----------
    first, second : the drawings; the second is None until one is opened.
    line_counts : the fields for rows and columns.

    Raises
    ------
    DeformError
        For what is neither picture nor drawing, or grids whose numbers of lines differ.

    Examples
    --------
    >>> import numpy as np
    >>> from deformnb import Volume
    >>> leaf = np.zeros((1, 40, 60), np.uint8)
    >>> leaf[0, 10:30, 10:50] = 200
    >>> picture = project(Volume.from_array(leaf), "+z")
    >>> pair = DrawingPair(picture, picture, rows=3, columns=4)
    >>> len(pair.map().points)
    12
    """

    def __init__(
        self,
        first: Picture | GridDrawing,
        second: Picture | GridDrawing | None = None,
        *,
        rows: int | None = None,
        columns: int | None = None,
        guard: ShowError | None = None,
    ) -> None:
        rows, columns = _line_counts((first, second), rows, columns)
        self.first = _drawing(first, rows, columns, "first")
        self.second: GridDrawing | None = None
        self._guard = guard or self._run_guarded
        self.message = basic.HTML("")
        self.line_counts = [
            basic.BoundedIntText(value, min=2, max=MOST_LINES, description=word, layout=basic.layout(width="150px"))
            for value, word in ((rows, "Rows"), (columns, "Columns"))
        ]
        for number in self.line_counts:
            number.observe(lambda _: self._guard(self._change_lines), "value")
        self.upload = FileInput(
            self.take,
            self._guard,
            label="Open the second drawing",
            accept=",".join(IMAGE_SUFFIXES),
            tip="A photograph or drawing: " + ", ".join(IMAGE_SUFFIXES),
        )
        self._place = column(self.upload, flex="1 1 300px", min_width="0")
        first_side = column(basic.HTML("<b>1. This drawing</b>"), self.first, flex="1 1 300px", min_width="0")
        sides = line(first_side, self._place, flex_flow="row wrap", grid_gap="8px")
        super().__init__(
            [
                basic.HTML(f'<div style="line-height: 1.35">{_SAME}</div>'),
                line(*self.line_counts),
                sides,
                self.message,
            ]
        )
        self._arrange()
        if second is not None:
            self.show_second(second)

    def take(self, path: Path, progress: Progress) -> None:
        """Show a file as the second drawing."""
        volume = read_volume(path, progress=progress)
        self.show_second(project(volume, "+z"))

    def show_second(self, shown: Picture | GridDrawing) -> None:
        """Show a picture as the second drawing, with a grid around its foreground, or a drawing with its own grid.

        Raises
        ------
        DeformError
            For what is neither, or a grid whose numbers of lines are not those of the first.
        """
        rows, columns = _line_counts((self.first, shown), None, None)
        before, self.second = self.second, _drawing(shown, rows, columns, "second")
        if before is not None and before is not self.second:
            before.close()
        self._arrange()

    def map(self, scale: ScaleName = "inside") -> ThompsonMap:
        """The pair in the coordinates of the first picture, at its grid.

        Parameters
        ----------
        scale : of the second animal relative to the first, one of :data:`~deformnb.datasets.SCALES`.

        Raises
        ------
        DeformError
            If there is no second drawing, or a cell of a grid is flat or turned over.
        """
        if self.second is None:
            raise DeformError("there is no second drawing yet: open one, and put its grid on it.")
        flat = self.first.nodes.reshape(-1, 2)
        (a0, b0), (a1, b1) = flat.min(axis=0), flat.max(axis=0)
        return thompson_map(
            self.first.grid("the first drawing"),
            self.second.grid("the second drawing"),
            box=(a0, a1, b0, b1),
            frame=self.first.picture.raster.box,
            scale=scale,
        )

    def close(self) -> None:
        """End the upload and both drawings."""
        if hasattr(self, "upload"):  # ipywidgets closes a half-made widget too
            for made in (self.upload, self.first, self.second):
                if made is not None:
                    made.close()
        super().close()

    def _arrange(self) -> None:
        words = basic.HTML("<b>2. The target</b>")
        self._place.children = (words, self.upload, *([] if self.second is None else [self.second]))

    def _change_lines(self) -> None:
        for drawing in (self.first, self.second):
            if drawing is not None:
                drawing.set_lines(*(number.value for number in self.line_counts))

    def _run_guarded(self, action: Callable[[], None]) -> bool:
        try:
            action()
        except DeformError as error:
            self.message.value = str(error).replace("&", "&amp;").replace("<", "&lt;")
            return False
        self.message.value = ""
        return True


def _line_counts(given: Sequence[Any], rows: int | None, columns: int | None) -> tuple[int, int]:
    """Rows and columns of both grids: as requested, those of the drawings, or 5 and 7."""
    for role, shown in zip(("first", "second"), given, strict=True):
        if not isinstance(shown, Picture | GridDrawing) and not (shown is None and role == "second"):
            raise DeformError(f"the {role} drawing is a Picture or a GridDrawing, got {short_value(shown)}.")
    drawn = [shown.nodes.shape[:2] for shown in given if isinstance(shown, GridDrawing)]
    wanted = drawn[0] if drawn else (5, 7)
    wanted = (wanted[0] if rows is None else rows, wanted[1] if columns is None else columns)
    other = next((shape for shape in drawn if shape != wanted), None)
    if other is not None:
        raise DeformError(
            f"both grids have the same lines, and one has {other[0]} rows of {other[1]} nodes, not {wanted[0]} of "
            f"{wanted[1]}: call set_lines of the drawing first."
        )
    return wanted


def _drawing(given: Picture | GridDrawing, rows: int, columns: int, role: str) -> GridDrawing:
    if isinstance(given, GridDrawing):
        return given
    return GridDrawing(given, rows, columns, label=f"Grid on the {role} drawing")
