"""The command line: its output, its exit codes, and one sentence for every mistake."""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from command_line import error_sentence, run, small_folder

import deformnb
from deformnb.cli import warp as cli_stages
from deformnb.cli.main import main
from deformnb.datasets import PHANTOMS
from deformnb.document.deformation import Deformation
from deformnb.errors import Cancelled
from deformnb.io import FORMATS, read_volume, write_volume
from deformnb.volume.volume import Volume

ROOT = Path(deformnb.__file__).resolve().parent.parent
COMMANDS = ("demo", "warp", "info", "datasets", "doctor")


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a small fish, and the results of a demonstration on it in "out"."""
    folder = tmp_path_factory.mktemp("cli")
    write_volume(PHANTOMS["fish"].make((24, 48, 20)), folder / "fish.nii.gz")
    line = f"demo --volume {folder}/fish.nii.gz --out {folder}/out"
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        assert main(shlex.split(line)) == 0
    (folder / "printed.txt").write_text(printed.getvalue(), encoding="utf-8")
    return folder


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """A folder with a tiny volume and a session made on it."""
    return small_folder(tmp_path)


# ---- demo ------------------------------------------------------------------------------------------------------------


def test_demo_says_what_it_wrote_and_how_to_go_on(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = (place / "printed.txt").read_text(encoding="utf-8").splitlines()
    assert {Path(line.split()[-1]).name for line in lines[:-1]} == {p.name for p in (place / "out").iterdir()}
    # The proposed command works, and shows the fish half way.
    command = shlex.split(lines[-1].removeprefix("half way there: "))
    assert command[0] == "deformnb"
    assert main(command[1:]) == 0
    assert capsys.readouterr().err == ""
    half, warped = (read_volume(place / "out" / name) for name in ("half.nii.gz", "warped.nii.gz"))
    (place / "out" / "half.nii.gz").unlink()
    assert half.values.any()
    assert (np.array(half.shape) >= warped.shape).all()


def test_demo_may_replace_its_own_results(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*_: Any, **__: Any) -> None:
        raise Cancelled  # the check before it has passed

    monkeypatch.setattr(importlib.import_module("deformnb.imaging.demo"), "run_demo", stop)
    assert run(place, "demo --volume fish.nii.gz --out out", monkeypatch) == 130
    assert (place / "out" / "render.png").exists()


def test_the_session_repeats_the_demo(
    place: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    warped = read_volume(place / "out" / "warped.nii.gz")
    margin = 20 * max(warped.grid.spacing)  # in whole voxels
    margins = " ".join(f"{round(margin / s) * s}" for s in warped.grid.spacing)
    assert run(place, f"warp out/session.json fish.nii.gz again.nrrd --force --margin {margins}", monkeypatch) == 0
    assert capsys.readouterr().out == "again.nrrd\n"
    again = read_volume(place / "again.nrrd")
    start = np.round(again.grid.point_to_index(warped.grid.origin)).astype(int)[::-1]
    part = again.values[tuple(slice(s, s + n) for s, n in zip(start, warped.shape, strict=True))]
    # Other fields of view number the voxels differently: the last digit of a float32 place may round otherwise.
    assert np.abs(part.astype(int) - warped.values).max() <= 1
    assert (part != warped.values).mean() < 1e-3


def test_demo_protects_what_is_not_its_own(
    small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (small / "before.png").write_bytes(b"mine")
    code = run(small, "demo --volume tiny.nrrd --out .", monkeypatch)
    assert "before.png is already there and not from an earlier demo" in error_sentence(capsys.readouterr(), code)
    assert (small / "before.png").read_bytes() == b"mine"
    (small / "before.png").unlink()
    write_volume(read_volume(small / "tiny.nrrd"), small / "warped.nii.gz")
    code = run(small, "demo --volume warped.nii.gz --out . --force", monkeypatch)
    assert "would be overwritten" in error_sentence(capsys.readouterr(), code)


def test_info_names_all_that_it_knows(
    small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (small / "notes.odt").write_text("no volume", encoding="utf-8")
    code = run(small, "info notes.odt", monkeypatch)
    said = error_sentence(capsys.readouterr(), code)
    for kind in (".nii.gz", "folders of slices", ".stl", ".fcsv", ".mrk.json", "sessions (.json)"):
        assert kind in said
    code = run(small, "demo --volume notes.odt --out new", monkeypatch)
    said = error_sentence(capsys.readouterr(), code)
    assert "no known kind of volume file" in said
    assert "sessions" not in said  # of which no demo is made


@pytest.mark.parametrize(
    ("line", "match"),
    [
        ("demo --volume missing.nii.gz --out new", "no such file"),
        ("demo --volume . --out new", "neither a DICOM series nor TIFF"),
        ("demo --volume notes.txt --out new", "no known kind of volume file"),
        ("demo --volume tiny.nrrd --out tiny.nrrd", "is a file"),
        ("demo --volume tiny.nrrd --out tiny.nrrd/sub", "Not a directory"),
        ("demo --volume tiny.nrrd --out new --species Cyprinus", "no figure of Thompson.*Antigonia"),
        ("demo --volume tiny.nrrd --out new --view front", r"unknown view 'front'.*-x"),
        ("demo --volume tiny.nrrd --out new --head up", "argument --head.*left"),
        ("demo --volume tiny.nrrd --out new --renderer povray", "unknown renderer.*core"),
        ("demo --volume tiny.nrrd --out new --spacing 0 1 1", "spacing must be positive"),
        ("demo --volume tiny.nrrd --out new --spacing nan 1 1", "spacing must be three finite"),
        ("demo --volume tiny.nrrd --out new --spacing 1 1", "expected 3 arguments"),
        ("demo --volume empty.nrrd --out new", "nothing on the picture"),
    ],
)
def test_mistakes_of_the_demo(
    line: str, match: str, small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (small / "notes.txt").write_text("no volume", encoding="utf-8")
    write_volume(Volume.from_array(np.zeros((4, 5, 6), np.uint8)), small / "empty.nrrd")
    before = sorted(small.iterdir())
    code = run(small, line, monkeypatch)
    assert re.search(match, error_sentence(capsys.readouterr(), code))
    assert sorted(small.iterdir()) == before  # no empty folder is left


@pytest.mark.parametrize("view", ["-x", "+x", "-z"])
def test_views_with_a_minus_are_no_options(
    view: str, small: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    seen: list[str] = []

    def stop(*_: Any, view: str, **__: Any) -> None:
        seen.append(view)
        raise KeyboardInterrupt

    monkeypatch.setattr(importlib.import_module("deformnb.imaging.demo"), "run_demo", stop)
    assert run(small, f"demo --volume tiny.nrrd --view {view} --out new", monkeypatch) == 130
    assert seen == [view]
    assert not (small / "new").exists()
    assert capsys.readouterr().err.startswith("deformnb: stopped")


def test_a_stopped_demo_leaves_whole_files_only(
    place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    real = cli_stages.SilentStage.move

    def move(self: Any, share: float) -> None:
        if self.name == "render both volumes":
            raise KeyboardInterrupt
        real(self, share)

    monkeypatch.setattr(cli_stages.SilentStage, "move", move)
    code = main(["demo", "--volume", str(place / "fish.nii.gz"), "--out", str(tmp_path / "new"), "--renderer", "core"])
    assert code == 130
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.splitlines()[-1] == "deformnb: stopped; nothing half-done was left behind."
    assert {p.name for p in (tmp_path / "new").iterdir()} == {"before.png", "after.png", "thompson.png"}


# ---- info, datasets, doctor ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [s for k, f in FORMATS.items() if f.write and k != "image" for s in f.suffixes])
def test_info_of_every_kind_of_file(
    suffix: str, small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    write_volume(read_volume(small / "tiny.nrrd"), small / f"my volume{suffix}")
    assert run(small, f"info 'my volume{suffix}'", monkeypatch) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    rows = dict(re.split(r" {2,}", line, maxsplit=1) for line in captured.out.splitlines())
    assert rows["file"] == f"my volume{suffix}"
    assert rows["voxels (x, y, z)"] == "8 x 7 x 6"
    assert rows["spacing"] == "1 x 2 x 1.5" + " mm" * (suffix == ".vti")  # which has no word for an unknown unit


@pytest.mark.parametrize("name", ["pull.json", "PULL.JSON"])
def test_info_of_a_session(
    name: str, small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (small / "pull.json").rename(small / name)
    assert run(small, f"info {name}", monkeypatch) == 0
    out = capsys.readouterr().out
    assert "pull" in out
    assert "4 control points" in out
    assert "8 x 7 x 6 voxels" in out


def test_datasets_lists_credits(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["datasets"]) == 0
    assert "Erlangen" in capsys.readouterr().out


def test_doctor_reports(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor"]) == 0
    assert "float64 solve exact" in capsys.readouterr().out


def test_doctor_reports_a_missing_package(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    metadata = importlib.import_module("importlib.metadata")
    real = metadata.version

    def version(name: str) -> str:
        if name == "pydicom":
            raise metadata.PackageNotFoundError(name)
        return str(real(name))

    monkeypatch.setattr(metadata, "version", version)
    assert main(["doctor"]) == 0
    out = capsys.readouterr().out
    assert re.search(r'missing +pydicom +not installed: no DICOM series\n.*pip install "deformnb-core\[formats\]"', out)


def test_a_missing_optional_package_is_named(
    small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (small / "slice.dcm").write_bytes(bytes(128) + b"DICM" + bytes(100))
    monkeypatch.setitem(sys.modules, "pydicom", None)  # as Python does for a missing package
    code = run(small, "info slice.dcm", monkeypatch)
    assert "needs the package pydicom" in error_sentence(capsys.readouterr(), code)


# ---- help ------------------------------------------------------------------------------------------------------------


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"deformnb {deformnb.__version__}\n"


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_that_explains_every_option(
    command: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    assert main([command, "--help"]) == 0
    out = capsys.readouterr().out
    assert len(out.splitlines()) > 4
    options = re.sub(r"\n {5,}", "  ", out[out.index("options:") :])  # long ones are explained on the next line
    for line in options.splitlines()[1:]:
        assert re.fullmatch(r"  \S.*?  +\S.*", line), f"{line!r} explains nothing"
    assert main(["--help"]) == 0
    assert command in capsys.readouterr().out


def test_nothing_asked_shows_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "Start with: deformnb demo" in captured.err


# ---- surprises -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("error", "match"),
    [
        (MemoryError(), "not enough memory"),
        (OSError(28, "No space left", "out"), "No space left: out"),
        (PermissionError(13, "Permission denied", "/x"), "Permission denied: /x"),
        (ZeroDivisionError("division by zero"), "unexpected ZeroDivisionError.*--traceback"),
        (RuntimeError("two\nlines"), "unexpected RuntimeError: two"),
    ],
)
def test_what_nobody_thought_of_is_one_sentence_too(
    error: Exception, match: str, small: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise error

    monkeypatch.setattr(Deformation, "apply", fail)
    code = run(small, "warp pull.json tiny.nrrd out.nrrd", monkeypatch)
    assert re.search(match, error_sentence(capsys.readouterr(), code))
    if isinstance(error, (ZeroDivisionError, RuntimeError)):
        with pytest.raises(type(error)):
            run(small, "--traceback warp pull.json tiny.nrrd out.nrrd", monkeypatch)


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("terminal", [True, False])
@pytest.mark.parametrize("seconds", [0.0, 0.3, 2.0])
def test_progress_is_shown_only_for_long_work(seconds: float, terminal: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0
    stream = Terminal() if terminal else io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr("tqdm.std.time", lambda: now)
    monkeypatch.setattr("deformnb.cli.warp.time", SimpleNamespace(monotonic=lambda: now))
    with cli_stages.stages() as stage:
        for name in ("first", "second"):
            move = stage(name)
            for share in (0.0, 0.5, 1.0):
                now += seconds
                move(share)
    text = stream.getvalue()
    if seconds < 1:
        assert text == ""
    elif terminal:
        assert "first" in text
        assert "100 %" in text
    else:
        assert text == ""


def test_a_bar_of_work_that_failed_does_not_reach_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(cli_stages, "_PATIENCE", 0.0)

    def work() -> None:
        with cli_stages.stages() as stage:
            stage("first")(0.25)
            raise Cancelled

    with pytest.raises(Cancelled):
        work()
    assert "25 %" in stream.getvalue()
    assert "100 %" not in stream.getvalue()


# ---- as a program ----------------------------------------------------------------------------------------------------


def program(*arguments: str, **options: Any) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    return subprocess.run(
        [sys.executable, "-m", "deformnb", *arguments],
        env=environment,
        text=True,
        check=False,
        **{"capture_output": True, **options},
    )


@pytest.mark.nightly
def test_as_a_program(small: Path) -> None:
    done = program("warp", "pull.json", "tiny.nrrd", "out.nrrd", cwd=small)
    assert (done.returncode, done.stdout, done.stderr) == (0, "out.nrrd\n", "")
    failed = program("warp", "pull.json", "tiny.nrrd", "out.nrrd", cwd=small)
    assert failed.returncode == 2
    assert failed.stderr.count("\n") == 1


@pytest.mark.skipif(os.name != "posix", reason="pipes of a POSIX shell")
@pytest.mark.parametrize("ending", ["| true", "> /dev/full", ">&-"])
def test_output_that_goes_nowhere(ending: str, small: Path) -> None:
    command = f"env PYTHONPATH={shlex.quote(str(ROOT))} {shlex.quote(sys.executable)} -m deformnb datasets {ending}"
    if ending == "| true":
        command = f"set -o pipefail; (sleep 0.2; exec {command.removesuffix(ending)}) {ending}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False, cwd=small)
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr
    if ending == "> /dev/full":
        assert done.returncode == 2
        assert done.stderr == "deformnb: No space left on device.\n"
    else:
        assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    ("command", "absent"),
    [
        (["warp", "--help"], ("jax", "numpy", "vtk", "matplotlib")),
        (["info", "small.nrrd"], ("jax", "scipy.ndimage", "vtk", "matplotlib")),
    ],
    ids=["help", "info"],
)
def test_what_only_describes_loads_nothing_heavy(command: list[str], absent: tuple[str, ...], tmp_path: Path) -> None:
    write_volume(Volume.from_array(np.zeros((2, 3, 4), np.uint8)), tmp_path / "small.nrrd")
    code = (
        f"import sys; from deformnb.cli.main import main; main({command});"
        f"print([m for m in {absent} if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert done.stdout.splitlines()[-1] == "[]"
