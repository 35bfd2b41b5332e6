"""The beat of LinuxCNC's servo thread, found by looking at a number that it changes each period.

What the thread commands holds from its beat on. A look at any time would see it up to a whole period later, and stamps
that scatter by that are far from what a drive shows: 0.5 mrad at 1 rad/s and 1 ms.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

from rotary_error_monitor.linuxcnc_controller.clock import Clock, Moment

_LEAD_NS = 150_000
"""How long before a beat the look for it begins, ns: a nap ends within some tens of microseconds."""

_STEP = 1e-5
"""Nap between two looks for it, s: without one this process would take the processor that a thread without real time
needs for its beat."""

_RUSH_NS = 300_000
"""How long it is looked for like that, ns; then it does not come as expected, and there is time."""

_PAUSE = 5e-5
"""Nap between two looks after that, s."""

_SHARP_NS = 200_000
"""Two looks further apart, ns, because this process had to wait, do not tell when a beat came between them."""

_LONGEST_NS = 5_000_000
"""How long a beat is waited for, ns: some periods of the slowest usual servo thread."""

_LATE_NS = 100_000
"""How late a beat is on time, ns: those of a real-time thread scatter by some tens of microseconds."""

_CREEP = 16
"""Beats over which a grid that is later than it seemed is believed; an earlier one is at once."""

_FIRST = 20
"""Beats from which the period is told."""

_LONGEST_BASELINE = 1000
"""Periods over which it is told at most: some hundredths of a microsecond are enough."""


@dataclass(frozen=True)
class Beat:
    """A beat.

    Attributes:
        moment: when it came.
        pulse: the number that the thread shows from then to the next.
        on_time: whether it came when it should; what a thread without real time tells late is not meant for then.
    """

    moment: Moment
    pulse: int
    on_time: bool


class ServoBeat:
    """Waits for beats; between them it sleeps, since a thread of the kernel keeps its period."""

    def __init__(self, pulse: Callable[[], int], sleep: Callable[[float], None] = time.sleep) -> None:
        """Look at `pulse`, which gives a number that changes with every beat."""
        self._pulse = pulse
        self._sleep = sleep
        self._period_ns: float | None = None
        self._due_ns = self._last_ns = self._origin_ns = 0
        self._count = 0
        self._baseline = _FIRST - 1

    def wait(self, clock: Clock) -> Beat | None:
        """The next beat; None where none comes within some periods."""
        if self._period_ns is None:
            self._learn(clock)
        self._nap(clock)
        return self._next(clock)

    def _nap(self, clock: Clock) -> None:
        """Sleep until shortly before the next beat, as far as that is known."""
        if self._period_ns is not None:
            ahead_ns = (self._due_ns - clock().steady_ns) % self._period_ns - _LEAD_NS
            if ahead_ns > 0:
                self._sleep(ahead_ns * 1e-9)

    def _learn(self, clock: Clock) -> None:
        times: list[int] = []
        while len(times) < _FIRST and (beat := self._next(clock)) is not None:
            times.append(beat.moment.steady_ns)
        if len(times) == _FIRST:
            self._period_ns = statistics.median(b - a for a, b in pairwise(times))
            self._due_ns = self._last_ns = self._origin_ns = times[-1]

    def _note(self, steady_ns: int) -> bool:
        """Whether a beat came on time."""
        if self._period_ns is None:
            return False
        self._measure(steady_ns, self._period_ns)
        periods = round((steady_ns - self._due_ns) / self._period_ns)
        late_ns = steady_ns - self._due_ns - periods * self._period_ns
        self._due_ns = round(steady_ns - late_ns + (late_ns if late_ns < 0 else late_ns / _CREEP))
        return late_ns <= _LATE_NS

    def _measure(self, steady_ns: int, period_ns: float) -> None:
        """The period: the longer ago the first beat was, the less it matters how late each of them comes."""
        self._count += round((steady_ns - self._last_ns) / period_ns)
        self._last_ns = steady_ns
        if self._count >= self._baseline:
            self._period_ns = (steady_ns - self._origin_ns) / self._count
            self._baseline = min(self._count, _LONGEST_BASELINE)
            if self._count >= _LONGEST_BASELINE:
                self._origin_ns, self._count = steady_ns, 0

    def _next(self, clock: Clock) -> Beat | None:
        calm_ns = _LONGEST_NS if self._period_ns is None else _RUSH_NS
        was_missed = False
        seen, begin = self._pulse(), clock()
        now = before = begin
        while now.steady_ns - begin.steady_ns < _LONGEST_NS:
            self._sleep(_PAUSE if was_missed and now.steady_ns - begin.steady_ns > calm_ns else _STEP)
            pulse, now = self._pulse(), clock()
            if pulse != seen and now.steady_ns - before.steady_ns <= _SHARP_NS:
                between_ns = (now.steady_ns - before.steady_ns) // 2
                moment = Moment(now.stamp_ns - between_ns, now.steady_ns - between_ns)
                return Beat(moment, pulse, self._note(moment.steady_ns))
            seen, before = pulse, now
            if not was_missed and now.steady_ns - begin.steady_ns > calm_ns:  # it began when the beat had just come
                self._nap(clock)
                seen, before = self._pulse(), clock()
                calm_ns = before.steady_ns - begin.steady_ns + _RUSH_NS
                was_missed = True
        return None
