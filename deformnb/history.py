"""Undo and redo: a list of old states, whatever they are."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np

# Edits of one kind closer than this are one step of undo: arrow keys held down, a slider on its way.
_JOIN_SECONDS = 0.8
_MOST_UNDO = 200


@dataclass
class History:
    """Old states and what was done to each; edits of one kind in quick succession count as one."""

    most: int = _MOST_UNDO
    past: list[tuple[Any, str]] = field(default_factory=list)
    future: list[tuple[Any, str]] = field(default_factory=list)
    _kind: str | None = None
    _at: float = -np.inf

    def record(self, before: Any, label: str, kind: str | None = None, now: float | None = None) -> None:
        """Keep ``before``, the state that an edit leaves; kind None never joins the edit before it."""
        now = time.monotonic() if now is None else now
        joins = kind is not None and kind == self._kind and now - self._at < _JOIN_SECONDS and bool(self.past)
        if not joins:
            self.past.append((before, label))
            del self.past[: -self.most]
        self.future.clear()
        self._kind, self._at = kind, now

    def step(self, way: str, current: Any) -> tuple[Any, str] | None:
        """The state before ("undo") or after ("redo") the current one and what lies between; None at the end."""
        source, other = (self.past, self.future) if way == "undo" else (self.future, self.past)
        if not source:
            return None
        state, label = source.pop()
        other.append((current, label))
        self._kind = None
        return state, label

    def labels(self) -> dict[str, str]:
        """What "undo" and "redo" would take back or do again; empty where there is nothing."""
        return {"undo": self.past[-1][1] if self.past else "", "redo": self.future[-1][1] if self.future else ""}
