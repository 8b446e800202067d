"""A failure is shown although garbage is left whose finalisers fail: a small suite in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent

# Garbage in cycles, which only a collection finds; parsing the long file makes so many objects that one takes place.
SUITE = """
class Unclosed:
    def __init__(self):
        self.cycle = self

    def __del__(self):
        raise ResourceWarning("unclosed")

def test_that_fails():
    left = [Unclosed() for _ in range(20)]
    del left
    assert 1 == 2, "plainly wrong"
""" + "\n".join(f"def f{k}(a, b):\n    return [a + {k} * b for c in range(9) if c > {k}]" for k in range(400))


def test_a_failure_is_shown_whatever_is_collected_meanwhile(tmp_path: Path) -> None:
    (tmp_path / "test_suite.py").write_text(SUITE, encoding="utf-8")
    (tmp_path / "pytest.ini").write_text("[pytest]\n", encoding="utf-8")
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "report_without_gc"]
    done = subprocess.run(
        command, cwd=tmp_path, env={**environment, "PYTHONPATH": str(HERE)}, capture_output=True, text=True, check=False
    )
    told = done.stdout + done.stderr
    assert "plainly wrong" in told
    assert "INTERNALERROR" not in told
    assert done.returncode == 1
