"""The light that the front end computes for its ray caster, against that of Python's."""

from __future__ import annotations

import numpy as np
from scripts import run_script

from deformnb.imaging.occlusion import ambient_light
from deformnb.volume.transfer import TransferFunction
from deformnb.volume.volume import Grid, Volume

LIGHT = """({ values, shape, alphas, thickness }) => {
    const made = ambientLight(Uint8Array.from(values), shape, Float32Array.from(alphas), thickness);
    return { size: made.size, values: [...made.values] }; }"""


def test_the_front_end_has_the_ambient_light_of_python() -> None:
    noise = np.random.default_rng(3).integers(120, 256, (29, 34, 41))
    z, y, x = np.indices(noise.shape)
    values = np.where(np.hypot(np.hypot(z - 14, y - 17), x - 20) < 17, noise, noise // 8).astype(np.uint8)
    transfer = TransferFunction(((0, 1, 1, 1),), ((40, 0), (200, 0.9)), unit=1.5)
    volume = Volume(values, Grid(values.shape, (0.5, 1.0, 2.0)))
    rgba = transfer.table(0, 255)
    found = run_script(
        ("webgl/volume_blocks.ts",),
        LIGHT,
        {
            "values": values.ravel().tolist(),
            "shape": values.shape[::-1],
            "alphas": rgba[:, 3].tolist(),
            "thickness": 4 * 0.5 / 1.5,
        },
    )
    wanted = ambient_light(volume, transfer)
    assert found["size"] == [*wanted.shape[::-1]] == [11, 9, 8]
    got = np.reshape(found["values"], wanted.shape) / 255
    assert got.min() < 0.7  # there is something in the shade
    assert np.abs(got - wanted.values).max() < 1.5 / 255  # a byte has no more digits
