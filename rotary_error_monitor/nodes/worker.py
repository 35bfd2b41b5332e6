"""The thread on which a node handles messages and round instants; services and parameters stay with the executor.

An rclpy executor assembles its wait set of all some forty entities of a managed node twice for each callback: 0.7 ms,
at 200 blocks a second a seventh of a core for each stream of a cell. This wait set holds the subscriptions alone.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

from rclpy.callback_groups import CallbackGroup
from rclpy.context import Context
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.subscription import Subscription

from rotary_error_monitor.signals.blocks import NANOSECONDS

MessageInfo: TypeAlias = dict[str, int | None]
"""Of a message: when it was sent and received (`source_timestamp`, `received_timestamp`, ns of the system), and its
`publication_sequence_number`."""

_LONGEST_NAP_NS = 5_000_000
_LONGEST_WAIT_NS = 50_000_000
_MOST_ROUNDS = 8  # messages of one stream taken before what they allow is reckoned, even if more are waiting
_LONGEST_REST = 0.01  # s; a backlog is not left waiting


class NotByExecutor(CallbackGroup):
    """Callback group of the subscriptions that a worker serves: the executor leaves them alone."""

    def can_execute(self, entity: Any) -> bool:  # noqa: ANN401 (rclpy's signature)
        """Never."""
        return False

    def beginning_execution(self, entity: Any) -> bool:  # noqa: ANN401
        """Never."""
        return False

    def ending_execution(self, entity: Any) -> None:  # noqa: ANN401
        """Nothing was begun."""


@dataclass
class _Beat:
    period_ns: int
    callback: Callable[[int], None]
    last_ns: int = 0


class Worker:
    """Calls back with each message, after all that came together, and once for each multiple of a period that passed.

    Streams are served in turn, a message each: one that has a backlog shall not make the others look late. A late
    wake-up reports the latest multiple only: whoever is called sends all that became due since the last call.

    What is reckoned after messages costs by the call, hardly by the message. Where something is, the worker rests after
    each wake-up as long as that took, so that what comes meanwhile shares the next: on a slow or busy computer more
    messages share a call instead of piling up, and a cell of many nodes keeps its processors half free.
    """

    def __init__(self, context: Context, now_ns: Callable[[], int], fail: Callable[[Exception], None]) -> None:
        """Keep the time of `now_ns`, a clock that may jump or halt; `fail` is told what a callback did not handle.

        `gather` (s) may be set before `start`: how long messages gather after the first has come, for each wake-up
        costs more than the messages it brings. With None they gather until the next instant, at most 5 ms.
        """
        self.gather: float | None = 0.0
        self._context = context
        self._now_ns = now_ns
        self._fail = fail
        self._beats: list[_Beat] = []
        self._subscriptions: list[Subscription] = []
        self._callbacks: dict[Subscription, Callable[[Any, MessageInfo], None]] = {}
        self._after: list[Callable[[], None]] = []
        self._ending = threading.Event()
        self._thread: threading.Thread | None = None

    def at_each(self, period_ns: int, callback: Callable[[int], None]) -> None:
        """Call back at each multiple of `period_ns`, from `start` on, with that instant (ns)."""
        self._beats.append(_Beat(period_ns, callback))

    def serve(self, subscription: Subscription, callback: Callable[[Any, MessageInfo], None]) -> None:
        """Call back with each message and what the middleware knows of it, from `start` on.

        The subscription's group is `NotByExecutor`.
        """
        self._subscriptions.append(subscription)
        self._callbacks[subscription] = callback

    def after_messages(self, callback: Callable[[], None]) -> None:
        """Call back once after the messages that were there at one wake-up: the more came, the less each one costs."""
        self._after.append(callback)

    def start(self) -> None:
        """Begin, if there is anything to do."""
        if self._beats or self._subscriptions:
            self._thread = threading.Thread(target=self._run, name="worker")
            self._thread.start()

    def stop(self) -> None:
        """End: when this returns, nothing is called any more."""
        self._ending.set()
        if self._thread is not None:
            self._thread.join()
        self._thread = None
        self._beats.clear()
        self._subscriptions.clear()
        self._callbacks.clear()
        self._after.clear()
        self._ending.clear()

    def _run(self) -> None:
        try:
            at_messages = self._subscriptions and self.gather is not None
            wait = self._wait_for_messages() if at_messages else self._wait_for_instants()
            while not wait():
                now_ns = self._now_ns()
                for beat in self._beats:
                    self._call_if_due(beat, now_ns)
        except Exception as error:
            self._fail(error)

    def _wait_for_instants(self) -> Callable[[], bool]:
        def wait() -> bool:
            if not self._ending.wait(self._nap_ns() / NANOSECONDS):
                self._take(list(self._subscriptions))
            return self._ending.is_set()

        return wait

    def _wait_for_messages(self) -> Callable[[], bool]:
        wait_set = rclpy_implementation.WaitSet(len(self._subscriptions), 0, 0, 0, 0, 0, self._context.handle)

        def wait() -> bool:
            wait_set.clear_entities()
            for subscription in self._subscriptions:
                wait_set.add_subscription(subscription.handle)
            wait_set.wait(self._nap_ns())
            ready = set(wait_set.get_ready_entities("subscription"))
            if ready and self.gather:
                self._ending.wait(self.gather)
                self._take(list(self._subscriptions))
            else:
                begin = time.monotonic()
                self._take([each for each in self._subscriptions if each.handle.pointer in ready])
                if ready and self._after:
                    self._ending.wait(min(time.monotonic() - begin, _LONGEST_REST))
            return self._ending.is_set()

        return wait

    def _take(self, ready: list[Subscription]) -> None:
        rounds = 0
        while ready and not self._ending.is_set():
            ready = [subscription for subscription in ready if self._take_one(subscription)]
            rounds += 1
            if not ready or rounds % _MOST_ROUNDS == 0:
                for callback in self._after:
                    callback()

    def _take_one(self, subscription: Subscription) -> bool:
        taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
        if taken is not None:
            message, about = taken
            self._callbacks[subscription](message, about)
        return taken is not None

    def _call_if_due(self, beat: _Beat, now_ns: int) -> None:
        due_ns = now_ns - now_ns % beat.period_ns
        # A clock that was set back makes the old multiples meaningless; simulated time is 0 until it is known.
        if due_ns > beat.last_ns or due_ns < beat.last_ns - beat.period_ns:
            beat.last_ns = due_ns
            beat.callback(due_ns)

    def _nap_ns(self) -> int:
        """Time to the next instant, ns; never long, for simulated time runs at a speed of its own."""
        if not self._beats:
            return _LONGEST_WAIT_NS if self.gather is not None else _LONGEST_NAP_NS
        now_ns = self._now_ns()
        return min(_LONGEST_NAP_NS, *(beat.period_ns - now_ns % beat.period_ns for beat in self._beats))
