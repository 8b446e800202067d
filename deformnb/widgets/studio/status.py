"""Status of a studio: a line of facts, and the last event or error, over the volume until it is closed."""

from __future__ import annotations

import html
import logging
from collections.abc import Callable

from deformnb.errors import DeformError
from deformnb.widgets import basic_widgets as basic
from deformnb.widgets.boxes import column

_LOG = logging.getLogger(__name__)

_CLOSE = '<button type="button" class="dnb-message-close" aria-label="Close this message">&times;</button>'  # head.js


class StudioStatus:
    """The two texts of a studio, and the guard that lets no error pass unreported.

    Attributes
    ----------
    status : the line of facts, in the group "Check"; notice : what has happened; box : the messages over the volume.

    Examples
    --------
    >>> words = StudioStatus()
    >>> words.run_guarded(lambda: print(1 / 0))
    False
    >>> "ZeroDivisionError" in words.notice.value
    True
    """

    def __init__(self) -> None:
        self.status, self.notice = basic.Label(""), basic.HTML("")
        self.box = column(self.notice)

    def show(self, text: str, *, is_error: bool = False) -> None:
        """Show a text in the place of the one before; an empty text shows nothing."""
        self.notice.value = as_html(text, is_error)

    def run_guarded(self, action: Callable[[], None]) -> bool:
        """Do something that may fail, and report that in the front end; returns whether it went well."""
        try:
            action()
        except Exception as error:
            self.show(reason_of(error), is_error=True)
            return False
        return True

    def report_error(self, error: Exception) -> None:
        """Report an error of a thread, which has been logged."""
        self.show(_error_text(error), is_error=True)


def as_html(text: str, is_error: bool = False) -> str:
    """A text as it is seen; nothing for an empty one."""
    if not text:
        return ""
    role, kind = ("alert", " dnb-message-error") if is_error else ("status", "")
    words = f'<span class="dnb-message-text">{html.escape(text)}</span>'
    return f'<div role="{role}" class="dnb-message{kind}">{words}{_CLOSE}</div>'


def reason_of(error: Exception) -> str:
    """Message of an error; an unexpected one is logged."""
    if not isinstance(error, DeformError):
        _LOG.error("an action of the studio failed", exc_info=error)
    return _error_text(error)


def _error_text(error: Exception) -> str:
    return str(error) if isinstance(error, DeformError) else f"{type(error).__name__}: {error}"
