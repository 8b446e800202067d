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

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from deformnb._typing import Progress
from deformnb.datasets.phantoms import abdomen, bar, fish, head, horse, knee, lobster
from deformnb.datasets.phantoms.scene import Part, PhantomScene, render, render_labels
from deformnb.errors import DeformError
from deformnb.volume.views import ViewName
from deformnb.volume.volume import Volume

if TYPE_CHECKING:
    from deformnb.imaging.projection import ProjectionName

__all__ = ["PHANTOMS", "Part", "Phantom", "PhantomScene", "render", "render_labels"]

Shape3 = tuple[int, int, int]


@dataclass(frozen=True)
class Phantom:
    """A row of :data:`PHANTOMS`.

    Parameters
    ----------
    scene : function of the scene.
    title : for a menu.
    figure : the figures of the paper that it replaces.
    view : the picture plane that shows it best, one of :data:`deformnb.volume.views.VIEWS`.
    projection : suitable for that picture, "mip" or "slice".
    axes : meaning of the x, y and z axes.

    Examples
    --------
    >>> knee = PHANTOMS["knee"]
    >>> knee.make((20, 12, 8)).name, knee.labels((20, 12, 8)).is_labels
    ('knee (phantom)', True)
    """

    scene: Callable[[], PhantomScene]
    title: str
    figure: str
    view: ViewName
    projection: ProjectionName
    axes: str

    def make(
        self,
        shape: Shape3 | None = None,
        *,
        dtype: str = "uint8",
        noise: float | None = None,
        progress: Progress | None = None,
    ) -> Volume:
        """The volume; see :func:`render`."""
        return render(self.scene(), shape, dtype=dtype, noise=noise, progress=progress)

    @property
    def label_names(self) -> dict[int, str]:
        """Number to name of the labels; empty if there are none."""
        return self.scene().label_names

    def labels(self, shape: Shape3 | None = None, *, progress: Progress | None = None) -> Volume:
        """The label volume on the grid of :meth:`make`; 1 is other tissue.

        Raises
        ------
        DeformError
            If it has no labels.
        """
        if not self.label_names:
            raise DeformError(f"the phantom {self.title!r} has no labels.")
        return render_labels(self.scene(), shape, progress=progress)


PHANTOMS: dict[str, Phantom] = {
    "bar": Phantom(bar.scene, "Checked bar", "1, 2", "+y", "mip", "x along the bar, y and z across"),
    "fish": Phantom(
        fish.scene, "Carp", "3", "-x", "mip", "voxel x across, y tail to head (-y in space), z belly to back"
    ),
    "knee": Phantom(
        knee.scene, "Right knee, straight", "4", "-x", "mip", "x outer to inner side, y front to back, z up the leg"
    ),
    "lobster": Phantom(lobster.scene, "Lobster", "5", "-z", "mip", "x right to left, y head to tail, z belly to back"),
    "head": Phantom(head.scene, "Human head", "6 a, b", "+x", "mip", "x right to left, y face to occiput, z up"),
    "horse": Phantom(horse.scene, "Horse", "6 c, d", "+x", "mip", "x right to left, y tail to head, z up"),
    "abdomen": Phantom(abdomen.scene, "Human abdomen", "7", "+y", "slice", "x right to left, y front to back, z up"),
}
"""The paper's objects by name. The fish seen along "-x" has its head to the left, like the
fishes of Thompson's plates, seen along "+x" to the right."""
