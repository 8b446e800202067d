"""Sample data: procedural phantoms, downloads of real volumes, and D'Arcy Thompson's grids.

- :data:`PHANTOMS` work without a network.
- :data:`DATASETS`, :func:`fetch` and :func:`load` download real volumes of the paper once; :func:`find` takes
  the phantom where that fails.
- :func:`thompson_map` has the points that turn the fish into other fishes, and :func:`thompson_score` how near a
  deformation comes to them; :func:`thompson_plate` has his drawings.
"""

from deformnb.datasets.darcy import (
    ThompsonGrid,
    ThompsonMap,
    custom_grid,
    thompson_grid,
    thompson_grids,
    thompson_map,
    thompson_pairs,
)
from deformnb.datasets.grid_score import GridScore, thompson_score
from deformnb.datasets.phantoms import PHANTOMS, Phantom
from deformnb.datasets.plates import PLATE_SOURCE, thompson_plate
from deformnb.datasets.registry import DATASETS, Dataset, credits, fetch, find, load  # noqa: A004 (see there)

__all__ = [
    "DATASETS",
    "PHANTOMS",
    "PLATE_SOURCE",
    "Dataset",
    "GridScore",
    "Phantom",
    "ThompsonGrid",
    "ThompsonMap",
    "credits",
    "custom_grid",
    "fetch",
    "find",
    "load",
    "thompson_grid",
    "thompson_grids",
    "thompson_map",
    "thompson_pairs",
    "thompson_plate",
    "thompson_score",
]
