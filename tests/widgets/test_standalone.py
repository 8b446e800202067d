"""The web page without a kernel: the content of the file, and texts that cannot end an element."""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deformnb.datasets import PHANTOMS
from deformnb.document.deformation import Deformation, Step
from deformnb.document.json_format import from_json
from deformnb.errors import DeformError, VolumeFileError
from deformnb.imaging.projection import project
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets import standalone
from deformnb.widgets.editor.editor import Editor, picture_png
from deformnb.widgets.standalone import standalone_html, write_standalone
from deformnb.widgets.textures import field_textures
from deformnb.widgets.view.live_view import LiveView

GRID = Grid((20, 16, 24), (1.5, 2.0, 1.0), (5.0, -7.0, 30.0))
PLANE = Plane.from_view(GRID, "+y")
EVIL = "</script><script>alert(1)</script><img src=x onerror=alert(2)><!-- \"'&"


class _Elements(HTMLParser):
    """Every element with its attributes, and the text in it."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None], list[str]]] = []
        self.open: list[tuple[str, dict[str, str | None], list[str]]] = []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs), []))
        self.open.append(self.found[-1])

    def handle_endtag(self, tag: str) -> None:
        while self.open and self.open.pop()[0] != tag:
            pass

    def handle_data(self, data: str) -> None:
        for element in self.open:
            element[2].append(data)

    def texts(self, tag: str) -> list[str]:
        return ["".join(parts) for name, _, parts in self.found if name == tag]

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes, _ in self.found if name == tag]


def data_of(page: str) -> dict[str, Any]:
    elements = _Elements(page)
    at = [k for k, a in enumerate(elements.all("script")) if a.get("id") == "dnb-data"]
    assert len(at) == 1
    return dict(json.loads(elements.texts("script")[at[0]]))


def binary(value: dict[str, Any]) -> bytes:
    data = base64.b64decode(value["base64"], validate=True)
    return gzip.decompress(data) if value.get("gzip") else data


def block(grid: Grid = GRID, name: str = "block") -> Volume:
    """Noise with all 256 values, which the page shows as they are."""
    values = np.random.default_rng(1).integers(0, 256, grid.shape).astype(np.uint8)
    values.flat[:2] = 0, 255
    return Volume(values, grid, name)


def points(moved: float = 2.0) -> ControlPoints:
    corners = PLANE.to_plane(GRID.corners())[:, :2]
    low, size = corners.min(axis=0), np.ptp(corners, axis=0)
    source = low + size * np.array([[0.2, 0.2], [0.8, 0.2], [0.8, 0.8], [0.2, 0.8], [0.5, 0.5]])
    return ControlPoints.from_arrays(source, source + np.array([[0, 0]] * 4 + [[moved, moved / 2]]))


def pair(volume: Volume | None = None, **options: Any) -> tuple[Editor, LiveView]:
    volume = volume or block()
    editor = Editor(project(volume, Plane.from_view(volume.grid, "+y")), points())
    view = LiveView(volume, width=320, height=240, **options)
    view.follow(editor, Deformation.from_picture_points(volume.grid, PLANE, points(0.0)).field(volume.grid))
    return editor, view


@pytest.fixture(scope="module")
def page() -> str:
    return standalone_html(*pair(), title="A block", about="of noise")


def test_voxels_picture_points_and_colours_come_back_exactly(page: str) -> None:
    editor, view = pair()
    data = data_of(page)
    voxels = np.zeros(GRID.size, np.uint8)
    for chunk in data["chunks"]:
        piece = np.frombuffer(gzip.decompress(binary(chunk["packed"])), np.uint8)
        if chunk["lag"]:
            piece = np.cumsum(piece.reshape(-1, chunk["lag"]), axis=0, dtype=np.uint8).ravel()
        voxels[chunk["start"] : chunk["start"] + len(piece)] = piece
    np.testing.assert_array_equal(voxels.reshape(GRID.shape), block().values)
    assert data["view"]["volume_info"]["shape"] == [24, 16, 20]
    assert binary(data["view"]["table"]) == view.table
    assert binary(data["editor"]["image"]) == picture_png(editor.picture)[0]  # type: ignore[arg-type]
    assert [p["target"] for p in data["editor"]["points"]] == points().target.tolist()
    assert data["editor"]["settings"]["kernel"] == "wendland_c2"
    # What refers to the editor finds it: the model is known to the page under this name.
    assert data["view"]["editor"] == "IPY_MODEL_editor"


def test_the_field_is_that_of_the_view_but_for_what_the_page_fits_itself() -> None:
    editor, view = pair()
    other = Deformation((Step((points(3.0), points(0.0)), PLANE, extrusion="interpolate", knots=(0.0, 1.0)),))
    turned = ControlPoints.from_arrays(GRID.corners()[:4], GRID.corners()[:4] + np.array([0.0, 1.5, 0.5]))
    both = Deformation.from_space_points(turned, trend="none", support=30.0).then(other.steps[0])
    view.follow(editor, both.field(GRID), 1)
    message = data_of(standalone_html(editor, view))["field"]
    planar, space = message["content"]["planar"], message["content"]["space"]
    maps, weights, samples = (np.frombuffer(binary(b), "<f4") for b in message["buffers"])
    now = both.with_step(1, other.steps[0].with_points(points(), 1))  # the editor's points have gone on since
    fresh = field_textures(now.field(GRID), view.source.voxels, None, 192, 48)  # type: ignore[arg-type]
    expected = [np.frombuffer(b, "<f4") for b in fresh.buffers]
    halves = maps.reshape(2, -1), expected[0].reshape(2, -1)
    assert np.abs(halves[1][0]).max() > 1
    assert np.abs(halves[0][0] - halves[1][0]).max() < 0.01  # a hundredth of a voxel's width of 1
    assert not halves[0][1].any()
    np.testing.assert_array_equal(weights, expected[1])
    assert np.abs(expected[2]).max() > 0.5
    assert np.abs(samples - expected[2]).max() < 0.01
    assert (planar, space) == (fresh.content.planar, fresh.content.space)
    assert data_of(standalone_html(editor, view))["view"]["editor_map"] == 1


def test_a_view_that_follows_nobody_is_linked_to_the_editor() -> None:
    editor, _ = pair()
    data = data_of(standalone_html(editor, LiveView(block(), width=320, height=240)))
    assert data["view"]["editor"] == "IPY_MODEL_editor"
    assert data["field"]["content"]["planar"]["isReplicated"] is True


def test_the_picture_alone_needs_no_view() -> None:
    editor, _ = pair()
    page = standalone_html(editor, about="no volume")
    data = data_of(page)
    assert (data["view"], data["chunks"], data["field"]) == (None, [], None)
    assert "new RayCaster" not in page
    assert "new RayCaster" in standalone_html(*pair())
    steps = from_json(json.dumps(data["document"])).steps
    assert steps == (editor.step(),)


def test_the_same_input_makes_the_same_bytes(page: str) -> None:
    again = standalone_html(*pair(), title="A block", about="of noise")
    assert again == page
    assert standalone_html(*pair(), title="A block", about="of signal") != page


def test_nothing_breaks_out_of_its_place() -> None:
    editor, view = pair(block(name=EVIL))
    editor.points = editor.points.edit(0, name=EVIL)
    editor.label = EVIL
    page = standalone_html(editor, view, title=EVIL, about=EVIL)
    elements, data = _Elements(page), data_of(page)
    assert [a.get("type") for a in elements.all("script")] == ["application/json", "module", "module", "module"]
    (image,) = elements.all("img")
    assert set(image) == {"class", "alt", "src"}
    assert image["src"] is not None
    assert image["src"].startswith("data:image/png;base64,iVBOR")
    assert elements.texts("title") == [EVIL]
    assert elements.texts("h1") == [EVIL]
    assert "".join(elements.texts("p")).startswith(EVIL)
    assert data["editor"]["points"][0]["name"] == EVIL
    assert data["view"]["label"] == f"Volume {EVIL}"
    assert not any(name.startswith("on") for _, attributes, _ in elements.found for name in attributes)


def test_half_a_surrogate_pair_in_a_name_is_no_reason_to_fail(tmp_path: Path) -> None:
    editor, view = pair()
    write_standalone(tmp_path / "page.html", editor, view, title="carp \ud83d", about="\ud83d")
    assert "<title>carp ?</title>" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_the_policy_knows_every_script_and_allows_no_network(page: str) -> None:
    elements = _Elements(page)
    (policy,) = (a["content"] for a in elements.all("meta") if a.get("http-equiv") == "Content-Security-Policy")
    assert policy is not None
    rules = dict(rule.split(" ", 1) for rule in policy.split("; "))
    assert rules["default-src"] == "'none'"
    assert rules["img-src"] == "data: blob:"
    assert set(rules) == {"default-src", "script-src", "style-src", "img-src", "base-uri", "form-action"}
    scripts = zip(elements.texts("script"), elements.all("script"), strict=True)
    digests = [
        f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
        for text, a in scripts
        if a["type"] == "module"
    ]
    assert rules["script-src"].split() == digests
    assert len(digests) == 3
    # Nothing refers to anything outside of the file.
    assert elements.all("link") == []
    assert not re.search(r"@import|url\((?!['\"]?data:)", "".join(elements.texts("style")))


def test_a_volume_beyond_the_limit_is_reduced_and_the_page_says_so() -> None:
    editor, view = pair()
    page = standalone_html(editor, view, limit=1000)
    info = data_of(page)["view"]["volume_info"]
    assert np.prod(info["shape"]) <= 1000
    assert info["note"].startswith("shown at")
    assert f"{' x '.join(map(str, info['shape']))} voxels, reduced from 24 x 16 x 20" in page
    assert "24 x 16 x 20 voxels. This file" in standalone_html(editor, view)


@pytest.mark.nightly
def test_a_phantom_of_128_voxels_along_each_side_is_little_more_than_a_megabyte() -> None:
    volume = PHANTOMS["fish"].make((128, 128, 128))
    editor = Editor(project(volume, Plane.from_view(volume.grid, "-x")))
    page = standalone_html(editor, LiveView(volume))
    assert 300_000 < len(page) < 1_250_000  # 0.55 of it are the scripts


def test_nothing_of_the_file_but_the_name_of_the_volume_is_in_the_page(tmp_path: Path) -> None:
    path = tmp_path / "secret folder" / "page.html"
    path.parent.mkdir()
    editor, view = pair(block(name="knee"))
    write_standalone(path, editor, view)
    text = path.read_text(encoding="utf-8")
    assert text == standalone_html(editor, view)
    assert "<title>knee</title>" in text
    assert str(tmp_path) not in text
    assert "secret" not in text
    for own in (editor.uid, editor.model_id, view.model_id, view.volume_info["id"]):
        assert own not in text
    assert [p.name for p in path.parent.iterdir()] == ["page.html"]


def test_writing_says_what_stands_in_the_way(tmp_path: Path) -> None:
    editor, _ = pair()
    with pytest.raises(VolumeFileError, match="there is no folder"):
        write_standalone(tmp_path / "none" / "page.html", editor)
    (tmp_path / "page.html").write_text("mine", encoding="utf-8")
    with pytest.raises(VolumeFileError, match="overwrite is False"):
        write_standalone(tmp_path / "page.html", editor, overwrite=False)
    assert (tmp_path / "page.html").read_text(encoding="utf-8") == "mine"


def test_the_document_is_the_one_that_the_editor_makes() -> None:
    editor, view = pair()
    document = from_json(json.dumps(data_of(standalone_html(editor, view, title="bent"))["document"]))
    assert document.name == "bent"
    assert document.steps == (editor.step(),)
    assert document.volume is not None
    assert document.volume.matches(block())
    half = Deformation.from_picture_points(GRID, PLANE, points(), extrusion="modulate", curve=(0.0, 1.0, 0.5))
    view.follow(editor, half.field(GRID))
    (step,) = from_json(json.dumps(data_of(standalone_html(editor, view))["document"])).steps
    assert (step.extrusion, step.curve) == ("modulate", (0.0, 1.0, 0.5))
    two = Deformation((Step((points(), points()), PLANE, extrusion="interpolate", knots=(0.0, 1.0)),))
    view.follow(editor, two.field(GRID))
    assert data_of(standalone_html(editor, view))["document"] is None  # the other points are not the editor's


def test_a_page_has_the_controls_and_about_the_bytes_that_are_wanted(monkeypatch: pytest.MonkeyPatch) -> None:
    editor, view = pair()
    monkeypatch.setattr(standalone, "MOST_BYTES", 4000)
    data = data_of(standalone_html(editor, view, controls=("clip", "strength")))
    assert data["controls"] == ["strength", "clip"]
    assert sum(len(chunk["packed"]["base64"]) for chunk in data["chunks"]) <= 4000
    assert np.prod(data["view"]["volume_info"]["shape"]) > 1000
    assert len(data["cut_off"]["sides"]) == 6


def test_what_cannot_be_put_on_a_page_is_said() -> None:
    editor, view = pair()
    with pytest.raises(DeformError, match="no control 'zoom'; there are strength, kernel"):
        standalone_html(editor, view, controls=("strength", "zoom"))
    with pytest.raises(DeformError, match="follows another editor"):
        standalone_html(Editor(editor.picture), view)
    with pytest.raises(DeformError, match="shows no volume yet"):
        standalone_html(editor, LiveView())
    with pytest.raises(DeformError, match="has no plane in space"):
        standalone_html(Editor(None, points()), LiveView(block()))
    view.show_deformation(
        Deformation.from_space_points(ControlPoints.from_arrays(GRID.corners(), GRID.corners() * 1.01))
    )
    with pytest.raises(DeformError, match="another deformation since"):
        standalone_html(editor, view)
