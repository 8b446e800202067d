"""Deformation documents as JSON files: reading, writing and description."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import BinaryIO, cast

from deformnb.checks import short_value
from deformnb.document.deformation import Deformation, Step
from deformnb.document.json_format import LONGEST_DOCUMENT, from_json, to_json
from deformnb.errors import DeformError, VolumeFileError
from deformnb.io.files.addresses import input_path
from deformnb.io.files.atomic import KnownFiles, atomic_write
from deformnb.io.files.errors import fail, printable
from deformnb.io.files.objects import check_open, copied_to_disk, is_open_file
from deformnb.io.files.paths import address_of, as_path
from deformnb.io.volumes.formats import FORMATS
from deformnb.rbf.cuts import Cut
from deformnb.rbf.rigid import RigidPart

_HERE = KnownFiles()  # of all that belongs to no session

# The markups of 3D Slicer, and the side files of arrays.
_OTHER_JSON = (".bigwarp.json", ".mrk.json", ".npy.json", ".raw.json")


def read_deformation(path: str | PathLike[str] | BinaryIO) -> Deformation:
    """The deformation in a file.

    Raises
    ------
    DeformError
        In one sentence, if the file is missing, is no deformnb document, is cut short, or is of a newer version.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from deformnb.document.json_format import to_json
    >>> file = Path(tempfile.mkdtemp()) / "nothing.json"
    >>> _ = file.write_text(to_json(Deformation()), encoding="utf-8")
    >>> read_deformation(file) == Deformation()
    True
    """
    if is_open_file(path):
        with copied_to_disk(path, "file.json") as copy:
            return read_document(copy)[0]
    file = cast("str | PathLike[str]", path)
    document, content = read_document(file)
    if not address_of(file):
        _HERE.remember(file, content)
    return document


def read_document(path: str | PathLike[str]) -> tuple[Deformation, bytes]:
    """The deformation in a file, and the file's content; see :func:`read_deformation`."""
    file, name = input_path(path), printable(path)
    try:
        if not file.is_file():
            what = "is a folder, not a file" if file.is_dir() else "is not an ordinary file"
            raise VolumeFileError(f"{name} {what}." if file.exists() else f"there is no file {name}.")
        with file.open("rb") as stream:
            data = stream.read(LONGEST_DOCUMENT + 1)
    except (OSError, ValueError) as error:  # a name with a NUL
        if isinstance(error, VolumeFileError):
            raise
        raise VolumeFileError(
            f"{name} cannot be read: {getattr(error, 'strerror', None) or printable(error)}."
        ) from None
    try:
        return from_json(data), data
    except DeformError as error:
        raise DeformError(f"{printable(file.name)}: {error}") from None


def write_deformation(
    deformation: Deformation,
    path: str | PathLike[str] | BinaryIO,
    *,
    known: KnownFiles | None = None,
    overwrite: bool = True,
) -> None:
    """Write a deformation to a file, atomically, or to an open one.

    Parameters
    ----------
    path : ends in ``.json`` or has no suffix, or is an open file of bytes; any other is that of another kind of file.
    known : with ``overwrite=False``, files that may still be replaced while their content is the one from when they
        were last read or written; default are those of :func:`read_deformation` and of this function in this process.
        This one is known afterwards.
    overwrite : whether an existing file may be replaced.

    Raises
    ------
    VolumeFileError
        If the path ends otherwise.
    FileChangedError
        With ``overwrite=False``, if the file is there and is not known, or was changed since.

    Examples
    --------
    >>> write_deformation(Deformation(), "drag.tfm")
    Traceback (most recent call last):
    ...
    deformnb.errors.VolumeFileError: drag.tfm: a deformation is written as JSON, and .tfm is another kind of file;
    name it drag.json (write_transform(deformation, path, volume) writes a transform of ITK).
    """
    if not isinstance(deformation, Deformation):
        raise DeformError(
            f"a Deformation is needed to be written, got {short_value(deformation)}; a field is written "
            "by write_transform(field, path, grid)."
        )
    data = to_json(deformation).encode("utf-8")
    if is_open_file(path):
        check_open(path, "wb")
        path.write(data)
        return
    file = cast("str | PathLike[str]", path)
    check_json_target(file, "a deformation")
    files = _HERE if known is None else known
    if overwrite:
        writing = atomic_write(file)
    else:
        files.check(file)
        writing = atomic_write(file, overwrite=files.has(file), replacing=files.replacing)
    with writing as stream:
        stream.write(data)
    files.remember(file, data)


def check_json_target(path: str | PathLike[str], what: str) -> None:
    """Refuse to write JSON to a path with another suffix than ``.json``, or with that of another kind of JSON.

    Raises
    ------
    VolumeFileError
        With a valid name, and the writer of volumes if the path has a suffix of one.
    """
    place = as_path(path)
    name, suffix = place.name, "".join(place.suffixes[-2:]).lower()
    if place.suffix.lower() in ("", ".json") and suffix not in _OTHER_JSON:
        return
    ending = suffix if suffix in _OTHER_JSON or suffix == ".nii.gz" else place.suffix
    stem = name[: len(name) - len(ending)].removesuffix(".json")
    volume = (
        " (write_volume(deformation.apply(volume), path) writes the deformed volume)"
        if any(name.lower().endswith(row.suffixes) for row in FORMATS.values())
        else ""
    )
    if place.suffix.lower() in (".tfm", ".h5", ".zarr"):
        volume = " (write_transform(deformation, path, volume) writes a transform of ITK)"
    raise fail(
        place,
        f"{what} is written as JSON, and {ending} is another kind of file; name it {printable(stem)}.json{volume}.",
    )


def describe_document(path: str | PathLike[str]) -> dict[str, str]:
    """Describe a document for people: its edits, and the volume on which they were made."""
    return describe_deformation(read_deformation(path), printable(path))


def describe_deformation(deformation: Deformation, name: str) -> dict[str, str]:
    """Describe a deformation for people, under the name of its file."""
    rows = {"file": name, "kind": "deformation", "name": printable(deformation.name) or "(none)"}
    if deformation.volume is not None:
        v = deformation.volume
        voxels = " x ".join(str(n) for n in v.shape[::-1])
        spacing = " x ".join(f"{s:.6g}" for s in v.spacing)
        rows["made on"] = (
            f"{printable(v.name) or '(unnamed)'}, {voxels} voxels (x, y, z) of {spacing}, sha256 {v.sha256[:12]}..."
        )
    for k, step in enumerate(deformation.steps):
        rows[f"step {k + 1}"] = _describe_step(step)
    if deformation.mode != "compose":
        rows["mode"] = f"{deformation.mode}: the displacements of all steps are added up"
    if deformation.keyframes:
        times = ", ".join(f"{key.time:g}" for key in deformation.keyframes)
        rows["animation"] = f"{len(deformation.keyframes)} key frames at {times} s"
    return rows


def _describe_step(step: Step) -> str:
    normal = None if step.plane is None else tuple(round(c, 4) for c in step.plane.normal)
    where = "in space" if normal is None else f"on the plane with normal {normal}"
    radius = step.chosen_support.radius if step.chosen_support else step.support
    support = f"{radius:g}" if isinstance(radius, float) else "automatic"
    curve, knots = printable(step.curve) if isinstance(step.curve, str) else "a table", [f"{k:g}" for k in step.knots]
    rule = {"modulate": f"modulate by {curve}", "interpolate": f"interpolate at depths {', '.join(knots)}"}.get(
        step.extrusion, step.extrusion
    )
    count = " + ".join(str(len(m)) for m in step.maps)
    shapes = "".join(
        f", {_describe_shapes(what, given)}"
        for what, given in (("rigid part(s)", step.parts), (f"cut(s) by the rule {step.cut_rule}", step.cuts))
        if given
    )
    state = "" if step.enabled else ", switched off"
    stages = "" if step.stages == 1 else f", in {step.stages} stages"
    name = f"{printable(step.name)}: " if step.name else ""
    points = "control point" if count == "1" else "control points"
    return (
        f"{name}{count} {points} {where}, {step.kernel} with support {support}, {step.trend} trend, {rule}, "
        f"strength {step.strength:g}{stages}{shapes}{state}"
    )


def _describe_shapes(what: str, shapes: Sequence[RigidPart] | Sequence[Cut]) -> str:
    names = []
    for shape in shapes:
        kind = shape.region.kind.replace("_", " ")
        moved = " that moves" if isinstance(shape, RigidPart) and shape.motion is not None else ""
        off = ", switched off" if not shape.enabled else ""
        names.append(f"{printable(shape.name) + ', ' if shape.name else ''}a {kind}{moved}{off}")
    return f"{len(shapes)} {what} ({'; '.join(names)})"
