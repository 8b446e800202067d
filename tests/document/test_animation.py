"""Animations: what turns does not shrink, key frames are met to the bit, and all moments fit into one array."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from deformnb.document.animation import Animation, TimeMaps, covering_raster
from deformnb.document.deformation import EASINGS, LOOPS, Deformation, Keyframe, Step
from deformnb.errors import DeformError
from deformnb.rbf.cuts import Cut
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Line, Polygon
from deformnb.rbf.rigid import RigidMotion, RigidPart
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid

GRID = Grid((8, 60, 80))
PLANE = Plane.from_view(GRID, "+z")
OTHER = Plane.from_view(GRID, "+y")

# A bar along a: its left half is fixed, the right one turns about (30, 30).
BODY = np.array([[10.0, 26.0], [10.0, 34.0], [20.0, 26.0], [20.0, 34.0], [30.0, 30.0]])
ARM = np.array([[40.0, 30.0], [50.0, 26.0], [50.0, 34.0], [60.0, 30.0]])
POINTS = ControlPoints.from_arrays(np.concatenate([BODY, ARM]))
TIP = 8


def turned(points: np.ndarray, degrees: float, about: tuple[float, float] = (30.0, 30.0)) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    x, y = (points - about).T
    return np.stack([c * x - s * y, s * x + c * y], axis=1) + about


def bent(degrees: float, points: ControlPoints = POINTS) -> ControlPoints:
    target = points.source.copy()
    target[5:] = turned(points.source[5:], degrees)
    return replace(points, target=target)


def step(points: ControlPoints, **options: Any) -> Step:
    return Step((points,), PLANE, **options)


def animation(*keys: tuple[float, Step | tuple[Step, ...]], **options: Any) -> Animation:
    frames = [Keyframe(t, s if isinstance(s, tuple) else (s,)) for t, s in keys]
    return Animation(Deformation(frames[0].steps, keyframes=tuple(frames)), **options)


def tip(deformation: Deformation) -> np.ndarray:
    return deformation.steps[0].points.target[TIP] - (30, 30)


# The length of the arm halfway on straight paths, cos(angle / 2): 0.966, 0.866, 0.707, 0.259.
@pytest.mark.parametrize(("degrees", "straight"), [(30, 0.966), (60, 0.866), (90, 0.707), (150, 0.259)])
def test_a_limb_keeps_its_length_where_a_blend_of_displacements_shrinks_it(degrees: float, straight: float) -> None:
    moving = animation((0, step(POINTS)), (2, step(bent(degrees))))
    lengths = [np.hypot(*tip(moving.at(t))) for t in np.linspace(0, 2, 17)]
    assert lengths == pytest.approx([30.0] * 17, rel=0.008)
    # The blend of both displacements, followed from the tip of the arm at rest.
    ends = [moving.at(t).steps[0].points for t in (0, 2)]
    chord = (ends[0].target[TIP] + ends[1].target[TIP]) / 2
    assert np.hypot(*(chord - (30, 30))) == pytest.approx(30 * straight, rel=2e-3)
    # The field of the moment really takes the tip there.
    half = moving.at(1.0)
    field = half.field(GRID)
    place = np.append(half.steps[0].points.target[TIP], 4.0)
    assert PLANE.to_plane(place + field.displacement(place))[:2] == pytest.approx([60, 30], abs=1e-5)


def test_key_frames_are_met_to_the_bit() -> None:
    steps = [step(bent(d), smoothing=s) for d, s in ((0, 0.0), (40, 0.1), (20, 0.0))]
    moving = animation((0.5, steps[0]), (1.0, steps[1]), (3.0, steps[2]))
    for t, wanted in ((0.0, 0), (0.5, 0), (1.0, 1), (3.0, 2), (9.0, 2)):
        assert moving.at(t).steps == (steps[wanted],), t
    assert moving.at(1.0).keyframes == ()
    assert moving.at(0.75).steps[0].smoothing == pytest.approx(0.05)
    assert moving.duration == 3.0


@pytest.mark.parametrize(("easing", "quarter"), [("linear", 0.25), ("smooth", 0.15625)])
def test_time_passes_as_the_easing_says(easing: str, quarter: float) -> None:
    moving = animation((0, step(POINTS)), (4, step(bent(80))), easing=easing)
    angle = np.degrees(np.arctan2(*tip(moving.at(1.0))[::-1]))
    assert angle == pytest.approx(80 * quarter, abs=0.3)
    assert [EASINGS[easing](t) for t in (0.0, 0.5, 1.0)] == [0.0, 0.5, 1.0]


def test_the_loop_says_what_comes_after_the_end() -> None:
    keys = ((0, step(POINTS)), (2, step(bent(60))))
    assert set(LOOPS) == {"once", "loop", "swing"}
    moments = {name: [animation(*keys, loop=name).moment(t) for t in (-0.5, 0, 1.5, 2, 2.5, 4.5)] for name in LOOPS}
    assert moments == {
        "once": [0, 0, 1.5, 2, 2, 2],
        "loop": [1.5, 0, 1.5, 2, 0.5, 0.5],
        "swing": [0.5, 0, 1.5, 2, 1.5, 0.5],
    }
    assert animation(*keys).times(2) == (0.0, 0.5, 1.0, 1.5, 2.0)
    assert animation(*keys, loop="loop").times(2) == (0.0, 0.5, 1.0, 1.5)
    assert animation(*keys, loop="swing").times(1) == (0.0, 1.0, 2.0, 1.0)


def test_a_point_that_was_added_later_changes_nothing_before() -> None:
    first = bent(50)
    later = first.add([45.0, 20.0], [45.0, 5.0])
    # Only a trend of the kernels' own energy is not changed by one more point that is on the map.
    moving = animation((0, step(first, trend="affine_exact")), (1, step(later, trend="affine_exact")))
    just = moving.at(1e-7)
    assert just.steps[0].points.ids == later.ids
    x = np.random.default_rng(0).uniform((5, 5, 0), (75, 55, 7), (200, 3))
    np.testing.assert_allclose(just.field(GRID).displacement(x), moving.at(0).field(GRID).displacement(x), atol=1e-3)
    end = moving.at(1 - 1e-7)
    np.testing.assert_allclose(end.field(GRID).displacement(x), moving.at(1).field(GRID).displacement(x), atol=1e-3)


def test_a_point_that_is_added_beside_a_cut_that_stops_begins_on_its_tissue() -> None:
    slit = {"cuts": (Cut(Line([(20, 31), (70, 33)], stops=(True, True))),)}
    first = bent(20)
    later = first.add([60.0, 20.0], [60.0, 5.0])
    moving = animation((0, step(first, **slit)), (1, step(later, **slit)))
    begun = moving.at(1e-9).steps[0].points
    (fits,) = moving.at(0).steps[0].fits_of_regions(GRID)
    at = begun.target[-1]
    assert np.linalg.norm(at - [60, 20]) > 0.3
    moves = [fit.displacement(at) for fit in fits.values()]
    assert min(np.linalg.norm(at + d - [60, 20]) for d in moves) < 1e-4


def test_a_point_that_is_switched_off_at_one_key_only_is_there_between() -> None:
    off = bent(50).edit(5, active=False)
    moving = animation((0, step(bent(50))), (1, step(off)))
    assert moving.at(0.5).steps[0].points.active.all()
    both = animation((0, step(off)), (1, step(off.move(8, [30, 55]))))
    assert both.at(0.5).steps[0].points.active.tolist() == off.active.tolist()


def test_a_step_that_comes_later_begins_with_nothing_dragged() -> None:
    other = Step((ControlPoints.from_arrays([[20.0, 4.0], [60.0, 4.0]], [[20.0, 4.0], [60.0, 10.0]]),), OTHER)
    moving = animation((0, (step(POINTS),)), (2, (step(POINTS), other)))
    assert len(moving.at(1).steps) == 2
    assert moving.at(1).steps[1].points.target[1] == pytest.approx([60, 7], abs=0.2)  # it turns about its neighbour
    off = animation((0, (replace(other, enabled=False),)), (2, (other,)))
    assert off.at(1).steps[0].enabled
    assert off.at(1).steps[0].points.target[1] == pytest.approx([60, 7], abs=0.2)
    turned_away = animation((0, (other,)), (2, (step(bent(60)),)))
    assert [s.plane for s in turned_away.at(1).steps] == [OTHER, PLANE]
    assert turned_away.at(1).steps[0].points.target[1] == pytest.approx([60, 7], abs=0.2)
    assert np.degrees(np.arctan2(*(turned_away.at(1).steps[1].points.target[TIP] - (30, 30))[::-1])) == pytest.approx(
        30, abs=1
    )


def test_strengths_turn_instead_of_shrinking() -> None:
    moving = animation((0, step(bent(90), strength=0.0)), (2, step(bent(90), strength=1.0)))
    half = moving.at(1).steps[0]
    assert half.strength == 1
    assert np.hypot(*(half.points.target[TIP] - (30, 30))) == pytest.approx(30, rel=0.01)


def test_numbers_go_evenly_and_what_has_nothing_between_switches() -> None:
    before = step(POINTS, support=40.0, extrusion="modulate", curve="z")
    after = step(POINTS, support=60.0, extrusion="modulate", curve=(1.0, 1.0), kernel="gaussian", name="end")
    moving = animation((0, before), (4, after))
    half = moving.at(2).steps[0]
    assert half.support == 50
    assert (half.curve[0], half.curve[-1]) == (0.5, 1.0)
    assert half.kernel == "wendland_c2"
    assert moving.notes == ("at 4 s the kernel of step 1 changes: it switches there.",)
    replicated = animation((0, step(POINTS)), (4, after)).at(1).steps[0]
    assert set(replicated.curve) == {1.0}
    keyed = Step((POINTS, bent(60)), PLANE, extrusion="interpolate", knots=(0.0, 0.5))
    moved = animation((0, keyed), (1, replace(keyed, knots=(0.5, 1.0)))).at(0.5).steps[0]
    assert moved.knots == (0.25, 0.75)
    spread = animation((0, step(POINTS)), (1, keyed)).at(0.5).steps[0]
    assert len(spread.maps) == 2
    hold = animation((0, before), (1, keyed))
    assert "extrusion" in hold.notes[0]
    assert hold.at(0.5).steps[0].extrusion == "modulate"


def test_rigid_parts_move_along_their_screw_and_take_their_points_along() -> None:
    box = Polygon([(35, 20), (65, 20), (65, 40), (35, 40)])
    motion = RigidMotion.turn(60, (30, 30))
    points = ControlPoints.from_arrays([[10, 10], [10, 50], [50, 30]], [[10, 10], [10, 50], motion([50, 30])])
    rest = points.reset()
    moving = animation((0, step(rest, parts=(RigidPart(box),))), (1, step(points, parts=(RigidPart(box, motion),))))
    half = moving.at(0.5)
    made = half.steps[0].parts[0].motion
    assert made is not None
    np.testing.assert_allclose(made([60, 30]), [30 + 30 * np.cos(np.pi / 6), 45], atol=1e-9)
    np.testing.assert_allclose(half.steps[0].points.target[2], made([50, 30]), atol=1e-9)
    half.field(GRID)  # a point that left its part would be refused
    assert moving.frame_count(10) == 7
    other = Polygon([(35, 20), (60, 20), (60, 40), (35, 40)])
    assert (
        "rigid parts"
        in animation((0, step(rest, parts=(RigidPart(box),))), (1, step(rest, parts=(RigidPart(other),)))).notes[0]
    )


def test_frames_lie_ten_degrees_apart_and_key_frames_are_among_them() -> None:
    moving = animation((0, step(POINTS)), (2, step(bent(90))))
    assert moving.frame_count() == 10
    assert moving.frame_count(5) == 19
    assert animation((0, step(POINTS)), (1, step(bent(40))), (4, step(POINTS))).frame_count() == 17  # a quarter is one
    assert animation((0, step(POINTS))).frame_count() == 1
    assert animation((0, step(POINTS)), (1, step(bent(40))), easing="smooth").frame_count() == 17
    with pytest.raises(DeformError, match="4096"):
        moving.frame_count(0.001)


@pytest.mark.parametrize("options", [{}, {"extrusion": "modulate", "curve": "1-z"}])
def test_all_moments_in_one_array_are_what_is_solved_for(options: dict[str, Any]) -> None:
    moving = animation((0, step(POINTS, **options)), (2, step(bent(90), **options)), (3, step(POINTS, **options)))
    maps = moving.stack(GRID)
    assert maps.values.shape == (28, 61, 81, 2)
    assert maps.values.dtype == np.float32
    assert maps.nbytes == 28 * 61 * 81 * 2 * 4
    assert maps.full_bytes(GRID) == 28 * 3 * 4 * 8 * 60 * 80
    x = np.random.default_rng(1).uniform((8, 8, 0), (72, 52, 7), (500, 3))
    for t in np.linspace(0, 3, 28):  # at the frames only the raster errs, between them time too
        assert np.abs(maps.field(t).displacement(x) - moving.field(t, GRID).displacement(x)).max() < 0.05, t
    worst = max(
        np.abs(maps.field(t).displacement(x) - moving.field(t, GRID).displacement(x)).max()
        for t in np.linspace(0.05, 2.95, 13)
    )
    assert worst < 0.3  # 30 (1 - cos 5 degrees) = 0.11 at the tip of the arm, more in the crease
    coarse = moving.stack(GRID, 4)
    assert len(coarse) == 4
    wrong = np.abs(coarse.field(1.5).displacement(x) - moving.field(1.5, GRID).displacement(x)).max()
    assert wrong > 5 * worst


def test_time_is_looked_up_between_frames_and_clamped() -> None:
    lattice = covering_raster(PLANE, GRID, 9)
    values = np.broadcast_to(np.array([0.0, 4.0, 8.0, 4.0], np.float32)[:, None, None, None], (4, *lattice.shape, 2))
    maps = TimeMaps(values, lattice, PLANE, (0.0, 7.0), (np.array([0.0, 1.0]), np.ones((1, 2))), 3.0)
    assert [float(maps.at(t).values[0, 0, 0]) for t in (-1, 0, 0.25, 1.5, 2.0, 2.5, 3, 8)] == [0, 0, 1, 6, 8, 6, 4, 4]
    for t in (0.1, 0.9, 1.7, 2.95):
        assert float(maps.at(t).values[0, 0, 0]) == pytest.approx(np.interp(t, range(4), [0, 4, 8, 4]), abs=1e-5)
    assert maps.times.tolist() == [0, 1, 2, 3]
    with pytest.raises(DeformError, match="shape"):
        replace(maps, values=values[..., :1])


def test_the_raster_covers_the_picture() -> None:
    lattice = covering_raster(PLANE, GRID)
    assert lattice.shape == (61, 81)
    assert lattice.origin == pytest.approx((-0.5, -0.5))
    assert (lattice.columns[-1], lattice.rows[-1]) == pytest.approx((79.5, 59.5))
    assert covering_raster(PLANE, GRID, 41).shape == (31, 41)


def test_what_cannot_be_animated_says_why() -> None:
    with pytest.raises(DeformError, match="no key frames"):
        Animation(Deformation((step(POINTS),)))
    with pytest.raises(DeformError, match="easing 'fast'"):
        animation((0, step(POINTS)), easing="fast")
    with pytest.raises(DeformError, match="loop 'twice'"):
        animation((0, step(POINTS)), loop="twice")
    with pytest.raises(DeformError, match="2 steps in use"):
        animation((0, (step(POINTS), step(POINTS)))).stack(GRID)
    space = ControlPoints.from_arrays([[1.0, 1, 1], [5, 5, 5]])
    with pytest.raises(DeformError, match="in space"):
        animation((0, Step((space,)))).stack(GRID)
    cut = step(POINTS, cuts=(Cut(Line([(40, 0), (40, 60)])),))
    with pytest.raises(DeformError, match="cut"):
        animation((0, cut)).stack(GRID)
    with pytest.raises(DeformError, match="'interpolate'"):
        animation((0, Step((POINTS,), PLANE, extrusion="interpolate", knots=(0.0,)))).stack(GRID)
    with pytest.raises(DeformError, match="one plane"):
        animation((0, step(POINTS)), (1, Step((POINTS,), OTHER))).stack(GRID)
    with pytest.raises(DeformError, match="frames"):
        animation((0, step(POINTS))).stack(GRID, 0)
    assert not animation((0, step(POINTS, enabled=False)), (1, step(POINTS))).stack(GRID, 2).values.any()


def test_points_in_space_turn_too() -> None:
    rng = np.random.default_rng(4)
    source = rng.uniform(10, 50, (20, 3))
    target = source.copy()
    target[:, :2] = turned(source[:, :2], 120)
    rest = ControlPoints.from_arrays(source)
    moving = animation((0, Step((rest,))), (1, Step((replace(rest, target=target),))))
    half = moving.at(0.5).steps[0].points.target
    np.testing.assert_allclose(half[:, :2], turned(source[:, :2], 60), atol=1e-8)
    np.testing.assert_allclose(half[:, 2], source[:, 2], atol=1e-8)
