"""Faults of the autocollimator, of the command and of the clocks of all streams."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .fault import Acting, Fault, Size, stamps_fault, values_fault
from .faults_heads import dies, stuck

Array = NDArray[np.float64]


def _seen(acting: Acting, values: Array) -> Array:
    """What the autocollimator gives out for such values: within its range, in its steps."""
    limit = acting.recording.stage["autocollimator"]["range"]
    return acting.stepped(np.clip(values, -limit, limit))


def _axes(acting: Acting) -> Array:
    """(2,) a drawn direction: one axis or both."""
    return np.array(((1.0, 0.0), (0.0, 1.0), (0.7, 0.7), (0.7, -0.7))[int(acting.rng.integers(0, 4))])


def _stepped(acting: Acting) -> Array:
    """Off by a constant."""
    return _seen(acting, acting.values + acting.size * _axes(acting))


def _drifted(acting: Acting) -> Array:
    """Further off with time."""
    return _seen(acting, acting.values + acting.size * acting.seconds[:, None] * _axes(acting))


def _spikes(acting: Acting) -> Array:
    """Now and then one to five samples far off; their number is drawn, one or up to 5 % of the samples."""
    values, n = acting.values.copy(), len(acting.values)
    for at in acting.rng.integers(0, n, 1 + int(acting.rng.uniform(0.0, 0.02) * n)):
        width = int(acting.rng.integers(1, 6))
        values[at : at + width] += acting.size * acting.rng.choice((-1.0, 1.0)) * _axes(acting)
    return _seen(acting, values)


def _reversed(axis: int) -> Callable[[Acting], Array]:
    """One axis with the wrong sign."""
    signs = np.where(np.arange(2) == axis, -1.0, 1.0)
    return lambda acting: acting.values * signs


def _saturated(acting: Acting) -> Array:
    """One axis or both at the end of the range."""
    limit = acting.recording.stage["autocollimator"]["range"]
    off = _axes(acting)
    return np.where(off != 0.0, np.sign(off) * np.sign(acting.size) * limit, acting.values)


def _std(acting: Acting) -> float:
    """Stated noise of the autocollimator, or its resolution if none is stated."""
    section = acting.recording.stage["autocollimator"]
    return float(section["noise"] or section["resolution"])


def _unlit(acting: Acting) -> Array:
    """Noise about zero of so many times the stated size, or zeros."""
    return _seen(acting, acting.size * _std(acting) * acting.rng.standard_normal(acting.values.shape))


def _noisy(acting: Acting) -> Array:
    """Noise of so many times the stated size, in all."""
    extra = _std(acting) * np.sqrt(max(acting.size**2 - 1.0, 0.0))
    return _seen(acting, acting.values + extra * acting.rng.standard_normal(acting.values.shape))


def _gain(acting: Acting) -> Array:
    """Values times the size."""
    return _seen(acting, acting.values * acting.size)


def _low_pass(acting: Acting) -> Array:
    """First-order low pass of a time constant, s, as of an averaging that is set too long."""
    out, last = np.empty_like(acting.values), acting.previous
    steps = np.diff(acting.seconds, prepend=acting.seconds[0])
    for at, (value, step) in enumerate(zip(acting.values, steps, strict=True)):
        out[at] = last = last + (1.0 - np.exp(-step / acting.size)) * (value - last)
    return _seen(acting, out)


WHO = "autocollimator"
AUTOCOLLIMATOR_FAULTS: list[Fault] = [
    values_fault("autocollimator_stuck", "The autocollimator repeats a value.", WHO, stuck),
    values_fault(
        "autocollimator_stepped",
        "The autocollimator is off from a time on.",
        WHO,
        _stepped,
        Size(5e-6, 2e-4, "rad", signed=True),
    ),
    values_fault("autocollimator_spikes", "The autocollimator has spikes.", WHO, _spikes, Size(2e-5, 2e-3, "rad")),
    values_fault(
        "autocollimator_axes_swapped",
        "The autocollimator's axes are swapped.",
        WHO,
        lambda a: a.values[:, ::-1],
        when="start",
    ),
    values_fault("autocollimator_x_reversed", "tilt_x has the wrong sign.", WHO, _reversed(0), when="start"),
    values_fault("autocollimator_y_reversed", "tilt_y has the wrong sign.", WHO, _reversed(1), when="start"),
    values_fault(
        "autocollimator_saturated",
        "The autocollimator stands at the end of its range.",
        WHO,
        _saturated,
        Size(signed=True),
    ),
    values_fault("autocollimator_unlit_zero", "The autocollimator sees nothing and gives 0.", WHO, _unlit, Size(0.0)),
    values_fault(
        "autocollimator_unlit_noise",
        "The autocollimator sees nothing and gives noise about 0.",
        WHO,
        _unlit,
        Size(0.5, 20.0, "times"),
    ),
    values_fault(
        "autocollimator_gain_half", "The autocollimator shows half of a tilt.", WHO, _gain, Size(0.5), when="start"
    ),
    values_fault(
        "autocollimator_gain_double", "The autocollimator shows twice a tilt.", WHO, _gain, Size(2.0), when="start"
    ),
    values_fault("autocollimator_noisy", "The autocollimator is noisy.", WHO, _noisy, Size(3.0, 300.0, "times")),
    values_fault(
        "autocollimator_drifts",
        "The autocollimator drifts fast.",
        WHO,
        _drifted,
        Size(5e-7, 5e-5, "rad/s", signed=True),
    ),
    values_fault(
        "autocollimator_low_pass",
        "The autocollimator averages, with a time constant of 0.1 s to 1 s.",
        WHO,
        _low_pass,
        Size(0.1, 1.0, "s"),
        when="either",
    ),
    stamps_fault(
        "autocollimator_late", "The autocollimator's values are old at their stamps.", WHO, Size(1e-3, 0.2), late=True
    ),
    dies("autocollimator_dead_later", "The autocollimator falls silent.", WHO, "later"),
    dies("autocollimator_dead_start", "The autocollimator is silent from the start.", WHO, "start"),
]


def _offset(acting: Acting) -> Array:
    """The command's angle off by a constant."""
    return acting.values + acting.size * np.array([1.0, 0.0])


def _command_noisy(acting: Acting) -> Array:
    """Noise on the command's angle."""
    values = acting.values.copy()
    values[:, 0] += acting.size * acting.rng.standard_normal(len(values))
    return values


def _wrong_velocity(acting: Acting) -> Array:
    """The command's velocity times a wrong factor: 0, -1, 0.5, 2, or degrees."""
    factor = float(acting.rng.choice((0.0, -1.0, 0.5, 2.0, 180.0 / np.pi)))
    return np.asarray(acting.values * [1.0, factor], float)


def _wrong_rate(acting: Acting) -> Array:
    """The command runs too fast or too slow, velocity included, from the begin on."""
    values = acting.values.copy()
    values[:, 0] += acting.size * (values[:, 0] - acting.previous[0])
    values[:, 1] *= 1.0 + acting.size
    return values


def _staircase(acting: Acting) -> Array:
    """The values of every tenth of a second, repeated until the next."""
    kept = np.floor(acting.seconds / 0.1).astype(int)
    return acting.values[np.searchsorted(kept, kept, side="left")]


COMMAND_FAULTS: list[Fault] = [
    values_fault(
        "command_staircase",
        "The command changes ten times a second, under fresh stamps.",
        "command",
        _staircase,
        when="either",
    ),
    stamps_fault(
        "command_stamps_off", "The command's stamps are off, either way.", "command", Size(3e-4, 0.02, signed=True)
    ),
    values_fault(
        "command_offset",
        "The command is off by a constant angle.",
        "command",
        _offset,
        Size(2e-5, 3e-3, "rad", signed=True),
        when="either",
    ),
    values_fault("command_stuck", "The command repeats its values.", "command", stuck),
    dies("command_dead_later", "The command falls silent.", "command", "later"),
    dies("command_dead_start", "The command is silent from the start.", "command", "start"),
    values_fault("command_noisy", "The command's angle is noisy.", "command", _command_noisy, Size(5e-6, 2e-3, "rad")),
    values_fault(
        "command_wrong_velocity",
        "The command's velocity does not fit its angle.",
        "command",
        _wrong_velocity,
        when="either",
    ),
    values_fault(
        "command_wrong_rate",
        "The command runs at another speed than the rotor.",
        "command",
        _wrong_rate,
        Size(1e-4, 0.1, "relative", signed=True),
        when="either",
    ),
]


CLOCK_FAULTS: list[Fault] = [
    stamps_fault(
        "clocks_step_forward", "The clocks of all streams step forward.", "all", Size(0.01, 10.0), when="later"
    ),
    stamps_fault(
        "clocks_step_back", "The clocks of all streams step back.", "all", Size(0.01, 10.0), when="later", factor=-1.0
    ),
]
