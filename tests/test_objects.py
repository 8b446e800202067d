"""Table of the public classes of a notebook: what each shows, and what Python and NumPy make of it, literally."""

from __future__ import annotations

import copy
import io
import pickle
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import deformnb as dn
from deformnb.volume.plane import Raster
from deformnb.warping.points import Landmarks

EVIL = "<script>a & b</script>"
SAFE = "&lt;script&gt;a &amp; b&lt;/script&gt;"

GRID = dn.Grid((2, 2, 3), (1.0, 1.0, 2.5), (10.0, 0.0, 0.0), unit="mm")
VOLUME = dn.Volume(np.arange(12, dtype=np.uint8).reshape(2, 2, 3), GRID, EVIL)
PLANE = dn.Plane((0, 0, 0), (1, 0, 0), (0, 1, 0))
PICTURE = dn.Picture(
    np.array([[0, 100, 200]], np.uint8), PLANE, Raster((1, 3), (1.0, 2.0), (0.0, 0.0)), "slice", (0.0, 200.0)
)
POINTS = dn.ControlPoints.from_arrays(
    [[0, 0], [10, 0], [0, 10]], [[0, 0], [13, 4], [0, 10]], names=["tail", EVIL, ""], active=[True, True, False]
)
MARKS = Landmarks([[0, 0, 0], [1, 2, 3]], ("tail", EVIL), fixed=[[0, 0, 1], [np.nan] * 3], unit="mm")
DEFORMATION = dn.Deformation((dn.Step((POINTS,), PLANE, name=EVIL, trend="translation"),), name=EVIL)
CHANNELS = dn.volume.Channels((dn.Volume(VOLUME.values, GRID, "a"), dn.Volume(VOLUME.values, GRID, "b")), name=EVIL)
MESH = dn.warping.Mesh([[0, 0, 0], [1, 0, 0], [0, 2, 0]], [[0, 1, 2]], EVIL, unit="mm")
FIT = dn.fit_rbf(POINTS, trend="translation", support=20.0)


def session() -> dn.Session:
    return dn.Session(VOLUME, DEFORMATION)


@dataclass(frozen=True)
class Row:
    """Wanted outputs of an object; texts of errors are those of exceptions, with their types."""

    made: Callable[[], Any]
    text: str
    html: str | None  # with <img> for each picture; None where there is none
    png: tuple[int, int] | None  # width and height
    array: Any  # np.asarray, as lists
    length: Any
    items: Any  # the texts of iteration
    equals_copy: bool  # == of an object and its copy, which is always unequal to None
    hashable: bool


OBJECT = "an array of one object"
NO_LENGTH = "TypeError: object of type '{}' has no len()"
NOT_ITERABLE = "TypeError: '{}' object is not iterable"

TABLE = {
    "Volume": Row(
        lambda: VOLUME,
        f"<Volume '{EVIL}': 3 x 2 x 2 voxels (x, y, z), uint8, spacing 1 x 1 x 2.5 mm>",
        f"<div><b>Volume</b> {SAFE}<br><img><table><tr><th>shape (z, y, x)</th><td>2 x 2 x 3</td></tr>"
        "<tr><th>voxels</th><td>uint8, 0 to 11</td></tr>"
        "<tr><th>spacing (x, y, z)</th><td>1 x 1 x 2.5 mm</td></tr>"
        "<tr><th>origin (x, y, z)</th><td>10, 0, 0 mm</td></tr><tr><th>axes</th><td>LPS</td></tr></table></div>",
        None,
        [[[0, 1, 2], [3, 4, 5]], [[6, 7, 8], [9, 10, 11]]],
        2,
        ["[[0 1 2]\n [3 4 5]]", "[[ 6  7  8]\n [ 9 10 11]]"],
        False,
        True,
    ),
    "Picture": Row(
        lambda: PICTURE,
        "<Picture: slice, 3 x 1 pixels (right, down) of 1 x 2, uint8 from 0 to 200>",
        None,
        (480, 320),
        [[0, 100, 200]],
        NO_LENGTH.format("Picture"),
        NOT_ITERABLE.format("Picture"),
        True,
        True,
    ),
    "ControlPoints": Row(
        lambda: POINTS,
        f"<ControlPoints: 3 points in the plane, 1 moved: 'tail', '{EVIL[:20]}'>",
        "<div><b>ControlPoints</b><table><tr><th></th><th>name</th><th>source (a, b)</th><th>target (a, b)</th>"
        "<th>moved</th><th></th></tr>"
        "<tr><td>1</td><td>tail</td><td>0, 0</td><td>0, 0</td><td>0</td><td></td></tr>"
        f"<tr><td>2</td><td>{SAFE}</td><td>10, 0</td><td>13, 4</td><td>5</td><td></td></tr>"
        "<tr><td>3</td><td></td><td>0, 10</td><td>0, 10</td><td>0</td><td>off</td></tr></table></div>",
        None,
        "TypeError: control points are two arrays; take points.source or points.target.",
        3,
        [
            (
                "ControlPoint(id=0, name='tail', source=(0.0, 0.0), target=(0.0, 0.0), active=True, weight=1.0, "
                "locked=False, radius=None)"
            ),
            (
                f"ControlPoint(id=1, name='{EVIL}', source=(10.0, 0.0), target=(13.0, 4.0), active=True, weight=1.0, "
                "locked=False, radius=None)"
            ),
            (
                "ControlPoint(id=2, name='', source=(0.0, 10.0), target=(0.0, 10.0), active=False, weight=1.0, "
                "locked=False, radius=None)"
            ),
        ],
        True,
        False,
    ),
    "Landmarks": Row(
        lambda: MARKS,
        f"<Landmarks: 2 in space, paired with fixed places, in mm: 'tail', '{EVIL[:20]}'>",
        "<div><b>Landmarks</b><table><tr><th></th><th>name</th><th>place (x, y, z) in mm</th>"
        "<th>fixed place (x, y, z)</th><th></th></tr>"
        "<tr><td>1</td><td>tail</td><td>0, 0, 0</td><td>0, 0, 1</td><td></td></tr>"
        f"<tr><td>2</td><td>{SAFE}</td><td>1, 2, 3</td><td></td><td></td></tr></table></div>",
        None,
        [[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]],
        2,
        ["[0. 0. 0.]", "[1. 2. 3.]"],
        True,
        False,
    ),
    "Deformation": Row(
        lambda: DEFORMATION,
        f"<Deformation '{EVIL}': 1 step (compose)>",
        f"<div><b>Deformation</b> {SAFE}<table><tr><th></th><th>step</th><th>points</th><th>moved</th><th>fit</th>"
        "<th>extrusion</th><th></th><th></th><th></th></tr>"
        f"<tr><td>1</td><td>{SAFE}</td><td>3 on a picture</td><td>1</td><td>wendland_c2, translation trend</td>"
        "<td>replicate</td><td></td><td></td><td></td></tr></table></div>",
        None,
        [DEFORMATION.steps[0]],
        1,
        [str(DEFORMATION.steps[0])],
        True,
        False,
    ),
    "Channels": Row(
        lambda: CHANNELS,
        "<Channels: a, b; 3 x 2 x 2 voxels (x, y, z), uint8>",
        f"<div><b>Channels</b> {SAFE}<br><img><table><tr><th>channels</th><td>a, b</td></tr>"
        "<tr><th>shape (z, y, x)</th><td>2 x 2 x 3</td></tr><tr><th>voxels</th><td>uint8</td></tr>"
        "<tr><th>spacing (x, y, z)</th><td>1 x 1 x 2.5 mm</td></tr>"
        "<tr><th>origin (x, y, z)</th><td>10, 0, 0 mm</td></tr><tr><th>axes</th><td>LPS</td></tr></table></div>",
        None,
        [VOLUME.values.tolist()] * 2,
        2,
        [repr(one) for one in CHANNELS.volumes],
        True,
        True,
    ),
    "Mesh": Row(
        lambda: MESH,
        f"<Mesh '{EVIL}': 3 corners, 1 triangle>",
        f"<div><b>Mesh</b> {SAFE}<table><tr><th>corners</th><td>3</td></tr><tr><th>triangles</th><td>1</td></tr>"
        "<tr><th>from (x, y, z)</th><td>0, 0, 0 mm</td></tr><tr><th>to (x, y, z)</th><td>1, 2, 0 mm</td></tr>"
        "<tr><th>closed</th><td>no</td></tr></table></div>",
        None,
        OBJECT,
        NO_LENGTH.format("Mesh"),
        NOT_ITERABLE.format("Mesh"),
        True,
        True,
    ),
    "Session": Row(
        session,
        f"<Session on '{EVIL}', 3 x 2 x 2 voxels (x, y, z): 1 step>",
        f"<div><b>Session</b> {SAFE}<br><img><table><tr><th></th><th>step</th><th>points</th><th>moved</th>"
        "<th>fit</th><th>extrusion</th><th></th><th></th><th></th></tr>"
        f"<tr><td>1</td><td>{SAFE}</td><td>3 on a picture</td><td>1</td><td>wendland_c2, translation trend</td>"
        "<td>replicate</td><td></td><td></td><td></td></tr></table></div>",
        None,
        OBJECT,
        NO_LENGTH.format("Session"),
        NOT_ITERABLE.format("Session"),
        False,
        True,
    ),
    "RBFInterpolant": Row(
        lambda: FIT,
        "<RBFInterpolant: 2 points in the plane, wendland_c2, trend translation>",
        "<div><b>RBFInterpolant</b><table><tr><th>points</th><td>2 in the plane</td></tr>"
        "<tr><th>kernel</th><td>wendland_c2</td></tr><tr><th>support</th><td>20</td></tr>"
        "<tr><th>trend</th><td>translation</td></tr></table></div>",
        None,
        OBJECT,
        NO_LENGTH.format("RBFInterpolant"),
        NOT_ITERABLE.format("RBFInterpolant"),
        False,
        True,
    ),
}

TABLES = {
    "Grid": (
        lambda: GRID,
        (
            "<div><b>Grid</b><table><tr><th>shape (z, y, x)</th><td>2 x 2 x 3</td></tr><tr><th>spacing (x, y, z)</th>"
            "<td>1 x 1 x 2.5 mm</td></tr><tr><th>origin (x, y, z)</th><td>10, 0, 0 mm</td></tr><tr><th>axes</th>"
            "<td>LPS</td></tr><tr><th>size (x, y, z)</th><td>3 x 2 x 5 mm</td></tr></table></div>"
        ),
    ),
    "LargeVolume": (
        lambda: dn.chunked.open_volume(VOLUME),
        (
            f"<div><b>LargeVolume</b> {SAFE}<table><tr><th>shape (z, y, x)</th><td>2 x 2 x 3</td></tr>"
            "<tr><th>voxels</th>"
            "<td>uint8, read in parts</td></tr><tr><th>spacing (x, y, z)</th><td>1 x 1 x 2.5 mm</td></tr><tr>"
            "<th>origin (x, y, z)</th><td>10, 0, 0 mm</td></tr><tr><th>axes</th><td>LPS</td></tr></table></div>"
        ),
    ),
    "Staged": (
        lambda: dn.rbf.Staged((FIT, FIT)),
        "<div><b>Staged</b><table><tr><th>points</th><td>2 in the plane</td></tr><tr><th>trend</th>"
        "<td>translation</td></tr><tr><th>made of</th><td>"
        + "; ".join(["&lt;RBFInterpolant: 2 points in the plane, wendland_c2, trend translation&gt;"] * 2)
        + "</td></tr></table></div>",
    ),
    "ForwardFit": (
        lambda: dn.rbf.ForwardFit(FIT),
        (
            "<div><b>ForwardFit</b><table><tr><th>points</th><td>2 in the plane</td></tr><tr><th>trend</th>"
            "<td>translation</td></tr><tr><th>made of</th><td>&lt;RBFInterpolant: 2 points in the plane, wendland_c2, "
            "trend translation&gt;</td></tr></table></div>"
        ),
    ),
}
"""Objects that are a table in a cell, and its HTML."""

OTHERS = {dn.Studio, dn.rbf.ChosenFit, dn.rbf.TipBlend}
"""Those with tests of their own, and a fit that only cuts make, whose table is that of all fits."""

_IMAGE = re.compile(r'<img alt="[^"<>]+" width="\d+" src="data:image/png;base64,[A-Za-z0-9+/=]+">')
rows = pytest.mark.parametrize("row", TABLE.values(), ids=TABLE)


def outcome(call: Callable[[], Any]) -> Any:
    """The result of a call, or its error as a text."""
    try:
        return call()
    except TypeError as error:
        return f"{type(error).__name__}: {error}"


@rows
def test_a_console_shows_one_line(row: Row) -> None:
    assert repr(row.made()) == row.text


@rows
def test_a_cell_shows_a_picture_or_a_table_with_escaped_names(row: Row) -> None:
    made = row.made()
    show = getattr(made, "_repr_html_", None)
    assert (None if show is None else _IMAGE.sub("<img>", show())) == row.html
    png = getattr(made, "_repr_png_", None)
    assert (None if png is None else Image.open(io.BytesIO(png())).size) == row.png


@pytest.mark.parametrize("name", TABLES)
def test_a_cell_shows_a_table(name: str) -> None:
    made, html = TABLES[name]
    assert made()._repr_html_() == html


def test_every_class_that_a_cell_shows_is_here() -> None:
    shown = {type(row.made()).__name__ for row in TABLE.values()} | set(TABLES)
    for module in (dn, dn.rbf, dn.volume, dn.warping, dn.chunked):
        for kind in (getattr(module, name) for name in module.__all__):
            if isinstance(kind, type) and "_repr_html_" in dir(kind) and kind not in OTHERS:
                assert kind.__name__ in shown


@rows
def test_numpy_takes_it_as_an_array(row: Row) -> None:
    found = outcome(lambda: np.asarray(row.made()))
    if isinstance(found, np.ndarray):
        found = OBJECT if found.dtype == object and found.ndim == 0 else found.tolist()
    assert found == row.array


@rows
def test_length_and_iteration(row: Row) -> None:
    assert outcome(lambda: len(row.made())) == row.length
    assert outcome(lambda: [str(one) for one in row.made()]) == row.items


@rows
def test_equality_and_hash(row: Row) -> None:
    made = row.made()
    assert (made == made) is True
    assert (made == None) is False  # noqa: E711  # as a user may write it
    assert (made != None) is True  # noqa: E711
    assert isinstance(outcome(lambda: hash(made)), int) is row.hashable


@pytest.mark.parametrize("way", [copy.copy, copy.deepcopy, lambda made: pickle.loads(pickle.dumps(made))])
@rows
def test_a_copy_is_the_same(row: Row, way: Callable[[Any], Any]) -> None:
    made = row.made()
    found = outcome(lambda: way(made))
    if isinstance(made, dn.Session):
        assert found == (
            "TypeError: a session is not copied; its document makes another one: Session(volume, session.document())."
        )
        return
    assert repr(found) == row.text
    assert (found == made) is row.equals_copy
    if isinstance(row.array, list):
        assert np.asarray(found).tolist() == row.array


def test_equality_is_that_of_all_that_an_object_holds() -> None:
    for made, changes in (
        (PICTURE, {"values": PICTURE.values + 1, "plane": replace(PLANE, origin=(0, 0, 1)), "unit": "HU"}),
        (MESH, {"points": MESH.points + 1, "faces": MESH.faces[:, ::-1], "name": "b", "unit": "m"}),
        (CHANNELS, {"volumes": CHANNELS.volumes[::-1], "name": "b", "colours": ((1, 0, 0), (0, 1, 0))}),
    ):
        assert hash(made) == hash(copy.deepcopy(made))
        for name, value in changes.items():
            assert made != replace(made, **{name: value}), name  # type: ignore[arg-type, type-var]
        assert (made == "a") is False
    not_a_number = dn.Volume.from_array(np.full((1, 1, 2), np.nan), name="a")
    assert not_a_number.equals(copy.deepcopy(not_a_number))
    for other in (VOLUME + 1, replace(VOLUME, name="b"), VOLUME.astype(np.int16), VOLUME.values, None):
        assert not VOLUME.equals(other)
    assert VOLUME.equals(copy.deepcopy(VOLUME))


def test_what_is_in_an_object_is_what_its_brackets_give() -> None:
    for made, name in ((POINTS, "tail"), (MARKS, "tail"), (DEFORMATION, EVIL), (CHANNELS, "a")):
        assert name in made
        assert "head" not in made
        assert made[name] in made  # type: ignore[index]
        assert made[0] in made
        assert None not in made
    assert 11 in VOLUME
    assert 12 not in VOLUME
    assert "" not in POINTS


def test_parts_of_points_keep_their_unit() -> None:
    points = dn.ControlPoints.from_arrays([[0, 0], [1, 1]], names=["a", "b"], unit="um")
    for part in (points[:1], points[["b", "a"]], points.add([2, 2]), points.move("a", [1, 0]), points.remove("a")):
        assert part.unit == points.unit
    assert points[["b", "a"]].names == ("b", "a")
    for wrong, words in (("", "names no point"), (None, "asks for 2 axes"), (["a", "c"], "no point of the name 'c'")):
        with pytest.raises(dn.errors.DeformError, match=words):
            points[wrong]
    with pytest.raises(dn.errors.DeformError, match=r"2 points have the name 'a'.*position, which are 0, 1"):
        dn.ControlPoints.from_arrays([[0, 0], [1, 1]], names=["a", "a"])["a"]


def test_nothing_changes_the_voxels_of_a_volume() -> None:
    values = np.arange(27, dtype=np.float32).reshape(3, 3, 3)
    volume, before = dn.Volume.from_array(values), values.copy()
    for change in (
        lambda: np.put(volume, 0, 1),
        lambda: np.copyto(volume, 0),
        lambda: np.place(volume, values > 3, 0),
        lambda: np.putmask(volume, values > 3, 0),
        lambda: np.fill_diagonal(volume, 0),
        lambda: np.add.at(volume, 0, 1),
        lambda: np.add(volume, 1, out=volume),
        lambda: np.nan_to_num(volume, copy=False),
        lambda: np.median(volume, overwrite_input=True),
    ):
        with pytest.raises(dn.errors.DeformError, match="never changed in place"):
            change()
        np.testing.assert_array_equal(values, before)


def test_a_volume_is_no_truth_and_no_index() -> None:
    for question in (lambda: bool(VOLUME == 3), lambda: not VOLUME > 3, lambda: sorted([VOLUME, VOLUME])):
        with pytest.raises(dn.errors.DeformError, match="neither true nor false"):
            question()
    assert bool(VOLUME) is True
    with pytest.raises(dn.errors.DeformError, match="a mask is a volume of bool, got uint8"):
        VOLUME[VOLUME]
    assert type(VOLUME[:, :, :2] @ VOLUME[:, :, :2]) is np.ndarray
    with pytest.raises(dn.errors.DeformError, match="three whole numbers"):
        VOLUME.crop((0.5, 0, 0), (1, 1, 1))  # type: ignore[arg-type]
    with pytest.raises(dn.errors.DeformError, match="no type of voxels; there are bool"):
        VOLUME.astype("hounsfield")
    for other, words in ((PICTURE, "warp_picture"), (MARKS, "a Volume is needed")):
        with pytest.raises(dn.errors.DeformError, match=words):
            dn.project(other, "+z")


def test_objects_are_shown_without_jax_and_matplotlib() -> None:
    code = """
        import sys
        import numpy as np
        import deformnb as dn
        volume = dn.Volume.from_array(np.arange(60, dtype=np.uint8).reshape(3, 4, 5))
        points = dn.ControlPoints.from_arrays([[0, 0], [3, 0], [0, 3]], [[0, 0], [3, 1], [0, 3]])
        session = dn.Session(volume)
        assert "PIL" not in sys.modules
        for shown in (volume, points, dn.Deformation.from_picture_points(volume, "+z", points), session):
            assert shown._repr_html_()
        assert dn.project(volume, "+z")._repr_png_()
        print(sorted({"jax", "matplotlib", "vtkmodules", "pandas", "xarray"} & set(sys.modules)))
    """
    code = "\n".join(line[8:] for line in code.splitlines())
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, encoding="utf-8", check=False)
    assert (run.returncode, run.stdout.strip()) == (0, "[]"), run.stderr


def test_functions_of_numpy_that_move_no_voxels_keep_the_grid() -> None:
    volume = dn.Volume(np.arange(8, dtype=np.int16).reshape(2, 2, 2), dn.Grid((2, 2, 2), (1.0, 2.0, 3.0)), "a")
    kept = {
        "clip": np.clip(volume, 2, 5),
        "round": np.round(volume, -1),
        "around": np.around(volume, -1),
        "select": np.select([volume > 3], [volume], 0),
        "interp": np.interp(volume, [0, 7], [0.0, 1.0]),
        "digitize": np.digitize(volume, [2, 5]),
        "where": np.where(volume > 3, volume, 0),
        "nan_to_num": np.nan_to_num(volume),
        "isin": np.isin(volume, [1, 2]),
        "isclose": np.isclose(volume, 3),
        "zeros_like": np.zeros_like(volume),
        "full_like": np.full_like(volume, 7),
    }
    for name, found in kept.items():
        assert isinstance(found, dn.Volume), name
        assert found.grid == volume.grid, name
    assert kept["clip"].values.ravel().tolist() == [2, 2, 2, 3, 4, 5, 5, 5]
    assert kept["select"].values.tolist() == kept["where"].values.tolist()
    assert kept["digitize"].values.ravel().tolist() == [0, 0, 1, 1, 1, 2, 2, 2]
    assert kept["where"].values.ravel().tolist() == [0, 0, 0, 0, 4, 5, 6, 7]
    assert kept["full_like"].values.ravel().tolist() == [7] * 8
    for moved in (np.flip(volume), np.roll(volume, 1), np.sort(volume), np.rot90(volume), np.cumsum(volume, axis=0)):
        assert type(moved) is np.ndarray
    assert np.stack([volume, volume]).shape == (2, 2, 2, 2)
    assert (np.mean(volume), np.max(volume), np.where(volume > 6)[0].tolist()) == (3.5, 7, [1])
    other = dn.Volume(volume.values, dn.Grid((2, 2, 2)))
    with pytest.raises(dn.errors.DeformError, match="on different grids"):
        np.where(volume > 3, volume, other)
    with pytest.raises(dn.errors.DeformError, match="never changed in place"):
        np.clip(volume, 0, 1, out=volume)
    with pytest.raises(dn.errors.DeformError, match="no parts by name, got 'head'"):
        volume["head"]


def test_the_steps_of_a_deformation_are_its_items() -> None:
    step = DEFORMATION[0]
    two = dn.Deformation((replace(step, name="bend"), replace(step, name="twist")))
    assert [step.name for step in two] == ["bend", "twist"]
    assert (len(two), two["bend"].name, two[-1].name) == (2, "bend", "twist")
    assert bool(dn.Deformation()) is True
    for wrong in (2, "fold", 1.0, True, slice(1)):
        with pytest.raises(dn.errors.DeformError, match=r"steps are named|a step is taken by"):
            two[wrong]  # type: ignore[index]


def test_no_code_asks_whether_a_mask_is_true(tmp_path: Path) -> None:
    """The studio's ways with volumes that may be absent, which a volume of bool refuses to decide."""
    mask = dn.Volume(np.indices((12, 14, 16)).sum(axis=0) % 5 > 2, dn.Grid((12, 14, 16)))
    flat, space = np.array([[5.0, 5.0], [10.0, 10.0]]), np.array([[5.0, 5.0, 5.0], [10.0, 10.0, 8.0]])
    points = dn.ControlPoints.from_arrays(flat, flat + np.array([1.0, 0.0]))
    editor = dn.widgets.Editor(dn.project(mask, "+z", "slice"), points=points)
    assert editor.preview_png().startswith(b"\x89PNG")
    studio = dn.Studio(mask)
    try:
        for step in (
            dn.Step((points,), dn.Plane.from_view(mask.grid, "+z"), support=6.0),
            dn.Step((dn.ControlPoints.from_arrays(space, space + np.array([1.0, 0.0, 0.0])),)),
        ):
            studio.session.take(dn.Deformation((step,)))
            for suffix in (".html", ".png", ".nrrd"):
                name = f"{step.plane is None}{suffix}"
                (studio.export_html if suffix == ".html" else studio.export)(tmp_path / name)
                assert (tmp_path / name).stat().st_size
    finally:
        studio.close()
        editor.close()
