"""The device that computes: chosen by name, the same results on each, nothing copied in between that need not be.

Where there is no GPU a second device of the CPU replaces it: all of a device but its speed is tested.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest

from deformnb import devices
from deformnb.devices import use_device
from deformnb.errors import DeformError

ROOT = Path(__file__).resolve().parents[1]

COMPUTE = """
import json, sys
import jax, numpy as np
import deformnb as dn
from deformnb import devices
from deformnb._jax import jit, float64, jnp
from deformnb.document.json_format import to_json
from deformnb.rbf.fitting import fit_rbf
from deformnb.volume.sampling import to_device
from deformnb.warping.planning import displacements, plan_extrusion
from deformnb.warping.warper import Warper

rng = np.random.default_rng(3)
volume = dn.Volume.from_array(rng.integers(0, 256, (12, 14, 16)).astype(np.uint8))
plane = dn.Plane.from_view(volume, "+y")
flat = dn.ControlPoints.from_arrays(rng.uniform(-5, 5, (5, 2)), rng.uniform(-5, 5, (5, 2)))
space = dn.ControlPoints.from_arrays(rng.uniform(0, 12, (6, 3)), rng.uniform(0, 12, (6, 3)))
cut = dn.Line([(0, 9), (0, -9)])

def results():
    in_space = fit_rbf(space, trend="none")
    fields = {"space": in_space, "replicated": dn.Step((flat,), plane).field(volume.grid),
              "modulated": dn.Step((flat,), plane, extrusion="modulate", curve=(1.0, 0.0)).field(volume.grid),
              "cut": dn.Step((flat,), plane, cuts=(dn.rbf.Cut(cut),)).field(volume.grid)}
    fields["composed"] = dn.rbf.compose(fields["modulated"], in_space)
    made = {name: Warper(volume)(fields[name]).values for name in sys.argv[2:]}
    made["fit"] = np.asarray(in_space.coefficients)
    made["places"] = in_space.displacement([[1.0, 2, 3], [4, 5, 6]])
    made["document"] = to_json(dn.Deformation.from_space_points(space))
    if "cut" in made:
        made["shaded"] = dn.project(volume, "+y", "shaded").values
    return made

def apart(one, other):
    if isinstance(one, str):
        return float(one != other)
    return float(np.abs(np.asarray(one, float) - np.asarray(other, float)).max())

first = results()
assert devices.is_host()
devices.use_device(sys.argv[1])
second = results()
add = jit(lambda x: x + 1)
with float64():
    wide = jnp.asarray(1.0)
moved = displacements(fit_rbf(space, trend="none"), volume.grid)
plan = plan_extrusion(dn.Step((flat,), plane).field(volume.grid), volume.grid, volume.grid, "float32")
report = {
    "name": devices.device_name(), "is_host": devices.is_host(),
    "apart": {name: apart(first[name], second[name]) for name in first},
    "places": {"compiled": str(add(1.0).device), "float64": str(wide.device),
               "voxels": str(to_device(volume.values).device), "displacements": [str(d.device) for d in moved],
               "maps": str(plan.maps.device)},
    "wide": str(wide.dtype), "users": str(jax.numpy.ones(1).device)}
# Where JAX itself prefers another device, as it does a GPU, a computation on the host never uses that one.
jax.config.update("jax_default_device", jax.devices()[1])
devices.use_device("cpu")
before = {id(array) for array in jax.live_arrays()}
seen = set()
put = jax.device_put
def noted(*given, **options):
    found = put(*given, **options)
    seen.update(str(array.device) for array in jax.tree.leaves(found))
    return found
jax.device_put = noted
assert devices.is_host()
results()
made = {str(array.device) for array in jax.live_arrays() if id(array) not in before}
print(json.dumps({**report, "host": sorted(seen | made)}))
"""


def computed(*arguments: str) -> dict[str, Any]:
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count=2"
    done = subprocess.run(
        [sys.executable, "-c", COMPUTE, *arguments],
        capture_output=True,
        text=True,
        timeout=180,
        env={**os.environ, "XLA_FLAGS": flags},
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout.splitlines()[-1]))


@pytest.mark.skipif(jax.default_backend() == "gpu", reason="a second device of the CPU is asked for")
@pytest.mark.parametrize(
    "fields", [("space", "composed"), pytest.param(("replicated", "modulated", "cut"), marks=pytest.mark.nightly)]
)
def test_another_device_computes_the_same_and_keeps_what_it_computed(
    fields: tuple[str, ...], isolated_folders: Path
) -> None:
    found = computed("cpu:1", *fields)
    apart = found["apart"]
    assert apart.keys() >= set(fields)
    assert found["name"] == "cpu:1"
    assert not found["is_host"]
    # Sums in another order are rounded otherwise, and so may be a voxel.
    assert max(apart[name] for name in fields) <= 1, apart
    assert max(apart["fit"], apart["places"]) < 1e-12, apart
    assert apart["document"] == 0, apart
    assert apart.get("shaded", 0) <= 1, apart
    second = "cpu:1"
    assert found["places"] == {
        "compiled": second,
        "float64": second,
        "voxels": second,
        "displacements": [second] * 3,
        "maps": second,
    }
    assert found["wide"] == "float64"
    assert set(found["host"]) <= {"cpu:0"}  # no array at all where compiled loops do everything
    assert found["users"] == "cpu:0"  # what the user computes with JAX stays where it was


@pytest.mark.nightly
@pytest.mark.skipif(jax.default_backend() == "gpu", reason="DEFORMNB_DEVICE=gpu runs them there")
def test_the_tests_of_warps_and_fields_pass_on_another_device() -> None:
    flags = "--xla_force_host_platform_device_count=2 --xla_backend_optimization_level=0"
    environment = {**os.environ, "XLA_FLAGS": flags, "DEFORMNB_DEVICE": "cpu:1", "HYPOTHESIS_PROFILE": "dev"}
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-x", "tests/warping", "tests/rbf", "tests/volume"],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-5000:]


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("cuda", "unknown device 'cuda'; choose one of auto, cpu, gpu"),
        ("", "unknown device"),
        ("gpu:x", "unknown device"),
        ("auto:1", "unknown device"),
        ("cpu:77", "there is no cpu:77: JAX finds 1 of this kind"),
    ],
)
def test_a_device_that_is_not_there_is_named(name: str, reason: str) -> None:
    before = devices.current_device()
    with pytest.raises(DeformError, match=reason):
        use_device(name)
    assert devices.current_device() == before


@pytest.mark.skipif(jax.default_backend() == "gpu", reason="there is one")
def test_without_a_gpu_the_error_says_so_and_with_an_idle_one_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(DeformError, match="JAX finds no gpu on this machine"):
        use_device("gpu")
    monkeypatch.setattr(devices, "has_nvidia_driver", lambda: True)
    with pytest.raises(DeformError, match=r"CUDA plugin: pip install -U .jax\[cuda13\]"):
        use_device("gpu")


def test_the_environment_chooses_where_nothing_else_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DEFORMNB_DEVICE", "cpu")
    assert devices.current_device() == "cpu"
    assert devices.device_name() == "cpu:0"
    monkeypatch.setenv("DEFORMNB_DEVICE", "toaster")
    with pytest.raises(DeformError, match="toaster"):
        devices.device_in_use()


def test_a_device_is_described_with_its_kind_and_memory() -> None:
    class Gpu:
        platform, id, device_kind = "gpu", 0, "NVIDIA H100 80GB HBM3"

        def memory_stats(self) -> dict[str, int]:
            return {"bytes_limit": 63_500_000_000}

    assert devices.describe_device(Gpu()) == "gpu:0 (NVIDIA H100 80GB HBM3, 63.5 GB for JAX)"
    assert devices.describe_device(jax.devices("cpu")[0]) == "cpu:0"


@pytest.mark.skipif(jax.default_backend() == "gpu", reason="it begins on the CPU")
def test_options_of_the_cpu_are_given_to_no_other_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    from deformnb import _jax

    given: list[Any] = []
    real = jax.jit

    def jit(function: Any, *, compiler_options: Any = None, donate_argnames: Any = None, **options: Any) -> Any:
        given.append((compiler_options, donate_argnames))
        return real(function, **options)

    class Other:
        platform = "gpu"

    monkeypatch.setattr(jax, "jit", jit)
    monkeypatch.setattr(devices, "device_context", devices.nullcontext)
    for device in (devices.device_in_use(), Other()):
        monkeypatch.setattr(devices, "device_in_use", lambda device=device: device)
        _jax.jit(lambda x: np.float32(2) * x, donated="x")(np.float32(1))
    assert given[-2][0]
    assert given[-2][1] is None
    assert given[-1] == (None, "x")
