"""The page without Python that opens a file of one's own: what it saves, Python applies with the same result."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser.pane_messages import message_script
from browser.test_editor_touch import Fingers
from browser.test_standalone_page import EDITOR, GRID, MODELS, VIEW, Opened, bar_with_a_ball
from PIL import Image
from scipy.ndimage import map_coordinates
from volume_bytes import nrrd

from deformnb.cli.main import main
from deformnb.datasets import PHANTOMS, thompson_grid, thompson_map
from deformnb.document.json_format import from_json
from deformnb.io import read_volume, write_volume
from deformnb.io.documents import read_deformation
from deformnb.session.inputs import best_view
from deformnb.volume.volume import Volume
from deformnb.widgets.file_pages import write_file_page

pytestmark = pytest.mark.needs_browser

DROP = """([name, text]) => {
  const data = new DataTransfer(), bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  data.items.add(new File([bytes], name));
  document.body.dispatchEvent(new DragEvent("drop", { dataTransfer: data, bubbles: true, cancelable: true }));
}"""
ALERT = "document.querySelector('.dnb-page-alert').textContent"
# Both sides solve the same system in float64; this is what a page is held to.
CLOSE = 1e-6


class FilePage(Opened):
    """The page in a browser that has no network."""

    def drop(self, path: Path) -> None:
        self.wait("document.body.opener")
        self.page.evaluate(DROP, [path.name, base64.b64encode(path.read_bytes()).decode()])

    def open(self, path: Path) -> None:
        name = path.name.split(".")[0]
        self.drop(path)
        self.wait(
            f"document.querySelector('.dnb-page-words').textContent.startsWith('{name}: ') && "
            "!document.body.opener.work"
        )
        self.wait_settled()

    def save(self, button: str, path: Path) -> Path:
        with self.page.expect_download() as download:
            self.page.get_by_role("button", name=button).click()
        download.value.save_as(path)
        return path


@pytest.fixture
def open_page(browser: Any, tmp_path: Path) -> Iterator[Callable[..., FilePage]]:
    pages: list[FilePage] = []

    def make(size: tuple[int, int] = (940, 700), **options: Any) -> FilePage:
        path = tmp_path / "page.html"
        if not path.exists():
            write_file_page(path)
        pages.append(FilePage(browser, path, size, "", accept_downloads=True, **options))
        return pages[-1]

    yield make
    for page in pages:
        page.context.close()
        assert page.errors == []
        assert [url.split(":")[0] for url in page.requests if not url.startswith(("blob:", "data:"))] == ["file"]


def check_replay(page: FilePage, path: Path, session: Path, folder: Path) -> None:
    """Python's result is that of the page's own displacements, looked up by SciPy."""
    volume, document = read_volume(path), read_deformation(session)
    assert document.difference(volume) == ""
    plane = document.steps[0].plane
    assert plane is not None
    indices = np.stack(np.indices(volume.shape)[::-1], axis=-1)
    places = volume.grid.index_to_point(indices.astype(float))
    flat = np.unique(plane.to_plane(places)[..., :2].reshape(-1, 2).round(9), axis=0)
    moves = np.array(page.js(f"{MODELS}.displacements({flat.tolist()})"))
    assert np.abs(moves).max() > 1
    field = document.field(volume.grid)
    in_space = field.displacement(plane.from_plane(flat))
    np.testing.assert_allclose(in_space, moves @ plane.frame[:2], rtol=0, atol=CLOSE)
    assert main(["replay", str(session), str(path), "--out", str(folder)]) == 0
    result = read_volume(folder / path.name)
    order = {tuple(place): k for k, place in enumerate(flat.tolist())}
    at = plane.to_plane(places)[..., :2].reshape(-1, 2).round(9).tolist()
    moved = moves[[order[tuple(place)] for place in at]].reshape(*volume.shape, 2) @ plane.frame[:2]
    sources = volume.grid.point_to_index(places + moved)
    last = np.array(volume.shape[::-1]) - 1
    inside = ((sources > 0) & (sources < last) | (last == 0)).all(axis=-1)
    assert inside.mean() > 0.5
    expected = map_coordinates(volume.values.astype(float), sources[inside][:, ::-1].T, order=1)
    rounding = 0.5 if volume.dtype.kind == "u" else 0.0
    np.testing.assert_allclose(result.values[inside], expected, rtol=0, atol=rounding + CLOSE * np.ptp(volume.values))


def test_a_session_of_the_page_gives_the_same_volume_in_python(
    open_page: Callable[..., FilePage], tmp_path: Path
) -> None:
    ball = bar_with_a_ball()
    path = tmp_path / "ball.nii.gz"
    write_volume(Volume(ball.values.astype(np.float64), GRID), path)
    page = open_page()
    page.open(path)
    page.wait(f"{VIEW}.caster?.isReady && {VIEW}.field")
    a0, a1, b0, b1 = page.js(f"({EDITOR}.picture.painter.source.box)")
    middle = (a0 + a1) / 2, (b0 + b1) / 2
    view, box = page.js(f"({EDITOR}.viewport.view)"), page.page.locator(".dnb-ed-stage").bounding_box()
    page.page.mouse.dblclick(box["x"] + view["k"] * middle[0] + view["x"], box["y"] + view["k"] * middle[1] + view["y"])
    page.wait(f"{MODELS}.editor.get('points').length === 5")
    page.drag(middle, (30, -20))
    assert np.abs(page.points().displacement).max() > 1
    session = page.save("Download session", tmp_path / "session.json")
    check_replay(page, path, session, tmp_path / "out")
    # A bad file says what is wrong and leaves all as it is.
    bad = tmp_path / "bad.nrrd"
    bad.write_bytes(nrrd(np.zeros((2, 3, 4), np.int16))[:-3])
    before = page.js(f"JSON.stringify({MODELS}.document())")
    page.drop(bad)
    page.wait(f"{ALERT} !== ''")
    assert "cut short" in page.js(ALERT)
    assert page.js(f"JSON.stringify({MODELS}.document())") == before
    # Cuts are in the session too.
    region = {"kind": "line", "vertices": [[a0, middle[1]], [a1, middle[1]]]}
    page.js(f"{MODELS}.editor.update({{ cuts: [{json.dumps({'name': 'a cut', 'enabled': True, 'region': region})}] }})")
    (cut,) = from_json(page.js(f"JSON.stringify({MODELS}.document())")).steps[0].cuts
    assert cut.name == "a cut"
    page.js(f"{MODELS}.editor.update({{ cuts: [] }})")
    # Tissue that leaves the box is reported.
    page.js(
        f"{MODELS}.editor.update({{ points: {EDITOR}.points.list.map((p) => "
        "({ ...p, target: [p.source[0] + 30, p.source[1] - 25] })) })"
    )
    page.wait_settled()
    page.volume()
    page.wait(f"{message_script('.dnb-editor')}.startsWith('Tissue leaves the box')")
    # Closed by mistake: the same file comes back with its points.
    kept = page.js(f"{MODELS}.editor.get('points')")
    other = page.context.new_page()
    other.goto(page.page.url)
    page.page = other
    page.open(path)
    assert page.js(f"{MODELS}.editor.get('points')") == kept


@pytest.mark.nightly
def test_a_picture_is_deformed_by_a_finger_on_a_phone(open_page: Callable[..., FilePage], tmp_path: Path) -> None:
    rows, columns = np.mgrid[:60, :80]
    colours = np.stack([3 * columns, 4 * rows, (columns // 8 + rows // 8) % 2 * 200], axis=-1).astype(np.uint8)
    path = tmp_path / "photo.png"
    Image.fromarray(colours).save(path)
    page = open_page((390, 844), has_touch=True)
    page.open(path)
    assert page.js("document.documentElement.scrollWidth <= innerWidth")
    view, box = page.js(f"({EDITOR}.viewport.view)"), page.page.locator(".dnb-ed-stage").bounding_box()
    corner = box["x"] + view["k"] * 79 + view["x"], box["y"] + view["k"] * 59 + view["y"]
    Fingers(page.page).drag(corner, (-60, -40))
    page.wait_settled()
    assert np.abs(page.points().displacement).max() > 5
    check_replay(page, path, page.save("Download session", tmp_path / "session.json"), tmp_path / "out")
    saved = Image.open(io.BytesIO(page.save("Download picture", tmp_path / "after.png").read_bytes()))
    assert saved.size == (80, 60)
    assert np.abs(np.asarray(saved.convert("RGB")).astype(int) - colours).mean() > 5
    page.page.select_option("select[name=shows]", "wipe")
    page.wait(f"{EDITOR}.model.get('shows') === 'wipe'")


EMPTY = {
    "zeros": (np.zeros((6, 7, 8), np.int16), "every voxel has the value 0"),
    "tenths": (np.full((6, 7, 8), 0.1, np.float32), "every voxel has the value 0.1"),
    "nan": (np.full((6, 7, 8), np.nan, np.float32), "no voxel is a finite number"),
}


@pytest.mark.parametrize("name", EMPTY)
def test_a_volume_in_which_nothing_is_seen_says_so_and_what_to_do(
    open_page: Callable[..., FilePage], tmp_path: Path, name: str
) -> None:
    values, why = EMPTY[name]
    write_volume(Volume.from_array(values), tmp_path / f"{name}.nii.gz")
    page = open_page()
    page.open(tmp_path / f"{name}.nii.gz")
    alert = page.page.get_by_role("alert").filter(visible=True)
    (note,) = (note for note in read_volume(tmp_path / f"{name}.nii.gz").notes if "nothing to see" in note)
    assert alert.inner_text() == note
    assert note.startswith(why)
    # Another file takes its place, and there is nothing to report.
    write_volume(bar_with_a_ball(), tmp_path / "ball.nii.gz")
    page.open(tmp_path / "ball.nii.gz")
    assert alert.count() == 0


def test_the_page_begins_with_a_carp_a_drawing_and_a_file(open_page: Callable[..., FilePage]) -> None:
    page = open_page()
    page.wait("document.querySelectorAll('.dnb-page-card').length === 3")
    cards = page.page.locator(".dnb-page-card")
    # Each has a picture: of the carp and of the drawing, more than the bytes of an even one.
    sizes = "[...document.querySelectorAll('.dnb-page-card-picture')].map((c) => c.toDataURL('image/png').length)"
    page.wait(f"({sizes}).slice(0, 2).every((size) => size > 10000)")
    cards.nth(0).click()
    page.wait_loaded()
    assert not cards.nth(0).is_visible()
    assert page.page.locator("select[name=side]").input_value() == "-x"
    with page.page.expect_file_chooser():
        page.page.get_by_role("button", name="Open a file").click()


def test_a_volume_is_seen_from_the_side_that_a_studio_begins_with(
    open_page: Callable[..., FilePage], tmp_path: Path
) -> None:
    page = open_page()
    for name in ("knee", "lobster", "fish"):
        volume = PHANTOMS[name].make((20, 28, 24))
        write_volume(volume, tmp_path / f"{name}.nii.gz")
        page.open(tmp_path / f"{name}.nii.gz")
        assert page.page.locator("select[name=side]").input_value() == best_view(
            read_volume(tmp_path / f"{name}.nii.gz")
        )


def test_thompsons_grid_turns_his_drawing_into_the_other_and_undo_takes_it_back(
    open_page: Callable[..., FilePage],
) -> None:
    page = open_page()
    page.wait("document.querySelectorAll('.dnb-page-card').length === 3")
    page.page.locator(".dnb-page-card").nth(1).click()
    page.wait_settled()
    before = page.js(f"JSON.stringify({MODELS}.editor.get('points'))")
    page.page.locator("select[name=grids]").select_option(label="Polyprion → Antigonia capros")
    page.wait(f"{MODELS}.editor.get('points').length === 56")
    page.wait_settled()
    source = thompson_grid("Polyprion").nodes
    points = page.points()
    # The grid is where he printed it, on the pixels of the drawing; and it stays in the picture.
    shift = points.source[0] - source[0, 0]
    np.testing.assert_allclose(points.source - shift, source.reshape(-1, 2), atol=1e-9)
    a0, a1, b0, b1 = page.js(f"({EDITOR}.picture.box)")
    assert (points.target.min(axis=0) > (a0 - 1e-9, b0 - 1e-9)).all()
    assert (points.target.max(axis=0) < (a1 + 1e-9, b1 + 1e-9)).all()
    wanted = thompson_map(
        "Polyprion",
        "Antigonia",
        box=(*[f(points.source[:, 0]) for f in (min, max)], *[f(points.source[:, 1]) for f in (min, max)]),
        frame=(a0, a1, b0, b1),
    )
    np.testing.assert_allclose(points.target, wanted.points.target, atol=1e-9)
    page.page.locator("[data-command=undo]").click()
    page.wait(f"JSON.stringify({MODELS}.editor.get('points')) === {json.dumps(before)}")


def test_a_grid_on_the_picture_goes_to_that_on_a_second_drawing(
    open_page: Callable[..., FilePage], tmp_path: Path
) -> None:
    leaf = np.full((120, 200, 3), 255, np.uint8)
    leaf[30:90, 40:160] = 40
    Image.fromarray(leaf).save(tmp_path / "leaf.png")
    second = np.full((200, 120, 3), 255, np.uint8)
    second[40:160, 30:90] = 40
    Image.fromarray(second).save(tmp_path / "second.png")
    page = open_page()
    page.open(tmp_path / "leaf.png")
    page.page.locator("select[name=grids]").select_option("own")
    page.wait("document.querySelectorAll('.dnb-gd-svg').length === 1")
    apply = page.page.get_by_role("button", name="Apply own grids")
    assert apply.is_disabled()
    page.page.locator(".dnb-grid-own input[type=file]").nth(1).set_input_files(tmp_path / "second.png")
    page.wait("document.querySelectorAll('.dnb-gd-svg').length === 2")
    apply.click()
    page.wait(f"{MODELS}.editor.get('points').length === 24")
    points = page.points()
    low, high = points.source.min(axis=0), points.source.max(axis=0)
    np.testing.assert_allclose(low, (40, 30), atol=4)  # around the leaf
    np.testing.assert_allclose(high, (159, 89), atol=4)
    wide, tall = np.ptp(points.target, axis=0)
    assert tall > 1.8 * wide  # it stands upright now, as the second one does, within the picture
    assert tall < 120 + 1e-9
