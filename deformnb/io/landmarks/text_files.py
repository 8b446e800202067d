"""Landmark files of plain text: TPS, NTS, Morphologika, elastix, PyGeM, and lists of points of vedo and VTK.

Files of geometric morphometrics hold specimens with the same landmarks. Of two specimens the second is the one that the
first corresponds to, as the moving and fixed places of BigWarp; of more the first is read. None of these formats states
the directions of its axes: coordinates are not converted.

TPS: F. J. Rohlf, tpsDig. NTS: NTSYS-pc. Morphologika: P. O'Higgins, N. Jones. elastix: its manual, section 4.3.
Lists of points: vtkSimplePointsReader, one place to a line; vtkParticleReader, with which vedo reads, has a value more.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deformnb.io.files.errors import fail, printable
from deformnb.io.landmarks.coordinates import coordinates, drop_missing, finite_number, is_comment, is_missing
from deformnb.warping.points import Landmarks


def _pair(
    path: Path, specimens: list[NDArray[np.float64]], titles: Sequence[str], notes: tuple[str, ...] = ()
) -> Landmarks:
    """The first specimen; with one more that is its fixed counterpart."""
    if not specimens:
        raise fail(path, "there is no landmark in it.")
    first, fixed = specimens[0], None
    if len(specimens) == 2:
        fixed = specimens[1]
        if fixed.shape != first.shape:
            raise fail(
                path,
                f"its two specimens have {len(first)} and {len(fixed)} landmarks of {first.shape[1]} and "
                f"{fixed.shape[1]} coordinates; they must be the same ones.",
            )
    elif len(specimens) > 2:
        title = f", {printable(titles[0], 40)}" if titles[0] else ""
        notes = (f"the first of {len(specimens)} specimens was read{title}; two of them would be read as pairs", *notes)
    return drop_missing(path, first, fixed, notes=notes)


def _number_rows(path: Path, rows: Sequence[tuple[int, str]], counts: Sequence[int] = (2, 3)) -> NDArray[np.float64]:
    """Places of numbered lines, all of the same count of coordinates."""
    places = list[list[float]]()
    for number, row in rows:
        words = re.split(r"[,\s]+", row.strip().strip(","))
        if len(words) not in counts and all(map(_DECIMAL_COMMA.fullmatch, row.split())):
            words = [word.replace(",", ".") for word in row.split()]
        if len(words) not in counts or (places and len(words) != len(places[0])):
            raise fail(
                path,
                f"line {number} has {len(words)} numbers where a place of "
                f"{' or '.join(map(str, counts if not places else [len(places[0])]))} is expected.",
            )
        places.append(coordinates(path, words, f"line {number}", 1))
    return np.array(places).reshape(len(places), len(places[0]) if places else counts[-1])


# As programs write it where a comma is the decimal point: whole numbers among them have none.
_DECIMAL_COMMA = re.compile(r"[-+]?\d+(,\d+)?([eE][-+]?\d+)?")


def _number_lines(text: str) -> list[tuple[int, str]]:
    """The lines of a text that are not empty, with their numbers."""
    return [(number, line) for number, line in enumerate(text.split("\n"), 1) if line.strip()]


# ---- TPS -------------------------------------------------------------------------------------------------------------


def read_tps(path: Path, text: str) -> Landmarks:
    """Landmarks of a TPS file; SCALE multiplies, curves and outlines are left out with a note.

    A landmark at -1 -1 is missing, as tpsDig writes it, where no other coordinate is negative.
    """
    lines, notes = text.split("\n"), dict[str, None]()
    specimens, titles, curves, at = list[NDArray[np.float64]](), list[str](), 0, 0
    while at < len(lines):
        key, sign, value = (part.strip() for part in lines[at].partition("="))
        at += 1
        if not sign:
            if key:
                raise fail(path, f"line {at} is '{printable(key, 30)}' where TPS has a key such as LM= or ID=.")
            continue
        name = key.upper()
        if name in ("LM", "LM3", "POINTS", "POINTS3"):
            count = _count(path, value, at)
            rows = lines[at : at + count]
            if len(rows) < count or (count and not all(row.strip() for row in rows)):
                raise fail(path, f"line {at} announces {count} landmarks, and fewer lines follow.")
            places = _number_rows(path, list(enumerate(rows, at + 1)), (3,) if name.endswith("3") else (2, 3))
            at += count
            if name.startswith("LM"):
                specimens.append(_mask_missing(places, notes))
                titles.append("")
            else:
                curves += 1
        elif name in ("ID", "IMAGE") and titles:
            titles[-1] = value if name == "ID" else titles[-1] or value
        elif name == "SCALE" and specimens:
            specimens[-1] = specimens[-1] * _scale(path, value, at, notes)
    if curves:
        if not any(map(len, specimens)):
            raise fail(path, f"it holds {curves} curves or outlines and no landmark.")
        notes[f"{curves} curves were left out; only landmarks are read"] = None
    return _pair(path, specimens, titles, tuple(notes))


def _mask_missing(places: NDArray[np.float64], notes: dict[str, None]) -> NDArray[np.float64]:
    """Places with NaN where tpsDig marks a landmark as missing by -1 -1; not among coordinates that are negative."""
    is_marked = (places == -1).all(axis=1)
    if is_marked.any() and (places[~is_marked] < 0).any():
        notes["landmarks at -1 -1 were taken as places, for other coordinates are negative too"] = None
        return places
    return np.where(is_marked[:, None], np.nan, places)


def _scale(path: Path, value: str, line: int, notes: dict[str, None]) -> float:
    """Lengths of a unit of the coordinates; 1 with a note where none is given."""
    if is_missing(value):
        notes["the scale is empty: coordinates were taken as they are"] = None
        return 1.0
    scale = finite_number(path, value.replace(",", "."), f"line {line}, the scale")
    if not scale > 0:
        raise fail(path, f"line {line}, the scale: {printable(value, 20)} is not above 0.")
    return scale


def write_tps(landmarks: Landmarks) -> str:
    """One specimen, or two where there are fixed places; doubled and with a scale where one is at -1 -1."""
    key = "LM3" if landmarks.points.shape[1] == 3 else "LM"
    factor = 1.0
    while any((factor * places == -1).all(axis=1).any() for _, places in _specimens(landmarks)):
        factor *= 2  # a power of two, so that no digit changes
    scale = "" if factor == 1 else f"SCALE={1 / factor!r}\n"
    return "".join(
        f"{key}={len(places)}\n{_rows(factor * places)}ID={title}\n{scale}" for title, places in _specimens(landmarks)
    )


def _count(path: Path, word: str, line: int) -> int:
    if not word.isdecimal() or len(word) > 7:
        raise fail(path, f"line {line} has '{printable(word, 20)}' where a count of landmarks is expected.")
    return int(word)


def _specimens(landmarks: Landmarks) -> list[tuple[str, NDArray[np.float64]]]:
    second = [] if landmarks.fixed is None else [("fixed", landmarks.fixed)]
    return [("moving" if second else "specimen", landmarks.points), *second]


def _rows(places: NDArray[np.float64], separator: str = " ") -> str:
    return "".join(separator.join(map(repr, place)) + "\n" for place in places.tolist())


# ---- NTS -------------------------------------------------------------------------------------------------------------


def read_nts(path: Path, text: str) -> Landmarks:
    """Landmarks of an NTS file: ``1 specimens numbers 0 dim=3``, or ``1 9999`` for the 0 where 9999 means missing."""
    lines = [(number, line) for number, line in _number_lines(text) if not line.lstrip().startswith(('"', "'"))]
    found = re.fullmatch(
        r"\s*1\s+(\d{1,6})(L?)\s+(\d{1,7})(L?)\s+(\d+)(?:\s+(\S+))?\s+dim\s*=\s*([23])\s*",
        lines[0][1] if lines else "",
        re.IGNORECASE,
    )
    if found is None:
        raise fail(
            path,
            "its first line is not that of an NTS file of landmarks: 1, how many specimens, how many "
            "numbers, 0, DIM=2 or DIM=3.",
        )
    count, numbers, dim = int(found[1]), int(found[3]), int(found[7])
    words = [
        (word, f"line {number}, column {column}")
        for number, line in lines[1:]
        for column, word in enumerate(line.split(), 1)
    ]
    titles = list[str]()
    if found[2]:
        titles, words = [word for word, _ in words[:count]], words[count:]
    if found[4]:
        words = words[numbers:]  # the names of the columns
    if len(words) != count * numbers or numbers % dim:
        raise fail(path, f"its first line announces {count} specimens of {numbers} numbers, and {len(words)} follow.")
    values = np.array([coordinates(path, [word], where)[0] for word, where in words]).reshape(count, -1, dim)
    if found[5] != "0" and found[6] and not is_missing(found[6]):
        values[values == finite_number(path, found[6], "its first line")] = np.nan
    return _pair(path, list(values), titles or [""])


def write_nts(landmarks: Landmarks) -> str:
    """One specimen, or two where there are fixed places; a line to a landmark, as IDAV's programs read it too."""
    titled, (count, dim) = _specimens(landmarks), landmarks.points.shape
    values = np.concatenate([places for _, places in titled])
    missing = 9999
    while (values == missing).any():  # the mark of a landmark that was not found
        missing = 10 * missing + 9
    rows = "".join(" ".join(map(repr, place)) + "\n" for place in values.tolist())
    titles = "".join(f"{title}\n" for title, _ in titled)
    return f"1 {len(titled)}L {count * dim} 1 {missing} dim={dim}\n{titles}{rows}"


# ---- Morphologika, elastix -------------------------------------------------------------------------------------------


def read_txt(path: Path, text: str) -> Landmarks:
    """Landmarks of a text: Morphologika's sections in brackets, points of elastix or transformix, or bare places."""
    begin = text.lstrip()
    if begin.startswith("["):
        return _read_morphologika(path, text)
    if re.match(r"Point\s+\d+\s*;", begin):
        return _read_transformix(path, text)
    return read_xyz(path, text) if re.match(r"[-+.\d]", begin) else _read_elastix(path, text)


def _read_morphologika(path: Path, text: str) -> Landmarks:
    sections: dict[str, list[tuple[int, str]]] = {}
    for number, line in _number_lines(text):
        if heading := re.fullmatch(r"\s*\[(.+?)\]\s*", line):
            sections[heading[1].strip().lower()] = []
        elif sections:
            sections[next(reversed(sections))].append((number, line))
    counts = {}
    for key in ("individuals", "landmarks", "dimensions"):
        number, word = (sections.get(key) or [(1, "none")])[0]
        counts[key] = _count(path, word.strip(), number)
    rows = [row for row in sections.get("rawpoints", []) if not row[1].lstrip().startswith("'")]
    wanted = counts["individuals"] * counts["landmarks"]
    if len(rows) != wanted or counts["dimensions"] not in (2, 3):
        raise fail(
            path,
            f"it announces {counts['individuals']} individuals of {counts['landmarks']} landmarks in "
            f"{counts['dimensions']} dimensions, and {len(rows)} places follow under [rawpoints].",
        )
    values = _number_rows(path, rows, (counts["dimensions"],))
    return _pair(
        path,
        list(values.reshape(counts["individuals"], -1, counts["dimensions"])),
        [*(line for _, line in sections.get("names", [])), ""],
    )


def write_morphologika(landmarks: Landmarks) -> str:
    """One individual, or two where there are fixed places."""
    titled, (count, dim) = _specimens(landmarks), landmarks.points.shape
    names = "".join(f"{title}\n" for title, _ in titled)
    points = "".join(f"'{title}\n{_rows(places)}" for title, places in titled)
    return (
        f"[individuals]\n{len(titled)}\n[landmarks]\n{count}\n[dimensions]\n{dim}\n[names]\n{names}"
        f"[rawpoints]\n{points}"
    )


def _read_elastix(path: Path, text: str) -> Landmarks:
    lines = _number_lines(text)
    kind = lines[0][1].strip() if len(lines) > 1 else ""
    if kind not in ("point", "index"):
        raise fail(
            path,
            "it is neither Morphologika's ([individuals] ...) nor a list of points of elastix, whose "
            "first line is 'point', nor of places alone.",
        )
    if kind == "index":
        raise fail(path, "it holds indices of voxels, which have no place without their volume.")
    if len(lines) != 2 + _count(path, lines[1][1].strip(), lines[1][0]):
        raise fail(path, f"line {lines[1][0]} announces {lines[1][1].strip()} points, and {len(lines) - 2} follow.")
    return replace(_pair(path, [_number_rows(path, lines[2:])], [""]), unit="mm")  # as all lengths of ITK


def _read_transformix(path: Path, text: str) -> Landmarks:
    """Points that transformix mapped (outputpoints.txt): the inputs, and as fixed places the outputs."""
    found: dict[str, list[tuple[int, str]]] = {"InputPoint": [], "OutputPoint": []}
    for number, line in _number_lines(text):
        for name, rows in found.items():
            place = re.search(rf"{name}\s*=\s*\[([^\]]*)\]", line)
            if place is None:
                raise fail(path, f"line {number} has no {name} = [ ... ], as transformix writes them.")
            rows.append((number, place[1]))
    return replace(_pair(path, [_number_rows(path, rows) for rows in found.values()], [""]), unit="mm")


def write_txt(landmarks: Landmarks) -> str:
    """A list of points of elastix; without fixed places, for which it has no room."""
    return f"point\n{len(landmarks)}\n{_rows(landmarks.points)}"


# ---- lists of places -------------------------------------------------------------------------------------------------


def read_xyz(path: Path, text: str) -> Landmarks:
    """Places in space, one to a line; a fourth number, as of particles, is left out with a note."""
    rows = [(number, line) for number, line in _number_lines(text) if not is_comment(line)]
    values = _number_rows(path, rows, (3, 4))
    notes = ("the fourth number of each line was left out",) if values.shape[1] == 4 else ()
    return _pair(path, [values[:, :3]], [""], notes)


def write_xyz(landmarks: Landmarks) -> str:
    """Places, one to a line; without fixed places, for which it has no room."""
    return _rows(landmarks.points)


# ---- PyGeM -----------------------------------------------------------------------------------------------------------

_PRM_KEYS = ("original control points", "deformed control points")


def read_prm(path: Path, text: str) -> Landmarks:
    """Control points before and after of a PyGeM parameter file; its kernel and radius are not read."""
    found: dict[str, list[tuple[int, str]]] = {}
    key = ""
    for number, line in _number_lines(text):
        name, sign, rest = line.partition(":")
        if is_comment(line) or line.lstrip().startswith("["):
            continue
        if sign:
            key = name.strip().lower()
        found.setdefault(key, []).append((number, rest if sign else line))
    if any(name not in found for name in _PRM_KEYS):
        raise fail(path, "it has no original and deformed control points, as PyGeM has for radial basis functions.")
    before, after = (_number_rows(path, found[name], (3,)) for name in _PRM_KEYS)
    if len(before) != len(after):
        raise fail(path, f"it has {len(before)} original and {len(after)} deformed control points.")
    return drop_missing(path, before, after)


def write_prm(landmarks: Landmarks) -> str:
    """Parameters of PyGeM for radial basis functions: places and fixed places, a thin-plate spline of radius 1.

    PyGeM takes lines that do not begin with a space for keys.
    """
    fixed = landmarks.points if landmarks.fixed is None else landmarks.fixed
    both = zip(_PRM_KEYS, (landmarks.points, fixed), strict=True)
    lists = "".join(f"\n{key}: {_rows(places).rstrip().replace(chr(10), f'{chr(10)}    ')}\n" for key, places in both)
    return "[Radial Basis Functions]\nbasis function: thin_plate_spline\nradius: 1.0\n\n[Control points]" + lists
