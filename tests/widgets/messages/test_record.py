"""Channels of messages: wrong ones are refused in one sentence, right ones are read."""

from __future__ import annotations

from typing import Any

import pytest
from example_messages import example

from deformnb.errors import DeformError
from deformnb.rbf.points import ControlPoints
from deformnb.widgets.messages.editors import EDITOR, PointsEdit, ShapesEdit
from deformnb.widgets.messages.inputs import RESTORE, TABLE, UPLOAD
from deformnb.widgets.messages.record import Buffers, Channel, Refused, check_buffers, check_size
from deformnb.widgets.messages.schema import CHANNELS, fields
from deformnb.widgets.messages.views import LIVE


def at(x: float, *target: float) -> dict[str, Any]:
    """A point with this coordinate."""
    return {"points": [{"id": 1, "source": [0, x], "target": [0, *target]}]}


RECEIVED = [(channel, record) for channel in CHANNELS for record in channel.incoming_records]


@pytest.mark.parametrize(
    ("channel", "record"), RECEIVED, ids=[f"{channel.widgets[0]} {record.__name__}" for channel, record in RECEIVED]
)
def test_a_message_with_all_fields_is_read_and_one_without_those_that_it_needs_is_not(
    channel: Channel[Any], record: Any
) -> None:
    full, buffers = example(record)
    made = channel.read(full, buffers)
    assert type(made) is record
    for name, _, may_miss in fields(record):
        less = channel.read({key: value for key, value in full.items() if key != name}, buffers)
        if not may_miss:
            assert isinstance(less, Refused), name
            assert name in less.reason


@pytest.mark.parametrize("channel", CHANNELS, ids=lambda channel: channel.widgets[0])
def test_no_kind_is_there_twice(channel: Channel[Any]) -> None:
    for records in (channel.incoming_records, channel.to_front_end):
        assert len({record.tag() for record in records}) == len(records)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"seq": True}, "seq: expected a whole number, got true or false."),
        ({"seq": 2**53}, "seq: expected a whole number <= 9007199254740991."),
        ({"sender": "a" * 41}, "sender: expected text of length <= 40."),
        (
            {"points": [{"id": 1, "source": [0, float("nan")], "target": [0, 0]}]},
            "points[0].source[1]: expected a number",
        ),
        (
            {"points": [{"id": 1, "source": [0, 10**400], "target": [0, 0]}]},
            "points[0].source[1]: number out of range.",
        ),
        (at(0, 0, 0), "two numbers on a picture"),
        ({"phase": None}, "phase: expected text, got null."),
    ],
    ids=str,
)
def test_the_reason_of_a_refusal_is_a_sentence_with_the_place(changes: dict[str, Any], reason: str) -> None:
    content, _ = example(PointsEdit)
    refused = EDITOR.read({**content, **changes})
    assert isinstance(refused, Refused)
    assert reason in refused.reason
    assert "\n" not in refused.reason


def test_a_refusal_is_answered_by_who_and_which_where_they_are_right() -> None:
    content, _ = example(PointsEdit)
    assert EDITOR.read({**content, "phase": "?"}).content == {"sender": "a", "seq": 3}
    assert EDITOR.read({**content, "seq": -1}).content == {}
    assert EDITOR.read({**content, "type": "other"}).content == {}
    assert EDITOR.read([content]).content == {}
    assert RESTORE.read({"type": "act"}).content == {}
    assert TABLE.read({"type": "act", "view": "v", "seq": 2}).content == {"view": "v", "seq": 2}


def test_objects_of_the_package_are_in_a_message_that_was_read() -> None:
    content, _ = example(PointsEdit)
    made = EDITOR.read(content)
    assert isinstance(made, PointsEdit)
    assert isinstance(made.points, ControlPoints)
    assert made.part is not None
    assert made.part.motion is not None
    assert made.with_part(()) == ()
    shapes = EDITOR.read(example(ShapesEdit)[0])
    assert isinstance(shapes, ShapesEdit)
    assert shapes.shapes[0].region.dim == 2


def test_buffers_are_as_many_and_as_large_as_described() -> None:
    check_buffers(Buffers("x", None), [b"a", memoryview(b"bc")])
    with pytest.raises(DeformError, match="2 buffers, not 1"):
        check_buffers(Buffers("x", 1), [b"a", b"b"])
    with pytest.raises(DeformError, match="3 bytes, more than 2"):
        check_buffers(Buffers("x", 1, 2), [b"abc"])
    piece = {"type": "piece", "id": "u", "offset": 0}
    assert isinstance(UPLOAD.read(piece, [bytes(2**18 + 1)]), Refused)
    assert isinstance(LIVE.read({"type": "screenshot", "view": "v", "id": 1}, []), Refused)


def test_the_size_of_a_message_is_bounded() -> None:
    assert check_size({"a": "\ud800"}, 100) == {"a": "?"}  # half a character
    with pytest.raises(DeformError, match="more than 10"):
        check_size({"a": "x" * 10}, 10)
    deep: Any = []
    for _ in range(5000):
        deep = [deep]
    for odd in (deep, {(1, 2): 3}, object()):
        with pytest.raises(DeformError, match="no JSON"):
            check_size(odd, 10**9)
