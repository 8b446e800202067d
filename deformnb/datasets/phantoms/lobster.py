"""A lobster lying flat, after figure 5: a bright thin shell round faint flesh, as in the CT scan.

x runs from its right to its left side (symmetry plane at 120 but for the claws), y from head to tail, z upwards, in mm.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Float3
from deformnb.datasets.phantoms.scene import Part, PhantomScene, SolidValue
from deformnb.datasets.phantoms.shapes import Blend, Both, Ellipsoid, Float32s, Loft, Sheet, Shell, Solid, Tube, path

_MIDDLE = 120.0
_LENGTHS = (240.0, 330.0, 78.4)
FLESH = 62.0

# Centre lines from the body outwards: (x from the middle, y, z); mirrored for the other side.
_LEGS = (
    ((14, 132, 26), (44, 112, 40), (70, 104, 30), (88, 92, 9)),
    ((15, 146, 26), (50, 136, 42), (78, 132, 30), (98, 124, 8)),
    ((15, 160, 26), (50, 164, 42), (76, 172, 30), (95, 178, 8)),
    ((14, 174, 26), (44, 190, 40), (64, 206, 28), (79, 222, 8)),
)
ANTENNA = ((7, 98, 46), (24, 70, 54), (40, 62, 58), (70, 100, 62), (96, 160, 60), (106, 220, 56), (103, 280, 52))
ANTENNULES = (((4, 94, 48), (10, 72, 56), (14, 52, 58)), ((4, 94, 48), (6, 70, 58), (5, 48, 62)))
ARM = ((16, 122, 32), (36, 108, 30), (52, 92, 30), (57, 80, 30))


@cache
def scene() -> PhantomScene:
    """A lobster in a box of 240 x 330 x 78.4 mm.

    Voxels of 1.4 mm, as thick as the real scan's slices. Tail before carapace, legs below, so that every plate overlaps
    the next as in life.
    """
    parts = [*_legs(), *_tail(), *_claw(-1.0, 1.12), *_claw(1.0, 0.98), *_carapace(), *_feelers()]
    return PhantomScene("lobster (phantom)", _LENGTHS, (56, 236, 172), tuple(parts), texture=0.05, seed=5)


def _armour(value: float) -> SolidValue:
    """Shell with the mottling of uneven lime."""

    def paint(x: Float32s, y: Float32s, z: Float32s) -> Float32s:
        spots = np.sin(0.33 * x + 1.1 * np.sin(0.19 * y)) * np.sin(0.29 * y + 0.21 * z)
        spots = spots + 0.5 * np.sin(0.8 * x - 0.7 * y + 0.5 * z)
        return np.asarray(np.float32(value) + np.float32(13) * spots)

    return paint


def _crust(solid: Solid, value: float, thickness: float = 1.8) -> Part:
    return Part(solid, ((0.0, _armour(value)), (thickness, FLESH)))


def _mirror(line: tuple[Float3, ...], side: float, count: int) -> tuple[Float3, ...]:
    return tuple((_MIDDLE + side * float(x), float(y), float(z)) for x, y, z in path(line, count))


def _carapace() -> list[Part]:
    hull = Loft(
        "y",
        (
            (96, _MIDDLE, 42, 3, 3),
            (101, _MIDDLE, 41, 9, 10),
            (116, _MIDDLE, 39, 17, 16),
            (140, _MIDDLE, 38, 24, 21),
            (166, _MIDDLE, 37, 26, 21.5),
            (190, _MIDDLE, 36, 24, 20),
            (203, _MIDDLE, 36, 20, 17),
        ),
    )
    rostrum = Tube(((_MIDDLE, 104, 51), (_MIDDLE, 92, 54), (_MIDDLE, 76, 58)), (5.0, 3.2, 0.6))
    parts = [_crust(hull, 205.0, 2.2), Part(rostrum, ((0.0, 200.0),))]
    organs = Both((Ellipsoid((_MIDDLE, 150, 42), (16, 34, 11)), Shell(hull, 99.0, 4.0)))
    parts += [
        Part(organs, ((0.0, 96.0), (4.0, 128.0))),
        Part(Ellipsoid((_MIDDLE, 120, 42), (9, 10, 9)), ((0.0, 120.0), (1.2, 20.0))),
    ]
    groove = Tube(
        (
            (_MIDDLE - 25, 140, 44),
            (_MIDDLE - 12, 153, 57),
            (_MIDDLE, 158, 60),
            (_MIDDLE + 12, 153, 57),
            (_MIDDLE + 25, 140, 44),
        ),
        (1.4,),
    )
    parts += [
        Part(groove, ((0.0, 232.0),)),
        Part(Tube(((_MIDDLE, 104, 52), (_MIDDLE, 160, 59.5), (_MIDDLE, 202, 53)), (1.0,)), ((0.0, 232.0),)),
    ]
    for side in (-1.0, 1.0):
        for k in range(3):
            start = (_MIDDLE + side * (4 - k), 96.0 - 6 * k, 53.0 + 1.5 * k)
            parts.append(
                Part(Tube((start, (start[0] + side * 4, start[1] - 6, start[2] + 1)), (1.6, 0.5)), ((0.0, 210.0),))
            )
        parts += [
            Part(Tube(((_MIDDLE + side * 6, 104, 47), (_MIDDLE + side * 11, 95, 49)), (2.6, 2.2)), ((0.0, 170.0),)),
            Part(Ellipsoid((_MIDDLE + side * 12.0, 93, 49.5), (3.8, 3.8, 3.8)), ((0.0, 225.0), (1.2, 110.0))),
        ]
    return parts


def _tail() -> list[Part]:
    """Six overlapping rings with side plates, the fan of telson and four uropods, swimmerets underneath."""
    parts: list[Part] = []
    for flap in (((12.0, 300.0, 27.0), (15.0, 18.0), 0.22), ((25.0, 293.0, 25.0), (11.0, 21.0), 0.62)):
        (dx, y, z), (wide, long), turn = flap
        for side in (-1.0, 1.0):
            u, v = (
                (float(np.cos(turn)), -side * float(np.sin(turn)), 0.0),
                (side * float(np.sin(turn)), float(np.cos(turn)), 0.0),
            )
            angle = np.linspace(0, 2 * np.pi, 25)[:-1]
            rim = tuple(
                (wide * float(np.cos(t)) * (1 + 0.25 * float(np.sin(t))), long * float(np.sin(t))) for t in angle
            )
            origin = (_MIDDLE + side * dx, float(y), float(z))
            parts.append(Part(Sheet(rim, 3.0, origin, u, v), ((0.0, 165.0),)))
            for s in np.linspace(-0.8, 0.8, 7):
                base = np.asarray(origin) - 0.7 * long * np.asarray(v)
                tip = np.asarray(origin) + 0.9 * wide * s * np.asarray(u) + long * (0.97 - 0.35 * s * s) * np.asarray(v)
                parts.append(Part(Tube((_triple(base), _triple(tip)), (1.3, 0.8)), ((0.0, 215.0),)))
    telson = ((-11, 279), (-13, 298), (-11, 314), (0, 319), (11, 314), (13, 298), (11, 279))
    parts.append(
        Part(
            Sheet(
                tuple((_MIDDLE + float(a), float(b)) for a, b in telson),
                4.5,
                (0.0, 0.0, 31.0),
                (1.0, 0.0, 0.0),
                (0.0, 1.0, 0.0),
            ),
            ((0.0, 205.0), (1.5, 120.0)),
        )
    )
    for k in reversed(range(6)):
        y, wide, high = 207.0 + 13.5 * k, 22.5 - 1.2 * k, 16.0 - 0.8 * k
        for side in (-1.0, 1.0):
            plate = Tube(
                (
                    (_MIDDLE + side * (wide - 2), y, 33),
                    (_MIDDLE + side * (wide + 2), y + 3, 24),
                    (_MIDDLE + side * (wide + 1), y + 8, 15),
                ),
                (6.0, 4.6, 0.8),
            )
            parts.append(_crust(plate, 205.0, 1.4))
            if k < 5:
                parts.append(Part(Ellipsoid((_MIDDLE + side * 9.0, y + 4, 16.5), (4.0, 8.0, 1.6)), ((0.0, 130.0),)))
        parts.append(_crust(Ellipsoid((_MIDDLE, y, 34.0 - 0.5 * k), (wide, 10.5, high)), 198.0, 1.6))
        hoop = Both(
            (
                Shell(Ellipsoid((_MIDDLE, y, 34.0 - 0.5 * k), (wide, 10.5, high)), 1.8),
                Ellipsoid((_MIDDLE, y + 8, 34), (40, 3.2, 40)),
            )
        )
        parts.append(Part(hoop, ((0.0, 238.0),)))
    return parts


def _legs() -> list[Part]:
    parts = []
    for side in (-1.0, 1.0):
        for line in _LEGS:
            joints = _mirror(line, side, 4)
            for (a, b), (ra, rb) in zip(pairwise(joints), ((4.4, 3.6), (3.6, 2.6), (2.6, 0.8)), strict=True):
                parts.append(_crust(Tube((a, b), (ra, rb)), 180.0, 1.2))
                parts.append(Part(Ellipsoid(b, (rb, rb, rb)), ((0.0, 215.0),)))
    return parts


def _claw(side: float, size: float) -> list[Part]:
    """Four arm segments and a claw; the right one (side -1) is the larger crusher with blunt teeth."""

    def at(x: float, y: float, z: float = 30.0) -> Float3:
        return (_MIDDLE + side * (57 + size * (x - 57)), 80 + min(size, 1.0) * (y - 80), z)

    parts = []
    arm = _mirror(ARM, side, 4)
    for k, (a, b) in enumerate(pairwise(arm)):
        parts.append(_crust(Tube((a, b), (5.5 + k, 6.5 + k)), 190.0, 1.6))
        for s in (-1, 1):
            tip = (b[0] + side * 2.0, b[1] - 5.0, b[2] + s * 8.0)
            parts.append(Part(Tube((b, tip), (3.0, 0.6)), ((0.0, 215.0),)))
    # Seen from above the thumb (dactyl) is the inner finger; flat in z.
    palm = Blend(
        (
            Ellipsoid(at(65, 56), (15 * size, 24 * size, 10 * size)),
            Tube((at(57, 80), at(62, 68)), (6.0, 9.0)),
            Tube((at(72, 42), at(76, 22), at(69, 4)), (9.0 * size, 6.0 * size, 1.5)),
        ),
        7.0,
    )
    thumb = Tube(
        tuple(at(*p) for p in ((54, 46), (49, 34), (51, 18), (58, 5))), (6.5 * size, 6.0 * size, 4.4 * size, 1.4)
    )
    parts += [
        _crust(palm, 208.0, 2.4),
        _crust(thumb, 214.0, 2.2),
        Part(Ellipsoid(at(55, 47), (5.5, 5.5, 6.0)), ((0.0, 235.0), (1.6, 110.0))),
    ]
    for k in range(5):
        r = (2.6 if side < 0 else 1.7) * (1 - 0.1 * k)
        parts.append(Part(Ellipsoid(at(68.5 + 0.5 * k - 0.35 * k * k, 33 - 5.5 * k), (r, r, r)), ((0.0, 245.0),)))
        parts.append(Part(Ellipsoid(at(55.5 + 0.2 * k + 0.1 * k * k, 32 - 5.5 * k), (r, r, r)), ((0.0, 245.0),)))
    return parts


def _feelers() -> list[Part]:
    parts = []
    for side in (-1.0, 1.0):
        parts.append(Part(Tube(_mirror(ANTENNA, side, 24), tuple(np.linspace(2.2, 0.7, 24))), ((0.0, 185.0),)))
        parts.append(Part(Tube(_mirror(ANTENNA[:2], side, 3), (4.0, 3.4, 2.6)), ((0.0, 200.0), (1.2, 80.0))))
        parts += [
            Part(Tube(_mirror(line, side, 8), tuple(np.linspace(1.5, 0.6, 8))), ((0.0, 165.0),)) for line in ANTENNULES
        ]
        parts.append(
            Part(
                Tube(_mirror(((8, 112, 24), (11, 96, 22), (7, 86, 24)), side, 6), (2.6, 2.6, 2.4, 2.2, 1.6, 0.8)),
                ((0.0, 175.0), (1.0, 80.0)),
            )
        )
    return parts


def _triple(p: NDArray[np.float64]) -> Float3:
    return (float(p[0]), float(p[1]), float(p[2]))
