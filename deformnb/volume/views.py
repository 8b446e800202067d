"""The six viewing directions: their names and how they are called in words."""

from __future__ import annotations

from typing import Literal, TypeAlias, get_args

ViewName: TypeAlias = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
"""Names of the viewing directions."""

VIEWS: tuple[ViewName, ...] = get_args(ViewName)
"""Viewing directions. "+y" views along growing y: in LPS from the front (anterior) to the back of a patient."""

SIDES = {
    "+y": "from the front (+y)",
    "-y": "from behind (-y)",
    "+x": "from the right (+x)",
    "-x": "from the left (-x)",
    "-z": "from above (-z)",
    "+z": "from below (+z)",
}
"""The six views in words, for a patient or an animal in LPS."""

AXIS_SIDES = {
    "+y": "along +y",
    "-y": "along -y",
    "+x": "along +x",
    "-x": "along -x",
    "-z": "along -z",
    "+z": "along +z",
}
"""The same where it is not known how a body lies along the axes."""


def side_words(view: str, *, is_anatomical: bool) -> str:
    """A viewing direction in words: a side of the patient where the directions of the grid are known, else an axis.

    Examples
    --------
    >>> side_words("+y", is_anatomical=True), side_words("+y", is_anatomical=False)
    ('from the front (+y)', 'along +y')
    """
    return (SIDES if is_anatomical else AXIS_SIDES)[view]
