"""Messages of a mock cell as they come to estimator and compensation, handed to the nodes' own callbacks without DDS.

Both nodes run in this process. What they publish goes to the middleware, where nobody listens; the estimator's blocks
are handed on to the compensation.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.parameter import Parameter

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.compensation import Compensation
from rotary_error_monitor.nodes.error_estimator import ErrorEstimator
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.sources.mock import MockSettings, MockSource, mock_stage
from rotary_error_monitor.sources.mock_machine import MachineMotion
from rotary_error_monitor.testing.domains import own_domain

MS = 1_000_000
BLOCK_NS = 5 * MS
EPOCH_NS = 1_764_000_000_000_000_000
MACHINE = "xyzac_trt"
SPEEDS = (1.5707963267948966, 6.283185307179586)
BEGIN_NS = EPOCH_NS + 1000 * MS


@dataclass
class Feed:
    """Streams of one stage, by the names of their topics, and what the two nodes make of them.

    Attributes:
        estimator, compensation: the nodes, active, their workers not started.
        published: bytes of error motion since they were taken last.
    """

    rate: float
    estimator: ErrorEstimator
    compensation: Compensation
    published: list[bytes] = field(default_factory=list)

    def __post_init__(self) -> None:
        wire, stage = self.estimator.wire, load_stage(None)
        plant = mock_stage(stage, MockSettings(1, EPOCH_NS, SPEEDS, rate=self.rate))
        streams = [*(f"head_{letter}" for letter in stage.azimuths), "autocollimator", "command"]
        self._sources = {wire.of_stream(name).name: (name, MockSource(plant, name)) for name in streams}
        self._motion = MachineMotion(load_machine(MACHINE), plant)
        keys = ("machine_joint_states", "machine_temperature", "applied_corrections", "error_motion_samples")
        self._joints, self._temperature, self._applied, self._samples = (wire.topic(key).name for key in keys)
        self._now_ns = BEGIN_NS
        self._numbers: dict[str, int] = {}
        for node in (self.estimator, self.compensation):
            node.now_ns = lambda: self._now_ns
        publisher = self.estimator._sample_publisher
        publish = publisher.publish

        def keep(data: bytes) -> None:
            self.published.append(data)
            publish(data)

        publisher.publish = keep

    def sets(self, count: int) -> Iterator[tuple[Callable[[], None], Callable[[], None]]]:
        """For each set of blocks what hands it to the estimator, and what hands its estimate to the compensation."""
        for number in range(count):
            begin_ns = BEGIN_NS + number * BLOCK_NS
            blocks = []
            for topic, (name, source) in self._sources.items():
                block = source.take(begin_ns, begin_ns + BLOCK_NS)
                assert block is not None
                blocks.append((topic, messages.block_bytes(block, name)))
            self._now_ns = begin_ns + BLOCK_NS + MS
            yield (
                self._delivery(self.estimator, lambda blocks=blocks: blocks),
                self._delivery(self.compensation, self._with_estimate(number, begin_ns + BLOCK_NS)),
            )

    def _with_estimate(self, number: int, time_ns: int) -> Callable[[], list[tuple[str, Any]]]:
        beside: list[tuple[str, Any]] = []
        states = self._motion.at(time_ns)
        letters, positions = [each.letter for each in states], [each.position for each in states]
        if number % 2 == 0:
            speeds = [each.velocity for each in states]
            beside.append((self._joints, messages.joint_state_message(time_ns, "", letters, positions, speeds)))
        if number % 20 == 0:
            beside.append((self._temperature, messages.temperature_message(time_ns, "", 20.0)))
        if number == 0:
            beside.append((self._applied, messages.joint_state_message(time_ns, "", letters, [0.0] * len(letters))))

        def found() -> list[tuple[str, Any]]:
            estimates, self.published = self.published, []
            return [*((self._samples, data) for data in estimates), *beside]

        return found

    def _delivery(self, node: ManagedNode, found: Callable[[], list[tuple[str, Any]]]) -> Callable[[], None]:
        """Call the node's callbacks as its worker does at one wake-up."""
        worker = node._worker
        callbacks = {subscription.topic_name: callback for subscription, callback in worker._callbacks.items()}

        def deliver() -> None:
            for topic, message in found():
                self._numbers[topic] = self._numbers.get(topic, -1) + 1
                about = {
                    "publication_sequence_number": self._numbers[topic],
                    "received_timestamp": self._now_ns,
                    "source_timestamp": self._now_ns,
                }
                callbacks[topic](message, about)
            for callback in worker._after:
                callback()

        return deliver


@contextmanager
def feed(rate: float) -> Iterator[Feed]:
    """Estimator and compensation of a mock cell whose instruments sample at `rate`, 1/s."""
    context = Context()
    with own_domain() as domain:
        rclpy.init(context=context, domain_id=domain, args=[])
        nodes = (
            ErrorEstimator("error_estimator", context=context),
            Compensation("compensation", context=context, parameter_overrides=[Parameter("machine", value=MACHINE)]),
        )
        try:
            for node in nodes:
                node._worker.start = lambda: None  # its messages are handed over here
                node.autostart()
            yield Feed(rate, *nodes)
        finally:
            for node in nodes:
                node.stop()
            context.try_shutdown()


class Stopwatch:
    """Processor time of this thread in functions by the step that each belongs to, without that of the steps within."""

    def __init__(self) -> None:
        self.spent: dict[str, float] = {}
        self._within = [0.0]

    def timed(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, its time counted for the step `name`."""

        def call(*args: Any, **named: Any) -> Any:
            self._within.append(0.0)
            begin = time.thread_time()
            try:
                return function(*args, **named)
            finally:
                took = time.thread_time() - begin
                self.spent[name] = self.spent.get(name, 0.0) + took - self._within.pop()
                self._within[-1] += took

        return call
