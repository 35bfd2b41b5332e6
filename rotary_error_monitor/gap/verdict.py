"""What a diagnosis concludes."""

from __future__ import annotations

import enum
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.gap.alternatives import Key
from rotary_error_monitor.gap.fitting import Fit
from rotary_error_monitor.gap.p_values import LEAST_LOG_P_VALUE
from rotary_error_monitor.gap.posterior import PRIOR_OF_UNKNOWN, Resembled, shown_by
from rotary_error_monitor.gap.problem import Problem, StructureTest
from rotary_error_monitor.gap.steps import Step

LARGE = 1000.0
"""Power of an effect in a channel, in variances of one sample's noise, that noise alone cannot cancel."""

CANCELLED = 0.01
"""Part of the power of the weaker of two effects that is left of both together: of 120 pairs of real ones none left so
little, of those that stood for a third left 0.02 % or less."""


class Verdict(enum.Enum):
    """The four verdicts; `exit_code` is that of the command."""

    NO_GAP = "no_gap"
    EXPLAINED = "explained"
    PARTLY_EXPLAINED = "partly_explained"
    UNKNOWN = "unknown"

    @property
    def exit_code(self) -> int:
        """0 no gap, 10 explained, 11 partly explained, 12 unknown."""
        return {"no_gap": 0, "explained": 10, "partly_explained": 11, "unknown": 12}[self.value]


@dataclass(frozen=True)
class Judgement:
    """Outcome of weighing the sets that were tried.

    Attributes:
        step: set of causes whose table of candidates the alternatives are read from.
        fit: causes with their departures.
        findings: structure that is left; empty where only noise is.
        unknown: probability that something unknown stands in the place of the causes.
        credits: log odds of other sets that were weighed or fitted, by the keys of their causes, beside the chosen one.
        needless: log odds, by cause, that it is a departure of the others.
        doubts: why causes that fit were not believed.
    """

    verdict: Verdict
    step: Step
    fit: Fit
    findings: tuple[StructureTest, ...]
    unknown: float
    dispersion: float = 1.0
    credits: Mapping[frozenset[Key], float] | None = None
    needless: Mapping[Key, float] = field(default_factory=dict)
    doubts: tuple[str, ...] = ()


def probability_of_unknown(findings: Sequence[StructureTest]) -> float:
    """Probability that something unknown is left, from the least likely finding.

    The bound of Sellke, Bayarri and Berger (2001) turns a chance p, corrected for the number of tests, into the largest
    odds that it can mean: `1 / (-e p ln p)`.
    """
    if not findings:
        return PRIOR_OF_UNKNOWN
    log_p_value = min(0.0, max(findings[0].log_p_value, LEAST_LOG_P_VALUE) + float(np.log(len(findings))))
    if log_p_value >= -1.0:
        return PRIOR_OF_UNKNOWN
    log_odds = (
        float(np.log(PRIOR_OF_UNKNOWN / (1 - PRIOR_OF_UNKNOWN))) - 1.0 - log_p_value - float(np.log(-log_p_value))
    )
    return float(1 / (1 + np.exp(-min(log_odds, 700.0))))


def cancelled_in(problem: Problem, fit: Fit) -> str:
    """Channel in which the causes of a fit cancel one another, or nothing.

    Effects know nothing of each other. Two large ones whose sum is nothing in a channel stand for a third that does not
    act on that channel: what only the probe does, say, looks like a tilt of the spindle less a wobble of the mirror.
    """
    parts = shown_by(problem, fit)
    for channel in fit.rest:
        seen = [shown[channel] for shown in parts if channel in shown]
        weakest = min((float(np.sum(rows**2)) for rows in seen), default=0.0)
        together = float(np.sum(np.square(sum(seen)))) if seen else 0.0
        if len(seen) > 1 and weakest > LARGE and together < CANCELLED * weakest:
            return channel
    return ""


def doubt_about(problem: Problem, fit: Fit) -> str:
    """Why the causes of a fit are not believed however well they fit; empty where they are."""
    channel = cancelled_in(problem, fit)
    if channel:
        words = "something that is not seen there is the likelier cause"
        return f"{names_of(fit.causes)} fit, but cancel one another on {channel}: {words}"
    return problem.doubt(fit.causes) if isinstance(problem, Resembled) else ""


def names_of(causes: Sequence[Cause]) -> str:
    """Causes and their places, in words."""
    return " and ".join(" at ".join(filter(None, cause.key)) for cause in causes)


def alarming(findings: tuple[StructureTest, ...], step: Step) -> tuple[StructureTest, ...]:
    """Those findings that are less likely than the named false-alarm rate allows."""
    return tuple(f for f in findings if f.log_p_value < step.log_alarm)
