"""Put mutants into a copy of the tree, one at a time, and see whether the tests catch them."""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from mutants.draw import drawn, files_for
from mutants.places import NOT_COPIED, ROOT, Mutant, StaleError, placed

NAMED = Path(__file__).with_name("mutants.toml")
_BASELINE_MINUTES = 120
# What pytest returns: 0 all passed, 1 some failed, 2 an error while files were imported; 4 and 5 are no tests.
_VERDICTS = {0: "survived", 1: "caught", 2: "caught"}


def named_mutants(path: Path = NAMED) -> list[Mutant]:
    """The mutants of the table, with the tests that are expected to catch each."""
    rows = tomllib.loads(path.read_text(encoding="utf-8"))["mutant"]
    return [Mutant(**{**row, "tests": tuple(row["tests"])}) for row in rows]


def found_test(test: str, root: Path = ROOT) -> str:
    """The test's node id with the file where it is today: a file that has moved is found by its name."""
    file, colons, node = test.partition("::")
    if (root / file).exists():
        return test
    moved = list((root / "tests").rglob(Path(file).name))
    return f"{moved[0].relative_to(root).as_posix()}{colons}{node}" if len(moved) == 1 else test


class Copy:
    """A copy of the tree in a temporary folder, with what its tests have compiled; it goes when the block ends."""

    def __init__(self, root: Path = ROOT) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="mutants-"))
        self.root = self.folder / "tree"
        self._original = root

    def __enter__(self) -> Copy:
        shutil.copytree(self._original, self.root, symlinks=True, ignore=shutil.ignore_patterns(*NOT_COPIED))
        modules = Path("frontend") / "node_modules"
        if (self._original / modules).is_dir():  # large, and only read
            (self.root / modules).symlink_to(self._original / modules)
        return self

    def __exit__(self, *_: object) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)

    @contextlib.contextmanager
    def mutated(self, mutant: Mutant) -> Iterator[str]:
        """The line that is changed, while the block lasts."""
        change = placed(mutant, self.root)
        original = change.path.read_bytes()
        try:
            self._write(change.path, change.text.encode())
            yield f"{change.path.relative_to(self.root).as_posix()}:{change.line}"
        finally:
            self._write(change.path, original)

    def _write(self, path: Path, data: bytes) -> None:
        path.write_bytes(data)
        if path.suffix == ".ts":
            subprocess.run([sys.executable, "node_tasks.py", "bundle"], cwd=self.root, check=True)
        if path.suffix == ".py":  # by its time alone, in whole seconds, the compiled file would pass for today's
            Path(importlib.util.cache_from_source(str(path))).unlink(missing_ok=True)

    def test(self, tests: list[str], minutes: float) -> tuple[str, str]:
        """Outcome of pytest in a word, and its last line. A run that takes too long hangs, or the machine is busy."""
        environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(str(self.root / name) for name in ("", "lessons", "napari-deformnb")),
        }
        for own in ("PYTEST_ADDOPTS", "PYTHONDONTWRITEBYTECODE"):
            environment.pop(own, None)
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
        log = self.folder / "log"
        with (
            log.open("wb") as out,
            subprocess.Popen(
                command,
                cwd=self.root,
                env=environment,
                stdout=out,
                stderr=out,
                stdin=subprocess.DEVNULL,
                start_new_session=True,
            ) as process,
        ):
            try:
                code = process.wait(minutes * 60)
            except subprocess.TimeoutExpired:
                return "too long", f"it took longer than {minutes:g} minutes"
            finally:
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    os.killpg(process.pid, signal.SIGKILL)  # with the browsers and servers it has started
        lines = log.read_text(errors="replace", encoding="utf-8").strip().splitlines() or [""]
        failed = [line for line in lines if line.startswith(("FAILED", "ERROR"))]
        verdict = "caught" if code < 0 else _VERDICTS.get(code, "no tests")  # below zero a signal has ended it
        return verdict, failed[0][:160] if failed and verdict == "caught" else lines[-1]


def main(arguments: list[str] | None = None) -> int:
    """Run the command: 0 if all mutants were caught, 1 if any was not, 2 if the tests fail without."""
    parser = argparse.ArgumentParser(prog="python -m mutants", description=__doc__)
    parser.add_argument("names", nargs="*", help="the mutants to run; all if none is named")
    parser.add_argument("--list", action="store_true", help="list the mutants and run nothing")
    parser.add_argument("--check", action="store_true", help="only see that each text is found once in its symbol")
    parser.add_argument("--all-tests", action="store_true", help="run all tests, not those named for each mutant")
    parser.add_argument("--random", type=int, metavar="N", help="draw N mutants instead of those of the table")
    parser.add_argument("--seed", type=int, default=1, help="of --random (default: %(default)s)")
    parser.add_argument(
        "--only", nargs="+", default=[], metavar="PART", help='parts of paths for --random, such as "io/"'
    )
    parser.add_argument("--tests", nargs="+", metavar="FILE", help="test files or node ids to run for each mutant")
    parser.add_argument(
        "--files",
        type=int,
        default=12,
        metavar="N",
        help="test files to run for each mutant of --random, its own first (default: %(default)s)",
    )
    parser.add_argument("--minutes", type=float, default=10, help="that a mutant may take (default: %(default)s)")
    parser.add_argument("--no-baseline", action="store_true", help="do not run the tests without a mutant first")
    chosen = parser.parse_args(arguments)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that the copy and what runs in it go
    mutants = named_mutants() if chosen.random is None else drawn(chosen.random, chosen.seed, tuple(chosen.only))
    unknown = set(chosen.names) - {mutant.name for mutant in mutants}
    if unknown:
        parser.error(f"there is no mutant {', '.join(sorted(unknown))}")
    mutants = [mutant for mutant in mutants if not chosen.names or mutant.name in chosen.names]
    if chosen.list:
        for mutant in mutants:
            say(f"{mutant.name}  [{mutant.kind}]  {mutant.file}: {mutant.symbol}: {mutant.old} -> {mutant.new}")
        return 0
    if chosen.check:
        return _check(mutants)
    tests = {
        mutant.name: ["tests", "deformnb"]
        if chosen.all_tests
        else chosen.tests or [found_test(test) for test in mutant.tests or files_for(mutant, most=chosen.files)]
        for mutant in mutants
    }
    return run(mutants, tests, chosen.minutes, baseline=not chosen.no_baseline)


def _check(mutants: list[Mutant]) -> int:
    stale = 0
    for mutant in mutants:
        try:
            placed(mutant)
        except StaleError as reason:
            stale += 1
            say(f"stale     {mutant.name}: {reason}")
    say(f"{len(mutants) - stale} of {len(mutants)} mutants can be placed")
    return int(stale > 0)


def run(
    mutants: list[Mutant], tests: dict[str, list[str]], minutes: float = 10, *, baseline: bool = True, root: Path = ROOT
) -> int:
    """Put in one mutant after the other and print what the tests say; what :func:`main` returns.

    Parameters
    ----------
    tests : test files or node ids, by the name of the mutant.
    minutes : that the tests of one mutant may take.
    baseline : whether to run all of the tests without a mutant first.
    root : of the tree, which is copied and stays as it is.
    """
    counts: Counter[str] = Counter()
    with Copy(root) as copy:
        if baseline:
            every = list(dict.fromkeys(test for names in tests.values() for test in names))
            verdict, line = copy.test(every, _BASELINE_MINUTES)
            say(f"without mutants: {line}")
            if verdict != "survived":
                say("the tests fail without any mutant, so they would catch everything")
                return 2
        for mutant in mutants:
            start = time.monotonic()
            try:
                with copy.mutated(mutant) as place:
                    verdict, line = copy.test(tests[mutant.name], minutes)
            except StaleError as reason:
                verdict, line, place = "stale", str(reason), mutant.file
            counts[verdict] += 1
            say(f"{verdict:9} {mutant.name} ({time.monotonic() - start:.0f} s) {line}")
            if verdict != "caught":
                say(f"          {place}: {mutant.old} -> {mutant.new}  [{mutant.kind}] {' '.join(tests[mutant.name])}")
    say(
        f"{counts['caught']} of {len(mutants)} caught, "
        + ", ".join(f"{counts[word]} {word}" for word in ("survived", "too long", "stale", "no tests"))
    )
    return int(counts["caught"] < len(mutants))


def say(line: str) -> None:
    """Print a line at once: a run takes long and may be read while it goes on."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
