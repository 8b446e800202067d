"""What all views of a volume have in common, so that one can take another's place."""

from __future__ import annotations

from abc import ABC, ABCMeta, abstractmethod
from typing import Any

import numpy as np
import traitlets
from numpy.typing import ArrayLike, NDArray

from deformnb.deformation import Deformation
from deformnb.fields import AbstractField
from deformnb.transfer import TransferFunction
from deformnb.volume import Grid, Volume

Image = NDArray[np.uint8]


class ViewMeta(ABCMeta, traitlets.MetaHasTraits):
    """For views that are widgets: ABC and HasTraits have a metaclass each, and Python wants one."""


class AbstractView(ABC):
    """A window on one volume and its deformation.

    A view keeps the volume it was shown; edits send displacements only. All lengths are physical, all directions in
    space (LPS). A view never changes what it is given.
    """

    @abstractmethod
    def show(self, volume: Volume) -> None:
        """Show another volume, without deformation, from the same side."""

    @abstractmethod
    def show_deformation(self, deformation: Deformation | AbstractField | None, *, output: Grid | None = None) -> None:
        """Deform what is shown.

        Parameters
        ----------
        deformation : a document, a backward field in space, or None for the volume as it is.
        output : its box is what can be seen (the field of view); default is the volume's own.
        """

    @abstractmethod
    def set_transfer(self, transfer: TransferFunction | str) -> None:
        """Show with other colours and opacities: a transfer function, or the name of a preset."""

    @abstractmethod
    def set_camera(self, direction: ArrayLike | None = None, up: ArrayLike | None = None,
                   zoom: float | None = None) -> None:
        """Look from another side.

        Parameters
        ----------
        direction : where the viewer looks, any length; None keeps it.
        up : what points up; default is +z, or -y for a view along z.
        zoom : 1 shows the whole box, 2 half of it; None keeps it.
        """

    @abstractmethod
    async def screenshot(self, timeout: float = 10.0) -> Image:
        """The picture that is on the screen now, (height, width, 3); without a screen the one of :meth:`still`."""

    @abstractmethod
    def still(self, size: tuple[int, int] | None = None) -> Image:
        """The same picture rendered by the core, at once and without a screen, (height, width, 3)."""

    @abstractmethod
    def stats(self) -> dict[str, Any]:
        """Frame times in milliseconds, bytes sent and the resolution; keys differ between views."""
