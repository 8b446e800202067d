"""Sample data: each phantom and each plate by its own command."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import deformnb as dn
from deformnb.datasets import PHANTOMS, thompson_grids
from napari_deformnb import samples

MANIFEST = Path(samples.__file__).with_name("napari.yaml")
PLATES = [grid.species.partition(" ")[0].lower() for grid in thompson_grids().values()]


def test_the_manifest_has_all_of_them() -> None:
    rows = yaml.safe_load(MANIFEST.read_text(encoding="utf-8"))["contributions"]["sample_data"]
    assert [row["key"] for row in rows] == [*PHANTOMS, *PLATES]


def test_a_sample_is_opened_by_napari(viewer: Any) -> None:
    pytest.importorskip("npe2")
    [layer] = viewer.open_sample("napari-deformnb", "polyprion")
    assert layer.name == "Polyprion (Thompson 1917)"
    assert layer.data.shape == dn.datasets.thompson_plate("Polyprion").values.shape


@pytest.mark.parametrize("name", PLATES)
def test_a_plate_is_at_the_place_of_its_grid(name: str) -> None:
    [(data, attributes, kind)] = getattr(samples, name)()
    plate = dn.datasets.thompson_plate(name)
    assert kind == "image"
    assert np.array_equal(data, plate.values)
    assert attributes["translate"] == plate.raster.origin[::-1]


@pytest.mark.nightly
def test_a_phantom_comes_with_its_labels(viewer: Any) -> None:
    pytest.importorskip("npe2")
    viewer.open_sample("napari-deformnb", "abdomen")
    image, labels = viewer.layers
    assert image.data.shape == labels.data.shape == PHANTOMS["abdomen"].scene().shape
    assert np.allclose(image.data_to_world((1, 1, 1)), labels.data_to_world((1, 1, 1)))
    assert not labels.visible
    assert str(image.units[0]) == "millimeter"


@pytest.mark.nightly
@pytest.mark.parametrize("name", PHANTOMS)
def test_a_phantom_is_a_volume(name: str) -> None:
    (data, _, kind), *_ = getattr(samples, name)()
    assert kind == "image"
    assert data.max() > 200
