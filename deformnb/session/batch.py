"""Batch replay of one document on many files: finished results stay, failures are reported, and a second run resumes.

The folder of the results holds ``deformnb-replay.json``, which names for each result the document, options and input it
was made of. After an interruption, or with further inputs, a run does only the results that are missing or out of date.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

from deformnb.checks import short_value
from deformnb.document.deformation import Deformation
from deformnb.document.json_format import to_json
from deformnb.document.transplant import transplant
from deformnb.errors import Cancelled, DeformError
from deformnb.io.files.addresses import input_path
from deformnb.io.files.atomic import atomic_write
from deformnb.io.files.paths import as_path
from deformnb.io.landmarks.formats import is_landmarks
from deformnb.io.meshes.formats import is_mesh
from deformnb.io.volumes.formats import find_format, read_volume, write_volume
from deformnb.io.volumes.ome_zarr import is_zarr
from deformnb.session.view_state import without_view_state

RECORD = "deformnb-replay.json"
_FORMAT, _VERSION = "deformnb-replay", 1
_LARGEST_RECORD = 32 * 2**20

FileWork = Callable[[Deformation, Path, Path, Callable[[float], None]], Mapping[str, Any]]
"""Applies a document to an input file, writes the output file, and returns facts for the summary."""


@dataclass(frozen=True)
class Replayed:
    """Result for one file.

    Parameters
    ----------
    input, output : file names.
    state : "done", "kept" (it was done before) or "failed".
    seconds : it took.
    message : why it failed.
    facts : of the work, such as the smallest det J.
    """

    input: str
    output: str
    state: str
    seconds: float = 0.0
    message: str = ""
    facts: Mapping[str, Any] = field(default_factory=dict)


def inputs_of(paths: Sequence[str | PathLike[str]]) -> list[Path]:
    """The files meant: those named, and of folders all volumes, meshes and landmarks in them, by name.

    Raises
    ------
    DeformError
        If one is not there, a folder holds nothing that can be deformed, or two files have one name.
    """
    found: list[Path] = []
    for path in map(input_path, paths):
        if not path.exists():
            raise DeformError(f"there is no file {path}.")
        inside = [path] if _is_one(path) else sorted(p for p in path.iterdir() if _is_one(p) and _is_known(p))
        if not inside:
            raise DeformError(f"{path} holds no volume, mesh or landmarks that could be deformed.")
        found += inside
    names = [p.name for p in found]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise DeformError(
            f"two inputs are named {twice}, and their results would be one file; rename one, or replay "
            "them into two folders."
        )
    return found


def _is_one(path: Path) -> bool:
    """Check for a file, or a folder that is one volume in OME-Zarr."""
    return not path.is_dir() or is_zarr(path)


def _is_known(path: Path) -> bool:
    if path.name.startswith(".") or path.name == RECORD:
        return False
    if is_mesh(path) or is_landmarks(path):
        return True
    try:
        find_format(path, writing=False)
    except DeformError:
        return False
    return True


def replay(
    deformation: Deformation,
    inputs: Sequence[str | PathLike[str]],
    folder: str | PathLike[str],
    *,
    work: FileWork | None = None,
    options: Mapping[str, Any] | None = None,
    suffix: str = "",
    overwrite: bool = False,
    progress: Callable[[str, float], None] | None = None,
) -> list[Replayed]:
    """Apply a document to files, and continue where an earlier run was stopped.

    Parameters
    ----------
    deformation : the document.
    inputs : files, or folders of them; see :func:`inputs_of`.
    folder : of the results, which have the names of their inputs; made if it is not there.
    work : the function for one file; default reads a volume, deforms it and writes it.
    options : of the work, as plain JSON: results that were made with others are made again.
    suffix : of the results, such as ".nii.gz", where they should have another format than their inputs.
    overwrite : replace files that no replay has written.
    progress : called with the name of an input and the finished share of it; may raise
        :class:`~deformnb.errors.Cancelled`. Finished results stay.

    Returns
    -------
    list of Replayed, one for each input. A file that fails does not stop the others.

    Raises
    ------
    DeformError
        If the inputs cannot be found, or the folder cannot be written to; if results would replace inputs or one
        another.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from deformnb.io import write_volume
    >>> from deformnb.volume.volume import Volume
    >>> folder = Path(tempfile.mkdtemp())
    >>> write_volume(Volume.from_array(np.zeros((2, 3, 4), np.uint8)), folder / "a.nrrd")
    >>> done = replay(Deformation(), [folder / "a.nrrd"], folder / "results")
    >>> (folder / "results" / "a.nrrd").is_file()
    True
    """
    if isinstance(inputs, str | PathLike) or not isinstance(inputs, Iterable):
        raise DeformError(f"the inputs are a list of paths, got {short_value(inputs)}.")
    files, target = inputs_of(list(inputs)), as_path(folder)
    outputs = [target / _rename(path, suffix) for path in files]
    _check_outputs(files, outputs)
    target.mkdir(parents=True, exist_ok=True)
    what_is_done = replace(without_view_state(deformation), volume=None)
    made_of = {"document": _digest(to_json(what_is_done)), "options": dict(options or {})}
    record, results = _read_record(target / RECORD), []
    report = progress or (lambda _name, _share: None)
    for path, output in zip(files, outputs, strict=True):
        done = _one(
            deformation, path, output, made_of, record, work or _warp_volume, overwrite, partial(report, path.name)
        )
        results.append(done)
        if done.state == "done":
            _write_record(target / RECORD, record)
    return results


def _check_outputs(files: Sequence[Path], outputs: Sequence[Path]) -> None:
    """Refuse results that would replace an input, with any ``overwrite``, or another result."""
    inputs, maker = {path.resolve() for path in files}, dict[str, str]()
    for path, output in zip(files, outputs, strict=True):
        if output.resolve() in inputs:
            raise DeformError(f"the results would replace their inputs in {output.parent}; name another folder.")
        other = maker.setdefault(output.name, path.name)
        if other != path.name:
            raise DeformError(
                f"the results of {other} and {path.name} would both be {output.name}; replay them into two folders."
            )


def _one(
    deformation: Deformation,
    path: Path,
    target: Path,
    made_of: dict[str, Any],
    record: dict[str, Any],
    work: FileWork,
    overwrite: bool,
    progress: Callable[[float], None],
) -> Replayed:
    start = time.perf_counter()
    try:
        made = {**made_of, "input": stamp(path)}
        known = record.get(target.name)
        if known is not None and target.exists() and known["output"] == stamp(target):
            if known["made_of"] == made:
                return Replayed(path.name, target.name, "kept", facts=known["facts"])
        elif target.exists() and not overwrite:
            raise DeformError(
                f"{target.name} is already there and was not made by a replay, or was changed since; "
                "move it away, or overwrite it (--force)."
            )
        facts = dict(work(deformation, path, target, progress))
        record[target.name] = {"made_of": made, "output": stamp(target), "facts": facts}
    except Cancelled:
        raise
    except (DeformError, OSError, MemoryError) as error:
        message = str(error) or "there is not enough memory for this."
        return Replayed(path.name, target.name, "failed", time.perf_counter() - start, message)
    return Replayed(path.name, target.name, "done", time.perf_counter() - start, facts=facts)


def _warp_volume(
    deformation: Deformation, path: Path, target: Path, progress: Callable[[float], None]
) -> Mapping[str, Any]:
    volume = read_volume(path)
    write_volume(transplant(deformation, volume.finest_grid).apply(volume, progress=progress), target)
    return {}


def _rename(path: Path, suffix: str) -> str:
    if not suffix or is_mesh(path) or is_landmarks(path):
        return path.name
    stem = path.name
    for end in (".gz", *path.suffixes[-1:], ".nii"):
        stem = stem.removesuffix(end)
    return stem + suffix


def stamp(path: Path) -> list[int]:
    """Size and time of a file, or of all files of a folder: they show that it is another one, without reading it."""
    found = [path.stat(), *(inner.stat() for inner in path.rglob("*"))] if path.is_dir() else [path.stat()]
    return [sum(one.st_size for one in found), max(one.st_mtime_ns for one in found)]


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def _read_record(path: Path) -> dict[str, Any]:
    """Record of earlier runs; a damaged record counts as none, so that nothing is taken for done wrongly."""
    if not path.exists() or path.stat().st_size > _LARGEST_RECORD:
        return {}
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        rows = data["files"] if data["format"] == _FORMAT and data["version"] == _VERSION else {}
        return {str(name): row for name, row in rows.items() if {"made_of", "output", "facts"} <= set(row)}
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return {}


def _write_record(path: Path, record: dict[str, Any]) -> None:
    data = {"format": _FORMAT, "version": _VERSION, "files": dict(sorted(record.items()))}
    with atomic_write(path) as file:
        file.write((json.dumps(data, indent=1) + "\n").encode())


def summary(results: Sequence[Replayed]) -> Iterator[str]:
    """A table for people: one line for each file, and what came of all."""
    wide = max([len(r.output) for r in results], default=0)
    for r in results:
        facts = ", ".join(
            f"{name} {value:.3g}" if isinstance(value, float) else f"{name} {value}" for name, value in r.facts.items()
        )
        yield f"{r.state:6}  {r.output:{wide}}  {r.seconds:6.1f} s  {r.message or facts}".rstrip()
    count = {state: sum(r.state == state for r in results) for state in ("done", "kept", "failed")}
    yield (
        f"{len(results)} files: {count['done']} done, {count['kept']} done before, {count['failed']} failed, "
        f"{sum(r.seconds for r in results):.1f} s"
    )


def as_rows(results: Sequence[Replayed]) -> list[dict[str, Any]]:
    """The same as plain data, for tables and JSON."""
    return [asdict(r) for r in results]
