"""Several steps, cuts, rigid parts and points in space in the studio: its panels, its editors, its page's messages."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import ipywidgets as ipw
import numpy as np
import pytest
from front_end import deliver
from numpy.testing import assert_array_equal
from studio_driver import a_drag, a_volume, act, controls, drag, get_notice, panel, post

from deformnb.document.deformation import Deformation
from deformnb.document.json_regions import part_to_data
from deformnb.document.step_checks import is_fold_free
from deformnb.errors import DeformError
from deformnb.io.volumes.formats import read_volume, write_volume
from deformnb.rbf.cuts import Cut
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import HalfSpace, Polygon
from deformnb.rbf.rigid import RigidMotion, RigidPart
from deformnb.volume.volume import Volume
from deformnb.widgets import Studio
from deformnb.widgets.messages.points import points_to_json
from deformnb.widgets.messages.shapes import shapes_to_json
from deformnb.widgets.studio.step_diagnostics import tissue_of


def buttons_of(box: Any) -> dict[str, ipw.Button]:
    """The buttons in a box, by their labels."""
    found = {box.description: box} if isinstance(box, ipw.Button) else {}
    for child in getattr(box, "children", ()):
        found |= buttons_of(child)
    return found


@pytest.fixture
def studio(tmp_path: Path) -> Iterator[Studio]:
    made = Studio(a_volume(), side="+y", folder=tmp_path)
    made.wait()
    yield made
    made.close()


# -- cuts, rigid parts, steps in space ---------------------------------------------------------------------------------


def draws(studio: Studio, what: str, kind: str, *shapes: Any) -> None:
    """As shapes drawn in the editor's page."""
    post(studio, {"type": "shapes", "what": what, "kind": kind, "shapes": list(shapes)})


def a_line(studio: Studio) -> dict[str, Any]:
    """Down the middle of the picture."""
    low, high = studio.editor.points.source[:4].min(axis=0), studio.editor.points.source[:4].max(axis=0)
    a = float((low[0] + high[0]) / 2)
    places = [[a, float(high[1])], [a, float(low[1])]]
    return {"name": "", "enabled": True, "region": {"kind": "line", "vertices": places}}


def test_a_cut_drawn_in_the_page_is_pulled_open_and_undone(studio: Studio) -> None:
    draws(studio, "cuts", "add cut", a_line(studio))
    assert studio.session.editing.history["undo"] == "add cut"
    assert shapes_to_json("cuts", studio.editor.cuts) == [a_line(studio)]
    middle = studio.editor.points.source.mean(axis=0)
    near, far = np.array([2.0, 0.0]), np.array([5.0, 0.0])
    drag(studio, studio.editor.points.add(middle - near, middle - far).add(middle + near, middle + far))
    expected = studio.deformation.apply(studio.volume)
    assert_array_equal(studio.result().values, expected.values)
    across = studio.result().values.max(axis=(0, 1)) if studio.session.steps.view == "+y" else None
    assert across is not None
    assert (across[10:14] == 0).all()
    assert across[:9].any()
    assert across[15:].any()
    items = panel(studio, "Rigid parts and cuts").items
    assert [(row["title"], row["facts"][:2]) for row in items.rows] == [("cut 1", ["cut", "line"])]
    act(items, "switch", 0, False)
    assert (studio.result().values.max(axis=(0, 1))[11:13] > 0).all()
    assert not studio.editor.cuts[0].enabled
    for _ in range(3):
        post(studio, {"type": "history", "way": "undo"})
    assert studio.editor.cuts == ()
    assert_array_equal(studio.result().values, studio.volume.values)


def test_shapes_that_the_points_do_not_allow_go_back_in_the_page(studio: Studio) -> None:
    drag(studio, a_drag(studio))
    (a, b) = studio.editor.points.source[-1].tolist()
    corners = [[a - 2, b - 2], [a + 2, b - 2], [a + 2, b + 2], [a - 2, b + 2]]
    around = {
        "name": "stone",
        "enabled": True,
        "motion": None,
        "weight": "saturated",
        "reach": None,
        "region": {"kind": "polygon", "vertices": corners},
    }
    draws(studio, "parts", "add part", around)
    assert "stone" in get_notice(studio)
    assert studio.editor.parts == ()
    assert studio.session.editing.step.parts == ()
    assert studio.stats()["refused"] == 1
    points = studio.editor.points
    drag(studio, points.remove(points.ids[-1]))
    draws(studio, "parts", "add part", around)
    assert studio.session.editing.step.parts[0].name == "stone"
    post(studio, {"type": "shapes", "what": "parts", "kind": "x", "shapes": [{"region": {"kind": "no"}}]})
    assert studio.session.editing.step.parts[0].name == "stone"


def test_quick_keys_on_a_part_are_one_step_of_the_history(studio: Studio) -> None:
    part = RigidPart(HalfSpace((0.0, 40.0), (0.0, -1.0)), name="floor")
    studio.session.editing.edit_parts([part])
    for number in (1.0, 2.0, 3.0):
        moved = part_to_data(replace(part, motion=RigidMotion.turn(0, (0, 0), (number, 0))))
        post(studio, {"type": "shapes", "what": "parts", "kind": "move floor", "shapes": [moved], "joins": True})
    assert studio.session.editing.step.parts[0].motion == RigidMotion.turn(0, (0, 0), (3.0, 0))
    assert studio.session.editing.undo() == "move floor"
    assert studio.session.editing.step.parts == (part,)


def test_code_and_page_share_cuts_and_parts(studio: Studio) -> None:
    cut = Cut(HalfSpace((12.0, 5.0), (1.0, 0.0)), "half")
    part = RigidPart(HalfSpace((0.0, 14.0), (0.0, -1.0)), name="floor")
    studio.session.editing.change(cuts=[cut])
    studio.session.editing.edit_parts([part])
    studio.session.editing.change(cut_rule="paper")
    assert studio.editor.cuts[0].name == "half"
    assert studio.editor.parts[0].name == "floor"
    assert studio.editor.cut_rule == "paper"
    assert (studio.editor.step().cuts, studio.editor.step().parts) == ((cut,), (part,))
    controls(studio)["Sides seen"].value = "source"
    assert studio.editor.cut_rule == studio.session.editing.step.cut_rule == "source"
    studio.session.steps.add()
    studio.wait()
    assert studio.editor.cuts == studio.editor.parts == ()


def test_a_part_is_turned_and_shifted_about_its_middle(studio: Studio) -> None:
    shapes = panel(studio, "Rigid parts and cuts")
    draws(studio, "parts", "add part", {"region": {"kind": "polygon", "vertices": [[4, 4], [10, 4], [10, 8], [4, 8]]}})
    found = {c.widget.description: c.widget for c in shapes.part.controls}
    assert found["Turn"].layout.display == "none"
    found["Part"].value = "moved"
    found["Turn"].value = 90.0
    found["Shift right"].value = 2.0
    part = studio.session.editing.step.parts[0]
    np.testing.assert_allclose(part.motion([[10.0, 6.0]]), [[9.0, 9.0]], atol=1e-9)  # turned about (7, 6), and 2 on
    assert shapes.items.rows[0]["facts"] == ["rigid part", "closed line", "turned 90\N{DEGREE SIGN}, shifted 2.0, 0.0"]
    assert studio.editor.parts[0].motion is not None
    x = studio.session.editing.plane.from_plane(np.array([[9.0, 9.0, 3.0]]))
    came_from = studio.session.editing.plane.to_plane(x + studio.session.results.field().displacement(x))
    np.testing.assert_allclose(came_from[0, :2], [10, 6], atol=1e-6)
    found["Reach"].value = 6.0
    assert studio.session.editing.step.parts[0].reach == 6.0
    found["Influence by"].value = "distance"
    found["Part"].value = "fixed"
    assert studio.session.editing.step.parts[0].motion is None
    assert found["Turn"].layout.display == "none"
    act(shapes.items, "rename", 0, "knee")
    assert studio.session.editing.history["undo"] == "rename part 1"
    act(shapes.items, "remove", 0)
    assert studio.session.editing.step.parts == ()
    assert studio.session.editing.history["undo"] == "remove knee"


def test_the_list_of_parts_and_the_picture_choose_the_same(studio: Studio) -> None:
    shapes = panel(studio, "Rigid parts and cuts")
    boxes = [[[a, 4], [a + 4, 4], [a + 4, 8], [a, 8]] for a in (2.0, 8.0, 14.0)]
    studio.session.editing.edit_parts(
        [RigidPart(Polygon(box), name=name) for box, name in zip(boxes, "abc", strict=True)]
    )
    assert shapes.items.chosen == -1
    assert shapes.part.part is None

    def names() -> tuple[str, str]:
        """The chosen and movable rows of the list, and those of the picture."""
        chosen, row = studio.editor.chosen_shape, shapes.items.chosen
        moved = shapes.part.part.name if shapes.part.part else ""
        assert moved == (shapes.items.rows[row]["name"] if row >= 0 else "")
        return moved, studio.editor.parts[chosen["index"]].name if chosen else ""

    post(studio, {"type": "choose", "what": "parts", "index": 1, "shape": part_to_data(studio.editor.parts[1])})
    assert names() == ("b", "b")
    act(shapes.items, "choose", 2)
    assert names() == ("c", "c")
    next(c.widget for c in shapes.part.controls if c.widget.description == "Part").value = "moved"
    assert [part.motion is not None for part in studio.session.editing.step.parts] == [False, False, True]
    assert names() == ("c", "c")
    studio.session.editing.edit_parts(studio.session.editing.step.parts[::-1], "reorder")
    assert names() == ("c", "c")
    studio.session.editing.edit_parts(studio.session.editing.step.parts[:-1], "remove a")
    post(studio, {"type": "choose", "what": "parts", "index": 1, "shape": part_to_data(studio.editor.parts[1])})
    studio.undo()
    assert names() == ("b", "b")
    studio.undo()
    assert names() == ("b", "b")
    # The page says its choice before it hears that the list is another one: the shape counts, not its place.
    post(studio, {"type": "choose", "what": "parts", "index": 2, "shape": part_to_data(studio.editor.parts[0])})
    assert names() == ("a", "a")
    act(shapes.items, "remove", 0)
    assert names() == ("", "")  # and not the next one, which was not meant
    post(studio, {"type": "choose", "what": "parts", "index": 0, "shape": {"name": "a"}})
    assert names() == ("", "")
    post(studio, {"type": "choose", "what": "parts", "index": 0, "shape": part_to_data(studio.editor.parts[0])})
    post(studio, {"type": "choose", "what": None})
    assert names() == ("b", "")  # a point is selected in the picture: the controls stay


def test_labels_and_the_ground_become_parts_and_cuts(tmp_path: Path) -> None:
    volume = a_volume()
    labels = np.zeros(volume.shape, np.uint8)
    labels[6:10, 8:12, 4:9] = 7
    labels[2:4, 2:4, 2:4] = 9
    made = Studio(volume, side="+y", labels=labels, label_names={7: "femur"}, folder=tmp_path)
    shapes = panel(made, "Rigid parts and cuts")
    assert [text for text, _ in shapes.labels.list.options] == ["femur", "label 9"]
    buttons = buttons_of(shapes.box)
    buttons["Label as part"].click()
    part = made.session.editing.step.parts[0]
    assert part.name == "femur"
    flat = np.array([[6.0, 8.0], [1.0, 8.0]])  # +y: a is x, b is down from the top slice
    assert (part.region.signed_distance(flat) < 0).tolist() == [True, False]
    buttons["Fixed side"].click()
    ground = made.session.editing.step.parts[1].region
    assert (ground.signed_distance([[5.0, 15.0], [5.0, 2.0]]) < 0).tolist() == [True, False]
    made.session.steps.add(in_space=True)
    made.wait()
    shapes.labels.list.value = (9,)
    buttons["Label as cut"].click()
    inside = np.array([[3.0, 3.0, 3.0], [9.0, 9.0, 9.0]])
    assert (made.session.editing.step.cuts[0].region.signed_distance(inside) < 0).tolist() == [True, False]
    made.close()
    with pytest.raises(DeformError, match="shape"):
        Studio(volume, labels=labels[1:])


def test_a_label_file_is_opened_and_several_labels_are_taken_in_one_edit(tmp_path: Path) -> None:
    volume = a_volume()
    values = np.zeros(volume.shape, np.uint8)
    values[6:10, 8:12, 4:9], values[2:4, 2:4, 2:4], values[12:14, 5:7, 12:14] = 7, 9, 11
    path = tmp_path / "bones.seg.nrrd"
    write_volume(Volume(values, volume.grid, "bones", is_labels=True), path)
    head, data = path.read_bytes().split(b"\n\n", 1)
    path.write_bytes(
        head + b"\nSegment0_LabelValue:=7\nSegment0_Name:=femur\nSegment1_LabelValue:=11\n"
        b"Segment1_Name:=tibia\n\n" + data
    )
    write_volume(Volume(values.astype(np.float32) / 2, volume.grid), tmp_path / "scan.nrrd")
    write_volume(Volume(values, replace(volume.grid, origin=(900.0, 0.0, 0.0))), tmp_path / "far.nrrd")
    made = Studio(volume, side="+y", folder=tmp_path)
    shapes = panel(made, "Rigid parts and cuts")
    menu, labels = shapes.labels.file, shapes.labels.list
    assert menu.options == (("open a label file", ""), *((name, name) for name in (path.name, "far.nrrd", "scan.nrrd")))
    for name, words in (("scan.nrrd", "is no label volume"), ("far.nrrd", "is at another place in space")):
        menu.value = name
        assert words in get_notice(made)
        assert menu.value == ""
    menu.value = path.name
    assert get_notice(made) == ""
    assert labels.options == (("femur", 7), ("label 9", 9), ("tibia", 11))
    labels.value = (7, 11)
    buttons_of(shapes.box)["Label as part"].click()
    assert [part.name for part in made.session.editing.step.parts] == ["femur", "tibia"]
    assert made.session.editing.undo() == "add the rigid parts femur, tibia"
    assert made.session.editing.step.parts == ()
    made.close()


def test_a_step_in_space_has_an_editor_of_its_own(studio: Studio) -> None:
    drag(studio, a_drag(studio))
    flat = studio.editor
    add = next(b for b in panel(studio, "Steps").box.children[1].children if b.description == "Add step in space")
    add.click()
    studio.wait()
    space = studio.editor
    assert space is not flat
    assert studio.parts.editors.box.children == (space,)
    assert (space.theme, space.fill) == (flat.theme, flat.fill) == ("dark", True)  # of the dark pane, as tall as that
    assert len(space.points) == 8
    points = space.points.add([12.0, 10.0, 8.0], [15.0, 10.0, 8.0])
    drag(studio, points)
    assert studio.deformation.steps[1].points == points
    assert_array_equal(studio.result().values, studio.deformation.apply(studio.volume).values)
    assert space.history["undo"] == f"add point {len(points)}"
    studio.undo()
    assert len(space.points) == 8
    drag_of_before = flat.points.add([3.0, 3.0])
    drag(studio, drag_of_before, "add", flat)  # of a page that has gone
    assert len(studio.deformation.steps[0].points) == 5
    act(panel(studio, "Steps").items, "choose", 0)
    studio.wait()
    assert studio.editor is flat
    assert studio.parts.editors.box.children == (flat,)
    assert flat.points == studio.session.editing.points
    assert controls(studio)["Side"].value == studio.session.steps.view


@pytest.mark.parametrize("kind", ["move", "nudge"])
def test_an_edit_in_space_ends_before_tissue_folds(studio: Studio, kind: str) -> None:
    studio.session.steps.add(in_space=True)
    studio.wait()
    space, flat = studio.editor, studio.parts.editors.plane
    middle = np.asarray(studio.volume.grid.center)
    beside = middle + np.array([4.0, 0.0, 0.0])  # is held where it is
    drag(studio, space.points.add(beside, beside).add(middle, middle), "add")
    before = space.points
    far = before.move(before.ids[-1], middle + np.array([7.0, 2.0, 0.0]))
    assert not is_fold_free(space.step().with_points(far, 0), studio.volume.grid)
    drag(studio, far, kind)
    stopped = studio.session.editing.points
    assert stopped == space.points
    way = (stopped.target[-1] - middle)[:2] / (far.target[-1] - middle)[:2]
    assert 0 < way[0] < 1
    assert way[0] == pytest.approx(way[1])
    assert is_fold_free(studio.session.editing.step, studio.volume.grid, is_tissue=tissue_of(studio.session))
    assert "Stopped before tissue folds" in get_notice(studio)
    studio.undo()
    assert space.points == before
    part = before.move(before.ids[-1], middle + 1.3 * way[0] * np.array([7.0, 2.0, 0.0]))
    drag(studio, part, kind)
    assert space.points != part
    studio.undo()
    assert not space.points.displacement.any()
    drag(studio, part, kind, fit={"stages": 8})  # with which it does not fold
    assert studio.session.editing.points == space.points == part
    assert studio.session.editing.step.stages == 8
    studio.undo()
    assert space.points == before
    flat.stop_at_folds = False  # one switch for both editors
    assert not space.stop_at_folds
    drag(studio, far, kind)
    assert studio.session.editing.points == far
    space.stop_at_folds = True
    assert flat.stop_at_folds


def test_a_studio_opens_with_a_step_in_space(tmp_path: Path) -> None:
    points = ControlPoints.from_arrays([[2, 2, 2], [20, 3, 3], [4, 15, 4], [5, 5, 12]]).move(3, [5, 6, 12])
    made = Studio(a_volume(), Deformation.from_space_points(points), folder=tmp_path)
    made.wait()
    assert made.editor.points == points
    assert made.still(200).shape[1] == 200
    made.close()


def test_what_the_page_cannot_follow_is_previewed_by_python(studio: Studio) -> None:
    drag(studio, a_drag(studio))
    controls(studio)["Side"].value = "+z"
    studio.wait()
    drag(studio, a_drag(studio))
    assert not studio.editor.live  # the page follows by itself
    act(panel(studio, "Steps").items, "choose", 0)
    studio.wait()
    assert studio.editor.live
    moved = a_drag(studio, 3.0)
    post(
        studio,
        {
            "type": "edit",
            "phase": "move",
            "kind": "move",
            "joins": False,
            "next_id": moved.next_id,
            "points": points_to_json(moved),
        },
    )
    studio.wait()
    assert studio.stats()["previews"] == 1
    wanted = studio.deformation.with_step(0, studio.session.editing.step.with_points(moved)).field(studio.volume.grid)
    x = np.array([[10.0, 9.0, 7.0], [12.0, 11.0, 9.0]])
    assert_array_equal(studio.view.fields.shown.field.displacement(x), wanted.displacement(x))
    drag(studio, moved)
    assert studio.view.fields.shown.field is studio.session.results.field()
    act(panel(studio, "Steps").items, "choose", 1)
    studio.wait()
    assert not studio.editor.live


def test_steps_are_ordered_named_and_added_up_in_the_list(studio: Studio) -> None:
    drag(studio, a_drag(studio))
    controls(studio)["Side"].value = "+z"
    studio.wait()
    drag(studio, a_drag(studio))
    items = panel(studio, "Steps").items
    a, b = studio.deformation.steps
    act(items, "rename", 0, "bend")
    act(items, "down", 0)
    studio.wait()
    assert [row["name"] for row in items.rows] == ["", "bend"]
    assert items.chosen == 0
    assert_array_equal(studio.result().values, Deformation((b, a)).apply(studio.volume).values)
    controls(studio)["Steps"].value = "blend"
    assert_array_equal(studio.result().values, Deformation((b, a), mode="blend").apply(studio.volume).values)
    assert studio.view.editor is None  # a sum is not followed in the page
    stale = {"type": "act", "what": "remove", "index": 0, "value": None, "version": items.version - 1}
    deliver(items, stale)
    assert len(studio.deformation.steps) == 2
    act(items, "double", 1)
    act(items, "remove", 0)
    studio.wait()
    assert [row["name"] for row in items.rows] == ["bend", "bend"]
    while studio.session.editing.undo():
        pass
    studio.wait()
    assert len(items.rows) == 1
    assert_array_equal(studio.result().values, studio.volume.values)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("how", ["cut", "space", "blend", "off"])
def test_everything_is_exported_whatever_was_done(studio: Studio, tmp_path: Path, how: str) -> None:
    draws(studio, "cuts", "add cut", a_line(studio))
    drag(studio, a_drag(studio, -1.5))
    if how == "off":
        act(panel(studio, "Steps").items, "switch", 0, False)
    elif how != "cut":
        studio.session.steps.add(in_space=how == "space")
        studio.wait()
        drag(studio, studio.editor.points.add(studio.editor.points.source.mean(axis=0)))
        drag(studio, a_drag(studio))
    if how == "blend":
        studio.session.steps.set_mode("blend")
    for name in ("a.html", "a.py", "a.json", "a.nrrd"):
        studio.export(tmp_path / name)
        assert (tmp_path / name).stat().st_size > 0
    scope: dict[str, Any] = {"volume": studio.volume}
    exec(studio.session.code("volume"), scope)
    assert scope["deformation"] == studio.deformation
    assert_array_equal(scope["deformed"].values, studio.result().values)
    kept = studio.deformation
    studio.session.editing.reset()
    studio.load(tmp_path / "a.json")
    studio.wait()
    assert studio.deformation.steps == kept.steps
    assert studio.deformation.mode == kept.mode
    assert_array_equal(read_volume(tmp_path / "a.nrrd").values, studio.result().values)


def test_a_stroke_in_space_has_its_name_in_the_history(studio: Studio) -> None:
    studio.session.steps.add(in_space=True)
    studio.wait()
    space, middle = studio.editor, np.asarray(studio.volume.grid.center)
    beside, moved = middle + np.array([0.0, 5.0, 0.0]), middle + np.array([1.0, 0.0, 0.0])
    stroke = space.points.add(middle, moved, name="move 1").add(beside, beside, name="move 1")
    drag(studio, stroke, "brush")
    assert studio.session.editing.points == stroke
    assert studio.session.editing.history_tree()[-1].label == "move 1"


def test_a_cut_and_a_fixed_side_lie_at_the_slice(studio: Studio) -> None:
    studio.session.steps.add(in_space=True)
    studio.wait()
    shapes, space = panel(studio, "Rigid parts and cuts"), studio.editor
    buttons = buttons_of(shapes.box)
    middle = np.asarray(studio.volume.grid.center)
    space.large_slice, space.cursor = 1, (middle + np.array([0.0, 2.0, 0.0])).tolist()  # coronal: y grows behind it
    buttons["Cut at the slice"].click()
    (cut,) = studio.session.editing.step.cuts
    sides = middle + np.array([[0.0, 1.0, 3.0], [0.0, 3.0, -2.0]])
    assert (cut.region.signed_distance(sides) < 0).tolist() == [False, True]
    along = np.array([2.0, 0.0, 0.0])
    points = space.points.add(sides[0], sides[0] + along).add(sides[1], sides[1] - along)
    drag(studio, points, "add")
    field = studio.session.editing.step.field(studio.volume.grid)
    near = middle + np.array([[0.0, 1.9, 3.0], [0.0, 2.1, -2.0]])
    assert np.sign(field.displacement(near)[:, 0]).tolist() == [-1, 1]  # backward: the sides go apart along x
    studio.undo()
    studio.undo()
    assert not studio.session.editing.step.cuts
    buttons["Fixed side"].click()
    (part,) = studio.session.editing.step.parts
    assert part.name == "fixed side"
    assert part.region == cut.region
    assert space.tissue is None  # Python alone checks the map now
