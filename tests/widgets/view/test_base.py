"""The common base of all views, by a custom view: it needs no more than the abstract methods."""

from __future__ import annotations

from typing import Any

import ipywidgets as ipw
import numpy as np
import pytest
from front_end import deliver, deliver_edit

from deformnb.analysis.extent import padded
from deformnb.document.deformation import Deformation
from deformnb.errors import DeformError
from deformnb.rbf.extrusion import Extrusion
from deformnb.rbf.fields import AbstractField
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Polygon
from deformnb.rbf.rigid import RigidPart
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.camera import CameraTrait, ClipTrait, ShowsTrait, checked_camera, update_camera
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.messages.editors import PointsEdit
from deformnb.widgets.messages.points import points_to_json
from deformnb.widgets.studio.studio import Studio
from deformnb.widgets.synced import ViewMeta
from deformnb.widgets.view.base import AbstractView

GRID = Grid((10, 20, 12))
PLANE = Plane.from_view(GRID, "+y")


class Mine(AbstractView, ipw.HTML, metaclass=ViewMeta):  # type: ignore[misc]  # ipywidgets has no types
    """Describes its content in words."""

    shows = ShowsTrait()
    clip = ClipTrait()
    camera = CameraTrait()
    field: AbstractField | None = None
    output: Grid | None = None

    def show(self, volume: Volume) -> None:
        self.field = None

    def show_deformation(self, deformation: Any, *, output: Grid | None = None) -> None:
        self.field, self.output = deformation, output

    def set_transfer(self, transfer: Any) -> None:
        self.value = "other colours"

    def set_camera(self, direction: Any = None, up: Any = None, zoom: float | None = None) -> None:
        self.camera = update_camera(self.camera, direction, up, zoom)

    async def screenshot(self, timeout: float = 10.0) -> Any:
        return self.still()

    def still(self, size: tuple[int, int] | None = None) -> Any:
        return np.zeros((*(size or (4, 3))[::-1], 3), np.uint8)

    def stats(self) -> dict[str, Any]:
        return {}

    def gone(self, x: Any) -> float:
        """The displacement of the tissue here to the right."""
        assert self.field is not None
        return float(-(self.field.displacement(np.asarray(x, float)) @ np.asarray(PLANE.u)))


def points(moved: float = 0.0) -> ControlPoints:
    source = np.array([[2.0, 2.0], [9.0, 2.0], [5.0, 8.0]])
    return ControlPoints.from_arrays(source, source + np.array([moved, 0.0]))


def extrusion(moved: float) -> Extrusion:
    made = Deformation.from_picture_points(GRID, PLANE, points(moved)).field(GRID)
    assert isinstance(made, Extrusion)
    return made


def test_a_view_of_ones_own_follows_an_editor() -> None:
    view, editor, middle = Mine(), Editor(None, points()), GRID.center
    view.follow(editor, extrusion(0.0), output=GRID)
    assert editor.live
    deliver_edit(editor, PointsEdit(sender="a", seq=1, phase="move", kind="move", points=points(2.0)))
    assert view.gone(middle) == pytest.approx(2.0, abs=1e-6)
    assert view.output is GRID
    view.follow(editor, extrusion(1.0))  # the answer to an earlier edit
    assert view.gone(middle) == pytest.approx(2.0, abs=1e-6)
    view.follow(None, extrusion(1.0))
    assert not editor.live
    assert view.gone(middle) == pytest.approx(1.0, abs=1e-6)


def test_a_view_of_ones_own_follows_a_rigid_part_on_its_way() -> None:
    part = RigidPart(Polygon([(3, 3), (7, 3), (7, 6), (3, 6)]))
    view, editor = Mine(), Editor(None, points(), parts=[part])
    inside = PLANE.from_plane([5.0, 4.5])
    view.follow(editor, extrusion(0.0))
    motion = {"matrix": [[1, 0], [0, 1]], "shift": [1.5, 0]}
    edit = {
        "type": "edit",
        "sender": "a",
        "phase": "move",
        "kind": "move",
        "joins": False,
        "points": points_to_json(points()),
    }
    deliver(editor, {**edit, "seq": 1, "part": {"index": 0, "motion": motion}})
    assert view.gone(inside) == pytest.approx(1.5, abs=1e-4)
    assert editor.parts == (part,)
    for k, wrong in enumerate(({"index": -1}, {"index": 0, "motion": {"shift": [0, 0, 0]}}, [0], {"motion": None})):
        deliver(editor, {**edit, "seq": 2 + k, "part": wrong})
    assert view.gone(inside) == pytest.approx(1.5, abs=1e-4)
    deliver(editor, {**edit, "seq": 9})  # as at the end of a drag that is given up
    assert view.gone(inside) == pytest.approx(0.0, abs=1e-4)


def test_a_view_of_ones_own_follows_in_the_box_that_was_named_last() -> None:
    view, editor, larger = Mine(), Editor(None, points()), padded(GRID, 3.0)
    view.follow(editor, extrusion(0.0), output=GRID)
    view.follow(editor, extrusion(1.0), output=larger)
    assert view.output == larger
    deliver_edit(editor, PointsEdit(sender="a", seq=1, phase="move", kind="move", points=points(2.0)))
    assert view.output == larger


def test_a_studio_takes_a_view_of_ones_own_and_says_what_it_lacks() -> None:
    volume = Volume(np.random.default_rng(0).integers(0, 255, GRID.shape).astype(np.uint8), GRID)
    view = Mine()
    studio = Studio(volume, view=view, side="+y")
    try:
        assert view.value == "other colours"
        added = studio.editor.points.add([5.0, 5.0], [5.0, 5.0])
        deliver_edit(studio.editor, PointsEdit(sender="a", seq=1, phase="end", kind="add", points=added))
        moved = added.move(added.ids[-1], [7.0, 5.0])
        deliver_edit(studio.editor, PointsEdit(sender="a", seq=2, phase="move", kind="move", points=moved))
        assert view.gone(studio.session.editing.plane.from_plane([7.0, 5.0, 5.0])) == pytest.approx(2.0, abs=1e-6)
    finally:
        studio.close()

    class WithoutCamera(Mine):
        camera = None

    with pytest.raises(DeformError, match="must be a widget with a trait named camera"):
        Studio(volume, view=WithoutCamera())


@pytest.mark.parametrize("camera", [{"pan": [1e300, 0]}, {"pan": [0, -1e13]}, {"zoom": 1e30}, {"zoom": 1e-30}])
def test_a_camera_that_sees_nothing_is_refused(camera: dict[str, Any]) -> None:
    with pytest.raises(DeformError, match="nothing can be seen"):
        checked_camera(camera)
