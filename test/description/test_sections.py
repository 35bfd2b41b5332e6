"""Sections as classes: what is read, what is refused with which words and line, and that what is written is read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import pytest
from hypothesis import given

from rotary_error_monitor.description.expected import Expected, Key, Stated, entries, expectations, parts, text_of
from rotary_error_monitor.description.machine_section import ParameterSection, TreeSection
from rotary_error_monitor.description.sections import Section, extended, from_content, narrowed, read, stated, write
from rotary_error_monitor.description.sensor_section import listed_kinds
from rotary_error_monitor.description.stage_section import StageSection
from rotary_error_monitor.description.wire_section import WireSection
from rotary_error_monitor.description.yaml_files import parse_yaml
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.kinds.mount.description import MountDescription
from rotary_error_monitor.kinds.quadrature.description import QuadratureDescription

from . import drawn

Pair = Annotated[tuple[float, float], Expected("[low, high] in m")]


@dataclass(frozen=True)
class Spring:
    rate: Annotated[float, Expected("a rate in N/m from 1 to 1e6", 1, 1e6)] = 100.0
    preload: Annotated[float, Expected("a force in N above 0", above=0, most=10)] = 1.0


@dataclass(frozen=True)
class Wheel(Section):
    place: Annotated[str, Key]
    teeth: Annotated[int, Expected("a number of teeth", 1, 500)]
    reach: Pair = (0.0, 1.0)
    turns: Annotated[Literal["left", "right"] | None, Expected("left or right", null=True)] = None
    ratio: Annotated[float | None, Expected("a ratio", -10, 10, size=0.5)] = None

    def contradictions(self) -> Iterator[tuple[tuple[str | int, ...], str]]:
        if self.reach[0] >= self.reach[1]:
            yield ("reach",), "does not rise"


@dataclass(frozen=True)
class Gearbox:
    oiled: bool
    wheels: Annotated[
        Mapping[Annotated[str, Expected(pattern="^[a-z]+$")], Wheel], Expected("wheels by place", count=(1, 2))
    ]
    names: Annotated[tuple[str, ...], Expected("at most 3 names", count=(0, 3), unique=True)] = ()
    spring: Annotated[Mapping[str, float], Stated(Spring)] = field(default_factory=dict)


RIGHT = """\
gearbox:
  oiled: true
  wheels:
    input: {teeth: 12.0, reach: [1, 2], turns: null}
    output: {teeth: 30, ratio: -2}
  names: [a, b]
  spring: {rate: 7}
"""


def load(text: str) -> Gearbox:
    return read(Gearbox, parse_yaml(text, "g.yaml"), ("gearbox",), "gearbox")


def test_a_section_is_read_with_the_types_of_its_fields():
    found = load(RIGHT)
    assert found == Gearbox(
        True,
        {"input": Wheel("input", 12, (1.0, 2.0)), "output": Wheel("output", 30, ratio=-2.0)},
        ("a", "b"),
        {"rate": 7.0},
    )
    assert type(found.wheels["input"].teeth) is int and type(found.wheels["input"].reach[0]) is float
    assert type(found.spring["rate"]) is float, "the default of what is not stated is not stated"


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("oiled: true", "oiled: 1", "2: gearbox.oiled: 1 is no truth value"),
        ("  oiled: true\n", "", "1: gearbox: 'oiled' is a required property"),
        ("teeth: 30", "teeth: true", "5: gearbox.wheels.output.teeth: True is no number; expected: a number of teeth"),
        ("teeth: 30", "teeth: 1.5", "5: gearbox.wheels.output.teeth: 1.5 is no whole number; expected: a number of"),
        ("teeth: 30", "teeth: 0", "5: gearbox.wheels.output.teeth: 0 is less than the minimum of 1; expected: a num"),
        ("teeth: 30", "teeth: 501", "5: gearbox.wheels.output.teeth: 501 is greater than the maximum of 500; expected"),
        ("teeth: 30, ", "", "5: gearbox.wheels.output: 'teeth' is a required property; expected: a number of teeth"),
        ("teeth: 30", "teeth: 30, tooth: 1", "'tooth' was unexpected; expected: one of teeth, reach, turns, ratio"),
        ("teeth: 30", "place: x, teeth: 30", "'place' was unexpected"),
        ("ratio: -2", "ratio: -0.4", "output.ratio: -0.4 is too near to 0; expected: a ratio"),
        ("ratio: -2", "ratio: 1e-6", "'1e-6' is no number; expected: a number; YAML takes 1e-6 for text, write 1.0e"),
        ("ratio: -2", "ratio: null", "output.ratio: None is no number; expected: a ratio"),
        ("turns: null", "turns: up", "4: gearbox.wheels.input.turns: 'up' is not one of ['left', 'right']; expected"),
        ("reach: [1, 2]", "reach: [1]", "input.reach: [1] is too short; expected: [low, high] in m"),
        ("reach: [1, 2]", "reach: [1, 2, 3]", "input.reach: [1, 2, 3] is too long; expected: [low, high] in m"),
        ("reach: [1, 2]", "reach: {a: 1}", "input.reach: {'a': 1} is no list; expected: [low, high] in m"),
        ("reach: [1, 2]", "reach: [1, x]", "input.reach.1: 'x' is no number"),
        ("reach: [1, 2]", "reach: [2, 1]", "4: gearbox.wheels.input.reach: does not rise"),
        ("    input:", "    in2:", "4: gearbox.wheels: 'in2' does not match '^[a-z]+$'; expected: wheels by place"),
        ("  names:", "    third: {teeth: 3}\n  names:", "is too long; expected: wheels by place"),
        ("[a, b]", "[a, a]", "6: gearbox.names: ['a', 'a'] has an entry twice; expected: at most 3 names"),
        ("[a, b]", f"[{', '.join(map('n{}'.format, range(20)))}]", "6: gearbox.names: 20 entries; expected: at most 3"),
        ("rate: 7", "rate: 0.5", "7: gearbox.spring.rate: 0.5 is less than the minimum of 1; expected: a rate in N/m"),
        ("rate: 7", "preload: 0", "spring.preload: 0 is less than or equal to the minimum of 0; expected: a force in"),
        ("rate: 7", "stiff: 7", "7: gearbox.spring: 'stiff' was unexpected; expected: one of rate, preload"),
        ("gearbox:", "box:", "1: (top level): 'gearbox' is a required property"),
        (RIGHT, "- 1\n", "1: (top level): [1] is no mapping; expected: a mapping with 'gearbox'"),
        (RIGHT, "gearbox: 3\n", "1: gearbox: 3 is no mapping; expected: {oiled, wheels, names, spring}"),
    ],
)
def test_what_is_wrong_is_told_with_its_line_and_what_is_right(old, new, told):
    assert RIGHT.count(old) == 1
    with pytest.raises(InputError) as error:
        load(RIGHT.replace(old, new))
    said = str(error.value)
    assert said.startswith("g.yaml:") and told in said


def test_an_empty_file_is_told():
    with pytest.raises(InputError, match=r"^g\.yaml: the file is empty; expected is a description \(gearbox\)$"):
        load("# nothing\n")


def test_a_range_holds_for_files_alone():
    assert Wheel("x", 100_000).teeth == 100_000, "a diagnosis may try it"
    with pytest.raises(InputError, match=r"^memory: memory\.teeth: 100000 is greater"):
        from_content(Wheel, {"teeth": 100_000}, "memory")


@given(content=drawn.contents(Gearbox))
def test_what_is_written_is_read_again(content: Any):
    for wheel in content["wheels"].values():
        wheel["reach"] = [1.0, 2.0]
    found = from_content(Gearbox, content, "gearbox")
    assert from_content(Gearbox, write(found), "gearbox") == found


def test_nothing_is_written_of_what_is_none_or_empty():
    written = write(Gearbox(False, {"a": Wheel("a", 1)}))
    assert written == {"oiled": False, "wheels": {"a": {"teeth": 1, "reach": [0.0, 1.0]}}}


def test_a_derived_section_is_its_base_and_more():
    @dataclass(frozen=True, kw_only=True)
    class Tight(Spring):
        torque: float

    tight = extended(Tight, Spring(2.0, 3.0), torque=4.0)
    assert stated(tight) == {"rate": 2.0, "preload": 3.0, "torque": 4.0} and narrowed(Spring, tight) == Spring(2.0, 3.0)


def sections_below(section: Any, seen: set[Any]) -> set[Any]:
    """All sections that a section is of."""
    if section not in seen and hasattr(section, "__dataclass_fields__"):
        seen.add(section)
        for each in entries(section):
            plain, notes = parts(each.kind)
            inner = [
                plain,
                *getattr(plain, "__args__", ()),
                *(note.section for note in notes if isinstance(note, Stated)),
            ]
            for kind in inner:
                sections_below(parts(kind)[0], seen)
    return seen


ROOTS = [StageSection, TreeSection, ParameterSection, WireSection, MountDescription, QuadratureDescription]


def test_each_value_of_the_package_says_what_is_right():
    """A number or text that a file may state has words, and its default is one that a file might have stated."""
    seen: set[Any] = set()
    for section in [*ROOTS, *listed_kinds().values()]:
        sections_below(section, seen)
    assert len(seen) >= 30
    for section in seen:
        for each in entries(section):
            plain, _ = parts(each.kind)
            if plain in (float, int, str) and each.name != "kind" and not each.is_key:
                assert text_of(each.kind), f"{section.__name__}.{each.name}"
            default = section.__dataclass_fields__[each.name].default
            if isinstance(default, float | int | tuple) and default != ():
                problems = [expected.problem(default) for expected in expectations(each.kind)]
                assert not any(problems), f"{section.__name__}.{each.name}: {problems}"
