"""What a node logs, for tests that wait for it: of what a thread writes to standard error while `capfd` reads, some is
lost (7 % of lines that come without a pause)."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from rotary_error_monitor.nodes.managed import ManagedNode


class Log:
    """The lines that nodes of a class log from now on, of any severity."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, node_class: type[ManagedNode]) -> None:
        self.lines: list[str] = []
        monkeypatch.setattr(node_class, "get_logger", lambda _: self)

    def __getattr__(self, severity: str) -> Callable[..., None]:
        return lambda text, **_: self.lines.append(text)

    def count(self, words: str) -> int:
        """Lines that hold such words."""
        return sum(words in line for line in self.lines)
