"""Movie files: GIF, MP4, WebP, or a numbered series of PNG; written atomically."""

from __future__ import annotations

import errno
import os
import re
import shutil
import subprocess
import tempfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, suppress
from operator import length_hint
from os import PathLike
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from deformnb._deferred import scipy
from deformnb._packages import install_command
from deformnb._typing import Image
from deformnb.checks import finite_number, short_value
from deformnb.errors import Cancelled, DeformError, MissingPackageError
from deformnb.io.files.atomic import atomic_write, check_target, lock_folder, sweep_folder, temporary_name
from deformnb.io.files.errors import fail, printable
from deformnb.io.files.paths import as_path

FrameProgress = Callable[[int, int], None]

_FASTEST_GIF = 50.0  # frames a second: browsers show frames shorter than 0.02 s for 0.1 s
_LEVELS = 64  # of each of red, green and blue, distinguished when the colours of a GIF are chosen
DISK_FULL = ("No space left", "Disk quota", "File too large")  # in the words of the system
_FULL_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def write_movie(
    path: str | PathLike[str],
    frames: Iterable[Image],
    fps: float = 24.0,
    *,
    overwrite: bool = True,
    progress: FrameProgress | None = None,
    cancel: Callable[[], bool] | None = None,
) -> Path:
    """Write pictures as a movie.

    Parameters
    ----------
    path : its suffix is one of :data:`MOVIES`. ``.gif`` and ``.webp`` repeat for ever; ``.mp4`` is H.264 that every
        browser plays and needs imageio-ffmpeg; a folder or ``name.png`` gets a series of numbered pictures, in a
        pattern such as ``turn_%03d.png`` if one is given.
    frames : (height, width, 3) uint8, all of one size, one after the other; never all in memory.
    fps : frames a second.
    overwrite : whether an existing file may be replaced; numbered pictures are never mixed with others.
    progress : called as ``progress(done, total)`` after each frame; total is 0 where the number of frames is
        not known. May raise :class:`~deformnb.errors.Cancelled`.
    cancel : called before each frame, such as ``threading.Event().is_set``; True raises Cancelled.

    Returns
    -------
    Path of the file, or of the folder of a series.

    Raises
    ------
    DeformError
        If the frames are no pictures of one size, the suffix is unknown, or the file cannot be written.
    MissingPackageError
        If the encoder for MP4 is not installed.
    Cancelled
        On request; an older file is untouched then, as after any error, and nothing else is left.

    Examples
    --------
    >>> folder = Path(tempfile.mkdtemp())
    >>> shades = [np.full((24, 32, 3), k, np.uint8) for k in range(0, 250, 50)]
    >>> write_movie(folder / "shades.gif", shades, fps=10).stat().st_size > 0
    True
    """
    place = as_path(path)
    kind = "" if place.is_dir() or str(path).endswith(("/", os.sep)) else place.suffix.lower()
    if kind not in MOVIES:
        raise DeformError(
            f"a movie is written as {', '.join(k for k in MOVIES if k)} or into a folder, "
            f"not as {printable(place.name)!r}."
        )
    wanted = "a movie has between 0.01 and 1000 frames a second"
    if not 0.01 <= finite_number(fps, wanted) <= 1000:
        raise DeformError(f"{wanted}, got {fps}.")
    if not isinstance(frames, Iterable):
        raise DeformError(f"a movie is made of pictures, one after the other, got {short_value(frames)}.")
    total = length_hint(frames, 0)
    try:
        if kind not in ("", ".png"):
            check_target(place, overwrite=overwrite)
        MOVIES[kind](place, _report_frames(frames, total, progress, cancel), float(fps))
    finally:  # frames that are made one by one hold a renderer, also when the last one was never requested
        close = getattr(frames, "close", None)
        if close is not None:
            close()
    return place.parent if kind == ".png" else place


def _report_frames(
    frames: Iterable[Image], total: int, progress: FrameProgress | None, cancel: Callable[[], bool] | None
) -> Iterator[Image]:
    """The frames, checked one by one; reports after each that it is done."""
    source, shape, done = iter(frames), None, 0
    while True:
        if cancel is not None and cancel():
            raise Cancelled
        image = next(source, None)
        if image is None:
            break
        image = np.asarray(image)
        if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or image.size == 0:
            raise DeformError(
                f"frame {done} is no picture: (height, width, 3) of uint8 is needed, got {image.shape} "
                f"of {image.dtype}."
            )
        if shape not in (None, image.shape):
            raise DeformError(
                f"frame {done} is {image.shape[1]} x {image.shape[0]}, those before are {shape[1]} x "
                f"{shape[0]}; all frames of a movie have one size."
            )
        shape = image.shape
        yield np.ascontiguousarray(image)
        done += 1
        if progress is not None:
            progress(done, total)
    if not done:
        raise DeformError("there are no frames, so there is no movie to write.")


class _Store:
    """Frames packed in a file without a name, which ends with the process: they are looked at twice."""

    def __init__(self, frames: Iterable[Image]) -> None:
        self._file: Any = tempfile.TemporaryFile()  # noqa: SIM115 - closed by close
        self._sizes: list[int] = []
        self.shape: tuple[int, ...] = ()
        self.histogram = np.zeros((4, _LEVELS**3))
        try:
            for image in frames:
                packed = zlib.compress(image.tobytes(), 1)
                self._file.write(packed)
                self._sizes.append(len(packed))
                self.shape = image.shape
                self.histogram += _colour_histogram(image)
        except BaseException:
            self.close()
            raise

    def __len__(self) -> int:
        return len(self._sizes)

    def __iter__(self) -> Iterator[Image]:
        self._file.seek(0)
        for size in self._sizes:
            raw = zlib.decompress(self._file.read(size))
            yield np.frombuffer(raw, np.uint8).reshape(self.shape)

    def close(self) -> None:
        self._file.close()


def _cells(image: Image) -> NDArray[np.int32]:
    """The cell of the colour cube of each pixel."""
    r, g, b = np.moveaxis(image, -1, 0).astype(np.int32) * _LEVELS // 256
    return (r * _LEVELS + g) * _LEVELS + b


def _colour_histogram(image: Image) -> NDArray[np.float64]:
    """Counts of pixels in each cell of the colour cube, and the sums of their red, green and blue."""
    cells, channels = _cells(image).ravel(), image.reshape(-1, 3).T
    return np.stack(
        [
            np.bincount(cells, minlength=_LEVELS**3),
            *(np.bincount(cells, weights=c, minlength=_LEVELS**3) for c in channels),
        ]
    )


def _durations(count: int, fps: float, unit: float) -> list[int]:
    """Duration of each frame, in whole units of ``unit`` milliseconds, so that no error adds up."""
    ends = np.round(np.arange(count + 1) * 1000 / (fps * unit)).astype(int)
    return [int(d * unit) for d in np.diff(ends)]


def _palette(histogram: NDArray[np.float64]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Up to 256 colours for all frames, and the index of the one for each cell of the colour cube."""
    from PIL import Image as Pillow

    counts, *sums = histogram[:, histogram[0] > 0]
    means = np.stack(sums, axis=-1) / counts[:, None]
    colors = means.round().astype(np.uint8)
    # A colour that covers much of the pictures, such as the background, is unchanged. The others are shared out by the
    # roots of their numbers, so that small details have a separate colour.
    common = counts > 0.02 * counts.sum()
    weights = np.sqrt(counts)
    times = np.maximum(1, np.round(weights * min(1.0, 2**20 / weights.sum()))).astype(int)
    crowd = Pillow.fromarray(np.repeat(colors, times, axis=0)[None])
    shared = crowd.quantize(256 - int(common.sum()), Pillow.Quantize.MEDIANCUT).getpalette() or []
    palette = np.concatenate([colors[common], np.asarray(shared, np.uint8).reshape(-1, 3)])
    nearest = np.zeros(histogram.shape[1], np.uint8)
    nearest[histogram[0] > 0] = scipy.spatial.cKDTree(palette.astype(float)).query(means)[1]
    return palette, nearest


def _write_gif(path: Path, frames: Iterator[Image], fps: float) -> None:
    from PIL import Image as Pillow

    if fps > _FASTEST_GIF:
        raise DeformError(f"GIF has at most {_FASTEST_GIF:g} frames a second, got {fps:g}; choose fewer, or .mp4.")

    def to_palette(image: Image) -> Any:
        # No dither: its grain would crawl over static surfaces.
        made = Pillow.fromarray(nearest[_cells(image)])
        made.putpalette(palette.tobytes())
        return made

    with atomic_write(path) as file, closing(_Store(frames)) as store:
        palette, nearest = _palette(store.histogram)
        _save(file, map(to_palette, store), "GIF", duration=_durations(len(store), fps, 10), optimize=False)


def _write_webp(path: Path, frames: Iterator[Image], fps: float) -> None:
    from PIL import Image as Pillow
    from PIL import features

    if not features.check("webp"):
        raise MissingPackageError("this Pillow was built without WebP: pip install --upgrade pillow, or choose .gif.")
    with atomic_write(path) as file, closing(_Store(frames)) as store:
        _save(file, map(Pillow.fromarray, store), "WEBP", duration=_durations(len(store), fps, 1), quality=85, method=2)


def _save(file: BinaryIO, images: Iterator[Any], kind: str, **options: Any) -> None:
    first = next(images)
    first.save(file, format=kind, save_all=True, append_images=images, loop=0, **options)


def _write_mp4(path: Path, frames: Iterator[Image], fps: float) -> None:
    try:
        import imageio_ffmpeg
    except ImportError as error:
        message = f"MP4 needs an encoder that is not installed: {install_command('movie')}, or choose .gif or .webp."
        raise MissingPackageError(message) from error
    with atomic_write(path) as file, tempfile.TemporaryFile() as words:
        first = _even(next(frames))
        command = [
            imageio_ffmpeg.get_ffmpeg_exe(),
            "-loglevel",
            "error",
            "-y",
            "-f",
            "rawvideo",
            "-pix_fmt",
            "rgb24",
            "-s",
            f"{first.shape[1]}x{first.shape[0]}",
            "-r",
            f"{fps:.6g}",
            "-i",
            "-",
            "-an",
            "-c:v",
            "libx264",
            "-crf",
            "18",
            "-pix_fmt",
            "yuv420p",
            "-movflags",
            "+faststart",
            "-f",
            "mp4",
            file.name,
        ]
        encoder = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=words)
        assert encoder.stdin is not None
        try:
            with suppress(BrokenPipeError):  # it has ended early; its error is read below
                encoder.stdin.write(first.tobytes())
                for image in frames:
                    encoder.stdin.write(_even(image).tobytes())
                encoder.stdin.close()
            encoder.wait()
        finally:
            encoder.kill()
            with suppress(BrokenPipeError):
                encoder.stdin.close()
            encoder.wait()
        if encoder.returncode != 0:
            words.seek(0)
            raise _encoder_error(path, words.read().decode(errors="replace"), encoder.returncode)


def _encoder_error(path: Path, words: str, code: int) -> Exception:
    if any(full in words for full in DISK_FULL):
        return OSError(errno.ENOSPC, "no space left")  # atomic_write reports it
    lines = words.strip().splitlines()
    return fail(
        path, f"was not written, the encoder ended with {code}: {printable(lines[-1] if lines else 'no message')}"
    )


def _even(image: Image) -> Image:
    """Pad to even sides, which the colours of H.264 need: the last row or column twice."""
    h, w, _ = image.shape
    return np.pad(image, ((0, h % 2), (0, w % 2), (0, 0)), mode="edge") if h % 2 or w % 2 else image


# ---- numbered pictures -----------------------------------------------------------------------------------------------


def _write_series(path: Path, frames: Iterator[Image], fps: float) -> None:
    """Pictures in a folder; ``fps`` is for their players."""
    is_folder = path.is_dir() or path.suffix.lower() != ".png"
    folder = path if is_folder else path.parent
    before, digits, after = _numbering("frame.png" if is_folder else path.name)
    is_new = is_folder and not folder.exists()
    check_target(folder if is_new else folder / f"{before}0{after}")
    if not is_new:
        _refuse_mixing(folder, before, after)
    beside = folder.parent if is_new else folder
    sweep_folder(beside)
    work, lock = beside / temporary_name(), None
    moved: list[Path] = []
    try:
        work.mkdir()
        lock = lock_folder(work)
        names = _write_pictures(work, frames, lambda k: f"{before}{k:0{digits}d}{after}")
        if is_new:
            work.replace(folder)
            return
        for name in names:
            (work / name).replace(folder / name)
            moved.append(folder / name)
        moved.clear()
    except OSError as error:
        if isinstance(error, ValueError):  # a DeformError that is also an ImportError or the like: not ours
            raise
        full = "the disk (or your share of it) is full"
        why = full if error.errno in _FULL_ERRORS else f"the system reports: {error.strerror or error}"
        raise fail(folder, f"the series was not written, {why}; nothing of it is left.") from error
    finally:
        for picture in moved:
            picture.unlink(missing_ok=True)
        shutil.rmtree(work, ignore_errors=True)
        if lock is not None:
            os.close(lock)


def _numbering(name: str) -> tuple[str, int, str]:
    """Split ``turn_%03d.png`` or ``turn.png`` into the text before the number, its digits, and the text after it."""
    stem, suffix = os.path.splitext(name)
    if "%" not in stem:
        stem += "_%04d"
    match = re.fullmatch(r"([^%]*)%0?([0-9]?)d([^%]*)", stem)
    if match is None:
        raise DeformError(f"{printable(name)!r} is no pattern of file names; write the number as in turn_%04d.png.")
    return match[1], int(match[2] or 1), match[3] + suffix


def _refuse_mixing(folder: Path, before: str, after: str) -> None:
    numbered = re.compile(f"{re.escape(before)}[0-9]+{re.escape(after)}")
    with os.scandir(folder) as entries:
        old = next((entry.name for entry in entries if numbered.fullmatch(entry.name)), None)
    if old is not None:
        raise fail(
            folder,
            f"holds a series already ({printable(old)}), and two would be mixed. Choose another folder or "
            "name, or remove it.",
        )


def _write_pictures(folder: Path, frames: Iterator[Image], number: Callable[[int], str]) -> list[str]:
    from PIL import Image as Pillow

    names = []
    for k, image in enumerate(frames):
        names.append(number(k))
        Pillow.fromarray(image).save(folder / names[-1], format="PNG", compress_level=3)
    return names


MOVIES: dict[str, Callable[[Path, Iterator[Image], float], None]] = {
    ".gif": _write_gif,
    ".mp4": _write_mp4,
    ".webp": _write_webp,
    ".png": _write_series,
    "": _write_series,
}
"""Writers of movies, by the suffix of the path; no suffix is a folder of pictures."""
