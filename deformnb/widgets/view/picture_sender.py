"""Sender of a view's pictures, notices and badge, by the notebook's own channel or by another transport."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from deformnb.widgets.camera import COMPARISONS, comparison_image
from deformnb.widgets.messages.views import Badge, Notice, TrameAddress
from deformnb.widgets.view.transport import FrameSender
from deformnb.widgets.vtk.render_loop import Frame


class PictureSender:
    """Sends all that the front ends of a view show.

    Parameters
    ----------
    post : sends a message of the view, and its buffers.

    Attributes
    ----------
    frames : their flow.
    badge : remark on the pictures: that the map folds; shown_camera : whose camera the scene has, and its number.
    carrier : of pictures that do not go by ``post``; None where all do.
    """

    def __init__(self, post: Callable[..., None]) -> None:
        self._post = post
        self.frames = FrameSender()
        self.carrier: Any = None
        self.badge = self._notice = ""
        self.shown_camera: tuple[str, int] = ("", 0)

    def greet(self) -> None:
        """Send a new front end the last messages to the others."""
        for message in (Notice(text=self._notice), Badge(text=self.badge)):
            if message.text:
                self._post(message)

    def open_carrier(self, make: Callable[[], Any], view: str, origin: str | None) -> None:
        """Send a front end of this origin the address from which its frame gets the pictures."""
        self.carrier = self.carrier or make()
        self.carrier.open(origin, lambda url: self._post(TrameAddress(view=view, url=url)))

    def deliver(self, frame: Frame, shows: str) -> None:
        """Send a picture, or two of one place."""
        view, number = self.shown_camera
        if self.carrier is not None and shows in COMPARISONS and len(frame.images) == 2:
            deformed, original = frame.images  # its client has no line to drag: it is in the middle
            frame = replace(frame, images=(comparison_image(shows, original, deformed),))
        message, pictures = self.frames.pack(frame, camera=number, by=view)
        if self.carrier is None:
            self._post(message, pictures)
        else:
            self.carrier.deliver(message, pictures, frame)

    def show_notice(self, notice: str) -> None:
        """Send a sentence on what went wrong, also to front ends that come later."""
        self._notice = notice
        self._post(Notice(text=notice))

    def show_badge(self, text: str) -> None:
        """Send a remark on the pictures, if it has changed."""
        if text != self.badge:
            self.badge = text
            self._post(Badge(text=text))

    def close(self) -> None:
        """End the transport, and release the pictures."""
        self.frames.forget()
        carrier, self.carrier = self.carrier, None
        if carrier is not None:
            carrier.close()
