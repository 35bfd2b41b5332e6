"""What the jumps of the ring add up to: where they take back one another, a fault of heads has ended."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

Change: TypeAlias = tuple[float, float, float]
"""From one window to the next: of the two radial components and of the rotation against its command, at the ring, m."""

_NOTHING = (0.0, 0.0, 0.0)


class RingJumps:
    """Sum of the changes that no bearing makes, each with those of the windows beside it, which may hold a part of it.

    The bearing's own motion between jumps is not in it, so that it tells the end of a fault also where the rotor has
    gone to an angle at which it never was before.

    Attributes:
        total: since the first jump; None where none is open, or some windows are missing.
    """

    def __init__(self) -> None:
        """No jump is open."""
        self.total: Change | None = None
        self._largest = 0.0
        self.forget_last()

    def forget_last(self) -> None:
        """What comes next does not follow upon what was."""
        self._before, self._open = _NOTHING, False

    def begin(self, change: Change | None) -> None:
        """A first jump, in the window that follows upon what was; None where its change is not known."""
        self._largest = 0.0
        self._put(None if change is None else _sum(change, self._before))
        self._before, self._open = _NOTHING, True

    def follow(self, change: Change | None, *, jump: bool) -> None:
        """Take in a window: its change, which is not known of other heads than before, and whether it is a jump."""
        if change is None:
            self.total = None
            self.forget_last()
            return
        counts = jump or self._open
        if counts and self.total is not None:
            self._put(_sum(self.total, change, self._before))
        self._before, self._open = _NOTHING if counts else change, jump

    def _put(self, total: Change | None) -> None:
        self.total = total
        if total is not None:
            self._largest = max(self._largest, abs(total[0]), abs(total[1]))

    def are_taken_back(self, part: float, most: float) -> bool:
        """Whether no more is left of them than a part of the largest that they were, and than `most`, m.

        What the rotation does is not asked where no command tells it.
        """
        return self.total is not None and not any(abs(each) > min(part * self._largest, most) for each in self.total)


def change_between(before: Sequence[float], here: Sequence[float], radius: float) -> Change:
    """Of what heads show in two windows, as in `head_history.Shown`, at a ring of a radius, m."""
    (_, ecc_before, x_before, y_before), (_, ecc, x, y) = before, here
    return x - x_before, y - y_before, radius * (ecc - ecc_before)


def _sum(*changes: Change) -> Change:
    x, y, turned = (sum(each) for each in zip(*changes, strict=True))
    return x, y, turned
