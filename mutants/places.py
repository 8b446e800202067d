"""Places of mutants: a text inside the source of a symbol, in whichever file has that symbol today."""

from __future__ import annotations

import ast
import itertools
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
NOT_COPIED = (
    ".git",
    ".venv",
    ".hypothesis",
    ".mypy_cache",
    ".ruff_cache",
    ".import_linter_cache",
    "__pycache__",
    "build",
    "dist",
    "node_modules",
)
Function = ast.FunctionDef | ast.AsyncFunctionDef
_NOT_SOURCES = ("tests", "mutants", "benchmarks", "notebooks", "docs", "node_modules", "static")


class StaleError(Exception):
    """The text of a mutant is not found once in its symbol: the code has changed, and the mutant must follow."""


@dataclass(frozen=True)
class Mutant:
    """One small fault.

    Parameters
    ----------
    name : of the mutant.
    file : in which the symbol is looked for first, relative to the root.
    symbol : ``function``, ``Class.method`` or the name of a constant of a module.
    old, new : a text that occurs exactly once in the symbol's source, and what stands there instead.
    kind : sign, axis order, off-by-one, swallowed error, ...
    tests : files or node ids that are expected to fail.
    offset : where in the symbol's source the text stands, in characters, if it may occur more than once.
    """

    name: str
    file: str
    symbol: str
    old: str
    new: str
    kind: str
    tests: tuple[str, ...] = field(default=())
    offset: int | None = None


@dataclass(frozen=True)
class Change:
    """The file that a mutant changes, the line, and all of the file's text afterwards."""

    path: Path
    line: int
    text: str


def sources(root: Path) -> Iterator[Path]:
    """The files of Python and TypeScript that a mutant may lie in: not those of tests, notebooks and tools."""
    for path in sorted(root.rglob("*")):
        parts = path.relative_to(root).parts
        if path.suffix in (".py", ".js", ".mjs", ".ts") and len(parts) > 1:
            if parts[0].startswith(".") or parts[0] in NOT_COPIED or set(parts) & set(_NOT_SOURCES):
                continue
            yield path


def placed(mutant: Mutant, root: Path = ROOT) -> Change:
    """The change that the mutant makes, in its file or, when the symbol has moved, in the only other file that fits.

    Raises
    ------
    StaleError
        If the text is not found exactly once in the symbol, or is found in several files.
    """
    own = root / mutant.file
    places = _places(mutant, own) if own.exists() else []
    if not places:
        suffixes = (".py",) if own.suffix == ".py" else (".js", ".mjs", ".ts")
        elsewhere = [path for path in sources(root) if path != own and path.suffix in suffixes]
        places = [place for path in elsewhere for place in _places(mutant, path)]
    if len(places) != 1:
        found = "not found" if not places else "found in " + ", ".join(f"{p.relative_to(root)}:{c}" for p, c in places)
        raise StaleError(f'"{mutant.old}" in {mutant.symbol} of {mutant.file}: {found}')
    path, start = places[0]
    text = path.read_text(encoding="utf-8")
    changed = text[:start] + mutant.new + text[start + len(mutant.old) :]
    if path.suffix == ".py":
        ast.parse(changed)
    return Change(path, text.count("\n", 0, start) + 1, changed)


def _places(mutant: Mutant, path: Path) -> list[tuple[Path, int]]:
    text = path.read_text(encoding="utf-8")
    if mutant.old not in text:
        return []
    spans = python_spans(text, mutant.symbol) if path.suffix == ".py" else script_spans(text, mutant.symbol)
    found = []
    for start, end in spans:
        if mutant.offset is not None:
            if text.startswith(mutant.old, start + mutant.offset):
                found.append((path, start + mutant.offset))
        elif text.count(mutant.old, start, end) == 1:
            found.append((path, text.index(mutant.old, start, end)))
    return found


def python_spans(text: str, symbol: str) -> list[tuple[int, int]]:
    """From where to where, in characters, each definition of the symbol reaches; its decorators belong to it."""
    at = positions(text)
    return [
        (start_of(node, text), at(node.end_lineno or 0, node.end_col_offset or 0))
        for name, node in symbols(ast.parse(text))
        if name == symbol
    ]


@cache
def positions(text: str) -> Callable[[int, int], int]:
    """The function that turns a line and a column of ``ast``, which counts bytes, into a place in the text."""
    lines = text.split("\n")  # as ast does, which knows no other ends of lines
    starts = [0, *itertools.accumulate(len(line) + 1 for line in lines)]
    return lambda line, column: starts[line - 1] + len(lines[line - 1].encode()[:column].decode())


def symbols(tree: ast.Module) -> Iterator[tuple[str, ast.stmt]]:
    """Functions, classes, methods and constants of a module by their names, such as ``Class.method``."""

    def below(body: list[ast.stmt], prefix: str) -> Iterator[tuple[str, ast.stmt]]:
        for node in body:
            if isinstance(node, Function):
                yield prefix + node.name, node
            elif isinstance(node, ast.ClassDef):
                yield prefix + node.name, node
                yield from below(node.body, f"{prefix}{node.name}.")
            elif isinstance(node, ast.Assign | ast.AnnAssign):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                yield from ((prefix + target.id, node) for target in targets if isinstance(target, ast.Name))

    return below(tree.body, "")


def start_of(node: ast.stmt, text: str) -> int:
    """Start of a definition, in characters, with its decorators and its indent."""
    return positions(text)(min([node.lineno, *(d.lineno for d in getattr(node, "decorator_list", []))]), 0)


def script_spans(text: str, symbol: str) -> list[tuple[int, int]]:
    """As :func:`python_spans`, of a function, method, class or constant of TypeScript or of a shader in its text.

    A definition ends at the first line that closes a bracket at its own indent, or on its own line if nothing is open
    at the end of that: so needs no parser, but a formatted file.
    """
    outer, _, inner = symbol.rpartition(".")
    if outer:
        return [
            (start + a, start + b)
            for start, end in script_spans(text, outer)
            for a, b in script_spans(text[start:end], inner)
        ]
    words = (
        r"(?:export\s+)?(?:default\s+)?(?:async\s+)?(?:static\s+)?(?:get\s+|set\s+)?"
        r"(?:function\*?\s+|const\s+|let\s+|class\s+|(?:float|int|bool|void|[bi]?vec\d|mat\d)\s+)?"
    )
    behind = (
        r"=(?!=)|\((?:.*[{(,])?\s*$|\(.*\{.*\}\s*$|\{|extends\b|implements\b|:\s*(?:async\s+)?(?:function|\()"
        r"|:[^=\n]*(?:=>[^=\n]*)*=(?![=>])"
    )
    generic = r"(?:<[^\n]*?>)?"
    declaration = re.compile(rf"^(?P<indent>[ \t]*){words}{re.escape(symbol)}{generic}\s*(?:{behind})", re.MULTILINE)
    return [(match.start(), _script_end(text, match)) for match in declaration.finditer(text)]


def _script_end(text: str, match: re.Match[str]) -> int:
    indent = len(match["indent"])
    end = text.find("\n", match.start())
    first = text[match.start() : end if end >= 0 else len(text)]
    is_whole = sum(map(first.count, "([{")) == sum(map(first.count, ")]}"))
    if is_whole and first.rstrip().endswith((";", "}", ",")):
        return match.start() + len(first)
    closing = re.compile(rf"^[ \t]{{{indent}}}(?:[}})\]]|`;?)(?!.*[{{(]\s*$).*$", re.MULTILINE)
    found = closing.search(text, match.start() + len(first))
    return found.end() if found else len(text)
