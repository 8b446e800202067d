"""Data files that a header names: one, a numbered set or a list, all in the header's own folder."""

from __future__ import annotations

import math
import os
import re
from pathlib import Path

from deformnb.io.files.addresses import copy_neighbour
from deformnb.io.files.errors import fail, printable
from deformnb.io.files.paths import regular_file


def detached_file(header: Path, name: str) -> Path:
    """The data file that a header names, which must be in the header's own folder or below it.

    One that belongs to the copy of an address is copied too. Anything else is refused: a header from elsewhere could
    otherwise show any file of this machine as voxels.
    """
    plain = name.strip()
    parts = re.split(r"[/\\]", plain)
    if not plain or "\0" in plain or ".." in parts or not parts[0] or os.path.isabs(plain) or ":" in parts[0]:
        raise fail(
            header,
            f"its data file '{printable(plain)}' is not in the header's own folder, so it is not read. "
            "Put both files into one folder and name it without a path.",
        )
    target = header.parent.joinpath(*parts)
    try:
        inside = target.resolve().is_relative_to(header.parent.resolve())
    except (OSError, RuntimeError, ValueError) as error:
        raise fail(header, f"its data file '{printable(plain)}' is not a usable name ({error}).") from error
    if not inside:
        raise fail(
            header, f"its data file '{printable(plain)}' is a link out of the header's own folder; it is not read."
        )
    copy_neighbour(header, "/".join(parts))
    if not target.exists():
        raise fail(header, f"its data file '{printable(plain)}' is missing; it belongs next to the header.")
    if target.resolve() == header.resolve():
        raise fail(header, "it names itself as its data file.")
    return regular_file(target)


# Real sets have a file for each slice.
MOST_FILES = 50_000
_PATTERN = re.compile(r"(.*%0?[0-9]{0,2}d\S*)\s+(-?[0-9]{1,9})\s+(-?[0-9]{1,9})(?:\s+(-?[0-9]{1,9}))?(?:\s+([0-9]+))?")


def numbered_names(header: Path, pattern: str) -> tuple[list[str], int | None]:
    """The names of a set of files that a header gives as a pattern: ``slice%03d.raw first last step``.

    Returns
    -------
    tuple
        Names in their order, and the number of axes that each file has, where the header states it behind the step.

    Raises
    ------
    VolumeFileError
        If it is no such pattern, or one of too many files.

    Examples
    --------
    >>> numbered_names(Path("a.nhdr"), "s%02d.raw 8 12 2")
    (['s08.raw', 's10.raw', 's12.raw'], None)
    """
    found = _PATTERN.fullmatch(pattern.strip())
    name = found[1] if found else ""
    if found is None or name.count("%") != 1:
        raise fail(
            header,
            f"its data file '{printable(pattern)}' should be a name, or a pattern of names with the first "
            "and the last number and a step, such as slice%03d.raw 1 20 1.",
        )
    first, last, step = int(found[2]), int(found[3]), int(found[4] or 1)
    numbers = range(first, last + (1 if step > 0 else -1), step) if step else range(0)
    if not 1 <= len(numbers) <= MOST_FILES:
        raise fail(
            header,
            f"its data files from {first} to {last} by {step} are {len(numbers)}; 1 to {MOST_FILES} can be read.",
        )
    return [name % number for number in numbers], int(found[5]) if found[5] else None


def listed_names(header: Path, text: str) -> list[str]:
    """The names of a set of files that a header lists, one a line up to its end."""
    names = [line.strip() for line in text.splitlines() if line.strip()]
    if not 1 <= len(names) <= MOST_FILES:
        raise fail(header, f"its list of data files has {len(names)} names; 1 to {MOST_FILES} can be read.")
    if len(set(names)) < len(names):
        raise fail(header, "its list of data files names a file twice.")
    return names


def check_share(header: Path, sizes: list[int], files: int, axes: int | None) -> None:
    """Refuse a set of files that are not as many as the sizes of the header require.

    Parameters
    ----------
    sizes : along all axes of the file, the one that changes fastest first.
    axes : how many of these each file has; by default all but the last.
    """
    inner = len(sizes) - 1 if axes is None else axes
    wanted = math.prod(sizes[inner:])
    fits = files == wanted if inner < len(sizes) else sizes[-1] % files == 0
    if not 1 <= inner <= len(sizes) or not fits:
        raise fail(header, f"its sizes {sizes} need {wanted} data files of {inner} axes, and it names {files}.")


def detached_name(header: Path, crc: int) -> str:
    """Name of the file of voxels that goes with a header we write; it cannot clash with another format's file.

    Parameters
    ----------
    crc : CRC-32 of the voxels' bytes: other voxels get another name.

    Raises
    ------
    VolumeFileError
        For a name that a text header cannot hold: it would be read back as another name, or as more fields.
    """
    name = f"{header.name}.{crc:08x}.raw"
    if not name.isprintable() or "%" in name or name != name.strip():
        raise fail(
            header,
            "a header with a detached data file cannot have this name; leave out '%', line ends and "
            "spaces at the ends, or write everything into one file (.nrrd, .mha).",
        )
    return name


def is_detached_name(header: Path, name: str) -> bool:
    """Check whether :func:`detached_name` gives such a name to a data file of this header."""
    return re.fullmatch(re.escape(header.name) + r"\.[0-9a-f]{8}\.raw", name) is not None


def detached_proof(crc: int) -> str:
    """The comment in a header that we write with the checksum of its data file."""
    return f"deformnb data crc32 {crc:08x}"


def stated_crc(comments: str, data_file: str) -> int | None:
    """The checksum of the data file in a header's comments; None if there is none.

    A program that reads our header and writes other voxels may copy the comments, but gives the data file another
    name; so a check sum counts only for a file that has it in its name.
    """
    found = re.search(r"deformnb data crc32 ([0-9a-f]{8})\b", comments)
    return int(found[1], 16) if found is not None and data_file.endswith(f".{found[1]}.raw") else None
