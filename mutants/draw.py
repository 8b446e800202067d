"""Mutants at random: simple operators at random functions of Python, the same for a seed while the functions live."""

from __future__ import annotations

import ast
import hashlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from mutants.places import ROOT, Function, Mutant, positions, sources, start_of, symbols

_SWAPS: dict[type, tuple[str, str, str]] = {
    ast.Add: ("+", "-", "sign"),
    ast.Sub: ("-", "+", "sign"),
    ast.Mult: ("*", "/", "factor"),
    ast.Div: ("/", "*", "factor"),
    ast.Lt: ("<", "<=", "limit"),
    ast.LtE: ("<=", "<", "limit"),
    ast.Gt: (">", ">=", "limit"),
    ast.GtE: (">=", ">", "limit"),
    ast.Eq: ("==", "!=", "comparison"),
    ast.NotEq: ("!=", "==", "comparison"),
    ast.Is: ("is", "is not", "comparison"),
    ast.IsNot: ("is not", "is", "comparison"),
    ast.And: ("and", "or", "logic"),
    ast.Or: ("or", "and", "logic"),
}


class Edit(NamedTuple):
    """A text at a place of a file, what replaces it, and what kind of fault that is."""

    start: int
    old: str
    new: str
    kind: str


def drawn(count: int, seed: int, only: tuple[str, ...] = (), root: Path = ROOT) -> list[Mutant]:
    """That many mutants, at most one in each function.

    Functions are ranked by a hash of the seed with their names and arguments, and so are the places in each: whether a
    function is drawn depends on no other and on no file, and the same ones come again after files have moved.

    Parameters
    ----------
    count : how many, fewer if there are not as many functions.
    seed : another draws others.
    only : parts of the paths of files, such as "io/" or "deformnb/rbf.py"; all files if empty.
    """
    ranked = []
    for path in sources(root):
        name = path.relative_to(root).as_posix()
        if path.suffix == ".py" and name.startswith("deformnb/") and (not only or any(part in name for part in only)):
            text = path.read_text(encoding="utf-8")
            ranked += [(_rank(seed, symbol, ast.unparse(node.args)), name, symbol, node, text)
                       for symbol, node in symbols(ast.parse(text)) if isinstance(node, Function)]
    mutants: dict[str, Mutant] = {}  # functions of one name and the same arguments would all be drawn at once
    for rank, name, symbol, node, text in sorted(ranked, key=lambda row: row[:3]):
        if len(mutants) == count:
            break
        found = list(edits(node, text))
        if found and rank not in mutants:
            first = start_of(node, text)
            keys = {edit: _rank(seed, symbol, text.count(edit.old, first, edit.start), *edit[1:]) for edit in found}
            chosen = min(found, key=keys.__getitem__)
            mutants[rank] = Mutant(f"{name}:{symbol}", name, symbol, chosen.old, chosen.new, chosen.kind,
                                   offset=chosen.start - first)
    return list(mutants.values())


def _rank(*key: object) -> str:
    return hashlib.sha256(repr(key).encode()).hexdigest()


def edits(function: ast.stmt, text: str) -> Iterator[Edit]:
    """All edits that the operators know in a function; annotations, docstrings and texts with fields stay."""
    at = positions(text)

    def span(node: ast.AST) -> tuple[int, int]:
        return at(node.lineno, node.col_offset), at(node.end_lineno, node.end_col_offset)  # type: ignore[attr-defined]

    for node in _code(function):
        for operands, operator in _operators(node):
            yield from _swapped(text, span(operands[0])[1], span(operands[1])[0], operator)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            start, end = span(node)
            yield Edit(start, text[start:end], re.sub(r"^not\b\s*", "", text[start:end]), "dropped not")
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
            start, end = span(node)
            yield Edit(start, text[start:end], f"({text[start:end]} + 1)", "constant")
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call | ast.Await):
            start, end = span(node)
            yield Edit(start, text[start:end], "pass", "dropped call")
        elif isinstance(node, ast.Call) and len(node.args) > 1 and not isinstance(node.args[1], ast.Starred):
            (start, middle), (after, end) = span(node.args[0]), span(node.args[1])
            one, other = text[start:middle], text[after:end]
            if one != other and not isinstance(node.args[0], ast.Starred):
                yield Edit(start, text[start:end], other + text[middle:after] + one, "argument order")


def _operators(node: ast.AST) -> Iterator[tuple[tuple[ast.AST, ast.AST], ast.AST]]:
    """The operators of an expression, each with what stands before and behind it."""
    if isinstance(node, ast.BinOp):
        yield (node.left, node.right), node.op
    elif isinstance(node, ast.BoolOp):
        yield (node.values[0], node.values[1]), node.op
    elif isinstance(node, ast.Compare):
        yield from zip(zip([node.left, *node.comparators], node.comparators, strict=False), node.ops, strict=True)


def _swapped(text: str, start: int, end: int, operator: ast.AST) -> Iterator[Edit]:
    if type(operator) in _SWAPS:
        old, new, kind = _SWAPS[type(operator)]
        match = re.search(old.replace(" ", r"\s+") if old.isalpha() else re.escape(old), text[start:end])
        if match:
            yield Edit(start + match.start(), match[0], new, kind)


def _code(node: ast.AST) -> Iterator[ast.AST]:
    for name, value in ast.iter_fields(node):
        if name not in ("annotation", "returns", "decorator_list"):
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST) and not isinstance(child, ast.JoinedStr):
                    yield child
                    yield from _code(child)


def files_for(mutant: Mutant, root: Path = ROOT, most: int = 12) -> tuple[str, ...]:
    """The test files that see the mutant: the module's examples and own tests, those that import it or say its name.

    Where these are few, those of the modules that import it come after them.
    """
    files = {path: path.read_text(encoding="utf-8") for path in sorted((root / "tests").rglob("test_*.py"))}
    chosen = _tests_of(mutant.file, mutant.symbol, files)
    if len(chosen) < most // 2:
        package = {path: path.read_text(encoding="utf-8") for path in sources(root) if path.suffix == ".py"}
        users = [path.relative_to(root).as_posix() for path, text in package.items() if _imports(text, mutant.file)]
        chosen += sorted((test for user in users for test in _tests_of(user, mutant.symbol, files)[:most // 2]),
                         key=lambda path: ("browser" in path.parts, len(files[path])))
    names = dict.fromkeys([mutant.file, *(path.relative_to(root).as_posix() for path in chosen)])
    return tuple(names)[:most]


def _tests_of(file: str, symbol: str, files: dict[Path, str]) -> list[Path]:
    """The best first: of the module's name, of its package's, those that import it, those that say the symbol's."""
    parts = Path(file).with_suffix("").parts[1:]
    own = {f"test_{'_'.join(parts[k:])}.py" for k in range(len(parts))}
    package = f"test_{parts[0]}_" if len(parts) > 1 else "/"
    *scope, name = symbol.split(".")
    says = None if name.startswith("_") else re.compile(rf"\.{name}\b" if scope else rf"\b{name}\b")

    def order(path: Path) -> tuple[bool, ...]:
        text = files[path]
        return (path.name not in own, not path.name.startswith(package), not _imports(text, file),
                not any(re.search(rf"\b{word}\b", text) for word in (*scope, name)), "browser" in path.parts)

    found = [path for path in files if not all(order(path)[:3]) or (says and says.search(files[path]))]
    return sorted(found, key=lambda path: (order(path), len(files[path])))


def _imports(text: str, file: str) -> bool:
    module = ".".join(Path(file).with_suffix("").parts).removesuffix(".__init__")
    parent, _, last = module.rpartition(".")
    return bool(re.search(rf"^\s*(?:from|import) {re.escape(module)}\b(?!\.)", text, re.MULTILINE)
                or re.search(rf"^\s*from {re.escape(parent)} import .*\b{last}\b", text, re.MULTILINE))
