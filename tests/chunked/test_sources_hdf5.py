"""The one field of metadata of HDF5 files: used, refused or named."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deformnb import DeformError
from deformnb.chunked import open_volume

h5py = pytest.importorskip("h5py")


def write(path: Path, sizes: Any) -> Path:
    with h5py.File(path, "w") as file:
        file["scan"] = np.zeros((2, 3, 4), np.uint8)
        if sizes is not None:
            file["scan"].attrs["element_size_um"] = sizes
    return path


def test_sizes_are_used_or_their_absence_named(tmp_path: Path) -> None:
    found = open_volume(write(tmp_path / "a.h5", [3.0, 2.0, 1.0]))
    assert (found.grid.spacing, found.grid.unit, found.notes) == ((1, 2, 3), "\u00b5m", ())
    found = open_volume(write(tmp_path / "a.h5", None))
    assert found.grid.spacing == (1, 1, 1)
    assert "states no element_size_um" in found.notes[0]


@pytest.mark.parametrize(
    "sizes",
    [
        [0.0, 2, 1],
        [-3.0, 2, 1],
        [np.nan, 2, 1],
        [1e300, 2, 1],
        [3.0, 2],
        [3.0, 2, 1, 1],
        3.0,
        "3 2 1",
        [b"a", b"b", b"c"],
    ],
    ids=str,
)
def test_sizes_that_are_none_are_refused(sizes: Any, tmp_path: Path) -> None:
    with pytest.raises(DeformError, match=r"element_size_um|spacing"):
        open_volume(write(tmp_path / "a.h5", sizes))
