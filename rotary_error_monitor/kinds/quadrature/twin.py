"""The twin of sine and cosine signals: the circle on which they go round, and the phase that they stand for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.arrays import Array, Complex
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.kinds.quadrature.effects import CircleState, QuadratureEffect
from rotary_error_monitor.twin.finite import check_finite

FEWEST_SAMPLES = 500
"""Some twenty in each of the patches of the circle that are left out."""

_MOST_SUBSTITUTIONS = 30
_SETTLED = 1e-10
"""Each substitution shrinks the mistake by the slope of the phase error, a tenth for very bad signals; this is rad."""


@dataclass(frozen=True)
class QuadratureRecording:
    """Samples of two signals, in any order.

    Attributes:
        signals: (n,) cosine + i sine, counts.
    """

    signals: Complex


def distorted(turning: Complex, amplitude: float, causes: Sequence[Cause]) -> Complex:
    """(n,) signals, counts, at true phases given as (n,) points on the unit circle, with effects.

    Raises:
        UnpredictableError: a value is not finite.
    """
    signals = amplitude * turning
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):  # what is not finite is told below
        for cause in sorted(causes, key=_rank):
            effect = cause.effect
            assert isinstance(effect, QuadratureEffect)
            state = CircleState(turning, amplitude, signals)
            signals = signals + effect.displacement(cause.values, cause.location, state)
    check_finite("the signals", signals, causes)
    return np.asarray(signals, np.complex128)


def true_phase(signals: Complex, amplitude: float, causes: Sequence[Cause]) -> Array:
    """(n,) phase, rad, that signals with these effects stand for, near the phase that they show.

    The point on the distorted circle that stands in the signals' direction is found by repeated substitution.
    """
    shown = signals / np.maximum(np.abs(signals), 1e-300)
    phase = np.zeros(len(signals))
    for _ in range(_MOST_SUBSTITUTIONS if causes else 0):
        away = np.angle(shown * np.conj(distorted(shown * np.exp(1j * phase), amplitude, causes)))
        phase = phase + away
        if np.max(np.abs(away)) < _SETTLED:
            break
    return np.asarray(np.angle(shown) + phase, np.float64)


def predict_radius(signals: Complex, amplitude: float, causes: Sequence[Cause]) -> Array:
    """(n,) radius, counts, at which the twin expects signals in the direction of the measured ones."""
    phase = true_phase(signals, amplitude, causes)
    return np.asarray(np.abs(distorted(np.exp(1j * phase), amplitude, causes)), np.float64)


def _rank(cause: Cause) -> tuple[int, str]:
    effect = cause.effect
    assert isinstance(effect, QuadratureEffect)
    return effect.rank, effect.name
