"""Rows of numbers, as many as come: a whole recording read part by part, wherever its rows are kept."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Protocol

import numpy as np
from numpy.typing import DTypeLike, NDArray

PART = 1 << 15
"""Rows that are worked with at once: half a minute of estimates, whose covariances are 10 MB."""


class Rows(Protocol):
    """Rows (n, …) of one shape and kind, one behind another."""

    def __len__(self) -> int:
        """How many there are."""

    def append(self, rows: NDArray[Any]) -> None:
        """Put rows (m, …) behind those that are there."""

    def read(self, first: int, last: int) -> NDArray[Any]:
        """Rows from `first` to before `last`."""


Keep = Callable[[tuple[int, ...], DTypeLike], Rows]
"""Where rows are kept: gives an empty place for rows of a shape and kind."""


class RowsInMemory:
    """Rows that a computer's memory holds."""

    def __init__(self, shape: tuple[int, ...] = (), dtype: DTypeLike = np.float64) -> None:
        self._parts: list[NDArray[Any]] = []
        self._joined: NDArray[Any] = np.empty((0, *shape), dtype)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def append(self, rows: NDArray[Any]) -> None:
        """As `Rows.append`."""
        self._parts.append(np.asarray(rows, self._joined.dtype))
        self._count += len(rows)

    def read(self, first: int, last: int) -> NDArray[Any]:
        """As `Rows.read`."""
        if self._parts:
            self._joined = np.concatenate([self._joined, *self._parts] if len(self._joined) else self._parts)
            self._parts = []
        return self._joined[first:last]


def parts_of(first: int, last: int, size: int | None = None) -> Iterator[tuple[int, int]]:
    """First row and the one after the last of each part of a stretch, of `PART` rows by default, one after another."""
    size = PART if size is None else size
    for begin in range(first, last, size):
        yield begin, min(begin + size, last)


def place_of(rows: Rows, value: int) -> int:
    """Number of the first of ascending rows (n,) that is not below a value; n where all are."""
    low, high = 0, len(rows)
    while high - low > PART:
        middle = (low + high) // 2
        if rows.read(middle, middle + 1)[0] < value:
            low = middle + 1
        else:
            high = middle
    return low + int(np.searchsorted(rows.read(low, high), value))
