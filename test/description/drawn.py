"""Whatever a section of the package allows, drawn by hypothesis as content of a file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import reduce
from typing import Any, Literal, get_args, get_origin

from hypothesis import strategies as st

from rotary_error_monitor.description.expected import Expected, Stated, entries, expectations, parts
from rotary_error_monitor.description.machine_section import (
    MachineSection,
    ParameterSection,
    TableSection,
    TreeSection,
)
from rotary_error_monitor.description.periodic_tables import FEWEST, PeriodicTable
from rotary_error_monitor.description.sensor_section import SensorSection, listed_kinds
from rotary_error_monitor.description.wire_section import SAMPLE_BLOCK, TopicSection

VARIANTS = {
    SensorSection: lambda: list(listed_kinds().items()),
    MachineSection: lambda: [(None, TreeSection), (None, ParameterSection)],
}
"""Sections that are one of several, with what `kind` says of each."""

MOST_DRAWN = 6


def contents(kind: Any) -> st.SearchStrategy[Any]:
    """Contents that a type with annotations allows; what a section holds against itself is not met."""
    plain, notes = parts(kind)
    wanted = reduce(_both, expectations(kind), Expected())
    base = get_origin(plain) or plain
    whole = [note.section for note in notes if isinstance(note, Stated)]
    drawn = _section(whole[0], partly=True) if whole else _plain(base, plain, wanted)
    return drawn | st.none() if wanted.null else drawn


def _plain(base: Any, plain: Any, wanted: Expected) -> st.SearchStrategy[Any]:
    size = {"min_size": wanted.count[0], "max_size": int(min(wanted.count[1], wanted.count[0] + 3))}
    if base is float:
        return _floats(wanted)
    if base is int:
        return st.integers(int(wanted.least), int(wanted.most))
    if base is str:
        return _texts(wanted)
    if base is bool:
        return st.booleans()
    if base is Literal:
        return st.sampled_from(get_args(plain))
    if base is Any:
        return st.none() | st.booleans() | st.text(max_size=3)
    if base is tuple:
        first, *rest = get_args(plain)
        if rest == [...]:
            return st.lists(contents(first), unique=wanted.unique, **size)
        return st.tuples(contents(first), *map(contents, rest)).map(list)
    if base is Mapping:
        name, value = get_args(plain)
        most = min(wanted.count[1], MOST_DRAWN)
        return st.dictionaries(contents(name), contents(value), min_size=wanted.count[0], max_size=int(most))
    if base in VARIANTS:
        return st.one_of([_section(each, tag) for tag, each in VARIANTS[base]()])
    return _section(base).filter(lambda found: len(found) >= wanted.count[0])


def _section(section: type[Any], tag: str | None = None, partly: bool = False) -> st.SearchStrategy[Any]:
    known = {
        each.name: (each.required and not partly, contents(each.kind)) for each in entries(section) if not each.is_key
    }
    if section is TopicSection:  # of sample blocks, and of other messages
        rest = {name: known[name] for name in known if name not in ("fields", "columns")}
        fields, columns = (True, known["fields"][1]), (True, known["columns"][1])
        return _fixed({**rest, "fields": fields}) | _fixed(
            {**rest, "columns": columns, "type": (True, st.just(SAMPLE_BLOCK))}
        )
    if section is TableSection:  # values, or forward and backward
        first, values, *both = ((name, (True, drawn)) for name, (_, drawn) in known.items())
        return _fixed(dict([first, values])) | _fixed(dict([first, *both]))
    if issubclass(section, PeriodicTable):
        return st.integers(2 * FEWEST, 3 * FEWEST).flatmap(lambda count: _turn(known, count))
    if tag is not None:
        known["kind"] = True, st.just(tag)
    return _fixed(known)


def _turn(known: dict[str, tuple[bool, st.SearchStrategy[Any]]], count: int) -> st.SearchStrategy[Any]:
    """A value of each column at angles all round, in about equal steps."""
    step = 2 * math.pi / count
    off = st.lists(st.floats(-0.2, 0.2), min_size=count, max_size=count)
    angles = off.map(lambda parts: [step * (k + part) for k, part in enumerate(parts)])
    many = {
        name: (required, drawn.map(lambda some: (some * count)[:count])) for name, (required, drawn) in known.items()
    }
    return _fixed({**many, "angles": (True, angles)})


def _fixed(known: dict[str, tuple[bool, st.SearchStrategy[Any]]]) -> st.SearchStrategy[Any]:
    """Mappings with what is required, and what is not or not."""
    return st.fixed_dictionaries(
        {name: drawn for name, (required, drawn) in known.items() if required},
        optional={name: drawn for name, (required, drawn) in known.items() if not required},
    )


def _both(one: Expected, other: Expected) -> Expected:
    """What is right for both."""
    return Expected(
        least=max(one.least, other.least),
        most=min(one.most, other.most),
        above=max(one.above, other.above),
        size=max(one.size, other.size),
        count=(max(one.count[0], other.count[0]), min(one.count[1], other.count[1])),
        pattern=other.pattern or one.pattern,
        unique=one.unique or other.unique,
        null=one.null or other.null,
    )


def _floats(wanted: Expected) -> st.SearchStrategy[float]:
    low, high = max(wanted.least, wanted.above), wanted.most
    edge = {"exclude_min": wanted.above >= wanted.least and wanted.above > -1e308}
    bounds = {"min_value": low if low > -1e308 else None, "max_value": high if high < 1e308 else None}
    floats = st.floats(**bounds, **edge, allow_nan=False, allow_infinity=False)
    ordinary = st.floats(max(low, -1e3), min(high, 1e3), **edge)
    if low <= 0 <= high < 1e308 and low > -1e308:
        ordinary = st.floats(low / 100, high / 100, **edge)
    drawn = ordinary | floats
    return drawn.filter(lambda value: abs(value) >= wanted.size) if wanted.size else drawn


def _texts(wanted: Expected) -> st.SearchStrategy[str]:
    if wanted.pattern is not None:
        pattern = wanted.pattern.removesuffix("$") + r"\Z"  # $ alone lets a line break follow
        return st.from_regex(pattern, alphabet=st.characters(codec="ascii") | st.just("°"))
    return st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"]), min_size=wanted.count[0])
