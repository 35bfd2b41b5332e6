"""Faults of a displacement probe or a tilt sensor, for recordings of stages that list some."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .fault import Acting, Fault, Size, registry, stamps_fault, values_fault
from .faults_heads import dies, stuck

Array = NDArray[np.float64]
WHO = "probe"


def _section(acting: Acting) -> Mapping[str, Any]:
    """What the description says of the probe."""
    return acting.recording.probes[acting.topic]


def _seen(acting: Acting, values: Array) -> Array:
    """What the probe gives out for such values: within its range, in its steps."""
    limit = float(_section(acting)["range"])
    return acting.stepped(np.clip(values, -limit, limit))


def _stepped(acting: Acting) -> Array:
    """Off by a constant: knocked, or its target was."""
    return _seen(acting, acting.values + acting.size)


def _drifted(acting: Acting) -> Array:
    """Further off with time: its holder warms up."""
    return _seen(acting, acting.values + acting.size * acting.seconds[:, None])


def _noisy(acting: Acting) -> Array:
    """Noise of so many times the stated size, in all."""
    std = float(_section(acting)["noise"] or _section(acting)["resolution"])
    extra = std * np.sqrt(max(acting.size**2 - 1.0, 0.0))
    return _seen(acting, acting.values + extra * acting.rng.standard_normal(acting.values.shape))


def _saturated(acting: Acting) -> Array:
    """At the end of its range."""
    return np.full_like(acting.values, np.sign(acting.size) * float(_section(acting)["range"]))


def _gain(acting: Acting) -> Array:
    """Values times the size: an amplifier that is set otherwise."""
    return _seen(acting, acting.values * acting.size)


def _axis(acting: Acting, values: Array, changed: Array) -> Array:
    """Values of both axes or of a drawn one changed, as a cable or a detector with two halves does it."""
    chosen = np.array(((True, False), (False, True), (True, True))[int(acting.rng.integers(0, 3))])
    return np.where(chosen, changed, values)


def _swapped(acting: Acting) -> Array:
    """Axes exchanged: a plug that was put in the wrong way."""
    return acting.values[:, ::-1].copy()


def _unlit(acting: Acting) -> Array:
    """No number: no light comes back."""
    return np.full_like(acting.values, np.nan)


def _one_stuck(acting: Acting) -> Array:
    """An axis, or both, that repeat a value."""
    return _axis(acting, acting.values, stuck(acting))


def _one_stepped(acting: Acting) -> Array:
    """An axis, or both, off by a constant."""
    return _axis(acting, acting.values, _stepped(acting))


def _one_drifted(acting: Acting) -> Array:
    """An axis, or both, further off with time."""
    return _axis(acting, acting.values, _drifted(acting))


PROBE_FAULTS: dict[str, Fault] = registry(
    [
        values_fault("probe_stuck", "A probe repeats a value.", WHO, stuck),
        values_fault(
            "probe_stepped", "A probe is off from a time on.", WHO, _stepped, Size(2e-7, 2e-5, "m", signed=True)
        ),
        values_fault("probe_drifts", "A probe drifts.", WHO, _drifted, Size(2e-8, 2e-6, "m/s", signed=True)),
        values_fault("probe_noisy", "A probe is noisy.", WHO, _noisy, Size(5.0, 300.0, "times")),
        values_fault("probe_saturated", "A probe stands at the end of its range.", WHO, _saturated, Size(signed=True)),
        values_fault("probe_gain_double", "A probe shows twice a displacement.", WHO, _gain, Size(2.0), when="start"),
        stamps_fault("probe_late", "A probe's values are old at their stamps.", WHO, Size(1e-3, 0.2), late=True),
        dies("probe_dead_later", "A probe falls silent.", WHO, "later"),
    ]
)

TILT_FAULTS: dict[str, Fault] = registry(
    [
        values_fault("tilt_sensor_stuck", "A tilt sensor repeats a value.", WHO, _one_stuck),
        values_fault(
            "tilt_sensor_stepped",
            "A tilt sensor is off from a time on.",
            WHO,
            _one_stepped,
            Size(2e-6, 2e-4, "rad", signed=True),
        ),
        values_fault(
            "tilt_sensor_drifts", "A tilt sensor drifts.", WHO, _one_drifted, Size(2e-7, 2e-5, "rad/s", signed=True)
        ),
        values_fault("tilt_sensor_noisy", "A tilt sensor is noisy.", WHO, _noisy, Size(5.0, 300.0, "times")),
        values_fault("tilt_sensor_saturated", "A tilt sensor ends at its range.", WHO, _saturated, Size(signed=True)),
        values_fault("tilt_sensor_axes_swapped", "A tilt sensor's axes are exchanged.", WHO, _swapped),
        values_fault("tilt_sensor_unlit", "A tilt sensor sees nothing and gives no number.", WHO, _unlit),
        values_fault("tilt_sensor_gain_double", "A tilt sensor shows twice a tilt.", WHO, _gain, Size(2.0)),
        stamps_fault("tilt_sensor_late", "A tilt sensor's values are old.", WHO, Size(1e-3, 0.2), late=True),
        dies("tilt_sensor_dead_later", "A tilt sensor falls silent.", WHO, "later"),
    ]
)
