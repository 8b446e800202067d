"""JupyterLab with the notebooks that come with the package, copied to a folder where they may be changed.

This is the command ``deformnb lab``, a separate module because it starts another program.
"""

from __future__ import annotations

import argparse
import importlib.util
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from deformnb._packages import install_command
from deformnb.errors import DeformError, MissingPackageError

FIRST = "01_quickstart.ipynb"
"""The notebook that is opened."""


def add_lab(commands: Any) -> None:
    """Add ``lab`` to the commands of an argument parser."""
    what = "open JupyterLab with the notebooks that come with deformnb"
    p = commands.add_parser(
        "lab",
        help=what,
        description=f"""{what[0].upper()}{what[1:]}: they are copied into a
        folder, where files of the same names are left unchanged, and the first of them is opened.""",
    )
    p.add_argument("folder", nargs="?", default=".", help="where the notebooks go (default: the working directory)")
    add_lab_options(p)
    p.set_defaults(run=_lab)


def _lab(options: argparse.Namespace) -> None:
    check_lab()
    copy_and_open(shipped_notebooks(), Path(options.folder), options)


def add_lab_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that are forwarded to JupyterLab."""
    parser.add_argument(
        "--no-browser", action="store_true", help="only print the address, on a machine without a screen"
    )
    parser.add_argument(
        "--allow-root", action="store_true", help="let the administrator run it, which Lab advises against"
    )


def copy_and_open(
    sources: list[Path], folder: Path, options: argparse.Namespace, opener: Callable[..., None] | None = None
) -> None:
    """Copy notebooks into a folder, report the new ones, and open the first of them, in JupyterLab by default."""
    copy_and_list(sources, folder)
    sys.stdout.flush()  # Lab prints next, past our buffer
    chosen = {"--no-browser": options.no_browser, "--allow-root": options.allow_root}
    (opener or open_lab)(folder / sources[0].name, *(name for name, given in chosen.items() if given))


def copy_and_list(sources: list[Path], folder: Path) -> None:
    """Copy notebooks into a folder and report the new ones."""
    new, kept = copy_files(sources, folder)
    for what, paths in (("new", new), ("unchanged", kept)):
        for path in paths:
            print(f"{what:14} {path}")


def shipped_notebooks() -> list[Path]:
    """The notebooks of the package, in their order.

    Raises
    ------
    DeformError
        If this installation has none.

    Examples
    --------
    >>> shipped_notebooks()[0].name
    '01_quickstart.ipynb'
    """
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "notebooks", package.parent / "notebooks"):  # installed; a checkout
        if (folder / FIRST).is_file():
            return sorted(folder.glob("*.ipynb"))
    raise DeformError(
        f"{FIRST} is missing from this installation; pip install --force-reinstall --no-deps deformnb-core."
    )


def copy_notebooks(folder: Path) -> tuple[list[Path], list[Path]]:
    """Copy the notebooks into a folder, and overwrite nothing.

    Parameters
    ----------
    folder : where they go; it is made if need be.

    Returns
    -------
    list of Path
        The new files.
    list of Path
        Those that existed already and are unchanged.

    Raises
    ------
    DeformError
        If the folder is a file.
    """
    return copy_files(shipped_notebooks(), folder)


def copy_files(sources: list[Path], folder: Path) -> tuple[list[Path], list[Path]]:
    """Copy files as :func:`copy_notebooks` does."""
    if folder.exists() and not folder.is_dir():
        raise DeformError(f"{folder} is a file; name a folder for the notebooks.")
    folder.mkdir(parents=True, exist_ok=True)
    new, kept = [], []
    for source in sources:
        target = folder / source.name
        if target.exists():
            kept.append(target)
        else:
            shutil.copyfile(source, target)  # not its permissions: files of an administrator may be read-only
            new.append(target)
    return new, kept


def open_lab(notebook: Path, *options: str) -> None:
    """Start JupyterLab in the folder of a notebook and wait until it ends.

    Parameters
    ----------
    notebook : the one that opens first.
    options : further options of ``jupyter lab``.

    Raises
    ------
    MissingPackageError
        If JupyterLab is not installed.
    """
    check_lab()
    from jupyterlab.labapp import LabApp

    # In this process, so that Ctrl-C and the end of a terminal reach Lab itself, which then prompts or cleans up.
    # The address, and not the file as its argument, leads to the notebook also where no browser is opened.
    LabApp.launch_instance(
        [
            f"--ServerApp.root_dir={notebook.resolve().parent}",
            f"--LabApp.default_url=/lab/tree/{notebook.name}",
            *options,
        ]
    )


def open_voila(notebook: Path, *options: str) -> None:
    """Show a notebook without its code, by Voila, and wait until it ends; parameters and errors as :func:`open_lab`."""
    check_lab("voila")
    from voila.app import Voila  # type: ignore[import-untyped]

    # Voila alone is no Jupyter server: it has no administrator, and loads no server extension.
    chosen = [option for option in options if option != "--allow-root"]
    quick = "deformnb.server_extension.PromptConnection"
    Voila.launch_instance([str(notebook), *chosen, f"--Voila.kernel_websocket_connection_class={quick}"])


def check_lab(*more: str) -> None:
    """Raise if JupyterLab, or one of the other packages that are named, is missing, before anything is copied."""
    for name in ("jupyterlab", "ipykernel", *more):
        if importlib.util.find_spec(name) is None:
            raise MissingPackageError(
                f"{name} is not installed, and the notebooks need it; {install_command('notebook')}."
            )
