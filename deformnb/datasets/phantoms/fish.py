"""A carp, after the outline and the skeleton of the paper's own CT scan (figure 3).

The voxel axes are x across (symmetry plane at 50), y from tail to head, z from belly to back, in mm. Numbers were read
from the side picture of that scan. The grid has its box and, like its file, RAS axes: in space (LPS) the head points
towards -y. So both give the same picture under the same view, and take the same control points.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from deformnb.datasets.phantoms.scene import Part, PhantomScene, SolidValue
from deformnb.datasets.phantoms.shapes import (
    Blend,
    Both,
    Ellipsoid,
    Float32s,
    Loft,
    Sheet,
    Shell,
    Solid,
    Tube,
    path,
    smooth_curve,
)

Stroke = tuple[tuple[float, float], ...]

# Stations of the body: y, centre x, centre z, half width, half height.
_BODY = (
    (97.0, 50.0, 92.0, 2.5, 17.0),
    (105.0, 50.0, 91.0, 7.0, 23.0),
    (120.0, 50.0, 88.5, 11.5, 26.0),
    (135.0, 50.0, 88.5, 12.5, 28.0),
    (150.0, 50.0, 90.0, 14.5, 31.5),
    (165.0, 50.0, 91.0, 15.5, 37.0),
    (180.0, 50.0, 88.0, 17.0, 45.0),
    (210.0, 50.0, 88.0, 19.5, 55.0),
    (240.0, 50.0, 90.0, 22.5, 62.0),
    (270.0, 50.0, 92.5, 26.0, 66.5),
    (300.0, 50.0, 95.0, 30.5, 68.0),
    (330.0, 50.0, 97.5, 32.5, 70.0),
    (360.0, 50.0, 98.5, 34.5, 67.5),
    (375.0, 50.0, 99.0, 35.0, 63.0),
    (390.0, 50.0, 98.5, 35.0, 58.0),
    (405.0, 50.0, 96.0, 35.0, 52.0),
    (420.0, 50.0, 93.0, 34.5, 44.5),
    (435.0, 50.0, 90.5, 33.0, 38.5),
    (450.0, 50.0, 89.5, 30.5, 31.5),
    (465.0, 50.0, 88.5, 26.0, 26.0),
    (480.0, 50.0, 88.5, 21.0, 20.5),
    (495.0, 50.0, 92.0, 15.0, 13.5),
    (503.0, 50.0, 93.0, 9.5, 8.0),
    (507.0, 50.0, 93.5, 3.0, 3.0),
)
SPINE: Stroke = (
    (123.3, 88.3),
    (160, 91.7),
    (186.7, 95),
    (213.3, 99.3),
    (240, 105.7),
    (266.7, 113.3),
    (293.3, 120.7),
    (313.3, 125),
    (333.3, 126.7),
    (353.3, 124),
    (370, 120),
    (394, 117),
)
VERTEBRAE = 37

# Fins: outline, then the curves on which the fin rays start and end, then the strong first ray; all (y, z).
DORSAL: Stroke = (
    (131.7, 118),
    (146.7, 125.3),
    (166.7, 133.7),
    (186.7, 142),
    (206.7, 150.3),
    (226.7, 159.7),
    (235, 164),
    (237.3, 169.3),
    (246.7, 174.7),
    (256.7, 177),
    (266.7, 176.7),
    (283.3, 174.7),
    (300, 169.3),
    (310, 165.7),
    (315, 162),
    (290, 157),
    (266.7, 154),
    (233.3, 146.3),
    (200, 135.3),
    (166.7, 122.3),
)
DORSAL_BASE: Stroke = (
    (304, 161.7),
    (296.7, 160.3),
    (288.3, 159.7),
    (276.7, 158),
    (240, 151),
    (196.7, 138.3),
    (141.7, 120),
)
DORSAL_TIPS: Stroke = (
    (256.7, 176.3),
    (245, 173.7),
    (237.7, 168.3),
    (230, 161.3),
    (206.7, 150),
    (166.7, 133.3),
    (133.3, 118.7),
)
DORSAL_SPINE: Stroke = ((309.3, 162.7), (296.7, 169.7), (280, 174), (260, 176))
ANAL: Stroke = (
    (184, 44),
    (173.3, 39.3),
    (156.7, 39.7),
    (133.3, 43),
    (120, 45),
    (113.3, 51),
    (133.3, 57.5),
    (150, 60),
    (166.7, 57),
)
ANAL_BASE: Stroke = ((180, 45.3), (166.7, 51), (150, 56.7))
ANAL_TIPS: Stroke = ((130.7, 43.3), (120, 46), (114, 50.7))
ANAL_SPINE: Stroke = ((182.7, 43.7), (166.7, 41), (150, 42), (131.7, 44))
CAUDAL: Stroke = (
    (117.3, 105.3),
    (106.7, 112.7),
    (96.7, 117.3),
    (80, 121.7),
    (56.7, 123.7),
    (36.7, 121.7),
    (20, 116),
    (17.3, 110),
    (20, 101.7),
    (30, 95),
    (36.7, 88.3),
    (40.7, 84.7),
    (33.3, 78.3),
    (16.7, 71.7),
    (3.3, 56.7),
    (1, 45),
    (6.7, 40),
    (26.7, 39.3),
    (53.3, 41.7),
    (76.7, 48.3),
    (96.7, 58.3),
    (110, 67.3),
    (117.3, 74),
)
CAUDAL_UPPER: Stroke = ((36, 121), (20.7, 115.7), (18, 110), (20.7, 102.3), (29.3, 95.7), (38.3, 87.3))
CAUDAL_LOWER: Stroke = ((39.3, 83.3), (32.7, 78), (17.3, 71.3), (4.7, 57.3), (2, 45.7), (13.3, 40.5))

# Plates of the head, painted on the inside of the skin where it lies within these side outlines.
OPERCLE: Stroke = (
    (393.3, 122.7),
    (419.3, 119),
    (422.7, 100),
    (420.7, 76.7),
    (425, 60),
    (413.3, 61.7),
    (398.3, 85),
    (390.7, 103.3),
)
PREOPERCLE: Stroke = (
    (422.7, 115),
    (429.3, 114),
    (431.3, 90),
    (448.3, 68.3),
    (463.3, 66),
    (433.3, 56.7),
    (426, 66.7),
    (424, 93.3),
)
CHEEK: Stroke = (
    (433.3, 90),
    (445, 88.3),
    (450.7, 78.3),
    (466.7, 80),
    (475, 85),
    (475, 75),
    (463.3, 68.3),
    (448.3, 70.7),
    (435, 83.3),
)
ROOF: Stroke = (
    (396.7, 150),
    (423.3, 137),
    (450, 123),
    (476.7, 111),
    (493.3, 107),
    (493.3, 99.5),
    (473.3, 103.3),
    (446.7, 111),
    (423.3, 118.7),
    (398.3, 129),
)
CREST: Stroke = ((398.7, 144), (386.7, 153), (375, 152.3), (381, 144), (373.3, 133.3), (393.3, 129.7))
SHOULDER = ((82.0, 380.0, 121.7), (83.5, 381.0, 100.0), (80.0, 383.3, 80.0), (72.0, 390.7, 63.3), (57.0, 411.7, 53.3))


@cache
def scene() -> PhantomScene:
    """A carp-like fish in a box of 100 x 512 x 200 mm.

    The shape (256, 512, 256) has exactly the voxels of the real scan, the default half of them each way.
    """
    body = Loft("y", _BODY)
    parts = (
        *_fins(),
        Part(body, ((0.0, 96.0), (1.3, _muscle))),
        *_viscera(),
        *_spine(),
        *_ribs(),
        *_head(body),
        *_rays(),
        *_paired_fins(),
    )
    return PhantomScene(
        "carp (phantom)", (100.0, 512.0, 200.0), (128, 256, 128), parts, texture=0.03, seed=377, axes="RAS"
    )


def _muscle(x: Float32s, y: Float32s, z: Float32s) -> Float32s:
    """Myomeres: the W-shaped leaves of fish muscle, 9 mm apart, a few grey values of contrast."""
    fold = np.abs(np.abs(z - np.float32(95)) - np.float32(28))
    return np.asarray(80 + 2.5 * np.sin(np.float32(2 * np.pi / 9) * (y + np.float32(0.6) * fold)))


def _bone(value: float) -> Callable[[Float32s, Float32s, Float32s], Float32s]:
    """Head bone: no plate has one grey, CT shows pits and ridges of a few millimetres."""

    def paint(x: Float32s, y: Float32s, z: Float32s) -> Float32s:
        pits = np.sin(0.31 * y + 1.7 * np.sin(0.21 * z)) * np.sin(0.27 * z + 0.2 * x) + 0.4 * np.sin(0.9 * y - 0.7 * z)
        return np.asarray(np.float32(value) * (np.float32(0.87) + np.float32(0.1) * pits))

    return paint


def _gill_cover(x: Float32s, y: Float32s, z: Float32s) -> Float32s:
    """The opercle: ridges fanning out from its hinge at the upper front corner, brightest there."""
    dy, dz = y - np.float32(421), z - np.float32(120)
    ridges = np.sin(np.float32(34) * np.arctan2(dy, dz)) + 0.5 * np.sin(np.float32(0.55) * np.hypot(dy, dz))
    return np.asarray(np.float32(178) - np.float32(0.75) * np.hypot(dy, dz) + np.float32(12) * ridges + 0 * x)


def _side(line: Stroke, x: float = 50.0) -> tuple[tuple[float, float, float], ...]:
    return tuple((x, float(y), float(z)) for y, z in line)


def _points(array: NDArray[np.float64]) -> tuple[tuple[float, float, float], ...]:
    return tuple((float(p[0]), float(p[1]), float(p[2])) for p in array)


def _fins() -> list[Part]:
    return [
        Part(Sheet(tuple(outline), 1.6, (50.0, 0.0, 0.0)), ((0.0, value),))
        for outline, value in ((DORSAL, 80.0), (ANAL, 78.0), (CAUDAL, 78.0))
    ]


def _fan(base: Stroke, tips: Stroke, count: int, lift: float, radius: float, value: float) -> list[Part]:
    """Fin rays from the base curve to the tip curve, thinner outwards, bowed by ``lift`` in z."""
    parts = []
    for a, b in zip(path(_side(base), count), path(_side(tips), count), strict=True):
        middle = (a + b) / 2 + np.array([0.0, 0.0, lift])
        parts.append(
            Part(
                Tube(
                    _points(path([a, middle, b], 6)),
                    (radius, radius, 0.9 * radius, 0.7 * radius, 0.55 * radius, 0.4 * radius),
                ),
                ((0.0, value),),
            )
        )
    return parts


def _rays() -> list[Part]:
    parts = _fan(DORSAL_BASE, DORSAL_TIPS, 22, 2.0, 0.9, 125.0) + _fan(ANAL_BASE, ANAL_TIPS, 8, -0.5, 0.8, 118.0)
    upper: Stroke = ((113.0, 106.5), (104.0, 103.0), (101.0, 93.0))
    lower: Stroke = ((101.0, 87.0), (103.0, 78.0), (113.0, 71.0))
    parts += _fan(upper, CAUDAL_UPPER, 11, 3.0, 0.9, 122.0) + _fan(lower, CAUDAL_LOWER, 11, -3.0, 0.9, 122.0)
    for line in (DORSAL_SPINE, ANAL_SPINE):
        parts.append(
            Part(Tube(_points(path(_side(line), 9)), (1.3, 2.2, 2.4, 2.3, 2.2, 2.0, 1.7, 1.4, 0.8)), ((0.0, 225.0),))
        )
    # Pterygiophores: the bones inside the back that carry the rays, pointing forwards and down.
    for k, base in enumerate(path(_side(DORSAL_BASE), 20)):
        reach = np.array([0.0, 16.0 - 0.4 * k, -17.0 + 0.5 * k]) * (1.6 if k < 2 else 1.0)
        parts.append(Part(Tube(_points(np.array([base, base + reach])), (1.2 if k < 2 else 0.8, 0.4)), ((0.0, 140.0),)))
    for k, base in enumerate(path(_side(ANAL_BASE), 6)):
        reach = np.array([0.0, 32.0 - 3 * k, 27.0 - 3 * k]) * (1.35 if k == 0 else 1.0)
        parts.append(Part(Tube(_points(np.array([base, base + reach])), (1.6 if k < 2 else 0.8, 0.5)), ((0.0, 165.0),)))
    return parts


def _spine() -> list[Part]:
    """Hourglass vertebrae with a canal above, neural spines, and haemal spines behind the belly."""
    parts = []
    ends = path(_side(SPINE), VERTEBRAE + 1)
    for k, (a, b) in enumerate(pairwise(ends)):
        forward = (b - a) / np.linalg.norm(b - a)
        middle = (a + b) / 2
        wide = 2.5 + 1.1 * min(1.0, k / 16)
        parts.append(
            Part(
                Tube(_points(np.array([a + 1.6 * forward, middle, b - 1.6 * forward])), (wide, 0.55 * wide, wide)),
                ((0.0, 152.0), (1.4, 108.0)),
            )
        )
        back = min(1.0, (VERTEBRAE - k) / 14)  # spines lean back over the tail, stand up behind the head
        neural = np.array([[0.0, -1.0, 3.0], [0.0, -8.0 * back - 1, 12.0], [0.0, -23.0 * back, 24.0 + 0.12 * k]])
        if k > 1:
            long = min(1.0, 0.45 + k / 14)
            parts.append(
                Part(Tube(_points(path(middle + long * neural, 5)), (1.5, 1.0, 0.8, 0.6, 0.45)), ((0.0, 138.0),))
            )
        if 1 < k < 18:
            long = min(1.0, 0.5 + k / 14)
            haemal = np.array([[0.0, -1.0, -3.0], [0.0, -8.0, -12.0], [0.0, -22.0, -24.0]]) * long
            parts.append(Part(Tube(_points(path(middle + haemal, 5)), (1.4, 0.9, 0.75, 0.6, 0.45)), ((0.0, 135.0),)))
    for target in ((99.0, 103.0), (97.5, 96.0), (97.5, 88.0), (99.0, 80.0), (102.0, 73.0)):  # hypurals of the tail
        plate = np.array([[50.0, 124.0, 88.5], [50.0, 111.0, 0.4 * 88.5 + 0.6 * target[1]], [50.0, *target]])
        parts.append(Part(Tube(_points(plate), (1.4, 1.8, 2.4)), ((0.0, 142.0),)))
    return parts


def _ribs() -> list[Part]:
    """Fifteen pairs, hung from the spine, following the body wall just under the muscle."""
    stations = np.asarray(_BODY)
    parts = []
    for k in range(15):
        s = k / 14
        y0 = 363.0 - 112.0 * s
        z0 = float(smooth_curve(np.array(SPINE)[:, 0], np.array(SPINE)[:, 1], y0)) - 3.0
        sweep, drop = 18.0 + 34.0 * min(1.0, 1.5 * s), 70.0 - 22.0 * s**2
        t = np.linspace(0.0, 1.0, 9)
        y, z = y0 - sweep * t**1.3, z0 - drop * t
        cz, rx, rz = smooth_curve(stations[:, 0], stations[:, 2:], y).T
        wall = rx * np.sqrt(np.maximum(0.05, 1 - ((z - cz) / rz) ** 2)) - 5.5
        out = 3.0 + (wall - 3.0) * np.minimum(1.0, 2.6 * t) ** 0.8
        for side in (-1, 1):
            line = np.column_stack([50 + side * out, y, z])
            parts.append(Part(Tube(_points(line), tuple(1.35 - 0.8 * t)), ((0.0, 150.0 - 22.0 * s),)))
    return parts


def _viscera() -> list[Part]:
    """Swim bladder of two chambers (air), gut, liver and a few bubbles."""
    gut = Tube(
        ((50, 372, 82), (42, 340, 55), (57, 300, 46), (43, 262, 50), (55, 225, 52), (50, 192, 50)), (7, 8, 7.5, 7, 6, 4)
    )
    front = Loft(
        "y",
        (
            (277.0, 50.0, 104.0, 2.0, 3.0),
            (281.0, 50.0, 104.0, 12.0, 12.0),
            (292.0, 50.0, 101.0, 18.0, 18.5),
            (315.0, 50.0, 97.0, 21.5, 23.5),
            (340.0, 50.0, 98.0, 21.0, 21.0),
            (356.0, 50.0, 102.0, 17.0, 15.0),
            (363.0, 50.0, 103.0, 9.0, 9.0),
            (366.0, 50.0, 103.0, 2.0, 3.0),
        ),
    )
    rear = Loft(
        "y",
        (
            (228.0, 50.0, 83.5, 0.5, 0.5),
            (240.0, 50.0, 84.0, 3.5, 3.0),
            (254.0, 50.0, 86.5, 9.5, 9.0),
            (268.0, 50.0, 86.0, 11.0, 10.5),
            (280.0, 50.0, 83.0, 8.0, 7.0),
            (285.0, 50.0, 82.0, 2.0, 2.0),
        ),
    )
    duct = Tube(((50, 283, 82), (50, 290, 79), (50, 300, 77)), (1.2, 1.0, 0.8))
    return [
        Part(Ellipsoid((50, 350, 62), (24, 30, 20)), ((0.0, 87.0),)),
        Part(gut, ((0.0, 89.0), (2.2, 66.0))),
        Part(front, ((-1.2, 92.0), (0.0, 0.0))),
        Part(rear, ((-1.2, 90.0), (0.0, 0.0))),
        Part(duct, ((0.0, 30.0),)),
        Part(Ellipsoid((55, 256, 55), (2.5, 6, 2)), ((0.0, 25.0),)),
    ]


def _head(body: Solid) -> list[Part]:
    def plate(
        outline: Stroke, depth: float, thickness: float, value: SolidValue, minus: tuple[Solid, ...] = ()
    ) -> Part:
        return Part(
            Both((Sheet(outline, 99.0, (50.0, 0.0, 0.0)), Shell(body, thickness, depth)), minus), ((0.0, value),)
        )

    brain_case = Loft(
        "y",
        (
            (386.0, 50.0, 126.0, 5.0, 8.0),
            (398.0, 50.0, 126.0, 19.0, 14.0),
            (420.0, 50.0, 118.0, 19.0, 11.0),
            (445.0, 50.0, 109.0, 15.0, 7.0),
            (470.0, 50.0, 103.0, 11.0, 4.5),
            (488.0, 50.0, 100.0, 6.0, 3.0),
        ),
    )
    orbits = tuple(Ellipsoid((50.0 + s * 26.0, 457.0, 97.5), (12.0, 10.0, 9.0)) for s in (-1, 1))
    bars = (  # bones of the face, as seen from the side: hyomandibular, pterygoid, frontal edge, nasal, branchiostegals
        ((27, 424, 117), (29, 426, 100), (27, 430, 84), (22, 446, 70)),
        ((24, 428, 84), (22, 445, 84), (17, 466, 88)),
        ((19, 428, 119), (23, 445, 112), (19, 468, 106)),
        ((9, 470, 107), (9, 484, 104), (7, 494, 101)),
        ((16, 428, 60), (20, 412, 56), (18, 400, 57)),
        ((20, 430, 62), (25, 412, 59), (23, 398, 61)),
    )
    parts = [
        Part(brain_case, ((0.0, _bone(150.0)), (1.8, 72.0))),
        Part(
            Tube(((50, 395, 112), (50, 420, 101), (50, 445, 99.5), (50, 482, 100)), (3.0, 2.4, 1.8, 1.4)),
            ((0.0, 172.0),),
        ),
        Part(Sheet(CREST, 2.4, (50.0, 0.0, 0.0)), ((0.0, _bone(150.0)),)),
        Part(
            Loft(
                "y",
                (
                    (402.0, 50.0, 84.0, 8.0, 2.0),
                    (430.0, 50.0, 88.0, 16.0, 4.0),
                    (470.0, 50.0, 89.0, 13.0, 2.4),
                    (500.0, 50.0, 91.0, 7.0, 1.4),
                    (508.0, 50.0, 91.5, 5.0, 1.0),
                ),
            ),
            ((0.0, 0.0),),
        ),
        plate(ROOF, 1.8, 2.6, _bone(150.0), orbits),
        plate(OPERCLE, 1.6, 2.2, _gill_cover),
        plate(PREOPERCLE, 1.8, 2.6, _bone(168.0)),
        plate(CHEEK, 2.0, 2.0, _bone(150.0), orbits),
    ]
    for side in (-1.0, 1.0):
        parts += [*_eye(50 + side * 25.0), *_jaws(side), *_gills(side)]
        for bar in bars:
            line = np.array([(50 + side * x, y, z) for x, y, z in bar], dtype=np.float64)
            parts.append(Part(Tube(_points(path(line, 6)), (1.3, 1.6, 1.8, 1.8, 1.5, 1.1)), ((0.0, _bone(175.0)),)))
        shoulder = np.array([(50 + side * (x - 50), y, z) for x, y, z in SHOULDER])
        parts.append(Part(Tube(_points(path(shoulder, 8)), (2.0, 2.2, 2.6, 2.8, 2.8, 2.6, 2.4, 1.8)), ((0.0, 182.0),)))
    return parts


def _eye(x: float) -> list[Part]:
    turn = np.linspace(0, 2 * np.pi, 17)
    ring = np.column_stack(
        [np.full(17, x + np.sign(x - 50) * 0.5), 457 + 11.5 * np.cos(turn), 97.5 + 10.0 * np.sin(turn)]
    )
    return [
        Part(Ellipsoid((x, 457.0, 97.5), (9.5, 9.5, 8.5)), ((0.0, 90.0), (1.0, 62.0))),
        Part(Ellipsoid((x + np.sign(x - 50) * 3.0, 457.0, 98.0), (3.2, 3.6, 3.6)), ((0.0, 165.0),)),
        Part(Tube(_points(ring), (1.1,)), ((0.0, 150.0),)),
    ]


def _jaws(side: float) -> list[Part]:
    """Upper and lower jaw, the quadrate they hinge on, pharyngeal teeth and an ear stone."""

    def at(*points: tuple[float, float, float]) -> tuple[tuple[float, float, float], ...]:
        return tuple((50 + side * x, y, z) for x, y, z in points)

    bones = (
        (at((13, 478, 99), (8, 492, 98.5), (2, 502, 95.5)), (1.6, 2.2, 2.4), 178.0),
        (at((13, 478, 99), (12, 484, 90), (11, 485, 84)), (1.4, 2.0, 1.4), 165.0),
        (at((17, 462, 69), (13, 477, 75), (7, 491, 82), (1.5, 499, 86)), (2.2, 3.2, 3.0, 2.6), 172.0),
        (at((20, 447, 68), (18, 460, 69)), (3.0, 2.4), 160.0),
        (at((15, 420, 62), (10, 440, 64), (5, 462, 70)), (1.5, 2.2, 1.4), 140.0),
    )
    parts = [Part(Tube(points, radii), ((0.0, value),)) for points, radii, value in bones]
    teeth = ((50 + side * (5 + 1.5 * k), 384.0 + 1.5 * k, 97.0 - 2.6 * k) for k in range(4))
    parts += [Part(Ellipsoid(tooth, (2.4, 2.4, 2.0)), ((0.0, 240.0),)) for tooth in teeth]
    parts.append(Part(Ellipsoid((50 + side * 9.0, 402.0, 118.0), (1.6, 2.4, 2.0)), ((0.0, 250.0),)))
    return parts


def _gills(side: float) -> list[Part]:
    """Four arches with water-filled clefts (air in a scanned, dead fish) between them and the gill cover."""
    parts = [
        Part(Ellipsoid((50 + side * 25.5, 403.0 + 7 * k, 88.0), (1.7, 2.6, 20.0 - 2 * k)), ((0.0, 8.0),))
        for k in range(3)
    ]
    for k in range(4):
        y = 398.0 + 8.5 * k
        arch = np.array([[8.0, y - 3, 110.0 - 2 * k], [20.0, y, 99.0], [21.0, y + 1, 82.0], [9.0, y + 9, 66.0]])
        arch[:, 0] = 50 + side * arch[:, 0]
        parts.append(Part(Tube(_points(path(arch, 8)), (1.3,)), ((0.0, 138.0),)))
    return parts


def _paired_fins() -> list[Part]:
    """Pectoral fins behind the gill covers and pelvic fins under the belly, each a tilted fan with rays."""
    fans = (
        ((26.0, 388.0, 56.0), (0.12, -0.93, -0.35), (0.55, 0.30, -0.60), 66.0, 16.0, 13),
        ((9.0, 301.0, 29.0), (0.22, -0.97, -0.03), (0.85, 0.15, -0.35), 62.0, 13.0, 9),
    )
    parts = []
    for origin, along, across, length, spread, rays in fans:
        u = np.asarray(along) / np.linalg.norm(along)
        v = np.asarray(across) - (np.asarray(across) @ u) * u
        v /= np.linalg.norm(v)
        rim = [
            (length * (0.8 + 0.2 * np.cos(2.2 * (s - 0.4))), -0.55 * spread + 1.55 * spread * s)
            for s in np.linspace(0, 1, 9)
        ]
        outline = ((0.0, -3.0), *((float(a), float(b)) for a, b in rim), (0.0, 3.0))
        for side in (-1.0, 1.0):
            mirror = np.array([side, 1.0, 1.0])
            o, us, vs = np.array([50.0, 0, 0]) + np.asarray(origin) * mirror, u * mirror, v * mirror
            parts.append(Part(Sheet(outline, 1.6, *_points(np.array([o, us, vs]))), ((0.0, 84.0),)))
            for a, b in path([(*p, 0.0) for p in rim], rays)[:, :2]:
                base = o + vs * (2.5 * (2 * (b + 0.55 * spread) / (1.55 * spread) - 1))
                parts.append(
                    Part(Tube(_points(np.array([base, o + 0.96 * a * us + b * vs])), (0.9, 0.45)), ((0.0, 125.0),))
                )
            root = np.array([base, base + np.array([-side * 8.0, 26.0, 4.0])])
            parts.append(
                Part(
                    Blend((Tube(_points(root), (2.6, 1.6)), Ellipsoid(_points(root)[0], (3.5, 3.5, 3.0))), 3.0),
                    ((0.0, 150.0),),
                )
            )
    return parts
