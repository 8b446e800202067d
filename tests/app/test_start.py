"""The page of the start: who may see it, what it shows, and how the next start finds the pages of this one."""

from __future__ import annotations

import http.client
import json
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from waiting import PATIENCE

from deformnb.app.start import MOST_EARLIER, StartRecord, StartServer, stage_of, starting
from deformnb.errors import DeformError
from deformnb.widgets.web.addresses import SECRET_HEADER, digest_of, is_password


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder for what starts leave."""
    monkeypatch.setenv("DEFORMNB_STATE", str(tmp_path / "state"))
    return tmp_path / "state"


def get(start: StartServer, path: str = "/deformnb/start", **headers: str) -> tuple[int, str, dict[str, str]]:
    """Status, text and headers of an answer."""
    connection = http.client.HTTPConnection("127.0.0.1", start.port, timeout=PATIENCE)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    found = answer.status, answer.read().decode(), dict(answer.getheaders())
    connection.close()
    return found


def facts(start: StartServer) -> dict[str, Any]:
    """The facts that a page with the password receives."""
    status, text, _ = get(start, **{SECRET_HEADER: start.token})
    assert status == 200
    return dict(json.loads(text))


def test_only_a_page_with_the_password_is_told_the_name_and_the_progress() -> None:
    start = StartServer("carp.nii")
    try:
        assert get(start)[0] == get(start, **{SECRET_HEADER: "another"})[0] == 403
        assert get(start, Host="elsewhere.example")[0] == get(start, Origin="http://elsewhere.example")[0] == 403
        status, page, headers = get(start, "/index.html")
        assert status == 200
        assert "carp" not in page
        assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
        assert get(start, "/etc/passwd")[0] == 404
        shares: list[float] = []
        stage_of(start, "Reading carp.nii", shares.append)(0.25)
        assert shares == [0.25]
        assert {name: facts(start)[name] for name in ("state", "name", "text", "progress")} == {
            "state": "loading",
            "name": "carp.nii",
            "text": "Reading carp.nii",
            "progress": 0.25,
        }
    finally:
        start.close()


def test_the_words_of_the_start_are_those_of_its_language() -> None:
    start = StartServer("carp.nii", language="de")
    start.progress("Reading carp.nii")
    assert facts(start)["text"] == "carp.nii wird gelesen"
    start.close()


def test_the_next_start_with_the_volume_takes_the_port_and_lets_in_the_pages_of_this_one(tmp_path: Path) -> None:
    tokens: list[str] = []
    port = 0
    for k in range(MOST_EARLIER + 2):
        start = StartServer("carp.nii", subject=str(tmp_path))
        port = port or start.port
        assert start.port == port
        assert [is_password(token, start.token, start.earlier) for token in tokens] == [
            k - number <= MOST_EARLIER for number in range(k)
        ]
        tokens.append(start.token)
        start.close()
    other = StartServer("carp.nii", subject="another")
    assert other.earlier == []
    other.close()


def test_a_port_in_use_is_another_one_unless_it_was_asked_for(tmp_path: Path) -> None:
    first = StartServer("a", subject=str(tmp_path))
    second = StartServer("a", subject=str(tmp_path))
    assert second.port != first.port
    with pytest.raises(DeformError, match="cannot be had"), starting("b", port=first.port, browser=False):
        pass
    first.close()
    second.close()


def test_no_password_is_stored_and_a_damaged_record_is_none(state: Path) -> None:
    start = StartServer("carp.nii")
    record = StartRecord("carp.nii", "127.0.0.1")
    assert (record.port, record.passwords) == (start.port, [digest_of(start.token)])
    (path,) = (state / "starts").iterdir()
    assert start.token not in path.read_text("utf-8")
    start.close()
    for wrong in ("", "[]", '{"port": 99999999, "passwords": []}', '{"port": "x", "passwords": 3}'):
        path.write_text(wrong, "utf-8")
        assert StartRecord("carp.nii", "127.0.0.1").port == 0


def test_an_error_waits_for_a_page_that_is_there() -> None:
    start = StartServer("carp.nii")
    assert facts(start)["state"] == "loading"  # a page is there
    ended = threading.Thread(target=start.fail, args=("this is no NIfTI file.",))
    ended.start()
    while (found := facts(start))["state"] == "loading":
        time.sleep(0.01)
    assert (found["state"], found["text"]) == ("failed", "this is no NIfTI file.")
    ended.join(PATIENCE)
    assert not ended.is_alive()
    alone, begin = StartServer("carp.nii"), time.monotonic()
    alone.fail("nobody is there.")
    assert time.monotonic() - begin < 2


def test_a_file_that_cannot_be_read_is_said_in_the_terminal(tmp_path: Path) -> None:
    (tmp_path / "broken.nii").write_bytes(b"no volume")
    done = subprocess.run(
        [sys.executable, "-m", "deformnb", "app", "--no-browser", str(tmp_path / "broken.nii")],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    assert done.returncode == 2
    assert done.stdout.startswith("http://127.0.0.1:")
    assert "broken.nii" in done.stderr.splitlines()[-1]


def test_the_address_comes_before_the_heavy_packages() -> None:
    code = """
import sys
from deformnb.app.start import check_app, starting
check_app("127.0.0.1", 0, None)
with starting("carp", browser=False) as start:
    print(*sorted({"jax", "scipy", "trame", "aiohttp", "ipywidgets", "PIL", "numpy"} & set(sys.modules)))
    start.close()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=PATIENCE)
    assert done.stdout.splitlines()[1].split() == []
