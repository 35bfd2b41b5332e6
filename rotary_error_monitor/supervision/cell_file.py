"""The nodes of a cell, by the parameter file that they take their parameters from."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from rotary_error_monitor.description.sections import place_named
from rotary_error_monitor.description.wire import EXTERNAL, load_wire
from rotary_error_monitor.description.yaml_files import read_yaml
from rotary_error_monitor.errors import InputError, excerpt

_ANY = ("**", "*")


@dataclass(frozen=True)
class CellNode:
    """A node to start: its executable, its name, and its namespace (empty for that of the whole cell).

    Attributes:
        where: file and line of its section.
    """

    executable: str
    name: str
    namespace: str = ""
    where: str = field(default="", compare=False)

    @property
    def full_name(self) -> str:
        """Name with namespace, such as `/left/encoder_head_a`."""
        return "/".join(["", *(step for step in self.namespace.split("/") if step), self.name])


def executables() -> tuple[str, ...]:
    """Executables of the package's nodes, as the wire contract names who speaks and listens."""
    names = {name for topic in load_wire(None) for name in (*topic.publishers, *topic.subscribers)}
    return tuple(sorted(names - {EXTERNAL}))


def nodes_of(path: Path) -> tuple[CellNode, ...]:
    """Nodes that a ROS parameter file names, in its order; `/**` alone names none.

    A node is called like its executable, or like it with a name of its own behind: `encoder_head_a`.

    Raises:
        InputError: the file is no parameter file, names no node or one twice, or one that no executable serves; the
            message names file, line and what is expected.
    """
    found = read_yaml(path, "a ROS parameter file")
    if not isinstance(found.node, yaml.MappingNode):
        raise InputError(
            f"{path}: no parameter file; expected sections such as /**/encoder_head_a: {{ros__parameters: …}}"
        )
    known, nodes = executables(), dict[tuple[str, str], CellNode]()
    for key, section in found.node.value:
        where = f"{path}:{key.start_mark.line + 1}"
        if not isinstance(section, yaml.MappingNode) or "ros__parameters" not in (k.value for k, _ in section.value):
            raise InputError(
                f"{where}: '{excerpt(key.value)}': expected ros__parameters in it, {{}} where there are none"
            )
        *spaces, name = key.value.strip("/").split("/")
        if name in _ANY:
            continue
        node = CellNode(_executable(name, known, where), name, _namespace(spaces), where)
        if (node.namespace, name) in nodes:
            raise InputError(f"{where}: '{excerpt(key.value)}' names {name} a second time; one section a node")
        nodes[node.namespace, name] = node
    if not nodes:
        raise InputError(f"{path}: names no node to start; expected sections such as /**/encoder_head_a")
    return tuple(nodes.values())


def _executable(name: str, known: Iterable[str], where: str) -> str:
    fitting = [each for each in known if name == each or name.startswith(f"{each}_")]
    if not fitting:
        raise InputError(
            f"{where}: no executable serves a node '{excerpt(name)}'; expected one of {', '.join(known)}, with a name "
            "of its own behind it or without (encoder_head_a)"
        )
    return max(fitting, key=len)


def _namespace(spaces: list[str]) -> str:
    """Namespace that the parts before a name state; what stands for any of them states none."""
    stated = [each for each in spaces if each and each not in _ANY]
    return "/" + "/".join(stated) if stated else ""


def parameters_of(path: Path, nodes: Iterable[CellNode]) -> dict[CellNode, dict[str, object]]:
    """Parameters of each node by their dotted names; what stands further down in the file counts for more, as for rcl.

    Raises:
        InputError: as `nodes_of`, or a section holds something else than parameters.
    """
    found: dict[CellNode, dict[str, object]] = {node: {} for node in nodes}
    for key, section in read_yaml(path, "a ROS parameter file").content.items():
        given, fits = section["ros__parameters"] or {}, _pattern(key)
        if not isinstance(given, Mapping):
            raise InputError(f"{path}: '{excerpt(key)}': ros__parameters is {given!r}; expected parameters by name")
        for node in found:
            if fits.fullmatch(node.full_name):
                found[node] |= dict(_dotted(given))
    return found


def where_given(path: Path, node: CellNode, name: str) -> str:
    """File, line and place of the parameter of a node that the file gives it and that counts."""
    found = read_yaml(path, "a ROS parameter file")
    sections = {key: section["ros__parameters"] or {} for key, section in found.content.items()}
    *_, last = (key for key, given in sections.items() if name in given and _pattern(key).fullmatch(node.full_name))
    return place_named(found, (last, "ros__parameters", name))


def _pattern(key: str) -> re.Pattern[str]:
    """What matches the full names of nodes that a section is of: `*` is one step of a name, `**` any number of them."""
    steps = (step for step in key.split("/") if step)
    return re.compile("".join({"**": r"(/\w+)*", "*": r"/\w+"}.get(step, "/" + re.escape(step)) for step in steps))


def _dotted(given: Mapping[str, object], above: str = "") -> Iterator[tuple[str, object]]:
    for name, value in given.items():
        if isinstance(value, Mapping):
            yield from _dotted(value, f"{above}{name}.")
        else:
            yield f"{above}{name}", value
