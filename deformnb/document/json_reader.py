"""Typed access to JSON, which checks every value and names the place of a wrong one."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from deformnb.errors import DeformError


class JsonReader:
    """Typed access to a JSON object; every error names the place."""

    def __init__(self, data: Any, where: str) -> None:
        if not isinstance(data, dict):
            raise DeformError(f"{where} must be an object, got {type(data).__name__}.")
        self.data, self.where = data, where

    def value(self, key: str, kinds: tuple[type, ...], default: Any) -> Any:
        value = self.data.get(key, default)
        if value is ... or not isinstance(value, kinds) or (isinstance(value, bool) and bool not in kinds):
            what = " or ".join(k.__name__ for k in kinds)
            got = "nothing" if value is ... else repr(value)[:40]
            raise DeformError(f"{self.where}.{key} must be of type {what}, got {got}.")
        return value

    def text(self, key: str, default: Any = ...) -> str:
        return str(self.value(key, (str,), default))

    def flag(self, key: str, default: Any = ...) -> bool:
        return bool(self.value(key, (bool,), default))

    def integer(self, key: str, default: Any = ...) -> int:
        value = self.value(key, (int,), default)
        if abs(value) > 2**53:
            raise DeformError(f"{self.where}.{key} is too large.")
        return int(value)

    def number(self, key: str, default: Any = ...) -> float:
        return self._finite(self.value(key, (int, float), default), key)

    def numbers(self, key: str, length: int | None = None, default: Any = ...) -> tuple[float, ...]:
        values = self.value(key, (list, tuple), default)
        if length is not None and len(values) != length:
            raise DeformError(f"{self.where}.{key} must have {length} numbers, got {len(values)}.")
        for v in values:
            if not isinstance(v, (int, float)) or isinstance(v, bool):
                raise DeformError(f"{self.where}.{key} must be a list of numbers, got {v!r:.40}.")
        return tuple(self._finite(v, key) for v in values)

    def _finite(self, value: Any, key: str) -> float:
        try:
            number = float(value)
        except OverflowError:
            number = np.inf
        if not np.isfinite(number):
            raise DeformError(f"{self.where}.{key} is not a finite number.")
        return number

    def part(self, key: str) -> JsonReader:
        return JsonReader(self.data.get(key), f"{self.where}.{key}")

    def items(self, key: str, default: Any = ...) -> list[JsonReader]:
        return [JsonReader(v, f"{self.where}.{key}[{k}]") for k, v in enumerate(self.value(key, (list,), default))]

    def rest(self, known: set[str]) -> Mapping[str, Any]:
        return {k: v for k, v in self.data.items() if k not in known}


def without_surrogates(text: str) -> str:
    """Text with halves of surrogate pairs escaped: legal in names in Python and JSON, but not in UTF-8."""
    return re.sub("[\ud800-\udfff]", lambda m: f"\\u{ord(m[0]):04x}", text)
