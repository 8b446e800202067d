"""Tables of landmarks: with the names of columns that other programs write, and without any."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from deformnb.errors import VolumeFileError
from deformnb.io.landmarks.formats import read_landmarks, write_landmarks
from deformnb.warping.points import Landmarks

ONE, OTHER = [1.0, 2.0, 3.0], [4.0, 5.0, 6.5]


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("name,x,y,z\nnose,1,2,3\ntail,4,5,6.5\n", ("nose", "tail")),  # OpenSim Creator
        ("x,y,z\n1,2,3\n4,5,6.5\n", ("", "")),
        ("nose,1,2,3\ntail,4,5,6.5\n", ("nose", "tail")),
        ("1,2,3\n4,5,6.5\n", ("", "")),
        ("label,r,a,s,defined,selected\nnose,-1,-2,3,1,1\ntail,-4,-5,6.5,1,1\n", ("nose", "tail")),  # Slicer
        ("label,l,p,s\nnose,1,2,3\ntail,4,5,6.5\n", ("nose", "tail")),
        ("index,axis-0,axis-1,axis-2\n0,3,2,1\n1,6.5,5,4\n", ("0", "1")),  # napari
        ("Landmark\tPosition X\tPosition Y\tPosition Z\nnose\t1\t2\t3\ntail\t4\t5\t6.5\n", ("nose", "tail")),
        ("X (mm);Y (mm);Z (mm)\n1;2;3\n4;5;6,5\n", ("", "")),
        ("name,z_um,y_um,x_um\nnose,3000,2000,1000\ntail,6500,5000,4000\n", ("nose", "tail")),
        ("id,x [m],y [m],z [m]\nnose,1e-3,2e-3,3e-3\ntail,4e-3,5e-3,6.5e-3\n", ("nose", "tail")),
    ],
)
def test_places_of_tables(text: str, names: tuple[str, ...], tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    found = read_landmarks(tmp_path / "a.csv").to_unit("mm")
    np.testing.assert_allclose(found.points, [ONE, OTHER], rtol=1e-12)
    assert (found.names, found.fixed) == (names, None)


@pytest.mark.parametrize(
    "text",
    [
        "name,x,y,z,fixed_x,fixed_y,fixed_z\nnose,1,2,3,4,5,6.5\n",
        "source_x,source_y,source_z,target_x,target_y,target_z,name\n1,2,3,4,5,6.5,nose\n",
        "point,x1,y1,z1,x2,y2,z2\nnose,1,2,3,4,5,6.5\n",
        "nose,1,2,3,4,5,6.5\n",
        "nose,true,7,1,2,3,4,5,6.5\n",
    ],
)
def test_pairs_of_tables(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    found = read_landmarks(tmp_path / "a.csv")
    assert found.fixed is not None
    assert (found.names, found.points.tolist(), found.fixed.tolist()) == (("nose",), [ONE], [OTHER])


def test_what_a_table_lacks_is_left_out_or_has_no_pair(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("name,active,x,y,x_fixed,y_fixed\na,no,1,2,,\nb,yes,,,5,6\n", encoding="utf-8")
    found = read_landmarks(tmp_path / "a.csv")
    assert (found.names, found.points.tolist(), found.notes) == (
        ("a",),
        [[1.0, 2.0]],
        ("1 landmark is missing and left out: 2", "1 landmark is without a fixed place: 1"),
    )
    assert found.active is not None
    assert found.active.tolist() == [False]
    assert len(found.control_points()) == 0


def test_a_table_is_written_with_names_of_columns(tmp_path: Path) -> None:
    write_landmarks(Landmarks([ONE], ("left, upper",), fixed=[[np.nan, 0, 0]]), tmp_path / "a.points.csv")
    assert (tmp_path / "a.points.csv").read_text(encoding="utf-8") == (
        'name,x,y,z,fixed_x,fixed_y,fixed_z\n"left, upper",1.0,2.0,3.0,,0.0,0.0\n'
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x,y,z\n1,2,3\n1,b,3\n", "line 3, column 2: 'b'"),
        ("x;y;z\n1;2;q\n", "line 2, column 3: 'q'"),
        ("1,2,3\n\n1,2\n", "line 3 has 2 columns"),
        ("x [px],y [px]\n1,2\n", "line 1, column 1: .*in voxels"),
        ("left,right\n1,2\n", "names no columns"),
        ("1\n", "line 1 has 1 columns"),
        ("# only\n", "no landmark"),
        ("x,y,z\n", "no landmark"),
        ("1,2,inf\n", "all 1 are missing"),
    ],
)
def test_mistakes_in_tables_are_named_by_line_and_column(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    with pytest.raises(VolumeFileError, match=words):
        read_landmarks(tmp_path / "a.csv")
