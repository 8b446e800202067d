"""Files are read in a page as Python reads them: the same grid, values, type and labels, and the same refusals."""

from __future__ import annotations

import base64
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scripts import run_script
from volume_bytes import nifti, nrrd

from deformnb.datasets import PHANTOMS
from deformnb.errors import VolumeFileError
from deformnb.imaging.projection import project
from deformnb.io import read_volume, write_volume
from deformnb.volume.known_spacings import known_spacings
from deformnb.volume.plane import Plane
from deformnb.volume.transfer import levels, specimen, typical_range
from deformnb.volume.views import VIEWS
from deformnb.volume.volume import Volume, voxel_checksum
from deformnb.widgets.packed_volume import fine_window, packed_volume, whole_window

READ = """async ({ files, known }) => {
  const results = [];
  for (const { name, data } of files) {
    const bytes = Uint8Array.from(atob(data), (c) => c.charCodeAt(0));
    try {
      const volume = await readVolume(new Blob([bytes]), name, { knownSpacings: known });
      const { grid, dtype, isLabels, notes } = volume, values = Array.from(volume.values, (v) =>
        Number.isFinite(v) ? v : String(v));
      results.push({ ...grid, dtype, isLabels, notes, values, name: volume.name, sha256: await voxelChecksum(volume) });
    } catch (error) {
      if (!(error instanceof FileError)) throw error;
      results.push({ error: error.message });
    }
  }
  return results;
}"""
FILES = ("formats/volume_files.ts", "formats/reading.ts")


def _with_byte(data: bytes, at: int, value: int) -> bytes:
    return data[:at] + bytes([value]) + data[at + 1 :]


RAMP = np.arange(24).reshape(2, 3, 4)
OBLIQUE = [[1.2, -0.9, 0, 5], [0.9, 1.2, 0, -7.5], [0, 0, 2, 3]]
CASES: dict[str, bytes] = {
    **{
        f"{kind}{'le' if order == '<' else 'be'}.nii": nifti(
            (RAMP - (5 if kind[0] != "u" else 0)).astype(kind), order=order, sform=OBLIQUE
        )
        for kind in ("u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8")
        for order in "<>"
    },
    "large.nii": nifti((RAMP + 2**33).astype("i8")),
    "nothing stated.nii": nifti(RAMP.astype("u1")),
    "qform.nii": nifti(RAMP.astype("i2"), qform=(0.1, 0.2, 0.3, 4, 5, 6)),
    "qform flipped.nii.gz": nifti(RAMP.astype("i2"), qform=(0, 0, 1.0001, 4, 5, 6), flip=-1, packed=True),
    "both.nii": nifti(RAMP.astype("f4"), sform=np.diag([1.5, 2, 2.5, 1])[:3], qform=(0, 0, 0, 0, 0, 0)),
    "both differ.nii": nifti(RAMP.astype("f4"), sform=OBLIQUE, qform=(0, 0, 0, 0, 0, 0)),
    "negative.nii": nifti(RAMP.astype("u1"), spacing=(-1.0, 1.0, 3.0)),
    "scaled.nii": nifti(RAMP.astype("i2"), slope=0.1, intercept=-1000),
    "scaled wide.nii": nifti(RAMP.astype("i4"), slope=1e-3),
    "slope 0.nii": nifti(RAMP.astype("i2"), slope=0, intercept=7),
    "not finite.nii": nifti(np.array([[[1, np.nan, np.inf]]], "f4")),
    "labels.nii.gz": nifti(RAMP.astype("u1"), intent=1002, packed=True),
    "more behind.nii.gz": nifti(RAMP.astype("u1"), packed=True) + b"\0" * 40,
    "version 2.nii": nifti(RAMP.astype("u2"), version=2, order=">", sform=OBLIQUE, slope=2, intercept=1),
    "version 2 qform.nii.gz": nifti(RAMP.astype("f8"), version=2, qform=(0.5, 0.5, 0.5, 1, 2, 3), packed=True),
    "slice.nii": nifti(RAMP[:1].astype("u1"), dim=(2, 4, 3, 1, 1, 1, 1, 1)),
    "plain.nrrd": nrrd(RAMP.astype("u1")),
    "big.nrrd": nrrd(
        RAMP.astype("i2"),
        "space: right-anterior-superior",
        "space directions: (0,0,2) (1.5,0,0) (0,-1,0)",
        "space origin: (3,-4,5.5)",
        order=">",
    ),
    "packed.nrrd": nrrd(
        RAMP.astype("f4"), "spacings: 0.5 0.25 2", "axis mins: 1 2 3", "centers: cell node cell", packed=True
    ),
    "mirrored.nrrd": nrrd(RAMP.astype("u2"), "spacings: -1 2 3"),
    "long.nrrd": nrrd(RAMP.astype("i8"), kind="long long int"),
    "labels.nrrd": nrrd(RAMP.astype("u1"), "deformnb_labels:=yes", "# comment: of no account"),
    "segments.nrrd": nrrd(RAMP.astype("u1"), "Segment0_LabelValue:=1", "Segment0_Name:=a: b"),
    "one channel.nrrd": nrrd(
        RAMP[None].transpose(1, 2, 3, 0).astype("u1"),
        "kinds: vector domain domain domain",
        "space: las",
        "space directions: none (1,0,0) (0,1,0) (0,0,3)",
        "space origin: (1,2,3)",
    ),
    "picture.nrrd": nrrd(RAMP[0].astype("u1"), "space: lps", "space directions: (0,1,0) (0,0,2)"),
    "skipped.nrrd": nrrd(RAMP.astype("u1"), "byte skip: -1").replace(b"\n\n", b"\n\nsome text"),
    **{f"unit {code}.nii": _with_byte(nifti(RAMP.astype("u1"), sform=OBLIQUE), 123, code) for code in range(8)},
    **{
        f"unit {k}.nrrd": nrrd(
            RAMP.astype("u1"),
            "space: lps",
            "space directions: (1,0,0) (0,2,0) (0,0,3)",
            f"space units: {words}",
            "space origin: (1,2,3)",
        )
        for k, words in enumerate(
            (
                '"um" "um" "um"',
                '"\u00b5m" "\u00b5m" "mm"',
                '"" "" ""',
                '"micron" "" "nm"',
                '"furlong" "mm" "mm"',
                '"Inch" "in" "ft"',
            )
        )
    },
    "units of axes.nrrd": nrrd(RAMP.astype("u1"), "spacings: 1 2 3", "axis mins: 1 1 1", 'units: "mm" "um" "mm"'),
    "lines.nrrd": nrrd(RAMP.astype("u1"), "line skip: 1", "byte skip: 2").replace(b"\n\n", b"\n\nsome text\n!!"),
}
BAD: dict[str, bytes] = {
    "empty.nii": b"",
    "cut short.nii": CASES["f8le.nii"][:-1],
    "torn.nii.gz": CASES["labels.nii.gz"][:-12],
    "damaged.nii.gz": CASES["labels.nii.gz"][:-8] + bytes(4) + CASES["labels.nii.gz"][-4:],
    "huge.nii": nifti(RAMP.astype("u1"), dim=(3, 30000, 30000, 30000, 1, 1, 1, 1)),
    "huge.nii.gz": nifti(RAMP.astype("f4"), dim=(3, 600, 600, 600, 1, 1, 1, 1), packed=True),
    "four.nii": nifti(RAMP.astype("u1"), dim=(4, 4, 3, 1, 2, 1, 1, 1)),
    "zero.nii": nifti(RAMP.astype("u1"), dim=(3, 4, 0, 2, 1, 1, 1, 1)),
    "complex.nii": nifti(RAMP.astype("f8"), datatype=32),
    "sheared.nii": nifti(RAMP.astype("u1"), sform=[[1, 0.5, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]),
    "flat.nii": nifti(RAMP.astype("u1"), sform=[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 0]]),
    "text.nrrd": b"hello\n\n",
    "endless.nrrd": b"NRRD0004\ntype: uchar\n",
    "no sizes.nrrd": b"NRRD0004\ntype: uchar\ndimension: 3\nencoding: raw\n\n",
    "twice.nrrd": nrrd(RAMP.astype("u1"), "type: uchar"),
    "apart.nrrd": nrrd(RAMP.astype("u1"), "data file: other.raw"),
    "colours.nrrd": nrrd(RAMP[0].astype("u1")[:, :, None].repeat(2, 2), "kinds: vector domain domain"),
    "short.nrrd": nrrd(RAMP.astype("i2"))[:-3],
    "words.nrrd": nrrd(RAMP.astype("u1"), "spacings: one 2 3"),
}


@cache
def read() -> dict[str, dict[str, Any]]:
    files = [{"name": name, "data": base64.b64encode(data).decode()} for name, data in {**CASES, **BAD}.items()]
    known = [vars(row) for row in known_spacings()]
    return dict(zip([*CASES, *BAD], run_script(FILES, READ, {"files": files, "known": known}), strict=True))


@pytest.mark.parametrize("name", CASES)
def test_a_file_is_read_as_python_reads_it(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(CASES[name])
    wanted, found = read_volume(tmp_path / name), read()[name]
    assert "error" not in found, found
    assert found["name"] == wanted.name
    assert (tuple(found["shape"]), found["dtype"], found["isLabels"]) == (
        wanted.shape,
        wanted.dtype.name,
        wanted.is_labels,
    )
    assert found["unit"] == wanted.grid.unit
    for field in ("spacing", "origin", "direction"):
        np.testing.assert_allclose(found[field], getattr(wanted.grid, field), rtol=1e-12, atol=1e-12)
    values = np.array([float(v) for v in found["values"]]).reshape(wanted.shape)
    np.testing.assert_array_equal(values, wanted.values.astype(np.float64))
    assert found["sha256"] == voxel_checksum(wanted.dtype, wanted.shape, wanted.values)
    header_notes = [
        note
        for note in wanted.notes
        if "negative" in note or "places" in note or "became" in note or "states no place" in note or "unit" in note
    ]
    assert [note for note in found["notes"] if "one slice" not in note] == header_notes


@pytest.mark.parametrize("name", BAD)
def test_a_file_that_is_none_is_refused_as_python_refuses_it(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(BAD[name])
    with pytest.raises(VolumeFileError):
        read_volume(tmp_path / name)
    message = read()[name]["error"]
    assert message.startswith(f"{name}: ")
    assert message.endswith(".")
    assert 40 < len(message) < 300


def test_a_known_volume_gets_its_true_spacing() -> None:
    values = np.arange(24, dtype=np.uint8).reshape(2, 3, 4)
    row = {
        "title": "a volume",
        "shape": [2, 3, 4],
        "dtype": "uint8",
        "header_spacing": [1, 1, 1],
        "sha256": voxel_checksum(values.dtype, (2, 3, 4), values),
        "spacing": [2, 3, 4],
        "reason": "its size",
    }
    files = [
        {"name": "a.nrrd", "data": base64.b64encode(nrrd(values)).decode()},
        {"name": "b.nrrd", "data": base64.b64encode(nrrd(values[::-1])).decode()},
    ]
    right, other = run_script(FILES, READ, {"files": files, "known": [row]})
    assert right["spacing"] == [2, 3, 4]
    assert other["spacing"] == [1, 1, 1]


PACK = """async ({ name, data, views, factors }) => {
  const volume = await readVolume(new Blob([Uint8Array.from(atob(data), (c) => c.charCodeAt(0))]), name);
  const about = measureLevels(volume), transfer = specimen(volume, about);
  const { window, share } = windowOf(volume, about, transfer);
  const bytes = await bytesOfVolume(volume, factors, window, () => {});
  const pictures = views.map((view) => {
    const plane = planeAlong(volume.grid, view), pixels = maximumProjection(volume, plane);
    return { plane, raster: voxelRaster(volume.grid, plane), values: Array.from(pixels),
      window: pictureWindow(pixels, volume, about) };
  });
  return { about, transfer, window, share, bytes: Array.from(bytes), pictures,
    table: Array.from(tableOf(transfer, window[0], window[1])) };
}"""


def _hounsfield() -> Volume:
    """Padding, air, fat, muscle, bone, and a piece of metal."""
    values = PHANTOMS["fish"].make((16, 20, 24)).values.astype(np.int16)
    values = np.where(values < 20, -1000, 14 * values.astype(np.int16) - 300).astype(np.int16)
    values[:, :2, :2], values[8, 10, 12] = -3024, 20000
    return Volume.from_array(values)


@pytest.mark.parametrize(
    "make",
    [
        lambda: PHANTOMS["bar"].make((12, 14, 16)),
        _hounsfield,
        lambda: Volume.from_array(np.arange(60.0).reshape(3, 4, 5) ** 2),
    ],
)
def test_a_volume_is_shown_as_python_shows_it(make: Any, tmp_path: Path) -> None:
    write_volume(make(), tmp_path / "a.nrrd")
    volume = read_volume(tmp_path / "a.nrrd")
    data = base64.b64encode((tmp_path / "a.nrrd").read_bytes()).decode()
    modules = (FILES[0], "volume/levels.ts", "volume/packing.ts", "volume/grid.ts")
    function, coarse = specimen(volume), whole_window(volume)
    window = fine_window(function, volume, coarse) or coarse
    shown = packed_volume(volume, volume.grid.size // 5, 10**6, window)
    found = run_script(modules, PACK, {"name": "a.nrrd", "data": data, "views": VIEWS, "factors": shown.factors})
    np.testing.assert_allclose(found["about"]["levels"], levels(volume))
    np.testing.assert_allclose(found["about"]["range"], typical_range(volume))
    np.testing.assert_allclose(found["transfer"]["colors"], function.colors)
    np.testing.assert_allclose(found["transfer"]["opacities"], function.opacities)
    np.testing.assert_allclose(found["window"], window)
    np.testing.assert_allclose(np.reshape(found["table"], (-1, 4)), function.table(*window), atol=1e-6)
    for view, picture in zip(VIEWS, found["pictures"], strict=True):
        plane = Plane.from_view(volume, view)
        wanted = project(volume, plane)
        for part, name in (("origin", "origin"), ("u", "u"), ("v", "v"), ("n", "normal")):
            np.testing.assert_allclose(picture["plane"][part], getattr(plane, name), atol=1e-12)
        np.testing.assert_array_equal(np.reshape(picture["values"], picture["raster"]["shape"]), wanted.values)
        np.testing.assert_allclose(picture["raster"]["origin"], wanted.raster.origin, atol=1e-9)
        np.testing.assert_allclose(picture["window"], wanted.window)
    # Means of blocks are rounded in float32 there and in float64 here.
    assert np.abs(np.array(found["bytes"]) - shown.volume.values.ravel()).max() <= 1
