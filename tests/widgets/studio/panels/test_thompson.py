"""The panel of two grids: its effect on the session, its display, and the files it writes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import oracle
import pytest
from front_end import deliver
from studio_driver import a_volume, find_panel, get_classes, wait_for, walk

from deformnb.datasets import PHANTOMS
from deformnb.errors import DeformError
from deformnb.rbf.cuts import Cut
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Line
from deformnb.session.session import Session
from deformnb.widgets import Studio, ThompsonPanel
from deformnb.widgets.boxes import Fold
from deformnb.widgets.messages.points import points_to_json
from deformnb.widgets.studio.editors import make_editor
from deformnb.widgets.studio.panels.thompson import strength_text


@pytest.fixture
def panel(tmp_path: Path) -> Any:
    made = ThompsonPanel(Session(a_volume(), view="+y"), folder=tmp_path)
    yield made
    made.close()


def page_edits(panel: ThompsonPanel, points: ControlPoints) -> None:
    """As the end of a drag in the page."""
    deliver(
        panel.editor,
        {
            "type": "edit",
            "sender": "test",
            "seq": next(SEQ),
            "phase": "end",
            "kind": "move",
            "joins": False,
            "next_id": points.next_id,
            "points": points_to_json(points),
        },
    )


SEQ = iter(range(1, 10**6))


def test_alone_a_drag_of_a_node_is_one_edit_of_the_session_and_can_be_undone(panel: ThompsonPanel) -> None:
    before = panel.session.editing.points
    page_edits(panel, before.add([12.0, 8.0], [15.0, 9.0], name="grid 3,2"))
    assert panel.session.editing.points.names[-1] == "grid 3,2"
    assert panel.session.editing.history["undo"] == 'add "grid 3,2"'
    assert panel.editor.history["undo"] == 'add "grid 3,2"'
    assert panel.session.editing.undo() == 'add "grid 3,2"'
    assert panel.session.editing.points == before
    assert panel.editor.points == before


def test_alone_it_shows_the_window_the_colour_map_and_the_projection_of_the_session(panel: ThompsonPanel) -> None:
    panel.session.pictures.window, panel.session.pictures.colour_map = (20.0, 90.0), "viridis"
    assert panel.editor.window == [20.0, 90.0]
    assert panel.editor.colour_map == "viridis"
    panel.session.pictures.method = "slice"
    np.testing.assert_array_equal(panel.editor.picture.values, panel.session.pictures.automatic_picture().values)
    assert (panel.editor.picture.window, panel.editor.slices["count"]) == ((20.0, 90.0), 20)
    panel.editor.window = []  # as a double click on the bar of grey values does
    assert panel.session.pictures.window is None


def test_what_others_do_to_the_session_is_shown(panel: ThompsonPanel) -> None:
    panel.session.editing.edit_points(panel.session.editing.points.add([12.0, 8.0], [14.0, 8.0]))
    panel.session.editing.change(cuts=[Cut(Line([(12, 20), (12, -5)]))])
    panel.session.editing.change(strength=2.0)
    assert len(panel.editor.points) == 5
    assert len(panel.editor.cuts) == 1
    assert panel.magnify.value == 2.0
    assert panel.editor.strength == 2.0
    panel.session.set_view("+x")
    assert panel.editor.picture is panel.session.pictures.picture()


def test_an_edit_that_cannot_be_fitted_is_said_and_taken_back(panel: ThompsonPanel) -> None:
    before = panel.session.editing.points
    page_edits(panel, before.add([12.0, 8.0], [12.0, 8.0]).add([14.0, 8.0], [12.0, 8.0]))
    assert panel.session.editing.points == before
    assert panel.editor.points == before
    assert "point 5 and point 6 are at the same place" in panel.figure.message.value


def test_both_places_hold_views_of_one_editor(panel: ThompsonPanel) -> None:
    assert panel.views.before.children == panel.views.after.children == (panel.editor,)
    assert "dnb-th-before" in get_classes(panel.views.before)
    assert "dnb-th-after" in get_classes(panel.views.after)
    panel.session.steps.add(in_space=True)
    assert panel.views.before.children == panel.views.after.children == ()
    assert panel.views.nowhere.layout.display is None
    with pytest.raises(DeformError, match="in space"):
        panel.apply_grid()
    with pytest.raises(DeformError, match="in space"):
        panel.figure.write(".svg")
    panel.session.editing.edit_step(0)
    assert panel.views.after.children == (panel.editor,)


def test_in_a_studio_views_are_there_while_the_tab_is_seen() -> None:
    studio = Studio(a_volume(), side="+y")
    try:
        panel = find_panel(studio, ThompsonPanel)
        fold = next(box for box in walk(studio) if isinstance(box, Fold) and panel.box in walk(box))
        assert panel.editor is studio.parts.editors.plane
        assert panel.views.after.children == ()
        fold.choose(0)
        assert panel.views.after.children == (studio.editor,)
        fold.choose(None)
        assert panel.views.after.children == ()
    finally:
        studio.close()


def test_magnify_is_the_strength_of_the_step_and_told_in_words(panel: ThompsonPanel) -> None:
    panel.session.editing.edit_points(panel.session.editing.points.add([12.0, 8.0], [14.0, 8.0]))
    for value, said in (
        (0.0, "the original"),
        (2.0, "exaggerated"),
        (-1.0, "in the opposite direction"),
        (1.0, "as drawn"),
    ):
        panel.magnify.value = value
        assert panel.session.editing.step.strength == value
        assert panel.words.value == said
    assert panel.session.editing.history["undo"] == "change strength"
    assert strength_text(-2.5) == "in the opposite direction, 2.50 times as far"
    assert strength_text(0.4) == "partial"


def test_lines_and_overlay_are_those_of_the_editor() -> None:
    session = Session(a_volume(), view="+y")
    editor = make_editor(session, 200)
    panel = ThompsonPanel(session, lambda action: action() is None, editor)
    try:
        widgets = {w.description: w for w in walk(panel.box) if hasattr(w, "description")}
        widgets["Lines"].value = 7
        widgets["Overlay"].value = "strain"
        assert (editor.density, editor.overlay) == (7, "strain")
        panel.everywhere.value = True
        assert editor.drag_grid
    finally:
        panel.close()


def test_a_grid_of_thompson_is_laid_around_the_fish_and_can_be_undone() -> None:
    panel = ThompsonPanel(Session(PHANTOMS["fish"].make((32, 64, 32)), view="-x"))
    try:
        before = panel.session.editing.points
        panel.grid.value = ("Polyprion", "Antigonia capros")
        panel.apply_grid()
        points = panel.session.editing.points
        assert len(points) == 56
        a0, a1, b0, b1 = panel.session.pictures.picture().raster.box
        source = points.source.reshape(7, 8, 2)
        assert np.ptp(source[0, :, 0]) > 0.7 * (a1 - a0)
        assert (np.diff(source[:, :, 0], axis=1) > 0).all()
        assert (np.diff(source[:, :, 1], axis=0) > 0).all()
        target = points.target
        assert (target[:, 1] >= b0 - 1e-6).all()
        assert (target[:, 1] <= b1 + 1e-6).all()
        assert np.ptp(points.target[:, 0]) < np.ptp(points.source[:, 0])  # a deep, short fish
        panel.head.value = "right"
        panel.apply_grid()
        assert np.ptp(panel.session.editing.points.source[:, 0]) == pytest.approx(np.ptp(points.source[:, 0]))
        panel.session.editing.undo()
        assert panel.session.editing.undo() == "apply the grid of Antigonia capros"
        assert panel.session.editing.points == before
    finally:
        panel.close()


def test_three_files_are_written_and_handed_over(panel: ThompsonPanel, tmp_path: Path) -> None:
    panel.session.editing.edit_points(panel.session.editing.points.add([12.0, 8.0], [15.0, 9.0]))
    handed: list[tuple[str, int]] = []
    panel.figure.file_transfer.download = lambda name, content: handed.append((name, len(content)))  # type: ignore[method-assign]
    panel.editor.overlay = "area"
    panel.figure.downloads.value = True
    for suffix, begins in ((".svg", b"<?xml"), (".pdf", b"%PDF"), (".png", b"\x89PNG")):
        panel.figure.write(suffix)
        wait_for(lambda: panel.figure.message.value.startswith("Wrote"), 60)
        assert (tmp_path / f"ball_grids{suffix}").read_bytes().startswith(begins)
        panel.figure.message.value = ""
    assert "area grows" in (tmp_path / "ball_grids.svg").read_text(encoding="utf-8")
    assert [name for name, size in handed if size > 1000] == ["ball_grids.svg", "ball_grids.pdf", "ball_grids.png"]
    wait_for(lambda: not any(button.disabled for button in panel.figure.writers))


def test_a_name_that_leads_elsewhere_is_refused(panel: ThompsonPanel, tmp_path: Path) -> None:
    panel.figure.name.value = "../elsewhere"
    panel.figure.writers[0].click()
    assert "no plain file name" in panel.figure.message.value
    assert list(tmp_path.iterdir()) == []
    assert not panel.figure.writers[0].disabled


def test_a_figure_that_cannot_be_drawn_is_said(panel: ThompsonPanel, tmp_path: Path) -> None:
    panel.figure.folder = tmp_path / "not there"
    panel.figure.write(".svg")
    wait_for(lambda: not panel.figure.writers[0].disabled)
    assert "not there" in panel.figure.message.value or "folder" in panel.figure.message.value
    assert not panel.figure.message.value.startswith("Writ")


def test_points_of_a_grid_are_met_exactly(panel: ThompsonPanel) -> None:
    page_edits(panel, panel.session.editing.points.add([12.0, 8.0], [15.0, 9.0], name="grid 3,2"))
    x = np.array([15.0, 9.0])
    oracle.assert_close(x + panel.editor.fit().displacement(x), [12.0, 8.0], atol=1e-9)


def test_grids_on_two_drawings_become_points_that_can_be_undone(panel: ThompsonPanel) -> None:
    with pytest.raises(DeformError, match="press Own drawings"):
        panel.own.apply()
    before = panel.session.editing.points
    panel.own.toggle.value = True
    assert panel.own.drawings is not None
    panel.own.drawings.line_counts[0].value = 3
    panel.own.drawings.show_second(panel.session.pictures.picture())
    assert panel.own.drawings.second is not None
    wider = panel.own.drawings.second.nodes * (2.0, 1.0)
    panel.own.drawings.second.nodes = wider
    panel.own.apply()
    assert len(panel.session.editing.points) == 3 * 7
    assert panel.session.editing.history["undo"] == "apply custom grids"
    target = panel.session.editing.points.target.reshape(3, 7, 2)
    assert np.ptp(target[..., 0]) / np.ptp(target[..., 1]) == pytest.approx(
        np.ptp(wider[..., 0]) / np.ptp(wider[..., 1]), rel=1e-6
    )
    panel.session.editing.undo()
    assert panel.session.editing.points == before
    panel.session.set_view("+x")
    with pytest.raises(DeformError, match="another side"):
        panel.own.apply()
    panel.own.toggle.value = False
    assert panel.own.drawings is None
