"""Files through napari's own dialogs: readers and writers are found, and places stay."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dicom_series import write_series

import deformnb as dn
from napari_deformnb.files import WRITTEN, get_reader, open_dicom_folder, read_slices


def _need_plugin() -> None:
    npe2 = pytest.importorskip("npe2")
    if "napari-deformnb" not in npe2.PluginManager.instance():
        pytest.skip("the plugin is not installed: pip install ./napari-deformnb")


@pytest.mark.parametrize("suffix", WRITTEN)
@pytest.mark.parametrize("kind", ["image", "labels"])
def test_a_volume_goes_through_a_file(
    viewer: Any, add_volume: Any, ball: dn.Volume, tmp_path: Path, suffix: str, kind: str
) -> None:
    _need_plugin()
    given = ball.mark_labels(kind == "labels")
    path = tmp_path / f"ball{suffix}"
    assert add_volume(given).save(str(path)) == [str(path)]
    [layer] = viewer.open(str(path), plugin="napari-deformnb")
    assert np.array_equal(layer.data, ball.values)
    assert np.allclose(layer.data_to_world((1, 2, 3)), ball.grid.index_to_point([3, 2, 1])[::-1], atol=1e-5)
    assert str(layer.units[0]) == "millimeter"
    found = dn.read_volume(path)
    assert found.grid.is_like(ball.grid)
    if suffix == ".nrrd":
        assert type(layer).__name__.lower() == kind


@pytest.mark.parametrize("suffix", [".mrk.json", ".fcsv"])
def test_landmarks_are_points(viewer: Any, tmp_path: Path, suffix: str) -> None:
    _need_plugin()
    dn.write_landmarks(dn.warping.Landmarks([[1, 2, 3], [4, 5, 6]], ("nose", "tail")), tmp_path / f"a{suffix}")
    [layer] = viewer.open(str(tmp_path / f"a{suffix}"), plugin="napari-deformnb")
    assert layer.data.tolist() == [[3, 2, 1], [6, 5, 4]]
    assert layer.features["name"].tolist() == ["nose", "tail"]
    layer.save(str(tmp_path / f"b{suffix}"))
    again = dn.read_landmarks(tmp_path / f"b{suffix}")
    assert again.points.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert again.names == ("nose", "tail")


def test_formats_of_napari_are_left_to_it() -> None:
    for name in ("a.tif", "a.tiff", "a.png", "a.npy", "a.csv", "a.zarr", "a.json", "folder"):
        assert get_reader(name) is None
    assert get_reader(["a.nii", "b.nii"]) is None
    assert get_reader(["one/a.dcm", "two/b.dcm"]) is None


@pytest.mark.filterwarnings("ignore:Non-orthogonal slicing")  # of napari, on an oblique series
def test_a_series_of_dicom_is_a_volume(viewer: Any, tmp_path: Path, messages: list[str]) -> None:
    folder = tmp_path / "series"
    folder.mkdir()
    write_series(folder)
    files = sorted(str(path) for path in folder.iterdir())
    reader = get_reader(files)
    assert reader is read_slices
    [(data, _, _)] = reader(files)
    expected = dn.read_volume(folder)
    assert np.array_equal(data, expected.values)
    open_dicom_folder(viewer, folder)
    [layer] = viewer.layers
    assert layer.data.shape == (6, 5, 7)
    assert np.allclose(layer.data_to_world((1, 2, 3)), expected.grid.index_to_point([3, 2, 1])[::-1])
    (tmp_path / "empty").mkdir()
    open_dicom_folder(viewer, tmp_path / "empty")
    assert "neither a DICOM series" in messages[-1]
