"""Drawings: their content, its places, and their files."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import oracle
import pytest
from PIL import Image

from deformnb.errors import DeformError
from deformnb.imaging.drawing import SOURCE, STYLES, TARGET, draw_pictures, save_figure
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Picture, Plane, Raster

PLANE = Plane((0, 0, 0), (1, 0, 0), (0, 0, -1))


def picture(shape: tuple[int, int] = (20, 30), spacing: tuple[float, float] = (1, 1), bright: Any = None) -> Picture:
    values = np.zeros(shape, np.uint8)
    values[bright if bright is not None else (shape[0] // 2, shape[1] // 2)] = 255
    return Picture(values, PLANE, Raster(shape, spacing, (0.0, 0.0)), "mip", (0, 255))


def pixels(figure: Any, tmp_path: Path) -> np.ndarray:
    path = tmp_path / "drawn.png"
    save_figure(figure, path)
    with Image.open(path) as file:
        return np.asarray(file.convert("RGB")).astype(int)


def rgb(color: str) -> list[int]:
    return [int(color[k : k + 2], 16) for k in (1, 3, 5)]


# ---- places ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("style", STYLES)
def test_a_pixel_is_drawn_where_it_lies(style: str, tmp_path: Path) -> None:
    figure = draw_pictures([picture((20, 30), (1.0, 2.0), (slice(2, 5), slice(20, 24)))], style=style)
    image = pixels(figure, tmp_path)
    like_bright = np.abs(image - rgb(STYLES[style].bright)).sum(axis=2) < 60
    rows, columns = np.nonzero(like_bright)
    (axes,) = figure.axes
    height, width = image.shape[:2]
    # Columns 20 to 23 are centred at a = 21.5, rows 2 to 4 with spacing 2 at b = 6.
    x, y = axes.transData.transform((21.5, 6.0)) / figure.bbox.size * (width, height)
    oracle.assert_close([columns.mean(), height - rows.mean()], [x, y], atol=3)  # printed pixels; one of ours is 47


def test_one_picture_fills_its_figure() -> None:
    figure = draw_pictures([picture((20, 40))])
    (axes,) = figure.axes
    box = axes.get_position()
    assert box.width > 0.95
    assert box.height > 0.9
    width, height = figure.get_size_inches() * (box.width, box.height)
    assert width / height == pytest.approx(np.diff(axes.get_xlim())[0] / -np.diff(axes.get_ylim())[0])


@pytest.mark.parametrize(
    "shapes",
    [
        [(20, 30)],
        [(20, 30)] * 2,
        [(30, 20)] * 2,
        [(10, 90), (40, 70)],
        [(90, 10), (30, 30)],
        [(5, 5)] * 5,
        [(1, 200)] * 3,
        [(200, 1), (1, 1)],
    ],
)
@pytest.mark.parametrize("titled", ["", "a title"])
def test_pictures_and_titles_do_not_overlap_and_share_one_scale(shapes: list[tuple[int, int]], titled: str) -> None:
    titles = [titled] * len(shapes) if titled else None
    figure = draw_pictures([picture(s) for s in shapes], titles=titles)
    figure.draw_without_rendering()
    inches = figure.get_size_inches()
    boxes = [axes.get_tightbbox() for axes in figure.axes]
    assert len(boxes) == len(shapes)
    for one, two in itertools.combinations(boxes, 2):
        assert one.x1 <= two.x0 + 1 or two.x1 <= one.x0 + 1 or one.y1 <= two.y0 + 1 or two.y1 <= one.y0 + 1
    whole = figure.bbox
    for box in boxes:
        assert box.x0 >= -1
        assert box.y0 >= -1
        assert box.x1 <= whole.x1 + 1
        assert box.y1 <= whole.y1 + 1
    scales = [(axes.get_position().width * inches[0]) / np.diff(axes.get_xlim())[0] for axes in figure.axes]
    assert max(scales) == pytest.approx(min(scales))
    assert max(inches) < 7.5 * len(shapes) + 1


def test_wide_pictures_are_stacked_and_tall_ones_stand_side_by_side() -> None:
    wide = [axes.get_position() for axes in draw_pictures([picture((20, 60))] * 2).axes]
    assert wide[0].y0 >= wide[1].y1
    tall = [axes.get_position() for axes in draw_pictures([picture((60, 20))] * 2).axes]
    assert tall[0].x1 <= tall[1].x0


def test_grids_beyond_the_picture_are_shown(tmp_path: Path) -> None:
    grid = [np.array([[-10.0, -15.0], [45.0, -15.0]]), np.array([[-10.0, -15.0], [-10.0, 40.0]])]
    figure = draw_pictures([picture(), picture()], grids=[grid, []])
    first, second = figure.axes
    assert first.get_xlim()[0] < -10
    assert first.get_xlim()[1] > 45
    assert first.get_ylim()[0] > 40  # down the picture
    assert first.get_ylim()[1] < -15
    assert second.get_xlim()[0] > -2
    drawn = np.abs(pixels(figure, tmp_path) - rgb(STYLES["paper"].grid)).sum(axis=2) < 40
    assert drawn.any()
    assert [line.get_xydata().tolist() for line in first.lines] == [n.tolist() for n in grid]


def test_control_points_are_arrows_from_source_to_target(tmp_path: Path) -> None:
    points = ControlPoints.from_arrays([[5, 5], [20, 10]], [[15, 5], [20, 10]])
    figure = draw_pictures([picture(), picture()], points=[points, None])
    first, second = figure.axes
    assert len(first.texts) == 1  # the second point rests where it is: no arrow
    assert len(second.texts) == 0
    assert tuple(first.texts[0].xy) == (15, 5)
    assert first.texts[0].xyann == (5, 5)
    drawn = pixels(figure, tmp_path)
    for color in (SOURCE, TARGET):
        assert (np.abs(drawn - rgb(color)).sum(axis=2) < 60).any()


@pytest.mark.parametrize("style", STYLES)
def test_coloured_pictures_lie_on_the_dark_end(style: str, tmp_path: Path) -> None:
    values = np.zeros((20, 30, 4), np.float32)
    values[5:15, 10:20] = [1.0, 0.0, 0.0, 1.0]
    colored = Picture(values, PLANE, Raster((20, 30), (1, 1), (0, 0)), "composite", (0, 1))
    image = pixels(draw_pictures([colored], style=style), tmp_path)
    assert (np.abs(image - [255, 0, 0]).sum(axis=2) < 10).any()
    assert (np.abs(image - rgb(STYLES[style].dark)).sum(axis=2) < 10).mean() > 0.5


# ---- texts -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "title",
    ["carp", "costs $5 and $6", r"$\frac{1}{0$", "鯉 カープ", "two\nlines", "<script>", "x" * 300, "\x1b[31mred", ""],
)
@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
@pytest.mark.filterwarnings("ignore:Glyph")  # outside of save_figure, which is quiet about them
def test_titles_are_shown_as_they_are(title: str, suffix: str, tmp_path: Path) -> None:
    figure = draw_pictures([picture()], titles=[title], path=tmp_path / f"a.{suffix}")
    text = figure.axes[0].get_title()
    assert text.isprintable()
    assert text[:10] == title[:10].replace("\n", "\\n").replace("\x1b", "\\x1b")[:10]
    figure.draw_without_rendering()
    box = figure.axes[0].title.get_window_extent()
    assert box.x0 >= 0
    assert box.x1 <= figure.bbox.x1


# ---- files -----------------------------------------------------------------------------------------------------------

STARTS = {"png": b"\x89PNG", "pdf": b"%PDF", "svg": b"<?xml"}


@pytest.mark.parametrize("suffix", STARTS)
@pytest.mark.parametrize("name", ["a", "with spaces and é", "two.dots", "UPPER"])
def test_the_suffix_decides_the_kind_of_file(suffix: str, name: str, tmp_path: Path) -> None:
    path = tmp_path / f"{name}.{suffix.upper() if name == 'UPPER' else suffix}"
    draw_pictures([picture()], path=path)
    assert path.read_bytes().startswith(STARTS[suffix])
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("name", ["a.jpg", "a", "a.png.txt", ".png", "png"])
def test_other_kinds_are_refused_before_anything_is_drawn(name: str, tmp_path: Path) -> None:
    with pytest.raises(DeformError, match=r"written as \.png, \.pdf or \.svg"):
        draw_pictures([picture()], path=tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_a_failing_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(b"old")
    figure = draw_pictures([picture()])

    def fail(*_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(figure, "savefig", fail)
    with pytest.raises(DeformError, match="full"):
        save_figure(figure, path)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(DeformError, match="no folder"):
        draw_pictures([picture()], path=tmp_path / "missing" / "a.png")


def test_pyplot_knows_nothing_of_it() -> None:
    import matplotlib.pyplot as plt

    before = plt.get_fignums()
    draw_pictures([picture()])
    assert plt.get_fignums() == before


# ---- choices ---------------------------------------------------------------------------------------------------------


def test_an_unknown_style_lists_the_styles() -> None:
    with pytest.raises(DeformError, match=r"unknown style 'neon'.*paper, dark"):
        draw_pictures([picture()], style="neon")


def test_nothing_to_draw_is_said() -> None:
    with pytest.raises(DeformError, match="no picture"):
        draw_pictures([])


@pytest.mark.parametrize("options", [{"titles": ["a"]}, {"grids": [[], [], []]}, {"points": [None]}])
def test_as_many_of_each_as_pictures(options: dict[str, Any]) -> None:
    with pytest.raises(DeformError, match="2 pictures but"):
        draw_pictures([picture(), picture()], **options)
