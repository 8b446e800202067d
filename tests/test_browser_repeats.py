"""Repetition of tests, and its report: small suites in separate processes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent

# Each attempt is a line of a file: what a test keeps in memory would be gone under xdist or with a new fixture.
SUITE = """
import os
from pathlib import Path
import pytest

@pytest.fixture
def attempt(request):
    file = Path(os.environ["ATTEMPTS"]) / request.node.name
    with file.open("a") as lines:
        lines.write("x")
    return len(file.read_text())

@pytest.fixture(scope="session")
def server():
    return []

@pytest.fixture(scope="module")
def page(server):
    server.append("opened")
    page = []
    yield page
    if "broken" in page:
        raise RuntimeError("the page complains when it is closed")

@pytest.mark.needs_browser
def test_lost_race(attempt):
    assert attempt == 2, "lost the race"

@pytest.mark.needs_browser
def test_defect(attempt):
    assert attempt == 3, "never came"

def test_unmarked(attempt):
    assert attempt == 2, "plainly wrong"

@pytest.mark.needs_browser
def test_broken_page(page, server, attempt):
    if attempt == 1:
        page.append("broken")
    assert (page, len(server)) == ([], 2), "page is broken"

@pytest.mark.needs_browser
def test_next_on_that_page(page, server):
    assert (page, len(server)) == ([], 2)
"""


def run_suite(folder: Path, *options: str) -> tuple[int, str]:
    """Exit status and print-out of pytest on the suite above."""
    (folder / "test_suite.py").write_text(SUITE, encoding="utf-8")
    (folder / "pytest.ini").write_text("[pytest]\nmarkers =\n    needs_browser: drives a browser\n", encoding="utf-8")
    (folder / "attempts").mkdir(exist_ok=True)
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    environment |= {"ATTEMPTS": str(folder / "attempts"), "PYTHONPATH": str(HERE)}
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "--strict-markers",
        "-p",
        "no:cacheprovider",
        "-p",
        "browser_repeats",
        *options,
    ]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout + done.stderr


def attempts(folder: Path) -> dict[str, int]:
    return {file.name: len(file.read_text(encoding="utf-8")) for file in (folder / "attempts").iterdir()}


@pytest.mark.nightly
@pytest.mark.parametrize("options", [(), ("-n", "2", "--dist", "loadfile")], ids=["one process", "xdist"])
def test_a_browser_test_is_repeated_once_and_every_repeat_is_printed(tmp_path: Path, options: tuple[str, ...]) -> None:
    status, said = run_suite(tmp_path, *options)
    assert status == pytest.ExitCode.TESTS_FAILED, said
    assert "2 failed, 3 passed, 3 rerun" in said
    assert attempts(tmp_path) == {"test_lost_race": 2, "test_defect": 2, "test_unmarked": 1, "test_broken_page": 2}
    section = said[said.index("repeated tests: each is a defect to mend") :]
    assert "test_suite.py::test_lost_race (passed when repeated)\n    AssertionError: lost the race\n" in section
    assert "test_suite.py::test_defect (failed again)\n    AssertionError: never came\n" in section
    assert "test_suite.py::test_broken_page (passed when repeated)\n    AssertionError: page is broken\n" in section
    place = 1 + SUITE[: SUITE.index('"lost the race"')].count("\n")
    assert f"test_suite.py:{place}: AssertionError\n" in section
    assert "plainly wrong" not in section.partition("short test summary info")[0]


def test_where_all_pass_at_once_nothing_is_said(tmp_path: Path) -> None:
    (tmp_path / "attempts").mkdir()
    (tmp_path / "attempts" / "test_lost_race").write_text("x", encoding="utf-8")
    status, said = run_suite(tmp_path, "-k", "lost_race")
    assert status == pytest.ExitCode.OK, said
    assert "defect to mend" not in said


@pytest.mark.nightly
def test_the_debugger_stops_at_the_first_failure(tmp_path: Path) -> None:
    status, said = run_suite(tmp_path, "--pdb", "-k", "lost_race")
    assert status != pytest.ExitCode.USAGE_ERROR, said
    assert attempts(tmp_path) == {"test_lost_race": 1}


def test_this_suite_repeats_its_browser_tests(request: pytest.FixtureRequest) -> None:
    assert request.config.pluginmanager.has_plugin("browser_repeats")
    assert request.config.pluginmanager.has_plugin("rerunfailures")
