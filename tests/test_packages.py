"""Parts that deformnb-core leaves out: each says what is missing and the command that installs it."""

from __future__ import annotations

import io
import re
import sys
from collections.abc import Callable

import numpy as np
import pytest

import deformnb as dn
from deformnb.app.start import check_app
from deformnb.errors import MissingPackageError
from deformnb.imaging.vtk_volume import check_gl, gl_status
from deformnb.io.meshes.vtp import write_vtp
from deformnb.warping.mesh import Mesh
from deformnb.widgets.view.volume_view import check_transport

TRIANGLE = Mesh(np.eye(3), np.array([[0, 1, 2]]))

CALLS: dict[str, tuple[Callable[[], object], str, str]] = {
    "application": (lambda: check_app("127.0.0.1", 0, None), "trame_rca", "app"),
    "pictures by trame": (lambda: check_transport("trame"), "trame_rca", "app"),
    "drawing by VTK": (check_gl, "vtkmodules", "vtk"),
    "VTP files": (lambda: write_vtp(TRIANGLE, io.BytesIO()), "vtkmodules", "vtk"),
    "surfaces of pyvista": (TRIANGLE.to_pyvista, "pyvista", "vtk"),
}


@pytest.mark.parametrize("part", CALLS)
def test_a_part_that_is_missing_is_named_with_its_command(part: str, monkeypatch: pytest.MonkeyPatch) -> None:
    call, package, extra = CALLS[part]
    for name in [name for name in sys.modules if name.partition(".")[0] == package]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)  # as Python does for a missing package
    gl_status.cache_clear()
    try:
        with pytest.raises(dn.errors.DeformError, match=re.escape(f'pip install "deformnb-core[{extra}]"')) as caught:
            call()
    finally:
        gl_status.cache_clear()
    assert isinstance(caught.value, MissingPackageError) or part == "drawing by VTK"
