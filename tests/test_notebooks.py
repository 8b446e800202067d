"""The notebooks: each runs without a network, is stored without results, explains itself and ends with a picture."""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from docs.notebook_pages import TAG

ROOT = Path(__file__).resolve().parents[1]
LESSONS = sorted((ROOT / "lessons" / "deformnb_lessons" / "notebooks").glob("*.ipynb"))
CODELESS = [path for path in LESSONS if path.stem.startswith("1")]  # they need no programming, so their code is hidden
HIDDEN = {"jupyter": {"source_hidden": True}, "tags": ["remove-input"]}  # in JupyterLab, and in the documentation
NOTEBOOKS = [*sorted((ROOT / "notebooks").glob("*.ipynb")), *LESSONS]
TIMEOUT = 300  # seconds for a cell: a busy machine renders a movie slowly

# A kernel without a way out: what a notebook needs must be on this machine.
OFFLINE = """
import socket
def refuse(*address, **options):
    raise OSError("a notebook must run without a network")
socket.getaddrinfo = refuse
"""

every_notebook = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def stored(path: Path) -> dict[str, Any]:
    notebook: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return notebook


def text_of(cell: dict[str, Any]) -> str:
    return "".join(cell["source"])


@pytest.fixture
def kernel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Name of a kernel of this interpreter, whatever other kernels there are on the machine."""
    pytest.importorskip("ipykernel")
    for name in ("JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR", "IPYTHONDIR"):
        monkeypatch.setenv(name, str(tmp_path / name.lower()))
    monkeypatch.setenv("JUPYTER_PATH", str(tmp_path / "share"))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), str(ROOT / "lessons")]))
    monkeypatch.setenv("DEFORMNB_DATA", str(tmp_path / "data"))  # what the user has downloaded is not wanted here
    monkeypatch.delenv("XLA_FLAGS", raising=False)  # compiled as for users: it computes for longer than it compiles
    startup = tmp_path / "ipythondir" / "profile_default" / "startup"
    startup.mkdir(parents=True)
    (startup / "offline.py").write_text(OFFLINE, encoding="utf-8")
    spec = {
        "argv": [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"],
        "display_name": "This interpreter",
        "language": "python",
    }
    folder = tmp_path / "share" / "kernels" / "tested"
    folder.mkdir(parents=True)
    (folder / "kernel.json").write_text(json.dumps(spec), encoding="utf-8")
    return "tested"


# What a notebook's text says of its numbers, as the numbers must say it.
SAID = {
    "01_quickstart": [r"128 x 256 x 128 voxels \(x, y, z\)"],
    "02_bend_and_cut_a_bar": [r"together +rule source +gap +0\.00 mm", r"together +rule paper +gap +16\.00 mm"],
    "04_bend_a_knee": [r"rigid parts +40\.0 deg +100\.0% +100\.0% +100% and 100%, at 100% of its places"],
    "06_cut_an_abdomen": [
        r"spine that changed: 0 of \d",
        r"outside the support: 0\.0e\+00 mm; smallest determinant: 0\.",
    ],
    "07_heads_and_horses": [r"nothing folds: True[^$]*nothing folds: True", r"legs move by 0\.0 voxels"],
    "08_a_map_you_can_believe": [
        r"suspect: nape, first ray\n",
        r"as far as is safe .* folded 0\.0 %",
        r"in \d+ stages .* folded 0\.0 %",
        r"at worst, 100\.0 % of the places",
    ],
}


# The tools for notebooks close their sockets late and use what asyncio has deprecated; only the cells are tested here.
@pytest.mark.sampled(8)
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("path", [path for path in NOTEBOOKS if path not in LESSONS], ids=lambda path: path.stem)
def test_it_runs_and_ends_with_a_picture(path: Path, kernel: str, tmp_path: Path) -> None:
    outputs = executed(path, kernel, tmp_path)
    assert any(kind.startswith("image/") for output in outputs[-1] for kind in output.get("data", {}))
    texts = "".join(output.get("text", "") for cell in outputs for output in cell)
    assert not re.search(r"\b(nan|inf)\b", texts), texts
    shares = [float(number) for number in re.findall(r"(-?\d+(?:\.\d+)?) ?%", texts)]
    assert [share for share in shares if not -100 <= share <= 1000] == [], "a share of what was not found"
    for wanted in SAID.get(path.stem, ()):
        assert re.search(wanted, texts), texts


@pytest.mark.nightly
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("path", LESSONS, ids=lambda path: path.stem)
def test_a_lesson_runs_and_passes_no_exercise_that_was_not_done(path: Path, kernel: str, tmp_path: Path) -> None:
    outputs = executed(path, kernel, tmp_path)
    assert any(kind.startswith("image/") for output in outputs[-1] for kind in output.get("data", {}))
    shown = "".join(output.get("data", {}).get("text/plain", "") for cell in outputs for output in cell)
    code = [text_of(cell) for cell in stored(path)["cells"] if cell["cell_type"] == "code"]
    checks = sum("lesson.check(" in cell for cell in code)
    assert shown.count("Your turn. ") == checks
    assert "Not yet." not in shown  # nothing is judged before it is answered
    assert checks > 5 or path in CODELESS
    assert "Right." not in shown


def executed(path: Path, kernel: str, tmp_path: Path) -> list[list[Any]]:
    """Output of each code cell; it has no error, no warning, and no folder of this machine."""
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    notebook = nbformat.read(path, as_version=4)
    work = tmp_path / "work"
    work.mkdir()
    resources = {"metadata": {"path": str(work)}}
    nbclient.NotebookClient(notebook, timeout=TIMEOUT, kernel_name=kernel, resources=resources).execute()
    cells = [cell.outputs for cell in notebook.cells if cell.cell_type == "code"]
    outputs = [output for cell in cells for output in cell]
    assert [output for output in outputs if output.output_type == "error"] == []
    assert [output.text for output in outputs if output.get("name") == "stderr"] == []
    shown = json.dumps([{**output.get("data", {}), "text": output.get("text", "")} for output in outputs])
    assert str(tmp_path) not in shown, "an output names a folder of this machine"
    assert_a_page_shows_the_pictures(notebook, outputs)
    return cells


def assert_a_page_shows_the_pictures(notebook: Any, outputs: list[Any]) -> None:
    """The page that nbconvert makes shows all pictures, although it has the state of widgets too."""
    page, _ = pytest.importorskip("nbconvert").HTMLExporter().from_notebook_node(notebook)
    drawn = [output.data["image/png"].replace("\n", "") for output in outputs if "image/png" in output.get("data", {})]
    assert drawn
    assert [png[:40] for png in drawn if f'src="data:image/png;base64,{png}' not in page] == []


def test_widgets_that_jupyterlab_has_kept_are_pictures_by_the_option_that_the_documentation_names() -> None:
    nbformat, nbconvert = pytest.importorskip("nbformat"), pytest.importorskip("nbconvert")
    option = re.search(r"--(\w+)\.enabled=True", (ROOT / "docs" / "hosts.md").read_text(encoding="utf-8"))
    assert option is not None
    view, state = (f"application/vnd.jupyter.widget-{kind}+json" for kind in ("view", "state"))
    shown = nbformat.v4.new_output("display_data", {view: {"model_id": "one"}, "image/png": "iVBORw0KGgo="})
    model = {"model_name": "AnyModel", "model_module": "anywidget", "state": {}}
    kept = {"widgets": {state: {"state": {"one": model}}}}
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(outputs=[shown])], metadata=kept)
    page, _ = nbconvert.HTMLExporter(config={option[1]: {"enabled": True}}).from_notebook_node(notebook)
    assert 'src="data:image/png;base64,iVBORw0KGgo="' in page


@every_notebook
def test_it_is_stored_without_results(path: Path) -> None:
    notebook = stored(path)
    assert set(notebook["metadata"]) == {"kernelspec", "language_info"}
    assert notebook["metadata"]["kernelspec"]["name"] == "python3"  # what every host has
    cards = [cell for cell in notebook["cells"] if cell["metadata"] == {"tags": [TAG]}]
    assert len(cards) == (path not in LESSONS), "the picture of one cell is the card of the gallery"
    for cell in notebook["cells"]:
        hidden = HIDDEN if path in CODELESS and cell["cell_type"] == "code" else {}
        assert cell in cards or cell["metadata"] == hidden
        if cell["cell_type"] == "code":
            assert cell["outputs"] == []
            assert cell["execution_count"] is None
    wanted = json.dumps(notebook, indent=1, ensure_ascii=False) + "\n"  # as Jupyter writes it: edits differ little
    assert path.read_text(encoding="utf-8") == wanted


@every_notebook
def test_it_explains_itself(path: Path) -> None:
    cells = stored(path)["cells"]
    assert re.match(r"# \S", text_of(cells[0])), "a notebook begins with its title"
    texts = [cell for cell in cells if cell["cell_type"] == "markdown"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert 2 * len(texts) >= len(code)
    assert all(text_of(cell).strip() for cell in cells)
    # At most two cells of code in a row without a word.
    kinds = "".join(cell["cell_type"][0] for cell in cells)
    assert "ccc" not in kinds
    assert max(text_of(cell).count("\n") for cell in code) < 20


@every_notebook
def test_its_lines_fit_a_narrow_window(path: Path) -> None:
    lines = [line for cell in stored(path)["cells"] for line in text_of(cell).splitlines()]
    assert max(len(line) for line in lines) <= 120


# ---- with real volumes, where they are -------------------------------------------------------------------------------


REAL = {
    "03_darcy_thompson_carp": ("carp.nii.gz", [r"the real carp: ", r"largest miss of a node: \d\.\de-\d\d mm"]),
    "04_bend_a_knee": ("knee_labels.nrrd", [r"the real knee_labels: "]),
    "05_swim_a_lobster": (
        "lobster.nrrd",
        [r"the real lobster: ", r"midway between two frames: 0\.[01]\d+ voxels", r"the body moves by 0\.00 mm"],
    ),
    "06_cut_an_abdomen": (
        "abdomen_ct.nii.gz",
        [r"the real abdomen_ct: ", r"the real body opens by 1[0-6]\d\.\d mm at half height"],
    ),
    "07_heads_and_horses": (
        "horse.ply",
        [r"the real head_ct: ", r"9\d{4} triangles", r"nothing folds: True[^$]*nothing folds: True"],
    ),
}


@pytest.mark.nightly
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("name", REAL)
def test_a_figure_is_of_the_real_volume_where_it_is_there(
    name: str, kernel: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, real_data: Callable[[str], Path]
) -> None:
    file, said = REAL[name]
    monkeypatch.setenv("DEFORMNB_DATA", str(real_data(file).parent))
    outputs = executed(ROOT / "notebooks" / f"{name}.ipynb", kernel, tmp_path)
    texts = "".join(output.get("text", "") for cell in outputs for output in cell)
    assert not re.search(r"\b(nan|inf)\b", texts), texts
    for wanted in said:
        assert re.search(wanted, texts), texts
    assert any(kind.startswith("image/") for output in outputs[-1] for kind in output.get("data", {}))


@pytest.mark.nightly
@pytest.mark.filterwarnings("default")
def test_the_knee_that_was_scanned_twice_is_shown(
    kernel: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, real_data: Callable[[str], Path]
) -> None:
    folder = real_data("knee_mr_straight.nrrd").parent
    real_data("knee_mr_bent.nrrd")
    monkeypatch.setenv("DEFORMNB_DATA", str(folder))
    outputs = executed(ROOT / "notebooks" / "04_bend_a_knee.ipynb", kernel, tmp_path)
    texts = "".join(output.get("text", "") for cell in outputs for output in cell)
    assert "both scans are here" in texts
    assert re.search(r"two rigid parts +0\.93 +4\.5 +\| +0\.86 +10\.8", texts), texts
    pictures = [cell for cell in outputs if any("image/png" in output.get("data", {}) for output in cell)]
    assert len(pictures) == 2


def test_the_first_notebook_says_what_differs_and_what_it_does_to_the_studio_above() -> None:
    cells = stored(ROOT / "notebooks" / "01_quickstart.ipynb")["cells"]
    kernels = next(text_of(cell) for cell in cells if "thin_plate" in text_of(cell) and cell["cell_type"] == "code")
    assert "grids=grids, points=[belly] * 3" in kernels  # three fish alone look the same
    bars = next(text_of(cell) for cell in cells if "rules.items()" in text_of(cell))
    assert ".text(" in bars
    dragging, keeping = (
        next(text_of(cell) for cell in cells if text_of(cell).startswith(start))
        for start in ("## 2. Drag it", "Without Python, the same")
    )
    assert "three points and a bent carp instead" in " ".join(dragging.split())
    assert "`head`, `back` and `tail`" in keeping
