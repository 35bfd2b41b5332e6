"""Whether a stream is believed at all: by how much of it had to be refused, and whether enough is left to judge it."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence

from rotary_error_monitor.pipeline.evidence import AGREEMENT, PERSISTENT, SHORT, WINDOW_NS, EvidenceWindow
from rotary_error_monitor.signals.admission import LATE
from rotary_error_monitor.signals.blocks import NANOSECONDS
from rotary_error_monitor.signals.streams import SampleStream

REFUSED = 0.1
"""Part of the samples in a window whose refusal counts against their stream, and of the last windows together."""

JUDGED = 2
"""Windows one behind another that must have a value at each tick to tell a step in them."""

BROKEN = (
    f"samples are missing or too far apart in every {WINDOW_NS * 1e-6:g} ms of {SHORT * WINDOW_NS * 1e-9:g} s: "
    "what is left of it cannot be judged"
)


class StreamBelief:
    """Judges each stream by how much of it had to be refused: what does not hold together is not believed in parts.

    Nor is what has values at some ticks of each window and not at others: of it nothing can be judged.

    Attributes:
        doubted: why a stream is not used, by its name.
    """

    def __init__(self, streams: Mapping[str, SampleStream], bits: Mapping[str, int]) -> None:
        """Judge of `streams` by name, each with its bit in a mask."""
        self._streams, self._bits = dict(streams), dict(bits)
        self.reset()

    def reset(self) -> None:
        """Believe all of them again."""
        self.doubted: dict[str, str] = {}
        # of the latest windows, if anything was refused in one of them: mostly there is nothing to remember
        self._parts = {name: deque[float](maxlen=SHORT) for name in self._streams}
        self._agreeing = dict.fromkeys(self._streams, 0.0)
        # windows since the last that could be judged, of streams that were broken of late, and whole ones behind these
        self._unjudged: dict[str, tuple[int, int]] = {}

    def distrust(self, name: str, why: str) -> None:
        """Do not use a stream of which something is known that its samples do not tell."""
        self.doubted[name] = why
        self._agreeing[name] = 0.0

    def refuses_all(self, names: Sequence[str]) -> bool:
        """Whether something of each of these streams was refused in the window that was judged last."""
        return all(self._parts[name] and self._parts[name][-1] > 0.0 for name in names)

    @property
    def quiet(self) -> bool:
        """Whether no sample is known that was refused, nor any stream doubted: then there is nothing to judge."""
        refusals = (len(stream.admission.refusals) for stream in self._streams.values())
        return not (self.doubted or self._unjudged or any(self._parts.values()) or any(refusals))

    def judge(self, window: EvidenceWindow, begin_ns: int) -> None:
        """Take in a window that begins at `begin_ns`, timestamp (ns)."""
        end_ns = begin_ns + round(window.duration * NANOSECONDS)
        for name, stream in self._streams.items():
            parts, part = self._parts[name], stream.refused_between(begin_ns, end_ns)
            if part or parts:
                parts.append(part)
                if not any(parts):
                    parts.clear()
            if sum(each > REFUSED for each in parts) >= PERSISTENT and sum(parts) > REFUSED * len(parts):
                reasons = stream.admission.refused
                worst = max(reasons, key=lambda reason: reasons[reason])
                hint = "; do two publishers share its topic?" if worst == LATE else ""
                self.doubted.setdefault(name, f"{part:.0%} of its samples are refused: {worst}{hint}")
                self._agreeing[name] = 0.0
            elif self._is_unjudged(name, window):
                self.doubted.setdefault(name, BROKEN)
                self._agreeing[name] = 0.0
            elif name in self.doubted:
                self._agreeing[name] += window.duration
                if self._agreeing[name] >= AGREEMENT:
                    del self.doubted[name]

    def _is_unjudged(self, name: str, window: EvidenceWindow) -> bool:
        """Whether too little of a stream was there to judge it, in this window and in so many before it."""
        broken = bool(window.broken & self._bits[name])
        if not broken and name not in self._unjudged:
            return False
        passed, whole = self._unjudged.get(name, (0, 0))
        passed, whole = passed + 1, 0 if broken else whole + 1
        if whole >= JUDGED:
            del self._unjudged[name]
            return False
        self._unjudged[name] = passed, whole
        return passed >= SHORT
