"""Messages of widgets to front ends, while those, the kernel's messages and other threads set traits concurrently."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import anywidget
import pytest
import traitlets

import deformnb.widgets.inputs.clip_controls  # noqa: F401
import deformnb.widgets.inputs.depth_keys  # noqa: F401
import deformnb.widgets.inputs.file_transfer  # noqa: F401
import deformnb.widgets.studio.save_restore  # noqa: F401
from deformnb.rbf.points import ControlPoints
from deformnb.widgets import Editor, LiveView, Player, VolumeView
from deformnb.widgets.inputs.item_list import ItemList
from deformnb.widgets.inputs.points_table import PointsTable
from deformnb.widgets.messages.record import FRAGMENT_BYTES
from deformnb.widgets.synced import LocalComm, SyncedWidget

MAKERS: dict[str, tuple[Callable[[], Any], str, Any]] = {  # and a trait that the page sets, with a value
    "editor": (lambda: Editor(None, ControlPoints.empty()), "selected", [2]),
    "table": (PointsTable, "selected", [2]),
    "player": (Player, "time", 0.5),
    "live view": (LiveView, "clip", [[0.5, 1.0], [0.0, 1.0], [0.0, 1.0]]),
    "volume view": (lambda: VolumeView(method="core"), "clip", [[0.5, 1.0], [0.0, 1.0], [0.0, 1.0]]),
    "list": (ItemList, "", None),
}
OTHERS = {"selected": [1], "time": 0.25, "clip": [[0.0, 0.5], [0.0, 1.0], [0.0, 1.0]]}


class Page:
    """The state of a front end: the value of each trait that it received last, by an update or an answer."""

    def __init__(self, widget: Any, monkeypatch: pytest.MonkeyPatch) -> None:
        self.traits: dict[str, Any] = {}
        self.meanwhile: Callable[[], None] | None = None
        self.thread: threading.Thread | None = None
        monkeypatch.setattr(widget, "_send", self._apply)

    def _apply(self, message: dict[str, Any], buffers: Any = None) -> None:
        if message["method"] not in ("update", "echo_update"):
            return
        self.traits.update(message["state"])
        if self.meanwhile is not None:  # another thread has its turn now, as far as it need not wait for this one
            self.thread, self.meanwhile = threading.Thread(target=self.meanwhile), None
            self.thread.start()
            self.thread.join(0.2)


@pytest.fixture(params=MAKERS)
def widget_and_trait(request: Any) -> Any:
    make, name, value = MAKERS[request.param]
    widget = make()
    yield widget, name, value
    widget.close()


def test_a_trait_that_another_thread_sets_while_held_ones_are_sent_reaches_the_page(
    widget_and_trait: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    widget, page = widget_and_trait[0], Page(widget_and_trait[0], monkeypatch)

    are_sent = threading.Event()

    def edit() -> None:
        with widget.hold_sync():
            widget.tabbable = True
            are_sent.wait(20)

    page.meanwhile = edit
    with widget.hold_sync():
        widget.tooltip = "one"
    are_sent.set()
    assert page.thread is not None
    page.thread.join(20)
    assert not page.thread.is_alive()
    assert page.traits == {"tooltip": "one", "tabbable": True}
    with widget.hold_sync(), widget.hold_sync():
        widget.tooltip = "two"
        assert page.traits["tooltip"] == "one"
    assert page.traits["tooltip"] == "two"


@pytest.mark.parametrize("widget_and_trait", [name for name, (_, trait, _) in MAKERS.items() if trait], indirect=True)
def test_the_page_is_told_last_what_python_holds_though_both_have_set_it_at_once(
    widget_and_trait: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    widget, name, value = widget_and_trait
    page = Page(widget, monkeypatch)
    page.traits[name] = value  # it has set it, and shows it
    page.meanwhile = lambda: widget.set_trait(name, OTHERS[name])  # after the answer, before the value is taken
    widget.set_state({name: value})
    assert page.thread is not None
    page.thread.join(20)
    assert page.traits[name] == widget.get_state(name)[name]


def test_a_page_that_sets_a_trait_alone_is_answered_once(
    widget_and_trait: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    widget, name, value = widget_and_trait
    told: list[str] = []
    monkeypatch.setattr(widget, "_send", lambda message, buffers=None: told.append(message["method"]))
    with suppress(traitlets.TraitError):
        widget.set_state({name: value})
    assert [method for method in told if method == "update"] == []


def test_every_widget_of_ours_keeps_to_this() -> None:
    def below(kind: type) -> set[type]:
        return {kind}.union(*(below(made) for made in kind.__subclasses__()))

    ours = {kind for kind in below(anywidget.AnyWidget) if kind.__module__.startswith("deformnb.")}
    assert len(ours) > 10
    assert [kind.__name__ for kind in ours if not issubclass(kind, SyncedWidget)] == []


def test_a_comm_without_a_kernel_gives_messages_to_its_function_and_nothing_of_its_own_life() -> None:
    given: list[tuple[Any, list[bytes]]] = []
    comm = LocalComm(lambda data, buffers: given.append((data, buffers)))
    comm.open(data={"state": {"time": 1.0}})
    comm.send({})
    comm.send({"method": "custom"}, buffers=[memoryview(b"voxels")])
    comm.close(data={"state": {}})
    assert given == [({"method": "custom"}, [b"voxels"])]


def test_a_message_that_is_too_large_for_one_is_sent_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    widget, sent = SyncedWidget(), []
    monkeypatch.setattr(widget, "_send", lambda message, buffers=None: sent.append((message["content"], buffers)))
    widget.send({"type": "small"}, [bytes(FRAGMENT_BYTES)])
    first, second = bytes(range(256)) * 30_000, b"end"
    widget.send({"type": "large"}, [first, second])
    assert [content["type"] for content, _ in sent] == ["small", "fragment", "fragment"]
    assert all(len(buffer) <= FRAGMENT_BYTES for _, (buffer,) in sent)
    assert b"".join(buffer for _, (buffer,) in sent[1:]) == first + second
    assert [content["message"] for content, _ in sent[1:]] == [None, {"type": "large"}]
    assert [(content["index"], content["sizes"]) for content, _ in sent[1:]] == [
        (0, [7_680_000, 3]),
        (1, [7_680_000, 3]),
    ]
    widget.close()
