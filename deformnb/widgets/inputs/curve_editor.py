"""Curve editor: f(z) of the extrusion rule "modulate", drawn with the pointer or given as a formula.

Values of its messages (see :mod:`deformnb.widgets.inputs.base`): ``{"nodes": [[z, f], ...], "smooth": true | false}``
or ``{"formula": text}``.

Curves over [0, 1] pass through nodes; the module has their values, and the nodes that draw a given curve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import gcd
from typing import Any, TypeAlias

import numpy as np
import traitlets
from numpy.typing import ArrayLike, NDArray

from deformnb._deferred import scipy
from deformnb.errors import DeformError
from deformnb.rbf.extrusion import FRONT_ONLY, LONGEST_FORMULA, modulate
from deformnb.widgets.bundle import bundle
from deformnb.widgets.inputs.base import AbstractEdited, nodes_from_json

Nodes: TypeAlias = tuple[tuple[float, float], ...]

PARTS = 128
"""The front end puts nodes at multiples of 1/128, so that 129 values hold a curve exactly and give its nodes back."""

MOST_NODES = 64
"""More cannot be resolved on a plot of 360 pixels."""

# Of the height: invisible differences, and those of rounding.
_SEEN, _ROUNDING = 0.004, 1e-9


def values_of(nodes: Nodes, z: ArrayLike, smooth: bool = False) -> NDArray[np.float64]:
    """The curve through nodes at z: straight lines, or if ``smooth`` the cubic that never overshoots.

    >>> values_of(((0, 0), (0.5, 1), (1, 0)), [0.0, 0.25, 0.75]).tolist()
    [0.0, 0.5, 0.5]
    """
    at, (x, y) = np.asarray(z, dtype=np.float64), np.asarray(nodes, dtype=np.float64).T
    if not smooth or len(x) < 3:
        return np.interp(at, x, y)
    return np.asarray(scipy.interpolate.PchipInterpolator(x, y)(np.clip(at, x[0], x[-1])), dtype=np.float64)


def fewest_values(nodes: Nodes) -> int:
    """The fewest values at equal steps that hold the straight lines through nodes exactly, at most 129.

    >>> fewest_values(((0, 0), (0.25, 1), (1, 1)))
    5
    """
    at = [x * PARTS for x, _ in nodes]
    if any(abs(a - round(a)) > 1e-9 * PARTS for a in at):
        return PARTS + 1
    return PARTS // gcd(PARTS, *(round(a) for a in at)) + 1


def exact_nodes(values: Sequence[float]) -> Nodes | None:
    """The nodes whose straight lines are these values at equal steps; None if there are too many.

    >>> exact_nodes((0.0, 0.5, 1.0, 1.0))
    ((0.0, 0.0), (0.666..., 1.0), (1.0, 1.0))
    """
    y = np.asarray(values, dtype=np.float64)
    bends = np.abs(np.diff(y, 2)) > _ROUNDING * _height(y)
    kept = np.concatenate(([0], np.flatnonzero(bends) + 1, [len(y) - 1]))
    if len(kept) > MOST_NODES:
        return None
    return tuple((float(k / (len(y) - 1)), float(y[k])) for k in kept)


def few_nodes(values: Sequence[float], most: int = 9) -> Nodes:
    """At most ``most`` nodes that draw these values at equal steps about as well as so few can.

    Even spacing where it does as well, for it is easier to read; else a node wherever the lines err most.
    """
    z, y = np.linspace(0.0, 1.0, len(values)), np.asarray(values, dtype=np.float64)
    best: Nodes = ()
    for count in (n for n in (2, 3, 5, 9) if n <= most):
        x = np.round(np.linspace(0, 1, count) * PARTS) / PARTS
        best = tuple(zip(x.tolist(), np.interp(x, z, y).tolist(), strict=True))
        if _error(best, z, y) <= _SEEN * _height(y):
            return best
    chosen = _greedy(z, y, most)
    return chosen if _error(chosen, z, y) < 0.7 * _error(best, z, y) else best


def _greedy(z: NDArray[np.float64], y: NDArray[np.float64], most: int) -> Nodes:
    grid = np.arange(PARTS + 1) / PARTS
    on_grid, kept = np.interp(grid, z, y), [0, PARTS]
    while len(kept) < most:
        off = np.abs(np.interp(grid, grid[kept], on_grid[kept]) - on_grid)
        if off.max() <= _SEEN * _height(y):
            break
        kept = sorted({*kept, int(off.argmax())})
    return tuple((float(grid[k]), float(on_grid[k])) for k in kept)


def _error(nodes: Nodes, z: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    return float(np.abs(values_of(nodes, z) - y).max())


def _height(y: NDArray[np.float64]) -> float:
    return max(float(np.ptp(y)), float(np.abs(y).max()), 1e-12)


Curve = str | tuple[float, ...]

CURVES = {
    "constant 1": "1",
    "z": "z",
    "1 - z": "1-z",
    "front only": FRONT_ONLY,
    "sin(\u03c0 z)": "sin(pi*z)",
    "smoothstep": "z*z*(3-2*z)",
}
"""Formulas that the front end offers, by the name it shows."""


class _CurveTrait(traitlets.TraitType[Curve, Curve]):
    """A formula in z or values at equal steps, as :class:`~deformnb.document.deformation.Step` takes them."""

    info_text = "a formula in z or a tuple of numbers"

    def validate(self, obj: Any, value: Any) -> Curve:
        if isinstance(value, str):
            modulate(value)
            return value.strip()
        if callable(value):
            raise DeformError("a curve editor takes a formula or values at equal steps; a function has no nodes.")
        return tuple(float(v) for v in modulate(value)[1][0])


@dataclass(frozen=True)
class _Edit:
    """Request of the front end: nodes, or a formula."""

    nodes: Nodes
    smooth: bool
    formula: str

    @property
    def curve(self) -> Curve:
        """As a step takes it: as few values as hold the lines exactly."""
        if self.formula:
            return self.formula
        count = PARTS + 1 if self.smooth else fewest_values(self.nodes)
        return tuple(values_of(self.nodes, np.linspace(0.0, 1.0, count), self.smooth).tolist())


class CurveEditor(AbstractEdited):
    """A curve f(z) over the depth z in [0, 1].

    Parameters
    ----------
    curve : a formula in z (see :mod:`deformnb.rbf.extrusion`) or at least two values at equal steps.
    range : least and greatest f that the plot shows; it grows if the curve goes beyond.
    smooth : True rounds the lines between nodes without overshooting.
    height : least height of the plot in CSS pixels; a wide window makes it a little larger.
    theme, label, read_only : as in :class:`~deformnb.widgets.Editor`.

    Notes
    -----
    ``curve`` is a trait and fits :class:`Step`: ``editor.observe(f, "curve")`` calls f after
    every edit. A formula is drawn as it is until a node is picked up, which turns it into nodes.

    Raises
    ------
    DeformError
        For a curve that is not finite or no formula; the old one stays.

    Examples
    --------
    >>> editor = CurveEditor("4*z*(1-z)")
    >>> editor.values(5)
    (0.0, 0.75, 1.0, 0.75, 0.0)
    >>> editor.set_nodes([(0, 1), (0.5, 1), (1, 0)])
    >>> editor.curve
    (1.0, 1.0, 0.0)
    """

    _esm = bundle("curve_editor.js")
    _css = bundle("curve_editor.css")

    curve = _CurveTrait("z")
    range = traitlets.Tuple(traitlets.Float(), traitlets.Float(), default_value=(-1.0, 1.5)).tag(sync=True)
    smooth = traitlets.Bool(False)
    height = traitlets.Int(150, min=80, max=1024).tag(sync=True)
    presets = traitlets.Dict(CURVES, read_only=True).tag(sync=True)

    def __init__(self, curve: Any = "z", **traits: Any) -> None:
        self._nodes: Nodes | None = None
        super().__init__(curve=curve, **{"label": "Curve over the depth", **traits})
        self._show()

    @property
    def nodes(self) -> Nodes:
        """The nodes (z, f); for a formula, or values that need too many, a few that come near."""
        return self._nodes or few_nodes(self.values())

    def set_nodes(self, nodes: Any, smooth: bool = False) -> None:
        """Draw another curve.

        Parameters
        ----------
        nodes : pairs (z, f), z rising from 0 to 1.
        smooth : True rounds the lines between them.
        """
        try:
            rows = [[float(z), float(f)] for z, f in nodes]
        except (TypeError, ValueError):
            raise DeformError("the nodes of a curve must be pairs (z, f) of numbers.") from None
        self._take(self._check_value({"nodes": rows, "smooth": bool(smooth)}))

    def values(self, count: int = PARTS + 1) -> tuple[float, ...]:
        """The curve at ``count`` equal steps from 0 to 1."""
        if count < 2:
            raise DeformError(f"a curve needs at least two values, got {count}.")
        z = np.linspace(0.0, 1.0, count)
        if self._nodes is not None:
            return tuple(values_of(self._nodes, z, self.smooth).tolist())
        knots, weights = modulate(self.curve)
        return tuple(np.interp(z, knots, weights[0]).tolist())

    # ---- edits ------------------------------------------------------------------------------------------------------

    def _check_value(self, value: Any) -> _Edit:
        if not isinstance(value, dict):
            raise DeformError("a curve is a formula or a list of nodes.")
        if "formula" in value:
            formula = value["formula"]
            if not isinstance(formula, str) or len(formula) > LONGEST_FORMULA:
                raise DeformError(f"a formula is a text of at most {LONGEST_FORMULA} characters.")
            modulate(formula)
            return _Edit((), False, formula.strip())
        nodes = nodes_from_json(value.get("nodes"), 2, MOST_NODES)
        if nodes[0][0] != 0 or nodes[-1][0] != 1 or (np.diff([z for z, _ in nodes]) < 1e-6).any():
            raise DeformError("the nodes of a curve must rise from z = 0 to z = 1.")
        if not isinstance(value.get("smooth"), bool):
            raise DeformError("smooth must be true or false.")
        return _Edit(nodes, value["smooth"], "")

    def _take(self, edit: _Edit) -> None:
        self._nodes = None if edit.formula else edit.nodes
        with self.hold_trait_notifications():  # observers of one see the other
            if not edit.formula:
                self.smooth = edit.smooth
            self.curve = edit.curve
        self._show()

    def _callback_value(self, edit: _Edit) -> Curve:
        return edit.curve

    @traitlets.observe("curve", "smooth")
    def _handle_change(self, change: Any) -> None:
        if self._nodes is not None and change["name"] == "smooth":
            self.curve = _Edit(self._nodes, self.smooth, "").curve
        elif isinstance(self.curve, str):
            self._nodes = None
        elif self._nodes is None or _Edit(self._nodes, self.smooth, "").curve != self.curve:
            self._nodes = exact_nodes(self.curve)
            self.smooth = False
        self._show()

    def _show(self) -> None:
        formula = self.curve if isinstance(self.curve, str) else ""
        self._set_content(
            nodes=[list(node) for node in self.nodes],
            smooth=self.smooth,
            formula=formula,
            samples=list(self.values(2 * PARTS + 1)) if self._nodes is None else [],
        )

    @traitlets.validate("range")
    def _a_range(self, proposal: Any) -> tuple[float, float]:
        low, high = (float(v) for v in proposal["value"])
        if not (np.isfinite([low, high]).all() and low < high):
            raise DeformError(f"the range of a plot must rise, got {low:g} to {high:g}.")
        return low, high

    def __repr__(self) -> str:
        if self._nodes is None:
            curve = self.curve if isinstance(self.curve, str) else f"{len(self.curve)} values"
            return f"CurveEditor({curve!r})"
        return f"CurveEditor({len(self._nodes)} nodes{', smooth' if self.smooth else ''})"
