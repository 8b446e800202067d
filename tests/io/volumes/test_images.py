"""Pictures as volumes of one slice."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOImage import vtkPNGReader, vtkPNGWriter

import deformnb as dn
from deformnb.errors import VolumeFileError
from deformnb.session.inputs import best_view

GREY = np.random.default_rng(2).integers(0, 255, (12, 17), dtype=np.uint8)


@pytest.mark.parametrize(
    ("name", "picture", "wanted"),
    [
        ("a.png", Image.fromarray(GREY), GREY),
        ("b.png", Image.fromarray(GREY.astype(np.uint16) * 257), GREY.astype(np.uint16) * 257),
        ("c.png", Image.fromarray(np.repeat(GREY[..., None], 3, axis=2)), GREY),
        ("d.png", Image.fromarray(GREY > 99), np.where(GREY > 99, 255, 0)),
    ],
)
def test_grey_values_are_kept(name: str, picture: Image.Image, wanted: np.ndarray, tmp_path: Path) -> None:
    picture.save(tmp_path / name)
    volume = dn.read_volume(tmp_path / name)
    np.testing.assert_array_equal(volume.values, wanted[None])
    assert "a picture was taken as a volume of one slice" in volume.notes
    assert ("its colours became grey values" in volume.notes) == (name == "c.png")


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_vtk_agrees(dtype: type, tmp_path: Path) -> None:
    """Compare with its PNG files, whose rows it numbers from the bottom."""
    known = GREY.astype(dtype) * (257 if dtype is np.uint16 else 1)
    dn.write_volume(dn.Volume(known[None], dn.Grid((1, *known.shape))), tmp_path / "ours.png")
    reader = vtkPNGReader()
    reader.SetFileName(str(tmp_path / "ours.png"))
    reader.Update()
    image = reader.GetOutput()
    theirs = vtk_to_numpy(image.GetPointData().GetScalars()).reshape(known.shape)[::-1]
    np.testing.assert_array_equal(theirs, known)
    writer = vtkPNGWriter()
    writer.SetFileName(str(tmp_path / "theirs.png"))
    writer.SetInputData(image)
    writer.Write()
    np.testing.assert_array_equal(dn.read_volume(tmp_path / "theirs.png").values[0], known)


def test_a_photograph_is_turned_as_its_camera_says(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6  # to be turned clockwise by a quarter
    wide = np.zeros((16, 48), np.uint8)
    wide[:, :16] = 255
    Image.fromarray(wide).save(tmp_path / "a.jpg", exif=exif, quality=95)
    upright = dn.read_volume(tmp_path / "a.jpg").values[0]
    assert upright.shape == (48, 16)
    assert upright[:14].min() > 200 > 50 > upright[18:].max()


def test_a_picture_is_seen_upright_and_bent(tmp_path: Path) -> None:
    large = np.kron(GREY, np.ones((4, 4), np.uint8))
    Image.fromarray(large).save(tmp_path / "plate.png")
    volume = dn.read_volume(tmp_path / "plate.png")
    session = dn.Session(volume, view=best_view(volume))
    shown = session.pictures.picture().grey()
    assert shown.shape == large.shape
    assert np.corrcoef(shown.ravel(), large.ravel())[0, 1] > 0.999
    session.editing.edit_points(session.editing.points.add([20.0, 20.0], [25.0, 22.0]))
    assert session.editing.deformation.apply(volume).values.shape == (1, 48, 68)


@pytest.mark.parametrize("content", [b"", b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff\xe0 cut", b"text"])
def test_what_is_no_picture_is_refused(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(content)
    with pytest.raises(VolumeFileError, match=r"a\.png: it (is cut short|cannot be read)"):
        dn.read_volume(tmp_path / "a.png")
    Image.fromarray(GREY).save(tmp_path / "b.png")
    whole = (tmp_path / "b.png").read_bytes()
    (tmp_path / "b.png").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(VolumeFileError, match=r"b\.png"):
        dn.read_volume(tmp_path / "b.png")
