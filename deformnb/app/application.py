"""The application without its server: a studio whose widgets are used in one thread, as a kernel would.

An edit that takes a second so never keeps the server from answering.
"""

from __future__ import annotations

from os import PathLike

from deformnb.document.deformation import Deformation
from deformnb.session.session import Session
from deformnb.volume.channels import ChannelsLike
from deformnb.widgets.cell_widgets import parts_of_another
from deformnb.widgets.studio.studio import Studio
from deformnb.widgets.worker import Worker


class Application:
    """A studio, and the thread in which the messages of pages reach its widgets.

    Parameters
    ----------
    volume : what is deformed.
    deformation : to go on with; default is none.
    side : of the first picture, a name of :data:`~deformnb.volume.plane.VIEWS`; default is the one that shows most.
    viewer : "live" or "vtk": who draws the volume, see :data:`deformnb.app.VIEWERS`.
    folder : where the controls save files.
    language : of the page, a code of :data:`~deformnb.words.LANGUAGES`; default is the one that was chosen.

    Attributes
    ----------
    studio : the same as in a notebook.
    thread : where whatever a page requests is done.

    Examples
    --------
    >>> from deformnb.datasets import PHANTOMS
    >>> app = Application(PHANTOMS["bar"].make((8, 8, 8)))
    >>> app.thread.call(lambda: len(app.session.editing.points)).result()
    4
    >>> app.close()
    """

    def __init__(
        self,
        volume: ChannelsLike,
        deformation: Deformation | None = None,
        *,
        side: str | None = None,
        viewer: str = "live",
        folder: str | PathLike[str] = ".",
        language: str | None = None,
    ) -> None:
        with parts_of_another():
            self.studio = Studio(volume, deformation, side=side, view=viewer, folder=folder, language=language)
        self.thread = Worker("deformnb-application")

    @property
    def session(self) -> Session:
        """The document and its history."""
        return self.studio.session

    def close(self) -> None:
        """End the threads; what was not saved stays in the history of who opens the volume again."""
        self.thread.close()
        self.studio.close()
