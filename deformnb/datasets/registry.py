"""Real volumes: their sources, their licences, and a download that is checked and cached.

Nothing here ships with the package and nothing is downloaded at import. A file that is already there is used without
a network: in ``folder``, else in the folder that the environment variable ``DEFORMNB_DATA`` names, else in the user's
cache.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeAlias
from urllib.parse import urlsplit

from deformnb._deferred import scipy
from deformnb._typing import Float3, Progress
from deformnb.errors import DeformError, VolumeFileError
from deformnb.io.files.address_copies import explain
from deformnb.io.files.addresses import Meter, download
from deformnb.io.files.folders import data_home
from deformnb.io.files.paths import as_path
from deformnb.volume.volume import Volume


@dataclass(frozen=True)
class Dataset:
    """A row of :data:`DATASETS`.

    Parameters
    ----------
    title : short description.
    file : its name in the folder; the address may end otherwise.
    address : where it is downloaded from; None if the user has to put it into the folder, see ``source``.
    sha256, size : checksum and bytes of exactly that file, or of the download where ``variable`` is given; None where
        several versions are in circulation.
    credit : whom to name.
    licence : known terms.
    source : origin, in words.
    phantom : the phantom used offline, a name in PHANTOMS.
    spacing : (x, y, z) of the voxels, where files may come without one; None is what :func:`read_volume` finds.
    is_labels : voxels are numbers of structures.
    remark : further information for users.
    variable : name of the array [x, y, z] in the MATLAB file that is downloaded; ``file`` is written from it.
    is_mesh : the file is a mesh, for :func:`deformnb.read_mesh`.

    Examples
    --------
    >>> DATASETS["carp"].phantom
    'fish'
    """

    title: str
    file: str
    address: str | None
    sha256: str | None
    size: int | None
    credit: str
    licence: str
    source: str
    phantom: str
    spacing: Float3 | None = None
    is_labels: bool = False
    remark: str = ""
    variable: str = ""
    is_mesh: bool = False


_MRICROGL = "https://raw.githubusercontent.com/neurolabusc/MRIcroGL/e1392fd1a260f3dfd4dc8906376b3370f5ed352e/Distro/"
_TOTALSEGMENTATOR = (
    "https://raw.githubusercontent.com/wasserth/TotalSegmentator/"
    "0e65a448d557382b1e925276212b3bec7f5aff83/tests/reference_files/"
)
_FAIR = "https://raw.githubusercontent.com/C4IR/FAIR.m/975edebd37b833ae76696792870de5c05efcb9cb/kernel/data/"
_HORSE = "https://raw.githubusercontent.com/pyvista/vtk-data/126ee906165a8b2f984f08259a4a2d32cf3b3409/Data/horse.ply"
_KNEE_ATLAS = "https://raw.githubusercontent.com/mhalle/spl-knee-atlas/b8cb94143b88775671737e5bcad7783120ea5066/Data/"


def _knee_mr(pose: str, variable: str) -> Dataset:
    """One of the two scans of a knee in the MATLAB file of the FAIR toolbox."""
    return Dataset(
        f"MR of a knee, {pose}, 128 x 64 x 128; the same knee was scanned straight and bent",
        f"knee_mr_{pose}.nrrd",
        _FAIR + "knee3D.mat",
        "6a7833dcefbbeb962ebc1ec7da57e2d549b9d156eb9ff3cb1c6b2da6cce55ba9",
        1050710,
        "Thomas Netsch, Philips Medical Solutions, Hamburg",
        "see the licence of the FAIR toolbox",
        "the FAIR toolbox of Jan Modersitzki",
        "knee",
        spacing=(1.0, 0.96875, 1.0),
        variable=variable,
        remark="Both scans are in one MATLAB file, which is downloaded once.",
    )


DatasetName: TypeAlias = Literal[
    "carp",
    "head_ct",
    "abdomen_ct",
    "lobster",
    "knee_labels",
    "knee_mr_straight",
    "knee_mr_bent",
    "horse",
    "abdomen_labels",
]
"""Names of the real volumes."""

DATASETS: dict[str, Dataset] = {
    "carp": Dataset(
        "CT of a carp, the paper's own (figure 3), 256 x 512 x 256",
        "carp.nii.gz",
        _MRICROGL + "carp.nii.gz",
        "65c94568fcb941d888e37c8465e7fc0a7b9338b056bf3ca47209890dbac26f7a",
        3036369,
        "Michael Scheuring, Computer Graphics Group, University of Erlangen",
        "no licence is stated",
        "copy in the repository of MRIcroGL",
        "fish",
        remark="The header says 1, 1, 1; the reader takes the spacing of the animal's anatomy instead, with a note.",
    ),
    "head_ct": Dataset(
        "CT of a human head, 208 x 256 x 225, scaled to 0..1",
        "head_ct.nii.gz",
        _MRICROGL + "ct.nii.gz",
        "78dfd74fa1336a0160a74969dc3ac5148fdbdc47a5694bfb44e5d324a22e1fc4",
        2784530,
        "MRIcroGL, Chris Rorden",
        "the repository is under the BSD 2-clause licence",
        "repository of MRIcroGL",
        "head",
    ),
    "abdomen_ct": Dataset(
        "CT of abdomen and pelvis in Hounsfield units, 122 x 101 x 112 voxels of 3 mm",
        "abdomen_ct.nii.gz",
        _TOTALSEGMENTATOR + "example_ct.nii.gz",
        "dbd3ae6d614d1d7ef3a46925c30c70038ed52da6b37fdd6afdc7b9b71387e3e1",
        2206612,
        "TotalSegmentator, Jakob Wasserthal, University Hospital Basel",
        "the repository is under the Apache 2.0 licence",
        "test data in the repository of TotalSegmentator",
        "abdomen",
    ),
    "lobster": Dataset(
        "CT of a lobster, the paper's own (figure 5), 301 x 324 x 56",
        "lobster.nrrd",
        None,
        None,
        None,
        "VolVis distribution of SUNY Stony Brook, New York",
        "no licence is stated",
        "the Open SciVis Datasets, manually: save lobster_301x324x56_uint8.raw, bytes without a header; then "
        "np.fromfile('lobster_301x324x56_uint8.raw', 'uint8').reshape(56, 324, 301) is the array for "
        "Volume.from_array, with the spacing (1, 1, 1.4), and write_volume saves it as NRRD",
        "lobster",
        spacing=(1.0, 1.0, 1.4),
    ),
    "knee_labels": Dataset(
        "Labels of the SPL knee atlas, 512 x 512 x 119: femur 95, tibia 96, fibula 97, patella 98",
        "knee_labels.nrrd",
        _KNEE_ATLAS + "seg.nrrd",
        "7b1eba4d06a24d8d769fe0342bf57042d6a6d3afb67da04f2749f62007670091",
        466251,
        "Surgical Planning Laboratory, Brigham and Women's Hospital, Boston",
        "3D Slicer licence",
        "the SPL knee atlas",
        "knee",
        is_labels=True,
    ),
    "knee_mr_straight": _knee_mr("straight", "dataR"),
    "knee_mr_bent": _knee_mr("bent", "dataT"),
    "horse": Dataset(
        "Surface of a horse, the paper's own (figure 6), 48,485 vertices",
        "horse.ply",
        _HORSE,
        "dfadaea01775943a75f9bf0560e6ad55aab39694af3003d9976a46e58226c4d7",
        2182101,
        "Georgia Institute of Technology, Large Geometric Models Archive",
        "the copy's repository states no licence",
        "example data of PyVista",
        "horse",
        is_mesh=True,
    ),
    "abdomen_labels": Dataset(
        "Labels of the SPL abdominal atlas, 256 x 256 x 113: liver 3, spleen 4, aorta 7, kidneys 51 and 52",
        "abdomen_labels.nrrd",
        None,
        "f6ccae59157948bd790c0783ca672ba1bfb719239bb5ac1a9f023f63357ea02f",
        232498,
        "Surgical Planning Laboratory, Brigham and Women's Hospital, Boston",
        "3D Slicer licence",
        "the SPL abdominal atlas, manually: save the labels (a 256 x 256 x 113 NRRD of the atlas's data)",
        "abdomen",
        is_labels=True,
    ),
}
"""Real volumes by name. Only those whose exact file has a permanent address and a checksum can be downloaded."""


def data_folder(folder: str | os.PathLike[str] | None = None) -> Path:
    """Folder of the real volumes: ``folder``, else DEFORMNB_DATA, else the user's cache."""
    return as_path(folder) if folder else data_home()


def fetch(
    name: DatasetName, *, progress: bool | Progress | None = None, folder: str | os.PathLike[str] | None = None
) -> Path:
    """The path of a real volume, downloaded the first time.

    Parameters
    ----------
    name : a key of :data:`DATASETS`.
    progress : True for a bar, False for none, a function called with 0..1 (it may raise
        :class:`~deformnb.errors.Cancelled`); default is a bar where the error stream is a terminal.
    folder : where it is searched for and stored; default see :func:`data_folder`.

    Raises
    ------
    DeformError
        If there is no such name, if a file of that name is there but is another one (it is never overwritten), if
        there is no network, room or permission, or if what came is not the published file. No partial file is left.

    Examples
    --------
    >>> fetch("carpp")
    Traceback (most recent call last):
    ...
    deformnb.errors.DeformError: there is no dataset 'carpp'; there are carp, head_ct, abdomen_ct, lobster, ...
    """
    data = _row(name)
    place = data_folder(folder)
    path = place / data.file
    if path.is_file():
        if not data.variable:  # a file that was converted here has no published checksum
            _check_present(path, data)
        return path
    if data.address is None:
        raise DeformError(
            f"{name} has no download: get it from {data.source}, put it at {path}, or use {_alternative(data)}."
        )
    download = place / data.address.rsplit("/", 1)[-1] if data.variable else path
    if download.is_file():
        _check_present(download, data)
    else:
        _make_room(place, data)
        try:
            _download(data, download, progress)
        except OSError as error:  # requests' errors are OSErrors, as are a full disk and a refused permission
            raise VolumeFileError(_offline_message(name, data, download, error)) from error
    if data.variable:
        _convert(data, download, path)
    return path


def _convert(data: Dataset, source: Path, path: Path) -> None:
    """Write one array of a MATLAB file as a volume, atomically."""
    from deformnb.io import write_volume

    values = scipy.io.loadmat(source, variable_names=[data.variable])[data.variable]
    write_volume(
        Volume.from_array(
            values.transpose(2, 1, 0), spacing=data.spacing or (1.0, 1.0, 1.0), unit="mm" if data.spacing else ""
        ),
        path,
    )


def load(
    name: DatasetName, *, progress: bool | Progress | None = None, folder: str | os.PathLike[str] | None = None
) -> Volume:
    """A real volume with its true spacing, downloaded the first time; parameters and errors as :func:`fetch`.

    Examples
    --------
    >>> load("horse")
    Traceback (most recent call last):
    ...
    deformnb.errors.DeformError: horse is a mesh and no volume; use ...
    """
    from deformnb.io import read_volume

    data = _row(name)
    if data.is_mesh:
        raise DeformError(f"{name} is a mesh and no volume; use deformnb.read_mesh(deformnb.datasets.fetch({name!r})).")
    path = fetch(name, progress=progress, folder=folder)
    volume: Volume = read_volume(path, spacing=data.spacing, is_labels=data.is_labels)
    return replace(volume, name=name)


def find(
    name: DatasetName, shape: tuple[int, int, int] | None = None, *, folder: str | os.PathLike[str] | None = None
) -> tuple[Volume, bool]:
    """A real volume if it is available, else its phantom; prints which.

    The file in the folder is taken, else it is downloaded (with a bar in a terminal and in a notebook). Without a
    network, and for a row without an address, it is the phantom.

    Parameters
    ----------
    name : a key of :data:`DATASETS`.
    shape : of the phantom, voxels along z, y, x; default is its own.
    folder : where it is searched for and stored; default see :func:`data_folder`.

    Returns
    -------
    Volume
    bool
        True for the real volume.

    Raises
    ------
    DeformError
        If there is no such name, or it is a mesh.

    Examples
    --------
    >>> volume, real = find("lobster", (12, 33, 31), folder="nowhere")
    no real lobster: it has to be put into the folder manually (deformnb datasets); the phantom is used
    >>> real
    False
    """
    from deformnb.datasets.phantoms import PHANTOMS

    data = _row(name)
    try:
        volume = load(name, progress=True if "ipykernel" in sys.modules else None, folder=folder)
    except VolumeFileError as error:
        print(f"no real {name}: {str(error).split(';')[0]}; the phantom is used")  # noqa: T201 (what it is for)
    except DeformError:
        if data.is_mesh or data.address is not None:
            raise
        cure = "it has to be put into the folder manually (deformnb datasets)"
        print(f"no real {name}: {cure}; the phantom is used")  # noqa: T201
    else:
        print(f"the real {name}: {data.title}. Credit: {data.credit}")  # noqa: T201
        return volume, True
    phantom = PHANTOMS[data.phantom]
    make = phantom.labels if data.is_labels else phantom.make
    return (make() if shape is None else make(shape)), False


def credits() -> str:  # noqa: A001 (the word users look for; the module never needs the builtin of the same name)
    """Acknowledgements of the volumes, one paragraph each.

    Examples
    --------
    >>> print(credits().splitlines()[0])
    carp: CT of a carp, the paper's own (figure 3), 256 x 512 x 256.
    """
    return "\n\n".join(
        f"{name}: {d.title}.\n  Credit: {d.credit}.\n  Terms: {d.licence}.\n  Source: {d.address or d.source}."
        + (f"\n  {d.remark}" if d.remark else "")
        for name, d in DATASETS.items()
    )


def _row(name: str) -> Dataset:
    try:
        return DATASETS[name]
    except KeyError:
        raise DeformError(f"there is no dataset {name!r}; there are {', '.join(DATASETS)}.") from None


def _alternative(data: Dataset) -> str:
    make = "labels" if data.is_labels else "make"
    return f'the phantom deformnb.datasets.PHANTOMS["{data.phantom}"].{make}() instead'


def _check_present(path: Path, data: Dataset) -> None:
    if data.sha256 is None:
        return
    try:
        with path.open("rb") as file:
            found = hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise VolumeFileError(f"{path} cannot be read ({error.strerror or error}); check its permissions.") from error
    if found != data.sha256:
        raise VolumeFileError(
            f"{path} is not the published file: its sha256 begins with {found[:12]}, not with "
            f"{data.sha256[:12]}. Move it away, and it is fetched again."
        )


def _make_room(place: Path, data: Dataset) -> None:
    try:
        place.mkdir(parents=True, exist_ok=True)
        free = shutil.disk_usage(place).free
    except OSError as error:
        raise VolumeFileError(
            f"the folder {place} for downloads cannot be made ({error.strerror or error}); name "
            "another one in the environment variable DEFORMNB_DATA."
        ) from error
    if data.size is not None and free < 2 * data.size:
        raise VolumeFileError(
            f"{data.file} takes {data.size:,} bytes and {place} has only {free:,} left; make room "
            "or name another folder in the environment variable DEFORMNB_DATA."
        )


def _download(data: Dataset, path: Path, progress: bool | Progress | None) -> None:
    size = data.size or 0
    meter = Meter(data.file, size, "the server sends more than the published", progress, size)
    download(data.address or "", path, meter, f"sha256:{data.sha256}")


def _offline_message(name: str, data: Dataset, path: Path, error: OSError) -> str:
    host = urlsplit(data.address or "").hostname
    return (
        f"{name} could not be downloaded from {host} ({explain(error)}); save {data.address} as {path} yourself, "
        f"or use {_alternative(data)}."
    )
