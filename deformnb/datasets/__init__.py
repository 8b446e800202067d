"""Sample data: procedural phantoms, downloads of real volumes, and D'Arcy Thompson's grids.

- :data:`PHANTOMS` and its functions (:func:`fish`, :func:`knee`, ...) work without a network.
- :data:`DATASETS`, :func:`fetch` and :func:`load` get real volumes of the paper once and keep them.
- :func:`thompson_points` turns the fish into other fishes.
"""

from deformnb.datasets.darcy import (
    ThompsonGrid,
    ThompsonMap,
    thompson_grid,
    thompson_grids,
    thompson_map,
    thompson_pairs,
    thompson_points,
)
from deformnb.datasets.phantoms import (
    PHANTOMS,
    Phantom,
    abdomen,
    abdomen_labels,
    bar,
    fish,
    head,
    horse,
    knee,
    knee_labels,
    lobster,
)
from deformnb.datasets.registry import DATASETS, Dataset, credits, fetch, load  # noqa: A004 (see there)

__all__ = [
    "DATASETS",
    "PHANTOMS",
    "Dataset",
    "Phantom",
    "ThompsonGrid",
    "ThompsonMap",
    "abdomen",
    "abdomen_labels",
    "bar",
    "credits",
    "fetch",
    "fish",
    "head",
    "horse",
    "knee",
    "knee_labels",
    "load",
    "lobster",
    "thompson_grid",
    "thompson_grids",
    "thompson_map",
    "thompson_pairs",
    "thompson_points",
]
