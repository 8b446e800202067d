"""The widget "Deform volume": the choice of a layer, the settings of the fit, files, and what the map does."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import napari
from napari.utils.notifications import show_error, show_info, show_warning
from qtpy.QtCore import QEvent, QSignalBlocker, Qt
from qtpy.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDoubleSpinBox,
    QFileDialog,
    QFormLayout,
    QGroupBox,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QListWidget,
    QListWidgetItem,
    QProgressBar,
    QPushButton,
    QScrollArea,
    QSizePolicy,
    QSpinBox,
    QVBoxLayout,
    QWidget,
)

from deformnb import Deformation
from deformnb.errors import DeformError
from deformnb.widgets.parameters import Choice, Number, parameters
from napari_deformnb.editor import MODES, LayerEditor, Mode, describe
from napari_deformnb.results import MOST_CELLS, VERTEX_KINDS, Result
from napari_deformnb.subject import Subject

CHOICES = ("kernel", "trend", "direction", "extrusion")
"""Settings with a menu, of the package's table of parameters."""

NUMBERS = ("smoothing", "strength", "stages")
"""Settings that are numbers."""

VOXEL_KINDS = ("image", "labels")
"""Kinds of layers that can be deformed by themselves."""

HINT = (
    "Select the layer of targets. Add points (key 2) on what should move, choose the arrow (key 3), and drag them. "
    "Points that are not dragged hold their places."
)
"""Hint for the first minute."""

_MOST_CELLS_OFFERED = 32
_SUPPORT_DIGITS = 4  # of a support radius as long as the diagonal


class DeformVolumeWidget(QWidget):
    """Deform a layer by pairs of points.

    Parameters
    ----------
    viewer : of napari, which passes itself.

    Attributes
    ----------
    editor : the deformation that is edited; None before the first and after the end.
    """

    def __init__(self, viewer: napari.viewer.Viewer, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.viewer = viewer
        self.editor: LayerEditor | None = None
        self._finished = WeakKeyDictionary[Any, LayerEditor]()  # the last edits of each layer, to be continued
        self._build()
        for name in ("inserted", "removed", "reordered", "renamed"):
            getattr(viewer.layers.events, name).connect(self._list_layers)
        viewer.layers.selection.events.active.connect(self._active_changed)
        self.destroyed.connect(self._end_quietly)
        self._list_layers()
        self._show_state()

    # -- construction --------------------------------------------------------------------------------------------------

    def _build(self) -> None:
        self.layer_menu, self.mode_menu = QComboBox(), QComboBox()
        self.layer_menu.setPlaceholderText("Open an image first")
        self.layer_menu.setToolTip("The image or the labels to deform; the layer itself stays as it is")
        _narrow(self.layer_menu)
        _narrow(self.mode_menu)
        self.mode_menu.setToolTip("The place of the points: on a picture, as in the paper, or in space")
        for name, label in MODES.items():
            self.mode_menu.addItem(label, name)
        self.start_button = _button("Make point pairs", "Layers of sources and targets, and the deformed layer")
        self.start_button.clicked.connect(self._toggle)
        head = QFormLayout()
        head.addRow("Layer", self.layer_menu)
        head.addRow("Points", self.mode_menu)
        head.addRow(self.start_button)
        self.body = QWidget()
        inner = QVBoxLayout(self.body)
        self.hint = QLabel(HINT)
        self.hint.setWordWrap(True)
        for part in (self.hint, self._build_points(), self._build_fit(), self._build_display(), self._build_files()):
            inner.addWidget(part)
        inner.addStretch(1)
        scroll = QScrollArea()
        scroll.setWidgetResizable(True)
        scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        scroll.setFrameShape(QScrollArea.Shape.NoFrame)
        scroll.setWidget(self.body)
        inner.setContentsMargins(0, 0, scroll.verticalScrollBar().sizeHint().width() // 2, 0)
        scroll.setMinimumWidth(self.body.minimumSizeHint().width() + scroll.verticalScrollBar().sizeHint().width())
        self.status = QLabel()
        self.status.setWordWrap(True)
        self.status.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.progress = QProgressBar()
        self.progress.setRange(0, 100)
        self.cancel_button = _button("Cancel", "Stop the computation; the layers stay as they are")
        self.cancel_button.clicked.connect(self._cancel)
        whole = QVBoxLayout(self)
        whole.addLayout(head)
        whole.addWidget(scroll, 1)
        whole.addWidget(self.status)
        whole.addLayout(_row(self.progress, self.cancel_button))

    def _build_points(self) -> QGroupBox:
        self.undo_button = _button("Undo", "Undo the last edit")
        self.redo_button = _button("Redo", "Redo the edit that was undone last")
        self.reset_button = _button("Reset", "The layer as it was, without points and steps; can be undone")
        self.undo_button.clicked.connect(lambda: self._edit(lambda e: e.editing.undo()))
        self.redo_button.clicked.connect(lambda: self._edit(lambda e: e.editing.redo()))
        self.reset_button.clicked.connect(lambda: self._edit(lambda e: e.editing.reset()))
        self.pair_button = _button(
            "Add from two layers", "Pairs from two layers of points that are selected: sources below, targets above"
        )
        self.pair_button.clicked.connect(lambda: self._edit(self._add_from_layers))
        self.step_menu = QComboBox()
        _narrow(self.step_menu)
        self.step_menu.setToolTip("The step whose points are shown; each deforms the result of those before")
        self.step_menu.currentIndexChanged.connect(self._choose_step)
        self.add_step_button = _button("Add", "Deform once more after all other steps, on the slice that is shown")
        self.remove_step_button = _button("Remove", "Remove this step; can be undone")
        self.add_step_button.clicked.connect(lambda: self._edit(lambda e: e.add_step()))
        self.remove_step_button.clicked.connect(lambda: self._edit(lambda e: e.remove_step()))
        return _group(
            "Points",
            _row(self.undo_button, self.redo_button, self.reset_button),
            _row(self.pair_button),
            _row(QLabel("Step"), self.step_menu, self.add_step_button, self.remove_step_button),
        )

    def _build_fit(self) -> QGroupBox:
        table = parameters(1.0)
        form = QFormLayout()
        self.menus: dict[str, QComboBox] = {}
        self.numbers: dict[str, Any] = {}
        for name in (*CHOICES[:2], "support", *NUMBERS, *CHOICES[2:]):
            row = table[name]
            made: QWidget
            if isinstance(row, Choice):
                made = self.menus[name] = QComboBox()
                _narrow(made)
                for label, value in row.menu:
                    made.addItem(label, value)
                made.currentIndexChanged.connect(
                    lambda _, name=name: self._change(name, self.menus[name].currentData())
                )
            elif name == "support":
                made = self._build_support(str(table["automatic_support"].tooltip))
            else:
                assert isinstance(row, Number)
                made = self.numbers[name] = _number(row)
                made.valueChanged.connect(lambda value, name=name: self._change(name, value, slides=True))
            made.setToolTip(row.tooltip)
            form.addRow(row.label, made)
        self.curve = QLineEdit()
        self.curve.setToolTip(
            "f(z) of the rule Modulate: z is the depth, 0 in front and 1 at the back, as in sin(pi*z)"
        )
        self.curve.editingFinished.connect(lambda: self._change("curve", self.curve.text().strip()))
        form.addRow("Curve f(z)", self.curve)
        self.form = form
        return _group("Fit", form)

    def _build_support(self, tooltip: str) -> QWidget:
        self.support, self.automatic = QDoubleSpinBox(), QCheckBox("auto")
        self.support.setKeyboardTracking(False)
        self.automatic.setToolTip(tooltip)
        self.support.valueChanged.connect(lambda value: self._change("support", value, slides=True))
        self.automatic.toggled.connect(self._toggle_automatic)
        box = QWidget()
        layout = _row(self.support, self.automatic)
        layout.setStretch(0, 1)  # the number, with its unit, is longer than the word
        layout.setContentsMargins(0, 0, 0, 0)
        box.setLayout(layout)
        return box

    def _build_display(self) -> QGroupBox:
        self.live = QCheckBox("Deformed layer, computed at every edit")
        self.live.toggled.connect(lambda on: self._edit(lambda e: e.set_live(on)))
        self.cells = QSpinBox()
        self.cells.setRange(0, min(_MOST_CELLS_OFFERED, MOST_CELLS))
        self.cells.setSpecialValueText("none")
        self.cells.setToolTip("Cells of a grid along the longest side, which bends with the tissue")
        self.cells.valueChanged.connect(lambda count: self._edit(lambda e: e.set_cells(count)))
        self.others = QListWidget()
        self.others.setMaximumHeight(90)
        self.others.setToolTip("Layers of the same world that get a deformed copy; labels by the nearest voxel")
        self.others.itemChanged.connect(lambda _: self._edit(lambda e: e.set_others(self._chosen_others())))
        return _group("Show", self.live, _row(QLabel("Grid"), self.cells), QLabel("Deform along:"), self.others)

    def _build_files(self) -> QGroupBox:
        self.file_buttons = {
            "open": _button("Open session", "Open a document of deformnb, .json"),
            "save": _button("Save session", "Save the points and settings as a document of deformnb, .json"),
            "script": _button("Export script", "Write a Python script that makes this deformation"),
            "volume": _button("Save deformed layer", "Write the deformed layer by napari's writers and this plugin's"),
        }
        self.file_buttons["open"].clicked.connect(self._ask_open)
        self.file_buttons["save"].clicked.connect(lambda: self._ask_save("session", "*.json", self.save_session))
        self.file_buttons["script"].clicked.connect(lambda: self._ask_save("script", "*.py", self.save_script))
        self.file_buttons["volume"].clicked.connect(
            lambda: self._ask_save("deformed layer", " ".join(f"*{s}" for s in written_suffixes()), self.save_deformed)
        )
        names = list(self.file_buttons)
        rows = [_row(*(self.file_buttons[name] for name in names[k : k + 2])) for k in (0, 2)]
        return _group("Files", *rows)

    # -- the life of an editor -----------------------------------------------------------------------------------------

    def start(self, layer: Any = None, mode: Mode | None = None) -> None:
        """Begin to deform a layer; by default those that the menus show.

        Parameters
        ----------
        layer : an image or labels of the viewer.
        mode : one of :data:`~napari_deformnb.editor.MODES`.
        """
        self.stop()
        layer = self.layer_menu.currentData() if layer is None else layer
        if layer is None:
            show_error("There is no image and there are no labels to deform: open a file, or File > Open Sample.")
            return
        chosen: Mode = mode or self.mode_menu.currentData()
        try:
            editor = LayerEditor(self.viewer, layer, chosen, self._document_of(layer, chosen))
        except DeformError as error:
            show_error(_sentence(str(error)))
            return
        if chosen == "space" and editor.subject.ndim == 2:
            show_info("The layer has two dimensions: its points are on its picture.")
        self.editor = editor
        editor.changed.connect(self._show_state)
        editor.finished.connect(self._show_result)
        editor.failed.connect(self._show_failure)
        editor.progressed.connect(self._show_progress)
        editor.ended.connect(self._editor_ended)
        editor.editing.observe(self._notice, "notice")
        self._show_progress(0.0)
        self._list_layers()
        self._show_state()

    def _document_of(self, layer: Any, mode: Mode) -> Deformation | None:
        """The document that was made on a layer before, if it is where it was and points are in the same place."""
        before = self._finished.get(layer)
        if before is None or before.subject.grid != Subject(layer).grid:
            return None
        is_alike = before.subject.ndim == 2 or (before.plane is None) == (mode == "space")
        return before.editing.deformation if is_alike else None

    def event(self, event: Any) -> bool:
        """End the edits where napari takes this widget out of its window."""
        if event.type() == QEvent.Type.ParentChange and self.parent() is None:
            self._end_quietly()
        return bool(super().event(event))

    def stop(self) -> None:
        """End the edits: the points go, the deformed layers stay. The next start on the layer continues them."""
        if self.editor is not None:
            self.editor.close()

    def _editor_ended(self, reason: str) -> None:
        if self.editor is not None:
            self._finished[self.editor.layer] = self.editor
        self.editor = None
        self.status.setText("")
        if reason:
            show_warning(reason)
        self._list_layers()
        self._show_state()

    def _end_quietly(self, *_: Any) -> None:
        editor = getattr(self, "editor", None)  # events come while the widget is made, too
        if editor is not None:
            editor.close()

    def _toggle(self) -> None:
        if self.editor is None:
            self.start()
        else:
            self.stop()

    # -- edits ---------------------------------------------------------------------------------------------------------

    def _edit(self, edit: Callable[[LayerEditor], Any]) -> None:
        if self.editor is None:
            return
        try:
            edit(self.editor)
        except DeformError as error:
            show_error(_sentence(str(error)))
        self._show_state()

    def _change(self, name: str, value: Any, *, slides: bool = False) -> None:
        if self.editor is None or getattr(self.editor.editing.step, name) == value:
            return
        value = int(value) if name == "stages" else value
        self._edit(lambda e: e.editing.change(kind=name if slides else None, slides=slides, **{name: value}))

    def _toggle_automatic(self, automatic: bool) -> None:
        if self.editor is not None:
            step = self.editor.editing.step
            self._change("support", None if automatic else step.support_for(step.points) or self.support.value())

    def _choose_step(self, index: int) -> None:
        if self.editor is not None and index >= 0 and index != self.editor.editing.index:
            self._edit(lambda e: e.editing.edit_step(index))

    def _add_from_layers(self, editor: LayerEditor) -> None:
        own = set(editor.pairs.sides.values())
        layers = [one for one in self.viewer.layers if one in self.viewer.layers.selection and one not in own]
        if len(layers) != 2 or any(one.as_layer_data_tuple()[2] != "points" for one in layers):
            raise DeformError(
                "select two layers of points in the list of layers, beside those of this widget: the lower one has the "
                "sources, the upper one the targets."
            )
        editor.add_landmarks(*layers)

    def _cancel(self) -> None:
        if self.editor is not None:
            self.editor.cancel()
            self._show_status("Cancelled: the deformed layer is as it was. The next edit computes it.", True)
            self._show_busy(False)

    # -- files ---------------------------------------------------------------------------------------------------------

    def open_session(self, path: str | Path) -> None:
        """Continue with a document of deformnb."""

        def open_file(editor: LayerEditor) -> None:
            difference = editor.open(path)
            if difference:
                show_warning(difference)

        self._edit(open_file)

    def save_session(self, path: str | Path) -> None:
        """Save the document as JSON, in place of a file of that name."""
        self._edit(lambda e: e.save(path, overwrite=True))

    def save_script(self, path: str | Path) -> None:
        """Write the Python script of the deformation."""
        if self.editor is not None:
            Path(path).write_text(self.editor.script(), encoding="utf-8")

    def save_deformed(self, path: str | Path) -> None:
        """Write the deformed layer by napari's writers, of which this plugin's are some."""
        editor = self.editor
        if editor is None or editor.deformed is None:
            show_error("There is no deformed layer: switch it on first.")
        elif editor.is_busy:
            show_error("The deformed layer is still being computed: save it once it is there.")
        else:
            written = editor.deformed.save(str(path))
            if not written:
                show_error(
                    f"No writer of napari knows {Path(path).name!r}; write one of {', '.join(written_suffixes())}."
                )

    def _ask_open(self) -> None:
        path, _ = QFileDialog.getOpenFileName(self, "Open session", "", "Documents of deformnb (*.json)")
        if path:
            self.open_session(path)

    def _ask_save(self, what: str, pattern: str, save: Callable[[str], None]) -> None:
        path, _ = QFileDialog.getSaveFileName(self, f"Save {what}", "", f"{what.capitalize()} ({pattern})")
        if path:
            suffixes = [one.removeprefix("*") for one in pattern.split()]
            save(path if path.lower().endswith(tuple(suffixes)) else path + suffixes[0])

    # -- display -------------------------------------------------------------------------------------------------------

    def _list_layers(self, _event: Any = None) -> None:
        """List the layers that can be deformed, and those that can be deformed along."""
        made = self._own_layers()
        layers = [one for one in self.viewer.layers if one not in made]
        kinds = {id(one): type(one).__name__.lower() for one in layers}
        subjects = [one for one in layers if kinds[id(one)] in VOXEL_KINDS]
        with QSignalBlocker(self.layer_menu), QSignalBlocker(self.others):
            before = self.layer_menu.currentData()
            self.layer_menu.clear()
            for one in subjects:
                self.layer_menu.addItem(one.name, one)
            wanted = [before, *(one for one in reversed(subjects) if one.visible), *subjects]
            wanted = [one for one in wanted if one in subjects]
            if self.editor is not None and self.editor.layer in subjects:
                wanted.insert(0, self.editor.layer)
            if wanted:
                self.layer_menu.setCurrentIndex(subjects.index(wanted[0]))
            chosen = set() if self.editor is None else set(self.editor.others)
            self.others.clear()
            for one in layers:
                if kinds[id(one)] in (*VOXEL_KINDS, *VERTEX_KINDS) and (
                    self.editor is None or one is not self.editor.layer
                ):
                    item = QListWidgetItem(f"{one.name} ({kinds[id(one)]})")
                    item.setData(Qt.ItemDataRole.UserRole, one)
                    item.setFlags(item.flags() | Qt.ItemFlag.ItemIsUserCheckable)
                    item.setCheckState(Qt.CheckState.Checked if one in chosen else Qt.CheckState.Unchecked)
                    self.others.addItem(item)
        self.start_button.setEnabled(self.editor is not None or bool(subjects))

    def _own_layers(self) -> set[Any]:
        if self.editor is None:
            return set()
        results = [one for one in self.editor.others.values() if one is not None]
        return {*self.editor.pairs.layers, self.editor.deformed, self.editor.overlay, *results}

    def _active_changed(self, event: Any) -> None:
        """Offer the layer that is selected, before one is deformed."""
        found = self.layer_menu.findData(event.value) if event.value is not None else -1
        if self.editor is None and found >= 0:
            self.layer_menu.setCurrentIndex(found)

    def _chosen_others(self) -> list[Any]:
        items = [self.others.item(k) for k in range(self.others.count())]
        return [item.data(Qt.ItemDataRole.UserRole) for item in items if item.checkState() == Qt.CheckState.Checked]

    def _show_state(self) -> None:
        """Show the document: settings, steps, undo and redo."""
        editor = self.editor
        self.body.setEnabled(editor is not None)
        self.start_button.setText("Make point pairs" if editor is None else "Finish: keep the deformed layer")
        for menu in (self.layer_menu, self.mode_menu):
            menu.setEnabled(editor is None)
        if editor is None:
            self._show_busy(False)
            return
        with _Blocked(self._controls()):
            self._show_settings(editor)
            history = editor.editing.history
            for button, way in ((self.undo_button, "undo"), (self.redo_button, "redo")):
                what = history.get(way)
                button.setEnabled(bool(what))
                button.setToolTip(f"{way.capitalize()}: {what}" if what else f"Nothing to {way}")
            self._show_steps(editor)
            self.live.setChecked(editor.is_live)
            self.cells.setValue(editor.cells)
        self._show_busy(editor.is_busy)

    def _show_settings(self, editor: LayerEditor) -> None:
        step = editor.editing.step
        for name, menu in self.menus.items():
            menu.setCurrentIndex(menu.findData(getattr(step, name)))
        for name, box in self.numbers.items():
            box.setValue(getattr(step, name))
        diagonal, row = editor.subject.grid.diagonal, parameters(editor.subject.grid.diagonal)["support"]
        assert isinstance(row, Number)
        self.support.setDecimals(max(0, _SUPPORT_DIGITS - math.ceil(math.log10(diagonal))))
        self.support.setRange(row.low, row.high)
        self.support.setSingleStep(0.02 * diagonal)
        unit = editor.subject.grid.unit
        self.support.setSuffix(f" {unit}" if unit else "")
        radius = step.support if isinstance(step.support, float) else step.support_for(step.points)
        self.support.setValue(radius or 0.25 * diagonal)
        self.automatic.setChecked(step.support is None)
        self.support.setEnabled(step.support is not None)
        on_plane = step.plane is not None and editor.subject.ndim == 3
        for widget, is_used in (
            (self.menus["extrusion"], on_plane),
            (self.curve, on_plane and step.extrusion == "modulate"),
        ):
            widget.setVisible(is_used)
            label = self.form.labelForField(widget)
            if label is not None:
                label.setVisible(is_used)
        self.curve.setText(step.curve if isinstance(step.curve, str) else ", ".join(f"{v:g}" for v in step.curve))
        self.curve.setReadOnly(not isinstance(step.curve, str))

    def _show_steps(self, editor: LayerEditor) -> None:
        steps = editor.editing.deformation.steps
        self.step_menu.clear()
        for k, step in enumerate(steps):
            where = "in space" if step.plane is None else "on a slice"
            self.step_menu.addItem(f"{k + 1}: {step.name or where}")
        self.step_menu.setCurrentIndex(editor.editing.index)
        self.remove_step_button.setEnabled(len(steps) > 1)

    def _controls(self) -> list[QWidget]:
        return [
            *self.menus.values(),
            *self.numbers.values(),
            self.support,
            self.automatic,
            self.curve,
            self.step_menu,
            self.live,
            self.cells,
        ]

    def _show_result(self, result: Result) -> None:
        if self.editor is not None:
            self._show_status(*describe(self.editor, result))
            self._list_layers()
            self._show_busy(False)

    def _show_failure(self, text: str) -> None:
        self._show_status(_sentence(text), True)
        self._show_busy(False)
        show_error(_sentence(text))

    def _show_status(self, text: str, is_warning: bool) -> None:
        self.status.setText(text)
        self.status.setStyleSheet("color: #ff9d2e;" if is_warning else "")

    def _show_progress(self, share: float) -> None:
        self.progress.setValue(round(100 * share))
        self._show_busy(self.editor is not None and self.editor.is_busy)

    def _show_busy(self, is_busy: bool) -> None:
        for widget in (self.progress, self.cancel_button):
            policy = widget.sizePolicy()
            policy.setRetainSizeWhenHidden(True)
            widget.setSizePolicy(policy)
            widget.setVisible(is_busy)

    def _notice(self, change: Any) -> None:
        if change["new"]:
            show_info(change["new"])


class _Blocked:
    """A context in which controls emit no signals."""

    def __init__(self, controls: list[QWidget]) -> None:
        self._blockers = [QSignalBlocker(control) for control in controls]

    def __enter__(self) -> None:
        return None

    def __exit__(self, *_: object) -> None:
        for blocker in self._blockers:
            blocker.unblock()


def written_suffixes() -> list[str]:
    """Suffixes of volumes that napari or this plugin writes, the first of them by this plugin with the place."""
    from napari_deformnb.files import WRITTEN

    return [*WRITTEN, ".tif"]


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def _button(label: str, tooltip: str) -> QPushButton:
    button = QPushButton(label)
    button.setToolTip(tooltip)
    button.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
    return button


def _narrow(menu: QComboBox) -> None:
    """Let a menu be narrower than its longest words."""
    menu.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
    menu.setMinimumContentsLength(8)


def _row(*widgets: QWidget) -> QHBoxLayout:
    row = QHBoxLayout()
    for widget in widgets:
        row.addWidget(widget)
    return row


def _group(title: str, *parts: Any) -> QGroupBox:
    box = QGroupBox(title)
    layout = QVBoxLayout(box)
    for part in parts:
        if isinstance(part, QWidget):
            layout.addWidget(part)
        else:
            layout.addLayout(part)
    return box


def _number(row: Number) -> QSpinBox | QDoubleSpinBox:
    box = QSpinBox() if row.digits == 0 else QDoubleSpinBox()
    box.setKeyboardTracking(False)
    if isinstance(box, QDoubleSpinBox):
        box.setDecimals(row.digits)
        box.setSingleStep(0.05)
        box.setRange(row.low, row.high)
    else:
        box.setRange(int(row.low), int(row.high))
    return box
