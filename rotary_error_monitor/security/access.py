"""What each node of a cell may publish, hear, answer and ask: read off the wire contract, and nothing beside it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from rotary_error_monitor.description.wire import EXTERNAL, Topic, Wire
from rotary_error_monitor.description.wire_section import Service
from rotary_error_monitor.errors import InputError

OPERATOR = "operator"
"""Who stands for a person: hears every topic and calls what the contract lets an operator call."""

_ONE_EACH = ("encoder_head", "listed_sensor")
"""Executables of which a node runs for each head or each listed sensor."""

MANAGED_TOPICS = ("/parameter_events", "/rosout", "~/transition_event")
"""What every managed node of ROS 2 Jazzy publishes of itself."""

MANAGED_SERVICES = (
    "~/change_state",
    "~/describe_parameters",
    "~/get_available_states",
    "~/get_available_transitions",
    "~/get_parameter_types",
    "~/get_parameters",
    "~/get_state",
    "~/get_transition_graph",
    "~/get_type_description",
    "~/list_parameters",
    "~/set_parameters",
    "~/set_parameters_atomically",
)
"""What every managed node of ROS 2 Jazzy answers."""

_BESIDE_CONTRACT = {"visualization": ("/tf",)}
"""What an executable publishes beside the contract, where it is installed: tf2 sends the frames itself."""

Nodes = dict[str, tuple[str, str | None]]
"""Executable of each node by its name, and letter of the head or name of the listed sensor that it speaks for."""

_TOOL_SERVICE = "/_ros2cli_*/get_type_description"
"""What the nodes that `ros2` commands start answer; an operator's tools cannot start without it."""


@dataclass(frozen=True)
class Access:
    """What one node may do; names are absolute, as on the wire of ROS.

    Attributes:
        node: name of the node; its enclave is `/<node>`.
        publish: topics that it may publish.
        subscribe: topics that it may hear.
        reply: services that it may answer.
        request: services that it may call.
    """

    node: str
    publish: tuple[str, ...]
    subscribe: tuple[str, ...]
    reply: tuple[str, ...] = ()
    request: tuple[str, ...] = ()

    @property
    def enclave(self) -> str:
        """Name of the enclave, for `--enclave` on a command line."""
        return f"/{self.node}"


def cell_accesses(
    wire: Wire,
    services: Sequence[Service],
    listen: Mapping[str, Sequence[str]] | None = None,
    call: Mapping[str, Sequence[str]] | None = None,
) -> tuple[Access, ...]:
    """Access of every node that the contract names, one for each head and listed sensor, and of the operator.

    Args:
        wire: topics, for the heads and listed sensors of one stage.
        services: what nodes answer beside what every managed node answers.
        listen: topics outside the contract by node, such as that of a driver that `encoder_head_a` listens to.
        call: services by node that the contract lets a person alone call, such as `/compensation/reset`.

    Raises:
        InputError: `listen` or `call` names a node that is none, or what is not absolute.
    """
    executables = {name for topic in wire for name in (*topic.publishers, *topic.subscribers)}
    executables |= {name for service in services for name in service.servers}
    nodes: Nodes = {}
    for executable in sorted(executables - {EXTERNAL}):
        if executable in _ONE_EACH:
            heads = sorted({topic.head for topic in wire.published_by(executable) if topic.head is not None})
            nodes |= {f"{executable}_{head}": (executable, head) for head in heads}
        else:
            nodes[executable] = executable, None
    heard, called = dict(listen or {}), dict(call or {})
    _check_granted(nodes, "topic", heard, "/joint_states")
    _check_granted(nodes, "service", called, "/compensation/reset")
    found = [_of_node(node, nodes, wire, services, heard.get(node, ()), called.get(node, ())) for node in nodes]
    operated = _called_by(OPERATOR, nodes, services)
    operated |= {_absolute(name, node) for node in nodes for name in MANAGED_SERVICES}
    everything = {*wire.names, *MANAGED_TOPICS[:2], *(_absolute(MANAGED_TOPICS[2], node) for node in nodes)}
    tools = ("/parameter_events", "/rosout"), tuple(sorted(everything)), (_TOOL_SERVICE,), tuple(sorted(operated))
    return (*found, Access(OPERATOR, *tools))


def _check_granted(nodes: Nodes, what: str, granted: Mapping[str, Sequence[str]], example: str) -> None:
    for node, names in granted.items():
        if node not in nodes:
            raise InputError(f"no node is called '{node}'; the cell has {', '.join(nodes)}")
        for name in names:
            if not name.startswith("/"):
                raise InputError(f"{what} '{name}' of {node} is not absolute; expected a name such as {example}")


def _of_node(
    node: str,
    nodes: Nodes,
    wire: Wire,
    services: Sequence[Service],
    heard: Sequence[str],
    called: Sequence[str],
) -> Access:
    executable, head = nodes[node]

    def own(topics: Sequence[Topic]) -> Iterator[str]:
        """The node of a head or a listed sensor speaks for that alone."""
        return (topic.name for topic in topics if head is None or topic.head in (None, head))

    managed = (_absolute(name, node) for name in MANAGED_TOPICS)
    answered = (*MANAGED_SERVICES, *(service.name for service in services if executable in service.servers))
    return Access(
        node,
        publish=tuple(sorted({*own(wire.published_by(executable)), *_BESIDE_CONTRACT.get(executable, ()), *managed})),
        subscribe=tuple(sorted({*own(wire.read_by(executable)), *heard})),
        reply=tuple(sorted({_absolute(name, node) for name in answered})),
        request=tuple(sorted({*_called_by(executable, nodes, services), *called})),
    )


def _called_by(caller: str, nodes: Nodes, services: Sequence[Service]) -> set[str]:
    """Absolute names of the services that `caller` may call."""
    return {
        _absolute(service.name, node)
        for service in services
        if caller in service.callers
        for node, (executable, _) in nodes.items()
        if executable in service.servers
    }


def _absolute(name: str, node: str) -> str:
    return f"/{node}{name[1:]}" if name.startswith("~") else name
