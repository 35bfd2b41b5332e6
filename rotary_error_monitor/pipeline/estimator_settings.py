"""How an estimator samples, and what it counts for its diagnostics."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.signals.streams import SampleStream

SHORTEST_GAP_NS, LONGEST_GAP_NS = 100_000, 1_000_000_000
"""Range of `max_gap`, ns: from a stream of 10 kHz to a stage that is moved by hand."""

NEARLY = 0.9
"""Part of `max_gap` from which samples are so far apart that the scatter of their stamps leaves gaps."""


@dataclass(frozen=True)
class EstimatorSettings:
    """How the estimator samples and when it goes on without a stream.

    Attributes:
        period_ns: distance of two estimates, ns.
        patience_ns: how far a stream may stay behind the others before it counts as absent, ns; the longest block
            comes on top.
        max_gap_ns: samples further apart than this are not joined, ns.
        disagreement_limit: contradiction among the heads, in standard deviations, from which nothing is published.
        max_age_ns: samples that are older at their arrival are refused, ns.
        check_turns: part of a turn that must have been seen before the description counts as verified.
    """

    period_ns: int = 1_000_000
    patience_ns: int = 100_000_000
    max_gap_ns: int = 25_000_000
    disagreement_limit: float = 10.0
    max_age_ns: int = 1_000_000_000
    check_turns: float = 1.0

    def __post_init__(self) -> None:
        for name in ("period_ns", "patience_ns", "max_gap_ns", "max_age_ns"):
            if getattr(self, name) <= 0:
                raise InputError(f"estimator setting {name} is {getattr(self, name)}; it must be above 0")
        if not self.disagreement_limit > 0:
            raise InputError(f"estimator setting disagreement_limit is {self.disagreement_limit}; it must be above 0")
        if not self.check_turns >= 0:
            raise InputError(f"estimator setting check_turns is {self.check_turns}; it must be 0 or more")


MAX_GAP = EstimatorSettings.max_gap_ns * 1e-9
"""Default of `max_gap`, s."""


def max_gap_of(gap: float, nanoseconds: int, told: str) -> int:
    """`max_gap`, ns, of one in a unit of so many nanoseconds; `told` as in `--max-gap-ms is 0`.

    Raises:
        InputError: an estimator has none so short or so long.
    """
    shortest, longest = SHORTEST_GAP_NS / nanoseconds, LONGEST_GAP_NS / nanoseconds
    if not shortest <= gap <= longest:
        raise InputError(f"{told}; it must be from {shortest:g} to {longest:g}")
    return round(gap * nanoseconds)


@dataclass
class EstimatorStatus:
    """What a diagnostic tells of the estimator; counts since the start.

    Attributes:
        estimates: ticks published.
        withheld: ticks not published because the heads contradict one another.
        unobservable: ticks not published because nothing was there that tells the rotation.
        saturated: samples of autocollimator and listed sensors at the end of the measuring range, by stream.
        restarts: how often everything began anew because the clock was set back.
        turns: whole turns that were taken out of the heads, to count as the command does.
        absent: streams that nobody waits for now.
        sparse: streams whose samples are further apart than `max_gap`, or nearly so: their stamps scatter.
        unjoined: ticks published without a value of a stream that nobody takes for absent, by stream: samples between
            which a value would lie are missing, or not joined for they are too far apart or too uneven.
        joined: bit mask of the streams that had a value since the start, or since the clock was set back.
        refused: messages refused by their time of arrival, by stream and reason.
        disagreement: contradiction among the heads at the latest tick, standard deviations.
        unseen_orders: harmonics of the graduation, up to `HIGHEST_ORDER`, that the heads in use cannot contradict: they
            pass for rotation or radial motion.
        streams: by name.
    """

    estimates: int = 0
    withheld: int = 0
    unobservable: int = 0
    restarts: int = 0
    turns: int = 0
    absent: tuple[str, ...] = ()
    sparse: tuple[str, ...] = ()
    saturated: Counter[str] = field(default_factory=Counter)
    unjoined: Counter[str] = field(default_factory=Counter)
    joined: int = 0
    refused: Counter[tuple[str, str]] = field(default_factory=Counter)
    disagreement: float = 0.0
    unseen_orders: tuple[int, ...] = ()
    streams: Mapping[str, SampleStream] = field(default_factory=dict)

    def note_sparse(self, max_gap_ns: int) -> None:
        """Take note of the streams whose samples are not joined, or nearly so."""
        self.sparse = tuple(name for name, each in self.streams.items() if each.spacing_ns > NEARLY * max_gap_ns)

    def note_unjoined(self, bits: Mapping[str, int], there: NDArray[np.int64], published: NDArray[np.bool_]) -> None:
        """Count the published ticks at which a stream lacks that had a value before.

        Args:
            bits: of the streams of which that would not be said otherwise, by name.
            there: (m,) bit mask of the streams that have a value at each tick.
            published: (m,) whether it is published.
        """
        expected = sum(bits.values()) & self.joined
        lacking = (expected & ~there)[published]
        if lacking.any():
            for name, bit in bits.items():
                if name not in self.absent and (count := int((lacking & bit != 0).sum())):
                    self.unjoined[name] += count
        self.joined |= int(np.bitwise_or.reduce(there))

    def too_far_apart(self, names: Sequence[str], max_gap_ns: int) -> str:
        """That samples of these streams are not joined, and why."""
        gap = max(self.streams[name].spacing_ns for name in names) * 1e-6
        return (
            f"samples of {', '.join(names)} are {gap:.3g} ms apart; "
            f"what is further apart than max_gap of {max_gap_ns * 1e-6:g} ms is not joined"
        )
