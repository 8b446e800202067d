"""Landmarks that are missing, in every format and as every program writes them, and the encodings of files of text."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deformnb.errors import VolumeFileError
from deformnb.io.files.texts import WESTERN, decode_text
from deformnb.io.landmarks.coordinates import is_missing
from deformnb.io.landmarks.formats import LANDMARK_FORMATS, read_landmarks, write_landmarks
from deformnb.warping.points import Landmarks

PLACES = [(1.5, 2.0, 3.0), (4.0, 5.0, 6.0), (7.0, 8.0, 9.5), (10.0, 11.0, 12.0)]
FIXED = [(2.5, 2.0, 3.0), (4.0, 6.0, 6.0), (7.0, 8.0, 9.0), (10.0, 12.0, 12.0)]

WORDS = [
    "NA",
    "na",
    "NaN",
    "nan",
    "-nan",
    "inf",
    "-inf",
    "Infinity",
    "-Infinity",
    "undefined",
    "null",
    "None",
    "missing",
    "n/a",
    "N/A",
    "#N/A",
    "?",
    ".",
    "1.#QNAN",
    "-1.#IND",
]
"""Words of R, Python, Java, Windows' C library, spreadsheets and people."""

Rows = list[tuple[str, str, str]]


def rows_of(places: list[tuple[float, float, float]], missing: int | None, word: str) -> Rows:
    return [(word, word, word) if k == missing else (repr(x), repr(y), repr(z)) for k, (x, y, z) in enumerate(places)]


def join_rows(rows: Rows, separator: str = " ", end: str = "\n") -> str:
    return "".join(separator.join(row) + end for row in rows)


def table(moving: Rows, fixed: Rows, separator: str) -> str:
    heading = separator.join(["name", "x", "y", "z", "fixed_x", "fixed_y", "fixed_z"])
    lines = (separator.join([f"p{k}", *a, *b]) for k, (a, b) in enumerate(zip(moving, fixed, strict=True)))
    return "\n".join([heading, *lines]) + "\n"


def markups(moving: Rows, _fixed: Rows) -> str:
    def number(word: str) -> object:
        try:
            return float(word)
        except ValueError:
            return word

    points = [{"label": "p", "position": list(map(number, row))} for row in moving]
    return json.dumps({"markups": [{"coordinateSystem": "LPS", "controlPoints": points}]})


def bigwarp_json(moving: Rows, fixed: Rows) -> str:
    data = {"movingPoints": moving, "fixedPoints": fixed, "names": ["p"] * len(moving), "active": [True] * len(moving)}
    return json.dumps({"landmarks": data})


def morphologika(moving: Rows, fixed: Rows) -> str:
    return (
        f"[individuals]\n2\n[landmarks]\n{len(moving)}\n[dimensions]\n3\n[names]\na\nb\n[rawpoints]\n'a\n"
        f"{join_rows(moving)}'b\n{join_rows(fixed)}"
    )


def prm(moving: Rows, fixed: Rows) -> str:
    def listed(rows: Rows) -> str:
        return join_rows(rows, end="\n    ").rstrip()

    return f"original control points: {listed(moving)}\n\ndeformed control points: {listed(fixed)}\n"


WRITTEN: dict[str, Callable[[Rows, Rows], str]] = {
    "markups": markups,
    "bigwarp json": bigwarp_json,
    "fcsv": lambda moving, _: "# CoordinateSystem = LPS\n" + "".join(f"1,{','.join(row)}\n" for row in moving),
    "table": lambda moving, fixed: table(moving, fixed, ","),
    "bigwarp": lambda moving, fixed: "".join(
        f'"p","true",{",".join((*a, *b))}\n' for a, b in zip(moving, fixed, strict=True)
    ),
    "tab table": lambda moving, fixed: table(moving, fixed, "\t"),
    "points": lambda moving, _: join_rows(moving),
    "tps": lambda moving, fixed: f"LM3=4\n{join_rows(moving)}ID=a\nLM3=4\n{join_rows(fixed)}ID=b\n",
    "nts": lambda moving, fixed: f"1 2 12 1 -999 DIM=3\n{join_rows(moving)}{join_rows(fixed)}",
    "morphologika": morphologika,
    "elastix": lambda moving, _: f"point\n4\n{join_rows(moving)}",
    "pygem": prm,
}
"""A file of four landmarks as another program writes it, by format: written literally here."""


def test_every_format_is_written_by_hand_here() -> None:
    assert set(WRITTEN) == set(LANDMARK_FORMATS)


def read(folder: Path, kind: str, text: str | bytes) -> Landmarks:
    path = folder / f"a{LANDMARK_FORMATS[kind].suffix}"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_landmarks(path)


@pytest.mark.parametrize("kind", WRITTEN)
@pytest.mark.parametrize("missing", [0, 2, 3])
def test_a_missing_landmark_is_no_place_and_is_named(kind: str, missing: int, tmp_path: Path) -> None:
    for word in [*WORDS, *(["-999"] if kind == "nts" else ["-1"] if kind == "tps" else [])]:
        text = WRITTEN[kind](rows_of(PLACES, missing, word), rows_of(FIXED, None, word))
        found = read(tmp_path, kind, text)
        left = [k for k in range(4) if k != missing]
        np.testing.assert_array_equal(found.points, np.array(PLACES)[left], err_msg=word)
        if found.fixed is not None:
            np.testing.assert_array_equal(found.fixed, np.array(FIXED)[left])
        assert f"1 landmark is missing and left out: {missing + 1}" in found.notes, (kind, word, found.notes)


@pytest.mark.parametrize("kind", [name for name, row in LANDMARK_FORMATS.items() if row.has_fixed])
def test_one_without_a_counterpart_makes_no_pair_and_is_named(kind: str, tmp_path: Path) -> None:
    for word in [*WORDS, *(["-999"] if kind == "nts" else ["-1"] if kind == "tps" else [])]:
        found = read(tmp_path, kind, WRITTEN[kind](rows_of(PLACES, None, word), rows_of(FIXED, 1, word)))
        made = found.control_points()
        np.testing.assert_array_equal(made.source, np.array(PLACES)[[0, 2, 3]])
        np.testing.assert_array_equal(made.target, np.array(FIXED)[[0, 2, 3]])
        assert len([note for note in found.notes if note.endswith(": 2")]) == 1


@pytest.mark.parametrize("kind", WRITTEN)
def test_negative_coordinates_are_places(kind: str, tmp_path: Path) -> None:
    places = [(-1.0, -1.0, -1.0), (-2.0, 5.0, -6.0), (7.0, -8.0, 9.5), (-10.0, -11.0, -12.0)]
    found = read(tmp_path, kind, WRITTEN[kind](rows_of(places, None, ""), rows_of(places, None, "")))
    np.testing.assert_array_equal(found.points, places)
    assert all("missing" not in note for note in found.notes)
    assert any("-1 -1" in note for note in found.notes) == (kind == "tps")


@pytest.mark.parametrize("kind", WRITTEN)
def test_a_landmark_at_minus_one_survives_writing(kind: str, tmp_path: Path) -> None:
    marks = Landmarks([[-1.0, -1, -1], [3, 4, 5], [0.1, 0.2, 0.3]])
    path = tmp_path / f"a{LANDMARK_FORMATS[kind].suffix}"
    write_landmarks(marks, path)
    np.testing.assert_array_equal(read_landmarks(path).points, marks.points)


@pytest.mark.parametrize("kind", WRITTEN)
def test_a_file_of_missing_landmarks_only_says_so(kind: str, tmp_path: Path) -> None:
    rows: Rows = [("NA", "NA", "NA")] * 4
    with pytest.raises(VolumeFileError, match="all 4 are missing"):
        read(tmp_path, kind, WRITTEN[kind](rows, rows))


def test_landmarks_of_slicer_that_were_never_placed_are_counted(tmp_path: Path) -> None:
    points = [
        {"label": "a", "position": [1, 2, 3]},
        *({"label": "b", "position": [0, 0, 0], "positionStatus": status} for status in ("undefined", "missing")),
    ]
    found = read(tmp_path, "markups", json.dumps({"markups": [{"controlPoints": points}]}))
    assert (found.names, found.notes) == (("a",), ("2 landmarks are missing and left out: 2, 3",))


def test_a_scale_is_empty_positive_or_refused(tmp_path: Path) -> None:
    found = read(tmp_path, "tps", "LM=2\n10 20\n30 40\nIMAGE=\nID=a\nSCALE=\n")
    assert (found.points.tolist(), found.notes) == (
        [[10.0, 20.0], [30.0, 40.0]],
        ("the scale is empty: coordinates were taken as they are",),
    )
    assert read(tmp_path, "tps", "LM=1\n10 20\nSCALE=0,5\n").points.tolist() == [[5.0, 10.0]]
    for scale in ("0", "-1", "x", "1e999"):
        with pytest.raises(VolumeFileError, match="line 3, the scale"):
            read(tmp_path, "tps", f"LM=1\n10 20\nSCALE={scale}\n")


@pytest.mark.parametrize(
    "text",
    [
        "name\tx\ty\tz\nnose\t1.5\t2\t3\n",
        "name;x;y;z\nnose;1,5;2;3\n",
        'name, x, y, z\n"nose", "1.5", "2", "3"\n',
        "name x;y;z\n".replace(" x", ";x") + "nose;1,5;2;3\n",
    ],
)
@pytest.mark.parametrize("suffix", [".csv", ".tsv", ".txt", ".points.csv"])
def test_tables_are_read_under_each_usual_suffix(text: str, suffix: str, tmp_path: Path) -> None:
    (tmp_path / f"a{suffix}").write_text(text, encoding="utf-8")
    found = read_landmarks(tmp_path / f"a{suffix}")
    assert (found.names, found.points.tolist()) == (("nose",), [[1.5, 2.0, 3.0]])


def test_a_dot_parts_thousands_where_a_comma_is_the_decimal_point(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("name;x;y;z\na;1.234,5;2.000;3\nb;0,5;12.345.678,25;-1.000,0\n", encoding="utf-8")
    assert read_landmarks(tmp_path / "a.csv").points.tolist() == [[1234.5, 2000.0, 3.0], [0.5, 12345678.25, -1000.0]]
    (tmp_path / "b.csv").write_text("name;x;y;z\na;1.234;2,5;3\n", encoding="utf-8")
    assert read_landmarks(tmp_path / "b.csv").points.tolist() == [[1.234, 2.5, 3.0]]


@given(st.floats())
def test_a_number_is_missing_where_it_is_not_finite(value: float) -> None:
    assert is_missing(repr(value)) == is_missing(value) == (not np.isfinite(value))


# ---- encodings -------------------------------------------------------------------------------------------------------

ENCODINGS = {"utf-8": (), "utf-8-sig": (), "utf-16": (), "utf-32": (), "cp1252": (WESTERN,)}


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("kind", ["bigwarp", "table", "tab table", "tps", "fcsv"])
def test_text_is_decoded_in_one_way_for_all(kind: str, end: str, encoding: str, tmp_path: Path) -> None:
    marks = Landmarks([[1.0, 2, 3], [4, 5, 6]], ("\u00d6se", "Gr\u00f6\u00dfe \u2013 caf\u00e9"))
    path = tmp_path / f"a{LANDMARK_FORMATS[kind].suffix}"
    write_landmarks(marks, path)
    text = path.read_text("utf-8")
    text = text.replace("ID=specimen", "ID=Gr\u00f6\u00dfe") if kind == "tps" else text
    path.write_bytes(text.replace("\n", end).encode(encoding))
    found = read_landmarks(path)
    np.testing.assert_array_equal(found.points, marks.points)
    assert found.notes == ENCODINGS[encoding]
    if LANDMARK_FORMATS[kind].has_names:
        assert found.names == marks.names


@given(st.binary(max_size=60))
def test_bytes_are_text_or_one_sentence_without_the_name_of_a_codec(data: bytes) -> None:
    try:
        text, notes = decode_text(Path("a.csv"), data)
    except VolumeFileError as error:
        text, notes = str(error), ()
        text = text.replace("codec", "\r").replace("can't", "\r")
    assert "\r" not in text
    assert notes in ((), (WESTERN,))
