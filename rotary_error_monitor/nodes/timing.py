"""A timer that fires at round instants of a clock, so that the blocks of separate processes end together."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node

from rotary_error_monitor.signals.blocks import NANOSECONDS


class AlignedTimer:
    """Calls back once for each multiple of a period that has passed, with the latest such instant.

    A late wake-up reports the latest multiple only: whoever is called sends all that became due since the last call.
    A plain timer has a phase of its own, and one that drifts against the clock where that is disciplined.
    """

    def __init__(self, node: Node, period_ns: int, callback: Callable[[int], None]) -> None:
        """Start on the node's clock; with simulated time nothing is called before the first `/clock`."""
        self._node = node
        self._period_ns = period_ns
        self._callback = callback
        self._last_ns = 0
        self._timer = node.create_timer(period_ns / NANOSECONDS, self._tick)
        self._aim()

    def destroy(self) -> None:
        """Stop for good."""
        self._node.destroy_timer(self._timer)

    def _tick(self) -> None:
        now_ns = self._node.get_clock().now().nanoseconds
        due_ns = now_ns - now_ns % self._period_ns
        # The clock may have been set back, then the old multiples mean nothing any more.
        if due_ns > self._last_ns or due_ns < self._last_ns - self._period_ns:
            self._last_ns = due_ns
            self._callback(due_ns)
        self._aim()

    def _aim(self) -> None:
        now_ns = self._node.get_clock().now().nanoseconds
        self._timer.timer_period_ns = self._period_ns - now_ns % self._period_ns
        self._timer.reset()
