"""The table of parameters: its menus, the values that it takes, and the page of the documentation."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from deformnb.document.deformation import MODES
from deformnb.errors import DeformError
from deformnb.imaging.projection import PROJECTIONS
from deformnb.rbf.cuts import CUT_RULES
from deformnb.rbf.extrusion import EXTRUSIONS
from deformnb.rbf.kernels import KERNELS
from deformnb.rbf.trends import TRENDS
from deformnb.widgets.camera import SHOWS, SIDES
from deformnb.widgets.parameters import PARAMETERS, Choice, Number, Switch, as_json, as_markdown, parameters
from deformnb.widgets.protocol import OVERLAYS


@pytest.mark.parametrize(("name", "registry"), [
    ("view", SIDES), ("method", PROJECTIONS), ("kernel", KERNELS), ("trend", TRENDS), ("extrusion", EXTRUSIONS),
    ("shows", SHOWS), ("mode", MODES), ("overlay", OVERLAYS), ("cut_rule", CUT_RULES),
])
def test_menus_are_the_registries(name: str, registry: Any) -> None:
    parameter = PARAMETERS[name]
    assert isinstance(parameter, Choice)
    assert [value for value, _ in parameter.options] == list(registry)
    assert all(label.strip() for _, label in parameter.options)


@pytest.mark.parametrize(("parameter", "value"), [
    (Number("a", low=0, high=1), 1.5), (Number("a"), "0.5"), (Number("a"), None), (Number("a"), True),
    (Number("a"), float("inf")), (Switch("a"), 1), (Switch("a"), "true"), (Choice("a", registry=("b",)), "c"),
    (Choice("a", registry=("1",)), 1),
])
def test_wrong_values_are_refused(parameter: Any, value: Any) -> None:
    with pytest.raises(DeformError, match=r"^a "):
        parameter.checked(value)


@pytest.mark.parametrize("diagonal", [1e-3, 0.7, 350.0, 1e6])
def test_the_ends_of_a_logarithmic_range_can_be_set(diagonal: float) -> None:
    support = parameters(diagonal)["support"]
    assert isinstance(support, Number)
    for end in (support.low, support.high):  # as a slider gives them back
        assert support.checked(end * (1 + 1e-15)) == pytest.approx(end, rel=1e-12)
        assert support.low <= support.checked(end * (1 - 1e-15)) <= support.high


def test_what_a_page_without_python_gets_is_json() -> None:
    assert json.loads(json.dumps(as_json(tuple(PARAMETERS)))).keys() == PARAMETERS.keys()


def test_the_page_of_the_documentation_is_written_from_the_table() -> None:
    page = Path(__file__).parents[2] / "docs" / "parameters.md"
    assert page.read_text(encoding="utf-8") == as_markdown(), "run: python -m deformnb.widgets.parameters > docs/..."
