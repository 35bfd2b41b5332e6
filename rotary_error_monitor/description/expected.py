"""What a file may hold at a field of a section, said once beside the field: `Annotated[float, Expected("…", 0, 1)]`."""

from __future__ import annotations

import dataclasses
import functools
import math
import re
import types
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

_MANY = 10
"""Entries above which their number says more than they themselves."""


@dataclass(frozen=True)
class Expected:
    """What is right at a place in a file.

    Attributes:
        text: in words, with the unit.
        least: smallest number.
        most: largest number.
        above: a number that it must exceed.
        size: least absolute value of a number.
        count: fewest and most entries of a list or mapping, or characters of a text.
        pattern: regular expression of a text.
        unique: whether no entry may stand twice.
        null: whether null may stand there.
    """

    text: str = ""
    least: float = -math.inf
    most: float = math.inf
    above: float = -math.inf
    size: float = 0.0
    count: tuple[int, float] = (0, math.inf)
    pattern: str | None = None
    unique: bool = False
    null: bool = False

    def problem(self, value: object) -> str | None:
        """What is wrong with a value of the right type; None where nothing is."""
        if isinstance(value, int | float):
            return self._of_number(value)
        if isinstance(value, str) and self.pattern is not None and not re.search(self.pattern, value):
            return f"{value!r} does not match '{self.pattern}'"
        if not isinstance(value, str | list | tuple | Mapping):
            return None
        if len(value) < self.count[0]:
            return f"{value!r} is too short"
        if len(value) > self.count[1]:
            return f"{len(value)} entries" if len(value) > _MANY else f"{value!r} is too long"
        twice = self.unique and any(each in list(value)[:at] for at, each in enumerate(value))
        return f"{value!r} has an entry twice" if twice else None

    def _of_number(self, value: float) -> str | None:
        if not value >= self.least:
            return f"{value!r} is less than the minimum of {self.least}"
        if value <= self.above:
            return f"{value!r} is less than or equal to the minimum of {self.above}"
        if value > self.most:
            return f"{value!r} is greater than the maximum of {self.most}"
        return f"{value!r} is too near to 0" if abs(value) < self.size else None


@dataclass(frozen=True)
class Stated:
    """Annotation of a mapping: those fields of a section that the file states, without its defaults."""

    section: type[Any]


class Key:
    """Annotation of a field that a file states as the key under which the section stands."""


@dataclass(frozen=True)
class Entry:
    """A field of a section: its name, what it holds, whether a file must state it, whether it is the key."""

    name: str
    kind: Any
    required: bool
    is_key: bool


def entries(section: type[Any]) -> tuple[Entry, ...]:
    """What a file may state of a section, in order."""
    kind: Any = section
    return _entries(kind)


@functools.cache
def _entries(section: Any) -> tuple[Entry, ...]:  # noqa: ANN401 (a type, which the type check takes for not hashable)
    hints = get_type_hints(section, include_extras=True)
    none = dataclasses.MISSING
    return tuple(
        Entry(each.name, kind, each.default is none and each.default_factory is none, Key in parts(kind)[1])
        for each, kind in ((each, hints[each.name]) for each in dataclasses.fields(section) if each.init)
    )


@functools.cache
def parts(kind: Any) -> tuple[Any, tuple[Any, ...]]:  # noqa: ANN401 (a type with annotations)
    """A type without annotations and `| None`, and the annotations, the general before the special."""
    notes: tuple[Any, ...] = ()
    while True:
        if get_origin(kind) is Annotated:
            notes, kind = (*kind.__metadata__, *notes), kind.__origin__
        elif get_origin(kind) in (Union, types.UnionType):
            kind = next(each for each in get_args(kind) if each is not types.NoneType)
        else:
            return kind, notes


@functools.cache
def expectations(kind: Any) -> tuple[Expected, ...]:  # noqa: ANN401 (as above)
    """What is expected of a type, the general before the special: of a tuple of some length, that length first."""
    plain, notes = parts(kind)
    length = len(get_args(plain)) if get_origin(plain) is tuple and get_args(plain)[-1] is not Ellipsis else None
    own = () if length is None else (Expected(count=(length, length)),)
    return (*own, *(note for note in notes if isinstance(note, Expected)))


def text_of(kind: Any) -> str:  # noqa: ANN401 (as above)
    """What is expected in words: the most special that is said."""
    return next((each.text for each in reversed(expectations(kind)) if each.text), "")
