"""Grids place voxels; volumes take every array they can store exactly and refuse the others by name."""

from __future__ import annotations

import gc
import mmap
import os
import pickle
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from deformnb import DeformError, Grid, Volume
from deformnb.datasets import PHANTOMS
from deformnb.errors import FileChangedError
from deformnb.io import read_volume
from deformnb.volume.volume import DTYPES, IDENTITY, KEPT, NOTHING_TO_SEE

ANISOTROPIC = (0.5, 1.25, 3.0)
ORIGIN = (-12.5, 7.0, 101.25)


def rotation(seed: int, *, mirrored: bool = False) -> np.ndarray:
    """Any orthonormal matrix, right-handed unless mirrored."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    if (np.linalg.det(q) < 0) != mirrored:
        q[:, 0] *= -1
    return q


def oblique(shape: tuple[int, int, int] = (3, 4, 5), seed: int = 1, *, mirrored: bool = False) -> Grid:
    return Grid(shape, ANISOTROPIC, ORIGIN, rotation(seed, mirrored=mirrored).tolist())


def numbers(shape: tuple[int, int, int] = (3, 4, 5), dtype: str = "int16") -> np.ndarray:
    return (np.arange(np.prod(shape)) % 100).reshape(shape).astype(dtype)


# -- Grid ------------------------------------------------------------------------------------------------------------


@given(st.integers(0, 10**6), st.booleans())
def test_point_is_origin_plus_direction_times_spacing_times_index(seed: int, mirrored: bool) -> None:
    grid = oblique(seed=seed, mirrored=mirrored)
    index = np.random.default_rng(seed).uniform(-5, 5, 3)
    point = np.array(ORIGIN) + rotation(seed, mirrored=mirrored) @ (np.array(ANISOTROPIC) * index)
    # rounding of a 3 x 3 product of coordinates of about 100
    np.testing.assert_allclose(grid.index_to_point(index), point, rtol=0, atol=1e-10)
    np.testing.assert_allclose(grid.point_to_index(point), index, rtol=0, atol=1e-10)


@given(st.integers(0, 10**6), st.booleans())
def test_the_affine_holds_the_whole_grid(seed: int, mirrored: bool) -> None:
    grid = oblique(seed=seed, mirrored=mirrored)
    again = Grid.from_affine(grid.shape, grid.affine)
    np.testing.assert_allclose(again.affine, grid.affine, rtol=0, atol=1e-13)
    np.testing.assert_allclose(again.spacing, ANISOTROPIC, rtol=1e-14)


@pytest.mark.parametrize(
    ("affine", "words"),
    [
        (np.diag([1, 0, 1, 1]), "singular"),
        ([[1, 1, 0, 0], [0, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], "singular"),
        ([[1, 0.1, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], "sheared"),
        (np.full((4, 4), np.nan), "finite"),
        (np.eye(3), "4 x 4"),
    ],
)
def test_an_affine_that_is_no_grid_is_refused(affine: object, words: str) -> None:
    with pytest.raises(DeformError, match=words):
        Grid.from_affine((2, 2, 2), affine)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"spacing": (1, 0, 1)}, "spacing must be positive"),
        ({"spacing": (1, -1, 1)}, "flipped axis belongs into direction"),
        ({"spacing": (1, np.nan, 1)}, "spacing must be three finite"),
        ({"spacing": (1, 1)}, "spacing must be three finite"),
        ({"origin": (0, np.inf, 0)}, "origin must be three finite"),
        ({"direction": np.zeros((3, 3))}, "direction must be orthonormal"),
        ({"direction": [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]}, "sheared"),
        ({"direction": np.full((3, 3), np.nan)}, "direction must be 3 x 3 finite"),
        ({"shape": (0, 4, 5)}, "at least one voxel"),
        ({"shape": (4, 5)}, "at least one voxel"),
    ],
)
def test_a_bad_grid_names_its_field(change: dict[str, object], words: str) -> None:
    with pytest.raises(DeformError, match=words):
        Grid(**{"shape": (2, 3, 4), **change})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("direction", "letters"),
    [
        (IDENTITY, "LPS"),
        (np.diag([-1, -1, 1]), "RAS"),
        (np.diag([1, -1, -1]), "LAI"),
        ([[0, 0, 1], [1, 0, 0], [0, -1, 0]], "PIL"),
        # 46 degrees about z: the x axis is a little more posterior than left, and no letter may come twice
        ([[np.cos(0.8), -np.sin(0.8), 0], [np.sin(0.8), np.cos(0.8), 0], [0, 0, 1]], "PRS"),
    ],
)
def test_orientation_letters(direction: object, letters: str) -> None:
    assert Grid((2, 3, 4), direction=direction).orientation == letters  # type: ignore[arg-type]


def test_the_box_reaches_half_a_voxel_beyond_the_outer_centres() -> None:
    grid = Grid((2, 3, 4), (1, 2, 3), (10, 20, 30))
    assert grid.corners().min(axis=0).tolist() == [9.5, 19, 28.5]
    assert grid.corners().max(axis=0).tolist() == [13.5, 25, 34.5]
    assert grid.corners(centres=True).max(axis=0).tolist() == [13, 24, 33]
    assert grid.center == (11.5, 22, 31.5)
    assert grid.lengths == (4, 6, 6)
    assert grid.size == 24


@given(st.integers(0, 10**6), st.floats(0.2, 3), st.floats(0, 5))
def test_another_resolution_keeps_the_middle(seed: int, spacing: float, margin: float) -> None:
    grid = oblique(seed=seed)
    new = grid.resampled(spacing=spacing, margin=margin)
    np.testing.assert_allclose(new.center, grid.center, atol=1e-9)
    # the number of voxels is rounded, so the box is right to half a voxel on each side
    assert (np.abs(np.subtract(new.lengths, grid.lengths) - 2 * margin) <= spacing / 2 + 1e-9).all() or 1 in new.shape


def test_a_shape_decides_the_spacing_and_a_crop_keeps_the_places() -> None:
    grid = oblique((4, 6, 8))
    half = grid.resampled(shape=(2, 3, 4))
    np.testing.assert_allclose(half.spacing, 2 * np.array(ANISOTROPIC), rtol=1e-14)
    np.testing.assert_allclose(half.lengths, grid.lengths, rtol=1e-14)
    part = grid.crop((1, 2, 3), (2, 2, 2))
    np.testing.assert_allclose(part.index_to_point([1, 1, 1]), grid.index_to_point([4, 3, 2]), atol=1e-12)
    with pytest.raises(DeformError, match="not both"):
        grid.resampled(spacing=1.0, shape=(1, 1, 1))
    with pytest.raises(DeformError, match="leaves nothing"):
        grid.resampled(margin=-1e3)


# -- the cast table --------------------------------------------------------------------------------------------------


def test_the_kept_types_are_the_types_of_a_volume() -> None:
    assert set(DTYPES) == KEPT


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("order", ["<", ">"])
def test_kept_types_come_back_native_and_unchanged(dtype: str, order: str) -> None:
    array = numbers(dtype=dtype).astype(np.dtype(dtype).newbyteorder(order))
    volume = Volume.from_array(array)
    assert volume.dtype == np.dtype(dtype)
    assert volume.dtype.isnative
    np.testing.assert_array_equal(volume.values, array)
    assert volume.notes == ()
    assert np.shares_memory(volume.values, array) == array.dtype.isnative


@pytest.mark.parametrize(
    ("dtype", "extreme", "expected"),
    [
        ("int64", 2**31 - 1, "int32"),
        ("int64", -(2**31), "int32"),
        ("int64", 2**31, "float64"),
        ("int64", -(2**53), "float64"),
        ("int64", 2**60, "float64"),  # a power of two is exact
        ("int64", 2**53 + 1, None),
        ("int64", 2**63 - 1, None),
        ("int64", -(2**63), "float64"),
        ("uint32", 2**31 - 1, "int32"),
        ("uint32", 2**32 - 1, "float64"),
        ("uint64", 2**53, "float64"),
        ("uint64", 2**64 - 1, None),
        ("uint64", 2**63, "float64"),
    ],
)
def test_long_integers_keep_their_values_or_are_refused(dtype: str, extreme: int, expected: str | None) -> None:
    array = np.zeros((2, 2, 2), dtype=dtype)
    array[1, 1, 1] = extreme
    if expected is None:
        with pytest.raises(DeformError, match=f"{dtype}.*{extreme}"):
            Volume.from_array(array)
        return
    volume = Volume.from_array(array)
    assert volume.dtype.name == expected
    assert int(volume.values[1, 1, 1]) == extreme
    assert any(expected in note for note in volume.notes)


def test_half_and_extended_floats() -> None:
    half = np.array([[[0.1, -2, np.inf]]], dtype=np.float16)
    assert Volume.from_array(half).dtype == np.float32
    np.testing.assert_array_equal(Volume.from_array(half).values, half)
    long = np.array([[[0.5, np.nan]]], dtype=np.longdouble)
    if long.dtype != np.float64:  # on some systems they are the same
        assert Volume.from_array(long).dtype == np.float64
        with pytest.raises(DeformError, match="would round"):
            Volume.from_array(long + np.longdouble(2) ** -60)


@pytest.mark.parametrize(
    ("array", "words"),
    [
        (np.zeros((2, 2, 2), complex), "complex"),
        (np.zeros((2, 2, 2), object), "object"),
        (np.zeros((2, 2, 2), "U3"), "text"),
        (np.zeros((2, 2, 2), "datetime64[s]"), "dates"),
        (np.zeros((2, 2, 2), [("a", "i2")]), "structured"),
        (np.ma.masked_less(np.arange(8).reshape(2, 2, 2), 3), "masked"),
        (np.zeros((2, 0, 2)), r"\(2, 0, 2\)"),
        (np.zeros(5), r"shape \(5,\)"),
        (np.float64(3), r"shape \(\)"),
        (np.zeros((9, 20, 20, 20)), r"axis 0: 9, .*array\[0\]"),
        (np.zeros((20, 20, 20, 3), np.uint8), r"axis 3: 3\).*array\[\.\.\., 0\]"),
    ],
)
def test_what_is_no_volume_is_refused_by_name(array: object, words: str) -> None:
    with pytest.raises(DeformError, match=words):
        Volume.from_array(array)  # type: ignore[arg-type]


def test_a_picture_is_one_slice_and_colours_are_pointed_out() -> None:
    volume = Volume.from_array(np.zeros((4, 5)))
    assert volume.shape == (1, 4, 5)
    assert "one slice" in volume.notes[0]
    assert "one channel" in Volume.from_array(np.zeros((20, 20, 3), np.uint8)).notes[0]


def test_nothing_is_copied_or_written_where_it_need_not_be(tmp_path) -> None:
    np.save(tmp_path / "a.npy", numbers())
    mapped = np.load(tmp_path / "a.npy", mmap_mode="r")
    frozen = numbers()
    frozen.flags.writeable = False
    for array in (mapped, frozen, np.asfortranarray(numbers()), numbers()[::-1, :, ::2]):
        volume = Volume.from_array(array)
        assert np.shares_memory(volume.values, array)
        assert volume.values.flags.writeable == array.flags.writeable


def test_voxels_that_are_not_finite_are_counted() -> None:
    array = np.zeros((20, 20, 20), np.float32)
    array[:, :, :5] = np.nan
    array[0, 0, 10] = -np.inf
    volume = Volume.from_array(array)
    assert volume.notes == ("2 001 voxels are not finite, shown as background",)
    assert volume.value_range == (0, 0)
    assert np.isfinite(volume.finite_values).all()
    array[:] = 0
    array[1, 2, 3] = np.nan
    assert Volume.from_array(array).notes == ("1 voxel is not finite, shown as background",)
    array[:] = np.nan
    assert Volume.from_array(array).value_range == (0, 0)


def test_bool_is_labels_unless_told_otherwise() -> None:
    assert Volume.from_array(np.zeros((2, 2, 2), bool)).is_labels
    assert not Volume.from_array(np.zeros((2, 2, 2), bool), is_labels=False).is_labels
    assert not Volume.from_array(np.zeros((2, 2, 2), np.uint8)).is_labels
    assert Volume.from_array(np.zeros((2, 2, 2), np.uint8), is_labels=True).is_labels


def test_the_constructor_checks_too() -> None:
    with pytest.raises(DeformError, match="shape"):
        Volume(np.zeros((2, 2, 2)), Grid((2, 2, 3)))
    for dtype in ("int64", ">i2", "complex64"):
        with pytest.raises(DeformError, match="from_array"):
            Volume(np.zeros((2, 2, 2), dtype), Grid((2, 2, 2)))


# -- other packages' objects -----------------------------------------------------------------------------------------


def assert_same_places(grid: Grid, other: Grid, tolerance: float = 1e-12) -> None:
    assert grid.shape == other.shape
    np.testing.assert_allclose(grid.corners(), other.corners(), rtol=0, atol=tolerance * np.abs(grid.corners()).max())


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("mirrored", [False, True])
def test_sitk_puts_every_voxel_at_the_same_place(dtype: str, mirrored: bool) -> None:
    pytest.importorskip("SimpleITK")
    volume = Volume(numbers(dtype=dtype), oblique(mirrored=mirrored))
    image = volume.to_sitk()
    point = image.TransformIndexToPhysicalPoint((4, 2, 1))
    np.testing.assert_allclose(point, volume.grid.index_to_point([4, 2, 1]), atol=1e-12)
    assert image[4, 2, 1] == volume.values[1, 2, 4]
    again = Volume.from_sitk(image, is_labels=volume.is_labels)
    assert_same_places(again.grid, volume.grid)
    np.testing.assert_array_equal(again.values, volume.values)
    assert again.dtype == (np.uint8 if dtype == "bool" else np.dtype(dtype))


def test_sitk_pictures_and_images_of_many_axes() -> None:
    sitk = pytest.importorskip("SimpleITK")
    assert Volume.from_sitk(sitk.Image(5, 4, sitk.sitkInt16)).shape == (1, 4, 5)
    with pytest.raises(DeformError, match="4"):
        Volume.from_sitk(sitk.Image([5, 4, 3, 2], sitk.sitkInt16))
    with pytest.raises(DeformError, match="colours or components"):
        Volume.from_sitk(sitk.Image([5, 4, 3], sitk.sitkVectorUInt8, 3))
    with pytest.raises(DeformError, match="complex"):
        Volume.from_sitk(sitk.Image([5, 4, 3], sitk.sitkComplexFloat32))


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("mirrored", [False, True])
def test_nibabel_speaks_ras_and_shares_the_voxels(dtype: str, mirrored: bool) -> None:
    nibabel = pytest.importorskip("nibabel")
    volume = Volume(numbers(dtype=dtype), oblique(mirrored=mirrored))
    image = volume.to_nibabel()
    left, posterior, superior = volume.grid.index_to_point([4, 2, 1])
    ras = nibabel.affines.apply_affine(image.affine, [4, 2, 1])
    np.testing.assert_allclose(ras, [-left, -posterior, superior], atol=1e-12)
    assert np.asanyarray(image.dataobj)[4, 2, 1] == volume.values[1, 2, 4]
    assert np.shares_memory(np.asanyarray(image.dataobj), volume.values)
    again = Volume.from_nibabel(image)
    assert_same_places(again.grid, volume.grid)
    np.testing.assert_array_equal(again.values, volume.values)
    sheared = nibabel.Nifti1Image(np.zeros((2, 2, 2), "f4"), [[1, 0.5, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    with pytest.raises(DeformError, match="sheared"):
        Volume.from_nibabel(sheared)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("mirrored", [False, True])
def test_pyvista_shares_the_voxels_and_puts_them_at_the_same_place(dtype: str, mirrored: bool) -> None:
    pytest.importorskip("pyvista")
    values = numbers(dtype=dtype)
    values.flags.writeable = False
    volume = Volume(values, oblique(mirrored=mirrored))
    image = volume.to_pyvista()
    assert np.shares_memory(image.point_data["values"], values)
    number = np.ravel_multi_index((1, 2, 4), volume.shape)
    np.testing.assert_allclose(image.GetPoint(number), volume.grid.index_to_point([4, 2, 1]), atol=1e-12)
    assert image.active_scalars[number] == values[1, 2, 4]
    again = Volume.from_pyvista(image)
    assert np.shares_memory(again.values, values)
    assert again.dtype == values.dtype
    assert_same_places(again.grid, volume.grid)


def test_pyvista_extents_names_and_lifetime() -> None:
    pyvista = pytest.importorskip("pyvista")
    image = pyvista.ImageData(dimensions=(5, 4, 3), spacing=(1, 2, 3), direction_matrix=rotation(3))
    image.point_data["a"] = np.arange(60, dtype=np.int16)
    image.point_data["b"] = np.arange(60, dtype=np.uint8)
    image.cell_data["c"] = np.zeros(24)
    image.SetExtent(2, 6, -1, 2, 5, 7)
    volume = Volume.from_pyvista(image, "b")
    np.testing.assert_allclose(volume.grid.index_to_point([0, 0, 0]), image.GetPoint(0), atol=1e-12)
    np.testing.assert_allclose(volume.grid.index_to_point([4, 3, 2]), image.GetPoint(59), atol=1e-12)
    cells = Volume.from_pyvista(image, "c")  # which are at the middles of the cells
    np.testing.assert_allclose(cells.grid.index_to_point([3, 2, 1]), image.cell_centers().points[23], atol=1e-6)
    with pytest.raises(DeformError, match="no data called 'nothing'"):
        Volume.from_pyvista(image, "nothing")
    del image
    gc.collect()
    np.testing.assert_array_equal(volume.values.reshape(-1), np.arange(60))
    with pytest.raises(DeformError, match="ImageData"):
        Volume.from_pyvista(pyvista.Sphere())
    colours = pyvista.ImageData(dimensions=(5, 4, 3))
    colours.point_data["rgb"] = np.zeros((60, 3), np.uint8)
    with pytest.raises(DeformError, match="components"):
        Volume.from_pyvista(colours)


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "SimpleITK", None)
    with pytest.raises(DeformError, match="pip install SimpleITK"):
        Volume.from_array(numbers()).to_sitk()


def test_a_volume_is_printed_in_one_line() -> None:
    grid = Grid((4, 5, 6), (0.5, 1.0, 2.25), unit="mm")
    volume = Volume(np.zeros(grid.shape, np.int16), grid, "a fish")
    assert (
        repr(volume)
        == str(volume)
        == ("<Volume 'a fish': 6 x 5 x 4 voxels (x, y, z), int16, spacing 0.5 x 1 x 2.25 mm>")
    )
    labels = Volume.from_array(np.zeros((2, 3, 4), np.uint8), is_labels=True)
    assert repr(labels) == "<Volume: 4 x 3 x 2 voxels (x, y, z), uint8 labels, spacing 1 x 1 x 1>"
    assert "\n" not in repr(Volume.from_array(np.zeros((2, 3, 4)), name="two\nlines" * 50))


def test_numpy_takes_a_volume_for_its_voxels() -> None:
    volume = Volume.from_array(np.arange(24, dtype=np.uint8).reshape(2, 3, 4), spacing=(1, 1, 2))
    assert np.asarray(volume) is volume.values
    assert np.shares_memory(np.asarray(volume, dtype=np.uint8), volume.values)
    assert not np.shares_memory(np.array(volume), volume.values)
    assert np.asarray(volume, dtype=np.float32).dtype == np.float32
    assert np.mean(volume) == 11.5
    with pytest.raises(ValueError, match="without a copy"):
        volume.__array__(np.float32, copy=False)


CUT_SHORT = """
import sys
import numpy as np
from pathlib import Path
from deformnb import DeformError, Volume
from deformnb.rbf.fields import Identity
from deformnb.io import write_volume
from deformnb.warping.warper import Warper
folder, use = Path(sys.argv[1]), sys.argv[2]
voxels = np.random.default_rng(0).random((40, 64, 64)).astype(np.float32)
np.save(folder / "a.npy", voxels)
mapped = np.load(folder / "a.npy", mmap_mode="r")
volume = Volume.from_array(mapped[:, ::-1])
warper = Warper(Volume.from_array(mapped))
warper(Identity(3))
with open(folder / "a.npy", "r+b") as file:
    file.truncate(5000)
uses = {"values": lambda: float(volume.values.sum()), "range": lambda: volume.value_range,
        "finite": lambda: float(volume.finite_values.sum()), "new": lambda: Volume.from_array(mapped),
        "warp": lambda: warper(Identity(3)), "write": lambda: write_volume(volume, folder / "b.nrrd"),
        "view": lambda: volume.to_pyvista()}
try:
    uses[use]()
except DeformError as error:
    print(error)
"""


@pytest.mark.sampled(4)
@pytest.mark.skipif(sys.platform == "win32", reason="Windows keeps mapped files whole")
@pytest.mark.parametrize("use", ["values", "range", "finite", "new", "warp", "write", "view"])
def test_a_mapped_file_cut_short_is_an_error_and_not_the_end_of_the_process(use: str, tmp_path: Path) -> None:
    command = [sys.executable, "-c", CUT_SHORT, str(tmp_path), use]
    child = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert child.returncode == 0, child.stderr[-2000:]
    assert re.search(
        "the file 'a.npy' that the volume's voxels are mapped from is 5000 bytes long but 655488 are mapped",
        child.stdout,
    )


def test_a_mapped_file_that_was_written_to_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    np.save(path, numbers())
    volume = Volume.from_array(np.load(path, mmap_mode="r"))
    again = pickle.loads(pickle.dumps(volume))
    assert volume.values.sum() == numbers().sum()
    stat = path.stat()
    with path.open("r+b") as file:
        file.seek(200)
        file.write(b"1")
    os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns + 1))
    with pytest.raises(FileChangedError, match="written to since the volume was made"):
        _ = volume.values
    np.testing.assert_array_equal(again.values, numbers())


def test_a_mapped_file_that_was_replaced_or_removed_is_still_read(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    np.save(path, numbers())
    volume = Volume.from_array(np.load(path, mmap_mode="r"))
    np.save(tmp_path / "b.npy", numbers() + 1)
    os.replace(tmp_path / "b.npy", path)
    np.testing.assert_array_equal(volume.values, numbers())
    path.unlink()
    np.testing.assert_array_equal(volume.values, numbers())


def test_maps_without_a_name_and_without_a_file(tmp_path: Path) -> None:
    memory = mmap.mmap(-1, 4096)
    assert Volume.from_array(np.frombuffer(memory, np.uint8).reshape(16, 16, 16)).values.sum() == 0
    (tmp_path / "a.raw").write_bytes(bytes(4096))
    with (tmp_path / "a.raw").open("r+b") as file:
        nameless = mmap.mmap(file.fileno(), 0)
        volume = Volume.from_array(np.frombuffer(nameless, np.uint8).reshape(16, 16, 16))
        file.truncate(10)
    with pytest.raises(FileChangedError, match="cut short"):
        _ = volume.values


# ---- arrays that may be labels --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "asks"),
    [
        ("knee_labels.nrrd", True),
        ("abdomen_labels.nrrd", True),
        ("carp.nii.gz", False),
        ("lobster.nrrd", False),
        ("abdomen_ct.nii.gz", False),
        ("knee_mr_straight.nrrd", False),
        ("knee_mr_bent.nrrd", False),
    ],
)
def test_labels_that_no_file_declares_are_asked_about_and_scans_are_not(
    name: str, asks: bool, real_data: Callable[[str], Path]
) -> None:
    path = real_data(name)
    volume = read_volume(path)
    assert not volume.is_labels
    assert any("is_labels=True" in note for note in volume.notes) == asks
    for told in (True, False):
        volume = read_volume(path, is_labels=told)
        assert volume.is_labels == told
        assert not [note for note in volume.notes if "labels" in note]


@pytest.mark.parametrize("kind", sorted(PHANTOMS))
def test_no_phantom_of_grey_values_looks_like_labels(kind: str) -> None:
    values = PHANTOMS[kind].make((24, 32, 28)).values
    assert Volume.from_array(values).notes == ()
    smooth = ndimage.gaussian_filter(values.astype(np.float32), 1.5)
    assert Volume.from_array((smooth // 16).astype(np.uint8)).notes == (), "few grey values are no labels either"


def test_labels_of_a_phantom_are_asked_about_in_every_array() -> None:
    labels = PHANTOMS["knee"].labels((40, 40, 40))
    for values in (labels.values, labels.values.astype(np.int32), labels.values.astype(np.int64)):
        asked = Volume.from_array(values)
        assert sum("is_labels=True" in note for note in asked.notes) == 1
        assert Volume.from_array(values, is_labels=False).notes == tuple(n for n in asked.notes if "became" in n)


@pytest.mark.parametrize(
    "values",
    [
        np.random.default_rng(0).integers(0, 5, (20, 20, 20)),  # noise of five values
        np.kron(np.eye(2, dtype=np.uint8)[None], np.full((20, 20, 20), 200, np.uint8)),  # two values are no question
        np.tile(np.arange(40) // 8, (20, 20, 1)),  # a ramp in few steps
        np.tile(np.arange(4).repeat(2), (2, 2, 1)),  # too few voxels to decide
        np.zeros((5, 5, 1), int),
    ],
)
def test_no_question_is_asked_of_what_need_not_be_labels(values: Any) -> None:
    assert not [note for note in Volume.from_array(values.astype(np.int16)).notes if "labels" in note]


@pytest.mark.parametrize("value", [0, 7, -3.5, True])
def test_a_volume_of_one_value_is_noted(value: float) -> None:
    values = np.full((5, 6, 7), value)
    assert any(f"has the value {float(value):g}" in note for note in Volume.from_array(values).notes)
    values[-1, -1, -1] = not value
    assert Volume.from_array(values.astype(np.float32)).notes == ()
    nowhere = np.full((2, 2, 2), np.nan)
    assert Volume.from_array(nowhere).notes == (f"no voxel is a finite number: {NOTHING_TO_SEE}",)
    nowhere[0, 0, 0] = 1.0
    assert Volume.from_array(nowhere).notes == ("7 voxels are not finite, shown as background",)
