"""A page that holds live views, with the widgets' own Python at the other end: no notebook, no server, no network."""

from __future__ import annotations

import base64
import io
import json
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from front_end import deliver
from numpy.typing import NDArray
from waiting import PATIENCE

from deformnb.widgets.view.live_view import LiveView

FOLLOWED = "!document.querySelector('.dnb-view').deformnb.elements.frame"
"""Letters, scale and cube are those of the camera: they follow it in the next frame."""

_PAGE = """<!doctype html><meta charset="utf-8"><style>body { margin: 0; background: #888 }</style><div id="root"></div>
<script>
const models = {};
let underway = 0; // messages that Python has not read yet
async function tell(...message) {
  if (!window.toPython) return;
  underway += 1;
  try { await toPython(...message); } finally { underway -= 1; }
}
const packed = (b) => { let s = ""; for (const x of new Uint8Array(b)) s += String.fromCharCode(x); return btoa(s); };
const bytes = (t) => new DataView(Uint8Array.from(atob(t), (c) => c.charCodeAt(0)).buffer);
const value = (v) => (v && v.__bytes__ !== undefined ? bytes(v.__bytes__) : v);
function makeModel(name, state) {
  const traits = Object.fromEntries(Object.entries(state).map(([k, v]) => [k, value(v)]));
  const calls = {}, dirty = new Set();
  const fire = (event, ...args) => [...(calls[event] || [])].forEach((f) => f(...args));
  const model = {
    name, sent: [], saved: [],
    get: (k) => traits[k],
    set(k, v) { traits[k] = v; dirty.add(k); fire("change:" + k, model, v); fire("change"); },
    fromPython(k, v) { traits[k] = value(v); fire("change:" + k, model, traits[k]); },
    save_changes() {
      const state = {};
      for (const k of dirty) state[k] = traits[k];
      dirty.clear();
      model.saved.push(state);
      tell(name, "state", JSON.stringify(state), []);
    },
    send(content, callbacks, buffers) { if (content?.type !== "pointer") model.sent.push(content);
      tell(name, "message", JSON.stringify(content), (buffers || []).map(packed)); },
    on(e, f) { (calls[e] ??= []).push(f); },
    off(e, f) { if (calls[e]) calls[e] = calls[e].filter((g) => g !== f); },
    receive(content, buffers) { fire("msg:custom", content, buffers.map(bytes)); },
    widget_manager: { get_model: async (id) => models[id] },
  };
  return (models[name] = model);
}
async function draw(name, source) {
  const module = await import(URL.createObjectURL(new Blob([source], { type: "text/javascript" })));
  const isNew = !models[name].isInitialized;
  models[name].isInitialized = true;
  if (isNew && module.default.initialize) await module.default.initialize({ model: models[name] });
  const el = document.createElement("div");
  document.getElementById("root").append(el);
  const cleanup = await module.default.render({ model: models[name], el });
  models[name].cleanups = [...(models[name].cleanups || []), () => { cleanup && cleanup(); el.remove(); }];
  const frame = () => new Promise(requestAnimationFrame);
  await frame(); // its size is observed
  await frame(); // and it is drawn with that
}
function pixels() { // what is on the canvas, drawn at once and in full
  const page = document.querySelector(".dnb-view").deformnb;
  page.loop.drawNow(2);
  return page.elements.canvas.toDataURL("image/png").split(",")[1];
}
</script>"""

# Without a sandbox it runs in containers; without a network it is quiet.
ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-sync",
    "--disable-component-update",
    "--enable-unsafe-swiftshader",
]


class LivePage:
    """A browser page with models whose messages go to real widgets in this process."""

    def __init__(self, browser: Any, size: tuple[int, int] = (900, 700), *, init: str = "") -> None:
        self.page = browser.new_page(viewport={"width": size[0], "height": size[1]})
        self.errors: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", self._collect_error)
        self.widgets: dict[str, Any] = {}
        self.outbox: list[tuple[str, dict[str, Any], list[bytes]]] = []
        self._thread = threading.current_thread()  # the only one that may talk to the browser
        self._changes: list[tuple[str, str]] = []  # of traits, by others
        self._echo = ""  # the widget that hears its own page
        self._inbox: list[tuple[str, str, str, list[str]]] = []
        self._is_reading = False
        self.page.expose_function("toPython", self._receive)
        self.page.set_content(_PAGE)
        if init:
            self.page.evaluate(init)

    def _collect_error(self, message: Any) -> None:
        if message.type in ("error", "warning") and "GPU stall due to ReadPixels" not in message.text:
            self.errors.append(message.text)  # reading pixels back is what a screenshot is

    def add(self, widget: Any, name: str = "view", *, draw: bool = True) -> None:
        """Add a widget to the page."""
        self.widgets[name] = widget
        widget.send = lambda content, buffers=None: self.outbox.append((name, content, list(buffers or [])))
        widget.observe(lambda change: self._send_change(name, change))
        state = {k: _plain(v) for k, v in widget.get_state().items() if not k.startswith("_") and k not in _OTHERS}
        # Under its own name and under the one by which another widget's trait refers to it.
        self.page.evaluate("([n, s, id]) => { models[id] = makeModel(n, s); }", [name, state, widget.model_id])
        if draw:
            self.draw(name)

    def _send_change(self, name: str, change: Any) -> None:
        if self.widgets[name].trait_metadata(change["name"], "sync") and self._echo != name:
            if threading.current_thread() is self._thread:
                self._deliver_trait(name, change["name"])
            else:
                self._changes.append((name, change["name"]))

    def _deliver_trait(self, name: str, key: str) -> None:
        self.page.evaluate(
            "([m, k, v]) => models[m].fromPython(k, v)", [name, key, _plain(self.widgets[name].get_state(key)[key])]
        )

    def draw(self, name: str = "view") -> None:
        of_widget = self.widgets[name].get_state(["_css", "_esm"])
        self.page.add_style_tag(content=of_widget["_css"])
        self.page.evaluate("([n, s]) => draw(n, s)", [name, of_widget["_esm"]])
        self.flush()

    def _receive(self, name: str, kind: str, text: str, buffers: list[str]) -> None:
        """Read one message after the other, as in a kernel: the reply to one lets the next one in."""
        self._inbox.append((name, kind, text, buffers))
        if self._is_reading:
            return
        self._is_reading = True
        try:
            while self._inbox:
                self._read(*self._inbox.pop(0))
        finally:
            self._is_reading = False

    def _read(self, name: str, kind: str, text: str, buffers: list[str]) -> None:
        widget, content = self.widgets[name], json.loads(text)
        if kind == "state":
            self._echo = name
            widget.set_state(content)
            self._echo = ""
        else:
            deliver(widget, content, [memoryview(base64.b64decode(b)) for b in buffers])

    def flush(self) -> None:
        """Deliver the widgets' messages, and changes by other threads."""
        while self._changes:
            self._deliver_trait(*self._changes.pop(0))
        while self.outbox:
            name, content, buffers = self.outbox.pop(0)
            text = [base64.b64encode(b).decode() for b in buffers]
            self.page.evaluate("([m, c, b]) => { models[m].receive(c, b); }", [name, content, text])

    def wait(self, condition: str, timeout: float = PATIENCE, *, passing: bool = False) -> None:
        """Wait until a JavaScript expression holds and no message is pending, on either side.

        What may hold for a moment only is ``passing``: messages may then be underway.
        """
        rest = "" if passing else " && underway === 0"
        for _ in range(int(timeout / 0.03)):
            self.flush()
            if self.page.evaluate(f"() => Boolean({condition}){rest}") and (passing or not self._is_busy):
                return
            self.page.wait_for_timeout(30)
        raise TimeoutError(f"{condition} did not become true in {timeout} s; the page reported {self.errors}")

    def wait_until(self, condition: Callable[[], Any], timeout: float = PATIENCE) -> None:
        """Wait for a state of Python, or of the page read by it; messages are dispatched meanwhile."""
        end = time.monotonic() + timeout
        while True:
            self.flush()
            if condition():
                return
            if time.monotonic() > end:
                raise TimeoutError(f"it did not become true in {timeout} s; the page reported {self.errors}")
            self.page.wait_for_timeout(30)

    @property
    def _is_busy(self) -> bool:
        """Check whether messages of the page are read, answers not delivered, or states wait for older ones."""
        pacers = (widget.fields.pacer for widget in self.widgets.values() if isinstance(widget, LiveView))
        return self._is_reading or bool(self._inbox or self.outbox) or any(pacer.is_waiting for pacer in pacers)

    def wait_answered(self) -> None:
        """Wait until Python has read all messages of the page so far, and the page its replies."""
        self.wait("true")

    def frames(self) -> None:
        """Wait for two frames of the page: in the first sizes are observed, in the second it is drawn with them."""
        self.page.evaluate("""async () => {
            for (const _ of [1, 2]) await new Promise(requestAnimationFrame); }""")

    def wait_loaded(self) -> None:
        """Wait until the volume is on the GPU and all messages are applied."""
        self.wait(
            "document.querySelector('.dnb-view').deformnb.caster?.isReady && "
            "document.querySelector('.dnb-view').deformnb.field"
        )

    def pixels(self) -> NDArray[np.uint8]:
        """The picture, drawn in full now."""
        from PIL import Image

        self.flush()
        data = self.page.evaluate("() => pixels()")
        return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")).copy()

    def close(self) -> None:
        self.page.close()


_OTHERS = ("comm", "layout", "tabbable", "tooltip")


def _plain(value: Any) -> Any:
    if isinstance(value, bytes | memoryview):
        return {"__bytes__": base64.b64encode(bytes(value)).decode()}
    return value
