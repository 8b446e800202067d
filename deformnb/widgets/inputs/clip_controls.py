"""Clipping sliders of a view, moved in the front end: a live view follows them without the kernel."""

from __future__ import annotations

from typing import Any

import ipywidgets
import traitlets

from deformnb.widgets.bundle import bundle
from deformnb.widgets.synced import SyncedWidget


class ClipControls(SyncedWidget):
    """Three sliders with two ends each, a button that opens the volume towards the viewer, and one that closes it.

    Parameters
    ----------
    view : any view with the traits ``clip``, ``camera`` and ``volume_info``; None shows nothing. The front end writes
        its ``clip``, as a program may.

    Examples
    --------
    >>> from deformnb.widgets.view.live_view import LiveView
    >>> view = LiveView()
    >>> ClipControls(view).view is view
    True
    """

    _esm = bundle("clip_controls.js")
    _css = bundle("clip_controls.css")

    view = traitlets.Any(None, allow_none=True).tag(sync=True, **ipywidgets.widget_serialization)

    def __init__(self, view: Any = None, **traits: Any) -> None:
        super().__init__(view=view, **traits)

    def set_state(self, sync_data: Any) -> None:
        """The front end decides on nothing here: the clipping is sent to the view."""
