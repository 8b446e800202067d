"""The table of parameters: its menus, the values that it takes, and the page of the documentation."""

from __future__ import annotations

import json
from typing import Any

import pytest

from deformnb.document.deformation import MODES
from deformnb.imaging.projection import PROJECTIONS
from deformnb.rbf.cuts import CUT_RULES
from deformnb.rbf.extrusion import EXTRUSIONS
from deformnb.rbf.kernels import KERNELS
from deformnb.rbf.trends import TRENDS
from deformnb.volume.views import SIDES
from deformnb.widgets.camera import SHOWS
from deformnb.widgets.messages.traits import OVERLAYS
from deformnb.widgets.parameters import PARAMETERS, Choice, as_json


@pytest.mark.parametrize(
    ("name", "registry"),
    [
        ("view", SIDES),
        ("method", PROJECTIONS),
        ("kernel", KERNELS),
        ("trend", TRENDS),
        ("extrusion", EXTRUSIONS),
        ("shows", SHOWS),
        ("mode", MODES),
        ("overlay", OVERLAYS),
        ("cut_rule", CUT_RULES),
    ],
)
def test_menus_are_the_registries(name: str, registry: Any) -> None:
    parameter = PARAMETERS[name]
    assert isinstance(parameter, Choice)
    assert [value for value, _ in parameter.options] == list(registry)
    assert all(label.strip() for _, label in parameter.options)


def test_what_a_page_without_python_gets_is_json() -> None:
    assert json.loads(json.dumps(as_json(tuple(PARAMETERS)))).keys() == PARAMETERS.keys()
