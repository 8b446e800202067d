"""The row of messages of a pane: of an editor below its pictures, of a view below its volume."""

from __future__ import annotations

from typing import Any


def message_script(pane: str = "body") -> str:
    """A JavaScript expression: the message that the first row in a pane shows, "" where there is none."""
    return f"(document.querySelector('{pane} .dnb-messages-text')?.textContent ?? '')"


def message_text(page: Any, pane: str = "body") -> str:
    """The message that the first row in a pane of a page shows, "" where there is none."""
    return str(page.evaluate(f"() => {message_script(pane)}"))
