"""A straight right knee, after figure 4: four bones with cortical shell and spongy inside, muscles, fat and skin.

x runs from the outer (fibular) to the inner side, y from the kneecap to the hollow of the knee, z up the leg, in mm.
There is room behind the leg, so that a bent lower leg is inside the box.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from deformnb._typing import Float3
from deformnb.datasets.phantoms.scene import Part, PhantomScene
from deformnb.datasets.phantoms.shapes import Blend, Both, Ellipsoid, Float32s, Loft, Shell, Solid, Tube, path

_LABELS = {
    95: "femur",
    96: "tibia",
    97: "fibula",
    98: "patella",
    12: "vastus lateralis",
    13: "vastus medialis",
    15: "biceps femoris",
    16: "semimembranosus",
    20: "medial gastrocnemius",
    21: "lateral gastrocnemius",
    24: "tibialis anterior",
    35: "patellar ligament",
    71: "popliteal artery",
}
"""Numbers of the SPL knee atlas, so that code written for one runs on the other."""

_LENGTHS = (130.0, 190.0, 300.0)


@cache
def scene() -> PhantomScene:
    """A knee in a box of 130 x 190 x 300 mm.

    Voxels of 1.5 mm. Skin and fat, muscles, vessels, ligaments, then the bones.
    """
    parts = (*_flesh(), *_joint(), *_bones())
    return PhantomScene(
        "knee (phantom)",
        _LENGTHS,
        (200, 127, 87),
        parts,
        texture=0.04,
        seed=4,
        label_names={1: "other tissue", **_LABELS},
    )


def _spongy(x: Float32s, y: Float32s, z: Float32s) -> Float32s:
    """Trabecular bone: a fine lattice, denser towards the joint at z = 132."""
    near = np.exp(-np.square((z - np.float32(132)) / np.float32(45)))
    net = np.sin(1.1 * x + 0.4 * z + 0.9 * np.sin(0.5 * y)) * np.sin(0.9 * z - 0.3 * x)
    net = net + np.sin(1.0 * y - 0.5 * x + np.sin(0.6 * z))
    return np.asarray(np.float32(112) + np.float32(30) * near + np.float32(4) * net)


def _cortical(x: Float32s, y: Float32s, z: Float32s) -> Float32s:
    """Compact bone: thick and dense in the shafts, thin and paler round the joint."""
    near = np.exp(-np.square((z - np.float32(138)) / np.float32(48)))
    patches = np.sin(0.21 * x + 0.8 * np.sin(0.13 * z)) * np.sin(0.17 * z + 0.15 * y)
    return np.asarray(np.float32(236) - np.float32(52) * near + np.float32(9) * patches)


def _skin() -> Loft:
    return Loft(
        "z",
        (
            (-5, 66, 78, 42, 43),
            (50, 66, 82, 46, 49),
            (90, 65, 77, 47, 47),
            (115, 65, 70, 47, 47),
            (140, 65, 65, 49, 48),
            (165, 65, 64, 50, 51),
            (195, 65, 66, 51, 49),
            (240, 65, 69, 55, 53),
            (305, 65, 72, 59, 59),
        ),
    )


def _flesh() -> list[Part]:
    muscles: tuple[tuple[int, Loft], ...] = (
        (12, Loft("z", ((182, 42, 48, 3, 3), (200, 38, 48, 12, 13), (240, 36, 52, 17, 20), (305, 36, 54, 20, 25)))),
        (13, Loft("z", ((168, 88, 46, 3, 3), (188, 90, 48, 11, 13), (220, 90, 52, 14, 18), (305, 90, 54, 16, 22)))),
        (1, Loft("z", ((190, 65, 29, 9, 3), (225, 65, 33, 17, 9), (305, 64, 36, 22, 13)))),
        (15, Loft("z", ((116, 31, 86, 3, 3), (150, 33, 92, 8, 10), (220, 40, 98, 14, 15), (305, 46, 102, 18, 19)))),
        (16, Loft("z", ((118, 92, 88, 3, 3), (150, 93, 92, 8, 10), (220, 86, 99, 15, 15), (305, 84, 103, 19, 18)))),
        (
            20,
            Loft(
                "z",
                (
                    (-5, 80, 104, 14, 13),
                    (50, 82, 108, 17, 15),
                    (100, 82, 101, 14, 11),
                    (140, 80, 96, 9, 7),
                    (158, 80, 92, 2, 2),
                ),
            ),
        ),
        (
            21,
            Loft(
                "z",
                (
                    (-5, 52, 106, 13, 12),
                    (50, 51, 110, 15, 14),
                    (100, 51, 102, 12, 10),
                    (140, 51, 97, 8, 6),
                    (158, 51, 92, 2, 2),
                ),
            ),
        ),
        (1, Loft("z", ((-5, 62, 90, 24, 9), (60, 61, 92, 24, 9), (100, 56, 88, 14, 7), (118, 50, 86, 3, 2)))),
        (24, Loft("z", ((-5, 44, 54, 14, 12), (60, 44, 56, 15, 12), (95, 43, 54, 10, 8), (112, 42, 52, 2, 2)))),
        (1, Loft("z", ((-5, 28, 70, 7, 12), (60, 26, 71, 7, 12), (95, 27, 72, 5, 8), (108, 29, 74, 2, 2)))),
    )
    parts = [Part(_skin(), ((0.0, 98.0), (1.8, 60.0)), 1)]
    inside = Shell(_skin(), 200.0, 4.0)  # everything deeper than 4 mm, so that no muscle bulges through
    parts += [Part(Both((solid, inside)), ((-0.6, 84.0), (0.4, _muscle)), label) for label, solid in muscles]
    artery = Tube(((68, 90, 305), (66, 98, 220), (65, 98, 150), (64, 96, 110), (62, 88, 60), (60, 84, -5)), (3.2,))
    vein = Tube(((73, 93, 305), (71, 102, 220), (70, 102, 150), (68, 100, 110), (66, 91, 60), (64, 88, -5)), (4.0,))
    return [*parts, Part(vein, ((0.0, 108.0),)), Part(artery, ((0.0, 140.0),), 71)]


def _muscle(x: Float32s, y: Float32s, z: Float32s) -> Float32s:
    """Bundles running along the leg, a few grey values apart."""
    return np.asarray(np.float32(102) + np.float32(3) * np.sin(0.9 * x + 0.03 * z) * np.sin(0.8 * y - 0.02 * z))


def _joint() -> list[Part]:
    ligament = Loft("z", ((100, 64, 39, 9, 3), (125, 65, 31, 12, 3), (150, 65, 24, 14, 4)))
    tendon = Loft("z", ((180, 65, 24, 15, 4), (200, 65, 26, 14, 4), (232, 65, 34, 9, 3)))
    parts = [
        Part(Ellipsoid((65, 36, 136), (22, 12, 13)), ((0.0, 64.0),)),
        Part(ligament, ((0.0, 122.0),), 35),
        Part(tendon, ((0.0, 120.0),)),
    ]
    for middle in (46.0, 84.0):  # menisci: open rings on the tibia
        turn = np.linspace(0.25 * np.pi, 1.75 * np.pi, 13) + (np.pi if middle < 65 else 0.0)
        ring = [(middle - 13 * np.cos(t), 68 + 17 * np.sin(t), 132.3) for t in turn]
        parts.append(Part(Tube(tuple(ring), (3.2,)), ((0.0, 118.0),)))
    cords: tuple[tuple[Float3, ...], ...] = (
        ((72, 60, 131), (56, 80, 148)),
        ((62, 88, 128), (74, 66, 145)),
        ((31, 72, 158), (28, 84, 110)),
        ((101, 70, 158), (96, 62, 95)),
    )
    return parts + [Part(Tube(cord, (2.6,)), ((0.0, 116.0),)) for cord in cords]


def _bones() -> list[Part]:
    shaft = Tube(((65, 62, 310), (65, 62, 215), (65, 63, 185), (65, 64, 168)), (13.5, 13.5, 17.5, 21.0))
    # The trochlea joins the condyles in front; the notch between them is cut out from behind and below.
    condyles: tuple[Solid, ...] = (
        Ellipsoid((85, 70, 156), (15, 28, 23)),
        Ellipsoid((45, 70, 156), (15, 28, 22.5)),
        Ellipsoid((65, 54, 160), (25, 16, 18)),
    )
    femur = Both((Blend((shaft, *condyles), 10.0),), minus=(Ellipsoid((65, 88, 142), (8.0, 27, 20)),))
    plateau = Loft(
        "z",
        (
            (-10, 66, 66, 12.5, 13.5),
            (45, 66, 66, 13, 14),
            (85, 66, 67, 17, 17.5),
            (108, 65, 67, 29, 23),
            (121, 65, 68, 38, 26),
            (128, 65, 68, 38.5, 26.5),
            (131.5, 65, 68, 36, 24),
        ),
    )
    tibia = Blend(
        (
            plateau,
            Ellipsoid((63, 46, 101), (8, 7, 13)),
            Ellipsoid((60, 69, 131), (3, 6, 4)),
            Ellipsoid((70, 69, 131), (3, 6, 4)),
        ),
        5.0,
    )
    fibula = Blend(
        (
            Tube(_line((30, 84, -10), (29, 86, 45), (30, 87, 90), (31, 86, 107)), (6.0,)),
            Ellipsoid((31, 86, 112), (9.5, 10.5, 10)),
        ),
        5.0,
    )
    patella = Blend((Ellipsoid((65, 27, 168), (22, 10.5, 17)), Ellipsoid((65, 25, 156), (11, 8, 12))), 6.0)
    bone = ((-0.8, 120.0), (0.0, _cortical), (2.2, _spongy))
    marrow = ((0.0, 150.0), (0.8, 82.0))
    return [
        Part(femur, bone, 95),
        Part(Tube(((65, 62, 310), (65, 62, 222), (65, 63, 205)), (8.0, 8.0, 3.0)), marrow, 95),
        Part(tibia, bone, 96),
        Part(Tube(((66, 66, -10), (66, 66, 55), (66, 66, 72)), (7.5, 7.5, 3.0)), marrow, 96),
        Part(fibula, bone, 97),
        Part(Tube(((30, 84, -10), (29, 86, 45), (30, 87, 80)), (2.6,)), marrow, 97),
        Part(patella, bone, 98),
    ]


def _line(*points: Float3) -> tuple[Float3, ...]:
    return tuple((float(a), float(b), float(c)) for a, b, c in path(points, 9))
