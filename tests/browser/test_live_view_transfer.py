"""The colours of the live view, pixel by pixel, against the transfer function itself."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from browser.live_page import LivePage

from deformnb.volume.transfer import TransferFunction
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.view.live_view import LiveView

pytestmark = pytest.mark.needs_browser

SIZE = (320, 240)
GRID = Grid((40, 40, 40))


@pytest.fixture
def page(browser: Any) -> Iterator[LivePage]:
    found = LivePage(browser)
    yield found
    found.close()


def slope(high: float, kind: str) -> Volume:
    """A volume whose values rise from 0 along x."""
    return Volume(np.broadcast_to(np.linspace(0, high, 40), GRID.shape).astype(kind), GRID)


def row(page: LivePage, volume: Volume, transfer: TransferFunction | str, zoom: float) -> np.ndarray:
    """The middle row of a picture along y, in which x runs right, as shares of full brightness."""
    view = LiveView(
        volume,
        transfer=transfer,
        projection="composite",
        width=SIZE[0],
        height=SIZE[1],
        settle_ms=60000,
        background="dark",
    )
    view.set_camera((0, 1, 0), (0, 0, 1), zoom)
    page.add(view)
    page.wait_loaded()
    return page.pixels()[SIZE[1] // 2] / 255


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    "transfer",
    [TransferFunction(((0, 0, 0.2, 1), (60, 1, 0.5, 0), (100, 1, 1, 1)), ((0, 0.9),), unit=0.1), "surface", "specimen"],
)
def test_a_hot_voxel_changes_no_colour(browser: Any, transfer: TransferFunction | str) -> None:
    plain = slope(100, "float32")
    values = plain.values.copy()
    values[3, 30, 3] = 1e6
    rows = []
    for volume in (plain, Volume(values, GRID)):
        page = LivePage(browser)
        rows.append(row(page, volume, transfer, 1.0))
        assert page.errors == []
        page.close()
    assert rows[0].max() > 0.3
    assert np.abs(rows[1] - rows[0]).max() < 0.02


def test_colours_are_those_of_the_function(page: LivePage) -> None:
    function = TransferFunction(((0, 0, 0.2, 1), (60, 1, 0.5, 0), (100, 1, 1, 1)), ((0, 0.95),), unit=0.05)
    values = slope(100, "float32").values.copy()
    values[3, 30, 3] = 1e6
    found = row(page, Volume(values, GRID), function, 4.0)
    # One edge of the picture to the other, a quarter of what is seen without zoom, lies in the middle of the slope.
    wanted = function(np.linspace(0, 100, 10001))[:, :3]
    place = np.abs(wanted[None] - found[:, None]).max(axis=-1)
    assert place.min(axis=1).max() < 0.01  # every pixel has a colour of the function
    at = np.linspace(0, 100, 10001)[place.argmin(axis=1)]
    assert abs(at[160] - 50) < 2.6  # a voxel
    assert np.abs(np.diff(at, 2)).max() < 1.2  # and they follow one another evenly


def test_a_jump_of_colour_is_sharper_than_a_byte(page: LivePage) -> None:
    function = TransferFunction(
        ((0, 1, 0, 0), (128.4, 1, 0, 0), (128.4, 0, 1, 0), (255, 0, 1, 0)), ((0, 0.95),), unit=0.05
    )
    found = row(page, slope(255, "uint8"), function, 8.0)
    assert found[0, 0] > 0.98
    assert found[-1, 1] > 0.98
    # A pixel is a tenth of a byte: a table with one entry for each would mix the colours over ten.
    assert np.count_nonzero((found[:, 0] > 0.05) & (found[:, 1] > 0.05)) <= 4
