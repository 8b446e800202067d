"""Volumes of labels before and after a deformation."""

from __future__ import annotations

import math

import numpy as np
import pytest

from deformnb import DeformError, Volume, warp
from deformnb.analysis import label_volumes
from deformnb.rbf.fields import Affine


def test_a_map_that_shrinks_by_two_leaves_an_eighth() -> None:
    values = np.zeros((16, 16, 16), np.int16)
    values[4:12, 4:12, 4:12] = 5
    values[0, 0, 0] = 9
    labels = Volume(values, Volume.from_array(values, spacing=(1, 1, 2)).grid, is_labels=True)
    middle = np.asarray(labels.grid.center)
    shrunk = warp(labels, Affine(2 * np.eye(3), -middle))
    rows = label_volumes(labels, shrunk, {5: "cube"})
    assert [(row.label, row.name, row.before, row.after) for row in rows] == [
        (5, "cube", 512 * 2.0, 64 * 2.0),
        (9, "", 2.0, 0.0),
    ]
    assert [row.change for row in rows] == [-87.5, -100.0]


def test_a_label_that_is_new_has_no_change_in_percent() -> None:
    empty, full = Volume.from_array(np.zeros((2, 2), bool)), Volume.from_array(np.ones((2, 2), bool))
    [row] = label_volumes(empty, full)
    assert (row.label, row.before, row.after) == (1, 0, 4)
    assert math.isnan(row.change)
    with pytest.raises(DeformError, match="whole numbers"):
        label_volumes(empty, Volume.from_array(np.zeros((2, 2))))
