"""A horse standing on four legs, the implicit surface of figure 6 (c, d).

x runs from the right to the left side (symmetry plane at 40), y from tail to head, z up, in mm; it stands
on z = 6.
"""

from __future__ import annotations

from functools import cache

from deformnb._typing import Float3
from deformnb.datasets.phantoms.scene import Part, PhantomScene
from deformnb.datasets.phantoms.shapes import Blend, Block, Both, Ellipsoid, Solid, Tube

_MIDDLE, GROUND = 40.0, 6.0

# Legs: (x from the middle, y, z, radius) from shoulder or hip to hoof; all in different poses, as in the paper's horse.
_LEGS = (
    (
        (-13, 147, 96, 13.0),
        (-15, 149, 72, 9.5),
        (-13, 152, 45, 5.6),
        (-13, 154, 40, 4.6),
        (-13, 156, 24, 3.9),
        (-13, 159, 14, 4.4),
    ),
    (
        (13, 145, 96, 13.0),
        (15, 139, 72, 9.5),
        (13, 132, 45, 5.6),
        (13, 131, 40, 4.6),
        (13, 127, 24, 3.9),
        (13, 129, 14, 4.4),
    ),
    (
        (-12, 62, 104, 17.0),
        (-15, 58, 84, 13.0),
        (-14, 45, 70, 8.5),
        (-13, 30, 60, 5.6),
        (-13, 23, 38, 4.3),
        (-13, 19, 22, 4.2),
        (-13, 21, 14, 4.6),
    ),
    (
        (12, 64, 104, 17.0),
        (15, 68, 84, 13.0),
        (14, 60, 72, 8.5),
        (13, 48, 58, 5.6),
        (13, 43, 38, 4.3),
        (13, 41, 22, 4.2),
        (13, 44, 14, 4.6),
    ),
)
_BODY = (
    ((0, 127, 96), (25, 36, 27)),
    ((0, 97, 97), (26, 38, 24.5)),
    ((0, 62, 106), (25, 27, 23)),
    ((0, 154, 99), (20, 17, 20)),
    ((0, 132, 117), (12, 26, 11)),
)
NECK = (
    ((0, 136, 116, 13), (0, 158, 136, 10), (0, 176, 151, 8.5), (0, 191, 158, 8)),
    ((0, 152, 100, 15), (0, 170, 122, 10.5), (0, 186, 142, 8)),
)
_HEAD = ((0, 194, 157, 9.5), (0, 206, 146, 9), (0, 219, 132, 6.3), (0, 226, 124, 6.0))
MANE = ((0, 138, 126, 3), (0, 152, 140, 4), (0, 168, 155, 4), (0, 184, 166, 4), (0, 196, 168, 3), (0, 204, 163, 2))
TAIL = ((0, 40, 122, 4), (0, 31, 118, 5), (0, 24, 104, 6), (0, 20, 82, 6.5), (0, 17, 60, 5), (0, 15, 44, 2))


@cache
def scene() -> PhantomScene:
    """A horse in a box of 80 x 245 x 185 mm.

    Voxels of 1.5 mm. One blended body, then mane, tail, hooves and eyes.
    """
    flesh: list[Solid] = [Ellipsoid(_at(c), r) for c, r in _BODY]
    flesh += [_tube(line) for line in (*NECK, _HEAD, *_LEGS)]
    flesh += [Ellipsoid(_at((s * 4.5, 203, 146)), (5, 9, 10)) for s in (-1, 1)]
    flesh += [_tube(((s * 4.5, 194, 163, 3.2), (s * 6, 194, 170, 2.8), (s * 6, 195, 177, 0.8))) for s in (-1, 1)]
    parts = [
        Part(_tube(MANE), ((0.0, 120.0),)),
        Part(_tube(TAIL), ((0.0, 120.0),)),
        Part(Blend(tuple(flesh), 7.0), ((0.0, 175.0), (3.0, 150.0))),
    ]
    for leg in _LEGS:
        x, y, z, _ = leg[-1]
        hoof = _tube(((x, y, z, 4.2), (x, y + 3, z - 8, 6.5)))
        parts.append(Part(Both((hoof, Block((0.0, 0.0, GROUND), (80.0, 245.0, 13.0)))), ((0.0, 235.0),)))
    for s in (-1, 1):
        parts.append(Part(Ellipsoid(_at((s * 8.2, 207, 150)), (1.8, 2.4, 2.2)), ((0.0, 250.0),)))
        parts.append(Part(Ellipsoid(_at((s * 4.2, 229, 122)), (1.4, 1.8, 1.8)), ((0.0, 60.0),)))
    return PhantomScene("horse (phantom)", (80.0, 245.0, 185.0), (124, 164, 54), tuple(parts), texture=0.03, seed=6)


def _at(point: tuple[float, float, float]) -> Float3:
    return (_MIDDLE + point[0], float(point[1]), float(point[2]))


def _tube(line: tuple[tuple[float, float, float, float], ...]) -> Tube:
    return Tube(tuple(_at((x, y, z)) for x, y, z, _ in line), tuple(float(r) for *_, r in line))
