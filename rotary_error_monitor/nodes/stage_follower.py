"""A mock stage on a machine: it turns as its command says, and its read heads and autocollimator speak.

It stands for these where a controller turns the axis, as LinuxCNC its table; who publishes the command is another node.

ros2 run rotary_error_monitor stage_follower
"""

from __future__ import annotations

from collections.abc import Hashable
from functools import partial

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.diagnostics import Condition, Level, StreamWatch
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.parameters import cell_settings
from rotary_error_monitor.nodes.process import program
from rotary_error_monitor.nodes.sensor import BlockSender
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock
from rotary_error_monitor.sources.follower import FollowedSource, FollowedStage
from rotary_error_monitor.sources.mock import MOCK, RATE, mock_settings

_STALE_AFTER = 0.5


class StageFollower(ManagedNode):
    """Publishes what the instruments of a stage see that turns as it is commanded."""

    settings = (*cell_settings("block_period", "mock."), RATE)
    hardware = MOCK
    simulates = True

    def open(self) -> None:
        """Listen to the command; the instruments speak from the first one on.

        Raises:
            InputError: the stage has no such instrument.
        """
        self._stage = FollowedStage(self.stage, mock_settings(self.setting, self.now_ns(), self.setting(RATE.name)))
        period_ns = round(self.setting("block_period") * NANOSECONDS)
        wire = self.wire.topic
        self._senders = []
        instruments = [(wire("head_samples", h), wire("head_joint_states", h)) for h in self.stage.azimuths]
        if self.stage.autocollimator is not None:
            instruments.append((wire("autocollimator_samples"), wire("autocollimator_tilt")))
        if not instruments:
            raise InputError("the stage has no section 'encoder' or 'autocollimator'; this node stands for these alone")
        for topic, people in instruments:
            told = people, partial(messages.latest_message, people)
            source = FollowedSource(self._stage, topic.frame)
            self._senders.append(BlockSender(self, topic, source, period_ns, told))
        self._topic = wire("command_samples")
        self._watch = StreamWatch(self._topic.name, _STALE_AFTER, _STALE_AFTER, self.now_ns())
        self.listen_to_blocks(self._topic, self._follow)

    def conditions(self, now_ns: int) -> list[Condition]:
        """The command that is followed, and the streams that go out."""
        topic, last_ns = self._topic.name, self._watch.last_ns
        if last_ns is None:
            return [Condition("command", Level.WARN, f"waiting for a command on {topic}")]
        age = (now_ns - last_ns) / NANOSECONDS
        level, words = Level.OK, "following"
        if self._watch.is_stale(now_ns):
            level, words = Level.ERROR, f"the stage stands: no command for {age:.1f} s on {topic}"
        command = Condition("command", level, words, {"age_ms": age * 1e3})
        return [command, *(sender.watch.report(now_ns) for sender in self._senders)]

    def news(self, now_ns: int) -> Hashable:
        """Whether the command comes and the streams go out."""
        return self._watch.state(now_ns), *(sender.watch.state(now_ns) for sender in self._senders)

    def _follow(self, block: SampleBlock) -> None:
        if self.listening.is_shared(self._topic.name):
            raise InputError(self.listening.publishers_of(self._topic.name))
        rows = block.columns(self._topic.columns).tolist()
        for stamp_ns, (angle, velocity) in zip(block.times_ns.tolist(), rows, strict=True):
            self._stage.command(stamp_ns, angle, velocity)
        self._watch.observe(block, self.now_ns())


main = program(StageFollower, "stage_follower")

if __name__ == "__main__":
    raise SystemExit(main())
