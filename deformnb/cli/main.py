"""Command line ``deformnb``: demo, app, page, lab, lesson, warp, transform, replay, info, datasets, doctor.

Errors are one sentence on standard error and exit code 2, with ``--json`` a document with it too; Ctrl-C is 130. Work
of more than a second shows a bar on a terminal, and nothing in a file or a pipe.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn, TypeAlias

from deformnb.cli.info import add_info
from deformnb.cli.output import add_json, print_json
from deformnb.cli.transform import add_transform
from deformnb.cli.warp import add_replay, add_spacing, add_warp, note, read_input, stages
from deformnb.devices import add_device
from deformnb.errors import Cancelled, DeformError

if TYPE_CHECKING:
    from deformnb.app.start import StartServer

EXIT_ERROR = 2
EXIT_INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    given = sys.argv[1:] if arguments is None else list(arguments)
    parser = _parser()
    _complete(parser)
    if not given:
        parser.print_help(sys.stderr)
        return EXIT_ERROR
    fail = partial(_fail, as_json="--json" in given)
    options = _parse(parser, given, fail)
    if isinstance(options, int):
        return options
    try:
        if getattr(options, "device", None):
            from deformnb.devices import use_device

            use_device(options.device)
        from deformnb.checks import report_notes

        with report_notes():
            _copy_addressed(options)
            options.run(options)
        if sys.stdout is not None:
            sys.stdout.flush()  # here, where a closed pipe is caught
    except (KeyboardInterrupt, Cancelled):
        return fail("stopped; nothing half-done was left behind.", EXIT_INTERRUPTED)
    except DeformError as error:
        return fail(str(error))
    except MemoryError:
        return fail("there is not enough memory for this; use a smaller volume or a coarser resolution (--spacing).")
    except BrokenPipeError:  # the reader of our output has ended, as in "deformnb info FILE | head -1"
        _end_output()
        return 0
    except OSError as error:
        _end_output()  # which may be the cause
        return fail(f"{error.strerror or error}{f': {error.filename}' if error.filename else ''}.")
    except Exception as error:
        if options.traceback:
            raise
        return fail(f"unexpected {type(error).__name__}: {error} (--traceback before the command shows where).")
    return 0


def _parse(parser: argparse.ArgumentParser, given: list[str], fail: Callable[..., int]) -> argparse.Namespace | int:
    """The options of a line, or the exit code where nothing is to be run."""
    try:
        return parser.parse_args(_join_negative_values(given))
    except SystemExit as end:  # --help, --version
        return int(end.code or 0)
    except _MistakeError as mistake:
        return fail(str(mistake), name=mistake.command)


def _complete(parser: argparse.ArgumentParser) -> None:
    """Print what may follow in a line, and end, if that is what the script of argcomplete in a shell asks for."""
    if "_ARGCOMPLETE" not in os.environ:
        return
    try:
        import argcomplete
    except ImportError:
        return
    argcomplete.autocomplete(parser)


def _end_output() -> None:
    """Flush the output, or discard it if that fails: it would fail again when Python ends."""
    if sys.stdout is not None:
        try:
            sys.stdout.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _fail(message: str, code: int = EXIT_ERROR, *, name: str = "deformnb", as_json: bool = False) -> int:
    line = " ".join(message.split())  # other packages' messages may have several lines
    print(f"{name}: {line}", file=sys.stderr)
    if as_json:
        with contextlib.suppress(OSError):  # which may be the error
            print_json({"error": line})
            _end_output()
    return code


class _MistakeError(Exception):
    """A mistake in a line, with the command that it is of."""

    def __init__(self, command: str, message: str) -> None:
        super().__init__(message)
        self.command = command


class _Parser(argparse.ArgumentParser):
    """One line for a mistake, like all other errors."""

    def error(self, message: str) -> NoReturn:
        raise _MistakeError(self.prog, f"{message} ({self.prog} --help shows how)")


def _join_negative_values(arguments: list[str]) -> list[str]:
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
    from deformnb.cli.lab import add_lab
    from deformnb.cli.lesson import add_lesson

    parser = _Parser(
        prog="deformnb",
        description="Deform volumes by control points on a picture of them.",
        epilog="Start with: deformnb demo. Each command has its own --help.",
    )
    parser.add_argument("--version", action="version", version=f"deformnb {__version__}")
    parser.add_argument("--traceback", action="store_true", help="show where an unexpected error came from")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for add in (
        _add_demo,
        partial(add_app, run=_app),
        _add_page,
        add_lab,
        add_lesson,
        add_warp,
        add_transform,
        add_replay,
        add_info,
        _add_datasets,
        _add_cache,
        _add_doctor,
    ):
        add(commands)
    return parser


Commands: TypeAlias = "argparse._SubParsersAction[_Parser]"  # noqa: SLF001  # argparse has no public name for it


def _add_demo(commands: Commands) -> None:
    what = "turn a carp into another fish the way D'Arcy Thompson drew it"
    p = commands.add_parser(
        "demo",
        help=what,
        description=f"""{what[0].upper()}{what[1:]}: the grid of one species is
        fitted to the fish on a picture, its nodes are moved to the grid of the other, and the volume follows. Writes
        pictures before and after, the deformed volume, and the session that "deformnb warp" applies again.""",
    )
    p.add_argument("--volume", metavar="FILE", help="your volume (default: a synthetic carp)")
    add_spacing(p)
    add_device(p)
    p.add_argument(
        "--species",
        default="Antigonia",
        help="Thompson's species to end with: Antigonia, Scorpaena, "
        "Pseudopriacanthus, Sternoptyx, Orthagoriscus (default %(default)s)",
    )
    p.add_argument(
        "--view",
        default="-x",
        help="viewing axis for the side of the fish: +x -x +y -y +z -z (default %(default)s)",
    )
    p.add_argument(
        "--head",
        choices=("left", "right"),
        default="left",
        help="where the head points on that picture (default %(default)s)",
    )
    p.add_argument(
        "--out", metavar="FOLDER", default="deformnb-demo", help="folder for the results (default %(default)s)"
    )
    p.add_argument("--renderer", default="auto", help="auto, vtk (needs OpenGL) or core (default %(default)s)")
    p.add_argument("--force", action="store_true", help="overwrite files that are no earlier results of the demo")
    p.set_defaults(run=_demo)


_PAGES = {"": "deformnb.html", "thompson": "thompson.html"}  # names of pages by their kinds


def _add_page(commands: Commands) -> None:
    from deformnb.app import add_language

    what = "write a page that deforms a volume or a picture in a browser, without Python"
    p = commands.add_parser(
        "page",
        help=what,
        description=f"""{what[0].upper()}{what[1:]}: one file that works offline,
        from a stick or on a phone. On it a NIfTI, NRRD, PNG or JPEG file is opened, deformed by control points and
        compared, and pictures and a session are downloaded; "deformnb replay" applies the session to the same file.
        "deformnb page thompson" writes a page about D'Arcy Thompson's grids: one fish becomes another, on a phone,
        in five minutes.""",
    )
    p.add_argument(
        "output",
        nargs="*",
        metavar="OUTPUT",
        help=f"the file to write (default {_PAGES['']}); after the word thompson that of the page about "
        f"Thompson's grids (default {_PAGES['thompson']})",
    )
    p.add_argument("--force", action="store_true", help="overwrite the output if it is there")
    add_language(p)
    p.set_defaults(run=_page)


def _add_datasets(commands: Commands) -> None:
    what = "list the real volumes with their credits, or fetch one"
    p = commands.add_parser("datasets", help=what, description=f"{what.capitalize()}.")
    p.add_argument("name", nargs="?", help="the one to download; prints where it is then (default: list all)")
    add_json(p)
    p.set_defaults(run=_datasets)


def _add_cache(commands: Commands) -> None:
    what = "list the copies of files at addresses, or remove them"
    p = commands.add_parser("cache", help=what, description=f"{what.capitalize()}.")
    p.add_argument("--clear", action="store_true", help="remove them; a file that is read again comes again")
    add_json(p)
    p.set_defaults(run=_cache)


def _add_doctor(commands: Commands) -> None:
    what = "list the parts that work on this machine and what to install for the others"
    p = commands.add_parser("doctor", help=what, description=f"{what.capitalize()}.")
    add_json(p)
    p.set_defaults(run=_doctor)


# ---- the commands ---------------------------------------------------------------------------------------------------


def _demo(options: argparse.Namespace) -> None:
    from deformnb.imaging.demo import check_demo, run_demo

    check_demo(options.species, options.view, options.renderer)
    with _folder(Path(options.out), options) as folder, stages() as stage:
        volume = read_input(options.volume, options.spacing, stage) if options.volume else None
        done = run_demo(
            folder,
            volume=volume,
            species=options.species,
            view=options.view,
            head=options.head,
            renderer=options.renderer,
            stage=stage,
        )
    print("\n".join(f"{what:30} {path}" for what, path in done.written))
    again = [
        "deformnb",
        "warp",
        folder / "session.json",
        options.volume or folder / "volume.nii.gz",
        folder / "half.nii.gz",
        "--strength",
        "0.5",
        "--margin",
        *(f"{m:g}" for m in done.result.margin),
    ]
    if options.volume and options.spacing:
        again += ["--spacing", *(f"{s:g}" for s in options.spacing)]
    print(f"half way there: {shlex.join(map(str, again))}")


def _app(options: argparse.Namespace) -> None:
    from deformnb.app.start import check_app, starting
    from deformnb.io.files.paths import address_of, as_path, named_path

    host = check_app(options.host, options.port, options.side, options.idle)
    subject = (address_of(options.file) or str(as_path(options.file).resolve())) if options.file else ""
    if subject and not address_of(subject) and not Path(subject).exists():  # before a page is opened
        raise DeformError(f"there is no file {options.file}.")
    name = named_path(options.file).name if options.file else "carp"
    with starting(
        name,
        host=host,
        port=options.port,
        browser=not options.no_browser,
        idle=options.idle,
        subject=subject,
        language=options.language,
    ) as start:
        _load_app(options, start)


def _load_app(options: argparse.Namespace, start: StartServer) -> None:
    """Read the volume of an application and serve it; the page of the start shows how far that is."""
    from deformnb.app.start import stage_of

    start.progress("Loading the packages …")
    from deformnb.app.application import serve_app, synthetic_carp
    from deformnb.session.inputs import as_deformation, subject_from
    from deformnb.volume.channels import Channels

    deformation = as_deformation(options.session)
    with stages() as stage:
        if options.file:
            work = f"Reading {start.facts['name']}"
            volume = subject_from(
                options.file,
                spacing=options.spacing,
                is_labels=options.labels or None,
                level=options.level,
                progress=stage_of(start, work, stage(f"read {start.facts['name']}")),
            )
        else:
            volume = synthetic_carp(stage_of(start, "Making the carp", stage("make the carp")))
    note(*(() if isinstance(volume, Channels) else volume.notes))
    serve_app(
        volume,
        deformation,
        start,
        side=options.side,
        viewer=options.viewer,
        idle=options.idle,
        language=options.language,
    )


def _page(options: argparse.Namespace) -> None:
    from deformnb.widgets.file_pages import write_file_page, write_thompson_page

    kind, *outputs = options.output if options.output[:1] == ["thompson"] else ["", *options.output]
    if len(outputs) > 1:
        raise DeformError(f"one file is written, and {len(outputs)} were named: {', '.join(outputs)}.")
    output = outputs[0] if outputs else _PAGES[kind]
    if Path(output).exists() and not options.force:
        raise DeformError(f"{output} is there already; name another file, or --force to overwrite it.")
    write = write_thompson_page if kind else write_file_page
    write(output, language=options.language)
    print(output)


@contextlib.contextmanager
def _folder(folder: Path, options: argparse.Namespace) -> Iterator[Path]:
    """The folder for the results of the demo, checked before any work; removed if no result was written."""
    from deformnb.imaging.demo import FILES
    from deformnb.io.files.atomic import check_target

    if folder.exists() and not folder.is_dir():
        raise DeformError(f"{folder} is a file; name a folder for the results with --out.")
    present = [name for name in FILES if (folder / name).exists()]
    if options.volume and any(Path(options.volume).resolve() == (folder / name).resolve() for name in FILES):
        raise DeformError(f"{options.volume} would be overwritten; name another folder for the results with --out.")
    if present and "session.json" not in present and not options.force:
        raise DeformError(
            f"{folder / present[0]} is already there and not from an earlier demo; name another folder "
            "with --out, or --force to overwrite it."
        )
    is_new = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    try:
        for name in FILES:
            check_target(folder / name)
        yield folder
    finally:
        if is_new:
            with contextlib.suppress(OSError):  # not empty: its files are complete
                folder.rmdir()


def _copy_addressed(options: argparse.Namespace) -> None:
    """Replace the addresses of files that are read by the paths of their copies."""
    from deformnb.io.files.paths import address_of

    for name in ("file", "input", "inputs", "session", "volume"):
        given = getattr(options, name, None)
        one = [given] if isinstance(given, str) else given or []
        if any(map(address_of, one)) and (name, options.run) != ("file", _app):  # whose page shows the progress
            from deformnb.io.files.addresses import input_path

            copies = [str(input_path(path)) for path in one]
            setattr(options, name, copies[0] if isinstance(given, str) else copies)


def _datasets(options: argparse.Namespace) -> None:
    from deformnb import datasets

    if options.name is None:
        if options.json:
            print_json({"datasets": [{"name": name, **asdict(row)} for name, row in datasets.DATASETS.items()]})
        else:
            print(datasets.credits())
        return
    path = datasets.fetch(options.name, progress=sys.stderr.isatty())
    if options.json:
        print_json({"name": options.name, "path": str(path)})
    else:
        print(path)


def _cache(options: argparse.Namespace) -> None:
    from deformnb.io.files.address_copies import addresses_home, list_copies, remove_copies
    from deformnb.io.files.errors import human_bytes
    from deformnb.io.files.paths import format_address

    copies = [(format_address(address), size) for address, size in list_copies()]
    if options.clear:
        remove_copies()
    if options.json:
        rows = [{"address": address, "size": size} for address, size in copies]
        print_json({"folder": str(addresses_home()), "copies": rows, "removed": options.clear})
        return
    for address, size in copies:
        print(f"{human_bytes(size):>10}  {address}")
    total = f"{len(copies)} copies of files at addresses, {human_bytes(sum(size for _, size in copies))}"
    print(f"{total}, {'removed from' if options.clear else 'in'} {addresses_home()}")


def _doctor(options: argparse.Namespace) -> None:
    from deformnb.cli.doctor import as_records, doctor, report

    checks = doctor()
    if options.json:
        print_json(as_records(checks))
    else:
        print(report(checks))


if __name__ == "__main__":
    sys.exit(main())
