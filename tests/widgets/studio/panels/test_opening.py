"""Files dropped on a studio: each kind becomes what it is for; any other is named and changes nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from uploads import uploaded

from deformnb.datasets import PHANTOMS
from deformnb.io.formats import write_volume
from deformnb.io.landmarks import write_landmarks
from deformnb.volume.volume import Volume
from deformnb.warping.points import Landmarks
from deformnb.widgets.studio.panels.labels import LabelChooser
from deformnb.widgets.studio.panels.opening import OpenPanel
from deformnb.widgets.studio.panels.registration import FitPanel
from deformnb.widgets.studio.studio import Studio


def test_what_is_dropped_becomes_what_it_is_for(tmp_path: Path) -> None:
    volume = PHANTOMS["bar"].make((12, 16, 20))
    studio = Studio(volume, folder=tmp_path)
    opening, fit = (next(p for p in studio._panels if isinstance(p, kind)) for kind in (OpenPanel, FitPanel))
    labels: LabelChooser = opening._shapes.labels

    def drop(path: Path) -> str:
        uploaded(opening.box, path.name, path.read_bytes())
        return str(studio._words.notice.value)

    place = volume.grid.index_to_point(np.array([3.0, 5.0, 7.0]))
    write_landmarks(Landmarks([place], ("mark",)), tmp_path / "mark.fcsv")
    assert "1 landmarks of mark.fcsv" in drop(tmp_path / "mark.fcsv")
    assert studio.session.points.names[-1] == "mark"
    write_landmarks(Landmarks([place], ("second",)), tmp_path / "second.mrk.json")
    (tmp_path / "second.mrk.json").rename(tmp_path / "second.json")  # known by what is in it
    assert "1 landmarks of second.json" in drop(tmp_path / "second.json")
    assert studio.session.points.names[-1] == "second"

    numbers = np.zeros(volume.shape, np.uint8)
    numbers[2:6], numbers[6:10] = 1, 2
    write_volume(Volume(numbers, volume.grid, is_labels=True), tmp_path / "bones.nrrd")
    assert "bones.nrrd has 2 labels" in drop(tmp_path / "bones.nrrd")
    assert [name for name, _ in labels.list.options] == ["label 1", "label 2"]

    grey = np.random.default_rng(1).integers(0, 999, volume.shape).astype(np.int16)
    write_volume(Volume(grey, volume.grid), tmp_path / "other.nrrd")
    assert "other.nrrd is the target" in drop(tmp_path / "other.nrrd")
    np.testing.assert_array_equal(fit.target.volume.values, grey)

    studio.save(tmp_path / "kept.json")
    before = studio.deformation
    studio.session.reset()
    assert "Opened kept.json" in drop(tmp_path / "kept.json")
    assert studio.deformation.steps[0].points == before.steps[0].points

    before = studio.deformation
    for name, words in (("notes.odt", "notes.odt is no file that can be opened here"),
                        ("notes.txt", "notes.txt: it is neither"), ("affine.tfm", "affine.tfm is a transform")):
        (tmp_path / name).write_text("hello")
        assert words in drop(tmp_path / name)
    (tmp_path / "cut.nrrd").write_bytes((tmp_path / "other.nrrd").read_bytes()[:500])
    assert "cut.nrrd" in drop(tmp_path / "cut.nrrd")
    assert studio.deformation is before

    elsewhere = Studio(PHANTOMS["bar"].make((8, 8, 8)))
    elsewhere.save(tmp_path / "else.json")
    elsewhere.close()
    drop(tmp_path / "else.json")
    assert opening.question.box.layout.display == ""
    opening.question.agree.click()
    assert "else.json" in studio.session.history["undo"]
    studio.close()
