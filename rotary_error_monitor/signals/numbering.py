"""Which messages of a topic never came, by the numbers that its publishers give them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

_ROUNDS = 3
"""Messages of each publisher within which one that is still there is heard: publishers of one topic send about as often
as one another. Whoever is silent for so long has ended, or its messages were lost."""


@dataclass(eq=False)
class _Chain:
    """Messages whose numbers follow one another: all of one publisher, until some are lost.

    Attributes:
        first: number of its first message.
        last: number of its latest.
        begun: messages of all publishers when it began.
        heard: messages of all publishers when its latest came.
        is_open: whether it is not decided yet if it is a new publisher, or one from before after messages were lost.
    """

    first: int
    last: int
    begun: int
    heard: int
    is_open: bool


class MessageCount:
    """Counts the messages of one topic that were published and never came.

    Each publisher numbers its messages one by one; which of several a message is from is not told, and how many there
    are is told late. So a number that goes on nowhere begins a chain of its own, and what it was is decided when each
    publisher has had its turn some times: a chain that fell silent below it is its beginning, and what lies between is
    lost; where all others go on, or the one that does not has ended, it is a new publisher. What a publisher has sent
    before it was heard for the first time is not lost.

    Attributes:
        lost: messages so far.
    """

    def __init__(self, publishers: Callable[[], int]) -> None:
        """`publishers` tells how many there are now on the topic, as far as it is known by then."""
        self.lost = 0
        self._publishers = publishers
        self._chains: list[_Chain] = []
        self._seen = 0

    def observe(self, number: int) -> int:
        """Take note of a message; give how many are found lost by now, some rounds after they should have come."""
        self._seen += 1
        ends = [chain for chain in self._chains if chain.last == number - 1]
        if ends:
            chain = min(ends, key=lambda chain: chain.heard)  # whose turn it is
            chain.last, chain.heard = number, self._seen
        else:
            self._forget_ended()
            self._chains.append(_Chain(number, number, self._seen, self._seen, is_open=bool(self._chains)))
        patience = _ROUNDS * len(self._chains)
        return self._decide(patience, patience)

    def finish(self) -> int:
        """Decide by what came so far, where nothing more comes; give how many are found lost by it."""
        return self._decide(0, len(self._chains) - 1)  # each of the others has had one more turn

    def forget(self) -> None:
        """Begin anew, such as after a time in which nobody listened; what was lost stays."""
        self._chains.clear()

    def _open_since(self, messages: int) -> Iterator[_Chain]:
        for chain in list(self._chains):
            if chain.is_open and self._seen - chain.begun >= messages and chain in self._chains:
                yield chain

    def _decide(self, age: int, silence: int) -> int:
        """Find what chains of such an age go on, by those of such a silence; give how many messages are lost."""
        before = self.lost
        for chain in self._open_since(age):
            silent = [
                other for other in self._chains if other.last < chain.first and self._seen - other.heard >= silence
            ]
            nearest = max(silent, key=lambda other: other.last, default=None)
            if nearest is None:
                self._forget_ended()
                chain.is_open = len(self._chains) > max(self._publishers(), 1)
            elif not any(other.is_open and nearest.last < other.first < chain.first for other in self._chains):
                self.lost += chain.first - nearest.last - 1
                self._chains.remove(nearest)
                chain.first, chain.begun, chain.is_open = nearest.first, nearest.begun, nearest.is_open
        return self.lost - before

    def _forget_ended(self) -> None:
        """Leave out publishers that are there no more, so that nobody who begins is taken for one of them."""
        patience, surplus = _ROUNDS * len(self._chains), len(self._chains) - max(self._publishers(), 1)
        ended = [
            chain
            for chain in sorted(self._chains, key=lambda chain: chain.heard)
            if self._seen - chain.heard > patience
            and not any(other.is_open and other.first > chain.last for other in self._chains)
        ]
        for chain in ended[: max(surplus, 0)]:
            self._chains.remove(chain)
