"""Landmark files of plain text, written literally after the descriptions of their formats."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from deformnb.errors import VolumeFileError
from deformnb.io.landmarks.formats import read_landmarks, write_landmarks
from deformnb.warping.points import Landmarks

PAIR = ([[1.0, 2.0, 3.0], [4.0, 5.0, 6.5]], [[1.5, 2.0, 3.0], [4.0, 5.0, -7.0]])
FILES = {
    "a.tps": "LM3=2\n1 2 3\n4 5 6.5\nID=trout\nLM3=2\n3 4 6\n8 10 -14\nIMAGE=b.png\nSCALE=0.5\n",
    "a.nts": '"two fishes\n1 2L 6 0 DIM=3\ntrout carp\n1 2 3 4 5 6.5\n1.5 2 3\n4 5 -7\n',
    "b.nts": "1 2 6L 0 dim=3\nx1 y1 z1 x2 y2 z2\n1 2 3 4 5 6.5 1.5 2 3 4 5 -7\n",
    "a.txt": "[Individuals]\n2\n[landmarks]\n2\n[dimensions]\n3\n[names]\ntrout\ncarp\n[rawpoints]\n'1\n1 2 3\n"
    "4 5 6.5\n'2\n1.5 2 3\n4 5 -7\n",
    "a.prm": "[Radial Basis Functions]\nbasis function: gaussian_spline\nradius: 0.5\n\n[Control points]\n# before\n"
    "original control points: 1 2 3\n           4 5 6.5\n\ndeformed control points: 1.5 2 3\n4 5 -7\n",
}


@pytest.mark.parametrize("name", FILES)
def test_two_specimens_are_pairs(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(FILES[name], encoding="utf-8")
    found = read_landmarks(tmp_path / name)
    assert found.fixed is not None
    assert (found.points.tolist(), found.fixed.tolist(), found.notes) == (*PAIR, ())


@pytest.mark.parametrize("suffix", [".tps", ".nts", ".prm", ".txt", ".morphologika.txt", ".xyz", ".points.csv"])
@pytest.mark.parametrize("dim", [2, 3])
def test_round_trip(suffix: str, dim: int, tmp_path: Path) -> None:
    places, fixed = (np.random.default_rng(k).normal(size=(5, dim)) * 1e3 for k in (0, 1))
    path = tmp_path / f"a{suffix}"
    if suffix in (".prm", ".xyz") and dim == 2:
        with pytest.raises(VolumeFileError, match="two coordinates"):
            write_landmarks(Landmarks(places, fixed=fixed), path)
        return
    write_landmarks(Landmarks(places, fixed=fixed), path)
    again = read_landmarks(path)
    np.testing.assert_array_equal(again.points, places)
    if suffix not in (".txt", ".xyz"):  # lists of points hold one place of each
        np.testing.assert_array_equal(again.fixed, fixed)


def test_the_first_of_several_specimens_is_read_and_curves_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "a.tps"
    path.write_text(
        "LM=1\n1 2\nCURVES=1\nPOINTS=2\n1 1\n2 2\nID=first\n" + "LM=1\n3 4\nID=other\n" * 2, encoding="utf-8"
    )
    found = read_landmarks(path)
    assert (found.points.tolist(), found.fixed) == ([[1.0, 2.0]], None)
    assert found.notes == (
        "the first of 3 specimens was read, first; two of them would be read as pairs",
        "1 curves were left out; only landmarks are read",
    )


def test_points_that_transformix_mapped_are_pairs(tmp_path: Path) -> None:
    (tmp_path / "outputpoints.txt").write_text(
        "Point\t0\t; InputIndex = [ 1 2 3 ]\t; InputPoint = [ 1.5 2 3 ]\t; OutputIndexFixed = [ 1 2 4 ]\t; "
        "OutputPoint = [ 1.5 2.25 4 ]\t; Deformation = [ 0 0.25 1 ]\n",
        encoding="utf-8",
    )
    found = read_landmarks(tmp_path / "outputpoints.txt")
    assert found.fixed is not None
    assert (found.points.tolist(), found.fixed.tolist()) == ([[1.5, 2.0, 3.0]], [[1.5, 2.25, 4.0]])


def test_points_of_elastix(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("point\n2\n1.5 2 3\n-4 5e1 6\n", encoding="utf-8")
    assert read_landmarks(path).points.tolist() == [[1.5, 2.0, 3.0], [-4.0, 50.0, 6.0]]


BAD = {
    "a.tps": [
        ("LM=2\n1 2\n", "announces 2"),
        ("LM=1\n1 2 3 4\n", "line 2 has 4"),
        ("LM=x\n", "'x'"),
        ("LM=2\n1 2 3\n1 2\n", "line 3 has 2"),
        ("hello\n", "a key"),
        ("LM=1\n1 nan\n", "all 1 are missing"),
        ("LM=1\n1 2\nSCALE=-1\n", "not above 0"),
        ("LM=0\nOUTLINES=1\nPOINTS=1\n1 2\n", "1 curves or outlines and no landmark"),
        ("ID=1\n", "no landmark"),
        ("LM=1\n1 2\nLM=2\n1 2\n3 4\n", "1 and 2"),
    ],
    "a.nts": [
        ("1 2 6 0\n", "first line"),
        ("1 1 6 0 dim=3\n1 2 3\n", "and 3 follow"),
        ("1 1 6 1 9999 dim=3\n9999 2 3\n9999 9999 9999\n", "all 2 are missing"),
        ("", "first line"),
    ],
    "a.txt": [
        ("index\n1\n1 2 3\n", "indices of voxels"),
        ("point\n2\n1 2 3\n", "announces 2"),
        ("words\n", "neither"),
        ("[individuals]\n1\n[landmarks]\n2\n[dimensions]\n2\n[rawpoints]\n1 2\n", "1 places follow"),
    ],
    "a.xyz": [("# only\n", "no landmark"), ("1 2 3\n1 x 3\n", "line 2, column 2: 'x'"), ("1 2\n", "line 1 has 2")],
    "a.prm": [
        ("[Control points]\noriginal control points: 1 2 3\n", "no original and deformed"),
        ("original control points: 1 2 3\n4 5 6\ndeformed control points: 1 2 3\n", "2 original and 1"),
    ],
}


@pytest.mark.parametrize("name", BAD)
def test_damaged_files_are_refused_with_the_line(name: str, tmp_path: Path) -> None:
    for text, words in BAD[name]:
        (tmp_path / name).write_text(text, encoding="utf-8")
        with pytest.raises(VolumeFileError, match=words):
            read_landmarks(tmp_path / name)
