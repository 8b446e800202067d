"""The command ``deformnb``: demo, app, lab, warp, info, datasets, doctor.

Errors are one sentence on standard error and exit code 2; Ctrl-C is 130. Work of more than a second shows a bar.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import shlex
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn, TypeAlias

from deformnb.errors import Cancelled, DeformError

if TYPE_CHECKING:
    from deformnb.deformation import Deformation
    from deformnb.volume import Grid, Volume

EXIT_ERROR = 2
EXIT_INTERRUPTED = 130

_PATIENCE = 1.0  # seconds of silence

Stage: TypeAlias = Callable[[str], Callable[[float], None]]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    given = sys.argv[1:] if arguments is None else list(arguments)
    parser = _parser()
    if not given:
        parser.print_help(sys.stderr)
        return EXIT_ERROR
    try:
        options = parser.parse_args(_joined(given))
    except SystemExit as end:  # --help, --version, or a mistake that argparse has named
        return int(end.code or 0)
    try:
        options.run(options)
        if sys.stdout is not None:
            sys.stdout.flush()  # here, where a reader that has gone is caught
    except (KeyboardInterrupt, Cancelled):
        return _fail("stopped; nothing half-done was left behind.", EXIT_INTERRUPTED)
    except DeformError as error:
        return _fail(str(error))
    except MemoryError:
        return _fail("there is not enough memory for this; use a smaller volume or a coarser resolution (--spacing).")
    except BrokenPipeError:  # the reader of our output has gone, as in "deformnb info FILE | head -1"
        # What is still to be written would fail again when Python ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        return _fail(f"{error.strerror or error}{f': {error.filename}' if error.filename else ''}.")
    except Exception as error:
        if options.traceback:
            raise
        return _fail(f"unexpected {type(error).__name__}: {error} (--traceback before the command shows where).")
    return 0


def _fail(message: str, code: int = EXIT_ERROR) -> int:
    line = " ".join(message.split())  # other packages' messages may have several lines
    print(f"deformnb: {line}", file=sys.stderr)
    return code


class _Parser(argparse.ArgumentParser):
    """One line for a mistake, like all other errors."""

    def error(self, message: str) -> NoReturn:
        self.exit(EXIT_ERROR, f"{self.prog}: {message} ({self.prog} --help shows how)\n")


def _joined(arguments: list[str]) -> list[str]:
    """``--view -x`` as ``--view=-x``: argparse would take -x, or -1e3, for an option."""
    out: list[str] = []
    for argument in arguments:
        if out and out[-1] in ("--view", "--side", "--fill", "--strength") and argument.startswith("-"):
            out[-1] += f"={argument}"
        else:
            out.append(argument)
    return out


def _parser() -> argparse.ArgumentParser:
    from deformnb import __version__
    from deformnb.app import add_app
    from deformnb.launch import add_lab

    parser = _Parser(prog="deformnb", description="Deform volumes by control points on a picture of them.",
                     epilog="Start with: deformnb demo. Each command has its own --help.")
    parser.add_argument("--version", action="version", version=f"deformnb {__version__}")
    parser.add_argument("--traceback", action="store_true", help="show where an unexpected error came from")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for add in (_add_demo, partial(add_app, run=_app), add_lab, _add_warp, _add_info, _add_datasets, _add_doctor):
        add(commands)
    return parser


Commands: TypeAlias = "argparse._SubParsersAction[_Parser]"


def _add_demo(commands: Commands) -> None:
    what = "turn a carp into another fish the way D'Arcy Thompson drew it"
    p = commands.add_parser("demo", help=what, description=f"""{what[0].upper()}{what[1:]}: the net of one species is
        laid around the fish on a picture, its nodes are moved to the net of the other, and the volume follows. Writes
        pictures before and after, the deformed volume, and the session that "deformnb warp" applies again.""")
    p.add_argument("--volume", metavar="FILE", help="a volume of your own (default: a carp that is made up)")
    _add_spacing(p)
    p.add_argument("--species", default="Antigonia", help="Thompson's species to end with: Antigonia, Scorpaena, "
                   "Pseudopriacanthus, Sternoptyx, Orthagoriscus (default %(default)s)")
    p.add_argument("--view", default="-x",
                   help="along which axis to look at the side of the fish: +x -x +y -y +z -z (default %(default)s)")
    p.add_argument("--head", choices=("left", "right"), default="left",
                   help="where the head points on that picture (default %(default)s)")
    p.add_argument("--out", metavar="FOLDER", default="deformnb-demo",
                   help="folder for the results (default %(default)s)")
    p.add_argument("--renderer", default="auto", help="auto, vtk (needs OpenGL) or core (default %(default)s)")
    p.add_argument("--force", action="store_true", help="overwrite files that are no earlier results of the demo")
    p.set_defaults(run=_demo)


def _add_warp(commands: Commands) -> None:
    p = commands.add_parser("warp", help="apply a session to a volume", description="Apply a session to a volume.",
                            usage="deformnb warp SESSION INPUT OUTPUT [options]")
    p.add_argument("session", help="a document written by deformnb (.json)")
    p.add_argument("input", help="the volume to deform")
    p.add_argument("output", help="the volume to write; its suffix decides the format")
    _add_spacing(p)
    p.add_argument("--strength", type=float, default=1.0, help="1 as saved, 0 not at all, 2 exaggerated, -1 opposite")
    p.add_argument("--method", help="nearest, linear or cubic (default linear, nearest for labels)")
    p.add_argument("--fill", type=float, help="value outside the volume (default its smallest)")
    p.add_argument("--labels", action="store_true", help="the volume holds labels: keep their values")
    p.add_argument("--resolution", type=float, nargs="+", metavar="S",
                   help="voxel size of the result, one length or three (x y z; default as the input)")
    p.add_argument("--margin", type=float, nargs="+", metavar="M",
                   help="field of view: length to add on every side, one or three (x y z); negative crops")
    p.add_argument("--force", action="store_true", help="overwrite the output if it is there")
    p.set_defaults(run=_warp)


def _add_info(commands: Commands) -> None:
    what = "say what is in a volume file or a session"
    p = commands.add_parser("info", help=what, description=f"{what.capitalize()}.")
    p.add_argument("file", help="a volume, a folder of slices, or a session (.json)")
    p.set_defaults(run=_info)


def _add_datasets(commands: Commands) -> None:
    what = "list the real volumes with their credits, or fetch one"
    p = commands.add_parser("datasets", help=what, description=f"{what.capitalize()}.")
    p.add_argument("name", nargs="?", help="the one to download; prints where it is then (default: list all)")
    p.set_defaults(run=_datasets)


def _add_doctor(commands: Commands) -> None:
    what = "say which parts work on this machine and what to install for the others"
    p = commands.add_parser("doctor", help=what, description=f"{what.capitalize()}.")
    p.set_defaults(run=_doctor)


def _add_spacing(p: argparse.ArgumentParser) -> None:
    p.add_argument("--spacing", type=float, nargs=3, metavar=("X", "Y", "Z"),
                   help="true voxel size of the input, where its file is wrong")


# ---- the commands ---------------------------------------------------------------------------------------------------


def _demo(options: argparse.Namespace) -> None:
    from deformnb.demo import check_demo, run_demo

    check_demo(options.species, options.view, options.renderer)
    with _folder(Path(options.out), options) as folder, _stages() as stage:
        volume = _read(options.volume, options.spacing, stage) if options.volume else None
        done = run_demo(folder, volume=volume, species=options.species, view=options.view, head=options.head,
                        renderer=options.renderer, stage=stage)
    print("\n".join(f"{what:30} {path}" for what, path in done.written))
    again = ["deformnb", "warp", folder / "session.json", options.volume or folder / "volume.nii.gz",
             folder / "half.nii.gz", "--strength", "0.5", "--margin", *(f"{m:g}" for m in done.result.margin)]
    if options.volume and options.spacing:
        again += ["--spacing", *(f"{s:g}" for s in options.spacing)]
    print(f"half way there: {shlex.join(map(str, again))}")


def _app(options: argparse.Namespace) -> None:
    from deformnb.app.launch import check_app, made_up_carp, open_app

    check_app(options.host, options.port, options.side)
    with _stages() as stage:
        volume = _read(options.file, options.spacing, stage) if options.file else made_up_carp(stage("make the carp"))
    open_app(volume, side=options.side, viewer=options.viewer, host=options.host, port=options.port,
             browser=not options.no_browser)


@contextlib.contextmanager
def _folder(folder: Path, options: argparse.Namespace) -> Iterator[Path]:
    """The folder for the results of the demo, checked before any work; gone again if nothing came of it."""
    from deformnb.demo import FILES
    from deformnb.io.atomic import check_target

    if folder.exists() and not folder.is_dir():
        raise DeformError(f"{folder} is a file; name a folder for the results with --out.")
    present = [name for name in FILES if (folder / name).exists()]
    if options.volume and any(Path(options.volume).resolve() == (folder / name).resolve() for name in FILES):
        raise DeformError(f"{options.volume} would be overwritten; name another folder for the results with --out.")
    if present and "session.json" not in present and not options.force:
        raise DeformError(f"{folder / present[0]} is already there and not from an earlier demo; name another folder "
                          "with --out, or --force to overwrite it.")
    is_new = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    try:
        for name in FILES:
            check_target(folder / name)
        yield folder
    finally:
        if is_new:
            with contextlib.suppress(OSError):  # not empty: what is there is whole
                folder.rmdir()


def _warp(options: argparse.Namespace) -> None:
    from dataclasses import replace

    from deformnb.io import write_volume
    from deformnb.io.documents import read_deformation

    target = Path(options.output)
    _check_output(target, force=options.force)
    document = read_deformation(options.session)
    with _stages() as stage:
        volume = _read(options.input, options.spacing, stage)
        if options.labels:
            volume = replace(volume, is_labels=True)
        _note(*_differences(document, volume), *document.notes(volume.grid))
        if options.strength != 1:
            document = document.blended(options.strength)
        warped = document.apply(volume, output=_output_grid(volume, options), fill=options.fill,
                                method=options.method, progress=stage("deform"))
        write_volume(warped, target, progress=stage(f"write {target.name}"))
    print(target)


def _check_output(target: Path, *, force: bool) -> None:
    """What would only be noticed after the work."""
    from deformnb.io.atomic import check_target
    from deformnb.io.formats import format_of

    format_of(target, writing=True)
    check_target(target)
    if target.exists() and not force:
        raise DeformError(f"{target} is already there; choose another name, or --force to overwrite it.")


def _differences(document: Deformation, volume: Volume) -> Iterator[str]:
    """Why the result may not be what the author of a session saw."""
    made = document.volume
    if made is None:
        return
    if not made.matches(volume):
        yield f"the session was made on another volume ({made.name or 'unnamed'})."
    elif any(abs(a - b) > 1e-5 * a for a, b in zip(made.spacing, volume.grid.spacing, strict=True)):
        was, now = (" ".join(f"{s:g}" for s in spacing) for spacing in (made.spacing, volume.grid.spacing))
        yield f"the session was made with voxels of {was}, these are of {now}; --spacing {was} makes them alike."


def _note(*notes: str) -> None:
    for note in notes:
        print(f"deformnb: note: {note}", file=sys.stderr)


def _output_grid(volume: Volume, options: argparse.Namespace) -> Grid | None:
    from deformnb.io import available_memory

    if options.resolution is None and options.margin is None:
        return None
    for name in ("resolution", "margin"):
        value = getattr(options, name)
        if value is not None and len(value) not in (1, 3):
            raise DeformError(f"--{name} takes one length or three (x y z), got {len(value)}.")
    grid, spacing, margin = volume.grid, options.resolution, options.margin
    output = grid.resampled(spacing=grid.spacing if spacing is None else spacing if len(spacing) == 3 else spacing[0],
                            margin=0.0 if margin is None else margin if len(margin) == 3 else margin[0])
    needed, free = output.size * volume.dtype.itemsize, available_memory()
    if needed > free:
        voxels = " x ".join(map(str, output.shape[::-1]))
        raise DeformError(f"the result would have {voxels} voxels, {needed / 2**30:.3g} GiB, and {free / 2**30:.3g} "
                          "GiB are free; choose a coarser --resolution.")
    return output


def _info(options: argparse.Namespace) -> None:
    from deformnb.io import describe_file
    from deformnb.io.documents import describe_document

    path = Path(options.file)
    is_session = path.suffix.lower() == ".json" and not path.is_dir()
    rows = describe_document(path) if is_session else describe_file(path).rows()
    wide = max(len(key) for key in rows)
    print("\n".join(f"{key:{wide}}  {value}" for key, value in rows.items()))


def _datasets(options: argparse.Namespace) -> None:
    from deformnb import datasets

    print(datasets.credits() if options.name is None else datasets.fetch(options.name, progress=sys.stderr.isatty()))


def _doctor(_: argparse.Namespace) -> None:
    from deformnb.doctor import doctor, report

    print(report(doctor()))


def _read(path: str, spacing: Sequence[float] | None, stage: Stage) -> Volume:
    from deformnb.datasets.registry import recognised
    from deformnb.io import read_volume

    given = None if spacing is None else (float(spacing[0]), float(spacing[1]), float(spacing[2]))
    known = recognised(path) if given is None else None
    if known is not None and known.spacing is not None:
        given = known.spacing
        _note(f"this is the {known.title}; its true spacing {given} is used (--spacing overrides it)")
    volume = read_volume(path, spacing=given, progress=stage(f"read {Path(path).name}"))
    _note(*volume.notes)
    return volume


@contextlib.contextmanager
def _stages() -> Iterator[Stage]:
    """A function that begins a piece of work by name and returns what is told how far it has come.

    What takes longer than a second shows a bar; where standard error is a file or a pipe, a line when it is done.
    """
    make = _Bar if sys.stderr.isatty() else _Line
    current: list[_Bar | _Line] = []

    def stage(name: str) -> Callable[[float], None]:
        while current:
            current.pop().finish()
        current.append(make(name))
        return current[0].move

    try:
        yield stage
        while current:
            current.pop().finish()
    finally:
        while current:
            current.pop().abandon()


class _Bar:
    """A progress bar that appears after one second."""

    def __init__(self, name: str) -> None:
        from tqdm import tqdm

        self._bar = tqdm(total=100, desc=name, delay=_PATIENCE, file=sys.stderr, leave=True,
                         bar_format="{desc:28} {bar} {n:3.0f} % {elapsed}")

    def move(self, share: float) -> None:
        self._bar.update(max(0.0, 100 * min(share, 1.0) - self._bar.n))

    def finish(self) -> None:
        self._bar.close()

    abandon = finish


class _Line:
    """A line for logs when work of more than a second is done."""

    def __init__(self, name: str) -> None:
        self._name, self._start = name, time.monotonic()

    def move(self, share: float) -> None:
        """A log needs no bars."""

    def finish(self) -> None:
        elapsed = time.monotonic() - self._start
        if elapsed > _PATIENCE:
            print(f"{self._name:28} {elapsed:4.0f} s", file=sys.stderr)

    def abandon(self) -> None:
        """It was not finished."""


if __name__ == "__main__":
    sys.exit(main())
