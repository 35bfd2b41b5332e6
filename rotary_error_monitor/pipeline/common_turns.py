"""The whole turns that heads count: the same for all of them, wherever each began to count."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array, Mask
from rotary_error_monitor.signals.resampling import Resampled
from rotary_error_monitor.units import TURN

ANOTHER = 0.75
"""Part of a turn by which a head must be off to count another turn: one that is half a turn off by a wrong zero would
change to and fro with its noise."""


class CommonTurns:
    """Takes out by how many whole turns each head counts differently from the others.

    The rotation is counted as the first head that is there counts. Without this it would be another by whole turns
    wherever that head is missing for a moment. What is taken out at a tick follows from this tick and those before it.
    """

    def __init__(self, bits: Mapping[str, int]) -> None:
        """Of heads by the names of their streams, in their order, with their bits in a mask."""
        self._names = tuple(bits)
        self._bits = np.array(list(bits.values()), np.int64)[:, None]
        self._all = sum(bits.values())
        self._ahead = np.full(len(bits), np.nan)  # turns by which each is ahead of the common count; NaN if not known
        self._alike = False  # whether all count the same

    def take_out(self, sampled: Mapping[str, Resampled], there: NDArray[np.int64]) -> None:
        """Bring readings (rad) to a common count, in place, at the next m ticks.

        Args:
            sampled: streams at these ticks, by name; the first column of a head is its reading.
            there: (m,) bit mask of the streams that have a value.
        """
        if len(self._names) < 2:
            return
        readings = np.stack([sampled[name].values[:, 0] for name in self._names])
        if self._alike and (there & self._all == self._all).all() and np.ptp(readings, axis=0).max() < ANOTHER * TURN:
            return  # as nearly always
        shown = ((there & self._bits) != 0) & np.isfinite(readings)
        counts = readings / TURN
        begin = end = 0
        while begin < len(there):
            end = self._first_change(counts, shown, end)
            for name, ahead, here in zip(self._names, self._ahead.tolist(), shown, strict=True):
                if ahead != 0.0 and not np.isnan(ahead):
                    sampled[name].values[begin:end, 0] -= TURN * ahead * here[begin:end]
            begin, end = end, end + 1
            if begin < len(there):
                self._count_anew(counts[:, begin], shown[:, begin])

    def _first_change(self, counts: Array, shown: Mask, begin: int) -> int:
        """The first tick from `begin` on at which a head counts otherwise than is known; their number if none does."""
        counts, shown = counts[:, begin:], shown[:, begin:]
        if not counts.shape[1]:
            return begin
        known = shown & ~np.isnan(self._ahead)[:, None]
        some = known.any(axis=0) | bool(np.isnan(self._ahead).all())
        first = known.argmax(axis=0)
        common = counts - self._ahead[:, None]
        apart = np.abs(common - common[first, np.arange(counts.shape[1])])
        changed = ((shown & ~known).any(axis=0) & some) | (known & (apart > ANOTHER)).any(axis=0)
        return begin + (int(changed.argmax()) if changed.any() else counts.shape[1])

    def _count_anew(self, counts: Array, shown: Mask) -> None:
        """Note by how much heads (h,) are ahead of the first one that is known; most of them stay as they were."""
        known = shown & ~np.isnan(self._ahead)
        first = int((known if known.any() else shown).argmax())
        ahead = np.nan_to_num(self._ahead)
        moved = np.rint(counts - ahead - (counts[first] - ahead[first]))
        among = moved[known].tolist()
        usual = max(among, key=among.count) if among else 0.0  # the first of those that are as frequent
        self._ahead[shown] = (ahead + moved - usual)[shown]
        self._alike = not self._ahead.any()  # what is not known is not alike
