"""Inputs of a session: a volume from any accepted object, a saved document, the side that shows most."""

from __future__ import annotations

import json
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Progress, Spacing
from deformnb.document.deformation import Deformation
from deformnb.document.json_reader import without_surrogates
from deformnb.errors import DeformError
from deformnb.io.documents import read_deformation
from deformnb.io.files.addresses import input_path, split_progress
from deformnb.io.files.paths import address_of
from deformnb.io.meshes.formats import is_mesh, read_mesh
from deformnb.io.volumes.formats import describe_file, read_volume
from deformnb.io.volumes.series import is_series, open_series
from deformnb.volume.channels import Channels
from deformnb.volume.converters import convert
from deformnb.volume.transfer import levels
from deformnb.volume.views import ViewName
from deformnb.volume.volume import Grid, Volume, as_spacing, as_volume
from deformnb.warping.mesh import Mesh, as_mesh, fill_distance, grid_around, is_surface, signed_distance


def volume_from(
    given: Any,
    *,
    spacing: Spacing | None = None,
    is_labels: bool | None = None,
    level: int | None = None,
    progress: Progress | None = None,
) -> Volume:
    """A volume from any object that is one, from a mesh, or from the path of a file of a volume or a mesh.

    Parameters
    ----------
    spacing : true voxel size (x, y, z), where a file has a wrong one.
    is_labels : whether the voxels of a file are labels; None as in the file.
    level : of a pyramid that is read, 0 for the finest; None for the finest that fits into memory.
    """
    if is_surface(given):
        return body_of(as_mesh(given), progress)
    if not isinstance(given, str | PathLike):
        found = as_volume(given)
        found = found if spacing is None else replace(found, grid=replace(found.grid, spacing=as_spacing(spacing)))
        return found if is_labels is None else found.mark_labels(is_labels)
    if not is_mesh(given):
        return read_volume(given, spacing=spacing, is_labels=is_labels, level=level, progress=progress)
    if spacing is not None:
        raise DeformError(f"a spacing is for volumes, and {Path(given).name} is a mesh.")
    return body_of(read_mesh(given), progress)


def subject_from(given: Any, **options: Any) -> Volume | Channels:
    """Subject of a session: as :func:`volume_from`, but channels and colours stay unchanged.

    Parameters
    ----------
    options : of :func:`volume_from`.
    """
    if address_of(given):
        copied, options["progress"] = split_progress(given, options.get("progress"))
        given = input_path(given, copied)
    if isinstance(given, str | PathLike) and not is_mesh(given) and is_series(given):
        series = open_series(given, spacing=options.get("spacing"))
        if len(series) == 1:
            return next(iter(series))
    if not isinstance(given, str | PathLike) and not is_surface(given):
        found = convert(given)
        if isinstance(found, Channels):
            return found
        given = found
    return volume_from(given, **options)


def as_volume_and_channels(subject: Volume | Channels) -> tuple[Volume, Channels | None]:
    """The volume that is shown, dragged and measured, and the channels that it is made of."""
    return (subject.brightness(), subject) if isinstance(subject, Channels) else (subject, None)


def grid_of_file(path: str | PathLike[str], spacing: Spacing | None = None) -> Grid:
    """Grid of a volume, from the header of its file; of a mesh, the grid of the volume that is made of it."""
    grid = grid_around(read_mesh(path)) if is_mesh(path) else describe_file(path).grid
    return grid if spacing is None else replace(grid, spacing=as_spacing(spacing))


def body_of(mesh: Mesh, progress: Progress | None = None) -> Volume:
    """A closed mesh as a volume of grey values, to be looked at and deformed like a scan."""
    return fill_distance(signed_distance(mesh, progress=progress))


def source_of(given: Any) -> str:
    """An expression that reads the volume that was given as a path, for scripts; empty for anything else.

    Examples
    --------
    >>> source_of("scans/carp.nii.gz"), source_of(np.zeros((2, 2, 2)))
    ('dn.read_volume("scans/carp.nii.gz")', '')
    >>> source_of("bone.stl")
    'dn.warping.fill_distance(dn.warping.signed_distance(dn.read_mesh("bone.stl")))'
    """
    if not isinstance(given, str | PathLike):
        return ""
    path = without_surrogates(json.dumps(str(given), ensure_ascii=False))
    if not is_mesh(given):
        is_of_channels = bool(address_of(given) or Path(given).is_file()) and is_series(given)
        return f"dn.io.read_channels({path}).brightness()" if is_of_channels else f"dn.read_volume({path})"
    return f"dn.warping.fill_distance(dn.warping.signed_distance(dn.read_mesh({path})))"


def source_of_labels(source: str) -> str:
    """The expression that reads the same file as labels.

    Examples
    --------
    >>> source_of_labels('dn.read_volume("bones.nrrd")')
    'dn.read_volume("bones.nrrd", is_labels=True)'
    """
    return f"{source.removesuffix(')')}, is_labels=True)" if source.startswith("dn.read_volume(") else source


def as_deformation(given: Any) -> Deformation | None:
    """A document from a document or the path of a file; None for none."""
    return given if given is None or isinstance(given, Deformation) else read_deformation(given)


# Of the diagonal of a silhouette's picture: roughness of the outline that is finer is noise, not shape.
SILHOUETTE_SMOOTHING = 0.01


def best_view(volume: Volume) -> ViewName:
    """The side that shows most of the subject: the one with the longest silhouette; that of a picture for one slice.

    The length of the silhouette is the measure of viewpoints by O. Polonsky et al., "What's in an image? Towards the
    computation of the best view of an object", The Visual Computer 21 (2005): limbs, fins and bends that stand out in
    profile lengthen it, where an area counts them no more than a bulk. Where the volume ends inside the subject, its
    edge is part of the silhouette.

    Examples
    --------
    >>> flat = np.zeros((8, 8, 8), np.uint8)
    >>> flat[1:7, 1:7, 4] = 200
    >>> best_view(Volume.from_array(flat))
    '-x'
    """
    if volume.shape[0] == 1:
        return "+z"  # its rows run down and its columns to the right; from the other side it is mirrored
    _, air, _, _ = levels(volume)
    subject = volume.finite_values > air
    dx, dy, dz = volume.grid.spacing
    sides: tuple[tuple[ViewName, int, tuple[float, float]], ...] = (
        ("+y", 1, (dz, dx)),
        ("-x", 2, (dz, dy)),
        ("-z", 0, (dy, dx)),
    )
    lengths = {view: silhouette_length(np.asarray(subject.any(axis=axis)), spacing) for view, axis, spacing in sides}
    return max(lengths, key=lambda view: lengths[view])


def silhouette_length(silhouette: NDArray[np.bool_], spacing: tuple[float, float]) -> float:
    """Length of the outline of a silhouette, in the unit of the spacing: its total variation, slightly smoothed.

    Parameters
    ----------
    silhouette : [v, u], true where the subject is.
    spacing : of rows and of columns.

    Examples
    --------
    >>> disc = np.hypot(*np.mgrid[-60:61, -60:61]) < 50
    >>> round(silhouette_length(disc, (1.0, 1.0)) / (2 * np.pi * 50), 2)
    1.0
    """
    size = np.hypot(*(np.array(silhouette.shape) * spacing))
    sigma = [max(SILHOUETTE_SMOOTHING * size / step, 0.5) for step in spacing]
    margins = [int(4 * one) + 2 for one in sigma]
    padded = np.pad(silhouette.astype(np.float64), [(margin, margin) for margin in margins])
    # By Fourier transforms of NumPy: importing SciPy's filters takes longer than a studio's first picture.
    v = 2 * np.pi * np.fft.fftfreq(padded.shape[0])[:, None]
    u = 2 * np.pi * np.fft.rfftfreq(padded.shape[1])
    smooth = np.fft.rfft2(padded) * np.exp(-((sigma[0] * v) ** 2 + (sigma[1] * u) ** 2) / 2)
    slopes = [np.fft.irfft2(1j * frequency * smooth, padded.shape) for frequency in (v, u)]
    return float(np.hypot(slopes[0] / spacing[0], slopes[1] / spacing[1]).sum() * spacing[0] * spacing[1])
