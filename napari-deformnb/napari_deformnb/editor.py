"""The edits of one layer: a document of deformnb with its history, shown as layers of napari and edited on them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from napari.layers import Layer, Vectors
from qtpy.QtCore import QObject, Signal

from deformnb import ControlPoints, Deformation, Plane, read_deformation, write_deformation
from deformnb.document.deformation import VolumeReference
from deformnb.document.script import UNKNOWN_VOLUME, as_python
from deformnb.errors import DeformError
from deformnb.session.editing import Editing
from deformnb.warping import warp_points
from napari_deformnb import drawing
from napari_deformnb.live import LiveResults
from napari_deformnb.pairs import PairLayers, Side
from napari_deformnb.results import Calculator, Result, VisiblePart, deform_layer, grid_lines
from napari_deformnb.subject import Subject

Mode: TypeAlias = Literal["slice", "space"]
"""Names of the places of points: on the slice that is shown, for all slices; or in space."""

MODES: dict[Mode, str] = {
    "slice": "On the slice shown, for all slices",
    "space": "In space, each at its own slice",
}
"""All modes with their labels."""

NO_POINTS = "Add a point to one of both layers of points, then drag its target."
"""Sentence for a deformation whose points have not been moved."""


class LayerEditor(QObject):
    """The deformation of one layer of a viewer.

    Parameters
    ----------
    viewer : of napari.
    layer : an image or labels; it is hidden where the deformed layer is shown in its place.
    mode : one of :data:`MODES`.
    deformation : to continue; default is a step with points that hold the corners.

    Attributes
    ----------
    editing : the document, its selected step, undo and redo.
    pairs : the layers of points.
    deformed : the deformed layer; None where it is switched off or was removed.
    others : layers that are deformed along, with their results.
    changed : emitted after an edit of the document.
    finished : emitted with a full Result.
    failed : emitted with a sentence.
    ended : emitted with a sentence when a layer that is needed was removed.

    Raises
    ------
    DeformError
        If the layer cannot be deformed.
    """

    changed = Signal()
    finished = Signal(object)
    failed = Signal(str)
    progressed = Signal(float)
    ended = Signal(str)

    def __init__(self, viewer: Any, layer: Any, mode: Mode = "slice", deformation: Deformation | None = None) -> None:
        super().__init__()
        self.viewer, self.layer = viewer, layer
        self.subject = Subject(layer)
        plane = self._visible_plane(layer) if mode == "slice" or self.subject.ndim == 2 else None
        home = plane or Plane.from_view(self.subject.grid, "+z")
        self.editing = Editing(self.subject.grid, home, deformation or Deformation())
        if deformation is None and plane is None:
            self.editing = Editing(self.subject.grid, home, Deformation((self.editing.initial_step(None),)))
        self.deformed: Any = None
        self.overlay: Any = None
        self.others: dict[Any, Any] = {}
        self.cells = 0
        self.problems: tuple[str, ...] = ()
        self._is_live, self._is_adding = True, False
        self._calculator = Calculator(self.subject)
        self._reference: VolumeReference | None = None
        self._live = LiveResults()
        for signal, slot in ((self._live.done, self._show), (self._live.failed, self.failed)):
            signal.connect(slot)
        self._live.progressed.connect(self.progressed)
        self.pairs = PairLayers(viewer, self.subject, layer.name, self._edit_points, self._preview)
        self.pairs.depth = self.visible_part().position
        self.editing.observe(lambda _: self._document_changed(), "deformation")
        self.editing.observe(lambda _: self._write_points(), ["index", "key"])
        viewer.layers.events.removed.connect(self._layer_removed)
        viewer.dims.events.current_step.connect(self._dims_changed)
        viewer.dims.events.order.connect(self._dims_changed)
        viewer.dims.events.ndisplay.connect(self._dims_changed)
        layer.events.data.connect(self._voxels_changed)
        for name in ("scale", "translate", "rotate", "shear", "affine", "units"):
            getattr(layer.events, name).connect(self._place_changed)
        self._write_points()
        self.compute()
        self.select("target")

    # -- what is shown -------------------------------------------------------------------------------------------------

    @property
    def document(self) -> Deformation:
        """The deformation, with the checksum of the layer's voxels where there is one of them."""
        if self._reference is None:
            self._reference = VolumeReference.of(replace(self.subject.volumes[0], name=self.layer.name))
        return replace(self.editing.deformation, volume=self._reference)

    @property
    def is_busy(self) -> bool:
        """True while the newest result is not there."""
        return self._live.is_busy

    @property
    def is_closed(self) -> bool:
        """True after :meth:`close`."""
        return self._is_closed

    _is_closed = False

    @property
    def plane(self) -> Plane | None:
        """The plane of the points being edited; None for points in space."""
        return self.editing.step.plane

    def visible_part(self) -> VisiblePart:
        """The slice of the layer that the viewer shows, or the whole volume."""
        dims, offset = self.viewer.dims, self.viewer.dims.ndim - self.subject.ndim
        if self.subject.ndim == 2:
            return VisiblePart(0, 0)
        hidden = [axis - offset for axis in dims.not_displayed if axis >= offset]
        if len(hidden) != 1 or not self.subject.is_straight:
            return VisiblePart(None, round(self._visible_index(self._normal_axis())))
        position = round(self._visible_index(hidden[0]))
        return VisiblePart(hidden[0], min(max(position, 0), self.subject.grid.shape[hidden[0]] - 1))

    def _normal_axis(self) -> int:
        plane = self.editing.plane
        return drawing.axis_of_plane(self.subject, plane)

    def _visible_index(self, axis: int) -> float:
        point = np.asarray(self.viewer.dims.point)[-self.subject.ndim :]
        index = np.asarray(self.layer.world_to_data(point))[axis]
        return float(np.clip(index, 0, self.subject.grid.shape[axis] - 1))

    def _visible_plane(self, layer: Any) -> Plane:
        offset = self.viewer.dims.ndim - layer.ndim
        displayed = [axis - offset for axis in self.viewer.dims.displayed if axis >= offset][-2:]
        if self.viewer.dims.ndisplay != 2 or len(displayed) != 2:
            raise DeformError(
                "points are drawn on a slice, and the viewer shows the whole volume: show it in two dimensions "
                '(the button "Toggle 2D/3D view"), or choose points in space.'
            )
        return drawing.plane_of_slice(self.subject, (displayed[0], displayed[1]))

    def select(self, side: Side) -> None:
        """Make the layer of sources or targets the active one, and its points the ones that are dragged."""
        layer = self.pairs.sides[side]
        self.viewer.layers.selection.active = layer
        layer.mode = "select"

    # -- edits ---------------------------------------------------------------------------------------------------------

    def _edit_points(self, side: Side) -> None:
        """Take over an edit of a layer of points; what cannot be fitted is refused, and the layer is as before."""
        editing = self.editing
        with editing.lock:
            before = editing.points
            points, new = self.pairs.read(before, self.plane, side)
            label = "remove points" if len(points) < len(before) else "move points"
            try:
                if new:
                    points, label = self._add_pairs(points, side, new), "add points"
                editing.edit_points(points, label)
            except DeformError as error:
                self.failed.emit(str(error))
            self._write_points()
            if editing.points == before:
                self.compute()  # the preview of a drag that led nowhere

    def _add_pairs(self, points: ControlPoints, side: Side, rows: list[int]) -> ControlPoints:
        """Pairs of new points and of what is at their places now, so that the map stays as it is until one is dragged.

        A point that is added to the result holds the tissue that is seen there: its source is where that comes from.
        """
        field = self.editing.step.fits_of_regions(self.subject.grid)[self.editing.key]
        places = self.pairs.places(self.plane, side)[rows]
        fit = field.get(()) if len(field) == 1 else None
        for place in places:
            other = place
            if fit is not None and side == "target":
                other = place + fit.displacement(place[None])[0]
            elif fit is not None:
                moved, found = warp_points(place[None], fit)
                other = moved[0] if found[0] else place
            points = points.add(place, other) if side == "source" else points.add(other, place)
        return points

    def add_landmarks(self, source: Any, target: Any) -> None:
        """More control points from two layers of points of the same length, paired by their order.

        Raises
        ------
        DeformError
            If they have different numbers of points.
        """
        from deformnb.interop import from_napari

        sides = [from_napari(one) for one in (source, target)]
        points, left, other = ControlPoints.from_landmarks(*sides, pair="order")  # type: ignore[arg-type]
        if left or other:
            raise DeformError(
                f"the layers {source.name!r} and {target.name!r} have {len(sides[0])} and {len(sides[1])} points; "
                "pairs need the same number in the same order."
            )
        points = points.to_unit(self.subject.grid.unit)
        more = self.editing.points
        for one in points:
            ends = [one.source, one.target]
            if self.plane is not None:
                ends = [tuple(self.plane.to_plane([end])[0, :2]) for end in ends]
            more = more.add(ends[0], ends[1], name=one.name)
        self.editing.edit_points(more, "add landmarks")

    def add_step(self) -> None:
        """Begin another step after all others, on the slice that is shown; the viewer's axes choose its side."""
        plane = None if self.plane is None else self._visible_plane(self.layer)
        deformation = self.editing.deformation
        step = self.editing.initial_step(plane)
        self.editing.edit_document(deformation.then(step), "add a step", len(deformation.steps), key=0)

    def remove_step(self) -> None:
        """Remove the step that is edited.

        Raises
        ------
        DeformError
            If it is the only one.
        """
        if len(self.editing.deformation.steps) == 1:
            raise DeformError("this is the only step; reset it instead.")
        self.editing.edit_document(self.editing.deformation.without_step(self.editing.index), "remove a step")

    def open(self, path: str | Path) -> str:
        """Continue with the document of a file; can be undone.

        Returns
        -------
        A warning where it was made on another volume; else an empty text.
        """
        deformation = read_deformation(path)
        difference = deformation.difference(self.subject.volumes[0])
        wrong = next((step for step in deformation.steps if self.subject.ndim == 2 and step.plane is None), None)
        if wrong is not None:
            raise DeformError(
                "this document has points in space, and the layer has two dimensions: open it on a volume."
            )
        last = max(0, len(deformation.steps) - 1)
        self.editing.edit_document(deformation, "open a document", last, key=0)
        return difference

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write the document as JSON, which the studio and the command line open."""
        write_deformation(self.document, path, overwrite=overwrite)

    def script(self) -> str:
        """A Python script that makes the deformation and applies it to the file of the layer, where it has one."""
        source = getattr(self.layer, "source", None)
        path = getattr(source, "path", None)
        expression = f"dn.read_volume({str(path)!r})" if path else UNKNOWN_VOLUME
        return as_python(self.editing.deformation, self.subject.grid, volume=expression)

    # -- results -------------------------------------------------------------------------------------------------------

    def compute(self) -> None:
        """Compute the full result anew, soon."""
        if self._is_closed:
            return
        deformation, calculator, subject = self.editing.deformation, self._calculator, self.subject
        name, cells, part, is_live = f"{self.layer.name} deformed", self.cells, self.visible_part(), self._is_live
        others, problems = [], []
        for layer in self.others:
            try:
                has_voxels = layer.as_layer_data_tuple()[2] in ("image", "labels")
                others.append((layer, layer.as_layer_data_tuple(), Subject(layer) if has_voxels else None))
            except DeformError as error:
                problems.append(str(error))

        def job(progress: Any) -> Result:
            if is_live:
                result = calculator.full(deformation, name, progress)
            else:
                field = deformation.field(subject.grid)
                result = calculator.check(deformation, field, deformation.output or subject.grid)
            made, wrong = {}, list(problems)
            for layer, data, other in others:
                progress(1.0)
                try:
                    made[layer] = deform_layer(data, subject, deformation, other)
                except DeformError as error:
                    wrong.append(str(error))
            lines = grid_lines(subject, deformation, part, cells) if cells else None
            return replace(result, lines=lines, others=made, problems=tuple(wrong))

        self._live.request(job, is_preview=False)

    def _preview(self, side: Side) -> None:
        """Show the result of a drag that goes on: of the slice that is shown, or coarse."""
        points, new = self.pairs.read(self.editing.points, self.plane, side)
        if new or self._is_closed:
            return
        editing, part, cells = self.editing, self.visible_part(), self.cells
        calculator, subject, is_live = self._calculator, self.subject, self._is_live and self.deformed is not None
        step, key, index, deformation = editing.step, editing.key, editing.index, editing.deformation

        def job(progress: Any) -> Result:
            moved = deformation.with_step(index, step.with_points(points, key))
            result = calculator.preview(moved, part, progress) if is_live else Result()
            return replace(result, lines=grid_lines(subject, moved, part, cells) if cells else None)

        self._live.request(job, is_preview=True)

    def set_live(self, is_live: bool) -> None:
        """Show the deformed layer, or compute none."""
        self._is_live = is_live
        if not is_live:
            self._forget(self.deformed)
        self.compute()

    def set_cells(self, cells: int) -> None:
        """Show a grid of so many cells along the longest side, which bends with the tissue; 0 shows none."""
        self.cells = cells
        if not cells:
            self._forget(self.overlay)
        else:
            self.compute()

    def set_others(self, layers: list[Any]) -> None:
        """Choose the layers that are deformed along; the results of others go."""
        for layer in [layer for layer in self.others if layer not in layers]:
            result = self.others.pop(layer)
            if result is not None and result in self.viewer.layers:
                self.viewer.layers.remove(result)
        self.others.update({layer: None for layer in layers if layer not in self.others})
        self.compute()

    def cancel(self) -> None:
        """Stop what is computed; the layers stay as they are."""
        self._live.cancel()

    def _show(self, result: Result) -> None:
        if self._is_closed:
            return
        if result.layer is not None:
            self._show_deformed(result)
        elif result.array is not None and self.deformed is not None:
            self._show_preview(result)
        if result.lines is not None and self.cells:
            self._show_lines(result.lines)
        if result.layer is None and result.array is not None:
            return
        self._show_others(result)
        self.problems = result.problems
        if not self._live.is_busy:
            self.finished.emit(result)

    def _show_deformed(self, result: Result) -> None:
        assert result.layer is not None
        if self.deformed is not None and self._has_same_place(result):
            self.deformed.data = result.array
            return
        data, attributes, kind = result.layer
        if self.deformed is not None:
            self._forget(self.deformed)
        self.deformed = self._add(Layer.create(data, attributes, kind), above=self.layer)
        self.layer.visible = False

    def _has_same_place(self, result: Result) -> bool:
        assert result.layer is not None
        made = Layer.create(*result.layer)
        return self.deformed.data.shape == made.data.shape and np.allclose(
            self.deformed.data_to_world(np.eye(made.ndim)[0]), made.data_to_world(np.eye(made.ndim)[0])
        )

    def _show_preview(self, result: Result) -> None:
        if result.part is None:
            self.deformed.data = result.array
            return
        where: list[Any] = [slice(None)] * self.subject.ndim
        if self.subject.ndim == 3:
            where[result.part.axis or 0] = result.part.position
        if not self.deformed.data.flags.writeable:
            self.deformed.data = self.deformed.data.copy()
        self.deformed.data[tuple(where)] = result.array
        self.deformed.refresh()

    def _show_lines(self, lines: Any) -> None:
        if self.overlay is None:
            width = self.pairs.lines.edge_width / 2
            self.overlay = self._add(
                Vectors(
                    lines,
                    ndim=self.subject.ndim,
                    name=f"{self.layer.name}: grid",
                    edge_color="#7dff7d",
                    edge_width=width,
                    vector_style="line",
                    **self.subject.place(),
                ),
                below=self.pairs.lines,
            )
        else:
            self.overlay.data = lines

    def _show_others(self, result: Result) -> None:
        for layer in list(self.others):
            made = result.others.get(layer)
            if made is None:
                continue
            shown = self.others[layer]
            if shown is None or made[2] == "shapes":
                if shown is not None:
                    self.viewer.layers.remove(shown)
                shown = self._add(Layer.create(*made), above=layer)
            else:
                shown.data = made[0]
            self.others[layer] = shown

    def _add(self, made: Any, *, above: Any = None, below: Any = None) -> Any:
        """Add a layer next to another one, and leave the active layer as it is."""
        layers, active = self.viewer.layers, self.viewer.layers.selection.active
        chosen = set(layers.selection)
        at = layers.index(above) + 1 if above is not None and above in layers else len(layers)
        at = layers.index(below) if below is not None and below in layers else at
        layers.insert(at, made)
        layers.selection.clear()
        layers.selection.update(chosen & set(layers))
        layers.selection.active = active if active in layers else None
        return made

    def _forget(self, layer: Any) -> None:
        if layer is not None and layer in self.viewer.layers:
            self.viewer.layers.remove(layer)

    # -- events --------------------------------------------------------------------------------------------------------

    def _document_changed(self) -> None:
        self._write_points()
        self.compute()
        self.changed.emit()

    def _write_points(self) -> None:
        if not self._is_closed:
            self.pairs.write(self.editing.points, self.plane)

    def _dims_changed(self, _event: Any = None) -> None:
        if self._is_closed:
            return
        part = self.visible_part()
        if self.plane is not None and self.subject.ndim == 3 and part.axis in (None, self._normal_axis()):
            self.pairs.set_depth(float(part.position), self.editing.points, self.plane)
        if self.cells:
            self.compute()

    def _voxels_changed(self, _event: Any = None) -> None:
        """Other voxels in the same layer: the same document on them, or the end where they are on another grid."""
        if self._is_closed:
            return
        try:
            subject = Subject(self.layer)
        except DeformError as error:
            self.close(str(error))
            return
        if subject.grid != self.subject.grid or subject.ndim != self.subject.ndim:
            self.close(f"The voxels of {self.layer.name!r} are on another grid now; begin again.")
            return
        self.subject = self.pairs.subject = subject
        self._calculator, self._reference = Calculator(subject), None
        self.compute()

    def _place_changed(self, _event: Any = None) -> None:
        """A layer that is somewhere else now: the points stay with its tissue, in the document too."""
        if not self._is_closed and Subject(self.layer).grid != self.subject.grid:
            self.close(
                f"The layer {self.layer.name!r} was moved or scaled, and the points are measured in its world: they "
                "come back with the next start where the layer is as it was."
            )

    def _layer_removed(self, event: Any) -> None:
        removed = event.value
        if self._is_closed:
            return
        if removed is self.layer:
            self.close(f"The layer {removed.name!r} was removed, and the deformation of it has ended.")
        elif removed in self.pairs.sides.values():
            self.close(f"The layer {removed.name!r} was removed, and the deformation has ended with its points.")
        elif removed is self.deformed:
            self.deformed = None
            if self._is_live:
                self._is_live = False
                self.changed.emit()
        elif removed is self.overlay:
            self.overlay = None
            if self.cells:
                self.cells = 0
                self.changed.emit()
        elif removed in self.others:
            self.others.pop(removed)
        else:
            for layer, result in list(self.others.items()):
                if result is removed:
                    self.others.pop(layer)
                    self.changed.emit()

    @property
    def is_live(self) -> bool:
        """True while a deformed layer is computed."""
        return self._is_live

    def close(self, reason: str = "") -> None:
        """End the edits: the thread ends, and the layers of points go; the deformed layers stay.

        Parameters
        ----------
        reason : a sentence, for ``ended``.
        """
        if self._is_closed:
            return
        self._is_closed = True
        self._live.close()
        self.editing.unobserve_all()
        events = self.viewer.layers.events, self.viewer.dims.events
        events[0].removed.disconnect(self._layer_removed)
        for name in ("current_step", "order", "ndisplay"):
            getattr(events[1], name).disconnect(self._dims_changed)
        for layer in (*self.pairs.layers, self.overlay):
            self._forget(layer)
        self.layer.visible = True
        self.ended.emit(reason)


def describe(editor: LayerEditor, result: Result) -> tuple[str, bool]:
    """A line on a result, and whether it is a warning.

    Parameters
    ----------
    editor : that computed it.
    result : a full one.
    """
    warnings = [*result.warnings, *(problem[:1].upper() + problem[1:] for problem in result.problems)]
    count = len(editor.editing.points)
    moved = int((editor.editing.points.displacement != 0).any(axis=1).sum())
    facts = [f"{count} pairs, {moved} dragged."] if moved else [NO_POINTS]
    if moved and not any("folds" in warning for warning in warnings):
        facts.append("The map has no folds.")
    return " ".join([*warnings, *facts, *result.notes]), bool(warnings)
