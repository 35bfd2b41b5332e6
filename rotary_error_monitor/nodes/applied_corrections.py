"""The feedback of a controller: corrections that it has in effect, on the contract's topic."""

from __future__ import annotations

from collections.abc import Sequence

from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.signals.blocks import NANOSECONDS

_PERIOD_NS = NANOSECONDS // 20
_LONGEST_INTERVAL_NS = 10 * _PERIOD_NS
"""Corrections further apart, or falling in time because the clock was set, tell no rate."""


class AppliedCorrections:
    """Publishes what is in effect at most 20 times a second, of whatever it is given more often."""

    def __init__(self, node: ManagedNode) -> None:
        """Publish for a node that opens."""
        self._topic = node.wire.topic("applied_corrections")
        self._publisher = node.publish_on(self._topic)
        self._names: tuple[str, ...] = ()
        self._last: tuple[int, tuple[float, ...]] | None = None

    def publish(self, stamp_ns: int, names: Sequence[str], effect: Sequence[float]) -> None:
        """Publish corrections in effect (m, rad) at `stamp_ns`, if it is time; the rate is that since the last ones."""
        last = self._last if self._names == tuple(names) else None
        if last is not None and stamp_ns // _PERIOD_NS == last[0] // _PERIOD_NS:
            return
        self._names, self._last = tuple(names), (stamp_ns, tuple(effect))
        elapsed_ns = 0 if last is None else stamp_ns - last[0]
        rates = [0.0] * len(effect)
        if last is not None and 0 < elapsed_ns <= _LONGEST_INTERVAL_NS:
            rates = [(now - then) * NANOSECONDS / elapsed_ns for now, then in zip(effect, last[1], strict=True)]
        self._publisher.publish(messages.joint_state_message(stamp_ns, self._topic.frame, names, effect, rates))
