"""Jupyter Server extension that sends small messages without delay.

A kernel replies to a widget with several small messages in a row. TCP with Jupyter's settings delays the second of them
until the front end has acknowledged the first (Nagle's algorithm), and the front end's side waits up to 40 ms before
it does. A dragged point is delayed by that wait at every step. The extension switches it off (TCP_NODELAY) for the
websockets of kernels and changes nothing else.

It comes with the package: ``etc/jupyter/jupyter_server_config.d/deformnb.json`` enables it for JupyterLab, Notebook 7
and Voila inside either. Voila alone loads no extensions; the class can be named to it instead::

    voila --Voila.kernel_websocket_connection_class=deformnb.server_extension.PromptConnection notebook.ipynb
"""

from __future__ import annotations

from functools import cache
from typing import Any

_SETTING = "kernel_websocket_connection_class"


def _jupyter_server_extension_points() -> list[dict[str, str]]:
    return [{"module": "deformnb.server_extension"}]


def _load_jupyter_server_extension(app: Any) -> None:
    """Let the server make prompt connections, unless another class is configured for them."""
    try:
        from jupyter_server.services.kernels.connection.channels import ZMQChannelsWebsocketConnection as Usual
    except ImportError:  # a server before 2.0 has no such setting
        app.log.info("deformnb: this Jupyter Server cannot send small messages without delay; all else works.")
        return
    settings = app.web_app.settings
    if settings.get(_SETTING) is Usual:  # a gateway's class, or another extension's, has precedence
        settings[_SETTING] = _prompt_connection()
        app.log.info("deformnb: small messages of kernels are sent without delay.")


@cache
def _prompt_connection() -> Any:
    """The class of the connections; made here because Jupyter Server need not be installed to read this file."""
    from jupyter_server.services.kernels.connection.channels import ZMQChannelsWebsocketConnection

    class PromptConnection(ZMQChannelsWebsocketConnection):
        """A kernel's websocket that delays no small message."""

        def connect(self) -> Any:
            try:
                self.websocket_handler.set_nodelay(True)
            except Exception as error:  # a slower connection is better than none
                self.log.debug("deformnb: TCP_NODELAY could not be set: %s", error)
            return super().connect()

    return PromptConnection


def __getattr__(name: str) -> Any:
    """``PromptConnection``, for those who name it in a configuration."""
    if name == "PromptConnection":
        return _prompt_connection()
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
