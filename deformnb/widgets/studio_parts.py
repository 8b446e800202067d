"""What a studio is put together from: its view, the arrangement of its widgets, its status line, its still."""

from __future__ import annotations

import io
import weakref
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import ipywidgets as ipw
import numpy as np
from numpy.typing import NDArray

from deformnb.errors import DeformError
from deformnb.opening import as_volume
from deformnb.session import Session
from deformnb.volume import Volume
from deformnb.widgets.cell_widgets import leave_to_another, parts_of_another
from deformnb.widgets.controls import Panel
from deformnb.widgets.editor import Editor
from deformnb.widgets.judgement import Judgement
from deformnb.widgets.live_view import LiveView
from deformnb.widgets.stills import PREVIEW_SIZE, as_png
from deformnb.widgets.studio_editors import StudioEditors, make_editor
from deformnb.widgets.studio_link import followed_step
from deformnb.widgets.view import AbstractView

WELCOME = ("The points in the corners hold the picture. Double-click on it to add a point, and drag that. To open "
           "something: draw a cut across it, then drag a point on either side of the cut apart.")
"""What a studio says before anything was dragged."""

VIEW_KINDS = ("live", "vtk")
"""Views by name: rendered in the browser, or by VTK in Python."""


def make_view(kind: str | AbstractView, volume: Volume, transfer: Any, height: int) -> Any:
    """A view of the volume by its name in :data:`VIEW_KINDS`, or one that was made by hand."""
    if isinstance(kind, AbstractView):
        if not (isinstance(kind, ipw.DOMWidget) and kind.has_trait("camera")):
            raise DeformError(f"a studio cannot show a {type(kind).__name__}; a view of your own must be a widget with "
                              "a trait named camera, deformnb.widgets.view.CameraTrait().")
        leave_to_another(kind)
        kind.show(volume)
        kind.set_transfer(transfer)
        return kind
    with parts_of_another():
        if kind == "live":
            return LiveView(volume, transfer=transfer, width=720, height=height)
        if kind == "vtk":
            from deformnb.widgets.volume_view import VolumeView

            return VolumeView(volume, transfer=transfer, width=720, height=height)
    raise DeformError(f"unknown view {kind!r}; choose one of {', '.join(VIEW_KINDS)}, or give a view.")


def as_labels(given: Any, volume: Volume) -> Volume | None:
    """A label volume from a volume, a file, or an array that lies as the volume does; None for none."""
    if given is None:
        return None
    if isinstance(given, np.ndarray):
        if given.shape != volume.shape:
            raise DeformError(f"labels of shape {given.shape} do not lie on a volume of {volume.shape}; give a Volume "
                              "with a grid of its own.")
        return Volume(given, volume.grid, "labels")
    return as_volume(given)


def as_target(given: Any, volume: Volume) -> Volume | None:
    """A volume to become alike, from a volume, a file, or an array that lies as the volume does; None for none."""
    if isinstance(given, np.ndarray) and given.shape == volume.shape:
        return Volume(given, volume.grid, "target")
    return None if given is None else as_volume(given)


def last_step(session: Session, editor: Editor, view: Any) -> tuple[Editor, LiveView]:
    """An editor and a live view of the last step in use, whichever is edited: what a page without Python shows.

    What such a page cannot drag (points in space, steps that are added up) is done to its volume beforehand, and the
    page goes on with a picture of that.
    """
    last = followed_step(session.deformation)
    deformed = None if last is not None else session.result()
    whole = Session(deformed or session.volume, None if deformed else session.deformation, view=session.plane)
    whole.method = session.method
    whole.edit_step(last or 0)
    shown = make_editor(whole, editor.height)
    shown.density, shown.theme = editor.density, editor.theme
    with parts_of_another():
        live = LiveView(whole.volume, transfer=session.transfer_function, width=view.width, height=view.height)
    live.camera, live.shows, live.clip = dict(view.camera), view.shows, view.clip
    for name in ("projection", "background", "show_folds"):
        if view.has_trait(name):
            setattr(live, name, getattr(view, name))
    live.follow(shown, whole.field(), whole.key, output=whole.output)
    return shown, live


def arranged(editors: StudioEditors, view: Any, panels: Sequence[Panel], words: ipw.Box) -> list[Any]:
    """Picture and volume side by side, warnings and the first panel below, the others in tabs, and the words."""
    view.layout.width = "100%"
    editors.beside.children = (view,)
    if view.has_trait("fill"):
        view.fill = True  # as high as the picture is
    pictures = ipw.HBox([editors.box, editors.beside],
                        layout=ipw.Layout(flex_flow="row wrap", align_items="stretch", grid_gap="8px"))
    head, *others = panels
    others = [panel for panel in others if panel.title]
    tabs = ipw.Tab([panel.box for panel in others], titles=[panel.title for panel in others],
                   layout=ipw.Layout(width="100%", margin="2px 0"))  # its own margin would make the studio scroll
    tell = _tell_opened(others)
    tell({"new": tabs.selected_index})
    tabs.observe(tell, "selected_index")
    warnings = [panel.warning for panel in panels if panel.warning is not None]
    return [pictures, *warnings, head.box, tabs, words]


def _tell_opened(panels: Sequence[Panel]) -> Callable[[Any], None]:
    """Tells panels which of them is seen; keeps none of them alive."""
    known = [weakref.ref(panel) for panel in panels]

    def chosen(change: Any) -> None:
        for k, reference in enumerate(known):
            panel = reference()
            if panel is not None:
                panel.opened(k == change["new"])
    return chosen


def latency_text(edit_ms: float | None, stats: Mapping[str, Any]) -> str:
    """How long Python took for the last edit, and a picture of the view while something moves; empty for neither.

    Examples
    --------
    >>> latency_text(3.2, {"drag_ms": 41.0})
    'edit 3 ms, volume 41 ms'
    >>> latency_text(None, {"frames": 0})
    ''
    """
    volume_ms = stats.get("drag_ms") or stats.get("frame_ms")
    times = (("edit", edit_ms), ("volume", volume_ms))
    return ", ".join(f"{what} {ms:.0f} ms" if ms >= 1 else f"{what} < 1 ms" for what, ms in times if ms is not None)


def status_text(session: Session, latency: str = "", found: Judgement | None = None) -> str:
    """How many points there are, what is edited, whether it folds and comes back, and how long that took."""
    step = session.step
    moved = int(np.count_nonzero(session.points.displacement.any(axis=1) & session.points.active))
    facts = [f"{len(session.points)} points, {moved} dragged"]
    if len(session.deformation.steps) > 1:
        facts.append(f"step {session.index + 1} of {len(session.deformation.steps)}")
    if step.extrusion == "interpolate":
        facts.append(f"key {session.key + 1} of {len(step.maps)}")
    if step.stages > 1:
        facts.append(f"{step.stages} stages")
    if found is not None:
        facts += [text for text in (found.folds_text, found.trip_text) if text]
    if latency:
        facts.append(latency)
    return " \u00b7 ".join(facts)


def side_by_side(editor: Any, view: AbstractView, width: int) -> NDArray[np.uint8]:
    """Picture and volume as an image, (height, width, 3)."""
    from PIL import Image

    left = Image.open(io.BytesIO(editor.preview_png())).convert("RGB")
    height = round(width / 2 * left.height / left.width)
    left = left.resize((width // 2, height), Image.Resampling.LANCZOS)
    return np.concatenate([np.asarray(left), view.still((width - width // 2, height))], axis=1)


def preview_png(editor: Any, view: Any) -> bytes:
    """Picture and volume side by side as a PNG, from few voxels: it is made before the studio is shown."""
    from PIL import Image

    left = Image.open(io.BytesIO(editor.preview_png())).convert("RGB")
    small = view.preview_png() if hasattr(view, "preview_png") else as_png(view.still(PREVIEW_SIZE))
    right = Image.open(io.BytesIO(small)).convert("RGB")
    left = left.resize((right.width, round(right.width / left.width * left.height)), Image.Resampling.LANCZOS)
    whole = Image.new("RGB", (left.width + right.width, max(left.height, right.height)), left.getpixel((0, 0)))
    for image, x in ((left, 0), (right, left.width)):
        whole.paste(image, (x, (whole.height - image.height) // 2))
    return as_png(np.asarray(whole))
