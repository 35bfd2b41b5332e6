"""A recorder of raw streams that says meanwhile what comes, and of whom: for commands that work on a running cell."""

from __future__ import annotations

import gc
import re
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions

from rotary_error_monitor.codec.cdr_blocks import BlockDecoder
from rotary_error_monitor.description.topics import place_of
from rotary_error_monitor.description.wire import Topic
from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.nodes.diagnostics import Level, status_name
from rotary_error_monitor.nodes.protection import check_environment, explained
from rotary_error_monitor.nodes.publishers import deafness, name_of
from rotary_error_monitor.nodes.qos import profile
from rotary_error_monitor.nodes.recorder import Recorder
from rotary_error_monitor.nodes.transport import steady_transport
from rotary_error_monitor.signals.blocks import SampleBlock

NAME = "commission"
"""Of the node: a cell has a `recorder` of its own."""

_STEP = 0.1
"""Longest time, s, that nothing but ROS is looked after: signals and progress wait as long."""

_NAMESPACE = re.compile(r"(/[A-Za-z]\w*)*", re.ASCII)

OfBlock = Callable[[str, SampleBlock], None]


class StreamRecorder(Recorder):
    """Records what instruments and controller publish as blocks of samples, with the diagnostics.

    Attributes:
        samples: that came so far, by stream.
        on_block: called with the stream's name and each of its blocks, on the node's worker.
    """

    def __init__(self, name: str, on_block: OfBlock, **how: Any) -> None:  # noqa: ANN401 (as `ManagedNode`)
        """As `Recorder`."""
        self.samples: Counter[str] = Counter()
        self.on_block = on_block
        self._decoders: dict[str, tuple[str, BlockDecoder]] = {}
        self._told_by: dict[str, DiagnosticStatus] = {}
        super().__init__(name, **how)

    def is_wanted(self, topic: Topic) -> bool:
        """Raw streams, and what their nodes say."""
        return topic.is_everyones or topic.is_raw

    def note(self, topic: str, data: bytes) -> None:
        """Count samples, and keep what nodes say of themselves."""
        if topic not in self._decoders:
            known = self.contract.named(topic)
            if not known.is_sample_block:
                message: DiagnosticArray = deserialize_message(data, DiagnosticArray)
                self._told_by.update({status.name: status for status in message.status})
                return
            self._decoders[topic] = known.frame, BlockDecoder()
        stream, decoder = self._decoders[topic]
        block = decoder.decode(data)
        self.samples[stream] += len(block.rows)
        self.on_block(stream, block)

    def complaints(self, node: str, topic: str) -> list[str]:
        """What a node says of itself that is not well, but for that its own `topic` is silent."""
        beginning = status_name(f"{node}: ")
        with self.busy:
            told = list(self._told_by.values())
        return [
            f"{status.name.removeprefix(beginning)}: {status.message}"
            for status in told
            if status.name.startswith(beginning)
            and status.name != status_name(f"{node}: {topic}")
            and int.from_bytes(status.level, "little") != Level.OK
        ]


@dataclass(frozen=True)
class Presence:
    """What there is of one stream.

    Attributes:
        topic: of the contract, by its name in the cell's namespace.
        rate: samples a second; 0 where none come.
        publishers: nodes that publish it.
        deaf: those of them that are not heard, and why.
        complaints: what these nodes say of themselves.
    """

    topic: Topic
    rate: float
    publishers: tuple[str, ...]
    deaf: tuple[str, ...]
    complaints: tuple[str, ...]


class LiveCell:
    """A running cell whose raw streams are being recorded."""

    def __init__(self, node: StreamRecorder, executor: SingleThreadedExecutor) -> None:
        """A node that is recording."""
        self._node, self._executor = node, executor
        self.raw = {here.frame: here for here in node.wire if here.is_raw}

    def spin(self, duration: float, until: Callable[[], bool] = lambda: False) -> None:
        """Let the recording go on for a time, s, or until something is so.

        Raises:
            InputError: the recording had to stop.
        """
        end = time.monotonic() + duration
        while not until() and time.monotonic() < end:
            self._executor.spin_once(timeout_sec=min(_STEP, max(0.0, end - time.monotonic())))
            if self._node.stopped is not None:
                raise InputError(self._node.stopped)
            if self._node.end.done():
                self._node.end.result()

    def counts(self) -> dict[str, int]:
        """Samples that came so far, by stream."""
        return {stream: self._node.samples[stream] for stream in self.raw}

    def presence(self, stream: str, rate: float) -> Presence:
        """Who publishes a stream of which samples come at a rate, Hz."""
        topic = self.raw[stream]
        found = self._node.get_publishers_info_by_topic(topic.name)
        reasons = [(name_of(each), deafness(each, topic.type, profile(topic))) for each in found]
        names = tuple(sorted({name for name, _ in reasons}))
        deaf = tuple(f"{name} on {topic.name} ({why})" for name, why in reasons if why)
        complaints = [f"{name} says: {text}" for name in names for text in self._node.complaints(name, topic.name)]
        return Presence(topic, rate, names, deaf, tuple(complaints))

    def unheard(self) -> list[str]:
        """Topics of drivers to which nobody listens, with their types: one of them may be meant by a name mistyped."""
        found = []
        for name, types in self._node.get_topic_names_and_types():
            if place_of(name) is None and _is_of_driver(types) and not self._node.count_subscribers(name):
                who = sorted(map(name_of, self._node.get_publishers_info_by_topic(name)))
                if who:
                    found.append(f"{name} ({', '.join(types)}) of {', '.join(who)}")
        return found

    def other_cells(self) -> list[str]:
        """Namespaces of other cells that publish, `/` for none."""
        own = self._node.get_namespace().rstrip("/")
        places = [(name, place_of(name)) for name, _ in self._node.get_topic_names_and_types()]
        return sorted(
            {
                place.namespace or "/"
                for name, place in places
                if place is not None and place.namespace != own and self._node.count_publishers(name)
            }
        )


DRIVERS = ("sensor_msgs/msg/JointState", "geometry_msgs/msg/Vector3Stamped")
"""Types by which drivers of angles and tilts publish."""


def _is_of_driver(types: list[str]) -> bool:
    return any(kind in DRIVERS for kind in types)


@contextmanager
def live_cell(stage: Path, folder: Path, namespace: str, on_block: OfBlock) -> Iterator[LiveCell]:
    """A cell whose raw streams are recorded while in the `with` statement; afterwards the bag is whole.

    Args:
        stage: YAML file of its stage, which says what streams there are.
        folder: new folder of the bag.
        namespace: of the cell, such as `/left`; empty for none.
        on_block: as of `StreamRecorder`.

    Raises:
        InputError: the namespace is none, the file is wrong, the folder cannot be written, or ROS cannot be started.
    """
    space = "/" + namespace.strip("/") if namespace.strip("/") else ""
    if not _NAMESPACE.fullmatch(space):
        raise InputError(f"--namespace is '{excerpt(namespace)}'; expected one such as /left or /hall/left")
    values = {"stage": str(stage), "folder": str(folder)}
    with ExitStack() as stack:
        context = Context()
        stack.callback(gc.collect)  # rclpy's objects refer to one another: the participant leaves the domain with them
        try:
            check_environment(None)
            with steady_transport():
                rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
                stack.callback(context.try_shutdown)
                node = StreamRecorder(
                    NAME,
                    on_block,
                    context=context,
                    parameter_overrides=[Parameter(name, value=value) for name, value in values.items()],
                    cli_args=["--ros-args", "-r", f"__ns:={space or '/'}"],
                )
        except InputError:
            raise
        except RuntimeError as error:  # so rcl refuses keys and surroundings
            raise InputError(str(explained(error))) from error
        stack.callback(node.stop)
        node.get_logger().set_level(LoggingSeverity.WARN)
        executor = SingleThreadedExecutor(context=context)
        stack.callback(executor.shutdown)
        executor.add_node(node)
        node.autostart()
        yield LiveCell(node, executor)
