"""Everything passed or read as numbers ends in a result or in one DeformError: wrong types, texts, huge numbers."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deformnb import (
    ControlPoints,
    Deformation,
    DeformError,
    Grid,
    Step,
    Volume,
    Warper,
    fit_rbf,
    read_landmarks,
    read_mesh,
    read_volume,
    warp,
    write_volume,
)
from deformnb.checks import finite_array, is_finite, short_value
from deformnb.document import from_json, to_json
from deformnb.document.deformation import MOST_STEPS
from deformnb.io import points_from_csv
from deformnb.rbf.fields import Identity

HUGE = 10**400
WRONG: dict[str, Any] = {
    "text": "a",
    "digit": "1",
    "nothing": None,
    "object": object(),
    "bytes": b"x",
    "long text": "x" * 200_000,
    "empty": [],
    "one": [1],
    "two": (1, 1),
    "four": (1, 1, 1, 1),
    "nested": [[1]],
    "ragged": (1, 2, [3]),
    "mixed": ("a", 1, 1),
    "mapping": {},
    "texts": np.array(["a"]),
    "flag": True,
    "complex": 1 + 1j,
    "huge": HUGE,
    "negative huge": -HUGE,
    "unwritable": 10**5000,
    "three huge": [HUGE] * 3,
    "nan": np.nan,
    "infinite": np.inf,
    "large": 1e308,
    "small": 1e-320,
    "one large": (1e308, 1, 1),
    "one small": (1e-320, 1, 1),
    "minus": -1,
    "zero": 0,
}
POINTS = ControlPoints.from_arrays([[0, 0], [1, 0]])
GRID = Grid((4, 5, 6))
VOLUME = Volume.from_array(np.zeros((2, 3, 4)))


def with_file(tmp_path: Path, **options: Any) -> Volume:
    write_volume(VOLUME, tmp_path / "a.npy")
    return read_volume(tmp_path / "a.npy", **options)


CALLS: dict[str, Callable[[Any, Path], Any]] = {
    **{
        f"Grid {key}": lambda value, _, key=key: Grid(**{"shape": (2, 3, 4), key: value})
        for key in ("shape", "spacing", "origin", "direction")
    },
    "Grid.from_affine": lambda value, _: Grid.from_affine((2, 3, 4), value),
    "Grid.from_affine shape": lambda value, _: Grid.from_affine(value, np.eye(4)),
    **{
        f"Grid.resampled {key}": lambda value, _, key=key: GRID.resampled(**{key: value})
        for key in ("spacing", "shape", "margin")
    },
    "Grid.cover": lambda value, _: GRID.cover(value) if value != 1e308 else None,
    "Grid.crop": lambda value, _: GRID.crop(value, (1, 1, 1)),
    "Grid.crop shape": lambda value, _: GRID.crop((0, 0, 0), value),
    "Grid.index_to_point": lambda value, _: GRID.index_to_point(value),
    "Grid.point_to_index": lambda value, _: GRID.point_to_index(value),
    **{
        f"Volume.from_array {key}": lambda value, _, key=key: Volume.from_array(np.zeros((2, 3, 4)), **{key: value})
        for key in ("spacing", "origin", "direction")
    },
    "Volume.from_array": lambda value, _: Volume.from_array(value),
    "Volume": lambda value, _: Volume(value, GRID),
    **{
        f"ControlPoints.from_arrays {key}": lambda value, _, key=key: ControlPoints.from_arrays(
            **{"source": [[0, 0], [1, 1]], key: value}
        )
        for key in ("source", "target", "ids", "names", "active", "weight", "next_id", "locked", "radius")
    },
    **{
        f"ControlPoints.edit {key}": lambda value, _, key=key: POINTS.edit(0, **{key: value})
        for key in ("source", "target", "active", "weight", "locked", "radius")
    },
    **{
        f"ControlPoints.{name}": lambda value, _, name=name: getattr(POINTS, name)(value)
        for name in ("index", "scaled", "take", "remove", "empty")
    },
    **{
        f"Step {key}": lambda value, _, key=key: Step(**{"maps": (POINTS,), key: value})
        for key in (
            "maps",
            "kernel",
            "support",
            "trend",
            "smoothing",
            "extrusion",
            "curve",
            "knots",
            "strength",
            "parts",
            "cuts",
            "cut_rule",
            "stages",
        )
    },
    **{
        f"fit_rbf {key}": lambda value, _, key=key: fit_rbf(POINTS, **{key: value})
        for key in ("kernel", "support", "trend", "smoothing")
    },
    **{
        f"Deformation {key}": lambda value, _, key=key: Deformation(**{key: value})
        for key in ("steps", "mode", "keyframes", "output", "easing", "loop")
    },
    **{
        f"Warper {key}": lambda value, _, key=key: Warper(VOLUME, **{key: value})
        for key in ("output", "fill", "method", "step")
    },
    "Warper": lambda value, _: Warper(value),
    "warp field": lambda value, _: warp(VOLUME, value),
    **{
        f"read_volume {key}": lambda value, folder, key=key: with_file(folder, **{key: value})
        for key in ("spacing", "stride", "max_bytes")
    },
    "points_from_csv": lambda value, _: points_from_csv(value, POINTS),
    "from_json": lambda value, _: from_json(value),
    "read_volume": lambda value, _: read_volume(value),
    "read_landmarks": lambda value, _: read_landmarks(value),
    "read_mesh": lambda value, _: read_mesh(value),
}


@pytest.mark.parametrize("call", CALLS)
def test_any_value_is_taken_or_refused_in_one_sentence(call: str, tmp_path: Path) -> None:
    refused = 0
    for name, value in WRONG.items():
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                CALLS[call](value, tmp_path)
        except DeformError as error:
            refused += 1
            assert len(str(error)) < 1000, name  # noqa: PT017
        except Exception as error:
            raise AssertionError(f"{call} of {name} raised {type(error).__name__}: {error}") from error
    assert refused


@pytest.mark.parametrize(
    ("spacing", "words"),
    [
        ((1e-320, 1, 1), "from 1e-12 to 1e"),
        ((1e308, 1, 1), "from 1e-12 to 1e"),
        ((1, 0.9e-12, 1), "from 1e-12 to 1e"),
        ((1, 1, 1.1e12), "from 1e-12 to 1e"),
        ((0, 1, 1), "positive"),
        (("a", 1, 1), "three finite numbers"),
    ],
)
def test_spacings_beyond_their_limits(spacing: Any, words: str, tmp_path: Path) -> None:
    with pytest.raises(DeformError, match=words):
        Grid((2, 3, 4), spacing)
    with pytest.raises(DeformError, match=words):
        with_file(tmp_path, spacing=spacing)


def test_spacings_at_their_limits_are_kept() -> None:
    for spacing in (1e-12, 1e12):
        grid = Grid((2, 3, 4), (spacing,) * 3)
        size = np.prod(np.float32(grid.spacing))
        assert np.finfo(np.float32).tiny <= size <= np.finfo(np.float32).max
        np.testing.assert_allclose(grid.point_to_index(grid.index_to_point([3, 2, 1])), [3, 2, 1], rtol=1e-12)


@pytest.mark.parametrize("spacing", ["1e-320", "1e308"])
@pytest.mark.parametrize("suffix", ["nrrd", "mha", "vti", "npy"])
def test_readers_refuse_spacings_beyond_their_limits(suffix: str, spacing: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.{suffix}"
    write_volume(Volume.from_array(np.zeros((2, 3, 4), np.uint8), (1.5, 1.25, 1.75)), path)
    place = path.with_name("a.npy.json") if suffix == "npy" else path
    content = place.read_bytes()
    assert b"1.25" in content
    place.write_bytes(content.replace(b"1.25", spacing.encode()))
    with pytest.raises(DeformError, match=r"spacing|sheared|singular"):
        read_volume(path)


def test_origins_beyond_their_limits() -> None:
    assert Grid((1, 1, 1), origin=(1e15, 0, -1e15)).origin == (1e15, 0, -1e15)
    with pytest.raises(DeformError, match="below 1e"):
        Grid((1, 1, 1), origin=(1.1e15, 0, 0))


LONG = "9" * 5000


@pytest.mark.parametrize(
    "text",
    [
        "source_a,source_b,id\n1,2," + LONG,
        "source_a,source_b,id\n1,2," + "9" * 30,
        "source_a,source_b\n1," + LONG,
        "source_a,source_b,name\n1,2," + "x" * 200_000,
    ],
)
def test_tables_of_points_with_endless_cells(text: str) -> None:
    with pytest.raises(DeformError):
        points_from_csv(text, POINTS)


@pytest.mark.parametrize(
    ("suffix", "text"),
    [
        (".csv", "x" * 200_000 + ",true,1,2,3,4\n"),
        (".fcsv", "1,1,2,3," + "x" * 200_000),
        (".csv", '"' + "x,\n" * 100_000),
        (".mrk.json", "[" * 100_000),
        (".mrk.json", LONG),
        (".mrk.json", '{"markups":[{"controlPoints":[{"position":[1,2,' + LONG + "]}]}]}"),
        (".mrk.json", json.dumps({"markups": [{"controlPoints": [{"position": [1, 2, HUGE]}]}]})),
        (".csv", f"a,true,1,2,3,{LONG}\n"),
        (".fcsv", f"1,1,2,{LONG}"),
    ],
)
def test_landmark_files_with_endless_fields(suffix: str, text: str, tmp_path: Path) -> None:
    (tmp_path / f"a{suffix}").write_text(text, encoding="utf-8")
    try:
        read_landmarks(tmp_path / f"a{suffix}")
    except DeformError as error:
        assert str(error).startswith(f"a{suffix}: ")  # noqa: PT017
        assert len(str(error)) < 1000  # noqa: PT017


@pytest.mark.nightly
def test_a_document_of_20_000_steps_is_refused() -> None:
    step = Step((POINTS,), None) if POINTS.dim == 3 else Step((ControlPoints.from_arrays([[0, 0, 0]]),))
    most = Deformation((step,) * MOST_STEPS)
    text = to_json(most)
    assert from_json(text) == most
    warp(VOLUME, most.field(VOLUME.grid))  # as deep as possible
    data = json.loads(text)
    data["steps"] = data["steps"][:1] * 20_000
    with pytest.raises(DeformError, match="20000 steps"):
        from_json(json.dumps(data))


def test_a_result_that_no_memory_holds_is_one_sentence() -> None:
    with pytest.raises(DeformError, match="not enough memory for a result of 2000000 x 2000000 x 2000"):
        warp(VOLUME, Identity(3), output=Grid((2000, 2_000_000, 2_000_000)))


def test_checks_say_what_was_passed() -> None:
    with pytest.raises(DeformError, match=r"size must be two numbers, got \(1, 'a'\)\."):
        finite_array((1, "a"), (2,), "size must be two numbers")
    assert finite_array(np.array([1, 2], np.int8), (2,), "").tolist() == [1.0, 2.0]
    assert short_value("x" * 100) == "'" + "x" * 59
    assert is_finite(np.float32(1))
    assert not is_finite(np.nan)
    assert not is_finite(None)
