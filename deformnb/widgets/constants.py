"""Constants that Python and the front end share, written out as ``maths/constants.ts``.

``python -m deformnb.widgets.constants > frontend/src/maths/constants.ts`` writes the file anew; a test compares.
"""

from __future__ import annotations

import json

from deformnb import checks
from deformnb.analysis import folds
from deformnb.imaging import occlusion
from deformnb.rbf import (
    conditioning,
    cross_validation,
    exactness,
    interpolant,
    kernels,
    regions,
    rigid,
    slits,
    stages,
    trends,
)
from deformnb.volume import units
from deformnb.widgets import edit_messages

CONSTANTS: dict[str, tuple[object, tuple[str, ...]]] = {
    "conditioning": (
        conditioning,
        (
            "LARGEST_SET",
            "SAME_PLACE",
            "SAME_DISPLACEMENT",
            "LONGEST_SHARE",
            "COLLAPSED",
            "FAR_BEHIND",
            "SAME_DISTANCE",
            "NEAREST",
            "NEAREST_AND_EQUAL",
        ),
    ),
    "cross_validation": (cross_validation, ("MOST_LEFT_OUT",)),
    "exactness": (exactness, ("RESIDUAL", "ROUNDING", "MOST_MISSED")),
    "interpolant": (interpolant, ("MOST_GAIN", "STEEP")),
    "kernels": (kernels, ("TINY",)),
    "folds": (folds, ("NEARLY_FOLDED",)),
    "checks": (checks, ("LARGEST_COORDINATE",)),
    "trends": (trends, ("NO_ANGLE", "FLAT", "THIN", "THIN_BEND", "SOFTNESS", "LEAST_SPREAD")),
    "regions": (regions, ("LARGEST_SHAPE",)),
    "rigid": (rigid, ("SAME_MOTION",)),
    "slits": (slits, ("MOST_SLITS",)),
    "stages": (stages, ("MOST_STAGES",)),
    "occlusion": (occlusion, ("AMBIENT_CELL", "AMBIENT_NEAR", "AMBIENT_FAR", "AMBIENT_AHEAD", "AMBIENT_EVEN")),
    "units": (units, ("UNIT_METRES", "UNIT_WORDS", "UNIT_LOWER_WORDS", "NO_UNITS")),
    "edit_messages": (edit_messages, ("LONGEST_EDIT",)),
}
"""The modules by name, and the constants of each that the front end needs too; their reasons are there."""


def as_typescript() -> str:
    """The module of the front end.

    Examples
    --------
    >>> "export const MOST_STAGES = 64;" in as_typescript()
    True
    """
    lines = ["// Constants of the package, written by: python -m deformnb.widgets.constants. Change them there."]
    for name, (module, names) in CONSTANTS.items():
        lines += ["", f"// {name}.py"]
        lines += [f"export const {constant} = {json.dumps(getattr(module, constant))};" for constant in names]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(as_typescript(), end="")  # noqa: T201
