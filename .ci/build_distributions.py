"""Builds the files of a release: of each distribution an archive of its sources, and from this archive its wheels.

``python .ci/build_distributions.py FOLDER [--here] [options of build]``, such as ``--no-isolation``. The distributions
are those of ``tool.deformnb.distributions`` in pyproject.toml. deformnb-core gets a wheel for each platform, whose
loops zig compiles; with ``--here`` it gets that of this machine alone.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
import native_build  # noqa: E402
import readme_links  # noqa: E402


def main(folder: Path, *options: str) -> None:
    """Build all distributions into a folder."""
    targets = [None] if "--here" in options else list(native_build.TARGETS)
    options = tuple(option for option in options if option != "--here")
    for name in readme_links.read_project()["tool"]["deformnb"]["distributions"]:
        with tempfile.TemporaryDirectory() as scratch:
            build(ROOT / name, Path(scratch), "--sdist", *options)
            (archive,) = Path(scratch).iterdir()
            shutil.unpack_archive(archive, scratch)
            tree = Path(scratch) / archive.name.removesuffix(".tar.gz")
            folder.mkdir(parents=True, exist_ok=True)
            shutil.copy(archive, folder)
            for target in targets if name == "core" else [None]:
                build(tree, folder, "--wheel", *options, target=target)


def build(tree: Path, folder: Path, *options: str, target: str | None = None) -> None:
    """Build one file."""
    environment = os.environ | ({} if target is None else {native_build.TARGET_VARIABLE: target})
    command = [sys.executable, "-m", "build", *options, "--outdir", str(folder), str(tree)]
    subprocess.run(command, env=environment, check=True)


main(Path(sys.argv[1]), *sys.argv[2:])
