"""DICOM series: sorted by place, never guessed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dicom_series import COSINES, NORMAL, SERIES, VOXELS, write_series, write_slice

from deformnb.errors import VolumeFileError
from deformnb.io import describe_file, read_volume

pydicom = pytest.importorskip("pydicom")


def refuse(path: Path, words: str, **options: Any) -> None:
    with pytest.raises(VolumeFileError, match=words) as caught:
        read_volume(path, **options)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("names", ["{}.dcm", "IM{}", "{}.IMA"])
def test_a_series_is_sorted_by_place(names: str, tmp_path: Path) -> None:
    (tmp_path / "deep" / "er").mkdir(parents=True)
    write_series(tmp_path / "deep" / "er", names=names)
    (tmp_path / "readme.txt").write_text("no slice", encoding="utf-8")
    volume = read_volume(tmp_path)
    np.testing.assert_array_equal(volume.values, VOXELS)
    assert volume.dtype == np.uint16
    np.testing.assert_allclose(volume.grid.spacing, (0.5, 1.25, 2.5), rtol=1e-4)  # positions have four decimals
    np.testing.assert_allclose(
        volume.grid.index_to_point([4, 3, 2]), 10 + COSINES[:, 0] * 2 + COSINES[:, 1] * 3.75 + NORMAL * 5, atol=1e-3
    )
    assert not volume.notes
    assert describe_file(tmp_path).grid == volume.grid


def test_simpleitk_agrees(tmp_path: Path) -> None:
    sitk = pytest.importorskip("SimpleITK")
    write_series(tmp_path, RescaleSlope=2, RescaleIntercept=-1000)
    reader = sitk.ImageSeriesReader()
    reader.SetFileNames(reader.GetGDCMSeriesFileNames(str(tmp_path)))
    image = reader.Execute()
    volume = read_volume(tmp_path)
    np.testing.assert_array_equal(volume.values, sitk.GetArrayFromImage(image))
    np.testing.assert_allclose(
        image.TransformIndexToPhysicalPoint((6, 4, 5)), volume.grid.index_to_point([6, 4, 5]), atol=1e-3
    )


@pytest.mark.parametrize("syntax", ["1.2.840.10008.1.2", "1.2.840.10008.1.2.1", "1.2.840.10008.1.2.2"])
@pytest.mark.parametrize("dtype", ["uint8", "uint16", "int16", "int32"])
def test_types_and_byte_orders(syntax: str, dtype: str, tmp_path: Path) -> None:
    values = (VOXELS % 100).astype(dtype) - (50 if dtype.startswith("i") else 0)
    write_series(tmp_path, values, syntax=syntax)
    volume = read_volume(tmp_path)
    assert volume.dtype == np.dtype(dtype)
    np.testing.assert_array_equal(volume.values, values)


@pytest.mark.parametrize(
    ("slope", "intercept", "dtype"),
    [
        (1, -1024, np.int32),
        (2, 0, np.int32),
        (0.5, 0, np.float32),
        (1, 0.25, np.float32),
    ],
)
def test_rescaling(slope: float, intercept: float, dtype: type, tmp_path: Path) -> None:
    write_series(tmp_path, RescaleSlope=slope, RescaleIntercept=intercept)
    volume = read_volume(tmp_path)
    assert volume.dtype == dtype
    np.testing.assert_allclose(volume.values, VOXELS * float(slope) + intercept, rtol=1e-6)


def test_rescaling_slice_by_slice_and_into_int16(tmp_path: Path) -> None:
    values = (VOXELS % 256).astype(np.uint8)
    for k, pixels in enumerate(values):
        write_slice(tmp_path / f"{k}.dcm", pixels, NORMAL * k, RescaleSlope=k + 1, RescaleIntercept=-k)
    volume = read_volume(tmp_path)
    assert volume.dtype == np.int16
    factors = np.arange(6)[:, None, None]
    np.testing.assert_array_equal(volume.values, values.astype(int) * (factors + 1) - factors)


def test_several_series_are_listed_and_chosen(tmp_path: Path) -> None:
    (tmp_path / "b").mkdir()
    write_series(tmp_path)
    other = {"SeriesInstanceUID": SERIES + ".9", "SeriesNumber": 7, "SeriesDescription": "thick"}
    write_series(tmp_path / "b", VOXELS[:3] + 1, **other)
    refuse(tmp_path, r"series='3': 6 slices of 7 x 5, 'thin'; series='7': 3 slices of 7 x 5, 'thick'")
    refuse(tmp_path, "no one series '8'", series=8)
    for series in (7, "7", "thick", SERIES + ".9"):
        np.testing.assert_array_equal(read_volume(tmp_path, series=series).values, VOXELS[:3] + 1)


def test_mixed_geometry_in_one_series_is_listed_and_chosen(tmp_path: Path) -> None:
    write_series(tmp_path)
    write_slice(tmp_path / "scout.dcm", VOXELS[0, :, :4], (0, 0, 0))
    refuse(tmp_path, r"series='3/1': 6 slices of 7 x 5.*series='3/2': 1 slices of 4 x 5")
    np.testing.assert_array_equal(read_volume(tmp_path, series="3/1").values, VOXELS)
    (tmp_path / "scout.dcm").unlink()
    write_slice(tmp_path / "turned.dcm", VOXELS[0], (0, 0, 0), ImageOrientationPatient=[1, 0, 0, 0, 1, 0])
    refuse(tmp_path, "several series or geometries")


def test_missing_double_and_uneven_slices(tmp_path: Path) -> None:
    write_series(tmp_path)
    middle = sorted(tmp_path.iterdir())[int(np.flatnonzero(np.random.default_rng(2).permutation(6) == 2)[0])]
    content = middle.read_bytes()
    middle.unlink()
    refuse(tmp_path, r"1 of 4 gaps differ from 2\.5.*is 5.*, 1 missing")
    middle.write_bytes(content)
    (tmp_path / "copy.dcm").write_bytes(content)
    volume = read_volume(tmp_path)
    np.testing.assert_array_equal(volume.values, VOXELS)
    assert volume.notes == ("1 files that repeat another were left out",)
    write_slice(tmp_path / "copy.dcm", VOXELS[0], 10 + NORMAL * 5, uid=SERIES + ".77")
    refuse(tmp_path, "are at the same place")
    write_slice(tmp_path / "copy.dcm", VOXELS[0], 10 + NORMAL * 6, uid=SERIES + ".77")
    refuse(tmp_path, "unevenly spaced: 2 of 6")


def test_a_tilted_gantry_is_named(tmp_path: Path) -> None:
    for k, pixels in enumerate(VOXELS):
        write_slice(tmp_path / f"{k}.dcm", pixels, NORMAL * k + COSINES[:, 1] * k * np.tan(np.radians(15)))
    refuse(tmp_path, r"lean by 15\.0 degrees")


@pytest.mark.parametrize(("lean", "is_straight"), [(0.0, True), (0.9e-3, True), (1.1e-3, False), (1.5e-3, False)])
def test_slices_may_lean_by_the_rounding_of_positions(lean: float, is_straight: bool, tmp_path: Path) -> None:
    for k, pixels in enumerate(VOXELS):
        write_slice(tmp_path / f"{k}.dcm", pixels, 10 * NORMAL * k + COSINES[:, 1] * 10 * k * lean)
    if is_straight:
        np.testing.assert_array_equal(read_volume(tmp_path).values, VOXELS)
    else:
        refuse(tmp_path, r"lean by 0\.1 degrees")


def test_an_odd_number_of_bytes_is_padded_by_one_and_no_more(tmp_path: Path) -> None:
    pixels = (VOXELS[0] % 256).astype(np.uint8)
    write_slice(tmp_path / "a.dcm", pixels, (1, 2, 3))  # 35 bytes, padded to 36
    np.testing.assert_array_equal(read_volume(tmp_path / "a.dcm").values[0], pixels)
    write_slice(tmp_path / "a.dcm", pixels, (1, 2, 3), raw=bytes(38))
    refuse(tmp_path / "a.dcm", "35 bytes.*38")


def test_one_slice(tmp_path: Path) -> None:
    write_slice(tmp_path / "a.dcm", VOXELS[0], (1, 2, 3), SliceThickness=4)
    volume = read_volume(tmp_path / "a.dcm")
    assert volume.shape == (1, 5, 7)
    assert volume.grid.spacing == (0.5, 1.25, 4.0)
    assert volume.grid.origin == (1, 2, 3)
    assert "its folder" in volume.notes[0]
    write_slice(tmp_path / "noname", VOXELS[0], (1, 2, 3), PhotometricInterpretation="MONOCHROME1")
    notes = read_volume(tmp_path / "noname").notes
    assert any("without thickness" in note for note in notes)
    assert any("white" in note for note in notes)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"SamplesPerPixel": 3}, "colours"),
        ({"PhotometricInterpretation": "PALETTE COLOR"}, "colours"),
        ({"NumberOfFrames": 9}, "9 frames"),
        ({"BitsAllocated": 1}, "1 bits"),
        ({"Rows": None}, "lacks the field Rows"),
        ({"Rows": 0}, "at least 1 voxel"),
        ({"Rows": 6}, "84 bytes.*70"),
        ({"PixelSpacing": None}, "PixelSpacing"),
        ({"PixelSpacing": [0, 1]}, "spacing must be positive"),
        ({"ImageOrientationPatient": None}, "ImageOrientationPatient"),
        ({"ImageOrientationPatient": [1, 0, 0, 0.5, 1, 0]}, "orthonormal"),
        ({"ImageOrientationPatient": [0] * 6}, "orthonormal"),
        ({"ImagePositionPatient": [1, 2]}, "ImagePositionPatient"),
        ({"PixelData": bytes(60)}, "70 bytes.*60"),
        ({"PixelData": bytes(72)}, "70 bytes.*72"),
        ({"PixelData": bytes(140)}, "70 bytes.*140"),
        ({"PixelData": None}, "no pixels"),
    ],
)
def test_what_is_no_slice_is_refused(changes: dict[str, Any], words: str, tmp_path: Path) -> None:
    write_slice(tmp_path / "a.dcm", VOXELS[0], (1, 2, 3), **changes)
    refuse(tmp_path / "a.dcm", words)


def test_deflated_files_are_not_unpacked(tmp_path: Path) -> None:
    write_slice(tmp_path / "a.dcm", VOXELS[0], (1, 2, 3), syntax="1.2.840.10008.1.2.1.99")
    refuse(tmp_path / "a.dcm", "deflated")


def test_compressed_pixels_that_are_none_are_named(tmp_path: Path) -> None:
    pixels = pydicom.encaps.encapsulate([b"\xff\x4f\xff\x51" + bytes(60)])
    write_slice(tmp_path / "a.dcm", VOXELS[0], (1, 2, 3), syntax="1.2.840.10008.1.2.4.90", raw=pixels)
    refuse(tmp_path / "a.dcm", r"JPEG 2000.*could not be unpacked: it is a picture of 0 x 0")


def test_run_length_pixels_are_unpacked(tmp_path: Path) -> None:
    write_slice(tmp_path / "a.dcm", VOXELS[0], (1, 2, 3))
    data = pydicom.dcmread(tmp_path / "a.dcm")
    data.compress("1.2.840.10008.1.2.5")
    data.save_as(tmp_path / "b.dcm")
    np.testing.assert_array_equal(read_volume(tmp_path / "b.dcm").values[0], VOXELS[0])


def test_a_file_cut_anywhere_is_refused(tmp_path: Path) -> None:
    write_slice(tmp_path / "a.dcm", VOXELS[0], (1, 2, 3))
    whole = (tmp_path / "a.dcm").read_bytes()
    for length in [*range(0, len(whole), 17), len(whole) - 1]:
        (tmp_path / "a.dcm").write_bytes(whole[:length])
        refuse(tmp_path / "a.dcm", ".")


def test_a_missing_package_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_slice(tmp_path / "a.dcm", VOXELS[0], (1, 2, 3))
    monkeypatch.setitem(__import__("sys").modules, "pydicom", None)
    with pytest.raises(ImportError, match="pip install pydicom"):
        read_volume(tmp_path / "a.dcm")
