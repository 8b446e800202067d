"""The renderer of pictures in files: it draws as a view does, is fast, and can be stopped."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from deformnb.errors import Cancelled
from deformnb.session.exports import Frozen, export
from deformnb.session.session import Session
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.cell_widgets import with_png
from deformnb.widgets.image_encoding import PREVIEW_SIZE, from_png
from deformnb.widgets.view.live_view import LiveView
from deformnb.widgets.view.stills import CoreScene, StillAsSeen
from deformnb.widgets.view.volume_view import VolumeView
from deformnb.widgets.vtk.scene import VtkScene


@pytest.fixture
def session() -> Session:
    z, y, x = np.mgrid[:12, :14, :20]
    values = (200 * ((z - 6) ** 2 / 25 + (y - 7) ** 2 / 36 + (x - 10) ** 2 / 81 < 1)).astype(np.uint8)
    made = Session(Volume(values, Grid((12, 14, 20), (1.0, 1.0, 2.0)), "egg"))
    made.editing.edit_points(made.editing.points.add([8.0, 6.0], [11.0, 6.0]))
    return made


@pytest.mark.parametrize("view_class", [LiveView, pytest.param(VolumeView, marks=pytest.mark.needs_gl)])
def test_a_rendering_tells_how_far_it_is_and_stops_in_between(
    session: Session, tmp_path: Path, view_class: type[LiveView] | type[VolumeView]
) -> None:
    view = view_class(session.volume)
    shares: list[float] = []

    def watch(share: float) -> None:
        shares.append(share)
        if share > 0.4 and is_stopped:
            raise Cancelled("enough.")

    is_stopped = False
    export(session, tmp_path / "egg.png", seen=view.settings(), size=(160, 640), progress=watch)
    assert shares == sorted(shares)
    assert sum(0.1 < share < 0.85 for share in shares) >= 2
    is_stopped = True
    with pytest.raises(Cancelled):
        export(session, tmp_path / "other.png", seen=view.settings(), size=(160, 640), progress=watch)
    assert [p.name for p in tmp_path.iterdir()] == ["egg.png"]
    view.close()


def test_one_picture_of_a_live_view_is_the_cores_and_of_a_view_of_vtk_vtks(session: Session) -> None:
    live, vtk = LiveView(session.volume), VolumeView(session.volume, method="core")
    still = live.settings().still
    assert still is StillAsSeen  # VTK without a graphics card takes five times as long, and ten seconds for its shader
    assert vtk.settings().still is None
    made = Frozen.of(session, live.settings()).scene((64, 48), once=True)
    assert isinstance(made, StillAsSeen)
    assert isinstance(made.scene, CoreScene)
    made.close()
    live.close()
    vtk.close()


@pytest.mark.parametrize("projection", ["shaded", "composite", "mip"])
@pytest.mark.parametrize("perspective", [False, True])
def test_a_preview_is_a_still_of_fewer_samples(projection: str, perspective: bool) -> None:
    z, y, x = np.mgrid[:32, :36, :40].astype(float)
    values = np.zeros(z.shape)
    for centre, radius, bright in (((15, 17, 19), 9, 150), ((20, 10, 30), 5, 220), ((9, 26, 10), 4, 255)):
        far = np.sqrt(sum((a - c) ** 2 for a, c in zip((z, y, x), centre, strict=True)))
        values = np.maximum(values, bright * np.clip(radius - far, 0, 1))
    view = LiveView(Volume(values.astype(np.uint8), Grid(z.shape)), projection=projection, ambient_occlusion=False)
    view.camera = {**view.camera, "perspective": perspective}
    wanted, found = view.still(PREVIEW_SIZE).astype(float), from_png(view.preview_png()).astype(float)
    # A mirrored or shifted picture differs by 10 and more on average; fewer samples by edges alone.
    assert np.abs(found - wanted).mean() < 1.5
    assert np.corrcoef(found.ravel(), wanted.ravel())[0, 1] > 0.975
    view.close()


@pytest.mark.needs_gl
def test_one_picture_of_a_live_view_is_red_where_the_map_folds(session: Session) -> None:
    middle = session.editing.points.source.mean(axis=0)
    session.editing.edit_points(session.editing.points.add(middle - 1, middle + 6).add(middle + 1, middle - 6))
    live = LiveView(session.volume)
    for is_visible, kind in ((True, VtkScene), (False, CoreScene)):
        live.show_folds = is_visible
        made = Frozen.of(session, live.settings()).scene((64, 48), once=True)
        assert isinstance(made, StillAsSeen)
        made.set_field(session.results.field())
        assert isinstance(made.scene, kind)
        made.close()
    live.close()


class Cell:
    """State of IPython while a cell runs, of which ``runs_for_later_readers`` sees the request."""

    def __init__(self, **content: object) -> None:
        self.kernel = self
        self.content = content

    def get_parent(self, channel: str) -> dict[str, object]:
        assert channel == "shell"
        return {"content": self.content}


@pytest.mark.parametrize(
    ("content", "host", "wanted"),
    [
        ({"code": "studio", "allow_stdin": False}, "", True),
        ({"code": "studio", "allow_stdin": True}, "", False),
        ({"code": "studio"}, "", False),
        ({"comm_id": "x"}, "", False),  # a front end is there, which has sent this
        ({"code": "studio", "allow_stdin": False}, "SERVER_SOFTWARE", False),  # Voila has a page in front of it
        ({"code": "studio", "allow_stdin": False}, "VOILA_BASE_URL", False),
    ],
)
def test_a_picture_takes_the_place_of_the_widget_where_nobody_is_in_front_of_it(
    content: dict[str, object], host: str, wanted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("IPython.get_ipython", lambda: Cell(**content))
    if host:
        monkeypatch.setenv(host, "voila/0.5")
    bundle = {"text/plain": "Studio", "application/vnd.jupyter.widget-view+json": {"model_id": "x"}}
    assert ("application/vnd.jupyter.widget-view+json" not in with_png(dict(bundle), lambda: b"PNG")) == wanted
    assert with_png(dict(bundle), lambda: 1 // 0) == bundle  # there is no picture to take its place
