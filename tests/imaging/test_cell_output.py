"""Pictures and tables of objects in a cell, where they are long, large, coloured or of uneven pixels."""

from __future__ import annotations

import base64
import io
import re

import numpy as np
from PIL import Image

import deformnb as dn
from deformnb.imaging.cell_output import as_html, as_png
from deformnb.warping.points import Landmarks


def _pixels(png: bytes) -> np.ndarray:  # type: ignore[type-arg]
    return np.asarray(Image.open(io.BytesIO(png)))


def test_a_picture_has_square_pixels_and_its_own_colours() -> None:
    values = np.zeros((6, 5, 4), np.uint8)
    values[:, 0, 0], values[:, 4, 3] = 100, 200
    volume = dn.Volume.from_array(values, spacing=(2.0, 1.0, 1.0))
    picture = dn.project(volume, "+z")  # 8 wide, 5 high
    found = _pixels(as_png(picture))
    assert found.shape == (300, 480, 3)
    colours = picture.rgb8()
    for v in range(5):
        for u in range(4):
            np.testing.assert_array_equal(found[60 * v + 30, 120 * u + 60], colours[v, u])


def test_a_large_picture_is_made_small_with_its_means() -> None:
    checks = np.indices((1, 1920, 1920)).sum(axis=0) % 2 * 255
    found = _pixels(as_png(dn.project(dn.Volume.from_array(checks.astype(np.uint8)), "+z")))
    assert found.shape == (480, 480, 3)
    assert abs(int(found[240, 240, 0]) - 127) <= 2


def test_a_volume_shows_its_three_middle_slices_in_one_row_to_one_scale() -> None:
    values = np.zeros((9, 17, 33), np.uint8)
    values[4], values[:, 8], values[:, :, 16] = 80, 160, 240
    html = as_html(dn.Volume.from_array(values, spacing=(1, 1, 2)))
    data = re.findall(r'src="data:image/png;base64,([^"]+)"', html)
    assert len(data) == 1
    found = _pixels(base64.b64decode(data[0]))
    assert found.shape == (87, 160 + 160 + 82 + 2 * 4, 3)  # 33 x 17, 33 x 18 and 17 x 18 to one scale


def test_long_tables_are_cut() -> None:
    places = np.arange(300.0).reshape(100, 3)
    for shown in (Landmarks(places), dn.ControlPoints.from_arrays(places)):
        html = as_html(shown)
        assert html.count("<tr>") == 13
        assert "... and 88 more" in html
    assert "more" not in as_html(dn.ControlPoints.from_arrays(places[:12]))


def test_any_volume_is_shown() -> None:
    for values in (
        np.full((2, 3, 4), np.nan),
        np.zeros((1, 1, 1), bool),
        np.full((3, 3, 3), np.inf),
        np.arange(8, dtype=np.int32).reshape(2, 2, 2) - 2**30,
    ):
        assert as_html(dn.Volume.from_array(values)).startswith("<div><b>Volume</b><br><img ")
    turned = dn.Grid((4, 5, 6), direction=((0.6, -0.8, 0), (0.8, 0.6, 0), (0, 0, 1)))
    assert "<img " in as_html(dn.Volume(np.random.default_rng(0).random((4, 5, 6)), turned))
