"""Landmarks in files that other programs have read and written again: see tests/fixtures/landmarks/README.md."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from format_table import bound
from peer_landmarks import LANDMARKS

from deformnb.errors import VolumeFileError
from deformnb.io.landmarks.formats import read_landmarks, write_landmarks
from deformnb.warping.points import Landmarks

FILES = Path(__file__).parents[2] / "fixtures" / "landmarks"

PROGRAMS = [
    ("ours.bigwarp.json", "bigwarp.bigwarp.json", bound("landmarks", "bigwarp json", "BigWarp")),
    ("ours.csv", "bigwarp.csv", bound("landmarks", "bigwarp", "BigWarp")),
    ("ours.points.csv", "opensim.points.csv", bound("landmarks", "table", "OpenSim Creator")),
    ("ours.prm", "pygem.prm", bound("landmarks", "pygem", "PyGeM")),
    ("ours.tps", "geomorph.tps", bound("landmarks", "tps", "geomorph")),
    ("ours.tps", "ktch.tps", bound("landmarks", "tps", "ktch")),
    ("ours.nts", "geomorph-nts.tps", bound("landmarks", "nts", "geomorph")),
    ("ours.morphologika.txt", "geomorph-morphologika.tps", bound("landmarks", "morphologika", "geomorph")),
    ("ours.mrk.json", "morpho.mrk.json", bound("landmarks", "markups", "Morpho")),
]


@pytest.mark.parametrize(("ours", "theirs", "limit"), PROGRAMS)
def test_a_program_has_read_what_is_written_and_wrote_the_same(
    ours: str, theirs: str, limit: float, tmp_path: Path
) -> None:
    write_landmarks(LANDMARKS, tmp_path / ours)
    assert (tmp_path / ours).read_text(encoding="utf-8") == (FILES / ours).read_text(encoding="utf-8"), (
        "the written file has changed: let the program read it again"
    )
    found = read_landmarks(FILES / theirs)
    assert np.abs(found.points - LANDMARKS.points).max() <= limit
    if found.fixed is not None:
        assert LANDMARKS.fixed is not None
        assert np.abs(found.fixed - LANDMARKS.fixed).max() <= limit
    assert (found.fixed is None) == (theirs in ("opensim.points.csv", "morpho.mrk.json"))
    if theirs.startswith(("bigwarp", "opensim")):
        assert found.names == LANDMARKS.names
    if theirs.startswith("bigwarp"):
        np.testing.assert_array_equal(found.active, LANDMARKS.active)


@pytest.mark.parametrize("name", ["a.tps", "a.nts", "a.morphologika.txt", "a.prm"])
def test_a_format_without_room_for_an_open_place_refuses_it(name: str, tmp_path: Path) -> None:
    half = Landmarks([[0, 0, 0], [1, 2, 3]], ("nose", "tail"), [[1, 1, 1], [np.nan] * 3])
    with pytest.raises(VolumeFileError, match="landmark 2 has no fixed place"):
        write_landmarks(half, tmp_path / name)
    assert not (tmp_path / name).exists()
    write_landmarks(half, tmp_path / "a.csv")
