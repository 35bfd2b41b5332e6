"""What comes in as corrections: which are followed, what was refused, and since when and why the last one is held."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from rotary_error_monitor.linuxcnc_controller.clock import NANOSECONDS
from rotary_error_monitor.linuxcnc_controller.gate import (
    AcceptedCorrection,
    CorrectionGate,
    CorrectionMessage,
    GateLimits,
    RefusalError,
    RefusalReason,
)
from rotary_error_monitor.linuxcnc_controller.sources import Sources
from rotary_error_monitor.linuxcnc_controller.stands import LASTS, CorrectionStands

NOTHING_YET = "no correction has come yet"
NOTHING_COMES = "no correction comes"
PRESENT = 1.5
"""What happened is said for so long, s: longer than the period of the diagnostics, so that one of them says it."""


@dataclass(frozen=True)
class Hold:
    """Why nothing new is followed.

    Attributes:
        reason: in words.
        duration: since the last correction was believed, s; none before the first.
        doubt: what is wrong with what comes; none where nothing comes.
    """

    reason: str
    duration: float | None
    doubt: RefusalReason | None

    def __str__(self) -> str:
        return f"held: {self.reason}" if self.duration is None else f"held for {self.duration:.1f} s: {self.reason}"


class CorrectionIntake:
    """Gate and sources of one machine's corrections; reads no clock.

    Times `now_ns` are timestamps (ns) by which stamps are judged; `steady_ns` are of a clock that never steps.

    Attributes:
        sources: who sends.
        refused: how many messages were refused, by doubt.
    """

    def __init__(self, limits: GateLimits) -> None:
        """Believe what keeps within `limits` and comes from one publisher."""
        self.sources = Sources()
        self.refused: Counter[RefusalReason] = Counter()
        self._gate = CorrectionGate(limits)
        places = [limits.axes.index(name) for name in limits.corrected]
        self._stands = CorrectionStands(places, min(limits.max_age, LASTS))
        self._max_age_ns = limits.max_age * NANOSECONDS
        self._accepted_ns: int | None = None
        self._refusal: RefusalError | None = None
        self._refused_ns = 0
        self._is_refusing = False

    def note_axes(self, positions: Sequence[float], steady_ns: int) -> None:
        """Take note of where the program has the controller's axes, m or rad: where they move, so do corrections."""
        self._stands.note_axes(positions, steady_ns)

    def take(self, message: CorrectionMessage, number: int | None, now_ns: int, steady_ns: int) -> AcceptedCorrection:
        """What is believed of a message that carries `number` among its publisher's; none where nobody numbers.

        Raises:
            RefusalError: nothing of it; counted.
        """
        if number is not None:
            self.sources.hear(number, steady_ns)
        try:
            trouble = self.sources.trouble(steady_ns)
            if trouble:
                raise RefusalError(RefusalReason.PUBLISHERS, trouble)
            correction = self._gate.judge(message, now_ns)
            if stuck := self._stands.judge(correction.positions, steady_ns):
                raise RefusalError(RefusalReason.STANDS, stuck)
        except RefusalError as error:
            self.refused[error.doubt] += 1
            self._refusal, self._refused_ns, self._is_refusing = error, steady_ns, True
            raise
        self._accepted_ns, self._is_refusing = steady_ns, False
        return correction

    def hold(self, steady_ns: int) -> Hold | None:
        """Why nothing new is followed now; none while corrections come that are believed."""
        duration = None if self._accepted_ns is None else (steady_ns - self._accepted_ns) / NANOSECONDS
        trouble = self.sources.trouble(steady_ns)
        if trouble:
            return Hold(trouble, duration, RefusalReason.PUBLISHERS)
        if self._accepted_ns is not None and steady_ns - self._accepted_ns <= self._max_age_ns:
            return None
        if self._is_refusing and self._refusal is not None and self._is_present(steady_ns):
            return Hold(str(self._refusal), duration, self._refusal.doubt)
        return Hold(NOTHING_YET if duration is None else NOTHING_COMES, duration, None)

    def remark(self, steady_ns: int) -> str:
        """What was refused of late; empty where nothing was."""
        if self._refusal is None or not self._is_present(steady_ns):
            return ""
        return f"{self.refused.total()} refused so far, the last one: {self._refusal}"

    def _is_present(self, steady_ns: int) -> bool:
        return steady_ns - self._refused_ns <= PRESENT * NANOSECONDS
