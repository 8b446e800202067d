"""Memory of the kernels of a class: how much each takes when all pupils have run a lesson, without exercises done.

The proportional set size (PSS) shares what processes have in common (libraries, above all) among them; the sum over all
kernels is then what the machine has to have.
"""

from __future__ import annotations

import argparse
import re
import tempfile
from pathlib import Path

LESSONS = Path(__file__).resolve().parents[1] / "lessons" / "deformnb_lessons" / "notebooks"


def pss(process: int) -> float:
    """Proportional set size of a process in MB (10^6 bytes), by Linux."""
    text = Path(f"/proc/{process}/smaps_rollup").read_text(encoding="ascii")
    (kilobytes,) = re.findall(r"^Pss: +(\d+) kB", text, flags=re.MULTILINE)
    return int(kilobytes) * 1024 / 1e6


def measure(pupils: int, lesson: Path) -> list[float]:
    """PSS in MB of the kernel of each pupil, all alive, after each has run the cells of a lesson in turn."""
    import nbformat
    from jupyter_core.utils import run_sync
    from nbclient import NotebookClient

    clients = []
    try:
        with tempfile.TemporaryDirectory() as folder:
            for _ in range(pupils):
                client = NotebookClient(
                    nbformat.read(lesson, as_version=4),
                    timeout=600,
                    kernel_name="python3",
                    resources={"metadata": {"path": folder}},
                )
                client.create_kernel_manager()
                client.start_new_kernel()
                client.start_new_kernel_client()
                clients.append(client)
                for k, cell in enumerate(client.nb.cells):
                    client.execute_cell(cell, k)
            return [pss(client.km.provisioner.process.pid) for client in clients]
    finally:
        for client in clients:
            client.kc.stop_channels()
            run_sync(client.km.shutdown_kernel)(now=True)


def main(arguments: list[str]) -> int:
    """Print the memory of each kernel, and of all."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks classroom", description=__doc__)
    parser.add_argument("--pupils", type=int, default=10, help="kernels at the same time (default 10)")
    parser.add_argument(
        "--lesson", default=sorted(LESSONS.glob("*.ipynb"))[0], type=Path, help="notebook (default: the first lesson)"
    )
    options = parser.parse_args(arguments)
    found = measure(options.pupils, options.lesson)
    print(
        f"{options.lesson.name}, {len(found)} kernels: largest {max(found):.0f} MB, mean "
        f"{sum(found) / len(found):.0f} MB, all {sum(found):.0f} MB"
    )
    return 0
