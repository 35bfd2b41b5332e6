"""Pages that are made from the nodes' own descriptors and from the wire contract."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import rclpy
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.context import Context
from rclpy.parameter import Parameter

from rotary_error_monitor.description.wire import TIME_COLUMN, Topic, load_services, load_wire
from rotary_error_monitor.nodes.managed import ManagedNode

ROOT = Path(__file__).parents[2]
_OF_ROS = ("use_sim_time", "start_type_description_service")
"""Parameters that each node of ROS has."""


@dataclass(frozen=True)
class NodePage:
    """What is told of a node.

    Attributes:
        name: of its executable.
        module: docstring of its module: what it is in a line, and how it is started.
        meaning: docstring of its class.
        parameters: descriptor and default of each, by name.
    """

    name: str
    module: str
    meaning: str
    parameters: dict[str, tuple[ParameterDescriptor, Parameter]]


def node_names() -> list[str]:
    """Executables that are nodes, in the order of setup.py."""
    for statement in ast.parse((ROOT / "setup.py").read_text(encoding="utf-8")).body:
        if isinstance(statement, ast.Assign) and getattr(statement.targets[0], "id", "") == "NODES":
            return list(ast.literal_eval(statement.value))
    raise LookupError(f"{ROOT / 'setup.py'}: no list NODES")


def node_pages() -> Iterator[NodePage]:
    """Each node as it describes itself; it is made, not configured, so that it neither speaks nor listens."""
    context = Context()
    rclpy.init(args=[], context=context)
    try:
        for name in node_names():
            module = import_module(f"rotary_error_monitor.nodes.{name}")
            (kind,) = (
                item
                for item in vars(module).values()
                if inspect.isclass(item) and issubclass(item, ManagedNode) and item.__module__ == module.__name__
            )
            node = kind(name, context=context)
            given = node.get_parameters_by_prefix("")
            names = sorted(set(given) - set(_OF_ROS))
            found = {key: (node.describe_parameter(key), node.get_parameter(key)) for key in names}
            node.destroy_node()  # type: ignore[no-untyped-call]
            yield NodePage(name, inspect.getdoc(module) or "", inspect.getdoc(kind) or "", found)
    finally:
        rclpy.shutdown(context=context)


def node_text(page: NodePage) -> str:
    """The page of a node, in Markdown."""
    summary, _, starts = page.module.partition("\n")
    meaning = page.meaning.split("\n\n")[0]
    parts = [f"# {page.name}", summary, meaning if meaning != summary else ""]
    if starts.strip():
        parts += [f"```sh\n{starts.strip()}\n```"]
    parts += ["## Parameters", _parameter_table(page), "## Topics", *_topic_lists(page.name)]
    services = [service for service in load_services() if page.name in service.servers]
    if services:
        rows = ((f"`{s.name}`", f"`{s.type}`", s.meaning, ", ".join(s.callers)) for s in services)
        parts += ["## Services", table(("service", "type", "does", "called by"), rows)]
    return "\n\n".join(part for part in parts if part) + "\n"


def _parameter_table(page: NodePage) -> str:
    rows = (
        (f"`{name}`", given.type_.name.lower(), default_text(given), bounds_text(said), said.description, _when(said))
        for name, (said, given) in page.parameters.items()
    )
    return table(("parameter", "type", "default", "range", "meaning", "set"), rows)


def default_text(given: Parameter) -> str:
    """The default of a parameter as a parameter file has it; a text that is empty says so."""
    value = given.value
    if value == "" or value is None:
        return "empty"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    return f"`{value if isinstance(value, str | int | float) else list(value)}`"


def bounds_text(said: ParameterDescriptor) -> str:
    """The range that rclpy holds values against; empty where there is none."""
    ranges = [*said.floating_point_range, *said.integer_range]
    return f"{ranges[0].from_value:g} to {ranges[0].to_value:g}" if ranges else ""


def _when(said: ParameterDescriptor) -> str:
    return "at the start" if said.read_only else "before it configures"


def _topic_lists(node: str) -> Iterator[str]:
    wire = load_wire(None)
    for heading, topics in (("Publishes", wire.published_by(node)), ("Listens to", wire.read_by(node))):
        rows = ((_link(topic, "topics.md"), f"`{topic.type}`", topic.meaning) for topic in topics)
        yield f"### {heading}"
        yield table(("topic", "type", "holds"), rows) if topics else "Nothing that the wire contract names."


def topics_text() -> str:
    """The page of all topics and services, in Markdown."""
    parts = [
        "# Topics and services",
        "Made of `msg_defs/`. `{head}` is the letter of a read head, `{sensor}` the name of a listed sensor. "
        "A sample block is a `PointCloud2` of FLOAT64 columns; the first is the time after the stamp.",
    ]
    for topic in load_wire(None):
        columns = [(f"`{TIME_COLUMN}`", "s", "time after the stamp")] if topic.is_sample_block else []
        rows = [*columns, *((f"`{f.name}`", f.unit, f.meaning + _bits(f.bits)) for f in topic.fields)]
        facts = (
            ("type", f"`{topic.type}`"),
            ("published by", _nodes(topic.publishers)),
            ("heard by", _nodes(topic.subscribers)),
            ("rate", topic.rate),
            ("QoS", f"{topic.qos.reliability}, {topic.qos.durability}, last {topic.qos.depth}"),
            ("frame", f"`{topic.frame}`" if topic.frame else "none"),
        )
        held = "column" if topic.is_sample_block else "field"
        parts += [f"## `{topic.name}` {{#{anchor(topic)}}}", topic.meaning]
        parts += [table(("", ""), facts), table((held, "unit", "meaning"), rows)]
    parts += ["## Services"]
    services = [
        (", ".join(f"`/{server}{s.name[1:]}`" for server in s.servers), f"`{s.type}`", s.meaning, ", ".join(s.callers))
        for s in load_services()
    ]
    parts += [table(("service", "type", "does", "called by"), services)]
    return "\n\n".join(parts) + "\n"


def anchor(topic: Topic) -> str:
    """Anchor of a topic on the page of all."""
    return topic.key


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table; what would end a cell is written out."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(
        f"| {' | '.join(' '.join(cell.split()).replace('|', chr(92) + '|') for cell in row)} |" for row in lines
    )


def _link(topic: Topic, page: str) -> str:
    return f"[`{topic.name}`]({page}#{anchor(topic)})"


def _nodes(names: Iterable[str]) -> str:
    known = node_names()
    return ", ".join(f"[{name}]({name}.md)" if name in known else name for name in names) or "no node of the package"


def _bits(names: Sequence[str]) -> str:
    return f" (bits {', '.join(names)})" if names else ""
