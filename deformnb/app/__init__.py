"""Web application without Jupyter, served by trame: ``deformnb app FILE SESSION``.

A picture with points to drag, the volume next to it, and the settings of a session, served by trame to the
browsers of this machine. The edits and the state are those of a :class:`Session`, as in a notebook.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from deformnb.devices import add_device
from deformnb.words import LANGUAGES

IDLE_MINUTES = 240.0
"""The server ends when no client was connected for so long; a lesson begins an hour after it was started."""

VIEWERS = ("live", "vtk")
"""Renderers of the volume: in the client, or by VTK on the server, which sends pictures."""


def add_language(parser: Any) -> None:
    """Add the option ``--language`` to an argument parser.

    Examples
    --------
    >>> import argparse
    >>> parser = argparse.ArgumentParser()
    >>> add_language(parser)
    >>> parser.parse_args(["--language", "de"]).language
    'de'
    """
    parser.add_argument(
        "--language",
        choices=tuple(LANGUAGES),
        help="language of the words that are seen (default: that of DEFORMNB_LANGUAGE, or else en)",
    )


def add_app(commands: Any, run: Callable[[Any], None]) -> None:
    """Add ``app`` to the commands of an argument parser.

    Parameters
    ----------
    run : called with the options.
    """
    what = "open the tool in a web page, without Jupyter"
    p = commands.add_parser(
        "app",
        help=what,
        description=f"""{what[0].upper()}{what[1:]}: drag points on a picture of
        the volume and watch the volume follow. Only this machine reaches the page, by the address that is printed.""",
    )
    p.add_argument("file", nargs="?", metavar="FILE", help="a volume (default: a synthetic carp)")
    p.add_argument("session", nargs="?", metavar="SESSION", help="a saved session to continue")
    p.add_argument(
        "--spacing",
        type=float,
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="true voxel size of the input, where its file is wrong",
    )
    p.add_argument("--labels", action="store_true", help="the volume holds labels: preserve their values")
    p.add_argument(
        "--level",
        type=int,
        metavar="N",
        help="level of a pyramid (OME-Zarr) that is shown and edited, 0 "
        "for the finest (default: the finest that fits into memory)",
    )
    p.add_argument("--side", help="side of the first picture: +x -x +y -y +z -z (default: the one that shows most)")
    p.add_argument(
        "--view",
        choices=VIEWERS,
        default="live",
        dest="viewer",
        help="render the volume in the browser (live) or by VTK here (vtk; needs OpenGL) (default %(default)s)",
    )
    p.add_argument("--port", type=int, default=0, help="port to listen at (default: a free one)")
    p.add_argument(
        "--host",
        default="127.0.0.1",
        help="address to listen at; another than the default lets others in "
        "who know the password (default %(default)s)",
    )
    p.add_argument("--no-browser", action="store_true", help="print the address and open nothing")
    p.add_argument(
        "--idle",
        type=float,
        default=IDLE_MINUTES,
        metavar="MINUTES",
        help="end when no page was connected for so long; 0 never does (default %(default)g)",
    )
    add_language(p)
    add_device(p)
    p.set_defaults(run=run)
