"""Movies: read back they hold the frames that were written, and a stop or a failure leaves no file."""

from __future__ import annotations

import errno
import operator
import os
import re
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import oracle
import pytest
from PIL import Image, features

from deformnb.document.animation import Animation
from deformnb.document.deformation import Deformation, Keyframe
from deformnb.errors import Cancelled, DeformError, MissingPackageError, VolumeFileError
from deformnb.imaging.movie_frames import animation_frames, deformation_frames, orbit, swing, write_movie
from deformnb.imaging.render import render_pair, render_volume
from deformnb.io import movies
from deformnb.rbf.points import ControlPoints
from deformnb.volume.transfer import TransferFunction
from deformnb.volume.volume import Grid, Volume

BACKENDS = ["core", pytest.param("vtk", marks=pytest.mark.needs_gl)]
WHITE = TransferFunction(((0, 1, 1, 1),), ((0, 0), (50, 0.9), (255, 0.9)))
KINDS = [
    "a.gif",
    "a.mp4",
    pytest.param("a.webp", marks=pytest.mark.skipif(not features.check("webp"), reason="none")),
    "a.png",
    "folder/",
]


def ball() -> tuple[Volume, Deformation]:
    """A ball that is moved by 8 to the right on the picture along +y."""
    k = np.indices((32, 32, 32)) - 15.5
    values = np.clip(6.5 - np.sqrt((k**2).sum(axis=0)), 0, 1) * 200
    volume = Volume(values.astype(np.uint8), Grid((32, 32, 32)))
    points = ControlPoints.from_arrays([[16.0, 16.0]], [[24.0, 16.0]])
    return volume, Deformation.from_picture_points(volume.grid, "+y", points, trend="translation")


def middle(image: np.ndarray) -> float:
    """Mean column of the foreground."""
    bright = image.max(axis=2) > 100
    return float(np.nonzero(bright)[1].mean())


def shades(count: int, size: tuple[int, int] = (20, 12)) -> list[np.ndarray]:
    """Frames of one grey each that can be distinguished after any encoder, with a red corner."""
    frames = []
    for k in range(count):
        frame = np.full((size[1], size[0], 3), 40 + 170 * k // max(1, count - 1), np.uint8)
        frame[:6, :8] = (200, 30, 30)
        frames.append(frame)
    return frames


def ffmpeg(*arguments: str) -> subprocess.CompletedProcess[bytes]:
    import imageio_ffmpeg

    return subprocess.run([imageio_ffmpeg.get_ffmpeg_exe(), *arguments], capture_output=True, check=False)


def read_back(path: Path) -> list[np.ndarray]:
    """All frames of a movie as they would be seen."""
    if path.is_dir():
        return [np.asarray(Image.open(p)) for p in sorted(path.glob("*.png"))]
    if path.suffix == ".mp4":
        done = ffmpeg("-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "-")
        width, height = map(int, re.findall(rb"yuv420p.*?, (\d+)x(\d+)", done.stderr)[0])
        return list(np.frombuffer(done.stdout, np.uint8).reshape(-1, height, width, 3))
    with Image.open(path) as file:
        found = []
        for k in range(file.n_frames):
            file.seek(k)
            found.append(np.asarray(file.convert("RGB")))
        return found


# ---- frames ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_first_frame_is_the_original_and_the_middle_one_is_deformed(backend: str) -> None:
    volume, deformation = ball()
    look: dict[str, Any] = {"transfer": WHITE, "size": (96, 72), "backend": backend, "background": (0, 0, 0)}
    frames = list(deformation_frames(volume, deformation, strengths=6, directions=(0, 1, 0), **look))
    assert len(frames) == 6
    oracle.assert_close(frames[0], render_volume(volume, direction=(0, 1, 0), **look), atol=1)
    oracle.assert_close(frames[3], render_volume(deformation.apply(volume), direction=(0, 1, 0), **look), atol=1)
    pixels = 72 / (31 * 1.02 + 1)  # a voxel is so many of them
    # 8 voxels to the right; a quarter of that way after a sixth of the swing, three quarters after a third.
    oracle.assert_close(
        [middle(f) - middle(frames[0]) for f in frames], np.array([0, 2, 6, 8, 6, 2]) * pixels, atol=0.8
    )
    for k in (1, 2):
        np.testing.assert_array_equal(frames[k], frames[6 - k])


@pytest.mark.sampled(2)
@pytest.mark.parametrize("backend", BACKENDS)
def test_a_pair_keeps_the_original_at_the_left(backend: str) -> None:
    volume, deformation = ball()
    frames = list(
        deformation_frames(
            volume,
            deformation,
            strengths=(0.0, 1.0),
            directions=(0, 1, 0),
            shows="pair",
            transfer=WHITE,
            size=(64, 64),
            backend=backend,
        )
    )
    assert [f.shape for f in frames] == [(64, 128, 3)] * 2
    np.testing.assert_array_equal(frames[0][:, :64], frames[0][:, 64:])
    np.testing.assert_array_equal(frames[0][:, :64], frames[1][:, :64])
    assert middle(frames[1][:, 64:]) > middle(frames[1][:, :64]) + 10


@pytest.mark.nightly
@pytest.mark.parametrize("backend", BACKENDS)
def test_the_camera_turns_and_keeps_its_scale(backend: str) -> None:
    k, j, i = np.indices((24, 24, 48))
    values = np.where(np.abs(i - 40) + np.abs(j - 11.5) + np.abs(k - 11.5) < 6, 200, 0)  # at the end of +x
    volume = Volume(values.astype(np.uint8), Grid((24, 24, 48)))
    look: dict[str, Any] = {"transfer": WHITE, "size": (96, 72), "backend": backend, "background": (0, 0, 0)}
    around = orbit(4, (0, 1, 0))
    frames = list(deformation_frames(volume, Deformation(), strengths=(0.0,) * 4, directions=around, **look))
    # From the front +x is right, from behind left; along x it is in the middle.
    offsets = [middle(f) - 47.5 for f in frames]
    oracle.assert_close(offsets, [offsets[0], 0, -offsets[0], 0], atol=1)
    assert offsets[0] > 20
    areas = [(f.max(axis=2) > 100).sum() for f in frames]
    assert max(areas) < 1.35 * min(areas)  # a picture fitted to each side would be twice as large


@pytest.mark.nightly
def test_the_field_of_view_can_be_larger() -> None:
    volume, deformation = ball()
    wide = volume.grid.resampled(margin=(16.0, 0, 0))
    frames = list(
        deformation_frames(
            volume,
            deformation.scaled(2.5),
            strengths=(1.0,),
            directions=(0, 1, 0),
            transfer=WHITE,
            size=(128, 64),
            backend="core",
            output=wide,
        )
    )
    assert middle(frames[0]) == pytest.approx(63.5 + 20 * 64 / 32.64, abs=1)  # beyond the box of the volume itself


@pytest.mark.nightly
def test_a_frame_can_be_painted_on() -> None:
    volume, deformation = ball()
    frames = deformation_frames(volume, deformation, strengths=4, size=(16, 12), backend="core")
    pictures = []
    for frame in frames:
        pictures.append(frame.copy())
        frame[:] = 7
    np.testing.assert_array_equal(pictures[1], pictures[3])


def test_frames_are_made_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[float] = []
    blended = Deformation.scaled
    monkeypatch.setattr(Deformation, "scaled", lambda self, s: (made.append(s), blended(self, s))[1])
    volume, deformation = ball()
    frames = deformation_frames(volume, deformation, strengths=swing(4), size=(16, 12), backend="core")
    assert made == []
    next(frames)
    assert made == [0.0]
    assert frames.__length_hint__() == 3
    assert len(list(frames)) == 3
    assert made == [0.0, 0.5, 1.0]  # the way back is not made again
    frames.close()


@pytest.mark.nightly
def test_a_volume_is_not_deformed_again_where_only_the_camera_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[float] = []
    blended = Deformation.scaled
    monkeypatch.setattr(Deformation, "scaled", lambda self, s: (made.append(s), blended(self, s))[1])
    volume, deformation = ball()
    for shows, strengths, times in (("after", (1, 1, 1), 1), ("pair", (1, 1, 1), 2), ("pair", (1, 2, 0), 3)):
        made.clear()
        list(
            deformation_frames(
                volume,
                deformation,
                strengths=strengths,
                directions=orbit(3),
                shows=shows,
                size=(16, 12),
                backend="core",
            )
        )
        assert len(made) == times


def test_swing_and_orbit() -> None:
    assert swing(1) == (0.0,)
    assert swing(2, to=3.0) == (0.0, 3.0)
    steps = np.diff(swing(48))
    assert steps[0] < 0.01 < steps[12]  # slow at the ends
    oracle.assert_close(orbit(4, (0, 1, 1), axis=(0, 0, 2), degrees=180)[2], [-1, 0, 1], atol=1e-12)
    assert len(set(orbit(7))) == 7


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"strengths": 0}, "at least 1"),
        ({"strengths": ()}, "at least one"),
        ({"strengths": (0, np.nan)}, "finite"),
        ({"strengths": "all"}, "list of numbers"),
        ({"directions": np.ones((3, 3))}, "each of the 2"),
        ({"directions": (0, 0, 0)}, "normal"),
        ({"shows": "grid"}, "after or pair"),
        ({"size": (0, 4)}, "size"),
        ({"backend": "povray"}, "unknown renderer"),
    ],
)
def test_senseless_frames_are_refused_at_once(options: dict[str, Any], match: str) -> None:
    volume, deformation = ball()
    with pytest.raises(DeformError, match=match):
        deformation_frames(volume, deformation, **{"strengths": 2, "backend": "core", **options})


# ---- files -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", KINDS)
def test_a_movie_is_read_back(name: str, tmp_path: Path) -> None:
    frames = shades(9)
    target = f"{tmp_path}/{name}"
    written = write_movie(target, iter(frames), fps=10)
    assert written == (tmp_path if name == "a.png" else Path(target))
    found = read_back(written)
    assert [f.shape for f in found] == [(12, 20, 3)] * 9
    for was, now in zip(frames, found, strict=True):
        # Limits of exactness: 32 levels of a palette, and colours of half resolution.
        oracle.assert_close(now[9, 16].astype(float), was[9, 16], atol=9)
        oracle.assert_close(now[2, 2].astype(float), was[2, 2], atol=16)
    assert [p.name for p in tmp_path.iterdir() if not p.name.startswith(name[0])] == []


def test_a_deformation_becomes_a_movie(tmp_path: Path) -> None:
    volume, deformation = ball()
    seen: list[tuple[int, int]] = []
    frames = deformation_frames(
        volume, deformation, strengths=6, directions=(0, 1, 0), transfer=WHITE, size=(60, 44), backend="core"
    )
    path = write_movie(tmp_path / "ball.gif", frames, progress=lambda done, total: seen.append((done, total)))
    assert seen == [(k, 6) for k in range(1, 7)]
    found = read_back(path)
    assert len(found) == 6
    assert middle(found[3]) > middle(found[0]) + 8


def test_odd_sizes_lose_nothing(tmp_path: Path) -> None:
    frames = shades(3, (21, 13))
    found = read_back(write_movie(tmp_path / "odd.mp4", frames, fps=5))
    assert [f.shape for f in found] == [(14, 22, 3)] * 3
    oracle.assert_close(found[1][-1, -1].astype(float), frames[1][-1, -1], atol=9)


def test_mp4_is_what_browsers_play(tmp_path: Path) -> None:
    path = write_movie(tmp_path / "a.mp4", shades(12), fps=12.5)
    facts = ffmpeg("-i", str(path), "-f", "null", "-").stderr.decode()
    for fact in ("Video: h264", "yuv420p", "12.50 fps", "Duration: 00:00:00.96"):
        assert fact in facts
    raw = path.read_bytes()
    assert raw.index(b"moov") < raw.index(b"mdat")  # it starts before all of it has arrived


def test_a_gif_keeps_time_repeats_and_does_not_flicker(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    still = rng.integers(0, 256, (24, 32, 3), dtype=np.uint8)
    frames = []
    for k in range(10):
        frame = still.copy()
        frame[8:16, 3 * k : 3 * k + 4] = (255, 255 - 20 * k, 20 * k)
        frames.append(frame)
    path = write_movie(tmp_path / "a.gif", frames, fps=24)
    with Image.open(path) as file:
        assert file.info["loop"] == 0
        durations = []
        for k in range(file.n_frames):
            file.seek(k)
            durations.append(file.info["duration"])
    assert set(durations) == {40, 50}  # hundredths of a second, and no drift
    assert sum(durations) == 420
    found = read_back(path)
    for frame in found[1:]:
        np.testing.assert_array_equal(frame[:8], found[0][:8])


@pytest.mark.nightly
def test_a_gif_keeps_the_colour_of_its_background(tmp_path: Path) -> None:
    volume, deformation = ball()
    frames = list(deformation_frames(volume, deformation, strengths=4, size=(64, 48), backend="core"))
    found = read_back(write_movie(tmp_path / "a.gif", frames))
    assert tuple(frames[0][0, 0]) == (15, 17, 20)
    oracle.assert_close(found[0][0, 0].astype(float), [15, 17, 20], atol=1)
    for was, now in zip(frames, found, strict=True):
        assert np.abs(was.astype(int) - now).mean() < 2


def test_a_webp_keeps_time_and_repeats(tmp_path: Path) -> None:
    if not features.check("webp"):
        pytest.skip("this Pillow has no WebP")
    path = write_movie(tmp_path / "a.webp", shades(6), fps=24)
    with Image.open(path) as file:
        assert (file.n_frames, file.info["loop"]) == (6, 0)
        durations = []
        for k in range(6):
            file.seek(k)
            file.load()
            durations.append(file.info["duration"])
    assert sum(durations) == 250


@pytest.mark.parametrize(
    ("name", "files"),
    [
        ("turn.png", ["turn_0000.png", "turn_0001.png"]),
        ("turn_%02d.png", ["turn_00.png", "turn_01.png"]),
        ("%d of two.png", ["0 of two.png", "1 of two.png"]),
        ("new", ["frame_0000.png", "frame_0001.png"]),
        ("new/", ["frame_0000.png", "frame_0001.png"]),
        ("", ["frame_0000.png", "frame_0001.png"]),
        ("{0}.PNG", ["{0}_0000.PNG", "{0}_0001.PNG"]),
    ],
)
def test_numbered_pictures(name: str, files: list[str], tmp_path: Path) -> None:
    frames = shades(2)
    folder = write_movie(f"{tmp_path}/{name}", frames)
    assert sorted(p.name for p in folder.iterdir()) == files
    for file, frame in zip(files, frames, strict=True):
        np.testing.assert_array_equal(np.asarray(Image.open(folder / file)), frame)


def test_two_series_are_not_mixed(tmp_path: Path) -> None:
    write_movie(tmp_path / "turn.png", shades(3))
    write_movie(tmp_path / "other.png", shades(2))
    with pytest.raises(DeformError, match=r"holds a series already \(turn_000"):
        write_movie(tmp_path / "turn.png", shades(2))
    assert len(list(tmp_path.iterdir())) == 5


def test_an_older_file_is_replaced(tmp_path: Path) -> None:
    path = write_movie(tmp_path / "a.gif", shades(3))
    with pytest.raises(VolumeFileError, match="exists already"):
        write_movie(path, shades(5), overwrite=False)
    assert len(read_back(path)) == 3
    assert len(read_back(write_movie(path, shades(5)))) == 5


# ---- stops and errors ------------------------------------------------------------------------------------------------


def after_three(what: Callable[[], Any]) -> Iterator[np.ndarray]:
    yield from shades(3)
    what()
    yield from shades(3)


@pytest.fixture(params=KINDS)
def target(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """A path whose older file must survive; no file may be left next to it."""
    path = tmp_path / request.param
    old = not request.param.endswith("/") and path.suffix != ".png"
    if old:
        path.write_bytes(b"old")
    yield f"{tmp_path}/{request.param}"
    assert [p.name for p in tmp_path.iterdir()] == ([path.name] if old else [])
    if old:
        assert path.read_bytes() == b"old"


def test_what_is_cancelled_leaves_nothing(target: str) -> None:
    stop = threading.Event()
    with pytest.raises(Cancelled):
        write_movie(target, after_three(stop.set), cancel=stop.is_set)


def test_progress_may_cancel(target: str) -> None:
    def progress(done: int, total: int) -> None:
        assert total == 6
        if done == 4:
            raise Cancelled

    with pytest.raises(Cancelled):
        write_movie(target, shades(6), progress=progress)


def test_an_error_of_a_frame_leaves_nothing(target: str) -> None:
    def fail() -> None:
        raise DeformError("points 1 and 2 lie in one place")

    with pytest.raises(DeformError, match="points 1 and 2"):
        write_movie(target, after_three(fail))


@pytest.mark.parametrize(
    ("bad", "match"),
    [
        (np.zeros((12, 21, 3), np.uint8), r"frame 2 is 21 x 12, those before are 20 x 12"),
        (np.zeros((12, 20), np.uint8), "frame 2 is no picture"),
        (np.zeros((12, 20, 3)), "frame 2 is no picture"),
        (np.zeros((0, 20, 3), np.uint8), "frame 2 is no picture"),
    ],
)
def test_frames_that_are_no_pictures_of_one_size(target: str, bad: np.ndarray, match: str) -> None:
    with pytest.raises(DeformError, match=match):
        write_movie(target, [*shades(2), bad])


def test_no_frames(target: str) -> None:
    with pytest.raises(DeformError, match="no frames"):
        write_movie(target, [])


@pytest.mark.parametrize("fps", [0, -1, np.nan, np.inf, 1e9])
def test_senseless_speeds(fps: float, target: str) -> None:
    with pytest.raises(DeformError, match="frames a second"):
        write_movie(target, shades(2), fps=fps)


def test_a_full_disk_is_said(target: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def full() -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(DeformError, match=r"disk .* is full"):
        write_movie(target, after_three(full))


def test_an_encoder_that_fails_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import imageio_ffmpeg

    for words, match in (
        ("av_interleaved_write_frame(): No space left on device", "disk .* is full"),
        ("Unknown encoder libx264", "the encoder ended with 3: Unknown encoder"),
    ):
        fake = tmp_path / "ffmpeg"
        fake.write_text(f"#!/bin/sh\nhead -c 100 >/dev/null\necho '{words}' >&2\nexit 3\n", encoding="utf-8")
        fake.chmod(0o755)
        monkeypatch.setattr(imageio_ffmpeg, "get_ffmpeg_exe", lambda fake=fake: str(fake))
        with pytest.raises(DeformError, match=match):
            write_movie(tmp_path / "a.mp4", shades(200, (200, 100)))
        assert [p.name for p in tmp_path.iterdir()] == ["ffmpeg"]


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="Linux has this device")
def test_the_encoder_itself_meets_a_full_disk(tmp_path: Path) -> None:
    run = ffmpeg("-loglevel", "error", "-y", "-f", "lavfi", "-i", "testsrc=d=1", "-f", "mp4", "/dev/full")
    assert run.returncode != 0
    assert any(word in run.stderr.decode() for word in movies.DISK_FULL)


def test_mp4_without_the_encoder_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingPackageError, match=r'pip install "deformnb-core\[movie\]"'):
        write_movie(tmp_path / "a.mp4", shades(2))
    assert list(tmp_path.iterdir()) == []


def test_webp_without_webp_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(features, "check", lambda name: False)
    with pytest.raises(MissingPackageError, match="WebP"):
        write_movie(tmp_path / "a.webp", shades(2))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "match"),
    [
        ("a.avi", r"\.gif, \.mp4, \.webp, \.png or into a folder"),
        ("missing/a.gif", "no folder"),
        ("missing/a.mp4", "no folder"),
        ("missing/a.png", "no folder"),
        ("missing/new/", "no folder"),
        ("a_%s.png", "no pattern"),
        ("a_%d_%d.png", "no pattern"),
    ],
)
def test_paths_that_cannot_be_written(name: str, match: str, tmp_path: Path) -> None:
    asked: list[int] = []

    def frames() -> Iterator[np.ndarray]:
        asked.append(1)
        yield from shades(2)

    with pytest.raises(DeformError, match=match):
        write_movie(f"{tmp_path}/{name}", frames())
    assert asked == []  # raised before any frame is made
    assert list(tmp_path.iterdir()) == []


def test_a_gif_cannot_be_faster_than_browsers_show(tmp_path: Path) -> None:
    with pytest.raises(DeformError, match="at most 50"):
        write_movie(tmp_path / "a.gif", shades(2), fps=60)


@pytest.mark.needs_gl
def test_a_stopped_movie_gives_back_the_window(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from deformnb.imaging.render import VtkRenderer

    closed: list[bool] = []
    close = VtkRenderer.close
    monkeypatch.setattr(VtkRenderer, "close", lambda self: (closed.append(True), close(self)))
    volume, deformation = ball()
    frames = deformation_frames(volume, deformation, strengths=4, size=(32, 24), backend="vtk")
    done: list[int] = []
    with pytest.raises(Cancelled):
        write_movie(tmp_path / "a.gif", frames, progress=lambda k, total: done.append(k), cancel=lambda: len(done) == 2)
    assert closed == [True]
    assert list(frames) == []


@pytest.mark.nightly
def test_pairs_of_stills_and_movies_agree() -> None:
    volume, deformation = ball()
    look: dict[str, Any] = {"transfer": WHITE, "size": (64, 48), "backend": "core", "background": (0, 0, 0)}
    (frame,) = deformation_frames(volume, deformation, strengths=(1.0,), shows="pair", **look)
    still = render_pair(volume, deformation.apply(volume), captions=("", ""), **look)
    assert middle(frame[:, 64:]) - middle(frame[:, :64]) == pytest.approx(
        middle(still[:, still.shape[1] // 2 :]) - middle(still[:, : still.shape[1] // 2]), abs=1
    )


def test_an_animation_becomes_frames_of_its_moments() -> None:
    volume, deformation = ball()
    keys = (Keyframe(0.0, deformation.scaled(0).steps), Keyframe(1.0, deformation.steps))
    document = Deformation(deformation.steps, keyframes=keys)
    look: dict[str, Any] = {
        "directions": (0, 1, 0),
        "transfer": WHITE,
        "size": (64, 48),
        "backend": "core",
        "background": (0, 0, 0),
    }
    frames = animation_frames(volume, Animation(document), fps=4, **look)
    assert operator.length_hint(frames) == 5
    places = [middle(frame) for frame in frames]
    pixel = (places[4] - places[0]) / 8  # the ball moves by 8
    assert pixel > 0.8
    assert [(place - places[0]) / pixel for place in places] == pytest.approx([0, 2, 4, 6, 8], abs=0.35)
    there = [middle(frame) for frame in animation_frames(volume, Animation(document, loop="swing"), fps=2, **look)]
    assert there == pytest.approx([places[0], places[2], places[4], places[2]], abs=0.1)
    (pair,) = animation_frames(volume, Animation(document), times=(0.5,), shows="pair", **look)
    assert middle(pair[:, :64]) == pytest.approx(places[0], abs=0.1)
    assert middle(pair[:, 64:]) == pytest.approx(places[2], abs=0.1)
    with pytest.raises(DeformError, match="times are a list of numbers"):
        animation_frames(volume, Animation(document), times="now", **look)  # type: ignore[arg-type]
