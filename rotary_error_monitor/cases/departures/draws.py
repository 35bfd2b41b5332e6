"""Which mechanisms a fault may depart by, and drawn departures of a drawn size."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from rotary_error_monitor.cases.departures import forms, friction, poses, readings, swells
from rotary_error_monitor.cases.departures.company import Neighbours, SecondWave
from rotary_error_monitor.cases.departures.departure import AnyFault, Departure, Varied
from rotary_error_monitor.cases.departures.textbook import Channels, TextbookFit, fit_textbook
from rotary_error_monitor.cases.faults import Named, UnsuitableSeedError

SHARES = (0.02, 0.30)
"""Range of departures: root mean square of what the best textbook form leaves over that of the fault's signal."""

_DELAYS = (swells.OneWay, swells.Fast, swells.Warming, swells.Wander, swells.RunIn)
_ORBITS = (Neighbours, swells.Warming, swells.Around, swells.Wander, swells.OneWay, swells.Fast)
_WAVES = (poses.PoseWarming, poses.AlongOwn, poses.PoseOneWay, poses.PoseWander)
_SEATS = (poses.PoseWarming, poses.AlongTravel, poses.PoseOneWay, poses.PoseWander, poses.PoseRunIn)

MECHANISMS: Mapping[str, tuple[type[Departure], ...]] = {
    "disc_eccentricity": (readings.OvalRing, swells.Warming, swells.OneWay, swells.Wander, swells.RunIn),
    "graduation_error": (Neighbours, swells.Around, swells.Warming),
    "disc_scale": (swells.Around, swells.Warming, swells.Fast),
    "subdivisional_error": (readings.UnlikeGains, swells.Around, swells.Warming, swells.Fast),
    "head_misplacement": (readings.CreepingBracket, swells.Around, swells.OneWay),
    "head_latency": _DELAYS,
    "encoder_latency": _DELAYS,
    "head_missed_counts": (readings.SlowLoss, readings.PartlyRegained),
    "autocollimator_gain": (readings.BentGain, swells.Warming, swells.Wander, swells.Around),
    "autocollimator_roll": (readings.SkewReticle, swells.Warming, swells.Wander, swells.RunIn),
    "autocollimator_nonlinearity": (readings.Saturating, readings.UnlikeAxes, swells.Warming),
    "autocollimator_drift": (readings.SettlingDrift, swells.Wander),
    "autocollimator_latency": _DELAYS,
    "mirror_wobble": (swells.Warming, swells.Fast, swells.OneWay, swells.Wander, swells.RunIn),
    "mirror_flatness": (Neighbours, swells.Warming, swells.Around),
    "spindle_radial": (*_ORBITS, swells.Pressed),
    "spindle_tilt": (*_ORBITS, swells.Pressed),
    "bearing_asynchronous": (swells.Around, swells.Fast, swells.Warming, swells.Wander),
    "load_compliance": (forms.Stiffening, forms.UnlikeSides, swells.Warming, swells.Around),
    "thermal_drift": (forms.LaggingDrift, swells.Wander, swells.OneWay),
    "unbalance": (forms.Resonant, swells.Warming, swells.OneWay, swells.Wander),
    "radial_hysteresis": (friction.CompliantFlanks, friction.OilFilmSide, swells.Around, swells.Warming),
    "reversal_backlash": (friction.CompliantFlanks, friction.OilFilmSide, swells.Around, swells.Warming),
    "following_error": (*_DELAYS, swells.LowSpeed),
    "drive_cyclic_error": (Neighbours, swells.OneWay, swells.Around, swells.LowSpeed, swells.Pressed),
    "lvdt_gain": (readings.BentGain, swells.Warming, swells.Wander, swells.OneWay),
    "lvdt_artefact": (readings.LobedArtefact, swells.Warming, swells.RunIn, swells.OneWay),
    "lvdt_height": (swells.Warming, swells.Wander, swells.OneWay, swells.Around),
    "squareness": (poses.PoseWarming, poses.AlongTravel, poses.PoseWander, poses.PoseOneWay),
    "axis_scale": (poses.AlongOwn, poses.PoseWarming, poses.PoseOneWay),
    "thermal_expansion": (poses.LaggingScale, poses.AlongOwn, poses.PoseWander),
    "axis_backlash": (poses.AlongOwn, poses.PoseWarming, poses.PoseWander, poses.PoseRunIn),
    "axis_straightness": _WAVES,
    "axis_angular": _WAVES,
    "cyclic_error": (SecondWave, *_WAVES),
    "rotary_harmonic": (Neighbours, poses.PoseWarming, poses.PoseOneWay, poses.PoseWander),
    "pivot_offset": _SEATS,
    "axis_orientation": _SEATS,
    "head_droop": (poses.StiffeningHead, poses.PoseWarming, poses.PoseOneWay),
    "tool_length": _SEATS,
    "setup_offset": _SEATS,
}
"""Mechanisms of each effect; all that textbooks and machine shops know of it and the plant can simulate."""

_SOFTEST, _TRIALS, _NEAR = 1e-4, 9, 0.1


def vary_fault(
    fault: Named, draw: np.random.Generator, channels: Callable[[tuple[AnyFault, ...]], Channels]
) -> tuple[Varied, TextbookFit]:
    """The fault with a drawn mechanism, as strong as a share drawn from `SHARES` needs, and how it departs.

    A mechanism that does not show in this recording (a force that nobody applies) gives way to the next.

    Args:
        fault: of the vocabulary, of its final size.
        draw: where chance comes from.
        channels: gives by channel how far faults move the recording, over the noise.

    Raises:
        UnsuitableSeedError: none of its mechanisms shows.
    """
    target = float(np.exp(draw.uniform(*np.log(SHARES))))
    kinds = MECHANISMS[fault.name]
    for index in draw.permutation(len(kinds)).tolist():
        found = _as_strong(Varied(fault, kinds[index].drawn(draw)), target, channels)
        if found is not None:
            return found
    raise UnsuitableSeedError(f"{fault} departs by no mechanism in this recording; take another seed")


def _as_strong(
    varied: Varied, target: float, channels: Callable[[tuple[AnyFault, ...]], Channels]
) -> tuple[Varied, TextbookFit] | None:
    """The fault departing by the share `target`, or as near as its mechanism allows within `SHARES`; None for neither.

    The share rises with the strength as long as the departure is one: bisection of its logarithm.
    """
    low, high = np.log(_SOFTEST), np.log(varied.departure.most)
    base = abs(varied.departure.strength)
    best: tuple[Varied, TextbookFit] | None = None
    for _ in range(_TRIALS):
        strength = float(np.exp((low + high) / 2))
        tried = replace(varied, departure=varied.departure.scaled(strength / base))
        fit = fit_textbook(tried, channels)
        if best is None or abs(fit.share - target) < abs(best[1].share - target):
            best = tried, fit
        if abs(fit.share / target - 1) < _NEAR:
            break
        low, high = (low, np.log(strength)) if fit.share > target else (np.log(strength), high)
    assert best is not None
    return best if SHARES[0] <= best[1].share <= SHARES[1] else None
