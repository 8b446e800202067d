"""Command ``deformnb info``: what is in a file, as a table for people or as one document of JSON."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from deformnb.cli.output import add_json, print_json
from deformnb.cli.session_input import STANDARD_INPUT, read_session
from deformnb.errors import DeformError, UnknownKindError

if TYPE_CHECKING:
    from deformnb.document.deformation import Deformation, Step
    from deformnb.io.volumes.formats import FileDescription

_OtherKind = Literal["transform", "landmarks", "mesh", "session"]


def add_info(commands: Any) -> None:
    """Add the command to argparse's commands."""
    what = "describe a file: a volume, a session, a transform, a mesh or landmarks"
    p = commands.add_parser("info", help=what, description=f"{what.capitalize()}.")
    p.add_argument(
        "file",
        help="a volume, a folder of slices, a session (.json), a transform, a mesh or landmarks; "
        "- is a session from standard input",
    )
    add_json(p)
    p.set_defaults(run=_info)


def _info(options: argparse.Namespace) -> None:
    from deformnb.io.documents import describe_deformation
    from deformnb.io.files.paths import as_path

    if options.file == STANDARD_INPUT:
        document = read_session(STANDARD_INPUT)
        _show(options, describe_deformation(document, "-"), lambda: session_facts(document, "-"))
        return
    path = as_path(options.file)
    found = _recognize(path)
    if not isinstance(found, str):
        _show(options, found.rows(), lambda: volume_facts(found))
    elif options.json:
        print_json(_facts(found, path))
    else:
        _print_rows(_rows(found, path))


def _show(options: argparse.Namespace, rows: dict[str, str], facts: Any) -> None:
    if options.json:
        print_json(facts())
    else:
        _print_rows(rows)


def _print_rows(rows: dict[str, str]) -> None:
    wide = max(len(key) for key in rows)
    print("\n".join(f"{key:{wide}}  {value}" for key, value in rows.items()))


def _recognize(path: Path) -> FileDescription | _OtherKind:
    """The description of a volume, or which other kind of file this is."""
    from deformnb.io import describe_file
    from deformnb.io.transforms.remarks import read_remark

    try:  # first, since it does without JAX
        return "transform" if read_remark(path) else describe_file(path)
    except UnknownKindError as error:
        return _other_kind(path, error)


def _other_kind(path: Path, error: UnknownKindError) -> _OtherKind:
    from deformnb.io.landmarks.formats import is_landmarks, landmark_suffixes
    from deformnb.io.meshes.formats import is_mesh, mesh_suffixes
    from deformnb.io.transforms.formats import is_transform_file, transform_suffixes

    if is_transform_file(path):
        return "transform"
    if is_landmarks(path):
        return "landmarks"
    if is_mesh(path):
        return "mesh"
    if path.suffix.lower() == ".json" and not path.is_dir():
        return "session"
    raise DeformError(
        f"{error} Surfaces ({mesh_suffixes()}), landmarks ({landmark_suffixes()}), transforms "
        f"({transform_suffixes()}) and sessions (.json) are known too."
    ) from None


def _rows(kind: _OtherKind, path: Path) -> dict[str, str]:
    from deformnb.io.documents import describe_document
    from deformnb.io.landmarks.formats import describe_landmarks
    from deformnb.io.meshes.formats import describe_mesh
    from deformnb.io.transforms.formats import describe_transform

    describe = {
        "transform": describe_transform,
        "landmarks": describe_landmarks,
        "mesh": describe_mesh,
        "session": describe_document,
    }
    return describe[kind](path)


def _facts(kind: _OtherKind, path: Path) -> dict[str, Any]:
    if kind == "session":
        return session_facts(read_session(str(path)), path.name)
    return {"transform": _transform_facts, "landmarks": _landmark_facts, "mesh": _mesh_facts}[kind](path)


# ---- JSON; docs/howto/command_line.md lists the keys -----------------------------------------------------------------


def volume_facts(found: FileDescription) -> dict[str, Any]:
    """A volume as values of JSON; lists of lengths are in the order x, y, z."""
    grid = found.grid
    return {
        "kind": "volume",
        "file": found.name,
        "format": found.format,
        "voxels": list(grid.shape[::-1]),
        "moments": found.moments,
        "channels": found.channels,
        "type": str(found.dtype),
        "spacing": list(grid.spacing),
        "origin": list(grid.origin),
        "direction": [list(row) for row in grid.direction],
        "orientation": grid.orientation,
        "unit": grid.unit,
        "labels": found.is_labels,
        "file_bytes": found.file_bytes,
        "memory_bytes": found.memory_bytes,
        "notes": list(found.notes),
    }


def session_facts(document: Deformation, name: str) -> dict[str, Any]:
    """A session as values of JSON, with the number of points of each step."""
    made_on = document.volume
    return {
        "kind": "session",
        "file": name,
        "format": "deformation",
        "name": document.name,
        "made_on": None
        if made_on is None
        else {
            "name": made_on.name,
            "voxels": list(made_on.shape[::-1]),
            "spacing": list(made_on.spacing),
            "sha256": made_on.sha256,
        },
        "mode": document.mode,
        "steps": [_step_facts(step) for step in document.steps],
        "key_frames": [key.time for key in document.keyframes],
        "notes": [],
    }


def _step_facts(step: Step) -> dict[str, Any]:
    return {
        "name": step.name,
        "points": sum(len(points) for points in step.maps),
        "plane_normal": None if step.plane is None else [float(part) for part in step.plane.normal],
        "kernel": str(step.kernel),
        "trend": step.trend,
        "extrusion": step.extrusion,
        "strength": step.strength,
        "enabled": step.enabled,
    }


def _transform_facts(path: Path) -> dict[str, Any]:
    from deformnb.io.transforms.formats import describe_transform
    from deformnb.io.transforms.remarks import read_remark

    rows, stated = describe_transform(path), read_remark(path)
    return {
        "kind": "transform",
        "file": rows["file"],
        "format": rows["kind"],
        "maps": stated.partition(":")[0] or "backward",
        "is_stated": bool(stated),
        "parts": [text for key, text in rows.items() if key.startswith("part ")],
        "notes": [],
    }


def _landmark_facts(path: Path) -> dict[str, Any]:
    from deformnb.io.landmarks.formats import check_landmark_target, read_landmarks

    found = read_landmarks(path)
    return {
        "kind": "landmarks",
        "file": path.name,
        "format": check_landmark_target(path).description,
        "landmarks": len(found),
        "names": list(found.names),
        "from": found.points.min(axis=0).tolist(),
        "to": found.points.max(axis=0).tolist(),
        "pairs": found.fixed is not None,
        "unit": found.unit,
        "notes": list(found.notes),
    }


def _mesh_facts(path: Path) -> dict[str, Any]:
    from deformnb.io.meshes.formats import check_mesh_target, read_mesh

    mesh = read_mesh(path)
    low, high = mesh.box
    return {
        "kind": "mesh",
        "file": path.name,
        "format": check_mesh_target(path).description,
        "corners": len(mesh.points),
        "faces": len(mesh.faces),
        "from": [float(c) for c in low],
        "to": [float(c) for c in high],
        "closed": mesh.is_closed,
        "unit": mesh.unit,
        "notes": list(mesh.notes),
    }
