"""Files made of a session: each read back, and nothing left where one is stopped."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from deformnb.datasets.phantoms import PHANTOMS
from deformnb.document.deformation import Keyframe, VolumeReference
from deformnb.document.script import UNKNOWN_VOLUME
from deformnb.errors import Cancelled, DeformError, FileChangedError, VolumeFileError
from deformnb.io.documents import read_deformation
from deformnb.io.volumes.formats import FORMATS, read_volume, write_volume
from deformnb.session.exports import EXPORTS, Frozen, export, export_for
from deformnb.session.inputs import as_deformation, best_view, silhouette_length, volume_from
from deformnb.session.session import Session
from deformnb.volume.volume import Grid, Volume, voxel_checksum
from deformnb.widgets.view.live_view import LiveView


@pytest.fixture
def session() -> Session:
    z, y, x = np.mgrid[:12, :14, :20]
    values = (200 * ((z - 6) ** 2 / 25 + (y - 7) ** 2 / 36 + (x - 10) ** 2 / 81 < 1)).astype(np.uint8)
    made = Session(Volume(values, Grid((12, 14, 20), (1.0, 1.0, 2.0)), "egg"))
    made.editing.edit_points(made.editing.points.add([8.0, 6.0], [11.0, 6.0]))
    return made


def test_a_document_with_key_frames_is_exported_as_its_animation(
    session: Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from PIL import Image

    monkeypatch.setattr("deformnb.session.exports._FRAME", (64, 48))
    moved, rest = session.editing.deformation, session.editing.deformation.scaled(0)
    session.editing.deformation = replace(moved, keyframes=(Keyframe(0.0, rest.steps), Keyframe(0.25, moved.steps)))
    shares: list[float] = []
    path = export(session, tmp_path / "swim.gif", camera={"direction": (0, 1, 0)}, progress=shares.append)
    with Image.open(path) as gif:
        assert gif.n_frames == 7  # 0.25 s at 24 frames a second, with both ends
    assert len(shares) == 7


def test_every_writable_format_of_volumes_is_a_suffix_of_the_export() -> None:
    writable = {suffix for entry in FORMATS.values() if entry.write is not None for suffix in entry.suffixes}
    pictures = set(FORMATS["image"].suffixes)  # of one slice only; as an export they are views of the volume
    # .raw needs no place in a menu, and a folder is no download
    assert writable - pictures - {".raw", ".zarr"} <= set(EXPORTS["volume"].suffixes)


@pytest.mark.parametrize("suffix", [s for s in EXPORTS["volume"].suffixes if s not in (".nii", ".nhdr", ".mhd")])
def test_a_volume_comes_back(session: Session, tmp_path: Path, suffix: str) -> None:
    path = export(session, tmp_path / f"egg{suffix}")
    assert_array_equal(read_volume(path).values, session.results.volume().values)


@pytest.fixture
def levels(tmp_path: Path) -> list[Volume]:
    """An uneven volume as the two levels of a pyramid."""
    pytest.importorskip("zarr")
    values = np.random.default_rng(1).integers(10, 250, (13, 19, 301)).astype(np.uint8)
    write_volume(Volume(values, Grid(values.shape, (0.5, 1.5, 2.0), (3.0, 4.0, 5.0)), "tissue"), tmp_path / "in.zarr")
    return [read_volume(tmp_path / "in.zarr", level=level) for level in range(2)]


def _edited(volume: Volume) -> Session:
    made = Session(volume, view="+y")
    made.editing.edit_points(made.editing.points.add([60.0, 12.0], [75.0, 14.0]))
    made.editing.change(extrusion="modulate", curve="sin(pi*z)")
    made.results.grow(4.0)
    return made


def test_a_document_does_not_depend_on_the_level_that_is_edited(levels: list[Volume]) -> None:
    fine, coarse = (_edited(volume) for volume in levels)
    assert (fine.volume.shape, coarse.volume.shape) == ((13, 19, 301), (7, 10, 151))
    assert fine.document() == coarse.document()
    assert fine.document().volume == VolumeReference.of(Volume(levels[0].values, levels[0].grid, "in"))
    assert not coarse.files.difference(fine.document())
    middle = levels[1].grid.center
    assert_allclose(coarse.results.field().displacement(middle), fine.results.field().displacement(middle))
    assert_allclose(coarse.results.volume().grid.lengths, fine.results.volume().grid.lengths, rtol=0.05)
    assert coarse.results.volume().grid.size < fine.results.volume().grid.size / 6
    code = coarse.code().replace("deformed =", "_ =")
    there: dict[str, Any] = {}
    exec(code.replace(UNKNOWN_VOLUME, "coarse"), {"coarse": levels[1]}, there)
    assert there["deformation"].output == fine.editing.deformation.output


def test_voxels_that_are_not_of_the_pyramid_are_not_taken_for_its_level(levels: list[Volume]) -> None:
    coarse = levels[1]
    assert replace(coarse, name="other", is_labels=True).level is coarse.level
    for other in (replace(coarse, values=coarse.values + 1), replace(coarse, grid=Grid(coarse.shape))):
        assert other.level is None
        assert other.finest_grid == other.grid


def test_a_large_pyramid_is_known_by_its_coarsest_level(levels: list[Volume], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deformnb.io.volumes.ome_zarr._MOST_CHECKED", 13 * 19 * 301 - 1)
    fine, coarse = (VolumeReference.of(volume) for volume in levels)
    assert fine == coarse
    assert fine.sha256 == voxel_checksum(levels[1].dtype, levels[1].shape, levels[1].values)


def test_full_resolution_is_that_of_the_finest_level(levels: list[Volume], tmp_path: Path) -> None:
    fine, coarse = (_edited(volume) for volume in levels)
    target = tmp_path / "out.zarr"
    found = read_volume(export(coarse, target), level=0)
    assert found.grid == fine.results.volume().grid
    assert np.abs(found.values.astype(int) - fine.results.volume().values).max() <= 1  # a rounding of values at a half
    before = found.values
    with pytest.raises(VolumeFileError, match="exists already"):
        export(coarse, target)

    def stop(share: float) -> None:
        if share > 0:
            raise Cancelled("enough.")

    coarse.editing.edit_points(coarse.editing.points.add([20.0, 10.0]))
    with pytest.raises(Cancelled):
        export(coarse, target, overwrite=True, progress=stop)
    assert_array_equal(read_volume(target, level=0).values, before)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["in.zarr", "out.zarr"]


def test_document_and_script_come_back(session: Session, tmp_path: Path) -> None:
    assert read_deformation(export(session, tmp_path / "egg.json")).steps == session.editing.deformation.steps
    text = export(session, tmp_path / "egg.py").read_text(encoding="utf-8")
    scope: dict[str, Any] = {}
    exec(text.replace('dn.read_volume("volume.nii.gz")', "volume"), scope | {"volume": session.volume}, scope)
    assert scope["deformation"] == session.editing.deformation


@pytest.mark.parametrize("name", ["egg.png", "egg.svg", "egg.pdf", "egg.gif"])
def test_pictures_are_written(session: Session, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deformnb.session.exports._RENDERING", (160, 120))
    monkeypatch.setattr("deformnb.session.exports._FRAME", (64, 48))
    monkeypatch.setattr("deformnb.session.exports._FRAMES", 4)
    shares: list[float] = []
    path = export(session, tmp_path / name, camera={"direction": (0, 1, 0)}, progress=shares.append)
    start = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF", ".gif": b"GIF8"}[path.suffix]
    assert path.read_bytes().startswith(start)
    assert shares == sorted(shares)
    if path.suffix == ".png":
        from PIL import Image

        image = np.asarray(Image.open(path).convert("L")).astype(int)
        assert image.shape == (120, 160)
        assert image.std() > 10


@pytest.mark.parametrize("name", ["egg.nrrd", "egg.png", "egg.gif"])
def test_a_cancelled_export_leaves_nothing(session: Session, tmp_path: Path, name: str) -> None:
    def stop(_share: float) -> None:
        raise Cancelled("enough.")

    with pytest.raises(Cancelled):
        export(session, tmp_path / name, progress=stop)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", [e.suffixes[0] for e in EXPORTS.values()])
def test_what_cannot_be_written_is_said_before_the_work(session: Session, tmp_path: Path, suffix: str) -> None:
    (tmp_path / f"folder{suffix}").mkdir()
    worked: list[float] = []
    for name, words in ((f"none/a{suffix}", "there is no folder"), (f"folder{suffix}", "this is a folder")):
        with pytest.raises(VolumeFileError, match=words):
            export(session, tmp_path / name, progress=worked.append)
    assert worked == []


def test_a_result_beyond_the_memory_is_refused_with_numbers(
    session: Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("deformnb.io.files.memory.available_memory", lambda: 3000)
    with pytest.raises(DeformError, match=r"takes 3.3 KiB and 2.9 KiB are free"):
        export(session, tmp_path / "egg.nrrd")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["egg.nrrd", "egg.mhd", "egg.json", "egg.py", "egg.svg"])
def test_a_file_that_was_there_before_is_not_written_over(session: Session, tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"the original")
    worked: list[float] = []
    with pytest.raises(FileChangedError, match=f"^{name} was there before"):
        export(session, tmp_path / name, progress=worked.append)
    assert worked == []
    assert (tmp_path / name).read_bytes() == b"the original"
    export(session, tmp_path / name, overwrite=True)
    export(session, tmp_path / name)  # written here
    with pytest.raises(FileChangedError):
        export(Session(session.volume), tmp_path / name)
    (tmp_path / name).write_bytes(b"of another")
    with pytest.raises(FileChangedError, match="changed by someone else"):
        export(session, tmp_path / name)


def test_an_export_knows_nothing_of_later_edits(session: Session, tmp_path: Path) -> None:
    frozen, before = Frozen.of(session), session.results.volume().values
    session.editing.change(strength=-1.0)
    assert_array_equal(read_volume(export(frozen, tmp_path / "egg.nrrd")).values, before)
    assert not np.array_equal(session.results.volume().values, before)


def test_a_suffix_that_says_nothing_is_refused_with_those_that_do(session: Session, tmp_path: Path) -> None:
    with pytest.raises(DeformError, match=r"movie \.gif"):
        export(session, tmp_path / "egg.exe")
    assert export_for("a/b/EGG.NII.GZ") is EXPORTS["volume"]


# -- the box of the result, and what a view shows ----------------------------------------------------------------------


def cut_off(session: Session) -> Session:
    """The egg dragged out of its box to the left, and a box that is large enough."""
    middle = session.editing.points.source.mean(axis=0)
    session.editing.edit_points(session.editing.points.add(middle, middle + np.array([26.0, 0.0])))
    assert session.results.exceeded_sides() == ("left side (L)",)
    assert session.results.fit_output()
    return session


def test_a_volume_is_written_on_the_grid_of_the_result(session: Session, tmp_path: Path) -> None:
    written = read_volume(export(cut_off(session), tmp_path / "egg.nrrd"))
    assert written.grid.is_like(session.results.box)
    assert_array_equal(written.values, session.results.volume().values)
    assert (written.values[:, :, 20:] > 100).any()  # beyond the volume


@pytest.mark.parametrize("is_seen", [True, False])
def test_pictures_and_movies_show_what_lies_beyond_the_volume(
    session: Session, tmp_path: Path, is_seen: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    from PIL import Image

    monkeypatch.setattr("deformnb.session.exports._FRAMES", 2)
    view = LiveView(cut_off(session).volume)
    view.set_camera((0, 1, 0))
    looks: dict[str, Any] = {"seen": view.settings()} if is_seen else {"camera": {"direction": (0, 1, 0)}}
    paths = [export(session, tmp_path / name, size=(240, 120), **looks) for name in ("egg.png", "egg.gif")]
    for path in paths:
        with Image.open(path) as image:
            image.seek(getattr(image, "n_frames", 1) - 1)  # dragged all the way
            grey = np.asarray(image.convert("L")).astype(int)
        seen = np.flatnonzero((np.abs(grey - grey[0, 0]) > 25).any(axis=0))
        # x runs to the right; the picture is as high as the box or as wide: the egg ends where its voxels do.
        lit = np.flatnonzero((session.results.volume().values > 100).any(axis=(0, 1)))
        nx, share = session.results.box.shape[2], 1.02 if not is_seen else None
        if share is not None:
            wanted = 120 + (np.array([lit[0] - 0.5, lit[-1] + 0.5]) - (nx - 1) / 2) * 240 / (share * nx)
            assert np.abs(seen[[0, -1]] - wanted).max() < 240 / nx
        middle = (lit[0] + lit[-1]) / 2 - (nx - 1) / 2
        assert np.sign((seen[0] + seen[-1]) / 2 - 120) == np.sign(middle)
    view.close()


def test_the_picture_before_has_the_same_box(session: Session, tmp_path: Path) -> None:
    """The drawing puts both side by side at one scale."""
    path = export(cut_off(session), tmp_path / "egg.svg")
    assert path.stat().st_size > 1000


@pytest.mark.sampled(4)
@pytest.mark.needs_gl
@pytest.mark.parametrize(
    "look",
    [
        {"camera": {"direction": (0, 1, 0), "zoom": 2.0}},
        {"camera": {"direction": (0, 1, 0), "zoom": 1.0, "pan": (9.0, 3.0)}},
        {"camera": {"direction": (0.4, 1, -0.3), "perspective": True}},
        {"projection": "composite"},
        {"background": "light"},
        {"shows": "original"},
        {"shows": "side_by_side"},
        {"clip": ((0.0, 0.4), (0.0, 1.0), (0.3, 1.0))},
    ],
)
def test_a_rendering_shows_what_the_view_shows(session: Session, tmp_path: Path, look: dict[str, Any]) -> None:
    from PIL import Image

    size = (200, 150)
    plain = LiveView(session.volume, projection="mip")
    view = LiveView(session.volume, **{"projection": "mip", **look})
    for shown in (plain, view):
        shown.show_deformation(session.results.field())
    path = export(session, tmp_path / "egg.png", seen=view.settings(), size=size)
    made = np.asarray(Image.open(path)).astype(float)
    alike, other = (np.abs(made - v.still(size)).mean() for v in (view, plain))
    assert made.shape == (150, 200, 3)
    assert alike < 8
    assert other > 1.5 * alike  # so it is no accident
    for shown in (plain, view):
        shown.close()


def test_a_movie_has_the_size_the_rate_and_the_looks_asked_for(
    session: Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from PIL import Image

    monkeypatch.setattr("deformnb.session.exports._FRAMES", 4)
    view = LiveView(session.volume, background="light", projection="mip")
    path = export(session, tmp_path / "egg.gif", seen=view.settings(), size=(96, 64), fps=10)
    with Image.open(path) as gif:
        assert (gif.size, gif.n_frames, gif.info["duration"]) == ((96, 64), 4, 100)
        frames = []
        for k in range(4):
            gif.seek(k)
            frames.append(np.asarray(gif.convert("RGB")).astype(int))
    assert all(frame[0, 0].min() > 200 for frame in frames)  # light
    assert np.abs(frames[0] - frames[2]).max() > 30  # from not at all to all the way
    assert np.abs(frames[1] - frames[3]).max() <= 8  # and back; a palette may differ a little
    view.close()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"size": (8, 100)}, "whole pixels from 16"),
        ({"size": (100.5, 100)}, "whole pixels"),
        ({"size": 100}, "whole"),
        ({"size": (100, 10**6)}, "to 8192"),
        ({"fps": 0}, "more than 0"),
        ({"fps": np.nan}, "at most 120"),
        ({"fps": True}, "pictures a second"),
    ],
)
def test_sizes_and_rates_that_are_none_are_refused(
    session: Session, tmp_path: Path, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(DeformError, match=message):
        export(session, tmp_path / "egg.gif", **options)
    assert list(tmp_path.iterdir()) == []


def test_a_script_names_the_file_that_was_opened(session: Session, tmp_path: Path) -> None:
    session.files.source = 'dn.read_volume("scans/egg.nrrd")'
    assert 'volume = dn.read_volume("scans/egg.nrrd")\n' in export(session, tmp_path / "egg.py").read_text("utf-8")


# -- what a session begins with ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("axis", "view"), [(0, "-z"), (1, "+y"), (2, "-x")])
def test_the_first_picture_shows_the_broad_side(axis: int, view: str) -> None:
    values = np.zeros((20, 20, 20), np.uint8)
    cut: list[Any] = [slice(2, 18)] * 3
    cut[axis] = slice(9, 11)
    values[tuple(cut)] = 150
    assert best_view(Volume.from_array(values)) == view


@pytest.mark.parametrize(
    ("name", "views"),
    [
        ("bar", ("+y", "-z")),  # as broad as deep
        ("fish", ("-x",)),
        ("knee", ("-x",)),  # from the side: where it bends
        ("lobster", ("-z",)),
        ("head", ("-x",)),
        ("horse", ("-x",)),
        ("abdomen", ("+y",)),
    ],
)
def test_the_first_picture_of_a_phantom_is_that_of_an_atlas(name: str, views: tuple[str, ...]) -> None:
    assert best_view(PHANTOMS[name].make()) in views


@pytest.mark.parametrize(
    ("name", "view"),
    [
        ("abdomen_ct.nii.gz", "+y"),
        ("carp.nii.gz", "-x"),
        ("head_ct.nii.gz", "-x"),
        ("knee_mr_bent.nrrd", "+y"),  # its front is broader, and a rectangle
        ("knee_mr_straight.nrrd", "+y"),
        ("lobster.nrrd", "-z"),
    ],
)
def test_the_first_picture_of_a_real_volume_is_that_of_an_atlas(real_data: Any, name: str, view: str) -> None:
    assert best_view(volume_from(real_data(name))) == view


@pytest.mark.parametrize("spacing", [(1.0, 1.0), (0.5, 2.0)])
def test_the_length_of_a_silhouette_is_that_of_its_outline(spacing: tuple[float, float]) -> None:
    rows, columns = (round(100 / step) for step in spacing)
    silhouette = np.zeros((rows, columns), bool)
    silhouette[: rows // 2, columns // 4 : 3 * columns // 4] = True  # a square of side 50 that the picture cuts off
    assert silhouette_length(silhouette, spacing) == pytest.approx(200, rel=0.04)  # corners are rounded
    noisy = silhouette ^ (np.random.default_rng(0).random(silhouette.shape) < 0.002)
    assert silhouette_length(noisy, spacing) < 1.6 * silhouette_length(silhouette, spacing)


def test_what_is_given_is_opened(session: Session, tmp_path: Path) -> None:
    assert volume_from(session.volume) is session.volume
    assert volume_from(session.volume.values.tolist()).shape == session.volume.shape
    assert_array_equal(volume_from(str(export(session, tmp_path / "egg.nrrd"))).values, session.results.volume().values)
    assert as_deformation(None) is None
    opened = as_deformation(export(session, tmp_path / "egg.json"))
    assert opened is not None
    assert opened.steps == session.editing.deformation.steps
