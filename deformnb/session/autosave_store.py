"""Store of autosaved sessions in a folder of the user: the list, the lost ones, and their contents.

Each is a file of two parts: a line of facts, and the document. Next to the file of a running session is an
empty one that its process holds (see :mod:`deformnb.io.files.atomic`): when the process ends, the system releases it,
and the edits that were not saved count as lost.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from deformnb.document.deformation import Deformation, VolumeReference
from deformnb.document.json_format import LONGEST_DOCUMENT, from_json, to_json
from deformnb.errors import DeformError
from deformnb.io.files.atomic import atomic_write, is_abandoned, sweep
from deformnb.io.files.errors import printable
from deformnb.io.files.folders import state_home
from deformnb.io.files.paths import as_path
from deformnb.volume.volume import Grid, VolumeLike

AUTOSAVE_FORMAT = "deformnb-autosave"
STATES = ("open", "saved", "closed", "skipped", "restored", "unchanged")
"""Of a session; "open" is lost when its process has gone, and the others are stored for a while.

A session that ends with edits that are in no file is "closed", however it was closed; it stays "open" only if its
process had no time to record it.
"""

MOST_PER_VOLUME, MOST_AUTOSAVES, MOST_AUTOSAVE_BYTES = 20, 200, 200 * 2**20
"""Largest number of sessions stored in addition to the open ones, and their size together; the newest stay.

No age counts: a clock may go wrong in both directions, and a holiday is longer than any number of days.
"""

_LONGEST_FACTS, _LONGEST_NAME = 8192, 200
_OF_VOLUME = ("shape", "spacing", "sha256", "origin", "direction", "unit")
_NUMBERS = ("points", "steps", "index", "key", "number")
_SUFFIX, _HELD = ".json", ".live"
_OURS = re.compile(r"[0-9a-f]{16}-\d+-[0-9a-f]+")  # as file_name makes them
skipped_here: set[Path] = set()
"""Sessions that are offered no more by this process, where their folder has become read-only."""


def state_folder() -> Path:
    """Folder of the sessions: below ``DEFORMNB_STATE`` if that is set, else in the user's own state folder."""
    return state_home() / "sessions"


@dataclass(frozen=True)
class SavedSession:
    """A session that was autosaved.

    Parameters
    ----------
    path : its file.
    volume : name of the deformed volume.
    edited : when the last edit was made.
    state : one of :data:`STATES`.
    points, steps : how many there are.
    index, key : which step, and which of its sets of points, was edited.
    number : higher than that of any session that existed when this one began, independent of the clock.
    """

    path: Path
    volume: VolumeReference
    edited: datetime
    state: str
    points: int
    steps: int
    index: int = 0
    key: int = 0
    number: int = 0

    @property
    def lock_path(self) -> Path:
        """The file that the session's process holds while it runs."""
        return self.path.with_suffix(_HELD)

    @property
    def is_live(self) -> bool:
        """True while the process that writes it runs."""
        return not is_abandoned(self.lock_path)

    @property
    def is_earlier(self) -> bool:
        """True if it ended with edits that are in no file, and is not offered: it is found in the history."""
        return self.state in ("closed", "skipped") and not self.is_live

    @property
    def is_lost(self) -> bool:
        """True if its process has died without closing it, as in a crash."""
        return self.state == "open" and self.path not in skipped_here and not self.is_live

    def __str__(self) -> str:
        return f"{moment(self.edited)} ({count_text(self.points, 'point')}, {count_text(self.steps, 'step')})"


def moment(when: datetime, now: datetime | None = None) -> str:
    """A time for people: of today the hour, else the day too.

    Examples
    --------
    >>> now = datetime(2026, 5, 3, 18, 0).astimezone()
    >>> moment(datetime(2026, 5, 3, 14, 32).astimezone(), now), moment(datetime(2026, 5, 1, 9, 5).astimezone(), now)
    ('14:32', '2026-05-01 09:05')
    """
    local, today = when.astimezone(), (now or datetime.now(UTC)).astimezone()
    return f"{local:%H:%M}" if local.date() == today.date() else f"{local:%Y-%m-%d %H:%M}"


def count_text(number: int, what: str) -> str:
    """A count with its noun.

    Examples
    --------
    >>> count_text(1, "step"), count_text(9, "point")
    ('1 step', '9 points')
    """
    return f"{number} {what}{'' if number == 1 else 's'}"


# -- the files ---------------------------------------------------------------------------------------------------------


def file_name(reference: VolumeReference, token: str) -> str:
    """The name of a session's file: first what identifies its volume, so that others need not be read."""
    return f"{reference.sha256[:16]}-{os.getpid()}-{token}{_SUFFIX}"


def next_number(folder: Path) -> int:
    """The number of a session that begins now."""
    return 1 + max((entry.number for entry in read_entries(folder)), default=0)


def write_session(entry: SavedSession, document: Deformation | str) -> None:
    """Write a session's file, whole or not at all; its folder is made if there is none.

    Raises
    ------
    DeformError, OSError
        If it cannot be written.
    """
    entry.path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    facts: dict[str, Any] = {
        "format": AUTOSAVE_FORMAT,
        "state": entry.state,
        "edited": entry.edited.isoformat(),
        **{name: getattr(entry, name) for name in _NUMBERS},
    }
    facts |= {name: getattr(entry.volume, name) for name in _OF_VOLUME} | {"name": entry.volume.name[:_LONGEST_NAME]}
    text = document if isinstance(document, str) else to_json(document)
    with atomic_write(entry.path) as stream:
        stream.write(json.dumps(facts).encode() + b"\n" + text.encode())


def read_session(path: Path) -> SavedSession | None:
    """The facts of a session's file; None if it is none."""
    try:
        with path.open("rb") as stream:
            data = json.loads(stream.readline(_LONGEST_FACTS))
        if data["format"] != AUTOSAVE_FORMAT or data["state"] not in STATES:
            return None
        edited = datetime.fromisoformat(data["edited"])
        grid = Grid(tuple(data["shape"]), data["spacing"], data["origin"], data["direction"], data.get("unit", ""))
        volume = VolumeReference(
            str(data["name"])[:_LONGEST_NAME],
            grid.shape,
            grid.spacing,
            str(data["sha256"]),
            grid.origin,
            grid.direction,
            grid.unit,
        )
        numbers = {name: int(data.get(name, 0)) for name in _NUMBERS}
        return SavedSession(path, volume, edited.astimezone(UTC), data["state"], **numbers)
    except (OSError, ValueError, TypeError, LookupError, OverflowError, RecursionError):
        return None


def read_entries(folder: Path, prefix: str = "") -> list[SavedSession]:
    """Sessions in a folder whose file names begin so, the newest first."""
    found = (read_session(path) for path in folder.glob(f"{prefix}*{_SUFFIX}"))
    return sorted(
        (entry for entry in found if entry is not None), key=lambda entry: (entry.number, entry.edited), reverse=True
    )


# -- for users ---------------------------------------------------------------------------------------------------------


def saved_sessions(
    volume: VolumeLike | VolumeReference, folder: Path | None = None, *, every: bool = False
) -> list[SavedSession]:
    """Sessions on a volume that were lost, the newest first.

    Parameters
    ----------
    volume : which; takes a moment for a large one, for its checksum.
    folder : of the files; default is :func:`state_folder`.
    every : those too that were saved, closed, skipped or restored, or are running.

    Examples
    --------
    >>> from deformnb.datasets import PHANTOMS
    >>> saved_sessions(PHANTOMS["bar"].make((8, 8, 8)))
    []
    """
    reference = volume if isinstance(volume, VolumeReference) else VolumeReference.of(volume)
    found = read_entries(as_path(folder) if folder else state_folder(), reference.sha256[:16])
    return [entry for entry in found if _same(entry.volume, reference) and (every or entry.is_lost)]


def _same(one: VolumeReference, other: VolumeReference) -> bool:
    """The same voxels at the same places: points are places."""
    a, b = one.grid, other.grid
    return one.sha256 == other.sha256 and a is not None and b is not None and a.is_like(b)


def restore(entry: SavedSession) -> Deformation:
    """The document of a session as it was last written.

    Raises
    ------
    DeformError
        If its file is missing or damaged.

    Examples
    --------
    >>> from deformnb.datasets.phantoms import PHANTOMS
    >>> from deformnb.session.autosave import Autosave
    >>> from deformnb.session.session import Session
    >>> session = Session(PHANTOMS["bar"].make((8, 8, 16)))
    >>> autosave = Autosave(session)
    >>> session.editing.change(strength=0.5)
    >>> autosave.flush()
    >>> (entry,) = saved_sessions(session.volume, every=True)
    >>> restore(entry).steps[0].strength
    0.5
    >>> autosave.close()
    True
    """
    return from_json(_text(entry))


def skip(entry: SavedSession) -> None:
    """Offer a session no more; its file stays for a while."""
    skipped_here.add(entry.path)
    mark(entry, "skipped")


def delete(entry: SavedSession) -> None:
    """Remove a session's file.

    Raises
    ------
    DeformError
        If it cannot be removed.
    """
    try:
        entry.path.unlink(missing_ok=True)
        sweep(entry.lock_path)
    except OSError as error:
        raise DeformError(f"{printable(entry.path)} cannot be removed: {error.strerror or error}.") from None


def mark(entry: SavedSession, state: str) -> None:
    """Give a session another state, if its file can be written."""
    with suppress(OSError, DeformError):
        write_session(replace(entry, state=state), _text(entry))


def _text(entry: SavedSession) -> str:
    try:
        with entry.path.open("rb") as stream:
            stream.readline(_LONGEST_FACTS)
            return stream.read(LONGEST_DOCUMENT + 1).decode("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise DeformError(f"the session of {moment(entry.edited)} cannot be read any more: {error}.") from None


# -- limits of the history ---------------------------------------------------------------------------------------------


def prune(folder: Path) -> None:
    """Remove the oldest files beyond the limits; never an open one: it is running, or its offer is not answered yet.

    The folder may be one of the user's: files that are not named as those of sessions are ignored.
    """
    with suppress(OSError):
        for held in _session_files(folder, _HELD):
            if is_abandoned(held):
                sweep(held)
        there = list(_session_files(folder, _SUFFIX))  # before they are read: what others write meanwhile stays
        kept = {entry.path for entry in _select_retained(read_entries(folder))}
        for path in there:
            if path not in kept and not path.with_suffix(_HELD).exists():
                path.unlink(missing_ok=True)


def _session_files(folder: Path, suffix: str) -> Iterator[Path]:
    return (path for path in folder.glob(f"*{suffix}") if _OURS.fullmatch(path.stem))


def _select_retained(entries: Iterable[SavedSession]) -> list[SavedSession]:
    """Of sessions, the newest first: those that are open, and of the others those within the bounds."""
    kept: list[SavedSession] = []
    counts: dict[str, int] = {}
    size = most = 0
    for entry in entries:
        if entry.state == "open":
            kept.append(entry)
            continue
        own = counts.get(entry.volume.sha256, 0)
        size += entry.path.stat().st_size
        if own < MOST_PER_VOLUME and most < MOST_AUTOSAVES and size <= MOST_AUTOSAVE_BYTES:
            kept.append(entry)
            counts[entry.volume.sha256] = own + 1
            most += 1
    return kept
