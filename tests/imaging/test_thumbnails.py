"""Thumbnails of presets: their content, their side, and that poor volumes have some."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from deformnb.imaging.thumbnails import preset_thumbnails
from deformnb.volume.transfer import PRESETS
from deformnb.volume.volume import Grid, Volume


def head(shape: tuple[int, int, int] = (150, 40, 20), spacing: tuple[float, float, float] = (1, 1, 1)) -> Volume:
    """A body [z, y, x] with a bone in its upper half."""
    values = np.zeros(shape, np.uint8)
    z, y, x = shape
    values[z // 10 : -z // 10, y // 4 : -y // 4, x // 4 : -x // 4] = 90
    values[z * 6 // 10 : z * 8 // 10, y * 3 // 8 : -y * 3 // 8, x * 3 // 8 : -x * 3 // 8] = 240
    return Volume(values, Grid(shape, spacing))


def test_bone_is_seen_through_skin_and_alone_and_not_behind_a_surface() -> None:
    found = preset_thumbnails(head(), "+y", 64)
    assert list(found) == list(PRESETS)
    upper, lower = (32 - 15, 31), (32 + 15, 31)  # up is +z
    assert found["bone"][upper][3] > 200
    assert found["bone"][lower][3] == 0
    assert found["specimen"][upper][2] > found["specimen"][lower][2] + 10  # whiter than flesh
    assert found["surface"][lower][3] > 240
    assert all((picture[0] == 0).all() and (picture[:, 0] == 0).all() for picture in found.values())


@pytest.mark.parametrize(
    ("view", "spacing", "is_wide"),
    [("+y", (1, 1, 1), False), ("+y", (20, 1, 1), True), ("-z", (1, 1, 1), False), ("-x", (1, 9, 1), True)],
)
def test_lengths_are_true_and_fill_the_picture(view: str, spacing: Any, is_wide: bool) -> None:
    opacity = preset_thumbnails(head(spacing=spacing), view, 64)["surface"][..., 3] > 100
    tall, wide = np.ptp(np.flatnonzero(opacity.any(axis=1))), np.ptp(np.flatnonzero(opacity.any(axis=0)))
    assert max(tall, wide) > 50
    assert (wide > tall) == is_wide


@pytest.mark.parametrize(
    "values",
    [
        np.zeros((2, 2, 2)),
        np.full((1, 1, 1), -1000.0),
        np.array([[[False, True]]]),
        np.full((2, 2, 2), np.nan),
        np.array([[[0, 1e300]]]),
        np.zeros((1, 300, 2), np.uint8),
    ],
    ids=["zero", "one voxel", "bool", "nan", "huge", "flat"],
)
def test_poor_volumes_have_pictures(values: np.ndarray) -> None:
    for picture in preset_thumbnails(Volume.from_array(values), size=24).values():
        assert (picture.shape, picture.dtype) == ((24, 24, 4), np.uint8)
