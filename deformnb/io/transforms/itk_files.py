"""Files of ITK's transforms, read without ITK: text (.tfm, .txt), MATLAB's level 4 (.mat), HDF5 (.h5).

Each is a list of transforms: the name of a class, its parameters and its fixed parameters. Sizes, counts and types are
compared with the size of the data before any number is decoded.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.checks import optional_package
from deformnb.io.files.errors import fail, human_bytes, printable, unpacking
from deformnb.io.files.memory import available_memory
from deformnb.io.files.streams import MOST_PACKED
from deformnb.io.transforms.itk_kinds import COMPOSITE, ItkTransform, check_transform, parse_class

LONGEST_ITK_TEXT = 1 << 26
"""Bytes of a .tfm file: some million numbers."""

_MOST_TRANSFORMS = 1000  # of one file
_NUMBERS = re.compile(r"[0-9eE+\-.\s]*|(?i:[0-9e+\-.\sinfatyn]*)")
_LONGEST_NUMBER = 400  # characters; float64 has 17 digits, and 1e308 written out 309
_PIECE = 1 << 20  # characters of a line that are words at a time: words take ten times as much as their text

_LONGEST_NAME = 1 << 10  # characters of the name of a class
# Of HDF5's filters those that its library has built in and needs nothing from elsewhere for: deflate, shuffle, checks.
_FILTERS = (1, 2, 3)


def read_text(path: Path) -> str:
    """The text of a file of parameters, of bounded length."""
    size = path.stat().st_size
    if size > LONGEST_ITK_TEXT:
        raise fail(path, f"a text of {human_bytes(size)} is too long for a transform; save it as .h5.")
    with path.open("rb") as file:
        return file.read(LONGEST_ITK_TEXT).decode("utf-8", errors="replace")


def finite_numbers(path: Path, text: str, what: str) -> NDArray[np.float64]:
    """The numbers of a text, of any count; refused where one of them is invalid, or not finite."""
    parts = list[NDArray[np.float64]]()
    for piece in _pieces(text):
        words = piece.split()
        plain = _NUMBERS.fullmatch(piece) is not None and max(map(len, words), default=0) <= _LONGEST_NUMBER
        try:
            parts.append(np.array([float(word) for word in words]) if plain else np.full(1, np.nan))
        except ValueError:
            plain = False
        if not plain:
            raise fail(path, f"{what} must be numbers, and one of them is none: '{printable(piece.strip(), 60)}'.")
    found = np.concatenate(parts) if parts else np.zeros(0)
    if not np.isfinite(found).all():
        raise fail(path, f"{what} must be finite numbers, and one of them is not.")
    return found


def _pieces(text: str) -> Iterator[str]:
    start = 0
    while start < len(text):
        end = start + _PIECE
        while end < len(text) and not text[end].isspace() and end - start < 2 * _PIECE:
            end += 1
        yield text[start:end]
        start = end


def transforms_of_text(path: Path, text: str) -> list[ItkTransform]:
    """The transforms of a .tfm file: lines 'Name: value', of which 'Transform' begins one."""
    entries = list[dict[str, str]]()
    lines = text.split("\n")
    if not lines[0].startswith("#Insight Transform File"):
        raise fail(path, "it is no text of ITK's transforms: its first line is not '#Insight Transform File V1.0'.")
    for line in lines[1:]:
        key, colon, value = line.partition(":")
        key = key.strip()
        if not line.strip() or key.startswith("#"):
            continue
        if not colon or key not in ("Transform", "Parameters", "FixedParameters"):
            raise fail(
                path,
                f"its line '{printable(line.strip(), 60)}' is none of 'Transform:', 'Parameters:' and "
                "'FixedParameters:'; it is damaged, or not of ITK.",
            )
        if key == "Transform":
            entries.append({})
            if len(entries) > _MOST_TRANSFORMS:
                raise fail(path, f"it holds more than {_MOST_TRANSFORMS} transforms.")
        if not entries or key in entries[-1]:
            raise fail(
                path,
                f"its line '{key}:' "
                + ("appears twice in one transform." if entries else "comes before the first 'Transform:'."),
            )
        entries[-1][key] = value
    return [_from_lines(path, rows) for rows in entries]


def _from_lines(path: Path, rows: dict[str, str]) -> ItkTransform:
    name = rows["Transform"].strip()
    kind, _, _ = parse_class(path, name)
    for key in ("Parameters", "FixedParameters"):
        if key not in rows and kind != COMPOSITE:
            raise fail(path, f"its {printable(name, 80)} has no line '{key}:'; it is cut short or damaged.")
    numbers = [
        finite_numbers(path, rows.get(key, ""), f"the {key} of its {printable(name, 80)}")
        for key in ("Parameters", "FixedParameters")
    ]
    return check_transform(path, name, numbers[0], numbers[1])


# -- MATLAB's level 4 --------------------------------------------------------------------------------------------------

# MOPT of a matrix: thousands M = 0 little-endian or 1 big-endian, tens P = 0 float64 or 1 float32, the rest 0.
# Source: MAT-File Format, The MathWorks, chapter "Level 4 MAT-File Format".
_MATRICES = {0: "<f8", 10: "<f4", 1000: ">f8", 1010: ">f4"}


def transforms_of_matrices(path: Path) -> list[ItkTransform]:
    """The transforms of a .mat file: pairs of matrices, one named by the class and one named "fixed"."""
    size = path.stat().st_size
    if size > available_memory() // 3:
        raise fail(path, f"it has {human_bytes(size)}, more than a third of the memory that is free.")
    data, at = path.read_bytes(), 0
    found = list[tuple[str, NDArray[np.float64]]]()
    while at < len(data):
        name, numbers, at = _matrix(path, data, at)
        found.append((name, numbers))
        if len(found) > 2 * _MOST_TRANSFORMS:
            raise fail(path, f"it holds more than {_MOST_TRANSFORMS} transforms.")
    if not found or len(found) % 2 or any(name != "fixed" for name, _ in found[1::2]):
        raise fail(
            path, "it is no matrix file of ITK or ANTs: a transform is a matrix named by its class and one named fixed."
        )
    return [
        check_transform(path, name, numbers, fixed)
        for (name, numbers), (_, fixed) in zip(found[::2], found[1::2], strict=True)
    ]


def _matrix(path: Path, data: bytes, at: int) -> tuple[str, NDArray[np.float64], int]:
    """Name and numbers of the matrix that begins at a byte, and where it ends."""
    wrong = fail(path, "it is no matrix file of ITK or ANTs, or damaged: its sizes do not agree with its length.")
    if at + 20 > len(data):
        raise wrong
    for order in "<>":
        mopt, rows, columns, imaginary, length = np.frombuffer(data, f"{order}i4", 5, at).tolist()
        dtype = _MATRICES.get(mopt)
        if dtype is not None and dtype[0] == order:
            break
    else:
        raise wrong
    count = rows * columns
    end = at + 20 + length + count * int(dtype[2])
    if imaginary or rows < 0 or columns < 0 or not 0 < length <= _LONGEST_NAME or end > len(data):
        raise wrong
    name = data[at + 20 : at + 20 + length].split(b"\0")[0].decode("ascii", "replace")
    return name, np.frombuffer(data, dtype, count, at + 20 + length).astype(np.float64), end


# -- HDF5 --------------------------------------------------------------------------------------------------------------


def transforms_of_hdf5(path: Path) -> list[ItkTransform]:
    """The transforms of an HDF5 file: the groups 0, 1, ... of its group TransformGroup."""
    h5py = optional_package("h5py")
    with unpacking(path), h5py.File(path, "r") as file:
        group = _member(path, file, "TransformGroup", h5py.Group)
        names = sorted(group, key=lambda name: (len(name), name))
        if len(names) > _MOST_TRANSFORMS:
            raise fail(path, f"it holds {len(names)} transforms; at most {_MOST_TRANSFORMS} are read.")
        if names != [str(k) for k in range(len(names))]:
            raise fail(path, f"its transforms are not numbered 0 to {len(names) - 1}, but {printable(names, 60)}.")
        return [_from_group(path, _member(path, group, name, h5py.Group)) for name in names]


def _member(path: Path, group: Any, name: str, kind: type) -> Any:
    """A member of a group in this very file, of a kind; links lead elsewhere."""
    h5py = optional_package("h5py")
    link = group.get(name, getlink=True)
    found = group[name] if isinstance(link, h5py.HardLink) else None
    if not isinstance(found, kind):
        raise fail(
            path, f"it is no HDF5 file of ITK's transforms: '{printable(name, 40)}' is missing, or is something else."
        )
    return found


def _from_group(path: Path, group: Any) -> ItkTransform:
    h5py = optional_package("h5py")
    name = _text(path, _member(path, group, "TransformType", h5py.Dataset))
    # Old versions of ITK wrote "Tranform".
    found = {key.replace("Tranform", "Transform"): key for key in group}
    numbers = list[NDArray[np.float64]]()
    for key in ("TransformParameters", "TransformFixedParameters"):
        if key not in found and parse_class(path, name)[0] == COMPOSITE:
            numbers.append(np.zeros(0))
            continue
        numbers.append(_numbers(path, _member(path, group, found.get(key, key), h5py.Dataset), key))
    return check_transform(path, name, numbers[0], numbers[1])


def _text(path: Path, dataset: Any) -> str:
    """The one string of a dataset, of a fixed or a variable length."""
    wrong = fail(path, "the name of a transform in it is no text of one line.")
    kind = dataset.dtype
    h5py = optional_package("h5py")
    if dataset.size != 1 or h5py.check_string_dtype(kind) is None or kind.itemsize > _LONGEST_NAME:
        raise wrong
    _check_stored(path, dataset, "TransformType")
    value = np.ravel(dataset[()])[0]
    text = value.decode("ascii", "replace") if isinstance(value, bytes) else str(value)
    if len(text) > _LONGEST_NAME:
        raise wrong
    return text


def _numbers(path: Path, dataset: Any, what: str) -> NDArray[np.float64]:
    """The numbers of a dataset, after checks of type, count, memory and of the stored size."""
    if dataset.dtype.kind != "f" or dataset.dtype.itemsize not in (4, 8) or len(dataset.shape or ()) > 1:
        raise fail(
            path,
            f"its {what} are of the type {printable(dataset.dtype, 40)}, and must be a list of float32 or float64.",
        )
    if dataset.shape is None or dataset.size == 0:
        return np.zeros(0)
    need = dataset.size * 16 + math.prod(dataset.chunks or (0,)) * dataset.dtype.itemsize
    if need > available_memory() // 2:
        raise fail(path, f"its {what} are {dataset.size} numbers, more than the memory here can hold twice.")
    _check_stored(path, dataset, what)
    return np.asarray(dataset[()], dtype=np.float64).reshape(-1)


def _check_stored(path: Path, dataset: Any, what: str) -> None:
    """Refuse data that are in other files, need other programs, or are missing: HDF5 fills that up with zeros."""
    if dataset.external or dataset.is_virtual:
        raise fail(path, f"its {what} are in another file, which is not read.")
    plist = dataset.id.get_create_plist()
    if any(plist.get_filter(k)[0] not in _FILTERS for k in range(plist.get_nfilters())):
        raise fail(path, f"its {what} are packed in a way that is not read; save them with gzip, or unpacked.")
    whole, stored = dataset.size * dataset.dtype.itemsize, dataset.id.get_storage_size()
    if dataset.chunks is None:
        short = stored < whole
    else:
        short = (
            dataset.id.get_num_chunks()
            < math.prod(-(-n // c) for n, c in zip(dataset.shape, dataset.chunks, strict=True))
            or stored * MOST_PACKED < whole
        )
    if short or stored > path.stat().st_size:
        raise fail(path, f"its {what} should be {whole} bytes, and {stored} are stored; it is cut short or damaged.")
