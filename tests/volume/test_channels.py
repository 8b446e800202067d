"""Channels: their colours, their brightness, and mismatches."""

from __future__ import annotations

import numpy as np
import pytest

from deformnb import DeformError, Grid, Volume
from deformnb.volume import Channels


def test_colours_are_added_up() -> None:
    values = np.array([[[0, 0], [100, 0], [0, 50], [100, 50]]], np.uint8)  # [y, x, c]
    mixed = Channels.from_array(values).composite()[0, 0]
    assert mixed[..., :3].tolist() == [[0, 0, 0], [0, 1, 0], [1, 0, 1], [1, 1, 1]]  # green, magenta, and both
    assert (mixed[..., 3] == 1).all()


def test_colours_of_a_picture_keep_their_scale() -> None:
    photo = Channels.from_array(np.array([[[51, 102, 255], [0, 0, 0]]], np.uint8), kind="rgb")
    assert np.allclose(photo.composite()[0, 0, 0], (0.2, 0.4, 1, 1))
    clear = Channels.from_array(np.array([[[255, 255, 255, 51]]], np.uint8), kind="rgba")
    assert np.allclose(clear.composite()[0, 0, 0], (0.2, 0.2, 0.2, 1))
    assert len(clear.colours) == 4


def test_brightness_is_luma_of_colours_and_the_largest_of_channels() -> None:
    photo = Channels.from_array(np.array([[[255, 0, 0], [0, 255, 0], [10, 10, 10]]], np.uint8), kind="rgb")
    assert photo.brightness().values.tolist() == [[[76, 150, 10]]]  # 0.299 and 0.587 of 255
    stained = Channels.from_array(np.array([[[0.0, 7], [2, 7], [1, 9]]]))
    assert stained.brightness().values.tolist() == [[[0, 255, 255]]]


def test_a_channel_is_found_by_number_and_name() -> None:
    stained = Channels.from_array(np.zeros((2, 3, 4, 2)), Grid((2, 3, 4), (1, 1, 2)), ("nuclei", "actin"))
    assert stained["actin"] is stained[1] is stained[-1]
    assert stained.grid.spacing == (1, 1, 2)
    for which in ("bone", 2, 0.5):
        with pytest.raises(DeformError, match="channel"):
            stained[which]  # type: ignore[index]


@pytest.mark.parametrize(
    ("volumes", "more", "said"),
    [
        ((), {}, "one or more volumes"),
        ((Volume.from_array(np.zeros((2, 2))), Volume.from_array(np.zeros((2, 3)))), {}, "one grid"),
        ((Volume.from_array(np.zeros((2, 2))), Volume.from_array(np.zeros((2, 2), np.uint8))), {}, "one voxel type"),
        ((Volume.from_array(np.zeros((2, 2))),), {"kind": "rgb"}, "cannot be of the kind"),
        ((Volume.from_array(np.zeros((2, 2))),), {"kind": "cmyk"}, "cannot be of the kind"),
        ((Volume.from_array(np.zeros((2, 2))),), {"colours": ((1, 0, 0),) * 2}, "as many colours"),
    ],
    ids=["none", "grids", "types", "rgb", "cmyk", "colours"],
)
def test_what_does_not_belong_together_is_refused(volumes: object, more: dict[str, object], said: str) -> None:
    with pytest.raises(DeformError, match=said):
        Channels(volumes, **more)  # type: ignore[arg-type]
