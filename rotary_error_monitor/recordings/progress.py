"""How far the reading of a long recording is, for whoever waits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

from rotary_error_monitor.bags.window import Window
from rotary_error_monitor.codec.contents import Content
from rotary_error_monitor.signals.blocks import SampleBlock

Step = Callable[[float, int], None]
"""Is told which part of a step is done, from 0 to 1, and of how many samples that is."""

Progress = Callable[[str], AbstractContextManager[Step]]
"""Begins a step that has a name and ends with the context."""

_OFTEN = 64
"""Messages after which it is told anew: some milliseconds."""


@contextmanager
def silent(name: str) -> Iterator[Step]:
    """Progress that nobody is told."""
    yield lambda share, samples: None


class Passed:
    """Counts what of a recording has passed, by its stamps."""

    def __init__(self, window: Window | None, step: Step) -> None:
        """Count within the time of a recording, and tell `step`."""
        self._begin_ns, end_ns = (0, 1) if window is None else (window.first_ns, window.last_ns)
        self._duration_ns = max(end_ns - self._begin_ns, 1)
        self._step = step
        self._messages = self._samples = 0

    def note(self, content: Content) -> None:
        """One more message has passed."""
        self._messages += 1
        self._samples += len(content.rows) if isinstance(content, SampleBlock) else 1
        if self._messages % _OFTEN == 0:
            share = (content.stamp_ns - self._begin_ns) / self._duration_ns
            self._step(min(max(share, 0.0), 1.0), self._samples)
