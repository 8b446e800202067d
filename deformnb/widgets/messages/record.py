"""Base of all messages, and the channels of widgets, which read them.

A message is a JSON object with a ``type`` and binary buffers next to it. Its record names each field with its type,
bounds and meaning; msgspec converts and checks. NaN, infinity, numbers beyond what JavaScript counts exactly, and true
in the place of a number are refused by the bounds of :data:`Finite` and :data:`Whole`.
"""

from __future__ import annotations

import json
import re
from abc import ABCMeta
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Generic, Literal, TypeAlias, TypeVar, get_args

import msgspec
from msgspec import UNSET, Meta, Struct

from deformnb.errors import DeformError

LARGEST_NUMBER = 2**53 - 1
"""JavaScript counts exactly up to here."""

LONGEST_NAME = 200
"""Characters of a name at most."""

LONGEST_ID = 40
"""Characters of an id that a front end makes at most."""

LONGEST_MESSAGE = 65536
"""Bytes of a message or a trait of a front end at most."""

LONGEST_EDIT = 2**20
"""Bytes of an edit at most: all the points that a fit takes."""

Whole: TypeAlias = Annotated[int, Meta(ge=0, le=LARGEST_NUMBER)]
Finite: TypeAlias = Annotated[float, Meta(gt=-1e300, lt=1e300)]
Place2: TypeAlias = tuple[Finite, Finite]
Place3: TypeAlias = tuple[Finite, Finite, Finite]
Window: TypeAlias = Annotated[str, Meta(min_length=1, max_length=LONGEST_ID, description="id of the window")]
Counted: TypeAlias = Annotated[
    int, Meta(ge=0, le=LARGEST_NUMBER, description="number of the message, counted by the sender")
]
View: TypeAlias = Annotated[str, Meta(max_length=LONGEST_ID, description="id of the front end")]
Views: TypeAlias = Annotated[str | None, Meta(description="id of the one front end, or null for all")]
Phase: TypeAlias = Literal["move", "end"]
Shade: TypeAlias = Annotated[Literal["dark", "light"], Meta(description="background of the page around it")]


@dataclass(frozen=True)
class Buffers:
    """Binary buffers of a message.

    Parameters
    ----------
    about : their contents.
    count : how many there are; None for any number.
    most : bytes of one of them at most.
    """

    about: str = ""
    count: int | None = 0
    most: int = 2**31


class Message(Struct, frozen=True, kw_only=True, tag_field="type"):
    """Any message; ``binary`` describes what comes with it.

    Examples
    --------
    >>> class Ping(Message, frozen=True, kw_only=True, tag="ping"):
    ...     number: int
    >>> Ping(number=3).content()
    {'type': 'ping', 'number': 3}
    """

    binary: ClassVar[Buffers] = Buffers()

    @classmethod
    def tag(cls) -> str:
        """Its ``type``."""
        return str(cls.__struct_config__.tag)

    def content(self) -> dict[str, Any]:
        """The JSON object that is sent, without the fields that were not set."""
        fields = {name: getattr(self, name) for name in self.__struct_fields__}
        return {"type": self.tag(), **{name: value for name, value in fields.items() if value is not UNSET}}


FRAGMENT_BYTES = 2**22
"""Bytes of the buffers of one message to a front end at most: servers and hosts refuse messages of 10 MB."""


class Fragment(Message, frozen=True, kw_only=True, tag="fragment"):
    """Part of a message whose buffers are too large for one."""

    binary: ClassVar[Buffers] = Buffers("a part of all buffers, joined", 1, FRAGMENT_BYTES)

    index: Annotated[int, Meta(ge=0, description="of the part; the others of its message come right after")]
    sizes: Annotated[list[int], Meta(description="bytes of each of its buffers")]
    message: Annotated[dict[str, Any] | None, Meta(description="the message, with its last part")] = None


def fragments(content: dict[str, Any], buffers: Sequence[bytes]) -> Iterator[tuple[Fragment, bytes]]:
    """Divide a message into parts with at most :data:`FRAGMENT_BYTES` of its buffers each.

    Examples
    --------
    >>> [(part.index, part.message, len(data)) for part, data in fragments({"type": "x"}, [bytes(5_000_000), b"ab"])]
    [(0, None, 4194304), (1, {'type': 'x'}, 805698)]
    """
    sizes = [len(buffer) for buffer in buffers]
    joined = memoryview(b"".join(buffers))
    count = -(-len(joined) // FRAGMENT_BYTES)
    for index in range(count):
        part = bytes(joined[index * FRAGMENT_BYTES : (index + 1) * FRAGMENT_BYTES])
        yield Fragment(index=index, sizes=sizes, message=content if index == count - 1 else None), part


class Seen(Message, frozen=True, kw_only=True, tag="seen"):
    """Confirmation that the item of this number is shown or being drawn, so that the next may come."""

    view: View
    seq: Annotated[int, Meta(ge=1, le=LARGEST_NUMBER, description="number")]


@dataclass(frozen=True)
class Refused:
    """A message with a mistake in it.

    Parameters
    ----------
    reason : in one sentence.
    content : the fields by which it can be answered, as far as they are right; empty for none.
    """

    reason: str
    content: dict[str, Any] = field(default_factory=dict)


OBJECTS: dict[type, tuple[Any, Callable[[Any], Any]]] = {}
"""Stand-ins of classes that records hold: the type of each as plain data, and a function that makes the object."""


def stand_in(kind: type, plain: Any, make: Callable[[Any], Any]) -> type:
    """A type for fields of records that hold a dataclass of the package, which msgspec would read field by field.

    Parameters
    ----------
    kind : the class; its objects are instances of the stand-in.
    plain : type of the same as plain data.
    make : makes an object of that.
    """
    made: type = ABCMeta(kind.__name__, (), {})
    made.register(kind)  # type: ignore[attr-defined]
    OBJECTS[made] = (plain, make)
    return made


_M = TypeVar("_M")


@dataclass(frozen=True)
class Channel(Generic[_M]):
    """The messages of one kind of widget.

    Parameters
    ----------
    widgets : names of their classes.
    to_python : type of all messages that their front ends send: a record, or a union of several.
    to_front_end : records that they send.
    longest : bytes of a message at most.
    answered_by : a record with the fields by which a refused message is answered; None where none is.

    Examples
    --------
    >>> class Ping(Message, frozen=True, kw_only=True, tag="ping"):
    ...     number: Whole
    >>> channel = Channel(("Bell",), Ping)
    >>> channel.read({"type": "ping", "number": 3}).number
    3
    >>> channel.read({"type": "ping", "number": -3}).reason
    'number: expected a whole number >= 0.'
    """

    widgets: tuple[str, ...]
    to_python: Any = None
    to_front_end: tuple[type[Message], ...] = ()
    longest: int = LONGEST_MESSAGE
    answered_by: type[Struct] | None = None

    @property
    def incoming_records(self) -> tuple[type[Message], ...]:
        """The records of :attr:`to_python`, one by one."""
        return get_args(self.to_python) or (() if self.to_python is None else (self.to_python,))

    @property
    def all(self) -> tuple[type[Message], ...]:
        """The records of both directions."""
        return (*self.incoming_records, *self.to_front_end)

    def read(self, content: Any, buffers: Any = ()) -> _M | Refused:
        """A message that has arrived, checked."""
        try:
            message = convert(check_size(content, self.longest), self.to_python)
            check_buffers(type(message).binary, buffers)
        except DeformError as error:
            return Refused(f"{error!s:.300}", self._address(content))
        result: _M = message
        return result

    def _address(self, content: Any) -> dict[str, Any]:
        if self.answered_by is None or not isinstance(content, dict):
            return {}
        if content.get("type") not in [record.tag() for record in self.incoming_records]:
            return {}
        try:
            return dict(msgspec.structs.asdict(convert(content, self.answered_by)))
        except DeformError:
            return {}


def convert(data: Any, kind: Any) -> Any:
    """Plain data as a type of a message; DeformError with one sentence where it is none.

    Examples
    --------
    >>> convert([1, 2], Place2)
    (1.0, 2.0)
    """
    try:
        return msgspec.convert(data, kind, dec_hook=_decode)
    except msgspec.ValidationError as error:
        raise DeformError(_sentence(error)) from None
    except UnicodeEncodeError:
        raise DeformError("it has half a character.") from None
    except RecursionError:
        raise DeformError("it is nested too deeply.") from None


def _replace_surrogates(data: Any) -> Any:
    try:
        return json.loads(json.dumps(data, ensure_ascii=False).encode("utf-8", "replace"))
    except (TypeError, ValueError, RecursionError):
        raise DeformError("it is no JSON.") from None


def _decode(kind: type, data: Any) -> Any:
    return OBJECTS[kind][1](data)


_WORDS = {
    "`int`": "a whole number",
    "`float`": "a number",
    "`str`": "text",
    "`bool`": "true or false",
    "`array`": "a list",
    "`object`": "an object",
    "`null`": "null",
}


def _sentence(error: msgspec.ValidationError) -> str:
    """The reason as a sentence, after the place in the message."""
    what, _, where = str(error).partition(" - at `$")
    place = where.strip("`.")
    if isinstance(error.__cause__, DeformError):  # of an object, whose own places are in it
        reason = str(error.__cause__)
        return f"{place}{reason}" if reason.startswith("[") else reason
    for code, words in _WORDS.items():
        what = what.replace(code, words)
    what = re.sub(r"`(\w+ *\| *)*\w+`|`", lambda found: found[0].strip("`").replace(" | ", " or "), what)
    place = where.strip("`.")
    return (
        f"{place}: {what[:1].lower()}{what[1:]}." if place else f"it is no such message: {what[:1].lower()}{what[1:]}."
    )


def check_size(content: Any, most: int) -> Any:
    """Refuse what has more bytes as JSON; half characters, as JavaScript cuts them, become question marks.

    Examples
    --------
    >>> check_size({"name": chr(0xD83D)}, 100)
    {'name': '?'}
    """
    try:
        size = len(msgspec.json.encode(content))
    except UnicodeEncodeError:
        content = _replace_surrogates(content)
        size = len(msgspec.json.encode(content))
    except (TypeError, ValueError, OverflowError, RecursionError):
        raise DeformError("it is no JSON.") from None
    if size > most:
        raise DeformError(f"it has {size} bytes, more than {most}.")
    return content


def check_buffers(described: Buffers, given: Any) -> None:
    """Refuse binary buffers that are not those of the record."""
    sizes = [memoryview(buffer).nbytes for buffer in given or ()]
    if described.count is not None and len(sizes) != described.count:
        raise DeformError(f"it has {len(sizes)} buffers, not {described.count}.")
    if any(size > described.most for size in sizes):
        raise DeformError(f"a buffer has {max(sizes)} bytes, more than {described.most}.")
