"""The choice at a cut (Eq. 8) is one text of shaders: in VTK's as in the page's."""

from __future__ import annotations

import pytest

from deformnb.rbf.cuts import CUT_RULES
from deformnb.widgets.bundle import bundle
from deformnb.widgets.vtk.shader import cut_choice, cut_glsl


@pytest.mark.parametrize("rule", CUT_RULES)
def test_vtk_and_the_page_have_the_same_choice(rule: str) -> None:
    text = cut_choice()
    assert text in cut_glsl(((False,), (True,)), rule, False, "", "")
    code = [line for line in text.splitlines() if line and not line.startswith("//")]
    assert len(code) > 8
    page = bundle("live_view.js")
    assert all(line in page for line in code)
