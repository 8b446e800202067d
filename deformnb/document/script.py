"""Deformation as a short Python script that makes the same document: every edit is code.

Numbers are written so that reading them gives the same bits; arguments with their default value are left out.
"""

from __future__ import annotations

import dataclasses
import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.checks import check_arguments
from deformnb.document.deformation import Deformation, Step
from deformnb.document.json_reader import without_surrogates
from deformnb.document.json_regions import region_to_data
from deformnb.rbf.kernels import BUILT_IN
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Mask
from deformnb.rbf.support import ChosenSupport
from deformnb.volume.plane import Plane
from deformnb.volume.views import VIEWS
from deformnb.volume.volume import Grid, Volume

# Rows of coordinates on one line; a person reads a short list at a glance and a long one not at all.
_ROWS_ON_A_LINE = 3
_IN_A_ROW = 6

# Longer values than this get a variable in front.
_LONG = 80
_DEFAULTS = {f.name: f.default for f in dataclasses.fields(Step)}
_USUAL = {f.name: f.default for f in dataclasses.fields(Deformation) if f.name in ("mode", "easing", "loop")}
_PLAIN = tuple(name for name in _DEFAULTS if name not in ("maps", "plane", "extra", "chosen_support"))


UNKNOWN_VOLUME = (
    'dn.read_volume("volume.nii.gz")  # write it first: dn.write_volume(volume, "volume.nii.gz"), '
    "or put your own volume here"
)
"""Placeholder in a script for a volume of unknown origin; nothing may follow on the line."""

VOLUME_LINE = 3
"""The line of a script that gives the volume."""


def grid_expression(volume: Volume) -> str:
    """The expression of the grid on which deformations of a variable ``volume`` are stated."""
    return "volume.grid" if volume.level is None else "volume.finest_grid"


@check_arguments
def as_python(deformation: Deformation, grid: Grid, *, volume: str = UNKNOWN_VOLUME, own: str = "volume.grid") -> str:
    """A script that makes ``deformation`` and applies it.

    Parameters
    ----------
    deformation : the document; fields of a newer version (``extra``) and the volume's checksum are left out.
    grid : of the volume it was made on; its own axes are written by name ("+y").
    volume : expression that gives the volume.
    own : expression of ``grid``; see :func:`grid_expression`.

    Examples
    --------
    >>> points = ControlPoints.from_arrays([[0, 0], [9, 0]], [[0, 0], [9, 2.5]], names=["tail", "nose"])
    >>> grid = Grid((10, 10, 10))
    >>> print(as_python(Deformation.from_picture_points(grid, "+y", points), grid,
    ...                 volume='dn.read_volume("ct.nii.gz")'))
    import deformnb as dn
    <BLANKLINE>
    volume = dn.read_volume("ct.nii.gz")
    <BLANKLINE>
    points = dn.ControlPoints.from_arrays(
        source=[[0.0, 0.0], [9.0, 0.0]],
        target=[[0.0, 0.0], [9.0, 2.5]],
        names=["tail", "nose"],
    )
    <BLANKLINE>
    deformation = dn.Deformation.from_picture_points(volume, "+y", points)
    deformed = deformation.apply(volume)
    <BLANKLINE>
    """
    every = [*deformation.steps, *(step for key in deformation.keyframes for step in key.steps)]
    sets = iter(_names(sum(len(step.maps) for step in every)))
    blocks, steps = [_header(every), f"volume = {volume}"], []
    for step in every:
        names = [next(sets) for _ in step.maps]
        blocks += [f"{name} = {_points(points)}" for name, points in zip(names, step.maps, strict=True)]
        steps.append((step, names))
    shared = _Shared()
    made = _construction(deformation, steps, grid, shared, own)
    blocks += [f"{name} = {value}" for value, name in shared.names.items()]
    blocks.append(f"deformation = {made}\ndeformed = deformation.apply(volume)")
    return "\n\n".join(blocks) + "\n"


def _header(steps: list[Step]) -> str:
    """The import, and a comment on kernels that are registered first; without a line break, for volumes come after."""
    own = sorted({step.kernel for step in steps} - BUILT_IN)
    register = f"  # first dn.rbf.register_kernel(...) of {', '.join(own)}" if own else ""
    return f"import deformnb as dn{register}"


class _Shared:
    """Long values that several steps may have, each written once under a name."""

    def __init__(self) -> None:
        self.names: dict[str, str] = {}

    def name(self, kind: str, value: str) -> str:
        """Expression for a value: itself if it is short, else its name."""
        if len(value) <= _LONG:
            return value
        number = 1 + sum(name.startswith(f"{kind}_") for name in self.names.values())
        return self.names.setdefault(value, f"{kind}_{number}")


def _names(count: int) -> list[str]:
    return ["points"] if count == 1 else [f"points_{k + 1}" for k in range(count)]


def _construction(
    deformation: Deformation, steps: list[tuple[Step, list[str]]], grid: Grid, shared: _Shared, own: str
) -> str:
    step, names = steps[0] if len(steps) == 1 else (None, [])
    looks = "".join(
        f", {key}={_text(getattr(deformation, key))}"
        for key, usual in _USUAL.items()
        if key != "unit" and getattr(deformation, key) != usual
    )
    if deformation.output is not None:
        looks += f", output={_grid(deformation.output, grid, own)}"
    plain = not (deformation.name or deformation.keyframes or looks)
    if step is not None and step.plane is not None and len(names) == 1 and plain:
        view = _view(step.plane, grid)
        where = f'"{view}"' if view else _plane(step.plane, grid)
        return f"dn.Deformation.from_picture_points(volume, {where}, {names[0]}{_options(step, shared)})"
    lines = [
        f"dn.Step(({', '.join(names)},), {_plane(step.plane, grid)}{_options(step, shared)})" for step, names in steps
    ]
    looks += f", unit={_text(deformation.unit)}" if deformation.unit else ""
    count = len(deformation.steps)
    options = f", name={_text(deformation.name)}" if deformation.name else ""
    if deformation.keyframes:
        options += f", keyframes={_keyframes(deformation, lines[count:])}"
    return f"dn.Deformation({_list_text(lines[:count])}{options}{looks})"


def _keyframes(deformation: Deformation, lines: list[str]) -> str:
    made = []
    for key in deformation.keyframes:
        steps, lines = lines[: len(key.steps)], lines[len(key.steps) :]
        made.append(f"dn.Keyframe({_value(key.time)}, ({''.join(f'{line}, ' for line in steps).rstrip()}))")
    return _list_text(made)


def _list_text(lines: list[str]) -> str:
    return "(\n" + "".join(f"    {line},\n" for line in lines) + ")" if lines else "()"


def _points(points: ControlPoints) -> str:
    last = max((i + 1 for i in points.ids), default=0)
    if not len(points):
        options = "" if points.next_id == last else f", next_id={points.next_id}"
        return f"dn.ControlPoints.empty({points.dim}{options})"
    rows = {"source": _rows(points.source)}
    if not np.array_equal(points.source, points.target):
        rows["target"] = _rows(points.target)
    if points.ids != tuple(range(len(points))):
        rows["ids"] = repr(list(points.ids))
    if any(points.names):
        rows["names"] = f"[{', '.join(_text(n) for n in points.names)}]"
    if not points.active.all():
        rows["active"] = repr(points.active.tolist())
    if (points.weight != 1).any():
        rows["weight"] = repr(points.weight.tolist())
    if points.locked.any():
        rows["locked"] = repr(points.locked.tolist())
    if not np.isnan(points.radius).all():
        rows["radius"] = "[" + ", ".join("None" if np.isnan(r) else repr(r) for r in points.radius.tolist()) + "]"
    if points.next_id != last:  # points were removed: their ids must not be used again
        rows["next_id"] = str(points.next_id)
    return "dn.ControlPoints.from_arrays(\n" + "".join(f"    {key}={value},\n" for key, value in rows.items()) + ")"


def _rows(array: NDArray[np.float64]) -> str:
    rows = [repr(row) for row in array.tolist()]
    if len(rows) <= _ROWS_ON_A_LINE:
        return f"[{', '.join(rows)}]"
    chunks = [", ".join(rows[k : k + _ROWS_ON_A_LINE]) for k in range(0, len(rows), _ROWS_ON_A_LINE)]
    return "[\n        " + ",\n        ".join(chunks) + ",\n    ]"


def _view(plane: Plane, grid: Grid) -> str | None:
    return next((view for view in VIEWS if Plane.from_view(grid, view) == plane), None)


def _plane(plane: Plane | None, grid: Grid) -> str:
    if plane is None:
        return "None"
    view = _view(plane, grid)
    if view:
        return f'dn.Plane.from_view(volume, "{view}")'
    return f"dn.Plane({plane.origin!r}, {plane.u!r}, {plane.v!r})"


def _grid(output: Grid, grid: Grid, own: str) -> str:
    """The grid of a result: if it continues the voxels of the volume, as a part of those."""
    z, y, x = (int(n) for n in np.round(grid.point_to_index(output.origin))[::-1])
    if grid.crop((z, y, x), output.shape) == output:
        return f"{own}.crop(({z}, {y}, {x}), {output.shape})"
    return (
        f"dn.Grid({output.shape}, spacing={output.spacing}, origin={output.origin}, "
        f"direction={output.direction}{f', unit={output.unit!r}' if output.unit else ''})"
    )


def _options(step: Step, shared: _Shared) -> str:
    changed = [(name, getattr(step, name)) for name in _PLAIN if getattr(step, name) != _DEFAULTS[name]]
    if step.chosen_support != dataclasses.replace(step, chosen_support=None).chosen_support:
        changed.append(("chosen_support", step.chosen_support))
    return "".join(f", {name}={shared.name(name, _literal(value))}" for name, value in changed)


def _literal(value: Any) -> str:
    """A value as Python; a long table in rows."""
    if isinstance(value, tuple) and len(value) > _IN_A_ROW and isinstance(value[0], float):
        rows = [", ".join(map(repr, value[k : k + _IN_A_ROW])) for k in range(0, len(value), _IN_A_ROW)]
        return "(\n" + "".join(f"    {row},\n" for row in rows) + ")"
    return _value(value)


def _value(value: Any) -> str:
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, Mask):
        return f"dn.document.region_from_data({json.dumps(region_to_data(value))})"
    if isinstance(value, ChosenSupport):
        return f"({value.radius!r}, {_text(value.kernel)})"
    if dataclasses.is_dataclass(value):
        given = [(f.name, getattr(value, f.name), f.default) for f in dataclasses.fields(value)]
        return (
            f"dn.{type(value).__name__}("
            + ", ".join(f"{name}={_value(v)}" for name, v, default in given if v != default)
            + ")"
        )
    if isinstance(value, tuple) and value and not isinstance(value[0], float):
        return f"({''.join(f'{_value(v)}, ' for v in value).rstrip()})"
    return repr(value.item() if isinstance(value, np.generic) else value)  # NumPy's would need its name in the script


def _text(value: str) -> str:
    # Its escapes are Python's too, and the quotes are double as elsewhere.
    return without_surrogates(json.dumps(value, ensure_ascii=False))
