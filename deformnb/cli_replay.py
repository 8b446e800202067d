"""The command ``deformnb replay``: a session applied to many files, with progress, resume and a summary."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deformnb.cli_stages import Stage, note, stages
from deformnb.cli_warp import add_spacing, read_grid, read_input
from deformnb.errors import DeformError

if TYPE_CHECKING:
    from collections.abc import Callable

    from deformnb.deformation import Deformation
    from deformnb.volume import Grid


def add_replay(commands: Any) -> None:
    """Add the command to argparse's commands."""
    p = commands.add_parser(
        "replay", help="apply a session to many files, and go on where it was stopped",
        usage="deformnb replay SESSION INPUT [INPUT ...] --out FOLDER [options]",
        description="""Apply a session to many volumes, meshes and landmarks. What is done is remembered beside the
        results: run it again after a stop or an error, and only what is missing or out of date is done.""")
    p.add_argument("session", help="a document written by deformnb (.json)")
    p.add_argument("inputs", nargs="+", metavar="INPUT", help="files, or folders whose files are meant")
    p.add_argument("--out", required=True, metavar="FOLDER", help="folder of the results; made if it is not there")
    p.add_argument("--place", default="as it is", help='"as it is" keeps all coordinates (default); "by the box" lays '
                   "the box of the session's volume on that of each input")
    p.add_argument("--strength", type=float, default=1.0, help="1 as saved, 0 not at all, 2 exaggerated, -1 opposite")
    p.add_argument("--method", help="nearest, linear or cubic (default linear, nearest for labels)")
    p.add_argument("--fill", type=float, help="value outside a volume (default its smallest)")
    p.add_argument("--labels", action="store_true", help="the volumes hold labels: keep their values")
    p.add_argument("--volume", metavar="FILE", help="the volume in whose space meshes and landmarks lie")
    add_spacing(p)
    p.add_argument("--suffix", default="", help="format of the resulting volumes, such as .nii.gz (default as input)")
    p.add_argument("--summary", metavar="FILE", help="write what came of each file as JSON")
    p.add_argument("--force", action="store_true", help="overwrite files that no replay has written")
    p.set_defaults(run=_replay)


def _replay(options: argparse.Namespace) -> None:
    from deformnb.io.atomic import atomic_write, check_target
    from deformnb.io.documents import check_json_target, read_deformation
    from deformnb.replay import as_rows, replay, summary

    _check(options)
    document = read_deformation(options.session)
    if options.strength != 1:
        document = document.blended(options.strength)
    if options.summary:
        check_json_target(options.summary, "a summary")
        check_target(options.summary, overwrite=options.force or _is_summary(Path(options.summary)))
    with stages() as stage:
        results = replay(document, options.inputs, options.out, work=_Work(options, stage),
                         options=_made_with(options, document), suffix=options.suffix, overwrite=options.force)
    print("\n".join(summary(results)))
    if options.summary:
        with atomic_write(options.summary) as file:
            file.write((json.dumps(as_rows(results), indent=1) + "\n").encode())
    failed = sum(r.state == "failed" for r in results)
    if failed:
        raise DeformError(f"{failed} of {len(results)} files failed, see above; the others are done.")


def _is_summary(path: Path) -> bool:
    """Whether an earlier replay has written this file: then the next one may replace it."""
    from deformnb.replay import Replayed

    try:
        rows = json.loads(path.read_bytes())
        names = {field.name for field in fields(Replayed)}
        return isinstance(rows, list) and len(rows) > 0 and all(row.keys() == names for row in rows)
    except (OSError, ValueError, AttributeError, RecursionError):
        return False


def _made_with(options: argparse.Namespace, document: Deformation) -> dict[str, Any]:
    """All that results depend on besides the document's steps and their inputs."""
    from deformnb.replay import stamp

    made = {name: getattr(options, name) for name in ("place", "method", "fill", "labels", "volume", "spacing")}
    if options.volume and Path(options.volume).exists():  # where it is missing and wanted, every file says so
        made["volume_stamp"] = stamp(Path(options.volume))
    if options.place != "as it is" and document.volume is not None:
        made["box"] = repr(document.volume.grid)
    return made


def _check(options: argparse.Namespace) -> None:
    """What would be wrong for every file alike."""
    from deformnb.io.formats import format_of
    from deformnb.io.meshes import is_mesh
    from deformnb.placing import PLACES

    if options.place not in PLACES:
        raise DeformError(f"unknown place {options.place!r}; choose one of {', '.join(PLACES)}.")
    if options.suffix:
        format_of(Path(f"x{options.suffix}"), writing=True)
    if options.volume and is_mesh(options.volume):
        raise DeformError(f"--volume names the volume in whose space meshes lie, and {options.volume} is a mesh.")


class _Work:
    """What is done to one file."""

    def __init__(self, options: argparse.Namespace, stage: Stage) -> None:
        self._options, self._stage = options, stage
        self._grid: Grid | None = None

    def __call__(self, document: Deformation, path: Path, target: Path,
                 progress: Callable[[float], None]) -> Mapping[str, Any]:
        from deformnb.io.landmarks import is_landmarks
        from deformnb.io.meshes import is_mesh
        from deformnb.placing import placed

        if is_mesh(path) or is_landmarks(path):
            grid = self._space(path)
            document = placed(document, grid, self._options.place)
            grid = document.own_grid(grid)
            facts = _facts(document, grid)
            (self._mesh if is_mesh(path) else self._landmarks)(document, grid, path, target)
            return facts
        volume = read_input(str(path), self._options.spacing, self._stage, is_labels=self._options.labels or None)
        document = placed(document, volume.grid, self._options.place)
        # First: what is written must be remembered at once, or counts as foreign.
        facts = _facts(document, document.own_grid(volume.grid))
        self._write(document, volume, target)
        return facts

    def _write(self, document: Deformation, volume: Any, target: Path) -> None:
        from deformnb.io import write_volume

        warped = document.apply(volume, fill=self._options.fill, method=self._options.method,
                                progress=self._stage(f"deform {target.name}"))
        note(*(text for text in warped.notes if text not in volume.notes))
        write_volume(warped, target, progress=self._stage(f"write {target.name}"))

    def _space(self, path: Path) -> Grid:
        if self._options.volume is None:
            raise DeformError(f"{path.name} does not say where its volume lies; name that with --volume FILE.")
        if self._grid is None:
            self._grid = read_grid(self._options.volume, self._options.spacing)
        return self._grid

    def _mesh(self, document: Deformation, grid: Grid, path: Path, target: Path) -> None:
        from deformnb.io.meshes import read_mesh, write_mesh
        from deformnb.surfaces import warp_mesh

        self._stage(f"deform {path.name}")
        moved = warp_mesh(read_mesh(path), document.field(grid))
        note(*moved.notes)
        write_mesh(moved, target)

    def _landmarks(self, document: Deformation, grid: Grid, path: Path, target: Path) -> None:
        from deformnb.io.landmarks import read_landmarks, write_landmarks
        from deformnb.landmarks import warp_landmarks

        self._stage(f"deform {path.name}")
        moved = warp_landmarks(read_landmarks(path), document.field(grid))
        note(*moved.notes)
        write_landmarks(moved, target)


def _facts(document: Deformation, grid: Grid) -> dict[str, Any]:
    """What a summary says of a deformation on a volume."""
    from deformnb.trust import document_folds

    folds = document_folds(document, grid)
    return {"min det J": float(folds.least), "folded": f"{100 * folds.share:.2g} %"}
