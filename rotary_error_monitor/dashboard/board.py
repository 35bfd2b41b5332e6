"""What node and web server share: the drawn parts, who looks at them, and what the page may ask for."""

from __future__ import annotations

import time
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

PORT = 8088
"""On which the page is served unless somebody says otherwise."""

_WATCHED_FOR = 3.0
"""s after the last look of a browser in which somebody still watches."""


@dataclass(frozen=True)
class Action:
    """What a person may do on the page.

    Attributes:
        label: of the button.
        question: that is asked before it is done.
        place: part of the page that the button stands in.
        act: does it; what became of it, in a sentence.
    """

    label: str
    question: str
    place: str
    act: Callable[[], Awaitable[str]]


@dataclass
class PageBoard:
    """The parts of the page as they were drawn last; written by the node, read by the server's thread.

    A part is replaced as a whole, and the mapping of all of them too: no lock is needed.

    Attributes:
        parts: HTML by name.
        actions: what the page may ask for; none where the node does not allow control.
        drawn: how often there was something new.
    """

    parts: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    actions: tuple[Action, ...] = ()
    drawn: int = 0
    _looked: float = -_WATCHED_FOR

    def show(self, parts: Mapping[str, str]) -> None:
        """Put up new parts; one that is as before stays the same object, so that nobody sends it again."""
        before = self.parts
        kept = {name: before[name] if before.get(name) == text else text for name, text in parts.items()}
        self.parts, self.drawn = MappingProxyType(kept), self.drawn + 1

    def look(self) -> Mapping[str, str]:
        """The parts, for a browser."""
        self._looked = time.monotonic()
        return self.parts

    @property
    def is_watched(self) -> bool:
        """Whether a browser has looked of late: else nothing need be drawn."""
        return time.monotonic() - self._looked < _WATCHED_FOR
