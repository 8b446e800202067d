"""DICOM of several frames, in coded pictures, without a preamble, and uneven series that are resampled."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import pytest
from dicom_series import COSINES, NORMAL, VOXELS, write_series, write_slice

from deformnb.errors import DeformError, VolumeFileError
from deformnb.io import read_volume

pydicom = pytest.importorskip("pydicom")


def items(**fields: Any) -> Any:
    data = pydicom.Dataset()
    for name, value in fields.items():
        setattr(data, name, value)
    return pydicom.Sequence([data])


def write_enhanced(path: Path, order: np.ndarray, *, own: bool = True, **changes: Any) -> None:
    """A file of frames whose places are in functional groups, in any order."""
    write_slice(path, VOXELS[0], (9, 9, 9))
    data = pydicom.dcmread(path)
    for name in ("PixelSpacing", "ImageOrientationPatient", "ImagePositionPatient"):
        delattr(data, name)
    data.NumberOfFrames = len(order)
    measures = items(PixelSpacing=[1.25, 0.5], SliceThickness=2.5)
    shared = {
        "PixelMeasuresSequence": measures,
        "PixelValueTransformationSequence": items(RescaleSlope=2, RescaleIntercept=-10),
    }
    turned = {
        "PlaneOrientationSequence": items(
            ImageOrientationPatient=[round(float(c), 6) for c in COSINES[:, :2].T.ravel()]
        )
    }
    data.SharedFunctionalGroupsSequence = items(**shared, **({} if own else turned))
    data.PerFrameFunctionalGroupsSequence = pydicom.Sequence(
        [
            items(
                PlanePositionSequence=items(ImagePositionPatient=[round(float(p), 4) for p in 10 + NORMAL * 2.5 * k]),
                **(turned if own else {}),
            )[0]
            for k in order
        ]
    )
    data.PixelData = VOXELS[order].tobytes()
    for name, value in changes.items():
        setattr(data, name, value)
    data.save_as(path)


@pytest.mark.parametrize("own", [True, False])
def test_frames_with_places_are_slices(own: bool, tmp_path: Path) -> None:
    write_enhanced(tmp_path / "a.dcm", np.random.default_rng(5).permutation(6), own=own)
    read = read_volume(tmp_path / "a.dcm")
    np.testing.assert_array_equal(read.values, VOXELS.astype(int) * 2 - 10)
    np.testing.assert_allclose(read.grid.spacing, (0.5, 1.25, 2.5), rtol=1e-4)
    np.testing.assert_allclose(read.grid.origin, 10, atol=1e-3)
    np.testing.assert_allclose(np.asarray(read.grid.direction)[:, :2], COSINES[:, :2], atol=1e-5)
    assert read.notes == ()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"NumberOfFrames": 5}, "claims 5 frames but describes 6"),
        ({"NumberOfFrames": 7}, "claims 7 frames"),
        ({"PixelData": VOXELS[:5].tobytes()}, "420 bytes.*350"),
        ({"NumberOfFrames": 10**9}, "claims 1000000000"),
        ({"NumberOfFrames": -6}, "claims -6"),
        ({"NumberOfFrames": 0}, "claims 0"),
    ],
)
def test_frames_that_are_miscounted(changes: dict[str, Any], words: str, tmp_path: Path) -> None:
    write_enhanced(tmp_path / "a.dcm", np.arange(6), **changes)
    with pytest.raises(VolumeFileError, match=words):
        read_volume(tmp_path / "a.dcm")


def test_frames_at_one_place_are_several_times(tmp_path: Path) -> None:
    write_enhanced(tmp_path / "a.dcm", np.array([0, 1, 2, 2]))
    with pytest.raises(VolumeFileError, match=r"frame 3 and a.dcm frame 4 are at the same place"):
        read_volume(tmp_path / "a.dcm")


def test_frames_without_places_lie_at_the_distance_of_the_file(tmp_path: Path) -> None:
    options = {"raw": VOXELS.tobytes(), "NumberOfFrames": 6}
    write_slice(tmp_path / "a.dcm", VOXELS[0], (1, 2, 3), SliceThickness=3, **options)
    read = read_volume(tmp_path / "a.dcm")
    np.testing.assert_array_equal(read.values, VOXELS)
    assert read.grid.spacing == pytest.approx((0.5, 1.25, 3))
    assert read.notes == ("its 6 frames state no places: they were taken as slices 3 apart",)
    sitk = pytest.importorskip("SimpleITK")
    np.testing.assert_array_equal(sitk.GetArrayFromImage(sitk.ReadImage(str(tmp_path / "a.dcm"))), VOXELS)
    write_slice(tmp_path / "a.dcm", VOXELS[0], (1, 2, 3), GridFrameOffsetVector=[0, 2, 4, 6, 8, 10], **options)
    read = read_volume(tmp_path / "a.dcm")
    assert read.grid.spacing == pytest.approx((0.5, 1.25, 2))
    assert read.notes == ()
    write_slice(tmp_path / "a.dcm", VOXELS[0], (1, 2, 3), FrameIncrementPointer=0x00181063, SliceThickness=3, **options)
    with pytest.raises(VolumeFileError, match="moments of one slice"):
        read_volume(tmp_path / "a.dcm")
    write_slice(tmp_path / "a.dcm", VOXELS[0], (1, 2, 3), **options)
    with pytest.raises(VolumeFileError, match="no places and no distance"):
        read_volume(tmp_path / "a.dcm")


CODED: dict[str, tuple[str, Callable[[np.ndarray], bytes], Any]] = {
    "lossless": ("1.2.840.10008.1.2.4.70", lambda a: imagecodecs.jpeg8_encode(a, lossless=True), VOXELS),
    "lossless 8 bits": (
        "1.2.840.10008.1.2.4.57",
        lambda a: imagecodecs.jpeg8_encode(a, lossless=True),
        (VOXELS % 256).astype(np.uint8),
    ),
    "JPEG-LS": ("1.2.840.10008.1.2.4.80", imagecodecs.jpegls_encode, VOXELS),
    "JPEG 2000": ("1.2.840.10008.1.2.4.90", lambda a: imagecodecs.jpeg2k_encode(a, reversible=True, level=0), VOXELS),
    "JPEG 2000 signed": (
        "1.2.840.10008.1.2.4.90",
        lambda a: imagecodecs.jpeg2k_encode(a, reversible=True, level=0),
        VOXELS.astype(np.int16) - 2000,
    ),
}


@pytest.mark.parametrize("name", CODED)
def test_coded_pictures(name: str, tmp_path: Path) -> None:
    syntax, encode, values = CODED[name]
    for k, pixels in enumerate(values):
        coded = pydicom.encaps.encapsulate([bytes(encode(np.ascontiguousarray(pixels)))])
        write_slice(tmp_path / f"{k}.dcm", pixels, NORMAL * k, syntax=syntax, raw=coded)
    np.testing.assert_array_equal(read_volume(tmp_path).values, values)
    frames = pydicom.encaps.encapsulate([bytes(encode(np.ascontiguousarray(pixels))) for pixels in values])
    options = {"syntax": syntax, "raw": frames, "SliceThickness": 1}
    write_slice(tmp_path / "all.dcm", values[0], (0, 0, 0), NumberOfFrames=6, **options)
    np.testing.assert_array_equal(read_volume(tmp_path / "all.dcm").values, values)
    write_slice(tmp_path / "all.dcm", values[0], (0, 0, 0), NumberOfFrames=7, **options)
    with pytest.raises(VolumeFileError, match=r"7 frames|unpacked"):
        read_volume(tmp_path / "all.dcm")


@pytest.mark.parametrize("name", CODED)
def test_coded_pictures_of_another_size(name: str, tmp_path: Path) -> None:
    syntax, encode, values = CODED[name]
    coded = pydicom.encaps.encapsulate([bytes(encode(np.zeros((40, 40), values.dtype)))])
    write_slice(tmp_path / "a.dcm", values[0], (0, 0, 0), syntax=syntax, raw=coded)
    with pytest.raises(VolumeFileError, match="could not be unpacked"):
        read_volume(tmp_path / "a.dcm")


def test_what_itk_writes_in_jpeg_is_read(tmp_path: Path) -> None:
    sitk = pytest.importorskip("SimpleITK")
    for kind in ("JPEG", "JPEG2000"):
        write_slice(tmp_path / "a", np.pad(VOXELS[0], 8), (1, 2, 3), BitsStored=12, HighBit=11)
        writer = sitk.ImageFileWriter()
        writer.SetUseCompression(True)
        writer.SetCompressor(kind)
        writer.SetFileName(str(tmp_path / "a.dcm"))
        writer.Execute(sitk.ReadImage(str(tmp_path / "a")))
        np.testing.assert_array_equal(read_volume(tmp_path / "a.dcm").values[0], np.pad(VOXELS[0], 8))


def test_negative_numbers_in_lossless_jpeg_keep_their_sign(tmp_path: Path) -> None:
    values = VOXELS[0].astype(np.int16) - 2000
    stored = (values & 0xFFF).astype(np.uint16)
    coded = pydicom.encaps.encapsulate([bytes(imagecodecs.jpeg8_encode(stored, lossless=True, bitspersample=12))])
    write_slice(
        tmp_path / "a.dcm", values, (0, 0, 0), syntax="1.2.840.10008.1.2.4.70", raw=coded, BitsStored=12, HighBit=11
    )
    np.testing.assert_array_equal(read_volume(tmp_path / "a.dcm").values[0], values)


@pytest.mark.parametrize("syntax", ["1.2.840.10008.1.2", "1.2.840.10008.1.2.1"])
@pytest.mark.parametrize("with_meta", [True, False])
def test_files_without_a_preamble(syntax: str, with_meta: bool, tmp_path: Path) -> None:
    write_series(tmp_path, syntax=syntax)
    for path in tmp_path.iterdir():
        data = path.read_bytes()
        begin = 132 if with_meta else 132 + 12 + int.from_bytes(data[140:144], "little")
        path.write_bytes(data[begin:])
    np.testing.assert_array_equal(read_volume(tmp_path).values, VOXELS)


def linear(places: np.ndarray) -> np.ndarray:
    return 1000 + places @ [30.0, -7.0, 11.0]


def write_slices(folder: Path, depths: list[float], shift: Callable[[float], np.ndarray]) -> None:
    """Slices at depths, moved within their planes, that show a linear function of place."""
    rows, columns = np.mgrid[:20, :24]
    for k, depth in enumerate(depths):
        corner = 10 + NORMAL * depth + shift(depth)
        places = corner + COSINES[:, 0] * columns[..., None] * 0.5 + COSINES[:, 1] * rows[..., None] * 1.25
        write_slice(folder / f"{k}.dcm", np.rint(linear(places) * 10).astype(np.uint16), corner)


@pytest.mark.parametrize(
    ("depths", "lean", "count"),
    [
        ([0, 2, 4, 8, 10], 0.0, 6),
        ([0, 2, 4, 6, 8], 0.27, 5),
        ([0, 2, 4, 10, 12], 0.27, 7),
        ([0, 2, 4, 7, 9, 11.4], 0.0, 7),
    ],
    ids=["missing", "tilted", "both", "uneven"],
)
def test_uneven_slices_are_resampled_where_that_is_asked_for(
    depths: list[float], lean: float, count: int, tmp_path: Path
) -> None:
    write_slices(tmp_path, depths, lambda depth: COSINES[:, 1] * depth * lean)
    with pytest.raises(VolumeFileError, match='uneven_slices="resample"'):
        read_volume(tmp_path)
    read = read_volume(tmp_path, uneven_slices="resample")
    assert read.shape == (count, 20, 24)
    step = depths[-1] / (count - 1)
    assert read.grid.spacing == pytest.approx((0.5, 1.25, step), rel=1e-3)
    assert f"{len(depths)} uneven or leaning slices were resampled linearly to {count}, {step:.4g} apart" in read.notes
    k, j, i = np.mgrid[:count, :20, :24]
    expected = linear(read.grid.index_to_point(np.stack([i, j, k], axis=-1))) * 10
    inner = read.values[:, 4:-4] - expected[:, 4:-4]  # a leaning slice has no voxels at one of its borders
    # whole numbers in the slices and of their means: half each; places to 0.0001 mm and cosines to 1e-6 of 30 mm: 0.1
    assert np.abs(inner).max() < 1.2


def test_the_choice_is_one_of_two(tmp_path: Path) -> None:
    write_series(tmp_path)
    with pytest.raises(DeformError, match="uneven_slices is one of refuse, resample"):
        read_volume(tmp_path, uneven_slices="guess")
    np.testing.assert_array_equal(read_volume(tmp_path, uneven_slices="resample").values, VOXELS)
