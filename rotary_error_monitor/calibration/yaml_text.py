"""YAML text changed in place: only the characters of what is set or removed differ afterwards.

A reader that builds objects and writes them anew loses what is not content: comments, number formats, line endings,
line breaks. Here the text is parsed for where each value stands, and only that span is replaced.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import yaml

LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
Keys = tuple[str | int, ...]
"""The way to a value: keys of mappings, indices of lists."""

WIDTH = 100
"""Column after which a line of new values goes on in the next one; one more value than that still fits in 120."""

END_OF_LINE = re.compile("\r\n|[\r\n\x85\u2028\u2029]|$")
"""Line breaks of YAML 1.1."""

REST_OF_LINE = re.compile("[ \t]*(#[^\r\n\x85\u2028\u2029]*)?")


@dataclass(frozen=True)
class YamlRows:
    """A mapping or a list that is written with a line for each entry; what is not in rows is written in one line."""

    content: Mapping[str, Any] | Sequence[Any]


def plain(value: Any) -> Any:  # noqa: ANN401 (YAML content)
    """The value without `YamlRows`, and nothing in it shared with another place."""
    if isinstance(value, YamlRows):
        return plain(value.content)
    if isinstance(value, Mapping):
        return {key: plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    return value


class CannotChangeError(Exception):
    """The text cannot be changed there without changing another place; the message says where and why."""


@dataclass
class _Node:
    """A value in the text: `start` to `end` without comments after it.

    Attributes:
        items: key (None in a sequence) and value of each entry.
        anchor: its own name for others to use, empty if it has none.
        anchors: those of it and of what is in it.
        aliases: names that are used in it.
    """

    kind: str
    start: int
    end: int
    line: int
    name: str = ""
    flow: bool = True
    items: tuple[tuple[_Node | None, _Node], ...] = ()
    anchor: str = ""
    anchors: frozenset[str] = frozenset()
    aliases: tuple[str, ...] = ()

    def entry(self, step: str | int) -> tuple[_Node | None, _Node] | None:
        if self.kind == "sequence":
            return self.items[step] if isinstance(step, int) and 0 <= step < len(self.items) else None
        return next(((key, value) for key, value in self.items if key is not None and key.name == str(step)), None)


def _parse(text: str) -> _Node:
    events = yaml.parse(text, LOADER)
    first = next(event for event in events if not isinstance(event, yaml.StreamStartEvent | yaml.DocumentStartEvent))
    return _node(first, events, text)


def _node(event: Any, events: Any, text: str) -> _Node:  # noqa: ANN401 (PyYAML carries no types)
    start, end, line = event.start_mark.index, event.end_mark.index, event.start_mark.line + 1
    if isinstance(event, yaml.AliasEvent):
        return _Node("alias", start, end, line, aliases=(str(event.anchor),))
    anchor = event.anchor or ""
    own = frozenset([anchor]) - {""}
    if isinstance(event, yaml.ScalarEvent):
        # text in the styles | and > counts the line breaks after it as its own
        return _Node(
            "scalar", start, start + len(text[start:end].rstrip()), line, event.value, anchor=anchor, anchors=own
        )
    mapping = isinstance(event, yaml.MappingStartEvent)
    items: list[tuple[_Node | None, _Node]] = []
    part: Any
    while not isinstance(part := next(events), yaml.MappingEndEvent | yaml.SequenceEndEvent):
        key = _node(part, events, text) if mapping else None
        items.append((key, _node(next(events) if mapping else part, events, text)))
    flow, last = bool(event.flow_style), part.end_mark
    assert last is not None, "the parser marks what it has read"
    if flow:
        end = last.index
    elif items:
        end = items[-1][1].end
    parts = [node for pair in items for node in pair if node is not None]
    return _Node(
        "mapping" if mapping else "sequence",
        start,
        end,
        line,
        flow=flow,
        items=tuple(items),
        anchor=anchor,
        anchors=own.union(*(node.anchors for node in parts)),
        aliases=tuple(name for node in parts for name in node.aliases),
    )


class YamlText:
    """Text of a YAML file with one mapping, whose values can be set and removed by their path.

    Attributes:
        content: what it says, as plain dicts and lists of which none is shared between two places.
    """

    def __init__(self, text: str) -> None:
        """Take text that is a valid YAML mapping."""
        self._mark = "\ufeff" if text.startswith("\ufeff") else ""
        self._text = text.removeprefix("\ufeff")
        self.content: dict[str, Any] = plain(yaml.load(self._text, LOADER))
        breaks = re.findall("\r\n|\r|\n", self._text)
        self._break = max(("\n", "\r\n", "\r"), key=breaks.count)

    @property
    def text(self) -> str:
        """The text as it is now."""
        return self._mark + self._text

    def get(self, path: Keys) -> Any:  # noqa: ANN401 (YAML content)
        """The value at `path`, None if there is none."""
        value: Any = self.content
        for step in path:
            if isinstance(value, list):
                value = value[step] if isinstance(step, int) and step < len(value) else None
            else:
                value = value.get(step) if isinstance(value, dict) else None
        return value

    def set(self, path: Keys, value: Any) -> str | None:  # noqa: ANN401 (YAML content)
        """Put a value there, in place of what was there or as a new entry, with the mappings above it.

        Gives the comment beside the value that is replaced: it told of the old value and goes with it.

        Raises:
            CannotChangeError: the old value has an anchor that another place needs.
        """
        known = [self.get(path[: k + 1]) is not None for k in range(len(path))]
        self._put(path, plain(value))
        root = _parse(self._text)
        place = _Place(root)
        for k, step in enumerate(path):
            node = place.node
            if node.kind in ("alias", "scalar"):
                # a name for what stands elsewhere, or nothing at all: it is written out
                whole = self.get(path[:k]) if node.kind == "alias" else _nested(path[k:], value)
                return self._replace(place, whole)
            entry = node.entry(step)
            if entry is None:
                # what was merged in (<<) is written out with the change
                whole = self.get(path[: k + 1]) if known[k] else _nested(path[k + 1 :], value)
                self._insert(place, str(step), whole)
                return None
            place = place.below(self._text, entry)
            _check_anchors(root, place.node, k == len(path) - 1)
        return self._replace(place, value)

    def remove(self, path: Keys) -> None:
        """Take an entry of a mapping out; nothing happens where there is none.

        Raises:
            CannotChangeError: it has an anchor that another place needs, or stands there by a merge (`<<`).
        """
        if self.get(path) is None:
            return
        del self.get(path[:-1])[path[-1]]
        root = _parse(self._text)
        place = _Place(root)
        for k, step in enumerate(path):
            if place.node.kind == "alias":
                self._replace(place, self.get(path[:k]))
                return
            entry = place.node.entry(step)
            if entry is None:
                raise CannotChangeError(f"line {place.node.line}: {'.'.join(map(str, path))} is merged in (<<)")
            if k == len(path) - 1:
                _check_anchors(root, entry[1], True)
                self._cut(place, entry)
                return
            place = place.below(self._text, entry)
            _check_anchors(root, place.node, False)

    def _put(self, path: Keys, value: Any) -> None:  # noqa: ANN401 (YAML content)
        place: Any = self.content
        for step in path[:-1]:
            if isinstance(place, dict) and not isinstance(place.get(step), dict | list):
                place[step] = {}
            place = place[step]
        if isinstance(place, list) and not isinstance(path[-1], int):
            raise CannotChangeError(f"no place for {path[-1]} in the list {'.'.join(map(str, path[:-1]))}")
        place[path[-1]] = value

    def _replace(self, place: _Place, value: Any) -> str | None:  # noqa: ANN401 (YAML content)
        text, node = self._text, place.node
        rows = isinstance(value, YamlRows) and bool(value.content) and place.flow is None
        if node.flow:
            outer = place.flow or node
            stop, comment = self._rest(outer.end)
            if rows and place.value_from is not None:
                new = text[: place.value_from] + self._break + self._rows(value, place.column + 2)
            else:
                space = "" if node.start < node.end else " "
                new = text[: node.start] + space + self._line(value, place.column) + text[node.end : outer.end]
            self._text = new + text[stop:]
            return comment
        stop, _ = self._rest(node.end)
        begin = _line_start(text, node.start)
        if place.value_from is None or text[begin : node.start].strip():
            # the first entry stands on the line of a dash, or of an anchor
            begin = node.start if place.value_from is None else place.value_from
            column = node.start - _line_start(text, node.start) if place.value_from is None else place.column + 2
            new = self._rows(value, column) if rows else " " + self._line(value, place.column)
            lead = self._break if rows and place.value_from is not None else ""
            self._text = text[:begin] + lead + (new if lead else new.lstrip(" ")) + text[stop:]
        elif rows:
            self._text = text[:begin] + self._rows(value, place.column + 2) + text[stop:]
        else:
            between = text[place.value_from : begin].rstrip("\r\n")
            self._text = f"{text[: place.value_from]} {self._line(value, place.column)}{between}{text[stop:]}"
        return None

    def _insert(self, place: _Place, key: str, value: Any) -> None:  # noqa: ANN401 (YAML content)
        text, node = self._text, place.node
        if node.kind != "mapping":
            raise CannotChangeError(f"line {node.line}: no place for {key} in a list")
        if not node.flow:
            first = node.items[0][0]
            assert first is not None
            stop, _ = self._rest(node.end)
            new = self._rows(YamlRows({key: value}), first.start - _line_start(text, first.start))
            self._text = text[:stop] + self._break + new + text[stop:]
            return
        at = node.items[-1][1].end if node.items else text.index("{", node.start) + 1
        new = f"{_key(key)}: {self._line(value, place.column)}"
        lead = ", " if node.items else ""
        if node.items and at - _line_start(text, at) + len(new) > WIDTH:
            lead = "," + self._break + " " * (place.column + 4)
        self._text = text[:at] + lead + new + text[at:]

    def _cut(self, place: _Place, entry: tuple[_Node | None, _Node]) -> None:
        (key, node), text, entries = entry, self._text, place.node.items
        assert key is not None
        number = entries.index(entry)
        if len(entries) == 1:
            self._replace(place, {})
        elif number == 0 and (place.node.flow or text[_line_start(text, key.start) : key.start].strip()):
            following = entries[1][0]
            assert following is not None
            self._text = text[: key.start] + text[following.start :]
        elif not place.node.flow:
            match = END_OF_LINE.search(text, self._rest(node.end)[0])
            assert match is not None
            self._text = text[: _line_start(text, key.start)] + text[match.end() :]
        else:
            # a comment before it belongs to the entry before; a comma may stand at the end of a mapping
            begin, stop = entries[number - 1][1].end, node.end
            if "#" in text[begin : key.start]:
                begin, comma = key.start, re.compile("[ \t]*,").match(text, stop)
                stop = comma.end() if comma else stop
            self._text = text[:begin] + text[stop:]

    def _rest(self, end: int) -> tuple[int, str | None]:
        """Where the line ends on which a value ended at `end`, and the comment before that; `end` if more follows."""
        match = REST_OF_LINE.match(self._text, end)
        assert match is not None
        if END_OF_LINE.match(self._text, match.end()) is None:
            return end, None
        return match.end(), match.group(1)

    def _rows(self, rows: YamlRows, column: int) -> str:
        """Lines of rows that begin at `column`."""
        lines, named = [], isinstance(rows.content, Mapping)
        for key, value in rows.content.items() if isinstance(rows.content, Mapping) else enumerate(rows.content):
            start = " " * column + (f"{_key(key)}:" if named else "-")
            if named and isinstance(value, YamlRows) and value.content:
                lines += [start, self._rows(value, column + 2)]
            else:
                lines.append(f"{start} {self._line(value, column)}")
        return self._break.join(lines)

    def _line(self, value: Any, column: int) -> str:  # noqa: ANN401 (YAML content)
        """The value in flow style for an entry at `column`; long ones go on in further lines."""
        text = yaml.dump(
            plain(value),
            Dumper=yaml.SafeDumper,
            default_flow_style=True,
            allow_unicode=True,
            sort_keys=False,
            width=WIDTH - column,
        )
        lines = text.removesuffix("...\n").rstrip("\n").split("\n")
        return (self._break + " " * (column + 4)).join(line.strip(" ") for line in lines)


@dataclass(frozen=True)
class _Place:
    """Where a value stands.

    Attributes:
        column: of the key or dash of the innermost entry in block style.
        value_from: index after the colon of its key; None after a dash and in flow style.
        flow: the outermost mapping or list in flow style around it.
    """

    node: _Node
    column: int = -2
    value_from: int | None = None
    flow: _Node | None = None

    def below(self, text: str, entry: tuple[_Node | None, _Node]) -> _Place:
        key, value = entry
        if self.node.flow:
            return _Place(value, self.column, None, self.flow or self.node)
        at = text.rindex("-", 0, value.start) if key is None else key.start
        after = None if key is None else text.index(":", key.end) + 1
        return _Place(value, at - _line_start(text, at), after)


def _line_start(text: str, at: int) -> int:
    return max(text.rfind(mark, 0, at) for mark in "\n\r\x85\u2028\u2029") + 1


def _check_anchors(root: _Node, node: _Node, whole: bool) -> None:
    """Hold that nothing outside `node` is named in what changes: all of it (`whole`), or something in it."""
    for name in node.anchors if whole else {node.anchor} - {""}:
        if root.aliases.count(name) > node.aliases.count(name):
            raise CannotChangeError(
                f"line {node.line}: what is to be changed is named &{name} and used again as *{name}; write it out at "
                "both places"
            )


def _nested(path: Keys, value: Any) -> Any:  # noqa: ANN401 (YAML content)
    for step in reversed(path):
        value = YamlRows({str(step): value})
    return value


def _key(key: Any) -> str:  # noqa: ANN401 (YAML content)
    return str(yaml.dump(str(key), Dumper=yaml.SafeDumper, allow_unicode=True)).removesuffix("\n").removesuffix("\n...")
