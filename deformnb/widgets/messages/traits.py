"""Traits that a front end sets: only those that it owns, each checked; a wrong one is logged and costs no other."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import traitlets

from deformnb.errors import DeformError
from deformnb.widgets.messages.record import LARGEST_NUMBER, LONGEST_MESSAGE, LONGEST_NAME, check_size

OVERLAYS = ("none", "folds", "area", "strain", "uncertainty")
"""Overlays of an editor's picture."""

_LOG = logging.getLogger(__name__)


def checked_state(state: Any, own: Mapping[str, Callable[[Any], None]]) -> dict[str, Any]:
    """The part of a state update by the front end that is right; the rest is logged and dropped.

    Parameters
    ----------
    state : traits and their values.
    own : checks of the traits of this kind of editor, in addition to those that all have.
    """
    if not isinstance(state, dict):
        _LOG.warning("a state update of an editor was dropped: it is no object.")
        return {}
    kept = {}
    for name, value in state.items():
        try:
            check_size(value, LONGEST_MESSAGE)
            _check_trait(name, value, own)
            kept[name] = value
        except DeformError as error:
            _LOG.warning("the trait %.40r from the page was dropped: %s", name, error)
    return kept


def _check_trait(name: Any, value: Any, own: Mapping[str, Callable[[Any], None]]) -> None:
    if name == "selected":
        if not isinstance(value, list) or not all(_is_id(v) for v in value):
            raise DeformError("a selection is a list of ids.")
    elif name in ("show_grid", "show_radius"):
        if not isinstance(value, bool):
            raise DeformError("it must be true or false.")
    elif name == "overlay":
        if value not in OVERLAYS:
            raise DeformError(f"there is no such overlay; choose one of {', '.join(OVERLAYS)}.")
    elif name in own:
        own[name](value)
    elif name != "_view_count" or not (value is None or _is_id(value)):  # ipywidgets counts views, on request
        raise DeformError("the page does not own it.")


def _is_id(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= LARGEST_NUMBER


@contextmanager
def log_mistakes(what: str) -> Iterator[None]:
    """Take a message of a front end: a mistake is logged and dropped, never raised into the front end's channel."""
    try:
        yield
    except (traitlets.TraitError, ValueError, TypeError, KeyError) as error:
        _LOG.warning("%s of the page was dropped: %s", what, error)


def take_traits(said: Any, of_page: Collection[str], put: Callable[[dict[str, Any]], Any]) -> None:
    """Put the trait values that a front end sends, one by one: a wrong one is logged, dropped, and costs no other.

    Parameters
    ----------
    said : values by name; of_page : the names a front end may decide on.
    """
    for name, value in dict(said).items():
        with log_mistakes("a trait"):
            if name not in of_page:
                raise ValueError(f"the page does not decide on {str(name)[:LONGEST_NAME]!r}")
            put({name: value})
