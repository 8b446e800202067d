"""Control points from text: round trips, spreadsheets, BigWarp, and errors."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from deformnb.errors import DeformError
from deformnb.io.files.texts import LONGEST_TABLE
from deformnb.io.landmarks.formats import points_from_csv
from deformnb.rbf.points import ControlPoints


def two(dim: int = 2) -> ControlPoints:
    source = np.arange(2 * dim, dtype=float).reshape(2, dim)
    return ControlPoints.from_arrays(source, source + 0.5, names=["tail", "head"], next_id=7)


def test_a_row_with_a_known_id_changes_that_point_and_others_are_added() -> None:
    text = (
        "id,name,active,locked,source_a,source_b,target_a,target_b,weight,radius\n"
        '1,"a ""nose"", long",false,TRUE,1.5,2.5,3.5,4.5,2,9\n'
        "99,new,,,5,6,7,8,,\n"
        ",alone,yes,no,1,1,,,,\n"
    )
    read = points_from_csv(text, two())
    points = read.points
    assert (read.changed, read.added) == ((1,), (7, 8))
    assert points.ids == (0, 1, 7, 8)
    assert points.names == ("tail", 'a "nose", long', "new", "alone")
    assert_array_equal(points.active, [True, False, True, True])
    assert_array_equal(points.locked, [False, True, False, False])
    assert_array_equal(points.source, [[0, 1], [1.5, 2.5], [5, 6], [1, 1]])
    assert_array_equal(points.target, [[0.5, 1.5], [3.5, 4.5], [7, 8], [1, 1]])
    assert_array_equal(points.weight, [1, 2, 1, 1])
    assert_array_equal(points.radius, [np.nan, 9, np.nan, np.nan])
    assert points.next_id == 9


def test_what_a_row_leaves_empty_stays() -> None:
    read = points_from_csv("id,source_a,source_b,name\n0,,,renamed\n", two())
    assert read.points.names == ("renamed", "head")
    assert_array_equal(read.points.source, two().source)


@pytest.mark.parametrize("text", ["1,2\n3,4", "\ufeff1\t2\r\n3\t4\r\n", "1;2\n3;4\n\n", "1,0;2,0\n3,0;4,0"])
def test_plain_places_by_commas_tabs_semicolons_and_decimal_commas(text: str) -> None:
    read = points_from_csv(text, ControlPoints.empty(2))
    assert_array_equal(read.points.source, [[1, 2], [3, 4]])
    assert_array_equal(read.points.target, [[1, 2], [3, 4]])


def test_rows_of_bigwarp_and_pairs_of_places_in_space() -> None:
    text = '"Pt-0","true","1.0","2.0","3.0","4.0","5.0","6.0"\n"Pt-1","false",7,8,9,10,11,12\n'
    points = points_from_csv(text, ControlPoints.empty(3)).points
    assert points.names == ("Pt-0", "Pt-1")
    assert_array_equal(points.active, [True, False])
    assert_array_equal(points.source, [[1, 2, 3], [7, 8, 9]])
    assert_array_equal(points.target, [[4, 5, 6], [10, 11, 12]])
    assert_array_equal(points_from_csv("1,2,3,4,5,6", ControlPoints.empty(3)).points.target, [[4, 5, 6]])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "empty"),
        (" \n ,\n", "empty"),
        ("1,nan", "row 1 must be a number, got 'nan'"),
        ("1,x", "got 'x'"),
        ("1,inf", "got 'inf'"),
        ("1,2\n1,2,3", "row 2 has 3 columns"),
        ("a,b,c", "row 1 has 3 columns"),
        ("source_a,source_b\n1,2,3", "row 2 has 3 columns"),
        ("source_a,source_b\n1,", "the source of row 2 must be a number"),
        ("id,source_a,source_b\n-1,1,2", "no whole number"),
        ("id,source_a,source_b\n1.5,1,2", "no whole number"),
        ("id,source_a,source_b\n55,,", "needs a place|no place|has no source"),
        ("source_a,source_b,active\n1,2,maybe", "neither true nor false"),
        ("source_a,source_b,weight\n1,2,-3", "weights must be positive"),
        ("source_a,source_b,radius\n1,2,0", "positive length"),
        ("source_x,source_y,source_z\n1,2,3", "a and b"),
        ('"' + "x" * 200_000, "no table"),
        ("1" * (LONGEST_TABLE + 1), "at most"),
        ("1e400,2", "must be a number"),
        ("1e20,2", "below 1e15"),
    ],
)
def test_what_is_wrong_is_said(text: str, words: str) -> None:
    with pytest.raises(DeformError, match=words):
        points_from_csv(text, two())
