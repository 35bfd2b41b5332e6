"""A diagnosis: where model and recording differ, which effect causes it, and how far the gap shrinks."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.effect import Cause, ParameterEstimate, Role
from rotary_error_monitor.gap.alternatives import REJECTED, Alternatives, Key, rank_alternatives
from rotary_error_monitor.gap.fitted_departures import FittedDeparture, describe
from rotary_error_monitor.gap.fitting import Fit
from rotary_error_monitor.gap.judgement import judge
from rotary_error_monitor.gap.options import FALSE_ALARMS, MOST_CAUSES
from rotary_error_monitor.gap.p_values import LEAST_LOG_P_VALUE
from rotary_error_monitor.gap.posterior import departures_of
from rotary_error_monitor.gap.problem import DiagnosableProblem, Share, StructureTest
from rotary_error_monitor.gap.reversals import odds_of_slips
from rotary_error_monitor.gap.selection import select_causes
from rotary_error_monitor.gap.shrink import Gap, measure_gap
from rotary_error_monitor.gap.steps import Selection
from rotary_error_monitor.gap.verdict import Verdict

SCHEMA = 1


@dataclass(frozen=True)
class FoundCause:
    """An effect added to the model, and how it departs from its textbook form, the largest departure first.

    Attributes:
        beside: departures that are known effects, such as that at a neighbouring order: a twin can hold them.
    """

    cause: Cause
    probability: float
    parameters: Mapping[str, ParameterEstimate]
    departures: tuple[FittedDeparture, ...] = ()
    beside: tuple[Cause, ...] = ()

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
            "departures": [{"pattern": told.pattern, "share": told.share} for told in self.departures],
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
class DiagnosisResult:
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
    remainder: tuple[StructureTest, ...] = ()
    remarks: tuple[str, ...] = ()
    figures: Mapping[str, float] = field(default_factory=dict)

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
            "where": [{k: v for k, v in dataclasses.asdict(s).items() if k != "shown_in"} for s in self.where],
            "gap": {
                name: _plain(getattr(self.gap, name))
                for name in ("before", "after", "noise_floor", "shrink", "interval")
            },
            "remainder": [
                {"channel": f.channel, "pattern": f.pattern, "log_p_value": max(f.log_p_value, LEAST_LOG_P_VALUE)}
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
) -> DiagnosisResult:
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
    told = judge(problem, selection, false_alarms, progress)
    fit, explained = told.fit, told.verdict is Verdict.EXPLAINED
    progress("alternatives")
    alternatives = rank_alternatives(told.step, fit.causes, told.unknown, told.dispersion, told.credits, told.needless)
    settled = told.verdict in (Verdict.EXPLAINED, Verdict.NO_GAP)
    gap = measure_gap(fit, problem.conditions, None if settled else _floor(problem, fit))
    progress("where")
    causes = tuple(_found(i, fit, alternatives) for i in range(len(fit.causes)))
    return DiagnosisResult(
        told.verdict,
        causes,
        tuple(Ranked(*row) for row in alternatives.ranking),
        tuple(Group(keys, problem.advice(tuple(keys), fit.causes)) for keys in alternatives.groups),
        tuple(problem.where(fit.causes, fit.rest, explained)),
        gap,
        told.findings[:12],
        (
            *problem.remarks(fit.rest),
            *_at_bounds(causes),
            *_like_slips(problem, fit),
            *_left_out(selection),
            *told.doubts,
        ),
        problem.figures(fit.causes),
    )


def _at_bounds(causes: Sequence[FoundCause]) -> tuple[str, ...]:
    """Estimates at a bound: the effect was not allowed to be larger, so its size is not what the recording says."""
    return tuple(
        f"{' at '.join(filter(None, found.cause.key))}: {name} is at its bound, {value:g} {units[name]}; "
        "the recording asks for more, which is not physically sensible: look for another cause or a wrong description"
        for found in causes
        for units in (found.cause.effect.units(found.cause.location),)
        for name, value in found.at_bounds.items()
    )


def _like_slips(problem: DiagnosableProblem, fit: Fit) -> tuple[str, ...]:
    """Causes that the recording does not tell from what slipped: further reversals would."""
    return tuple(
        f"{' at '.join(filter(None, cause.key))}: something that slipped once, for good, would look the same: "
        "record more reversals"
        for cause, odds in zip(fit.causes, odds_of_slips(problem, fit), strict=True)
        if odds > np.log(REJECTED)
    )


def _left_out(selection: Selection) -> tuple[str, ...]:
    if not selection.dropped:
        return ()
    names = ", ".join(" at ".join(filter(None, key)) for key in selection.dropped)
    count = len(selection.dropped)
    return (
        f"{count} candidate{'s' if count > 1 else ''} left out, with which the twin gives values that are not finite: "
        f"{names}",
    )


def _floor(problem: DiagnosableProblem, fit: Fit) -> float:
    """Noise alone where more than noise is left: what neighbouring rows differ by."""
    squares, count = 0.0, 0.0
    for channel, rows in fit.rest.items():
        expected = problem.expected(channel)
        both = (expected[1:] > 0) & (expected[:-1] > 0)
        squares += 0.5 * float(np.sum(np.square(np.diff(rows[:, 0]))[both]))
        count += 0.5 * float(np.sum((expected[1:] + expected[:-1])[both]))
    return float(np.sqrt(squares / max(count, 1.0)))


def _found(place: int, fit: Fit, alternatives: Alternatives) -> FoundCause:
    cause = fit.causes[place]
    departing = [own for own in departures_of(fit) if own.departures.cause == place]
    told = (row for own in departing for row in describe(own))
    beside = (effect for own in departing for effect in own.effects())
    covariance = fit.covariances[place] + _definition(cause, sum(own.size() for own in departing))
    return FoundCause(
        cause,
        alternatives.probability(cause.key),
        cause.effect.report(cause.values, covariance),
        tuple(told),
        tuple(beside),
    )


def _definition(cause: Cause, share: float) -> Array:
    """Covariance of values because their definition lacks detail (VIM 2.27): that of a cause which departs by a share.

    One value of a parameter then describes the cause no better than that, however little noise there is.
    """
    effect, width = cause.effect, np.zeros(len(cause.values))
    for parameter in effect.parameters:
        if parameter.role is Role.LINEAR:
            own = effect.slices()[parameter.name]
            width[own] = share * float(np.linalg.norm(cause.values[own]))
    return np.diag(np.square(width))


def _plain(value: object) -> object:
    return list(value) if isinstance(value, tuple) else value


def _estimate(estimate: ParameterEstimate) -> dict[str, Any]:
    value, std = estimate.value, estimate.std
    return {
        "value": list(value) if isinstance(value, tuple) else value,
        "std": list(std) if isinstance(std, tuple) else std,
    }
