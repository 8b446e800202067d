"""Downloads of real volumes: right file, wrong file, cut connection, no network; nothing half done is left behind."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import socket
import subprocess
import sys
import threading
from collections import Counter
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pytest

from deformnb.datasets import DATASETS, PHANTOMS, fetch, find, load, registry
from deformnb.errors import Cancelled, DeformError, VolumeFileError
from deformnb.io import write_volume

BODY = bytes(range(256)) * 300  # 76,800 bytes: several chunks


class Files(BaseHTTPRequestHandler):
    """One small file, and the ways in which a server can fail."""

    def do_GET(self):
        self.server.asked[self.path] += 1
        if self.path == "/missing":
            self.send_error(404)
            return
        body = {"/other": BODY[:-1] + b"!", "/endless": BODY * 40, **self.server.bodies}.get(self.path, BODY)
        self.send_response(200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        # The client may hang up on us (that is one of the tests).
        with contextlib.suppress(OSError):
            self.wfile.write(body[: len(body) // 2] if self.path == "/cut" else body)

    def log_message(self, *_):
        """Keep quiet."""


@pytest.fixture(scope="module")
def server():
    with ThreadingHTTPServer(("127.0.0.1", 0), Files) as running:
        running.asked = Counter()
        running.bodies = {}
        thread = threading.Thread(target=running.serve_forever, daemon=True)
        thread.start()
        yield running
        running.shutdown()
        thread.join()


@pytest.fixture
def serve(server, monkeypatch, tmp_path, isolated_folders):
    """Make "carp" the small file at a path of the local server, stored in an empty folder."""
    for variable in ("http_proxy", "https_proxy", "all_proxy"):
        monkeypatch.delenv(variable, raising=False)
        monkeypatch.delenv(variable.upper(), raising=False)
    monkeypatch.setenv("DEFORMNB_DATA", str(tmp_path / "kept here"))

    def at(path, **changes):
        row = replace(
            DATASETS["carp"],
            address=f"http://127.0.0.1:{server.server_port}{path}",
            size=len(BODY),
            sha256=hashlib.sha256(BODY).hexdigest(),
            **changes,
        )
        monkeypatch.setitem(registry.DATASETS, "carp", row)
        return tmp_path / "kept here"

    return at


def nothing_left(folder):
    return not folder.exists() or list(folder.iterdir()) == []


def test_right_file_is_fetched_once_and_then_used_offline(serve, server, monkeypatch):
    folder = serve("/right")
    before = server.asked["/right"]
    path = fetch("carp", progress=False)
    assert path == folder / "carp.nii.gz"
    assert path.read_bytes() == BODY
    assert [p.name for p in folder.iterdir()] == ["carp.nii.gz"]
    monkeypatch.setattr(registry, "_download", None)  # would fail if called
    assert fetch("carp", progress=False) == path
    assert server.asked["/right"] == before + 1


def test_progress_rises_to_one(serve):
    serve("/right")
    seen = []
    fetch("carp", progress=seen.append)
    assert seen[-1] == 1.0
    assert seen == sorted(seen)
    assert len(seen) > 3


def test_bar_is_drawn_where_asked(serve, capsys):
    serve("/right")
    fetch("carp", progress=True)
    assert "carp.nii.gz" in capsys.readouterr().err


def test_silent_where_no_terminal_is(serve, capsys):
    serve("/right")
    fetch("carp")
    assert capsys.readouterr() == ("", "")


def test_cancelling_leaves_nothing(serve):
    folder = serve("/right")

    def stop(_):
        raise Cancelled

    with pytest.raises(Cancelled):
        fetch("carp", progress=stop)
    assert nothing_left(folder)


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("/other", "checksum differs"),
        ("/cut", "could not be downloaded"),
        ("/missing", "404"),
        ("/endless", "more than"),
    ],
)
def test_wrong_cut_missing_or_endless_leaves_nothing_and_says_why(serve, path, words):
    folder = serve(path)
    with pytest.raises(VolumeFileError, match=words) as caught:
        fetch("carp", progress=False)
    assert nothing_left(folder)
    message = str(caught.value)
    assert str(folder / "carp.nii.gz") in message, "where to put it by hand"
    assert 'deformnb.datasets.PHANTOMS["fish"].make()' in message, "what to use instead"
    assert "\n" not in message


def test_offline_names_file_folder_and_phantom(serve, monkeypatch):
    folder = serve("/right")
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        port = unused.getsockname()[1]
    row = replace(DATASETS["carp"], address=f"http://127.0.0.1:{port}/carp.nii.gz")
    monkeypatch.setitem(registry.DATASETS, "carp", row)
    with pytest.raises(DeformError) as caught:
        fetch("carp", progress=False)
    message = str(caught.value)
    assert "127.0.0.1" in message
    assert str(folder / "carp.nii.gz") in message
    assert 'deformnb.datasets.PHANTOMS["fish"].make()' in message
    assert len(message) < 500, "one sentence, not the whole stack of urllib3"
    assert nothing_left(folder)


def test_a_file_put_there_by_hand_is_used_but_only_the_right_one(serve):
    folder = serve("/missing")
    folder.mkdir()
    (folder / "carp.nii.gz").write_bytes(BODY)
    assert fetch("carp") == folder / "carp.nii.gz"
    (folder / "carp.nii.gz").write_bytes(b"mine")
    with pytest.raises(VolumeFileError, match="not the published file"):
        fetch("carp")
    assert (folder / "carp.nii.gz").read_bytes() == b"mine", "never overwritten"


def test_folder_argument_wins_over_the_environment(serve, tmp_path):
    kept = serve("/right")
    assert fetch("carp", progress=False, folder=tmp_path / "mine") == tmp_path / "mine" / "carp.nii.gz"
    assert nothing_left(kept)


def test_default_folder_is_the_users_cache(isolated_folders, monkeypatch):
    monkeypatch.delenv("DEFORMNB_DATA", raising=False)
    assert registry.data_folder().is_relative_to(isolated_folders)


def test_full_disk_and_unusable_folder_are_said_before_anything_is_asked(serve, server, monkeypatch, tmp_path):
    serve("/room")
    monkeypatch.setattr(registry.shutil, "disk_usage", lambda _: type("Usage", (), {"free": 1000})())
    with pytest.raises(VolumeFileError, match="1,000 left"):
        fetch("carp", progress=False)
    (tmp_path / "a file").write_text("", encoding="utf-8")
    with pytest.raises(VolumeFileError, match="cannot be made"):
        fetch("carp", progress=False, folder=tmp_path / "a file")
    assert server.asked["/room"] == 0


def test_what_has_no_download_says_where_to_get_it(isolated_folders, tmp_path):
    for name, row in DATASETS.items():
        if row.address is None:
            with pytest.raises(DeformError, match="has no download: get it from") as caught:
                fetch(name, folder=tmp_path)
            assert str(tmp_path / row.file) in str(caught.value)
    with pytest.raises(DeformError, match="lobster has no download"):
        fetch("lobster", folder=tmp_path)


def test_rows_are_complete():
    for name, row in DATASETS.items():
        assert row.phantom in PHANTOMS
        assert all((row.credit, row.licence, row.source)), name
        assert row.file == os.path.basename(row.file)
        if row.is_labels:
            assert PHANTOMS[row.phantom].label_names
        if row.address is not None:
            # A permanent address is https and names a commit, not a branch that moves.
            assert re.match(r"https://.*/[0-9a-f]{40}/", row.address)
            assert re.fullmatch("[0-9a-f]{64}", row.sha256 or "")
            assert row.size


@pytest.mark.parametrize(
    ("name", "local"),
    [
        ("carp", "carp.nii.gz"),
        ("head_ct", "head_ct.nii.gz"),
        ("abdomen_ct", "abdomen_ct.nii.gz"),
        ("knee_labels", "knee_labels.nrrd"),
        ("abdomen_labels", "abdomen_labels.nrrd"),
        ("horse", "horse.ply"),
    ],
)
def test_checksums_and_sizes_are_those_of_the_real_files(real_data, name, local):
    data = real_data(local).read_bytes()
    assert hashlib.sha256(data).hexdigest() == DATASETS[name].sha256
    assert len(data) == DATASETS[name].size


def test_credits_name_everyone():
    text = registry.credits()
    for name, row in DATASETS.items():
        assert name in text
        assert row.credit in text
        assert row.licence in text


def test_importing_asks_nobody_and_loads_no_downloader():
    code = (
        "import sys, socket\n"
        "def refuse(*a, **k): raise AssertionError('network at import')\n"
        "socket.socket.connect = refuse\n"
        "import deformnb.datasets\n"
        "assert not {'pooch', 'requests', 'tqdm', 'platformdirs'} & set(sys.modules), 'heavy import'\n"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True, timeout=300)


def test_load_corrects_the_spacing(real_data, isolated_folders, monkeypatch):
    monkeypatch.setenv("DEFORMNB_DATA", str(real_data("carp.nii.gz").parent))
    carp = load("carp")
    assert carp.name == "carp"
    assert carp.grid.spacing == (0.390625, 1.0, 0.78125)
    phantom = PHANTOMS["fish"].make((4, 4, 4)).grid
    assert carp.grid.lengths == pytest.approx(phantom.lengths)
    assert carp.grid.direction == phantom.direction, "the same view shows the same side of both"
    assert carp.shape == (256, 512, 256)


def test_both_scans_of_the_knee_come_from_one_matlab_file(server, serve, monkeypatch, tmp_path):
    from scipy.io import savemat

    straight, bent = (np.arange(24, dtype=np.uint8).reshape(2, 3, 4) + k for k in (0, 100))
    savemat(tmp_path / "two.mat", {"dataR": straight, "dataT": bent})
    body = (tmp_path / "two.mat").read_bytes()
    server.bodies["/knee3D.mat"] = body
    folder = serve("/right")
    for name in ("knee_mr_straight", "knee_mr_bent"):
        row = replace(
            DATASETS[name],
            address=f"http://127.0.0.1:{server.server_port}/knee3D.mat",
            size=len(body),
            sha256=hashlib.sha256(body).hexdigest(),
        )
        monkeypatch.setitem(registry.DATASETS, name, row)
    found = [load(name, progress=False) for name in ("knee_mr_straight", "knee_mr_bent")]
    assert server.asked["/knee3D.mat"] == 1
    assert sorted(path.name for path in folder.iterdir()) == [
        "knee3D.mat",
        "knee_mr_bent.nrrd",
        "knee_mr_straight.nrrd",
    ]
    for volume, values in zip(found, (straight, bent), strict=True):
        np.testing.assert_array_equal(volume.values, values.transpose(2, 1, 0))  # MATLAB's is [x, y, z]
        assert volume.grid.spacing == (1.0, 0.96875, 1.0)


def test_find_says_whether_it_is_real(serve, capsys):
    folder = serve("/missing")
    volume, real = find("carp", (8, 16, 8))
    assert (volume.shape, real) == ((8, 16, 8), False)
    assert re.search("no real carp: .*404.*; the phantom is used\n", capsys.readouterr().out)
    assert nothing_left(folder)
    assert not find("lobster", (8, 16, 8))[1]
    assert "manually" in capsys.readouterr().out
    write_volume(PHANTOMS["lobster"].make((8, 16, 4)), folder / "lobster.nrrd")
    volume, real = find("lobster")
    assert (volume.shape, real, volume.name) == ((8, 16, 4), True, "lobster")
    assert "VolVis" in capsys.readouterr().out


def test_a_mesh_is_fetched_and_not_loaded(isolated_folders):
    for function in (load, find):
        with pytest.raises(DeformError, match="is a mesh"):
            function("horse")
