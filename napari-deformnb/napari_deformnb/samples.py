"""Sample data: the phantoms of the paper's objects, their labels, and the drawings of D'Arcy Thompson."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from deformnb.datasets import PHANTOMS, thompson_plate
from deformnb.interop import to_napari
from deformnb.volume.layers import LayerData


def phantom(name: str) -> list[LayerData]:
    """The layers of a phantom: an image, and labels where it has some, which are hidden at first.

    Parameters
    ----------
    name : of :data:`deformnb.datasets.PHANTOMS`.
    """
    row = PHANTOMS[name]
    layers = to_napari(row.make())
    if row.label_names:
        [(data, attributes, kind)] = to_napari(row.labels())
        layers.append((data, {**attributes, "visible": False}, kind))
    return layers


def plate(species: str) -> list[LayerData]:
    """The layer of a drawing by Thompson, with one pixel of the scan as unit.

    Parameters
    ----------
    species : as of :func:`deformnb.datasets.thompson_plate`.
    """
    picture = thompson_plate(species)
    attributes: dict[str, Any] = {
        "name": f"{species} (Thompson 1917)",
        "translate": picture.raster.origin[::-1],
        "axis_labels": ("y", "x"),
    }
    return [(np.asarray(picture.values), attributes, "image")]


# Functions by the names that the manifest has: a sample is a command without arguments.
bar = partial(phantom, "bar")
fish = partial(phantom, "fish")
knee = partial(phantom, "knee")
lobster = partial(phantom, "lobster")
head = partial(phantom, "head")
horse = partial(phantom, "horse")
abdomen = partial(phantom, "abdomen")
argyropelecus = partial(plate, "Argyropelecus")
sternoptyx = partial(plate, "Sternoptyx")
polyprion = partial(plate, "Polyprion")
pseudopriacanthus = partial(plate, "Pseudopriacanthus")
scorpaena = partial(plate, "Scorpaena")
antigonia = partial(plate, "Antigonia")
diodon = partial(plate, "Diodon")
orthagoriscus = partial(plate, "Orthagoriscus")
