"""OpenGL contexts of other programs in a thread where VTK draws, and the class of the windows of VTK."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Any

_LIBRARIES = ("libGLX.so.0", "libGL.so.1")  # with the functions of GLX; drivers without libglvnd have the second alone
WINDOW_CLASS = "VTK_DEFAULT_OPENGL_WINDOW"  # the environment variable that VTK reads for each window
_BINDINGS = ("PySide6", "PyQt6", "PyQt5", "PySide2")  # of Qt
_environment = Lock()


@contextmanager
def use_window_class(name: str) -> Iterator[None]:
    """Have VTK make windows of this class, unless the user's environment names one.

    It holds for the block alone: with the class that draws off screen in the environment, ``pyvista.Plotter().show()``
    of the same process would open no window.
    """
    with _environment:
        is_chosen = WINDOW_CLASS in os.environ
        os.environ.setdefault(WINDOW_CLASS, name)
        try:
            yield
        finally:
            if not is_chosen:
                del os.environ[WINDOW_CLASS]


def _load_glx() -> Any:
    """The functions of GLX in the library that this process has loaded; None where it has loaded none."""
    if not sys.platform.startswith("linux"):
        return None
    for name in _LIBRARIES:
        try:
            library = ctypes.CDLL(name, mode=os.RTLD_NOLOAD | os.RTLD_LAZY)
            library.glXGetCurrentDisplay.restype = ctypes.c_void_p
            library.glXMakeCurrent.argtypes = [ctypes.c_void_p, ctypes.c_ulong, ctypes.c_void_p]
        except (OSError, AttributeError):
            continue
        return library
    return None


def _release_glx() -> None:
    """Release the GLX context that is current in this thread, through Qt where it is Qt's, which remembers it."""
    glx = _load_glx()
    if glx is None:
        return
    for binding in _BINDINGS:
        context = getattr(sys.modules.get(f"{binding}.QtGui"), "QOpenGLContext", None)
        current = None if context is None else context.currentContext()
        if current is not None:
            current.doneCurrent()
    display = glx.glXGetCurrentDisplay()
    if display is not None:
        glx.glXMakeCurrent(display, 0, None)


@contextmanager
def separate_from_glx(release: Callable[[], None]) -> Iterator[None]:
    """Draw with EGL in this block, in a thread where other programs draw with GLX.

    Qt leaves its context current between two pictures, napari's for instance. EGL, by which VTK draws off screen,
    cannot make another one current beside it, VTK does not notice, and draws into Qt's window; and where one of EGL is
    current, Qt's first window ends the process. All make theirs current before they draw, so that none need be current
    outside of the block.

    Parameters
    ----------
    release : releases the context of the block.
    """
    _release_glx()
    try:
        yield
    finally:
        if sys.platform.startswith("linux"):  # elsewhere all have the same interface, which exchanges contexts
            release()
