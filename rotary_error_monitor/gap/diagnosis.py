"""A diagnosis: where model and recording differ, which effect causes it, and how far the gap shrinks."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rotary_error_monitor.effects.effect import Cause, Estimate
from rotary_error_monitor.gap.alternatives import Alternatives, Key, weigh_alternatives
from rotary_error_monitor.gap.held_out import OpenProblem, dispersion, predicts
from rotary_error_monitor.gap.options import FALSE_ALARMS, MOST_CAUSES
from rotary_error_monitor.gap.problem import DiagnosableProblem, Finding, LandingProblem, Share
from rotary_error_monitor.gap.selection import Selection, Stage, select_causes
from rotary_error_monitor.gap.shrink import Gap, measure_gap
from rotary_error_monitor.gap.verdict import (
    CHANCE_OF_RESEMBLANCE,
    Verdict,
    cancelled_in,
    chance_of_unknown,
    trusted_causes,
)

SCHEMA = 1

LEAST_LOG_CHANCE = -1e6
"""Chances below this are written as this: JSON knows no infinity."""


@dataclass(frozen=True)
class FoundCause:
    """An effect added to the model."""

    cause: Cause
    probability: float
    parameters: Mapping[str, Estimate]

    @property
    def at_bounds(self) -> Mapping[str, float]:
        """Parameters that the recording drives to a bound of what is physically sensible, with that value."""
        return self.cause.effect.at_bounds(self.cause.values)

    def as_mapping(self) -> dict[str, Any]:
        """Row of `diagnosis.json`."""
        return {
            "effect": self.cause.effect.name,
            "location": self.cause.location,
            "probability": self.probability,
            "parameters": {name: _estimate(value) for name, value in self.parameters.items()},
            **({"at_bounds": dict(self.at_bounds)} if self.at_bounds else {}),
        }


@dataclass(frozen=True)
class Ranked:
    """A candidate, its probability, and the gap on held-out conditions with it in the model."""

    effect: str
    location: str
    probability: float
    held_out_gap: float


@dataclass(frozen=True)
class Group:
    """Effects that this recording cannot tell apart, and the measurement that would."""

    effects: tuple[Key, ...]
    advice: str


@dataclass(frozen=True)
class Diagnosis:
    """Outcome of one run; `as_mapping` is the content of `diagnosis.json`.

    Attributes:
        remainder: structure that the causes leave, the least likely first.
        remarks: findings beside the causes: noise larger than stated, samples left out.
        figures: numbers that people in the field ask for, named with their units.
    """

    verdict: Verdict
    causes: tuple[FoundCause, ...]
    ranking: tuple[Ranked, ...]
    indistinguishable: tuple[Group, ...]
    where: tuple[Share, ...]
    gap: Gap
    remainder: tuple[Finding, ...] = ()
    remarks: tuple[str, ...] = ()
    figures: Mapping[str, float] = field(default_factory=dict)
    selection: Selection | None = field(default=None, repr=False, compare=False)

    def as_mapping(self) -> dict[str, Any]:
        """Plain numbers, strings, lists and mappings, as `diagnosis.json` holds them."""
        return {
            "schema": SCHEMA,
            "verdict": self.verdict.value,
            "causes": [found.as_mapping() for found in self.causes],
            "ranking": [dataclasses.asdict(row) for row in self.ranking],
            "indistinguishable": [
                {
                    "effects": [{"effect": name, "location": place} for name, place in group.effects],
                    "advice": group.advice,
                }
                for group in self.indistinguishable
            ],
            "where": [dataclasses.asdict(share) for share in self.where],
            "gap": {**dataclasses.asdict(self.gap), "interval": list(self.gap.interval)},
            "remainder": [
                {"channel": f.channel, "pattern": f.pattern, "log_chance": max(f.log_chance, LEAST_LOG_CHANCE)}
                for f in self.remainder
            ],
            "remarks": list(self.remarks),
            **({"figures": dict(self.figures)} if self.figures else {}),
        }


def diagnose(
    problem: DiagnosableProblem,
    false_alarms: float = FALSE_ALARMS,
    most_causes: int = MOST_CAUSES,
    progress: Callable[[str], None] = lambda step: None,
) -> Diagnosis:
    """Diagnose a recording beside its twin.

    Args:
        problem: recording and twin.
        false_alarms: largest chance that anything at all is found in a recording without a gap.
        most_causes: largest number of effects combined.
        progress: called with a few words at the beginning of each step.

    Raises:
        InputError: the gap is so large that the twin must be of another machine.
    """
    problem.check_plausible()
    selection = select_causes(problem, false_alarms, most_causes, progress)
    progress("verdict")
    verdict, stage = _judge(problem, selection)
    progress("alternatives")
    if isinstance(problem, OpenProblem) and verdict is Verdict.PARTLY_EXPLAINED:
        # Something unknown is there beside the causes, not in their place: it is noise to the choice among them.
        alternatives = weigh_alternatives(stage, 0.0, dispersion(stage.fit))
    else:
        partly = verdict is Verdict.PARTLY_EXPLAINED
        unknown = CHANCE_OF_RESEMBLANCE if partly else chance_of_unknown(stage.findings)
        alternatives = weigh_alternatives(stage, unknown)
    gap = measure_gap(stage.fit, problem.conditions, _floor(problem, stage))
    progress("where")
    causes = tuple(_found(cause, stage, alternatives) for cause in stage.fit.causes)
    return Diagnosis(
        verdict,
        causes,
        tuple(Ranked(*row) for row in alternatives.ranking),
        tuple(Group(keys, problem.advice(tuple(keys), stage.fit.causes)) for keys in alternatives.groups),
        tuple(problem.where(stage.fit.causes, stage.fit.rest, verdict is Verdict.EXPLAINED)),
        gap,
        () if stage.settled else tuple(f for f in stage.findings if f.log_chance < stage.log_alarm)[:12],
        problem.remarks(stage.fit.rest)
        + _at_bounds(causes)
        + _left_out(selection)
        + (() if stage is selection.chosen else _disbelieved(problem, selection.chosen)),
        _figures(problem, stage.fit.causes),
        selection,
    )


def _at_bounds(causes: Sequence[FoundCause]) -> tuple[str, ...]:
    """Estimates at a bound: the effect was not allowed to be larger, so its size is not what the recording says."""
    return tuple(
        f"{' at '.join(filter(None, found.cause.key))}: {name} is at its bound, {value:g} {_unit(found.cause, name)}; "
        "the recording asks for more, which is not physically sensible: look for another cause or a wrong description"
        for found in causes
        for name, value in found.at_bounds.items()
    )


def _unit(cause: Cause, name: str) -> str:
    return next(parameter.unit for parameter in cause.effect.parameters if parameter.name == name)


def _left_out(selection: Selection) -> tuple[str, ...]:
    if not selection.dropped:
        return ()
    names = ", ".join(" at ".join(filter(None, key)) for key in selection.dropped)
    count = len(selection.dropped)
    return (
        f"{count} candidate{'s' if count > 1 else ''} left out, with which the twin gives values that are not finite: "
        f"{names}",
    )


def _figures(problem: DiagnosableProblem, causes: Sequence[Cause]) -> Mapping[str, float]:
    """What people in the field ask for: where the gap lands, or what such recordings are usually judged by."""
    if isinstance(problem, LandingProblem):
        return problem.landing(causes)
    return problem.figures(causes) if isinstance(problem, OpenProblem) else {}


def _judge(problem: DiagnosableProblem, selection: Selection) -> tuple[Verdict, Stage]:
    if selection.null.settled:
        return Verdict.NO_GAP, selection.null
    for stage in selection.stages[:0:-1]:
        if _disbelieved(problem, stage):
            continue
        if stage is selection.chosen and stage.settled:
            return Verdict.EXPLAINED, stage
        if trusted_causes(problem, stage) or (isinstance(problem, OpenProblem) and predicts(problem, stage.fit)):
            return Verdict.PARTLY_EXPLAINED, stage
    return Verdict.UNKNOWN, selection.null


def _disbelieved(problem: DiagnosableProblem, stage: Stage) -> tuple[str, ...]:
    """Why causes are not believed however well they fit; on open problems many effects share every channel."""
    channel = "" if isinstance(problem, OpenProblem) else cancelled_in(problem, stage)
    if not channel:
        return ()
    names = " and ".join(" at ".join(filter(None, cause.key)) for cause in stage.fit.causes)
    return (
        f"{names} fit, but cancel one another on {channel}: something that is not seen there is the likelier cause",
    )


def _floor(problem: DiagnosableProblem, stage: Stage) -> float | None:
    """Noise alone: what a settled fit leaves, else what neighbouring rows differ by."""
    if stage.settled:
        return None
    squares, count = 0.0, 0.0
    for channel, rows in stage.fit.rest.items():
        expected = problem.expected(channel)
        both = (expected[1:] > 0) & (expected[:-1] > 0)
        squares += 0.5 * float(np.sum(np.square(np.diff(rows[:, 0]))[both]))
        count += 0.5 * float(np.sum((expected[1:] + expected[:-1])[both]))
    return float(np.sqrt(squares / max(count, 1.0)))


def _found(cause: Cause, stage: Stage, alternatives: Alternatives) -> FoundCause:
    index = next(i for i, other in enumerate(stage.fit.causes) if other.key == cause.key)
    return FoundCause(
        cause,
        alternatives.probability(cause.key),
        cause.effect.report(cause.values, stage.fit.covariances[index]),
    )


def _estimate(estimate: Estimate) -> dict[str, Any]:
    value, std = estimate.value, estimate.std
    return {
        "value": list(value) if isinstance(value, tuple) else value,
        "std": list(std) if isinstance(std, tuple) else std,
    }
