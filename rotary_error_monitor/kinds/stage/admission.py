"""How long a recording of a stage must be to be worth a diagnosis, and what its motion and noise hide."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.streams import COMMAND
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.kinds.stage.jitter import even_motion, orders_at_one_speed
from rotary_error_monitor.noise.noise_by_speed import NoiseBySpeed
from rotary_error_monitor.noise.stage_noise import StageNoise
from rotary_error_monitor.sensors.library import instrument_of, is_listed, sensor_of
from rotary_error_monitor.twin.recording import StageRecording
from rotary_error_monitor.twin.stage import Signals

SHORTEST = 12.0
"""Duration, s, below which the jitter of the rotor cannot be told from effects: of 72 recordings of 6 to 10 s without a
gap 11 showed one, of 112 from 12 to 16 s none."""

WORTH_SAYING = 0.01
"""Part of the samples that is said to be left out: with less nothing is known less well."""

FINEST = 1e-12
"""Noise of a reading, rad or m, that no instrument comes below; less than that is a stand-in for not known."""


def check_noise(streams: Iterable[str], std: Mapping[str, float]) -> None:
    """Refuse a twin that states no noise of an instrument: what differs is weighed against that.

    Args:
        streams: names of the sensors that take part.
        std: standard deviation of one sample of each instrument, rounding included: head, autocollimator, reference and
            listed sensors by their streams.

    Raises:
        InputError: it is next to nothing.
    """
    instruments = {instrument_of(name) for name in streams}
    for name, size in std.items():
        if name in instruments and size < FINEST:
            unit, section = sensor_of(name).unit, sensor_of(name).section
            place = f"{section}.{name.rpartition('_')[2]}" if is_listed(name) else section
            raise InputError(
                f"stage.{place}: noise and resolution together are {size:g} {unit}; differences are weighed "
                f"against the noise: state the standard deviation of one reading, above {FINEST:g} {unit}"
            )


def check_extent(recording: StageRecording, raw: Signals, noise: Mapping[str, float]) -> None:
    """Refuse a recording that is too short to hold anything out.

    Args:
        recording: what was measured.
        raw: (n, k) measured minus predicted of each sensor.
        noise: standard deviation of one sample of each instrument: head, autocollimator, reference, listed sensors.

    Raises:
        InputError: it lasts too little; the message says what can be said all the same.
    """
    if recording.duration >= SHORTEST:
        return
    damage = "".join(f"; {remark}" for remark in recording.remarks)
    raise InputError(
        f"the recording lasts {recording.duration:.1f} s: too little to hold data out and to tell effects from noise; "
        f"record at least {SHORTEST:g} s. "
        f"What can be said: {_describe(raw, noise)}{damage}"
    )


def motion_remarks(recording: StageRecording, uncommanded: int) -> list[str]:
    """What the motion hides: orders on an arc or at one speed, and samples at which the command is not known.

    Args:
        recording: what was measured.
        uncommanded: number of samples of the heads that do not count against the command.
    """
    found = []
    command = recording.streams[COMMAND]
    arc = float(np.ptp(command.values[:, 0])) / (2 * np.pi)
    turns, uneven = even_motion(command.time, command.values[:, 0])
    if arc >= 1 and uneven < 1:  # of order 1: uneven turning by a radian would smear it
        found.append(
            f"the stage turned at one speed only: an order of the rotation cannot be told from a wave of the rotor's "
            f"own at that multiple of {turns:.3g} Hz: record at another speed too"
        )
    if arc < 1:
        found.append(
            f"the stage turned within {arc:.2g} of a turn: orders look like one another and like a drift there, "
            "and what lies beyond does not show"
        )
    if uncommanded > WORTH_SAYING * len(recording.streams[COMMAND].time):
        found.append(
            f"command: {uncommanded} samples of the heads are not held against it, where its speed changes within a "
            "sample: publish the command at a higher rate"
        )
    return found


def noise_remarks(noises: Sequence[StageNoise], command: Callable[[Array], Array]) -> list[str]:
    """Slow noise of instruments, noise that grows with speed, and lines of the jitter that look like an order.

    Args:
        noises: of each stretch of a recording.
        command: gives commanded rotation, rad, at times, s.
    """
    slow: dict[str, list[float]] = {}
    for noise in noises:
        for name, size in noise.slow_sizes().items():
            slow.setdefault(name, []).append(size)
    found = [
        f"{name}: slow noise of {1e6 * max(sizes):.2g} {sensor_of(name).small_unit} (rms) beside the white"
        for name, sizes in slow.items()
    ]
    grown: dict[str, list[NoiseBySpeed]] = {}
    for noise in noises:
        for name, by_speed in noise.by_speed:
            grown.setdefault(name, []).append(by_speed)
    for name, own in grown.items():
        most = max(own, key=lambda by_speed: float(by_speed.level[-1]))
        found.append(
            f"{name}: noise grows with speed, {most.level[-1]:.2f} times as much at {most.speed[-1]:.2g} rad/s"
        )
    for noise in noises:
        time = noise.grid.time
        found += [
            f"rotation: a wave at {line:.2f} Hz was taken for jitter of the rotor's own; recorded at one speed only, "
            f"it cannot be told from order {order}: record at another speed too"
            for line, order in orders_at_one_speed(noise.lines, time, command(time))
        ]
    return list(dict.fromkeys(found))


def _describe(raw: Signals, noise: Mapping[str, float]) -> str:
    sizes = {}
    for name, values in raw.items():
        unit = sensor_of(name).small_unit
        rms = 1e6 * float(np.sqrt(np.mean(np.square(values))))
        sizes[name] = f"{rms:.3g} {unit} (noise of one sample {1e6 * noise[instrument_of(name)]:.2g} {unit})"
    listed = ", ".join(f"{name} {size}" for name, size in sizes.items())
    return f"measured and predicted differ by {listed}; of that the rotor's own jitter is a part at the heads"
