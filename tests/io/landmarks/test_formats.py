"""Landmarks: files of other programs in the right directions, and places that follow a deformation."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyvista
from format_table import bound
from oracle import assert_close
from vtkmodules.vtkIOLegacy import vtkSimplePointsReader, vtkSimplePointsWriter

from deformnb.document.deformation import Deformation
from deformnb.errors import DeformError, VolumeFileError
from deformnb.io.landmarks.formats import is_landmarks, read_landmarks, write_landmarks
from deformnb.rbf.fields import DisplacementField
from deformnb.rbf.points import ControlPoints
from deformnb.volume.volume import Grid
from deformnb.warping.points import Landmarks, warp_landmarks

EACH = pytest.mark.parametrize("suffix", ["mrk.json", "fcsv", "csv", "bigwarp.json"])


@EACH
def test_round_trip(suffix: str, tmp_path: Path) -> None:
    marks = Landmarks([[1.1, -2, 3e-7], [4, 5, 1e5]], ('left "ear", upper', "\u00e9"), active=[True, False])
    write_landmarks(marks, tmp_path / f"a.{suffix}")
    again = read_landmarks(tmp_path / f"a.{suffix}")
    np.testing.assert_array_equal(again.points, marks.points)
    assert again.names == marks.names
    assert again.active is not None
    assert again.active.tolist() == [True, False]


def test_pairs_of_bigwarp(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(
        '"Pt-0","true","1","2","3","4","5","6"\n"Pt-1","false","7","8","9","Infinity","-Infinity","NaN"\n'
        '"Pt-2","true","Infinity","Infinity","Infinity","1","1","1"\n',
        encoding="utf-8",
    )
    marks = read_landmarks(path)
    assert marks.points.tolist() == [[1, 2, 3], [7, 8, 9]]
    assert marks.notes == ("1 landmark is missing and left out: 3", "1 landmark is without a fixed place: 2")
    pairs = marks.control_points()
    assert (pairs.source.tolist(), pairs.target.tolist(), pairs.names) == ([[1, 2, 3]], [[4, 5, 6]], ("Pt-0",))
    write_landmarks(marks, path)
    again = read_landmarks(path)
    np.testing.assert_array_equal(again.fixed, marks.fixed)
    with pytest.raises(DeformError, match="single places, not pairs"):
        Landmarks([[1, 2, 3]]).control_points()


BIGWARP = (
    '{"type": "BigWarpLandmarks", "numDimensions": 3, "movingPoints": [[1, 2, 3], [7, 8, 9], [Infinity, 0, 0]],'
    ' "fixedPoints": [[4, 5, 6], [Infinity, Infinity, Infinity], [1, 1, 1]], '
    '"active": [true, false, true], "names": ["Pt-0", "Pt-1", "Pt-2"]}'
)


@pytest.mark.parametrize(
    "text",
    [
        BIGWARP,
        f'{{"type": "Thin Plate Spline", "landmarks": {BIGWARP}}}',
        f'{{"Sources": [], "Transform": {{"landmarks": {BIGWARP}}}}}',
    ],
)
@pytest.mark.parametrize("name", ["a.json", "a.bigwarp.json"])
def test_json_of_bigwarp(name: str, text: str, tmp_path: Path) -> None:
    """Literally, after LandmarkTableModel.toJson of BigWarp 9: alone, in a transform and in a project."""
    (tmp_path / name).write_text(text, encoding="utf-8")
    assert is_landmarks(tmp_path / name)
    marks = read_landmarks(tmp_path / name)
    assert marks.points.tolist() == [[1, 2, 3], [7, 8, 9]]
    assert (marks.names, marks.notes) == (
        ("Pt-0", "Pt-1"),
        ("1 landmark is missing and left out: 3", "1 landmark is without a fixed place: 2"),
    )
    pairs = marks.control_points()
    assert (pairs.source.tolist(), pairs.target.tolist()) == ([[1, 2, 3]], [[4, 5, 6]])


def test_slicers_markups_are_known_by_what_is_in_them_and_state_their_unit(tmp_path: Path) -> None:
    point = {"label": "nose", "position": [1, 2, 3]}
    for unit, symbol in (("um", "\u00b5m"), (["mm", "UCUM", "millimeter"], "mm")):
        markup = {"coordinateSystem": "RAS", "coordinateUnits": unit, "controlPoints": [point]}
        (tmp_path / "a.json").write_text(json.dumps({"markups": [markup]}), encoding="utf-8")
        assert is_landmarks(tmp_path / "a.json")
        found = read_landmarks(tmp_path / "a.json")
        assert (found.points.tolist(), found.unit) == ([[-1, -2, 3]], symbol)
    text = (tmp_path / "a.json").read_text(encoding="utf-8").replace("UCUM", "x").replace('"mm"', '"ell"')
    (tmp_path / "a.json").write_text(text, encoding="utf-8")
    with pytest.raises(VolumeFileError, match="its unit"):
        read_landmarks(tmp_path / "a.json")


@pytest.mark.parametrize(
    ("system", "wanted"), [("RAS", [-1, -2, 3]), ("0", [-1, -2, 3]), ("LPS", [1, 2, 3]), ("1", [1, 2, 3])]
)
def test_ras_and_lps(system: str, wanted: list[float], tmp_path: Path) -> None:
    (tmp_path / "a.fcsv").write_text(
        f"# Markups fiducial file version = 4.11\n# CoordinateSystem = {system}\n"
        "# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\n"
        "n_1,1,2,3,0,0,0,1,1,1,0,nose,,\n",
        encoding="utf-8",
    )
    assert read_landmarks(tmp_path / "a.fcsv").points.tolist() == [wanted]
    point = {"label": "nose", "position": [1, 2, 3], "positionStatus": "defined"}
    missing = {"label": "ear", "positionStatus": "undefined"}
    data = {"markups": [{"coordinateSystem": system, "controlPoints": [point, missing]}]}
    (tmp_path / "a.mrk.json").write_text(json.dumps(data), encoding="utf-8")
    marks = read_landmarks(tmp_path / "a.mrk.json")
    assert marks.points.tolist() == [wanted]
    assert marks.names == ("nose",)


MARKUP = '{"markups": [{"coordinateSystem": "LPS", "controlPoints": [%s]}]}'


@pytest.mark.parametrize(
    ("name", "text", "match"),
    [
        ("a.csv", "", "no landmark"),
        ("a.csv", "a,b,c\n", "line 1 names no columns"),
        ("a.csv", "p,true,1,2,3,4,5,6\np,true,1,2,3,4\n", "line 2 has 6 columns"),
        ("a.csv", "p,yes,1,2,3,4,5,6\n", "line 1, column 2: 'yes'"),
        ("a.csv", "p,true,1,2,x,4,5,6\n", "line 1, column 5: 'x'"),
        ("a.fcsv", "", "no landmark"),
        ("a.fcsv", "# CoordinateSystem = XYZ\n1,1,2,3\n", "neither LPS nor RAS"),
        ("a.fcsv", "1,1,2,inf\n", "all 1 are missing"),
        ("a.fcsv", "1,1,2\n", "line 1, column 4: nothing"),
        ("a.mrk.json", "{", "cannot be read"),
        ("a.mrk.json", "[]", "with a list markups"),
        ("a.mrk.json", '{"markups": [3]}', "no list controlPoints"),
        ("a.mrk.json", MARKUP % "3", "not an object"),
        ("a.mrk.json", MARKUP % '{"position": [1, 2]}', "landmark 1 has no position"),
        ("a.mrk.json", MARKUP % '{"position": [1, 2, NaN]}', "all 1 are missing"),
        ("a.mrk.json", MARKUP % "", "no landmark"),
        ("a.mrk.json", "[" * 100000, "cannot be read"),
        ("a.odt", "", "no kind of landmark file"),
    ],
)
def test_mistakes_are_one_sentence(name: str, text: str, match: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text, encoding="utf-8")
    with pytest.raises(VolumeFileError, match=match) as caught:
        read_landmarks(tmp_path / name)
    assert str(caught.value).startswith(f"{name}: ")
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"points": [[0, 0, np.inf]]}, "landmark 1 is not finite"),
        ({"points": [[0]]}, "shape"),
        ({"points": ["a"]}, "numbers"),
        ({"points": [[0, 0, 0]], "names": ("a", "b")}, "1 landmarks need as many names"),
        ({"points": [[0, 0, 0]], "fixed": [[0, 0]]}, "fixed places"),
    ],
)
def test_what_are_no_landmarks(arguments: dict[str, Any], match: str) -> None:
    with pytest.raises(DeformError, match=match):
        Landmarks(**arguments)


def test_flat_landmarks_go_into_bigwarps_file_only(tmp_path: Path) -> None:
    flat = Landmarks([[1, 2]], fixed=[[3, 4]])
    write_landmarks(flat, tmp_path / "a.csv")
    assert read_landmarks(tmp_path / "a.csv").control_points().dim == 2
    with pytest.raises(VolumeFileError, match="holds places in space"):
        write_landmarks(flat, tmp_path / "a.fcsv")


def test_landmarks_follow_a_deformation() -> None:
    points = ControlPoints.from_arrays(
        [[0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10], [5, 5, 5]],
        [[0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10], [7, 5, 6]],
    )
    field = Deformation.from_space_points(points, kernel="thin_plate").field(Grid((4, 4, 4)))
    moved = warp_landmarks(Landmarks([[5, 5, 5], [10, 0, 0]], ("a", "b")), field)
    assert_close(moved.points, [[7, 5, 6], [10, 0, 0]], atol=1e-4)
    assert moved.names == ("a", "b")
    assert moved.notes == ()


def test_a_landmark_without_a_place_stays_and_is_named() -> None:
    grid = Grid((2, 2, 2), (1e3, 1e3, 1e3), (-500, -500, -500))
    k, j, i = np.indices(grid.shape)
    crush = DisplacementField(-grid.index_to_point(np.stack([i, j, k], axis=-1)), grid)
    moved = warp_landmarks(Landmarks([[3, 4, 5]], ("nose",)), crush)
    assert moved.points.tolist() == [[3, 4, 5]]
    assert moved.notes == ("these landmarks have no place in the result and stay where they were: nose",)


def test_names_say_what_are_landmarks() -> None:
    assert is_landmarks("a/b.FCSV")
    assert not is_landmarks("a.json")


def test_two_lists_are_paired_by_name_or_order_and_the_rest_is_named() -> None:
    moving = Landmarks([[0, 0, 0], [1, 0, 0], [2, 0, 0]], ("a", "b", "c"), active=[True, False, True])
    fixed = Landmarks([[5, 5, 5], [6, 6, 6]], ("c", "b"))
    points, left, others = ControlPoints.from_landmarks(moving, fixed)
    assert (points.names, points.source.tolist(), points.target.tolist()) == (
        ("b", "c"),
        [[1, 0, 0], [2, 0, 0]],
        [[6, 6, 6], [5, 5, 5]],
    )
    assert (points.active.tolist(), left, others) == ([False, True], ("a",), ())
    by_order = ControlPoints.from_landmarks(moving, Landmarks([[9, 9, 9]] * 4), pair="order")
    assert (by_order.points.names, by_order.left_moving, by_order.left_fixed) == (("a", "b", "c"), (), ("landmark 4",))
    for other, pair, words in (
        (Landmarks([[0, 0, 0]]), "name", "landmark 1 has no name"),
        (Landmarks([[0, 0, 0]] * 2, ("a", "a")), "name", "more than once"),
        (Landmarks([[0, 0]], ("a",)), "name", "coordinates"),
        (fixed, "nearest", 'by "name"'),
    ):
        with pytest.raises(DeformError, match=words):
            ControlPoints.from_landmarks(moving, other, pair=pair)


def test_the_samples_of_other_programs(real_data: Callable[[str], Path]) -> None:
    folder = real_data("landmarks")
    pairs = read_landmarks(folder / "bigwarp_3d.csv").control_points()
    assert pairs.dim == 3
    limit = bound("landmarks", "bigwarp", "BigWarp's samples, read only")
    assert_close(pairs.source[0], [193.1527102803737, 163.57943925233658, 130], atol=limit)
    assert_close(pairs.target[0], [216.01797508417232, 233.3341910984992, 126.86263579832789], atol=limit)
    assert read_landmarks(folder / "bigwarp_2d.csv").control_points().dim == 2
    ras = read_landmarks(folder / "slicer_ras.fcsv")
    limit = bound("landmarks", "fcsv", "3D Slicer's samples, read only")
    assert_close(ras.points[0], [-10.2321648, -3.71826, 6.6954888], atol=limit)
    mice = [read_landmarks(folder / f"slicer_mouse_{name}.mrk.json") for name in ("A_J", "CAST_EIJ")]
    assert len(mice[0]) == len(mice[1])
    limit = bound("landmarks", "markups", "3D Slicer's samples, read only")
    assert_close(mice[0].points[0], [-9.21016, -25.0792, 9.31477], atol=limit)


def test_vtk_reads_and_writes_the_same_points(tmp_path: Path) -> None:
    places = np.random.default_rng(0).normal(size=(5, 3)) * 100
    write_landmarks(Landmarks(places), tmp_path / "ours.xyz")
    reader = vtkSimplePointsReader()
    reader.SetFileName(str(tmp_path / "ours.xyz"))
    reader.Update()
    limit = bound("landmarks", "points", "VTK") * np.abs(places).max()
    assert_close(pyvista.wrap(reader.GetOutput()).points, places, atol=limit)
    writer = vtkSimplePointsWriter()
    writer.SetInputData(pyvista.PolyData(places))
    writer.SetDecimalPrecision(17)
    writer.SetFileName(str(tmp_path / "theirs.xyz"))
    writer.Write()
    assert_close(read_landmarks(tmp_path / "theirs.xyz").points, places, atol=limit)
