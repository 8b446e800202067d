"""Front ends of widgets in a kernel: widgets of one class share a model of it, and others have their own."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from ipywidgets.embed import dependency_state

from deformnb.rbf.points import ControlPoints
from deformnb.widgets import Editor, Player
from deformnb.widgets import basic_widgets as basic
from deformnb.widgets.bundle import bundle
from deformnb.widgets.cell_widgets import close_all
from deformnb.widgets.modules import FrontEndModule


@pytest.fixture
def kernel(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    zmqshell = pytest.importorskip("ipykernel.zmqshell")
    shell = zmqshell.ZMQInteractiveShell.__new__(zmqshell.ZMQInteractiveShell)
    monkeypatch.setattr("deformnb.widgets.modules.running_shell", lambda: shell)
    yield
    for model in basic.shared_models():
        if isinstance(model, FrontEndModule):
            model.close()


@pytest.mark.usefixtures("kernel")
def test_widgets_of_a_kernel_share_a_model_of_their_front_end() -> None:
    one, other = (Editor(None, ControlPoints.empty()) for _ in range(2))
    player = Player()
    sent = one.get_state()
    assert sent["_esm"] == bundle("module_loader.js") == player.get_state()["_esm"]
    assert len(sent["_esm"]) < 2000
    assert sent["_css"] == ""
    assert one.module is other.module
    assert (one.module.script, one.module.style) == (bundle("editor.js"), bundle("editor.css"))
    assert player.module.digest != one.module.digest
    assert one.module.model_id in dependency_state(one)  # a saved page has it too
    close_all(one, player)
    assert other.module.comm is not None
    other.module.close()  # as ipywidgets.Widget.close_all() does
    assert Editor(None, ControlPoints.empty()).module.comm is not None


def test_a_widget_outside_of_a_kernel_has_its_script() -> None:
    editor = Editor(None, ControlPoints.empty())
    assert editor.module is None
    assert editor.get_state()["_esm"] == bundle("editor.js")
    editor.close()
