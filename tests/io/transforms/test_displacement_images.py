"""Images of displacements: cut and damaged files are refused, and fields equal those of nibabel and SimpleITK."""

from __future__ import annotations

import gzip
import os
import shutil
import struct
from collections.abc import Callable
from pathlib import Path

import nibabel
import numpy as np
import pytest
import SimpleITK as sitk  # noqa: N813 (the name that its own manual uses)

from deformnb.errors import VolumeFileError
from deformnb.io.transforms.displacement_images import to_itk_image
from deformnb.io.transforms.formats import read_transform, write_transform
from deformnb.rbf.fields import DisplacementField
from deformnb.volume.volume import Grid

RANDOM = np.random.default_rng(2)
GRID = Grid((9, 8, 7), (1.5, 1.0, 2.0), (5.0, -30.0, 12.0), ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
FIELD = DisplacementField(RANDOM.normal(size=(*GRID.shape, 3)).astype(np.float32), GRID)
OTHER = DisplacementField(FIELD.values + 7, GRID)
SUFFIXES = (".nii.gz", ".nii", ".nrrd", ".nhdr", ".mha", ".mhd")


def write_field(path: Path, field: DisplacementField = FIELD) -> Path:
    sitk.WriteImage(to_itk_image(sitk, field), str(path))
    return path


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(
    "kind", [sitk.sitkVectorFloat32, sitk.sitkVectorFloat64, sitk.sitkVectorInt16], ids=["float32", "float64", "int16"]
)
@pytest.mark.parametrize("packed", [False, True], ids=["plain", "packed"])
def test_images_that_simpleitk_writes_are_the_same_vectors(
    suffix: str, kind: int, packed: bool, tmp_path: Path
) -> None:
    image = sitk.Cast(to_itk_image(sitk, DisplacementField(100 * np.asarray(FIELD.values), GRID)), kind)
    sitk.WriteImage(image, str(tmp_path / f"a{suffix}"), packed)
    found = read_transform(tmp_path / f"a{suffix}")
    assert isinstance(found, DisplacementField)
    assert isinstance(found.lattice, Grid)
    np.testing.assert_array_equal(found.values, sitk.GetArrayFromImage(image))
    np.testing.assert_allclose(found.lattice.matrix, GRID.matrix, atol=1e-6)  # NIfTI has float32
    np.testing.assert_allclose(found.lattice.origin, GRID.origin, rtol=1e-6)


def test_a_packed_file_is_not_taken_from_the_plain_one_beside_it(tmp_path: Path) -> None:
    write_field(tmp_path / "w.nii", OTHER)
    write_field(tmp_path / "w.nii.gz")
    for name, field in (("w.nii.gz", FIELD), ("w.nii", OTHER)):
        np.testing.assert_array_equal(read_transform(tmp_path / name).values, field.values)  # type: ignore[attr-defined]


@pytest.mark.parametrize("components", [2, 4])
def test_an_image_of_other_vectors_than_of_space_is_refused(components: int, tmp_path: Path) -> None:
    image = sitk.GetImageFromArray(np.zeros((*GRID.shape, components), np.float32), isVector=True)
    sitk.WriteImage(image, str(tmp_path / "a.mha"))
    with pytest.raises(VolumeFileError, match=f"three components, and this image holds {components} channels"):
        read_transform(tmp_path / "a.mha")


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("short", [1, 40, 2000])
def test_a_file_that_is_cut_short_is_refused(suffix: str, short: int, tmp_path: Path) -> None:
    path = write_field(tmp_path / f"a{suffix}")
    data = max(tmp_path.iterdir(), key=lambda file: file.stat().st_size)  # of a header its own file of voxels
    data.write_bytes(data.read_bytes()[:-short])
    with pytest.raises(VolumeFileError, match=r"^a\."):
        read_transform(path)
    if suffix.startswith(".nii") and short > 8:  # as nibabel does, which does not check gzip's checksum at the end
        with pytest.raises((OSError, EOFError, ValueError)):
            np.asarray(nibabel.load(path).dataobj)


def changed(offset: int, form: str, *values: float) -> Callable[[bytes], bytes]:
    return lambda data: data[:offset] + struct.pack(form, *values) + data[offset + struct.calcsize(form) :]


NIFTI = {
    "dim[1] = 3000": changed(42, "<h", 3000),
    "dim[1] = -1": changed(42, "<h", -1),
    "dim[5] = 2": changed(50, "<h", 2),
    "dim[5] = 1": changed(50, "<h", 1),
    "dim[0] = 9": changed(40, "<h", 9),
    "vox_offset 0": changed(108, "<f", 0.0),
    "vox_offset NaN": changed(108, "<f", np.nan),
    "pixdim NaN": changed(80, "<f", np.nan),
    "pixdim 1e30": changed(80, "<f", 1e30),
    "srow NaN": changed(280, "<f", np.nan),
    "srow 1e30": changed(280, "<f", 1e30),
    "offset 1e30": changed(292, "<f", 1e30),
    "a NaN": changed(400, "<f", np.nan),
    "an inf": changed(400, "<f", -np.inf),
    "a 1e30": changed(400, "<f", 1e30),
    "complex": changed(70, "<2h", 32, 64),
    "colours": changed(70, "<2h", 128, 24),
    "nothing": lambda data: b"",
    "a word": lambda data: b"nonsense",
}


@pytest.mark.parametrize("what", NIFTI)
@pytest.mark.parametrize("suffix", [".nii", ".nii.gz"])
def test_a_header_that_does_not_fit_is_refused(what: str, suffix: str, tmp_path: Path) -> None:
    path = write_field(tmp_path / f"a{suffix}")
    packed = suffix == ".nii.gz"
    whole = gzip.decompress(path.read_bytes()) if packed else path.read_bytes()
    damaged = NIFTI[what](whole)
    path.write_bytes(gzip.compress(damaged) if packed else damaged)
    if what.startswith("pixdim"):  # the sform decides on places
        found = read_transform(path)
        np.testing.assert_array_equal(found.values, FIELD.values)  # type: ignore[attr-defined]
        return
    with pytest.raises(VolumeFileError, match=r"^a\.nii"):
        read_transform(path)


LINES = [
    ".mha DimSize = 7 8 9|DimSize = 7 8 900000000",
    ".mha NDims = 3|NDims = -1",
    ".mha TransformMatrix = 0|TransformMatrix = 1e308",
    ".mha ElementSpacing = 1.5|ElementSpacing = nan",
    ".mha ElementNumberOfChannels = 3|ElementNumberOfChannels = 2",
    ".mha Offset = 5|Offset = 1e30",
    ".nrrd sizes: 3 7 8 9|sizes: 3 7 8 90",
    ".nrrd dimension: 4|dimension: -4",
    ".nrrd space directions: none (0|space directions: none (nan",
    ".nrrd space origin: (5|space origin: (1e300",
    ".mha ObjectType = Image|ObjectType = " + "x" * 2_000_000,
]


@pytest.mark.parametrize("line", LINES, ids=lambda line: line[:30])
def test_a_line_that_does_not_fit_is_refused(line: str, tmp_path: Path) -> None:
    suffix, _, rest = line.partition(" ")
    old, _, new = rest.partition("|")
    path = tmp_path / f"a{suffix}"
    sitk.WriteImage(to_itk_image(sitk, FIELD), str(path), False)
    data = path.read_bytes()
    assert data.count(old.encode()) == 1, data[:600]
    path.write_bytes(data.replace(old.encode(), new.encode()))
    with pytest.raises(VolumeFileError, match=r"^a\."):
        read_transform(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes have names on POSIX only")
@pytest.mark.parametrize("suffix", [*SUFFIXES, ".tfm", ".h5", ".mat", ".txt", ".vti"])
def test_a_pipe_is_not_waited_for(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a{suffix}"
    if suffix in (".nhdr", ".mhd"):
        write_field(path)
        path = max(tmp_path.iterdir(), key=lambda file: file.stat().st_size)
        path.unlink()
    os.mkfifo(path)
    with pytest.raises(VolumeFileError, match=r"no plain file|not a plain file"):
        read_transform(tmp_path / f"a{suffix}")


@pytest.mark.parametrize("change", ["a chunk is missing", "a chunk is a pipe", "a chunk is a link", "many chunks"])
def test_a_field_in_zarr_whose_chunks_are_not_all_there_is_refused(change: str, tmp_path: Path) -> None:
    zarr = pytest.importorskip("zarr")
    still = DisplacementField(np.zeros((70, 5, 6, 3)), Grid((70, 5, 6)))  # chunks of zeros are stored as well
    write_transform(still, tmp_path / "a.zarr", Grid((70, 5, 6)))
    assert np.abs(read_transform(tmp_path / "a.zarr").displacement([[1.0, 2.0, 3.0]])).max() == 0
    chunk = max(file for file in tmp_path.rglob("c/*/*/*/*") if file.is_file())
    if change == "many chunks":
        place = next(
            file.parent for file in tmp_path.rglob("zarr.json") if '"array"' in file.read_text(encoding="utf-8")
        )
        shutil.rmtree(place)
        zarr.create_array(str(place), shape=(3, 70, 70, 70), chunks=(1, 1, 1, 1), dtype="f4", fill_value=0)
    else:
        chunk.unlink()
    if change == "a chunk is a pipe":
        os.mkfifo(chunk)
    elif change == "a chunk is a link":
        (tmp_path / "elsewhere").write_bytes(b"x")
        chunk.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(VolumeFileError, match=r"^a\.zarr: .*(missing|no plain file|chunks, and at most)"):
        read_transform(tmp_path / "a.zarr")
