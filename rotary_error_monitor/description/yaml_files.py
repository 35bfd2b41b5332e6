"""YAML as people write it, from files that may hold anything.

Every YAML file and text that the package reads comes through here. What costs more than it says, means something else
than it shows, or makes a parser fail, is refused with its line: depth and number of nodes (aliases count as what they
stand for), aliases within what they name, tags, keys that stand twice, numbers that are not finite, not decimal or of
endless digits. Keys are text as written, and so are dates.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.files import read_text

LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""The safe loader, in C where PyYAML was built with libyaml: ten times as fast, felt at the start of every node."""

MOST_BYTES = 4 << 20
"""Bytes of a file: a hundred times that of a machine whose errors are all tables of a hundred positions."""

MOST_NODES = 100_000
"""Mappings, lists, keys and values: about as many as the largest file has that is allowed by its size."""

DEEPEST = 32
"""Nested mappings and lists: four times as deep as the deepest description."""

LONGEST_NUMBER = 64
"""Characters of a number: twice what a double takes when all its digits are written."""

_TAG = "tag:yaml.org,2002:"
_DECIMAL = re.compile(r"[-+]?(0|[1-9][0-9]*|[0-9]*\.[0-9]*([eE][-+]?[0-9]+)?)")
_NOT_FINITE = re.compile(r"[-+]?\.(nan|inf)", re.IGNORECASE)


@dataclass(frozen=True)
class YamlContent:
    """What a YAML text holds.

    Attributes:
        origin: the file, or what else messages name.
        text: as it was read.
        content: mappings with text for keys, lists, text, numbers, truth values, None.
        node: the same with lines; None where the text is empty.
    """

    origin: str
    text: str
    content: Any
    node: yaml.Node | None


def read_yaml(path: Path, kind: str = "a YAML file") -> YamlContent:
    """The one document of a YAML file; `kind` says in messages what it should be.

    Raises:
        InputError: the file cannot be read, or what `parse_yaml` raises.
    """
    return parse_yaml(read_text(path, kind, MOST_BYTES), str(path))


def parse_yaml(text: str, origin: str) -> YamlContent:
    """The one document of a YAML text; `origin` says in messages where it is from.

    Raises:
        InputError: it is no YAML, or no such YAML as the package reads; the message names the line.
    """
    try:
        _check_cost(text, origin)
        loader = LOADER(text)
        try:
            node = loader.get_single_node()
            if node is None:
                return YamlContent(origin, text, None, None)
            _check_nodes(node, origin)
            return YamlContent(origin, text, loader.construct_document(node), node)
        finally:
            loader.dispose()
    except yaml.MarkedYAMLError as error:
        line = f":{error.problem_mark.line + 1}" if error.problem_mark else ""
        told = ", ".join(part for part in (error.context, error.problem) if part)
        raise InputError(f"{origin}{line}: no valid YAML: {excerpt(told)}") from error
    except yaml.YAMLError as error:
        place = getattr(error, "position", None)  # of a character that no YAML holds
        line = f":{text.count(chr(10), 0, place) + 1}" if isinstance(place, int) else ""
        raise InputError(f"{origin}{line}: no valid YAML: {excerpt(' '.join(str(error).split()))}") from error


def _check_cost(text: str, origin: str) -> None:
    """Refuse what grows beyond its text, before anything is built of it."""
    nodes, sizes = 0, dict[str, int]()
    opened: list[tuple[str | None, int]] = []  # anchor of each node that is open, and how many nodes came before it
    for event in yaml.parse(text, LOADER):
        where = f"{origin}:{event.start_mark.line + 1 if event.start_mark else 1}"
        if isinstance(event, yaml.ScalarEvent | yaml.CollectionStartEvent):
            if event.tag is not None:
                raise InputError(f"{where}: tag {excerpt(event.tag)}: tags are not read; write the value without one")
            opened.append((event.anchor, nodes))
            nodes += 1
        elif isinstance(event, yaml.AliasEvent):
            anchor = str(event.anchor)
            if anchor in (name for name, _ in opened):
                raise InputError(f"{where}: *{excerpt(anchor)} stands within what it names; write what is meant")
            nodes += sizes.get(anchor, 1)
        if isinstance(event, yaml.ScalarEvent | yaml.CollectionEndEvent):
            name, before = opened.pop()
            if name is not None:
                sizes[name] = nodes - before
        if len(opened) > DEEPEST:
            raise InputError(f"{where}: nested more than {DEEPEST} deep; no file that is read here is")
        if nodes > MOST_NODES:
            raise InputError(f"{where}: more than {MOST_NODES} keys and values, aliases resolved; give a smaller file")


def _check_nodes(top: yaml.Node, origin: str) -> None:
    """Keys are text and stand once; numbers are what they look like; dates stay as they are written."""
    waiting, seen = [top], set[int]()
    while waiting:
        node = waiting.pop()
        if id(node) in seen:
            continue
        seen.add(id(node))
        if isinstance(node, yaml.MappingNode):
            _check_keys(node, origin)
            waiting += [value for _, value in node.value]
        elif isinstance(node, yaml.SequenceNode):
            waiting += node.value
        elif node.tag in (_TAG + "int", _TAG + "float"):
            _check_number(str(node.value), f"{origin}:{node.start_mark.line + 1}")
        elif node.tag not in (_TAG + "null", _TAG + "bool"):
            node.tag = _TAG + "str"


def _check_keys(mapping: yaml.MappingNode, origin: str) -> None:
    seen: set[str] = set()
    for key, _ in mapping.value:
        where = f"{origin}:{key.start_mark.line + 1}"
        if not isinstance(key, yaml.ScalarNode):
            raise InputError(f"{where}: a list or mapping as a key; expected a name")
        if key.value in seen:
            raise InputError(f"{where}: key '{excerpt(key.value)}' stands twice; keep one")
        seen.add(key.value)
        if key.tag != _TAG + "merge":
            key.tag = _TAG + "str"


def _check_number(text: str, where: str) -> None:
    if len(text) > LONGEST_NUMBER:
        raise InputError(f"{where}: a number of {len(text)} characters; expected at most {LONGEST_NUMBER}")
    if _NOT_FINITE.fullmatch(text):
        raise InputError(f"{where}: {text} is no finite number; write one, or leave the key out")
    if not _DECIMAL.fullmatch(text):
        raise InputError(
            f"{where}: YAML takes {text} for a number that is not decimal; write 1234 or 1.0e-6, or quote it"
        )
    if not math.isfinite(float(text)):
        raise InputError(f"{where}: {text} is no finite number; write one, or leave the key out")
