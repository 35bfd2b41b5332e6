"""The command of a stage that is an axis of the machine, as its controller gives it to the drive."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.diagnostics import Condition, Level
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.sensor import BlockSender
from rotary_error_monitor.signals.blocks import NANOSECONDS
from rotary_error_monitor.sources.source import Gathered


class ControllerCommand:
    """Publishes the command of one axis as `stage_command` would, so that no other node need do so.

    It is what the drive is told, corrections included: what the stage turns by because of them is no error of its own.
    """

    def __init__(self, node: ManagedNode, letter: str, period: float) -> None:
        """Send blocks of the axis `letter` each `period` s for a node that opens."""
        samples, people = node.wire.topic("command_samples"), node.wire.topic("command_joint_states")
        self._node = node
        self._letter = letter
        self._topic = samples.name
        self._source = Gathered(samples.columns)
        told = people, partial(messages.latest_message, people, joint=messages.STAGE_JOINT)
        self._sender = BlockSender(node, samples, self._source, round(period * NANOSECONDS), told)

    def note(self, stamp_ns: int, names: Sequence[str], commands: Sequence[float], speeds: Sequence[float]) -> None:
        """Take what the drives are told at `stamp_ns` (ns): positions (m, rad) and how fast they change, by axis."""
        if self._letter not in names:
            return
        place = names.index(self._letter)
        try:
            self._source.add(stamp_ns, (commands[place], speeds[place]), self._node.now_ns())
        except InputError as error:
            self._node.refuse(self._topic, error)

    def condition(self, now_ns: int, names: Sequence[str], trouble: str) -> Condition:
        """How the stream fares, for a controller with these axes; `trouble` says why it moves none."""
        found = self._sender.watch.report(now_ns)
        if names and self._letter not in names:
            text = f"no command: the controller has the axes {' '.join(names)}, not the monitored one, {self._letter}"
            return Condition(found.what, Level.ERROR, text, found.figures)
        return Condition(found.what, Level.WARN, f"no command: {trouble}", found.figures) if trouble else found
