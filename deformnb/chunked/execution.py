"""Work on many blocks: on threads of this process, or on the workers of a dask cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from itertools import islice
from typing import Any

from deformnb._packages import install_command
from deformnb._threads import can_start_threads
from deformnb.errors import DeformError, MissingPackageError

# Work with more bytes of arrays is given to each worker once instead of travelling with the list of tasks.
_LARGE = 2**20

# Retries of a block on another worker after its own crashed or its file system failed.
_RETRIES = 3


def run_on_threads(work: Callable[[int], Any], numbers: Sequence[int], threads: int) -> Iterator[int]:
    """Work on all numbers, and yield each finished one. Ending the loop early cancels those not begun."""
    if not can_start_threads():
        for number in numbers:
            work(number)
            yield number
        return
    with ThreadPoolExecutor(threads, thread_name_prefix="deformnb-block") as pool:
        waiting: set[Any] = set()
        following = iter(numbers)
        try:
            numbered: dict[Any, int] = {}
            while True:
                while len(waiting) < threads and (upcoming := next(following, None)) is not None:
                    future = pool.submit(work, upcoming)
                    waiting.add(future)
                    numbered[future] = upcoming
                if not waiting:
                    return
                finished, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                for future in finished:
                    future.result()
                    yield numbered.pop(future)
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def run_on_cluster(
    client: Any, work: Callable[[int], Any], numbers: Sequence[int], at_once: int, nbytes: int
) -> Iterator[int]:
    """The same on the workers of a ``dask.distributed.Client``; a block whose worker fails is done by another one.

    Parameters
    ----------
    at_once : number of concurrent blocks, if the memory suffices for fewer than the workers have threads.
    nbytes : bytes of the arrays that the work holds.
    """
    from distributed import as_completed
    from distributed.scheduler import KilledWorker

    if not numbers:
        return
    # Results of a worker can be computed again if that fails; scattered data are on each of them.
    shared = (
        client.scatter(work, broadcast=True, hash=False) if nbytes > _LARGE else client.submit(_same, work, pure=False)
    )
    # Neighbours read the same chunks, which each worker caches: each begins with a separate run. Any other
    # one may take a block over.
    slots = [address for address, threads in sorted(client.nthreads().items()) for _ in range(threads)]
    are_all = at_once >= len(slots)
    following = iter(
        (number, [slots[k * len(slots) // len(numbers)]] if are_all else None) for k, number in enumerate(numbers)
    )

    def submit(count: int | None) -> dict[Any, int]:
        return {
            client.submit(
                _call,
                shared,
                number,
                pure=False,
                retries=_RETRIES,
                workers=workers,
                allow_other_workers=workers is not None,
            ): number
            for number, workers in islice(following, count)
        }

    futures = submit(None if are_all else at_once)
    finished = as_completed(list(futures))
    try:
        for future in finished:
            try:
                if future.status != "finished":  # else there is nothing to fetch but a round trip to the worker
                    future.result()
            except KilledWorker as error:
                raise DeformError(
                    f"the workers died over block {futures[future]} again and again, most likely for "
                    "want of memory; give memory=... a smaller value."
                ) from error
            yield futures.pop(future)
            more = submit(1)
            finished.update(more)
            futures |= more
    finally:
        client.cancel(list(futures))


def _same(work: Callable[[int], Any]) -> Callable[[int], Any]:
    return work


def _call(work: Callable[[int], Any], number: int) -> None:
    work(number)


def count_threads(client: Any) -> int:
    """Threads of all workers of a client.

    Raises
    ------
    DeformError
        If it is no client, or has no workers.
    """
    try:
        import distributed
    except ImportError as error:
        raise MissingPackageError(
            f"a cluster needs the package distributed, which is not installed: {install_command('large')}"
        ) from error
    if not isinstance(client, distributed.Client):
        raise DeformError(f"client is a dask.distributed.Client, got {type(client).__name__}.")
    count = sum(client.nthreads().values())
    if not count:
        raise DeformError("the cluster of this client has no workers.")
    return int(count)
