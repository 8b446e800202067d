"""Helpers of the tests of the command line: a folder to work in, a runner of lines, and the form of an error."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deformnb.cli.main import main
from deformnb.document.deformation import Deformation, VolumeReference
from deformnb.io import write_volume
from deformnb.io.documents import write_deformation
from deformnb.rbf.points import ControlPoints
from deformnb.volume.volume import Volume


def small_folder(folder: Path) -> Path:
    """A folder with a tiny volume and a session made on it."""
    values = np.random.default_rng(5).integers(0, 200, (6, 7, 8)).astype(np.uint8)
    volume = Volume.from_array(values, spacing=(1, 2, 1.5), name="tiny")
    write_volume(volume, folder / "tiny.nrrd")
    points = ControlPoints.from_arrays([[1, 1], [6, 1], [3, 6], [2, 3]], [[1, 2], [6, 1], [3, 5], [3, 3]])
    deformation = Deformation.from_picture_points(volume.grid, "+y", points)
    write_deformation(Deformation(deformation.steps, "pull", VolumeReference.of(volume)), folder / "pull.json")
    return folder


def run(folder: Path, line: str, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.chdir(folder)
    return main(shlex.split(line))


def error_sentence(captured: Any, code: int) -> str:
    """The one sentence on standard error."""
    assert code == 2
    assert captured.out == ""
    lines = [line for line in captured.err.splitlines() if not line.startswith("deformnb: note: ")]
    assert len(lines) == 1, captured.err
    assert lines[0].startswith("deformnb")
    assert "Traceback" not in captured.err
    assert lines[0].isprintable()
    return lines[0]
