"""The curve editor: f(z) of the extrusion rule "modulate", drawn by hand or given as a formula.

Values of its messages (see :mod:`~deformnb.widgets.edited`): ``{"nodes": [[z, f], ...], "smooth": true | false}`` or
``{"formula": text}``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import traitlets

from deformnb.errors import DeformError
from deformnb.expression import LONGEST
from deformnb.extrusion import modulate
from deformnb.widgets.assets import joined, style
from deformnb.widgets.curve_nodes import (
    MOST_NODES,
    PARTS,
    Nodes,
    exact_nodes,
    few_nodes,
    fewest_values,
    values_of,
)
from deformnb.widgets.edited import SCRIPTS, AbstractEdited, nodes_from_json

Curve = str | tuple[float, ...]

CURVES = {
    "constant 1": "1", "z": "z", "1 - z": "1-z", "sin(\u03c0 z)": "sin(pi*z)", "smoothstep": "z*z*(3-2*z)",
}
"""Formulas that the page offers, by the name it shows."""


class _CurveTrait(traitlets.TraitType[Curve, Curve]):
    """A formula in z or values at equal steps, as :class:`~deformnb.deformation.Step` takes them."""

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
    """What the page asks for: nodes, or a formula."""

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
    curve : a formula in z (see :mod:`deformnb.expression`) or at least two values at equal steps.
    range : least and greatest f that the plot shows; it grows if the curve goes beyond.
    smooth : True rounds the lines between nodes without overshooting.
    height : least height of the plot in CSS pixels; a wide page makes it a little larger.
    theme, label, read_only : as in :class:`~deformnb.widgets.Editor`.

    Notes
    -----
    ``curve`` is a trait and fits :class:`~deformnb.deformation.Step`: ``editor.observe(f, "curve")`` calls f after
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

    _esm = joined(*SCRIPTS, "curves.js", "curve_plot.js", "curve_editor.js")
    _css = style("curve_editor.css")

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
        self._take(self._checked({"nodes": rows, "smooth": bool(smooth)}))

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

    def _checked(self, value: Any) -> _Edit:
        if not isinstance(value, dict):
            raise DeformError("a curve is a formula or a list of nodes.")
        if "formula" in value:
            formula = value["formula"]
            if not isinstance(formula, str) or len(formula) > LONGEST:
                raise DeformError(f"a formula is a text of at most {LONGEST} characters.")
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

    def _told(self, edit: _Edit) -> Curve:
        return edit.curve

    @traitlets.observe("curve", "smooth")
    def _changed(self, change: Any) -> None:
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
        self._say(nodes=[list(node) for node in self.nodes], smooth=self.smooth, formula=formula,
                  samples=list(self.values(2 * PARTS + 1)) if self._nodes is None else [])

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
