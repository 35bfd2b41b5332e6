"""Sections of YAML files as classes: a field states name, type, unit, range and default once; the rest follows here.

A section is a frozen dataclass. Its fields say by `Annotated` and `Expected` what a file may hold. From that follow
reading, the message where something is wrong (file, line, place, value, what is expected) and writing.

Fields may be float, int, str, bool, a `Literal`, a tuple, a mapping with text for keys, another section, or `X | None`
for what a file may leave out. A range holds for files alone: in memory a diagnosis may try what no file would state.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeVar, get_args, get_origin

import yaml

from rotary_error_monitor.description.expected import Stated, entries, expectations, parts, text_of
from rotary_error_monitor.description.yaml_files import YamlContent, read_yaml
from rotary_error_monitor.errors import InputError, excerpt

T = TypeVar("T")
Place = tuple[str | int, ...]


class WrongError(Exception):
    """Something is wrong at a place in a file."""

    def __init__(
        self, place: Place, problem: str, expected: str = "", value: object = None, key: str | None = None
    ) -> None:
        """Place, what is wrong there, what is expected, and the value or the key below it if that is what is wrong."""
        super().__init__(problem)
        self.place, self.problem, self.expected, self.value, self.key = place, problem, expected, value, key

    def at(self, place: Place) -> WrongError:
        """The same at another place."""
        return WrongError(place, self.problem, self.expected, self.value, self.key)


class Section:
    """Base of sections that are more than their fields."""

    is_open: ClassVar[bool] = False
    """Whether a file may state more than the fields."""

    names_as: ClassVar[str] = "one of"
    """What stands before the names of the fields where a file states another."""

    beside: ClassVar[tuple[str, ...]] = ()
    """What a file may state beside the fields: `arranged` takes it out."""

    @classmethod
    def variant(cls, content: Mapping[str, Any]) -> type[Any]:
        """The class that a content is of: this, or one of several in its place.

        Raises:
            WrongError: the content is of none.
        """
        return cls

    @classmethod
    def arranged(cls, content: Mapping[str, Any]) -> tuple[Mapping[str, Any], Mapping[Place, Place]]:
        """The content with all where the fields are, and where in the file stands what was moved for that.

        Raises:
            WrongError: what would be moved is there already.
        """
        return content, {}

    def contradictions(self) -> Iterator[tuple[Place, str]]:
        """Places below the section whose values do not go together, and what would be right."""
        yield from ()


def load(path: Path | str, name: str, section: type[T]) -> T:
    """The section under the key `name` of the YAML file `path`.

    Raises:
        InputError: what `read_yaml` and `read` raise.
    """
    return read(section, read_yaml(Path(path)), (name,), name)


def read(section: type[T], found: YamlContent, place: Place = (), what: str = "") -> T:
    """What stands at a place in a file, as a section; `what` names the description that is expected.

    Raises:
        InputError: it is not there, breaks what the section states or contradicts itself; the message names file, line,
            place, value and what is expected.
    """
    if found.node is None:
        raise InputError(f"{found.origin}: the file is empty; expected is a description ({what})")
    content = found.content
    try:
        for depth, step in enumerate(place):
            if not isinstance(content, Mapping):
                raise WrongError(place[:depth], f"{content!r} is no mapping", f"a mapping with '{step}'", content)
            if step not in content:
                there = excerpt(", ".join(map(str, content))) or "nothing"
                wanted = f"a section '{step}' beside {there}"
                raise WrongError(place[:depth], f"{step!r} is a required property", wanted)
            content = content[step]
        made: T = _read(section, content, place)
    except WrongError as error:
        raise InputError(_message(error, found)) from None
    return made


def locate(path: Path | str, place: Place) -> str:
    """`file:line: key.key` of a place in the YAML file `path`, to begin a message about its value with."""
    return place_named(read_yaml(Path(path)), place)


def place_named(found: YamlContent, place: Place) -> str:
    """`file:line: key.key` of a place in what was read, to begin a message about its value with."""
    line = _line(found.node, place)
    where = f"{found.origin}:{line}" if line else found.origin
    return f"{where}: {'.'.join(map(str, place))}"


def from_content(section: type[T], content: object, name: str) -> T:
    """A section from content that is in memory; messages call it `name`.

    Raises:
        InputError: as `read`.
    """
    return read(section, YamlContent(name, "", {name: content}, yaml.MappingNode("", [])), (name,))


def write(value: Any) -> Any:  # noqa: ANN401 (what YAML holds)
    """Content of a file from a section: what is None or empty is left out."""
    if dataclasses.is_dataclass(value):
        own = {each.name: write(getattr(value, each.name)) for each in entries(type(value)) if not each.is_key}
        return {name: each for name, each in own.items() if each is not None and each not in ([], {})}
    if isinstance(value, Mapping):
        return {key: write(each) for key, each in value.items()}
    return [write(each) for each in value] if isinstance(value, list | tuple) else value


def stated(section: object) -> dict[str, Any]:
    """Fields of a section without those that the file leaves out."""
    values = {each.name: getattr(section, each.name) for each in entries(type(section))}
    return {name: value for name, value in values.items() if value is not None}


def narrowed(kind: type[T], section: object) -> T:
    """The part of a section that is of a class from which it is derived."""
    return kind(**{each.name: getattr(section, each.name) for each in entries(kind)})


def extended(section: type[T], part: object, **more: Any) -> T:  # noqa: ANN401 (fields of any type)
    """A section that is derived from the class of `part`, with `more` in the fields that this does not have."""
    names = {each.name for each in entries(section)} - set(more)
    return section(**{name: value for name, value in stated(part).items() if name in names}, **more)


def _read(kind: Any, value: Any, place: Place) -> Any:  # noqa: ANN401 (a type with annotations, what YAML holds)
    (plain, notes), wanted, text = parts(kind), expectations(kind), text_of(kind)
    if value is None and any(each.null for each in wanted):
        return None
    base = get_origin(plain) or plain
    fits, name = _TYPES.get(base, _TYPES[Mapping])
    if not isinstance(value, fits) or (isinstance(value, bool) and base in (float, int)):
        raise WrongError(place, f"{value!r} is no {name}", text or _names(base), value)
    for each in wanted:
        if problem := each.problem(value):
            raise WrongError(place, problem, text, value)
    for note in notes:
        if isinstance(note, Stated):
            return _values(note.section, value, place, text, partly=True)
    if base in _READERS:
        return _READERS[base](get_args(plain), value, place, text)
    return value if base in _TYPES else _section(base, value, place, text)


_TYPES: dict[Any, tuple[Any, str]] = {
    Any: (object, "value"),
    Literal: (object, "value"),
    float: (int | float, "number"),
    int: (int | float, "number"),
    str: (str, "text"),
    bool: (bool, "truth value"),
    tuple: (list | tuple, "list"),
    Mapping: (Mapping, "mapping"),
}


def _whole(_: Any, value: float, place: Place, text: str) -> int:  # noqa: ANN401 (nothing)
    if value != int(value):
        raise WrongError(place, f"{value!r} is no whole number", text, value)
    return int(value)


def _choice(choices: tuple[Any, ...], value: object, place: Place, text: str) -> object:
    for choice in choices:
        if choice == value and isinstance(choice, bool) == isinstance(value, bool):
            return choice
    raise WrongError(place, f"{value!r} is not one of {list(choices)}", text, value)


def _tuple(kinds: tuple[Any, ...], value: Sequence[Any], place: Place, text: str) -> tuple[Any, ...]:
    kinds = (kinds[0],) * len(value) if kinds[-1] is Ellipsis else kinds
    return tuple(_read(kind, each, (*place, at)) for at, (kind, each) in enumerate(zip(kinds, value, strict=True)))


def _mapping(kinds: tuple[Any, Any], value: Mapping[str, Any], place: Place, text: str) -> dict[str, Any]:
    key, kind = kinds
    for name in value:
        try:
            _read(key, name, place)
        except WrongError as error:
            raise WrongError(place, error.problem, error.expected or text, key=name) from None
    return {name: _read(kind, each, (*place, name)) for name, each in value.items()}


_READERS: dict[Any, Any] = {
    float: lambda _, value, place, text: float(value),
    int: _whole,
    Literal: _choice,
    tuple: _tuple,
    Mapping: _mapping,
}


def _section(kind: type[Any], value: Mapping[str, Any], place: Place, text: str) -> Any:  # noqa: ANN401 (any section)
    if not issubclass(kind, Section):
        return kind(**_values(kind, value, place, text))
    try:
        kind = kind.variant(value)
        value, moved = kind.arranged(value)
    except WrongError as error:
        raise error.at((*place, *error.place)) from None
    try:
        made = kind(**_values(kind, value, place, text))
        for below, problem in made.contradictions():
            raise WrongError((*place, *below), problem)
    except WrongError as error:
        raise error.at((*place, *place_in_file(error.place[len(place) :], moved))) from None
    return made


def place_in_file(place: Place, moved: Mapping[Place, Place]) -> Place:
    """Where a place of the arranged content stands in the file, by what `Section.arranged` says was moved."""
    for arranged, stands in moved.items():
        if place[: len(arranged)] == arranged:
            return (*stands, *place[len(arranged) :])
    return place


def _values(kind: type[Any], value: Mapping[str, Any], place: Place, text: str, partly: bool = False) -> dict[str, Any]:
    """Fields of a section from what a file states."""
    known = {each.name: each for each in entries(kind) if not each.is_key}
    rules = kind if issubclass(kind, Section) else Section
    if not rules.is_open:
        check_names(value, known, place, text or f"{rules.names_as} {', '.join((*known, *rules.beside))}")
    for name, each in known.items():
        if name not in value and each.required and not partly:
            raise WrongError(place, f"{name!r} is a required property", text_of(each.kind) or text)
    found = {name: _read(known[name].kind, each, (*place, name)) for name, each in value.items() if name in known}
    return found | {each.name: place[-1] for each in entries(kind) if each.is_key}


def check_names(value: Iterable[str], known: Collection[str], place: Place, expected: str) -> None:
    """Hold what a file states at a place against the names that may stand there.

    Raises:
        WrongError: a name is none of these.
    """
    for name in value:
        if name not in known:
            raise WrongError(place, f"{name!r} was unexpected", expected, key=name)


def _names(kind: type[Any]) -> str:
    """What a file may state of a section; nothing of what is none."""
    if kind in _TYPES:
        return ""
    return f"{{{', '.join(each.name for each in entries(kind) if not each.is_key)}}}"


def _message(error: WrongError, found: YamlContent) -> str:
    line = _line(found.node, error.place if error.key is None else (*error.place, error.key))
    where = f"{found.origin}:{line}" if line else found.origin
    expected = error.expected
    if isinstance(error.value, str) and _is_number(error.value):
        expected = "a number; YAML takes 1e-6 for text, write 1.0e-6"
    place = excerpt(".".join(map(str, error.place))) or "(top level)"
    return f"{where}: {place}: {excerpt(error.problem)}" + (f"; expected: {expected}" if expected else "")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _line(node: yaml.Node | None, path: Place) -> int | None:
    """Line of the deepest node of `path`, counted from 1."""
    if node is None or node.start_mark is None:
        return None
    line = node.start_mark.line + 1
    for step in path:
        if isinstance(node, yaml.MappingNode):
            pair = next(((key, value) for key, value in node.value if key.value == str(step)), None)
            if pair is None:
                break
            line, node = pair[0].start_mark.line + 1, pair[1]
        elif isinstance(node, yaml.SequenceNode) and isinstance(step, int) and step < len(node.value):
            node = node.value[step]
            line = node.start_mark.line + 1
    return int(line)
