"""The parts of the benchmarks: rows and their goals, loops in C, stored ratios; of latency the report, the notebooks
and the hooks in a page, without a notebook server."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from argparse import Namespace
from collections import Counter
from collections.abc import Callable
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scripts import chromium

from benchmarks import bench_edits, bench_rbf, bench_warp, c_loops, latency, once, prediction, problem, ratios
from benchmarks.goals import ROWS
from benchmarks.latency_cells import CASES
from benchmarks.latency_page import HOOKS, Seat, Seen
from benchmarks.latency_report import Results, Verdict, table, verdicts
from benchmarks.studio_cases import CASES as STUDIOS
from benchmarks.studio_cases import application
from benchmarks.studio_cases import cell as studio_cell
from benchmarks.studio_page import RATE, hand_path, split_trace
from deformnb.native import library
from deformnb.rbf.fields import DisplacementField
from deformnb.rbf.fitting import fit_rbf
from deformnb.volume.plane import Raster
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.warper import warp

ROOT = Path(__file__).resolve().parents[1]
DRAG = {"inputs_hz": 60.0, "view_hz": 20.0, "picture_hz": 45.0, "grid_hz": 44.0, "catch_up_ms": 30.0, "view_bytes": 0}


def result(*edits: float) -> dict[str, Any]:
    return {
        "edit_ms": list(edits),
        "picture_ms": [10.0],
        "whole_ms": [900.0],
        "bytes_up": 500.0,
        "bytes_down": 1500.0,
        "bytes_view": 0.0,
        "short_drag": DRAG,
        "long_drag": DRAG | {"grid_hz": 29.0},
        "memory_mib": {"kernel": 300.0, "kernel_growth": 0.2, "page": 40.0, "page_growth": -1.0},
    }


def test_the_table_compares_with_the_rivals_and_says_what_failed() -> None:
    rival = {"edit_ms": [300.0, 225.0, 180.0]}
    results: Results = {
        "Editor + LiveView": result(80.0, 90.0, 200.0),
        "Editor + VolumeView": {"failed": "no OpenGL"},
        "pyvista, trame": rival,
        "pyvista, trame-rca": {"edit_ms": [180.0]},
    }
    text = table(128, results)
    ours = next(line for line in text.splitlines() if line.startswith("| Editor + LiveView"))
    cells = [cell.strip() for cell in ours.split("|")[2:-1]]
    assert cells[:6] == ["90", "200", "10", "900", "0.5 + 1.5", "0.0"]
    assert cells[7:9] == ["45 and 29", "60"]
    assert cells[-2:] == ["2.5", "2.0"]
    failed = next(line for line in text.splitlines() if line.startswith("| Editor + VolumeView"))
    assert set(failed.removeprefix("| Editor + VolumeView").replace("|", " ").split()) == set()
    assert "- Editor + VolumeView failed. no OpenGL" in text


def test_every_target_of_the_views_asked_for_is_judged() -> None:
    lagging = result(200.0) | {"long_drag": DRAG | {"catch_up_ms": 300.0, "view_bytes": 9}}
    results: Results = {"Editor + LiveView": result(80.0, 90.0, 200.0), "pyvista, trame": {"edit_ms": [225.0]}}
    assert [str(verdict).removeprefix("- Editor + LiveView: ") for verdict in verdicts(results)] == [
        "edit to pixels within 100 ms: 90 ms: met",
        "3 times faster than pyvista, trame: 2.5 times: MISSED",
        "picture at 30 Hz in a drag: 45 Hz: met",
        "grid at 30 Hz in a drag: 29 Hz: MISSED",
        "no lag that grows in a long drag: last picture after 30 and 30 ms: met",
        "memory of the kernel within 16 MiB over all edits: +0.2 MiB: met",
        "memory of the page within 4 MiB over all edits: -1.0 MiB: met",
        "no byte of the view in a drag: 0 bytes: met",
    ]
    judged = {verdict.what: verdict.is_met for verdict in verdicts({"Editor + LiveView": lagging})}
    assert not judged["Editor + LiveView: no lag that grows in a long drag"]
    assert not judged["Editor + LiveView: no byte of the view in a drag"]
    unmeasured = verdicts({"Editor + VolumeView": {"failed": "no OpenGL"}})
    assert len(unmeasured) == 6
    assert not any(verdict.is_met for verdict in unmeasured)
    assert str(unmeasured[0]) == "- Editor + VolumeView: edit to pixels within 400 ms: not measured: MISSED"


@pytest.mark.parametrize(
    ("judged", "failed", "status"),
    [
        ([True, True], {}, 0),
        ([True, False], {}, 1),
        ([], {}, 1),
        ([True], {"failed": "open: no"}, 1),
    ],
)
def test_a_target_that_is_missed_is_told_by_the_exit_status(
    judged: list[bool],
    failed: dict[str, str],
    status: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    report = {"load_before": (0.1,), "load_after": (0.2,), "sizes": {64: {"pyvista, trame": failed}}}
    monkeypatch.setattr(latency, "_introduce", lambda: None)
    monkeypatch.setattr(latency, "_measure_all", lambda options: report)
    monkeypatch.setattr(latency, "verdicts", lambda results: [Verdict("a view", "1 ms", met) for met in judged])
    monkeypatch.setattr(latency.signal, "signal", lambda *_: None)
    assert latency.main(["--sizes", "64"]) == status
    assert capsys.readouterr().out.count("MISSED") == judged.count(False)


@pytest.mark.parametrize("name", CASES)
def test_the_cells_are_python(name: str) -> None:
    for cell in CASES[name](32):
        ast.parse(cell)


@pytest.mark.parametrize("case", STUDIOS)
def test_the_programs_of_studios_are_python(case: str, tmp_path: Path) -> None:
    for program in (studio_cell(case, tmp_path, 8), application(case, tmp_path, 8, tmp_path)):
        ast.parse(program)


def test_a_hand_moves_without_jumps_and_comes_back_to_no_place() -> None:
    path = np.array(list(hand_path(4.0)))
    assert len(path) == 4 * RATE
    steps = np.hypot(*np.diff(path, axis=0).T)
    assert 0 < steps.min() < 0.5 < steps.mean() < steps.max() < 6
    assert np.ptp(path, axis=0).min() > 30


def test_a_trace_is_split_into_the_time_of_each_kind_without_what_is_within() -> None:
    def event(name: str, start: int, long: int, thread: int = 1) -> dict[str, Any]:
        return {"ph": "X", "name": name, "ts": start, "dur": long, "pid": 1, "tid": thread}

    names = [
        {"ph": "M", "name": "thread_name", "pid": 1, "tid": tid, "args": {"name": name}}
        for tid, name in ((1, "CrRendererMain"), (2, "CrGpuMain"), (3, "Compositor"))
    ]
    own = [
        event("RunTask", 0, 20_000),
        event("FireAnimationFrame", 1_000, 10_000),
        event("Layout", 2_000, 4_000),
        event("SvgTextLayoutAlgorithm::Layout", 3_000, 1_000),
        event("Paint", 12_000, 3_000),
        event("RunTask", 30_000, 5_000),
    ]
    found = split_trace([*names, *own, event("RunTask", 0, 9_000, 2), event("RunTask", 0, 99_000, 3)])
    expected = {"script": 6.0, "layout": 4.0, "paint": 3.0, "other": 12.0, "gpu": 9.0}
    assert {kind: ms for kind, ms in found.items() if ms} == pytest.approx(expected)


def test_times_are_counted_from_the_first_input() -> None:
    seat = object.__new__(Seat)
    seat.seen = Seen(inputs=[1000.0, 1016.0], view=[990.0, 1120.0, 1080.0])
    assert seat.after(seat.seen.view) == [80.0, 120.0]
    seat.seen = Seen(view=[990.0])
    assert seat.after(seat.seen.view) == []


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
  const ee = e.getContext("2d"), made = (v) => new ImageData(new Uint8ClampedArray(64).fill(v), 4);
  ee.putImageData(made(3), 0, 0); await took("editor");
  ee.putImageData(made(3), 0, 0); await took("the same editor");
  const small = Object.assign(document.createElement("canvas"), { width: 4, height: 4 });
  for (const [v, name] of [[9, "coarse picture"], [9, "the same coarse picture"], [12, "another coarse picture"]]) {
    small.getContext("2d").putImageData(made(v), 0, 0); ee.drawImage(small, 0, 0); await took(name);
  }
  for (const [x, name] of [[5, "grid"], [5, "the same grid"], [6, "another grid"]]) {
    ee.beginPath(); ee.moveTo(0, 0); ee.lineTo(x, 9); ee.lineTo(20, 20); ee.stroke(); await took(name);
  }
  c2.beginPath(); c2.lineTo(3, 3); c2.stroke(); await took("lines elsewhere");
  o.getContext("2d").putImageData(new ImageData(4, 4), 0, 0); await took("elsewhere");
  const gl = g.getContext("webgl2");
  if (gl) {
    const shader = (type, text) => { const s = gl.createShader(type); gl.shaderSource(s, text); gl.compileShader(s);
      return s; };
    const p = gl.createProgram();
    gl.attachShader(p, shader(gl.VERTEX_SHADER, "#version 300 es\\nvoid main() { gl_Position = vec4(0, 0, 0, 1); }"));
    gl.attachShader(p, shader(gl.FRAGMENT_SHADER, "#version 300 es\\nout lowp vec4 c; void main() { c = vec4(1); }"));
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
    from browser.live_page import ARGUMENTS
    from playwright.sync_api import sync_playwright

    with sync_playwright() as p:
        browser = p.chromium.launch(executable_path=chromium(), args=ARGUMENTS)
        page = browser.new_page()
        page.set_content(PAGE)
        page.evaluate(HOOKS.read_text(encoding="utf-8"))
        said = page.evaluate(DRAW)
        page.mouse.move(20, 30)
        page.keyboard.press("a")
        page.wait_for_function("deformnbLatency.inputs.length >= 2")
        inputs = page.evaluate("[deformnbLatency.inputs, performance.timeOrigin + performance.now()]")
        browser.close()
    drawn = said.pop("webgl", ["view webgl"]), said.pop("webgl beside the screen", [])
    assert drawn == (["view webgl"], [])
    assert said == {
        "nothing": [],
        "image": ["view img"],
        "the same image": [],
        "another image": ["view img"],
        "canvas": ["view 2d"],
        "the same canvas": [],
        "editor": ["editor 2d"],
        "the same editor": [],
        "coarse picture": ["editor 2d"],
        "the same coarse picture": [],
        "another coarse picture": ["editor 2d"],
        "grid": ["editor grid"],
        "the same grid": [],
        "another grid": ["editor grid"],
        "lines elsewhere": [],
        "elsewhere": [],
    }
    assert [kind for _, kind in inputs[0]] == ["pointermove", "keydown"]
    assert all(0 <= inputs[1] - t < 60_000 for t, _ in inputs[0])


@pytest.mark.nightly
def test_left_out_nodes_of_thompsons_grids_are_predicted_as_the_documentation_says() -> None:
    said = (Path(__file__).parents[1] / "docs" / "prediction.md").read_text(encoding="utf-8")
    rows = [line.split("|")[1:-1] for line in said.splitlines() if " to " in line and line.startswith("|")]
    found = prediction.errors()
    assert [(row[0].strip(), row[1].strip()) for row in rows] == [(one.case.name, one.case.left_out) for one in found]
    for row, one in zip(rows, found, strict=True):
        assert [one.error[method] for method in prediction.METHODS] == pytest.approx(
            [float(value) for value in row[2:7]], abs=0.06
        ), row
        assert row[8].strip() == one.chosen
        assert prediction.is_reached(one), row
    middle = {method: np.median([one.error[method] for one in found]) for method in prediction.METHODS}
    assert middle["chosen"] < min(middle["plate backward"], middle["plate forward"], middle["default"])


def test_a_chosen_fit_predicts_a_pair_of_grids_as_the_documentation_says() -> None:
    said = (Path(__file__).parents[1] / "docs" / "prediction.md").read_text(encoding="utf-8")
    case = list(prediction.grids())[4]
    start = f"| {case.name} | {case.left_out} |"
    row = next(line.split("|")[1:-1] for line in said.splitlines() if line.startswith(start))
    found = prediction.measure(case)
    assert found.error["chosen"] == pytest.approx(float(row[5]), abs=0.06)
    assert found.ratio < 0.75
    assert found.chosen == row[8].strip()


@pytest.mark.nightly
def test_landmarks_of_mice_are_predicted_as_the_documentation_says(real_data: Callable[[str], Path]) -> None:
    said = (Path(__file__).parents[1] / "docs" / "prediction.md").read_text(encoding="utf-8")
    rows = [line.split("|")[1:-1] for line in said.splitlines() if line.startswith("| landmarks of two mice")]
    files = [str(real_data(f"landmarks/slicer_mouse_{name}.mrk.json")) for name in ("A_J", "CAST_EIJ")]
    found = prediction.errors(prediction.landmarks(*files))
    for row, one in zip(rows, found, strict=True):
        assert row[1].strip() == one.case.left_out
        assert [one.error[method] for method in prediction.METHODS] == pytest.approx(
            [float(value) for value in row[2:7]], abs=0.006
        ), row
        assert prediction.is_reached(one), row


@pytest.mark.parametrize(
    ("past", "now", "is_named"),
    [
        ([], 9.0, False),
        ([1.0], 1.34, False),
        ([1.0], 1.36, True),
        ([1.0, 1.0, 1.25, 1.25], 1.19, False),
        ([1.0, 1.0, 1.25, 1.25], 1.21, True),
        ([1.0, 1.0, 1.0, 1.25], 1.25, False),
        ([1.4, 1.0, 1.0], 1.3, False),
    ],
)
def test_a_ratio_is_named_that_is_much_worse_or_worse_three_times(
    past: list[float], now: float, is_named: bool
) -> None:
    named = ratios.worse([{"warp / C, gcc": ratio} for ratio in past], {"warp / C, gcc": now})
    assert [line.partition(":")[0] for line in named] == ["warp / C, gcc"] * is_named


def test_ratios_are_kept_for_each_machine(tmp_path: Path) -> None:
    file = tmp_path / "ratios.json"
    assert ratios.compare(file, "AVX2", "slow", {"a / C, gcc": 1.0}) == []
    assert ratios.compare(file, "AVX2", "fast", {"a / C, gcc": 2.0}) == []
    assert ratios.compare(file, "AVX-512", "slow", {"a / C, gcc": 3.0}) == []
    assert len(ratios.compare(file, "AVX2", "slow", {"a / C, gcc": 2.0})) == 1
    file.write_text("[]", encoding="utf-8")
    with pytest.raises(SystemExit, match="no file of ratios"):
        ratios.compare(file, "AVX2", "slow", {})
    assert file.read_text(encoding="utf-8") == "[]"


@pytest.mark.parametrize(
    ("flags", "width"),
    [
        ("sse4_2 avx2 fma bmi2 avx512f avx512bw avx512cd avx512dq avx512vl", "AVX-512"),
        ("sse4_2 avx2 fma bmi2 avx512f", "AVX2"),
        ("sse4_2 avx", "SSE"),
        ("fp asimd", "NEON"),
        ("", "generic"),
    ],
)
def test_machines_are_told_apart_by_the_width_of_their_vectors(flags: str, width: str) -> None:
    assert ratios.width_of(flags) == width


def test_ratios_of_a_forced_level_are_not_stored() -> None:
    for level in library.levels():
        before = library.use_level(level)
        assert bool(ratios.why_not_stored()) == (level != library.levels()[-1])
        library.use_level(before)


def test_the_stored_ratios_are_those_of_rows() -> None:
    widths = json.loads((ROOT / "benchmarks" / "ratios.json").read_text(encoding="utf-8"))
    runs = [run for machines in widths.values() for runs in machines.values() for run in runs]
    assert {name.rpartition(" / ")[0] for run in runs for name in run} <= set(ROWS)


def test_the_documentation_has_every_row() -> None:
    said = (ROOT / "docs" / "speed.md").read_text(encoding="utf-8")
    lines = iter(said.splitlines())
    assert any(line.startswith("| | deformnb | C, gcc |") for line in lines)
    table = [line.split("|")[1].strip() for line in takewhile(lambda line: line.startswith("|"), lines)]
    assert table[1:] == list(ROWS)


def test_every_row_is_measured_once() -> None:
    options = Namespace(size=24, points=32, dtype="uint8", threads=1, rounds=1, loops=True)
    groups = [group for module in (bench_rbf, bench_warp, bench_edits) for group in module.groups(options)]
    found = Counter(case.row for group in groups for case in group.cases if case.row)
    beginnings = "first volume", "five changes", "deformnb warp", "two threads", "peak memory"
    alone = [row for row in ROWS if row.startswith(beginnings)]
    assert found == Counter(row for row in ROWS if row not in alone)
    compilers = c_loops.commands()
    for group in groups:
        names = [case.name for case in group.cases]
        for row in (case.row for case in group.cases if case.row):
            assert {f"{ROWS[row].peer}, {compiler}" for compiler in compilers} <= set(names), row


def test_rows_that_are_measured_alone_are_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each in a process of its own, which the nightly run starts: here their answers are given."""
    kinds = "replicated", "modulated", "general"
    answers: dict[str, Any] = {
        "first": 100.0,
        "threads": {f"{kind} {name}": 1.0 for kind in kinds for name in ("deformnb", "C, gcc")},
        "memory": {"points on a picture": 1.1, "points in space": 1.2},
    }

    def run(command: list[str], **_: Any) -> Any:
        answer = answers[command[command.index("benchmarks.once") + 1]]
        return subprocess.CompletedProcess(command, 0, json.dumps(answer), "")

    monkeypatch.setattr(subprocess, "run", run)
    groups = [measure for name, measure in once.measure(Namespace(rounds=1)) if name != "C1: command"]
    judged = [row for measure in groups for row in measure()]
    assert {name for name, _, _ in judged} <= set(ROWS)
    assert all(peers == {"C, gcc": 1.0} for name, _, peers in judged if name.startswith("two threads"))


@pytest.mark.parametrize("compiler", c_loops.COMPILERS)
@pytest.mark.parametrize("dtype", ["uint8", "int16", "float32"])
def test_the_loops_in_c_compute_what_warps_do(dtype: str, compiler: str) -> None:
    if compiler not in c_loops.commands():
        pytest.skip(f"no {compiler}")
    loops = c_loops.libraries(dtype)[compiler]
    rng = np.random.default_rng(3)
    shape = (70, 41, 134)
    values = rng.integers(0, 256, shape).astype(dtype)
    volume = Volume(values, Grid(shape))
    d = (6 * rng.standard_normal((*shape, 3))).astype(np.float32)
    field, fill = DisplacementField(d, volume.grid), 9.0
    _compare_voxels(
        c_loops.general(loops, values, c_loops.components(d), fill)(), warp(volume, field, fill=fill).values
    )
    for axis in range(3):
        rest = [2 - a for a in range(3) if a != axis]
        flat = d.take(0, axis)[..., rest]
        same = np.zeros((*np.delete(shape, axis), 3), np.float32)
        same[..., rest] = flat
        moved = DisplacementField(np.repeat(np.expand_dims(same, axis), shape[axis], axis), volume.grid)
        right = warp(volume, moved, fill=fill).values
        given = values, flat[..., 0], flat[..., 1], fill, axis
        _compare_voxels(c_loops.rows(loops, *given)(), right)
        if axis < 2:
            _compare_voxels(c_loops.rows_in_place(loops, *given)(), right)
        if dtype == "uint8":
            rough = c_loops.rows(loops, *given, function="rows_of_8_bits")()
            assert np.abs(rough.astype(int) - right).max() <= 2
    weights = np.sin(np.linspace(0, np.pi, shape[0])).astype(np.float32)
    bent = np.zeros_like(d)
    bent[..., :2] = weights[:, None, None, None] * d[5, ..., :2]
    right = warp(volume, DisplacementField(bent, volume.grid), fill=fill).values
    _compare_voxels(c_loops.modulated(loops, values, d[5, ..., 1], d[5, ..., 0], weights, fill)(), right)


def _compare_voxels(found: Any, right: Any) -> None:
    """Compilers may join operations, so that a value of half a number is rounded to the other side."""
    if right.dtype.kind == "f":
        np.testing.assert_allclose(found, right, atol=1e-3)
    else:
        assert np.abs(found.astype(int) - right.astype(int)).max() <= 1
        assert (found != right).mean() < 1e-3


def test_the_sum_in_c_is_that_of_a_fit() -> None:
    raster = Raster((37, 50), (1.0, 1.0), (0.0, 0.0))
    fit = fit_rbf(problem.control_points(12, 2, 48), support=20.0)
    for loops in c_loops.libraries("uint8").values():
        np.testing.assert_allclose(c_loops.sums(loops, fit, raster)(), fit.sample_on_raster(raster), atol=1e-3)


def test_the_summary_has_the_rows_of_the_groups_asked_for() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks", "--size", "24", "--rounds", "1", "--loops", "--groups", "W2"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    _, _, summary = done.stdout.partition("### Summary")
    (row,) = [line for line in summary.splitlines() if line.split("|")[1:2] == [" modulated along z "]]
    cells = [cell.strip() for cell in row.split("|")[1:-1]]
    for compiler, time, share in zip(c_loops.COMPILERS, cells[2:4], cells[6:8], strict=True):
        assert bool(time) == bool(share) == (compiler in c_loops.commands())
    assert cells[-2:] == ["<= 1 x C", ""]  # no goal is set for volumes of this size


@pytest.mark.nightly
def test_the_table_of_a_gpu_is_made_on_another_device_of_the_processor_too() -> None:
    flags = "--xla_force_host_platform_device_count=2 --xla_backend_optimization_level=0"
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks", "gpu", "--size", "24", "--device", "cpu:1", "--rounds", "1"],
        cwd=ROOT,
        env={**os.environ, "XLA_FLAGS": flags},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    rows = [line.split("|")[1:-1] for line in done.stdout.splitlines() if line.startswith("| ")]
    edits = [row for row in rows if row[0].strip().startswith("E")]
    assert {row[0].partition(":")[0].strip() for row in edits} == {"E1", "E2", "E3", "E4"}
    assert all(float(cell) > 0 for row in edits for cell in row[1:])
