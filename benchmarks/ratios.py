"""The ratios of a run to its fastest peers, stored from run to run, and those that have become worse.

Ratios within one run can be compared from day to day where milliseconds cannot, on one kind of machine: the file keeps
them by the width of its vectors, and by its processor and the settings of the run.
"""

from __future__ import annotations

import json
import platform
import statistics
from collections.abc import Mapping
from pathlib import Path

from deformnb.native import library

_KEPT = 30  # runs

# A ratio is compared with the median of so many runs before those that are judged.
_USUAL = 7

_AT_ONCE, _THREE_TIMES = 1.35, 1.2

Ratios = Mapping[str, float]
"""By "row / peer"."""

_WIDTHS = {"AVX-512": {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}, "AVX2": {"avx2", "fma", "bmi2"},
           "SSE": {"sse4_2"}, "NEON": {"asimd"}}  # fmt: skip
_UNKNOWN = "generic"


def vector_width() -> str:
    """The width of the vectors of this processor: "AVX-512", "AVX2", "SSE", "NEON" or "generic".

    Examples
    --------
    >>> vector_width() in ("AVX-512", "AVX2", "SSE", "NEON", "generic")
    True
    """
    info = Path("/proc/cpuinfo")
    text = info.read_text(encoding="utf-8", errors="replace") if info.exists() else ""
    lines = [line.partition(":")[2] for line in text.splitlines() if line.lower().startswith(("flags", "features"))]
    is_arm = platform.machine().lower() in ("arm64", "aarch64")
    return width_of((lines or ["asimd" if is_arm else ""])[0])


def width_of(flags: str) -> str:
    """The width by the flags of a processor, as Linux names them.

    Examples
    --------
    >>> width_of("sse4_2 avx2 fma bmi2 avx512f"), width_of("fp asimd"), width_of("")
    ('AVX2', 'NEON', 'generic')
    """
    has = set(flags.split())
    return next((name for name, needed in _WIDTHS.items() if needed <= has), _UNKNOWN)


def why_not_stored() -> str:
    """The reason why ratios of this process are no figures of this kind of machine; empty where they are.

    Examples
    --------
    >>> before = library.use_level("off")
    >>> why_not_stored()
    'loops of level "off" are in use, not those that this processor has'
    >>> _ = library.use_level(before)
    """
    level, best = library.level(), (library.levels() or ("off",))[-1]
    if level == best != "off":
        return ""
    return f'loops of level "{level}" are in use, not those that this processor has'


def worse(before: list[Ratios], now: Ratios) -> list[str]:
    """Ratios that are 35 % above the usual, or 20 % for the third time in a row; empty if there are none.

    Parameters
    ----------
    before : the ratios of earlier runs, oldest first.

    Examples
    --------
    >>> usual = [{"warp / C, gcc": 1.0}] * 5
    >>> worse(usual, {"warp / C, gcc": 1.4})
    ['warp / C, gcc: 1.4, was 1 (40 % worse)']
    >>> worse(usual, {"warp / C, gcc": 1.25})
    []
    >>> worse([*usual, *[{"warp / C, gcc": 1.25}] * 2], {"warp / C, gcc": 1.22})
    ['warp / C, gcc: 1.22, was 1 (22 % worse, as in the two runs before)']
    """
    found = []
    for name, ratio in now.items():
        past = [run[name] for run in before if name in run]
        last, older = past[-2:], past[:-2][-_USUAL:]
        if older and len(last) == 2 and min(*last, ratio) > _THREE_TIMES * (usual := statistics.median(older)):
            when = ", as in the two runs before"
        elif past and ratio > _AT_ONCE * (usual := statistics.median(past[-_USUAL:])):
            when = ""
        else:
            continue
        found.append(f"{name}: {ratio:.3g}, was {usual:.3g} ({100 * (ratio / usual - 1):.0f} % worse{when})")
    return found


def compare(file: Path, width: str, machine: str, now: Ratios) -> list[str]:
    """Ratios that are worse than in the runs of this machine in the file; this run is added to them.

    Parameters
    ----------
    width : of its vectors, see :func:`vector_width`; machines that differ in it are never compared.
    machine : its processor and the settings of the run.

    Raises
    ------
    SystemExit
        If the file holds something else.
    """
    try:
        widths: dict[str, dict[str, list[Ratios]]] = json.loads(file.read_text("utf-8")) if file.exists() else {}
        runs = widths.setdefault(width, {})
        before = list(runs.get(machine, []))
        found = worse(before, now)
    except (OSError, ValueError, TypeError, AttributeError) as error:
        raise SystemExit(f"{file} is no file of ratios ({error}); move it away, or name another one.") from None
    runs[machine] = [*before, now][-_KEPT:]
    file.write_text(json.dumps(widths, indent=1) + "\n", encoding="utf-8")
    return found
