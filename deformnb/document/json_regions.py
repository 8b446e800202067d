"""Regions, rigid parts and cuts as plain data, the same in documents and in the messages of widgets."""

from __future__ import annotations

import base64
import binascii
import zlib
from math import prod
from typing import Any

import numpy as np

from deformnb.document.json_reader import JsonReader
from deformnb.errors import DeformError
from deformnb.rbf.cuts import Cut
from deformnb.rbf.regions import AbstractRegion, HalfSpace, Line, Mask, Polygon
from deformnb.rbf.rigid import RigidMotion, RigidPart
from deformnb.volume.plane import Raster
from deformnb.volume.volume import Grid

REGIONS: dict[str, type[AbstractRegion]] = {c.kind: c for c in (Line, Polygon, HalfSpace, Mask)}
"""All kinds of regions by the name they have in documents."""

LARGEST_MASK = 2**31
"""Voxels of a mask that is read: 256 MB of bits, which may come out of a few bytes."""


def region_to_data(region: AbstractRegion) -> dict[str, Any]:
    """A region as JSON data.

    >>> region_to_data(HalfSpace((0, 5), (0, 1)))
    {'kind': 'half_space', 'point': [0.0, 5.0], 'normal': [0.0, 1.0]}
    """
    if isinstance(region, HalfSpace):
        return {"kind": region.kind, "point": list(region.point), "normal": list(region.normal)}
    if isinstance(region, Polygon | Line):
        stops = {"stops": list(region.stops)} if isinstance(region, Line) and any(region.stops) else {}
        return {"kind": region.kind, "vertices": [list(v) for v in region.vertices], **stops}
    if isinstance(region, Mask):
        lattice = region.lattice
        turned = {"direction": np.asarray(lattice.direction).ravel().tolist()} if isinstance(lattice, Grid) else {}
        bits = base64.b64encode(zlib.compress(np.packbits(region.values).tobytes(), 6)).decode()
        return {
            "kind": region.kind,
            "shape": list(lattice.shape),
            "spacing": list(lattice.spacing),
            "origin": list(lattice.origin),
            **turned,
            "bits": bits,
        }
    raise DeformError(f"a region of type {type(region).__name__} has no form in a document.")


def region_from_data(data: Any, where: str = "region") -> AbstractRegion:
    """The region of JSON data; DeformError naming the place if it is none.

    Examples
    --------
    >>> region_from_data({"kind": "half_space", "point": [0, 5], "normal": [0, 1]}).dim
    2
    """
    return read_region(JsonReader(data, where))


def read_region(r: JsonReader) -> AbstractRegion:
    """The same of a part of a document."""
    kind = r.text("kind")
    if kind not in REGIONS:
        raise DeformError(f"{r.where}.kind is {kind!r:.40}; a region is one of {', '.join(REGIONS)}.")
    try:
        if kind == "half_space":
            return HalfSpace(r.numbers("point"), r.numbers("normal"))
        return _mask(r) if kind == "mask" else _read_outline(r, kind)
    except DeformError as error:
        raise DeformError(f"{error} (in {r.where})") from None


def _read_outline(r: JsonReader, kind: str) -> AbstractRegion:
    places = [
        JsonReader({"at": v}, f"{r.where}.vertices[{k}]").numbers("at", 2)
        for k, v in enumerate(r.value("vertices", (list, tuple), ...))
    ]
    if kind == "polygon":
        return Polygon(tuple((a, b) for a, b in places))
    return Line(tuple((a, b) for a, b in places), tuple(r.value("stops", (list, tuple), (False, False))))


def _mask(r: JsonReader) -> Mask:
    sizes = r.numbers("shape")
    dim = len(sizes)
    if dim not in (2, 3) or not all(n == int(n) and n >= 1 for n in sizes) or prod(sizes) > LARGEST_MASK:
        raise DeformError(f"{r.where}.shape must be 2 or 3 whole numbers, at most {LARGEST_MASK} pixels in all.")
    shape = tuple(int(n) for n in sizes)
    spacing, origin = r.numbers("spacing", dim), r.numbers("origin", dim)
    lattice: Raster | Grid
    if dim == 2:
        lattice = Raster(shape, spacing, origin)  # type: ignore[arg-type]
    else:
        rows = np.reshape(r.numbers("direction", 9, (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)), (3, 3))
        lattice = Grid(shape, spacing, origin, tuple(map(tuple, rows.tolist())))  # type: ignore[arg-type]
    count = prod(shape)
    try:
        packed = zlib.decompressobj().decompress(base64.b64decode(r.text("bits"), validate=True), -(-count // 8))
    except (binascii.Error, ValueError, zlib.error):
        raise DeformError(f"{r.where}.bits is damaged.") from None
    if len(packed) != -(-count // 8):
        raise DeformError(f"{r.where}.bits holds {8 * len(packed)} pixels; its shape needs {count}.")
    bits = np.unpackbits(np.frombuffer(packed, np.uint8), count=count)
    return Mask(bits.astype(bool).reshape(shape), lattice)


def cut_to_data(cut: Cut) -> dict[str, Any]:
    """A cut as JSON data."""
    return {"name": cut.name, "enabled": cut.enabled, "region": region_to_data(cut.region)}


def cut_from_data(data: Any, where: str = "cut") -> Cut:
    """The cut of JSON data; DeformError naming the place if it is none."""
    return read_cut(JsonReader(data, where))


def read_cut(r: JsonReader) -> Cut:
    """The same of a part of a document."""
    return Cut(read_region(r.part("region")), r.text("name", ""), r.flag("enabled", True))


def part_to_data(part: RigidPart) -> dict[str, Any]:
    """A rigid part as JSON data."""
    motion = part.motion and {"matrix": [list(row) for row in part.motion.matrix], "shift": list(part.motion.shift)}
    pivot = {} if part.pivot is None else {"pivot": list(part.pivot)}
    return {
        "name": part.name,
        "enabled": part.enabled,
        "weight": part.weight,
        "reach": part.reach,
        "motion": motion,
        **pivot,
        "region": region_to_data(part.region),
    }


def part_from_data(data: Any, where: str = "part") -> RigidPart:
    """The rigid part of JSON data; DeformError naming the place if it is none."""
    return read_part(JsonReader(data, where))


def read_part(r: JsonReader) -> RigidPart:
    """The same of a part of a document."""
    motion, region = None, read_region(r.part("region"))
    reach = None if r.data.get("reach") is None else r.number("reach")
    weight: Any = r.text("weight", "saturated")
    name, enabled = r.text("name", ""), r.flag("enabled", True)
    pivot = None if r.data.get("pivot") is None else r.numbers("pivot")
    if r.data.get("motion") is not None:
        motion = motion_from_data(r.data["motion"], f"{r.where}.motion")
    try:
        return RigidPart(region, motion, weight, reach, name, enabled, pivot)
    except DeformError as error:
        raise DeformError(f"{error} (in {r.where})") from None


def motion_from_data(data: Any, where: str = "motion") -> RigidMotion:
    """The rigid motion of JSON data; DeformError naming the place if it is none."""
    r = JsonReader(data, where)
    shift = r.numbers("shift")
    rows = [
        JsonReader({"row": v}, f"{where}.matrix[{k}]").numbers("row", len(shift))
        for k, v in enumerate(r.value("matrix", (list, tuple), ...))
    ]
    try:
        return RigidMotion(tuple(rows), shift)
    except DeformError as error:
        raise DeformError(f"{error} (in {where})") from None
