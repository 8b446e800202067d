"""A studio without a browser: the messages of its front end, and the places of its panels."""

from __future__ import annotations

from typing import Any
from unittest import mock

import numpy as np
from comm import get_comm_manager
from front_end import deliver
from waiting import PATIENCE, wait_for  # noqa: F401  (with the other helpers of a studio's tests)

from deformnb.session.autosave import Autosave
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets import Studio
from deformnb.widgets.basic_widgets import shared_models
from deformnb.widgets.boxes import Box
from deformnb.widgets.messages.points import points_to_json


def a_volume() -> Volume:
    z, y, x = np.mgrid[:16, :20, :24]
    values = 200 * (((z - 8) / 6) ** 2 + ((y - 10) / 7) ** 2 + ((x - 12) / 10) ** 2 < 1)
    return Volume((values + (x % 4) * 8 * (values > 0)).astype(np.uint8), Grid((16, 20, 24), (1.0, 1.0, 1.0)), "ball")


SEQ = iter(range(1, 10**6))


def post(studio: Studio, content: dict[str, Any], editor: Any = None) -> None:
    """Send a message as the front end of an editor, by default of the visible one."""
    deliver(editor or studio.editor, {"sender": "test", "seq": next(SEQ), **content})


def open_widgets() -> set[str]:
    """Ids of the widgets that are open, without the layouts and styles that all of them share."""
    return set(get_comm_manager().comms) - {model.model_id for model in shared_models()}


def get_notice(studio: Studio) -> str:
    """The line of the last action."""
    return str(studio.parts.words.notice.value)


def get_status(studio: Studio) -> str:
    """The line of the state: points, folds, speed."""
    return str(studio.parts.words.status.value)


def drag(studio: Studio, points: Any, kind: str = "move", editor: Any = None, **more: Any) -> None:
    """Send the end of a drag as the front end of an editor."""
    post(
        studio,
        {
            "type": "edit",
            "phase": "end",
            "kind": kind,
            "joins": False,
            "next_id": points.next_id,
            "points": points_to_json(points),
            **more,
        },
        editor,
    )


def a_drag(studio: Studio, by: float = 2.0) -> Any:
    points = studio.editor.points
    if len(points) == 4:
        points = points.add(points.target.mean(axis=0))
    return points.move(points.ids[-1], points.target[-1] + np.array([by, by / 2, 0.0])[: points.dim])


def controls(studio: Studio) -> dict[str, Any]:
    """All controls by their description."""
    bound = [c.widget for panel in panels(studio) for c in panel.controls]
    return {widget.description: widget for widget in bound if hasattr(widget, "description")}


def panel(studio: Studio, title: str) -> Any:
    """A panel by the title of its tab."""
    return next(found for found in panels(studio) if found.title == title)


def panels(studio: Studio) -> list[Any]:
    """All panels; those that nobody has seen yet are made."""
    return [*studio.parts.panels.initial, *(late.panel for late in studio.parts.panels.late)]


def find_panel(studio: Studio, kind: type[Any]) -> Any:
    """The panel of a kind."""
    return next(found for found in panels(studio) if isinstance(found, kind))


def walk(widget: Any) -> list[Any]:
    """A widget and all in it."""
    return [widget, *(found for child in getattr(widget, "children", ()) for found in walk(child))]


def find_box(studio: Studio, name: str) -> Any:
    """The box of a studio with this class name in the front end."""
    return next(box for box in walk(studio) if name in get_classes(box))


def get_classes(widget: Any) -> tuple[str, ...]:
    """The class names of a widget in the front end."""
    return widget.classes if isinstance(widget, Box) else tuple(widget.get_state().get("_dom_classes", ()))


def act(items: Any, what: str, index: int, value: Any = None) -> None:
    """Send a click as the front end of a list."""
    message = {"type": "act", "what": what, "index": index, "value": value, "version": items.version}
    deliver(items, message)


def crash(saving: Autosave) -> None:
    """Leave the files of a session as if its process had been killed."""
    with mock.patch("deformnb.session.autosave.mark"):  # nothing records that it was closed
        finish(saving)


def finish(saving: Autosave) -> None:
    """Close it and wait for its last file: users wait a second for it at most, and a busy machine takes longer."""
    assert saving.close(PATIENCE)
