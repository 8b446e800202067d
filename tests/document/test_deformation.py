"""The document in use: a dragged feature lands where it was dropped, steps compose, and nothing is ever changed."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, replace
from typing import Any

import numpy as np
import oracle
import pytest
from scipy.spatial.transform import Rotation

from deformnb.document.deformation import Deformation, Keyframe, Step, VolumeReference
from deformnb.document.json_format import from_json, to_json
from deformnb.errors import DeformError
from deformnb.rbf.cuts import Cut
from deformnb.rbf.extrusion import EXTRUSIONS
from deformnb.rbf.fields import Composed, Identity, compose
from deformnb.rbf.fit_settings import FitSettings
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.kernels import KERNELS
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import HalfSpace, Line, Polygon
from deformnb.rbf.rigid import RigidMotion, RigidPart
from deformnb.rbf.support import choose_support
from deformnb.rbf.trends import TRENDS
from deformnb.volume.channels import Channels
from deformnb.volume.plane import Plane
from deformnb.volume.views import VIEWS
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.mesh import Mesh
from deformnb.warping.points import Landmarks
from deformnb.warping.warper import warp

GRID = Grid((9, 11, 13), (1.0, 2.0, 1.5), (-7.0, 4.0, 12.0))
TURNED = replace(GRID, direction=tuple(map(tuple, Rotation.from_rotvec([0.4, -0.9, 0.3]).as_matrix().tolist())))
PLANE = Plane.from_view(GRID, "+z")
POINTS = ControlPoints.from_arrays([[0, 0], [12, 0], [0, 20], [6, 8]], [[0, 0], [12, 1], [1, 20], [8, 9]])


def places() -> np.ndarray:
    return np.random.default_rng(0).uniform([-7, 4, 12], [5, 24, 24], (20, 3))


def test_a_step_is_solved_once_for_a_grid(monkeypatch: pytest.MonkeyPatch) -> None:
    solved: list[int] = []
    fits = FitSettings.fits
    monkeypatch.setattr(FitSettings, "fits", lambda *given, **options: (solved.append(1), fits(*given, **options))[1])
    document = Deformation.from_picture_points(GRID, "+z", POINTS)
    wanted = document.field(GRID).displacement(places())
    document.notes(GRID)
    longer = document.then(Deformation.from_space_points(ControlPoints.from_arrays([[0, 9, 15]], [[0, 9, 15]])))
    np.testing.assert_allclose(longer.field(replace(GRID)).displacement(places()), wanted)
    assert len(solved) == 2  # the second step
    twice = document.field(replace(GRID, spacing=(2.0, 2.0, 2.0)))
    assert len(solved) == 3
    assert document == replace(document)
    assert twice.dim == 3


# ---- a feature lands where it is dropped -----------------------------------------------------------------------------


@pytest.mark.parametrize("grid", [GRID, TURNED], ids=["straight", "turned"])
@pytest.mark.parametrize("view", VIEWS)
def test_what_was_at_the_source_is_at_the_target(grid: Grid, view: str) -> None:
    """A bright voxel dragged on a picture is found, deformed, at the voxel where it was dropped, at the same depth."""
    here, there = np.array([4, 5, 3]), np.array([7, 7, 6])  # i, j, k
    axis = np.abs(np.asarray(grid.direction).T @ Plane.from_view(grid, view).normal).argmax()
    there[axis] = here[axis]  # a picture cannot move a thing along its normal
    values = np.zeros(grid.shape, np.uint8)
    values[tuple(here[::-1])] = 200
    plane = Plane.from_view(grid, view)
    a, b = (plane.to_plane(grid.index_to_point(p))[:2] for p in (here, there))
    document = Deformation.from_picture_points(grid, view, ControlPoints.empty(2).add(a, b))
    out = document.apply(Volume(values, grid), method="nearest")
    assert out.values[tuple(there[::-1])] == 200
    assert out.values[tuple(here[::-1])] == 0
    assert out.values.sum() == 200


def test_in_space_a_feature_moves_in_all_three_directions() -> None:
    values = np.zeros(TURNED.shape, np.uint8)
    values[3, 5, 4] = 200
    a, b = TURNED.index_to_point([4, 5, 3]), TURNED.index_to_point([6, 2, 7])
    document = Deformation.from_space_points(ControlPoints.empty(3).add(a, b))
    out = document.apply(Volume(values, TURNED), method="nearest")
    assert out.values[7, 2, 6] == 200
    assert out.values.sum() == 200


def test_a_document_applies_to_any_volume() -> None:
    """Twice as fine, and shifted: the field is the same in space."""
    document = Deformation.from_picture_points(GRID, PLANE, POINTS)
    fine = GRID.resampled(spacing=0.75)
    oracle.assert_close(
        document.field(fine).displacement(places()), document.field(GRID).displacement(places()), atol=1e-12
    )


# ---- fields ----------------------------------------------------------------------------------------------------------


def test_nothing_to_do_is_the_identity() -> None:
    volume = Volume(np.random.default_rng(0).integers(0, 255, GRID.shape).astype(np.uint8), GRID)
    step = Step((POINTS,), PLANE)
    still = Step((POINTS.reset(),), PLANE)
    for document in (
        Deformation(),
        Deformation((replace(step, enabled=False),)),
        Deformation((still,)),
        Deformation((replace(step, strength=0.0),)),
        Deformation((still, still)),
        Deformation.from_picture_points(GRID, "-x", ControlPoints.empty(2)),
        Deformation.from_space_points(ControlPoints.empty(3)),
    ):
        assert (document.field(GRID).displacement(places()) == 0).all()
        assert (document.apply(volume).values == volume.values).all()
    assert Deformation().field(GRID) == Identity(3)


def test_a_step_is_its_fit_extruded() -> None:
    step = Step(
        (POINTS,), PLANE, kernel="gaussian", trend="rigid", support=15.0, smoothing=0.1, extrusion="modulate", curve="z"
    )
    fit = fit_rbf(POINTS, kernel="gaussian", trend="rigid", support=15.0, smoothing=0.1)
    field = step.field(GRID)
    for x in places():
        a, b, c = PLANE.to_plane(x)
        d = oracle.relative_depth(c, *PLANE.depth_range(GRID)) * fit.displacement([a, b])
        oracle.assert_close(field.displacement(x), d @ np.array([PLANE.u, PLANE.v]), atol=1e-11)


def test_steps_are_done_first_to_last() -> None:
    first, second = Step((POINTS,), PLANE), Step((POINTS,), Plane.from_view(GRID, "+y"), trend="rigid")
    document = Deformation((first,)).then(second)
    wanted = Composed(first.field(GRID), second.field(GRID)).displacement(places())
    oracle.assert_close(document.field(GRID).displacement(places()), wanted, atol=1e-12)
    skipped = document.with_step(0, replace(first, enabled=False))
    wanted = second.field(GRID).displacement(places())
    oracle.assert_close(skipped.field(GRID).displacement(places()), wanted, atol=1e-12)


@pytest.mark.parametrize("strength", [2.0, 0.5, -1.0])
def test_strength_drags_the_points_so_much_further(strength: float) -> None:
    document = Deformation.from_picture_points(GRID, PLANE, POINTS, support=15.0)
    further = Deformation.from_picture_points(GRID, PLANE, POINTS.scaled(strength), support=15.0)
    for other in (document.scaled(strength), document.scaled(2 * strength).scaled(0.5)):
        oracle.assert_close(
            other.field(GRID).displacement(places()), further.field(GRID).displacement(places()), atol=1e-12
        )


def test_the_support_stays_during_a_drag_and_a_lone_point_has_a_visible_reach() -> None:
    step = Step((POINTS,), PLANE)
    dragged = replace(step, maps=(POINTS.move(3, [300.0, 300.0]),))
    assert step.fits(GRID)[0].support == dragged.fits(GRID)[0].support == pytest.approx(np.hypot(12, 20))
    lone = Step((POINTS.take([3]),), PLANE, trend="none")
    assert lone.fits(GRID)[0].support == GRID.diagonal / 4


def test_interpolation_keeps_the_drag_of_each_depth() -> None:
    step = Step((POINTS.reset(), POINTS), PLANE, extrusion="interpolate", knots=(0.0, 1.0))
    modulated = Step((POINTS,), PLANE, extrusion="modulate", curve="z")
    wanted = modulated.field(GRID).displacement(places())
    oracle.assert_close(step.field(GRID).displacement(places()), wanted, atol=1e-11)
    assert step.points == POINTS.reset()
    assert step.with_points(POINTS.move(0, [1, 1]), 1).maps[1].target[0].tolist() == [1, 1]
    with pytest.raises(DeformError, match="there is no set of control points 2; there are 2"):
        step.with_points(POINTS, 2)


def test_notes_name_each_thing_once() -> None:
    row = ControlPoints.from_arrays([[0, 0], [5, 0], [9, 0]], [[0, 0], [5, 1], [9, 0]])
    step = Step((row.scaled(0.0).move(1, [5.5, 0]),), PLANE)
    document = Deformation((step, step, replace(step, enabled=False)))
    assert len(document.notes(GRID)) == 1
    assert "on one line" in document.notes(GRID)[0]
    assert Deformation((replace(step, enabled=False),)).notes(GRID) == ()


def test_a_bad_step_says_so_when_it_is_used() -> None:
    double = POINTS.add([1, 1], [0, 0])
    with pytest.raises(DeformError, match="point 1 and point 5 are at the same place"):
        Deformation.from_picture_points(GRID, PLANE, double).field(GRID)
    with pytest.raises(DeformError, match=r"thin_plate kernel .* needs a trend of affine"):
        Deformation.from_picture_points(GRID, PLANE, POINTS, kernel="thin_plate", trend="rigid").field(GRID)


# ---- immutable -------------------------------------------------------------------------------------------------------


def test_an_edit_makes_a_new_document() -> None:
    step, other = Step((POINTS,), PLANE), Step((POINTS,), PLANE, name="other")
    document = Deformation((step, step))
    assert document.with_step(1, other).steps == (step, other)
    assert document.without_step(0).steps == (step,)
    assert document.then(other).steps == (step, step, other)
    assert document.steps == (step, step)
    assert document == Deformation((step, step))
    with pytest.raises(FrozenInstanceError):
        document.name = "x"  # type: ignore[misc]
    with pytest.raises(FrozenInstanceError):
        step.support = 3.0  # type: ignore[misc]
    for index in (-1, 2):
        with pytest.raises(DeformError, match=f"there is no step {index}; there are 2"):
            document.without_step(index)
        with pytest.raises(DeformError, match=f"there is no step {index}; there are 2"):
            document.with_step(index, other)


def test_lists_and_arrays_become_what_is_read_back() -> None:
    step = Step([POINTS], PLANE, extrusion="modulate", curve=np.array([0.0, 1, 0]), knots=[0.5])  # type: ignore[arg-type]
    assert step.curve == (0.0, 1.0, 0.0)
    assert step.knots == (0.5,)
    assert from_json(to_json(Deformation((step,)))).steps == (step,)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"kernel": "tps"}, "unknown kernel"),
        ({"trend": "free"}, "unknown trend"),
        ({"extrusion": "lathe"}, "unknown extrusion"),
        ({"support": 0.0}, "support radius"),
        ({"support": -1.0}, "support radius"),
        ({"support": np.nan}, "support radius"),
        ({"smoothing": -0.1}, "smoothing must be"),
        ({"smoothing": np.nan}, "smoothing must be"),
        ({"strength": np.inf}, "strength must be"),
        ({"extrusion": "modulate", "curve": "1/z"}, "not finite at z = 0"),
        ({"extrusion": "modulate", "curve": ()}, "at least two"),
        ({"extrusion": "modulate", "curve": 3.0}, "the curve of a step"),
        ({"extrusion": "modulate", "curve": abs}, "the curve of a step"),
        ({"knots": ["a"]}, "the knots of a step"),
        ({"extrusion": "interpolate"}, r"needs 0 set\(s\) of points, got 1"),
        ({"extrusion": "interpolate", "knots": (0.2, 0.4)}, r"needs 2 set\(s\) of points, got 1"),
        ({"extrusion": "interpolate", "knots": (2.0,)}, "knots must be numbers from 0"),
        ({"maps": ()}, r"needs 1 set\(s\)"),
        ({"maps": (POINTS, POINTS)}, r"needs 1 set\(s\)"),
        ({"maps": 3}, "the maps of a step"),
        ({"maps": (), "extrusion": "interpolate"}, "knots must be numbers"),
        ({"maps": (ControlPoints.empty(3),)}, "these have 3 and a plane"),
        ({"plane": None}, "these have 2 and no plane"),
        ({"plane": None, "maps": (ControlPoints.empty(3),), "extrusion": "modulate"}, "in space are not extruded"),
    ],
)
def test_parts_that_do_not_fit_together_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(DeformError, match=message):
        Step(**{"maps": (POINTS,), "plane": PLANE, **options})


def test_every_name_of_the_registries_makes_a_step() -> None:
    for kernel in KERNELS:
        assert Step((POINTS,), PLANE, kernel=kernel).kernel == kernel
    for trend in TRENDS:
        assert Step((POINTS,), PLANE, trend=trend).trend == trend
    for rule in EXTRUSIONS:
        knots = (0.5,) if rule == "interpolate" else ()
        knot_values, weights = Step((POINTS,), PLANE, extrusion=rule, knots=knots).weights()
        assert weights.shape == (1, len(knot_values))


# ---- which volume ----------------------------------------------------------------------------------------------------


def test_a_reference_knows_its_voxels_and_nothing_else() -> None:
    values = np.random.default_rng(0).integers(0, 255, (4, 5, 6)).astype(np.uint8)
    volume = Volume(values, Grid((4, 5, 6), (1, 2, 3)), "knee")
    reference = VolumeReference.of(volume)
    assert (reference.name, reference.shape, reference.spacing) == ("knee", (4, 5, 6), (1.0, 2.0, 3.0))
    assert reference == VolumeReference.of(volume)
    same = [
        Volume(values, volume.grid, "other"),
        Volume(np.asfortranarray(values), volume.grid),
        Volume(values[::-1][::-1], volume.grid),
        Volume(np.repeat(values, 2, axis=2)[..., ::2], volume.grid),
    ]
    for other in same:
        assert reference.matches(other)
    changed = values.copy()
    changed[3, 4, 5] ^= 1
    different = [
        Volume(changed, volume.grid),
        Volume(values.view(np.int8), volume.grid),
        Volume(values.astype(np.int16), volume.grid),
        Volume(values.reshape(4, 6, 5), Grid((4, 6, 5))),
        Volume(values[:3], Grid((3, 5, 6))),
    ]
    for other in different:
        assert not reference.matches(other)


# ---- parts, cuts, key frames, modes ----------------------------------------------------------------------------------

BONE = RigidPart(Polygon([(-3, 12), (0, 12), (0, 18), (-3, 18)]), RigidMotion.turn(20, (-1, 15), (1, 0)), name="bone")
SLIT = Cut(Line([(3.2, 40.0), (3.0, -40.0)]))


def test_what_is_switched_off_is_as_if_it_were_not_there() -> None:
    plain = Step((POINTS,), PLANE)
    wanted = plain.field(GRID).displacement(places())
    off = replace(plain, parts=(replace(BONE, enabled=False),), cuts=(replace(SLIT, enabled=False),))
    assert not off.field(GRID).has_cuts
    assert (off.field(GRID).displacement(places()) == wanted).all()
    assert replace(plain, cuts=(SLIT,)).field(GRID).has_cuts
    assert np.abs(replace(plain, parts=(BONE,)).field(GRID).displacement(places()) - wanted).max() > 0.1


@pytest.mark.parametrize("strength", [0.5, 2.0, -1.0])
def test_strength_moves_parts_so_much_further(strength: float) -> None:
    motion = BONE.motion
    assert motion is not None
    step = Step((ControlPoints.empty(2),), PLANE, parts=(BONE,), strength=strength)
    at = motion.power(strength)([[-1.0, 15.0], [-2.0, 13.0]])
    space = np.c_[at, [9.0, 9.0]] @ PLANE.frame + PLANE.origin
    wanted = [[-1.0, 15.0], [-2.0, 13.0]] - at
    oracle.assert_close(step.field(GRID).displacement(space) @ PLANE.frame[:2].T, wanted, atol=1e-9)
    still = Step((POINTS,), PLANE, parts=(BONE,), cuts=(SLIT,), strength=0.0).field(GRID)
    oracle.assert_close(still.displacement(places()), np.zeros((20, 3)), atol=1e-12)


def test_blend_is_the_sum_and_compose_is_not() -> None:
    steps = Step((POINTS,), PLANE, cuts=(SLIT,)), Step((POINTS,), Plane.from_view(GRID, "+y"), trend="rigid")
    document = Deformation(steps, mode="blend")
    wanted = sum(step.field(GRID).displacement(places()) for step in steps)
    oracle.assert_close(document.field(GRID).displacement(places()), wanted, atol=1e-12)
    composed = replace(document, mode="compose").field(GRID).displacement(places())
    assert np.abs(composed - wanted).max() > 1e-3
    with pytest.raises(DeformError, match="unknown mode 'add' of a deformation; choose one of compose, blend"):
        Deformation(steps, mode="add")


def test_a_step_moves_in_the_order() -> None:
    steps = tuple(Step((POINTS,), PLANE, name=str(k)) for k in range(4))
    for index in range(4):
        for to in range(4):
            names = [s.name for s in Deformation(steps).move_step(index, to).steps]
            assert names[to] == str(index)
            assert [n for n in names if n != str(index)] == [str(k) for k in range(4) if k != index]
    for bad in ((4, 0), (0, 4), (-1, 0)):
        with pytest.raises(DeformError, match="there is no step"):
            Deformation(steps).move_step(*bad)


def test_key_frames_rise() -> None:
    step = Step((POINTS,), PLANE)
    keys = [Keyframe(0, [step]), Keyframe(1.5, (step,))]  # type: ignore[arg-type]
    document = Deformation((step,), keyframes=keys)  # type: ignore[arg-type]
    assert document.keyframes == tuple(keys)
    assert document.keyframes[0].steps == (step,)
    for times in ((1.0, 1.0), (2.0, 1.0)):
        with pytest.raises(DeformError, match="must rise"):
            Deformation(keyframes=tuple(Keyframe(t, ()) for t in times))
    for time in (-1.0, np.nan, np.inf):
        with pytest.raises(DeformError, match="seconds from 0 on"):
            Keyframe(time, ())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"cut_rule": "both"}, "unknown rule 'both' of cuts"),
        ({"cuts": (BONE,)}, "must be of type Cut"),
        ({"parts": (SLIT,)}, "must be of type RigidPart"),
        ({"parts": 3}, "must be rigid parts"),
        ({"cuts": (Cut(HalfSpace((0, 0, 0), (0, 0, 1))),)}, r"dimension 2, .* one has 3: take the silhouette"),
        ({"plane": None, "maps": (ControlPoints.empty(3),), "cuts": (SLIT,)}, "one has 2: give it three coordinates"),
        ({"cuts": (SLIT,) * 9}, "at most 8 cuts, got 9"),
    ],
)
def test_shapes_that_do_not_fit_a_step_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(DeformError, match=message):
        Step(**{"maps": (POINTS,), "plane": PLANE, **options})


# ---- two deformations in one, and what is no step ------------------------------------------------------------------


def _pushes() -> tuple[Deformation, Deformation, Volume]:
    volume = Volume.from_array(np.random.default_rng(2).integers(0, 200, (10, 12, 14)).astype(np.uint8))
    one = Deformation.from_space_points(
        ControlPoints.from_arrays([[4.0, 5, 5]], [[5.0, 5.5, 5]]), support=6.0, trend="none"
    )
    corners = [[1.0, 1], [12, 1], [1, 8], [12, 8]]
    points = ControlPoints.from_arrays([*corners, [6, 4]], [*corners, [7, 5]])
    return one, Deformation.from_picture_points(volume.grid, "+y", points), volume


def test_a_deformation_then_another_is_one_with_the_steps_of_both() -> None:
    first, second, volume = _pushes()
    joined = replace(first, name="first").then(second)
    assert joined.steps == (*first.steps, *second.steps)
    assert joined.name == "first"
    places = np.random.default_rng(3).uniform(1, 9, (50, 3))
    by_hand = compose(first.field(volume.grid), second.field(volume.grid))
    np.testing.assert_array_equal(np.asarray(joined.field(volume.grid)(places)), np.asarray(by_hand(places)))
    box = volume.grid.resampled(margin=2.0)
    assert first.then(replace(second, output=box)).output == box
    assert replace(first, output=box).then(second).output == box
    assert replace(first, mode="blend").then(second).mode == "compose", "one step alone is the same in both modes"


def test_what_two_deformations_cannot_say_together_is_refused() -> None:
    first, second, _ = _pushes()
    several = replace(first, steps=first.steps * 2, mode="blend")
    for one, other in ((several, second), (second, several)):
        with pytest.raises(DeformError, match="one after the other"):
            one.then(other)
    animated = replace(first, keyframes=(Keyframe(1.0, first.steps),))
    for one, other in ((animated, second), (second, animated)):
        with pytest.raises(DeformError, match="key frames"):
            one.then(other)


@pytest.mark.parametrize(
    ("wrong", "way"),
    [
        (Identity(3), r"Identity.*warp\(volume, field\)"),
        (Deformation(), r"first\.then\(second\)"),
        (ControlPoints.from_arrays([[0.0, 0]], [[1.0, 0]]), "Deformation.from_picture_points"),
        (None, "NoneType"),
        ("a", "str 'a'"),
    ],
)
def test_what_is_no_step_is_refused_at_once(wrong: Any, way: str) -> None:
    first, _, _ = _pushes()
    for make in (
        lambda: Deformation((wrong,)),
        lambda: Keyframe(1.0, (*first.steps, wrong)),
        lambda: first.with_step(0, wrong),
    ):
        with pytest.raises(DeformError, match=way):
            make()


def test_what_is_no_list_of_steps_is_refused_at_once() -> None:
    first, _, _ = _pushes()
    with pytest.raises(DeformError, match="write"):
        Deformation(first.steps[0])  # type: ignore[arg-type]
    with pytest.raises(DeformError, match="list of Step, got Identity"):
        Deformation(Identity(3))  # type: ignore[arg-type]
    with pytest.raises(DeformError, match="of type Step, got Identity"):
        first.then(Identity(3))  # type: ignore[arg-type]
    with pytest.raises(DeformError, match="of type Keyframe"):
        Deformation(keyframes=first.steps)  # type: ignore[arg-type]
    with pytest.raises(DeformError, match="ControlPoints, got list"):
        Step(([[0.0, 0, 0]],), None)  # type: ignore[arg-type]
    with pytest.raises(DeformError, match="Plane or None, got str"):
        Step(first.steps[0].maps, "+y")  # type: ignore[arg-type]


def test_a_result_has_the_notes_of_its_volume_and_of_its_fits() -> None:
    values = np.random.default_rng(2).random((8, 8, 8))
    values[3, 3, 3] = np.nan
    volume = Volume.from_array(values)
    line = ControlPoints.from_arrays([[1.0, 4, 4], [4, 4, 4], [7, 4, 4]], [[1.0, 4, 4], [4, 5, 4], [7, 4, 4]])
    deformation = Deformation.from_space_points(line)
    own = deformation.notes(volume.grid)
    assert own
    assert deformation.apply(volume).notes == (*volume.notes, *own)
    assert "1 voxel is not finite" in volume.notes[0]
    assert warp(volume, deformation.field(volume.grid)).notes == volume.notes


def test_the_support_is_chosen_when_points_come_and_go_and_not_while_they_are_dragged() -> None:
    rng = np.random.default_rng(1)
    source = rng.uniform(0, 100, (9, 2))
    points = ControlPoints.from_arrays(source, source + rng.normal(0, 6, source.shape))
    step = Step((points,), PLANE)
    chosen = step.support_for(points)
    assert chosen == choose_support([points])
    dragged = step.with_points(points.move(3, [250.0, -90.0]))
    assert dragged.support_for(dragged.points) == chosen != choose_support([dragged.points])
    added = dragged.with_points(dragged.points.add([300.0, 300.0], [310.0, 305.0]))
    assert added.support_for(added.points) == choose_support([added.points], current=chosen)
    other = replace(added, kernel="gaussian")
    assert other.support_for(other.points) == choose_support([other.points], kernel="gaussian")
    fixed = replace(added, support=33.0)
    assert fixed.support_for(points) == 33.0
    assert fixed.chosen_support is None
    old = replace(added, support="box_diagonal")
    assert old.support_for(points) == np.linalg.norm(np.ptp(source, axis=0))
    with pytest.raises(DeformError, match="positive length, None or one of box_diagonal, got 'diagonal'"):
        replace(added, support="diagonal")
    with pytest.raises(DeformError, match="a radius and the name of a kernel, got 3"):
        replace(step, chosen_support=3)


SHIFT = Deformation.from_space_points(ControlPoints.from_arrays([[0, 0, 0]], [[1.5, 0, 0]]), trend="translation")
INPUT = Volume(np.arange(9 * 11 * 13, dtype=np.int16).reshape(GRID.shape), GRID, "a box")


def test_a_deformation_is_called_with_what_it_deforms() -> None:
    np.testing.assert_array_equal(SHIFT(INPUT).values, SHIFT.apply(INPUT).values)
    smaller = SHIFT(INPUT, output=INPUT[::2])
    np.testing.assert_array_equal(smaller.values, SHIFT.apply(INPUT, output=INPUT[::2]).values)
    assert SHIFT(INPUT.values.astype(float)).shape == GRID.shape
    two = Channels((INPUT, INPUT))
    assert len(SHIFT(two)) == 2
    moved = SHIFT(Landmarks(places()), INPUT)
    np.testing.assert_allclose(moved.points, places() + np.array([1.5, 0, 0]), atol=1e-6)
    np.testing.assert_array_equal(SHIFT(places(), grid=GRID), moved.points)
    np.testing.assert_array_equal(SHIFT(places().tolist(), grid=GRID), moved.points)
    np.testing.assert_array_equal(SHIFT(places()[0], grid=GRID), moved.points[0])
    mesh = Mesh(np.eye(3), [[0, 1, 2]])
    np.testing.assert_allclose(SHIFT(mesh, grid=GRID).points, np.eye(3) + np.array([1.5, 0, 0]), atol=1e-6)


def test_places_are_those_of_the_volume_that_a_deformation_was_made_on() -> None:
    steps = Deformation.from_picture_points(GRID, "+z", POINTS).steps
    known = Deformation(steps, volume=VolumeReference.of(INPUT))
    np.testing.assert_array_equal(known(places()), known(places(), grid=GRID))
    for call in (lambda: Deformation(steps)(places()), lambda: Deformation(steps)(Landmarks(places()))):
        with pytest.raises(DeformError, match=r"not known which volume .*: deformation\(points, grid=volume\)"):
            call()


def test_a_place_that_is_not_in_the_result_is_nan() -> None:
    opened = Deformation(
        (
            Step(
                (ControlPoints.from_arrays([[3, 10], [9, 10]], [[1, 10], [11, 10]]),),
                PLANE,
                trend="translation",
                cuts=(Cut(Line([(6, -50), (6, 50)])),),
                cut_rule="paper",
            ),
        )
    )
    volume_points = PLANE.from_plane(np.array([[2.0, 10.0], [5.9, 10.0], [6.1, 10.0]]))
    _, found = opened.warp_points(volume_points, GRID)
    moved = opened(volume_points, grid=GRID)
    np.testing.assert_array_equal(np.isnan(moved).any(axis=1), ~found)


def test_control_points_and_points_of_a_picture_are_not_deformed() -> None:
    with pytest.raises(DeformError, match="control points have two places each; deform one of them"):
        SHIFT(POINTS, grid=GRID)
    with pytest.raises(DeformError, match="points need 3 coordinates for this field"):
        SHIFT(POINTS.source, grid=GRID)
    with pytest.raises(DeformError, match="a Volume is needed"):
        SHIFT(3)
