"""The runner of mutants finds its places by symbol, and says of each mutant what the tests say."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from mutants.__main__ import found_test, named_mutants, run
from mutants.draw import drawn, files_for
from mutants.places import Mutant, StaleError, placed

ROOT = Path(__file__).resolve().parent.parent

SHAPES = '''"""Areas."""

LEAST = 1


class Square:
    """A square."""

    def area(self, side: float, times: int = 2) -> float:
        """Its area."""
        return side * side if side > LEAST else 0.0

    def edge(self, side: float) -> float:
        """Of all around."""
        return side * 4
'''
SCRIPT = """export class Pen {
  get width() { return this.size * 2; }
  move(x, y) {
    const { a } = this;
    return [x + a, y];
  }
}
function move(x) { return x + 1; }
const halved = (x) => x / 2;
const GLSL = `
vec3 lit(vec3 rgb, float light) {
  return rgb * light;
}
`;
"""


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    (tmp_path / "deformnb").mkdir()
    (tmp_path / "tests").mkdir()
    (tmp_path / "deformnb" / "__init__.py").touch()
    (tmp_path / "deformnb" / "shapes.py").write_text(SHAPES, encoding="utf-8")
    (tmp_path / "deformnb" / "pen.ts").write_text(SCRIPT, encoding="utf-8")
    (tmp_path / "tests" / "test_shapes.py").write_text(
        "from deformnb.shapes import Square\n\n\ndef test_area():\n    assert Square().area(3.0) == 9.0\n",
        encoding="utf-8",
    )
    return tmp_path


def mutant(symbol: str, old: str, new: str, file: str = "shapes.py") -> Mutant:
    return Mutant("one", f"deformnb/{file}", symbol, old, new, "sign", ("tests/test_shapes.py",))


def test_named_mutants_can_be_placed_and_their_tests_are_there() -> None:
    mutants = named_mutants()
    assert len(mutants) >= 40
    assert max(Counter(one.name for one in mutants).values()) == 1
    for one in mutants:
        placed(one)
        assert one.tests
        for test in one.tests:
            assert (ROOT / found_test(test).partition("::")[0]).is_file(), test


@pytest.mark.parametrize(
    ("symbol", "old", "line"),
    [
        ("Square.area", "side * side", 11),
        ("Square.edge", "4", 15),
        ("LEAST", "LEAST = 1", 3),
        ("Square", "side > LEAST", 11),
    ],
)
def test_a_text_is_found_in_its_symbol_only(tree: Path, symbol: str, old: str, line: int) -> None:
    change = placed(mutant(symbol, old, "MARK = 1" if old == "LEAST = 1" else "7"), tree)
    assert change.line == line
    before, after = SHAPES.splitlines(), change.text.splitlines()
    assert [k + 1 for k, (a, b) in enumerate(zip(before, after, strict=True)) if a != b] == [line]


@pytest.mark.parametrize(
    ("symbol", "old", "line"),
    [
        ("Pen.width", "* 2", 2),
        ("Pen.move", "x + a", 5),
        ("move", "x + 1", 8),
        ("halved", "/ 2", 9),
        ("lit", "* light", 12),
    ],
)
def test_functions_of_scripts_and_shaders_are_symbols(tree: Path, symbol: str, old: str, line: int) -> None:
    assert placed(mutant(symbol, old, "", "pen.ts"), tree).line == line


@pytest.mark.parametrize(
    ("symbol", "old"), [("Square.area", "side"), ("Square.edge", "side * side"), ("Circle.area", "1")]
)
def test_a_text_that_is_not_there_once_is_stale(tree: Path, symbol: str, old: str) -> None:
    with pytest.raises(StaleError, match=symbol.replace(".", r"\.")):
        placed(mutant(symbol, old, "x"), tree)


def test_a_mutant_and_its_tests_go_with_files_that_move(tree: Path) -> None:
    one = mutant("Square.edge", "* 4", "* 5")
    for old, new in (
        ("deformnb/shapes.py", "deformnb/geometry/squares.py"),
        ("tests/test_shapes.py", "tests/geometry/test_shapes.py"),
    ):
        (tree / new).parent.mkdir()
        (tree / old).rename(tree / new)
    assert placed(one, tree).path == tree / "deformnb" / "geometry" / "squares.py"
    assert found_test("tests/test_shapes.py::test_area", tree) == "tests/geometry/test_shapes.py::test_area"


def test_a_seed_draws_the_same_whatever_else_there_is(tree: Path) -> None:
    def places() -> set[tuple[str, str, str]]:
        return {(one.symbol, one.old, one.new) for one in drawn(2, 5, (".py",), tree)}

    before = places()
    assert {symbol for symbol, _, _ in before} == {"Square.area", "Square.edge"}
    text = SHAPES.replace("LEAST = 1\n", "LEAST = 1\n\n\ndef empty() -> None:\n    return None\n")
    (tree / "deformnb" / "shapes.py").rename(tree / "deformnb" / "squares.py")
    (tree / "deformnb" / "squares.py").write_text(text, encoding="utf-8")
    assert places() == before
    assert {(one.symbol, one.old, one.new) for seed in range(20) for one in drawn(2, seed, (".py",), tree)} == {
        ("Square.area", "*", "/"),
        ("Square.area", ">", ">="),
        ("Square.area", "0.0", "(0.0 + 1)"),
        ("Square.area", "2", "(2 + 1)"),
        ("Square.edge", "*", "/"),
        ("Square.edge", "4", "(4 + 1)"),
    }
    assert all(placed(one, tree).text != text for seed in range(20) for one in drawn(2, seed, (".py",), tree))


def test_in_scripts_operators_are_drawn_and_no_text_comment_or_shader(tree: Path) -> None:
    (tree / "deformnb" / "pen.ts").write_text(
        SCRIPT
        + """
export async function draw(path, { at = 5, name = "a - 3" } = {}) {
  // not 7 * 8
  if (!path.isOpen && at <= 2) return `${at} * 9`.replace(/x - 4/, "");
  path.moveTo(at, name);
}
""",
        encoding="utf-8",
    )
    ones = [one for seed in range(60) for one in drawn(9, seed, (".ts",), tree)]
    assert {(one.symbol, one.old, one.new) for one in ones} == {
        ("Pen.width", "*", "/"),
        ("Pen.width", "2", "(2 + 1)"),
        ("Pen.move", "+", "-"),
        ("move", "+", "-"),
        ("move", "1", "(1 + 1)"),
        ("halved", "/", "*"),
        ("halved", "2", "(2 + 1)"),
        ("draw", "&&", "||"),
        ("draw", "<=", "<"),
        ("draw", "!", ""),
        ("draw", "2", "(2 + 1)"),
        ("draw", "at, name", "name, at"),
        ("draw", "path.moveTo(at, name);", ";"),
    }
    for one in ones:
        placed(one, tree)


def test_a_drawn_mutant_of_a_script_is_tested_by_what_knows_its_module(tree: Path) -> None:
    (tree / "frontend" / "src" / "ui").mkdir(parents=True)
    (tree / "frontend" / "tests").mkdir()
    (tree / "deformnb" / "pen.ts").rename(tree / "frontend" / "src" / "ui" / "pen.ts")
    for name, text in (
        ("../frontend/tests/pen.test.js", ""),
        ("test_drawing.py", 'FILES = ("ui/pen.ts",)\n'),
        ("test_opens.py", 'FILES = ("ui/open.ts",)\n'),
    ):
        (tree / "tests" / name).write_text(text, encoding="utf-8")
    one = mutant("Pen.move", "+", "-", "frontend/src/ui/pen.ts")
    assert files_for(one, tree) == ("frontend/tests/pen.test.js", "tests/test_drawing.py")
    assert files_for(one, tree, most=1) == ("frontend/tests/pen.test.js",)


def test_a_drawn_mutant_is_tested_by_what_knows_its_module(tree: Path) -> None:
    (tree / "tests" / "test_other.py").write_text("from deformnb.shapes import LEAST\n", encoding="utf-8")
    (tree / "tests" / "test_unrelated.py").write_text("import json\n", encoding="utf-8")
    assert files_for(mutant("Square.edge", "4", "5"), tree) == (
        "deformnb/shapes.py",
        "tests/test_shapes.py",
        "tests/test_other.py",
    )


@pytest.mark.nightly
def test_the_runner_says_what_the_tests_say_and_leaves_the_tree_alone(
    tree: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mutants = [
        Mutant(name, "deformnb/shapes.py", symbol, old, "+", "sign")
        for name, symbol, old in (
            ("noticed", "Square.area", "*"),
            ("unnoticed", "Square.edge", "*"),
            ("outdated", "Square.edge", "/"),
        )
    ]
    status = run(mutants, {one.name: ["tests/test_shapes.py"] for one in mutants}, root=tree)
    told = capsys.readouterr().out
    assert status == 1
    assert [line.split()[:2] for line in told.splitlines() if line[0] != " "][1:] == [
        ["caught", "noticed"],
        ["survived", "unnoticed"],
        ["stale", "outdated"],
        ["1", "of"],
    ]
    assert (tree / "deformnb" / "shapes.py").read_text(encoding="utf-8") == SHAPES
    assert run(mutants[:1], {"noticed": ["tests/test_shapes.py"]}, root=tree) == 0
    (tree / "tests" / "test_shapes.py").write_text("def test_wrong():\n    assert False\n", encoding="utf-8")
    assert run(mutants[:1], {"noticed": ["tests/test_shapes.py"]}, root=tree) == 2
    assert "fail without any mutant" in capsys.readouterr().out


@pytest.mark.nightly
def test_what_hangs_is_ended_and_not_taken_for_caught(tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tree / "tests" / "test_shapes.py").write_text(
        "def test_for_ever():\n    while True:\n        pass\n", encoding="utf-8"
    )
    one = mutant("Square.edge", "* 4", "* 5")
    assert run([one], {one.name: ["tests/test_shapes.py"]}, 0.02, baseline=False, root=tree) == 1
    assert capsys.readouterr().out.startswith("too long  one")
