"""A human abdomen in the manner of a contrast CT, after figure 7: skin, fat, muscles, organs, spine, ribs and pelvis.

x runs from the patient's right to the left side (middle at 180), y from front to back, z from pelvis to ribs, in mm.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Float3
from deformnb.datasets.phantoms.scene import Part, PhantomScene
from deformnb.datasets.phantoms.shapes import Blend, Block, Both, Ellipsoid, Float32s, Loft, Shell, Solid, Tube, path

_LABELS = {
    3: "liver",
    4: "spleen",
    6: "pancreas",
    7: "aorta",
    8: "inferior vena cava",
    9: "colon and ileum",
    10: "gallbladder",
    13: "stomach and duodenum",
    32: "rectus abdominis muscle",
    51: "right kidney",
    52: "left kidney",
    131: "right psoas muscle",
    231: "left psoas muscle",
    137: "right erector spinae muscle",
    237: "left erector spinae muscle",
    299: "pelvis",
    412: "thoracic 12",
    411: "thoracic 11",
    501: "lumbar 1",
    502: "lumbar 2",
    503: "lumbar 3",
    504: "lumbar 4",
    505: "lumbar 5",
    600: "sacrum",
    690: "ribs",
}
"""Numbers of the SPL abdominal atlas, so that code written for one runs on the other."""

_LENGTHS = (360.0, 264.0, 330.0)
_MIDDLE = 180.0


@cache
def scene() -> PhantomScene:
    """An abdomen in a box of 360 x 264 x 330 mm.

    Voxels of 3 mm like the real scan's. Wall first, then bowel, organs, vessels and bones.
    """
    parts = (*_wall(), *_bowel(), *_organs(), *_vessels(), *_spine(), *_pelvis(), *_ribs())
    return PhantomScene(
        "abdomen (phantom)",
        _LENGTHS,
        (110, 88, 120),
        parts,
        texture=0.03,
        seed=7,
        noise=4.0,
        label_names={1: "other tissue", **_LABELS},
    )


def _torso() -> Loft:
    return Loft(
        "z",
        (
            (-10, _MIDDLE, 132, 166, 104),
            (40, _MIDDLE, 132, 165, 106),
            (110, _MIDDLE, 132, 152, 103),
            (170, _MIDDLE, 130, 148, 101),
            (240, _MIDDLE, 129, 150, 101),
            (340, _MIDDLE, 128, 152, 103),
        ),
    )


def _cavity() -> Loft:
    return Loft(
        "z",
        (
            (-10, _MIDDLE, 118, 122, 66),
            (60, _MIDDLE, 116, 122, 68),
            (170, _MIDDLE, 113, 122, 71),
            (240, _MIDDLE, 114, 126, 75),
            (340, _MIDDLE, 116, 126, 80),
        ),
    )


def _liver_texture(x: Float32s, y: Float32s, z: Float32s) -> Float32s:
    """Slightly mottled parenchyma."""
    mottle = np.sin(0.22 * x + np.sin(0.15 * z)) * np.sin(0.2 * y + 0.1 * z)
    return np.asarray(np.float32(116) + np.float32(2.5) * mottle)


def _wall() -> list[Part]:
    torso, cavity = _torso(), _cavity()
    parts = [
        Part(torso, ((0.0, 96.0), (2.2, 70.0)), 1),
        Part(cavity, ((-11.0, 103.0), (-6.5, 80.0), (-5.5, 104.0), (0.0, 68.0)), 1),
    ]
    for side, label in ((-1.0, 137), (1.0, 237)):
        rectus = Loft(
            "z",
            (
                (-10, _MIDDLE + side * 30, 47, 27, 7),
                (170, _MIDDLE + side * 32, 42, 30, 6.5),
                (340, _MIDDLE + side * 34, 36, 32, 6),
            ),
        )
        spinal = Loft(
            "z",
            (
                (-10, _MIDDLE + side * 34, 205, 30, 19),
                (120, _MIDDLE + side * 34, 200, 31, 20),
                (340, _MIDDLE + side * 30, 200, 30, 17),
            ),
        )
        gluteal = Loft(
            "z",
            (
                (-20, _MIDDLE + side * 88, 190, 58, 36),
                (40, _MIDDLE + side * 92, 178, 50, 34),
                (85, _MIDDLE + side * 100, 160, 20, 18),
            ),
        )
        psoas = Loft(
            "z",
            (
                (0, _MIDDLE + side * 62, 130, 16, 15),
                (80, _MIDDLE + side * 48, 150, 21, 20),
                (160, _MIDDLE + side * 38, 165, 15, 16),
                (225, _MIDDLE + side * 28, 170, 5, 6),
            ),
        )
        quadratus = Loft(
            "z",
            (
                (75, _MIDDLE + side * 74, 176, 18, 9),
                (150, _MIDDLE + side * 64, 180, 17, 8),
                (235, _MIDDLE + side * 56, 184, 9, 5),
            ),
        )
        deep = Shell(torso, 400.0, 9.0)
        parts += [
            Part(rectus, ((-1.0, 72.0), (0.5, 105.0)), 32),
            Part(Both((spinal, deep)), ((-1.5, 76.0), (0.5, 103.0)), label),
            Part(Both((gluteal, deep)), ((-1.5, 76.0), (0.5, 102.0)), 1),
            Part(quadratus, ((-1.0, 72.0), (0.5, 104.0)), 1),
            Part(psoas, ((-1.0, 72.0), (0.5, 106.0)), 131 if side < 0 else 231),
        ]
    return parts


def _bowel() -> list[Part]:
    """Coiled small bowel, then the frame of the colon with its bulges and gas."""
    t = np.linspace(0, 15 * np.pi, 150)
    coil = np.column_stack(
        [
            _MIDDLE + 66 * np.sin(t) * (1 - 0.15 * np.sin(0.37 * t)),
            92 + 28 * np.sin(0.73 * t + 1),
            160 - 2.5 * t + 12 * np.cos(t),
        ]
    )
    radii = 12.5 + 2.0 * np.sin(1.9 * t)
    parts = [Part(Tube(_points(coil), tuple(radii)), ((0.0, 112.0), (2.4, 96.0)), 9)]
    bubble = np.square(np.sin(2.3 * t)) > 0.86
    parts += [Part(Ellipsoid((p[0], p[1] - 3.5, p[2]), (5.0, 3.2, 5.0)), ((0.0, 6.0),), 9) for p in coil[bubble][::3]]
    frame = path(
        (
            (78, 116, 62),
            (70, 118, 110),
            (70, 110, 160),
            (82, 88, 190),
            (130, 62, 184),
            (180, 55, 176),
            (232, 62, 188),
            (280, 100, 222),
            (290, 128, 180),
            (290, 132, 120),
            (280, 124, 70),
            (240, 108, 44),
            (205, 120, 42),
            (184, 150, 28),
            (180, 162, 0),
            (180, 160, -14),
        ),
        120,
    )
    s = np.arange(120)
    colon = Tube(_points(frame), tuple(16.5 + 2.6 * np.sin(1.15 * s) - 4.0 * (s > 80)))
    parts.append(Part(colon, ((0.0, 110.0), (2.2, _contents)), 9))
    return parts + [
        Part(Ellipsoid((float(p[0]), float(p[1]) - 5, float(p[2])), (8.5, 6.0, 8.5)), ((0.0, 4.0),), 9)
        for p in frame[4:78:5]
    ]


def _contents(x: Float32s, y: Float32s, z: Float32s) -> Float32s:
    """Faeces: coarse and speckled with gas."""
    return np.asarray(np.float32(84) + np.float32(16) * np.sin(0.9 * x) * np.sin(0.8 * y + 0.4 * x) * np.sin(0.85 * z))


def _organs() -> list[Part]:
    liver: tuple[Solid, ...] = (
        Ellipsoid((112, 106, 272), (56, 66, 62)),
        Ellipsoid((108, 118, 222), (38, 46, 40)),
        Ellipsoid((186, 84, 286), (56, 34, 26)),
    )
    inside = Shell(_cavity(), 400.0, 2.5)
    stomach = Blend(
        (
            Ellipsoid((238, 116, 292), (34, 38, 34)),
            Tube(
                _smooth((238, 108, 285), (246, 84, 240), (218, 66, 212), (180, 72, 214), (158, 92, 224)),
                (30.0, 28.0, 26.0, 24.0, 22.0, 19.0, 17.0, 15.0, 13.0),
            ),
        ),
        10.0,
    )
    duodenum = Tube(
        _smooth((158, 92, 224), (140, 120, 220), (138, 134, 185), (165, 138, 165), (196, 134, 172)), (12.0,)
    )
    spleen = Both(
        (Ellipsoid((282, 158, 272), (22, 40, 46), ((0.88, 0.47, 0.0), (-0.47, 0.88, 0.0), (0.0, 0.0, 1.0))), inside),
        minus=(Ellipsoid((252, 140, 270), (18, 26, 30)),),
    )
    pancreas = Tube(
        _smooth((152, 116, 196), (172, 112, 206), (200, 118, 218), (232, 136, 232), (258, 150, 250)),
        (13.0, 12.5, 11.0, 10.0, 10.0, 9.5, 9.0, 8.0, 7.0),
    )
    gallbladder = Ellipsoid((122, 66, 212), (13, 16, 24), ((0.94, 0.0, 0.34), (0.0, 1.0, 0.0), (-0.34, 0.0, 0.94)))
    parts = [
        Part(pancreas, ((0.0, 108.0),), 6),
        Part(duodenum, ((0.0, 114.0), (2.6, 94.0)), 13),
        Part(stomach, ((0.0, 114.0), (3.6, 92.0)), 13),
        Part(Both((stomach, Block((100, 0, 190), (300, 86, 330)))), ((3.6, 5.0),), 13),
        Part(spleen, ((0.0, 124.0),), 4),
    ]
    for side, label in ((-1.0, 51), (1.0, 52)):
        lean = 0.16 * side
        axes = ((0.985, 0.0, lean), (0.0, 1.0, 0.0), (-lean, 0.0, 0.985))
        center = (_MIDDLE + side * 74, 158.0, 200.0 + 7 * side)
        hilum = Ellipsoid((center[0] - side * 30, center[1] - 6, center[2]), (17, 17, 20))
        kidney = Both((Ellipsoid(center, (30, 27, 56), axes),), minus=(hilum,))
        parts.append(Part(kidney, ((-1.0, 66.0), (0.0, 156.0), (8.0, 132.0)), label))
        for k in range(5):
            pyramid = (center[0] + side * 3.0 + lean * (k - 2) * 15, center[1], center[2] + 16.0 * (k - 2))
            parts.append(Part(Ellipsoid(pyramid, (8, 8, 5.5)), ((0.0, 112.0),), label))
        parts.append(
            Part(
                Ellipsoid((center[0] - side * 12, center[1] - 3, center[2]), (9, 8, 20)),
                ((0.0, 74.0), (3.0, 190.0)),
                label,
            )
        )
        parts.append(
            Part(
                Tube(
                    _smooth(
                        (center[0] - side * 16, 152, center[2] - 14),
                        (_MIDDLE + side * 46, 140, 120),
                        (_MIDDLE + side * 36, 140, 40),
                        (_MIDDLE + side * 22, 130, 0),
                    ),
                    (2.2,),
                ),
                ((0.0, 185.0),),
            )
        )
    parts += [
        Part(Both((Blend(liver, 22.0), inside)), ((0.0, _liver_texture),), 3),
        Part(gallbladder, ((0.0, 110.0), (1.8, 84.0)), 10),
    ]
    return [*parts, Part(Ellipsoid((180, 112, 4), (42, 34, 26)), ((0.0, 108.0), (4.0, 88.0)))]


def _vessels() -> list[Part]:
    aorta = Tube(
        _smooth((188, 152, 345), (190, 142, 250), (190, 136, 170), (186, 132, 120)),
        (11.5, 11.3, 11, 10.6, 10.2, 9.8, 9.4, 9.0, 8.6),
    )
    cava = Tube(
        _smooth((150, 138, 345), (158, 140, 250), (162, 138, 170), (166, 140, 112)),
        (13.0, 12.5, 12.0, 11.5, 11.0, 11.0, 10.5, 10.5, 10.0),
    )
    lines: list[tuple[tuple[Float3, ...], float, float]] = [
        (_smooth((190, 136, 236), (190, 112, 226), (186, 96, 180), (180, 92, 120)), 4.2, 168.0),
        # superior mesenteric artery
        (_smooth((190, 136, 250), (200, 120, 252), (236, 130, 252), (268, 150, 268)), 3.4, 168.0),  # splenic artery
        (_smooth((190, 136, 250), (170, 116, 250), (146, 106, 258)), 3.4, 165.0),  # hepatic artery
        (_smooth((176, 108, 200), (160, 108, 232), (136, 108, 262), (112, 108, 284)), 6.5, 138.0),  # portal vein
        (_smooth((150, 138, 300), (128, 116, 300), (104, 104, 300)), 5.0, 136.0),
        (_smooth((152, 136, 304), (170, 106, 300), (186, 88, 294)), 4.5, 136.0),
    ]
    for side in (-1.0, 1.0):
        lines += [
            (
                _smooth(
                    (188, 134, 124),
                    (_MIDDLE + side * 34, 134, 84),
                    (_MIDDLE + side * 60, 112, 30),
                    (_MIDDLE + side * 76, 84, -12),
                ),
                5.6,
                166.0,
            ),
            (
                _smooth(
                    (168, 140, 116),
                    (_MIDDLE + side * 34, 142, 80),
                    (_MIDDLE + side * 58, 120, 30),
                    (_MIDDLE + side * 72, 92, -12),
                ),
                6.2,
                132.0,
            ),
            (_smooth((188, 138, 206), (_MIDDLE + side * 40, 148, 203), (_MIDDLE + side * 58, 154, 200)), 3.4, 168.0),
        ]
    parts = [Part(Tube(line, (r,)), ((0.0, value),)) for line, r, value in lines]
    return [*parts, Part(cava, ((0.0, 132.0),), 8), Part(aorta, ((0.0, 168.0),), 7)]


def _spine() -> list[Part]:
    """Vertebrae from the tenth rib down to the sacrum: body, pedicles, arch, processes; discs between them."""
    parts = []
    levels = (
        (505, 92.0),
        (504, 127.0),
        (503, 162.0),
        (502, 197.0),
        (501, 231.0),
        (412, 263.0),
        (411, 293.0),
        (411, 321.0),
    )
    for label, z in levels:
        lordosis = 168.0 + 7.0 * np.cos((z - 235) / 70.0) - 3.0
        y, size = float(lordosis), 1.0 if label > 500 else 0.88
        parts.append(Part(Ellipsoid((_MIDDLE, y, z - 17.0), (22 * size, 16 * size, 7)), ((0.0, 112.0),)))
        bone = ((0.0, 205.0), (1.8, 146.0))
        body = Loft(
            "z",
            (
                (z - 12.5 * size, _MIDDLE, y, 24 * size, 17 * size),
                (z, _MIDDLE, y, 20.5 * size, 15 * size),
                (z + 12.5 * size, _MIDDLE, y, 24 * size, 17 * size),
            ),
        )
        arch: tuple[Solid, ...] = (
            Tube(((_MIDDLE, y + 34, z - 4), (_MIDDLE, y + 54 * size, z - 12)), (4.5, 5.5)),
            *(
                Tube(
                    ((_MIDDLE + s * 13, y + 12, z + 4), (_MIDDLE + s * 15, y + 24, z + 2), (_MIDDLE, y + 35, z - 3)),
                    (5.0, 5.5, 4.5),
                )
                for s in (-1, 1)
            ),
            *(
                Tube(((_MIDDLE + s * 15, y + 23, z + 2), (_MIDDLE + s * 44 * size, y + 26, z + 3)), (4.5, 3.2))
                for s in (-1, 1)
            ),
            *(
                Tube(((_MIDDLE + s * 16, y + 26, z + 14), (_MIDDLE + s * 14, y + 28, z - 19)), (5.0, 5.0))
                for s in (-1, 1)
            ),
        )
        parts += [Part(body, bone, label), Part(Blend(arch, 4.0), ((0.0, 200.0), (2.0, 150.0)), label)]
    canal = Tube(
        _smooth((_MIDDLE, 192, -5), (_MIDDLE, 194, 90), (_MIDDLE, 192, 160), (_MIDDLE, 196, 235), (_MIDDLE, 192, 345)),
        (8.0,),
    )
    return [*parts, Part(canal, ((0.0, 74.0), (2.2, 98.0)), 1)]


def _pelvis() -> list[Part]:
    """Two iliac wings, plates cut from a flaring bowl with a thick rim, and the wedge of the sacrum with its holes."""
    parts = []
    sacrum = Blend(
        (
            Loft(
                "z",
                (
                    (-10, _MIDDLE, 214, 18, 10),
                    (30, _MIDDLE, 206, 36, 15),
                    (62, _MIDDLE, 186, 50, 20),
                    (78, _MIDDLE, 172, 42, 20),
                ),
            ),
            Tube(((_MIDDLE, 222, 20), (_MIDDLE, 214, 66)), (5.0,)),
        ),
        6.0,
    )
    for side in (-1.0, 1.0):
        bowl = Shell(Ellipsoid((_MIDDLE + side * 30, 125, 150), (104, 90, 190)), 11.0)
        wing = Both(
            (
                bowl,
                Block(
                    (_MIDDLE + 52, 0, -10) if side > 0 else (0.0, 0, -10),
                    (360.0, 264, 120) if side > 0 else (_MIDDLE - 52, 264, 120),
                ),
                Ellipsoid((_MIDDLE + side * 105, 146, 18), (80, 66, 82)),
            )
        )
        # (y, z) of the crest; x follows from lying in the middle of the bowl's wall.
        rim = np.array(((186, 62), (177, 82), (160, 95), (136, 99), (112, 90), (94, 72), (87, 50)))
        out = 30 + 98.5 * np.sqrt(1 - ((rim[:, 0] - 125) / 84.5) ** 2 - ((rim[:, 1] - 150) / 184.5) ** 2)
        crest = np.column_stack([_MIDDLE + side * out, rim])
        socket = Ellipsoid((_MIDDLE + side * 108, 122, -6), (24, 24, 26))
        ilium = Blend((wing, Tube(_points(path(crest, 12)), (6.5,)), socket), 8.0)
        parts.append(Part(ilium, ((0.0, 210.0), (2.0, 142.0)), 299))
    parts.append(Part(sacrum, ((0.0, 200.0), (2.0, 140.0)), 600))
    for side in (-1.0, 1.0):
        holes = (
            Tube(
                ((_MIDDLE + side * (24 - 3 * k), 160, 52 - 17 * k), (_MIDDLE + side * (20 - 3 * k), 216, 48 - 17 * k)),
                (4.2,),
            )
            for k in range(3)
        )
        parts += [Part(hole, ((0.0, 80.0),)) for hole in holes]
    return parts


def _ribs() -> list[Part]:
    """Ribs eight to twelve: from the spine round the side, falling to the front; the last two end free."""
    parts = []
    for k, (z0, end) in enumerate(((262.0, 0.36), (294.0, 0.55), (322.0, 0.8), (352.0, 0.86), (382.0, 0.92))):
        t = np.linspace(0.0, end, 16)
        angle = np.pi * (0.93 * t + 0.04)
        x, y = 22 + 108 * np.sin(angle) ** 0.8, 122 + 66 * np.cos(angle)
        z = z0 - 96 * t + 18 * np.sin(np.pi * t)
        for side in (-1.0, 1.0):
            line = np.column_stack([_MIDDLE + side * x, y, z])
            parts.append(
                Part(
                    Tube(_points(line), tuple(np.linspace(5.0, 4.0 - 0.3 * (k < 2), 16))),
                    ((0.0, 198.0), (1.6, 138.0)),
                    690,
                )
            )
    return parts


def _smooth(*points: Float3) -> tuple[Float3, ...]:
    return _points(path(points, 9))


def _points(array: NDArray[np.float64]) -> tuple[Float3, ...]:
    return tuple((float(p[0]), float(p[1]), float(p[2])) for p in array)
