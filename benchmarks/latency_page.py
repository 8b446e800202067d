"""One notebook in a tab of a real browser: a pointer that edits, and the times of inputs and pictures."""

from __future__ import annotations

import base64
import io
import math
import time
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.latency_cells import CASES

HOOKS = Path(__file__).with_name("latency_hooks.js")

# The largest picture of the notebook that is not the editor's.
_VIEW_BOX = """() => {
  const found = [...document.querySelectorAll(".jp-OutputArea img, .jp-OutputArea canvas, .jp-OutputArea iframe")]
    .filter((e) => !e.closest(".dnb-editor")).map((e) => e.getBoundingClientRect())
    .sort((a, b) => b.width * b.height - a.width * a.height)[0];
  return found && found.width > 0 ? { x: found.x, y: found.y, width: found.width, height: found.height } : null;
}"""

# The point nearest the middle of the picture, where a drag moves visible tissue; in slices distant points are marks.
_POINT = """() => {
  const at = (e) => { const b = e.getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2]; };
  const middle = at(document.querySelector(".dnb-editor .dnb-ed-canvas"));
  const far = (e) => { const [x, y] = at(e); return Math.hypot(x - middle[0], y - middle[1]); };
  const disc = [...document.querySelector(".dnb-editor .dnb-ed-svg")
    .querySelectorAll("[data-id]:not(.dnb-sp-far) .dnb-ed-disc")].sort((a, b) => far(a) - far(b))[0];
  return disc.closest("[data-id]").dataset.id;
}"""


# The path of EditorPointer at 6 steps a second.
_DRAG = """([x, y, seconds, rate]) => new Promise((done) => {
  const stage = document.querySelector(".dnb-editor .dnb-ed-svg"), start = performance.now();
  const timer = setInterval(() => {
    const now = (performance.now() - start) / 1e3, angle = 6 * now / 2.1;
    if (now > seconds) { clearInterval(timer); done(); return; }
    stage.dispatchEvent(new PointerEvent("pointermove", { bubbles: true, cancelable: true, pointerId: 1, buttons: 1,
      pointerType: "mouse", isPrimary: true, clientX: x + 24 * Math.cos(angle), clientY: y + 24 * Math.sin(angle) }));
  }, 1e3 / rate);
})"""


class Pointer(ABC):
    """A pointer that presses a handle and moves it along a path around its first place."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.is_down = False
        self.handle = page.locator(self.selector()).first
        self.home = self.place()

    @abstractmethod
    def selector(self) -> str:
        """Selector of the element that is the handle."""

    @abstractmethod
    def displacement(self, step: float) -> tuple[float, float]:
        """Displacement of the handle from its first place after a number of steps."""

    def place(self) -> tuple[float, float]:
        """Place of the handle on the screen."""
        box = self.handle.bounding_box()
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def take(self) -> None:
        self.page.mouse.move(*self.place())
        self.page.mouse.down()
        self.is_down = True

    def move(self, step: float) -> None:
        if not self.is_down:
            self.take()
        (x, y), (dx, dy) = self.home, self.displacement(step)
        self.page.mouse.move(x + dx, y + dy)

    def drag(self, seconds: float, rate: float) -> None:
        """Move the pressed handle as often as the driver of the browser can, at most ``rate`` times a second."""
        start, k = time.perf_counter(), 0
        while (now := time.perf_counter() - start) < seconds:
            self.move(6 * now)
            k += 1
            time.sleep(max(0.0, k / rate - (time.perf_counter() - start)))

    def release(self) -> None:
        if self.is_down:
            self.page.mouse.up()
        self.is_down = False


class EditorPointer(Pointer):
    """Drags a control point of the editor in a circle."""

    def selector(self) -> str:
        return f".dnb-editor [data-id='{self.page.evaluate(_POINT)}'] .dnb-ed-disc"

    def displacement(self, step: float) -> tuple[float, float]:
        return 24 * math.cos(step / 2.1), 24 * math.sin(step / 2.1)

    def drag(self, seconds: float, rate: float) -> None:
        """Drag by events made in the page: a driver waits for each to be drawn, and would set the pace itself."""
        self.move(0.0)  # the mouse itself has pressed it
        self.page.evaluate(_DRAG, [*self.home, seconds, rate])


class SliderPointer(Pointer):
    """Drags the handle of the slider there and back, never as far as its ends."""

    def selector(self) -> str:
        return ".noUi-handle"

    def displacement(self, step: float) -> tuple[float, float]:
        return 8 * abs((1.3 * step + 7) % 20 - 10) - 40, 0.0  # a zigzag: no step is small


@dataclass
class Seen:
    """Times in milliseconds of inputs, and of pictures on their way to the screen; each differs from the one before."""

    inputs: list[float] = field(default_factory=list)
    view: list[float] = field(default_factory=list)
    picture: list[float] = field(default_factory=list)
    grid: list[float] = field(default_factory=list)


class Seat:
    """A view in a separate notebook, ready to be edited.

    Parameters
    ----------
    name : of :data:`~benchmarks.latency_cells.CASES`.
    size : edge of the volume in voxels.
    cells : of another notebook than that of the name.
    """

    def __init__(
        self, browser: Any, lab: Any, name: str, size: int, patience: float = 120.0, *, cells: list[str] | None = None
    ) -> None:
        self.name, self.lab = name, lab
        self.page = browser.new_page(viewport={"width": 1440, "height": 860})
        self.errors: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.add_init_script(path=HOOKS)
        self.seen = Seen()
        self.slowest = 400.0  # milliseconds of an edit so far
        own = f"{''.join(c for c in name.lower() if c.isalnum())}{size}"
        lab.place = f"{own}/"  # and a workspace of this name, else JupyterLab opens the others' notebooks as well
        lab.open_notebook(self.page, cells or CASES[name](size), f"{own}.ipynb")
        self.page.evaluate("""async () => {
            await jupyterapp.commands.execute("notebook:hide-all-cell-code");
            jupyterapp.shell.collapseLeft();
        }""")
        self._wait(lambda: bool(self.seen.view or self._complaints()), patience, "it showed no picture")
        if not self.seen.view:
            raise RuntimeError(self.trouble())
        self.rest(1500)
        self.pointer: Pointer = (EditorPointer if self.page.query_selector(".dnb-editor") else SliderPointer)(self.page)
        self.pid = int(lab.run(self.page, "import os; print(os.getpid())"))
        self.comms: dict[str, str] = {}  # by the name of the widget; a rival has none of ours
        if self.page.query_selector(".dnb-editor"):
            self.comms = {"view": lab.run(self.page, "print(view.comm.comm_id)").strip()}

    def _wait(self, reached: Any, patience: float, otherwise: str) -> None:
        end = time.monotonic() + patience
        while not reached():
            if time.monotonic() > end:
                raise TimeoutError(f"{otherwise} in {patience:.0f} s {self.trouble()}")
            self.page.wait_for_timeout(60)
            self.collect()

    def trouble(self) -> str:
        """Errors of the page and of the notebook."""
        return "; ".join([*self.errors[-2:], *self._complaints()]) or "(no error was shown)"

    def _complaints(self) -> list[str]:
        """Last lines of the errors of cells."""
        return list(
            self.page.evaluate("""() => [...document.querySelectorAll("[data-mime-type$='stderr']")]
            .map((e) => e.textContent.trim().split("\\n").pop()).filter((line) => /Error/.test(line))""")
        )

    def collect(self) -> None:
        """Fetch what the hooks have noted."""
        for frame in self.page.frames:
            try:
                inputs, paints = frame.evaluate("""() => {
                    const h = window.deformnbLatency, taken = h ? [h.inputs, h.paints] : [[], []];
                    if (h) { h.inputs = []; h.paints = []; }
                    return taken;
                }""")
            except Exception:  # a frame that is just going away
                continue
            self.seen.inputs += [t for t, _ in inputs]
            for t, place, kind in paints:
                here = "view" if place == "view" else "grid" if kind == "grid" else "picture"
                getattr(self.seen, here).append(t)

    def fresh(self) -> None:
        """Clear the recorded times."""
        self.collect()
        self.seen = Seen()

    def rest(self, quiet: float = 500.0, patience: float = 30.0) -> None:
        """Wait until the view has shown nothing new for ``quiet`` milliseconds."""
        end = time.monotonic() + patience
        last, since = len(self.seen.view), time.monotonic()
        while time.monotonic() - since < quiet / 1e3 and time.monotonic() < end:
            self.page.wait_for_timeout(80)
            self.collect()
            if len(self.seen.view) != last:
                last, since = len(self.seen.view), time.monotonic()

    # -- measurements --------------------------------------------------------------------------------------------------

    def edit(self, step: float, patience: float = 20.0) -> tuple[float, float | None]:
        """Milliseconds from one movement of the pressed handle to new pixels: in the view, and in the editor."""
        if not self.pointer.is_down:
            self.fresh()
            self.pointer.move(step - 0.5)
            self._wait(lambda: bool(self.seen.view), patience, "the first movement changed nothing")
        self.rest(self._long_rest)  # a picture of the edit before must not be taken for one of this
        self.fresh()
        self.pointer.move(step)
        self._wait(lambda: bool(self.after(self.seen.view)), patience, "an edit changed no pixel")
        view, picture = self.after(self.seen.view)[0], self.after(self.seen.picture)
        self.slowest = max(self.slowest, view)
        return view, picture[0] if picture else None

    @property
    def _long_rest(self) -> float:
        """Milliseconds without a new picture after which none is on its way any more."""
        return min(8000.0, max(1000.0, 1.5 * self.slowest))

    def after(self, times: list[float]) -> list[float]:
        """Times since the first input."""
        start = self.seen.inputs[0] if self.seen.inputs else math.inf
        return sorted(t - start for t in times if t > start)

    def whole_edit(self, step: float) -> float:
        """Milliseconds from a movement, after which the handle is released, to the last picture."""
        if not self.pointer.is_down:
            self.pointer.take()
        self.rest(self._long_rest)
        self.fresh()
        self.pointer.move(step)
        self.pointer.release()
        self._wait(lambda: bool(self.after(self.seen.view)), 20, "an edit changed no pixel")
        self.rest(self._long_rest)
        return self.after(self.seen.view)[-1]

    def drag(self, seconds: float, rate: float = 60.0) -> dict[str, float]:
        """Frames a second of a drag, bytes of the view meanwhile, and how long after it the last quick picture came."""
        if not self.pointer.is_down:
            self.pointer.take()
        self._set_settle(60_000)  # no full pictures, which would hide how far behind the quick ones are
        self.rest(self._long_rest)
        self.fresh()

        carried = self.measure_bytes(lambda: self.pointer.drag(seconds, rate))
        self.rest(self._long_rest)
        inputs, end = self.seen.inputs, max(self.seen.inputs)
        span = (end - inputs[0]) / 1e3

        def frequency(times: list[float]) -> float:
            return sum(inputs[0] < t <= end for t in times) / span

        self.pointer.release()
        self._set_settle(250)
        return {
            "inputs_hz": len(inputs) / span,
            "view_hz": frequency(self.seen.view),
            "picture_hz": frequency(self.seen.picture),
            "grid_hz": frequency(self.seen.grid),
            "catch_up_ms": max([t - end for t in self.seen.view] + [0.0]),
            "view_bytes": carried["view"],
        }

    def _set_settle(self, milliseconds: float) -> None:
        if self.comms:
            self.lab.run(self.page, f"view.settle_ms = {milliseconds}")

    def many(self, steps: int) -> None:
        """Drags of 50 movements each, with a pause in which all is drawn."""
        for k in range(steps):
            self.pointer.move(k / 3)
            self.page.wait_for_timeout(15)
            if k % 50 == 49:
                self.pointer.release()
                self.rest(self._long_rest / 2)
                self.fresh()
        self.pointer.release()

    def memory(self) -> tuple[float, float]:
        """MiB of the kernel, and of the page's own objects after a collection."""
        used = 0.0
        for session in self._sessions():
            session.send("HeapProfiler.collectGarbage")
            session.send("Performance.enable")
            metrics = {m["name"]: m["value"] for m in session.send("Performance.getMetrics")["metrics"]}
            used += metrics["JSHeapUsedSize"]
            session.detach()
        lines = Path(f"/proc/{self.pid}/status").read_text(encoding="utf-8").splitlines()
        kernel = next(int(line.split()[1]) for line in lines if line.startswith("VmRSS"))
        return kernel / 2**10, used / 2**20

    def _sessions(self) -> list[Any]:
        """The browser's own tools, for the page and for each frame that has a separate process."""
        sessions = [self.page.context.new_cdp_session(self.page)]
        for frame in self.page.frames[1:]:
            try:
                sessions.append(self.page.context.new_cdp_session(frame))
            except Exception:  # it lives in the page's process and is counted there
                continue
        return sessions

    def measure_bytes(self, work: Any) -> dict[str, int]:
        """Bytes of websockets while something is done: "up" and "down", and of those the "view"'s own messages."""
        carried = {"up": 0, "down": 0, "view": 0}
        ours = self.comms.get("view", "no such comm").encode()

        def count(way: str, event: dict[str, Any]) -> None:
            data = _payload(event["response"])
            carried[way] += len(data)
            carried["view"] += len(data) if ours in data else 0

        sessions = self._sessions()
        for session in sessions:
            session.on("Network.webSocketFrameSent", lambda e: count("up", e))
            session.on("Network.webSocketFrameReceived", lambda e: count("down", e))
            session.send("Network.enable")
        work()
        self.page.wait_for_timeout(150)  # messages in transit are counted
        for session in sessions:
            session.detach()
        return carried

    def changes(self, step: float) -> bool:
        """Check by screenshots, which measure no time, whether an edit changes the picture on the screen."""
        self._wait(lambda: self.page.evaluate(_VIEW_BOX), 20, "the view has no size on the page")
        box = self.page.evaluate(_VIEW_BOX)
        before = _pixels(self.page.screenshot(clip=box))
        self.whole_edit(step)
        after = _pixels(self.page.screenshot(clip=box))
        return bool((np.abs(before - after).max(axis=2) > 24).mean() > 0.002)

    def close(self) -> None:
        self.page.close()


def _payload(response: dict[str, Any]) -> bytes:
    data: str = response["payloadData"]
    return data.encode() if response["opcode"] == 1 else base64.b64decode(data)


def _pixels(png: bytes) -> Any:
    from PIL import Image

    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)
