"""The demonstration: a fish becomes another one, on the grid and in the volume, and every file of it makes sense."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import oracle
import pytest
from matplotlib.path import Path as Outline
from PIL import Image

from deformnb.datasets import PHANTOMS, thompson_pairs
from deformnb.datasets.darcy import grid_lines
from deformnb.errors import Cancelled, DeformError
from deformnb.imaging.demo import (
    FILES,
    Demonstration,
    Transformation,
    check_demo,
    deformed_grid,
    field_of_view,
    run_demo,
    source_figure,
    subdivide,
    subject_box,
    transform,
)
from deformnb.io import read_volume
from deformnb.io.documents import read_deformation
from deformnb.volume.plane import Picture, Plane, Raster
from deformnb.volume.volume import Grid, Volume

SHAPE = (48, 96, 40)


def quiet(_: str) -> Callable[[float], None]:
    return lambda share: None


@pytest.fixture(scope="module")
def fish() -> Volume:
    return PHANTOMS["fish"].make(SHAPE)


@pytest.fixture(scope="module")
def antigonia(fish: Volume) -> Transformation:
    return transform(fish, stage=quiet)


@pytest.fixture(scope="module")
def small() -> Volume:
    """A fish for tests of written files and leftovers: both renderings of it take a tenth of the time."""
    return PHANTOMS["fish"].make((24, 48, 20))


@pytest.fixture(scope="module")
def done(small: Volume, tmp_path_factory: pytest.TempPathFactory) -> tuple[Demonstration, Path]:
    folder = tmp_path_factory.mktemp("demo")
    return run_demo(folder, volume=small, renderer="core", stage=quiet), folder


def inside(nodes: np.ndarray, raster: Raster) -> np.ndarray:
    """Mask of the pixels inside the outline of a grid (rows, columns, 2)."""
    rim = np.concatenate([nodes[0], nodes[1:, -1], nodes[-1, -2::-1], nodes[-2:0:-1, 0]])
    return Outline(rim).contains_points(raster.points().reshape(-1, 2)).reshape(raster.shape)


# ---- the transformation ----------------------------------------------------------------------------------------------


def test_nodes_go_to_nodes(antigonia: Transformation) -> None:
    (fit,) = antigonia.deformation.steps[0].fits(antigonia.volume.grid)
    source, target = (n.reshape(-1, 2) for n in (antigonia.grids.source_nodes, antigonia.grids.target_nodes))
    # Backwards, the target node is looked up at the source node; in a fish of 512 mm, within the promise of 1e-9.
    oracle.assert_close(target + fit.displacement(target), source, atol=1e-9 * 512)


def test_the_drawn_grid_goes_through_the_target_nodes(antigonia: Transformation) -> None:
    for before, after, line in zip(
        antigonia.grid_before, antigonia.grid_after, grid_lines(antigonia.grids.target_nodes), strict=True
    ):
        assert before.shape == after.shape
        oracle.assert_close(after[::12], line, atol=0.01)  # the inversion ends at 1e-6 of the extent


def test_the_fish_fills_the_target_grid_as_it_filled_the_source_grid(antigonia: Transformation) -> None:
    a = antigonia
    before, after = a.before.grey() > 0.08, a.after.grey() > 0.08
    fills = []
    for body, nodes, picture in ((before, a.grids.source_nodes, a.before), (after, a.grids.target_nodes, a.after)):
        grid = inside(nodes, picture.raster)
        assert (body & grid).sum() > 0.97 * body.sum()  # the fish is inscribed
        fills.append((body & grid).sum() / grid.sum())
    assert fills[1] == pytest.approx(fills[0], abs=0.1)  # the map is not even: the belly grows more than the tail


def test_the_silhouette_is_the_old_one_carried_by_the_map(antigonia: Transformation) -> None:
    a = antigonia
    (fit,) = a.deformation.steps[0].fits(a.volume.grid)
    points = a.after.raster.points()
    looked_up = points + fit.displacement(points.reshape(-1, 2)).reshape(points.shape)
    (du, dv), (a0, b0), (nv, nu) = a.before.raster.spacing, a.before.raster.origin, a.before.raster.shape
    col, row = np.round((looked_up[..., 0] - a0) / du).astype(int), np.round((looked_up[..., 1] - b0) / dv).astype(int)
    known = (col >= 0) & (col < nu) & (row >= 0) & (row < nv)
    old = np.where(known, (a.before.grey() > 0.08)[row.clip(0, nv - 1), col.clip(0, nu - 1)], False)
    new = a.after.grey() > 0.08
    dice = 2 * (old & new).sum() / (old.sum() + new.sum())
    assert dice > 0.95  # edges of pixels of 5 mm


def test_the_fish_became_deep_and_kept_its_area(antigonia: Transformation) -> None:
    boxes = [subject_box(p, margin=0) for p in (antigonia.before, antigonia.after)]
    slender, deep = ((b[3] - b[2]) / (b[1] - b[0]) for b in boxes)
    assert deep > 1.5 * slender
    areas = [
        (p.grey() > 0.08).sum() * p.raster.spacing[0] * p.raster.spacing[1] for p in (antigonia.before, antigonia.after)
    ]
    assert areas[1] == pytest.approx(areas[0], rel=0.2)  # the grid does so exactly, its content about


def test_nothing_moves_along_the_direction_of_looking(antigonia: Transformation) -> None:
    a = antigonia
    values = a.volume.values.copy()
    values[..., 20:] = 0  # half of the fish is cut away: half of the result is missing, the rest is as before
    half = a.deformation.apply(Volume(values, a.volume.grid), output=a.warped.grid).values
    np.testing.assert_array_equal(half[..., :20], a.warped.values[..., :20])
    assert half[..., 20:].max() == 0


@pytest.mark.sampled(5)
@pytest.mark.parametrize("pair", thompson_pairs(), ids=lambda pair: pair[1])
def test_every_pair_of_thompson_works(pair: tuple[str, str], fish: Volume) -> None:
    source, target = pair
    result = transform(fish, species=target, stage=quiet)
    assert result.grids.source.species.startswith(source)
    body = result.after.grey() > 0.08
    assert (body & inside(result.grids.target_nodes, result.after.raster)).sum() > 0.93 * body.sum()


def test_a_fish_that_looks_right_is_the_mirror_image(fish: Volume) -> None:
    left = transform(fish, view="-x", head="left", stage=quiet)
    right = transform(fish, view="+x", head="right", stage=quiet)
    assert left.after.values.shape == right.after.values.shape
    difference = np.abs(left.after.values.astype(int) - right.after.values[:, ::-1])
    assert (difference > 8).mean() < 0.01


@pytest.mark.parametrize("direction", [np.diag([-1.0, -1, 1]), np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]])])
def test_however_the_volume_is_stored(direction: np.ndarray, antigonia: Transformation) -> None:
    # The same voxels at the same places in space, stored in another order of axes.
    volume = antigonia.volume
    at = np.linalg.inv(np.asarray(volume.grid.direction)) @ direction  # the new index axes in the old ones
    order = np.abs(at).argmax(axis=0)
    values = volume.values.transpose([2 - int(order[2 - k]) for k in range(3)])
    flips = [at[order[2 - k], 2 - k] < 0 for k in range(3)]
    stored = np.ascontiguousarray(values[tuple(slice(None, None, -1 if f else None) for f in flips)])
    spacing = tuple(volume.grid.spacing[int(o)] for o in order)
    first = np.zeros(3)
    for k, o in enumerate(order):
        first[o] = volume.shape[2 - int(o)] - 1 if at[o, k] < 0 else 0
    origin = tuple(volume.grid.index_to_point(first))
    other = Volume.from_array(stored, spacing, origin, tuple(map(tuple, direction.tolist())))
    again = transform(other, stage=quiet)
    np.testing.assert_array_equal(again.before.values, antigonia.before.values)
    assert again.after.values.shape == antigonia.after.values.shape
    difference = np.abs(again.after.values.astype(int) - antigonia.after.values)
    assert (difference > 1).mean() < 0.001  # float32 sums in another order


def test_the_margin_repeats_the_field_of_view(antigonia: Transformation) -> None:
    grown = antigonia.volume.grid.resampled(margin=antigonia.margin)
    index = grown.point_to_index(antigonia.warped.grid.origin)
    oracle.assert_close(index, np.round(index), atol=1e-6)
    assert (index > -0.5).all()
    last = index + np.array(antigonia.warped.shape[::-1]) - 1
    assert (last < np.array(grown.shape[::-1]) - 0.5).all()


# ---- parts -----------------------------------------------------------------------------------------------------------


def spot(values: np.ndarray) -> Picture:
    plane = Plane((0, 0, 0), (1, 0, 0), (0, 0, -1))
    return Picture(values, plane, Raster(values.shape, (2.0, 1.0), (10.0, -5.0)), "mip", (0, 1))


def test_the_box_lies_around_what_is_bright() -> None:
    values = np.zeros((50, 60))
    values[10:31, 20:51] = 1
    assert subject_box(spot(values), margin=0) == (50, 110, 5, 25)
    assert subject_box(spot(values), margin=0.1) == (44, 116, 3, 27)


def test_noise_and_a_stray_pixel_do_not_stretch_the_box() -> None:
    values = np.random.default_rng(1).uniform(0, 0.05, (200, 300))
    values[100:150, 100:200] = 1
    values[3, 5] = 1
    assert subject_box(spot(values), margin=0) == (210, 408, 95, 144)


@pytest.mark.parametrize("values", [np.zeros((5, 5)), np.full((5, 5), -1000.0)])
def test_an_empty_picture_is_refused(values: np.ndarray) -> None:
    with pytest.raises(DeformError, match="nothing on the picture"):
        subject_box(spot(values))


def test_a_line_is_too_thin() -> None:
    values = np.zeros((9, 9))
    values[4, 2:8] = 1
    with pytest.raises(DeformError, match="too thin"):
        subject_box(spot(values))


def test_refined_lines_keep_their_corners() -> None:
    line = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 8.0]])
    fine = subdivide(line, parts=4)
    assert fine.tolist() == [[0, 0], [1, 0], [2, 0], [3, 0], [4, 0], [4, 2], [4, 4], [4, 6], [4, 8]]


def test_the_field_of_view_holds_the_grid_and_the_volume(antigonia: Transformation) -> None:
    a = antigonia
    plane = a.deformation.steps[0].plane
    assert plane is not None
    grid = field_of_view(a.volume.grid, plane, a.grids)
    a0, a1, b0, b1 = a.after.raster.box
    nodes = a.grids.target_nodes.reshape(-1, 2)
    assert (nodes >= [a0, b0]).all()
    assert (nodes <= [a1, b1]).all()
    for corner in a.volume.grid.corners(centres=True):
        index = grid.point_to_index(corner)
        assert (index >= -1e-6).all()
        assert (index <= np.array(grid.shape[::-1]) - 1 + 1e-6).all()


def test_grids_of_a_still_map_stay(antigonia: Transformation) -> None:
    still = antigonia.deformation.scaled(0.0)
    moved = deformed_grid(antigonia.grid_before, still, antigonia.volume)
    for before, after in zip(antigonia.grid_before, moved, strict=True):
        oracle.assert_close(after, before, atol=1e-9 * 512)


# ---- the files -------------------------------------------------------------------------------------------------------


def test_all_files_are_there_and_nothing_else(done: tuple[Demonstration, Path]) -> None:
    demonstration, folder = done
    assert {p.name for p in folder.iterdir()} == set(FILES) - {"volume.nii.gz"}
    assert sorted(path.name for _, path in demonstration.written) == sorted(p.name for p in folder.iterdir())
    for name in FILES[:4]:
        with Image.open(folder / name) as image:
            assert min(image.size) > 100
            assert np.asarray(image.convert("L")).std() > 10  # something is drawn


def test_the_written_volume_is_the_deformed_one(done: tuple[Demonstration, Path]) -> None:
    demonstration, folder = done
    warped = read_volume(folder / "warped.nii.gz")
    np.testing.assert_array_equal(warped.values, demonstration.result.warped.values)
    oracle.assert_close(warped.grid.affine, demonstration.result.warped.grid.affine, atol=1e-4)  # NIfTI's float32


def test_the_written_session_does_the_same_again(done: tuple[Demonstration, Path]) -> None:
    demonstration, folder = done
    result = demonstration.result
    again = read_deformation(folder / "session.json")
    assert again.volume is not None
    assert again.volume.matches(result.volume)
    np.testing.assert_array_equal(again.apply(result.volume, output=result.warped.grid).values, result.warped.values)


@pytest.mark.nightly
def test_the_carp_that_it_makes_is_written_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kind, make = type(PHANTOMS["fish"]), type(PHANTOMS["fish"]).make
    monkeypatch.setattr(kind, "make", lambda self, _shape=None, **options: make(self, (24, 48, 20), **options))
    stages: list[str] = []

    def stage(name: str) -> Callable[[float], None]:
        stages.append(name)
        return lambda share: None

    demonstration = run_demo(tmp_path, renderer="core", stage=stage)
    carp = read_volume(tmp_path / "volume.nii.gz")
    assert demonstration.result.deformation.volume is not None
    assert demonstration.result.deformation.volume.matches(carp)
    assert stages == [
        "make a carp",
        "project it from the side",
        "deform it",
        "project the result",
        "render both volumes",
        "write the carp",
        "write the deformed volume",
    ]
    assert all(len(name) <= 28 for name in stages)  # the width of the bars


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    "stop_at", ["project it from the side", "deform it", "render both volumes", "write the deformed volume"]
)
def test_it_can_be_stopped_anywhere(stop_at: str, small: Volume, tmp_path: Path) -> None:
    def stage(name: str) -> Callable[[float], None]:
        def move(share: float) -> None:
            if name == stop_at:
                raise Cancelled

        return move

    with pytest.raises(Cancelled):
        run_demo(tmp_path, volume=small, renderer="core", stage=stage)
    assert {p.name for p in tmp_path.iterdir()} <= set(FILES)


# ---- mistakes --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("choices", "match"),
    [
        (("Cyprinus", "-x", "core"), "no figure.*Antigonia"),
        (("Diodon", "-x", "core"), "do not correspond"),
        (("", "-x", "core"), "no figure"),
        (("Antigonia", "front", "core"), r"unknown view 'front'.*\+x"),
        (("Antigonia", "-x", "povray"), "unknown renderer"),
    ],
)
def test_choices_are_checked_before_the_work(choices: tuple[str, str, str], match: str, tmp_path: Path) -> None:
    with pytest.raises(DeformError, match=match):
        check_demo(*choices)

    def stage(_: str) -> Any:
        pytest.fail("the work has begun")

    with pytest.raises(DeformError, match=match):
        run_demo(tmp_path, species=choices[0], view=choices[1], renderer=choices[2], stage=stage)


@pytest.mark.parametrize("pair", thompson_pairs(), ids=lambda pair: pair[1])
def test_every_species_starts_from_the_figure_beside_it(pair: tuple[str, str]) -> None:
    source, target = pair
    assert source_figure(target) == source
    check_demo(target.split()[0], "-x", "core")


def test_help_names_the_species(capsys: pytest.CaptureFixture[str]) -> None:
    from deformnb.cli.main import main

    assert main(["demo", "--help"]) == 0
    out = capsys.readouterr().out
    for _, target in thompson_pairs():
        assert target.split()[0] in out


def test_an_empty_volume_is_refused() -> None:
    with pytest.raises(DeformError, match="nothing on the picture"):
        transform(Volume(np.zeros((8, 9, 10), np.uint8), Grid((8, 9, 10))), stage=quiet)


def test_the_real_carp_becomes_a_boarfish(real_data: Any) -> None:
    volume = read_volume(real_data("carp.nii.gz"), spacing=(0.390625, 1.0, 0.78125), stride=4)
    result = transform(volume, stage=quiet)
    body = result.after.grey() > 0.08
    assert (body & inside(result.grids.target_nodes, result.after.raster)).sum() > 0.97 * body.sum()
    boxes = [subject_box(p, margin=0) for p in (result.before, result.after)]
    slender, deep = ((b[3] - b[2]) / (b[1] - b[0]) for b in boxes)
    assert slender == pytest.approx(0.305, abs=0.03)  # as the animal is
    assert deep == pytest.approx(0.65, abs=0.06)  # as the grid of Antigonia makes it
