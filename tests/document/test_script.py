"""The script of a document makes the same document."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from deformnb.document.deformation import MODES, Deformation, Keyframe, Step
from deformnb.document.json_format import from_json, to_json
from deformnb.document.script import as_python
from deformnb.rbf.cuts import Cut
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import HalfSpace, Line, Mask, Polygon
from deformnb.rbf.rigid import RigidMotion, RigidPart
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.views import VIEWS
from deformnb.volume.volume import Grid, Volume

GRID = Grid((6, 7, 8), (1.0, 0.7, 1.3), (5.0, -2.0, 0.1))
VOLUME = Volume(np.zeros(GRID.shape, np.uint8), GRID)

places = st.lists(st.floats(-50, 50, allow_subnormal=False), min_size=2, max_size=2)
names = st.text(st.characters(), max_size=8)


@st.composite
def point_sets(draw: Any) -> ControlPoints:
    n = draw(st.integers(0, 5))
    source = draw(st.lists(places, min_size=n, max_size=n))
    if n == 0:
        return ControlPoints.empty(2, draw(st.integers(0, 3)))
    ids = draw(st.lists(st.integers(0, 20), min_size=n, max_size=n, unique=True))
    return ControlPoints.from_arrays(
        source,
        draw(st.one_of(st.none(), st.lists(places, min_size=n, max_size=n))),
        ids=ids,
        names=draw(st.lists(names, min_size=n, max_size=n)),
        active=draw(st.lists(st.booleans(), min_size=n, max_size=n)),
        weight=draw(st.lists(st.floats(0.1, 9), min_size=n, max_size=n)),
        next_id=draw(st.integers(0, 30)),
        locked=draw(st.lists(st.booleans(), min_size=n, max_size=n)),
        radius=draw(st.lists(st.one_of(st.none(), st.floats(0.1, 99)), min_size=n, max_size=n)),
    )


# Far from all points, so that none is in it.
BONE = RigidPart(
    Mask(np.eye(2, 3, dtype=bool), Raster((2, 3), (1.0, 0.5), (200.0, 100.0))),
    RigidMotion.turn(30, (1, 2)),
    "distance",
    2.5,
    "bone",
)


@st.composite
def steps(draw: Any) -> Step:
    plane = draw(
        st.sampled_from([Plane.from_view(GRID, view) for view in VIEWS] + [Plane.from_normal((1, 2, 3), (1, 2, 0.3))])
    )
    rule = draw(st.sampled_from(["replicate", "modulate", "interpolate"]))
    options: dict[str, Any] = {"extrusion": rule}
    count = 1
    if rule == "modulate":
        options["curve"] = draw(st.sampled_from(["sin(pi*z)", (0.0, 1.0, 0.25)]))
    if rule == "interpolate":
        options["knots"], count = (0.0, 0.4, 1.0), 3
    options |= draw(
        st.fixed_dictionaries(
            {},
            optional={
                "kernel": st.sampled_from(["gaussian", "wendland_c4"]),
                "support": st.floats(0.5, 99),
                "trend": st.just("rigid"),
                "smoothing": st.floats(0, 2),
                "strength": st.floats(-1, 3),
                "enabled": st.booleans(),
                "name": names,
                "cut_rule": st.just("paper"),
                "cuts": st.just(
                    (Cut(Line(((0.1, 2), (3, 4.7))), "midline"), Cut(Polygon(((0, 0), (1, 0), (0, 1))), enabled=False))
                ),
                "parts": st.sampled_from([(BONE,), (BONE, RigidPart(HalfSpace((0, 60), (0, -1)), enabled=False))]),
                "stages": st.integers(1, 64),
            },
        )
    )
    if options.get("stages", 1) > 1:
        options.pop("parts", None)  # one that moves is not done in stages
    return Step(tuple(draw(point_sets()) for _ in range(count)), plane, **options)


def run_script(text: str) -> Deformation:
    scope: dict[str, Any] = {"VOLUME": VOLUME}
    lines = [line for line in text.split("\n") if not line.startswith("deformed = ")]
    exec("\n".join(lines), scope)  # the very promise that is tested
    result = scope["deformation"]
    assert isinstance(result, Deformation)
    return result


@settings(max_examples=60, deadline=None)
@given(st.lists(steps(), max_size=3), names)
def test_the_script_makes_the_same_document(all_steps: list[Step], name: str) -> None:
    deformation = Deformation(tuple(all_steps), name)
    text = as_python(deformation, GRID, volume="VOLUME")
    assert run_script(text) == deformation


@settings(max_examples=20)
@given(st.lists(steps(), max_size=2), st.lists(st.lists(steps(), max_size=2), max_size=3), st.sampled_from(list(MODES)))
def test_the_script_makes_the_same_key_frames(all_steps: list[Step], keys: list[list[Step]], mode: str) -> None:
    frames = tuple(Keyframe(0.3 * k, tuple(some)) for k, some in enumerate(keys))
    deformation = Deformation(
        tuple(all_steps),
        mode=mode,
        keyframes=frames,
        easing="smooth" if keys else "linear",
        loop="swing" if len(keys) > 1 else "once",
    )
    assert run_script(as_python(deformation, GRID, volume="VOLUME")) == deformation


def test_the_whole_script_runs() -> None:
    points = ControlPoints.from_arrays([[0, 0], [5, 1], [2, 4]], [[0, 0], [5.5, 1], [2, 4]])
    scope: dict[str, Any] = {"VOLUME": VOLUME}
    exec(as_python(Deformation.from_picture_points(GRID, "+y", points), GRID, volume="VOLUME"), scope)
    assert scope["deformed"].shape == GRID.shape


def test_numbers_of_numpy_are_written_as_numbers() -> None:
    """A loop over an array, or a slider, passes NumPy's own numbers."""
    step = Step(
        (ControlPoints.empty(),),
        Plane.from_view(GRID, "+y"),
        support=np.float64(2.5),
        smoothing=np.float32(0.5),
        strength=np.float64(0.25),
        enabled=np.bool_(False),
        stages=np.int64(3),
    )  # type: ignore[arg-type]
    still = RigidPart(HalfSpace((0, 60), (0, -1)), reach=np.float64(2.5))
    deformation = Deformation((step,), keyframes=(Keyframe(np.float64(0.5), (replace(step, parts=(still,)),)),))
    assert "np." not in as_python(deformation, GRID)
    assert run_script(as_python(deformation, GRID, volume="VOLUME")) == deformation
    assert from_json(to_json(deformation)) == deformation


def test_points_in_space_and_no_steps() -> None:
    points = ControlPoints.from_arrays([[0, 0, 0], [5, 1, 2]], [[0, 0, 1], [5.5, 1, 2]])
    for deformation in (
        Deformation.from_space_points(points, trend="none"),
        Deformation(),
        Deformation(name="nothing"),
    ):
        assert run_script(as_python(deformation, GRID, volume="VOLUME")) == deformation


def test_what_is_as_usual_is_left_out() -> None:
    points = ControlPoints.from_arrays([[0, 0], [5, 1]])
    text = as_python(Deformation.from_picture_points(GRID, "+y", points), GRID)
    assert not [word for word in ("target", "kernel", "Plane") if word in text]
    assert '"+y"' in text
    step = replace(Deformation.from_picture_points(GRID, "+y", points).steps[0], kernel="gaussian")
    assert 'kernel="gaussian"' in as_python(Deformation((step,)), GRID)


def test_what_several_steps_share_is_written_once() -> None:
    points = ControlPoints.from_arrays([[0, 0], [5, 1]], [[0, 0], [5, 2]])
    curve = tuple(np.linspace(0, 1, 33).tolist())
    step = Step((points,), Plane.from_view(GRID, "+y"), extrusion="modulate", curve=curve, parts=(BONE,))
    deformation = Deformation((step, replace(step, strength=0.5)), keyframes=(Keyframe(0.0, (step,)),))
    text = as_python(deformation, GRID, volume="VOLUME")
    assert text.count(repr(curve[7])) == 1
    assert text.count(BONE.name) == 1
    assert max(map(len, text.splitlines())) < 600  # the mask's own line is the longest
    assert run_script(text) == deformation
