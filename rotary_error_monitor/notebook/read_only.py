"""Results that nobody changes by accident: arrays that cannot be written to, and mappings that stay as they are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import TypeVar

import numpy as np

Value = TypeVar("Value")
Whole = TypeVar("Whole")


class ReadOnly(Mapping[str, Value]):
    """A mapping without a way to change it, which unlike `types.MappingProxyType` can be pickled."""

    __slots__ = ("_items",)

    def __init__(self, items: Mapping[str, Value]) -> None:
        self._items = dict(items)

    def __getitem__(self, name: str) -> Value:
        return self._items[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __repr__(self) -> str:
        return repr(self._items)


def sealed(value: Whole) -> Whole:
    """The value with all arrays in it, in whatever dataclass, mapping or sequence, made read-only in place."""
    if isinstance(value, np.ndarray):
        value.flags.writeable = False
    elif is_dataclass(value):
        for each in fields(value):
            sealed(getattr(value, each.name))
    elif isinstance(value, Mapping):
        for part in value.values():
            sealed(part)
    elif isinstance(value, tuple | list):
        for part in value:
            sealed(part)
    return value
