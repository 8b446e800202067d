"""The look in which an opening is seen: a cut that is pulled open is hidden in tissue that lets all light through."""

from __future__ import annotations

import numpy as np

from deformnb.session.session import Session
from deformnb.volume.transfer import PRESETS
from deformnb.warping.foreground import foreground_level

SEEN_OPACITY = 0.3
"""Opacity of most tissue from which on its surface, and so an opening in it, is seen."""

_STRIDE = 64  # voxels along each axis are enough for a median

OPENING_LOOK = "surface"


def show_opening(session: Session) -> bool:
    """Choose the look of the surface where that of a session is a preset that shows none; returns whether.

    A look that the user has made stays. The session's notice says what has changed.

    Examples
    --------
    >>> from deformnb.datasets.phantoms import PHANTOMS
    >>> session = Session(PHANTOMS["abdomen"].make((16, 16, 16)))
    >>> show_opening(session), session.pictures.transfer, show_opening(session)
    (True, 'surface', False)
    """
    pictures = session.pictures
    if pictures.shows_channels or session.volume.is_labels or pictures.transfer not in PRESETS:
        return False
    values = session.volume.values[tuple(slice(None, None, max(1, n // _STRIDE)) for n in session.volume.shape)]
    tissue = values[values > foreground_level(session.volume)]
    if not tissue.size:
        return False
    at, opacities = np.array(pictures.transfer_function.opacities).T
    if np.interp(float(np.median(tissue)), at, opacities) >= SEEN_OPACITY:
        return False
    pictures.set_trait("transfer", OPENING_LOOK)
    session.editing.notice = "The skin is opaque now, so that the opening is seen; the group View has the other looks."
    return True
