"""What the nodes of all instruments share: a source, its blocks on time, beside them a message for people."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import replace
from functools import partial
from typing import Any, ClassVar

from rotary_error_monitor.codec.driver_messages import DriverReader
from rotary_error_monitor.description.wire import Topic
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.diagnostics import Condition, StreamWatch
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.pace import Pace
from rotary_error_monitor.nodes.parameters import cell_settings
from rotary_error_monitor.nodes.qos import driver_profile
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock
from rotary_error_monitor.sources.device import POLL_RATE, Instrument, opened, told_of
from rotary_error_monitor.sources.library import device_settings, load_devices
from rotary_error_monitor.sources.source import Heard, Polled, Source

_LONGEST_CATCH_UP = NANOSECONDS
_HUMAN_PERIOD = 50_000_000
_LATE_PERIODS = 4.0
_STALE_AFTER = 0.5

_SILENT_AFTER = 1.0
"""Time without a message of the driver from which it counts as silent, s, where blocks do not take longer: that within
which a fault is to be said."""

THERMOMETER = 10.0
"""Longest time between two samples of a usual thermometer, s."""

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
        slowest: float = 0.0,
    ) -> None:
        """Send blocks of `source` on `topic` each `period_ns`, and what `human` makes of a block on its topic.

        A source may have nothing to give for `slowest` s before it counts as silent.
        """
        self._node = node
        self._source = source
        self._period_ns = period_ns
        self._frame = topic.frame
        self._blocks = node.publish_on(topic)
        self._people = node.publish_on(human[0])
        self._human_message = human[1]
        self._sent_ns = 0
        self._human_pace = Pace(_HUMAN_PERIOD)
        began_ns = node.now_ns()
        period = period_ns / NANOSECONDS
        stale_after = _STALE_AFTER + 2 * period + slowest
        self.watch = StreamWatch(topic.name, _LATE_PERIODS * period, stale_after, began_ns, outgoing=True)
        node.at_each(period_ns, self._send)

    def _send(self, due_ns: int) -> None:
        if not 0 <= due_ns - self._sent_ns <= _LONGEST_CATCH_UP:
            self._sent_ns = due_ns - (self._period_ns if self._sent_ns == 0 else _LONGEST_CATCH_UP)
        while self._sent_ns < due_ns:
            since_ns, self._sent_ns = self._sent_ns, self._sent_ns + self._period_ns
            with told_of(self._node.hardware):
                block = self._source.take(since_ns, self._sent_ns)
            if block is not None:
                self._publish(block)

    def _publish(self, block: SampleBlock) -> None:
        self._blocks.publish(messages.block_bytes(block, self._frame))
        self.watch.observe(block, self._node.now_ns())
        if self._human_pace.is_due(block.stamp_ns):
            self._people.publish(self._human_message(block))


class Driver:
    """The topic of a third-party driver: its messages are gathered as samples, and its silence is said."""

    def __init__(self, node: ManagedNode, source: Heard, silent_after: float) -> None:
        """Have `source` gather the samples of its topic, which counts as silent after a time, s.

        Where several publish, nothing tells whose sample is whose, and none is taken.
        """
        self._node = node
        self._source = source
        self._topic = node.resolve_topic_name(source.topic)
        late_after = silent_after - _SILENT_AFTER + _STALE_AFTER
        self._watch = StreamWatch(self._topic, late_after, silent_after, node.now_ns())
        self._said = ""
        # what is sent on is sent at instants: a wake-up for each message would cost more than all else
        node.gather(None)
        self._kind = messages.message_class(source.type)
        self._reader = DriverReader(source.type)
        node.listen_raw(self._topic, self._kind, driver_profile(), self._receive)
        node.every(_LOOK_PERIOD, self._look)

    def _receive(self, data: bytes, received_ns: int) -> None:
        try:
            if self._node.listening.is_shared(self._topic):
                self._source.drop()
                raise InputError(self._node.listening.publishers_of(self._topic))
            message = self._reader.read(data) or messages.message_from_bytes(data, self._kind)
            stamp_ns = messages.measured_ns(message.header)
            with told_of(self._node.hardware):
                self._source.add(stamp_ns, self._source.sample(message), received_ns)
        except InputError as error:
            self._watch.refuse(str(error))
            raise
        self._watch.observe_stamp(stamp_ns, received_ns)

    def condition(self, now_ns: int) -> Condition:
        """What comes of the driver, and whether there is one."""
        found = self._watch.report(now_ns)
        nobody = self._nobody(now_ns)
        return replace(found, message=f"{found.message}: {nobody}") if nobody else found

    def state(self, now_ns: int) -> str:
        """In a word whether samples come."""
        return self._watch.state(now_ns)

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

    Attributes:
        kind: of the instrument, as devices name what they serve.
        own_topics: the contract's names of the topics of its blocks and of its message for people, where a stage has
            one instrument of the kind.
        joint: name of the joint in its message for people, where that is a joint state; empty for that of the frame.
    """

    kind: ClassVar[str]
    own_topics: ClassVar[tuple[str, str]]
    joint: ClassVar[str] = ""

    def __init__(self, name: str, **how: Any) -> None:  # noqa: ANN401 (as `ManagedNode`)
        """As `ManagedNode`; parameters are those of the devices as well.

        Raises:
            InputError: as there, or a device of a plug-in cannot be loaded.
        """
        self._devices = load_devices(self.kind)
        self._source: Source | None = None
        self.settings = (*self.settings, *cell_settings("block_period"), *device_settings(self._devices))
        super().__init__(name, **how)

    def topics(self) -> tuple[Topic, Topic]:
        """The contract's topics of the instrument's blocks and of its message for people; the stage is known by then.

        Raises:
            InputError: the stage has no such instrument.
        """
        samples, people = self.own_topics
        return self.wire.topic(samples), self.wire.topic(people)

    def block_period(self, stream: str) -> float:
        """Time from one block of a stream to the next, s: the parameter `block_period`."""
        return float(self.setting("block_period"))

    def slowest(self, stream: str) -> float:
        """Longest time between two samples of a usual instrument of a stream, s; 0 for those of many a second."""
        return 0.0

    def open(self) -> None:
        """Open the source and begin to send."""
        self.hardware = self.setting("source")
        samples, people = self.topics()
        period_ns = round(self.block_period(samples.frame) * NANOSECONDS)
        instrument = Instrument(samples.frame, samples.columns, self.stage, self.setting, self.now_ns())
        device = self._devices[self.hardware]
        self.simulates = device.simulated
        with told_of(self.hardware):
            self._source = source = opened(device, instrument)
        told = people, partial(messages.latest_message, people, joint=self.joint)
        slowest = self.slowest(samples.frame)
        self._sender = BlockSender(self, samples, source, period_ns, told, slowest)
        silent_after = max(_SILENT_AFTER, _STALE_AFTER + 2 * period_ns / NANOSECONDS) + slowest
        self._driver = Driver(self, source, silent_after) if isinstance(source, Heard) else None
        if isinstance(source, Polled):
            self.at_each(round(NANOSECONDS / self.setting(POLL_RATE.name)), lambda _: self._poll(source))

    def origin(self) -> dict[str, object]:
        """The source, real or simulated."""
        return {"source": self.hardware} | super().origin()

    def release(self) -> None:
        """Close the source."""
        source, self._source = self._source, None
        if source is None:
            return
        try:
            with told_of(self.hardware):
                source.close()
        except InputError as error:  # what else there is shall be put away all the same
            self.get_logger().error(f"not closed: {error}")

    def _poll(self, source: Polled) -> None:
        with told_of(self.hardware):
            source.poll(self.now_ns())

    def conditions(self, now_ns: int) -> list[Condition]:
        """The driver that is heard, if it is one, and the stream that goes out."""
        driver = [] if self._driver is None else [self._driver.condition(now_ns)]
        return [*driver, self._sender.watch.report(now_ns)]

    def news(self, now_ns: int) -> Hashable:
        """Whether samples come and go out."""
        return "" if self._driver is None else self._driver.state(now_ns), self._sender.watch.state(now_ns)
