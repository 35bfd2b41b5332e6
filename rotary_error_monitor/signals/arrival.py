"""Stamps of messages held against the clock at their arrival: what is in the future, and what is too old."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.errors import InputError

FUTURE = "stamped in the future"
OLD = "too old at arrival"

AHEAD_NS = 100_000_000
"""How far a stamp may be ahead of the clock, ns: less than an estimate waits for a stream that stays behind, and more
than the clocks of well kept computers differ by."""


@dataclass
class ArrivalCheck:
    """Holds the stamps of messages against the time at which they arrive.

    Attributes:
        max_age_ns: a message whose newest sample is older than this at its arrival is refused.
        ahead_ns: how far a stamp may be ahead of the clock, see `AHEAD_NS`.
        refused: messages by reason.
    """

    max_age_ns: int = 1_000_000_000
    ahead_ns: int = AHEAD_NS
    refused: Counter[str] = field(default_factory=Counter)
    _behind: bool = False

    def __post_init__(self) -> None:
        if self.max_age_ns <= 0 or self.ahead_ns < 0:
            raise InputError(
                f"an age limit of {self.max_age_ns} ns and {self.ahead_ns} ns ahead; expected above 0 and at least 0"
            )

    def newest_of(self, times: NDArray[np.int64], arrival_ns: int, newest_ns: int | None = None) -> int:
        """Timestamp (ns) of the newest of samples at `times` (n,) that is not in the future; of all, where all are.

        That of the newest of all may be known.
        """
        newest = int(times.max()) if newest_ns is None else newest_ns
        if newest - arrival_ns <= self.ahead_ns:
            return newest
        come = times[times <= arrival_ns + self.ahead_ns]
        return int(come.max()) if len(come) else newest

    def judge(self, newest_ns: int, arrival_ns: int) -> str:
        """Why a message with its newest sample at `newest_ns` is refused at `arrival_ns`, timestamps; empty if not.

        Once one was too old, all are refused until they come within half of that age: a backlog must not stay, but a
        computer that is always somewhat late must come back.
        """
        if refusal := self.judge_ahead(newest_ns, arrival_ns):
            return refusal
        age_ns = arrival_ns - newest_ns
        limit_ns = self.max_age_ns // 2 if self._behind else self.max_age_ns
        self._behind = age_ns > limit_ns
        if self._behind:
            self.refused[OLD] += 1
            limit = f"limit {limit_ns * 1e-9:g} s" + (" until it has caught up" if limit_ns < self.max_age_ns else "")
            return f"{OLD}: {_duration(age_ns)}, {limit}; are the clocks of all computers alike?"
        return ""

    def judge_ahead(self, newest_ns: int, arrival_ns: int) -> str:
        """The same of what is in the future alone: of a recording nothing is too old."""
        if newest_ns - arrival_ns <= self.ahead_ns:
            return ""
        self.refused[FUTURE] += 1
        return f"{FUTURE}: {_duration(newest_ns - arrival_ns)} ahead of this computer's clock; are all clocks alike?"

    def was_set_back(self, newest_ns: int | None, arrival_ns: int) -> bool:
        """Whether what was believed before is in the future now: the clock was set back."""
        return newest_ns is not None and newest_ns - arrival_ns > self.ahead_ns


def _duration(ns: int) -> str:
    """A span of time for people."""
    seconds = ns * 1e-9
    for size, unit in ((86_400.0, "days"), (3_600.0, "h"), (60.0, "min")):
        if seconds >= 2 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.3g} s"
