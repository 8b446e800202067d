"""DICOM series to read: CT slices with an oblique direction, and one that is wrong where a test requests it."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pydicom = pytest.importorskip("pydicom")

VOXELS = np.random.default_rng(0).integers(0, 4000, (6, 5, 7)).astype(np.uint16)
COSINES = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
SERIES = "1.2.826.0.1.3680043.8.498.1"
CT = "1.2.840.10008.5.1.4.1.1.2"


def write_slice(
    path: Path,
    pixels: np.ndarray,
    position: Any,
    *,
    uid: str = "",
    syntax: str = "1.2.840.10008.1.2.1",
    raw: bytes | None = None,
    **changes: Any,
) -> None:
    """One CT slice; a change of None removes the field."""
    data = pydicom.Dataset()
    data.file_meta = pydicom.dataset.FileMetaDataset()
    data.file_meta.TransferSyntaxUID = syntax
    data.file_meta.MediaStorageSOPClassUID = data.SOPClassUID = CT
    data.file_meta.MediaStorageSOPInstanceUID = data.SOPInstanceUID = uid or f"{SERIES}.{abs(hash(path.name)) % 10**9}"
    data.PatientName = "<img src=x onerror=alert(1)>"
    data.SeriesInstanceUID, data.SeriesNumber, data.SeriesDescription = SERIES, 3, "thin"
    data.Rows, data.Columns = pixels.shape
    data.SamplesPerPixel, data.PhotometricInterpretation = 1, "MONOCHROME2"
    data.BitsAllocated = data.BitsStored = 8 * pixels.itemsize
    data.HighBit = data.BitsStored - 1
    data.PixelRepresentation = int(pixels.dtype.kind == "i")
    data.PixelSpacing = [1.25, 0.5]  # between rows, then between columns
    data.ImageOrientationPatient = [round(float(c), 6) for c in COSINES[:, :2].T.ravel()]
    data.ImagePositionPatient = [round(float(p), 4) for p in position]
    big = syntax == "1.2.840.10008.1.2.2"
    data.PixelData = pixels.astype(pixels.dtype.newbyteorder(">" if big else "<")).tobytes() if raw is None else raw
    data["PixelData"].VR = "OB" if pixels.itemsize == 1 else "OW"
    if len(data.PixelData) % 2:
        data.PixelData += b"\0"
    for name, value in changes.items():
        if value is None:
            delattr(data, name)
        else:
            setattr(data, name, value)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # some of these are wrong on purpose
        data.save_as(path, enforce_file_format=True)


NORMAL = np.cross(COSINES[:, 0], COSINES[:, 1])


def write_series(
    folder: Path, voxels: np.ndarray = VOXELS, step: float = 2.5, names: str = "{}.dcm", **changes: Any
) -> None:
    """A series whose file names are in another order than its places."""
    order = np.random.default_rng(2).permutation(len(voxels))
    for number, k in enumerate(order):
        write_slice(folder / names.format(f"{number:03d}"), voxels[k], 10 + NORMAL * step * k, **changes)
