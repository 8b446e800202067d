"""Base of all widgets: traits that the front end, the kernel's messages and other threads set concurrently.

ipywidgets expects one thread. Studios compute in another, and the two rules that follow are held here for all widgets:

1. A trait that is set while traits are held back (``hold_sync``) reaches the front end, whichever thread sets it.
2. Where Python and the front end set a trait concurrently, the final value of Python is sent last. ipywidgets
   answers a front end before it takes its value: a value that another thread sends between the two would stay there.
"""

from __future__ import annotations

import logging
import threading
from abc import ABCMeta
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, ClassVar

import anywidget
import ipywidgets as ipw
import traitlets
from comm.base_comm import BaseComm

from deformnb.errors import DeformError
from deformnb.widgets.basic_widgets import layout
from deformnb.widgets.messages.record import FRAGMENT_BYTES, Channel, Message, Refused, fragments
from deformnb.widgets.modules import FrontEndModule, module_traits
from deformnb.words import language, word_table

__all__ = ["LocalComm", "SyncedWidget", "translated_by_owner"]

_LOG = logging.getLogger(__name__)

_IS_WORDED = ContextVar("_IS_WORDED", default=False)


@contextmanager
def translated_by_owner() -> Iterator[None]:
    """Context for the parts of another widget: it shows their words in its language too, and they share a layout."""
    before = _IS_WORDED.set(True)
    try:
        yield
    finally:
        _IS_WORDED.reset(before)


class LocalComm(BaseComm):
    """A comm without a kernel: its messages are passed to a function.

    Parameters
    ----------
    post : called with the message's data and its buffers.
    comm_id : by which front ends know it; default is a new one.
    """

    def __init__(self, post: Callable[[dict[str, Any], list[bytes]], None], comm_id: str | None = None) -> None:
        self._post = post
        super().__init__(target_name="deformnb.page", comm_id=comm_id)

    def publish_msg(
        self, msg_type: str, data: Any = None, metadata: Any = None, buffers: Any = None, **keys: Any
    ) -> None:
        """Publish a message of ipywidgets: of the life cycle, the traits, and custom messages."""
        if msg_type == "comm_msg" and data:
            self._post(data, [bytes(buffer) for buffer in buffers or []])


class SyncedWidget(anywidget.AnyWidget):
    """An anywidget whose traits may be set from several threads.

    Attributes
    ----------
    language : its code, chosen by :func:`deformnb.set_language` before the widget is made.
    words : of that language by the English ones, for the front end; empty for English.
    module : its front end, of which widgets of one kernel share a model; None outside of a kernel of Jupyter.
    channel : the messages of its front ends; None where they send none.

    Examples
    --------
    >>> widget = SyncedWidget()
    >>> with widget.hold_sync():
    ...     widget.tooltip = "sent at the end"
    >>> widget.close()
    """

    channel: ClassVar[Channel[Any] | None] = None

    language = traitlets.Unicode().tag(sync=True)
    words = traitlets.Dict().tag(sync=True)
    module = traitlets.Instance(FrontEndModule, allow_none=True).tag(sync=True, **ipw.widget_serialization)

    _holding_sync: bool  # ipywidgets' own mark, as are the names to send
    _states_to_send: set[str]

    def setup_instance(self, *given: Any, **named: Any) -> None:
        """Called by traitlets before anything is set."""
        self._sending = threading.RLock()
        self._sent_since: set[str] = set()  # since the front end has set a trait
        super().setup_instance(*given, **named)

    def __init__(self, **traits: Any) -> None:
        if _IS_WORDED.get():
            traits.setdefault("layout", layout())
        super().__init__(**module_traits(type(self)), **traits)
        if self.channel is not None:
            self.on_msg(lambda widget, content, buffers: widget.receive(content, buffers))

    # -- messages ------------------------------------------------------------------------------------------------------

    def post(self, message: Message, buffers: Sequence[Any] = ()) -> None:
        """Send a message to the front ends."""
        self.send(message.content(), *([list(buffers)] if buffers else []))

    def send(self, content: Any, buffers: Any = None) -> None:
        """Send a message to the front ends, in parts where its buffers are too large for one."""
        if sum(memoryview(buffer).nbytes for buffer in buffers or ()) <= FRAGMENT_BYTES:
            super().send(content, buffers)
            return
        with self._sending:
            for part, data in fragments(content, buffers):
                super().send(part.content(), [data])

    def receive(self, content: Any, buffers: Any = ()) -> None:
        """Take a message of a front end. One that is wrong is one line in the log, and changes nothing.

        Examples
        --------
        >>> SyncedWidget().receive({"type": "save"})  # a widget without messages
        """
        if self.channel is None:
            return
        message = self.channel.read(content, buffers)
        try:
            if isinstance(message, Refused):
                _LOG.warning("a message to %s was dropped: %s", type(self).__name__, message.reason)
                self._refuse(message)
            else:
                self.take_message(message, buffers)
        except (DeformError, traitlets.TraitError) as error:  # a right message at a wrong time
            _LOG.warning("a message to %s was dropped: %s", type(self).__name__, error)
        except Exception:  # of any callback: it must not end the connection with the front end
            _LOG.exception("a message to %s failed", type(self).__name__)

    def take_message(self, message: Any, buffers: Any = ()) -> None:
        """Handle a message of :attr:`channel`; DeformError where that is impossible now."""

    def _refuse(self, refused: Refused) -> None:
        """Answer a message with something wrong in it, which has been logged."""

    @traitlets.default("language")
    def _default_language(self) -> str:
        return "" if _IS_WORDED.get() else language()

    @traitlets.default("words")
    def _default_words(self) -> dict[str, str]:
        return word_table(self.language) if self.language else {}

    @contextmanager
    def hold_sync(self) -> Iterator[None]:
        """Send all traits to the front end in one message, at the end, with those that another thread sets meanwhile.

        ipywidgets' own sends the names that it holds and then empties their set: names held by another thread
        between the two, such as the history of an edit while a picture is exchanged, would never reach the front end.
        """
        if self._holding_sync:
            yield
            return
        self._holding_sync = True
        try:
            yield
        finally:
            with self._sending:
                self._holding_sync = False
                held = self._states_to_send
                self._states_to_send = set()
                if held:
                    self.send_state(held)

    def _should_send_property(self, key: str, value: Any) -> bool:
        with self._sending:  # a name is held or sent; none falls between the two
            return bool(super()._should_send_property(key, value))

    def send_state(self, key: Any = None) -> None:
        """Send traits to the front end; the value sent last holds, whichever thread sent it."""
        with self._sending:
            self._sent_since.update(self.keys if key is None else [key] if isinstance(key, str) else key)
            super().send_state(key)

    def set_state(self, sync_data: Any) -> None:
        """Take the trait values that the front end sends."""
        with self._sending:
            self._sent_since.clear()
        super().set_state(sync_data)
        with self._sending:
            crossed = self._sent_since.intersection(sync_data)
            if crossed:
                self.send_state(crossed)


class ViewMeta(ABCMeta, traitlets.MetaHasTraits):
    """For views that are widgets: ABC and HasTraits have a metaclass each, and Python allows one."""
