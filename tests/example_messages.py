"""Right messages of every kind, made from their records, and wrong ones made of those."""

from __future__ import annotations

import copy
import random
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

from msgspec import UnsetType

from deformnb.widgets.messages.record import OBJECTS, Message
from deformnb.widgets.messages.schema import fields, metas

_FIELDS: dict[str, Any] = {
    "sender": "a",
    "seq": 3,
    "view": "v",
    "drawn": {"hz": 60.0},
    "matrix": [[1.0, 0.0], [0.0, 1.0]],
    "vertices": [[0.0, 0.0], [9.0, 0.0], [0.0, 9.0]],
    "PointsCommand.what": "add",
    "PointsCommand.field": "",
    "PointsCommand.value": "1 2",
}


def example(record: type[Message]) -> tuple[dict[str, Any], list[bytes]]:
    """The content of a right message, and its buffers."""
    content = {"type": record.tag(), **_entries(record)}
    count = record.binary.count
    return content, [b"\x89PNG\r\n\x1a\n"] * (1 if count is None else count)


def _entries(record: type) -> dict[str, Any]:
    config = getattr(record, "__struct_config__", None)
    tag = {config.tag_field: config.tag} if config is not None and config.tag is not None else {}
    found = {}
    for name, hint, _ in fields(record):
        given = _FIELDS.get(f"{record.__name__}.{name}", _FIELDS.get(name))
        found[name] = _value(hint) if given is None else given
    return {**tag, **found}


def _value(hint: Any) -> Any:
    inner, notes = metas(hint)
    kind, parts = get_origin(inner), get_args(inner)
    if inner in OBJECTS:
        return _value(OBJECTS[inner][0])
    if kind is Literal:
        return parts[0]
    if kind in (Union, UnionType):
        return _value(next(part for part in parts if part not in (NoneType, UnsetType)))
    if kind is list:
        least = max([note.min_length or 0 for note in notes], default=0)
        return [_value(parts[0]) for _ in range(max(1, least))]
    if kind is tuple:
        return [_value(part) for part in parts]
    if kind is dict:
        return {}
    if hasattr(inner, "__struct_fields__") or hasattr(inner, "__required_keys__"):
        return _entries(inner)
    return {str: "x", bool: True, int: 1, float: 1.0, NoneType: None, Any: None}[inner]


ODD: tuple[Any, ...] = (
    None,
    True,
    False,
    -1,
    0,
    2**31,
    2**53,
    10**400,
    0.5,
    -1e300,
    1e308,
    float("nan"),
    float("inf"),
    "",
    "x",
    "x" * 500,
    "\ud800",
    "../../etc",
    [],
    {},
    [[]],
    [None] * 3,
    [float("nan")] * 2,
    {"type": "edit"},
    {"kind": "polygon", "vertices": [[0, 0], [1, 1]]},
    object(),
    b"bytes",
)
"""Values that a field may not expect."""


def mutate(rng: random.Random, content: Any, buffers: list[bytes]) -> tuple[Any, Any]:
    """A message that was changed in one or two places."""
    content, buffers = copy.copy(content), list(buffers)
    for _ in range(rng.choice((1, 1, 2))):
        change = rng.randrange(8)
        if change == 0:
            return rng.choice((*ODD, [content], {"content": content})), buffers
        if change == 1:
            buffers = rng.choice(([], [b""], [bytes(2**18 + 1)], [b"a", b"b"], [memoryview(b"abc")]))
        elif isinstance(content, dict):
            content = _mutate_value(rng, content, change)
    return content, buffers


def _mutate_value(rng: random.Random, data: Any, change: int) -> Any:
    if isinstance(data, dict) and data:
        name = rng.choice(list(data))
        if change == 2:
            return {key: value for key, value in data.items() if key != name}
        if change == 3:
            return {**data, rng.choice(("extra", "__class__", "type", "points")): rng.choice(ODD)}
        if change > 5 and isinstance(data[name], dict | list):
            return {**data, name: _mutate_value(rng, data[name], rng.randrange(2, 8))}
        return {**data, name: rng.choice(ODD)}
    if isinstance(data, list) and data:
        k = rng.randrange(len(data))
        if change == 2:
            return data[:k] + data[k + 1 :]
        if change == 3:
            return data * rng.choice((2, 50))
        return [*data[:k], _mutate_value(rng, data[k], change), *data[k + 1 :]]
    return rng.choice(ODD)
