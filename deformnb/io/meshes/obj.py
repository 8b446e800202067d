"""Wavefront OBJ: corners and faces."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np

from deformnb.io.files.errors import fail, printable
from deformnb.io.meshes.polygons import CUT_SHORT, Polygons
from deformnb.warping.mesh import Mesh


def read_obj(path: Path) -> Polygons:
    """The lines v and f of an OBJ file: places and polygons. Corners are counted from 1, negative ones backwards."""
    points: list[list[bytes]] = []
    counts, corners = [], list[int]()
    promised = None
    for line in _lines(path):
        if promised is None and (comment := re.match(rb"# deformnb: ([0-9]{1,12}) corners, ([0-9]{1,12}) faces", line)):
            promised = (int(comment[1]), int(comment[2]))
        kind, *words = line.split(b"#", 1)[0].split() or [b""]
        if kind == b"v":
            points.append(words[:3])
        elif kind == b"f":
            counts.append(len(words))
            for word in words:
                number = word.split(b"/", 1)[0]
                if re.fullmatch(rb"-?[1-9][0-9]{0,17}", number) is None:
                    raise fail(
                        path, f"the corner '{printable(word.decode('ascii', 'replace'), 30)}' of a face is none."
                    )
                corners.append(int(number) - 1 if int(number) > 0 else len(points) + int(number))
    if promised not in (None, (len(points), len(counts))):  # files of other programs do not mark their end
        raise fail(path, f"its first line declares other numbers of corners and faces than it has: {CUT_SHORT}.")
    try:
        places = np.array(points, dtype=np.float64).reshape(len(points), 3)
    except ValueError as error:
        raise fail(path, f"a line v does not hold three numbers: {CUT_SHORT}.") from error
    return places, np.array(counts, dtype=np.int64), np.array(corners, dtype=np.int64)


def _lines(path: Path) -> Iterator[bytes]:
    """Lines; a backslash at the end continues with the next one."""
    data = path.read_bytes()
    if b"\0" in data:
        raise fail(path, "this is no OBJ file: it is not text.")
    yield from data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").splitlines()


def write_obj(mesh: Mesh, file: BinaryIO) -> None:
    """A mesh as the lines v and f of OBJ."""
    lines = [f"# deformnb: {len(mesh.points)} corners, {len(mesh.faces)} faces\n"]
    lines += [f"v {x!r} {y!r} {z!r}\n" for x, y, z in mesh.points.tolist()]
    lines += [f"f {a} {b} {c}\n" for a, b, c in (mesh.faces + 1).tolist()]
    file.write("".join(lines).encode("ascii"))
