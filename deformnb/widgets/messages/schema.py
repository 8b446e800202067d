"""Types of messages in words, for the documentation, and as TypeScript, for the front ends."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NotRequired, Required, Union, get_args, get_origin, get_type_hints

from msgspec import NODEFAULT, Meta, Struct, UnsetType, structs

from deformnb.widgets.messages.editors import EDITOR, SPACE_EDITOR
from deformnb.widgets.messages.inputs import BOXES, HEAD, LIST, RESTORE, TABLE, TRANSFER, UPLOAD, VALUE
from deformnb.widgets.messages.record import OBJECTS, Message
from deformnb.widgets.messages.views import LIVE, SERVED

CHANNELS = (EDITOR, SPACE_EDITOR, VALUE, LIST, TABLE, TRANSFER, UPLOAD, RESTORE, HEAD, BOXES, LIVE, SERVED)
"""Those of all widgets."""


def fields(record: type) -> Iterator[tuple[str, Any, bool]]:
    """Name and type of each field of a record, and whether it may be left out."""
    hints = get_type_hints(record, include_extras=True)
    if issubclass(record, Struct):
        for field in structs.fields(record):
            yield (
                field.name,
                hints[field.name],
                field.default is not NODEFAULT or field.default_factory is not NODEFAULT,
            )
    else:
        for name, hint in hints.items():
            yield name, hint, _is_optional(hint)


def _is_optional(hint: Any) -> bool:
    """Check whether a key of a dictionary is marked; its own list of keys knows no annotations that are text."""
    return get_origin(hint) is NotRequired or (get_origin(hint) is Annotated and _is_optional(hint.__origin__))


def metas(hint: Any) -> tuple[Any, tuple[Meta, ...]]:
    """A type without its notes, and those."""
    if get_origin(hint) is Annotated:
        return metas(hint.__origin__)[0], (*metas(hint.__origin__)[1], *hint.__metadata__)
    if get_origin(hint) in (NotRequired, Required):
        return metas(get_args(hint)[0])
    return hint, ()


def meaning(hint: Any) -> str:
    """The meaning of a field, and its bounds."""
    _, notes = metas(hint)
    said = [note.description for note in notes if note.description]
    return said[-1] if said else ""


def bounds(hint: Any) -> str:
    """Bounds of a type in words.

    Examples
    --------
    >>> bounds(Annotated[int, Meta(ge=0, le=4)]), bounds(Annotated[str, Meta(max_length=40)])
    ('0 to 4', 'at most 40 characters')
    """
    inner, notes = metas(hint)
    if get_origin(inner) in (Union, UnionType):
        return next((found for part in get_args(inner) if (found := bounds(part))), "")
    said: dict[str, Any] = {}
    for note in notes:
        said |= {
            name: value
            for name in ("ge", "gt", "le", "lt", "min_length", "max_length")
            if (value := getattr(note, name)) is not None
        }
    if "max_length" in said or "min_length" in said:
        things = "characters" if inner is str else "items"
        low, high = said.get("min_length"), said.get("max_length")
        if low is not None and low == high:
            return f"{low} {things}"
        return f"at most {high} {things}" if not low else f"{low} to {high} {things}"
    low, high = said.get("ge", said.get("gt")), said.get("le", said.get("lt"))
    if high in (None, 1e300, 2**53 - 1):
        return f"from {low}" if low in (0, 1) else ""
    return f"{low} to {high}"


@dataclass(frozen=True)
class _Notation:
    """A notation for types: the text of each kind, from the texts of its parts.

    Parameters
    ----------
    name : key of the ``extra`` of a :class:`msgspec.Meta` that replaces the text.
    scalars : texts of the types without parts.
    alternative : between the members of a union, and the values of a Literal.
    array : of an item, the least number of items, and whether no more are allowed.
    sequence : of the items of a tuple.
    mapping : of the values of a dictionary with text as keys.
    """

    name: str
    scalars: dict[Any, str]
    alternative: str
    array: Callable[[str, int, bool], str]
    sequence: Callable[[list[str]], str]
    mapping: Callable[[str], str]


def _typescript_array(item: str, least: int, is_fixed: bool) -> str:
    rest = f"({item})[]" if " | " in item else f"{item}[]"
    return f"[{', '.join([item] * least + [f'...{rest}'] * (not is_fixed))}]" if least else rest


_WORDS = _Notation(
    "words",
    {str: "text", int: "whole number", float: "number", bool: "true or false", NoneType: "null", Any: "any JSON"},
    " or ",
    lambda item, *_: f"list of {item}" if item.endswith("s") else f"list of {item}s",
    lambda items: f"{len(items)} {items[0]}s",
    lambda _: "object",
)
_TYPESCRIPT = _Notation(
    "typescript",
    {str: "string", int: "number", float: "number", bool: "boolean", NoneType: "null", Any: "unknown"},
    " | ",
    _typescript_array,
    lambda items: f"[{', '.join(items)}]",
    lambda value: f"Record<string, {value}>",
)


def words(hint: Any) -> str:
    """A type in words.

    Examples
    --------
    >>> words(Literal["move", "end"] | None), words(list[float]), words(dict[str, Any])
    ('"move" or "end" or null', 'list of numbers', 'object')
    """
    return _write(hint, _WORDS)


def typescript(hint: Any) -> str:
    """A type as TypeScript.

    Examples
    --------
    >>> typescript(Literal["move", "end"] | None), typescript(list[float]), typescript(dict[str, Any])
    ('"move" | "end" | null', 'number[]', 'Record<string, unknown>')
    >>> typescript(Annotated[list[float], Meta(min_length=2, max_length=3)])
    '[number, number, ...number[]]'
    """
    return _write(hint, _TYPESCRIPT)


def _write(hint: Any, notation: _Notation) -> str:
    inner, notes = metas(hint)
    kind, parts = get_origin(inner), get_args(inner)
    given = [note.extra[notation.name] for note in notes if note.extra and notation.name in note.extra]
    if given:
        null = notation.alternative + notation.scalars[NoneType]
        return str(given[-1]) + (null if NoneType in parts else "")
    if inner in OBJECTS:
        return _write(OBJECTS[inner][0], notation)
    if kind is Literal:
        return notation.alternative.join(json.dumps(value) for value in parts)
    texts = [_write(part, notation) for part in parts if part is not UnsetType]
    if kind in (Union, UnionType):
        return notation.alternative.join(texts)
    if kind is list:
        least = max((note.min_length or 0 for note in notes), default=0)
        return notation.array(texts[0], least, any(note.max_length == least for note in notes))
    if kind is tuple:
        return notation.sequence(texts)
    if kind is dict:
        return notation.mapping(texts[1])
    return str(inner.__name__) if _is_record(inner) else notation.scalars[inner]


def _is_record(inner: Any) -> bool:
    return inspect.isclass(inner) and (issubclass(inner, Struct) or hasattr(inner, "__required_keys__"))


def interface(record: type, is_received: bool = False) -> str:
    """The interface of a record.

    Parameters
    ----------
    is_received : whether Python receives it, so that a field with a default may be left out.
    """
    lines = [
        f"/** {inspect.cleandoc(record.__doc__ or '').splitlines()[0]} */",
        f"export interface {record.__name__} {{",
    ]
    config = getattr(record, "__struct_config__", None)
    if (
        config is not None
        and config.tag is not None
        and (not issubclass(record, Message) or config.tag != record.__name__)
    ):
        lines.append(f"  {config.tag_field}: {json.dumps(config.tag)};")
    for name, hint, has_default in fields(record):
        about = "; ".join(part for part in (meaning(hint), bounds(hint)) if part)
        if about:
            lines.append(f"  /** {about[:1].upper()}{about[1:]}. */")
        may_miss = has_default and (
            is_received or UnsetType in get_args(metas(hint)[0]) or not issubclass(record, Struct)
        )
        lines.append(f"  {name}{'?' if may_miss else ''}: {typescript(hint)};")
    return "\n".join([*lines, "}"])


def records_in(hint: Any) -> Iterator[type]:
    """All records that a type needs, those first that others need."""
    inner, _ = metas(hint)
    if inner in OBJECTS:
        yield from records_in(OBJECTS[inner][0])
    elif _is_record(inner):
        for _, part, _ in fields(inner):
            yield from records_in(part)
        yield inner
    else:
        for part in get_args(inner):
            if not isinstance(part, str):
                yield from records_in(part)
