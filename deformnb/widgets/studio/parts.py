"""The parts of a studio: all that another session brings with it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from deformnb.session.session import Session
from deformnb.widgets.inputs.transfer_editor import TransferEditor
from deformnb.widgets.studio.editors import StudioEditors, StudioEdits, StudioPicture
from deformnb.widgets.studio.layout import StudioPanels
from deformnb.widgets.studio.save_restore import RestoreBar
from deformnb.widgets.studio.slices import StudioSlices
from deformnb.widgets.studio.status import StudioStatus
from deformnb.widgets.studio.sync import StudioSync
from deformnb.widgets.studio.view_sync import StudioLink
from deformnb.widgets.worker import Worker


@dataclass(eq=False)
class StudioParts:
    """The parts of a studio for one session; a studio that goes on with another volume takes others.

    Parameters
    ----------
    session : the document and its history.
    view : of the volume; link : shows the displacement there.
    words : the status line and the messages.
    worker : the studio's thread.
    editors : of the points; edits : take what is done in them; picture : behind the points.
    slices : in the place of the view.
    opacity : the editor of colours and opacities.
    panels : the controls.
    sync : shows every change of the session.
    ends : end what runs of the parts.
    bar : writes the session; made when that of the session before has written its own.
    """

    session: Session
    view: Any
    words: StudioStatus
    worker: Worker
    edits: StudioEdits
    editors: StudioEditors
    link: StudioLink
    picture: StudioPicture
    slices: StudioSlices
    opacity: TransferEditor
    panels: StudioPanels
    sync: StudioSync
    ends: Sequence[Callable[[], None]]
    bar: RestoreBar | None = None

    def close(self) -> None:
        """End the thread and stop observing; the widgets close with the studio's children."""
        end_all(self.ends)

    def leave_view(self) -> None:
        """Take the view out of its place, for a studio that shows it elsewhere."""
        self.editors.beside.children = ()


def end_all(ends: Sequence[Callable[[], None]]) -> None:
    """End what runs, in this order."""
    for end in ends:
        end()
