"""What a live run decided, repeated in a replay: which streams each tick rested on, and what was believed of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.pipeline.estimator_settings import LONGEST_GAP_NS
from rotary_error_monitor.pipeline.publication import Decision, Decisions
from rotary_error_monitor.signals.resampling import Resampled, resample

_NONE = Decision(0)

OTHERS = "listed sensors"
"""Name of streams for whose bits the description lists no sensor."""


class Repetition:
    """Repeats the decisions of a live run where the recording holds what they rested on.

    Attributes:
        begin_ns: timestamp (ns) of the recording's first sample.
        reach_ns: how far before a tick the samples may lie that it rests on, ns.
        unrepeated: ticks (ns) at which the live run used a stream of which the recording lacks samples, by stream; they
            follow from what the recording has.
    """

    def __init__(self, decisions: Decisions, bits: Mapping[str, int], streams: Sequence[str], heads: int) -> None:
        """Repeat `decisions`, by stamp (ns) of a tick.

        Args:
            decisions: what a live run published.
            bits: bits in masks of what may be in `streams`.
            streams: by their names.
            heads: bit mask of the heads.
        """
        self._decisions, self._bits, self._streams = decisions, bits, tuple(streams)
        self._head_bits = heads
        self.begin_ns = self.reach_ns = 0
        self.unrepeated: dict[str, list[NDArray[np.int64]]] = {}

    def joined(
        self,
        ticks: NDArray[np.int64],
        signals: Sequence[tuple[NDArray[np.int64], Array]],
        values: Sequence[Resampled],
        period_ns: int,
    ) -> list[Resampled]:
        """Values of the streams at the ticks (m,), also where a live run alone joined the samples around a tick.

        How far apart samples are that it joined is a parameter of the live run (`max_gap`), which the recording does
        not hold; which streams it used at a tick, it does.
        """
        found = list(values)
        if all(each.valid.all() for each in values):
            return found
        used = np.array([(decision or _NONE).streams for decision in self._found(ticks)], np.int64)
        for place, name in enumerate(self._streams):
            lacking = (used & self._bits[name] != 0) & ~values[place].valid
            if lacking.any():
                wider = resample(*signals[place], ticks[lacking], period_ns, LONGEST_GAP_NS)
                found[place] = values[place].replaced(lacking, wider)
        return found

    def choose(
        self, ticks: NDArray[np.int64], there: NDArray[np.int64], own: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], dict[int, Decision]]:
        """Streams that tell something at ticks (m,), and the decisions to repeat by the place of their tick.

        What is not of a head was judged live at every tick, also where a tick did not rest on it in the end.

        Args:
            ticks: (m,) timestamps (ns).
            there: (m,) masks of the streams that have samples.
            own: (m,) masks of the streams to use where a decision cannot be repeated.
        """
        found = self._found(ticks)
        lacking = self._lacking(found, there)
        # the first ticks of a recording that was begun in mid-run rest on samples from before it: there nothing is used
        used = np.where((lacking == 0) | self._is_lost(ticks), own, 0)
        decided = {
            place: decision for place, decision in enumerate(found) if decision is not None and lacking[place] == 0
        }
        for place, decision in decided.items():
            used[place] = decision.streams | own[place] & ~self._head_bits
        return used, decided

    def note(self, ticks: NDArray[np.int64], there: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Take note of which ticks (m,) were reckoned; give which of them the live run published (m,)."""
        found = self._found(ticks)
        lacking = np.where(self._is_lost(ticks), self._lacking(found, there), 0)
        for name, bit in (*self._bits.items(), (OTHERS, ~sum(self._bits.values()))):
            if (lost := ticks[lacking & bit != 0]).size:
                self.unrepeated.setdefault(name, []).append(lost)
        return np.array([decision is not None for decision in found], np.bool_)

    def _found(self, ticks: NDArray[np.int64]) -> list[Decision | None]:
        return [self._decisions.get(tick) for tick in ticks.tolist()]

    @staticmethod
    def _lacking(found: list[Decision | None], there: NDArray[np.int64]) -> NDArray[np.int64]:
        """Mask of the streams that a live run used at each tick and of which samples are missing."""
        return np.array([(decision or _NONE).streams for decision in found], np.int64) & ~there

    def _is_lost(self, ticks: NDArray[np.int64]) -> NDArray[np.bool_]:
        return np.asarray(ticks >= self.begin_ns + self.reach_ns)
