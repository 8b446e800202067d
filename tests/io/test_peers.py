"""Files of ITK, ANTs, elastix, ngff-zarr and others: each program applies the other's to the same voxels or points.

Large programs run in separate processes: ``tests/peer_programs.py``.
"""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import peer_programs
import pytest
from format_table import bound
from scipy.ndimage import gaussian_filter

import deformnb as dn
from deformnb.io.landmarks.formats import read_landmarks, write_landmarks
from deformnb.io.transforms.formats import read_transform, write_transform
from deformnb.rbf.fields import AbstractField, Affine, DisplacementField
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.points import Landmarks

_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
GRID = Grid((24, 28, 32), (1.5, 1.0, 2.0), (5.0, -30.0, 12.0), tuple(map(tuple, _TURN.tolist())))
RANDOM = np.random.default_rng(5)
_SMOOTH = gaussian_filter(RANDOM.normal(size=GRID.shape), 2)
VOLUME = Volume((255 * (_SMOOTH - _SMOOTH.min()) / np.ptp(_SMOOTH)).astype(np.float32), GRID)
AFFINE = Affine(np.eye(3) + RANDOM.uniform(-0.04, 0.04, (3, 3)), np.array([0.5, -0.8, 0.3]))
BEND = DisplacementField(
    np.stack([gaussian_filter(RANDOM.normal(size=GRID.shape), 4) * 60 for _ in range(3)], axis=-1), GRID
)

pytestmark = pytest.mark.nightly


def _need(package: str) -> None:
    if find_spec(package) is None:
        pytest.skip(f"{package} is not installed: pip install deformnb[peers]")


def _run(program: str, folder: Path, package: str) -> None:
    _need(package)
    child = subprocess.run(
        [sys.executable, peer_programs.__file__, program, str(folder)],
        capture_output=True,
        text=True,
        timeout=550,
        check=False,
        cwd=folder,
    )  # transformix writes into it
    assert child.returncode == 0, child.stdout[-2000:] + child.stderr[-2000:]


def _difference(known: np.ndarray, found: np.ndarray, outside: float = -1.0) -> float:
    """The largest difference where both have values, which is nearly everywhere that either has."""
    inside = (known != outside) & (found != outside)
    assert inside.mean() > 0.4
    assert inside.sum() > 0.98 * max((known != outside).sum(), (found != outside).sum())
    return float(np.abs(known - found)[inside].max())


def _warp(field: AbstractField) -> np.ndarray:
    return dn.warp(VOLUME, field, fill=-1.0).values


def _write_transforms(folder: Path, *suffixes: str) -> dict[str, np.ndarray]:
    """A field and an affine map in files of these endings, and the volume warped by each of them."""
    both = dn.rbf.compose(BEND, AFFINE)
    for suffix in suffixes:
        write_transform(both, folder / f"transform.{suffix}", GRID)
    sampled = _warp(DisplacementField.sample(both, GRID))
    return {suffix: _warp(both) if suffix in ("tfm", "h5") else sampled for suffix in suffixes}


def test_itk_applies_what_is_written(tmp_path: Path) -> None:
    dn.write_volume(VOLUME, tmp_path / "volume.nrrd")
    limits = {
        "tfm": bound("transforms", "itk text", "ITK"),
        "h5": bound("transforms", "itk hdf5", "ITK"),
        "nrrd": bound("transforms", "nrrd", "ITK"),
        "nii.gz": bound("transforms", "nifti", "ITK"),
        "mha": bound("transforms", "metaimage", "ITK"),
    }
    known = _write_transforms(tmp_path, *limits)
    _run("itk_resample", tmp_path, "itk")
    for suffix, limit in limits.items():
        assert _difference(known[suffix], np.load(tmp_path / f"transform.{suffix}.npy")) < limit, suffix


def test_kernel_transforms_of_itk_are_the_same_maps_here(tmp_path: Path) -> None:
    for name in ("source", "target", "places"):
        np.save(tmp_path / f"{name}.npy", RANDOM.uniform(0, 20, (9, 3)))
    _run("itk_kernels", tmp_path, "itk")
    places = np.load(tmp_path / "places.npy")
    files = sorted(tmp_path.glob("*.tfm"))
    assert len(files) == 3
    for file in files:
        found = places + read_transform(file).displacement(places)
        limit = bound("transforms", "itk text", "ITK's kernel transforms")
        assert np.abs(found - np.load(file.with_suffix(".npy"))).max() < limit, file.name


def test_ants_applies_what_is_written_and_the_other_way_round(tmp_path: Path) -> None:
    dn.write_volume(VOLUME, tmp_path / "volume.nii.gz")
    limits = {
        "nii.gz": bound("transforms", "nifti", "ANTs"),
        "h5": bound("transforms", "itk hdf5", "ANTs"),
        "tfm": bound("transforms", "itk text", "ANTs"),
    }
    known = _write_transforms(tmp_path, *limits)
    for name, value in (("matrix", AFFINE.matrix), ("offset", AFFINE.offset), ("vectors", BEND.values)):
        np.save(tmp_path / f"{name}.npy", value)
    _run("ants_resample", tmp_path, "ants")
    for suffix, limit in limits.items():
        assert _difference(known[suffix], np.load(tmp_path / f"transform.{suffix}.npy")) < limit, suffix
    for name, limit in (
        ("theirs.mat", bound("transforms", "ants matrix", "ANTs")),
        ("theirs.nii.gz", limits["nii.gz"]),
    ):
        warped = _warp(read_transform(tmp_path / name))
        assert _difference(warped, np.load(tmp_path / f"{name}.npy")) < limit, name


FIELD_FILE = f"""(Transform "DeformationFieldTransform")
(DeformationFieldInterpolationOrder 1)
(NumberOfParameters 0)
(InitialTransformParameterFileName "NoInitialTransform")
(HowToCombineTransforms "Compose")
(DeformationFieldFileName "transform.mha")
(FixedImageDimension 3)
(MovingImageDimension 3)
(FixedInternalImagePixelType "float")
(MovingInternalImagePixelType "float")
(Size {" ".join(map(str, GRID.shape[::-1]))})
(Index 0 0 0)
(Spacing {" ".join(map(str, GRID.spacing))})
(Origin {" ".join(map(str, GRID.origin))})
(Direction {" ".join(map(str, np.transpose(GRID.direction).ravel()))})
(UseDirectionCosines "true")
(ResampleInterpolator "FinalLinearInterpolator")
(Resampler "DefaultResampler")
(DefaultPixelValue -1)
(ResultImageFormat "nrrd")
(ResultImagePixelType "float")
(CompressResultImage "false")
"""


def test_elastix_applies_what_is_written_and_the_other_way_round(tmp_path: Path) -> None:
    dn.write_volume(VOLUME, tmp_path / "volume.nrrd")
    dn.write_volume(dn.warp(VOLUME, dn.rbf.compose(BEND, AFFINE), fill=0.0), tmp_path / "moving.nrrd")
    limits = {"nii.gz": bound("transforms", "nifti", "elastix"), "mha": bound("transforms", "metaimage", "elastix")}
    for suffix in limits:
        write_transform(BEND, tmp_path / f"transform.{suffix}", GRID)
    (tmp_path / "field.txt").write_text(FIELD_FILE, encoding="utf-8")
    marks = GRID.index_to_point(RANDOM.uniform(4, 20, (12, 3)))
    write_landmarks(Landmarks(marks), tmp_path / "points.txt")
    _run("elastix_resample", tmp_path, "itk")
    nodes = GRID.index_to_point(np.moveaxis(np.indices(GRID.shape)[::-1], 0, -1))
    kinds = ("translation", "rigid", "similarity", "affine", "bspline")
    for kind in kinds:
        found = read_transform(tmp_path / f"{kind}.txt", GRID).displacement(nodes)
        limit = bound("transforms", "elastix", "elastix")
        known = np.load(tmp_path / f"{kind}.npy")
        assert np.abs(known).max() > 0.5
        assert np.abs(found - known).max() < limit, kind
    for name in ("theirs.mhd", "theirs.nii"):
        found = read_transform(tmp_path / name).displacement(nodes)
        assert np.abs(found - np.load(tmp_path / "bspline.npy")).max() < bound("transforms", "elastix", "elastix")
    for suffix, limit in limits.items():
        assert _difference(_warp(BEND), np.load(tmp_path / f"transform.{suffix}.npy")) < limit
    mapped = read_landmarks(tmp_path / "outputpoints.txt")
    assert mapped.fixed is not None
    assert np.abs(mapped.points - marks).max() < bound("landmarks", "elastix", "elastix")
    moved = marks + read_transform(tmp_path / "affine.txt").displacement(marks)
    assert np.abs(mapped.fixed - moved).max() < bound("landmarks", "elastix", "elastix")


def test_ngff_zarr_reads_and_writes_the_same_fields(tmp_path: Path) -> None:
    plain = Grid(GRID.shape, GRID.spacing, GRID.origin)
    write_transform(DisplacementField(BEND.values, plain), tmp_path / "ours.zarr", plain)
    np.save(tmp_path / "vectors.npy", BEND.values)
    _run("ngff_exchange", tmp_path, "ngff_zarr")
    limit = bound("transforms", "ngff", "ngff-zarr")
    assert np.abs(np.load(tmp_path / "ours.npy") - BEND.values).max() < limit
    size, origin, spacing = np.load(tmp_path / "grid.npy").reshape(3, 3)
    assert (tuple(size), tuple(origin), tuple(spacing)) == (GRID.shape[::-1], GRID.origin, GRID.spacing)
    for name in ("theirs.zarr", "beside.zarr"):
        found = read_transform(tmp_path / name)
        assert isinstance(found, DisplacementField)
        assert found.lattice == plain
        assert np.abs(found.values - BEND.values).max() < limit


def test_vedo_reads_and_writes_the_same_points(tmp_path: Path) -> None:
    marks = GRID.index_to_point(RANDOM.uniform(4, 20, (12, 3)))
    write_landmarks(Landmarks(marks), tmp_path / "ours.xyz")
    np.save(tmp_path / "places.npy", marks)
    _run("vedo_points", tmp_path, "vedo")
    limit = bound("landmarks", "points", "vedo") * np.abs(marks).max()
    assert np.abs(np.load(tmp_path / "ours.npy") - marks).max() < limit
    assert np.abs(read_landmarks(tmp_path / "theirs.xyz").points - marks).max() < 10 * limit  # it writes six digits


def test_slicerio_reads_the_same_fiducials_and_turns_them_into_markups(tmp_path: Path) -> None:
    _need("slicerio")
    from slicerio.markups import fcsv_to_markups_json, read_markups_fcsv

    marks = GRID.index_to_point(RANDOM.uniform(4, 20, (7, 3)))
    names = tuple(f"mark {k}" for k in range(7))
    write_landmarks(Landmarks(marks, names), tmp_path / "ours.fcsv")
    (markup,) = read_markups_fcsv(tmp_path / "ours.fcsv")["markups"]
    assert markup["coordinateSystem"] == "LPS"
    assert [point["label"] for point in markup["controlPoints"]] == list(names)
    theirs = np.array([point["position"] for point in markup["controlPoints"]])
    assert np.abs(theirs - marks).max() < bound("landmarks", "fcsv", "slicerio")
    fcsv_to_markups_json(tmp_path / "ours.fcsv", tmp_path / "theirs.mrk.json")
    found = read_landmarks(tmp_path / "theirs.mrk.json")
    assert found.names == names
    assert np.abs(found.points - marks).max() < bound("landmarks", "markups", "slicerio, read only")


@pytest.mark.parametrize("dim", [2, 3])
def test_morphops_reads_the_same_specimens(tmp_path: Path, dim: int) -> None:
    _need("morphops")
    from morphops import read_dta

    marks = RANDOM.uniform(-80, 80, (9, dim))
    write_landmarks(Landmarks(marks, fixed=marks[::-1]), tmp_path / "ours.nts")
    specimens, titles = read_dta(tmp_path / "ours.nts")
    assert len(titles) == 2
    for found, known in zip(specimens, (marks, marks[::-1]), strict=True):
        assert np.abs(found - known).max() < bound("landmarks", "nts", "morphops, written only")
