"""No reader of another package opens a user's file but those that are listed here, with the checks that precede them.

A reader in C++ that crashes or hangs on a damaged file ends the kernel, and all work in it. SimpleITK, ITK, VTK and
pyvista get numbers, never names of files.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import deformnb

ROOT = Path(deformnb.__file__).parent

# Packages that can read files in a format, by the name that is imported.
PACKAGES = (
    "SimpleITK",
    "itk",
    "vtk",
    "vtkmodules",
    "pyvista",
    "nibabel",
    "h5py",
    "tifffile",
    "imagecodecs",
    "pydicom",
    "zarr",
    "PIL",
    "scipy.io",
    "imageio",
    "imageio_ffmpeg",
    "skimage.io",
    "nrrd",
    "ants",
    "meshio",
    "trimesh",
    "vedo",
    "ngff_zarr",
    "dask.array",
    "xarray",
    "pandas",
    "matplotlib.image",
    "cv2",
)
READS = re.compile(r"read|load|open|Reader|^File$|^TiffFile$|_decode$|^from_zarr$", re.IGNORECASE)

ALLOWED = {
    ("h5py", "File"): "sizes, types, filters and links are checked before a number is decoded",
    ("tifffile", "TiffFile"): "its pages are checked by io/volumes/tiff_pages.py",
    ("tifffile", "imread"): "as a Zarr store, of files whose header our own reader has checked",
    ("imagecodecs", "*"): "of one strip or tile, whose size is known and allowed",
    ("pydicom", "*"): "Python throughout; pixel data are counted before they are decoded",
    ("zarr", "open"): "metadata of bounded length",
    ("zarr", "open_array"): "likewise",
    ("zarr", "open_group"): "likewise",
    ("scipy.io", "loadmat"): "Python; of a file of datasets/registry.py, whose checksum is known",
    ("PIL", "load_default"): "no file of a user's: a font",
    ("PIL", "open"): "three formats, and no more pixels than any picture has",
}


def package_of(name: str) -> str | None:
    return next((p for p in PACKAGES if name == p or name.startswith(f"{p}.")), None)


def bound_names(tree: ast.AST) -> Iterator[tuple[str, str]]:
    """Names in a module, and the packages that they denote."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                if found := package_of(alias.name):
                    yield alias.asname or alias.name.partition(".")[0], found
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                if found := package_of(node.module) or package_of(f"{node.module}.{alias.name}"):
                    yield alias.asname or alias.name, found
        elif isinstance(node, ast.Assign):
            target = node.targets[0]
            pairs = (
                zip(target.elts, node.value.elts, strict=False)
                if (isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple))
                else [(target, node.value)]
            )
            yield from (
                (one.id, found)
                for one, value in pairs
                if isinstance(one, ast.Name) and (found := called_package(value))
            )


def called_package(value: ast.AST) -> str | None:
    """The package that optional_package("h5py"), import_module("h5py") or zarr_package() returns."""
    if not isinstance(value, ast.Call):
        return None
    if getattr(value.func, "id", getattr(value.func, "attr", "")) == "zarr_package":
        return "zarr"
    first = value.args[0] if value.args else None
    return package_of(str(first.value)) if isinstance(first, ast.Constant) else None


def readers_of(source: str) -> set[tuple[str, str]]:
    """The readers of other packages that a module uses, as package and name."""
    tree = ast.parse(source)
    bound, found = dict(bound_names(tree)), set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and READS.search(node.attr):
            base: ast.AST = node.value
            while isinstance(base, ast.Attribute):
                base = base.value
            if isinstance(base, ast.Name) and base.id in bound:
                found.add((bound[base.id], node.attr))
        elif isinstance(node, ast.ImportFrom) and node.module and (package := package_of(node.module)):
            found |= {(package, alias.name) for alias in node.names if READS.search(alias.name)}
        text = node.attr if isinstance(node, ast.Attribute) else node.value if isinstance(node, ast.Constant) else ""
        if isinstance(text, str) and re.fullmatch(
            r"vtk\w*Reader|ReadImage|ReadTransform|ImageFileReader|"
            r"ImageSeriesReader|transformread|meshread",
            text,
        ):
            found.add(("VTK or ITK", text))
    return found


def is_allowed(reader: tuple[str, str]) -> bool:
    return reader in ALLOWED or (reader[0], "*") in ALLOWED


def test_no_other_reader_is_used() -> None:
    named = re.compile("|".join([*(package.partition(".")[0] for package in PACKAGES), "Reader", "Read", "meshread"]))
    used = {
        (path.relative_to(ROOT).as_posix(), *reader)
        for path in sorted(ROOT.rglob("*.py"))
        if named.search(text := path.read_text(encoding="utf-8"))
        for reader in readers_of(text)
    }
    assert not [one for one in used if not is_allowed(one[1:])]
    assert len({one[1:] for one in used}) > 4  # and the test sees those that there are


@pytest.mark.parametrize(
    "line",
    [
        "import SimpleITK as sitk\nsitk.ReadImage(p)",
        'sitk = optional_package("SimpleITK")\nsitk.ReadTransform(p)',
        "import itk\nitk.imread(p)",
        "import pyvista\npyvista.read(p)",
        "import pyvista as pv\npv.get_reader(p)",
        "from vtkmodules.vtkIOXML import vtkXMLImageDataReader",
        "from skimage.io import imread",
        'getattr(vtk, "vtkNIFTIImageReader")()',
        "import nibabel\nnibabel.load(p)",
        "import skimage.io\nskimage.io.imread(p)",
        'a, sitk = optional_package("pyvista"), optional_package("SimpleITK")\nsitk.ImageFileReader()',
        'a = optional_package("pyvista")\na.core.utilities.fileio.read(p)',
    ],
)
def test_another_reader_would_be_seen(line: str) -> None:
    assert any(not is_allowed(one) for one in readers_of(line))
