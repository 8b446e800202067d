"""Files dropped on a studio: each kind becomes what it is for; any other is named and changes nothing."""

from __future__ import annotations

import weakref
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from front_end import deliver
from numpy.typing import NDArray
from studio_driver import find_panel, open_widgets
from uploads import upload_file

from deformnb.datasets import PHANTOMS
from deformnb.document.deformation import Deformation
from deformnb.errors import DeformError
from deformnb.io.landmarks.formats import write_landmarks
from deformnb.io.volumes.formats import write_volume
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.points import Landmarks
from deformnb.widgets.studio.panels.labels import LabelChooser
from deformnb.widgets.studio.panels.opening import OpenPanel
from deformnb.widgets.studio.panels.registration import FitPanel
from deformnb.widgets.studio.panels.steps import HistoryPanel
from deformnb.widgets.studio.studio import Studio


def answer(opening: OpenPanel, words: str) -> None:
    """Press the button of an answer to the question that is asked."""
    assert opening.question.box.is_visible
    next(button for button in opening.question.box.children[1:] if button.description == words).click()


def test_what_is_dropped_becomes_what_it_is_for(tmp_path: Path) -> None:
    volume = PHANTOMS["bar"].make((12, 16, 20))
    studio = Studio(volume, folder=tmp_path)
    opening, fit = find_panel(studio, OpenPanel), find_panel(studio, FitPanel)
    labels: LabelChooser = opening.shapes.panel.labels

    def drop(path: Path) -> str:
        upload_file(opening.box, path.name, path.read_bytes())
        return str(studio.parts.words.notice.value)

    place = volume.grid.index_to_point(np.array([3.0, 5.0, 7.0]))
    write_landmarks(Landmarks([place], ("mark",)), tmp_path / "mark.fcsv")
    assert "1 landmarks of mark.fcsv" in drop(tmp_path / "mark.fcsv")
    assert studio.session.editing.points.names[-1] == "mark"
    write_landmarks(Landmarks([place], ("second",)), tmp_path / "second.mrk.json")
    (tmp_path / "second.mrk.json").rename(tmp_path / "second.json")  # known by what is in it
    assert "1 landmarks of second.json" in drop(tmp_path / "second.json")
    assert studio.session.editing.points.names[-1] == "second"

    numbers = np.zeros(volume.shape, np.uint8)
    numbers[2:6], numbers[6:10] = 1, 2
    write_volume(Volume(numbers, volume.grid, is_labels=True), tmp_path / "bones.nrrd")
    assert "bones.nrrd has 2 labels" in drop(tmp_path / "bones.nrrd")
    assert [name for name, _ in labels.list.options] == ["label 1", "label 2"]

    (tmp_path / "names.csv").write_text("label,name\n2,tibia\n9,rib\n", encoding="utf-8")
    assert "names.csv names 1 of the 2 labels" in drop(tmp_path / "names.csv")
    assert [name for name, _ in labels.list.options] == ["label 1", "tibia"]

    grey = np.random.default_rng(1).integers(0, 999, volume.shape).astype(np.int16)
    write_volume(Volume(grey, volume.grid), tmp_path / "other.nrrd")
    drop(tmp_path / "other.nrrd")
    answer(opening, "Match to it")
    assert "other.nrrd is the target" in studio.parts.words.notice.value
    np.testing.assert_array_equal(fit.target.volume.values, grey)
    drop(tmp_path / "other.nrrd")
    answer(opening, "Show side by side")
    studio.wait()
    np.testing.assert_array_equal(opening.compare.panel.chosen.volume.values, grey)
    drop(tmp_path / "other.nrrd")
    answer(opening, "Use as labels")
    assert "is no label volume" in studio.parts.words.notice.value

    studio.save(tmp_path / "kept.json")
    before = studio.deformation
    studio.session.editing.reset()
    assert "Opened kept.json" in drop(tmp_path / "kept.json")
    assert studio.deformation.steps[0].points == before.steps[0].points

    before = studio.deformation
    for name, words in (
        ("notes.odt", "notes.odt is no file that can be opened here"),
        ("notes.txt", "notes.txt: it is neither"),
        ("names.tsv", "names.tsv: line 1 names no columns"),
        ("affine.tfm", "affine.tfm is a transform"),
    ):
        (tmp_path / name).write_text("hello", encoding="utf-8")
        assert words in drop(tmp_path / name)
    (tmp_path / "cut.nrrd").write_bytes((tmp_path / "other.nrrd").read_bytes()[:500])
    assert "cut.nrrd" in drop(tmp_path / "cut.nrrd")
    assert studio.deformation is before

    elsewhere = Studio(PHANTOMS["bar"].make((8, 8, 8)))
    elsewhere.save(tmp_path / "else.json")
    elsewhere.close()
    drop(tmp_path / "else.json")
    assert opening.question.box.is_visible
    opening.question.box.children[1].click()
    assert "else.json" in studio.session.editing.history["undo"]
    studio.close()


def test_a_volume_opens_in_place_of_another_and_history_leads_back(tmp_path: Path) -> None:
    studio = Studio(PHANTOMS["bar"].make((12, 16, 20)), folder=tmp_path)
    first, opening = studio.session, find_panel(studio, OpenPanel)
    shown = weakref.ref(studio.view)
    studio.editor.points = studio.editor.points.add([9.0, 7.0], [9.0, 9.0])
    other = PHANTOMS["fish"].make((8, 10, 24))
    write_volume(other, tmp_path / "fish.nrrd")
    seen: list[Deformation] = []
    studio.observe(lambda change: seen.append(change["new"]), "deformation")
    upload_file(opening.box, "fish.nrrd", (tmp_path / "fish.nrrd").read_bytes())
    assert studio.session is first
    assert "edits of bar" in opening.question.text
    answer(opening, "Open")
    assert studio.session is not first
    np.testing.assert_array_equal(studio.volume.values, other.values)
    assert seen == [studio.deformation]
    assert "History returns to bar" in studio.parts.words.notice.value
    assert shown() is not studio.view
    assert opening.question.box.children == ()  # the parts before are closed
    first.editing.change(trend="none")  # and whoever still holds their session changes nothing here
    assert studio.editor.settings.trend != "none"
    studio.editor.points = studio.editor.points.add([9.0, 5.0], [9.0, 6.0])
    assert studio.session.editing.history["undo"] == "add point 5"

    back = find_panel(studio, HistoryPanel).box.children[0]
    assert back.description == "Back to bar (phantom)"
    back.click()
    assert studio.session is first
    assert studio.session.editing.history["undo"] == "change trend"
    assert len(studio.editor.points) == 5
    assert seen[-1] is first.editing.deformation
    studio.undo()
    assert studio.editor.settings.trend != "none"
    studio.close()


def test_a_volume_that_cannot_be_opened_leaves_everything_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    studio = Studio(PHANTOMS["bar"].make((8, 8, 12)))
    studio.wait()
    kept = {name: getattr(studio, name) for name in ("session", "view", "editor", "children")}
    widgets = open_widgets()
    with pytest.raises(DeformError, match="no side"):
        studio.open_volume(PHANTOMS["bar"].make((8, 8, 8)), side="no side")
    monkeypatch.setattr("deformnb.widgets.studio.studio.arrange", failing)
    with pytest.raises(DeformError, match="no room"):
        studio.open_volume(PHANTOMS["bar"].make((8, 8, 8)))
    assert kept == {name: getattr(studio, name) for name in kept}
    assert open_widgets() <= widgets
    studio.editor.points = studio.editor.points.add([4.0, 4.0], [4.0, 5.0])
    assert studio.session.editing.history["undo"] == "add point 5"
    studio.close()


def blocks(shape: tuple[int, int, int] = (12, 24, 24)) -> NDArray[np.int16]:
    """Voxels that look like labels: regions of unrelated numbers in the type of amounts."""
    numbers = np.zeros(shape, np.int16)
    for k, number in enumerate((96, 3, 51, 17, 240, 88)):
        numbers[2 * k : 2 * k + 2, 4:20, 2:22] = number
    return numbers


def test_whole_numbers_that_look_like_labels_are_asked_about(tmp_path: Path) -> None:
    grid = Grid((12, 24, 24))
    write_volume(Volume(blocks(), grid), tmp_path / "atlas.nrrd")
    studio = Studio(tmp_path / "atlas.nrrd", folder=tmp_path)
    opening = find_panel(studio, OpenPanel)
    assert "atlas look like labels" in opening.question.text
    assert "is_labels" not in studio.parts.words.notice.value  # which is for those who write code
    studio.editor.points = studio.editor.points.add([9.0, 7.0], [9.0, 9.0])
    edited = studio.deformation
    answer(opening, "They are amounts")
    assert not studio.volume.is_labels
    opening = find_panel(studio, OpenPanel)
    assert not opening.question.box.is_visible
    studio.open_volume(tmp_path / "atlas.nrrd", edited)
    answer(find_panel(studio, OpenPanel), "They are labels")
    assert studio.volume.is_labels
    assert studio.deformation == edited
    assert 'atlas.nrrd", is_labels=True)' in studio.session.code()
    assert set(np.unique(studio.session.results.volume().values)) <= set(np.unique(blocks()))
    assert not find_panel(studio, OpenPanel).question.box.is_visible
    studio.close()


def test_a_file_that_is_on_its_way_when_the_voxels_are_taken_for_labels_arrives(tmp_path: Path) -> None:
    write_volume(Volume(blocks(), Grid((12, 24, 24))), tmp_path / "atlas.nrrd")
    write_volume(Volume(blocks(), Grid((12, 24, 24)), is_labels=True), tmp_path / "bones.nrrd")
    data = (tmp_path / "bones.nrrd").read_bytes()
    studio = Studio(tmp_path / "atlas.nrrd", folder=tmp_path)
    before = find_panel(studio, OpenPanel)
    place = studio.children.index(before.box)
    deliver(before.box, {"type": "begin", "id": "under way", "name": "bones.nrrd", "size": len(data)})
    answer(before, "They are labels")
    opening = find_panel(studio, OpenPanel)
    assert (opening is not before, opening.box is before.box, studio.children.index(opening.box)) == (True, True, place)
    deliver(before.box, {"type": "piece", "id": "under way", "offset": 0}, [memoryview(data)])
    opening.box.wait()
    assert "bones.nrrd has 6 labels" in studio.parts.words.notice.value
    assert len(opening.shapes.panel.labels.list.options) == 6
    studio.close()
    assert opening.box.comm is None


def test_dropped_labels_are_asked_about_unless_their_file_says_so(tmp_path: Path) -> None:
    studio = Studio(Volume(np.zeros((12, 24, 24), np.uint8), Grid((12, 24, 24)), "scan"), folder=tmp_path)
    opening = find_panel(studio, OpenPanel)
    labels: LabelChooser = opening.shapes.panel.labels

    def drop(name: str, origin: float, is_labels: bool) -> None:
        write_volume(Volume(blocks(), Grid((12, 24, 24), origin=(origin, 0, 0)), is_labels=is_labels), tmp_path / name)
        upload_file(opening.box, name, (tmp_path / name).read_bytes())

    drop("like.nrrd", 0.0, False)
    assert "like.nrrd looks like labels" in opening.question.text
    answer(opening, "Use as labels")
    assert len(labels.list.options) == 6
    drop("sure.nrrd", 0.0, True)
    assert not opening.question.box.is_visible
    assert "sure.nrrd has 6 labels" in studio.parts.words.notice.value
    drop("elsewhere.nrrd", 900.0, True)  # of another scan: to be deformed itself
    assert "Open elsewhere.nrrd in place of scan" in opening.question.text
    answer(opening, "Open")
    assert studio.volume.is_labels
    studio.close()


def test_labels_are_chosen_in_the_folder_with_the_names_beside_them(tmp_path: Path) -> None:
    volume = Volume(np.zeros((12, 24, 24), np.uint8), Grid((12, 24, 24)), "scan")
    write_volume(Volume(blocks(), volume.grid), tmp_path / "bones.nrrd")  # the menu is for labels: nothing is asked
    (tmp_path / "bones.csv").write_text("label,name\n17,tibia\n", encoding="utf-8")
    studio = Studio(volume, folder=tmp_path)
    opening = find_panel(studio, OpenPanel)
    labels: LabelChooser = opening.shapes.panel.labels
    labels.file.value = "bones.nrrd"
    names = [name for name, _ in labels.list.options]
    assert (len(names), names[1]) == (6, "tibia")
    assert labels.file.value == "bones.nrrd"
    studio.close()


def failing(*_given: Any) -> Any:
    raise DeformError("no room.")
