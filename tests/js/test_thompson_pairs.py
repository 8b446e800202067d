"""Pairs of Thompson's grids are placed and scored on a page as the package places and scores them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scripts import run_script

from deformnb.datasets import custom_grid, thompson_map, thompson_pairs, thompson_score
from deformnb.errors import DeformError

FILES = ("maths/thompson.ts", "maths/cuts.ts", "maths/points.ts")
PLACE = "(given) => given.map(({ source, target, ...placement }) => placePair(source, target, placement))"
BOX = (10.0, 522.0, 22.0, 176.0)
FRAME = (0.0, 540.0, 0.0, 200.0)
CASES = [(pair, frame, head) for pair in thompson_pairs() for frame in (None, FRAME, BOX) for head in ("left", "right")]


def placed(pair: tuple[str, str], frame: tuple[float, ...] | None, head: str) -> Any:
    scale = "area" if frame is None else "inside"
    return thompson_map(*pair, box=BOX, frame=frame, scale=scale, head=head)


def test_pairs_are_placed_where_the_package_places_them() -> None:
    given = []
    for pair, frame, head in CASES:
        grids = thompson_map(*pair)
        one = {"source": grids.source.nodes.tolist(), "target": grids.target.nodes.tolist(), "box": BOX, "head": head}
        given.append({**one, "frame": frame} if frame else one)
    for (pair, frame, head), found in zip(CASES, run_script(FILES, PLACE, given), strict=True):
        wanted = placed(pair, frame, head)
        np.testing.assert_allclose(found["source"], wanted.source_nodes, atol=1e-9)
        np.testing.assert_allclose(found["target"], wanted.target_nodes, atol=1e-9)
        drawn = np.array(found["scale"]) * wanted.target.nodes + found["shift"]
        np.testing.assert_allclose(drawn, wanted.target_nodes, atol=1e-9)


@pytest.mark.parametrize("pair", thompson_pairs(), ids=lambda pair: pair[1])
def test_all_nodes_are_reached_exactly_and_twelve_of_them_score_less(pair: tuple[str, str]) -> None:
    main = """({ source, target }) => {
      const pair = placePair(source, target, { box: boxOfNodes(source) }), settings = { kernel: "thin_plate",
        trend: "affine", strength: 1, cuts: [], parts: [] };
      const nodes = (points) => reachedNodes(layeredFit(points, settings), pair.source);
      const judge = (reached) => progressOf(pair.source.flat(), reached, pair.target.flat());
      const twelve = twelveNodes(source);
      return { all: judge(nodes(pairPoints(pair))), some: judge(nodes(pairPoints(pair, twelve))),
        halfway: judge(pair.source.flat().map((p, k) => placeBetween(p, pair.target.flat()[k], 0.5))),
        twelve, pair };
    }"""
    grids = thompson_map(*pair)
    found = run_script(FILES, main, {"source": grids.source.nodes.tolist(), "target": grids.target.nodes.tolist()})
    assert found["all"]["percent"] == pytest.approx(100, abs=1e-4)
    assert max(found["all"]["distances"]) < 1e-4
    assert found["halfway"]["percent"] == pytest.approx(50)
    assert 50 < found["some"]["percent"] < 99
    assert len(set(found["twelve"])) == 12
    rows, columns = grids.source.nodes.shape[:2]
    assert {0, columns - 1, (rows - 1) * columns, rows * columns - 1} < set(found["twelve"])


def test_the_score_is_that_of_the_package() -> None:
    nodes = thompson_map("Polyprion", "Antigonia").source.nodes
    low, high = nodes.reshape(-1, 2).min(axis=0), nodes.reshape(-1, 2).max(axis=0)
    grids = thompson_map("Polyprion", "Antigonia", box=(low[0], high[0], low[1], high[1]), scale="area")
    reached = grids.source_nodes + 0.7 * (grids.target_nodes - grids.source_nodes)
    reached[2, 3] += (30, -4)
    score = thompson_score(reached, grids)
    main = "({ source, reached, goals }) => progressOf(source, reached, goals)"
    flat = [a.reshape(-1, 2).tolist() for a in (grids.source_nodes, reached, grids.target_nodes)]
    found = run_script(FILES, main, dict(zip(("source", "reached", "goals"), flat, strict=True)))
    assert found["percent"] == pytest.approx(score.percent)
    assert divmod(found["worst"], nodes.shape[1]) == score.worst
    np.testing.assert_allclose(found["distances"], score.distances.ravel())


def test_growth_names_the_thirds_that_grew_most_and_least() -> None:
    # Three cells by three; the one in the middle of the head is four times as large, the tail's at the belly a quarter.
    main = "({ source, target }) => ({ ...growthOf(source, target), cells: cellsOf(source, target) })"
    source = np.stack(np.meshgrid([0.0, 2, 4, 6], [0.0, 2, 4, 6]), axis=-1)
    target = np.stack(np.meshgrid([0.0, 4, 6, 7], [0.0, 2, 6, 7]), axis=-1)
    found = run_script(FILES, main, {"source": source.tolist(), "target": target.tolist()})
    whole = 49 / 36
    assert found["most"] == {"row": 1, "column": 0, "times": pytest.approx(16 / 4 / whole)}
    assert found["least"] == {"row": 2, "column": 2, "times": pytest.approx(1 / 4 / whole)}
    assert [cell["times"] for cell in found["cells"]] == pytest.approx(
        [x * y / 4 / whole for y in (2, 4, 1) for x in (4, 2, 1)]
    )


@settings(max_examples=8, deadline=None)
@given(st.integers(2, 8), st.integers(2, 8), st.integers(2, 8), st.integers(2, 8))
def test_a_grid_with_other_lines_is_on_the_same_surface(rows: int, columns: int, more: int, across: int) -> None:
    # Of a grid that is an affine map of a regular one, any number of lines is that map of the regular one.
    def nodes(i: int, j: int) -> Any:
        v, u = np.meshgrid(np.linspace(0, 1, i), np.linspace(0, 1, j), indexing="ij")
        return np.stack([3 + 40 * u + 5 * v, 9 - 4 * u + 20 * v], axis=-1)

    main = "({ nodes, rows, columns }) => resampleNodes(nodes, rows, columns)"
    found = run_script(FILES, main, {"nodes": nodes(rows, columns).tolist(), "rows": more, "columns": across})
    np.testing.assert_allclose(found, nodes(more, across), atol=1e-9)


def test_a_fold_is_found_in_the_cell_in_which_the_package_finds_it() -> None:
    main = "(grids) => grids.map((nodes) => foldedCell(nodes))"
    plain = np.stack(np.meshgrid([0.0, 2, 4, 6], [0.0, 2, 4]), axis=-1)
    given = [plain]
    for node, place in (((0, 0), (3, 3)), ((1, 2), (7, 2)), ((2, 3), (4, 4))):
        folded = plain.copy()
        folded[node] = place
        given.append(folded)
    found = run_script(FILES, main, [grid.tolist() for grid in given])
    assert found[0] is None
    custom_grid(plain)
    for grid, (row, column) in zip(given[1:], found[1:], strict=True):
        with pytest.raises(DeformError, match=f"right of node r{row} c{column} "):
            custom_grid(grid)
