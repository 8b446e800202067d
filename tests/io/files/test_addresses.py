"""Files at addresses: downloaded once, again when they have changed, never beyond the room on the disk."""

from __future__ import annotations

import functools
import http.server
import os
import re
import shutil
import sys
import threading
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest

import deformnb as dn
from deformnb.cli.main import main
from deformnb.errors import Cancelled, MissingPackageError, VolumeFileError
from deformnb.io.files import room
from deformnb.io.volumes import ome_zarr
from deformnb.session.inputs import subject_from

VOLUME = dn.Volume.from_array(np.arange(24.0).reshape(2, 3, 4), spacing=(1.0, 2.0, 3.0))


class Requests(http.server.SimpleHTTPRequestHandler):
    """A server of files that records what it is asked."""

    asked: list[str]

    def do_GET(self) -> None:
        """A file, or the status in an address such as /status/401/a.nrrd."""
        status = re.match(r"/status/(\d+)/", self.path)
        super().do_GET() if status is None else self.send_error(int(status[1]))

    def end_headers(self) -> None:
        """The name that is asked for, as servers of downloads state it: /download?name=a.nrrd."""
        if name := parse_qs(urlsplit(self.path).query).get("name"):
            self.send_header("Content-Disposition", f'attachment; filename="{name[0]}"')
        super().end_headers()

    def log_message(self, form: str, *values: Any) -> None:
        self.asked.append(str(values[0]))


@pytest.fixture
def served(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[str, Path, list[str]]]:
    """The address of a folder, the folder, and the requests for it."""
    monkeypatch.setenv("DEFORMNB_DATA", str(tmp_path / "cache"))
    folder = tmp_path / "served"
    folder.mkdir()
    asked: list[str] = []
    handler = type("Recorded", (Requests,), {"asked": asked})
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(handler, directory=folder)) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}", folder, asked
        server.shutdown()
        thread.join()


def left(folder: Path) -> list[str]:
    return sorted(file.name for file in (folder.parent / "cache").rglob("*") if file.is_file())


@pytest.mark.parametrize("suffix", [".nii.gz", ".nrrd", ".mha", ".npy", ".vti", ".ome.tif"])
def test_a_volume_is_downloaded_once(suffix: str, served: tuple[str, Path, list[str]]) -> None:
    host, folder, asked = served
    dn.write_volume(VOLUME, folder / f"carp{suffix}")
    for _ in range(2):
        again = dn.read_volume(f"{host}/carp{suffix}")
        assert again.name == "carp"
        np.testing.assert_array_equal(again.values, VOLUME.values)
    assert [line.split()[0] for line in asked if f"carp{suffix} " in line] == ["HEAD", "GET", "HEAD"]


def test_a_changed_file_comes_again(served: tuple[str, Path, list[str]]) -> None:
    host, folder, _ = served
    dn.write_volume(VOLUME, folder / "a.nrrd")
    assert dn.read_volume(f"{host}/a.nrrd").shape == (2, 3, 4)
    dn.write_volume(dn.Volume.from_array(np.zeros((5, 6, 7))), folder / "a.nrrd")
    assert dn.read_volume(f"{host}/a.nrrd").shape == (5, 6, 7)


def test_files_of_every_kind_are_read(served: tuple[str, Path, list[str]]) -> None:
    host, folder, _ = served
    marks = dn.warping.Landmarks([[1, 2, 3]], ("nose",))
    mesh = dn.warping.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    dn.write_landmarks(marks, folder / "marks.fcsv")
    dn.write_mesh(mesh, folder / "mesh.ply")
    dn.write_transform(dn.rbf.Identity(3), folder / "none.nrrd", dn.Grid((2, 2, 2)))
    dn.write_deformation(dn.Deformation(), folder / "none.json")
    dn.io.write_channels(dn.volume.Channels((VOLUME, VOLUME)), folder / "two.nrrd")
    assert dn.read_landmarks(f"{host}/marks.fcsv").names == ("nose",)
    assert len(dn.read_mesh(f"{host}/mesh.ply").faces) == 1
    assert not dn.read_transform(f"{host}/none.nrrd").displacement([0.5, 0.5, 0.5]).any()
    assert dn.read_deformation(f"{host}/none.json") == dn.Deformation()
    assert len(dn.io.read_channels(f"{host}/two.nrrd")) == 2
    assert dn.io.describe_file(f"{host}/two.nrrd").name == "two.nrrd"
    dn.write_volume(VOLUME, folder / "one.nrrd")
    assert dn.project(f"{host}/one.nrrd", "+z").values.shape == (3, 4)


def test_progress_goes_once_from_0_to_1_and_may_cancel(served: tuple[str, Path, list[str]]) -> None:
    host, folder, _ = served
    noise = np.random.default_rng(1).integers(0, 255, (64, 64, 64)).astype(np.uint8)
    dn.write_volume(dn.Volume.from_array(noise), folder / "noise.nrrd")
    seen: list[float] = []
    dn.read_volume(f"{host}/noise.nrrd", progress=seen.append)
    assert seen == sorted(seen)
    assert seen[0] < 0.5 < seen[-1] == 1.0

    def cancel(share: float) -> None:
        raise Cancelled("enough")

    (folder / "noise.nrrd").rename(folder / "other.nrrd")
    before = left(folder)
    with pytest.raises(Cancelled):
        dn.read_volume(f"{host}/other.nrrd", progress=cancel)
    assert left(folder) == before


def test_a_file_larger_than_the_room_is_refused(
    served: tuple[str, Path, list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    host, folder, _ = served
    noise = np.random.default_rng(1).integers(0, 255, (64, 64, 64)).astype(np.uint8)
    dn.write_volume(dn.Volume.from_array(noise), folder / "noise.nrrd")
    monkeypatch.setattr(room, "DISK_SHARE", 1e-12)
    with pytest.raises(VolumeFileError, match="more than half of the free disk"):
        dn.read_volume(f"{host}/noise.nrrd")
    assert left(folder) == []


def test_what_is_missing_is_named_without_a_password(served: tuple[str, Path, list[str]]) -> None:
    host, folder, _ = served
    with pytest.raises(VolumeFileError, match=r"none\.nrrd could not be downloaded from 127\.0\.0\.1 \(404") as caught:
        dn.read_volume(f"{host}/none.nrrd".replace("//", "//anna:secret@"))
    assert "secret" not in str(caught.value)
    assert left(folder) == []
    with pytest.raises(VolumeFileError, match="could not be downloaded"):
        dn.read_volume("https://127.0.0.1:9/a.nrrd")
    with pytest.raises(VolumeFileError, match="no folder of Zarr at this address"):
        dn.read_volume(f"{host}/a.zarr")


@pytest.mark.parametrize(
    ("status", "words"),
    [
        (401, r"\(401: it asks for a user and a password, as in https://user:password@server/file\)"),
        (403, r"\(403: the server does not give it to everyone"),
        (404, r"\(404: there is no such file on the server; check the address\)"),
        (418, r"\(418: the server refuses it\)"),
        (503, r"\(503: the server has an error; try again later\)"),
    ],
)
def test_an_answer_of_a_server_is_explained(status: int, words: str, served: tuple[str, Path, list[str]]) -> None:
    host, folder, _ = served
    with pytest.raises(VolumeFileError, match=words):
        dn.read_volume(f"{host}/status/{status}/a.nrrd")
    assert left(folder) == []


def test_a_server_that_is_not_there_is_named_in_few_words() -> None:
    with pytest.raises(VolumeFileError, match="there is no connection to it; check the name of the server") as caught:
        dn.read_volume("http://127.0.0.1:9/a.nrrd")
    assert len(str(caught.value)) < 200


def test_a_page_of_the_web_is_no_file(served: tuple[str, Path, list[str]]) -> None:
    host, folder, _ = served
    (folder / "a.nrrd").write_text("\n<!DOCTYPE html><html>Log in</html>", encoding="utf-8")
    with pytest.raises(VolumeFileError, match=r"/a\.nrrd: a page of the web is there and not a file"):
        dn.read_volume(f"{host}/a.nrrd")
    assert left(folder) == []


def test_the_name_that_a_server_gives_tells_the_format(served: tuple[str, Path, list[str]]) -> None:
    host, folder, _ = served
    dn.write_volume(VOLUME, folder / "a.nrrd")
    (folder / "a.nrrd").rename(folder / "download")
    assert dn.read_volume(f"{host}/download?name=carp.nrrd").name == "carp"
    for name in ("../../carp.nrrd", "..%5C..%5Ccarp.nrrd"):  # stays in its folder
        assert "carp" in dn.read_volume(f"{host}/download?name={name}").name
    assert not list(folder.parent.glob("*.nrrd"))


def test_a_server_that_states_no_date_gives_the_file_anew(
    served: tuple[str, Path, list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    host, folder, _ = served
    send = Requests.send_header
    monkeypatch.setattr(
        Requests, "send_header", lambda self, name, value: name == "Last-Modified" or send(self, name, value)
    )
    for values in (VOLUME.values, VOLUME.values[::-1]):  # of one size
        dn.write_volume(dn.Volume.from_array(values), folder / "a.mha")
        np.testing.assert_array_equal(dn.read_volume(f"{host}/a.mha").values, values)


def test_an_archive_on_a_server_without_parts_is_copied(served: tuple[str, Path, list[str]]) -> None:
    pytest.importorskip("aiohttp")
    host, folder, _ = served
    dn.write_volume(VOLUME, folder / "a.nrrd")
    with zipfile.ZipFile(folder / "all.zip", "w") as archive:
        archive.write(folder / "a.nrrd", "in/a.nrrd")
    np.testing.assert_array_equal(dn.read_volume(f"zip://in/a.nrrd::{host}/all.zip").values, VOLUME.values)


def test_chunks_that_were_rewritten_or_removed_are_noticed(served: tuple[str, Path, list[str]]) -> None:
    pytest.importorskip("zarr")
    host, folder, asked = served
    for name, values in (("a.zarr", VOLUME.values), ("b.zarr", VOLUME.values + 1)):
        dn.write_volume(dn.Volume.from_array(values), folder / name)
        for file in (file for file in (folder / name).rglob("*") if file.is_file()):
            os.utime(file, (1_000_000_000, 1_000_000_000))
    np.testing.assert_array_equal(dn.read_volume(f"{host}/a.zarr").values, VOLUME.values)
    [chunk] = {line.split("?")[0] for line in chunks_asked(asked)}
    other = folder / chunk[1:].replace("a.zarr", "b.zarr")
    shutil.copyfile(other, folder / chunk[1:])  # at another time, and the metadata are the same
    for _ in range(2):
        np.testing.assert_array_equal(dn.read_volume(f"{host}/a.zarr").values, VOLUME.values + 1)
    assert len(chunks_asked(asked)) == 2
    (folder / chunk[1:]).unlink()
    large = dn.chunked.open_volume(f"{host}/a.zarr")
    for _ in range(2):
        assert not np.asarray(large.read((slice(0, 2), slice(0, 3), slice(0, 4)))).any()
    assert len(chunks_asked(asked)) == 3


def test_a_file_address_is_a_path(tmp_path: Path) -> None:
    dn.write_volume(VOLUME, tmp_path / "the carp.nrrd")
    assert dn.read_volume((tmp_path / "the carp.nrrd").as_uri()).name == "the carp"


def test_a_member_of_an_archive_and_a_file_in_memory_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fsspec = pytest.importorskip("fsspec")
    monkeypatch.setenv("DEFORMNB_DATA", str(tmp_path / "cache"))
    dn.write_volume(VOLUME, tmp_path / "carp.nii.gz")
    with zipfile.ZipFile(tmp_path / "all.zip", "w") as archive:
        archive.write(tmp_path / "carp.nii.gz", "in/carp.nii.gz")
    memory = fsspec.filesystem("memory")
    memory.put(str(tmp_path / "carp.nii.gz"), "/deformnb/carp.nii.gz")
    try:
        for address in (f"zip://in/carp.nii.gz::{tmp_path}/all.zip", "memory://deformnb/carp.nii.gz"):
            found = dn.read_volume(address)
            assert found.name == "carp"
            np.testing.assert_array_equal(found.values, VOLUME.values)
        with pytest.raises(VolumeFileError, match="nothing at this address"):
            dn.read_volume("memory://deformnb/none.nrrd")
    finally:
        memory.rm("/deformnb", recursive=True)


def test_a_folder_of_zarr_is_copied_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fsspec = pytest.importorskip("fsspec")
    pytest.importorskip("zarr")
    monkeypatch.setenv("DEFORMNB_DATA", str(tmp_path / "cache"))
    dn.write_volume(VOLUME, tmp_path / "carp.zarr")
    memory = fsspec.filesystem("memory")
    memory.put(str(tmp_path / "carp.zarr"), "/deformnb/carp.zarr", recursive=True)
    try:
        for _ in range(2):
            np.testing.assert_array_equal(dn.read_volume("memory://deformnb/carp.zarr").values, VOLUME.values)
    finally:
        memory.rm("/deformnb", recursive=True)


@pytest.mark.parametrize("suffix", [".nhdr", ".mhd", ".npy", ".raw"])
def test_files_that_belong_to_another_come_with_it(suffix: str, served: tuple[str, Path, list[str]]) -> None:
    host, folder, asked = served
    for second, values in (
        (1_000_000_000, VOLUME.values),
        (1_000_000_009, VOLUME.values + 1),
    ):  # changed
        dn.write_volume(replace(VOLUME, values=values), folder / f"the carp{suffix}")
        for file in folder.iterdir():
            os.utime(file, (second, second))  # the times of HTTP are whole seconds
        for _ in range(2):
            again = dn.read_volume(f"{host}/the%20carp{suffix}")
            assert again.grid == VOLUME.grid
            np.testing.assert_array_equal(again.values, values)
    gets = [line.split()[1] for line in asked if line.startswith("GET") and line.split()[1].endswith("raw")]
    assert len(gets) == (0 if suffix == ".npy" else 2)


def test_of_an_array_without_a_side_file_none_is_asked_in_vain(served: tuple[str, Path, list[str]]) -> None:
    host, folder, _ = served
    np.save(folder / "a.npy", VOLUME.values)
    assert dn.read_volume(f"{host}/a.npy").grid.spacing == (1.0, 1.0, 1.0)


def test_a_set_of_slices_and_a_chain_of_transforms_come_whole(served: tuple[str, Path, list[str]]) -> None:
    host, folder, _ = served
    (folder / "set").mkdir()
    for k in range(3):
        (folder / "set" / f"s{k}.raw").write_bytes(bytes([k] * 20))
    header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\nencoding: raw\ndata file: set/s%d.raw 0 2 1\n\n"
    (folder / "set.nhdr").write_text(header, encoding="utf-8")
    assert dn.read_volume(f"{host}/set.nhdr").values[:, 0, 0].tolist() == [0, 1, 2]
    (folder / "set" / "s2.raw").unlink()
    with pytest.raises(VolumeFileError, match=r"set/s2\.raw could not be downloaded"):
        dn.read_volume(f"{host}/set.nhdr")


def test_a_header_in_an_archive_finds_its_voxels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("fsspec")
    monkeypatch.setenv("DEFORMNB_DATA", str(tmp_path / "cache"))
    dn.write_volume(VOLUME, tmp_path / "carp.nhdr")
    with zipfile.ZipFile(tmp_path / "all.zip", "w") as archive:
        for file in tmp_path.glob("carp.*"):
            archive.write(file, f"in/{file.name}")
    again = dn.read_volume(f"zip://in/carp.nhdr::{tmp_path}/all.zip")
    np.testing.assert_array_equal(again.values, VOLUME.values)


def test_the_names_of_labels_come_from_beside_them(served: tuple[str, Path, list[str]]) -> None:
    host, folder, _ = served
    labels = dn.Volume(np.ones((2, 3, 4), np.uint8), dn.Grid((2, 3, 4)), is_labels=True)
    dn.write_volume(labels, folder / "bones.nii.gz")
    (folder / "bones.csv").write_text("label,name\n1,femur\n", encoding="utf-8")
    assert dn.io.read_label_names(f"{host}/bones.nii.gz") == {1: "femur"}


def test_the_subject_of_a_session_at_an_address_reports_its_copy_and_its_reading(
    served: tuple[str, Path, list[str]],
) -> None:
    host, folder, _ = served
    noise = np.random.default_rng(1).integers(0, 255, (64, 64, 64)).astype(np.uint8)
    dn.write_volume(dn.Volume.from_array(noise), folder / "noise.nrrd")
    seen: list[float] = []
    assert subject_from(f"{host}/noise.nrrd", progress=seen.append).name == "noise"
    assert seen == sorted(seen)
    assert seen[0] < 0.5 < seen[-1] == 1.0
    assert dn.session.Session(f"{host}/noise.nrrd").volume.name == "noise"


def chunks_asked(asked: list[str]) -> list[str]:
    names = [line.split()[1] for line in asked if line.startswith("GET")]
    return [name for name in names if not name.endswith(("zarr.json", ".zgroup", ".zarray", ".zattrs", ".zmetadata"))]


@pytest.mark.parametrize("version", ome_zarr.VERSIONS)
def test_of_a_pyramid_at_an_address_the_chunks_of_one_level_come_once(
    version: str, served: tuple[str, Path, list[str]]
) -> None:
    pytest.importorskip("zarr")
    host, folder, asked = served
    values = np.random.default_rng(2).integers(0, 255, (160, 80, 80)).astype(np.uint8)
    grids = ome_zarr.level_grids(dn.Grid(values.shape, (1.0, 2.0, 3.0)), 2)
    arrays = ome_zarr.create_pyramid(folder / "carp.zarr", grids, values.dtype, version=version)
    arrays[0][:], arrays[1][:] = values, ome_zarr.halve(values, discrete=False)
    coarse = dn.read_volume(folder / "carp.zarr", level=1)
    again = dn.read_volume(f"{host}/carp.zarr", level=1)
    assert again.name == "carp"
    assert again.grid == coarse.grid
    np.testing.assert_array_equal(again.values, coarse.values)
    first = chunks_asked(asked)
    assert first
    assert all(line.startswith("/carp.zarr/1/") for line in first)
    dn.read_volume(f"{host}/carp.zarr", level=1)
    assert chunks_asked(asked) == first
    large = dn.chunked.open_volume(f"{host}/carp.zarr")
    np.testing.assert_array_equal(np.asarray(large.read((slice(0, 4), slice(0, 4), slice(0, 4)))), values[:4, :4, :4])
    fine = [line for line in chunks_asked(asked) if line.startswith("/carp.zarr/0/")]
    assert 0 < len(fine) < 8


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "fsspec", None)
    with pytest.raises(MissingPackageError, match="s3 are read by the package fsspec, which is not installed"):
        dn.read_volume("s3://scans/carp.nrrd")


def test_commands_take_addresses(served: tuple[str, Path, list[str]], capsys: pytest.CaptureFixture[str]) -> None:
    host, folder, _ = served
    dn.write_volume(VOLUME, folder / "carp.nrrd")
    dn.write_deformation(dn.Deformation(), folder / "none.json")
    assert main(["info", f"{host}/carp.nrrd"]) == 0
    assert "carp.nrrd" in capsys.readouterr().out
    out = folder.parent / "out.nrrd"
    assert main(["warp", f"{host}/none.json", f"{host}/carp.nrrd", str(out)]) == 0
    np.testing.assert_array_equal(dn.read_volume(out).values, VOLUME.values)
    results = folder.parent / "results"
    assert main(["replay", f"{host}/none.json", f"{host}/carp.nrrd", "--out", str(results)]) == 0
    assert [file.name for file in results.glob("*.nrrd")] == ["carp.nrrd"]
    assert main(["info", "gopher://host/carp.nrrd"]) == 2
    assert "gopher is no kind of address" in capsys.readouterr().err
