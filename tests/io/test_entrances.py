"""Every public function of deformnb.io, given things of every other kind: it works, or a sentence states its need.

A second test puts an error into the reader of each format that no reader foresees, which must end in a sentence too.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deformnb as dn
from deformnb import io
from deformnb.errors import DeformError, VolumeFileError
from deformnb.io.files.errors import UNFORESEEN
from deformnb.io.transforms import formats as transforms
from deformnb.io.volumes import formats
from deformnb.rbf.fields import Identity
from deformnb.volume import Channels
from deformnb.warping.mesh import Mesh
from deformnb.warping.points import Landmarks

GRID = dn.Grid((3, 4, 5))
VOLUME = dn.Volume(np.arange(60, dtype=np.uint8).reshape(3, 4, 5), GRID)
LABELS = dn.Volume(np.arange(8, dtype=np.uint8).reshape(2, 2, 2) % 3, dn.Grid((2, 2, 2)), is_labels=True)
CHANNELS = Channels.from_array(np.zeros((2, 3, 4, 2), np.uint8))
POINTS = dn.ControlPoints.from_arrays([[1.0, 2, 3]], [[1.0, 2, 4]])
SEGMENTATION = (
    "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: raw\n"
    + "".join(
        f"Segment0_{key}:={value}\n"
        for key, value in (("ID", "a"), ("Name", "bone"), ("LabelValue", 1), ("Layer", 0), ("Extent", "0 1 0 1 0 1"))
    )
    + "\n"
).encode() + bytes([0, 1] * 4)

# Arguments with which each function works, by position; names of files are of the folder of the test.
CALLS: dict[str, tuple[Any, ...]] = {
    "atomic_write": ("x.bin",),
    "available_memory": (),
    "describe_file": ("a.nrrd",),
    "describe_transform": ("t.nrrd",),
    "is_series": ("a.nrrd",),
    "open_series": ("c.nrrd",),
    "points_from_csv": ("source_x,source_y,source_z\n1,2,3\n", POINTS),
    "read_channels": ("c.nrrd",),
    "read_deformation": ("d.json",),
    "read_label_names": ("n.csv",),
    "read_landmarks": ("l.mrk.json",),
    "read_mesh": ("m.ply",),
    "read_transform": ("t.nrrd", GRID),
    "read_volume": ("a.nrrd",),
    "to_vtk_transform": (Identity(3), GRID),
    "warp_markups": ("l.mrk.json", "m.mrk.json", Identity(3)),
    "write_channels": (CHANNELS, "c.nrrd"),
    "write_deformation": (dn.Deformation.from_space_points(POINTS), "d.json"),
    "write_landmarks": (Landmarks(np.zeros((2, 3))), "l.mrk.json"),
    "write_mesh": (Mesh(np.eye(3), np.array([[0, 1, 2]])), "m.ply"),
    "write_segmentation": (LABELS, "b.seg.nrrd", "a.seg.nrrd"),
    "write_series": ([CHANNELS], "s.nrrd", 1),
    "write_transform": (Identity(3), "t.nrrd", GRID),
    "write_volume": (VOLUME, "a.nrrd"),
}

OTHERS: list[Any] = [
    "v",
    "",
    "\0",
    "x" * 5000,
    b"",
    None,
    3,
    -1,
    1.5,
    float("nan"),
    True,
    [],
    [1, 2],
    {},
    object(),
    np.zeros(3),
    np.zeros((2, 2, 2)),
    Path(),
    len,
    VOLUME,
    CHANNELS,
    POINTS,
    10**5000,
]


def functions() -> list[str]:
    return sorted(
        name for name in dir(io) if callable(getattr(io, name)) and not name[0].isupper() and not name.startswith("_")
    )


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "n.csv").write_text("label,name\n1,femur\n", encoding="utf-8")
    (tmp_path / "a.seg.nrrd").write_bytes(SEGMENTATION)
    for name in (name for name in functions() if name.startswith("write_")):
        getattr(io, name)(*CALLS[name])
    return tmp_path


def test_every_function_has_a_call() -> None:
    assert set(CALLS) == set(functions())


@pytest.mark.parametrize("name", [name for name in CALLS if CALLS[name]])
def test_things_of_another_kind_are_refused_in_a_sentence(name: str, folder: Path) -> None:
    function: Callable[..., Any] = getattr(io, name)
    for position in range(len(CALLS[name])):
        for other in OTHERS:
            arguments = list(CALLS[name])
            arguments[position] = other
            try:
                done = function(*arguments)
                if name == "atomic_write":
                    with done:
                        pass
            except DeformError as error:
                said = str(error)
            else:
                said = ""
            assert UNFORESEEN not in said
            assert len(said) < 2000


@pytest.mark.parametrize(
    "error",
    [
        KeyError("x"),
        TypeError("x"),
        RuntimeError("x"),
        IndexError("x"),
        AttributeError("x"),
        ZeroDivisionError("x"),
        RecursionError(),
        MemoryError(),
        OSError(5, "x"),
    ],
    ids=lambda error: type(error).__name__,
)
@pytest.mark.parametrize("row", [*formats.FORMATS, *transforms.TRANSFORM_FORMATS])
def test_what_no_reader_foresees_is_a_sentence_too(
    row: str, error: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_args: Any) -> Any:
        raise error

    table, read = (
        (formats.FORMATS, io.read_volume)
        if row in formats.FORMATS
        else (transforms.TRANSFORM_FORMATS, io.read_transform)
    )
    entry: Any = table[row]
    monkeypatch.setitem(
        table,
        row,
        entry.__class__(
            **{  # type: ignore[arg-type]
                key: fails if key in ("header", "read") else value for key, value in vars(entry).items()
            }
        ),
    )
    path = tmp_path / f"a{entry.suffixes[0]}"
    if getattr(entry, "is_folder", False) or entry.suffixes[0] == ".zarr":
        path.mkdir()
        (path / "zarr.json").write_text("{}", encoding="utf-8")
    else:
        path.write_bytes(b"x")
    with pytest.raises(VolumeFileError, match=r"^a\."):
        read(path)
