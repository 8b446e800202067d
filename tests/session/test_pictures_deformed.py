"""The picture of the deformed volume: where the map depends on the depth it is not the picture, deformed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from deformnb.document.deformation import Deformation
from deformnb.imaging.projection import project
from deformnb.rbf.cuts import Cut
from deformnb.rbf.extrusion import FRONT_ONLY
from deformnb.rbf.regions import Line, Polygon
from deformnb.rbf.rigid import RigidMotion, RigidPart
from deformnb.session.session import Session
from deformnb.volume.channels import Channels
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.warper import warp

GRID = Grid((20, 22, 24), (1.0, 1.25, 1.5), (2.0, -3.0, 4.0))
CAMERA = {"side": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), "oblique": ((0.7, 1.0, -0.45), (0.1, 0.2, 1.0))}
DEPTHS: dict[str, dict[str, Any]] = {
    "front only": {"extrusion": "modulate", "curve": FRONT_ONLY},
    "f(z)": {"extrusion": "modulate", "curve": "sin(pi*z)"},
    "key pictures": {"extrusion": "interpolate", "knots": (0.0, 0.6)},
}


def spine() -> Volume:
    """Skin in front, and a spine at the back that a front drag leaves."""
    z, y, x = np.indices(GRID.shape)
    values = 90.0 * (((z - 10) / 8) ** 2 + ((x - 12) / 9) ** 2 + ((y - 11) / 9) ** 2 < 1) + 3 * (x % 5)
    values[:, 15:18, 10:14] = 230
    return Volume(values.astype(np.uint8), GRID, "spine")


def shifted(place: Any, a: float, b: float) -> tuple[float, float]:
    return float(place[0] + a), float(place[1] + b)


def edit(session: Session) -> None:
    """One drag, a cut that opens and a part that turns."""
    points, middle = session.editing.points, session.editing.points.source.mean(axis=0)
    points = points.add(middle, shifted(middle, 4.0, -2.0)).add(shifted(middle, 5.0, 5.0))
    session.editing.edit_points(points)
    cut = Line((shifted(middle, 2.0, -30.0), shifted(middle, 2.0, 30.0)))
    box = Polygon(tuple(shifted(middle, *d) for d in ((-9, 3), (-5, 3), (-5, 7), (-9, 7))))
    part = RigidPart(box, motion=RigidMotion.turn(15, shifted(middle, -7, 5), (0.5, 0.2)))
    session.editing.change(cuts=(Cut(cut),), parts=(part,))


@pytest.mark.parametrize("camera", CAMERA)
@pytest.mark.parametrize("depths", DEPTHS)
@pytest.mark.parametrize("method", ["mip", "slice", "mean", "composite", "shaded"])
def test_the_picture_at_rest_is_that_of_the_deformed_volume(camera: str, depths: str, method: str) -> None:
    session = Session(spine(), method=method)
    session.edit_view(*CAMERA[camera])
    edit(session)
    assert session.pictures.deformed_picture() is None  # replicated: the picture, deformed
    settings = DEPTHS[depths]
    if depths == "key pictures":
        settings = {
            **settings,
            "maps": (session.editing.points, session.editing.initial_step(session.editing.plane).points),
        }
    session.editing.change(**settings)
    picture = session.pictures.deformed_picture()
    assert picture is not None
    deformed = warp(session.volume, session.editing.deformation.field(GRID))
    expected = project(
        deformed,
        session.editing.plane,
        method,
        transfer=session.pictures.transfer_function,
        depth=session.pictures.depth,
    )
    assert_array_equal(picture.values, expected.values)
    assert (picture.raster, picture.plane) == (expected.raster, session.editing.plane)
    assert picture.values.ndim == 3 or picture.window == session.pictures.picture().window
    assert session.pictures.deformed_picture() is not None
    assert session.pictures.deformed_picture().values is picture.values  # type: ignore[union-attr]


def test_a_spine_stays_where_the_front_alone_is_opened() -> None:
    session = Session(spine())
    middle = session.editing.points.source.mean(axis=0)
    session.editing.change(cuts=(Cut(Line((shifted(middle, 0.0, -30.0), shifted(middle, 0.0, 30.0)))),))
    points = session.editing.points
    for way in (-3.0, 3.0):
        points = points.add(shifted(middle, way, 0.0), shifted(middle, 3 * way, 0.0))
    session.editing.edit_points(points)
    raster = session.pictures.picture().raster
    column, row = np.round((middle - raster.origin) / raster.spacing).astype(int)
    whole = project(session.results.volume(), session.editing.plane, "mip")
    assert whole.values[row, column] < 60  # the hole that the picture has, deformed in its plane
    session.editing.change(extrusion="modulate", curve=FRONT_ONLY)
    deformed = session.pictures.deformed_picture()
    assert deformed is not None
    assert deformed.values[row, column] > 200  # and the spine that is in it


def test_what_is_switched_off_or_moves_nothing_has_no_other_picture() -> None:
    session = Session(spine())
    session.editing.change(extrusion="modulate", curve="1-z")
    assert not session.pictures.changes_with_depth
    edit(session)
    assert session.pictures.changes_with_depth
    session.steps.set_enabled(0, False)
    assert session.pictures.deformed_picture() is None
    session.steps.set_enabled(0, True)
    session.steps.add(in_space=True)
    assert session.pictures.deformed_picture() is None


def test_earlier_steps_count_and_later_ones_do_not() -> None:
    session = Session(spine())
    edit(session)
    session.set_view("-z")
    edit(session)
    session.editing.change(extrusion="modulate", curve="1-z")
    two = session.editing.deformation
    session.edit_view(*CAMERA["oblique"])
    edit(session)
    session.editing.edit_step(1)
    picture = session.pictures.deformed_picture()
    assert picture is not None
    deformed = warp(session.volume, Deformation(two.steps).field(GRID))
    assert_array_equal(picture.values, project(deformed, two.steps[1].plane or "+y", "mip").values)


def test_channels_and_a_box_beyond_the_volume_are_seen_too() -> None:
    values = spine().values
    channels = Channels.from_array(np.stack([values, 255 - values]))
    session = Session(channels)
    edit(session)
    session.editing.change(extrusion="modulate", curve="1-z")
    picture = session.pictures.deformed_picture()
    assert picture is not None
    assert picture.values.shape[2] == 4
    one = Session(spine())
    edit(one)
    one.editing.change(extrusion="modulate", curve="1-z")
    one.results.grow(3.0)
    larger = one.pictures.deformed_picture()
    assert larger is not None
    assert larger.raster.shape > one.pictures.picture().raster.shape
    deformed = one.results.volume()
    assert_array_equal(larger.values, project(deformed, one.editing.plane, "mip").values)
    assert larger.window == one.pictures.picture().window
