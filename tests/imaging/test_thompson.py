"""Two grids side by side: the numbers that are drawn against known maps, and the content of the files."""

from __future__ import annotations

import io
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import oracle
import pytest
from imaging.test_figures import at, near, pixels

from deformnb.document.deformation import Deformation, Step
from deformnb.errors import DeformError
from deformnb.imaging.drawing import SOURCE, TARGET
from deformnb.imaging.projection import project
from deformnb.imaging.thompson import area_map, draw_grids, magnify_field, make_grids
from deformnb.rbf.cuts import Cut
from deformnb.rbf.fields import Identity
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Line
from deformnb.volume.plane import Picture, Plane, Raster
from deformnb.volume.volume import Grid, Volume

GRID = Grid((40, 8, 60))
PLANE = Plane.from_view(GRID, "+y")
SVG = "{http://www.w3.org/2000/svg}"
CORNERS = [[0, 0], [59, 0], [0, 39], [59, 39]]


@pytest.fixture(scope="module")
def picture() -> Picture:
    z, _, x = np.mgrid[:40, :8, :60]
    body = ((z - 20) / 14) ** 2 + ((x - 30) / 22) ** 2 < 1
    return project(Volume((200 * body).astype(np.uint8), GRID), PLANE)


def affine(*rows: tuple[float, float]) -> ControlPoints:
    """Points that are taken to A (p - middle) + middle by the affine trend alone."""
    source, middle = np.array(CORNERS, dtype=float), np.array([29.5, 19.5])
    return ControlPoints.from_arrays(source, (source - middle) @ np.array(rows).T + middle)


def step_of(points: ControlPoints, **options: Any) -> Step:
    return Step((points,), PLANE, **options)


BENT = ControlPoints.from_arrays(
    [*CORNERS, [20, 20], [40, 20]], [*CORNERS, [15, 17], [46, 23]], names=["", "", "", "", "left eye", ""]
)


# ---- numbers ---------------------------------------------------------------------------------------------------------


def test_twice_as_long_and_half_as_high_again_is_three_times_the_area_everywhere(picture: Picture) -> None:
    figure = draw_grids(step_of(affine((2, 0), (0, 1.5))), picture, overlay="area")
    grids = figure.grids
    oracle.assert_close(grids.strain().area, np.full(grids.nodes.shape[:2], 3.0), atol=1e-6)
    oracle.assert_close(area_map(grids.field, picture.raster), np.full((40, 60), 3.0), atol=1e-6)
    oracle.assert_close(grids.strain().principal, np.broadcast_to([2.0, 1.5], grids.nodes.shape), atol=1e-6)


def test_a_shear_stretches_along_the_axes_of_its_ellipse(picture: Picture) -> None:
    shear = np.array([[1.0, 0.8], [0.0, 1.0]])
    strain = draw_grids(step_of(affine(*shear.tolist())), picture, overlay="strain").grids.strain()
    long, short = (0.8 + np.sqrt(0.64 + 4)) / 2, (-0.8 + np.sqrt(0.64 + 4)) / 2  # of x -> x + g y
    oracle.assert_close(strain.principal, np.broadcast_to([long, short], strain.principal.shape), atol=1e-6)
    angle = np.arctan2(2 * 0.8, 0.64) / 2  # of the long axis, from F F^T = [[1 + g^2, g], [g, 1]]
    first = strain.directions[..., 0, :]
    oracle.assert_close(np.abs(first @ [np.cos(angle), np.sin(angle)]), np.ones(first.shape[:2]), atol=1e-6)


@pytest.mark.parametrize(("magnify", "factor"), [(0.0, 0.0), (1.0, 1.0), (2.0, 2.0), (-1.0, -1.0), (3.0, 3.0)])
def test_drags_are_magnified_exactly(picture: Picture, magnify: float, factor: float) -> None:
    points = affine((1.1, 0), (0, 1.05))
    grids = draw_grids(step_of(points), picture, magnify=magnify).grids
    expected = np.array([29.5, 19.5]) + (grids.nodes - [29.5, 19.5]) * (1 + factor * np.array([0.1, 0.05]))
    oracle.assert_close(grids.moved, expected, atol=1e-4)
    if magnify == 0:
        oracle.assert_close(
            np.concatenate(grids.after), np.concatenate(make_grids(Identity(2), picture).after), atol=1e-9
        )


def test_points_are_met_again_when_magnified(picture: Picture) -> None:
    grids = draw_grids(step_of(BENT), picture, magnify=1.5).grids
    there = BENT.source + 1.5 * (BENT.target - BENT.source)
    oracle.assert_close(there + grids.field.displacement(there), BENT.source, atol=1e-6)


def test_strength_and_magnify_multiply(picture: Picture) -> None:
    one = draw_grids(step_of(BENT, strength=0.5), picture, magnify=2.0).grids
    oracle.assert_close(one.moved, draw_grids(step_of(BENT), picture).grids.moved, atol=1e-9)


def test_a_field_is_multiplied(picture: Picture) -> None:
    fit = fit_rbf(BENT)
    x = np.array([[10.0, 10.0], [33.0, 21.0]])
    oracle.assert_close(magnify_field(fit, -0.5).displacement(x), -0.5 * fit.displacement(x), atol=0)
    oracle.assert_close(magnify_field(fit, -0.5).jacobian(x), -0.5 * fit.jacobian(x), atol=0)
    assert draw_grids(fit, picture, magnify=0.0).grids.moved == pytest.approx(make_grids(Identity(2), picture).nodes)


def test_nodes_lie_on_cells_of_one_size_and_go_where_their_matter_goes(picture: Picture) -> None:
    grids = draw_grids(step_of(BENT), picture, lines=6).grids
    assert grids.nodes.shape == (5, 7, 2)
    oracle.assert_close(np.diff(grids.nodes[0, :, 0]), np.full(6, 10.0), atol=1e-9)
    assert grids.found.all()
    back = grids.moved + grids.field.displacement(grids.moved)
    oracle.assert_close(back, grids.nodes, atol=1e-3)


def test_the_grid_is_broken_at_a_cut_and_at_a_fold(picture: Picture) -> None:
    cut = Cut(Line([(29.5, 50), (29.5, -9)]))
    pull = ControlPoints.from_arrays([[5, 5], [5, 30], [50, 5], [50, 30]], [[0, 5], [0, 30], [55, 5], [55, 30]])
    whole = draw_grids(step_of(pull), picture, lines=6).grids
    torn = draw_grids(step_of(pull, cuts=(cut,)), picture, lines=6).grids
    assert len(whole.after) == 12  # 5 across, 7 down
    assert len(torn.after) == 12 + 5
    crossing = ControlPoints.from_arrays([*CORNERS, [25, 20], [35, 20]], [*CORNERS, [40, 20], [20, 20]])
    folded = draw_grids(step_of(crossing), picture, lines=6).grids
    longest = max(float(np.linalg.norm(np.diff(line, axis=0), axis=1).max()) for line in folded.after)
    assert len(folded.after) > 12
    assert longest < 10  # no line leaps over the fold


def test_a_deformation_is_its_steps_one_after_the_other(picture: Picture) -> None:
    first, second = step_of(affine((1.2, 0), (0, 1))), step_of(affine((1, 0), (0, 1.3)))
    off = replace(second, enabled=False)
    both = draw_grids(Deformation((first, second, off)), picture, overlay="area").grids
    oracle.assert_close(both.strain().area, np.full(both.nodes.shape[:2], 1.56), atol=1e-6)
    assert draw_grids(Deformation(()), picture).grids.moved == pytest.approx(both.nodes)


# ---- drawing ---------------------------------------------------------------------------------------------------------


def words(figure: Any) -> list[str]:
    return [text.get_text() for text in figure.texts]


def test_growth_is_green_and_shrinkage_purple(picture: Picture) -> None:
    for rows, dominant in ((((1.3, 0), (0, 1.3)), 1), (((0.8, 0), (0, 0.8)), 0)):
        figure = draw_grids(step_of(affine(*rows)), picture, overlay="area", landmarks=False)
        row, column = at(figure, figure.axes[1], (33.4, 21.2))
        red, green, blue = pixels(figure)[row, column]
        assert (green > max(red, blue)) == (dominant == 1)
        assert (min(red, blue) > green) == (dominant == 0)
    still = draw_grids(step_of(affine((1, 0), (0, 1))), picture, overlay="area", landmarks=False)
    both = [pixels(still)[at(still, axes, (33.4, 21.2))] for axes in still.axes]
    assert np.abs(both[0] - both[1]).max() <= 3  # 1 leaves the picture unchanged


def test_the_bar_of_areas_tells_true_numbers(picture: Picture) -> None:
    known = words(draw_grids(step_of(affine((2, 0), (0, 1.5))), picture, overlay="area"))
    assert {"1/4", "1/2", "1", "2", "4"} <= set(known)
    assert {"1/2", "1", "2"} <= set(words(draw_grids(step_of(affine((1.3, 0), (0, 1.3))), picture, overlay="area")))


def test_red_where_the_map_folds(picture: Picture) -> None:
    crossing = ControlPoints.from_arrays([*CORNERS, [25, 20], [35, 20]], [*CORNERS, [40, 20], [20, 20]])
    figure = draw_grids(step_of(crossing), picture, overlay="area", landmarks=False)
    assert any("folds" in text for text in words(figure))
    red, green, blue = pixels(figure)[at(figure, figure.axes[1], (29.1, 20.4))]
    assert red > 1.4 * max(green, blue)


def test_stretched_arms_are_solid_and_pressed_ones_dashed(picture: Picture) -> None:
    figure = draw_grids(step_of(affine((1.2, 0), (0, 0.8))), picture, overlay="strain", lines=6)
    arms = {c.get_gid(): c for c in figure.axes[1].collections if c.get_gid() in ("stretched", "pressed")}
    solid, dashed = (np.array(arms[name].get_segments()) for name in ("stretched", "pressed"))
    assert len(solid) == len(dashed) == 35
    gain = float(re.search(r"\u00d7 ([\d.]+)", next(w for w in words(figure) if w.startswith("arms"))).group(1))
    oracle.assert_close(np.abs(solid[:, 1] - solid[:, 0]), np.tile([10 * gain * 0.2, 0.0], (35, 1)), atol=1e-4)
    oracle.assert_close(np.abs(dashed[:, 1] - dashed[:, 0]), np.tile([0.0, 10 * gain * 0.2], (35, 1)), atol=1e-4)
    assert arms["stretched"].get_linestyle()[0][1] is None
    assert arms["pressed"].get_linestyle()[0][1] is not None
    assert any("stretched by" in w for w in words(figure))
    assert any("pressed by" in w for w in words(figure))


def test_landmarks_with_their_arrows_stand_where_they_are(picture: Picture) -> None:
    figure = draw_grids(step_of(BENT), picture)
    image = pixels(figure)
    row, column = at(figure, figure.axes[1], (46, 23))
    assert near(image[row - 3 : row + 4, column - 3 : column + 4], TARGET).any()
    row, column = at(figure, figure.axes[0], (40, 20))
    assert near(image[row - 5 : row + 6, column - 5 : column + 6], SOURCE, 90).any()
    bare = draw_grids(step_of(BENT), picture, landmarks=False)
    assert len(figure.axes[1].patches) == 2  # of two points that were dragged
    assert len(bare.axes[1].patches) == 0


def test_both_panels_have_one_scale_and_a_bar_of_true_length(picture: Picture) -> None:
    figure = draw_grids(step_of(affine((1.2, 0), (0, 1))), picture, unit="cm")
    scales = [axes.get_window_extent().width / abs(np.subtract(*axes.get_xlim())) for axes in figure.axes]
    oracle.assert_close(scales[0], scales[1], rtol=1e-6)
    (label,) = [w for w in words(figure) if w.endswith(" cm")]
    bar = max(figure.artists + figure.lines, key=lambda line: np.ptp(line.get_xdata()))
    length = np.ptp(bar.get_xdata()) * figure.bbox.width / scales[0]
    oracle.assert_close(length, float(label.split()[0]), rtol=1e-6)


def test_the_title_tells_what_is_known_of_the_fit(picture: Picture) -> None:
    known = words(draw_grids(step_of(BENT, name="A fish $x$"), picture))
    assert known.count("A fish $x$") == 1
    facts = next(w for w in known if "landmarks" in w)
    assert facts.startswith("6 landmarks, ")
    assert "% of the drags affine, bending energy" in facts
    straight = words(draw_grids(step_of(affine((2, 0), (0, 1))), picture))
    assert any("100 % of the drags affine, bending energy" in w for w in straight)
    assert "only this" in words(draw_grids(step_of(BENT), picture, title="only this"))
    assert not any("landmark" in w for w in words(draw_grids(step_of(BENT), picture, title="")))


@pytest.mark.parametrize(
    ("magnify", "said"),
    [(1.0, "deformed"), (2.0, "dragged 2 times"), (0.0, "not dragged"), (-1.0, "opposite direction (\u00d7 \u22121)")],
)
def test_the_caption_tells_the_exaggeration(picture: Picture, magnify: float, said: str) -> None:
    assert any(said in w for w in words(draw_grids(step_of(BENT), picture, magnify=magnify)))


def test_coloured_pictures_and_dark_sheets_are_drawn_too(picture: Picture) -> None:
    grey = picture.grey()
    rgba = np.stack([grey, grey, 0 * grey, grey], axis=-1)
    coloured = Picture(rgba, picture.plane, picture.raster, "composite", (0.0, 1.0))
    for style in ("paper", "dark"):
        figure = draw_grids(step_of(BENT), coloured, style=style, overlay="area")
        red, _, blue = pixels(figure)[at(figure, figure.axes[0], (32.3, 21.0))]
        assert red > blue + 100  # yellow


# ---- files -----------------------------------------------------------------------------------------------------------


def test_svg_keeps_words_and_lines_and_embeds_two_pictures(picture: Picture) -> None:
    figure, stream = draw_grids(step_of(BENT, name="A fish"), picture, overlay="strain"), io.BytesIO()
    figure.savefig(stream, format="svg")
    root = ET.fromstring(stream.getvalue())
    texts = ["".join(t.itertext()) for t in root.iter(f"{SVG}text")]
    assert "A fish" in texts
    assert "original" in texts
    assert len(list(root.iter(f"{SVG}image"))) == 2
    grids = [g for g in root.iter(f"{SVG}g") if g.get("id") == "grid"]
    assert len(list(root.iter(f"{SVG}path"))) > 40
    assert all(list(g.iter(f"{SVG}path")) for g in grids)
    assert grids


def test_png_pdf_and_svg_are_written_whole(picture: Picture, tmp_path: Path) -> None:
    for suffix, begins in ((".png", b"\x89PNG"), (".pdf", b"%PDF"), (".svg", b"<?xml")):
        draw_grids(step_of(BENT), picture, path=tmp_path / f"grids{suffix}")
        assert (tmp_path / f"grids{suffix}").read_bytes().startswith(begins)
    assert b"/FontFile2" in (tmp_path / "grids.pdf").read_bytes()  # letters, no outlines
    with pytest.raises(DeformError, match=r"\.png, \.pdf or \.svg"):
        draw_grids(step_of(BENT), picture, path=tmp_path / "grids.gif")


# ---- refusals --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"overlay": "heat"}, "overlay 'heat'"),
        ({"style": "red"}, "style 'red'"),
        ({"magnify": np.nan}, "finite"),
        ({"lines": 0}, "1 to 64"),
        ({"lines": 65}, "1 to 64"),
        ({"lines": 2.5}, "1 to 64"),
    ],
)
def test_what_cannot_be_is_refused_in_words(picture: Picture, options: dict[str, Any], said: str) -> None:
    with pytest.raises(DeformError, match=said):
        draw_grids(step_of(BENT), picture, **options)


def test_only_steps_on_the_plane_of_the_picture_are_drawn(picture: Picture) -> None:
    other = Step((BENT,), Plane.from_view(GRID, "-y"))
    with pytest.raises(DeformError, match="step 2 has its control points on another plane"):
        draw_grids(Deformation((step_of(BENT), other)), picture)
    in_space = ControlPoints.from_arrays([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    with pytest.raises(DeformError, match="in space"):
        draw_grids(Deformation.from_space_points(in_space), picture)
    with pytest.raises(DeformError, match="in space"):
        draw_grids(Identity(3), picture)
    with pytest.raises(DeformError, match="got ControlPoints"):
        draw_grids(BENT, picture)  # type: ignore[arg-type]


def test_what_is_drawn_does_not_depend_on_the_size_of_pixels() -> None:
    raster = Raster((20, 30), (2.0, 2.0), (0.5, 0.5))
    coarse = Picture(np.zeros((20, 30), np.uint8), PLANE, raster, "mip", (0.0, 1.0))
    grids = draw_grids(step_of(affine((1.5, 0), (0, 1))), coarse, lines=6).grids
    assert grids.cell == 10
    oracle.assert_close(np.diff(grids.moved[..., 0], axis=1), np.full((5, 6), 15.0), atol=1e-6)
