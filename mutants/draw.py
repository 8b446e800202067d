"""Mutants at random: simple operators at random functions, the same for a seed while the functions live.

Python is parsed. In JavaScript, which has one space around each operator between two values, comments, texts (shaders
too) and regular expressions are blanked out, and the operators are looked for in what is left.
"""

from __future__ import annotations

import ast
import hashlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from mutants.places import ROOT, Function, Mutant, positions, script_spans, sources, start_of, symbols

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

_SCRIPT_SWAPS = {swap[0]: swap for swap in _SWAPS.values() if not swap[0].isalpha() and "is" not in swap[0]} | {
    "===": ("===", "!==", "comparison"),
    "!==": ("!==", "===", "comparison"),
    "&&": ("&&", "||", "logic"),
    "||": ("||", "&&", "logic"),
}
_NO_CODE = re.compile(
    r"""//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*'|`(?:\\.|[^`\\])*`"""
    r"""|(?<=[=(,:!&|?] |.[(!])/(?![*/ ])(?:\\.|\[(?:\\.|[^]\\\n])*]|[^/\\\n[])+/""",
    re.DOTALL,
)
_SCRIPT_NAMES = re.compile(
    r"^(?:export )?(?:(?:async )?function\*? |class |const (?=\w+ = (?:async )?\(.*=>))(\w+)", re.MULTILINE
)
_METHODS = re.compile(r"^  (?:static |async |get |set |\*)*(#?\w+)\(.*\{", re.MULTILINE)


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
        if name.startswith(("deformnb/", "frontend/src/", "lessons/")) and (
            not only or any(part in name for part in only)
        ):
            text = path.read_text(encoding="utf-8")
            functions = python_functions(text) if path.suffix == ".py" else script_functions(text)
            ranked += [
                (_rank(seed, symbol, arguments), name, symbol, first, text, found)
                for symbol, arguments, first, found in functions
            ]
    mutants: dict[str, Mutant] = {}  # functions of one name and the same arguments would all be drawn at once
    for rank, name, symbol, first, text, lazily in sorted(ranked, key=lambda row: row[:3]):
        if len(mutants) == count:
            break
        found = list(lazily)
        if found and rank not in mutants:
            keys = {edit: _rank(seed, symbol, text.count(edit.old, first, edit.start), *edit[1:]) for edit in found}
            chosen = min(found, key=keys.__getitem__)
            mutants[rank] = Mutant(
                f"{name}:{symbol}", name, symbol, chosen.old, chosen.new, chosen.kind, offset=chosen.start - first
            )
    return list(mutants.values())


def _rank(*key: object) -> str:
    return hashlib.sha256(repr(key).encode()).hexdigest()


def python_functions(text: str) -> Iterator[tuple[str, str, int, Iterator[Edit]]]:
    """Of each function and method: its symbol, its arguments, where it begins, and its edits."""
    for symbol, node in symbols(ast.parse(text)):
        if isinstance(node, Function):
            yield symbol, ast.unparse(node.args), start_of(node, text), edits(node, text)


def script_functions(text: str) -> Iterator[tuple[str, str, int, Iterator[Edit]]]:
    """As :func:`python_functions`, of a module of TypeScript; functions inside others belong to these."""
    code = _NO_CODE.sub(lambda match: re.sub(r"[^\n]", '"', match[0]), text)
    for match in _SCRIPT_NAMES.finditer(code):
        spans = script_spans(text, match[1])
        is_class = match[0].removeprefix("export ").startswith("class ")
        names = (
            [f"{match[1]}.{inner}" for start, end in spans for inner in _METHODS.findall(code, start, end)]
            if is_class
            else [match[1]]
        )
        for symbol in dict.fromkeys(names):
            places = script_spans(text, symbol)  # several for a getter and a setter, or a method and a function
            for start, end in places:
                if is_class or start == match.start():
                    found = (
                        edit
                        for edit in script_edits(code, start, end, text)
                        if sum(text.startswith(edit.old, place + edit.start - start) for place, _ in places) == 1
                    )
                    yield symbol, code[start : code.find("\n", start)].strip(), start, found


def script_edits(code: str, start: int, end: int, text: str) -> Iterator[Edit]:
    """All edits in a part of a module; in ``code``, as long as the text, all that is no code is blanked out."""
    first = code.find("\n", start) if code[:end].find("{\n", start) >= 0 else start  # defaults of arguments stay

    def found(pattern: str) -> Iterator[re.Match[str]]:
        return re.compile(pattern, re.MULTILINE).finditer(code, first, end)

    for match in found(r"(?<=[\w)\]}\"] )(?:[-+*/]|[<>]=?|[!=]==|&&|\|\|)(?= )"):
        _, new, kind = _SCRIPT_SWAPS[match[0]]
        yield Edit(match.start(), match[0], new, kind)
    for match in found(r"(?<![\w.$#\"])\d+(?:\.\d+)?(?:e-?\d+)?(?![\w.:\"])"):
        yield Edit(match.start(), match[0], f"({match[0]} + 1)", "constant")
    for match in found(r"(?<=[( ])!(?=[\w(])"):
        yield Edit(match.start(), "!", "", "dropped not")
    for match in found(r"^ +(?!return\b|super\b)[\w.#?]+\(.*\);$"):
        call = match[0].lstrip()
        if call.count("(") == call.count(")"):
            place = match.end() - len(call)
            yield Edit(place, text[place : match.end()], ";", "dropped call")
    for match in found(r"(?<=\w\()([\w.]+), ([\w.]+)(?=[,)])(?!\) (?:=>|\{))"):
        if match[1] != match[2]:
            yield Edit(match.start(), match[0], f"{match[2]}, {match[1]}", "argument order")


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
    paths = sorted([*(root / "tests").rglob("test_*.py"), *(root / "frontend" / "tests").rglob("*.test.js")])
    files = {path: path.read_text(encoding="utf-8") for path in paths}
    chosen = _tests_of(mutant.file, mutant.symbol, files)
    if len(chosen) < most // 2:
        kind = Path(mutant.file).suffix
        package = {path: path.read_text(encoding="utf-8") for path in sources(root) if path.suffix == kind}
        users = [path.relative_to(root).as_posix() for path, text in package.items() if _imports(text, mutant.file)]
        chosen += sorted(
            (test for user in users for test in _tests_of(user, mutant.symbol, files)[: most // 2]),
            key=lambda path: ("browser" in path.parts, len(files[path])),
        )
    examples = [mutant.file] if mutant.file.endswith(".py") else []
    names = dict.fromkeys([*examples, *(path.relative_to(root).as_posix() for path in chosen)])
    return tuple(names)[:most]


def _tests_of(file: str, symbol: str, files: dict[Path, str]) -> list[Path]:
    """The best first: of the module's name, those that import it, of its package, those that say the symbol's name."""
    parts = Path(file).with_suffix("").parts[1:]
    names = ["_".join(parts[k:]) for k in range(len(parts))]
    own = {f"test_{name}.py" for name in names} | {f"{name}.test.js" for name in names}
    is_script = file.endswith(".ts")  # its folder, such as "editor", names its tests in a browser
    beginning = f"test_{parts[-2]}_" if is_script else "/"
    folder = parts[:-1]  # the mirrored one, where files for a whole package lie too
    *scope, name = symbol.split(".")
    says = None if name.startswith("_") or is_script else re.compile(rf"\.{name}\b" if scope else rf"\b{name}\b")

    def order(path: Path) -> tuple[bool, ...]:
        text = files[path]
        in_folder = folder and path.parts[-len(parts) : -1] == folder
        return (
            path.name not in own,
            not path.name.startswith(beginning),
            not _imports(text, file),
            not in_folder,
            not any(re.search(rf"\b{word}\b", text) for word in (*scope, name)),
            "browser" in path.parts,
        )

    found = [path for path in files if not all(order(path)[:4]) or (says and says.search(files[path]))]
    return sorted(found, key=lambda path: (order(path), len(files[path])))


def _imports(text: str, file: str) -> bool:
    if file.endswith(".ts"):  # by its path, by its name in another module, or the widget's module in Python
        path, name = (re.escape(part) for part in (file.partition("/src/")[2], Path(file).name))
        return bool(
            re.search(rf"""["/]{path}["]|^import .*/{name}";""", text, re.MULTILINE)
            or _imports(text, f"deformnb/widgets/{file.partition('/src/')[2].removesuffix('.ts')}.py")
        )
    module = ".".join(Path(file).with_suffix("").parts).removesuffix(".__init__")
    parent, _, last = module.rpartition(".")
    return bool(
        re.search(rf"^\s*(?:from|import) {re.escape(module)}\b(?!\.)", text, re.MULTILINE)
        or re.search(rf"^\s*from {re.escape(parent)} import .*\b{last}\b", text, re.MULTILINE)
    )
