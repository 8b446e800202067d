"""Cuts in the live view in a real browser: a gap is where and as wide as the core says, and closes without a trace."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from browser.live_page import LivePage
from browser.pane_messages import message_script, message_text

from deformnb.document.deformation import Deformation, Step
from deformnb.imaging.projection import project
from deformnb.rbf.cuts import CUT_RULES, Cut
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import HalfSpace, Line
from deformnb.rbf.rigid import RigidPart
from deformnb.volume.plane import Plane
from deformnb.volume.transfer import TransferFunction
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.view.live_view import LiveView

pytestmark = pytest.mark.needs_browser

SIZE = (240, 180)
GRID = Grid((24, 28, 40), (1.0, 1.2, 1.5), (-4.0, 7.0, 20.0))
FINE = GRID.resampled(spacing=0.5)  # on which the second interpolation of the core's picture blurs little
PLANE = Plane.from_view(GRID, "+y")
MIDDLE = PLANE.to_plane(GRID.center)[:2]
WHITE = TransferFunction(((0, 1, 1, 1),), ((0, 0), (60, 0), (100, 0.95), (255, 0.95)))
VIEW = "document.querySelector('.dnb-view').deformnb"


def bar(grid: Grid = GRID) -> Volume:
    """Round edges, a darker end, and a grain that a wrong shader smears."""
    k, j, i = ((a + 0.5) / n - 0.5 for a, n in zip(np.indices(grid.shape), grid.shape, strict=True))
    far = np.maximum(np.maximum(np.abs(k), np.abs(j)) / 0.28, np.abs(i) / 0.4)
    return Volume((np.clip(5 * (1.1 - far), 0, 1) * (150 + 60 * (i > 0.1))).astype(np.uint8), grid, "bar")


def pulled(gap: float, rule: str = "source", *, shift: float = 0.0, plane: Plane = PLANE, **options: Any) -> Step:
    """A bar that is cut across, not quite upright, and pulled apart by a gap."""
    a, b = plane.to_plane(GRID.center)[:2]
    source = np.array([[a - 14, b - 4], [a - 14, b + 4], [a - 6, b], [a + 14, b - 4], [a + 14, b + 4], [a + 6, b]])
    move = np.where(source[:, :1] < a, -gap / 2 + shift, gap / 2 + shift) * np.array([1.0, 0.0])
    cut = Cut(Line(((a - 2.0, b - 10.0), (a + 2.0, b + 10.0))))
    return Step(
        (ControlPoints.from_arrays(source, source + move),),
        plane,
        trend="translation",
        cuts=(cut,),
        cut_rule=rule,
        **options,
    )


def slit(gap: float) -> Step:
    """The same bar with a cut along it that stops at both ends, opened in the middle."""
    a, b = MIDDLE
    source = np.array([[a - 20, b - 12], [a + 20, b - 12], [a - 20, b + 12], [a + 20, b + 12], [a, b - 3], [a, b + 3]])
    move = np.array([[0.0, 0.0]] * 4 + [[0.0, -gap / 2], [0.0, gap / 2]])
    cut = Cut(Line(((a - 10.0, b - 0.5), (a + 10.0, b + 0.5)), stops=(True, True)))
    return Step(
        (ControlPoints.from_arrays(source, source + move),), PLANE, cuts=(cut,), extrusion="modulate", curve="1-z/4"
    )


def open_view(page: LivePage, **options: Any) -> LiveView:
    view = LiveView(
        bar(),
        **{"transfer": WHITE, "width": SIZE[0], "height": SIZE[1], "settle_ms": 60000, "background": "dark", **options},
    )
    page.add(view)
    page.wait_loaded()
    return view


@pytest.fixture(scope="module")
def drawn(browser: Any) -> Iterator[tuple[LivePage, LiveView]]:
    """One page and one view for all cases that only look at what is shown: its shaders are compiled once."""
    page = LivePage(browser)
    view = open_view(page)
    yield page, view
    page.close()


def show(page: LivePage, view: LiveView, deformation: Deformation | None, **options: Any) -> None:
    """Shows it, and waits until the page has it."""
    view.show_deformation(deformation, **options)
    page.wait_answered()


def silhouette(image: np.ndarray) -> np.ndarray:
    return np.asarray(image.max(axis=2) > 64)


def dice(a: np.ndarray, b: np.ndarray) -> float:
    return 2 * float((a & b).sum()) / float(a.sum() + b.sum())


def but(kept: set[Any], *cases: Any) -> list[Any]:
    """Cases of which only some are run at every change: the others are of the same kind and take as long."""
    return [
        case if case in kept else pytest.param(*case if isinstance(case, tuple) else (case,), marks=pytest.mark.nightly)
        for case in cases
    ]


CASES = {
    "source": pulled(9.0),
    "paper": pulled(9.0, "paper"),
    "moved on": pulled(4.0, shift=6.0),
    "moved on, paper": pulled(4.0, "paper", shift=6.0),
    "modulate": pulled(10.0, extrusion="modulate", curve="z"),
    "pushed together": pulled(-6.0),
    "stops inside": slit(10.0),
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", but({"source", "moved on, paper", "stops inside"}, *CASES))
def test_a_cut_is_as_open_as_in_the_core(drawn: tuple[LivePage, LiveView], name: str) -> None:
    page, view = drawn
    view.projection, view.show_folds = "shaded", True
    view.set_transfer(WHITE)
    show(page, view, Deformation((CASES[name],)), output=FINE)
    for direction in ((0.0, 1.0, 0.0), (-0.6, 0.7, 0.4)):
        view.set_camera(direction)
        live, still = silhouette(page.pixels()), silhouette(view.still(SIZE))
        assert dice(live, still) > 0.965, direction
    assert page.errors == []


def early() -> dict[str, Deformation]:
    """Cuts that the card gets as samples in space."""
    other = Plane.from_view(GRID, "-z")
    at = other.to_plane(GRID.center)[:2]
    source = at + np.array([[0.0, 0.0], [15.0, 3.0], [-15.0, -3.0]])
    bend = Step((ControlPoints.from_arrays(source, source + np.array([[0, 4.0], [0, -2.0], [0, -2.0]])),), other)
    source = GRID.center + np.array([[-14.0, 0, 0], [-14, 0, 5], [-7, 2, 0], [14, 0, 0], [14, 5, 0], [7, 0, 1]])
    target = source + np.array([4.0, 0, 0]) * np.sign(source[:, :1] - GRID.center[0])
    cut = Cut(HalfSpace(tuple(GRID.center), (1.0, 0.1, 0.25)))
    in_space = Step((ControlPoints.from_arrays(source, target),), None, cuts=(cut,), trend="translation")
    return {
        "before a bend": Deformation((pulled(9.0), bend)),
        "in space": Deformation((in_space,)),
        "paper, before a bend": Deformation((pulled(4.0, "paper", shift=6.0), bend)),
        "cut twice": Deformation((in_space, pulled(6.0, plane=other))),
    }


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", but({"in space", "paper, before a bend"}, *early()))
def test_an_earlier_cut_and_one_in_space_are_as_sharp(drawn: tuple[LivePage, LiveView], name: str) -> None:
    page, view = drawn
    view.projection = "shaded"
    view.set_transfer(WHITE)
    view.show_folds = False  # the bend takes a triangle to a line: its determinant is 0 but for rounding
    show(page, view, early()[name], output=FINE)
    for direction in ((0.0, 1.0, 0.0), (-0.6, 0.7, 0.4)):
        view.set_camera(direction)
        live, still = silhouette(page.pixels()), silhouette(view.still(SIZE))
        assert dice(live, still) > 0.965, direction
    assert message_text(page.page) == ""
    assert page.errors == []


@pytest.mark.nightly
def test_an_earlier_cut_that_is_closed_is_not_seen(page: LivePage) -> None:
    view = open_view(page, transfer="surface", show_folds=False)  # see above
    bend = early()["before a bend"].steps[1]
    view.set_camera((-0.6, 0.7, 0.4))
    view.show_deformation(Deformation((bend,)))
    plain = page.pixels().astype(int)
    for rule in CUT_RULES:
        view.show_deformation(Deformation((pulled(0.0, rule), bend)))
        # One of the two is looked up in maps, the other in samples in space, which are coarser.
        assert np.abs(page.pixels().astype(int) - plain).mean() < 0.6
    later = Deformation((pulled(5.0), pulled(3.0, plane=Plane.from_view(GRID, "-z")), bend))
    view.show_deformation(later)
    page.wait(message_script())
    assert message_text(page.page) == "cuts of the first steps are shown roughly"
    assert page.errors == []


def test_the_gap_has_the_width_that_the_points_say(page: LivePage) -> None:
    view = open_view(page)
    view.set_camera(PLANE.normal, [-c for c in PLANE.v])
    view.show_deformation(pulled_document(0.0))
    closed = _gap(page)
    view.show_deformation(pulled_document(9.0))
    wide = _gap(page)
    view.show_deformation(Deformation((CASES["moved on"],)))
    beyond = _gap(page)
    view.show_deformation(Deformation((CASES["moved on, paper"],)))
    paper = _gap(page)
    scale = page.page.evaluate(f"{VIEW}.caster.size[1] / {VIEW}.camera.height")
    assert closed == 0
    # A ray that runs along a face stops in the first of its faint samples: half a ramp of a voxel (1.25) on each side.
    assert wide / scale == pytest.approx(9.0 - 1.2, abs=0.6)
    assert beyond / scale == pytest.approx(4.0 - 1.2, abs=0.6)
    # Eq. 8 leaves a false gap where both pieces have gone to the right, by 4 and by 8: none passes the line.
    assert paper / scale == pytest.approx(8.0 - 1.2, abs=0.6)


def pulled_document(*args: Any, **options: Any) -> Deformation:
    return Deformation((pulled(*args, **options),))


def _gap(page: LivePage) -> int:
    """Dark pixels between the pieces, in the row through the middle."""
    row = silhouette(page.pixels())[SIZE[1] // 2]
    inside = np.flatnonzero(row)
    return int((~row[inside[0] : inside[-1]]).sum())


@pytest.mark.sampled(4)
@pytest.mark.parametrize("projection", ["shaded", "mip"])
@pytest.mark.parametrize("rule", list(CUT_RULES))
def test_a_closed_cut_is_not_seen(drawn: tuple[LivePage, LiveView], projection: str, rule: str) -> None:
    page, view = drawn
    view.projection, view.show_folds = projection, True
    view.set_transfer("surface")
    view.set_camera((-0.6, 0.7, 0.4))
    show(page, view, None)
    plain = page.pixels().astype(int)
    show(page, view, pulled_document(0.0, rule))
    page.wait(f"{VIEW}.field.planar?.cut")
    assert np.abs(page.pixels().astype(int) - plain).max() <= 1
    still = replace(pulled(0.0, rule), maps=(ControlPoints.from_arrays([[0.0, 0.0]]),))
    show(page, view, Deformation((still,)))  # one of the sides has no points
    assert np.abs(page.pixels().astype(int) - plain).max() <= 1
    assert page.errors == []


@pytest.mark.parametrize(
    ("name", "projection"),
    but(
        {("source", "shaded"), ("modulate", "mip"), ("pushed together", "shaded")},
        *product(["source", "paper", "modulate", "pushed together"], ["shaded", "mip"]),
    ),
)
def test_skipping_what_is_empty_changes_nothing_beside_a_cut(
    drawn: tuple[LivePage, LiveView], name: str, projection: str
) -> None:
    page, view = drawn
    view.projection, view.show_folds = projection, True
    view.set_transfer(WHITE)
    show(page, view, Deformation((CASES[name],)))
    view.set_camera((-0.6, 0.7, 0.4))
    fast = page.pixels().astype(int)
    page.page.evaluate(f"() => {{ {VIEW}.caster.cells.skips = false; }}")
    slow = page.pixels().astype(int)
    assert (np.abs(fast - slow).max(axis=2) > 8).mean() < 3e-3


def test_a_cut_face_is_lit_and_has_no_grain(page: LivePage) -> None:
    rng = np.random.default_rng(0)
    given = bar()
    grain = np.clip(given.values + (given.values > 100) * rng.normal(0, 12, GRID.shape), 0, 255).astype(np.uint8)
    view = LiveView(
        replace(given, values=grain), transfer=WHITE, width=SIZE[0], height=SIZE[1], settle_ms=60000, background="dark"
    )
    page.add(view)
    page.wait_loaded()
    view.set_camera((1.0, 0.15, -0.1), zoom=1.5)
    view.show_deformation(pulled_document(40.0, shift=-16.0))  # the left piece is out of the box: a face is seen
    image = page.pixels().astype(float).mean(axis=2)
    face = image[80:100, 100:130]
    assert face.mean() > 90
    assert face.std() < 6


def test_a_drag_beside_a_cut_moves_the_volume_without_a_byte(page: LivePage) -> None:
    step = pulled(2.0)
    part = RigidPart(HalfSpace((float(MIDDLE[0]) + 19, 0.0), (-1.0, 0.0)))
    step = replace(step, parts=(part,), maps=(step.points.remove(*step.points.ids[3:5]),), chosen_support=None)
    editor = Editor(
        project(bar(), PLANE), step.points, cuts=list(step.cuts), parts=list(step.parts), trend="translation"
    )
    view = open_view(page)
    page.add(editor, "editor")
    view.set_camera(PLANE.normal, [-c for c in PLANE.v])
    view.follow(editor, Deformation((step,)).field(GRID))
    page.wait(f"{VIEW}.caster.fields.planar?.cut")
    before, sent, messages = page.pixels(), view.stats()["field_bytes"], view.stats()["messages"]
    count = page.page.evaluate(f"{VIEW}.shownField.link.count")
    moved = step.points.move(step.points.ids[0], np.asarray(step.points.target[0]) - [6.0, 0.0])
    moved = moved.move(step.points.ids[1], np.asarray(step.points.target[1]) - [6.0, 0.0])
    moved = moved.move(step.points.ids[2], np.asarray(step.points.target[2]) - [6.0, 0.0])
    editor.points = moved
    page.wait(f"{VIEW}.shownField.link.count > {count}")
    after = page.pixels()
    assert view.stats()["field_bytes"] == sent
    assert view.stats()["messages"] == messages
    assert silhouette(before).sum() > silhouette(after).sum() + 50
    # A cut that is drawn anew in the page is followed as well; without cuts the bar is whole again.
    editor.cuts = []
    page.wait(f"!{VIEW}.caster.fields.planar.cut")
    whole = page.pixels()
    row = silhouette(whole)[SIZE[1] // 2]
    assert row[np.flatnonzero(row)[0] : np.flatnonzero(row)[-1]].all()
    editor.cuts = [Cut(Line(((float(MIDDLE[0]) - 8, -50.0), (float(MIDDLE[0]) - 8, 50.0))))]
    page.wait(f"{VIEW}.caster.fields.planar.cut")
    again = page.pixels().astype(int)
    assert view.stats()["field_bytes"] == sent
    cut = Cut(Line(((float(MIDDLE[0]) - 8, -50.0), (float(MIDDLE[0]) - 8, 50.0))))
    view.follow(None, Deformation((replace(step, maps=(moved,), cuts=(cut,)),)).field(GRID))
    page.wait(f"{VIEW}.field.planar.cut?.id")
    assert np.abs(page.pixels().astype(int) - again).mean() < 0.3  # what Python makes of the same
    assert page.errors == []
