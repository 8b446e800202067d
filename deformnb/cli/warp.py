"""Commands ``deformnb warp`` and ``deformnb replay``: a session applied to one volume, or to many files.

``warp`` deforms a volume, and the labels, meshes and landmarks that belong to it. ``replay`` applies the session to
many files, with progress, resume and a summary. Both report notes and the progress of each piece of work.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import io
import json
import shutil
import sys
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deformnb._progress import remaining_time
from deformnb.cli.session_input import STANDARD_INPUT, read_session, refuse_pipes
from deformnb.devices import add_device
from deformnb.errors import DeformError

if TYPE_CHECKING:
    from deformnb._typing import Stage
    from deformnb.chunked.sources import LargeVolume
    from deformnb.document.deformation import Deformation
    from deformnb.rbf.fields import AbstractField
    from deformnb.volume.volume import Grid, Volume

_PATIENCE = 1.0  # seconds of silence


def note(*notes: str) -> None:
    """Remarks on standard error."""
    for text in notes:
        print(f"deformnb: note: {text}", file=sys.stderr)


@contextlib.contextmanager
def stages() -> Iterator[Stage]:
    """A function that begins a piece of work by name and returns the function that receives its progress.

    Work of more than a second shows a progress bar; nothing where standard error is a file or a pipe.
    """
    make = StageBar if sys.stderr.isatty() else SilentStage
    current: list[StageBar | SilentStage] = []

    def stage(name: str) -> Callable[[float], None]:
        while current:
            current.pop().finish()
        current.append(make(name))
        return current[0].move

    try:
        yield stage
    finally:
        while current:
            current.pop().finish()


class StageBar:
    """A progress bar that appears after one second."""

    def __init__(self, name: str) -> None:
        from tqdm import tqdm

        self._start = time.monotonic()
        self._bar = tqdm(
            total=100,
            desc=name,
            delay=_PATIENCE,
            file=sys.stderr,
            leave=True,
            bar_format="{desc:28} {bar} {n:3.0f} % {elapsed}{postfix}",
        )

    def move(self, share: float) -> None:
        self._bar.set_postfix_str(remaining_time(time.monotonic() - self._start, share), refresh=False)
        self._bar.update(max(0.0, 100 * min(share, 1.0) - self._bar.n))

    def finish(self) -> None:
        self._bar.close()


class SilentStage:
    """Work whose progress nobody watches: a file or a pipe holds notes and errors alone."""

    def __init__(self, name: str) -> None:
        self.name = name

    def move(self, share: float) -> None:
        """Take the progress."""

    def finish(self) -> None:
        """End the work."""


# Options for voxels only: (option, its default value).
_OF_VOLUMES = (
    ("method", None),
    ("fill", None),
    ("labels", False),
    ("resolution", None),
    ("margin", None),
    ("animate", False),
    ("volumes", None),
    ("memory", None),
)


def add_warp(commands: Any) -> None:
    """Add the command to argparse's commands."""
    p = commands.add_parser(
        "warp",
        help="apply a session to a volume, a mesh or landmarks",
        description="Apply a session to a volume, or to labels, a mesh or landmarks of it: all end at the same place.",
        usage="deformnb warp SESSION INPUT OUTPUT [options]",
    )
    p.add_argument(
        "session",
        help="a document written by deformnb (.json; - is one from standard input), or a transform (.tfm .h5 .nii.gz "
        ".nrrd .mha .mat .txt .zarr) of ITK, ANTs, elastix or OME-NGFF",
    )
    p.add_argument(
        "input",
        help="the volume to deform, with all its channels and moments, or a mesh (.ply .stl "
        ".obj .vtp) or landmarks (.mrk.json .fcsv "
        ".csv .tps .nts .txt .prm) in its space",
    )
    p.add_argument("output", help="the file to write; its suffix decides the format")
    add_spacing(p)
    add_device(p)
    p.add_argument("--strength", type=float, default=1.0, help="1 as saved, 0 not at all, 2 exaggerated, -1 opposite")
    p.add_argument("--method", help="nearest, linear or cubic (default linear, nearest for labels)")
    p.add_argument("--fill", type=float, help="value outside the volume (default its smallest)")
    p.add_argument("--labels", action="store_true", help="the volume holds labels: preserve their values")
    p.add_argument(
        "--resolution",
        type=float,
        nargs="+",
        metavar="S",
        help="voxel size of the result, one length or three (x y z; default as the input)",
    )
    p.add_argument(
        "--margin",
        nargs="+",
        metavar="M",
        help='field of view: "fit" is as large as the deformed foreground needs, 0 the box of the input; or '
        "a length to add on every side, one or three (x y z), negative crops (default the session's)",
    )
    p.add_argument(
        "--volumes", metavar="FILE", help="for labels: write the volume of each before and after as a table (.csv)"
    )
    p.add_argument(
        "--animate",
        action="store_true",
        help="for a series of moments (4D): each by the moment of the "
        "session's animation, whose key frames are stretched to the series; else one map moves all",
    )
    p.add_argument(
        "--volume",
        metavar="FILE",
        help="for a mesh or landmarks: the volume (or mesh) of the session, in whose space they are",
    )
    p.add_argument(
        "--memory",
        metavar="SIZE",
        help="for a volume that is deformed in parts, into a Zarr folder: what "
        "these take together, such as 2GB (default 1 GiB)",
    )
    p.add_argument("--force", action="store_true", help="overwrite the output if it is there")
    p.set_defaults(run=_warp)


def add_spacing(p: argparse.ArgumentParser) -> None:
    """The option for an error in many files."""
    p.add_argument(
        "--spacing",
        type=float,
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="true voxel size of the input, where its file is wrong",
    )


def _warp(options: argparse.Namespace) -> None:
    from deformnb.io.landmarks.formats import is_landmarks
    from deformnb.io.meshes.formats import is_mesh
    from deformnb.io.transforms.formats import is_transform

    refuse_pipes((options.input, options.output))
    given, target = Path(options.input), Path(options.output)
    follows = _follow_mesh if is_mesh(given) else _follow_landmarks if is_landmarks(given) else None
    if follows is None:
        if options.volume is not None:
            raise DeformError("--volume is for meshes and landmarks; a volume has its own space.")
        _check_output(target, force=options.force)
    else:
        _check_follower(options, target)
    is_piped = options.session == STANDARD_INPUT
    if not is_piped and Path(options.session).suffix.lower() != ".json" and given.suffix.lower() == ".json":
        raise DeformError(
            f"the session comes first: deformnb warp {given.name} {Path(options.session).name} {target.name}."
        )
    if not is_piped and is_transform(options.session, images=True):
        _apply_transform(options, follows)
        print(target)
        return
    document = read_session(options.session)
    with stages() as stage:
        if options.strength != 1:
            document = document.scaled(options.strength)
        if follows is None:
            _warp_volume(document, options, stage)
        else:
            follows(document.field(_space(document, options)), options, stage)
    print(target)


def _apply_transform(options: argparse.Namespace, follows: Any) -> None:
    """Deform by the file of a transform in place of a session."""
    from deformnb.io import is_series, open_series, read_transform, write_volume
    from deformnb.io.transforms.remarks import read_remark
    from deformnb.session.inputs import grid_of_file
    from deformnb.session.series import warp_series
    from deformnb.warping.warper import warp

    name = Path(options.session).name
    if options.strength != 1 or options.resolution or options.margin or options.animate or options.volumes:
        raise DeformError(
            f"{name} is a transform and no session: it is applied as it is, to volumes onto their own "
            "grid (without --strength, --resolution, --margin, --animate, --volumes)."
        )
    is_forward = read_remark(Path(options.session)).startswith("forward")
    if is_forward and follows is not None:
        raise DeformError(f"{name} states a forward map; name the backward transform, against which points move.")
    if is_forward:
        note(f"{name} states a forward map: as a backward map it inverts that transform")
    with stages() as stage:
        if follows is not None:
            follows(read_transform(options.session, grid_of_file(options.volume, options.spacing)), options, stage)
        elif is_series(options.input):
            series = open_series(
                options.input, spacing=options.spacing and tuple(options.spacing), is_labels=options.labels or None
            )
            warp_series(
                series,
                read_transform(options.session, series.grid),
                options.output,
                fill=options.fill,
                method=options.method,
                overwrite=options.force,
                progress=stage("deform"),
            )
        elif _is_in_parts(options):
            source = _open_partly(options, stage)
            _write_parts(source, read_transform(options.session, source.grid), options, stage)
        else:
            volume = read_input(options.input, options.spacing, stage, is_labels=options.labels or None)
            field = read_transform(options.session, volume)
            warped = warp(volume, field, fill=options.fill, method=options.method, progress=stage("deform"))
            write_volume(
                warped, options.output, overwrite=options.force, progress=stage(f"write {Path(options.output).name}")
            )


def _warp_volume(document: Deformation, options: argparse.Namespace, stage: Stage) -> None:
    from deformnb.io import is_series, write_segmentation, write_volume
    from deformnb.io.files.atomic import check_target
    from deformnb.io.volumes.label_names import is_segmentation_file

    if options.volumes:
        check_target(Path(options.volumes), overwrite=options.force)
    if _is_in_parts(options):
        if options.animate or options.volumes:
            raise DeformError(
                f"--{'animate' if options.animate else 'volumes'} is not for volumes that are deformed "
                "in parts, into a Zarr folder (.zarr)."
            )
        _warp_in_parts(document, options, stage)
        return
    if is_series(options.input):
        _warp_series(document, options, stage)
        return
    if options.animate:
        raise DeformError(f"--animate is for a series of moments, and {Path(options.input).name} holds one.")
    target = Path(options.output)
    if options.memory is not None:
        raise DeformError("--memory is for volumes that are deformed in parts, into a Zarr folder (.zarr).")
    volume = read_input(options.input, options.spacing, stage, is_labels=options.labels or None)
    if options.volumes and not volume.is_labels:
        raise DeformError(
            f"--volumes is for labels, and {Path(options.input).name} does not state that it holds any; "
            "add --labels if it does."
        )
    differs = tuple(_difference(document, volume))
    note(*differs)
    output = _output_grid(document, volume, options)
    given = {} if output is None else {"output": output}
    warped = document.apply(volume, fill=options.fill, method=options.method, progress=stage("deform"), **given)
    note(*(text for text in warped.notes if text not in (*volume.notes, *differs)))
    progress = stage(f"write {target.name}")
    if is_segmentation_file(options.input) and target.suffix.lower() == ".nrrd":
        write_segmentation(warped, target, options.input, overwrite=options.force, progress=progress)
    else:
        write_volume(warped, target, overwrite=options.force, progress=progress)
    if options.volumes:
        _write_label_volumes(volume, warped, options)


def _write_label_volumes(before: Volume, after: Volume, options: argparse.Namespace) -> None:
    """Write the volume of each label before and after as a table."""
    from deformnb.analysis import label_volumes
    from deformnb.io import atomic_write, read_label_names

    lines = io.StringIO()
    table = csv.writer(lines, lineterminator="\n")
    cubes = before.grid.unit and f"_{before.grid.unit}3"
    table.writerow(["label", "name", f"before{cubes}", f"after{cubes}", "change_percent"])
    for row in label_volumes(before, after, read_label_names(options.input)):
        table.writerow([row.label, row.name, f"{row.before:.6g}", f"{row.after:.6g}", f"{row.change:.4g}"])
    with atomic_write(options.volumes, overwrite=options.force) as file:
        file.write(lines.getvalue().encode())


def _warp_series(document: Deformation, options: argparse.Namespace, stage: Stage) -> None:
    """Deform all channels and moments of a file, moment by moment; for the options it is the first one that counts."""
    if options.volumes:
        raise DeformError(f"--volumes is for one volume of labels, and {Path(options.input).name} holds several.")
    from deformnb.document.animation import Animation
    from deformnb.io import open_series
    from deformnb.session.series import warp_series

    series = open_series(
        options.input, spacing=options.spacing and tuple(options.spacing), is_labels=options.labels or None
    )
    note(
        *series.notes,
        f"{Path(options.input).name} holds {series.layout}; all are deformed",
        *_difference(document, series.grid),
    )
    output = None
    if options.resolution is not None or options.margin is not None:
        output = _output_grid(document, next(iter(series)).brightness(), options)
    given: dict[str, Any] = {} if output is None else {"output": output}
    target = Path(options.output)
    warp_series(
        series,
        Animation(document) if options.animate else document,
        target,
        fill=options.fill,
        method=options.method,
        overwrite=options.force,
        progress=stage(f"deform to {target.name}"),
        **given,
    )


def _is_in_parts(options: argparse.Namespace) -> bool:
    """Check whether a volume is deformed block by block: Zarr on either side, or too large for the memory.

    Raises
    ------
    DeformError
        If it is too large and the output is no Zarr folder.
    """
    from deformnb.io.files.errors import human_bytes
    from deformnb.io.files.memory import default_limit
    from deformnb.io.meshes.formats import is_mesh
    from deformnb.io.volumes.formats import describe_file
    from deformnb.io.volumes.ome_zarr import ZARR_SUFFIX, is_zarr

    to_zarr = options.output.lower().endswith(ZARR_SUFFIX)
    if to_zarr or is_mesh(options.input):
        return to_zarr
    given = Path(options.input.partition("::")[0])
    if not given.exists():
        return False
    # An output that is no Zarr folder is held in memory, together with the input.
    needed = describe_file(given).memory_bytes if is_zarr(given) else 0
    if 2 * needed > default_limit():
        raise DeformError(
            f"{given.name} takes {human_bytes(needed)} of memory, too much to be written in one piece; "
            f"name an output that ends in {ZARR_SUFFIX}, which is written in parts."
        )
    return False


def _warp_in_parts(document: Deformation, options: argparse.Namespace, stage: Stage) -> None:
    """Deform block by block into a Zarr folder; finished blocks of a stopped run are reused."""
    from deformnb.document.output_grid import output_grid
    from deformnb.volume.volume import Volume

    source = _open_partly(options, stage)
    grid = source.grid
    if not any(
        document.own_grid(level) == level and not document.difference(level) for level in (grid, *source.levels)
    ):  # a document that was made on a coarser level belongs to all of them
        note(*_difference(document, grid))
    known = (*source.notes, document.difference(grid))
    output = None
    if options.resolution is not None or options.margin is not None:
        margin = _lengths(options.margin)
        if margin == "fit":
            raise DeformError(
                "--margin fit needs all voxels in memory; give lengths for a volume that is deformed in parts."
            )
        import numpy as np

        empty = Volume(np.broadcast_to(np.uint8(0), grid.shape), grid)
        output = output_grid(document, empty, spacing=_lengths(options.resolution), margin=margin).grid
    note(*document.notes(grid))
    notes = _write_parts(source, document, options, stage, output)
    note(*(text for text in notes if text not in known))


def _open_partly(options: argparse.Namespace, stage: Stage) -> LargeVolume:
    from deformnb.chunked import open_volume, unpack
    from deformnb.chunked.unpacking import needs_unpacking

    given, name = options.input, Path(options.input).name
    if needs_unpacking(given):
        given = _unpacked_path(options)
        if not given.exists():
            note(f"{name} takes more memory than there is and cannot be read in parts: it is written as Zarr first")
            unpack(options.input, given, progress=stage(f"unpack {name}"))
    stage(f"open {name}")
    source = open_volume(
        given,
        spacing=options.spacing and tuple(options.spacing),
        is_labels=options.labels or None,
        name=None if given is options.input else name,
    )
    note(*source.notes)
    return source


def _unpacked_path(options: argparse.Namespace) -> Path:
    """Path to unpack the input to, next to the output, until that is complete; another input has another name."""
    about, target = Path(options.input.partition("::")[0]).stat(), Path(options.output)
    return target.with_name(f".{target.name}.{about.st_size}-{about.st_mtime_ns}.source.zarr")


def _write_parts(
    source: LargeVolume,
    deformation: Deformation | AbstractField,
    options: argparse.Namespace,
    stage: Stage,
    output: Grid | None = None,
) -> tuple[str, ...]:
    from deformnb.chunked import warp

    made = warp(
        source,
        deformation,
        options.output,
        output=output,
        fill=options.fill,
        method=options.method,
        memory=options.memory,
        overwrite=options.force,
        progress=stage("deform"),
    )
    shutil.rmtree(_unpacked_path(options), ignore_errors=True)
    notes: tuple[str, ...] = made.notes
    return notes


def _follow_mesh(field: AbstractField, options: argparse.Namespace, stage: Stage) -> None:
    from deformnb.io.meshes.formats import read_mesh, write_mesh
    from deformnb.warping.mesh import warp_mesh

    stage(f"read {Path(options.input).name}")
    mesh = read_mesh(options.input)
    stage("deform")
    moved = warp_mesh(mesh, field)
    note(*moved.notes)
    write_mesh(moved, options.output, overwrite=options.force)


def _follow_landmarks(field: AbstractField, options: argparse.Namespace, stage: Stage) -> None:
    from deformnb.io.landmarks.formats import read_landmarks, write_landmarks
    from deformnb.io.landmarks.markups import is_markups, warp_markups
    from deformnb.warping.points import warp_landmarks

    if is_markups(options.input) and is_markups(options.output):  # all that Slicer has set stays
        stage("deform")
        note(*warp_markups(options.input, options.output, field, overwrite=options.force))
        return
    landmarks = read_landmarks(options.input)
    stage("deform")
    moved = warp_landmarks(landmarks, field)
    note(*moved.notes)
    write_landmarks(moved, options.output, overwrite=options.force)


def _check_follower(options: argparse.Namespace, target: Path) -> None:
    """Refuse options that do not apply to a mesh or landmarks, and check the output path."""
    from deformnb.io.files.atomic import check_target
    from deformnb.io.landmarks.formats import check_landmark_target
    from deformnb.io.meshes.formats import check_mesh_target, is_mesh

    name = Path(options.input).name
    for option, absent in _OF_VOLUMES:
        if getattr(options, option) != absent:
            raise DeformError(f"--{option} is for volumes, and {name} is none.")
    if options.volume is None:
        raise DeformError(f"name the volume of the session with --volume FILE: {name} does not have its place.")
    check: Callable[[Path], object] = check_mesh_target if is_mesh(name) else check_landmark_target
    check(target)
    check_target(target)
    _refuse_present(target, force=options.force)


def _space(document: Deformation, options: argparse.Namespace) -> Grid:
    """The grid of the volume of a session, from the header of its file."""
    from deformnb.session.inputs import grid_of_file

    grid = grid_of_file(options.volume, options.spacing)
    note(*_difference(document, grid), *document.notes(grid))
    return document.own_grid(grid)


def _check_output(target: Path, *, force: bool) -> None:
    """Check the output path, whose faults would only be noticed after the work."""
    from deformnb.io.files.atomic import check_target
    from deformnb.io.volumes.formats import find_format

    _, entry = find_format(target, writing=True)
    check_target(target, folder_marks=entry.folder_marks)
    _refuse_present(target, force=force)


def _refuse_present(target: Path, *, force: bool) -> None:
    if target.exists() and not force:
        raise DeformError(f"{target} is already there; choose another name, or --force to overwrite it.")


def _difference(document: Deformation, volume: Volume | Grid) -> Iterator[str]:
    """Reasons why the result may differ from the one that the author of a session saw, and the option that may help."""
    from deformnb.volume.volume import as_grid

    found, made, grid = document.difference(volume), document.volume, document.own_grid(as_grid(volume))
    if found:
        yield found
    if found and made is not None and made.shape == grid.shape and made.spacing != grid.spacing:
        yield f"--spacing {' '.join(f'{s:g}' for s in made.spacing)} reads the file with the voxels of the session."


def _output_grid(document: Deformation, volume: Volume, options: argparse.Namespace) -> Grid | None:
    """The grid that the options request, for which there is memory; None is the document's own."""
    from deformnb.analysis.extent import MOST
    from deformnb.document.output_grid import output_grid
    from deformnb.io.files.memory import check_room

    found = output_grid(document, volume, spacing=_lengths(options.resolution), margin=_lengths(options.margin))
    check_room(volume, found.grid)
    if found.is_limited:
        note(f"the deformed foreground needs more than {MOST:g} times the voxels of the volume; the rest is cut off.")
    return None if options.resolution is None and options.margin is None else found.grid


def _lengths(given: Sequence[float | str] | None) -> Any:
    """The lengths of an option, or its one word."""
    if given is None:
        return None
    try:
        lengths = [float(length) for length in given]
    except ValueError:
        return " ".join(map(str, given))
    return lengths[0] if len(lengths) == 1 else lengths


def read_input(path: str, spacing: Sequence[float] | None, stage: Stage, *, is_labels: bool | None = None) -> Volume:
    """A volume of a file, whose notes are printed; see :func:`deformnb.session.inputs.volume_from`."""
    from deformnb.session.inputs import volume_from

    volume = volume_from(path, spacing=spacing, is_labels=is_labels, progress=stage(f"read {Path(path).name}"))
    note(*volume.notes)
    return volume


def add_replay(commands: Any) -> None:
    """Add the command to argparse's commands."""
    p = commands.add_parser(
        "replay",
        help="apply a session to many files, and resume after a stop",
        usage="deformnb replay SESSION INPUT [INPUT ...] --out FOLDER [options]",
        description="""Apply a session to many volumes, meshes and landmarks. Progress is stored next to the
        results: run it again after a stop or an error, and only missing or outdated results are computed.""",
    )
    p.add_argument("session", help="a document written by deformnb (.json); - is one from standard input")
    p.add_argument("inputs", nargs="+", metavar="INPUT", help="files, or folders whose files are meant")
    p.add_argument("--out", required=True, metavar="FOLDER", help="folder of the results; made if it is not there")
    p.add_argument(
        "--align",
        default="none",
        help='"none" preserves all coordinates (default); "box" maps the box of '
        "the session's volume to that of each input",
    )
    p.add_argument("--strength", type=float, default=1.0, help="1 as saved, 0 not at all, 2 exaggerated, -1 opposite")
    p.add_argument("--method", help="nearest, linear or cubic (default linear, nearest for labels)")
    p.add_argument("--fill", type=float, help="value outside a volume (default its smallest)")
    p.add_argument("--labels", action="store_true", help="the volumes hold labels: preserve their values")
    p.add_argument("--volume", metavar="FILE", help="the volume in whose space meshes and landmarks are")
    add_spacing(p)
    add_device(p)
    p.add_argument("--suffix", default="", help="format of the resulting volumes, such as .nii.gz (default as input)")
    p.add_argument("--summary", metavar="FILE", help="write what came of each file as JSON")
    p.add_argument("--force", action="store_true", help="overwrite files that no replay has written")
    p.set_defaults(run=_replay)


def _replay(options: argparse.Namespace) -> None:
    from deformnb.io.documents import check_json_target
    from deformnb.io.files.atomic import atomic_write, check_target
    from deformnb.session.batch import as_rows, replay, summary

    refuse_pipes((*options.inputs, options.out))
    _check(options)
    document = read_session(options.session)
    if options.strength != 1:
        document = document.scaled(options.strength)
    if options.summary:
        check_json_target(options.summary, "a summary")
        check_target(options.summary, overwrite=options.force or _is_summary(Path(options.summary)))
    with stages() as stage:
        results = replay(
            document,
            options.inputs,
            options.out,
            work=_Work(options, stage),
            options=_provenance(options, document),
            suffix=options.suffix,
            overwrite=options.force,
        )
    print("\n".join(summary(results)))
    if options.summary:
        with atomic_write(options.summary) as file:
            file.write((json.dumps(as_rows(results), indent=1) + "\n").encode())
    failed = sum(r.state == "failed" for r in results)
    if failed:
        raise DeformError(f"{failed} of {len(results)} files failed, see above; the others are done.")


def _is_summary(path: Path) -> bool:
    """Check whether an earlier replay has written this file: then the next one may replace it."""
    from deformnb.session.batch import Replayed

    try:
        rows = json.loads(path.read_bytes())
        names = {field.name for field in fields(Replayed)}
        return isinstance(rows, list) and len(rows) > 0 and all(row.keys() == names for row in rows)
    except (OSError, ValueError, AttributeError, RecursionError):
        return False


def _provenance(options: argparse.Namespace, document: Deformation) -> dict[str, Any]:
    """Dependencies of the results besides the document's steps and their inputs."""
    from deformnb.session.batch import stamp

    made = {name: getattr(options, name) for name in ("align", "method", "fill", "labels", "volume", "spacing")}
    if options.volume and Path(options.volume).exists():  # where it is missing and needed, every file reports it
        made["volume_stamp"] = stamp(Path(options.volume))
    if options.align != "none" and document.volume is not None:
        made["box"] = repr(document.volume.grid)
    return made


def _check(options: argparse.Namespace) -> None:
    """Check for faults that would be the same for every file."""
    from deformnb.document.transplant import ALIGNMENTS
    from deformnb.io.meshes.formats import is_mesh
    from deformnb.io.volumes.formats import find_format

    if options.align not in ALIGNMENTS:
        raise DeformError(f"unknown alignment {options.align!r}; choose one of {', '.join(ALIGNMENTS)}.")
    if options.suffix:
        find_format(Path(f"x{options.suffix}"), writing=True)
    if options.volume and is_mesh(options.volume):
        raise DeformError(f"--volume names the volume in whose space meshes are, and {options.volume} is a mesh.")


class _Work:
    """Work on one file."""

    def __init__(self, options: argparse.Namespace, stage: Stage) -> None:
        self._options, self._stage = options, stage
        self._grid: Grid | None = None

    def __call__(
        self, document: Deformation, path: Path, target: Path, progress: Callable[[float], None]
    ) -> Mapping[str, Any]:
        from deformnb.document.transplant import transplant
        from deformnb.io.landmarks.formats import is_landmarks
        from deformnb.io.meshes.formats import is_mesh

        if is_mesh(path) or is_landmarks(path):
            grid = self._space(path)
            document = transplant(document, grid, self._options.align)
            self._note_difference(document, grid, path)
            grid = document.own_grid(grid)
            facts = _facts(document, grid)
            (self._mesh if is_mesh(path) else self._landmarks)(document, grid, path, target)
            return facts
        volume = read_input(str(path), self._options.spacing, self._stage, is_labels=self._options.labels or None)
        document = transplant(document, volume.grid, self._options.align)
        differs = self._note_difference(document, volume.finest_grid, path)
        # First: a written file must be recorded immediately, or counts as foreign.
        facts = _facts(document, document.own_grid(volume.grid))
        self._write(document, volume, target, differs)
        return facts

    def _note_difference(self, document: Deformation, grid: Grid, path: Path) -> tuple[str, ...]:
        """Note, with the name of the file, that the session was made on another grid; returns the sentences."""
        found = tuple(_difference(document, grid))
        if found and document.volume is not None and document.volume.grid is not None:
            found += ("--align box maps the box of the session's volume to that of each input.",)
        note(*([f"{path.name}: {' '.join(found)}"] if found else []))
        return found

    def _write(self, document: Deformation, volume: Volume, target: Path, noted: Collection[str]) -> None:
        from deformnb.io import write_volume
        from deformnb.io.files.memory import check_room

        check_room(volume, document.output)
        warped = document.apply(
            volume, fill=self._options.fill, method=self._options.method, progress=self._stage(f"deform {target.name}")
        )
        note(*(text for text in warped.notes if text not in (*volume.notes, *noted)))
        write_volume(warped, target, progress=self._stage(f"write {target.name}"))

    def _space(self, path: Path) -> Grid:
        if self._options.volume is None:
            raise DeformError(f"{path.name} does not have the place of its volume; name that with --volume FILE.")
        if self._grid is None:
            from deformnb.session.inputs import grid_of_file

            self._grid = grid_of_file(self._options.volume, self._options.spacing)
        return self._grid

    def _mesh(self, document: Deformation, grid: Grid, path: Path, target: Path) -> None:
        from deformnb.io.meshes.formats import read_mesh, write_mesh
        from deformnb.warping.mesh import warp_mesh

        self._stage(f"deform {path.name}")
        moved = warp_mesh(read_mesh(path), document.field(grid))
        note(*moved.notes)
        write_mesh(moved, target)

    def _landmarks(self, document: Deformation, grid: Grid, path: Path, target: Path) -> None:
        from deformnb.io.landmarks.formats import read_landmarks, write_landmarks
        from deformnb.warping.points import warp_landmarks

        self._stage(f"deform {path.name}")
        moved = warp_landmarks(read_landmarks(path), document.field(grid))
        note(*moved.notes)
        write_landmarks(moved, target)


def _facts(document: Deformation, grid: Grid) -> dict[str, Any]:
    """Facts of a summary about a deformation on a volume."""
    from deformnb.document.step_checks import document_folds

    folds = document_folds(document, grid)
    return {"min det J": float(folds.least), "folded": f"{100 * folds.share:.2g} %"}
