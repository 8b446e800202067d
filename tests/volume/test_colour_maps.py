from __future__ import annotations

import matplotlib
import numpy as np
import pytest

from deformnb.errors import DeformError
from deformnb.volume.colour_maps import COLOUR_MAPS, colour_table


@pytest.mark.parametrize("name", COLOUR_MAPS[1:])
def test_the_colours_are_those_of_matplotlib(name: str) -> None:
    wanted = matplotlib.colormaps[name](np.arange(256))[:, :3] * 255
    difference = np.abs(colour_table(name) - wanted)
    assert difference.max() <= 4.5  # where cividis has a corner between two knots
    assert difference.mean() < 0.5


def test_grey_is_the_value_itself_and_other_names_are_refused() -> None:
    assert colour_table("grey").tolist() == [[k, k, k] for k in range(256)]
    with pytest.raises(DeformError, match="viridis"):
        colour_table("jet")
