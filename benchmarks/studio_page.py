"""A studio in a tab of a real browser, a mouse that drags one of its points as a hand does, and what was drawn then."""

from __future__ import annotations

import json
import math
import statistics
import subprocess
import sys
import threading
import time
import urllib.request
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import websocket

from benchmarks import studio_cases

HOOKS = Path(__file__).with_name("studio_hooks.js")
SIZE = {"width": 1280, "height": 800}
RATE = 60.0
"""Movements of the mouse a second."""

# The point nearest the middle of the picture; in slices distant points are marks.
_HOME = """() => {
  const editor = document.querySelector(".dnb-space") ?? document.querySelector(".dnb-editor");
  const box = editor.querySelector(".dnb-ed-canvas").getBoundingClientRect();
  const middle = [box.x + box.width / 2, box.y + box.height / 2];
  const targets = editor.querySelector(".dnb-ed-svg").querySelectorAll(".dnb-ed-target:not(.dnb-sp-far)");
  const places = [...targets].map((e) => {
    const hit = e.querySelector(".dnb-ed-hit").getBoundingClientRect();
    const [x, y] = [hit.x + hit.width / 2, hit.y + hit.height / 2];
    return [x, y, Math.hypot(x - middle[0], y - middle[1])];
  });
  return places.sort((a, b) => a[2] - b[2])[0];
}"""

_READY = """() => {
  const view = document.querySelector(".dnb-view")?.deformnb;
  const editor = document.querySelector(".dnb-ed-svg [data-id]");
  return Boolean(editor && view?.caster?.isReady && view.loop?.screen.drawn[0] === "full0");
}"""

_AT_REST = """() => {
  const editor = (document.querySelector(".dnb-space") ?? document.querySelector(".dnb-editor")).deformnb;
  const { loop } = document.querySelector(".dnb-view").deformnb;
  return !editor.frames.isMoving && !editor.frames.request && !loop.isRequested && !loop.rush
    && loop.screen.drawn[loop.screen.layer] === `full${loop.screen.layer}`;
}"""

_LETS_FOLD = """() => {
  for (const root of document.querySelectorAll(".dnb-editor, .dnb-space")) {
    root.deformnb.model.set("stop_at_folds", false);
    root.deformnb.model.save_changes();
  }
}"""
"""A stopped drag moves nothing, so that no view is drawn."""

TRACED = {
    "script": {
        "FunctionCall",
        "EvaluateScript",
        "FireAnimationFrame",
        "TimerFire",
        "EventDispatch",
        "RunMicrotasks",
        "v8.callFunction",
        "HitTest",
    },
    "style": {"UpdateLayoutTree", "ScheduleStyleRecalculation", "RecalculateStyles"},
    "layout": {"Layout", "UpdateLayout"},
    "paint": {"PrePaint", "Paint", "Layerize", "Commit", "CompositeLayers", "UpdateLayer", "UpdateLayerTree"},
    "collection": {"MinorGC", "MajorGC", "V8.GCScavenger", "BlinkGC.AtomicPhase"},
}
"""Work of the main thread by the names of its events in a trace."""


class Connection:
    """The browser's protocol for one page. Input is sent without awaiting an answer, as a hand does not wait."""

    def __init__(self, port: int, marker: str) -> None:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list", timeout=10) as answer:
            pages = json.load(answer)
        address = next(page["webSocketDebuggerUrl"] for page in pages if marker in page["url"])
        self._socket = websocket.create_connection(address, suppress_origin=True, timeout=60)
        self._number = 0
        self._reader = threading.Thread(target=self._drain, daemon=True)
        self._reader.start()

    def _drain(self) -> None:
        try:
            while self._socket.recv():
                pass
        except (OSError, websocket.WebSocketException):
            return

    def send(self, method: str, **params: Any) -> None:
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": params}))

    def mouse(self, kind: str, x: float, y: float, *, is_down: bool = False) -> None:
        """An event of the mouse: "mouseMoved", "mousePressed" or "mouseReleased"."""
        button = "left" if kind != "mouseMoved" or is_down else "none"
        clicks = 0 if kind == "mouseMoved" else 1
        self.send(
            "Input.dispatchMouseEvent",
            type=kind,
            x=round(x, 2),
            y=round(y, 2),
            button=button,
            buttons=1 if is_down else 0,
            clickCount=clicks,
        )

    def close(self) -> None:
        self._socket.close()


def hand_path(seconds: float, reach: float = 26.0) -> Iterator[tuple[float, float]]:
    """Displacements in pixels of a hand that seeks a place: there and back at changing speed, with a slight tremor."""
    for k in range(round(seconds * RATE)):
        t = k / RATE
        along = reach * math.sin(1.9 * t + 0.7 * math.sin(0.8 * t))
        across = 0.7 * reach * math.sin(2.7 * t + 0.4 * math.sin(1.3 * t))
        yield along + 0.6 * math.sin(41 * t), across + 0.6 * math.sin(37 * t)


class StudioTab:
    """A studio in a tab, ready to be edited.

    Parameters
    ----------
    browser : Playwright's, with the protocol's port open.
    host : a started JupyterLab, or None for the application.
    folder : where the application saves.
    """

    def __init__(
        self, browser: Any, port: int, host: Any, case: str, name: str, checkout: Path, size: int, folder: Path
    ) -> None:
        self.context = browser.new_context(viewport=SIZE)
        self.page = self.context.new_page()
        self.errors: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.add_init_script(path=HOOKS)
        self.process: subprocess.Popen[str] | None = None
        own = "".join(c for c in f"{name}{case}".lower() if c.isalnum())
        if host is None:
            marker = self._open_application(case, checkout, size, folder)
        else:
            marker = own
            host.place = f"{own}/"
            host.open_notebook(self.page, [studio_cases.cell(case, checkout, size)], f"{own}.ipynb")
            self.page.evaluate("() => jupyterapp.commands.execute('notebook:hide-all-cell-code')")
        self.wait_until_ready()
        if host is not None:
            self.page.locator(".dnb-studio").evaluate("(e) => e.scrollIntoView({ block: 'start' })")
        self.page.evaluate(_LETS_FOLD)
        self.page.wait_for_function(_AT_REST, timeout=60_000)
        self.connection = Connection(port, marker)

    def _open_application(self, case: str, checkout: Path, size: int, folder: Path) -> str:
        program = studio_cases.application(case, checkout, size, folder)
        self.process = subprocess.Popen(
            [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, cwd=folder
        )
        assert self.process.stdout is not None
        address = self.process.stdout.readline().strip()
        if not address:
            raise RuntimeError("the application did not start")
        self.page.goto(address, timeout=90_000)
        return address.split("?")[0].split("#")[0]

    def wait_until_ready(self) -> None:
        """Wait for the only studio of the page, drawn in full."""
        self.page.wait_for_function(_READY, timeout=180_000)

    def rest(self) -> None:
        self.page.wait_for_function(_AT_REST, timeout=60_000)
        self.page.wait_for_timeout(700)  # passes that are averaged

    def _move(self, seconds: float) -> tuple[float, float]:
        """Press the point, move it along the path, and return its last place."""
        x, y, _ = self.page.evaluate(_HOME)
        mouse = self.connection.mouse
        mouse("mouseMoved", x, y)
        mouse("mousePressed", x, y, is_down=True)
        at, start = (x, y), time.perf_counter()
        for k, (dx, dy) in enumerate(hand_path(seconds)):
            time.sleep(max(0.0, start + k / RATE - time.perf_counter()))
            at = (x + dx, y + dy)
            mouse("mouseMoved", *at, is_down=True)
        return at

    def drag(self, seconds: float) -> dict[str, Any]:
        """The figures of one drag, and of the rest after it."""
        page = self.page
        page.bring_to_front()
        self.rest()
        page.evaluate("() => window.deformnbRates.begin()")
        page.wait_for_timeout(100)
        at = self._move(seconds)
        drawn = page.evaluate("""() => {
          const { pictures, views, frames, pointerdown } = window.deformnbRates;
          return { pictures, views, frames, down: pointerdown, now: performance.now() };
        }""")
        self.connection.mouse("mouseReleased", *at)
        page.wait_for_function("window.deformnbRates.pointerup > window.deformnbRates.pointerdown", timeout=30_000)
        page.wait_for_function(_AT_REST, timeout=60_000)
        rest = page.evaluate("() => ({ ...window.deformnbRates.end(), up: window.deformnbRates.pointerup })")
        full = [t for t, name, *_ in rest["views"] if t > rest["up"] and name.startswith("full")]
        down, end = drawn["down"], drawn["now"]
        span = (end - down) / 1e3
        gaps = [b - a for a, b in zip(drawn["frames"], drawn["frames"][1:], strict=False) if b > down]
        gaps.sort()
        moving = [view for view in drawn["views"] if down < view[0] <= end]
        self.undo()
        return {
            "pictures": sum(t > down for t in drawn["pictures"]) / span,
            "views": len(moving) / span,
            "median": gaps[len(gaps) // 2],
            "most": gaps[min(len(gaps) - 1, math.ceil(0.99 * len(gaps)) - 1)],
            "longest": gaps[-1],
            "settled": max(0.0, min(full) - rest["up"]) if full else math.nan,
            "across": statistics.median(v[2] for v in moving) if moving else math.nan,
            "down": statistics.median(v[3] for v in moving) if moving else math.nan,
        }

    def drag_point(self, seconds: float) -> None:
        """Drag the point in the middle, which stays where it is dropped."""
        self.connection.mouse("mouseReleased", *self._move(seconds))
        self.page.wait_for_function(_AT_REST, timeout=60_000)

    def turn(self) -> None:
        """Turn the volume by a drag on it."""
        box = self.page.locator(".dnb-view canvas").first.bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        mouse = self.connection.mouse
        mouse("mouseMoved", x, y)
        mouse("mousePressed", x, y, is_down=True)
        for k in range(30):
            time.sleep(1 / RATE)
            mouse("mouseMoved", x + 3 * k, y + k, is_down=True)
        mouse("mouseReleased", x + 90, y + 30)
        self.page.wait_for_function(_AT_REST, timeout=60_000)

    def undo(self) -> None:
        """Undo the drag, so that each begins at the same place; one that was not allowed to go anywhere was no edit."""
        self.page.wait_for_function("!document.querySelector('.dnb-editor, .dnb-space').deformnb.sender.isBehind()")
        self.page.evaluate("() => document.querySelector('[data-command=undo]:not([aria-disabled=true])')?.click()")
        self.rest()

    def trace(self, browser: Any, seconds: float, file: Path | None = None) -> dict[str, float]:
        """Milliseconds of the main thread for one movement, by kind of work, and of the GPU's; and MiB of scripts."""
        self.page.bring_to_front()
        self.rest()
        categories = ["devtools.timeline", "toplevel", "blink", "v8", "disabled-by-default-devtools.timeline"]
        moves = self.page.evaluate("() => window.deformnbRates.moves")
        browser.start_tracing(page=self.page, categories=categories, path=file)
        at = self._move(seconds)
        moves = self.page.evaluate("() => window.deformnbRates.moves") - moves
        events = json.loads(browser.stop_tracing())["traceEvents"]
        self.connection.mouse("mouseReleased", *at)
        self.rest()
        self.undo()
        found = split_trace(events)
        per_move = {kind: ms / max(1, moves) for kind, ms in found.items()}
        return {**per_move, "heap": self.script_bytes() / 2**20}

    def script_bytes(self) -> float:
        """Bytes of the objects of scripts that are alive."""
        session = self.context.new_cdp_session(self.page)
        for _ in range(3):  # an object with a finalizer goes with the second
            session.send("HeapProfiler.collectGarbage")
        session.send("Performance.enable")
        metrics = {m["name"]: m["value"] for m in session.send("Performance.getMetrics")["metrics"]}
        session.detach()
        return float(metrics["JSHeapUsedSize"])

    def close(self) -> None:
        self.connection.close()
        self.context.close()
        if self.process:
            self.process.terminate()
            self.process.wait(20)


def split_trace(events: list[dict[str, Any]]) -> dict[str, float]:
    """Milliseconds of processor time of the busiest main thread by kind of work, and of the GPU's main thread."""
    names = {(e["pid"], e["tid"]): e["args"]["name"] for e in events if e["name"] == "thread_name"}
    threads: dict[tuple[int, int], list[dict[str, Any]]] = defaultdict(list)
    for event in events:
        if event.get("ph") == "X" and "dur" in event:
            threads[event["pid"], event["tid"]].append(event)
    totals: dict[str, dict[str, float]] = {"CrRendererMain": {}, "CrGpuMain": {}}
    for thread, own in threads.items():
        kind = names.get(thread, "")
        if kind not in totals:
            continue
        split = _self_times(own)
        if sum(split.values()) > sum(totals[kind].values()):
            totals[kind] = split
    main = totals["CrRendererMain"]
    return {**{kind: main.get(kind, 0.0) for kind in [*TRACED, "other"]}, "gpu": sum(totals["CrGpuMain"].values())}


def _self_times(events: list[dict[str, Any]]) -> dict[str, float]:
    """Milliseconds of each kind without those of the events within; an unnamed event counts for what is around it."""
    kinds = {name: kind for kind, own in TRACED.items() for name in own}
    out: dict[str, float] = defaultdict(float)
    stack: list[tuple[float, str]] = []
    for event in sorted(events, key=lambda e: (e["ts"], -e["dur"])):
        while stack and stack[-1][0] <= event["ts"]:
            stack.pop()
        ms = event.get("tdur", event["dur"]) / 1e3
        around = stack[-1][1] if stack else None
        kind = kinds.get(event["name"], around or "other")
        out[kind] += ms
        if around is not None:
            out[around] -= ms
        stack.append((event["ts"] + event["dur"], kind))
    return dict(out)
