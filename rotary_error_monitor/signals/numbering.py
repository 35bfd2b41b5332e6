"""Which messages of a topic never came, by the numbers that its publishers give them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

_CONVINCED = 3
"""Messages of each publisher, without one of the publisher before, after which a leap was no new publisher but a loss:
publishers of one topic send about as often as one another."""


@dataclass(eq=False)
class _Chain:
    """The messages of one publisher, as far as numbers tell.

    Attributes:
        last: number of the latest.
        before: the chain that this one may go on with, if what lies between is lost.
        missing: how many that are.
        seen: messages of all publishers when it leapt.
    """

    last: int
    before: _Chain | None = None
    missing: int = 0
    seen: int = 0


class MessageCount:
    """Counts the messages of one topic that were published and never came.

    Each publisher numbers its messages one by one; which of several a message is from is not told. A message goes on
    where one of them ended, or, where nobody else could have sent it, leaves out what is lost. What a publisher has
    sent before it was heard for the first time is not lost.

    Attributes:
        lost: messages so far.
    """

    def __init__(self, publishers: Callable[[], int]) -> None:
        """`publishers` tells how many there are now on the topic."""
        self.lost = 0
        self._publishers = publishers
        self._chains: list[_Chain] = []  # the one that was heard last at the end
        self._seen = 0

    def observe(self, number: int) -> int:
        """Take note of a message; give how many are found lost with it."""
        before = self.lost
        self._seen += 1
        ends = [chain for chain in self._chains if chain.last == number - 1]
        if ends:
            doubted = {id(chain.before) for chain in self._chains}
            self._go_on(max(ends, key=lambda chain: id(chain) in doubted), number)
        else:
            self._leap(number)
        self._settle()
        return self.lost - before

    def forget(self) -> None:
        """Begin anew, such as after a time in which nobody listened; what was lost stays."""
        self._chains.clear()

    def _go_on(self, chain: _Chain, number: int) -> None:
        chain.last = number
        for other in self._chains:
            if other.before is chain:  # that publisher is still there: the other is a new one
                other.before, other.missing = None, 0
        self._chains.remove(chain)
        self._chains.append(chain)

    def _leap(self, number: int) -> None:
        expected = max(self._publishers(), 1)
        earlier = [chain for chain in self._chains if chain.last < number]
        nearest = max(earlier, key=lambda chain: chain.last, default=None)
        if len(self._chains) >= expected and nearest is not None:
            self.lost += number - nearest.last - 1
            self._go_on(nearest, number)
            return
        # a publisher that was not heard before, or began anew in the place of the one that is silent for longest
        missing = number - nearest.last - 1 if nearest is not None else 0
        del self._chains[: max(0, len(self._chains) - expected + 1)]
        self._chains.append(_Chain(number, nearest, missing, self._seen))

    def _settle(self) -> None:
        """Where nothing more came of the publisher before, the leap was a loss."""
        for chain in [chain for chain in self._chains if chain.before is not None]:
            if self._seen - chain.seen >= _CONVINCED * len(self._chains):
                self.lost += chain.missing
                self._chains = [other for other in self._chains if other is not chain.before]
                chain.before, chain.missing = None, 0
