"""How far a fault stands out of what the twin's own uncertainty could do: what no method could find should not count.

A fault that looks like an uncertain parameter within its uncertainty is no gap. With the fault's signals y and those N
of one standard uncertainty of each parameter, both over the noise, what stands out is

    size^2 = y' (1 + N N')^-1 y

the square of the distance, in standard deviations, between the recording with the fault and any that the twin allows.
What all heads see alike must stand out of the rotor's jitter as well, and what an autocollimator sees of the air's
turbulence, each at each frequency. All signals are those of the plant.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.fft import dct

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.cases.departures import Part, acting
from rotary_error_monitor.cases.faults import make_fault
from rotary_error_monitor.cases.making import MachineCase, StageCase
from rotary_error_monitor.cases.response import INPUTS, TRACKER_NOISE, noise_of, times_of
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.two_axis_section import Turbulence
from rotary_error_monitor.machine.uncertainty import uncertain_shifts
from rotary_error_monitor.plant.clocks import HEAD
from rotary_error_monitor.plant.machine import MachineFault, MachinePlant
from rotary_error_monitor.plant.scene import Fault
from rotary_error_monitor.plant.stage import StagePlant
from rotary_error_monitor.twin.stage_parameters import uncertain_parameters

Parts = tuple[Part, ...]

JITTER_BAND = 20.0
"""Frequency, Hz, up to which the rotor jitters, as the page of the stage says."""


def sizes_beyond_uncertainty(case: StageCase | MachineCase, duration: float) -> list[float]:
    """Size of each fault of a case, in standard deviations; `duration` of a stage's recording in s."""
    return _sizes(case, duration, [(acting((fault,)), ()) for fault in case.truth.faults])


def departure_beyond_uncertainty(case: StageCase | MachineCase, duration: float) -> float | None:
    """Size of what a variant's best textbook form leaves, likewise; None where nothing departs."""
    if case.truth.departure is None:
        return None
    (fault,) = case.truth.faults
    fitted = make_fault(fault.name, fault.location, **case.truth.departure.fitted)
    return _sizes(case, duration, [(acting((fault,)), acting((fitted,)))])[0]


def _sizes(case: StageCase | MachineCase, duration: float, pairs: Sequence[tuple[Parts, Parts]]) -> list[float]:
    """Size of the difference that the first of each pair makes to the second."""
    return _stage_sizes(case, duration, pairs) if isinstance(case, StageCase) else _machine_sizes(case, pairs)


def _size(shown: Array, allowed: list[Array]) -> float:
    if not allowed:
        return float(np.linalg.norm(shown))
    table = np.stack(allowed, axis=1)
    taken = table.T @ shown
    squares = float(shown @ shown - taken @ np.linalg.solve(np.eye(len(taken)) + table.T @ table, taken))
    return float(np.sqrt(max(squares, 0.0)))


def _stage_sizes(case: StageCase, duration: float, pairs: Sequence[tuple[Parts, Parts]]) -> list[float]:
    plain = replace(case.plant, faults=())
    measure = _measure_of(plain, duration)
    base = measure(plain)
    allowed = [
        measure(replace(plain, description=p.shifted(plain.description, p.uncertainty))) - base
        for p in uncertain_parameters(case.twin)
    ]
    sizes = []
    for pair in pairs:
        faulty, other = (
            replace(plain, faults=tuple(part for part in parts if isinstance(part, Fault))) for parts in pair
        )
        own = _size(measure(faulty) - measure(other), allowed)
        sizes.append(float(np.hypot(own, _shared_size(other, faulty, duration))))
    return sizes


def _shared_size(plain: StagePlant, faulty: StagePlant, duration: float) -> float:
    """Size of what all heads see alike in `faulty` beside `plain`, over the mean of their noise and the jitter."""
    heads = [stream for stream in plain.streams if stream.startswith(HEAD)]
    time = times_of(plain, heads[0], duration)
    period = float(np.ptp(time)) / (len(time) - 1)
    moved = np.mean([faulty.signal(head, time)[:, 0] - plain.signal(head, time)[:, 0] for head in heads], axis=0)
    power = 2 * np.square(np.abs(np.fft.rfft(moved))) / len(time)
    power[0] /= 2
    frequency = np.fft.rfftfreq(len(time), period)
    floor = 2 * period * noise_of(plain.stage, heads[0]) ** 2 / len(heads)
    density = floor + np.where(frequency < JITTER_BAND, plain.jitter**2 / JITTER_BAND, 0.0)
    return float(np.sqrt(np.sum(power * 2 * period / density)))


def _measure_of(plain: StagePlant, duration: float) -> Callable[[StagePlant], Array]:
    """Function that gives a plant's signals, without noise, over the noise, one sensor after the other.

    Of the heads it gives what each has beyond their mean.
    """
    sensors = [stream for stream in plain.streams if stream not in INPUTS]
    times = {stream: times_of(plain, stream, duration) for stream in sensors}
    noise = {stream: noise_of(plain.stage, stream) for stream in sensors}
    heads = [stream for stream in sensors if stream.startswith(HEAD)]
    air = plain.stage.tilt_instrument.turbulence

    def over_noise(plant: StagePlant, stream: str) -> Array:
        shown = plant.signal(stream, times[stream])
        slow = air if stream == "autocollimator" else None
        return shown.ravel() / noise[stream] if slow is None else _white(shown, times[stream], noise[stream], slow)

    def measure(plant: StagePlant) -> Array:
        read = np.stack([plant.signal(head, times[heads[0]])[:, 0] for head in heads])
        parts = [((read - read.mean(axis=0)) / noise[heads[0]]).ravel()]
        parts += [over_noise(plant, stream) for stream in sensors if stream not in heads]
        return np.asarray(np.concatenate(parts), np.float64)

    return measure


def _white(shown: Array, time: Array, noise: float, air: Turbulence) -> Array:
    """Signals (n, k) over white noise and turbulence (Ornstein-Uhlenbeck) together, at each frequency.

    Cosines over the recording: a drift does not jump from its end to its beginning, as waves have it.
    """
    period = float(np.ptp(time)) / (len(time) - 1)
    frequency = np.arange(len(time)) / (2 * period * len(time))
    slow = 2 * air.std**2 * air.correlation_time / (1 + (2 * np.pi * frequency * air.correlation_time) ** 2)
    white = dct(shown, axis=0, norm="ortho") / np.sqrt(noise**2 + slow / period)[:, None]
    return np.asarray(white.ravel(), np.float64)


def _machine_sizes(case: MachineCase, pairs: Sequence[tuple[Parts, Parts]]) -> list[float]:
    def measure(machine: MachineDescription, parts: Parts = ()) -> Array:
        plant = MachinePlant(machine, tuple(part for part in parts if isinstance(part, MachineFault)))
        return np.asarray(plant.tool_offset(case.poses)[:, :3].ravel() / TRACKER_NOISE, np.float64)

    base = measure(case.twin)
    allowed = [measure(shift.machine) - base for shift in uncertain_shifts(case.twin)]
    return [_size(measure(case.twin, faulty) - measure(case.twin, other), allowed) for faulty, other in pairs]
