"""The latest values of a sequence, and the latest few of these: means over both are taken at every window."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable


class Trailing:
    """Keeps the `many` latest values, and beside them the `few` latest: neither has to be cut out of the other.

    Attributes:
        few, many: the latest values, the oldest first.
    """

    __slots__ = ("few", "many")

    def __init__(self, few: int, many: int) -> None:
        """Nothing was taken in; so many at most are kept."""
        self.few: deque[float] = deque(maxlen=few)
        self.many: deque[float] = deque(maxlen=many)

    def __len__(self) -> int:
        return len(self.many)

    def add(self, value: float) -> None:
        """Take in a value."""
        self.few.append(value)
        self.many.append(value)

    def extend(self, values: Iterable[float]) -> None:
        """Take in values, one after another."""
        latest = tuple(values)
        self.few.extend(latest)
        self.many.extend(latest)

    def clear(self) -> None:
        """Forget all of them."""
        self.few.clear()
        self.many.clear()
