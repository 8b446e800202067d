"""What editors of control points tell their pages, from any thread."""

from __future__ import annotations

import threading
from typing import Any

from deformnb.control_points import ControlPoints
from deformnb.widgets.editor import Editor


def test_a_trait_that_another_thread_sets_while_held_ones_are_sent_reaches_the_page(monkeypatch: Any) -> None:
    editor = Editor(None, ControlPoints.empty())
    told: dict[str, Any] = {}
    others: list[threading.Thread] = []

    def sent(message: dict[str, Any], buffers: Any = None) -> None:
        if message["method"] == "update":
            told.update(message["state"])
            if not others:  # the held ones are on their way: now an edit comes, in the thread of the kernel's messages
                others.append(threading.Thread(target=edit))
                others[0].start()
                others[0].join(0.2)  # it may wait until the held ones are sent

    def edit() -> None:
        with editor.hold_sync():
            editor.history = {"undo": "move nose", "redo": ""}

    monkeypatch.setattr(editor, "_send", sent)
    with editor.hold_sync():
        editor.height = 300
    others[0].join(20)
    assert not others[0].is_alive()
    assert told["height"] == 300
    assert told["history"] == {"undo": "move nose", "redo": ""}
    with editor.hold_sync(), editor.hold_sync():
        editor.height, editor.history = 200, {}
        assert told["height"] == 300
    assert (told["height"], told["history"]) == (200, {})
