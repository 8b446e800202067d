"""Scene of a view with the thread that draws it, from the first requested picture until no client is left."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from deformnb.errors import DeformError
from deformnb.rbf.fields import AbstractField
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.vtk.render_loop import SceneLoop

_Result = TypeVar("_Result")


@dataclass(frozen=True, eq=False)
class SceneContent:
    """Content of a scene.

    Parameters
    ----------
    volume : before the deformation.
    field : makes the deformation, a backward field in space, or None for the volume as it is; in the drawing thread.
    output : its box is what can be seen; None for the volume's own.
    """

    volume: Volume
    field: Callable[[], AbstractField | None] = lambda: None
    output: Grid | None = None

    @property
    def box(self) -> Grid:
        """The grid whose box is seen."""
        return self.output or self.volume.grid

    def apply_to(self, scene: Any) -> None:
        """Have a scene show this."""
        if scene.volume is not self.volume:
            scene.set_volume(self.volume)
        scene.set_field(self.field(), self.output)


class SceneHost:
    """Life of a scene and its thread; may be used by several threads.

    Parameters
    ----------
    start : makes the loop of the scene.
    is_visible : whether a front end shows the scene, so that changes are drawn and make it if need be.

    Attributes
    ----------
    content : of the scene; None before the first volume.
    loop : that of the scene; None while there is none.
    """

    def __init__(self, start: Callable[[], SceneLoop], is_visible: Callable[[], bool]) -> None:
        self._start, self._is_visible = start, is_visible
        self._lock = threading.RLock()  # callbacks run in another thread than cells, and pictures in a third
        self.content: SceneContent | None = None
        self.loop: SceneLoop | None = None
        self._is_closed = False

    def ready(self) -> SceneContent:
        """The content; DeformError without one."""
        if self.content is None:
            raise DeformError("the view shows no volume yet; call show(volume) first.")
        return self.content

    def put_field(self, field: Callable[[], AbstractField | None]) -> None:
        """Have another field in the content; the scene is not changed by that."""
        with self._lock:
            self.content = replace(self.ready(), field=field)

    def _wake(self) -> SceneLoop:
        self.ready()
        with self._lock:
            if self._is_closed:
                raise DeformError("the view is closed; make a new one.")
            if self.loop is None:
                self.loop = self._start()
            return self.loop

    def do(self, function: Callable[[Any], _Result]) -> _Result:
        """Call ``function(scene)`` in the thread that draws, after all changes so far, and return its result."""
        return self._wake().do(function).result()

    def change(self, key: str, function: Callable[[Any], None]) -> None:
        """Change the scene by ``function(scene)`` before the next picture, instead of what waits under this key."""
        if self._is_closed:  # a front end's mouse may send events for a moment
            return
        is_visible = self._is_visible()
        loop = self._wake() if is_visible and self.content is not None else self.loop
        if loop is not None:
            loop.change(key, function, draw=is_visible)

    def touch(self) -> None:
        """Draw again, soon, if anything is drawn."""
        loop = self.loop
        if loop is not None:
            loop.touch()

    def rest(self) -> None:
        """End the thread and give the scene back, until either is wanted again."""
        with self._lock:
            loop, self.loop = self.loop, None
        if loop is not None:
            loop.close()

    def close(self) -> None:
        """End both for good."""
        with self._lock:
            self._is_closed = True
        self.rest()
