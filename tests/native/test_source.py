"""Arrays that the compiled loops could not read without harm are refused before."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from deformnb.native import library
from deformnb.native.source import VoxelSource

pytestmark = pytest.mark.skipif(library.loops() is None, reason=f"no compiled loops: {library.why_absent()}")

SHAPE = (3, 4, 5)


def make(samples: Any = None, dtype: str = "uint8", method: str = "linear", tables: Any = None) -> VoxelSource:
    loops = library.loops()
    assert loops is not None
    kind = np.dtype(dtype)
    samples = np.arange(60).reshape(SHAPE).astype(kind) if samples is None else samples
    whole = tables or [np.eye(3)[o][:, None] * np.arange(n) for o, n in enumerate(SHAPE)]
    part = [np.zeros_like(t) for t in whole]
    straight = np.eye(3)[::-1]
    return VoxelSource(loops, samples, kind, method, 0, whole, part, straight, is_near=True, is_straight=True)


def still(shape: tuple[int, ...] = SHAPE) -> list[Any]:
    return [np.zeros(shape, np.float32)] * 3


def test_an_identity_gives_the_voxels() -> None:
    out = np.zeros(SHAPE, np.uint8)
    make().read_box(out, (0, 0, 0), still())
    assert (out.ravel() == np.arange(60)).all()


def test_voxels_in_any_order_of_memory_and_read_only_are_read() -> None:
    samples = np.asfortranarray(np.arange(60, dtype=np.uint8).reshape(SHAPE))
    samples.flags.writeable = False
    out = np.zeros(SHAPE, np.uint8)
    make(samples).read_box(out, (0, 0, 0), still())
    np.testing.assert_array_equal(out, samples)


@pytest.mark.parametrize(
    "samples",
    [np.zeros(SHAPE, np.int16), np.zeros((3, 4), np.uint8), np.zeros((0, 4, 5), np.uint8)],
)
def test_other_samples_are_refused(samples: Any) -> None:
    with pytest.raises(ValueError, match="needs samples"):
        make(samples)


def test_tables_of_other_lengths_are_refused() -> None:
    with pytest.raises(ValueError, match="tables"):
        make(tables=[np.zeros((2, 3)), np.zeros((3, 4)), np.zeros((3, 5))])


@pytest.mark.parametrize(
    ("out", "start"),
    [
        (np.zeros(SHAPE, np.int8), (0, 0, 0)),
        (np.zeros((3, 4, 10), np.uint8)[:, :, ::2], (0, 0, 0)),
        (np.zeros(SHAPE, np.uint8), (1, 0, 0)),
        (np.zeros(SHAPE, np.uint8), (-1, 0, 0)),
        (np.zeros((3, 4), np.uint8), (0, 0, 0)),
    ],
)
def test_results_that_do_not_fit_are_refused(out: Any, start: Any) -> None:
    with pytest.raises(ValueError, match=r"box|result"):
        make().read_box(out, start, still())


def test_displacements_that_do_not_fit_are_refused() -> None:
    out = np.zeros(SHAPE, np.uint8)
    with pytest.raises(ValueError, match="displacements"):
        make().read_box(out, (0, 0, 0), still((2, 4, 5)))
    with pytest.raises(ValueError, match="three arrays"):
        make().read_box(out, (0, 0, 0), still()[:2])
    good = tuple((np.zeros(n, np.int32), np.ones((2, n), np.float32)) for n in SHAPE)
    make().read_box(out, (0, 0, 0), still((3, 2, 5)), good)
    for axis in range(3):
        for first, taps in (([0, 1, 5], 2), ([0, 0, -1], 2), ([0, 0], 2), ([0, 0, 0], 7)):
            changed = np.resize(first, SHAPE[axis] if len(first) == 3 else 2)
            tables = [*good]
            tables[axis] = (changed, np.ones((taps, len(changed)), np.float32))
            with pytest.raises(ValueError, match="nodes"):
                make().read_box(out, (0, 0, 0), still((3, 2, 5)), tuple(tables))
    with pytest.raises(ValueError, match="nodes"):
        make().read_box(out, (0, 0, 0), still((3, 2, 5)), good[:2])


def test_voxels_that_are_not_there_are_refused() -> None:
    for index in (-1, 3):
        with pytest.raises(ValueError, match="no such voxels"):
            make().read_voxels([np.array([index])] * 3, [np.zeros(1)] * 3)
    assert make().read_voxels([np.array([], int)] * 3, [np.zeros(0)] * 3).shape == (0,)


def test_maps_that_do_not_fit_are_refused() -> None:
    out, maps = np.zeros(SHAPE, np.uint8), np.zeros((1, 2, 4, 5), np.float32)
    make().read_slices(out, (0, 0, 0), maps, None, 0, 0, np.eye(2))
    for wrong in (
        (maps[..., :-1], None, 0, 0),
        (maps, None, 1, 0),
        (maps, None, 0, 1),
        (np.concatenate([maps, maps]), None, 0, 0),
        (maps, np.ones((1, 4), np.float32), 0, 0),
    ):
        with pytest.raises(ValueError, match=r"maps|slices"):
            make().read_slices(out, (0, 0, 0), *wrong, np.eye(2))
