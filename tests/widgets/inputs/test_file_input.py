"""Files uploaded by the browser: whole, in pieces, refused before they are sent, and given up."""

from __future__ import annotations

import logging
from functools import partial
from pathlib import Path

import pytest
from front_end import deliver
from uploads import upload_file
from widgets.studio.panels.test_steps_history import Guarded

from deformnb._typing import Progress
from deformnb.errors import DeformError
from deformnb.widgets.inputs.file_input import FileInput
from deformnb.widgets.messages.inputs import LARGEST_UPLOAD, PIECE
from deformnb.widgets.web.guard import LONGEST_REQUEST


class Taken:
    """Takes files: their contents, and their folders."""

    def __init__(self) -> None:
        self.files: dict[str, bytes] = {}
        self.paths: list[Path] = []
        self.guard = Guarded()
        self.input = FileInput(self.take, self.guard, self.check)

    def check(self, name: str) -> None:
        if name.endswith(".zip"):
            raise DeformError(f"{name} is no such file.")

    def take(self, path: Path, progress: Progress) -> None:
        self.files[path.name] = path.read_bytes()
        self.paths.append(path)
        progress(1.0)


def test_a_file_comes_in_pieces_that_a_socket_takes_and_is_gone_afterwards() -> None:
    taken = Taken()
    content = bytes(range(256)) * (PIECE // 100)
    sent = upload_file(taken.input, "../scan.nrrd", content)
    assert taken.files == {"scan.nrrd": content}
    assert not taken.paths[0].parent.exists()
    requests = [m for m in sent if m["type"] == "next"]
    assert len(requests) == -(-len(content) // PIECE)
    assert PIECE + 4096 < LONGEST_REQUEST
    assert [m["type"] for m in sent[len(requests) :]] == ["reading", "reading", "done"]
    taken.input.close()


def test_what_cannot_be_taken_is_refused_before_it_is_sent() -> None:
    taken = Taken()
    for name, size, words in (
        ("a.zip", 5, "no such file"),
        ("a.nrrd", 0, "empty"),
        ("..", 3, "no name"),
        ("a.nrrd", LARGEST_UPLOAD + 1, "more than the 500 MB"),
        ("a.nrrd", "5", "size: expected a whole number"),
    ):
        deliver(taken.input, {"type": "begin", "id": "x", "name": name, "size": size})
        assert words in taken.guard.errors[-1]
    taken.input.wait()
    assert taken.files == {}
    taken.input.close()


def test_what_is_given_up_or_comes_wrong_is_forgotten(caplog: pytest.LogCaptureFixture) -> None:
    taken = Taken()
    assert upload_file(taken.input, "a.nrrd", bytes(2 * PIECE), cancel_at=1)[-1]["type"] == "done"
    receive = partial(deliver, taken.input)
    receive({"type": "begin", "id": "y", "name": "b.nrrd", "size": 10}, [])
    receive({"type": "piece", "id": "y", "offset": 3}, [b"123"])
    assert "did not arrive as a whole" in taken.guard.errors[-1]
    receive({"type": "piece", "id": "y", "offset": 0}, [b"123"])  # nothing of that number is in progress any more
    with caplog.at_level(logging.WARNING):
        for wrong in ({"type": "begin"}, {"type": "begin", "id": 5}, "begin"):
            receive(wrong, [])
    assert len(caplog.records) == 3
    for k in range(6):  # of pages that have gone
        receive({"type": "begin", "id": f"z{k}", "name": "c.nrrd", "size": 10}, [])
    assert upload_file(taken.input, "d.nrrd", b"1")[-1]["type"] == "done"
    assert taken.files == {"d.nrrd": b"1"}
    taken.input.close()
