"""A length carries its unit: every format in every unit by every way out, measured in metres by another library.

The numbers of metres are written here and not taken from the package's own table.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

import deformnb as dn
from deformnb.cli.main import main
from deformnb.errors import DeformError
from deformnb.io.landmarks.formats import LANDMARK_FORMATS
from deformnb.io.volumes.formats import FORMATS
from deformnb.rbf.fields import Identity
from deformnb.session.exports import export
from deformnb.session.session import Session
from deformnb.volume import units
from deformnb.volume.units import find_unit

nibabel, nrrd = pytest.importorskip("nibabel"), pytest.importorskip("nrrd")
sitk, tifffile = pytest.importorskip("SimpleITK"), pytest.importorskip("tifffile")
zarr, pyvista, xarray = pytest.importorskip("zarr"), pytest.importorskip("pyvista"), pytest.importorskip("xarray")

METRES = {"pm": 1e-12, "\u00c5": 1e-10, "nm": 1e-9, "\u00b5m": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}
NAMES = {
    "pm": "picometer",
    "\u00c5": "angstrom",
    "nm": "nanometer",
    "\u00b5m": "micrometer",
    "mm": "millimeter",
    "cm": "centimeter",
    "m": "meter",
    "in": "inch",
}
SPACING = (0.5, 0.75, 2.0)
VALUES = np.arange(4 * 5 * 6, dtype=np.uint8).reshape(4, 5, 6)


# ---- files made by other libraries -----------------------------------------------------------------------------------


def _nifti(path: Path, unit: str) -> Path:
    image = nibabel.Nifti1Image(VALUES.transpose(2, 1, 0), np.diag([*SPACING, 1.0]))
    image.header.set_xyzt_units({"m": "meter", "mm": "mm", "\u00b5m": "micron"}[unit])
    nibabel.save(image, path / "a.nii.gz")
    return path / "a.nii.gz"


def _ome(path: Path, unit: str) -> Path:
    about = {
        key: value
        for axis, length in zip("XYZ", SPACING, strict=True)
        for key, value in ((f"PhysicalSize{axis}", length), (f"PhysicalSize{axis}Unit", unit))
    }
    tifffile.imwrite(path / "a.ome.tif", VALUES, metadata={"axes": "ZYX", **about}, photometric="minisblack")
    return path / "a.ome.tif"


def _imagej(path: Path, unit: str) -> Path:
    words = {"\u00b5m": "micron", "in": "inch"}
    tifffile.imwrite(
        path / "a.tif",
        VALUES,
        imagej=True,
        resolution=(1 / SPACING[0], 1 / SPACING[1]),
        metadata={"axes": "ZYX", "spacing": SPACING[2], "unit": words.get(unit, unit)},
    )
    return path / "a.tif"


def _nrrd(path: Path, unit: str) -> Path:
    word = {"\u00b5m": "um", "\u00c5": "angstrom"}.get(unit, unit)  # pynrrd writes ASCII
    nrrd.write(
        str(path / "a.nrrd"),
        VALUES.transpose(2, 1, 0),
        {
            "space": "left-posterior-superior",
            "space directions": np.diag(SPACING),
            "space origin": [0, 0, 0],
            "space units": [word] * 3,
        },
    )
    return path / "a.nrrd"


def _nrrd_axes(path: Path, unit: str) -> Path:
    nrrd.write(str(path / "a.nrrd"), VALUES.transpose(2, 1, 0), {"spacings": SPACING, "units": [NAMES[unit]] * 3})
    return path / "a.nrrd"


def _zarr(path: Path, unit: str) -> Path:
    group = zarr.open_group(str(path / "a.zarr"), mode="w", zarr_format=2)
    group.create_array("0", data=VALUES, chunks=VALUES.shape)
    scale = [{"type": "scale", "scale": list(SPACING[::-1])}]
    axes = [{"name": name, "type": "space", "unit": NAMES[unit]} for name in "zyx"]
    group.attrs["multiscales"] = [
        {"version": "0.4", "axes": axes, "datasets": [{"path": "0", "coordinateTransformations": scale}]}
    ]
    return path / "a.zarr"


def _raw(path: Path, unit: str) -> Path:
    VALUES.tofile(path / "a.raw")
    (path / "a.raw.json").write_text(
        json.dumps({"shape": VALUES.shape, "dtype": "uint8", "spacing": SPACING, "unit": NAMES[unit]}), encoding="utf-8"
    )
    return path / "a.raw"


def _sitk(suffix: str) -> Callable[[Path, str], Path]:
    def make(path: Path, _unit: str) -> Path:
        image = sitk.GetImageFromArray(VALUES)
        image.SetSpacing(SPACING)
        sitk.WriteImage(image, str(path / f"a{suffix}"))
        return path / f"a{suffix}"

    return make


def _vti(path: Path, _unit: str) -> Path:
    image = pyvista.ImageData(dimensions=(6, 5, 4), spacing=SPACING)
    image.point_data["v"] = VALUES.reshape(-1)
    image.save(path / "a.vti")
    return path / "a.vti"


SOURCES: dict[str, tuple[Callable[[Path, str], Path], tuple[str, ...]]] = {
    "nifti": (_nifti, ("m", "mm", "\u00b5m")),
    "ome": (_ome, tuple(METRES)),
    "imagej": (_imagej, ("nm", "\u00b5m", "mm", "cm", "m", "in")),
    "nrrd": (_nrrd, tuple(METRES)),
    "nrrd of axes": (_nrrd_axes, tuple(METRES)),
    "zarr": (_zarr, tuple(METRES)),
    "raw": (_raw, tuple(METRES)),
    "mha of itk": (_sitk(".mha"), ("mm",)),
    "nrrd of itk": (_sitk(".nrrd"), ("mm",)),
    "vti": (_vti, ("mm",)),
}


# ---- measured by other libraries -------------------------------------------------------------------------------------

Sizes = tuple[float, ...]


def _read_nibabel(image: Any) -> Sizes:
    metre = {"meter": 1.0, "mm": 1e-3, "micron": 1e-6}[image.header.get_xyzt_units()[0]]
    return tuple(metre * float(zoom) for zoom in image.header.get_zooms()[:3])


def _read_itk(path: Path) -> Sizes:
    return tuple(1e-3 * length for length in sitk.ReadImage(str(path)).GetSpacing())


def _read_ome(path: Path) -> Sizes:
    with tifffile.TiffFile(path) as file:
        [pixels] = ElementTree.fromstring(file.ome_metadata).iterfind(".//{*}Pixels")
        tags, centimetre = file.pages[0].tags, 1e-2
        across = [tags[name].value for name in ("XResolution", "YResolution")]
        states_size = tags["ResolutionUnit"].value == 3
    sizes = tuple(
        METRES[pixels.get(f"PhysicalSize{axis}Unit")] * float(pixels.get(f"PhysicalSize{axis}")) for axis in "XYZ"
    )
    assert states_size == (sizes[0] > 1e-11)  # of less a rational of 32 bits cannot count the pixels of a centimetre
    if states_size:
        for (above, below), size in zip(across, sizes, strict=False):
            assert centimetre * below / above == pytest.approx(size, rel=1e-3)
    return sizes


def _read_zarr(path: Path) -> Sizes:
    attributes = dict(zarr.open_group(str(path), mode="r").attrs)
    about = attributes.get("ome", attributes)["multiscales"][0]
    metre = {name: METRES[symbol] for symbol, name in NAMES.items()}
    scale = about["datasets"][0]["coordinateTransformations"][0]["scale"]
    return tuple(metre[axis["unit"]] * length for axis, length in zip(about["axes"], scale, strict=True))[::-1]


def _read_nrrd(path: Path) -> Sizes:
    header = nrrd.read_header(str(path))
    assert "space units" not in header
    sizes = tuple(1e-3 * np.linalg.norm(header["space directions"], axis=1))
    assert sizes == pytest.approx(_read_itk(path))
    return sizes


def _read_vti(path: Path) -> Sizes:
    return tuple(1e-3 * length for length in pyvista.read(path).spacing)


def _read_json(path: Path) -> Sizes:
    about = json.loads(path.with_name(path.name + ".json").read_text(encoding="utf-8"))
    return tuple(METRES[about["unit"]] * length for length in about["spacing"])


READERS: dict[str, Callable[[Path], Sizes]] = {
    ".nii.gz": lambda path: _read_nibabel(nibabel.load(path)),
    ".nii": _read_itk,
    ".nrrd": _read_nrrd,
    ".nhdr": _read_itk,
    ".mha": _read_itk,
    ".mhd": _read_itk,
    ".vti": _read_vti,
    ".npy": _read_json,
    ".raw": _read_json,
    ".zarr": _read_zarr,
    ".ome.tif": _read_ome,
}


def _written(suffix: str) -> Callable[[Path, Path], Sizes]:
    def out(source: Path, folder: Path) -> Sizes:
        target = folder / f"out{suffix}"
        dn.write_volume(dn.read_volume(source), target)
        return READERS[suffix](target)

    return out


def _napari(source: Path, _folder: Path) -> Sizes:
    [(_, attributes, _)] = dn.interop.to_napari(dn.read_volume(source))
    return tuple(
        METRES[unit] * np.linalg.norm(row)
        for unit, row in zip(attributes["units"], np.diag(attributes["scale"]), strict=True)
    )[::-1]


def _xarray(source: Path, _folder: Path) -> Sizes:
    array = dn.volume.to_xarray(dn.read_volume(source))
    metre = {name: METRES[symbol] for symbol, name in NAMES.items()}
    return tuple(metre[array.coords[dim].attrs["units"]] * float(np.diff(array.coords[dim])[0]) for dim in "xyz")


def _chunked(source: Path, folder: Path) -> Sizes:
    dn.chunked.warp(source, Identity(3), folder / "out.zarr")
    return _read_zarr(folder / "out.zarr")


def _command(suffix: str) -> Callable[[Path, Path], Sizes]:
    def out(source: Path, folder: Path) -> Sizes:
        document = dn.Deformation.from_space_points(
            dn.ControlPoints.from_arrays([[1, 1, 1]], [[1, 1, 1.5]]), support=2.0
        )
        dn.write_deformation(document, folder / "d.json")
        assert main(["warp", str(folder / "d.json"), str(source), str(folder / f"out{suffix}")]) == 0
        return READERS[suffix](folder / f"out{suffix}")

    return out


def _session(source: Path, folder: Path) -> Sizes:
    export(Session(dn.read_volume(source)), folder / "out.nii.gz")
    return _read_nibabel(nibabel.load(folder / "out.nii.gz"))


def _read_repr(source: Path, _folder: Path) -> Sizes:
    """The repr, as people read it."""
    *lengths, unit = re.search(
        r"spacing ([\d.e+-]+) x ([\d.e+-]+) x ([\d.e+-]+) (\S+)>", repr(dn.read_volume(source))
    ).groups()  # type: ignore[union-attr]
    return tuple(METRES[unit] * float(length) for length in lengths)


WAYS: dict[str, Callable[[Path, Path], Sizes]] = {
    **{suffix: _written(suffix) for suffix in READERS},
    "to_nibabel": lambda source, _: _read_nibabel(dn.read_volume(source).to_nibabel()),
    "to_sitk": lambda source, _: tuple(1e-3 * s for s in dn.read_volume(source).to_sitk().GetSpacing()),
    "to_pyvista": lambda source, _: tuple(1e-3 * s for s in dn.read_volume(source).to_pyvista().spacing),
    "to_napari": _napari,
    "to_xarray": _xarray,
    "chunked": _chunked,
    "command nifti": _command(".nii.gz"),
    "command tiff": _command(".ome.tif"),
    "command zarr": _command(".zarr"),
    "session": _session,
    "repr": _read_repr,
}


@pytest.mark.filterwarnings("ignore:.*resolution:UserWarning")
@pytest.mark.parametrize("way", list(WAYS))
@pytest.mark.parametrize(
    ("name", "unit"),
    [pytest.param(name, unit, id=f"{name} {NAMES[unit]}") for name, (_, some) in SOURCES.items() for unit in some],
)
@pytest.mark.sampled(19)
def test_metres_stay_the_same_from_every_format_by_every_way_out(
    name: str, unit: str, way: str, tmp_path: Path
) -> None:
    (tmp_path / "in").mkdir()
    found = WAYS[way](SOURCES[name][0](tmp_path / "in", unit), tmp_path)
    # NIfTI stores seven digits of float32, and repr six.
    assert found == pytest.approx([METRES[unit] * length for length in SPACING], rel=1e-5)


def test_every_format_that_is_written_and_every_unit_of_the_table_is_measured() -> None:
    assert {suffix for entry in FORMATS.values() if entry.write for suffix in entry.suffixes} - set(READERS) == {
        ".ome.tiff",
        ".tif",
        ".tiff",
        ".png",
        ".jpg",
        ".jpeg",
        ".webp",
    }  # the same, and pictures, which have no lengths
    for symbol, metres in METRES.items():
        assert float(units.UNITS[symbol].metres) == pytest.approx(metres, rel=1e-15)
        assert find_unit(NAMES[symbol]) == find_unit(symbol) == symbol
    assert {unit.name for unit in units.UNITS.values()} >= {  # https://ngff.openmicroscopy.org/0.5, units of length
        "angstrom",
        "attometer",
        "centimeter",
        "decimeter",
        "exameter",
        "femtometer",
        "foot",
        "gigameter",
        "hectometer",
        "inch",
        "kilometer",
        "megameter",
        "meter",
        "micrometer",
        "mile",
        "millimeter",
        "nanometer",
        "parsec",
        "petameter",
        "picometer",
        "terameter",
        "yard",
        "yoctometer",
        "yottameter",
        "zeptometer",
        "zettameter",
    }


# ---- units of one axis, and none -------------------------------------------------------------------------------------


def test_axes_in_other_units_are_brought_to_that_of_x(tmp_path: Path) -> None:
    tifffile.imwrite(
        tmp_path / "a.tif",
        VALUES,
        imagej=True,
        resolution=(2, 2),
        metadata={"axes": "ZYX", "spacing": 0.002, "unit": "\\u00B5m", "zunit": "mm"},
    )
    about = {
        "PhysicalSizeX": 0.5,
        "PhysicalSizeXUnit": "\u00b5m",
        "PhysicalSizeY": 0.5,
        "PhysicalSizeYUnit": "\u00b5m",
        "PhysicalSizeZ": 2000.0,
        "PhysicalSizeZUnit": "nm",
    }
    tifffile.imwrite(tmp_path / "a.ome.tif", VALUES, metadata={"axes": "ZYX", **about}, photometric="minisblack")
    path = _zarr(tmp_path, "\u00b5m")
    attributes = json.loads((path / ".zattrs").read_text(encoding="utf-8"))
    attributes["multiscales"][0]["axes"][0]["unit"] = "nanometer"
    attributes["multiscales"][0]["datasets"][0]["coordinateTransformations"] = [
        {"type": "scale", "scale": [2000.0, 0.5, 0.5]},
        {"type": "translation", "translation": [5000.0, 0, 0]},
    ]
    (path / ".zattrs").write_text(json.dumps(attributes), encoding="utf-8")
    nrrd.write(
        str(tmp_path / "a.nrrd"),
        VALUES.transpose(2, 1, 0),
        {
            "space": "left-posterior-superior",
            "space directions": np.diag([0.5, 0.5, 0.002]),
            "space origin": [0, 0, 0],
            "space units": ["um", "um", "mm"],
        },
    )
    layer = (VALUES, {"scale": (2000.0, 0.5, 0.5), "units": ("nm", "um", "um")}, "image")
    array = xarray.DataArray(
        VALUES,
        {
            "z": ("z", np.arange(4) * 0.002, {"units": "mm"}),
            "y": ("y", np.arange(5) * 0.5, {"units": "micrometer"}),
            "x": ("x", np.arange(6) * 0.5, {"units": "um"}),
        },
        ("z", "y", "x"),
    )
    for volume in (
        *map(dn.read_volume, (tmp_path / "a.tif", tmp_path / "a.ome.tif", path, tmp_path / "a.nrrd")),
        dn.interop.from_napari(layer),
        dn.volume.from_xarray(array),
    ):
        np.testing.assert_allclose(volume.grid.spacing, (0.5, 0.5, 2.0), rtol=1e-12)
        assert volume.grid.unit == "\u00b5m"
        assert any("different units" in note for note in volume.notes)
    assert dn.read_volume(path).grid.origin == (0.0, 0.0, 5.0)
    assert dn.chunked.open_volume(path).grid.spacing == (0.5, 0.5, 2.0)


@pytest.mark.parametrize("suffix", [".nii.gz", ".nrrd", ".mha", ".ome.tif", ".zarr", ".npy", ".raw"])
def test_a_unit_that_is_not_known_stays_unknown(suffix: str, tmp_path: Path) -> None:
    volume = dn.Volume.from_array(VALUES, SPACING)
    dn.write_volume(volume, tmp_path / f"a{suffix}")
    again = dn.read_volume(tmp_path / f"a{suffix}")
    assert (again.grid.unit, again.grid.spacing) == ("", SPACING)
    if suffix in (".nrrd", ".mha", ".nii.gz"):
        assert sitk.ReadImage(str(tmp_path / f"a{suffix}")).GetSpacing() == SPACING


def test_a_unit_that_is_none_is_said_and_its_numbers_stay(tmp_path: Path) -> None:
    tifffile.imwrite(
        tmp_path / "a.tif",
        VALUES,
        imagej=True,
        resolution=(2, 2),
        metadata={"axes": "ZYX", "spacing": 2.0, "unit": "furlong"},
    )
    volume = dn.read_volume(tmp_path / "a.tif")
    assert (volume.grid.spacing, volume.grid.unit) == ((0.5, 0.5, 2.0), "")
    assert any("furlong" in note for note in volume.notes)
    assert dn.read_volume(tmp_path / "a.tif", unit="yd").grid.unit == "yd"
    with pytest.raises(DeformError, match="no unit of length"):
        dn.read_volume(tmp_path / "a.tif", unit="furlong")


@pytest.mark.parametrize(
    "word", ["um", "\u00b5m", "\u03bcm", "\\u00B5m", "micron", "Microns", '"um"', "micrometre", "\ufffdm", "UM"]
)
def test_every_way_to_write_a_micrometre(word: str) -> None:
    assert find_unit(word) == "\u00b5m"


def test_capitals_of_short_symbols_count() -> None:
    assert [
        find_unit(word) for word in ("Mm", "mm", "pm", "Pm", "PM", "cM", "M", "ells", "pixel", "reference frame")
    ] == ["Mm", "mm", "pm", "Pm", None, "cm", None, None, "", ""]


# ---- two things meet by length ---------------------------------------------------------------------------------------

GRID = dn.volume.Grid((12, 14, 16), (1.0, 1.0, 1.5), (3.0, -2.0, 1.0), unit="mm")
BALL = dn.Volume((200 * np.exp(-((np.indices(GRID.shape) - 6.0) ** 2).sum(axis=0) / 20)).astype(np.uint8), GRID)
PAIRS = dn.warping.Landmarks([[9, 4, 9], [12, 6, 12]], ("a", "b"), [[11, 5, 9], [12, 6, 12]], unit="mm")
DOCUMENT = dn.Deformation.from_space_points(PAIRS.control_points(), support=9.0)


@pytest.mark.parametrize("unit", ["\u00b5m", "cm", "nm"])
def test_a_document_meets_a_volume_by_length(unit: str, tmp_path: Path) -> None:
    known = DOCUMENT.apply(BALL)
    assert (known.values != BALL.values).any()
    other = BALL.to_unit(unit)
    dn.write_deformation(DOCUMENT, tmp_path / "d.json")
    read = dn.read_deformation(tmp_path / "d.json")
    assert (read, read.unit) == (DOCUMENT, "mm")
    session = Session(other, read)
    for result in (
        read.apply(other),
        dn.warp(other, DOCUMENT),
        dn.warp(other, dn.fit_rbf(PAIRS.control_points(), support=9.0)),
        dn.chunked.warp(other, DOCUMENT, dn.Volume),
        session.results.volume(),
        read.to_unit(unit).apply(BALL),
    ):
        # A value at a half may be rounded either way.
        assert np.abs(result.values.astype(int) - known.values).max() <= 1
    assert any("converted" in note for note in read.apply(other).notes)
    on_picture = dn.Deformation.from_picture_points(
        other, "+z", dn.ControlPoints.from_arrays([[3, 4]], [[5, 4]], unit="mm")
    )
    assert on_picture.to_unit("mm").steps[0].points.target == pytest.approx(np.array([[5.0, 4.0]]))


def test_a_document_without_a_unit_takes_numbers_as_they_are(tmp_path: Path) -> None:
    plain = dn.Deformation.from_space_points(dn.ControlPoints.from_arrays(PAIRS.points, PAIRS.fixed), support=9.0)
    known = plain.apply(BALL)
    there = dn.Volume(BALL.values, dn.volume.Grid(GRID.shape, GRID.spacing, GRID.origin, unit="\u00b5m"))
    assert np.array_equal(plain.apply(there).values, known.values)
    unknown = dn.Volume(BALL.values, dn.volume.Grid(GRID.shape, GRID.spacing, GRID.origin))
    result = DOCUMENT.apply(unknown)
    assert np.array_equal(result.values, known.values)
    assert any("not known" in note for note in result.notes)


def test_an_earlier_document_states_no_unit() -> None:
    fixtures = Path(__file__).parents[1] / "fixtures"
    documents = [
        dn.read_deformation(path)
        for path in fixtures.glob("*.json")
        if "deformnb-deformation" in path.read_text("utf-8")
    ]
    assert documents
    assert {document.unit for document in documents} == {""}


@pytest.mark.parametrize("unit", ["\u00b5m", "m"])
def test_landmarks_and_meshes_meet_a_volume_by_length(unit: str) -> None:
    grid, there = GRID.to_unit(unit), PAIRS.to_unit(unit)
    moved = dn.warp_landmarks(PAIRS, DOCUMENT, grid=grid)
    assert np.abs(moved.points - PAIRS.fixed).max() < 1e-4  # of a grid in mm
    assert (moved.unit, dn.warp_landmarks(there, DOCUMENT, grid=GRID).unit) == ("mm", unit)
    mesh = dn.warping.isosurface(BALL, 100)
    known = dn.warp_mesh(mesh, DOCUMENT, grid=GRID)
    again = dn.warp_mesh(mesh, DOCUMENT, grid=grid)
    assert (again.unit, mesh.unit) == ("mm", "mm")
    np.testing.assert_allclose(again.points, known.points, atol=1e-4)
    points, _, _ = dn.ControlPoints.from_landmarks(PAIRS, there, pair="order")
    np.testing.assert_allclose(points.displacement, 0, atol=1e-12)
    session = Session(dn.Volume(BALL.values, grid), dn.Deformation((dn.Step((dn.ControlPoints.empty(3),)),)))
    session.add_landmarks(PAIRS)
    np.testing.assert_allclose(session.editing.points.source, there.points)
    np.testing.assert_allclose(session.landmarks().to_unit("mm").fixed, PAIRS.fixed, rtol=1e-12)


@pytest.mark.parametrize("name", ["t.h5", "t.tfm", "t.nrrd", "t.nii.gz", "t.mha", "t.vti", "t.zarr"])
def test_transform_files_of_a_grid_in_micrometres_hold_millimetres(name: str, tmp_path: Path) -> None:
    """As the file of the same grid in millimetres, but for NGFF, which states the unit."""
    own = GRID.to_unit("\u00b5m")
    dn.write_transform(DOCUMENT, tmp_path / name, own)
    (tmp_path / "mm").mkdir()
    dn.write_transform(DOCUMENT, tmp_path / "mm" / name, GRID)
    place = [[9.0, 5.0, 9.0], [11.0, 6.0, 10.0]]
    known = dn.read_transform(tmp_path / "mm" / name).displacement(place)
    assert np.abs(known).max() > 0.5
    factor = 1e3 if name.endswith(".zarr") else 1.0
    found = dn.read_transform(tmp_path / name)
    assert (found.unit, dn.read_transform(tmp_path / name, own).unit) == (
        "\u00b5m" if name.endswith(".zarr") else "mm",
        "\u00b5m",
    )
    np.testing.assert_allclose(found.displacement(np.array(place) * factor) / factor, known, atol=1e-5)
    at_grid = dn.read_transform(tmp_path / name, own).displacement(np.array(place) * 1e3)
    np.testing.assert_allclose(at_grid / 1e3, known, atol=1e-5)
    if name.endswith((".h5", ".tfm")):  # ITK maps a place that is in millimetres
        transform = sitk.ReadTransform(str(tmp_path / name))
        moved = np.array([transform.TransformPoint(point) for point in place])
        np.testing.assert_allclose(moved - place, known, atol=1e-5)
    moved = np.array([dn.interop.to_sitk_transform(DOCUMENT, own).TransformPoint(point) for point in place])
    np.testing.assert_allclose(moved - place, known, atol=1e-5)
    vtk = dn.io.to_vtk_transform(DOCUMENT, own)
    np.testing.assert_allclose([vtk.TransformPoint(point) for point in place], known + place, atol=1e-4)
    volume = dn.Volume(BALL.values, own)
    known_voxels = DOCUMENT.apply(BALL).values.astype(int)
    assert np.abs(dn.warp(volume, found).values - known_voxels).max() <= 2  # linear between the nodes, in float32


@pytest.mark.parametrize("name", list(LANDMARK_FORMATS))
def test_landmark_files_come_back_with_their_lengths(name: str, tmp_path: Path) -> None:
    row = LANDMARK_FORMATS[name]
    marks = dn.warping.Landmarks([[1, 2, 3], [4, 5, 7.5]], unit="\u00b5m")
    dn.io.write_landmarks(marks, tmp_path / f"a{row.suffix}")
    again = dn.io.read_landmarks(tmp_path / f"a{row.suffix}")
    assert again.unit == row.unit  # that of the program, or none: then the numbers are those of the volume
    np.testing.assert_allclose(again.points, marks.points * (1e-3 if row.unit else 1.0))


def test_a_table_of_landmarks_states_the_unit_of_each_column(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("name,x (um),y (um),z [mm]\ntip,1,2,0.003\n", encoding="utf-8")
    marks = dn.io.read_landmarks(tmp_path / "a.csv")
    assert (marks.unit, marks.points.round(9).tolist()) == ("\u00b5m", [[1.0, 2.0, 3.0]])
    assert any("different units" in note for note in marks.notes)


def test_a_mesh_file_is_in_millimetres(tmp_path: Path) -> None:
    mesh = dn.warping.isosurface(BALL.to_unit("\u00b5m"), 100)
    assert mesh.unit == "\u00b5m"
    for suffix in (".ply", ".stl", ".obj", ".vtp"):
        dn.write_mesh(mesh, tmp_path / f"a{suffix}")
        low, high = np.reshape(pyvista.read(tmp_path / f"a{suffix}").bounds, (3, 2)).T
        np.testing.assert_allclose([low, high], mesh.box * 1e-3, rtol=1e-6)
        assert dn.read_mesh(tmp_path / f"a{suffix}").unit == "mm"


def test_grids_that_lie_alike_are_alike_in_any_unit() -> None:
    assert GRID.is_like(GRID.to_unit("nm"))
    assert GRID.to_unit("nm") != GRID
    assert not GRID.is_like(dn.volume.Grid(GRID.shape, GRID.spacing, GRID.origin, unit="\u00b5m"))
    assert GRID.to_unit("\u00b5m").to_unit("mm") == GRID


def test_a_nifti_code_that_is_none_is_said(tmp_path: Path) -> None:
    dn.write_volume(BALL, tmp_path / "a.nii")
    data = bytearray((tmp_path / "a.nii").read_bytes())
    struct.pack_into("B", data, 123, 5)
    (tmp_path / "a.nii").write_bytes(bytes(data))
    volume = dn.read_volume(tmp_path / "a.nii")
    assert volume.grid.unit == ""
    assert "none of NIfTI" in volume.notes[0]
