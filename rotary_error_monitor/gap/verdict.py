"""What a diagnosis concludes."""

from __future__ import annotations

import enum
from collections.abc import Sequence

import numpy as np

from rotary_error_monitor.effects.effect import Role
from rotary_error_monitor.gap.normal import combine
from rotary_error_monitor.gap.problem import Finding, Problem, Rows
from rotary_error_monitor.gap.selection import Stage

PRIOR_OF_UNKNOWN = 0.02
"""Chance, before a recording is seen, that something no effect describes is at work beside the known ones."""

CHANCE_OF_RESEMBLANCE = 0.1
"""Chance that causes which are trusted although something is left are mere resemblances of that."""

OWN_CHANNEL = 0.05
"""A channel that holds this part of a cause's power is the cause's own."""

CLEAN = 0.01
"""A cause is trusted in spite of a remainder if in its own channels less than this part of its power remains."""


LARGE = 1000.0
"""Power of an effect in a channel, in variances of one sample's noise, that noise alone cannot cancel."""

CANCELLED = 0.01
"""Part of the power of the weaker of two effects that is left of both together: of 120 pairs of real ones none left so
little, of those that stood for a third left 0.02 % or less."""

ALIKE = 0.01
"""Difference in what two sets of effects explain, in squares of white rows, below which it is that of rounding."""


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


def chance_of_unknown(findings: Sequence[Finding]) -> float:
    """Probability that something unknown is left, from the least likely finding.

    The bound of Sellke, Bayarri and Berger (2001) turns a chance p, corrected for the number of tests, into the largest
    odds that it can mean: `1 / (-e p ln p)`.
    """
    if not findings:
        return PRIOR_OF_UNKNOWN
    log_chance = min(0.0, max(findings[0].log_chance, -1e6) + float(np.log(len(findings))))
    if log_chance >= -1.0:
        return PRIOR_OF_UNKNOWN
    log_odds = float(np.log(PRIOR_OF_UNKNOWN / (1 - PRIOR_OF_UNKNOWN))) - 1.0 - log_chance - float(np.log(-log_chance))
    return float(1 / (1 + np.exp(-min(log_odds, 700.0))))


def trusted_causes(problem: Problem, stage: Stage) -> bool:
    """Whether all causes of a stage stand although something is left: what is left lies in other channels.

    An effect that merely resembles an unknown one leaves part of it where it took the rest away; a real cause beside an
    unknown one leaves its own channels clean. What is found in no single channel (uncertain parameters that are moved
    too far, poses that scatter, an effect that stands out where no channel shows anything) may be left of the causes
    themselves: then they are not trusted. Nor are they where orders or places of one effect follow one another: such a
    series resembles anything that repeats.
    """
    channels = [f.channel for f in stage.findings if f.log_chance < stage.log_alarm]
    if any(channel not in stage.fit.rest for channel in channels) or (stage.improvable and not channels):
        return False
    if is_series(stage):
        return False
    for shown in _shown(problem, stage):
        power = {channel: float(np.sum(rows**2)) for channel, rows in shown.items()}
        total = sum(power.values())
        own = [channel for channel, value in power.items() if value > OWN_CHANNEL * total]
        left = sum(float(np.sum(stage.fit.rest[c] ** 2) - np.sum(problem.expected(c))) for c in own)
        structured = any(f.channel in own and f.log_chance < stage.log_alarm for f in stage.findings)
        if structured or left > CLEAN * total + 3 * np.sqrt(2 * sum(float(np.sum(problem.expected(c))) for c in own)):
            return False
    return bool(stage.fit.causes)


def is_series(stage: Stage) -> bool:
    """Whether one effect at several orders or places explains what the causes, and what would join them, do.

    An effect that predicts the same as a cause counts as that cause: which of the two was chosen is chance.
    """
    weighing = stage.weighing
    found = (weighing.position(cause.key) for cause in stage.fit.causes)
    members = [i for i in found if i is not None]
    if stage.improvable and stage.newcomer is not None:
        members.append(stage.newcomer.members[-1])
    gain = weighing.weigh(members).gain
    taken: set[str] = set()
    for k, member in enumerate(members):
        others = weighing.replacements(members, k, weighing.free(members))
        alike = [member, *(other.members[k] for other in others if abs(other.gain - gain) < ALIKE)]
        names = {weighing.candidates[i].effect.name for i in alike}
        if names & taken:
            return True
        taken |= names
    return False


def cancelled_in(problem: Problem, stage: Stage) -> str:
    """Channel in which the causes of a stage cancel one another, or nothing.

    Effects know nothing of each other. Two large ones whose sum is nothing in a channel stand for a third that does not
    act on that channel: what only the probe does, say, looks like a tilt of the spindle less a wobble of the mirror.
    """
    parts = _shown(problem, stage)
    for channel in stage.fit.rest:
        seen = [shown[channel] for shown in parts if channel in shown]
        weakest = min((float(np.sum(rows**2)) for rows in seen), default=0.0)
        together = float(np.sum(np.square(sum(seen)))) if seen else 0.0
        if len(seen) > 1 and weakest > LARGE and together < CANCELLED * weakest:
            return channel
    return ""


def _shown(problem: Problem, stage: Stage) -> list[Rows]:
    """White rows (m, 1) of what each cause does."""
    found = []
    for cause, columns in zip(stage.fit.causes, stage.fit.columns, strict=True):
        free = cause.effect.indices(Role.LINEAR, Role.SHAPE)
        shapes = set(cause.effect.indices(Role.SHAPE))
        amplitude = np.array([0.0 if i in shapes else cause.values[i] for i in free])
        found.append(combine(problem, [columns], [amplitude]))
    return found
