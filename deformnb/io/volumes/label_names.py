"""Names of labels: of the segments in a file of 3D Slicer, or in a table next to a label volume.

The segments of a file of 3D Slicer are written back with the labels that were deformed.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from pathlib import Path

from deformnb._typing import Progress
from deformnb.errors import VolumeFileError
from deformnb.io.files.addresses import copy_neighbour, input_path
from deformnb.io.files.atomic import check_target
from deformnb.io.files.errors import fail
from deformnb.io.files.paths import as_path
from deformnb.io.files.texts import decode_text
from deformnb.io.volumes import nrrd
from deformnb.io.volumes.nrrd import segment_keys, segment_names
from deformnb.volume.volume import VolumeLike, as_volume

LABEL_TABLES = (".csv", ".tsv", ".ctbl", ".txt", ".label")
"""Endings of the names of tables of label names."""

_VOLUMES = re.compile(r"(\.seg)?(\.nrrd|\.nhdr|\.nii|\.mha|\.mhd|\.tiff?|\.vti)(\.gz)?$", re.IGNORECASE)
_LONGEST = 1 << 20  # bytes: some ten thousand labels
_NUMBERS = frozenset({"label", "value", "index", "id", "idx", "labelvalue", "integer_label", "key"})
_NAMES = frozenset({"name", "structure", "text", "label_name", "labelname", "anatomy", "region"})
_PLACES = frozenset({"x", "y", "z", "source_a", "source_x"})  # columns of landmarks and points, which are named too
_LABEL = re.compile(r"\d{1,19}")
_ITK_SNAP = re.compile(r'\s*(\d{1,19})(?:\s+[\d.]+){3,6}\s+"([^"]*)"')
_COLOUR_TABLE = re.compile(r"\s*(\d{1,19})\s+(\S+)((?:\s+[\d.]+){3,4})\s*$")


def read_label_names(path: str | Path) -> dict[int, str]:
    r"""Read the names of the labels of a label volume.

    Parameters
    ----------
    path : of the volume. A segmentation of 3D Slicer (.seg.nrrd) names its segments itself. For any other file the
        names are looked for in a table of the same name next to it, such as bones.csv for bones.nii.gz: a .csv or
        .tsv with columns "label" and "name", a colour table of 3D Slicer or FreeSurfer (.ctbl, .txt), or the label
        descriptions of ITK-SNAP (.label, .txt).

    Returns
    -------
    Names by label; labels without a name are absent. Empty if there is no table, or none that can be understood: a
    volume can be used without names.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "names.csv"
    >>> _ = file.write_text("label,name\n3,liver\n7,aorta\n", encoding="utf-8")
    >>> read_label_names(file.with_name("names.nii.gz"))
    {3: 'liver', 7: 'aorta'}
    """
    path = input_path(path)
    if path.suffix.lower() in (".nrrd", ".nhdr") and path.is_file() and (own := segment_names(path)):
        return own
    if not path.name:  # a folder without a name, such as "."
        return {}
    stem = _VOLUMES.sub("", path.name)
    for ending in LABEL_TABLES:
        copy_neighbour(path, stem + ending, _LONGEST)
        if names := read_label_table(path.with_name(stem + ending)):
            return names
    return {}


def is_label_table(name: str) -> bool:
    """Check whether a file is named as tables of label names are; files of other kinds are named so too."""
    return name.lower().endswith(LABEL_TABLES)


def read_label_table(path: str | Path) -> dict[int, str]:
    r"""Names by label of a table, such as :func:`read_label_names` searches for; empty for another file.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "bones.csv"
    >>> _ = file.write_text("label,name\n95,femur\n96,tibia\n")
    >>> read_label_table(file)
    {95: 'femur', 96: 'tibia'}
    """
    path = input_path(path)
    try:
        if not is_label_table(path.name) or not path.is_file() or path.stat().st_size > _LONGEST:
            return {}
        return _table(decode_text(path, path.read_bytes())[0])
    except (VolumeFileError, csv.Error, OSError):  # the last of a name that is too long
        return {}


def is_segmentation_file(path: str | Path) -> bool:
    """Check whether a file is a segmentation of 3D Slicer, whose segments have names and colours."""
    path = input_path(path)
    return path.suffix.lower() in (".nrrd", ".nhdr") and path.is_file() and bool(segment_keys(path))


def write_segmentation(
    volume: VolumeLike, path: str | Path, like: str | Path, *, overwrite: bool = True, progress: Progress | None = None
) -> None:
    """Write labels as a segmentation of 3D Slicer, with the names, colours and terms of the segments of another.

    Parameters
    ----------
    volume : the labels, such as deformed ones.
    path : ends in .nrrd (.seg.nrrd, for 3D Slicer to take it for a segmentation).
    like : the segmentation whose segments these are; the box of each is computed again.
    overwrite : whether an existing file may be replaced.
    progress : receives the share done, 0 to 1; may raise Cancelled.

    Raises
    ------
    VolumeFileError
        If the other file is no segmentation, or this one cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from deformnb.volume.volume import Volume
    >>> file = Path(tempfile.mkdtemp()) / "none.nrrd"
    >>> write_segmentation(Volume.from_array(np.zeros((2, 3, 4), np.uint8), is_labels=True), file, file)
    Traceback (most recent call last):
    ...
    deformnb.errors.VolumeFileError: ...
    """
    volume, path, like = as_volume(volume), as_path(path), input_path(like)
    if path.suffix.lower() != ".nrrd":
        raise fail(path, "the names of segments are written to .nrrd files only; name it .seg.nrrd.")
    if not is_segmentation_file(like):
        raise fail(like, "it is no segmentation of 3D Slicer (.seg.nrrd), whose segments have names.")
    check_target(path, overwrite=overwrite)
    nrrd.write_segmentation(volume.to_unit("mm"), path, segment_keys(like), overwrite, progress)


def _table(text: str) -> dict[int, str]:
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        return {}
    delimiter = "\t" if "\t" in lines[0] else ";" if ";" in lines[0] else ","
    found: Mapping[int, str]
    if delimiter in lines[0]:
        found = _columns(list(csv.reader(lines, delimiter=delimiter)))
    else:
        rows = [_ITK_SNAP.match(line) or _COLOUR_TABLE.match(line) for line in lines]
        found = {int(row[1]): row[2] for row in rows if row}
    return {label: name for label, name in found.items() if name.strip("? ")}


def _columns(rows: list[list[str]]) -> dict[int, str]:
    """Names by label of a table whose first row names the columns."""
    head = [cell.strip().lower().replace(" ", "_") for cell in rows[0]]
    number = next((k for k, cell in enumerate(head) if cell in _NUMBERS), None)
    name = next((k for k, cell in enumerate(head) if cell in _NAMES), None)
    if number is None or name is None or _PLACES.intersection(head):
        return {}
    return {
        int(row[number]): row[name].strip()
        for row in rows[1:]
        if len(row) > max(number, name) and _LABEL.fullmatch(row[number].strip())
    }
