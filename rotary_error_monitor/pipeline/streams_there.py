"""Which streams have a value at a tick, as far as a stream's own gaps and the begin of the heads allow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Times
from rotary_error_monitor.signals.resampling import Resampled
from rotary_error_monitor.signals.streams import SampleStream


class StreamsThere:
    """Finds the streams that count as there.

    What a live run decided stands in a replay: the bag may begin later than a stream did.
    """

    def __init__(
        self,
        streams: Mapping[str, SampleStream],
        bits: Mapping[str, int],
        heads: Sequence[str],
        period_ns: int,
        *,
        live: bool,
    ) -> None:
        """Of `streams` with their `bits`, some of them heads, at ticks that are so far apart; `live` or repeated."""
        self._streams, self._period_ns, self._live = streams, period_ns, live
        self._bits = np.array([[bits[name]] for name in streams])
        self._heads, self._head_bits = tuple(heads), sum(bits[name] for name in heads)

    def at(self, ticks: Times, values: Sequence[Resampled]) -> NDArray[np.int64]:
        """Bit mask of the streams that have a value at each tick, of the values of all of them in their order."""
        there = np.array([each.valid for each in values])
        for heard, stream in zip(there, self._streams.values(), strict=True):
            if stream.has_gaps:
                heard &= stream.is_whole(ticks, self._period_ns, after_patience=self._live)
        masks: NDArray[np.int64] = (there * self._bits).sum(axis=0)
        begun = self._all_heads_begun_ns()
        if ticks[0] < begun:
            masks &= np.where(ticks < begun, ~self._head_bits, -1)
        return masks

    def _all_heads_begun_ns(self) -> int:
        """Timestamp (ns) before which a head that was awaited had not begun: until then nothing tells a wrong one."""
        begun = [0]
        for name in self._heads if self._live else ():
            stream = self._streams[name]
            if stream.begin_ns is not None:  # a value at a tick rests on samples to both of its sides
                begun.append(stream.begin_ns + 2 * max(self._period_ns, round(stream.spacing_ns)))
        return max(begun)
