"""What the same heads showed in the last windows, beside what they showed at the same angles in their first turn."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from operator import sub
from typing import TypeAlias

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.pipeline.turn_memory import AngleMemory

MEMORY = 1000
"""Windows that are remembered to find the wrong head in, 10 s: a turn of a slow stage."""

Shown: TypeAlias = tuple[float, float, float, float]
"""What heads show in a window: rotation and distance from the command, rad, two components of the radial error motion,
m."""

Row: TypeAlias = tuple[float, ...]
"""The same, and the contradiction of the heads (P,), rad."""


class HeadHistory:
    """Of one set of heads after another; each set has a first turn of its own."""

    def __init__(self) -> None:
        """Nothing was seen."""
        self._windows: deque[Row] = deque(maxlen=MEMORY)
        self._unrepeated: deque[Row | None] = deque(maxlen=MEMORY)
        self._turns: dict[tuple[str, ...], AngleMemory[Row]] = {}
        self.begin(())

    def begin(self, heads: tuple[str, ...]) -> None:
        """What comes next is of these heads."""
        self._heads, self._turn = heads, self._turns.setdefault(heads, AngleMemory())
        self.forget_last()

    def forget_last(self) -> None:
        """Forget the last windows, but not the first turn."""
        self._windows.clear()
        self._unrepeated.clear()
        self._last: tuple[int, float] | None = None

    def forget_turns(self) -> None:
        """Forget what was shown at which angle: the angles are others."""
        self._turns.clear()
        self.begin(self._heads)

    def add(self, number: int, shown: Shown, parity: list[float], *, sure: bool) -> None:
        """Take in a window by its number; `sure`, whether it may be what is seen there first."""
        theta, last = shown[0], self._last
        moved = theta - last[1] if last is not None and last[0] == number - 1 else 0.0
        self._last = number, theta
        row = (*shown, *parity)
        first = self._turn.seen(theta, moved)
        if first is None and sure:
            self._turn.complete(theta, moved, row)
        self._windows.append(row)
        self._unrepeated.append(None if first is None else _beyond(row, first))

    def before(self) -> Shown | None:
        """What was shown in the window before the last one; None where that is not remembered."""
        if len(self._windows) < 2:
            return None
        theta, ecc, x, y = self._windows[-2][:4]
        return theta, ecc, x, y

    def all_shown(self) -> tuple[Array, Array]:
        """(n, 4) and (n, P) what was shown, and the contradiction, in the windows that are remembered."""
        return _split(self._windows)

    def unrepeated(self) -> tuple[Array, Array]:
        """What of it is not as in the first turn, (m, 4) and (m, P), in those of the windows of which that is known.

        What repeats at an angle, such as the graduation, is not in it. Of the rotation itself it says nothing.
        """
        return _split([row for row in self._unrepeated if row is not None])


def _beyond(row: Row, first: Sequence[Row]) -> Row:
    """A row less the mean of others."""
    if len(first) == 1:
        return tuple(map(sub, row, first[0]))
    return tuple(map(sub, row, [sum(column) / len(first) for column in zip(*first, strict=True)]))


def _split(rows: Sequence[Row]) -> tuple[Array, Array]:
    values = np.array(rows, np.float64).reshape(len(rows), -1) if rows else np.zeros((0, 4))
    return values[:, :4], values[:, 4:]
