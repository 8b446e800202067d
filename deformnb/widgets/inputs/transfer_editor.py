"""Transfer function editor: opacity as a curve over the histogram of a volume, colours and window below it.

Values of its messages (see :mod:`~deformnb.widgets.inputs.base`): ``{"nodes": [[value, alpha], ...]}``, ``{"colors":
[[value, "#rrggbb"], ...]}``, ``{"window": [low, high]}`` or ``{"preset": name}``.
"""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
import traitlets

from deformnb._typing import Image
from deformnb._weak import weakly
from deformnb.errors import DeformError
from deformnb.imaging.thumbnails import preset_thumbnails
from deformnb.session.inputs import best_view
from deformnb.volume.transfer import PRESETS, Histogram, PresetName, TransferFunction, histogram, levels, preset
from deformnb.volume.volume import Volume, VolumeLike, as_volume
from deformnb.widgets.bundle import bundle
from deformnb.widgets.image_encoding import as_png
from deformnb.widgets.inputs.base import AbstractEdited, is_number, nodes_from_json
from deformnb.widgets.inputs.curve_editor import MOST_NODES
from deformnb.widgets.synced import SyncedWidget
from deformnb.widgets.worker import Worker

_BINS, _SLICES = 1024, 24  # of 12 bits a bin is a few values; the front end adds up bins finer than a pixel
_FEWEST_GAPS = 31  # gaps between values: fewer are no evidence of a step that all values share
_FELT = 16  # more steps than this in a bin, and one more or less is not seen


class _TransferTrait(traitlets.TraitType[TransferFunction, TransferFunction]):
    """A transfer function."""

    info_text = "a TransferFunction"

    def validate(self, obj: Any, value: Any) -> TransferFunction:
        if not isinstance(value, TransferFunction):
            raise DeformError(f"transfer must be a TransferFunction, got {type(value).__name__}; see preset(name).")
        return value


class TransferEditor(AbstractEdited):
    """Opacities, colours and window of a transfer function, dragged under the histogram of a volume.

    Parameters
    ----------
    volume : whose values they are for.
    transfer : a transfer function or the name of a preset.
    height : least height of the plot in CSS pixels; a wide window makes it a little larger.
    power : the height of an alpha on the plot is alpha to this power: below 1, the small alphas of translucent tissue
        can be distinguished and dragged; 1 is linear.
    worker : the thread in which thumbnails of the presets are made; default is a separate one.
    theme, label, read_only : as in :class:`~deformnb.widgets.Editor`.

    Notes
    -----
    ``transfer`` is a trait: ``editor.observe(f, "transfer")`` calls f after every edit. Colours are no part of a
    document and of its undo; the preset, which the front end offers as "Reset", restores them.

    Examples
    --------
    >>> editor = TransferEditor(Volume.from_array(np.arange(60, dtype=np.uint8).reshape(3, 4, 5)), "bone")
    >>> len(editor.transfer.opacities)
    4
    >>> editor.preset("xray")
    >>> editor.transfer.opacities[-1][1]
    0.06
    """

    _esm = bundle("transfer_editor.js")
    _css = bundle("transfer_editor.css")

    transfer = _TransferTrait(TransferFunction(((0, 1, 1, 1),), ((0, 0), (1, 1))))
    height = traitlets.Int(150, min=80, max=1024).tag(sync=True)
    power = traitlets.Float(0.4, min=0.1, max=1.0).tag(sync=True)
    presets = traitlets.Dict(
        {name: str(make.__doc__).partition("\n")[0] for name, make in PRESETS.items()},
        read_only=True,
        help="what each preset shows, by its name",
    ).tag(sync=True)
    thumbnails = traitlets.Dict(
        help="the volume in each preset's colours, PNG as data URLs; empty until they are made"
    ).tag(sync=True)
    histogram = traitlets.Dict(help="bars behind the curve").tag(sync=True)

    def __init__(
        self,
        volume: VolumeLike,
        transfer: TransferFunction | PresetName = "specimen",
        *,
        worker: Worker | None = None,
        **traits: Any,
    ) -> None:
        self._volume = volume = as_volume(volume)
        self._given_worker = worker
        self._named: tuple[str, TransferFunction] | None = None
        counts, self._extent = display_histogram(volume)
        super().__init__(histogram=_bars(counts), **{"label": "Opacities and colours", **traits})
        self.set_transfer(transfer)
        self._show()
        self._request_thumbnails()

    @property
    def volume(self) -> Volume:
        """Volume whose values the colours are for; a preset's name, or else the nodes, stay when another one is set."""
        return self._volume

    @volume.setter
    def volume(self, volume: Volume) -> None:
        volume = as_volume(volume)
        counts, extent = display_histogram(volume)
        name: Any = self.preset_name
        self._volume, self._extent = volume, extent
        with self.hold_sync():  # all in one message: histogram and nodes must match
            self.histogram = _bars(counts)
            self.thumbnails = {}
            if name:
                self.preset(name)
            self._show()
        self._request_thumbnails()

    def preset(self, name: PresetName) -> None:
        """Take the preset of this name for the volume."""
        self.set_transfer(name)

    def set_transfer(self, transfer: TransferFunction | PresetName) -> None:
        """Take a transfer function, or the preset of a name."""
        if isinstance(transfer, str):
            found = preset(transfer, self._volume)
            self._named = (transfer, found)
            transfer = found
        self.transfer = transfer

    def _request_thumbnails(self) -> None:
        # Held until the work is done: a worker without a reference ends before it.
        self._worker = self._given_worker or Worker("deformnb-thumbnails")
        if not self._worker.is_closed:
            self._worker.latest("thumbnails", weakly(self, TransferEditor._make_thumbnails))

    def _make_thumbnails(self) -> None:
        volume = self._volume
        made = preset_thumbnails(volume, best_view(volume))
        if volume is self._volume:
            self.thumbnails = {name: _data_url(picture) for name, picture in made.items()}
        if self._given_worker is None:
            self._worker.close()

    # ---- edits ------------------------------------------------------------------------------------------------------

    def _check_value(self, value: Any) -> tuple[str, TransferFunction]:
        if not isinstance(value, dict):
            raise DeformError("a transfer function is nodes, colours, a window or the name of a preset.")
        if "preset" in value:
            if not isinstance(value["preset"], str):
                raise DeformError("the name of a preset is a text.")
            name: Any = value["preset"]
            return name, preset(name, self._volume)
        if "colors" in value:
            return "", self.transfer.with_colors(_stops(value["colors"], max(MOST_NODES, len(self.transfer.colors))))
        if "window" in value:
            return "", self.transfer.windowed(*_window(value["window"]))
        nodes = nodes_from_json(value.get("nodes"), 1, max(MOST_NODES, len(self.transfer.opacities)))
        if any(not 0 <= alpha <= 1 for _, alpha in nodes):
            raise DeformError("an alpha must be a number from 0 to 1.")
        return "", self.transfer.with_opacities(nodes)

    def _take(self, edit: tuple[str, TransferFunction]) -> None:
        name, transfer = edit
        if name:
            self._named = (name, transfer)
        self.transfer = transfer
        self._show()

    def _callback_value(self, edit: tuple[str, TransferFunction]) -> TransferFunction:
        return edit[1]

    @property
    def preset_name(self) -> str:
        """The preset that is shown; "" for colours and opacities of the user's own."""
        return self._named[0] if self._named is not None and self._named[1] == self.transfer else ""

    @traitlets.observe("transfer")
    def _handle_change(self, _change: Any) -> None:
        self._show()

    def _show(self) -> None:
        values = [*self._extent, *self.transfer.window]
        self._set_content(
            nodes=[list(node) for node in self.transfer.opacities],
            preset=self.preset_name,
            colors=[list(node) for node in self.transfer.colors],
            back=self._named[0] if self._named else "",
            range=[min(values), max(values)],
        )

    def __repr__(self) -> str:
        what = repr(self.preset_name) if self.preset_name else f"{len(self.transfer.opacities)} nodes"
        return f"TransferEditor({self._volume.name or 'volume'}, {what})"


class PresetMenu(SyncedWidget):
    """A menu of the presets of a transfer editor, with its pictures.

    Parameters
    ----------
    editor : makes the pictures of its volume.

    Attributes
    ----------
    value : name of a preset, or empty for colours of one's own.
    disabled : whether it takes no choice.

    Examples
    --------
    >>> from deformnb.datasets import PHANTOMS
    >>> editor = TransferEditor(PHANTOMS["bar"].make((8, 8, 8)), "bone")
    >>> menu = PresetMenu(editor)
    >>> menu.value = editor.preset_name
    >>> menu.value, list(menu.presets)[:2]
    ('bone', ['specimen', 'bone'])
    >>> menu.close()
    """

    _esm = bundle("preset_menu.js")
    _css = bundle("preset_menu.css")

    value = traitlets.Enum(["", *PRESETS], "").tag(sync=True)
    disabled = traitlets.Bool(False).tag(sync=True)
    presets = traitlets.Dict(read_only=True, help="what each preset shows, by its name").tag(sync=True)
    thumbnails = traitlets.Dict(help="as those of the editor").tag(sync=True)

    def __init__(self, editor: TransferEditor, **traits: Any) -> None:
        super().__init__(**traits)
        self.set_trait("presets", editor.presets)
        traitlets.dlink((editor, "thumbnails"), (self, "thumbnails"))


def _data_url(picture: Image) -> str:
    return f"data:image/png;base64,{base64.b64encode(as_png(picture)).decode()}"


def _stops(data: Any, most: int) -> list[tuple[float, str]]:
    """Colours by the front end, values not falling."""
    if not isinstance(data, list) or not 1 <= len(data) <= most:
        raise DeformError(f"colours need a list of 1 to {most} stops.")
    if not all(
        isinstance(row, list) and len(row) == 2 and is_number(row[0]) and isinstance(row[1], str) for row in data
    ):
        raise DeformError("a stop of the colours must be a finite number and a colour.")
    return [(float(value), color) for value, color in data]


def _window(data: Any) -> tuple[float, float]:
    if not isinstance(data, list) or len(data) != 2 or not all(map(is_number, data)):
        raise DeformError("a window must be two finite numbers.")
    return float(data[0]), float(data[1])


def display_histogram(volume: Volume) -> tuple[Histogram, tuple[float, float]]:
    """The histogram behind the curve, up to the densest tissue, with its first and last value.

    A few voxels of metal would compress all tissue into the first tenth of the plot. Where values come in steps, as
    whole numbers and former bytes do, bins hold whole steps: one and a half would appear as a comb.
    """
    low, _, _, top = levels(volume)
    step = _step(volume, low, top)
    if step:
        count = int(np.ceil((top - low) / step - 1e-3)) + 1
        each = -(-count // _BINS)
        bins = max(2, -(-count // each))
        edge, width = low - step / 2, each * step
        return histogram(volume, edge, edge + bins * width, bins, _SLICES), (low, low + (bins * each - 1) * step)
    high = top if top > low else low + max(1.0, abs(low))
    return histogram(volume, low, high, _BINS, _SLICES), (low, high)


def _step(volume: Volume, low: float, top: float) -> float:
    """The step in which values come, as far as one slice shows it; 0 if there is none that affects bins."""
    middle = volume.finite_values[volume.shape[0] // 2, ::2, ::2]
    values = np.unique(middle.astype(np.float64))
    gaps = np.diff(values)
    gaps = gaps[gaps > 1e-6 * (top - low)]
    if len(gaps) < _FEWEST_GAPS:
        return 1.0 if middle.dtype.kind in "bui" else 0.0
    steps = (values - low) / gaps.min()
    is_even = bool(np.abs(steps - np.round(steps)).max() < 0.05)
    return float(gaps.min()) if is_even and (top - low) / gaps.min() < _FELT * _BINS else 0.0


def _bars(counts: Histogram) -> dict[str, Any]:
    """Heights from 0 to 1 on a logarithmic scale, on which the peak of the air does not flatten the rest."""
    heights = np.log1p(counts.counts) / max(np.log1p(counts.counts.max()), 1e-12)
    note = f"{counts.slices} of {counts.total} slices" if counts.is_sampled else ""
    return {"low": counts.low, "high": counts.high, "heights": np.round(heights, 3).tolist(), "note": note}
