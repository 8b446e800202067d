"""Each row of the table of the page about 3D Slicer, in both directions, with literal places.

Slicer reads volumes and transforms by ITK, here by SimpleITK, which has ITK's readers, and makes thin-plate splines by
VTK; slicerio reads its segmentations and markups, where it is installed.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deformnb as dn
from deformnb.rbf.fields import Affine, DisplacementField

PAGE = Path(__file__).resolve().parents[2] / "docs" / "howto" / "slicer.md"
# Directions of an image that is turned by a quarter about z and mirrored: x goes along P, y along R.
GRID = dn.Grid((6, 7, 8), (1.5, 2.0, 2.5), (10.0, -20.0, 30.0), ((0, -1, 0), (1, 0, 0), (0, 0, 1)), "mm")
PLACE = (7.0, -15.0, 36.0)


def _sitk() -> Any:
    return pytest.importorskip("SimpleITK")


def _volumes(folder: Path) -> None:
    sitk = _sitk()
    values = np.arange(336, dtype=np.int16).reshape(GRID.shape)
    for suffix in (".nrrd", ".nii.gz", ".mha"):
        dn.write_volume(dn.Volume(values, GRID), folder / f"ours{suffix}")
        image = sitk.ReadImage(str(folder / f"ours{suffix}"))
        # Voxel (x, y, z) = (1, 2, 3) is at (10 - 2 * 2, -20 + 1 * 1.5, 30 + 3 * 2.5) in LPS.
        assert image.TransformIndexToPhysicalPoint((1, 2, 3)) == pytest.approx((6, -18.5, 37.5), abs=1e-4)
        assert image[1, 2, 3] == values[3, 2, 1]
        sitk.WriteImage(image, str(folder / f"theirs{suffix}"))
        back = dn.read_volume(folder / f"theirs{suffix}")
        assert back.grid.index_to_point([1, 2, 3]) == pytest.approx((6, -18.5, 37.5), abs=1e-4)
        assert np.array_equal(back.values, values)


def _segmentations(folder: Path) -> None:
    slicerio = pytest.importorskip("slicerio")
    # A file that Slicer has written, which comes with slicerio; index (x, y, z) = (10, 20, 3).
    sample = Path(slicerio.__file__).parent / "data" / "Segmentation.seg.nrrd"
    volume = dn.read_volume(sample)
    assert volume.is_labels
    assert dn.io.read_label_names(sample)[5] == "right lung"
    assert volume.grid.index_to_point([10, 20, 3]) == pytest.approx((162.62724, 155.45848, -310.25), abs=1e-4)
    moved = dn.warp(volume, Affine(np.eye(3), np.array([0.0, 0.0, 20.0])))  # by two slices
    dn.io.write_segmentation(moved, folder / "ours.seg.nrrd", sample)
    theirs = slicerio.read_segmentation(str(folder / "ours.seg.nrrd"))
    assert np.array_equal(theirs["voxels"].transpose(2, 1, 0)[:-2], volume.values[2:])
    lung = next(segment for segment in theirs["segments"] if segment["name"] == "right lung")
    assert lung["labelValue"] == 5
    assert lung["color"] == pytest.approx((0.0862745, 0.772549, 0.278431))
    assert theirs["ijkToLPS"][:3, 3] == pytest.approx(volume.grid.origin)


def _point_lists(folder: Path) -> None:
    marks = dn.warping.Landmarks([[7, -15, 36], [1, 2, 3]], ("nose", "tail"), active=[True, False])
    dn.write_landmarks(marks, folder / "ours.mrk.json")
    dn.write_landmarks(marks, folder / "ours.fcsv")
    [markup] = json.loads((folder / "ours.mrk.json").read_text(encoding="utf-8"))["markups"]
    assert (markup["type"], markup["coordinateSystem"], markup["coordinateUnits"]) == ("Fiducial", "LPS", "mm")
    assert [point["position"] for point in markup["controlPoints"]] == [[7, -15, 36], [1, 2, 3]]
    assert [point["selected"] for point in markup["controlPoints"]] == [True, False]
    if find_spec("slicerio") is not None:
        from slicerio.markups import read_markups_fcsv

        [theirs] = read_markups_fcsv(str(folder / "ours.fcsv"))["markups"]
        assert [point["position"] for point in theirs["controlPoints"]] == [[7, -15, 36], [1, 2, 3]]
        sample = Path(str(find_spec("slicerio").origin)).parent / "data" / "F_1.fcsv"  # type: ignore[union-attr]
        found = dn.read_landmarks(sample)  # which Slicer has written, in LPS
        assert found.names[3] == "Different name"
        assert found.points[0] == pytest.approx((-6.282824184397157, -51.06216973995272, -10.2143))
        assert found.active is not None
        assert found.active.tolist()[4] is False
    # As Slicer 4.4 wrote them: the coordinate system is a number, and RAS.
    old = "# Markups fiducial file version = 4.4\n# CoordinateSystem = 0\n"
    old += "# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\n"
    old += "n0,43.5,23.25,1,0,0,0,1,1,1,0,L1,,\n"
    (folder / "old.fcsv").write_text(old, encoding="utf-8")
    assert dn.read_landmarks(folder / "old.fcsv").points.tolist() == [[-43.5, -23.25, 1]]


def _moved_markups(folder: Path) -> None:
    curve = {"type": "Curve", "coordinateSystem": "RAS", "display": {"color": [1, 0, 0]}}
    curve |= {"controlPoints": [{"label": "C-1", "position": [7.0, -15.0, 36.0], "locked": True}]}
    (folder / "theirs.mrk.json").write_text(json.dumps({"markups": [curve]}), encoding="utf-8")
    shift = Affine(np.eye(3), np.array([-10.0, 0.0, 0.0]))  # tissue goes 10 to +x of LPS, -x of RAS
    dn.io.warp_markups(folder / "theirs.mrk.json", folder / "ours.mrk.json", shift)
    [moved] = json.loads((folder / "ours.mrk.json").read_text(encoding="utf-8"))["markups"]
    assert moved["controlPoints"] == [{"label": "C-1", "position": [-3.0, -15.0, 36.0], "locked": True}]
    assert (moved["type"], moved["display"]) == ("Curve", {"color": [1, 0, 0]})
    assert dn.read_landmarks(folder / "ours.mrk.json").points.tolist() == [[3, 15, 36]]


def _linear_transforms(folder: Path) -> None:
    sitk = _sitk()
    turn = Affine(np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]), np.array([1.0, 2.0, 3.0]))
    for suffix in (".tfm", ".h5"):
        dn.write_transform(turn, folder / f"ours{suffix}", GRID)
        theirs = sitk.ReadTransform(str(folder / f"ours{suffix}"))
        assert theirs.TransformPoint(PLACE) == pytest.approx((-15 + 1, -7 + 2, 36 + 3))
        euler = sitk.Euler3DTransform()
        euler.SetCenter((1, 2, 3))
        euler.SetRotation(0, 0, np.pi / 2)
        euler.SetTranslation((5, 0, 0))
        sitk.WriteTransform(euler, str(folder / f"theirs{suffix}"))
        found = dn.read_transform(folder / f"theirs{suffix}").displacement([PLACE])[0]
        # About (1, 2, 3): (6, -17, 33) turns to (17, 6, 33).
        assert np.add(PLACE, found) == pytest.approx((17 + 1 + 5, 6 + 2, 33 + 3))


def _grid_transforms(folder: Path) -> None:
    sitk = _sitk()
    values = np.zeros((*GRID.shape, 3))
    values[..., 0], values[..., 2] = 1.5, -2.0
    values[3:, :, :, 1] = 4.0
    field = DisplacementField(values, GRID)
    inside = tuple(GRID.index_to_point([4, 3, 4.5]).tolist())
    for suffix in (".nrrd", ".h5", ".nii.gz"):
        dn.write_transform(field, folder / f"ours{suffix}", GRID)
        if suffix == ".h5":
            theirs = sitk.ReadTransform(str(folder / f"ours{suffix}"))
        else:
            image = sitk.ReadImage(str(folder / f"ours{suffix}"), sitk.sitkVectorFloat64)
            sitk.WriteImage(image, str(folder / f"theirs{suffix}"))
            theirs = sitk.DisplacementFieldTransform(image)
        assert theirs.TransformPoint(inside) == pytest.approx(np.add(inside, (1.5, 4, -2)))
        if suffix == ".h5":
            sitk.WriteTransform(theirs, str(folder / f"theirs{suffix}"))
        back = dn.read_transform(folder / f"theirs{suffix}")
        assert back.displacement([inside])[0] == pytest.approx((1.5, 4, -2))


def _spline_transforms(folder: Path) -> None:
    sitk = _sitk()
    spline = sitk.BSplineTransformInitializer(dn.Volume(np.zeros(GRID.shape), GRID).to_sitk(), [4, 4, 4])
    parameters = np.random.default_rng(2).normal(size=len(spline.GetParameters()))
    spline.SetParameters(parameters.tolist())
    places = GRID.index_to_point(np.random.default_rng(3).uniform(1, 4, (9, 3)))
    known = np.array([spline.TransformPoint(place) for place in places.tolist()])
    for suffix in (".tfm", ".h5"):
        sitk.WriteTransform(spline, str(folder / f"theirs{suffix}"))
        read = dn.read_transform(folder / f"theirs{suffix}")
        assert np.allclose(places + read.displacement(places), known, atol=1e-9)
        dn.write_transform(read, folder / f"ours{suffix}", GRID)
        again = sitk.ReadTransform(str(folder / f"ours{suffix}"))
        assert np.allclose([again.TransformPoint(place) for place in places.tolist()], known, atol=1e-9)
    assert np.abs(known - places).max() > 0.5


def _thin_plate_splines(folder: Path) -> None:
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonTransforms import vtkThinPlateSplineTransform

    random = np.random.default_rng(4)
    source = random.uniform(0, 100, (8, 3))
    target = source + random.normal(0, 5, (8, 3))
    for name, places in (("moving", source), ("fixed", target)):
        dn.write_landmarks(dn.warping.Landmarks(places, tuple("abcdefgh")), folder / f"{name}.mrk.json")
    lists = [dn.read_landmarks(folder / f"{name}.mrk.json") for name in ("moving", "fixed")]
    points, left, other = dn.ControlPoints.from_landmarks(*lists)
    assert (left, other) == ((), ())
    ours = dn.Deformation.from_space_points(points, kernel="linear", trend="affine_exact")
    grid = dn.Grid((10, 10, 10), 10.0, unit="mm")
    # As Slicer makes it of the lists "from" fixed "to" moving: the transform from parent is that of resampling.
    theirs = vtkThinPlateSplineTransform()
    theirs.SetBasisToR()
    for places, put in ((target, theirs.SetSourceLandmarks), (source, theirs.SetTargetLandmarks)):
        stored = vtkPoints()
        stored.SetDataTypeToDouble()
        for place in places.tolist():
            stored.InsertNextPoint(place)
        put(stored)
    places = random.uniform(0, 90, (20, 3))
    known = np.array([theirs.TransformPoint(place) for place in places.tolist()])
    assert np.allclose(places + ours.field(grid).displacement(places), known, atol=1e-6)
    assert np.abs(known - places).max() > 1


ROWS: dict[str, Callable[[Path], None]] = {
    "volume": _volumes,
    "segmentation": _segmentations,
    "point list": _point_lists,
    "markups of any kind, moved with the tissue": _moved_markups,
    "linear transform": _linear_transforms,
    "grid transform": _grid_transforms,
    "B-spline transform": _spline_transforms,
    "thin-plate spline of two point lists": _thin_plate_splines,
}


@pytest.mark.parametrize("row", ROWS)
def test_a_row_of_the_table_is_true(row: str, tmp_path: Path) -> None:
    ROWS[row](tmp_path)


def test_the_table_of_the_page_has_these_rows_and_names_functions_that_exist() -> None:
    lines = re.findall(r"^\| (.+) \|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)[2:]
    cells = [line.split(" | ") for line in lines]
    assert [row[0] for row in cells] == list(ROWS)
    for name in re.findall(r"`dn\.([\w.]+)`", " ".join(lines)):
        found: Any = dn
        for part in name.split("."):
            found = getattr(found, part)
        assert callable(found), name


def test_a_written_file_of_markups_fits_the_schema_of_slicer(tmp_path: Path) -> None:
    """The schema is Slicer's own file, which its address names; a copy is looked for in the folder of real data."""
    jsonschema = pytest.importorskip("jsonschema")
    path = Path(os.environ.get("DEFORMNB_TEST_DATA", "")) / "markups-schema-v1.0.3.json"
    if not path.is_file():
        pytest.skip("Slicer's schema of markups is not in the folder that DEFORMNB_TEST_DATA names")
    schema = json.loads(path.read_text(encoding="utf-8"))
    dn.write_landmarks(dn.warping.Landmarks([[1, 2, 3]], ("nose",)), tmp_path / "a.mrk.json")
    dn.io.warp_markups(tmp_path / "a.mrk.json", tmp_path / "b.mrk.json", Affine(np.eye(3), np.ones(3)))
    for name in ("a", "b"):
        jsonschema.Draft7Validator(schema).validate(json.loads((tmp_path / f"{name}.mrk.json").read_text("utf-8")))
