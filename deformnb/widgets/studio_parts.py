"""What a studio is put together from: its view, the arrangement of its widgets, its status line, its still."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import ipywidgets as ipw
import numpy as np
from numpy.typing import NDArray

from deformnb.errors import DeformError
from deformnb.session import Session
from deformnb.volume import Volume
from deformnb.widgets.controls import Panel
from deformnb.widgets.live_view import LiveView
from deformnb.widgets.view import AbstractView

VIEW_KINDS = ("live", "vtk")
"""Views by name: rendered in the browser, or by VTK in Python."""


def make_view(kind: str | AbstractView, volume: Volume, transfer: Any, height: int) -> Any:
    """A view of the volume by its name in :data:`VIEW_KINDS`, or one that was made by hand."""
    if isinstance(kind, AbstractView):
        kind.show(volume)
        kind.set_transfer(transfer)
        return kind
    if kind == "live":
        return LiveView(volume, transfer=transfer, width=720, height=height)
    if kind == "vtk":
        from deformnb.widgets.volume_view import VolumeView

        return VolumeView(volume, transfer=transfer, width=720, height=height)
    raise DeformError(f"unknown view {kind!r}; choose one of {', '.join(VIEW_KINDS)}, or give a view.")


def arranged(editor: Any, view: Any, panels: Sequence[Panel], line: list[Any]) -> list[Any]:
    """Picture and volume side by side, the first panel below, the others in tabs, and a line for words."""
    half = {"flex": "1 1 320px", "min_width": "0"}
    for widget in (editor, view):
        widget.layout.width = "100%"
    if view.has_trait("fill"):
        view.fill = True  # as high as the picture is
    pictures = ipw.HBox([ipw.Box([widget], layout=ipw.Layout(**half)) for widget in (editor, view)],
                        layout=ipw.Layout(flex_flow="row wrap", align_items="stretch", grid_gap="8px"))
    head, *others = panels
    tabs = ipw.Tab([panel.box for panel in others], titles=[panel.title for panel in others],
                   layout=ipw.Layout(width="100%"))
    return [pictures, head.box, tabs, ipw.HBox(line, layout=ipw.Layout(width="100%", grid_gap="16px"))]


def status_text(session: Session, edit_ms: float | None) -> str:
    """How many points there are, which of several steps and keys is edited, and how long the last edit took."""
    step = session.step
    moved = int(np.count_nonzero(session.points.displacement.any(axis=1)))
    facts = [f"{len(session.points)} points, {moved} dragged"]
    if len(session.deformation.steps) > 1:
        facts.append(f"step {session.index + 1} of {len(session.deformation.steps)}")
    if step.extrusion == "interpolate":
        facts.append(f"key {session.key + 1} of {len(step.maps)}")
    if edit_ms is not None:
        facts.append(f"edit {edit_ms:.0f} ms")
    return " \u00b7 ".join(facts)


def side_by_side(editor: Any, view: AbstractView, width: int) -> NDArray[np.uint8]:
    """Picture and volume as an image, (height, width, 3)."""
    from PIL import Image

    left = Image.open(io.BytesIO(editor.preview_png())).convert("RGB")
    height = round(width / 2 * left.height / left.width)
    left = left.resize((width // 2, height), Image.Resampling.LANCZOS)
    return np.concatenate([np.asarray(left), view.still((width - width // 2, height))], axis=1)
