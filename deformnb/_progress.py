"""The remaining time of a task, as text."""

from __future__ import annotations

_SURE = 2.0  # seconds of work, before which its pace is a guess
_BEGUN = 0.02  # share of the work, likewise


def remaining_time(elapsed: float, share: float) -> str:
    """The remaining time of a piece of work at constant speed: ``elapsed * (1 - share) / share``.

    Empty where that would be a guess, and for work that is done.

    Parameters
    ----------
    elapsed : seconds since it was begun.
    share : of it that is done, from 0 to 1.

    Examples
    --------
    >>> remaining_time(10.0, 0.25)
    'about 30 s left'
    >>> remaining_time(10.0, 0.03)
    'about 5 min left'
    """
    if elapsed < _SURE or not _BEGUN <= share < 1:
        return ""
    left = elapsed * (1 - share) / share
    if left < 90:
        return f"about {max(1, round(left) if left < 10 else 5 * round(left / 5))} s left"
    return f"about {round(left / 60)} min left" if left < 5400 else f"about {left / 3600:.1f} h left"
