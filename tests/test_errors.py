"""Display of errors: a message in IPython, whole tracebacks everywhere else and where they are requested."""

from __future__ import annotations

import pickle
import subprocess
import sys
import traceback
from collections.abc import Callable, Iterator

import pytest
from traitlets.config import Config

import deformnb as dn
from deformnb import errors
from deformnb.errors import Cancelled, DeformError, MissingPackageError, show_tracebacks

FAMILY = [
    value for value in vars(errors).values() if isinstance(value, type) and issubclass(value, DeformError | Cancelled)
]

CAUSED = """
import deformnb as dn
plan = {"steps": 7}
try:
    plan["maps"]
except KeyError as error:
    raise dn.DeformError("the plan has no maps; name some.") from error
"""

Run = Callable[[str], tuple[str, BaseException | None]]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Iterator[Run]:
    """Run a cell in IPython's own shell: its output, and the exception."""
    kind = pytest.importorskip("IPython.core.interactiveshell").InteractiveShell
    shell = kind.instance(config=Config({"HistoryManager": {"enabled": False}}), colors="nocolor")

    def cell(code: str) -> tuple[str, BaseException | None]:
        raised = shell.run_cell(code).error_in_exec
        out, err = capsys.readouterr()
        return out + err, raised

    yield cell
    show_tracebacks(False)
    shell.restore_sys_module_state()
    kind.clear_instance()


def test_a_notebook_shows_the_message_and_the_line_of_the_cell(run: Run) -> None:
    shown, raised = run("import deformnb as dn\ngrid = dn.Grid((4, 4, 4))\nbad = dn.Grid((4, 4, 4), (1.0, -1.0, 1.0))")
    assert isinstance(raised, DeformError)
    first, line, hint = shown.strip().splitlines()
    assert first == f"DeformError: {raised}"
    assert line == "  in line 3: bad = dn.Grid((4, 4, 4), (1.0, -1.0, 1.0))"
    assert "%tb Plain" in hint


@pytest.mark.parametrize("kind", FAMILY, ids=lambda kind: kind.__name__)
def test_the_whole_family_is_shown_so(run: Run, kind: type[Exception]) -> None:
    shown, raised = run(f"from deformnb.errors import {kind.__name__}\nraise {kind.__name__}('stopped here.')")
    assert type(raised) is kind
    assert shown.splitlines()[:2] == [
        f"{kind.__name__}: stopped here.",
        f"  in line 2: raise {kind.__name__}('stopped here.')",
    ]
    assert len(shown.strip().splitlines()) == 3


def test_causes_are_not_shown_and_stay_within_reach(run: Run) -> None:
    shown, raised = run(CAUSED)
    assert "KeyError" not in shown
    assert isinstance(raised, DeformError)
    assert isinstance(raised.__cause__, KeyError)


@pytest.mark.parametrize("ask", ["%tb Plain", "%tb Verbose", "%xmode Plain\n%tb", "dn.errors.show_tracebacks()\n%tb"])
def test_the_last_traceback_can_be_asked_for(run: Run, ask: str) -> None:
    run("%xmode Context")
    run(CAUSED)
    shown, _ = run(ask)
    assert "KeyError: 'maps'" in shown
    assert "DeformError: the plan has no maps; name some." in shown
    assert 'plan["maps"]' in shown
    run("%xmode Context")


def test_tracebacks_can_be_shown_from_now_on_and_no_more(run: Run) -> None:
    show_tracebacks()
    assert "KeyError: 'maps'" in run(CAUSED)[0]
    show_tracebacks(False)
    assert "KeyError" not in run(CAUSED)[0]


def test_other_errors_are_shown_as_ever(run: Run) -> None:
    shown, raised = run("import deformnb as dn\n{}['missing']")
    assert isinstance(raised, KeyError)
    assert "Traceback (most recent call last)" in shown


@pytest.mark.nightly
def test_an_executed_notebook_shows_the_message_alone() -> None:
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    v4 = nbformat.v4
    cells = [v4.new_code_cell(code) for code in (CAUSED, "%tb Plain", "raise dn.Cancelled('stopped.')")]
    notebook = v4.new_notebook(cells=cells)
    nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3", allow_errors=True).execute()
    first, whole, stopped = (cell["outputs"][-1] for cell in notebook.cells)
    assert first["output_type"] == "error"
    assert (first["ename"], first["evalue"]) == ("DeformError", "the plan has no maps; name some.")
    assert len("\n".join(first["traceback"]).splitlines()) == 3
    assert first["traceback"][0] == "DeformError: the plan has no maps; name some."
    assert "KeyError" in "\n".join(whole.get("traceback", [whole.get("text", "")]))
    assert stopped["traceback"][0] == "Cancelled: stopped."


def test_python_shows_the_whole_traceback() -> None:
    done = subprocess.run([sys.executable, "-c", CAUSED], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 1
    assert done.stderr.count("Traceback (most recent call last)") == 2
    assert "%tb" not in done.stderr


def test_without_ipython_all_that_can_be_asked_for_is_pythons_traceback() -> None:
    error = DeformError("wrong.")
    assert error._render_traceback_()[0] == "DeformError: wrong."
    show_tracebacks()
    try:
        assert error._render_traceback_() == traceback.format_exception(error)
    finally:
        show_tracebacks(False)


def test_a_notebook_shows_the_message_in_the_language_that_was_chosen() -> None:
    error = DeformError("point 1 and point 2 are at one place and count as one")
    dn.set_language("de")
    try:
        shown = error._render_traceback_()
    finally:
        dn.set_language(None)
    assert shown[0] == "DeformError: Punkt 1 und Punkt 2 sind an einem Ort und zählen als einer"
    assert "%tb Plain" in shown[-1]
    assert "zeigt" in shown[-1]
    assert str(error).startswith("point 1 and"), "programs see the same message in every language"


def test_errors_are_what_they_were() -> None:
    assert issubclass(DeformError, ValueError)
    assert issubclass(MissingPackageError, ImportError)
    assert not issubclass(Cancelled, DeformError)
    for kind in FAMILY:
        again = pickle.loads(pickle.dumps(kind("words")))
        assert (type(again), again.args) == (kind, ("words",))
