"""The command: pin the threads before anything that starts some is imported, then run and print a report."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from pathlib import Path

# Each library reads its number of threads from here, once, when it is loaded.
_THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "VTK_SMP_MAX_THREADS",
    "ITK_GLOBAL_DEFAULT_NUMBER_OF_THREADS",
)


_COMMANDS = ("latency", "drags", "studio", "memory", "start", "prediction", "chunked", "classroom", "gpu", "hosts")
"""Modules of this package with a separate command line."""


def main() -> int:
    command = sys.argv[1:2]
    if command and command[0] in _COMMANDS:  # they choose their threads, or take all
        return int(importlib.import_module(f"benchmarks.{command[0]}").main(sys.argv[2:]))
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description=__doc__,
        epilog="In a browser: python -m benchmarks latency --help, ... drags --help, ... studio --help, ... "
        "memory --help, ... start --help; on a GPU: ... gpu --help; of volumes larger than memory: "
        "... chunked --help; of errors: ... prediction; of the memory of a class: "
        "... classroom --help",
    )
    parser.add_argument("--size", type=int, default=256, help="edge of the volume in voxels (default 256)")
    parser.add_argument("--points", type=int, default=32, help="number of control points (default 32)")
    parser.add_argument("--threads", type=int, default=1, help="processors to use; 0 leaves all as it is (default 1)")
    parser.add_argument("--rounds", type=int, default=9, help="interleaved rounds of each group (default 9)")
    parser.add_argument("--groups", nargs="*", help="run only groups whose name contains one of these")
    parser.add_argument("--dtype", default="uint8", choices=["uint8", "int16", "float32"], help="voxel type")
    parser.add_argument(
        "--loops",
        action="store_true",
        help="leave the libraries out of RBF, W and E: only our own results and the loops in C and numba",
    )
    parser.add_argument(
        "--ratios",
        type=Path,
        metavar="FILE",
        help="compare the ratios to these loops with those of earlier runs in FILE, add this run to it "
        "and exit with 1 where one is 35 %% worse, or 20 %% in three runs one after the other",
    )
    options = parser.parse_args()
    if options.threads:
        os.environ.update(dict.fromkeys(_THREADS, str(options.threads)))
        if hasattr(os, "sched_setaffinity"):
            os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: options.threads])
    from benchmarks.run import run  # not before the threads are chosen

    return run(options)


if __name__ == "__main__":
    sys.exit(main())
