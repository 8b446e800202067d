"""Reading and writing deformations as JSON files."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from deformnb.deformation import Deformation, Step
from deformnb.document import LONGEST, from_json, to_json
from deformnb.errors import DeformError, VolumeFileError
from deformnb.io.atomic import atomic_write


def read_deformation(path: str | PathLike[str]) -> Deformation:
    """The deformation in a file.

    Raises
    ------
    DeformError
        In one sentence, if the file is missing, is no deformnb document, is cut short, or is of a newer version.
    """
    file = Path(path)
    if not file.is_file():
        raise VolumeFileError(f"there is no file {file}." if not file.exists() else f"{file} is a folder, not a file.")
    try:
        with file.open("rb") as stream:
            data = stream.read(LONGEST + 1)
    except OSError as error:
        raise VolumeFileError(f"{file} cannot be read: {error.strerror}.") from None
    try:
        return from_json(data)
    except DeformError as error:
        raise DeformError(f"{file.name}: {error}") from None


def write_deformation(deformation: Deformation, path: str | PathLike[str]) -> None:
    """Write a deformation to a file, whole or not at all."""
    with atomic_write(path) as stream:
        stream.write(to_json(deformation).encode("utf-8"))


def describe_document(path: str | PathLike[str]) -> dict[str, str]:
    """What is in a document, for people: what was done on which volume."""
    deformation = read_deformation(path)
    rows = {"file": str(path), "kind": "deformation", "name": deformation.name or "(none)"}
    if deformation.volume is not None:
        v = deformation.volume
        rows["made on"] = f"{v.name or '(unnamed)'}, shape {v.shape}, spacing {v.spacing}, sha256 {v.sha256[:12]}"
    for k, step in enumerate(deformation.steps):
        rows[f"step {k + 1}"] = _describe_step(step)
    return rows


def _describe_step(step: Step) -> str:
    normal = None if step.plane is None else tuple(round(c, 4) for c in step.plane.normal)
    where = "in space" if normal is None else f"on the plane with normal {normal}"
    support = "automatic" if step.support is None else f"{step.support:g}"
    rule = {"modulate": f"modulate by {step.curve}" if isinstance(step.curve, str) else "modulate by a table",
            "interpolate": f"interpolate at {step.knots}"}.get(step.extrusion, step.extrusion)
    count = " + ".join(str(len(m)) for m in step.maps)
    state = "" if step.enabled else ", switched off"
    name = f"{step.name}: " if step.name else ""
    return (f"{name}{count} control points {where}, {step.kernel} with support {support}, {step.trend} trend, {rule}, "
            f"strength {step.strength:g}{state}")
