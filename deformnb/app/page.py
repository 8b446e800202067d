"""Page of the application: the studio over the whole window."""

from __future__ import annotations

from typing import Any

from deformnb.app.application import Application


def build_page(server: Any, app: Application) -> None:
    """Give trame's server the page of an application.

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


def name_page(server: Any, app: Application) -> None:
    """Name the page after the volume that is open now; in the server's thread."""
    with server.state:
        server.state.trame__title = _title(app)


def _title(app: Application) -> str:
    return f"{app.session.volume.name or 'volume'} - deformnb"
