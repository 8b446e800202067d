"""The application: a studio whose widgets are used in one thread, its page, and its start from the command line.

An edit that takes a second so never blocks the server.
"""

from __future__ import annotations

import asyncio
import contextlib
import html
import math
import os
import sys
import tempfile
import webbrowser
from collections.abc import Callable, Iterator
from os import PathLike
from pathlib import Path
from typing import Any

from deformnb.app import IDLE_MINUTES
from deformnb.app.bridge import Bridge
from deformnb.datasets.phantoms import PHANTOMS
from deformnb.document.deformation import Deformation
from deformnb.errors import DeformError
from deformnb.session.session import Session
from deformnb.volume.channels import ChannelsLike
from deformnb.volume.plane import VIEWS
from deformnb.volume.volume import Volume
from deformnb.widgets.cell_widgets import owned_widgets
from deformnb.widgets.studio.studio import Studio
from deformnb.widgets.web.guard import checked_host, is_loopback
from deformnb.widgets.web.server import PageServer
from deformnb.widgets.worker import Worker


class Application:
    """A studio, and the thread in which the messages of pages reach its widgets.

    Parameters
    ----------
    volume : the volume to deform.
    deformation : the one to start from; default is none.
    side : of the first picture, a name of :data:`~deformnb.volume.plane.VIEWS`; default is the one that shows most.
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
        side: str | None = None,
        viewer: str = "live",
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


def check_app(host: str, port: int, side: str | None, idle: float = IDLE_MINUTES) -> str:
    """The address to listen at, or the error in the options, before a volume is read.

    Raises
    ------
    DeformError
        For an address, a port, a side or a time that cannot be.
    """
    if not 0 <= port < 2**16:
        raise DeformError(f"a port is a number from 0 to 65535, got {port}; 0 takes a free one.")
    if side is not None and side not in VIEWS:
        raise DeformError(f"unknown side {side!r}; choose one of {', '.join(VIEWS)}.")
    if not (idle >= 0 and math.isfinite(idle)):
        raise DeformError(f"--idle takes minutes, 0 for never, got {idle:g}.")
    return checked_host(host)


def app_server(
    app: Application, *, host: str = "127.0.0.1", port: int = 0, idle: float = 60 * IDLE_MINUTES
) -> PageServer:
    """A server of the page with this application; see :class:`~deformnb.widgets.web.server.PageServer`."""

    def make(server: PageServer) -> Bridge:
        bridge = Bridge(app.studio, app.thread, server)
        _build_client(server.trame, app)
        app.studio.observe(lambda _change: server.call_in_loop(_set_title, server.trame, app), "children")
        return bridge

    return PageServer(make, host=host, port=port, idle=idle)


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


def open_app(
    volume: ChannelsLike,
    deformation: Deformation | None = None,
    *,
    side: str | None = None,
    viewer: str = "live",
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
    if not is_loopback(host):
        _print(f"warning: anyone who reaches {host} and has the address below can use this session, unencrypted.")
    app = Application(volume, deformation, side=side, viewer=viewer, language=language)
    try:
        server = app_server(app, host=host, port=port, idle=60 * idle)
        with contextlib.ExitStack() as stack:

            def ready(url: str) -> None:
                announce(url, idle, stack if browser else None)
                app.studio.warm_up()  # while the browser starts

            asyncio.run(server.run(ready))
    except OSError as error:
        raise DeformError(
            f"{host} port {port or 'any'} cannot be had: {error.strerror or error}; choose another --port."
        ) from None
    finally:
        app.close()
    _print(f"stopped: {server.reason}.")


def _print(text: str) -> None:
    with contextlib.suppress(OSError):  # the terminal is closed
        sys.stderr.write(f"deformnb: {text}\n")
        sys.stderr.flush()


def announce(url: str, idle: float, stack: contextlib.ExitStack | None) -> None:
    """Print where the page is, and open it in a browser until the stack ends."""
    sys.stdout.write(f"{url}\n")  # once, and never into a log: anyone with it can open the session
    sys.stdout.flush()
    alone = f", and so do {idle:g} minutes without a page (--idle)" if idle else ""
    _print(f"open this address in a browser of this machine; Ctrl-C ends it{alone}.")
    if stack is not None:
        webbrowser.open(stack.enter_context(_redirect_file(url)).as_uri())


@contextlib.contextmanager
def _redirect_file(url: str) -> Iterator[Path]:
    """A file that leads to the address: arguments of a program, such as a browser, can be read by other users."""
    handle, name = tempfile.mkstemp(prefix="deformnb-", suffix=".html")  # only its owner may read it
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(
                f'<!doctype html><meta charset="utf-8"><meta http-equiv="refresh" '
                f'content="0; url={html.escape(url)}"><title>deformnb</title>'
            )
        yield Path(name)
    finally:
        Path(name).unlink(missing_ok=True)
