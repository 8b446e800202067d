"""The landmarks that the files in tests/fixtures/landmarks hold, which other programs have read and written again."""

from __future__ import annotations

import numpy as np

from deformnb.warping.points import Landmarks

_MOVING = np.array(
    [
        [69.551977, -97.9474168358, -157.35],
        [-292.4970571840865, -35.32321, 124.76],
        [3.307, 51.184, 102.3238],
        [-88.2145848, 265.2286697169545, -87.690825],
        [37.35530621878692, 273.958, -11.425241215164043],
    ]
)

LANDMARKS = Landmarks(
    _MOVING,
    ("nose", "left ear", "Auge", "fin 2", "tail"),
    _MOVING + np.array([1.5, -2.25, 0.3]),
    np.array([True, False, True, True, True]),
)
