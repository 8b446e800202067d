"""A Python as restricted as that of a browser, Pyodide 314, and what a notebook does there; run as a program.

Seen in Pyodide 314.0.7 under node: ``threading.Thread.start`` raises "can't start new thread", processes are refused
with an OSError, ``ctypes`` finds no library, ``os.link``, ``os.sched_getaffinity`` and ``time.thread_time`` are absent.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from pathlib import Path
from typing import Any

from without_jax import Hidden

ABSENT = ("jax", "jaxlib", "pyvista", "trame", "trame_rca", "vtk", "vtkmodules", "resource", "_multiprocessing")
"""Modules that Pyodide has not, and for which its registry has no wheels."""


def restrict() -> None:
    """Restrict this process."""
    os.environ["DEFORMNB_NATIVE"] = "off"  # there is no library for it

    def refuse_thread(_thread: Any) -> None:
        raise RuntimeError("can't start new thread")

    def refuse_process(*_: Any, **__: Any) -> None:
        raise OSError(138, "emscripten does not support processes.")

    threading.Thread.start = refuse_thread  # type: ignore[assignment,method-assign]
    subprocess.Popen = refuse_process  # type: ignore[assignment,misc]
    for module, names in ((os, ("link", "sched_getaffinity")), (time, ("thread_time", "thread_time_ns"))):
        for name in names:
            if hasattr(module, name):
                delattr(module, name)
    os.cpu_count = lambda: 1
    sys.meta_path.insert(0, Hidden(*ABSENT))


def use(folder: Path) -> dict[str, Any]:
    """A notebook's first steps: files, a fit, a warp, a session and the state of a studio; facts of their results."""
    import numpy as np

    import deformnb as dn

    found: dict[str, Any] = {}
    carp = dn.datasets.PHANTOMS["fish"].make((12, 24, 20))
    dn.write_volume(carp, folder / "carp.nii.gz")
    carp = dn.read_volume(folder / "carp.nii.gz")
    points = dn.ControlPoints.from_arrays(
        [[2, 2], [15, 2], [2, 20], [15, 20], [8, 10]], [[2, 2], [15, 2], [2, 20], [15, 20], [11, 12]]
    )
    deformation = dn.Deformation.from_picture_points(carp, "-x", points, extrusion="modulate", curve="z")
    found["curve"] = dn.rbf.extrusion.modulate(lambda z: z * z)[1].shape
    found["warp"] = int(dn.warp(carp, deformation).values.sum())
    found["displacement"] = dn.fit_rbf(points).displacement([[11.0, 12.0]]).round(6).tolist()

    studio = dn.Studio(carp)
    studio.wait()
    editing = studio.session.editing
    middle = editing.points.source.mean(axis=0)
    editing.edit_points(editing.points.add(middle, middle + np.array([2.0, 1.0])))
    studio.wait()
    studio.warm_up()
    found["sent"] = sorted(studio.editor.get_state())[:3]
    found["points"] = len(json.loads(json.dumps(studio.session.document().steps[0].points.target.tolist())))
    found["shown"] = not studio.view.fields.shown.field.is_identity
    found["picture"] = "image/png" in _bundle(studio)
    studio.undo()
    studio.wait()
    found["undone"] = not editing.points.displacement.any()
    studio.redo()
    found["saved"] = [
        [entry.state, entry.points] for entry in dn.session.saved_sessions(studio.session.volume, every=True)
    ]
    path = folder / "session.json"
    studio.session.save(path)
    found["replayed"] = int(dn.read_deformation(path).apply(carp).values.sum())
    found["result"] = int(studio.session.results.volume().values.sum())
    studio.close()
    found["threads"] = threading.active_count()
    return found


def _bundle(studio: Any) -> dict[str, Any]:
    bundle = studio._repr_mimebundle_()
    return dict(bundle[0] if isinstance(bundle, tuple) else bundle)


if __name__ == "__main__":
    if "restricted" in sys.argv:
        restrict()
    warnings.simplefilter("ignore", UserWarning)
    with tempfile.TemporaryDirectory() as name:
        sys.stdout.write(json.dumps(use(Path(name))))
    if "restricted" in sys.argv:
        assert not [module for module in sys.modules if module.partition(".")[0] in ABSENT]
