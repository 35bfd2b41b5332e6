"""Steps of the search for causes: the sets that were fitted, and what each leaves."""

from __future__ import annotations

from dataclasses import dataclass

from rotary_error_monitor.gap.fitting import Fit
from rotary_error_monitor.gap.hypotheses import Hypothesis, HypothesisTable
from rotary_error_monitor.gap.posterior import Powers, is_structured
from rotary_error_monitor.gap.problem import StructureTest


@dataclass(frozen=True)
class Step:
    """One size of the set of causes.

    Attributes:
        fit: causes fitted.
        table: table on which it was chosen.
        findings: structure that is left, the least likely first.
        log_alarm: logarithm of the level below which a finding counts.
        entering: the candidate that would add most to the set.
        log_p_entering: logarithm of its chance under noise, over its share of the false-alarm rate.
        log_alarm_entering: logarithm of the level below which that counts.
        powers: squares of what the causes do, by channel.
    """

    fit: Fit
    table: HypothesisTable
    findings: tuple[StructureTest, ...]
    log_alarm: float
    entering: Hypothesis | None
    log_p_entering: float
    log_alarm_entering: float
    powers: Powers

    @property
    def structured(self) -> bool:
        """Whether structure is left."""
        return is_structured(self.findings, self.log_alarm, self.powers)

    @property
    def improvable(self) -> bool:
        """Whether a known effect stands out from what is left."""
        return self.log_p_entering < self.log_alarm_entering

    @property
    def settled(self) -> bool:
        """Whether only noise is left."""
        return not (self.structured or self.improvable)


@dataclass(frozen=True)
class Selection:
    """All sizes tried, the last one chosen.

    Attributes:
        steps: one for each size.
        dropped: names and locations of candidates that were left out: with them the twin gives numbers that are not
            finite.
    """

    steps: tuple[Step, ...]
    dropped: tuple[tuple[str, str], ...] = ()

    @property
    def null(self) -> Step:
        """No cause at all, the last time: a cause that came may have gone again beside noise that it told better."""
        return next(step for step in reversed(self.steps) if not step.fit.causes)

    @property
    def chosen(self) -> Step:
        """The set that explains most."""
        return self.steps[-1]
