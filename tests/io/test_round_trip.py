"""Written files are read back, here and by other packages, at the same places."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deformnb import Grid, Volume
from deformnb.errors import Cancelled, DeformError
from deformnb.io import FORMATS, describe_file, read_volume, write_volume
from deformnb.volume.volume import DTYPES

WRITABLE = [s for kind, entry in FORMATS.items() if entry.write and kind != "image" for s in entry.suffixes]
FILES = [
    s
    for kind, entry in FORMATS.items()
    if entry.write and kind != "image" and not entry.folder_marks
    for s in entry.suffixes
]

# NIfTI-1 stores places as float32; the others store enough digits to get the same float64 back, but for one product
# and quotient of spacing and direction.
TOLERANCE = {".nii": 1e-6, ".nii.gz": 1e-6}
KEEPS_BOOL = {".npy", ".raw", ".zarr"}


def rotation(seed: int, mirrored: bool) -> list[list[float]]:
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    if (np.linalg.det(q) < 0) != mirrored:
        q[:, 0] *= -1
    return q.tolist()


def make(
    dtype: str = "int16",
    shape: tuple[int, int, int] = (3, 4, 5),
    seed: int = 1,
    mirrored: bool = False,
    is_labels: bool = False,
) -> Volume:
    generator = np.random.default_rng(seed)
    if dtype == "bool":
        values = generator.integers(0, 2, shape).astype(bool)
    elif dtype.startswith("float"):
        values = generator.normal(size=shape).astype(dtype)
    else:
        limits = np.iinfo(dtype)
        values = generator.integers(limits.min, limits.max, shape, dtype, endpoint=True)
    grid = Grid(shape, (0.5, 1.25, 3.0), (-12.5, 7.0, 101.25), rotation(seed, mirrored))
    return Volume(values, grid, "made", is_labels)


def assert_same(read: Volume, written: Volume, suffix: str) -> None:
    dtype = np.dtype(np.uint8) if written.dtype == np.bool_ and suffix not in KEEPS_BOOL else written.dtype
    assert read.dtype == dtype
    np.testing.assert_array_equal(read.values, written.values)
    assert read.grid.shape == written.grid.shape
    size = np.abs(written.grid.corners()).max()
    np.testing.assert_allclose(
        read.grid.corners(), written.grid.corners(), rtol=0, atol=TOLERANCE.get(suffix, 1e-14) * size
    )
    np.testing.assert_allclose(read.grid.spacing, written.grid.spacing, rtol=TOLERANCE.get(suffix, 1e-14))
    assert read.is_labels == written.is_labels


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("suffix", WRITABLE)
def test_every_type_and_any_direction_come_back(suffix: str, dtype: str, mirrored: bool, tmp_path: Path) -> None:
    volume = make(dtype, mirrored=mirrored)
    path = tmp_path / f"a b-ü{suffix}"
    write_volume(volume, path)
    read = read_volume(path)
    assert_same(read, volume, suffix)
    assert read.name == "a b-ü"
    assert not read.notes
    described = describe_file(path)
    assert (described.grid, described.dtype) == (read.grid, read.dtype)
    assert described.memory_bytes == read.values.nbytes
    assert described.value_range is None
    assert describe_file(path, voxels=True).value_range == read.value_range


@pytest.mark.parametrize("suffix", WRITABLE)
@given(st.integers(1, 40), st.integers(1, 40), st.integers(1, 3000), st.integers(0, 99))
def test_any_shape_comes_back(tmp_path_factory, suffix: str, nz: int, ny: int, nx: int, seed: int) -> None:
    volume = make("uint16", (nz, ny, nx), seed)
    path = tmp_path_factory.getbasetemp() / f"shape{suffix}"
    write_volume(volume, path)
    assert_same(read_volume(path), volume, suffix)


@pytest.mark.parametrize("suffix", WRITABLE)
def test_labels_stay_labels(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a{suffix}"
    write_volume(make("uint8", is_labels=True), path)
    assert read_volume(path).is_labels
    assert describe_file(path).is_labels
    assert not read_volume(path, is_labels=False).is_labels
    write_volume(Volume(make("uint8").values, make("uint8").grid, "labels"), path)
    assert not read_volume(path).is_labels
    assert read_volume(path, is_labels=True).is_labels


@pytest.mark.parametrize("suffix", FILES)
def test_arrays_in_any_memory_order_are_written_alike(suffix: str, tmp_path: Path) -> None:
    volume = make("float32", (6, 7, 8))
    grid = volume.grid
    frozen = volume.values.copy()
    frozen.flags.writeable = False
    write_volume(volume, tmp_path / f"plain{suffix}")
    plain = (tmp_path / f"plain{suffix}").read_bytes().replace(b"plain", b"")
    for number, values in enumerate((np.asfortranarray(frozen), frozen, frozen[::-1, :, ::-1][::-1, :, ::-1])):
        write_volume(Volume(values, grid, "made"), tmp_path / f"{number}{suffix}")
        # equal volumes give equal bytes: no time, no name, no memory order in the file
        assert (tmp_path / f"{number}{suffix}").read_bytes().replace(
            f"{number}{suffix}".encode(), suffix.encode()
        ) == plain


@pytest.mark.parametrize("suffix", WRITABLE)
def test_progress_ends_at_one_and_cancelling_leaves_nothing(suffix: str, tmp_path: Path) -> None:
    volume = Volume.from_array(np.zeros((40, 256, 256), np.float32))
    path = tmp_path / f"a{suffix}"
    told: list[float] = []
    write_volume(volume, path, progress=told.append)
    assert told == sorted(told)
    assert told[-1] == 1.0
    assert len(told) > 2
    told.clear()
    read_volume(path, progress=told.append)
    assert told == sorted(told)
    assert told[-1] == 1.0

    def cancel(share: float) -> None:
        raise Cancelled

    before = {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}
    with pytest.raises(Cancelled):
        write_volume(Volume(volume.values + 1, volume.grid), path, progress=cancel)
    assert {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()} == before
    with pytest.raises(Cancelled):
        read_volume(path, progress=cancel)


@pytest.mark.parametrize("suffix", WRITABLE)
@pytest.mark.parametrize("stride", [2, 3, 7, 100])
def test_a_stride_keeps_every_nth_voxel_at_its_place(suffix: str, stride: int, tmp_path: Path) -> None:
    volume = make("int32", (9, 80, 700))  # more than one block of a MiB
    path = tmp_path / f"a{suffix}"
    write_volume(volume, path)
    read = read_volume(path, stride=stride)
    np.testing.assert_array_equal(read.values, volume.values[::stride, ::stride, ::stride])
    last = np.array(read.shape[::-1]) - 1
    np.testing.assert_allclose(read.grid.index_to_point(last), volume.grid.index_to_point(last * stride), atol=1e-4)
    assert any("every" in note for note in read.notes)
    with pytest.raises(DeformError, match="stride"):
        read_volume(path, stride=0)


def test_fortran_order_numpy_files_are_read_without_turning(tmp_path: Path) -> None:
    values = make("int16", (9, 8, 7)).values
    np.save(tmp_path / "a.npy", np.asfortranarray(values))
    np.testing.assert_array_equal(read_volume(tmp_path / "a.npy").values, values)
    np.testing.assert_array_equal(read_volume(tmp_path / "a.npy", stride=2).values, values[::2, ::2, ::2])
    np.save(tmp_path / "b.npy", np.asfortranarray(values[0]))
    np.testing.assert_array_equal(read_volume(tmp_path / "b.npy").values, values[:1])


# -- other packages read our files ------------------------------------------------------------------------


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("suffix", [".nii", ".nii.gz", ".nrrd", ".nhdr", ".mha", ".mhd"])
def test_simpleitk_reads_the_same_places(suffix: str, dtype: str, mirrored: bool, tmp_path: Path) -> None:
    sitk = pytest.importorskip("SimpleITK")
    volume = make(dtype, mirrored=mirrored, is_labels=True)
    path = tmp_path / f"a{suffix}"
    write_volume(volume, path)
    image = sitk.ReadImage(str(path))
    np.testing.assert_array_equal(sitk.GetArrayFromImage(image), volume.values)
    for index in ((0, 0, 0), (4, 3, 2), (0, 3, 1)):
        np.testing.assert_allclose(
            image.TransformIndexToPhysicalPoint(index),
            volume.grid.index_to_point(index),
            atol=1e-5 if suffix.startswith(".nii") else 1e-11,
        )


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("suffix", [".nii", ".nii.gz"])
def test_nibabel_reads_the_same_places_from_sform_and_qform(suffix: str, mirrored: bool, tmp_path: Path) -> None:
    nibabel = pytest.importorskip("nibabel")
    volume = make("uint8", mirrored=mirrored, is_labels=True)
    write_volume(volume, tmp_path / f"a{suffix}")
    image = nibabel.load(tmp_path / f"a{suffix}")
    np.testing.assert_array_equal(np.asanyarray(image.dataobj), volume.values.T)
    left, posterior, superior = volume.grid.index_to_point([4, 2, 1])
    for affine in (image.get_sform(), image.get_qform()):
        np.testing.assert_allclose(
            nibabel.affines.apply_affine(affine, [4, 2, 1]), [-left, -posterior, superior], atol=1e-5
        )
    assert image.header.get_xyzt_units()[0] == "unknown"
    assert image.header.get_intent()[0] == "label"


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("dtype", DTYPES)
def test_vtk_reads_the_same_places(dtype: str, mirrored: bool, tmp_path: Path) -> None:
    pyvista = pytest.importorskip("pyvista")
    volume = Volume(make(dtype, mirrored=mirrored).values, make(dtype, mirrored=mirrored).grid, 'a <b> & "c"')
    write_volume(volume, tmp_path / "a.vti")
    image = pyvista.read(tmp_path / "a.vti")
    read = Volume.from_pyvista(image)
    assert image.point_data.keys() == ['a <b> & "c"']
    np.testing.assert_array_equal(read.values, volume.values)
    np.testing.assert_allclose(image.GetPoint(59), volume.grid.index_to_point([4, 3, 2]), atol=1e-11)


def test_pynrrd_and_numpy_read_what_is_written(tmp_path: Path) -> None:
    nrrd = pytest.importorskip("nrrd")
    volume = make("float64")
    for suffix in (".nrrd", ".nhdr", ".npy"):
        write_volume(volume, tmp_path / f"a{suffix}")
    for suffix in (".nrrd", ".nhdr"):
        values, header = nrrd.read(str(tmp_path / f"a{suffix}"))
        np.testing.assert_array_equal(values.T, volume.values)
        np.testing.assert_allclose(header["space directions"], volume.grid.matrix.T, rtol=1e-15)
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy", allow_pickle=False), volume.values)


# -- files of other packages are read here ---------------------------------------------------------------------------


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("dtype", [*DTYPES[1:], "uint32", "int64"])
@pytest.mark.parametrize("suffix", [".nii", ".nii.gz", ".nrrd", ".nhdr", ".mha", ".mhd"])
def test_files_of_simpleitk(suffix: str, dtype: str, compressed: bool, tmp_path: Path) -> None:
    sitk = pytest.importorskip("SimpleITK")
    grid = make().grid
    image = sitk.GetImageFromArray(np.arange(60).reshape(3, 4, 5).astype(dtype))
    image.SetSpacing(grid.spacing)
    image.SetOrigin(grid.origin)
    image.SetDirection(np.ravel(grid.direction).tolist())
    sitk.WriteImage(image, str(tmp_path / f"a{suffix}"), compressed)
    read = read_volume(tmp_path / f"a{suffix}")
    np.testing.assert_array_equal(read.values.ravel(), np.arange(60))
    assert read.dtype.name == {"uint32": "int32", "int64": "int32"}.get(dtype, dtype)
    np.testing.assert_allclose(read.grid.corners(), grid.corners(), atol=1e-5 if suffix.startswith(".nii") else 1e-11)


def test_simpleitk_reads_and_writes_the_same_raw_voxels(tmp_path: Path) -> None:
    """Read them by a MetaImage header next to them, which is text."""
    sitk = pytest.importorskip("SimpleITK")
    volume = make()
    write_volume(volume, tmp_path / "ours.raw")
    text = json.loads((tmp_path / "ours.raw.json").read_text(encoding="utf-8"))
    assert (text["byte_order"], text["dtype"]) == ("little", "int16")
    size, spacing, origin = (" ".join(map(repr, row)) for row in (text["shape"][::-1], text["spacing"], text["origin"]))
    axes = " ".join(repr(c) for c in np.transpose(text["direction"]).ravel().tolist())
    (tmp_path / "ours.mhd").write_text(
        f"ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nTransformMatrix = {axes}\n"
        f"Offset = {origin}\nElementSpacing = {spacing}\nDimSize = {size}\nElementType = MET_SHORT\n"
        "ElementDataFile = ours.raw\n",
        encoding="utf-8",
    )
    image = sitk.ReadImage(str(tmp_path / "ours.mhd"))
    np.testing.assert_array_equal(sitk.GetArrayFromImage(image), volume.values)
    assert_same(Volume.from_sitk(image), replace(volume, name=""), ".raw")
    sitk.WriteImage(image, str(tmp_path / "theirs.mhd"))
    (tmp_path / "theirs.raw.json").write_text(
        json.dumps({key: value for key, value in text.items() if key != "crc32"}), encoding="utf-8"
    )
    assert_same(read_volume(tmp_path / "theirs.raw"), volume, ".raw")


@pytest.mark.parametrize("encoding", ["raw", "gzip", "bzip2"])
@pytest.mark.parametrize("suffix", [".nrrd", ".nhdr"])
def test_files_of_pynrrd(suffix: str, encoding: str, tmp_path: Path) -> None:
    nrrd = pytest.importorskip("nrrd")
    grid = make().grid
    values = np.arange(60, dtype=np.int16).reshape(3, 4, 5)
    header = {
        "encoding": encoding,
        "space": "right-anterior-superior",
        "space directions": grid.matrix.T,
        "space origin": np.array(grid.origin),
    }
    nrrd.write(str(tmp_path / f"a{suffix}"), values.T, header)
    read = read_volume(tmp_path / f"a{suffix}")
    np.testing.assert_array_equal(read.values, values)
    np.testing.assert_allclose(
        read.grid.index_to_point([4, 3, 2]), grid.index_to_point([4, 3, 2]) * [-1, -1, 1], atol=1e-11
    )


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("codes", [(1, 0), (0, 1), (2, 3), (0, 0)])
@pytest.mark.parametrize("kind", ["Nifti1Image", "Nifti2Image"])
@pytest.mark.parametrize("order", "<>")
def test_files_of_nibabel(kind: str, codes: tuple[int, int], order: str, mirrored: bool, tmp_path: Path) -> None:
    nibabel = pytest.importorskip("nibabel")
    grid = make(mirrored=mirrored).grid
    affine = np.diag([-1, -1, 1, 1]) @ grid.affine
    values = np.arange(60, dtype=np.int16).reshape(3, 4, 5)
    maker = getattr(nibabel, kind)
    image = maker(values.T, affine, maker.header_class(endianness=order))
    image.set_qform(affine, codes[0] or 1, update_affine=False)
    image.set_sform(affine, codes[1] or 1, update_affine=False)
    image.to_filename(tmp_path / "a.nii")
    data = bytearray((tmp_path / "a.nii").read_bytes())  # nibabel itself never writes two codes of zero
    struct.pack_into(
        order + "hh" if kind == "Nifti1Image" else order + "ii", data, 252 if kind == "Nifti1Image" else 344, *codes
    )
    (tmp_path / "a.nii").write_bytes(data)
    read = read_volume(tmp_path / "a.nii")
    np.testing.assert_array_equal(read.values, values)
    if codes == (0, 0):
        assert read.grid.orientation == "RAS"
        assert "states no place" in read.notes[0]
        np.testing.assert_allclose(read.grid.spacing, grid.spacing, rtol=1e-6)
    else:
        assert not read.notes
        np.testing.assert_allclose(read.grid.corners(), grid.corners(), atol=2e-5)


@pytest.mark.parametrize("header_type", ["UInt32", "UInt64"])
@pytest.mark.parametrize("order", ["LittleEndian", "BigEndian"])
@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("mode", ["inline", "appended raw", "appended base64"])
@pytest.mark.parametrize("count", [7, 64])  # 64: more than one compressed block
def test_files_of_vtk(header_type: str, order: str, compressed: bool, mode: str, count: int, tmp_path: Path) -> None:
    vtk = pytest.importorskip("vtkmodules.vtkIOXML")
    grid = Grid((count, 5, 61), (0.5, 1.25, 3.0), (-12.5, 7.0, 101.25), rotation(1, False))
    values = np.random.default_rng(0).integers(-30000, 30000, grid.shape, np.int16)
    image = Volume(values, grid).to_pyvista()
    image.point_data["b"] = np.zeros(values.size, np.uint8)
    writer = vtk.vtkXMLImageDataWriter()
    writer.SetFileName(str(tmp_path / "a.vti"))
    writer.SetInputData(image)
    getattr(writer, f"SetHeaderTypeTo{header_type}")()
    getattr(writer, f"SetByteOrderTo{order}")()
    writer.SetBlockSize(8192)
    if not compressed:
        writer.SetCompressorTypeToNone()
    if mode == "inline":
        writer.SetDataModeToBinary()
    else:
        writer.SetDataModeToAppended()
        writer.SetEncodeAppendedData(mode.endswith("base64"))
    assert writer.Write()
    read = read_volume(tmp_path / "a.vti")
    np.testing.assert_array_equal(read.values, values)
    np.testing.assert_allclose(read.grid.corners(), grid.corners(), atol=1e-11)
    assert "of several arrays 'values' was taken" in read.notes[0]


def test_vti_with_an_extent_that_begins_elsewhere_and_with_cells(tmp_path: Path) -> None:
    pyvista = pytest.importorskip("pyvista")
    image = pyvista.ImageData(dimensions=(5, 4, 3), spacing=(1, 2, 3), direction_matrix=rotation(2, False))
    image.SetExtent(2, 6, -1, 2, 5, 7)
    image.point_data["a"] = np.arange(60)
    image.save(tmp_path / "a.vti")
    read = read_volume(tmp_path / "a.vti")
    np.testing.assert_allclose(read.grid.index_to_point([0, 0, 0]), image.GetPoint(0), atol=1e-12)
    del image.point_data["a"]
    image.cell_data["a"] = np.arange(24)
    image.save(tmp_path / "b.vti")
    cells = read_volume(tmp_path / "b.vti")
    assert cells.shape == (2, 3, 4)
    np.testing.assert_array_equal(cells.values.ravel(), np.arange(24))
    np.testing.assert_allclose(cells.grid.index_to_point([3, 2, 1]), image.cell_centers().points[23], atol=1e-6)


# -- real files ------------------------------------------------------------------------------------------------------


def test_the_carp_and_its_spacing(real_data) -> None:
    carp = read_volume(real_data("carp.nii.gz"), stride=4, spacing=(1, 1, 1))
    assert carp.shape == (64, 128, 64)
    assert carp.grid.orientation == "RAS"
    assert carp.grid.spacing == (4, 4, 4)
    true = read_volume(real_data("carp.nii.gz"), stride=4)
    assert true.grid.spacing == (1.5625, 4, 3.125)
    np.testing.assert_array_equal(true.values, carp.values)


@pytest.mark.parametrize(
    "name",
    [
        "carp.nii.gz",
        "abdomen_ct.nii.gz",
        "knee_labels.nrrd",
        "abdomen_labels.nrrd",
        "knee_mr_bent.nrrd",
        "lobster.nrrd",
    ],
)
def test_real_files_as_simpleitk_reads_them(name: str, real_data) -> None:
    sitk = pytest.importorskip("SimpleITK")
    image = sitk.ReadImage(str(real_data(name)))
    read = read_volume(real_data(name), spacing=image.GetSpacing())  # as in the file, the carp's wrong one too
    np.testing.assert_array_equal(read.values, sitk.GetArrayViewFromImage(image))
    last = np.array(image.GetSize()) - 1
    for index in (np.zeros(3, int), last):
        # coordinates up to 300 mm of float32 headers
        np.testing.assert_allclose(
            read.grid.index_to_point(index), image.TransformIndexToPhysicalPoint(index.tolist()), atol=1e-4
        )
    assert read.dtype == sitk.GetArrayViewFromImage(image).dtype
