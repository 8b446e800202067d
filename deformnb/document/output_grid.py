"""Grid of a result: the box that is seen of a deformed volume, and its resolution."""

from __future__ import annotations

from numpy.typing import ArrayLike

from deformnb.analysis.extent import FieldOfView, field_of_view, padded
from deformnb.document.deformation import Deformation
from deformnb.errors import DeformError
from deformnb.volume.volume import Volume


def output_grid(
    document: Deformation, volume: Volume, *, spacing: ArrayLike | None = None, margin: ArrayLike | str | None = None
) -> FieldOfView:
    """The grid of a document's result, with the requested spacing and margin.

    Parameters
    ----------
    spacing : voxel size of the result, one length or (x, y, z); default is that of the volume, or of the document's
        ``output``.
    margin : "fit" is the box that the deformed foreground needs; a length or (x, y, z) is added to the volume's box on
        every side, negative crops, 0 is the volume's own box. Without another spacing it is rounded up to whole voxels,
        so that these stay where they are. Default is the document's ``output``.

    Raises
    ------
    DeformError
        If nothing is left of the box, or a length is none.

    Examples
    --------
    >>> import numpy as np
    >>> volume = Volume.from_array(np.zeros((4, 4, 4)))
    >>> output_grid(Deformation(), volume, spacing=0.5, margin=1).grid.shape
    (12, 12, 12)
    """
    document = document.to_unit(volume.grid.unit)
    if isinstance(margin, str):
        if margin != "fit":
            raise DeformError(f'a margin is "fit" or lengths, got {margin!r:.60}.')
        found = field_of_view(volume, document.field(volume))
        return found if spacing is None else FieldOfView(found.grid.resampled(spacing=spacing), found.is_limited)
    own = None if document.output is None else volume.to_own_resolution(document.output)
    box = (own or volume.grid) if margin is None else volume.grid
    if spacing is not None:
        return FieldOfView(box.resampled(spacing=spacing, margin=0.0 if margin is None else margin))
    return FieldOfView(box if margin is None else padded(box, margin))
