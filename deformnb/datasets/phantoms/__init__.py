"""Procedural phantoms of the seven objects of the paper: CT-like volumes without a download.

>>> from deformnb.datasets import PHANTOMS
>>> sorted(PHANTOMS)
['abdomen', 'bar', 'fish', 'head', 'horse', 'knee', 'lobster']
>>> PHANTOMS["bar"].make((12, 8, 16)).shape
(12, 8, 16)

Each is a list of solids painted one over the other (:mod:`~deformnb.datasets.phantoms.scene`), so the same anatomy
appears at any resolution, always at the same place in space: control points fit every shape of a phantom. Grey
values run from 0 (air, exactly) over 60 to 70 (fat), about 100 (soft tissue) to 255 (densest). Edges are one voxel
wide; noise and texture come from fixed seeds. To change an object, edit its module; to add one, write ``scene()`` and a
row here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from deformnb._typing import Progress
from deformnb.datasets.phantoms.abdomen import LABELS as ABDOMEN_LABELS
from deformnb.datasets.phantoms.abdomen import abdomen, abdomen_labels
from deformnb.datasets.phantoms.bar import bar
from deformnb.datasets.phantoms.fish import fish
from deformnb.datasets.phantoms.head import head
from deformnb.datasets.phantoms.horse import horse
from deformnb.datasets.phantoms.knee import LABELS as KNEE_LABELS
from deformnb.datasets.phantoms.knee import knee, knee_labels
from deformnb.datasets.phantoms.lobster import lobster
from deformnb.datasets.phantoms.scene import Part, PhantomScene, render, render_labels
from deformnb.volume.volume import Volume

__all__ = ["PHANTOMS", "Part", "Phantom", "PhantomScene", "abdomen", "abdomen_labels", "bar", "fish", "head", "horse",
           "knee", "knee_labels", "lobster", "render", "render_labels"]

Shape3 = tuple[int, int, int]


class MakePhantom(Protocol):
    """The signature all phantoms share."""

    def __call__(self, shape: Shape3 | None = None, *, dtype: str = "uint8", noise: float = 3.0,
                 progress: Progress | None = None) -> Volume: ...


class MakeLabels(Protocol):
    """The signature of the label volume of a phantom."""

    def __call__(self, shape: Shape3 | None = None, *, progress: Progress | None = None) -> Volume: ...


@dataclass(frozen=True)
class Phantom:
    """A row of :data:`PHANTOMS`.

    Parameters
    ----------
    make : ``make(shape=None, *, dtype="uint8", noise=3.0, progress=None)`` returns the volume.
    title : for a menu.
    figure : the figures of the paper it stands in for.
    view : the picture plane that shows it best, one of :data:`deformnb.volume.plane.VIEWS`.
    projection : what makes that picture readable, "mip" or "slice".
    axes : what the x, y and z axes mean.
    labels : function of the label volume on the same grid, if there is one.
    label_names : number to name of those labels.
    """

    make: MakePhantom
    title: str
    figure: str
    view: str
    projection: str
    axes: str
    labels: MakeLabels | None = None
    label_names: dict[int, str] | None = None


PHANTOMS: dict[str, Phantom] = {
    "bar": Phantom(bar, "Checked bar", "1, 2", "+y", "mip", "x along the bar, y and z across"),
    "fish": Phantom(fish, "Carp", "3", "-x", "mip", "voxel x across, y tail to head (-y in space), z belly to back"),
    "knee": Phantom(knee, "Right knee, straight", "4", "-x", "mip",
                    "x outer to inner side, y front to back, z up the leg",
                    knee_labels, {1: "other tissue", **KNEE_LABELS}),
    "lobster": Phantom(lobster, "Lobster", "5", "-z", "mip", "x right to left, y head to tail, z belly to back"),
    "head": Phantom(head, "Human head", "6 a, b", "+x", "mip", "x right to left, y face to occiput, z up"),
    "horse": Phantom(horse, "Horse", "6 c, d", "+x", "mip", "x right to left, y tail to head, z up"),
    "abdomen": Phantom(abdomen, "Human abdomen", "7", "+y", "slice", "x right to left, y front to back, z up",
                       abdomen_labels, {1: "other tissue", **ABDOMEN_LABELS}),
}
"""The paper's objects by name. The fish seen along "-x" has its head to the left, like the
fishes of Thompson's plates, seen along "+x" to the right."""
