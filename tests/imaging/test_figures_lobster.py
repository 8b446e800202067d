"""Figure 5 of the paper: the lobster swims. The cells of the notebook run here, and their measurements are tested."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deformnb.imaging.figures import picture_field
from deformnb.warping.points import warp_points

NOTEBOOK = Path(__file__).resolve().parents[2] / "notebooks" / "05_swim_a_lobster.ipynb"


def run_cells(folder: Path, monkeypatch: pytest.MonkeyPatch, *, real: bool = False) -> dict[str, Any]:
    """The names of the notebook after its numbers, before anything is rendered."""
    monkeypatch.chdir(folder)
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    sources = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    numbers = sources[: next(k for k, source in enumerate(sources) if "LiveView" in source)]
    scope: dict[str, Any] = {}
    for source in numbers:
        text = source.replace("%matplotlib inline", "")
        exec(text.replace("real = False", "real = True") if real else text, scope)
    return scope


def check(scope: dict[str, Any]) -> None:
    # The tail, measured along joints that the fit bends smoothly, preserves its length to 3 % at every moment; straight
    # ways of the same points leave (cos 16 + cos 33 + cos 49 + cos 65 degrees) / 4 = 0.72 of it.
    assert min(scope["solved"]) > 0.97
    assert max(scope["solved"]) < 1.01
    assert min(scope["blended"]) < 0.75
    # Frames five degrees apart are read with an error far below the visible one.
    assert scope["worst"] / min(scope["volume"].grid.spacing) < 0.1
    # Fixed points are fixed in every frame but for the raster, and the loop closes.
    assert scope["still"] < 0.1
    assert scope["gap"] == 0
    maps, grid = scope["maps"], scope["volume"].grid
    assert maps.full_bytes(grid) == len(maps) * 12 * int(np.prod(grid.shape))
    assert 60 < maps.full_bytes(grid) / maps.nbytes < 100


def test_the_tail_swings_and_nothing_shrinks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scope = run_cells(tmp_path, monkeypatch)
    check(scope)
    assert "27 control points, 2 key frames" in capsys.readouterr().out
    # Where the end of the tail goes: 65 degrees to one side and the other, and through the middle.
    tip = np.array(scope["tail"][-1:], dtype=float)
    animation, grid = scope["animation"], scope["volume"].grid
    fields = [picture_field(animation.at(t).steps[0], grid) for t in (0.0, 0.5, 1.0, 1.5)]
    ways = [float(warp_points(tip, field)[0][0, 0]) for field in fields]
    assert ways[0] < 120 - 60
    assert ways[1] == pytest.approx(120, abs=4)
    assert ways[2] > 120 + 60
    assert ways[3] == pytest.approx(ways[1])  # in the second half
    assert animation.notes == ()


@pytest.mark.nightly
def test_the_papers_own_lobster_swims_too(
    real_data: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DEFORMNB_DATA", str(real_data("lobster.nrrd").parent))
    check(run_cells(tmp_path, monkeypatch, real=True))
