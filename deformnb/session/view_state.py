"""View state of a volume, stored in a document next to its edits: projection, slice, window, colours, opacities.

A document has it in a separate field, ``look``, since version 1.4. It is no part of the deformation: it is not undone
with an edit, and two documents that differ only in it are the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, get_args

from deformnb.checks import check_choice, check_fields, check_window
from deformnb.document.deformation import Deformation
from deformnb.document.json_reader import JsonReader
from deformnb.errors import DeformError
from deformnb.imaging.projection import PROJECTIONS
from deformnb.volume.colour_maps import COLOUR_MAPS
from deformnb.volume.transfer import PRESETS, PresetName, TransferFunction

FIELD = "look"
MOST_TRANSFER_NODES = 1024
"""Of colours, and of opacities, that a document may have."""


@dataclass(frozen=True)
class ViewState:
    """View state of a volume; None for settings that are not in the document.

    Parameters
    ----------
    transfer : colours and opacities, or the name of a preset.
    method : projection of the picture.
    depth : position of a slice along the normal, from the middle of the volume.
    window : values shown as black and white, where they were chosen manually.
    colour_map : of grey pictures, a name of :data:`~deformnb.volume.colour_maps.COLOUR_MAPS`; the default, which is the
        first, is not stored.
    ambient_occlusion : whether hollows of the volume are darker; the default, which is on, is not stored.
    """

    transfer: PresetName | TransferFunction | None = None
    method: str | None = None
    depth: float | None = None
    window: tuple[float, float] | None = None
    colour_map: str | None = None
    ambient_occlusion: bool | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        if isinstance(self.transfer, str):
            check_choice(self.transfer, PRESETS, "transfer function")

    def add_to(self, deformation: Deformation) -> Deformation:
        """A document with this view state."""
        transfer: Any = self.transfer
        if isinstance(transfer, TransferFunction):
            transfer = {
                "colors": [list(row) for row in transfer.colors],
                "unit": transfer.unit,
                "opacities": [list(row) for row in transfer.opacities],
            }
        settings = {
            "transfer": transfer,
            "method": self.method,
            "depth": self.depth,
            "window": None if self.window is None else list(self.window),
            "colour_map": None if self.colour_map == COLOUR_MAPS[0] else self.colour_map,
            "ambient_occlusion": None if self.ambient_occlusion else self.ambient_occlusion,
        }
        data = {key: value for key, value in settings.items() if value is not None}
        return replace(deformation, extra={**deformation.extra, FIELD: data})

    @classmethod
    def split(cls, deformation: Deformation) -> tuple[Deformation, ViewState]:
        """A document without its view state, and that.

        Names of presets, projections and colour maps that a later version may have are passed over.

        Raises
        ------
        DeformError
            If it is malformed, naming the place.
        """
        if FIELD not in deformation.extra:
            return deformation, cls()
        r = JsonReader(deformation.extra[FIELD], f"document.{FIELD}")
        method = r.text("method", "")
        depth = r.number("depth") if "depth" in r.data else None
        colours = r.text("colour_map", "")
        state = cls(
            _transfer(r),
            method if method in PROJECTIONS else None,
            depth,
            _window(r),
            colours if colours in COLOUR_MAPS else None,
            r.flag("ambient_occlusion") if "ambient_occlusion" in r.data else None,
        )
        return without_view_state(deformation), state

    def traits(self, *, is_other: bool = False) -> dict[str, Any]:
        """Settings that a session adopts; colours and window at the values of another volume would not fit."""
        settings = {
            "transfer": None if is_other and isinstance(self.transfer, TransferFunction) else self.transfer,
            "method": self.method,
            "depth": None if is_other else self.depth,
            "window": None if is_other else self.window,
            "colour_map": self.colour_map,
            "ambient_occlusion": self.ambient_occlusion,
        }
        return {key: value for key, value in settings.items() if value is not None}


def without_view_state(deformation: Deformation) -> Deformation:
    """A document without its view state."""
    if FIELD not in deformation.extra:
        return deformation
    return replace(deformation, extra={key: value for key, value in deformation.extra.items() if key != FIELD})


def _transfer(r: JsonReader) -> PresetName | TransferFunction | None:
    named = r.value("transfer", (str, dict), "")
    if isinstance(named, str):
        return next((name for name in get_args(PresetName) if name == named), None)
    part = r.part("transfer")
    try:
        return TransferFunction(_nodes(part, "colors", 4), _nodes(part, "opacities", 2), part.number("unit"))
    except DeformError as error:
        raise DeformError(f"{part.where}: {error}") from None


def _window(r: JsonReader) -> tuple[float, float] | None:
    if "window" not in r.data:
        return None
    try:
        return check_window(r.numbers("window", 2))
    except DeformError as error:
        raise DeformError(f"{r.where}: {error}") from None


def _nodes(r: JsonReader, key: str, width: int) -> Any:
    rows = r.value(key, (list,), ...)
    if len(rows) > MOST_TRANSFER_NODES:
        raise DeformError(f"{key} may have {MOST_TRANSFER_NODES} nodes, got {len(rows)}.")
    return tuple(JsonReader({key: row}, r.where).numbers(key, width) for row in rows)
