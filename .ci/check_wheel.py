"""Checks an installed wheel: its compiled loops load, and warp a volume as JAX does.

Run it outside of the checkout, whose package would be found first. Where there is no JAX (for Macs with Intel's
processors it is no longer made) a sum over centres is compared among the levels of instructions.
"""

import importlib.util

import numpy as np

from deformnb.native import library, sums


def main() -> None:
    """Compute by every level of instructions, and compare."""
    levels = library.levels()
    assert levels, library.why_absent()
    has_jax = importlib.util.find_spec("jax") is not None
    work = warp if has_jax else add_up
    results = []
    for level in levels:
        library.use_level(level)
        results.append(work())
    for level, values in zip(levels, results, strict=True):
        assert (values == results[0]).all(), f"level {level} gives other values than {levels[0]}"
    if has_jax:
        library.use_level("off")
        assert abs(work() - results[0]).max() <= 1, "compiled loops give other voxels than JAX"
    print("compiled loops:", *levels, "" if has_jax else "(without JAX)")


def warp() -> np.ndarray:
    """The voxels of a phantom that is bent."""
    import deformnb as dn

    volume = dn.datasets.PHANTOMS["fish"].make((32, 64, 32))
    points = dn.ControlPoints.from_arrays([[30, 100], [250, 60], [480, 100]], [[30, 130], [250, 60], [480, 130]])
    return dn.Deformation.from_picture_points(volume, "-x", points).apply(volume).values.astype(int)


def add_up() -> np.ndarray:
    """Displacements by nine points."""
    rng = np.random.default_rng(0)
    rows, columns, points, a = (rng.normal(size=shape) for shape in ((2, 40), (2, 50), (9, 2), (9, 2)))
    return sums.sum_lattice(rows, columns, points, a, np.eye(2), np.zeros(2), "gaussian", dtype=np.float32)


main()
