"""The latest values of a sequence: means over some spans of them are taken at every window."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate

ROUNDING = 1e-12
"""Part of a sum of some hundred values by which it may be off, however it is added up; thirty times as much."""


class Trailing:
    """Keeps the latest values of a sequence, none of them negative, and gives means over spans of them.

    A mean has the same bits however many values were taken in at once: those of its own values, added one by one.
    Running sums tell whether that has to be done.
    """

    __slots__ = ("_kept", "_longest", "_sums")

    def __init__(self, longest: int) -> None:
        """Nothing was taken in; a span has no more than the `longest` values."""
        self._longest = longest
        self.clear()

    def __len__(self) -> int:
        return min(len(self._kept), self._longest)

    def clear(self) -> None:
        """Forget all of them."""
        self._kept: list[float] = []
        self._sums = [0.0]

    def add(self, values: Sequence[float], each: int = 1) -> range:
        """Take in values; give where each of them ends, or each so many: places for what is asked until more come."""
        if len(self._kept) > 2 * self._longest:  # now and then: each value is moved about once
            del self._kept[: -self._longest]
            self._sums = list(accumulate(self._kept, initial=0.0))
        begin = len(self._kept)
        self._kept += values
        self._sums += list(accumulate(values, initial=self._sums[-1]))[1:]
        return range(begin + each, len(self._kept) + 1, each)

    @property
    def end(self) -> int:
        """The place behind all values."""
        return len(self._kept)

    def last(self, end: int) -> float:
        """The latest value before a place."""
        return self._kept[end - 1]

    def count(self, end: int, span: int) -> int:
        """How many values a span before a place has: fewer than it asks for where as many were not taken in."""
        return min(end, span)

    def mean(self, end: int, span: int) -> float:
        """Mean over a span before a place."""
        latest = self._kept[max(0, end - span) : end]
        return sum(latest) / len(latest)

    def excess(self, end: int, span: int, bound: float) -> float:
        """The mean over a bound where that is more than one; else one, or what it is below."""
        about, most = self._about(end, span)
        return self.mean(end, span) / bound if about + most >= bound else 1.0

    def significant(self, end: int, span: int, bound: float) -> float:
        """The mean where it is beyond a bound that chance does not pass; else one."""
        about, most = self._about(end, span)
        if about + most < bound:
            return 1.0
        mean = self.mean(end, span)
        return mean if mean > bound else 1.0

    def larger_mean(self, end: int, spans: tuple[int, int]) -> float:
        """The larger of the means over two spans."""
        (one, off), (other, off_too) = (self._about(end, span) for span in spans)
        if one + off < other - off_too:
            return self.mean(end, spans[1])
        first = self.mean(end, spans[0])
        return first if other + off_too < one - off else max(first, self.mean(end, spans[1]))

    def _about(self, end: int, span: int) -> tuple[float, float]:
        """The mean by running sums, and by how much it may be off."""
        count, sums = min(end, span), self._sums
        return (sums[end] - sums[end - count]) / count, ROUNDING * sums[end] / count
