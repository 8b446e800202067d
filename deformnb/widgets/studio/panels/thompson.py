"""Thompson panel: the picture on a regular grid, next to the deformed one on a grid that can be dragged.

Both are views of one editor, so that a drag in one is seen in all: the element around a view selects its contents
(see grid_nodes.js).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import traitlets

from deformnb.datasets.darcy import HEADS, thompson_map, thompson_pairs
from deformnb.errors import DeformError
from deformnb.imaging.demo import subject_box
from deformnb.imaging.thompson import GRID_OVERLAYS, draw_grids
from deformnb.io.files.paths import as_path
from deformnb.rbf.points import ControlPoints
from deformnb.session.session import Session
from deformnb.widgets import basic_widgets as basic
from deformnb.widgets.boxes import Box, Boxes, column, line, row
from deformnb.widgets.cell_widgets import close_all
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.inputs.drawing_pair import DrawingPair
from deformnb.widgets.inputs.file_transfer import FileTransfer
from deformnb.widgets.studio.controls import Guard, Panel, button, error_action, file_stem, menu, slider
from deformnb.widgets.studio.editors import make_editor, show_step, show_view_state
from deformnb.widgets.studio.history_labels import edit_label
from deformnb.widgets.studio.panels.folder import plain_name
from deformnb.widgets.worker import Worker

_OVERLAYS = [
    ("nothing", "none"),
    ("folds, red", "folds"),
    ("area: green grows, purple shrinks", "area"),
    ("principal strains", "strain"),
    ("uncertainty", "uncertainty"),
]
_IN_SPACE = "Points in space deform no picture, so there is no grid to show: choose a step on a picture."
_HEIGHT = 380  # CSS pixels of the pictures of a panel outside a studio
_EDITING = ["deformation", "index", "key", "history"]
_PICTURES = ["method", "depth", "transfer", "window", "colour_map"]
_CELLS = 12  # of a printed grid, where the picture shows none
_LOOK = (
    '<div style="line-height: 1.35"><b>Drag the nodes of the grid titled Deformed</b>: '
    "each becomes a control point; Delete removes that point.</div>"
)


class ThompsonPanel(Panel):
    """Two grids side by side; the nodes of the deformed one can be dragged.

    Parameters
    ----------
    session : to deform.
    guard : runs requests and reports errors; default shows them in the panel.
    editor : the studio's, of which the panel shows more views; default is a separate one, so that the panel can be
        shown by itself, as the last expression of a cell.
    folder : where figures are written.

    Attributes
    ----------
    views : the two grids; own : grids of a user's own; figure : writes both grids as a file.

    Examples
    --------
    >>> from deformnb.datasets import PHANTOMS
    >>> session = Session(PHANTOMS["bar"].make((16, 16, 16)))
    >>> panel = ThompsonPanel(session)
    >>> panel.magnify.value = 2.0
    >>> session.editing.step.strength
    2.0
    >>> panel.close()
    """

    title = "Thompson's grids and your own"

    def __init__(
        self,
        session: Session,
        guard: Guard | None = None,
        editor: Editor | None = None,
        folder: str | PathLike[str] = ".",
    ) -> None:
        super().__init__(session, guard or self._run_guarded)
        self.is_alone = editor is None
        self.editor = make_editor(session, _HEIGHT) if editor is None else editor
        self._is_open = self.is_alone
        self.figure = GridFigure(session, self.guard, self.editor, as_path(folder))
        self.own = OwnGrids(session, self.guard)
        self.views = GridViews(self.editor)
        self.box = column(row(*self._grid_settings()), self.own.box, self._settings(), self.views.box, self.figure.box)
        self._widget = Boxes([self.box]) if self.is_alone else None
        self._sync = EditorSync(session, self.guard, self.editor, self.refresh) if self.is_alone else None
        self.refresh()

    # -- the parts -----------------------------------------------------------------------------------------------------

    def _settings(self) -> Box:
        most = self.editor.traits()["density"].max
        lines = basic.IntSlider(
            min=2,
            max=most,
            description="Lines",
            style={"description_width": "60px"},
            tooltip="Cells of the grid along the longer side of the picture",
            layout=basic.layout(flex="1 1 200px", width="auto", min_width="0", max_width="320px"),
        )
        traitlets.link((self.editor, "density"), (lines, "value"))
        overlay = menu("Overlay", _OVERLAYS, "Overlay on the deformed picture")
        traitlets.link((self.editor, "overlay"), (overlay, "value"))
        self.magnify = self.add(
            slider(
                "Magnify", -1.0, 3.0, 0.01, "0 the original, 1 as drawn, 2 exaggerated, -1 in the opposite direction"
            ),
            lambda: float(np.clip(self.session.editing.step.strength, -1.0, 3.0)),
            lambda value: self.session.editing.change(kind="strength", slides=True, strength=float(value)),
        )
        self.words = basic.Label("")
        self.everywhere = basic.Checkbox(
            description="drag the grid in the main picture too",
            indent=False,
            layout=basic.layout(width="auto", display="none" if self.is_alone else ""),
        )
        traitlets.link((self.editor, "drag_grid"), (self.everywhere, "value"))
        return column(row(self.magnify, self.words), row(lines, overlay, self.everywhere))

    def _grid_settings(self) -> list[Any]:
        pairs = [(f"{source} \u2192 {target}", (source, target)) for source, target in thompson_pairs()]
        carp = next(pair for _, pair in pairs if pair[1].startswith("Antigonia"))
        self.grid = basic.Dropdown(
            options=pairs,
            value=carp,
            description="Grids of",
            layout=basic.layout(width="380px"),
            tooltip="Fish that D'Arcy Thompson turned into one another, in 1917",
        )
        self.head = basic.Dropdown(
            options=[(f"head on the {side}", side) for side in HEADS],
            layout=basic.layout(width="150px"),
            tooltip="Where the head is on this picture",
        )
        told = "Points at the nodes of his grid, in place of those that are there; can be undone"
        return [self.grid, self.head, button("Apply grid", told, lambda: self.guard(self.apply_grid)), self.own.toggle]

    # -- display -------------------------------------------------------------------------------------------------------

    def handle_visibility(self, is_open: bool) -> None:
        """The views are in the front end only while the panel is seen: each of them paints whenever something moves."""
        self._is_open = is_open
        self.arrange()

    def arrange(self) -> None:
        self.views.show(is_on_picture=self.session.editing.step.plane is not None, is_open=self._is_open)
        self.words.value = strength_text(self.session.editing.step.strength)

    # -- actions -------------------------------------------------------------------------------------------------------

    def apply_grid(self) -> None:
        """Put control points at the nodes of one of Thompson's grids, around the foreground of the picture."""
        if self.session.editing.step.plane is None:
            raise DeformError(_IN_SPACE)
        source, target = self.grid.value
        picture = self.session.pictures.picture()
        grids = thompson_map(source, target, box=subject_box(picture), frame=picture.raster.box, head=self.head.value)
        rows = grids.source_nodes.reshape(-1, 2), grids.target_nodes.reshape(-1, 2)
        points = ControlPoints.from_arrays(*rows)  # 56 names would hide the picture
        self.session.editing.edit_points(points, f"apply the grid of {target}")

    def close(self) -> None:
        """End the thread, and the editor of a panel outside a studio."""
        self.figure.close()
        self.own.close()
        if self._sync is not None:
            self._sync.close()
            close_all(self._widget, self.editor)

    def _run_guarded(self, action: Callable[[], None]) -> bool:
        try:
            action()
        except DeformError as error:
            self.figure.message.value = str(error).replace("&", "&amp;").replace("<", "&lt;")
            return False
        return True

    def _repr_mimebundle_(self, **options: Any) -> Any:
        return None if self._widget is None else self._widget._repr_mimebundle_(**options)


class GridViews:
    """Two views of an editor side by side: the picture on a regular grid, and the deformed one.

    Parameters
    ----------
    editor : of which both are views.

    Attributes
    ----------
    before, after : their places; nowhere : shown there for points in space; box : all of it.
    """

    def __init__(self, editor: Editor) -> None:
        self._editor = editor
        self.before, self.after = _place("before"), _place("after")
        self._pictures = line(
            _section("Original", self.before, _LOOK),
            _section("Deformed", self.after),
            flex_flow="row wrap",
            grid_gap="8px",
        )
        self.nowhere = basic.Label(_IN_SPACE)
        self.box = column(self._pictures, self.nowhere)

    def show(self, *, is_on_picture: bool, is_open: bool) -> None:
        """Show the views where there is a picture, and while they are seen."""
        self._pictures.is_visible = is_on_picture
        basic.set_visible(self.nowhere, not is_on_picture)
        shown = (self._editor,) if is_open and is_on_picture else ()
        for place in (self.before, self.after):
            if place.children != shown:
                place.children = shown


class OwnGrids:
    """Two drawings with a grid on each, shown by a switch: control points go from one grid to the other.

    Attributes
    ----------
    toggle : the switch; box : the place of the drawings; drawings : None while they are not shown.
    """

    def __init__(self, session: Session, guard: Guard) -> None:
        self._session, self._guard = session, guard
        self.drawings: DrawingPair | None = None  # made on first use: it sends pictures
        self.box = column()
        self.toggle = basic.ToggleButton(
            description="Own drawings",
            layout=basic.layout(width="auto"),
            tooltip="A custom grid on this picture, and one on a second drawing",
        )
        self.toggle.observe(lambda change: guard(lambda: self._show(change["new"])), "value")

    def _show(self, is_visible: bool) -> None:
        """Show or put away the two drawings, beginning with the picture that is seen."""
        self.close()
        if is_visible:
            if self._session.editing.step.plane is None:
                raise DeformError(_IN_SPACE)
            self.drawings = DrawingPair(self._session.pictures.picture(), guard=self._guard)
            told = "Points at the nodes of your grid, in place of those that are there; can be undone"
            self.box.children = (self.drawings, button("Apply own grids", told, lambda: self._guard(self.apply)))

    def close(self) -> None:
        """Put the drawings away."""
        self.box.children = ()
        if self.drawings is not None:
            self.drawings.close()
            self.drawings = None

    def apply(self) -> None:
        """Put control points at the nodes of the grid on this picture, which go to those of the second drawing."""
        if self.drawings is None:
            raise DeformError("no drawings are shown: press Own drawings.")
        if self.drawings.first.picture.plane != self._session.editing.step.plane:
            raise DeformError(
                "the grid was put on another side of the volume: go back to it, or press Own drawings "
                "twice to begin on this one."
            )
        grids = self.drawings.map()
        rows = grids.source_nodes.reshape(-1, 2), grids.target_nodes.reshape(-1, 2)
        self._session.editing.edit_points(ControlPoints.from_arrays(*rows), "apply custom grids")


class GridFigure:
    """Writes both grids with the overlay as a figure, in a separate thread.

    Parameters
    ----------
    guard : shows errors.
    editor : whose overlay and lines the figure has.
    folder : where figures are written.

    Attributes
    ----------
    box : the controls; name, downloads, writers, message, file_transfer : the widgets in it.
    """

    def __init__(self, session: Session, guard: Guard, editor: Editor, folder: Path) -> None:
        self._session, self._guard, self._editor, self.folder = session, guard, editor, folder
        self._thread = Worker("deformnb-grids")
        stem = file_stem(session.volume)
        self.name = basic.Text(
            value=f"{stem}_grids",
            description="Figure",
            style={"description_width": "60px"},
            layout=basic.layout(width="260px"),
            tooltip="File name, without its end",
        )
        self.downloads = basic.Checkbox(
            description="download it in the browser too", indent=False, layout=basic.layout(width="auto")
        )
        self.file_transfer = FileTransfer()
        self.writers = [
            button(kind.upper(), f"Write both grids with the overlay as {kind.upper()}", self._writer(f".{kind}"))
            for kind in ("svg", "pdf", "png")
        ]
        self.message = basic.HTML("", layout=basic.layout(flex="1 1 200px", min_width="0"))
        self.box = column(row(self.name, *self.writers, self.downloads, self.message), self.file_transfer)

    def _writer(self, suffix: str) -> Callable[[], Any]:
        return lambda: self._guard(lambda: self.write(suffix))

    def write(self, suffix: str) -> None:
        """Write the figure into the folder, in a separate thread."""
        session, editor, step = self._session, self._editor, self._session.editing.step
        if step.plane is None:
            raise DeformError(_IN_SPACE)
        path = self.folder / plain_name(f"{self.name.value.strip()}{suffix}")
        overlay = editor.overlay if editor.overlay in GRID_OVERLAYS else "none"
        given: dict[str, Any] = {
            "lines": editor.density or _CELLS,
            "overlay": overlay,
            "grid": session.editing.grid,
            "key": session.editing.key,
            "path": path,
        }
        named, downloads = replace(step, name=step.name or session.volume.name), self.downloads.value
        for writer in self.writers:
            writer.disabled = True
        self.message.value = f"Writing {path.name} ..."
        missing = " The uncertainty overlay is shown here only." if editor.overlay == "uncertainty" else ""

        def draw() -> None:
            with session.files.known.writing(path):
                draw_grids(named, session.pictures.picture(), **given)

        self._thread.call(lambda: self._do(draw, path, downloads, missing))

    def _do(self, draw: Callable[[], Any], path: Path, downloads: bool, missing: str) -> None:
        message = ""
        try:
            draw()
            message = f"Wrote {path.name} ({path.stat().st_size / 1e3:.0f} kB).{missing}"
            if downloads:
                self.file_transfer.download(path.name, path.read_bytes())
        except Exception as error:
            reason = error
            self._guard(error_action(reason))
        finally:
            if message or self.message.value.startswith("Writing"):
                self.message.value = message
            for writer in self.writers:
                writer.disabled = False

    def close(self) -> None:
        """End the thread."""
        self._thread.close()


class EditorSync:
    """Between a session and the editor of a panel outside a studio."""

    def __init__(self, session: Session, guard: Guard, editor: Editor, refresh: Callable[[], None]) -> None:
        self._session, self._guard, self._editor, self._refresh = session, guard, editor, refresh
        self._drawn = self._session.pictures.automatic_picture()
        self._editor.observe(self._points_changed, "points")
        self._editor.observe(self._shapes_changed, ["cuts", "parts"])
        self._editor.on_history(lambda way: getattr(self._session.editing, way)())
        self._editor.observe(self._window_chosen, "window")
        self._session.editing.observe(self._session_changed, _EDITING)
        self._session.pictures.observe(self._session_changed, _PICTURES)

    def _points_changed(self, change: Any) -> None:
        if change["new"] != self._session.editing.points:
            label = edit_label(self._session.editing.points, change["new"])
            self._run_guarded(lambda: self._session.editing.edit_points(change["new"], label))

    def _shapes_changed(self, change: Any) -> None:
        what = change["name"]
        if getattr(self._session.editing.step, what) != change["new"]:
            made = self._editor.edit_under_way
            points = None if made is None else made.points
            self._run_guarded(
                lambda: (
                    self._session.editing.change(cuts=change["new"])
                    if what == "cuts"
                    else self._session.editing.edit_parts(change["new"], points=points)
                )
            )

    def _window_chosen(self, change: Any) -> None:
        self._guard(lambda: self._session.pictures.set_trait("window", tuple(change["new"]) or None))

    def _run_guarded(self, edit: Callable[[], None]) -> None:
        """Apply the edit of the editor; on failure, the editor shows the state of the session again."""
        if not self._guard(edit):
            show_step(self._editor, self._session)

    def _session_changed(self, change: Any) -> None:
        if change["name"] == "history":
            self._editor.history = dict(change["new"])
            return
        if self._session.editing.step.plane is not None:
            picture = self._session.pictures.automatic_picture()
            if self._drawn is not picture:  # the editor's own is in the window of the session
                self._editor.picture = self._drawn = picture
            show_view_state(self._editor, self._session)
            show_step(self._editor, self._session)
        self._refresh()

    def close(self) -> None:
        """Stop observing the session."""
        self._session.editing.unobserve(self._session_changed, _EDITING)
        self._session.pictures.unobserve(self._session_changed, _PICTURES)


def strength_text(strength: float) -> str:
    """Effect of a strength on a drawing, in words.

    Examples
    --------
    >>> strength_text(1.0), strength_text(-1.0)
    ('as drawn', 'in the opposite direction')
    """
    if abs(strength) < 0.005:
        return "the original"
    if abs(strength - 1) < 0.005:
        return "as drawn"
    if abs(strength + 1) < 0.005:
        return "in the opposite direction"
    if strength < 0:
        return f"in the opposite direction, {-strength:.2f} times as far"
    return "exaggerated" if strength > 1 else "partial"


def _place(side: str) -> Box:
    return Box(classes=f"dnb-th-{side}", width="100%", min_width="0")


def _section(title: str, place: Box, text: str = "") -> Box:
    words = [basic.HTML(text)] if text else []
    return column(basic.HTML(f"<b>{title}</b>"), place, *words, flex="1 1 320px", min_width="0")
