"""What of a bag belongs to its recording by its time; the rest is left out, counted and said."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from datetime import UTC, datetime

import numpy as np

from rotary_error_monitor.codec.contents import Content
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock
from rotary_error_monitor.signals.stretches import PAUSE_NS


@dataclass
class Window:
    """The time of a recording.

    Attributes:
        first_ns, last_ns: timestamps (ns) of its first and last sample.
        left_out: samples (or messages that are no sample blocks) outside of it that have passed so far, by topic.
    """

    first_ns: int
    last_ns: int
    left_out: Counter[str] = field(default_factory=Counter)
    _example: int = 0

    def cut(self, topic: str, content: Content) -> Content | None:
        """What of a message lies within the recording; None where nothing does."""
        if not isinstance(content, SampleBlock):
            if self.first_ns <= content.stamp_ns <= self.last_ns:
                return content
            self._note(topic, 1, content.stamp_ns)
            return None
        times = content.times_ns
        inside = (times >= self.first_ns) & (times <= self.last_ns)
        if inside.all():
            return content
        outside = np.flatnonzero(~inside)
        self._note(topic, len(outside), int(times[outside[0]]))
        if not inside.any():
            return None
        return SampleBlock(content.stamp_ns, content.names, content.rows[inside])

    @property
    def remark(self) -> str | None:
        """What was left out so far, in words; None where nothing was."""
        if not self.left_out:
            return None
        counts = ", ".join(f"{count} of {topic}" for topic, count in self.left_out.items())
        return (
            f"left out are samples whose time lies outside of the recording: {counts}, the first at "
            f"{_date(self._example)}; the recording goes from {_date(self.first_ns)} to {_date(self.last_ns)}, the "
            f"longest stretch in which streams overlap without a pause of more than {PAUSE_NS // NANOSECONDS} s"
        )

    def _note(self, topic: str, count: int, time_ns: int) -> None:
        if not self.left_out:
            self._example = time_ns
        self.left_out[topic] += count


def _date(time_ns: int) -> str:
    return datetime.fromtimestamp(time_ns / NANOSECONDS, UTC).isoformat(sep=" ", timespec="seconds")
