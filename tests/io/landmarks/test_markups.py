"""Markups of Slicer that are deformed as a whole: places in literal numbers, and all else as it was."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deformnb as dn
from deformnb.errors import VolumeFileError
from deformnb.io import warp_markups
from deformnb.rbf.fields import Affine

# Backward: a place of the result reads 10 further along -x, so that tissue goes 10 along +x in LPS.
SHIFT = Affine(np.eye(3), np.array([-10.0, 0.0, 0.0]))
# Backward by a quarter turn about z, so that tissue turns from x to y.
QUARTER = Affine(np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]), np.zeros(3))

DISPLAY = {"visibility": True, "color": [1.0, 0.5, 0.0], "selectedColor": [0.0, 0.8, 1.0], "glyphSize": 3.0}


def _write(path: Path, **markup: Any) -> Path:
    points = [
        {
            "id": "1",
            "label": "nose",
            "position": [1.0, 2.0, 3.0],
            "locked": True,
            "visibility": False,
            "selected": True,
        },
        {"id": "2", "label": "tail", "description": "of the fish", "position": [4.0, 5.0, 6.0], "selected": False},
        {"id": "3", "label": "open", "position": [0.0, 0.0, 0.0], "positionStatus": "undefined"},
    ]
    usual = {"type": "Fiducial", "coordinateSystem": "LPS", "coordinateUnits": "mm", "locked": True, "display": DISPLAY}
    data = {"@schema": "x", "markups": [{**usual, "controlPoints": points, **markup}]}
    path.write_text(json.dumps(data), encoding="utf-8")
    return path


def _read(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8"))["markups"][0]


@pytest.mark.parametrize("kind", ["Fiducial", "Line", "Angle", "Curve", "ClosedCurve"])
def test_points_move_and_all_else_stays(tmp_path: Path, kind: str) -> None:
    source = _write(
        tmp_path / "a.mrk.json", type=kind, measurements=[{"name": "length", "enabled": True, "value": 3.0}]
    )
    assert warp_markups(source, tmp_path / "b.mrk.json", SHIFT) == ()
    before, after = _read(source), _read(tmp_path / "b.mrk.json")
    assert [point["position"] for point in after["controlPoints"]] == [[11, 2, 3], [14, 5, 6], [0, 0, 0]]
    for old, new in zip(before["controlPoints"], after["controlPoints"], strict=True):
        assert {**new, "position": None} == {**old, "position": None}
    for key in ("type", "locked", "display", "coordinateSystem", "coordinateUnits"):
        assert after[key] == before[key]
    assert after["measurements"] == [{"name": "length", "enabled": True}]


def test_ras_and_other_units_stay_what_they_are(tmp_path: Path) -> None:
    source = _write(tmp_path / "a.mrk.json", coordinateSystem="RAS", coordinateUnits="cm")
    grid = dn.Grid((40, 40, 40), unit="mm")
    warp_markups(source, tmp_path / "b.mrk.json", SHIFT, grid)
    after = _read(tmp_path / "b.mrk.json")
    assert after["controlPoints"][0]["position"] == pytest.approx([0, 2, 3])  # 1 cm along +x of LPS is -x of RAS
    assert (after["coordinateSystem"], after["coordinateUnits"]) == ("RAS", "cm")


def test_fiducials_of_old_files_keep_their_switches(tmp_path: Path) -> None:
    path = tmp_path / "old.fcsv"
    path.write_text(
        "# Markups fiducial file version = 4.4\n# CoordinateSystem = 0\n"
        "# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\n"
        "vtkMRMLMarkupsFiducialNode_0,43.5,23,1,0,0,0,1,0,1,1,L-1,first,vtkMRMLVolume1\n"
        "vtkMRMLMarkupsFiducialNode_1,49,-4.25,2,0,0,0,1,1,0,0,L-2,,\n",
        encoding="utf-8",
    )
    warp_markups(path, tmp_path / "new.mrk.json", SHIFT)
    first, second = _read(tmp_path / "new.mrk.json")["controlPoints"]
    assert first["position"] == [33.5, 23, 1]  # in RAS, as the file is
    assert (first["visibility"], first["selected"], first["locked"]) == (False, True, True)
    assert (first["label"], first["description"], first["associatedNodeID"]) == ("L-1", "first", "vtkMRMLVolume1")
    assert (second["visibility"], second["selected"], second["locked"]) == (True, False, False)
    warp_markups(tmp_path / "new.mrk.json", tmp_path / "again.fcsv", SHIFT)
    rows = (tmp_path / "again.fcsv").read_text(encoding="utf-8").splitlines()
    assert rows[1] == "# CoordinateSystem = RAS"
    assert rows[3] == "vtkMRMLMarkupsFiducialNode_0,23.5,23.0,1.0,0,0,0,1,0,1,1,L-1,first,vtkMRMLVolume1"
    marks = dn.read_landmarks(tmp_path / "again.fcsv")
    assert marks.points.tolist() == [[-23.5, -23, 1], [-29, 4.25, 2]]  # LPS


@pytest.mark.parametrize("system", ["LPS", "RAS"])
def test_boxes_and_planes_move_and_turn_by_their_middle(tmp_path: Path, system: str) -> None:
    sign = np.array([1.0, 1, 1]) if system == "LPS" else np.array([-1.0, -1, 1])
    center = (np.array([10.0, 0, 5]) * sign).tolist()
    frame = {"center": center, "orientation": np.eye(3).ravel().tolist(), "size": [4.0, 2.0, 6.0]}
    source = _write(tmp_path / "a.mrk.json", type="ROI", coordinateSystem=system, controlPoints=[], **frame)
    [note] = warp_markups(source, tmp_path / "b.mrk.json", QUARTER)
    assert "a box stays straight" in note
    after = _read(tmp_path / "b.mrk.json")
    assert after["center"] == pytest.approx((np.array([0.0, 10, 5]) * sign).tolist())
    axes = np.array(after["orientation"]).reshape(3, 3)
    assert np.allclose(axes[:, 0], [0, 1, 0])  # what was x is y
    assert np.allclose(axes[:, 2], [0, 0, 1])
    assert after["size"] == [4.0, 2.0, 6.0]
    base = np.eye(4)
    base[:3, 3] = center
    frame = {"center": center, "normal": sign.tolist(), "baseToNode": base.ravel().tolist()}
    frame["normal"] = [float(sign[0]), 0.0, 0.0]
    source = _write(tmp_path / "p.mrk.json", type="Plane", coordinateSystem=system, controlPoints=[], **frame)
    [note] = warp_markups(source, tmp_path / "q.mrk.json", QUARTER)
    assert "a plane stays flat" in note
    after = _read(tmp_path / "q.mrk.json")
    assert after["normal"] == pytest.approx([0, float(sign[1]), 0])
    assert np.allclose(np.array(after["baseToNode"]).reshape(4, 4)[:3, 3], np.array([0, 10, 5]) * sign)


def test_a_place_without_a_counterpart_stays_with_a_note(tmp_path: Path) -> None:
    source = _write(tmp_path / "a.mrk.json")
    points = dn.ControlPoints.from_arrays([[1, 2, 3]], [[41, 2, 3]])
    folding = dn.Deformation.from_space_points(points, trend="none", support=10.0)
    notes = warp_markups(source, tmp_path / "b.mrk.json", folding, dn.Grid((50, 50, 50)))
    moved, found = folding.warp_points([[1, 2, 3], [4, 5, 6]], dn.Grid((50, 50, 50)))
    after = [point["position"] for point in _read(tmp_path / "b.mrk.json")["controlPoints"][:2]]
    assert after == pytest.approx(np.where(found[:, None], moved, [[1, 2, 3], [4, 5, 6]]))
    assert bool(notes) == (not found.all())


@pytest.mark.parametrize(
    ("given", "target", "words"),
    [
        ({"type": "Curve"}, "b.fcsv", "an .fcsv holds one list of points, and the file has Curve; write an .mrk.json"),
        ({}, "b.csv", "this is no file of Slicer's markups; these end in .mrk.json or .fcsv"),
        ({"controlPoints": 3}, "b.mrk.json", "one of its markups has no list controlPoints"),
        ({"coordinateSystem": "XYZ"}, "b.mrk.json", "neither LPS nor RAS"),
        ({"controlPoints": [{"position": [1, 2]}]}, "b.mrk.json", "control point 1 has no position of three numbers"),
    ],
)
def test_files_that_do_not_fit_are_refused(tmp_path: Path, given: dict[str, Any], target: str, words: str) -> None:
    source = _write(tmp_path / "a.mrk.json", **given)
    with pytest.raises(VolumeFileError, match=words):
        warp_markups(source, tmp_path / target, SHIFT)
    assert not (tmp_path / target).exists()
