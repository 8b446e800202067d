"""Region growing against a label image of the whole volume."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from deformnb.errors import Cancelled, DeformError
from deformnb.volume.region_growing import connected_threshold


def test_it_is_the_component_of_the_seed_also_where_it_winds_through_many_slabs() -> None:
    rng = np.random.default_rng(3)
    values = rng.integers(0, 100, (60, 300, 300), np.uint8)  # three slabs
    seed = (31, 150, 150)
    values[seed] = 50
    labels = ndimage.label((values >= 20) & (values <= 55))[0]
    seen: list[float] = []
    mask = connected_threshold(values, seed, 20, 55, seen.append)
    np.testing.assert_array_equal(mask, labels == labels[seed])
    assert len(seen) == 4
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    stopped = Cancelled("by the user")

    def stop(_share: float) -> None:
        raise stopped

    with pytest.raises(Cancelled):
        connected_threshold(values, seed, 20, 55, stop)


def test_what_lies_outside_is_refused() -> None:
    values = np.array([[[1.0, np.nan, 3.0]]])
    assert connected_threshold(values, (0, 0, 0), 0, 9).tolist() == [[[True, False, False]]]
    for seed, words in (((0, 0, 3), "outside"), ((0, 0, 1), "not within"), ((0, 0, 2), "not within")):
        with pytest.raises(DeformError, match=words):
            connected_threshold(values, seed, 0, 2)
