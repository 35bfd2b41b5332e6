"""The ten nodes of a stage's cell in one process: the package's own, configured but not active, so that none sends.

python light_cell.py NAMESPACE FOLDER KIND

KIND is `nodes`, the package's own, or `topics`: nodes of rclpy with the topics of these and nothing else, neither
parameters nor services nor a life cycle, of which many more fit on a computer. Each node has a context of its own,
which is a participant of DDS as in a process of its own: what is discovered is what ten processes would discover. Says
`loaded`, then answers each line on standard input, as JSON with the time that it took (s), the memory of the process
(MB) and its processor time so far (s):

    make       the nodes
    find 5 60  once each node knows all nodes of five such cells, and each publisher all subscriptions to its topic, or
               60 s have passed; with the part of them that the least knowing node knows
    state      at once
"""

from __future__ import annotations

import json
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import rclpy
from rclpy.context import Context
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter

from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.nodes.autocollimator import AutocollimatorNode
from rotary_error_monitor.nodes.compensation import Compensation
from rotary_error_monitor.nodes.encoder_head import EncoderHead
from rotary_error_monitor.nodes.error_estimator import ErrorEstimator
from rotary_error_monitor.nodes.lvdt import LvdtNode
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.messages import message_class
from rotary_error_monitor.nodes.mock_controller import MockController
from rotary_error_monitor.nodes.qos import profile
from rotary_error_monitor.nodes.recorder import Recorder
from rotary_error_monitor.nodes.transport import steady_transport

MACHINE = "xyzac_trt"
NODES: dict[str, tuple[Callable[..., ManagedNode], dict[str, object]]] = {
    **{f"encoder_head_{letter}": (EncoderHead, {"source": "mock"}) for letter in "abcd"},
    "autocollimator": (AutocollimatorNode, {"source": "mock"}),
    "lvdt": (LvdtNode, {"source": "mock"}),
    "mock_controller": (MockController, {"machine": MACHINE}),
    "error_estimator": (ErrorEstimator, {}),
    "compensation": (Compensation, {"machine": MACHINE}),
    "recorder": (Recorder, {}),
}
"""The ten processes of a mock cell, as in `bench_start.py`."""

_LOOK = 0.1
"""Time between two looks whether all is found, s."""


def plain(namespace: str) -> list[Node]:
    """Nodes with the topics of those of a cell, each in a context of its own."""
    wire, nodes = load_wire().within(namespace), []
    for name in NODES:
        head = name.removeprefix("encoder_head_") if name.startswith("encoder_head_") else None
        executable = "encoder_head" if head else name
        context = Context()
        with steady_transport():
            rclpy.init(context=context, args=[])
            node = Node(name, context=context, namespace=namespace, start_parameter_services=False, enable_rosout=False)
        for topic in wire.published_by(executable):
            if head in (None, topic.head) or topic.is_everyones:
                node.create_publisher(message_class(topic.type), topic.name, profile(topic))
        for topic in wire.read_by(executable):
            node.create_subscription(message_class(topic.type), topic.name, lambda _: None, profile(topic), raw=True)
        nodes.append(node)
    return nodes


def made(namespace: str, folder: Path) -> list[Node]:
    """The nodes of a cell, each in a context of its own, configured."""
    nodes: list[Node] = []
    for name, (kind, given) in NODES.items():
        values = {**given, "folder": str(folder)} if name == "recorder" else given
        context = Context()
        with steady_transport():
            rclpy.init(context=context, args=[])
            node = kind(
                name,
                context=context,
                parameter_overrides=[Parameter(key, value=value) for key, value in values.items()],
                cli_args=["--ros-args", "-r", f"__ns:={namespace}"],
            )
        assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS, name
        nodes.append(node)
    return nodes


def all_found(nodes: Sequence[Node], namespace: str, stages: int) -> bool:
    """Whether each node knows all of them, and each publisher all subscriptions to its topic."""
    heard = Counter(each.topic_name for node in nodes for each in node.subscriptions)
    for node in nodes:
        for publisher in node.publishers:
            topic = publisher.topic_name
            others = 1 if topic.startswith(f"{namespace}/") else stages
            if publisher.get_subscription_count() < heard[topic] * others:
                return False
    return all(len(node.get_node_names()) >= stages * len(NODES) for node in nodes)


def state() -> dict[str, float]:
    """Memory that this process holds, MB, and processor time that it has taken, s."""
    rows = Path("/proc/self/smaps_rollup").read_text(encoding="ascii")
    return {"mb": int(rows.split("\nPss:")[1].split()[0]) * 1024 / 1e6, "processor": time.process_time()}


def answers(namespace: str, folder: Path, kind: str) -> Iterator[dict[str, float]]:
    """To each line of standard input, until it ends."""
    nodes: list[Node] = []
    known = 0.0
    for order, *number in map(str.split, sys.stdin):
        begin = time.monotonic()
        if order == "make":
            nodes = made(namespace, folder) if kind == "nodes" else plain(namespace)
        elif order == "find":
            stages, until = int(number[0]), begin + float(number[1])
            while not all_found(nodes, namespace, stages) and time.monotonic() < until:
                time.sleep(_LOOK)
            known = min(len(node.get_node_names()) for node in nodes) / (stages * len(NODES))
        yield {"took": time.monotonic() - begin, "endpoints": endpoints_of(nodes), "known": known, **state()}
    for node in nodes:
        context = node.context
        node.stop() if isinstance(node, ManagedNode) else node.destroy_node()
        context.try_shutdown()


def endpoints_of(nodes: Sequence[Node]) -> int:
    """Readers and writers of DDS: a service or its client has one of each."""
    return sum(
        len([*node.publishers, *node.subscriptions]) + 2 * len([*node.services, *node.clients]) for node in nodes
    )


if __name__ == "__main__":
    print("loaded", flush=True)
    for answer in answers(sys.argv[1], Path(sys.argv[2]), sys.argv[3]):
        print(json.dumps(answer), flush=True)
