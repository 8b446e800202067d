"""The panel "Diagnostics" of the studio without a browser: figures, suspects, what its buttons do to the document."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from studio_driver import a_drag, a_volume, controls, drag, get_notice, get_status, panel

from deformnb.document.deformation import Deformation
from deformnb.document.step_checks import is_fold_free, step_folds, step_uncertainty
from deformnb.rbf.points import ControlPoints
from deformnb.session.session import Session
from deformnb.volume.plane import Raster
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.inverse import RoundTrip
from deformnb.widgets import Studio
from deformnb.widgets.studio.step_diagnostics import (
    FoldActions,
    diagnose,
    diagnostics_of,
    facts_html,
    uncertainty_overlay,
    unit_of,
)


@pytest.fixture
def studio(tmp_path: Path) -> Iterator[Studio]:
    made = Studio(a_volume(), folder=tmp_path)
    settle(made)
    yield made
    made.close()


def settle(studio: Studio) -> None:
    """Until the thread has nothing left, also of requests by its own work."""
    for _ in range(3):
        studio.wait()


def least(studio: Studio) -> float:
    step, grid = studio.session.editing.step, studio.volume.grid
    return step_folds(step, grid).least


FAR = 12.0  # of a drag that folds


def test_figures_of_another_state_are_dimmed_until_new_ones_are_there(studio: Studio) -> None:
    diagnostics = panel(studio, "Diagnostics")
    before = diagnostics.facts.value
    release = threading.Event()
    studio.parts.worker.call(release.wait)  # the figures wait behind this
    drag(studio, a_drag(studio, 2.0))
    assert "Computing" in diagnostics.message.value
    assert before in diagnostics.facts.value
    assert "opacity: 0.45" in diagnostics.facts.value
    release.set()
    settle(studio)
    assert "opacity: 0.45" not in diagnostics.facts.value
    assert diagnostics.message.value == ""


def test_folds_in_air_are_told_apart_and_stop_nothing(tmp_path: Path) -> None:
    values = np.zeros((12, 40, 60), np.uint8)
    values[4:8, 10:30, 45:56] = 200  # the body, to the right of the fold
    points = ControlPoints.from_arrays(
        [[1, 1], [58, 1], [1, 38], [58, 38], [10, 20]], [[1, 1], [58, 1], [1, 38], [58, 38], [26, 20]]
    )
    step = replace(
        Deformation.from_picture_points(Grid(values.shape), "+z", points).steps[0], support=14.0, trend="none"
    )
    for shift, is_free in ((0, True), (-35, False)):
        volume = Volume(np.roll(values, shift, axis=2), Grid(values.shape))
        session = Session(volume, Deformation((step,)))
        found = diagnostics_of(session)
        assert found.is_fold_free is is_free
        assert (found.folds.air > 0.004) is is_free
        assert (found.folds.share > 0.004) is not is_free
        assert found.folds_text.startswith("no folds in tissue" if is_free else "folds ")
        assert ("% in air" in facts_html(found)) is is_free
        fold_actions = FoldActions(session)
        fold_actions.unfold()
        assert (session.editing.notice == "Nothing folds here.") is is_free


def test_the_figures_follow_the_edits(studio: Studio) -> None:
    diagnostics = panel(studio, "Diagnostics")
    assert "none; smallest det J 1" in diagnostics.facts.value
    assert "no folds" in get_status(studio)
    assert "round trip 0 voxels" in get_status(studio)
    drag(studio, a_drag(studio, FAR))
    settle(studio)
    found = diagnostics_of(studio.session)
    assert found.folds is not None
    assert found.folds.least == pytest.approx(least(studio))
    assert f"smallest det J {found.folds.least:.3g}" in diagnostics.facts.value
    assert "5 points, 1 dragged \u00b7 folds " in get_status(studio)
    assert "Bending energy" in diagnostics.facts.value


def test_unfolding_keeps_the_points_and_leaves_no_fold(studio: Studio) -> None:
    drag(studio, a_drag(studio, FAR))
    points = studio.editor.points
    assert least(studio) < 0
    panel(studio, "Diagnostics").buttons["unfold"].click()
    settle(studio)
    assert least(studio) > 0
    assert studio.session.editing.step.stages > 1
    assert studio.editor.stages == controls(studio)["Stages"].value == studio.session.editing.step.stages
    assert studio.editor.points == points
    assert f"Done in {studio.session.editing.step.stages} stages" in get_notice(studio)
    assert "no folds" in get_status(studio)
    studio.undo()
    assert studio.session.editing.step.stages == 1
    controls(studio)["Stages"].value = 16
    panel(studio, "Diagnostics").buttons["unfold"].click()  # fewer will do
    settle(studio)
    assert 1 < studio.session.editing.step.stages < 16


def test_the_last_drag_goes_as_far_as_is_safe(studio: Studio) -> None:
    first = a_drag(studio, 2.0)
    drag(studio, first)
    settle(studio)
    drag(studio, a_drag(studio, FAR))
    settle(studio)
    far = studio.editor.points
    assert least(studio) < 0
    panel(studio, "Diagnostics").buttons["take_back"].click()
    settle(studio)
    made = studio.editor.points
    assert is_fold_free(studio.session.editing.step, studio.volume.grid)
    assert studio.session.editing.step.strength == 1.0
    assert_array_equal(made.target[:4], far.target[:4])
    way = (made.target[4] - first.target[4]) / (far.target[4] - first.target[4])
    assert 0 < way[0] < 1
    assert way[0] == pytest.approx(way[1])
    assert studio.editor.history["undo"] == "largest safe drag"
    panel(studio, "Diagnostics").buttons["take_back"].click()
    settle(studio)
    assert "Nothing folds here" in get_notice(studio)


def test_a_strength_that_folds_is_taken_back(studio: Studio) -> None:
    drag(studio, a_drag(studio, 4.0))
    settle(studio)
    controls(studio)["Strength"].value = 3.0
    settle(studio)
    assert least(studio) < 0.05
    panel(studio, "Diagnostics").buttons["take_back"].click()
    settle(studio)
    assert 1.0 < studio.session.editing.step.strength < 3.0
    assert least(studio) == pytest.approx(0.05, abs=0.02)


def test_kept_free_of_folds_an_edit_and_its_stages_are_one_step_of_undo(studio: Studio) -> None:
    diagnostics = panel(studio, "Diagnostics")
    diagnostics.keep.value = True
    before = studio.editor.points
    drag(studio, a_drag(studio, FAR))
    settle(studio)
    assert least(studio) > 0
    assert studio.session.editing.step.stages > 1
    studio.undo()
    settle(studio)
    assert studio.session.editing.step.stages == 1
    assert studio.editor.points == before
    studio.redo()
    settle(studio)
    assert studio.session.editing.step.stages > 1
    assert least(studio) > 0


def test_ticking_the_box_unfolds_what_is_folded(studio: Studio) -> None:
    drag(studio, a_drag(studio, FAR))
    settle(studio)
    panel(studio, "Diagnostics").keep.value = True
    settle(studio)
    assert least(studio) > 0
    assert studio.editor.history["undo"] == "unfold by stages"


def test_what_cannot_be_unfolded_is_said(studio: Studio) -> None:
    middle = studio.editor.points.target.mean(axis=0)
    swapped = studio.editor.points.add(middle - 4, middle + 4).add(middle + 4, middle - 4)
    drag(studio, swapped)
    settle(studio)
    panel(studio, "Diagnostics").buttons["unfold"].click()
    settle(studio)
    assert "through one another" in get_notice(studio)
    assert studio.session.editing.step.stages == 1


def test_points_that_disagree_are_marked_and_found_by_a_click(studio: Studio) -> None:
    rng = np.random.default_rng(0)
    cells = np.stack(np.meshgrid(np.arange(4) * 6.0 + 2, np.arange(3) * 5.0 + 2), axis=-1).reshape(-1, 2)
    source = cells + rng.uniform(-0.8, 0.8, cells.shape)
    target = source * 1.05
    target[[5, 6]] = target[[6, 5]]
    names = [f"mark {k}" for k in range(12)]
    drag(studio, ControlPoints.from_arrays(source, target, names=names, ids=range(20, 32)))
    settle(studio)
    diagnostics = panel(studio, "Diagnostics")
    assert studio.editor.marked == [25, 26]
    label, *buttons = diagnostics.suspects.children
    assert label.value == "Possible outliers:"
    assert [b.description for b in buttons] == ["point 6 (mark 5)", "point 7 (mark 6)"]
    sent: list[Any] = []
    studio.editor.send = lambda content, buffers=None: sent.append(content)
    buttons[1].click()
    assert studio.editor.selected == [26]
    assert {"type": "look", "id": 26} in sent
    studio.undo()
    settle(studio)
    assert studio.editor.marked == []
    assert len(diagnostics.suspects.children) == 1


def test_the_uncertainty_overlay_is_made_when_it_is_looked_at(studio: Studio) -> None:
    diagnostics = panel(studio, "Diagnostics")
    drag(studio, a_drag(studio, 3.0))
    settle(studio)
    assert studio.editor.uncertainty == b""
    diagnostics.overlay.value = "uncertainty"
    settle(studio)
    assert studio.editor.overlay == "uncertainty"
    facts, raster = studio.editor.uncertainty_facts, studio.session.pictures.picture().raster
    shown = np.frombuffer(studio.editor.uncertainty, np.uint8).reshape(facts["height"], facts["width"])
    a0, a1, b0, b1 = raster.box
    a = a0 + (np.array([10, 60]) + 0.5) * (a1 - a0) / 96
    b = b0 + (np.array([40, 5]) + 0.5) * (b1 - b0) / facts["height"]
    known = step_uncertainty(studio.session.editing.step, studio.volume.grid)
    expected = known.at(np.stack([a, b], axis=-1))
    at = shown[[40, 5], [10, 60]] / 255
    assert at[0] / at[1] == pytest.approx(expected[0] / expected[1], rel=0.02)
    assert shown.max() == 255
    for byte, text in facts["legend"]:
        sign, value, unit = text.split()
        assert (sign, unit) == ("\u00b1", "voxels")
        assert byte == pytest.approx(float(value) / (expected[0] / at[0]) * 255, abs=3)
    before = studio.editor.uncertainty
    drag(studio, a_drag(studio, 5.0))
    settle(studio)
    assert studio.editor.uncertainty != before
    studio.session.editing.edit_points(studio.editor.points.reset())
    settle(studio)
    assert studio.editor.uncertainty == b""
    assert "nothing bends" in diagnostics.message.value


def test_a_step_in_space_has_diagnostics_too(studio: Studio) -> None:
    points = ControlPoints.from_arrays([[2, 2, 2], [20, 2, 2], [2, 16, 2], [2, 2, 13], [12, 9, 8]])
    studio.session.editing.deformation = Deformation.from_space_points(points.move(4, [14.0, 9.0, 8.0]))
    settle(studio)
    assert panel(studio, "Diagnostics").overlay.disabled
    assert "round trip" in get_status(studio)
    assert "Leave-one-out" in panel(studio, "Diagnostics").facts.value


# -- figures in words --------------------------------------------------------------------------------------------------


def test_what_cannot_be_computed_gives_the_reason() -> None:
    step = Session(a_volume()).editing.step
    found = diagnose(step.with_points(ControlPoints.empty(2)), 0, a_volume().grid)
    assert "no active control point" in found.reason
    assert found.folds is not None
    assert "no active control point" in facts_html(found)
    assert found.folds_text == "no folds"


def test_words_of_the_diagnostics() -> None:
    grid = Grid((16, 20, 24), (0.7, 0.7, 1.0), unit="mm")
    assert (unit_of(grid), unit_of(Grid((4, 4, 4)))) == ("mm", "voxels")
    assert (unit_of(replace(grid, unit="")), unit_of(Grid((4, 4, 4), unit="mm"))) == ("", "mm")
    found = diagnose(Session(a_volume()).editing.step, 0, grid)
    assert found.trip_text == "round trip 0 mm"
    assert replace(found, trip=RoundTrip(0.00123, 0.001, 1.0)).trip_text == "round trip 0.0012 mm"
    assert "4 % lost" in facts_html(replace(found, trip=RoundTrip(0.1, 0.1, 0.96)))
    folded = replace(found, folds=replace(found.folds, least=-0.1, share=0.004))
    assert folded.folds_text == "folds < 1 %"
    named = replace(found.step.points.move(0, [3.0, 4.0]), names=("<b>",) * 4)
    assert "(&lt;b&gt;)" in facts_html(diagnose(found.step.with_points(named), 0, grid))


def test_an_uncertainty_overlay_fits_a_long_picture() -> None:
    grid = Grid((4, 10, 50))
    session = Session(a_volume())
    points = ControlPoints.from_arrays([[1, 1], [48, 1], [1, 8], [48, 8], [20, 5]])
    step = replace(session.editing.step, maps=(points.move(4, [22, 5]),))
    overlay = uncertainty_overlay(step, 0, grid, Raster((10, 50), (1.0, 1.0), (0.0, 0.0)))
    assert (overlay.facts["width"], overlay.facts["height"]) == (96, 19)
    assert len(overlay.data) == 96 * 19


def test_only_the_newest_document_is_amended() -> None:
    session = Session(a_volume())
    session.editing.change(trend="rigid")
    made = session.editing.deformation
    better = made.with_step(0, replace(session.editing.step, stages=2))
    session.editing.change(trend="none")
    assert not session.editing.amend(made, better)  # another edit came in between
    session.editing.undo()
    assert not session.editing.amend(made, better)  # an older state that is looked at
    session.editing.redo()
    now = session.editing.deformation
    assert session.editing.amend(now, now.with_step(0, replace(session.editing.step, stages=2)), "said")
    assert (session.editing.step.stages, session.editing.step.trend, session.editing.notice) == (2, "none", "said")
    assert session.editing.index == 0
    session.editing.undo()
    assert (session.editing.step.stages, session.editing.step.trend) == (1, "rigid")
    session.editing.redo()
    assert (session.editing.step.stages, session.editing.step.trend) == (2, "none")


def bent_grid(studio: Studio) -> ControlPoints:
    """Nodes over the picture that are bent as a parabola is."""
    a0, a1, b0, b1 = studio.session.pictures.picture().raster.box
    a, b = np.meshgrid(np.linspace(a0, a1, 5), np.linspace(b0, b1, 4))
    source = np.column_stack([a.ravel(), b.ravel()])
    return ControlPoints.from_arrays(
        source, source + 0.2 / (a1 - a0) * np.column_stack([(source[:, 1] - b0) ** 2, 0 * source[:, 0]])
    )


def test_the_best_prediction_is_chosen_by_a_button_and_kept_by_a_switch(studio: Studio) -> None:
    drag(studio, bent_grid(studio))
    settle(studio)
    diagnostics = panel(studio, "Diagnostics")
    diagnostics.buttons["best_prediction"].click()
    settle(studio)
    step = studio.session.editing.step
    assert (step.trend, studio.editor.history["undo"]) == ("quadratic", "best prediction")
    assert step.support is not None
    assert "Best prediction: " in get_notice(studio)
    studio.session.editing.undo()
    assert studio.session.editing.step.trend == "affine"
    diagnostics.chosen.value = True
    settle(studio)
    assert studio.session.editing.step.trend == "quadratic"
    studio.session.editing.change(trend="affine")
    settle(studio)
    assert studio.session.editing.step.trend == "affine"  # the points are the same: a setting of one's own stays
    drag(studio, studio.editor.points.move(7, studio.editor.points.target[7] + 0.01))
    settle(studio)
    assert studio.session.editing.step.trend == "quadratic"


def test_too_few_points_are_said_to_be_so(studio: Studio) -> None:
    before = studio.session.editing.step
    panel(studio, "Diagnostics").buttons["best_prediction"].click()
    settle(studio)
    assert studio.session.editing.step is before
    assert "no active control point" in get_notice(studio) or "too few" in get_notice(studio)
