"""Words in the sources: the texts of Python and TypeScript that make those of a studio or a web page.

A text is the key of the tables in ``deformnb/words``. Where it has values (``f"{count} points"`` in Python,
``${count} points`` in TypeScript) its shape has ``{}`` in their place, and so has that of the key ``"{n} points"``.
"""

from __future__ import annotations

import ast
import json
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from pygments.lexer import inherit
from pygments.lexers.javascript import JavascriptLexer
from pygments.token import Comment, Punctuation, String, Whitespace

from node_tasks import find_node

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "deformnb"
LESSONS = ROOT / "lessons" / "deformnb_lessons"

_FEWEST = 4  # letters next to the values
_VALUE = re.compile(r"\{[^{}]*\}")
_READS_AS_WORDS = re.compile(r"[^\W\d_]{2,} [^\W\d_]{2,}|^\W*[A-Z][a-z]+")


def own_table(package: Path, code: str) -> dict[str, str]:
    """The words of a package, without those of others."""
    return dict(json.loads((package / "words" / f"{code}.json").read_text("utf-8")))


def shape(key: str) -> str:
    """A key without the names of its values."""
    return _VALUE.sub("{}", key)


def wildcard(text: str) -> re.Pattern[str]:
    """Possible results of a text with values; each is a letter at most, if there is hardly a word next to them."""
    letters = len(re.findall(r"[^\W\d_]", shape(text).replace("{}", "")))
    return re.compile(re.escape(shape(text)).replace(r"\{\}", ".*" if letters >= _FEWEST else ".?"), re.DOTALL)


def reads_as_words(text: str) -> bool:
    """Check whether a text may be one that is read: a capital letter first, or two words."""
    return _READS_AS_WORDS.search(text) is not None


# ---- Python ----------------------------------------------------------------------------------------------------------


def python_texts(path: Path, *, with_errors: bool = False) -> Iterator[tuple[int, str]]:
    """Line and shape of each text of a module, without docstrings, annotations, log messages and, mostly, errors."""
    tree = ast.parse(path.read_text("utf-8"))
    left_out = set[int]()
    for node in ast.walk(tree):
        for part in () if with_errors and isinstance(node, ast.Raise) else _left_out_of(node):
            left_out.update(id(below) for below in ast.walk(part))
    for node in ast.walk(tree):
        if id(node) in left_out:
            continue
        if isinstance(node, ast.JoinedStr):
            yield node.lineno, "".join(_part(value) for value in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.lineno, node.value


def _left_out_of(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, ast.Raise) or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
        yield node
    elif isinstance(node, ast.AnnAssign | ast.arg) and node.annotation is not None:
        yield node.annotation
    elif isinstance(node, ast.Call) and ast.unparse(node.func).startswith(("_LOG.", "typing.cast", "cast")):
        yield from node.args
    elif isinstance(node, ast.Call):
        yield from (word.value for word in node.keywords if word.arg == "help")
    elif isinstance(node, ast.JoinedStr):
        yield from (value for value in node.values if isinstance(value, ast.Constant))


def _part(value: ast.expr) -> str:
    return str(value.value) if isinstance(value, ast.Constant) else "{}"


# ---- TypeScript ------------------------------------------------------------------------------------------------------


def script_texts(folder: Path, into: Path) -> Iterator[tuple[Path, str]]:
    """Module and shape of each text of the modules of a folder, without errors for other modules.

    Parameters
    ----------
    into : an empty folder, for the modules as esbuild writes them: texts with a plus between them are one, and
        ``${count} points`` is ``"".concat(count, " points")``, which can be read without a parser.
    """
    node, _npm = find_node()
    modules = sorted(path for path in folder.rglob("*.ts") if not path.name.endswith(".d.ts"))
    subprocess.run(
        [
            node,
            str(ROOT / "frontend" / "node_modules" / "esbuild" / "bin" / "esbuild"),
            *map(str, modules),
            f"--outdir={into}",
            f"--outbase={folder}",
            "--supported:template-literal=false",
            "--minify-syntax",
            "--charset=utf8",
            "--log-level=error",
        ],
        check=True,
    )
    for module in modules:
        text = (into / module.relative_to(folder).with_suffix(".js")).read_text("utf-8")
        for found in _Texts(list(_tokens(text))).read():
            yield module, found


class _Token(NamedTuple):
    """A word or sign of a module, or a text without its quotes."""

    value: str
    is_text: bool


class _Lexer(JavascriptLexer):
    """A slash after an arrow begins a regular expression, which Pygments 2.21 takes for a division."""

    tokens = {"root": [(r"=>", Punctuation, "slashstartsregex"), inherit]}  # noqa: RUF012 (as Pygments requires)


_CONCAT = [_Token(sign, is_text=False) for sign in (".", "concat", "(")]


def _tokens(script: str) -> Iterator[_Token]:
    for kind, value in _Lexer().get_tokens(script):
        if kind in String.Double or kind in String.Single:
            yield _Token(ast.literal_eval(value), is_text=True)  # the escapes that esbuild writes are Python's too
        elif kind not in Comment and kind not in Whitespace and value.strip():
            yield _Token(value, is_text=False)


class _Texts:
    """Reader of the texts among the tokens of a module.

    Parameters
    ----------
    tokens : of the module.
    """

    def __init__(self, tokens: list[_Token]) -> None:
        self._tokens, self._at = tokens, 0

    def read(self) -> Iterator[str]:
        """All texts, those within the values of others first."""
        while self._at < len(self._tokens):
            yield from self._next()

    def _next(self) -> Iterator[str]:
        token = self._tokens[self._at]
        self._at += 1
        if not token.is_text:
            return
        parts = [token.value]
        while True:
            ahead = self._tokens[self._at : self._at + 3]
            if ahead == _CONCAT:
                self._at += 3
                yield from self._arguments(parts)
            elif len(ahead) > 1 and ahead[0] == _Token("+", False) and ahead[1].is_text:
                parts.append(ahead[1].value)
                self._at += 2
            else:
                break
        yield "".join(parts)

    def _arguments(self, parts: list[str]) -> Iterator[str]:
        """Add the arguments of a call of concat to the parts of a text, up to its closing bracket."""
        depth, inside = 0, list[str]()
        is_plain = True
        while True:
            token = self._tokens[self._at]
            if depth == 0 and not token.is_text and token.value in (",", ")"):
                parts.append(inside[0] if is_plain and len(inside) == 1 else "{}")
                if not (is_plain and len(inside) == 1):
                    yield from inside
                inside, is_plain = [], True
                self._at += 1
                if token.value == ")":
                    return
            elif token.is_text:
                inside += self._next()
            else:
                is_plain = False
                depth += {"(": 1, "[": 1, "{": 1, ")": -1, "]": -1, "}": -1}.get(token.value, 0)
                self._at += 1
