"""Plane of the edited picture in a view: its frame, and the choice of another plane by the camera."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import traitlets
from msgspec import UNSET

from deformnb.volume.plane import Plane
from deformnb.widgets.camera import checked_camera
from deformnb.widgets.messages.views import EditView

ViewPart = tuple[tuple[float, float, float], float]
"""Part of a view that is seen: the place in space in its middle, and the CSS pixels of a unit of length."""

CameraCallback = Callable[[dict[str, Any], ViewPart | None], None]
"""Called with the camera whose picture should be edited, as the trait ``camera`` holds it, and the part seen by it."""


class ShowsPlane(traitlets.HasTraits):
    """A view in which the frame of a picture is seen, and whose camera can become the next picture.

    Attributes
    ----------
    picture_plane : {} or ``{"corners": four places in space, clockwise from the left one at the top, "direction": of
        view, "up": vector, "name": of the side or of the step, "named": whether by a user, "side": whether it is one of
        the six, "editable": whether a callback answers}``; without corners for points in space.
    plane_frame : whether the frame of the picture is drawn; None draws it for oblique planes.
    """

    picture_plane = traitlets.Dict(help="place and name of the picture that is edited").tag(sync=True)
    plane_frame = traitlets.Bool(None, allow_none=True, help="whether its frame is drawn").tag(sync=True)

    def __init__(self, *given: Any, **traits: Any) -> None:
        self._edit_view_callbacks: list[CameraCallback] = []
        super().__init__(*given, **traits)

    def show_plane(
        self,
        plane: Plane | None,
        box: tuple[float, float, float, float] | None = None,
        name: str = "",
        *,
        is_named: bool = False,
        is_side: bool = False,
    ) -> None:
        """Show the place of the picture that is edited, and offer to edit the picture of the camera instead.

        Parameters
        ----------
        plane : of the picture; None for points in space.
        box : (a0, a1, b0, b1), its edges on the plane.
        name : of the side, or of the step; is_named : by a user.
        is_side : whether it is one of the six sides.
        """
        corners, ways = [], {}
        if plane is not None and box is not None:
            a0, a1, b0, b1 = box
            corners = plane.from_plane([(a0, b0), (a1, b0), (a1, b1), (a0, b1)]).tolist()
            ways = {"direction": list(plane.normal), "up": [-c + 0.0 for c in plane.v]}
        self.picture_plane = {
            "corners": corners,
            "name": name,
            "named": is_named,
            "side": is_side,
            "editable": bool(self._edit_view_callbacks),
            **ways,
        }

    def on_edit_view(self, callback: CameraCallback, remove: bool = False) -> None:
        """Call ``callback(camera, part)`` when a user wants to edit the picture that the camera sees."""
        if remove:
            self._edit_view_callbacks.remove(callback)
        else:
            self._edit_view_callbacks.append(callback)

    def edit_view(self, message: EditView) -> None:
        """Take the wish of a front end."""
        camera, part = checked_camera(message.camera.value()), None
        if message.middle is not UNSET and message.scale is not UNSET and message.scale > 0:
            x, y, z = message.middle
            part = ((x, y, z), message.scale)
        for callback in tuple(self._edit_view_callbacks):
            callback(camera, part)
