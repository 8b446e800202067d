"""Every field of a document, and of the data stored with it, is checked where it is made.

The dataclasses are found from the annotations of :class:`deformnb.Deformation`, so that a new one cannot be missed.
"""

from __future__ import annotations

import dataclasses
import math
import types
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import deformnb as dn
from deformnb.document.json_format import from_json, to_json
from deformnb.errors import DeformError
from deformnb.imaging.camera import Camera
from deformnb.imaging.raycast import PerspectiveCamera
from deformnb.rbf.fit_settings import FitSettings
from deformnb.session.view_state import ViewState
from deformnb.volume.clip import ClipBox
from deformnb.volume.plane import Slices

GRID = dn.Grid((4, 5, 6))
PLANE = dn.Plane((0, 0, 0), (1, 0, 0), (0, 1, 0))
RASTER = dn.Raster((4, 5), (1.0, 1.0), (0.0, 0.0))
POINTS = dn.ControlPoints.from_arrays([[1, 1], [6, 1], [3, 6]], [[1, 1], [6, 1], [3, 7]], names=["a", "b", "c"])
POLYGON = dn.Polygon([(0, 0), (4, 0), (4, 4)])
STEP = dn.Step((POINTS,), PLANE)
VOLUME = dn.Volume(np.zeros((4, 5, 6), np.uint8), GRID)

EXAMPLES: list[Any] = [
    GRID,
    PLANE,
    RASTER,
    POINTS,
    POLYGON,
    STEP,
    VOLUME,
    dn.HalfSpace((0, 0), (1, 0)),
    dn.Line([(0, 0), (1, 1)]),
    dn.Mask(np.ones((4, 5), bool), RASTER),
    dn.RigidMotion.turn(10, (0, 0)),
    dn.RigidPart(POLYGON),
    dn.Cut(POLYGON),
    dn.Keyframe(0.0, (STEP,)),
    dn.Deformation((STEP,)),
    FitSettings(),
    Slices(0.0, 1.0, 3),
    ViewState(),
    dn.document.VolumeReference("a", (4, 5, 6), (1.0, 1.0, 1.0), "0" * 64, (0.0, 0.0, 0.0), GRID.direction),
    dn.TransferFunction(((0, 0, 0, 0),), ((0, 0),)),
    dn.volume.ChannelDisplay((1, 0, 0), (0, 1)),
    dn.volume.Channels((VOLUME,)),
    dn.warping.Landmarks([[1, 2, 3]], ("a",)),
    dn.warping.Mesh(np.eye(3), [[0, 1, 2]]),
    Camera(PLANE, 1.0),
    PerspectiveCamera(1.0, 1.0, 1.0),
    ClipBox(GRID, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)),
]

WRONG: list[Any] = [
    "yes",
    "",
    b"x",
    5,
    -1,
    0,
    True,
    None,
    2.5,
    -2.5,
    1e300,
    10**400,
    float("nan"),
    float("inf"),
    -float("inf"),
    [],
    {},
    [1, 2],
    ["a"],
    (1, 2, 3),
    ("a", "b"),
    [[1, 2], [3, 4]],
    (float("nan"),) * 3,
    (None,) * 3,
    1 + 2j,
    object(),
    dn.Volume,
    np.array([1, 2]),
    np.zeros((2, 3)),
    np.bool_(True),
    np.float32(2),
    VOLUME,
    GRID,
    STEP,
    lambda: 0,
]

FIELDS = [(example, field.name) for example in EXAMPLES for field in dataclasses.fields(example) if field.init]


def _reached(kind: Any, seen: set[type]) -> set[type]:
    """The dataclasses of the package that annotations lead to."""
    if get_args(kind):
        for one in get_args(kind):
            _reached(one, seen)
    elif isinstance(kind, type) and kind.__module__.startswith("deformnb") and kind not in seen:
        seen.add(kind)
        if dataclasses.is_dataclass(kind):
            for hint in get_type_hints(kind).values():
                _reached(hint, seen)
        for below in kind.__subclasses__():
            _reached(below, seen)
    return seen


def test_every_dataclass_of_a_document_has_its_example() -> None:
    reached = {kind for kind in _reached(dn.Deformation, set()) if dataclasses.is_dataclass(kind)}
    assert len(reached) > 10
    assert {kind.__name__ for kind in reached} <= {type(example).__name__ for example in EXAMPLES}


def conforms(value: Any, hint: Any) -> bool:
    """The plain meaning of an annotation, read independently of the package."""
    origin, among = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return any(conforms(value, one) for one in among)
    if origin is tuple:
        if not isinstance(value, tuple):
            return False
        hints = (among[0],) * len(value) if among[1:] == (...,) else among
        return len(hints) == len(value) and all(map(conforms, value, hints))
    if hint in (int, bool, str):
        return type(value) is hint
    if hint is float:
        return type(value) in (int, float) and not math.isnan(value)
    if origin is Literal:
        return value in among
    return hint is Any or isinstance(value, origin or hint)


def tried(example: Any, name: str, value: Any) -> None:
    """A field with some value: it is refused in a sentence, or gets the annotated type."""
    try:
        made = dataclasses.replace(example, **{name: value})
    except DeformError:
        return
    assert conforms(getattr(made, name), get_type_hints(type(example))[name]), (name, value, getattr(made, name))


@pytest.mark.parametrize(
    ("example", "name"), FIELDS, ids=lambda one: one if isinstance(one, str) else type(one).__name__
)
def test_a_field_refuses_what_it_cannot_be(example: Any, name: str) -> None:
    for value in WRONG:
        tried(example, name, value)


ANY = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=4)
    | st.binary(max_size=2)
    | st.complex_numbers(),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.tuples(inner, inner, inner)
        | st.dictionaries(st.text(max_size=2), inner, max_size=2)
    ),
    max_leaves=8,
)


@given(st.sampled_from(FIELDS), ANY)
@settings(max_examples=300, deadline=None)
def test_any_value_in_any_field_is_refused_or_normal(field: tuple[Any, str], value: Any) -> None:
    tried(*field, value)


@pytest.mark.parametrize(
    "wrong",
    [
        {"knots": "abc"},
        {"enabled": "yes"},
        {"enabled": 1},
        {"name": 5},
        {"extra": [1]},
        {"cut_rule": ["source"]},
        {"curve": (float("nan"), 1.0)},
        {"curve": "import os"},
        {"parts": ""},
        {"cuts": "ab"},
        {"maps": "abc"},
        {"stages": 2.0},
        {"strength": "1"},
    ],
)
def test_a_step_is_checked_at_its_door(wrong: dict[str, Any]) -> None:
    with pytest.raises(DeformError):
        dn.Step(**{"maps": (POINTS,), "plane": PLANE} | wrong)


def test_numbers_of_numpy_become_plain_and_go_through_json() -> None:
    step = dn.Step(
        [POINTS], PLANE, enabled=np.bool_(False), name=np.str_("a"), strength=np.float32(0.5), stages=np.int64(2)
    )
    made = dn.Deformation([step], name=np.str_("b"), output=VOLUME)
    assert made.output == GRID
    assert type(step.enabled) is bool
    assert type(step.name) is str
    assert from_json(to_json(made)) == made
