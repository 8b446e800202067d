"""Regions, rigid parts and cuts as data: back as they were, and every fault named with its place."""

from __future__ import annotations

import base64
import json
import math
import zlib
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from deformnb.document.json_regions import (
    REGIONS,
    cut_from_data,
    cut_to_data,
    part_from_data,
    part_to_data,
    region_from_data,
    region_to_data,
)
from deformnb.errors import DeformError
from deformnb.rbf.cuts import Cut
from deformnb.rbf.regions import AbstractRegion, HalfSpace, Line, Mask, Polygon
from deformnb.rbf.rigid import RigidMotion, RigidPart
from deformnb.volume.plane import Raster
from deformnb.volume.volume import Grid

NUMBERS = st.floats(-1e6, 1e6)
AXES = tuple(map(tuple, Rotation.from_rotvec([0.4, -0.9, 0.3]).as_matrix().tolist()))
TRIANGLE = Polygon([(0, 0), (5, 0), (0, 5)])


@st.composite
def regions(draw: Any) -> AbstractRegion:
    kind = draw(st.sampled_from(["half_space", "polygon", "line", "mask", "mask in space"]))
    a, b, size = draw(NUMBERS), draw(NUMBERS), draw(st.floats(0.1, 1e4))
    if kind == "half_space":
        return HalfSpace((a, b, size), (1.0, draw(NUMBERS), draw(NUMBERS)))
    if kind in ("polygon", "line"):
        n = draw(st.integers(3, 9))
        corners = [
            (a + size * math.cos(2 * math.pi * k / (n + 4)), b + size * math.sin(2 * math.pi * k / (n + 4)))
            for k in range(n)
        ]
        return Polygon(corners) if kind == "polygon" else Line(corners[:2], stops=draw(st.tuples(*[st.booleans()] * 2)))
    rng = np.random.default_rng(draw(st.integers(0, 999)))
    shape = draw(st.tuples(*[st.integers(1, 11)] * (2 if kind == "mask" else 3)))
    values = rng.random(shape) < 0.5
    if kind == "mask":
        return Mask(values, Raster(shape, (size, 0.3), (a, b)))
    return Mask(values, Grid(shape, (size, 1.0, 0.3), (a, b, 1.0), AXES))


@st.composite
def parts(draw: Any) -> RigidPart:
    region = draw(regions().filter(lambda r: r.kind != "line"))
    axis = (1.0, draw(NUMBERS), 2.0) if region.dim == 3 else None
    motion = RigidMotion.turn(draw(NUMBERS), (draw(NUMBERS),) * region.dim, axis=axis)
    return RigidPart(
        region,
        draw(st.sampled_from([None, motion])),
        draw(st.sampled_from(["saturated", "distance"])),
        draw(st.none() | st.floats(1e-3, 1e5)),
        draw(st.text(max_size=5)),
        draw(st.booleans()),
        draw(st.none() | st.tuples(*[NUMBERS] * region.dim)),
    )


@given(regions())
def test_a_region_comes_back_as_it_was(region: AbstractRegion) -> None:
    data = json.loads(json.dumps(region_to_data(region), allow_nan=False))
    back = region_from_data(data)
    assert back == region
    assert type(back) is type(region) is REGIONS[data["kind"]]


@given(parts())
def test_a_rigid_part_comes_back_as_it_was(part: RigidPart) -> None:
    assert part_from_data(json.loads(json.dumps(part_to_data(part), allow_nan=False))) == part


@given(regions(), st.text(max_size=9), st.booleans())
def test_a_cut_comes_back_as_it_was(region: AbstractRegion, name: str, enabled: bool) -> None:
    cut = Cut(region, name, enabled)
    assert cut_from_data(json.loads(json.dumps(cut_to_data(cut), allow_nan=False))) == cut


def test_what_is_left_out_has_its_default() -> None:
    assert cut_from_data({"region": region_to_data(TRIANGLE)}) == Cut(TRIANGLE)
    assert part_from_data({"region": region_to_data(TRIANGLE)}) == RigidPart(TRIANGLE)


def packed(data: bytes) -> str:
    return base64.b64encode(zlib.compress(data)).decode()


MASK: dict[str, Any] = {"kind": "mask", "shape": [2, 9], "spacing": [1, 1], "origin": [0, 0], "bits": packed(b"abc")}
BROKEN: dict[str, tuple[Any, str]] = {
    "no object": ([], "region must be an object"),
    "no kind": ({}, r"region\.kind"),
    "unknown kind": ({"kind": "circle"}, "one of line, polygon, half_space, mask"),
    "no vertices": ({"kind": "polygon"}, r"region\.vertices"),
    "words": ({"kind": "line", "vertices": ["ab", "cd"]}, r"region\.vertices\[0\]"),
    "three numbers": ({"kind": "line", "vertices": [[0, 0], [1, 2, 3]]}, r"region\.vertices\[1\]"),
    "not a number": ({"kind": "line", "vertices": [[0, 0], [1, math.nan]]}, r"vertices\[1\].*finite"),
    "a loop": ({"kind": "polygon", "vertices": [[0, 0], [9, 0], [0, 5], [9, 6]]}, r"meet.*\(in region\)"),
    "one corner": ({"kind": "polygon", "vertices": [[0, 0]]}, r"\(in region\)"),
    "no normal": ({"kind": "half_space", "point": [0, 0]}, r"region\.normal"),
    "normal of another dimension": ({"kind": "half_space", "point": [0, 0], "normal": [0, 0, 1]}, r"in region"),
    "normal of nothing": ({"kind": "half_space", "point": [0, 0], "normal": [0, 0]}, r"zero.*in region"),
    "shape": (MASK | {"shape": [2]}, r"region\.shape"),
    "shape 0": (MASK | {"shape": [0, 9]}, r"region\.shape"),
    "half a pixel": (MASK | {"shape": [2, 8.5]}, r"region\.shape"),
    "negative shape": (MASK | {"shape": [-2, -9]}, r"region\.shape"),
    "huge shape": (MASK | {"shape": [10**9, 10**9]}, r"region\.shape"),
    "endless shape": (MASK | {"shape": [1e308, 1e308]}, r"region\.shape"),
    "spacing": (MASK | {"spacing": [1, 1, 1]}, r"region\.spacing"),
    "flat": (MASK | {"spacing": [1, 0]}, "in region"),
    "no bits": (MASK | {"bits": ""}, "bits"),
    "no base64": (MASK | {"bits": "%%%"}, "damaged"),
    "no zlib": (MASK | {"bits": base64.b64encode(b"hello").decode()}, "damaged"),
    "not ASCII": (MASK | {"bits": "\u00e4"}, "damaged"),
    "too few bits": (MASK | {"bits": packed(b"ab")}, "holds 16 pixels; its shape needs 18"),
    "bent axes": (
        MASK | {"shape": [1, 2, 9], "spacing": [1] * 3, "origin": [0] * 3, "direction": [1] * 9},
        "in region",
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_region_is_refused_with_its_place(case: str) -> None:
    data, message = BROKEN[case]
    with pytest.raises(DeformError, match=message):
        region_from_data(data)


def test_more_than_the_mask_is_never_unpacked() -> None:
    bomb = MASK | {"bits": packed(b"abc" + bytes(10**7))}
    assert isinstance(region_from_data(bomb), Mask)


PART: dict[str, Any] = {"region": {"kind": "polygon", "vertices": [[0, 0], [5, 0], [0, 5]]}}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"region": None}, r"here\.region"),
        ({"motion": []}, r"here\.motion"),
        ({"motion": {}}, r"here\.motion\.shift"),
        ({"motion": {"matrix": [[1, 0], [0]], "shift": [0, 0]}}, r"here\.motion\.matrix\[1\]"),
        ({"motion": {"matrix": [[2, 0], [0, 2]], "shift": [0, 0]}}, r"stretch.*\(in here"),
        ({"motion": {"matrix": [], "shift": []}}, r"\(in here"),
        ({"weight": "soft"}, r"unknown weight.*\(in here"),
        ({"weight": 3}, r"here\.weight"),
        ({"reach": "far"}, r"here\.reach"),
        ({"reach": -1}, r"reach.*\(in here"),
        ({"name": 5}, r"here\.name"),
        ({"enabled": 1}, r"here\.enabled"),
        ({"region": {"kind": "line", "vertices": [[0, 0], [5, 0]]}}, r"no inside.*\(in here"),
    ],
)
def test_a_broken_part_is_refused_with_its_place(change: dict[str, Any], message: str) -> None:
    with pytest.raises(DeformError, match=message):
        part_from_data(PART | change, "here")


def test_a_broken_cut_is_refused_with_its_place() -> None:
    for data, message in (
        ([], "here must be"),
        ({}, r"here\.region"),
        ({"region": {"kind": 3}}, r"here\.region\.kind"),
        (PART | {"name": None}, r"here\.name"),
    ):
        with pytest.raises(DeformError, match=message):
            cut_from_data(data, "here")


KEYS = st.sampled_from(["kind", "vertices", "point", "normal", "shape", "bits", "region", "motion"])
SOUP = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=6),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(KEYS, inner),
    max_leaves=8,
)


@given(SOUP, st.sampled_from([*PART, *MASK, "vertices", "point", "normal", "motion", "reach", "weight"]), SOUP)
def test_any_data_is_read_or_refused(data: Any, key: str, value: Any) -> None:
    for read, known in (
        (region_from_data, MASK),
        (region_from_data, PART["region"]),
        (part_from_data, PART),
        (cut_from_data, PART),
    ):
        for broken in (data, known | {key: value}):
            with suppress(DeformError):
                read(broken)


def test_a_region_of_another_type_has_no_form() -> None:
    with pytest.raises(DeformError, match="no form in a document"):
        region_to_data(object())  # type: ignore[arg-type]
