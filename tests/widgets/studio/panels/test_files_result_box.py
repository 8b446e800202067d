"""The studio's controls of the result's box: their choices, their texts, and the view that follows."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from front_end import deliver
from studio_driver import find_box, find_panel

from deformnb.analysis.extent import padded
from deformnb.document import edits as key_frames
from deformnb.document.deformation import Deformation
from deformnb.document.json_regions import region_from_data
from deformnb.rbf.regions import Mask
from deformnb.session.session import Session
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.studio.panels.animation import AnimationPanel
from deformnb.widgets.studio.panels.files import OutputCheck, ResultBox
from deformnb.widgets.studio.studio import Studio
from deformnb.widgets.worker import Worker


def a_brick() -> Volume:
    values = np.zeros((16, 16, 16), np.uint8)
    values[4:12, 4:12, 4:12] = 200
    return Volume(values, Grid((16, 16, 16), (2.0, 2.0, 2.0)), "brick")


def drag_out(session: Session, by: float = 24.0) -> None:
    middle = session.editing.points.source.mean(axis=0)
    session.editing.edit_points(session.editing.points.add(middle, middle + np.array([by, 0.0])))


def run(action: Callable[[], None]) -> bool:
    action()
    return True


@pytest.fixture
def box() -> Iterator[ResultBox]:
    """A box whose thread is the test: what it asks for is done by "check"."""
    session = Session(a_brick())
    made = ResultBox(session, run, OutputCheck(session, run, Worker(), Editor()))
    yield made
    made.check.editor.close()
    made.check.worker.close()


def refresh(box: ResultBox) -> None:
    box.check.refresh()
    box.refresh()


def looked(box: ResultBox) -> None:
    refresh(box)
    box.check.worker.call(lambda: None).result(30)
    box.check.check()


def test_a_margin_is_chosen_and_said(box: ResultBox) -> None:
    assert (box.choice.value, box.margin.layout.display) == ("volume", "none")
    assert box.words.value == "16 x 16 x 16 voxels (x, y, z), 4.0 KiB"
    box.choice.value = "margin"
    refresh(box)
    assert box.session.results.box.shape == (20, 20, 20)  # a tenth of 32 mm, in whole voxels of 2 mm
    assert box.margin.layout.display is None
    box.margin.value = 8.0
    refresh(box)
    assert box.session.results.box.shape == (24, 24, 24)
    assert box.words.value == "24 x 24 x 24 voxels (x, y, z), 13.5 KiB"
    box.choice.value = "volume"
    refresh(box)
    assert box.session.editing.output is None
    assert box.margin.layout.display == "none"


@pytest.mark.parametrize("margin", [4.0, 6.0, 12.0])
def test_the_margin_of_a_box_that_was_opened_is_read_back(margin: float) -> None:
    volume = replace(a_brick(), grid=Grid((16, 16, 16), (3.0, 2.0, 4.0), (5.0, -3.0, 2.0)))
    session = Session(volume)
    session.results.grow(margin)
    box = ResultBox(session, run, OutputCheck(session, run, Worker(), Editor()))
    refresh(box)
    before = session.editing.output
    assert (box.choice.value, box.margin.layout.display) == ("margin", None)
    assert padded(volume.grid, box.margin.value) == before  # another length may make the same whole voxels
    assert 0 <= abs(box.margin.value - margin) < 4.0
    session.editing.output = volume.grid.crop((0, -1, 0), (16, 18, 16))  # y alone: no one margin makes it
    refresh(box)
    assert (box.choice.value, box.margin.layout.display) == ("own", "none")
    box.check.worker.close()


def test_as_large_as_needed_goes_on_with_every_edit(box: ResultBox) -> None:
    box.choice.value = "needed"
    looked(box)
    assert box.session.editing.output == box.session.volume.grid
    assert box.choice.value == "needed"
    drag_out(box.session)
    looked(box)
    assert box.session.results.box.shape[2] > 16
    assert box.session.results.exceeded_sides() == ()
    assert box.session.editing.history["undo"] == "move points"  # the box belongs to the edit
    box.session.editing.undo()
    refresh(box)
    assert box.session.editing.output == box.session.volume.grid
    box.session.editing.undo()
    looked(box)
    assert box.session.editing.output is None
    assert (box.choice.value, box.check.follows) == ("volume", False)


def test_what_is_cut_off_is_warned_of_with_a_way_out(box: ResultBox) -> None:
    session, editor = box.session, box.check.editor
    looked(box)
    assert (editor.cut_off["sides"], editor.enlarges) == ([], True)
    drag_out(session)
    looked(box)
    assert editor.cut_off["sides"] == ["left side (L)"]
    assert not box.check.warning.is_visible  # the editor of the picture has it
    assert box.words.value.endswith("cut off at the left side (L)")
    before = editor.cut_off
    box.check.check()
    assert editor.cut_off != before  # the front end gets each answer, also one that is the same
    deliver(editor, {"type": "larger_box"})
    looked(box)
    assert (box.choice.value, session.results.exceeded_sides()) == ("needed", ())
    assert (editor.cut_off["sides"], editor.enlarges) == ([], False)
    assert "cut off" not in box.words.value
    drag_out(session, 40.0)
    looked(box)
    assert (editor.cut_off["sides"], session.results.exceeded_sides()) == ([], ())  # the box goes on with the edits
    box.choice.value = "volume"
    looked(box)
    assert (editor.cut_off["sides"], editor.enlarges) == (["left side (L)"], True)


def test_a_box_that_may_not_be_larger_offers_no_way_out(box: ResultBox) -> None:
    box.choice.value = "needed"
    looked(box)
    drag_out(box.session, 5000.0)
    looked(box)
    assert box.check.editor.cut_off["sides"]
    assert not box.check.editor.enlarges


def test_a_step_in_space_is_warned_of_below_the_pictures() -> None:
    studio = Studio(a_brick())
    try:
        panel, session = find_panel(studio, OutputCheck), studio.session
        assert panel.warning in find_box(studio, "dnb-studio-messages").children
        session.editing.deformation = Deformation((session.editing.initial_step(None),))
        centre = np.asarray(session.volume.grid.center)
        session.editing.edit_points(session.editing.points.add(centre, np.add(centre, (24.0, 0.0, 0.0))))
        studio.wait()
        assert panel.warning.is_visible
        text, button = panel.warning.children
        assert 'role="status"' in text.value
        assert "Tissue leaves the box at the left side (L), and is cut off there." in text.value
        button.click()
        studio.wait()
        assert not panel.warning.is_visible
        assert studio.session.results.exceeded_sides() == ()
    finally:
        studio.close()


def test_the_tissue_on_the_picture_is_known_where_the_step_alone_moves_it() -> None:
    studio = Studio(a_brick())
    try:
        session, editor = studio.session, studio.editor
        assert editor.outline["sides"] == ["right side (R)", "left side (L)", "top (S)", "bottom (I)"]
        tissue = region_from_data(editor.outline["tissue"])
        assert isinstance(tissue, Mask)
        assert tissue.values.sum() == 8 * 8
        session.editing.change(extrusion="modulate", curve=(1.0, 0.0))
        studio.wait()
        assert editor.outline == {}
        session.editing.undo()
        studio.wait()
        assert editor.outline
    finally:
        studio.close()


def test_a_box_that_was_given_by_code_is_shown_as_such(box: ResultBox) -> None:
    box.session.editing.output = box.session.volume.grid.resampled(spacing=1.0)
    looked(box)
    assert box.choice.value == "own"
    assert ("custom", "own") in box.choice.options
    box.choice.value = "volume"
    refresh(box)
    assert ("custom", "own") not in box.choice.options


@pytest.mark.parametrize("kind", ["live", "vtk"])
def test_the_view_of_a_studio_shows_the_box_at_once(kind: str) -> None:
    studio = Studio(a_brick(), view=kind)
    try:
        drag_out(studio.session)
        studio.session.results.grow(12.0)
        grid = studio.session.editing.output
        assert grid is not None
        assert studio.view.output_grid == grid
        assert studio.result().grid == grid
        corner = grid.crop((0, 0, 22), (28, 28, 6))  # what was cut off
        wide = studio.session.results.volume()
        inside = wide.values[:, :, 22:28]
        assert corner.is_like(wide.grid.crop((0, 0, 22), (28, 28, 6)))
        assert (inside > 100).any()
        studio.undo()
        assert studio.view.output_grid is None
    finally:
        studio.close()


@pytest.mark.nightly
def test_previews_and_points_in_space_keep_the_box() -> None:
    studio = Studio(a_brick(), output=a_brick().grid.crop((-2, -2, -2), (20, 20, 30)))
    try:
        wanted = studio.session.editing.output
        shown: list[Any] = []
        drag_out(studio.session)
        put = studio.view.show_deformation

        def show(field: Any, *, output: Grid | None = None) -> None:
            shown.append(output)
            put(field, output=output)

        studio.view.show_deformation = show  # type: ignore[method-assign]
        studio.parts.link.preview(studio.session.editing.step)
        studio.wait()
        assert shown == [wanted]
        studio.session.steps.add(in_space=True)
        studio.wait()
        points = studio.session.editing.points
        moved = points.move(points.ids[0], points.target[0] + 3.0)
        studio.editor.points = moved
        studio.wait()
        assert studio.view.output_grid == wanted
        assert set(shown) == {wanted}
    finally:
        studio.close()


def test_key_frames_are_played_in_the_box() -> None:
    studio = Studio(a_brick())
    try:
        panel = find_panel(studio, AnimationPanel)
        drag_out(studio.session)
        studio.session.results.grow(12.0)
        studio.session.editing.edit_document(key_frames.add_key(studio.session.editing.deformation, 0.0), "a key frame")
        studio.session.editing.edit_document(key_frames.add_key(studio.session.editing.deformation, 1.0), "another one")
        panel.player.time = 0.5
        panel.playback.wait()
        maps = studio.view.moments
        assert maps is not None
        assert studio.view.output_grid == studio.session.editing.output
        a, b = maps.raster.box[:2]
        assert b - a > 50  # the maps reach as far as the box, 56 mm, not only as far as the volume, 32 mm
    finally:
        studio.close()
