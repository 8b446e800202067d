"""The command ``deformnb``: demo, warp, info, datasets, doctor.

Errors are one sentence on standard error and exit code 2; Ctrl-C is 130. Work of more than a second shows a bar.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from deformnb.errors import Cancelled, DeformError

if TYPE_CHECKING:
    from deformnb.volume import Grid, Volume

EXIT_ERROR = 2
EXIT_INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    options = _parser().parse_args(arguments)
    try:
        options.run(options)
    except (KeyboardInterrupt, Cancelled):
        return _fail("stopped; nothing half-done was left behind.", EXIT_INTERRUPTED)
    except DeformError as error:
        return _fail(str(error))
    except MemoryError:
        return _fail("there is not enough memory for this; use a smaller volume or a coarser resolution (--spacing).")
    except BrokenPipeError:  # the reader of our output has gone, as in "deformnb info FILE | head -1"
        sys.stderr.close()
        return 0
    except OSError as error:
        return _fail(f"{error.strerror or error}{f': {error.filename}' if error.filename else ''}.")
    except Exception as error:
        if options.traceback:
            raise
        return _fail(f"unexpected {type(error).__name__}: {error} (--traceback before the command shows where).")
    return 0


def _fail(message: str, code: int = EXIT_ERROR) -> int:
    print(f"deformnb: {message}", file=sys.stderr)
    return code


def _parser() -> argparse.ArgumentParser:
    from deformnb import __version__

    parser = argparse.ArgumentParser(prog="deformnb", description="Deform volumes by control points on a picture.")
    parser.add_argument("--version", action="version", version=f"deformnb {__version__}")
    parser.add_argument("--traceback", action="store_true", help="show where an unexpected error came from")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for add in (_add_demo, _add_warp, _add_info, _add_datasets, _add_doctor):
        add(commands)
    return parser


Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"


def _add_demo(commands: Commands) -> None:
    p = commands.add_parser("demo", help="turn a carp into another fish the way D'Arcy Thompson drew it")
    p.add_argument("--volume", metavar="FILE", help="a volume of your own (default: the carp that comes along)")
    _add_spacing(p)
    p.add_argument("--species", default="Antigonia", help="Thompson's species to end with (default %(default)s)")
    p.add_argument("--view", help="direction of looking at the side: +x -x +y -y +z -z (default -x)")
    p.add_argument("--head", choices=("left", "right"), help="where the head then points (default left)")
    p.add_argument("--out", metavar="FOLDER", default="deformnb-demo", help="folder for the results (%(default)s)")
    p.add_argument("--renderer", default="auto", help="auto, vtk (needs OpenGL) or core (default %(default)s)")
    p.set_defaults(run=_demo)


def _add_warp(commands: Commands) -> None:
    p = commands.add_parser("warp", help="apply a session to a volume")
    p.add_argument("session", help="a document written by deformnb (.json)")
    p.add_argument("input", help="the volume to deform")
    p.add_argument("output", help="the volume to write; its suffix decides the format")
    _add_spacing(p)
    p.add_argument("--strength", type=float, default=1.0, help="1 as saved, 0 not at all, 2 exaggerated, -1 opposite")
    p.add_argument("--method", help="nearest, linear or cubic (default linear, nearest for labels)")
    p.add_argument("--fill", type=float, help="value outside the volume (default its smallest)")
    p.add_argument("--labels", action="store_true", help="the volume holds labels: keep their values")
    p.add_argument("--resolution", type=float, nargs="+", metavar="S",
                   help="voxel size of the result, one length or three (x y z)")
    p.add_argument("--margin", type=float, nargs="+", metavar="M",
                   help="field of view: length to add on every side, one or three (x y z); negative crops")
    p.add_argument("--force", action="store_true", help="overwrite the output if it is there")
    p.set_defaults(run=_warp)


def _add_info(commands: Commands) -> None:
    p = commands.add_parser("info", help="say what is in a volume file or a session")
    p.add_argument("file")
    p.set_defaults(run=_info)


def _add_datasets(commands: Commands) -> None:
    p = commands.add_parser("datasets", help="list the real volumes with their credits, or fetch one")
    p.add_argument("name", nargs="?", help="the one to fetch")
    p.set_defaults(run=_datasets)


def _add_doctor(commands: Commands) -> None:
    p = commands.add_parser("doctor", help="say which parts work on this machine and what to install for the others")
    p.set_defaults(run=_doctor)


def _add_spacing(p: argparse.ArgumentParser) -> None:
    p.add_argument("--spacing", type=float, nargs=3, metavar=("X", "Y", "Z"),
                   help="true voxel size of the input, where its file is wrong")


# ---- the commands ---------------------------------------------------------------------------------------------------


def _demo(options: argparse.Namespace) -> None:
    from deformnb.demo import run_demo

    folder = Path(options.out)
    if folder.exists() and not folder.is_dir():
        raise DeformError(f"{folder} is a file; name a folder for the results with --out.")
    folder.mkdir(parents=True, exist_ok=True)
    with _stages() as stage:
        volume = _read(options.volume, options.spacing, stage) if options.volume else None
        written = run_demo(folder, volume=volume, species=options.species, view=options.view, head=options.head,
                           renderer=options.renderer, stage=stage)
    print("\n".join(f"{what:34} {path}" for what, path in written))


def _warp(options: argparse.Namespace) -> None:
    from dataclasses import replace

    from deformnb.io import write_volume
    from deformnb.io.documents import read_deformation

    target = Path(options.output)
    if target.exists() and not options.force:
        raise DeformError(f"{target} is already there; choose another name, or --force to overwrite it.")
    document = read_deformation(options.session)
    with _stages() as stage:
        volume = _read(options.input, options.spacing, stage)
        if options.labels:
            volume = replace(volume, is_labels=True)
        if document.volume is not None and not document.volume.matches(volume):
            print(f"deformnb: note: the session was made on another volume ({document.volume.name or 'unnamed'}).",
                  file=sys.stderr)
        for note in (*volume.notes, *document.notes(volume.grid)):
            print(f"deformnb: note: {note}", file=sys.stderr)
        if options.strength != 1:
            document = document.blended(options.strength)
        warped = document.apply(volume, output=_output_grid(volume.grid, options), fill=options.fill,
                                method=options.method, progress=stage("warp"))
        write_volume(warped, target, progress=stage(f"write {target.name}"))
    print(target)


def _output_grid(grid: Grid, options: argparse.Namespace) -> Grid | None:
    if options.resolution is None and options.margin is None:
        return None
    for name in ("resolution", "margin"):
        value = getattr(options, name)
        if value is not None and len(value) not in (1, 3):
            raise DeformError(f"--{name} takes one length or three (x y z), got {len(value)}.")
    spacing, margin = options.resolution, options.margin
    return grid.resampled(spacing=grid.spacing if spacing is None else spacing if len(spacing) == 3 else spacing[0],
                          margin=0.0 if margin is None else margin if len(margin) == 3 else margin[0])


def _info(options: argparse.Namespace) -> None:
    from deformnb.io import describe_file
    from deformnb.io.documents import describe_document

    path = Path(options.file)
    rows = describe_document(path) if path.suffix == ".json" else describe_file(path).rows()
    wide = max(len(key) for key in rows)
    print("\n".join(f"{key:{wide}}  {value}" for key, value in rows.items()))


def _datasets(options: argparse.Namespace) -> None:
    from deformnb import datasets

    print(datasets.credits() if options.name is None else datasets.fetch(options.name, progress=sys.stderr.isatty()))


def _doctor(_: argparse.Namespace) -> None:
    from deformnb.doctor import doctor, report

    print(report(doctor()))


def _read(path: str, spacing: Sequence[float] | None, stage: Callable[[str], Callable[[float], None]]) -> Volume:
    from deformnb.io import read_volume

    given = None if spacing is None else (float(spacing[0]), float(spacing[1]), float(spacing[2]))
    return read_volume(path, spacing=given, progress=stage(f"read {Path(path).name}"))


@contextlib.contextmanager
def _stages() -> Iterator[Callable[[str], Callable[[float], None]]]:
    """A function that opens a progress bar of a name and returns what moves it; bars appear after one second."""
    from tqdm import tqdm

    bars: list[Any] = []

    def stage(name: str) -> Callable[[float], None]:
        close()
        bar: Any = tqdm(total=100, desc=name, delay=1.0, file=sys.stderr, leave=True,
                               bar_format="{desc:28} {bar} {n:3.0f} % {elapsed}")
        bars.append(bar)

        def move(share: float) -> None:
            bar.update(max(0.0, 100 * min(share, 1.0) - bar.n))

        return move

    def close() -> None:
        while bars:
            bars.pop().close()

    try:
        yield stage
    finally:
        close()
