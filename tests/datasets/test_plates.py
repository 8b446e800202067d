"""Thompson's drawings: each is cut out of its scan whole, and his lines are where the nodes of the grid are."""

from __future__ import annotations

import hashlib
from importlib import resources

import numpy as np
import pytest

from deformnb.datasets import PLATE_SOURCE, thompson_grids, thompson_plate
from deformnb.errors import DeformError

FIGURES = sorted(thompson_grids())
DARK = 128  # of 255
AROUND = 6  # pixels from a node within which its lines are looked for


@pytest.mark.parametrize("figure", FIGURES)
def test_lines_are_drawn_at_nearly_every_node(figure):
    picture = thompson_plate(figure)
    left, top = (round(o) for o in picture.raster.origin)
    high, wide = picture.values.shape
    inked = []
    for x, y in thompson_grids()[figure].nodes.reshape(-1, 2):
        i, j = round(y) - top, round(x) - left
        if AROUND <= i < high - AROUND and AROUND <= j < wide - AROUND:
            inked.append(picture.values[i - AROUND : i + AROUND + 1, j - AROUND : j + AROUND + 1].min() < DARK)
    assert len(inked) > 0.6 * len(thompson_grids()[figure].nodes.reshape(-1, 2))  # the rest is on the border
    assert np.mean(inked) > 0.9


@pytest.mark.parametrize("figure", FIGURES)
def test_a_drawing_ends_before_the_other_figure_of_the_scan(figure):
    grids = thompson_grids()
    (other,) = (g for g in grids.values() if g.image == grids[figure].image and g.figure != figure)
    a0, a1, _, _ = thompson_plate(figure).raster.box
    assert a0 < grids[figure].nodes[..., 0].min() + 1
    assert grids[figure].nodes[..., 0].max() < a1
    assert not ((other.nodes[..., 0] > a0) & (other.nodes[..., 0] < a1)).any()


def test_the_scans_are_those_of_the_book(real_data):
    for image in sorted({grid.image for grid in thompson_grids().values()}):
        shipped = resources.files("deformnb.datasets").joinpath("plates", image).read_bytes()
        read = (real_data("darcy") / image).read_bytes()
        assert hashlib.sha256(shipped).hexdigest() == hashlib.sha256(read).hexdigest()


def test_an_unknown_species_is_named():
    with pytest.raises(DeformError, match="no figure of Thompson is named 'Whale'"):
        thompson_plate("Whale")


def test_the_origin_is_printed_with_the_drawings():
    assert "1917" in PLATE_SOURCE
    assert "public domain" in PLATE_SOURCE
