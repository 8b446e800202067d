"""Memory of results that is used again, and never while somebody holds it."""

from __future__ import annotations

import gc
import threading
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from deformnb.rbf.fields import Affine
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.result_memory import ResultMemory
from deformnb.warping.warper import Warper

SHAPE = (128, 128, 128)


@pytest.mark.parametrize(
    "holder",
    [
        lambda a: a,
        lambda a: a[3:4, ::2],
        lambda a: a.view(np.int8).T,
        memoryview,
        lambda a: np.asarray(memoryview(a)),
        lambda a: np.frombuffer(a, np.uint8)[-1:],
        lambda a: a.ravel().reshape(2, -1).swapaxes(0, 1),
    ],
    ids=["itself", "slice", "other type", "buffer", "array of a buffer", "bytes", "reshaped"],
)
def test_memory_is_not_used_again_while_anything_refers_to_it(holder: Any) -> None:
    memory = ResultMemory()
    first = memory.empty(SHAPE, np.dtype(np.uint8))
    first[...] = 7
    held = holder(first)
    del first
    gc.collect()
    memory.empty(SHAPE, np.dtype(np.uint8))[...] = 9
    assert set(np.asarray(held).view(np.uint8).ravel().tolist()) == {7}


def test_one_block_is_kept_and_only_for_results_of_its_size() -> None:
    memory, kind = ResultMemory(), np.dtype(np.uint8)
    a, b = memory.empty(SHAPE, kind), memory.empty(SHAPE, kind)
    places = {a.ctypes.data, b.ctypes.data}
    assert len(places) == 2
    last = b.ctypes.data
    del a, b
    again = memory.empty(SHAPE, kind)
    assert again.ctypes.data == last
    del again
    other = memory.empty((128, 128, 100), kind)
    assert other.size == 128 * 128 * 100
    other[...] = 1


def test_results_outlive_the_warper() -> None:
    volume = Volume.from_array(np.random.default_rng(0).integers(0, 255, SHAPE).astype(np.uint8))
    warper = Warper(volume)
    field = Affine(np.eye(3), np.array([1.0, 0.0, 0.0]))
    result = warper(field).values
    wanted = result.copy()
    del warper
    gc.collect()
    np.testing.assert_array_equal(result, wanted)


def test_edits_one_after_the_other_do_not_change_earlier_results() -> None:
    volume = Volume(np.random.default_rng(1).integers(0, 255, SHAPE).astype(np.uint8), Grid(SHAPE))
    warper = Warper(volume, fill=0.0)
    held: list[tuple[NDArray[Any], NDArray[Any]]] = []
    for k in range(6):
        values = warper(Affine(np.eye(3), np.array([0.25 * k, 0.0, 0.0]))).values
        held = [*held[-1:], (values, values.copy())]
        for before, copy in held:
            np.testing.assert_array_equal(before, copy)


def test_threads_get_separate_memory() -> None:
    memory, failures = ResultMemory(), []

    def work(number: int) -> None:
        for _ in range(50):
            array = memory.empty(SHAPE, np.dtype(np.uint8))
            array[::16, ::16, 0] = number
            if not (array[::16, ::16, 0] == number).all():
                failures.append(number)

    threads = [threading.Thread(target=work, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failures
