"""Names of labels: from the tables that other programs write beside their label volumes."""

from __future__ import annotations

from pathlib import Path

import pytest

from deformnb.io.label_names import read_label_names

_ITK_SNAP = """# IDX   -R-  -G-  -B-  -A--  VIS MSH  LABEL
    0     0    0    0        0  0  0    "background"
   95   255    0    0        1  1  1    "femur, left"
   96     0  255    0      0.5  1  1    "tibia"
"""
TABLES = {
    "columns": ("bones.csv", "Label,Name,Voxels\n0,background,9\n3,?,1\n95,\"femur, left\",12\n96,tibia,7\n97,\n"),
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
    (tmp_path / "bones.csv").write_text("x,y,z\n1,2,3\n")
    (tmp_path / "bones.txt").write_bytes(b"\xff\xfe1 and more\n")
    assert read_label_names(tmp_path / "bones.nii") == {}
