"""Undo and redo as a tree of states: an edit after an undo begins a branch, and undone states stay reachable.

States are immutable and share the parts that no edit changed. The memory of the tree is an estimate: each shared part
counts once, for any number of states that have it (:func:`weigh_part` estimates its size).
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, NamedTuple

import numpy as np

from deformnb.errors import DeformError
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Mask

MOST_STATES = 200
"""States that can be restored, in addition to the one that is shown."""

MOST_HISTORY_BYTES = 256 * 2**20
"""Largest memory of all states together."""

# Edits of one kind closer than this are one step of undo: arrow keys held down, a slider that moves.
_JOIN_SECONDS = 0.8
# A pointer on a slider may rest for so long within one drag.
_SLIDE_SECONDS = 30.0
# Python objects, roughly: one of any kind, and the id, the name and the switches of one control point.
_OBJECT, _POINT = 64, 100

Weigh = Callable[[Any], tuple[int, tuple[Any, ...]]]
"""The bytes of a part without the parts in it, and those parts."""


class HistoryNode(NamedTuple):
    """One state of the tree, in words.

    Attributes
    ----------
    id : never given twice.
    parent : the state that it was made from; None for the oldest one.
    label : the edit that led there; "" for the state that everything began with.
    time : when, in seconds since 1970.
    is_current : whether it is the one that is shown.
    is_on_way : whether undo and redo lead there.

    Examples
    --------
    >>> HistoryNode(0, None, "opened", 0.0, True, True).label
    'opened'
    """

    id: int
    parent: int | None
    label: str
    time: float
    is_current: bool
    is_on_way: bool


@dataclass
class _Node:
    id: int
    parent: int | None
    label: str
    time: float
    state: Any = None  # None while it is shown: the caller that shows it holds it
    children: list[int] = field(default_factory=list)  # the one that was seen last at the end

    @property
    def last(self) -> int | None:
        """State to which redo goes."""
        return self.children[-1] if self.children else None


class History:
    """Old states and their edits; edits of one kind in quick succession count as one.

    The state that is shown belongs to the caller, which passes it when it is left. Where there is no room,
    the oldest ends of branches that undo and redo do not lead to go first, then the oldest states of all; the one
    next to the shown one stays, whatever its size.

    Parameters
    ----------
    most : states that can be restored; most_bytes : their limit of memory.
    weigh : returns the parts of a state.

    Examples
    --------
    >>> history = History()
    >>> history.record("plain", "bend")
    >>> history.step("undo", "bent")
    ('plain', 'bend')
    >>> history.record("plain", "twist")
    >>> [(node.id, node.parent, node.label) for node in history.nodes()]
    [(0, None, ''), (1, 0, 'bend'), (2, 0, 'twist')]
    >>> history.go(1, "twisted")
    ('bent', 'bend')
    """

    def __init__(
        self, most: int = MOST_STATES, most_bytes: int = MOST_HISTORY_BYTES, weigh: Weigh | None = None
    ) -> None:
        self.most, self.most_bytes = most, most_bytes
        self._ledger = _Ledger(weigh or weigh_part)
        self._nodes = {0: _Node(0, None, "", time.time())}
        self._ids = itertools.count(1)
        self._root = self._current = 0
        self._kind: str | None = None
        self._at: float = -np.inf

    # -- edits and paths -----------------------------------------------------------------------------------------------

    def record(
        self, before: Any, label: str, kind: str | None = None, now: float | None = None, *, slides: bool = False
    ) -> None:
        """Store ``before``, the state that an edit leaves; kind None never joins the edit before it.

        Parameters
        ----------
        slides : it is one of a slider, which may be dragged slowly; see :meth:`start_drag`.
        """
        now = time.monotonic() if now is None else now
        here = self._nodes[self._current]
        patience = _SLIDE_SECONDS if slides else _JOIN_SECONDS
        joins = kind is not None and kind == self._kind and now - self._at < patience and here.parent is not None
        self._kind, self._at = kind, now
        if joins:
            here.time = time.time()
            return
        made = _Node(next(self._ids), here.id, label, time.time())
        self._leave(before)
        self._nodes[made.id] = made
        here.children.append(made.id)
        self._current = made.id
        self._prune()

    def start_drag(self) -> None:
        """The pointer has gone down on a slider: the drag joins no edit before."""
        self._kind = None

    def step(self, way: str, current: Any) -> tuple[Any, str] | None:
        """The state before ("undo") or after ("redo") the current one and those in between; None at the end.

        Parameters
        ----------
        current : the state that is shown, which can be restored from then on.
        """
        here = self._nodes[self._current]
        to = here.parent if way == "undo" else here.last
        if to is None:
            return None
        return self._arrive(to, current), here.label if way == "undo" else self._nodes[to].label

    def go(self, node: int, current: Any) -> tuple[Any, str]:
        """Any state of the tree, and the edits that led there.

        Parameters
        ----------
        node : its id; current : the state that is shown, which can be restored from then on.

        Raises
        ------
        DeformError
            If there is no such state, or no more.
        """
        if node not in self._nodes:
            raise DeformError(f"the history has no state {node!r} (any more); the older ends of branches go first.")
        state = current if node == self._current else self._arrive(node, current)
        return state, self._nodes[node].label

    def labels(self) -> dict[str, str]:
        """Labels of the edits that "undo" and "redo" would apply; empty where there is none."""
        here = self._nodes[self._current]
        return {
            "undo": here.label if here.parent is not None else "",
            "redo": self._nodes[here.last].label if here.last is not None else "",
        }

    def nodes(self) -> tuple[HistoryNode, ...]:
        """All states from the oldest to the newest."""
        way = self._visible_path()
        return tuple(
            HistoryNode(n.id, n.parent, n.label, n.time, n.id == self._current, n.id in way)
            for n in self._nodes.values()
        )

    @property
    def current(self) -> int:
        """The id of the state that is shown."""
        return self._current

    @property
    def bytes(self) -> int:
        """Memory of the reachable states; the current one belongs to the caller."""
        return self._ledger.total

    def __len__(self) -> int:
        return len(self._nodes)

    # -- the tree ------------------------------------------------------------------------------------------------------

    def _leave(self, state: Any) -> None:
        self._nodes[self._current].state = state
        self._ledger.retain(state)

    def _arrive(self, to: int, current: Any) -> Any:
        self._kind = None
        self._leave(current)
        node = self._nodes[to]
        state, node.state = node.state, None
        self._ledger.release(state)
        self._current = to
        while node.parent is not None:  # redo comes back here
            parent = self._nodes[node.parent]
            parent.children.remove(node.id)
            parent.children.append(node.id)
            node = parent
        self._prune()
        return state

    def _visible_path(self) -> set[int]:
        """From the oldest state to the one that is shown, and on to where redo ends."""
        way, at = set(), self._root
        while True:
            way.add(at)
            last = self._nodes[at].last
            if last is None:
                return way
            at = last

    def _prune(self) -> None:
        while len(self._nodes) > 2 and (len(self._nodes) > self.most + 1 or self._ledger.total > self.most_bytes):
            self._drop_one()

    def _drop_one(self) -> None:
        way = self._visible_path()
        gone = next((n for n in self._nodes.values() if not n.children and n.id not in way), None)
        if gone is None and self._root != self._current and self._nodes[self._current].parent != self._root:
            gone = self._nodes[self._root]  # only the path is left, so it has one child
            self._root = gone.children[0]
            self._nodes[self._root].parent = None
        elif gone is None:
            gone = self._last_redo()
        if gone.parent is not None:
            self._nodes[gone.parent].children.remove(gone.id)
        del self._nodes[gone.id]
        self._ledger.release(gone.state)

    def _last_redo(self) -> _Node:
        node = self._nodes[self._current]
        while node.last is not None:
            node = self._nodes[node.last]
        return node


# -- what states weigh -------------------------------------------------------------------------------------------------


@dataclass
class _Held:
    part: Any  # held, or another object could come by its id
    holders: int
    bytes: int
    inner: tuple[Any, ...]


class _Ledger:
    """Parts of states and their memory together, each counted once."""

    def __init__(self, weigh: Weigh) -> None:
        self.total = 0
        self._weigh = weigh
        self._held: dict[int, _Held] = {}

    def retain(self, part: Any) -> None:
        """One more holder of a part."""
        held = self._held.get(id(part))
        if held is not None:
            held.holders += 1
            return
        size, inner = self._weigh(part)
        self._held[id(part)] = _Held(part, 1, size, inner)
        self.total += size
        for other in inner:
            self.retain(other)

    def release(self, part: Any) -> None:
        """Remove one holder; the last of them frees the parts of the part."""
        held = self._held[id(part)]
        held.holders -= 1
        if held.holders == 0:
            del self._held[id(part)]
            self.total -= held.bytes
            for other in held.inner:
                self.release(other)


def weigh_part(part: Any) -> tuple[int, tuple[Any, ...]]:
    """The approximate bytes of a part of a document alone, and the parts in it.

    Control points, masks and arrays count as their numbers; everything else as some dozens of bytes for each object.

    Examples
    --------
    >>> weigh_part(np.zeros((10, 10)))
    (864, ())
    """
    if isinstance(part, np.ndarray):
        return part.nbytes + _OBJECT, ()
    if isinstance(part, ControlPoints):
        names = sum(map(len, part.names))
        arrays = [v for v in vars(part).values() if isinstance(v, np.ndarray)]
        return sum(a.nbytes for a in arrays) + _POINT * len(part) + names + _OBJECT, ()
    if isinstance(part, Mask):  # with its distances, which are measured as soon as it is used
        return part.values.size * (1 + np.dtype(np.float32).itemsize) + _OBJECT, ()
    if isinstance(part, str | bytes):
        return len(part) + _OBJECT, ()
    if isinstance(part, Mapping):
        inner = [*part.keys(), *part.values()]
    elif isinstance(part, tuple | list | frozenset | set):
        inner = list(part)
    elif is_dataclass(part):
        inner = [getattr(part, f.name) for f in fields(part)]
    else:
        return _OBJECT, ()
    plain = [v for v in inner if v is None or isinstance(v, bool | int | float)]
    return (
        _OBJECT + 8 * len(inner) + 24 * len(plain),
        tuple(v for v in inner if v is not None and not isinstance(v, bool | int | float)),
    )
