"""People know a point by its number in the list from 1, in Python and in the scripts alike; ids are for programs."""

from __future__ import annotations

import numpy as np
import pytest
from js.test_rbf import as_json
from scripts import run_script

from deformnb.errors import DeformError
from deformnb.rbf.cuts import points_of_regions
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import HalfSpace

NAMES = ("maths/point_names.ts",)
FITS = ("maths/point_names.ts", "maths/rbf.ts", "maths/rigid_stages.ts", "maths/cuts.ts")
PLACES = [[0, 0], [90, 0], [0, 90], [90, 90], [40, 40], [50, 40]]


def later(targets: list[list[float]], **more: object) -> ControlPoints:
    """Points of which some were removed before others were added: their ids are 0, 2, 5, 6 and so on."""
    n = len(targets)
    return ControlPoints.from_arrays(PLACES[:n], targets, ids=[0, 2, *range(5, 3 + n)], **more)  # type: ignore[arg-type]


def script_labels(points: ControlPoints) -> list[str]:
    return list(run_script(NAMES, "(points) => points.map((p) => labelOf(p, numberOf(points, p.id)))", as_json(points)))


def test_labels_count_on_from_what_is_there() -> None:
    points = later(PLACES, names=["", "nose", "", "", "", ""])
    for some in (points, points.remove(0, 5), points.remove(6).add([7, 7]), points.take([4, 1])):
        labels = [some.label(k) for k in range(len(some))]
        assert labels == script_labels(some)
        assert labels == [f"point {k + 1}" + (' ("nose")' if name else "") for k, name in enumerate(some.names)]


def test_a_subset_keeps_the_numbers_of_the_whole() -> None:
    points = later(PLACES)
    assert points.subset([3, 1]).numbers == (4, 2)
    assert points.subset([3, 1]).subset([1]).label(0) == "point 2"
    assert points.subset([3, 1]).take([1]).label(0) == "point 1"
    assert points.subset([3, 1]) == points.take([3, 1])
    [left, right] = points_of_regions(points, [HalfSpace([45, 0], [1, 0])]).values()
    assert sorted(left.numbers + right.numbers) == [1, 2, 3, 4, 5, 6]


def test_labels_in_messages_are_found_whole() -> None:
    main = '() => ["point 1 is", "point 12 is", "point 12 and point 1."].map((text) => isNamed(text, "point 1"))'
    assert run_script(NAMES, main, None) == [True, False, True]


@pytest.mark.parametrize("off", [0, 1, 4])
def test_errors_of_fits_name_points_by_their_numbers_in_the_whole_list(off: int) -> None:
    targets = [*PLACES[:4], [40, 40], [40, 40]]
    points = later(targets)
    points = points.edit(points.ids[off], active=False)
    main = "(points) => { try { return layeredFit(points).notes; } catch (error) { return error.message; } }"
    found = run_script(FITS, main, as_json(points))
    if off == 4:
        assert not any("at the same place" in note for note in found)
        fit_rbf(points)
        return
    with pytest.raises(DeformError, match="point 5 and point 6 are at the same place") as caught:
        fit_rbf(points)
    assert found == str(caught.value)


@pytest.mark.parametrize("off", [0, 1])
def test_notes_of_fits_name_points_by_their_numbers_in_the_whole_list(off: int) -> None:
    points = later([*PLACES[:4], [50, 40], [40, 40]])
    points = points.edit(points.ids[off], active=False)
    wanted = "control points 5 and 6 are pulled past each other: the map folds there"
    assert wanted in fit_rbf(points).notes
    cut = {"region": {"kind": "half_space", "point": [20, 0], "normal": [1, 0]}, "enabled": True}
    for cuts in ([], [cut]):
        main = "({ points, cuts }) => layeredFit(points, { cuts }).notes"
        assert wanted in run_script(FITS, main, {"points": as_json(points), "cuts": cuts})
    assert np.array_equal(points.numbers, np.arange(1, 7))
