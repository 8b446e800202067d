"""Files of channels and moments, deformed: all channels by one map, each moment by one map or by its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deformnb as dn
from deformnb.cli.main import main
from deformnb.document.deformation import Keyframe
from deformnb.io import open_series, read_channels, write_channels, write_series
from deformnb.session.series import warp_series
from deformnb.volume import Channels
from deformnb.warping import warper

GRID = dn.Grid((8, 9, 10), (1.0, 1.5, 2.0))
BUMP = dn.Deformation.from_space_points(dn.ControlPoints.from_arrays([[8, 6, 4]], [[11, 6, 4]]), support=20.0)


def _moments(count: int, channels: int, kind: str = "channels") -> list[Channels]:
    rng = np.random.default_rng(3)
    return [
        Channels.from_array(rng.integers(0, 200, (*GRID.shape, channels)).astype(np.uint8), GRID, kind=kind)
        for _ in range(count)
    ]


def test_every_channel_at_every_moment_moves_as_a_volume_does(tmp_path: Path) -> None:
    moments = _moments(3, 2)
    write_series(moments, tmp_path / "a.nrrd", 3)
    seen: list[float] = []
    warp_series(tmp_path / "a.nrrd", BUMP, tmp_path / "b.mha", progress=seen.append)
    for before, after in zip(moments, open_series(tmp_path / "b.mha"), strict=True):
        assert after.names == before.names
        for was, now in zip(before, after, strict=True):
            assert np.array_equal(now.values, dn.warp(was, BUMP).values)
    assert seen[-1] == 1


def test_the_map_is_evaluated_once_for_all_channels(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []
    seen = warper.planning.displacements_and_opacity

    def counted(*given: Any) -> Any:
        calls.append(1)
        return seen(*given)

    monkeypatch.setattr(warper.planning, "displacements_and_opacity", counted)
    [four] = _moments(1, 4)
    dn.warp(four[0], BUMP)
    alone = len(calls)
    calls.clear()
    BUMP.apply_all(four.volumes)
    assert len(calls) == alone > 0


def test_moments_of_an_animation_have_maps_of_their_own(tmp_path: Path) -> None:
    rest = BUMP.steps[0].points.reset()
    steps = (dn.Step((rest,), None, support=20.0),)
    keys = (Keyframe(0.0, steps), Keyframe(4.0, BUMP.steps))
    document = dn.Deformation(keyframes=keys)
    moments = _moments(3, 1)
    write_series(moments, tmp_path / "a.nii.gz", 3)
    animation = dn.Animation(document)
    warp_series(tmp_path / "a.nii.gz", animation, tmp_path / "b.nii.gz")
    first, middle, last = open_series(tmp_path / "b.nii.gz")
    assert np.array_equal(first[0].values, moments[0][0].values)
    assert np.array_equal(middle[0].values, dn.warp(moments[1][0], animation.at(2.0)).values)
    assert np.array_equal(last[0].values, dn.warp(moments[2][0], BUMP).values)


def test_the_command_deforms_a_photograph_in_colour_and_a_series(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    values = np.zeros((20, 30, 3), np.uint8)
    values[10, 12] = (250, 120, 40)
    write_channels(Channels.from_array(values, kind="rgb"), "photo.png")
    points = dn.ControlPoints.from_arrays([[0, 0]], [[3, 0]])
    picture = dn.read_volume("photo.png")
    document = dn.Deformation.from_picture_points(picture, "+z", points, trend="translation")
    dn.write_deformation(document, "shift.json")
    assert main(["warp", "shift.json", "photo.png", "moved.png"]) == 0
    moved = read_channels("moved.png").values[0]
    assert moved[10, 15].tolist() == [250, 120, 40]
    assert moved.sum() == values.sum()
    assert "holds colours" in capsys.readouterr().err
    assert main(["warp", "shift.json", "photo.png", "moved.vti"]) == 2
    assert main(["warp", "shift.json", "photo.png", "again.png", "--animate"]) == 2
    assert not (tmp_path / "again.png").exists()


@pytest.mark.nightly  # compiles the sampling of labels, which the tests of volumes have
def test_labels_of_a_series_stay_labels(tmp_path: Path) -> None:
    values = (np.indices(GRID.shape)[0] > 3).astype(np.uint8) * 7
    volumes = [dn.Volume(values, GRID, "seg", is_labels=True)] * 2
    write_series([Channels((volume,)) for volume in volumes], tmp_path / "a.nrrd", 2)
    warp_series(tmp_path / "a.nrrd", BUMP, tmp_path / "b.nrrd")
    result = list(open_series(tmp_path / "b.nrrd"))
    assert result[0][0].is_labels
    assert set(np.unique(result[1].values)) == {0, 7}


def test_the_command_writes_a_segmentation_back_with_a_table_of_volumes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nrrd = pytest.importorskip("nrrd")
    monkeypatch.chdir(tmp_path)
    values = np.zeros(GRID.shape[::-1], np.uint8)
    values[3:7, 3:7, 2:6] = 4
    nrrd.write(
        "a.seg.nrrd",
        values,
        {
            "space": "left-posterior-superior",
            "space directions": np.diag(GRID.spacing),
            "space origin": [0, 0, 0],
            "kinds": ["domain"] * 3,
            "Segment0_Name": "liver",
            "Segment0_LabelValue": "4",
        },
    )
    dn.write_deformation(BUMP, "bump.json")
    assert main(["warp", "bump.json", "a.seg.nrrd", "b.seg.nrrd", "--volumes", "sizes.csv"]) == 0
    warped = dn.read_volume("b.seg.nrrd")
    assert warped.is_labels
    assert np.array_equal(warped.values, dn.warp(dn.read_volume("a.seg.nrrd"), BUMP).values)
    after = 3.0 * np.count_nonzero(warped.values)
    assert Path("sizes.csv").read_text(encoding="utf-8") == (
        f"label,name,before_mm3,after_mm3,change_percent\n4,liver,192,{after:.6g},{100 * (after - 192) / 192:.4g}\n"
    )
    assert dn.io.read_label_names("b.seg.nrrd") == {4: "liver"}
