"""Surfaces as volumes and back: distances against formulas, orientations, and meshes that follow a deformation."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from oracle import assert_close
from rbf.test_cuts import pushed

from deformnb.document.deformation import Deformation
from deformnb.errors import Cancelled, DeformError
from deformnb.io.meshes.formats import read_mesh
from deformnb.rbf.cuts import Decoupled
from deformnb.rbf.extrusion import extrude, replicate
from deformnb.rbf.fields import DisplacementField, Identity
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.mesh import Mesh, fill_distance, isosurface, signed_distance, warp_mesh
from deformnb.warping.points import Landmarks, warp_landmarks
from deformnb.warping.warper import warp

Array = NDArray[np.float64]

SQUARES = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
CUBE_FACES = np.array([t for a, b, c, d in SQUARES for t in ((a, b, c), (a, c, d))])


def cube(low: Any = (0, 0, 0), high: Any = (1, 1, 1)) -> Mesh:
    corners = np.array([[i, j, k] for k in (0, 1) for j in (0, 1) for i in (0, 1)], dtype=float)
    return Mesh(np.asarray(low) + corners * (np.asarray(high, dtype=float) - low), CUBE_FACES)


def sphere(radius: float, centre: Any = (0, 0, 0), rings: int = 96) -> Mesh:
    """Corners on the sphere; the flat faces are less than radius (pi / rings)^2 inside it."""
    theta, phi = np.linspace(0, np.pi, rings // 2 + 1)[1:-1], np.arange(rings) * 2 * np.pi / rings
    t, p = np.meshgrid(theta, phi, indexing="ij")
    rows = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1).reshape(-1, 3)
    points = np.concatenate([rows, [[0, 0, 1], [0, 0, -1]]])
    number = np.arange(len(rows)).reshape(t.shape)
    a, b, c, d = number[:-1], np.roll(number, -1, 1)[:-1], number[1:], np.roll(number, -1, 1)[1:]
    top, bottom = np.full(rings, len(rows)), np.full(rings, len(rows) + 1)
    faces = [
        (a, c, d),
        (a, d, b),
        (top, number[0], np.roll(number[0], -1)),
        (bottom, np.roll(number[-1], -1), number[-1]),
    ]
    return Mesh(np.asarray(centre) + radius * points, np.concatenate([np.stack(f, -1).reshape(-1, 3) for f in faces]))


def oblique(shape: tuple[int, int, int], spacing: Any, centre: Any, *, mirrored: bool = False) -> Grid:
    """A grid in no direction of space, around a place."""
    axis = np.array([1.0, 2.0, 3.0]) / math.sqrt(14)
    cross = np.cross(np.eye(3), axis)
    turn = np.eye(3) * math.cos(0.7) - math.sin(0.7) * cross + (1 - math.cos(0.7)) * np.outer(axis, axis)
    turn = turn @ np.diag([1, 1, -1 if mirrored else 1])
    first = np.asarray(centre) - turn @ (np.asarray(spacing) * (np.array(shape[::-1]) - 1) / 2)
    return Grid(shape, spacing, tuple(first), tuple(map(tuple, turn)))


def places(grid: Grid) -> Array:
    k, j, i = np.indices(grid.shape)
    return grid.index_to_point(np.stack([i, j, k], axis=-1))


def box_distance(points: Array, low: Any, high: Any) -> Array:
    """The signed distance to a straight box, by its formula."""
    half, centre = (np.asarray(high, float) - low) / 2, (np.asarray(high, float) + low) / 2
    q = np.abs(points - centre) - half
    return np.linalg.norm(np.maximum(q, 0), axis=-1) + np.minimum(q.max(axis=-1), 0)


# ---- meshes ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("points", "faces", "match"),
    [
        ([[0, 0, np.nan]], [], r"corner 0 of the mesh is not finite \(\[0.0, 0.0, nan\]\)"),
        ([[0, 0, 0]], [[0, 0, 1]], r"face 0 of the mesh has the corners \[0, 0, 1\], but there are only 1 corners"),
        ([[0, 0, 0]], [[0, -1, 0]], "face 0"),
        ([[0, 0]], [], r"the corners of a mesh must be numbers of shape \(n, 3\)"),
        ([[0, 0, 0]], [[0.5, 0, 0]], "the faces of a mesh must be whole numbers"),
        ([[0, 0, 0]], [[0, 0, 0, 0]], "shape"),
        ([["a", "b", "c"]], [], "numbers"),
    ],
)
def test_what_is_no_mesh_is_refused(points: Any, faces: Any, match: str) -> None:
    with pytest.raises(DeformError, match=match):
        Mesh(points, faces)


def test_a_mesh_keeps_its_own_arrays() -> None:
    given = np.zeros((3, 3))
    mesh = Mesh(given, [[0, 1, 2]])
    given[0] = 7
    assert mesh.points[0].tolist() == [0, 0, 0]
    assert not mesh.points.flags.writeable
    assert not mesh.faces.flags.writeable


def test_the_enclosed_volume_and_the_holes() -> None:
    body = cube((1, 2, 3), (3, 5, 7))
    assert body.enclosed == pytest.approx(24)
    assert Mesh(body.points, body.faces[:, ::-1]).enclosed == pytest.approx(-24)
    assert body.is_closed
    assert not Mesh(body.points, body.faces[1:]).is_closed
    soup = Mesh(body.points[body.faces].reshape(-1, 3), np.arange(36).reshape(-1, 3))  # as in an STL file
    assert soup.is_closed
    assert len(soup.merged().points) == 8
    assert not Mesh([], []).is_closed


def test_pyvista_and_back() -> None:
    body = cube()
    again = Mesh.from_pyvista(body.to_pyvista(), "again")
    np.testing.assert_array_equal(again.points, body.points)
    np.testing.assert_array_equal(again.faces, body.faces)
    assert again.name == "again"
    pyvista = pytest.importorskip("pyvista")
    polygons = pyvista.PolyData(np.array(body.points), faces=np.array([[4, *s] for s in SQUARES]).ravel())
    assert Mesh.from_pyvista(polygons).enclosed == pytest.approx(1)
    with pytest.raises(DeformError, match="takes a PolyData"):
        Mesh.from_pyvista(pyvista.ImageData(dimensions=(2, 2, 2)))


# ---- signed distance -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_cube_in_an_oblique_grid_of_long_voxels(mirrored: bool) -> None:
    low, high = (-4, 1, 2), (5, 9, 8)
    grid = oblique((40, 36, 30), (0.7, 0.5, 0.4), (0.5, 5, 5), mirrored=mirrored)
    found, wanted = signed_distance(cube(low, high), grid).values, box_distance(places(grid), low, high)
    near = np.abs(wanted) <= np.linalg.norm(grid.spacing)
    assert near.sum() > 4000
    assert_close(found[near], wanted[near], atol=1e-5)
    assert_close(found, wanted, atol=0.4)  # a voxel of 0.4 to 0.7, far away
    np.testing.assert_array_equal(found < 0, wanted < 0)
    assert found.dtype == np.float32


def test_a_sphere_against_the_formula() -> None:
    radius, centre = 20.0, np.array([3.0, -5.0, 40.0])
    volume = signed_distance(sphere(radius, centre), size=64)
    wanted = np.linalg.norm(places(volume.grid) - centre, axis=-1) - radius
    voxel = volume.grid.spacing[0]
    flat = radius * (np.pi / 96) ** 2
    assert flat < 0.05 * voxel
    near = np.abs(wanted) < 1.5 * voxel
    assert_close(volume.values[near], wanted[near], atol=0.05 * voxel)
    assert_close(volume.values, wanted, atol=0.75 * voxel)
    assert volume.grid.lengths == pytest.approx((48, 48, 48))  # a tenth of 40 on every side


def test_faces_turned_inside_out_and_mixed_ones() -> None:
    body = cube((0, 0, 0), (10, 10, 10))
    grid = Grid((16, 16, 16), origin=(-3, -3, -3))
    wanted = signed_distance(body, grid).values
    assert wanted[8, 8, 8] == -5
    np.testing.assert_array_equal(signed_distance(Mesh(body.points, body.faces[:, ::-1]), grid).values, wanted)
    faces = body.faces.copy()
    faces[::3] = faces[::3, ::-1]
    mixed = signed_distance(Mesh(body.points, faces), grid)
    np.testing.assert_array_equal(mixed.values, wanted)
    assert "do not agree on their outside" in mixed.notes[0]


def test_overlapping_bodies_and_a_cavity() -> None:
    a, b = cube((0, 0, 0), (10, 10, 10)), cube((6, 0, 0), (16, 10, 10))
    both = Mesh(np.concatenate([a.points, b.points]), np.concatenate([a.faces, b.faces + 8]))
    grid = Grid((14, 14, 20), origin=(-2, -2, -2))
    assert signed_distance(both, grid).values[7, 7, 10] < 0  # x = 8, where they overlap
    hole = cube((3, 3, 3), (7, 7, 7))
    hollow = Mesh(np.concatenate([a.points, hole.points]), np.concatenate([a.faces, hole.faces[:, ::-1] + 8]))
    values = signed_distance(hollow, grid).values
    assert values[7, 7, 7] == 2  # in the middle of the hole
    assert values[7, 7, 3] == -1


def test_corners_exactly_on_voxels() -> None:
    grid = Grid((12, 12, 12))
    found = signed_distance(cube((2, 3, 4), (8, 9, 10)), grid).values
    wanted = box_distance(places(grid), (2, 3, 4), (8, 9, 10))
    assert_close(np.abs(found), np.abs(wanted), atol=1e-6)
    off = np.abs(wanted) > 1e-9
    np.testing.assert_array_equal((found < 0)[off], (wanted < 0)[off])


def test_slivers_and_doubled_corners_do_no_harm() -> None:
    body = cube((0, 0, 0), (10, 10, 10))
    # An edge of the cube (0, 1) gets a corner in its middle, and the two faces there a neighbour that is a line.
    more = np.concatenate([body.points, [[5, 0, 0]]])
    faces = np.concatenate([body.faces, [[0, 8, 1], [0, 1, 8]]])
    grid = Grid((16, 16, 16), origin=(-3.3, -3.1, -3.2))
    wanted = signed_distance(body, grid).values
    assert_close(signed_distance(Mesh(more, faces), grid).values, wanted, atol=1e-6)


def test_a_part_of_a_body_in_a_smaller_grid() -> None:
    grid = Grid((8, 8, 8), origin=(-4.25, 1.75, 2.25))
    found = signed_distance(cube((0, 0, 0), (10, 10, 10)), grid).values
    wanted = box_distance(places(grid), (0, 0, 0), (10, 10, 10))
    np.testing.assert_array_equal(found < 0, wanted < 0)
    near = np.abs(places(grid)[..., 0]) < 1
    assert_close(found[near], wanted[near], atol=1e-5)


@pytest.mark.parametrize(
    ("mesh", "options", "match"),
    [
        (Mesh(cube().points, CUBE_FACES[2:]), {}, "is open: 4 edges have no face on their other side.*Close its holes"),
        (Mesh([], []), {}, "no faces"),
        (cube(), {"size": 1}, "size must be a whole number"),
        (cube(), {"size": 12.5}, "size must be a whole number"),
        (cube(), {"margin": -1}, "margin must be a length"),
        (cube(), {"margin": math.nan}, "margin must be a length"),
        (cube(), {"grid": Grid((4, 4, 4), origin=(50, 0, 0))}, "no face of the mesh passes through the grid"),
    ],
)
def test_mistakes_are_named(mesh: Mesh, options: dict[str, Any], match: str) -> None:
    with pytest.raises(DeformError, match=match):
        signed_distance(mesh, **options)


def test_progress_rises_to_one_and_may_cancel() -> None:
    seen: list[float] = []
    signed_distance(cube(), size=48, progress=seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == 1.0

    def cancel(_: float) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        signed_distance(cube(), size=48, progress=cancel)


def test_a_filled_body() -> None:
    body = signed_distance(cube((0, 0, 0), (10, 10, 10)), Grid((16, 16, 16), (1, 1, 1), (-3, -3, -3)))
    grey = fill_distance(body)
    assert grey.dtype == np.uint8
    assert grey.values[8, 8, 2:8].tolist() == [64, 128, 191, 255, 255, 255]  # at x = -1, 0, 1, 2, ...
    assert grey.background == 0
    assert fill_distance(body, ramp=8).values[8, 8, 5] == 191
    again = isosurface(grey, 127.5, inside="above")
    assert again.enclosed == pytest.approx(1000, rel=0.01)
    with pytest.raises(DeformError, match="ramp must be a positive length"):
        fill_distance(body, ramp=0)


# ---- isosurfaces -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mirrored", [False, True])
def test_an_isosurface_lies_in_space_and_looks_outwards(mirrored: bool) -> None:
    centre = np.array([11.0, -7.0, 3.0])
    grid = oblique((40, 44, 48), (0.5, 0.55, 0.6), centre, mirrored=mirrored)
    ball = Volume(np.linalg.norm(places(grid) - centre, axis=-1) - 8, grid)
    found = isosurface(ball)
    assert_close(np.linalg.norm(found.points - centre, axis=1), 8, atol=0.02)
    assert found.is_closed
    assert found.enclosed == pytest.approx(4 / 3 * np.pi * 8**3, rel=0.005)
    above = isosurface(Volume(100 - ball.values, grid), 100, inside="above")
    assert above.enclosed == pytest.approx(found.enclosed, rel=1e-4)


@pytest.mark.parametrize("dtype", [np.uint8, np.bool_, np.int16, np.float64])
def test_isosurfaces_of_all_kinds_of_voxels(dtype: Any) -> None:
    values = np.zeros((6, 7, 8), dtype)
    values[2:4, 2:5, 2:6] = 1
    found = isosurface(Volume.from_array(values), 0.5, inside="above")
    assert_close(found.box, [[1.5, 1.5, 1.5], [5.5, 4.5, 3.5]])


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"level": 3}, "no surface has the value 3: the volume's values go from 0 to 1"),
        ({"level": 0}, "no surface has the value 0: .* must lie between them"),
        ({"level": math.nan}, "no surface has the value nan"),
        ({"level": 0.5, "inside": "left"}, "'below' or 'above'"),
    ],
)
def test_no_surface(options: dict[str, Any], match: str) -> None:
    with pytest.raises(DeformError, match=match):
        isosurface(Volume.from_array(np.eye(3)[None].repeat(3, 0)), **options)


def test_mesh_to_distance_to_mesh() -> None:
    body = sphere(10)
    volume = signed_distance(body, size=48)
    again = isosurface(warp(volume, Identity()))
    voxel = volume.grid.spacing[0]
    assert_close(np.linalg.norm(again.points, axis=1), 10, atol=0.1 * voxel)
    assert again.is_closed
    assert again.enclosed == pytest.approx(body.enclosed, rel=0.005)


# ---- meshes that follow ----------------------------------------------------------------------------------------------


def bend(radius: float) -> Deformation:
    corners = float(radius) * np.array([[i, j, k] for i in (-2, 2) for j in (-2, 2) for k in (-2, 2)])
    source = np.concatenate([corners, [[0, 0, radius], [0, 0, -radius], [radius, 0, 0]]])
    target = source.copy()
    target[8] += [0.3 * radius, 0, 0.4 * radius]
    target[10] += [0, 0.3 * radius, 0]
    return Deformation.from_space_points(ControlPoints.from_arrays(source, target), kernel="thin_plate")


def test_the_mesh_moves_to_where_the_volume_moves() -> None:
    body = sphere(10)
    volume = signed_distance(body, size=64, margin=6)
    field = bend(10).field(volume.grid)
    directly = warp_mesh(body, field)
    assert directly.notes == ()
    moved = isosurface(warp(volume, field, fill=volume.value_range[1]))
    # Distances of one surface's corners to the other surface, both ways.
    voxel, there = volume.grid.spacing[0], signed_distance(directly, volume.grid)
    at = volume.grid.point_to_index(moved.points)
    from scipy.ndimage import map_coordinates

    off = map_coordinates(there.values, at.T[::-1], order=1)
    assert np.abs(off).max() < 0.5 * voxel
    assert np.abs(directly.points - body.points).max() > 3
    assert moved.enclosed == pytest.approx(directly.enclosed, rel=0.01)


def test_labels_mesh_and_points_of_a_thing_end_at_the_same_place() -> None:
    grid = oblique((48, 48, 48), (0.6, 0.6, 0.6), (0, 0, 0))
    thing = sphere(6, (1, -1, 0))
    distance = signed_distance(thing, grid)
    labels = Volume((distance.values < 0).astype(np.uint8) * 7, grid, is_labels=True)
    field = bend(6).field(grid)
    warped = warp(labels, field)
    assert set(np.unique(warped.values)) == {0, 7}
    moved = warp_mesh(thing, field)
    marks = warp_landmarks(Landmarks(thing.points[::97]), field)
    assert_close(marks.points, moved.points[::97], atol=1e-4)
    inside = signed_distance(moved, grid).values < 0
    assert np.count_nonzero(inside != (warped.values == 7)) < 0.1 * np.count_nonzero(inside)  # half a voxel at most
    centre = places(grid)[warped.values == 7].mean(axis=0)
    assert_close(centre, places(grid)[inside].mean(axis=0), atol=0.1)


def test_corners_without_a_place_follow_their_neighbours() -> None:
    # The result shows x < 8 of the input shifted by 5; nothing of it comes from between 8 and 13.
    grid = Grid((2, 2, 21))
    values = np.zeros((2, 2, 21, 3), dtype=np.float32)
    values[:, :, 9:, 0] = 5
    torn = DisplacementField(values, grid)
    mesh = Mesh([[2, 0.5, 0.5], [20, 0.5, 0.5], [10.5, 0.9, 0.5]], [[0, 1, 2]])
    moved = warp_mesh(mesh, torn)
    assert moved.points[:2, 0] == pytest.approx([2, 15], abs=1e-5)
    assert np.isfinite(moved.points).all()
    if moved.notes:
        assert "follow their neighbours" in moved.notes[0]


def test_corners_hidden_at_a_cut_are_counted_and_the_others_come_back() -> None:
    grid = Grid((4, 100, 100))
    flat = pushed(4.0, -3.0, rule="paper")
    plane = Plane.from_view(grid, "+z")
    cut = Decoupled(
        tuple(extrude(plane, grid, [f], replicate()) for f in flat.fields), flat.sides, flat.regions, plane, "paper"
    )
    mesh = Mesh([[20, 30, 1], [48, 30, 1], [51, 60, 2], [70, 30, 1], [44, 20, 1]], [[0, 1, 2], [2, 3, 4]])
    moved = warp_mesh(mesh, cut)
    assert moved.notes[0].startswith("2 of 5 corners have no place in the result")
    back = moved.points + cut.displacement(moved.points)
    assert_close(back[[0, 3, 4]], mesh.points[[0, 3, 4]], atol=1e-4)
    assert_close(moved.points[[0, 3, 4], 0], [24, 67, 48], atol=1e-4)


def test_a_field_that_shows_one_place_everywhere_moves_nothing_to_infinity() -> None:
    grid = Grid((2, 2, 2), (1e3, 1e3, 1e3), (-500, -500, -500))
    crush = DisplacementField(-places(grid), grid)
    moved = warp_mesh(cube((1, 1, 1), (2, 2, 2)), crush)
    assert np.isfinite(moved.points).all()
    note = "8 of 8 corners have no place in the result: the map folds there, or a cut hides them; they follow their"
    assert moved.notes == (f"{note} neighbours",)
    np.testing.assert_array_equal(moved.faces, CUBE_FACES)


def test_a_field_of_a_picture_is_refused() -> None:
    with pytest.raises(DeformError, match="extrude the field of a plane first"):
        warp_mesh(cube(), Identity(2))


# ---- the real horse --------------------------------------------------------------------------------------------------


@pytest.mark.nightly
def test_the_horse_of_the_paper(real_data: Callable[[str], Path]) -> None:
    horse = read_mesh(real_data("horse.ply"))
    assert horse.points.shape == (48485, 3)
    assert horse.is_closed
    volume = signed_distance(horse, size=128)
    assert max(volume.shape) == 128
    again = isosurface(volume)
    assert again.enclosed == pytest.approx(abs(horse.enclosed), rel=0.01)
    assert_close(again.box, horse.box, atol=volume.grid.spacing[0])  # ears end in a point
