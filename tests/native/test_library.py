"""The choice among compiled levels, and the structures that C and Python share."""

from __future__ import annotations

import ctypes
import re
from pathlib import Path
from typing import ClassVar

import pytest

from deformnb.native import jobs, library

SOURCES = Path(__file__).parents[2] / "native"


@pytest.mark.skipif(not library.levels(), reason="no compiled loops")
def test_the_best_level_is_used_unless_another_is_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DEFORMNB_NATIVE", raising=False)
    assert library.level() == library.levels()[-1]
    assert library.why_absent() == ""
    for name in library.levels():
        monkeypatch.setenv("DEFORMNB_NATIVE", name)
        assert library.level() == name
    monkeypatch.setenv("DEFORMNB_NATIVE", "off")
    assert library.loops() is None
    assert library.why_absent() == "DEFORMNB_NATIVE=off"
    monkeypatch.setenv("DEFORMNB_NATIVE", "v99")  # of another machine
    assert library.level() == library.levels()[-1]
    with pytest.raises(ValueError, match="v99"):
        library.use_level("v99")


@pytest.mark.skipif(not library.levels(), reason="no compiled loops")
def test_a_library_of_other_sources_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    class Longer(ctypes.Structure):
        _fields_: ClassVar = [("more", ctypes.c_int64 * 99)]

    monkeypatch.setattr(library, "STRUCTURES", (Longer, *jobs.STRUCTURES[1:]))
    assert library.shared_library.__wrapped__() is None
    monkeypatch.setattr(library, "STRUCTURES", jobs.STRUCTURES)
    assert library.shared_library.__wrapped__() is not None


@pytest.mark.skipif(not SOURCES.exists(), reason="an installed package has no sources of the loops")
@pytest.mark.parametrize(
    "name", ["Source", "Target", "Field", "PlaneField", "VoxelList", "LatticeSum", "EdgeDistances", "Loops"]
)
def test_structures_have_the_fields_of_the_header_in_order(name: str) -> None:
    text = re.sub(r"/\*.*?\*/", "", (SOURCES / "loops.h").read_text(encoding="utf-8"), flags=re.DOTALL)
    found = re.search(r"typedef struct \{([^}]*)\} " + name + ";", text)
    assert found
    names = []
    for line in found[1].split(";"):
        if call := re.search(r"\(\*(\w+)\)", line):
            names.append(call[1])
        elif line.strip():
            first, *others = line.split(",")
            names += [re.findall(r"\w+", re.sub(r"\[[^]]*\]", "", part))[-1] for part in (first, *others)]
    assert names == [field[0] for field in getattr(jobs, name)._fields_]


@pytest.mark.skipif(not SOURCES.exists(), reason="an installed package has no sources of the loops")
def test_names_and_numbers_are_those_of_the_sources() -> None:
    header = (SOURCES / "loops.h").read_text(encoding="utf-8")
    warp = (SOURCES / "voxel_warp.c").read_text(encoding="utf-8")
    assert re.findall(r"\bRUN = (\d+)", warp) == [str(jobs.TRANSPOSED_SLICES)]
    assert tuple(map(str.lower, re.findall(r"enum \{ ([A-Z0-9, ]+), VOXEL_TYPES", header)[0].split(", "))) == (
        jobs.VOXEL_TYPES
    )
    assert (
        tuple(map(str.lower, re.findall(r"enum \{ ([A-Z, ]+), METHODS", header)[0].split(", "))) == jobs.INTERPOLATIONS
    )
    kernels = (SOURCES / "radial_sums.c").read_text(encoding="utf-8")
    assert tuple(re.findall(r"DO\((\w+)\)", kernels)) == jobs.RADIAL_FUNCTIONS
    assert ctypes.sizeof(jobs.Source) % 8 == 0
