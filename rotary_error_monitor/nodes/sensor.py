"""What the nodes of all instruments share: a source, its blocks on time, beside them a message for people."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, ClassVar

from rotary_error_monitor.description.wire import Topic
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.diagnostics import Condition, StreamWatch
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.parameters import Setting, cell_settings
from rotary_error_monitor.nodes.qos import driver_profile
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock
from rotary_error_monitor.sources.mock import MockSettings, MockSource, last_midnight, mock_stage
from rotary_error_monitor.sources.source import Gathered, Polled, Source

MOCK = "mock"
MOCK_SETTINGS = cell_settings("block_period", "mock.")
RATE = Setting("rate", 0.0, "samples a second of the mock source; 0.0 for the instrument's usual rate", (0.0, 1e6))

_LONGEST_CATCH_UP = NANOSECONDS
_HUMAN_PERIOD = 50_000_000
_LATE_PERIODS = 4.0
_STALE_AFTER = 0.5

_SILENT_AFTER = 1.0
"""Time without a message of the driver from which it counts as silent, s: that within which a fault is to be said."""

_LOOK_PERIOD = 0.2
"""Time between two looks whether there is something to say of the driver, s: a fifth of that."""


class BlockSender:
    """Publishes what a source gives in blocks that end at multiples of a period, and now and then the latest sample.

    A late wake-up sends all blocks that are due, up to a second's worth: an instrument's buffer is not endless either,
    and what is older shows as lost samples.
    """

    def __init__(
        self,
        node: ManagedNode,
        topic: Topic,
        source: Source,
        period_ns: int,
        human: tuple[Topic, Callable[[SampleBlock], messages.Message]],
    ) -> None:
        """Send blocks of `source` on `topic` each `period_ns`, and what `human` makes of a block on its topic."""
        self._node = node
        self._source = source
        self._period_ns = period_ns
        self._frame = topic.frame
        self._blocks = node.publish_on(topic)
        self._people = node.publish_on(human[0])
        self._human_message = human[1]
        self._sent_ns = 0
        self._human_ns = 0
        began_ns = node.now_ns()
        period = period_ns / NANOSECONDS
        self.watch = StreamWatch(topic.name, _LATE_PERIODS * period, _STALE_AFTER + 2 * period, began_ns, outgoing=True)
        node.at_each(period_ns, self._send)

    def _send(self, due_ns: int) -> None:
        if not 0 <= due_ns - self._sent_ns <= _LONGEST_CATCH_UP:
            self._sent_ns = due_ns - (self._period_ns if self._sent_ns == 0 else _LONGEST_CATCH_UP)
        while self._sent_ns < due_ns:
            since_ns, self._sent_ns = self._sent_ns, self._sent_ns + self._period_ns
            block = self._source.take(since_ns, self._sent_ns)
            if block is not None:
                self._publish(block)

    def _publish(self, block: SampleBlock) -> None:
        self._blocks.publish(messages.block_bytes(block, self._frame))
        self.watch.observe(block, self._node.now_ns())
        if block.stamp_ns - self._human_ns >= _HUMAN_PERIOD:
            self._human_ns = block.stamp_ns
            self._people.publish(self._human_message(block))


class Driver:
    """The topic of a third-party driver: its messages are gathered as samples, and its silence is said."""

    def __init__(self, node: ManagedNode, topic: str) -> None:
        """Hear `topic`, which may be relative to the node's namespace."""
        self._node = node
        self._topic = node.resolve_topic_name(topic)
        self._watch = StreamWatch(self._topic, _STALE_AFTER, _SILENT_AFTER, node.now_ns())
        self._said = ""

    def gather(
        self, kind: type[Any], source: Gathered, sample: Callable[[messages.Message], Sequence[float]]
    ) -> Gathered:
        """Have `source` gather what `sample` makes of each message of type `kind`; gives the source.

        Where several publish, nothing tells whose sample is whose, and none is taken.
        """

        def receive(message: messages.Message) -> None:
            try:
                if self._node.is_shared(self._topic):
                    source.drop()
                    raise InputError(self._node.publishers_of(self._topic))
                stamp_ns, now_ns = messages.measured_ns(message.header), self._node.now_ns()
                source.add(stamp_ns, sample(message), now_ns)
            except InputError as error:
                self._watch.refuse(str(error))
                raise
            self._watch.observe_stamp(stamp_ns, now_ns)

        self._node.listen(self._topic, kind, driver_profile(), receive)
        self._node.every(_LOOK_PERIOD, self._look)
        return source

    def condition(self, now_ns: int) -> Condition:
        """What comes of the driver, and whether there is one."""
        found = self._watch.report(now_ns)
        nobody = self._nobody(now_ns)
        return replace(found, message=f"{found.message}: {nobody}") if nobody else found

    def _nobody(self, now_ns: int) -> str:
        """That nobody publishes, where nothing comes; empty where somebody does."""
        if not self._watch.is_stale(now_ns) or self._node.count_publishers(self._topic):
            return ""
        return f"nobody publishes on {self._topic}"

    def _look(self) -> None:
        """Log when the driver falls silent, and when it is heard again."""
        now_ns = self._node.now_ns()
        if not self._node.active:
            return
        words = ""
        if self._watch.is_stale(now_ns):
            words = self._nobody(now_ns) or f"no sample that can be used comes on {self._topic}"
        if words and words != self._said:
            self._node.get_logger().warning(words)
        elif self._said and not words:
            self._node.get_logger().info(f"samples come on {self._topic}")
        self._said = words


class SensorNode(ManagedNode):
    """Node of one instrument: its parameter `source` names the device that the samples come from.

    A subclass lists in `sources` a method for each, and says on which topics it speaks.
    """

    sources: ClassVar[dict[str, Callable[[Any], Source]]]

    def open(self) -> None:
        """Open the source and begin to send."""
        period_ns = round(self.setting("block_period") * NANOSECONDS)
        name = self.setting("source")
        self.hardware = name
        self._driver: Driver | None = None
        topic, people = self.topics()
        source = self.sources[name](self)
        self._sender = BlockSender(self, topic, source, period_ns, (people, self.human_message))
        if isinstance(source, Polled):
            self.at_each(round(NANOSECONDS / self.setting("poll_rate")), lambda _: source.poll(self.now_ns()))

    @abstractmethod
    def topics(self) -> tuple[Topic, Topic]:
        """Topic of the blocks and topic for people."""

    @abstractmethod
    def human_message(self, block: SampleBlock) -> messages.Message:
        """What people see of the latest sample of a block."""

    def mock(self, stream: str) -> Source:
        """Source of a stream of the true stage that all mock sources of the cell see."""
        return MockSource(mock_stage(self.stage, mock_settings(self)), stream)

    def hear(
        self, topic: str, kind: type[Any], source: Gathered, sample: Callable[[messages.Message], Sequence[float]]
    ) -> Source:
        """Source of what a third-party driver publishes; see `Driver`."""
        self._driver = Driver(self, topic)
        return self._driver.gather(kind, source, sample)

    def conditions(self, now_ns: int) -> list[Condition]:
        """The driver that is heard, if it is one, and the stream that goes out."""
        driver = [] if self._driver is None else [self._driver.condition(now_ns)]
        return [*driver, self._sender.watch.report(now_ns)]


def mock_settings(node: ManagedNode) -> MockSettings:
    """What the parameters of a node say about the mock stage."""
    return MockSettings(
        seed=node.setting("mock.seed"),
        epoch_ns=node.setting("mock.epoch") or last_midnight(node.now_ns()),
        speeds=tuple(node.setting("mock.speeds")),
        forces=node.setting("mock.forces"),
        force_cycle=node.setting("mock.force_cycle"),
        rate=(node.setting(RATE.name) or None) if node.has_parameter(RATE.name) else None,
    )


def source_setting(*choices: str) -> Setting:
    """The parameter `source`, the first choice by default."""
    return Setting("source", choices[0], "where the samples come from", choices=choices)


POLL_RATE = Setting("poll_rate", 500.0, "how often a device in sysfs is read, Hz", (1.0, 5000.0))
