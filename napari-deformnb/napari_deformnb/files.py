"""Readers and writers of the formats that deformnb knows and napari does not, with their places in space.

None of them takes a format that napari itself reads or writes (TIFF, PNG, NumPy, CSV, Zarr).
"""

from __future__ import annotations

from collections.abc import Callable
from os import fspath
from pathlib import Path
from typing import Any

from napari.utils.notifications import show_warning

from deformnb import read_landmarks, read_volume, write_landmarks, write_volume
from deformnb.errors import DeformError
from deformnb.interop import from_napari, to_napari
from deformnb.io.volumes.series import open_series, read_channels, write_channels
from deformnb.volume import Channels, Volume
from deformnb.volume.layers import LayerData
from deformnb.warping import Landmarks

VOLUMES = (".nii.gz", ".nii", ".nrrd", ".nhdr", ".mha", ".mhd", ".vti")
"""Suffixes of volumes that are read."""

SLICES = (".dcm", ".dicom", ".ima")
"""Suffixes of slices of DICOM, of which a folder or several are a volume."""

LANDMARKS = (".mrk.json", ".fcsv")
"""Suffixes of landmarks."""

WRITTEN = (".nii.gz", ".nii", ".nrrd", ".mha", ".vti")
"""Suffixes of volumes that are written: each is one file."""

_SERIES = (".nii.gz", ".nii", ".nrrd", ".nhdr", ".mha", ".mhd")

ReadFunction = Callable[[Any], list[LayerData]]
"""Reads what a reader was asked for, as layers."""


def get_reader(path: str | list[str]) -> ReadFunction | None:
    """The reader of a file of volumes or landmarks, or of slices of DICOM; None for anything else.

    Parameters
    ----------
    path : or a list of slices of DICOM in one folder, which are read as one volume.
    """
    paths = [Path(one) for one in (path if isinstance(path, list) else [path])]
    names = [one.name.lower() for one in paths]
    if all(name.endswith(SLICES) for name in names) and len({one.parent for one in paths}) == 1:
        return read_slices
    if len(names) == 1 and names[0].endswith((*VOLUMES, *LANDMARKS)):
        return read_file
    return None


def read_file(path: str) -> list[LayerData]:
    """The layers of a file: an image, labels or one image for each channel; or landmarks."""
    if path.lower().endswith(LANDMARKS):
        return _with_notes(to_napari(read_landmarks(path)), read_landmarks(path).notes, path)
    if path.lower().endswith(_SERIES):
        series = open_series(path)
        moments = len(series)
        if moments > 1:
            show_warning(f"{Path(path).name} has {moments} moments, of which the first is shown.")
        channels = read_channels(path)
        if len(channels) > 1:
            return to_napari(channels)
    volume = read_volume(path)
    return _with_notes(to_napari(volume), volume.notes, path)


def read_slices(path: str | list[str]) -> list[LayerData]:
    """The volume of a slice of DICOM, or of the series in the folder of several."""
    place = Path(path[0]).parent if isinstance(path, list) and len(path) > 1 else _only(path)
    volume = read_volume(place)
    return _with_notes(to_napari(volume), volume.notes, place.name)


def write_layer(path: str, data: Any, attributes: dict[str, Any], kind: str) -> list[str]:
    """Write a layer with its place, and its colours where it has some."""
    given = from_napari((data, attributes, kind))
    if isinstance(given, Landmarks):
        write_landmarks(given, path)
    elif isinstance(given, Channels):
        write_channels(given, path)
    else:
        assert isinstance(given, Volume)
        write_volume(given, path)
    return [path]


def write_image(path: str, data: Any, attributes: dict[str, Any]) -> list[str]:
    """Write an image as a volume, as napari calls a writer of one layer."""
    return write_layer(path, data, attributes, "image")


def write_labels(path: str, data: Any, attributes: dict[str, Any]) -> list[str]:
    """Write labels as a volume of labels."""
    return write_layer(path, data, attributes, "labels")


def write_points(path: str, data: Any, attributes: dict[str, Any]) -> list[str]:
    """Write points as landmarks."""
    return write_layer(path, data, attributes, "points")


def open_dicom_folder(viewer: Any, folder: str | Path | None = None) -> None:
    """Open the DICOM series of a folder.

    Parameters
    ----------
    viewer : in which it is shown.
    folder : asked for where it is None.
    """
    from napari.layers import Layer
    from napari.utils.notifications import show_error
    from qtpy.QtWidgets import QFileDialog

    chosen = (
        fspath(folder) if folder is not None else QFileDialog.getExistingDirectory(None, "Folder of a DICOM series")
    )
    if not chosen:
        return
    try:
        volume = read_volume(chosen)
    except DeformError as error:
        show_error(str(error))
        return
    for layer in _with_notes(to_napari(volume), volume.notes, Path(chosen).name):
        viewer.add_layer(Layer.create(*layer))


def _only(path: str | list[str]) -> Path:
    return Path(path[0] if isinstance(path, list) else path)


def _with_notes(layers: list[LayerData], notes: tuple[str, ...], name: str) -> list[LayerData]:
    """The layers, whose file had something to say."""
    if notes:
        show_warning(f"{Path(name).name}: {'; '.join(notes)}.")
    return layers
