"""The latency benchmark's own parts: its report, its notebooks and its hooks in a page, without a notebook server."""

from __future__ import annotations

import ast
import statistics
from typing import Any

import pytest
from scripts import chromium

from benchmarks import latency
from benchmarks.latency_cells import CASES
from benchmarks.latency_page import HOOKS, Seat, Seen

DRAG = {"inputs_hz": 60.0, "view_hz": 20.0, "editor_hz": 45.0, "catch_up_ms": 30.0}


def result(*edits: float) -> dict[str, Any]:
    return {"edit_ms": list(edits), "editor_ms": [10.0], "whole_ms": [900.0], "bytes_up": 500.0, "bytes_down": 1500.0,
            "short_drag": DRAG, "long_drag": DRAG | {"editor_hz": 29.0},
            "memory_mib": {"kernel": 300.0, "kernel_growth": 0.2, "page": 40.0, "page_growth": -1.0}}


def test_the_report_compares_with_the_rival_and_says_what_is_missed() -> None:
    results = {"Editor + LiveView": result(80.0, 90.0, 200.0), "Editor + VolumeView": {"failed": "open: no OpenGL"},
               "pyvista, trame": result(300.0, 225.0, 180.0)}
    text = latency._table(128, results)
    ours = next(line for line in text.splitlines() if line.startswith("| Editor + LiveView"))
    assert [cell.strip() for cell in ours.split("|")[2:7]] == ["90", "200", "2.5", "900", "0.5 + 1.5"]
    failed = next(line for line in text.splitlines() if line.startswith("| Editor + VolumeView"))
    assert set(failed.removeprefix("| Editor + VolumeView").replace("|", " ").split()) == set()
    assert "- Editor + VolumeView failed. open: no OpenGL" in text
    assert latency.verdicts(results) == [
        "- Editor + LiveView: 90 ms, wanted at most 100: met",
        "- Editor + LiveView: 2.5 times faster than pyvista, trame, wanted 3: MISSED",
        "- Editor + LiveView: picture and grid at 29 Hz, wanted 30: MISSED",
    ]


def test_one_view_alone_is_reported() -> None:
    text = latency._table(64, {"Editor + LiveView": {"edit_ms": [50.0]}})
    assert "| 50 | 50 |" in text
    assert "times faster than" not in text


@pytest.mark.parametrize("name", CASES)
def test_the_cells_are_python(name: str) -> None:
    for cell in CASES[name](32):
        ast.parse(cell)


def test_times_are_counted_from_the_first_input() -> None:
    seat = object.__new__(Seat)
    seat.seen = Seen(inputs=[1000.0, 1016.0], view=[990.0, 1120.0, 1080.0])
    assert seat._after(seat.seen.view) == [80.0, 120.0]
    seat.seen = Seen(view=[990.0])
    assert seat._after(seat.seen.view) == []


PAGE = """<div class="jp-OutputArea"><img id="i" width="80"><canvas id="c" width="80" height="80"></canvas>
<canvas id="g" width="80" height="80"></canvas><div class="dnb-editor"><canvas id="e"></canvas></div></div>
<canvas id="o"></canvas>"""
DRAW = """async () => {
  const frame = () => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
  const sheet = (colour) => { const c = Object.assign(document.createElement("canvas"), { width: 80, height: 80 });
    const p = c.getContext("2d"); p.fillStyle = colour; p.fillRect(0, 0, 80, 80); return c; };
  const show = (colour) => new Promise((done) => { i.onload = done; i.src = sheet(colour).toDataURL(); });
  const said = {}, h = window.deformnbLatency;
  const took = async (name) => { await frame(); said[name] = h.paints.map(([, p, k]) => `${p} ${k}`); h.paints = []; };
  await took("nothing");
  await show("red"); await took("image");
  await show("red"); await took("the same image");
  await show("blue"); await took("another image");
  const c2 = c.getContext("2d");
  c2.drawImage(sheet("red"), 0, 0); c2.drawImage(sheet("blue"), 0, 0); await took("canvas");
  c2.drawImage(sheet("blue"), 0, 0); await took("the same canvas");
  e.getContext("2d").putImageData(new ImageData(4, 4), 0, 0); await took("editor");
  o.getContext("2d").putImageData(new ImageData(4, 4), 0, 0); await took("elsewhere");
  const gl = g.getContext("webgl2");
  if (gl) {
    const made = (type, text) => { const s = gl.createShader(type); gl.shaderSource(s, text); gl.compileShader(s);
      return s; };
    const p = gl.createProgram();
    gl.attachShader(p, made(gl.VERTEX_SHADER, "#version 300 es\\nvoid main() { gl_Position = vec4(0, 0, 0, 1); }"));
    gl.attachShader(p, made(gl.FRAGMENT_SHADER, "#version 300 es\\nout lowp vec4 c; void main() { c = vec4(1); }"));
    gl.linkProgram(p); gl.useProgram(p);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    for (let k = 0; k < 100 && !h.paints.length; k++) await frame();
    await took("webgl");
    gl.bindFramebuffer(gl.FRAMEBUFFER, gl.createFramebuffer());
    gl.drawArrays(gl.TRIANGLES, 0, 0);
    for (let k = 0; k < 10; k++) await frame();
    await took("webgl beside the screen");
  }
  return said;
}"""


@pytest.mark.needs_browser
def test_the_hooks_see_what_changes_the_screen() -> None:
    path = chromium()
    if path is None:
        pytest.skip("no Chromium with Playwright: apt-get install chromium, pip install playwright")
    from browser.live_page import ARGUMENTS
    from playwright.sync_api import sync_playwright

    with sync_playwright() as p:
        browser = p.chromium.launch(executable_path=path, args=ARGUMENTS)
        page = browser.new_page()
        page.set_content(PAGE)
        page.evaluate(HOOKS.read_text())
        said = page.evaluate(DRAW)
        page.mouse.move(20, 30)
        page.keyboard.press("a")
        page.wait_for_function("deformnbLatency.inputs.length >= 2")
        inputs = page.evaluate("[deformnbLatency.inputs, performance.timeOrigin + performance.now()]")
        browser.close()
    drawn = said.pop("webgl", ["view webgl"]), said.pop("webgl beside the screen", [])
    assert drawn == (["view webgl"], [])
    assert said == {"nothing": [], "image": ["view img"], "the same image": [], "another image": ["view img"],
                    "canvas": ["view 2d"], "the same canvas": [], "editor": ["editor 2d"], "elsewhere": []}
    assert [kind for _, kind in inputs[0]] == ["pointermove", "keydown"]
    assert all(0 <= inputs[1] - t < 60_000 for t, _ in inputs[0])


def test_medians_are_of_the_edits() -> None:
    assert latency._faster({"edit_ms": [1.0, 10.0, 100.0]}, {"edit_ms": [30.0, 40.0, 5.0]}) == pytest.approx(
        statistics.median([5, 30, 40]) / 10)
