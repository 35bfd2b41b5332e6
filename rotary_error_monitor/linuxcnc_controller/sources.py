"""How many publishers send on one topic, from the numbers that their messages carry and the list of those there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rotary_error_monitor.linuxcnc_controller.clock import NANOSECONDS

SILENCE = 0.5
"""A publisher that was heard and then not for so long, s, sends no more: fifty corrections at the usual rate."""

_MOST_SOURCES = 16
"""Publishers that are told apart; two are too many already."""

_MOST_NAMES = 4
"""Of those, so many are named in one sentence."""

_LONGEST_LOSS = 1000
"""Messages of one publisher that may be missing at once, ten seconds of the usual 100 a second; more are another's."""


@dataclass
class _Source:
    number: int
    heard_ns: int
    is_gone: bool = False


class Sources:
    """Tells one publisher from several; reads no clock, and takes times of one that never steps (ns).

    Each publisher numbers its messages one by one, so a number that is not the next one is a loss, a new publisher in
    place of one that ended, or one beside another. The list of publishers settles most of it at once. It keeps one that
    was killed for up to 20 s, though, so one that was heard and fell silent is not counted; one that is listed and was
    never heard is, for it may begin at any time.
    """

    def __init__(self) -> None:
        """Nobody is listed, and nobody was heard."""
        self._sources: list[_Source] = []
        self._listed: tuple[str, ...] = ()

    def enlist(self, publishers: Sequence[str], now_ns: int) -> None:
        """Take note of the publishers that are there at `now_ns`, by name."""
        self._listed = tuple(publishers)
        silent = sorted(
            (s for s in self._sources if self._is_silent(s, now_ns)), key=lambda s: (not s.is_gone, s.heard_ns)
        )
        for source in silent[: max(0, len(self._sources) - len(self._listed))]:
            self._sources.remove(source)

    def continues(self, number: int) -> bool:
        """Whether a message with this number is the next one of the publisher heard last."""
        return bool(self._sources) and number == max(self._sources, key=lambda s: s.heard_ns).number + 1

    def hear(self, number: int, now_ns: int) -> None:
        """Take note of a message; where it does not continue the last one, those that are there are enlisted first."""
        source = self._find(number)
        if source is None:
            if len(self._listed) == 1:
                for former in self._sources:
                    former.is_gone = True
            source = _Source(number, now_ns)
            self._sources = [*self._sources[1 - _MOST_SOURCES :], source]
        source.number, source.heard_ns, source.is_gone = number, now_ns, False

    def trouble(self, now_ns: int) -> str:
        """Why it is not one publisher that sends; empty where it is, or may be."""
        active = sum(not (source.is_gone or self._is_silent(source, now_ns)) for source in self._sources)
        if active > 1:
            return f"{active} publishers send corrections at once: {self._names()}"
        if len(self._listed) > max(1, self._heard()):
            return f"{len(self._listed)} publishers of corrections are there: {self._names()}"
        return ""

    def _heard(self) -> int:
        """How many of those that are listed were heard, as far as is known."""
        return sum(not source.is_gone for source in self._sources)

    @staticmethod
    def _is_silent(source: _Source, now_ns: int) -> bool:
        return now_ns - source.heard_ns > SILENCE * NANOSECONDS

    def _find(self, number: int) -> _Source | None:
        """The source that it continues; else, where all that are listed were heard, one that may have lost some."""
        latest_first = sorted(self._sources, key=lambda s: (s.is_gone, -s.heard_ns))
        exact = [s for s in latest_first if number == s.number + 1]
        near = [s for s in latest_first if not s.is_gone and 0 < number - s.number <= _LONGEST_LOSS]
        if not exact and len(self._listed) > self._heard():
            return None
        return next(iter(exact), max(near, key=lambda s: s.number, default=None))

    def _names(self) -> str:
        more = len(self._listed) - _MOST_NAMES
        return ", ".join(self._listed[:_MOST_NAMES]) + (f" and {more} more" if more > 0 else "") or "unknown"
