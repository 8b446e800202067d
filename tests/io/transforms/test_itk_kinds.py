"""Every class of ITK's transforms that is read: the same map as ITK's own, and wrong counts and numbers refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import SimpleITK as sitk  # noqa: N813 (the name that its own manual uses)

from deformnb.errors import VolumeFileError
from deformnb.io.transforms.formats import read_transform
from deformnb.io.transforms.itk_kinds import LINEAR, OTHERS
from deformnb.rbf.bspline import BSplineField

RANDOM = np.random.default_rng(11)
KINDS = [(kind, dim) for kind, row in LINEAR.items() for dim in row.counts]
ON_GRID = [
    (f"{kind}_double_{dim}_{dim}{order}", dim)
    for kind, row in OTHERS.items()
    if row.is_on_grid
    for dim in (2, 3)
    for order in (("", "_1", "_2", "_0") if kind == "BSplineTransform" else ("",))
]


def text(name: str, parameters: Any, fixed: Any) -> str:
    lines = (" ".join(map(repr, np.asarray(numbers, dtype=float).tolist())) for numbers in (parameters, fixed))
    return "#Transform 0\nTransform: {}\nParameters: {}\nFixedParameters: {}\n".format(name, *lines)


def write_transforms(path: Path, *entries: str) -> Path:
    path.write_text("#Insight Transform File V1.0\n" + "".join(entries), encoding="utf-8")
    return path


def numbers_of(kind: str, dim: int) -> tuple[np.ndarray, np.ndarray]:
    """Random numbers of a class: versors and quaternions must not be longer than 1, all others may be anything."""
    row = LINEAR[kind]
    p, f = RANDOM.uniform(-0.5, 0.5, row.counts[dim]), RANDOM.uniform(-20, 20, max(row.fixed[dim]))
    if kind == "CenteredEuler3DTransform":
        f[:3] = p[3:6]
    if len(f) == 4:
        f[3] = RANDOM.integers(2)
    return p, f


def where(made: Any, places: np.ndarray) -> np.ndarray:
    return np.array([made.TransformPoint(tuple(place)) for place in places.tolist()])


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("kind", "dim"), KINDS)
def test_a_linear_transform_is_the_map_that_itk_makes_of_it(kind: str, dim: int, seed: int, tmp_path: Path) -> None:
    one = text(f"{kind}_double_{dim}_{dim}", *numbers_of(kind, dim))
    # SimpleITK has no class for some of ITK's, but all within a composite.
    whole = write_transforms(tmp_path / "a.tfm", text(f"CompositeTransform_double_{dim}_{dim}", [], []), one)
    known = where(sitk.ReadTransform(str(whole)), places := RANDOM.uniform(-50, 50, (20, dim)))
    for path in (whole, write_transforms(tmp_path / "b.tfm", one)):
        field = read_transform(path)
        assert field.dim == dim
        assert np.abs(places + field.displacement(places) - known).max() < 1e-10


@pytest.mark.parametrize(("name", "dim"), ON_GRID)
def test_a_transform_on_a_grid_is_the_map_that_itk_makes_of_it(name: str, dim: int, tmp_path: Path) -> None:
    is_spline = name.startswith("BSplineTransform")
    size = np.array([6, 5, 7])[:dim]
    turned = np.eye(dim)
    turned[:2, :2] = [[0.8, -0.6], [0.6, 0.8]]
    fixed = [*size, *RANDOM.uniform(-20, 20, dim), *RANDOM.uniform(2, 4, dim), *turned.ravel()]
    path = write_transforms(tmp_path / "a.tfm", text(name, RANDOM.normal(size=int(size.prod()) * dim), fixed))
    field, theirs = read_transform(path), sitk.ReadTransform(str(path))
    index = RANDOM.uniform(-1.0 if is_spline else 0.0, size if is_spline else size - 1.0, (300, dim))
    places = index * np.array(fixed[2 * dim : 3 * dim]) @ turned.T + np.array(fixed[dim : 2 * dim])
    known = where(theirs, places)
    assert np.abs(places + field.displacement(places) - known).max() < 1e-9
    if is_spline and not name.endswith("_0"):
        assert isinstance(field, BSplineField)
        still = (known == places).all(axis=1)
        assert 0 < still.sum() < len(still)  # within the domain and outside


@pytest.mark.parametrize("suffix", ["tfm", "h5", "mat"])
@pytest.mark.parametrize("precision", ["double", "float"])
def test_a_composite_keeps_its_order_in_every_file(suffix: str, precision: str, tmp_path: Path) -> None:
    kinds = ["Euler3DTransform", "ScaleSkewVersor3DTransform", "AffineTransform"]
    entries = [text(f"{kind}_double_3_3", *numbers_of(kind, 3)) for kind in kinds]
    whole = write_transforms(tmp_path / "whole.tfm", text("CompositeTransform_double_3_3", [], []), *entries)
    theirs = sitk.ReadTransform(str(whole))
    path = tmp_path / f"a.{suffix}"
    if suffix == "mat" or precision == "float":  # of which ITK reads no composite back, or writes none
        lines = whole.read_text(encoding="utf-8").partition("\n")[2]
        path = write_transforms(tmp_path / "a.tfm", lines.replace("double", precision))
    else:
        sitk.WriteTransform(theirs, str(path))
    places = RANDOM.uniform(-50, 50, (20, 3))
    field = read_transform(path)
    assert len(field.steps) == 3
    assert np.abs(places + field.displacement(places) - where(theirs, places)).max() < 1e-9


@pytest.mark.parametrize("kind", ["Euler3DTransform", "AffineTransform", "BSplineTransform"])
def test_matrices_of_matlab_are_read_in_either_order_of_bytes(kind: str, tmp_path: Path) -> None:
    made = (
        sitk.BSplineTransform(3, 3)
        if kind == "BSplineTransform"
        else getattr(sitk, kind)(*((3,) if kind == "AffineTransform" else ()))
    )
    made.SetParameters(RANDOM.uniform(-0.5, 0.5, len(made.GetParameters())).tolist())
    sitk.WriteTransform(made, str(tmp_path / "a.mat"))
    places = RANDOM.uniform(-1, 1, (50, 3))
    known = where(made, places) - places
    assert np.abs(read_transform(tmp_path / "a.mat").displacement(places) - known).max() < 1e-10
    turned = bytearray()
    data, at = (tmp_path / "a.mat").read_bytes(), 0
    while at < len(data):
        head = np.frombuffer(data, "<i4", 5, at)
        count, name = int(head[1] * head[2]), int(head[4])
        turned += (head + np.array([1000, 0, 0, 0, 0])).astype(">i4").tobytes() + data[at + 20 : at + 20 + name]
        turned += np.frombuffer(data, "<f8", count, at + 20 + name).astype(">f8").tobytes()
        at += 20 + name + 8 * count
    (tmp_path / "b.mat").write_bytes(turned)
    assert np.abs(read_transform(tmp_path / "b.mat").displacement(places) - known).max() < 1e-10


@pytest.mark.parametrize("change", ["one less", "one more", "none", "NaN", "inf", "1e30", "a word", "fixed one more"])
@pytest.mark.parametrize("kind", [*LINEAR, *OTHERS])
def test_wrong_counts_and_wrong_numbers_are_refused(kind: str, change: str, tmp_path: Path) -> None:
    if kind in LINEAR:
        dim = max(LINEAR[kind].counts)
        p, f = numbers_of(kind, dim)
    else:
        dim, n = 3, 2 if not OTHERS[kind].is_on_grid else 5 * 4 * 6
        p = RANDOM.normal(size=3 * n)
        f = np.array([5, 4, 6, 0, 0, 0, 1, 1, 1, *np.eye(3).ravel()]) if n > 2 else RANDOM.normal(size=6)
    words = [f"{x!r}" for x in p.tolist()]
    fixed = [f"{x!r}" for x in f.tolist()]
    if change in ("one less", "none", "NaN", "inf", "1e30", "a word") and not words:
        pytest.skip("the identity has no parameters")
    if change == "fixed one more":
        fixed += ["0.0"] * (3 if len(fixed) == 3 else 1)
    elif change in ("NaN", "inf", "1e30", "a word"):
        words[-1] = change.rpartition(" ")[2]
    else:
        words = {"one less": words[:-1], "one more": [*words, "0.5"], "none": []}[change]
    path = tmp_path / "a.tfm"
    path.write_text(
        f"#Insight Transform File V1.0\nTransform: {kind}_double_{dim}_{dim}\nParameters: "
        f"{' '.join(words)}\nFixedParameters: {' '.join(fixed)}\n",
        encoding="utf-8",
    )
    with pytest.raises(VolumeFileError, match=r"^a\.tfm: "):
        read_transform(path)


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        (["AffineTransform_double_3_3", "AffineTransform_double_3_3"], "2 transforms .* does not state"),
        (
            ["CompositeTransform_double_3_3", "AffineTransform_double_3_3", "CompositeTransform_double_3_3"],
            "flatten it",
        ),
        (
            ["CompositeTransform_double_3_3", "AffineTransform_double_3_3", "AffineTransform_double_2_2"],
            "different dim",
        ),
        (["AffineTransform_double_2_3"], "2 dimensions to 3"),
        (["AffineTransform_double_4_4"], "4 dimensions"),
        (["TimeVaryingVelocityFieldTransform_double_3_3"], "is not read here"),
        ([], "no transform"),
        (["BSplineTransform_double_3_3_5"], "order 5"),
        (["Rigid2DTransform_double_3_3"], "none of 3 dim"),
    ],
    ids=["two", "nested", "mixed", "to another", "four", "unknown", "empty", "order", "plane"],
)
def test_lists_that_are_no_one_map_are_refused(entries: list[str], words: str, tmp_path: Path) -> None:
    counts = {"Af": {"2": (6, 2), "3": (12, 3)}}
    path = write_transforms(
        tmp_path / "a.tfm",
        *(text(name, *(np.zeros(n) for n in counts.get(name[:2], {}).get(name[-1], (0, 0)))) for name in entries),
    )
    with pytest.raises(VolumeFileError, match=words):
        read_transform(path)


@pytest.mark.parametrize(
    "lines",
    [
        "Transform: {0}\nTransform: {0}\n",
        "Parameters: 1 2 3\n",
        "Nonsense: 1\n",
        "Transform: {0}\nParameters: 1 2 3\nParameters: 1 2 3\nFixedParameters:\n",
        "Transform: {0}\nParameters: 1 2 3\n",
        "Transform: {0}\nParameters: 1_0 2 3\nFixedParameters:\n",
        "Transform: {0}\nParameters: 1 2 \u0663\nFixedParameters:\n",
    ],
)
def test_lines_that_itk_would_not_write_are_refused(lines: str, tmp_path: Path) -> None:
    path = write_transforms(tmp_path / "a.tfm", lines.format("TranslationTransform_double_3_3"))
    with pytest.raises(VolumeFileError, match=r"^a\.tfm: "):
        read_transform(path)
