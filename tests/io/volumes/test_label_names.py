"""Names of labels: from the tables that other programs write next to their label volumes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from deformnb.errors import DeformError
from deformnb.io import read_volume
from deformnb.io.volumes.label_names import read_label_names, write_segmentation

_ITK_SNAP = """# IDX   -R-  -G-  -B-  -A--  VIS MSH  LABEL
    0     0    0    0        0  0  0    "background"
   95   255    0    0        1  1  1    "femur, left"
   96     0  255    0      0.5  1  1    "tibia"
"""
TABLES = {
    "columns": ("bones.csv", 'Label,Name,Voxels\n0,background,9\n3,?,1\n95,"femur, left",12\n96,tibia,7\n97,\n'),
    "semicolons": ("bones.csv", "Structure;Value\nfemur, left;95\ntibia;96\nbackground;0\nnone;x\n"),
    "tabs": ("bones.tsv", "index\tname\n0\tbackground\n95\tfemur, left\n96\ttibia\n"),
    "itk-snap": ("bones.label", _ITK_SNAP),
    "colours": ("bones.ctbl", "# Color table\n0 background 0 0 0 0\n95 femur,_left 255 0 0 255\n96 tibia 0 9 0 255\n"),
}


@pytest.mark.parametrize("kind", TABLES)
def test_the_table_beside_a_label_volume_is_read(kind: str, tmp_path: Path) -> None:
    name, text = TABLES[kind]
    (tmp_path / name).write_text(text, encoding="utf-8")
    left = "femur,_left" if kind == "colours" else "femur, left"
    assert read_label_names(tmp_path / "bones.seg.nii.gz") == {0: "background", 95: left, 96: "tibia"}
    assert read_label_names(tmp_path / "muscles.nii.gz") == {}


def test_a_table_of_something_else_gives_no_names(tmp_path: Path) -> None:
    (tmp_path / "bones.csv").write_text("x,y,z\n1,2,3\n", encoding="utf-8")
    (tmp_path / "bones.txt").write_bytes(b"\xff\xfe1 and more\n")
    assert read_label_names(tmp_path / "bones.nii") == {}


SEGMENTS = {
    "Segment0_ID": "liver",
    "Segment0_Name": "Liver, left: lobe",
    "Segment0_LabelValue": "3",
    "Segment0_Layer": "0",
    "Segment0_Color": "0.8 0.4 0.3",
    "Segment0_Extent": "0 9 0 9 0 9",
    "Segment1_ID": "lost",
    "Segment1_Name": "lost",
    "Segment1_LabelValue": "7",
    "Segment1_Layer": "0",
    "Segmentation_MasterRepresentation": "Binary labelmap",
}


def test_a_segmentation_is_written_back_with_its_names(tmp_path: Path) -> None:
    nrrd = pytest.importorskip("nrrd")
    values = np.zeros((4, 5, 6), np.uint8)  # [x, y, z]
    values[1:3, 2:5, 4] = 3
    source = tmp_path / "a.seg.nrrd"
    nrrd.write(
        str(source),
        values,
        {
            "space": "left-posterior-superior",
            "space directions": np.eye(3),
            "space origin": [0, 0, 0],
            "kinds": ["domain"] * 3,
            **SEGMENTS,
        },
    )
    labels = read_volume(source)
    assert labels.is_labels  # so that none are interpolated
    assert not labels.notes
    write_segmentation(labels, tmp_path / "b.seg.nrrd", source)
    back, header = nrrd.read(str(tmp_path / "b.seg.nrrd"))
    assert np.array_equal(back, values)
    expected = SEGMENTS | {"Segment0_Extent": "1 2 2 4 4 4", "Segment1_Extent": "0 -1 0 -1 0 -1"}
    assert {key: header[key] for key in expected} == expected
    assert read_label_names(tmp_path / "b.seg.nrrd") == {3: "Liver, left: lobe", 7: "lost"}
    with pytest.raises(DeformError, match="no segmentation"):
        write_segmentation(labels, tmp_path / "c.seg.nrrd", tmp_path / "c.seg.nrrd")
    with pytest.raises(DeformError, match=r"\.nrrd files only"):
        write_segmentation(labels, tmp_path / "c.nii", source)
