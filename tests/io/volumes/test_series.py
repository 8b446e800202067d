"""Channels, colours and moments: written files are read back, here and by SimpleITK, nibabel and pynrrd."""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from deformnb import Grid
from deformnb.errors import Cancelled, DeformError
from deformnb.io import describe_file, is_series, open_series, read_channels, read_volume, write_channels, write_series
from deformnb.volume import Channels

GRID = Grid((3, 4, 5), (1.0, 2.0, 3.0), (4.0, 5.0, 6.0), ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)))
# kind, channels, moments
LAYOUTS = [("channels", 2, 1), ("rgb", 3, 1), ("rgba", 4, 1), ("channels", 1, 3), ("rgb", 3, 2), ("channels", 2, 3)]
SUFFIXES = [".nrrd", ".nii", ".nii.gz", ".mha"]
NAMES = {"channels": ("nuclei", "actin"), "rgb": ("red", "green", "blue"), "rgba": ("red", "green", "blue", "alpha")}


def sample_series(kind: str, channels: int, moments: int, dtype: str = "uint8") -> list[Channels]:
    rng = np.random.default_rng(5)
    return [
        Channels.from_array(
            rng.integers(0, 200, (3, 4, 5, channels)).astype(dtype), GRID, NAMES[kind][:channels], kind=kind
        )
        for _ in range(moments)
    ]


def stack_values(series: list[Channels]) -> NDArray[np.uint8]:
    return np.stack([channels.values for channels in series])  # [t, z, y, x, c]


def writable(suffix: str, channels: int, moments: int, kind: str) -> bool:
    return not (suffix.startswith(".nii") and channels > 1 and moments > 1 and kind == "channels")


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(("kind", "channels", "moments"), LAYOUTS)
def test_what_is_written_is_read_back(kind: str, channels: int, moments: int, suffix: str, tmp_path: Path) -> None:
    path, series = tmp_path / f"a{suffix}", sample_series(kind, channels, moments)
    if not writable(suffix, channels, moments, kind):
        with pytest.raises(DeformError, match=r"write \.nrrd"):
            write_series(series, path, moments)
        assert not path.exists()
        return
    write_series(series, path, moments, duration=0.5)
    assert is_series(path)
    opened = open_series(path)
    back = list(opened)
    assert len(opened) == len(back) == moments
    assert np.array_equal(stack_values(back), stack_values(series))
    assert back[0].kind == kind
    assert opened.grid.is_like(GRID)
    if channels > 1 and not suffix.startswith(".nii"):
        assert back[0].names == series[0].names
        assert back[0].colours == series[0].colours
    if moments > 1 and suffix != ".nrrd":
        assert opened.layout.duration == 0.5
    assert np.array_equal(read_channels(path, frame=moments - 1).values, series[-1].values)
    assert any("holds" in note for note in describe_file(path).notes)
    if kind != "channels" and moments == 1:
        grey = read_volume(path)
        assert np.array_equal(grey.values, back[0].brightness().values)
        assert "grey values" in grey.notes[-1]
        return
    with pytest.raises(DeformError, match=r"read_channels"):
        read_volume(path)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(("kind", "channels", "moments"), LAYOUTS)
def test_simpleitk_reads_the_same(kind: str, channels: int, moments: int, suffix: str, tmp_path: Path) -> None:
    sitk = pytest.importorskip("SimpleITK")
    if not writable(suffix, channels, moments, kind):
        return
    path, series = tmp_path / f"a{suffix}", sample_series(kind, channels, moments)
    write_series(series, path, moments)
    image = sitk.ReadImage(str(path))
    values = sitk.GetArrayFromImage(image)
    expected = stack_values(series)
    if suffix == ".nrrd" and channels == 1:  # ITK takes a list along the last axis for the parts of a voxel
        values = np.moveaxis(values, -1, 0)
    assert np.array_equal(values.reshape(expected.shape), expected)
    assert image.GetSpacing()[:3] == GRID.spacing
    assert image.GetOrigin()[:3] == GRID.origin
    if image.GetDimension() == 3:  # of four dimensions it forgets NRRD's direction
        assert np.allclose(np.reshape(image.GetDirection(), (3, 3)), GRID.direction)


@pytest.mark.parametrize(("kind", "channels", "moments"), [("rgb", 3, 2), ("channels", 1, 3), ("channels", 2, 1)])
def test_nibabel_and_pynrrd_read_the_same(kind: str, channels: int, moments: int, tmp_path: Path) -> None:
    nibabel, nrrd = pytest.importorskip("nibabel"), pytest.importorskip("nrrd")
    series = sample_series(kind, channels, moments)
    expected = stack_values(series)
    write_series(series, tmp_path / "a.nii.gz", moments)
    values = np.asanyarray(nibabel.load(tmp_path / "a.nii.gz").dataobj)  # [x, y, z, t, c]
    if values.dtype.names:
        values = np.stack([values[part] for part in values.dtype.names], axis=-1)
    assert np.array_equal(values.reshape(5, 4, 3, moments, channels), np.transpose(expected, (3, 2, 1, 0, 4)))
    write_series(series, tmp_path / "a.nrrd", moments)
    values, _ = nrrd.read(str(tmp_path / "a.nrrd"))
    assert np.array_equal(values.reshape(channels, 5, 4, 3, moments), expected.T)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_simpleitk_wrote_is_read(suffix: str, tmp_path: Path) -> None:
    sitk = pytest.importorskip("SimpleITK")
    values = stack_values(sample_series("rgb", 3, 2)).astype(np.int16)
    colours = sitk.GetImageFromArray(values[0], isVector=True)
    moments = sitk.GetImageFromArray(values[..., 0], isVector=False)
    sitk.WriteImage(colours, str(tmp_path / f"c{suffix}"))
    assert np.array_equal(read_channels(tmp_path / f"c{suffix}").values, values[0])
    moments.SetSpacing((1, 2, 3, 0.5))
    moments.SetOrigin((4, 5, 6, 0))
    sitk.WriteImage(moments, str(tmp_path / f"m{suffix}"))
    series = open_series(tmp_path / f"m{suffix}")
    assert np.array_equal(stack_values(list(series)), values[..., :1])
    assert series.grid.is_like(Grid((3, 4, 5), (1, 2, 3), (4, 5, 6)))


def test_scaled_moments_are_what_their_numbers_mean(tmp_path: Path) -> None:
    nibabel = pytest.importorskip("nibabel")
    image = nibabel.Nifti1Image(np.arange(48, dtype=np.int16).reshape(2, 3, 4, 2), np.eye(4))
    image.header.set_slope_inter(0.5, 10)
    nibabel.save(image, tmp_path / "a.nii.gz")
    again = np.asarray(nibabel.load(tmp_path / "a.nii.gz").get_fdata())
    series = open_series(tmp_path / "a.nii.gz")
    assert series.dtype == np.float32
    assert np.array_equal(stack_values(list(series))[..., 0], again.T)


def test_one_moment_at_a_time_is_in_memory(tmp_path: Path) -> None:
    """The frames of a long series are made and read one by one: earlier ones are freed."""
    made_before: list[weakref.ref[Channels]] = []

    def moments() -> Iterator[Channels]:
        for k in range(6):
            assert [k for k, moment in enumerate(made_before) if moment() is not None] == []
            channels = Channels.from_array(np.full((3, 4, 5, 1), k, np.uint8))
            made_before.append(weakref.ref(channels))
            yield channels
            del channels

    write_series(moments(), tmp_path / "a.nrrd", 6)
    assert len(made_before) == 6
    with pytest.raises(DeformError, match=r"one moment of it needs 60 bytes.*limit is 50 bytes"):
        open_series(tmp_path / "a.nrrd", max_bytes=50)
    assert [int(channels.values.max()) for channels in open_series(tmp_path / "a.nrrd", max_bytes=60)] == [*range(6)]


@pytest.mark.parametrize(("count", "said"), [(2, "more moments"), (4, "only 3 of the 4")])
def test_a_number_of_moments_that_is_wrong_leaves_no_file(count: int, said: str, tmp_path: Path) -> None:
    with pytest.raises(DeformError, match=said):
        write_series(sample_series("channels", 1, 3), tmp_path / "a.nrrd", count)
    assert list(tmp_path.iterdir()) == []


def test_moments_must_be_alike_and_writing_can_be_cancelled(tmp_path: Path) -> None:
    with pytest.raises(DeformError, match="moment 2 is not like the first"):
        write_series([*sample_series("channels", 1, 1), *sample_series("channels", 2, 1)], tmp_path / "a.mha", 2)

    def stop(share: float) -> None:
        raise Cancelled(f"at {share}")

    with pytest.raises(Cancelled):
        write_series(sample_series("channels", 1, 3), tmp_path / "a.nrrd", 3, progress=stop)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", [".png", ".webp", ".jpg"])
def test_a_photograph_keeps_its_colours(suffix: str, tmp_path: Path) -> None:
    values = np.zeros((16, 24, 3), np.uint8)
    values[:, :12], values[:, 12:] = (200, 30, 10), (10, 90, 220)
    photo = Channels.from_array(values, kind="rgb")
    write_channels(photo, tmp_path / f"a{suffix}")
    back = read_channels(tmp_path / f"a{suffix}")
    assert back.kind == "rgb"
    # JPEG rounds its cosines: grey levels by a few at the edge of a colour.
    assert np.abs(back.values.astype(int) - photo.values).max() <= (6 if suffix == ".jpg" else 0)
    grey = read_volume(tmp_path / f"a{suffix}")
    assert np.abs(grey.values.astype(int) - photo.brightness().values).max() <= (6 if suffix == ".jpg" else 1)


@pytest.mark.parametrize(
    ("values", "kind", "name", "said"),
    [
        (np.zeros((2, 4, 5, 3), np.uint8), "rgb", "a.png", "one slice"),
        (np.zeros((4, 5, 3), np.uint16), "rgb", "a.png", "8 bits"),
        (np.zeros((4, 5, 4), np.uint8), "rgba", "a.jpg", "no transparency"),
        (np.zeros((4, 5, 2), np.uint8), "channels", "a.png", "parts of a colour"),
        (np.zeros((4, 5, 3), np.uint8), "rgb", "a.vti", r"written to \.nrrd"),
        (np.zeros((4, 5, 3), np.uint8), "rgb", "a.nhdr", r"written to \.nrrd"),
        (np.zeros((4, 5, 3), np.float32), "rgb", "a.nii", "are bytes"),
    ],
)
def test_what_a_format_cannot_hold_is_refused(
    values: NDArray[np.uint8], kind: str, name: str, said: str, tmp_path: Path
) -> None:
    with pytest.raises(DeformError, match=said):
        write_channels(Channels.from_array(values, kind=kind), tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_a_damaged_description_of_channels_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "a.nrrd"
    write_channels(sample_series("channels", 2, 1)[0], path)
    data = path.read_bytes()
    for wrong in (b'{"kind": "rgb", "names": 4}', b"[" * 900, b'{"kind": "rgb", "names": [], "colours": [[1]]}'):
        path.write_bytes(data.replace(data[data.index(b"{") : data.index(b"}") + 1], wrong))
        assert read_channels(path).names == ("channel 1", "channel 2")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_channels_of_our_own_are_no_vectors(suffix: str, tmp_path: Path) -> None:
    write_channels(sample_series("channels", 2, 1)[0], tmp_path / f"a{suffix}")
    assert "the file holds 2 channels" in " ".join(describe_file(tmp_path / f"a{suffix}").notes)


@pytest.mark.parametrize("suffix", [".nrrd", ".nii.gz"])
def test_vectors_of_another_program_are_called_so(suffix: str, tmp_path: Path) -> None:
    sitk = pytest.importorskip("SimpleITK")
    vectors = sitk.GetImageFromArray(np.zeros((3, 4, 5, 3), np.float32), isVector=True)
    sitk.WriteImage(vectors, str(tmp_path / f"a{suffix}"))
    assert "the file holds vectors of 3 components" in " ".join(describe_file(tmp_path / f"a{suffix}").notes)
    assert len(read_channels(tmp_path / f"a{suffix}").volumes) == 3
