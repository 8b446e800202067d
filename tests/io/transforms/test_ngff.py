"""Transforms of OME-NGFF, read by zarr and NumPy alone, and refused where damaged; ngff-zarr: test_peers.py."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from format_table import bound
from scipy.ndimage import map_coordinates

import deformnb as dn
from deformnb.errors import VolumeFileError
from deformnb.io.transforms.formats import read_transform, write_transform
from deformnb.rbf.fields import Affine, DisplacementField, Identity
from deformnb.volume.volume import Grid

RANDOM = np.random.default_rng(3)
PLAIN = Grid((5, 6, 7), (1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
TURNED = Grid((5, 6, 7), (1.0, 2.0, 3.0), (4.0, 5.0, 6.0), ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
AFFINE = Affine(np.eye(3) + RANDOM.uniform(-0.1, 0.1, (3, 3)), RANDOM.normal(size=3))
FIELD = DisplacementField(RANDOM.normal(size=(*PLAIN.shape, 3)), PLAIN)


def _map_literally(path: Path, points: np.ndarray) -> np.ndarray:
    """The points mapped by the one transformation of a scene, with nothing but the metadata and the arrays."""
    root = zarr.open_group(str(path), mode="r")
    ome: Any = root.attrs["ome"]
    assert ome["version"] == "0.6"
    [scene] = ome["scene"]["coordinateTransformations"]
    assert (scene["input"], scene["output"], scene["name"]) == ({"name": "LPS"}, {"name": "LPS"}, "backward")
    at = points[:, ::-1]  # z, y, x
    for one in scene.get("transformations", [scene]):
        if one["type"] == "affine":
            matrix = np.array(one["affine"])
            at = at @ matrix[:, :3].T + matrix[:, 3]
        else:
            group, name = one["path"].rsplit("/", 1)
            image: Any = root[group].attrs["ome"]
            [level] = image["multiscales"][0]["datasets"]
            scale, first = (step[step["type"]] for step in level["coordinateTransformations"][0]["transformations"])
            index = ((at - first[1:]) / scale[1:]).T
            values = np.asarray(root[group][name])  # type: ignore[index]
            at = at + np.stack([map_coordinates(part, index, order=1, mode="nearest") for part in values], axis=1)
    return at[:, ::-1]


@pytest.mark.parametrize("grid", [PLAIN, TURNED], ids=["plain", "turned"])
def test_zarr_and_numpy_read_the_same_map(grid: Grid, tmp_path: Path) -> None:
    values = RANDOM.normal(size=(*grid.shape, 3))
    points = grid.index_to_point(RANDOM.uniform(0, 4, (40, 3)))
    for field in (DisplacementField(values, grid), dn.rbf.compose(DisplacementField(values, grid), AFFINE), AFFINE):
        write_transform(field, tmp_path / "a.zarr", grid, overwrite=True)
        limit = bound("transforms", "ngff", "zarr and NumPy directly")
        again = read_transform(tmp_path / "a.zarr")
        assert np.abs(_map_literally(tmp_path / "a.zarr", points) - points - again.displacement(points)).max() < limit
        assert np.abs(again.displacement(points) - field.displacement(points)).max() < limit
        assert [type(step) for step in again.steps] == [type(step) for step in field.steps]
    assert "backward" in (tmp_path / "a.zarr" / "zarr.json").read_text(encoding="utf-8")
    assert [file.name for file in tmp_path.iterdir()] == ["a.zarr"]
    with pytest.raises(VolumeFileError, match="exists already"):
        write_transform(AFFINE, tmp_path / "a.zarr", grid, overwrite=False)
    (tmp_path / "b.zarr").mkdir()
    with pytest.raises(VolumeFileError, match="folder of something else"):
        write_transform(AFFINE, tmp_path / "b.zarr", grid, overwrite=True)


@pytest.mark.parametrize(
    ("given", "matrix", "offset"),
    [
        ({"type": "identity"}, np.eye(3), [0, 0, 0]),
        ({"type": "translation", "translation": [3, 2, 1]}, np.eye(3), [1, 2, 3]),
        ({"type": "scale", "scale": [4, 3, 2]}, np.diag([2, 3, 4]), [0, 0, 0]),
        (
            {"type": "rotation", "rotation": [[1, 0, 0], [0, 0, 1], [0, -1, 0]]},
            [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
            [0, 0, 0],
        ),
        (
            {"type": "bijection", "forward": {"type": "scale", "scale": [1, 1, 5]}, "inverse": {"type": "identity"}},
            np.diag([5, 1, 1]),
            [0, 0, 0],
        ),
        (
            {
                "type": "sequence",
                "transformations": [
                    {"type": "scale", "scale": [1, 1, 5]},
                    {"type": "translation", "translation": [0, 0, 1]},
                ],
            },
            np.diag([5, 1, 1]),
            [1, 0, 0],
        ),
    ],
)
def test_linear_transformations(given: dict[str, Any], matrix: Any, offset: Any, tmp_path: Path) -> None:
    _scene(
        tmp_path / "a.zarr",
        lambda scene: scene["coordinateTransformations"].__setitem__(
            0, {"input": {"name": "LPS"}, "output": {"name": "LPS"}, **given}
        ),
    )
    points = RANDOM.normal(size=(5, 3))
    found = points + read_transform(tmp_path / "a.zarr").displacement(points)
    assert np.abs(found - (points @ np.transpose(matrix) + offset)).max() < 1e-12


def _scene(path: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    """A file with a field, whose metadata are changed."""
    write_transform(FIELD, path, PLAIN)
    data = json.loads((path / "zarr.json").read_text(encoding="utf-8"))
    change(data["attributes"]["ome"]["scene"])
    (path / "zarr.json").write_text(json.dumps(data), encoding="utf-8")


def test_coordinates_are_displacements_from_their_nodes(tmp_path: Path) -> None:
    nodes = PLAIN.index_to_point(np.moveaxis(np.indices(PLAIN.shape)[::-1], 0, -1))
    write_transform(DisplacementField(FIELD.values + nodes, PLAIN), tmp_path / "a.zarr", PLAIN)
    file = tmp_path / "a.zarr" / "zarr.json"
    file.write_text(file.read_text(encoding="utf-8").replace('"displacements"', '"coordinates"'), encoding="utf-8")
    found = read_transform(tmp_path / "a.zarr")
    assert isinstance(found, DisplacementField)
    assert np.abs(np.asarray(found.values) - FIELD.values).max() < 1e-5


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda scene: scene["coordinateTransformations"].append({"type": "identity", "name": "b"}),
            "hold 2: backward, b",
        ),
        (lambda scene: scene["coordinateTransformations"].clear(), "hold 0"),
        (lambda scene: scene["coordinateTransformations"][0].update(type="byDimension"), "byDimension is not read"),
        (lambda scene: scene["coordinateTransformations"][0].update(path="../../x/0"), "leads out"),
        (lambda scene: scene["coordinateTransformations"][0].update(path="x/0"), "no image lists"),
        (lambda scene: scene["coordinateTransformations"][0].update(interpolation="cubic"), "only linear"),
        (lambda scene: scene["coordinateSystems"][0]["axes"][0].update(name="t"), "three axes"),
        (
            lambda scene: scene["coordinateSystems"][0]["axes"][0].update(
                orientation={"value": "superior-to-inferior"}
            ),
            "LPS",
        ),
        (lambda scene: scene["coordinateTransformations"][0].update(type="scale", scale=[1, "x", 1]), "finite numbers"),
    ],
)
def test_what_is_not_read_is_named(change: Callable[[dict[str, Any]], Any], words: str, tmp_path: Path) -> None:
    _scene(tmp_path / "a.zarr", change)
    with pytest.raises(VolumeFileError, match=words):
        read_transform(tmp_path / "a.zarr")


def test_an_array_that_no_memory_holds_is_refused_by_its_metadata(tmp_path: Path) -> None:
    write_transform(FIELD, tmp_path / "a.zarr", PLAIN)
    file = next((tmp_path / "a.zarr").glob("coordinateTransformations/*/0/zarr.json"))
    data = json.loads(file.read_text(encoding="utf-8"))
    for key, value, words in (
        ("shape", [3, 10**6, 10**6, 10**6], "memory"),
        ("shape", [2, 5, 6, 7], "three components"),
        ("data_type", "int7", "no Zarr array"),
    ):
        file.write_text(json.dumps({**data, key: value}), encoding="utf-8")
        with pytest.raises(VolumeFileError, match=words):
            read_transform(tmp_path / "a.zarr")
    data["chunk_grid"]["configuration"]["chunk_shape"] = [3, 10**6, 10**6, 10**6]
    file.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(VolumeFileError, match="memory"):
        read_transform(tmp_path / "a.zarr")


def test_nothing_is_an_identity(tmp_path: Path) -> None:
    write_transform(Identity(3), tmp_path / "a.zarr", PLAIN)
    assert isinstance(read_transform(tmp_path / "a.zarr"), Identity)
