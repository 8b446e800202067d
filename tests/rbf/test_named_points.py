"""Points by name, position, slice and mask, and tables of pandas and back."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest

import deformnb as dn
from deformnb.errors import DeformError, MissingPackageError
from deformnb.rbf.points import ControlPoint, ControlPoints
from deformnb.warping.points import Landmarks

NAMES = ["tail", "head", "head", ""]
SOURCE = np.array([[0.0, 0], [10, 0], [0, 10], [5, 5]])
DRAGS = np.array([[0.0, 0], [2, 1], [0, 0], [1, 0]])
POINTS = (
    ControlPoints.from_arrays(SOURCE, SOURCE + DRAGS, names=NAMES, ids=[3, 1, 7, 8], radius=[np.nan, 4, np.nan, 9])
    .edit(7, active=False, weight=2.5)
    .edit(8, locked=True)
)
MARKS = Landmarks(
    np.arange(12.0).reshape(4, 3),
    ("tail", "fin", "", "fin"),
    np.full((4, 3), np.nan),
    active=np.array([True, False, True, True]),
    unit="mm",
)


def test_one_point_by_name_and_position() -> None:
    assert POINTS["tail"] == POINTS[0] == ControlPoint(3, "tail", (0.0, 0.0), (0.0, 0.0), True, 1.0, False, None)
    assert POINTS[-1] == list(POINTS)[3] == ControlPoint(8, "", (5.0, 5.0), (6.0, 5.0), True, 1.0, True, 9.0)
    assert MARKS["tail"].tolist() == MARKS[0].tolist() == [0.0, 1.0, 2.0]
    assert "tail" in POINTS
    assert "nose" not in POINTS
    assert "fin" in MARKS


def test_several_points_by_slice_mask_and_list() -> None:
    for key in (slice(1, 3), [False, True, True, False], [1, 2], np.array([1, 2])):
        assert POINTS[key].ids == (1, 7)
        assert POINTS[key] == POINTS.take([1, 2])
        assert MARKS[key].names == ("fin", "")
        np.testing.assert_array_equal(MARKS[key].points, MARKS.points[1:3])
        assert MARKS[key].active is not None
        assert MARKS[key].active.tolist() == [False, True]
        assert MARKS[key].unit == "mm"
    assert POINTS[::-1].ids == (8, 7, 1, 3)


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: POINTS["nose"], "there is no point of the name 'nose'; there are 'tail', 'head'"),
        (lambda: POINTS["head"], "2 points have the name 'head'; take one by its position, which are 1, 2"),
        (lambda: POINTS[""], "an empty text names no point"),
        (lambda: MARKS["fin"], "2 points have the name 'fin'; take one by its position"),
        (lambda: ControlPoints.empty()["a"], "there is no point of the name 'a'; there are no names"),
        (lambda: POINTS.move("nose", [1, 1]), "there is no point of the name 'nose'"),
    ],
)
def test_names_that_are_not_unique_are_refused(call: Any, sentence: str) -> None:
    with pytest.raises(DeformError, match=sentence):
        call()


def test_positions_beyond_the_last_end_iteration() -> None:
    with pytest.raises(IndexError):
        POINTS[4]
    assert len(list(MARKS)) == 4


def test_edits_take_names() -> None:
    assert POINTS.move("tail", [4, 4])["tail"].target == (4.0, 4.0)
    assert POINTS.edit("tail", weight=3.0)[0].weight == 3.0
    assert POINTS.remove("tail", 7).ids == (1, 8)


def test_tables_come_back_equal() -> None:
    pytest.importorskip("pandas")
    table = POINTS.to_pandas()
    assert list(table.columns) == [
        "name",
        *("source_a", "source_b", "target_a", "target_b"),
        *("active", "weight", "locked", "radius"),
    ]
    assert table.index.tolist() == [3, 1, 7, 8]
    assert ControlPoints.from_pandas(table) == POINTS
    in_space = ControlPoints.from_arrays([[1, 2, 3]], [[1, 2, 4]], unit="mm")
    assert ControlPoints.from_pandas(in_space.to_pandas()) == in_space
    for marks in (MARKS, Landmarks([[1, 2]], ("tip",))):
        back = Landmarks.from_pandas(marks.to_pandas())
        assert (back.names, back.unit) == (marks.names, marks.unit)
        np.testing.assert_array_equal(back.points, marks.points)
        np.testing.assert_array_equal(back.active, marks.active)  # type: ignore[arg-type]
        assert (back.fixed is None) == (marks.fixed is None)


def test_a_table_that_was_filtered_and_edited_is_read() -> None:
    pandas = pytest.importorskip("pandas")
    table = POINTS.to_pandas()
    table = table[table["active"]].assign(target_b=7.0, remark="mine")
    found = ControlPoints.from_pandas(table)
    assert found.ids == (3, 1, 8)
    assert found.target[:, 1].tolist() == [7.0, 7.0, 7.0]
    plain = pandas.DataFrame({"source_x": [1], "source_y": [2], "source_z": [3], "name": [None]})
    assert ControlPoints.from_pandas(plain) == ControlPoints.from_arrays([[1, 2, 3]])


@pytest.mark.parametrize(
    ("columns", "sentence"),
    [
        ({"x": [1], "y": [1]}, "the table of landmarks has no column 'z', only x, y"),
        ({"left": [1]}, "the table of landmarks has no columns x, y and z .*; it has left"),
        ({"a": ["one"], "b": [2]}, "the columns a, b of a table of landmarks are no numbers"),
    ],
)
def test_tables_without_places_are_refused(columns: dict[str, Any], sentence: str) -> None:
    pandas = pytest.importorskip("pandas")
    with pytest.raises(DeformError, match=sentence):
        Landmarks.from_pandas(pandas.DataFrame(columns))
    with pytest.raises(DeformError, match="the table of control points has no columns source_a and source_b"):
        ControlPoints.from_pandas(pandas.DataFrame(columns))


def test_anything_else_than_a_table_is_refused() -> None:
    for read in (ControlPoints.from_pandas, Landmarks.from_pandas):
        with pytest.raises(DeformError, match=r"are read from a pandas.DataFrame, got \[1, 2\]"):
            read([1, 2])


def test_without_pandas_a_sentence_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingPackageError, match="this needs the package pandas, which is not installed: pip install"):
        POINTS.to_pandas()


def test_a_set_of_points_is_no_list_of_sets() -> None:
    for given in (POINTS, dn.ControlPoints.empty(2)):
        with pytest.raises(DeformError, match="the maps of a step must be sets of control points"):
            dn.Step(given)  # type: ignore[arg-type]
