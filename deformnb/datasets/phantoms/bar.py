"""The procedural bar of figures 1 and 2: a bend, a twist or a cut shows in its checks, seams and core."""

from __future__ import annotations

from functools import cache

import numpy as np

from deformnb.datasets.phantoms.scene import Part, PhantomScene
from deformnb.datasets.phantoms.shapes import Block, Float32s, Tube

LOW, HIGH = (28.0, 44.0, 76.0), (228.0, 84.0, 116.0)
CELL = 20.0
"""Edge of a check in mm: two across the bar and ten along it, large enough to survive a coarse grid."""


@cache
def scene() -> PhantomScene:
    """A bar of 200 x 40 x 40 mm along x in a box of 256 x 128 x 192 mm, with room to bend up and down.

    Voxels of 2 mm. Checked block, a ladder of bright wires on its skin, a dark canal and a bright core.

    The wires are there for projections: a maximum along the depth would drown checks that alternate in depth.
    """
    skin = 1.0
    y0, z0, y1, z1 = LOW[1] + skin, LOW[2] + skin, HIGH[1] - skin, HIGH[2] - skin
    x0, x1 = LOW[0] + skin, HIGH[0] - skin
    corners = ((y0, z0), (y1, z0), (y1, z1), (y0, z1))
    rungs = [tuple((float(x), y, z) for y, z in (*corners, corners[0])) for x in np.linspace(x0, x1, 11)]
    rails = [((x0, y, z), (x1, y, z)) for y, z in (*corners, (64.0, z0), (64.0, z1), (y0, 96.0), (y1, 96.0))]
    wires = [Tube(line, (1.4,)) for line in (*rungs, *rails)]
    canal = Block((LOW[0] + 3, 56.0, 88.0), (HIGH[0] - 3, 72.0, 104.0), 7.9)
    parts = (
        Part(Block(LOW, HIGH, 2.0), ((0.0, 150.0), (1.5, _checks))),
        *(Part(wire, ((0.0, 230.0),)) for wire in wires),
        Part(canal, ((0.0, 150.0), (1.5, 15.0))),
        Part(Tube(((LOW[0] - 6, 64.0, 96.0), (HIGH[0] + 6, 64.0, 96.0)), (3.5,)), ((0.0, 255.0),)),
    )
    return PhantomScene("bar (phantom)", (256.0, 128.0, 192.0), (96, 64, 128), parts, texture=0.0, seed=1)


def _checks(x: Float32s, y: Float32s, z: Float32s) -> Float32s:
    """Light and dark cubes; the sine anti-aliases the borders at any voxel size."""
    wave = 1.0
    for p, start in ((x, LOW[0]), (y, LOW[1]), (z, LOW[2])):
        wave = wave * np.clip(4 * np.sin(np.float32(np.pi / CELL) * (p - np.float32(start + 1e-3))), -1, 1)
    return np.asarray(np.float32(105) + np.float32(35) * wave)
