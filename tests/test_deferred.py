"""JAX and SciPy come at their first use: SciPy not before a studio's preview, JAX with all that is registered later."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import jax
import pytest

import deformnb

SHOWN = """
import sys
import deformnb as dn
studio = dn.Studio(dn.datasets.PHANTOMS["bar"].make((128, 128, 256)))
studio.wait()
dn.Studio.warm_up = lambda self: print("warm up")
bundle = studio._repr_mimebundle_()
data = bundle[0] if isinstance(bundle, tuple) else bundle
view = studio.view
def receive(content):
    view.comm.handle_msg({"content": {"data": {"method": "custom", "content": content}}, "buffers": []})
hello = {"type": "hello", "view": "page", "largest": 2048, "renderer": "", "software": True}
receive(hello)
info = view.volume_info
for index in range(info["chunks"]):
    print("piece", index)
    receive({"type": "chunk", "view": "page", "id": info["id"], "index": index})
print(sorted(data), [name for name in ("jax", "scipy", "matplotlib", "vtkmodules") if name in sys.modules])
studio.close()
"""

NAMED = """
import sys
import deformnb as dn
assert dn.Studio
print([name for name in ("jax", "scipy") if name in sys.modules])
"""

REGISTERED = """
import deformnb as dn
from deformnb.rbf.fields import Affine
import numpy as np
before = Affine(2 * np.eye(3), np.zeros(3))
import jax
print(len(jax.tree_util.tree_leaves(before)), len(jax.tree_util.tree_leaves(dn.HalfSpace((0, 0, 0), (0, 0, 1)))))
"""

AFTERWARDS = "import jax\n" + REGISTERED

THREADS = """
import threading
import deformnb as dn
from deformnb.rbf.fields import Affine
import numpy as np
points = dn.ControlPoints.from_arrays([[0, 0], [9, 0], [0, 9], [5, 5]], [[0, 0], [9, 1], [0, 9], [6, 5]])
found, gate = [], threading.Barrier(4)

def work():
    gate.wait()
    found.append(dn.fit_rbf(points).displacement([6.0, 5.0]).round(9).astype(int).tolist())

threads = [threading.Thread(target=work) for _ in range(4)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print(found)
"""

WARPED = """
import sys
import numpy as np
from dataclasses import replace
import deformnb as dn
from deformnb.native import library
volume = dn.datasets.PHANTOMS["bar"].make((24, 24, 48))
places = np.random.default_rng(0).uniform(2, 20, (12, 2))
points = dn.ControlPoints.from_arrays(places, places + 0.1 * places[::-1])
plain = dn.Deformation.from_picture_points(volume, "-x", points, trend="rigid").steps[0]
line = dn.Cut(dn.Line([(10, -50), (10, 50)]))
ground = dn.RigidPart(dn.HalfSpace((0, 1), (0, 1)))
deep = np.concatenate([places, places[:, :1]], axis=1)
deformations = [
    dn.Deformation((replace(plain, **settings),))
    for settings in (
        {}, {"extrusion": "modulate", "curve": "1-z"}, {"cuts": (line,)}, {"parts": (ground,)}, {"stages": 3},
        {"kernel": "thin_plate", "trend": "affine"}, {"kernel": "quintic", "trend": "quadratic"},
    )
]
deformations.append(dn.Deformation.from_space_points(dn.ControlPoints.from_arrays(deep, deep + 0.1 * deep[::-1])))
for deformation in deformations:
    dn.Warper(volume)(deformation.field(volume.grid))
print("jax" in sys.modules and library.loops() is not None)
"""

LEAVING = """
import deformnb as dn
studio = dn.Studio(dn.datasets.PHANTOMS["bar"].make((24, 24, 48)))
studio.warm_up()
print("left")
"""


def run(code: str, folder: Path) -> list[str]:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        env=os.environ,
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
        cwd=folder,
    )
    assert not done.stderr
    return done.stdout.splitlines()


def test_a_studio_is_shown_without_jax_and_scipy_and_warms_up_after_its_voxels(
    isolated_folders: Path,
) -> None:
    *order, shown = run(SHOWN, isolated_folders)
    assert order == ["piece 0", "piece 1", "warm up"]
    assert "image/png" in shown
    assert "application/vnd.jupyter.widget-view+json" in shown
    assert shown.endswith("[]")


@pytest.mark.skipif(jax.default_backend() == "gpu", reason="a GPU computes with JAX")
def test_volumes_are_deformed_on_a_processor_without_jax(isolated_folders: Path) -> None:
    assert run(WARPED, isolated_folders) == ["False"]


def test_the_studio_is_imported_without_jax_and_scipy(isolated_folders: Path) -> None:
    assert run(NAMED, isolated_folders) == ["[]"]


def test_jax_and_scipy_are_imported_in_one_module() -> None:
    """But for the report of ``deformnb doctor``, and for type checkers in the module of JAX."""
    package = Path(deformnb.__file__).parent
    found = {
        path.relative_to(package).as_posix()
        for path in package.rglob("*.py")
        if re.search(r"^ *(from|import) (jax|scipy)\b", path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert found == {"_deferred.py", "_jax.py", "cli/doctor.py"}


@pytest.mark.parametrize("code", [REGISTERED, AFTERWARDS], ids=["before jax", "after jax"])
def test_fields_are_pytrees_whoever_imports_jax(code: str, isolated_folders: Path) -> None:
    assert run(code, isolated_folders) == ["2 2"]


def test_threads_may_be_the_first_to_compute(isolated_folders: Path) -> None:
    assert run(THREADS, isolated_folders) == [str([[-1, 0]] * 4)]


def test_the_interpreter_ends_though_jax_is_being_imported(isolated_folders: Path) -> None:
    assert run(LEAVING, isolated_folders) == ["left"]
