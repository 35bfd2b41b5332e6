"""The latest values of a sequence: means over some spans of them are taken at every window."""

from __future__ import annotations

from collections.abc import Sequence


class Trailing:
    """Keeps the latest values of a sequence, as many as the longest of some spans, and gives means over each span."""

    __slots__ = ("_kept", "_most", "_spans")

    def __init__(self, *spans: int) -> None:
        """Nothing was taken in."""
        self._spans, self._most = spans, max(spans)
        self._kept: list[float] = []

    def __len__(self) -> int:
        return min(len(self._kept), self._most)

    def add(self, values: Sequence[float], each: int = 1) -> list[list[tuple[float, int]]]:
        """Take in values; give for each span its mean after each of them, or each so many, and over how many that is.

        A mean has the same bits however many values are taken in at once.
        """
        kept, begin = self._kept, len(self._kept)
        kept += values
        ends = range(begin + each, len(kept) + 1, each)
        found = [[self._mean(end, span) for end in ends] for span in self._spans]
        if len(kept) > 2 * self._most:  # now and then: each value is moved about once
            del kept[: -self._most]
        return found

    def _mean(self, end: int, span: int) -> tuple[float, int]:
        latest = self._kept[max(0, end - span) : end]
        return sum(latest) / len(latest), len(latest)

    def clear(self) -> None:
        """Forget all of them."""
        self._kept.clear()
