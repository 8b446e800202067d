"""What a view drawn in Python says of folds: whether they shall be red, and the words for the corner of the picture."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import traitlets


class TellsFolds(traitlets.HasTraits):
    """A view that paints red where the map folds, or else says that it folds."""

    show_folds = traitlets.Bool(True).tag(sync=True)

    badge = ""
    """What stands in a corner of the pictures, or an empty text."""

    shows: Any
    send: Callable[..., None]

    def _tell_folds(self, scene: Any) -> None:
        """In the thread that renders, whenever something else is shown."""
        scene.folding.show = self.show_folds
        text = "" if self.shows == "original" else scene.folding.remark
        if text != self.badge:
            self.badge = text
            self.send({"type": "badge", "text": text})
