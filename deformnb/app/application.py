"""The application: a studio whose widgets are used in one thread, its page, and its start from the command line.

An edit that takes a second so never blocks the server.
"""

from __future__ import annotations

import asyncio
import base64
from collections.abc import Callable
from os import PathLike
from typing import Any

from deformnb.app import IDLE_MINUTES
from deformnb.app.bridge import Bridge
from deformnb.app.start import StartServer, check_app, port_error, print_line, starting
from deformnb.datasets.phantoms import PHANTOMS
from deformnb.document.deformation import Deformation
from deformnb.imaging.preview import draw_preview
from deformnb.imaging.projection import project
from deformnb.rbf.points import ControlPoints
from deformnb.session.inputs import as_volume_and_channels, best_view, subject_from
from deformnb.session.session import Session
from deformnb.volume.channels import ChannelsLike
from deformnb.volume.views import ViewName
from deformnb.volume.volume import Volume
from deformnb.widgets.cell_widgets import owned_widgets
from deformnb.widgets.image_encoding import as_jpeg
from deformnb.widgets.studio.studio import Studio, ViewKind
from deformnb.widgets.web.server import PageServer
from deformnb.widgets.worker import Worker

STILL_SIZE = 480
"""Longer side in pixels of the picture that is seen until the studio is."""


class Application:
    """A studio, and the thread in which the messages of pages reach its widgets.

    Parameters
    ----------
    volume : the volume to deform.
    deformation : the one to start from; default is none.
    side : of the first picture, a name of :data:`~deformnb.volume.views.VIEWS`; default is the one that shows most.
    viewer : "live" or "vtk": the renderer of the volume, see :data:`deformnb.app.VIEWERS`.
    folder : where the controls save files.
    language : of the page, a code of :data:`~deformnb.words.LANGUAGES`; default is the one that was chosen.

    Attributes
    ----------
    studio : the same as in a notebook.
    thread : executes the requests of clients.

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
        side: ViewName | None = None,
        viewer: ViewKind = "live",
        folder: str | PathLike[str] = ".",
        language: str | None = None,
    ) -> None:
        with owned_widgets():
            self.studio = Studio(volume, deformation, side=side, view=viewer, folder=folder, language=language)
        self.thread = Worker("deformnb-application")

    @property
    def session(self) -> Session:
        """The document and its history."""
        return self.studio.session

    def close(self) -> None:
        """End the threads; unsaved edits stay in the history of the volume."""
        self.thread.close()
        self.studio.close()


def app_server(
    app: Application, *, host: str = "127.0.0.1", port: int = 0, idle: float = 60 * IDLE_MINUTES, **options: Any
) -> PageServer:
    """A server of the page with this application; options are those of a
    :class:`~deformnb.widgets.web.server.PageServer`.
    """

    def make(server: PageServer) -> Bridge:
        bridge = Bridge(app.studio, app.thread, server)
        _build_client(server.trame, app)
        app.studio.observe(lambda _change: server.call_in_loop(_set_title, server.trame, app), "children")
        return bridge

    return PageServer(make, host=host, port=port, idle=idle, **options)


def _build_client(server: Any, app: Application) -> None:
    """Register the client of an application with trame's server.

    Parameters
    ----------
    server : trame's, before it starts.
    app : whose volume names the page.
    """
    from trame.ui.html import DivLayout
    from trame_client.widgets.core import AbstractElement

    server.enable_module({"scripts": ["deformnb/app.js"], "styles": ["deformnb/app.css"], "vue_use": ["deformnb_app"]})
    server.state.trame__title = _title(app)
    server.state.trame__template_error_reconnect = "<deformnb-lost></deformnb-lost>"  # trame's own empties the page
    with DivLayout(server):
        AbstractElement("deformnb-studio")


def _set_title(server: Any, app: Application) -> None:
    """Set the title of the client to the name of the open volume; in the server's thread."""
    with server.state:
        server.state.trame__title = _title(app)


def _title(app: Application) -> str:
    return f"{app.session.volume.name or 'volume'} - deformnb"


def synthetic_carp(progress: Callable[[float], None] | None = None) -> Volume:
    """The volume where none is given."""
    return PHANTOMS["fish"].make(progress=progress)


def still_of(volume: ChannelsLike, side: ViewName | None = None) -> str:
    """URL of a picture of a volume, of few pixels, which is seen until a page shows the studio."""
    given, _ = as_volume_and_channels(subject_from(volume))
    picture = project(given, side or best_view(given), method="mip")
    small = draw_preview(picture, [], ControlPoints.empty(2), STILL_SIZE)
    return f"data:image/jpeg;base64,{base64.b64encode(as_jpeg(small)).decode()}"


def open_app(
    volume: ChannelsLike,
    deformation: Deformation | None = None,
    *,
    side: ViewName | None = None,
    viewer: ViewKind = "live",
    host: str = "127.0.0.1",
    port: int = 0,
    browser: bool = True,
    idle: float = IDLE_MINUTES,
    language: str | None = None,
) -> None:
    """Serve the tool for a volume until it is stopped, by Ctrl-C, by the end of the terminal, or left alone.

    Parameters
    ----------
    volume : the volume to deform.
    deformation : the one to start from.
    side : side of the first picture; default is the one that shows most.
    viewer : "live" or "vtk", see :data:`deformnb.app.VIEWERS`.
    host, port : where to listen; port 0 takes a free one.
    browser : whether to open a browser.
    idle : minutes without a page after which it ends; 0 never does.
    language : of the page, a code of :data:`~deformnb.words.LANGUAGES`; default is the one that was chosen.

    Raises
    ------
    DeformError
        If the address or the port cannot be had.
    """
    host = check_app(host, port, side, idle)
    name = getattr(volume, "name", "") or "volume"
    with starting(name, host=host, port=port, browser=browser, idle=idle, language=language) as start:
        serve_app(volume, deformation, start, side=side, viewer=viewer, idle=idle, language=language)


def serve_app(
    volume: ChannelsLike,
    deformation: Deformation | None,
    start: StartServer,
    *,
    side: ViewName | None = None,
    viewer: ViewKind = "live",
    idle: float = IDLE_MINUTES,
    language: str | None = None,
) -> None:
    """Serve the tool in place of the page of its start, as :func:`open_app` does.

    Parameters
    ----------
    start : whose address and password it takes.

    Raises
    ------
    DeformError
        If the port was taken by another program meanwhile.
    """
    start.facts["still"] = still_of(volume, side)
    start.progress("Opening the studio …")
    app = Application(volume, deformation, side=side, viewer=viewer, language=language)
    try:
        facts = {"name": start.facts["name"], "still": start.facts["still"]}
        server = app_server(
            app, host=start.host, port=start.port, idle=60 * idle, token=start.token, earlier=start.earlier, facts=facts
        )
        start.close()
        asyncio.run(server.run(lambda url: app.studio.warm_up()))  # while the page loads
    except OSError as error:
        raise port_error(start.host, start.port, error) from None
    finally:
        app.close()
    print_line(f"stopped: {server.reason}.")
