"""A human head in the manner of a CT, after figure 6 (a, b): skin, skull, teeth, brain, airways and neck.

x runs from the patient's right to the left side (middle at 92), y from nose to occiput, z upwards, in mm.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from deformnb._typing import Float3
from deformnb.datasets.phantoms.scene import Part, PhantomScene
from deformnb.datasets.phantoms.shapes import (
    Blend,
    Block,
    Both,
    Ellipsoid,
    Float32s,
    Loft,
    Sheet,
    Shell,
    Solid,
    Tube,
    path,
)

_LENGTHS = (184.0, 250.0, 228.0)
_MIDDLE = 92.0


@cache
def scene() -> PhantomScene:
    """A head and neck in a box of 184 x 250 x 228 mm.

    Voxels of 1.5 mm. From the skin inwards, then the face, the teeth and the neck.
    """
    parts = (*_skin(), *_neck(), *_skull(), *_brain(), *_face(), *_jaw(), *_teeth(), *_airway())
    return PhantomScene("head (phantom)", _LENGTHS, (152, 167, 123), parts, texture=0.02, seed=3)


def _vault(grow: float = 0.0) -> tuple[Solid, ...]:
    """The outside of the brain case, ``grow`` mm larger: cerebrum, cerebellum and the two temporal lobes."""
    temples = _pair((41.0, 120.0, 122.0), (26.0 + grow, 31.0 + grow, 25.0 + grow))
    return (
        *temples,
        Ellipsoid((_MIDDLE, 147, 157), (72 + grow, 87 + grow, 60 + grow)),
        Ellipsoid((_MIDDLE, 188, 112), (54 + grow, 44 + grow, 38 + grow)),
    )


def _both(*points: Float3) -> list[tuple[Float3, ...]]:
    """A smooth line (x from the middle, y, z) and its mirror image."""
    smooth = path(points, 9)
    return [tuple((_MIDDLE + side * float(x), float(y), float(z)) for x, y, z in smooth) for side in (-1.0, 1.0)]


def _pair(center: Float3, radii: Float3) -> list[Solid]:
    return [Ellipsoid((_MIDDLE + side * center[0], center[1], center[2]), radii) for side in (-1.0, 1.0)]


def _skin() -> list[Part]:
    throat = Loft(
        "z",
        (
            (-10, _MIDDLE, 142, 54, 56),
            (20, _MIDDLE, 145, 53, 56),
            (60, _MIDDLE, 150, 56, 58),
            (100, _MIDDLE, 150, 62, 66),
        ),
    )
    flesh: list[Solid] = [
        *_vault(5.5),
        throat,
        Ellipsoid((_MIDDLE, 96, 100), (62, 54, 56)),
        Ellipsoid((_MIDDLE, 92, 62), (52, 46, 34)),
        Ellipsoid((_MIDDLE, 62, 38), (26, 20, 18)),
        Ellipsoid((_MIDDLE, 44, 76), (24, 13, 13)),
        Tube(((_MIDDLE, 58, 143), (_MIDDLE, 40, 124), (_MIDDLE, 22, 112)), (7.0, 8.0, 8.5)),
        *_pair((10.0, 32.0, 106.0), (7.5, 9.5, 7.5)),
        Tube(((_MIDDLE - 44, 76, 146), (_MIDDLE, 62, 148), (_MIDDLE + 44, 76, 146)), (10.0,)),
    ]
    parts = []
    for side in (-1.0, 1.0):
        out, up = np.array([side * 0.42, 0.9, 0.1]), np.array([side * 0.12, 0.12, 0.98])
        across = np.cross(out, up)
        axes = [tuple(float(c) for c in v / np.linalg.norm(v)) for v in (across, np.cross(up, across), up)]
        ear = Ellipsoid((_MIDDLE + side * 76.0, 143, 116), (3.6, 17, 31), (axes[0], axes[1], axes[2]))  # type: ignore[arg-type]
        lobe = Tube(((_MIDDLE + side * 73, 138, 96), (_MIDDLE + side * 74, 139, 86)), (5.0, 4.0))
        rim = [
            (_MIDDLE + side * (79 + 4 * np.sin(t)), 146 - 14 * np.cos(t + 0.5), 119 + 27 * np.sin(t + 0.2))
            for t in np.linspace(0.3, 4.0, 12)
        ]
        parts.append(Part(Blend((ear, lobe, Tube(tuple(rim), (2.6,))), 4.0), ((0.0, 92.0),)))
    return [*parts, Part(Blend(tuple(flesh), 12.0), ((0.0, 98.0), (2.0, 70.0), (5.0, _flesh)))]


def _flesh(x: Float32s, y: Float32s, z: Float32s) -> Float32s:
    """Muscle with fat between its bundles."""
    bundles = np.sin(0.28 * x + 0.8 * np.sin(0.13 * z)) * np.sin(0.25 * y + 0.11 * z)
    return np.asarray(np.float32(95) + np.float32(9) * bundles)


def _neck() -> list[Part]:
    """Six vertebrae and the tooth of the second, cord, muscles of the nape, vessels."""
    parts = [
        Part(Tube(line, (13.0,)), ((-1.2, 74.0), (0.0, 103.0)))
        for line in _both((16, 188, -10), (18, 188, 40), (22, 192, 82))
    ]
    parts += [
        Part(Tube(line, (11.0,)), ((-1.2, 74.0), (0.0, 104.0)))
        for line in _both((30, 112, -10), (40, 128, 30), (56, 150, 76))
    ]
    parts += [Part(Tube(line, (4.5,)), ((0.0, 132.0),)) for line in _both((30, 128, -10), (30, 130, 30), (32, 134, 90))]
    for k, z in enumerate((70.0, 53.0, 36.0, 19.0, 2.0, -15.0)):
        y = 150.0 + 3.0 * np.sin(0.9 * k)
        solids: list[Solid] = [
            Loft("z", ((z - 6.5, _MIDDLE, y, 12, 9.5), (z, _MIDDLE, y, 10.5, 8.5), (z + 6.5, _MIDDLE, y, 12, 9.5))),
            Tube(((_MIDDLE, y + 27, z - 2), (_MIDDLE, y + (24 if k == 0 else 44), z - 9)), (3.5, 4.5)),
        ]
        for s in (-1, 1):
            solids += [
                Tube(
                    ((_MIDDLE + s * 9, y + 5, z), (_MIDDLE + s * 18, y + 12, z), (_MIDDLE, y + 28, z - 2)),
                    (4.0, 4.5, 3.6),
                ),
                Tube(
                    ((_MIDDLE + s * 10, y + 2, z - 2), (_MIDDLE + s * (36 if k == 0 else 24), y + 4, z - 2)), (4.5, 3.5)
                ),
            ]
        parts.append(Part(Blend(tuple(solids), 3.0), ((0.0, 205.0), (1.6, 148.0))))
    parts.append(Part(Tube(((_MIDDLE, 150, 55), (_MIDDLE, 146, 84)), (5.5, 4.0)), ((0.0, 205.0), (1.6, 155.0))))
    cord = tuple((_MIDDLE, float(y), float(z)) for y, z in ((164, -10), (166, 40), (164, 80), (160, 100)))
    return [*parts, Part(Tube(cord, (7.5, 7.5, 8.0, 9.0)), ((0.0, 86.0), (3.0, 104.0)))]


def _skull() -> list[Part]:
    """Outer table, spongy diploe, inner table; then water and cortex inside, all from one distance."""
    ridge = Blend(
        (
            Tube(
                (
                    (_MIDDLE - 48, 84, 140),
                    (_MIDDLE - 24, 69, 146),
                    (_MIDDLE, 66, 145),
                    (_MIDDLE + 24, 69, 146),
                    (_MIDDLE + 48, 84, 140),
                ),
                (6.0,),
            ),
            *(Ellipsoid((_MIDDLE + s * 52, 152, 84), (10, 14, 17)) for s in (-1, 1)),
            Ellipsoid((_MIDDLE, 224, 112), (16, 8, 8)),
        ),
        8.0,
    )
    parts = [Part(ridge, ((0.0, 212.0), (2.0, 160.0)))]
    parts.append(Part(Blend(_vault(), 24.0), ((0.0, _table), (2.6, 165.0), (4.6, _table), (6.6, 84.0), (8.4, _cortex))))
    parts += [Part(mastoid, ((0.0, _cells),)) for mastoid in _pair((52.0, 153.0, 82.0), (7.0, 10.0, 12.0))]
    petrous = _both((55, 145, 104), (42, 140, 106), (20, 122, 108))
    parts += [
        Part(Tube(line, (11.0, 11.0, 11.0, 10.0, 10.0, 9.0, 8.0, 6.0, 4.0)), ((0.0, 205.0), (3.0, 240.0)))
        for line in petrous
    ]
    parts += [
        Part(Tube(line, (5.0, 4.0, 3.5, 3.0, 3.0, 3.0, 3.0, 4.0, 4.0)), ((0.0, 0.0),))
        for line in _both((84, 142, 107), (66, 141, 106), (48, 139, 106))
    ]
    # The floor of the skull in front: roof of the orbits and of the nose, the saddle with the pituitary.
    floor = Loft(
        "y",
        (
            (66, _MIDDLE, 138, 26, 5),
            (84, _MIDDLE, 124, 42, 5),
            (104, _MIDDLE, 114, 50, 4.5),
            (124, _MIDDLE, 106, 36, 6),
            (142, _MIDDLE, 98, 18, 6),
        ),
    )
    return [
        *parts,
        Part(floor, ((0.0, 205.0), (2.2, 150.0))),
        Part(Ellipsoid((_MIDDLE, 122, 112), (7, 6, 5)), ((0.0, 110.0),)),
    ]


def _table(x: Float32s, y: Float32s, z: Float32s) -> Float32s:
    """Compact bone of the vault: thinner and paler at the temples and between the vessels' grooves."""
    dy, dz = (y - np.float32(112)) / np.float32(34), (z - np.float32(128)) / np.float32(26)
    temple = np.exp(-np.square(dy) - np.square(dz))
    groove = np.sin(0.07 * y + 1.9 * np.sin(0.045 * z)) * np.sin(0.06 * z + 0.03 * x + 0.8)
    return np.asarray(np.float32(216) - np.float32(34) * temple + np.float32(12) * groove)


def _cells(x: Float32s, y: Float32s, z: Float32s) -> Float32s:
    return np.asarray(np.float32(100) + np.float32(85) * np.sin(1.3 * x) * np.sin(1.1 * y + 0.5 * z) * np.sin(1.2 * z))


def _cortex(x: Float32s, y: Float32s, z: Float32s) -> Float32s:
    """Grey matter with water in the folds: level lines of a modulated sine, not straight stripes."""
    a = 0.34 * x + 1.6 * np.sin(0.11 * y + 0.07 * z)
    b = 0.3 * z + 1.4 * np.sin(0.13 * y - 0.05 * x)
    fold = np.sin(a) * np.cos(b) + np.sin(0.31 * y + 1.2 * np.sin(0.1 * z) + 0.9 * np.sin(0.09 * x))
    return np.asarray(np.float32(108) - np.float32(17) * np.exp(-np.square(fold / np.float32(0.22))))


def _brain() -> list[Part]:
    """White matter, nuclei, ventricles, falx and tent, cerebellum with its leaves, brain stem."""
    parts: list[Part] = []
    for s in (-1.0, 1.0):
        hemisphere = Ellipsoid((_MIDDLE + s * 30, 146, 160), (25, 62, 34))
        parts += [
            Part(hemisphere, ((-4.0, 106.0), (0.0, 100.0))),
            Part(Ellipsoid((_MIDDLE + s * 16, 138, 150), (8, 15, 9)), ((0.0, 107.0),)),
            Part(Ellipsoid((_MIDDLE + s * 42, 120, 126), (20, 30, 16)), ((0.0, _cortex),)),
        ]
    for line in _both((7, 96, 160), (11, 118, 169), (14, 150, 170), (20, 182, 160), (24, 196, 152)):
        parts.append(Part(Tube(line, (5.0, 6.5, 6.0, 5.5, 5.5, 6.5, 7.0, 6.0, 3.5)), ((0.0, 84.0),)))
    for line in _both((20, 182, 160), (34, 166, 138), (38, 138, 126)):
        parts.append(Part(Tube(line, (5.0, 4.5, 4.0, 3.5, 3.0, 3.0, 3.0, 2.5, 2.0)), ((0.0, 84.0),)))
    parts += [
        Part(Ellipsoid((_MIDDLE, 138, 146), (2.6, 14, 8)), ((0.0, 84.0),)),
        Part(Ellipsoid((_MIDDLE, 188, 110), (46, 35, 27)), ((-2.0, 88.0), (0.0, _leaves))),
        Part(
            Tube(((_MIDDLE, 146, 136), (_MIDDLE, 150, 114), (_MIDDLE, 160, 86)), (12.0, 14.0, 9.0)),
            ((-2.0, 88.0), (0.0, 105.0)),
        ),
        Part(Ellipsoid((_MIDDLE, 168, 112), (6, 4, 8)), ((0.0, 84.0),)),
        Part(Ellipsoid((_MIDDLE, 158, 152), (2.2, 3, 2.5)), ((0.0, 215.0),)),
    ]
    falx = Both(
        (
            Sheet(
                ((64, 140), (64, 222), (240, 222), (240, 140), (200, 150), (150, 182), (100, 176), (76, 150)),
                1.6,
                (_MIDDLE, 0.0, 0.0),
            ),
            Shell(Ellipsoid((_MIDDLE, 147, 157), (72, 87, 60)), 99.0, 6.0),
        )
    )
    return [*parts, Part(falx, ((0.0, 120.0),))]


def _leaves(x: Float32s, y: Float32s, z: Float32s) -> Float32s:
    r = np.hypot(y - np.float32(166), z - np.float32(112))
    return np.asarray(np.float32(104) + np.float32(6) * np.sin(1.3 * r) + 0 * x)


def _face() -> list[Part]:
    """Upper jaw with its sinuses, cheek bones, orbits with eyes, nose."""
    maxilla: list[Solid] = [
        Ellipsoid((_MIDDLE, 78, 104), (31, 30, 24)),
        Ellipsoid((_MIDDLE, 60, 92), (24, 21, 13)),
        *_pair((44.0, 80.0, 110.0), (12.0, 13.0, 11.0)),
        Tube(((_MIDDLE, 64, 140), (_MIDDLE, 55, 130), (_MIDDLE, 49, 122)), (6.5, 5.0, 3.0)),
    ]
    arches = _both((46, 80, 111), (60, 98, 110), (66, 116, 108), (64, 134, 108))
    outer = _both((47, 80, 112), (50, 84, 128), (48, 84, 143))
    parts = [
        Part(Blend((*maxilla, *(Tube(line, (4.2,)) for line in (*arches, *outer))), 8.0), ((0.0, 208.0), (2.0, 150.0)))
    ]
    parts += [
        Part(solid, ((-1.2, 205.0), (0.0, 0.0)))
        for solid in (
            *_pair((21.0, 83.0, 106.0), (11.0, 15.0, 14.0)),
            *_pair((8.0, 71.0, 150.0), (8.0, 5.0, 8.0)),
            *_pair((9.0, 96.0, 122.0), (6.0, 15.0, 8.0)),
            Ellipsoid((_MIDDLE, 116, 104), (11, 9, 7)),
        )
    ]
    parts.append(
        Part(
            Loft(
                "y",
                (
                    (30, _MIDDLE, 106, 7, 4),
                    (50, _MIDDLE, 108, 11, 11),
                    (75, _MIDDLE, 110, 13, 16),
                    (100, _MIDDLE, 104, 14, 12),
                    (112, _MIDDLE, 98, 14, 10),
                ),
            ),
            ((0.0, 0.0),),
        )
    )
    parts.append(
        Part(Sheet(((52, 96), (46, 108), (58, 126), (108, 118), (112, 94)), 2.4, (_MIDDLE, 0.0, 0.0)), ((0.0, 165.0),))
    )
    parts += [
        Part(Tube(line, (2.8,)), ((0.0, 112.0),))
        for z in (100.0, 110.0, 119.0)
        for line in _both((8.5, 62, z), (9, 80, z - 1), (8.5, 100, z - 3))
    ]
    for side in (-1.0, 1.0):
        orbit = Loft(
            "y",
            (
                (58, _MIDDLE + side * 34, 131, 16, 15),
                (72, _MIDDLE + side * 33, 131, 19, 17),
                (92, _MIDDLE + side * 27, 129, 13, 12),
                (116, _MIDDLE + side * 17, 126, 3, 3),
            ),
        )
        parts.append(Part(orbit, ((-1.6, 190.0), (0.0, 66.0))))
        eye = (_MIDDLE + side * 33, 71.0, 131.0)
        parts += [
            Part(Tube(((eye[0] - side * 2, 84, 130), (_MIDDLE + side * 18, 114, 126)), (2.6,)), ((0.0, 104.0),)),
            *(
                Part(Tube(((eye[0] + dx, 76, 131 + dz), (_MIDDLE + side * 18, 112, 126)), (2.0,)), ((0.0, 106.0),))
                for dx, dz in ((11, 0), (-11, 0), (0, 11), (0, -11))
            ),
            Part(Ellipsoid((eye[0], 60, 131), (20, 7, 13)), ((0.0, 96.0),)),
            Part(Ellipsoid(eye, (12.2, 12.2, 12.2)), ((0.0, 110.0), (1.5, 90.0))),
            Part(Ellipsoid((eye[0], 63.0, 131), (4.6, 2.4, 4.6)), ((0.0, 126.0),)),
        ]
    return parts


def _jaw() -> list[Part]:
    """Lower jaw with tongue, chewing muscle and the bone under the tongue."""
    upper = _both((26, 66, 47), (38, 88, 52), (45, 100, 66), (44, 96, 92))  # the edge with the teeth up to the coronoid
    lower = _both(
        (2, 47, 30), (22, 56, 31), (42, 88, 42), (49, 106, 60), (51, 112, 84), (52, 114, 98)
    )  # chin to condyle
    solids: list[Solid] = [Tube(line, (6.0, 5.5, 5.0, 5.0, 5.0, 5.0, 4.5, 3.5, 2.5)) for line in upper]
    solids += [Tube(line, (7.0, 6.5, 6.0, 6.0, 6.0, 6.0, 5.5, 5.0, 6.0)) for line in lower]
    solids.append(Ellipsoid((_MIDDLE, 48, 36), (14, 6, 11)))
    sheets = [
        Tube(line, (4.0,))
        for line in (
            *_both((32, 78, 40), (44, 98, 54)),
            *_both((47, 104, 66), (48, 105, 84)),
            *_both((22, 58, 40), (38, 84, 46)),
        )
    ]
    tongue = Blend((Ellipsoid((_MIDDLE, 82, 66), (22, 30, 17)), Ellipsoid((_MIDDLE, 100, 54), (18, 18, 22))), 10.0)
    hyoid = Tube(
        tuple((_MIDDLE + 22 * np.sin(t), 112 - 24 * np.cos(t), 26.0) for t in np.linspace(-1.3, 1.3, 9)), (2.6,)
    )
    masseter = [Tube(line, (9.0,)) for line in _both((58, 88, 102), (57, 102, 60))]
    return [
        *(Part(m, ((-1.0, 74.0), (0.0, 104.0))) for m in masseter),
        Part(tongue, ((-1.0, 80.0), (0.0, 103.0))),
        Part(Blend((*solids, *sheets), 7.0), ((0.0, 218.0), (2.2, 150.0))),
        Part(hyoid, ((0.0, 185.0),)),
    ]


def _teeth() -> list[Part]:
    """Fourteen teeth a jaw on a dental arch, molars wider than incisors, in bony sockets."""
    parts = []
    for top, (crown, root) in ((True, (70.0, 90.0)), (False, (67.0, 47.0))):
        t = np.linspace(-1.3, 1.3, 60)
        shrink = 0.0 if top else 1.5
        arch = np.column_stack(
            [
                _MIDDLE + (27 - shrink) * np.sin(t),
                39 + shrink + 42 * (1 - np.cos(t)),
                np.full(60, root + (1.0 if top else -1.0)),
            ]
        )
        parts.append(
            Part(
                Tube(tuple((float(p[0]), float(p[1]), float(p[2])) for p in arch[::3]), (6.5,)),
                ((0.0, 205.0), (1.6, 150.0)),
            )
        )
        for k in range(14):
            a = 1.3 * (k - 6.5) / 6.8
            wide = 2.6 + 1.9 * min(1.0, abs(k - 6.5) / 5.0) ** 1.5
            x, y = _MIDDLE + (27 - shrink) * np.sin(a), 39 + shrink + 42 * (1 - np.cos(a))
            neck = crown + (root - crown) * 0.42
            parts.append(Part(Tube(((x, y, neck), (x, y, root)), (0.8 * wide, 1.2)), ((0.0, 225.0),)))
            parts.append(
                Part(
                    Tube(((x, y, crown + (1.5 if top else -1.5)), (x, y, neck)), (wide, 0.9 * wide)),
                    ((0.0, 252.0), (2.4, 215.0)),
                )
            )
    return parts


def _airway() -> list[Part]:
    throat = Tube(
        tuple(
            (_MIDDLE, float(y), float(z))
            for y, z in ((112, 98), (124, 86), (128, 62), (124, 36), (110, 16), (106, -10))
        ),
        (9.0, 8.0, 6.5, 7.0, 8.0, 8.5),
    )
    larynx = Both(
        (
            Shell(
                Loft("z", ((-10, _MIDDLE, 104, 17, 17), (10, _MIDDLE, 104, 17, 18), (20, _MIDDLE, 108, 16, 17))), 3.0
            ),
            Block((0, 70, -10), (184, 118, 22)),
        )
    )
    return [
        Part(larynx, ((0.0, 138.0),)),
        Part(throat, ((0.0, 0.0),)),
        *(Part(Tube(line, (3.2,)), ((0.0, 0.0),)) for line in _both((8, 24, 101), (7.5, 36, 103), (7, 52, 104))),
    ]
