"""Status of a studio: a permanent line of facts, and beside it the last event or error."""

from __future__ import annotations

import html
import logging
from collections.abc import Callable

import ipywidgets as ipw

from deformnb.errors import DeformError

_LOG = logging.getLogger(__name__)


class StudioStatus:
    """The two texts below a studio, and the guard that lets no error pass unreported.

    Attributes
    ----------
    status : the line of facts; notice : what has happened; box : both side by side.

    Examples
    --------
    >>> words = StudioStatus()
    >>> words.guarded(lambda: print(1 / 0))
    False
    >>> "ZeroDivisionError" in words.notice.value
    True
    """

    def __init__(self) -> None:
        self.status = ipw.Label("", layout=ipw.Layout(flex="1 1 auto", min_width="0"))
        self.notice = ipw.HTML("", layout=ipw.Layout(flex="1 1 400px", min_width="0"))  # a label would cut long words
        self.box = ipw.HBox([self.status, self.notice], layout=ipw.Layout(
            width="100%", flex_flow="row wrap", align_items="center", grid_gap="0 24px"))

    def show(self, text: str, *, is_error: bool = False) -> None:
        """Show a text in the place of the one before; an empty text shows nothing."""
        self.notice.value = as_html(text, is_error)

    def guarded(self, action: Callable[[], None]) -> bool:
        """Do something that may fail, and report that in the front end; returns whether it went well."""
        try:
            action()
        except Exception as error:
            self.show(reason_of(error), is_error=True)
            return False
        return True

    def failed(self, error: Exception) -> None:
        """Report an error of a thread, which has been logged."""
        self.show(_in_words(error), is_error=True)


def as_html(text: str, is_error: bool = False) -> str:
    """A text as it is seen; nothing for an empty one."""
    colour = "color: var(--jp-error-color1, #c62828)" if is_error else "opacity: 0.85"
    return f'<div role="status" style="{colour}; line-height: 1.35">{html.escape(text)}</div>' if text else ""


def reason_of(error: Exception) -> str:
    """Message of an error; an unexpected one is logged."""
    if not isinstance(error, DeformError):
        _LOG.error("an action of the studio failed", exc_info=error)
    return _in_words(error)


def _in_words(error: Exception) -> str:
    return str(error) if isinstance(error, DeformError) else f"{type(error).__name__}: {error}"
