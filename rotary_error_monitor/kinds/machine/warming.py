"""Temperature of a machine at its poses: a smooth course, and the ways in which the thermometer may be wrong about it.

Thermometers round, scatter, fall silent and follow late; an expansion that the machine states makes micrometres of
that.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.machine import THERMOMETER, MachineDescription
from rotary_error_monitor.metrology.smooth_course import FEWEST, SmoothCourse, smooth_course
from rotary_error_monitor.metrology.thermometer_course import LOUDEST, class_b_uncertainty
from rotary_error_monitor.metrology.unread_temperature import COURSES_OF_AN_HOUR, believed_readings, unknown_warming
from rotary_error_monitor.twin.machine import MachineRecording, predict_probe

WARMED = 1.0
"""K by which what a warming does to the probe is found: it goes in proportion."""

NOTHING = 0.01
"""Part of the variance of the probe that ways in which the temperature may be wrong can be left out with together."""


BEHIND = 1.0
"""Standard uncertainty of how many poses a thermometer is behind what expands, or that behind it: it is read once a
pose, and in the time of one it may follow."""


def with_smooth_temperature(
    machine: MachineDescription, recording: MachineRecording
) -> tuple[MachineRecording, Callable[[], Array]]:
    """The recording with the temperatures that its machine had, and what they may be wrong by.

    Those beyond the machine's limits are taken as not read. Where fewer than three were, the machine is taken to be at
    its reference temperature.

    Returns:
        The recording, its remarks saying what was not read, and what gives the ways (n, k) in which its temperatures
        may be wrong, independent, each by one standard deviation, K.
    """
    read, count = recording.temperature, len(recording.temperature)
    good, doubt = believed_readings(read, machine.limits.temperature)
    remarks = [*recording.remarks, *([doubt] if doubt else [])]
    ways = partial(unknown_warming, np.arange(count) / count, COURSES_OF_AN_HOUR)
    if np.count_nonzero(np.isfinite(good)) < FEWEST:
        if _expands(machine):
            remarks.append("temperature: not recorded; what expands by it is not known")
        at_reference = np.full(count, machine.reference_temperature)
        return replace(recording, temperature=at_reference, remarks=tuple(remarks)), ways
    missing = np.count_nonzero(~np.isfinite(read))
    if missing:
        remarks.append(f"temperature: {missing} of {count} poses have none; it is taken from the others")
    course = smooth_course(good, LOUDEST)
    # one that the machine's file states is a parameter of it
    zero = 0.0 if THERMOMETER in machine.uncertainty else class_b_uncertainty(float(np.mean(course.values)))
    return replace(recording, temperature=course.values, remarks=tuple(remarks)), partial(_misread, course, zero)


def _misread(course: SmoothCourse, zero: float) -> Array:
    """(n, k) ways in which a thermometer that was read may be wrong, K: what is behind errs by how fast it warms."""
    return np.column_stack([course.ways(zero), BEHIND * np.gradient(course.values)])


def _expands(machine: MachineDescription) -> bool:
    return bool(np.any([axis.expansion for axis in machine.axes]))


def moved_by_temperature(
    machine: MachineDescription, recording: MachineRecording, ways: Callable[[], Array], probe_std: Array
) -> Array:
    """(3, n, j) change of the probe, m, by each of the ways in which the temperature may be wrong that matters.

    The ones left out make less of the probe's variance, of standard deviations (3,) m, together than anyone can tell.
    """
    if not _expands(machine):
        return np.zeros((3, len(recording.probe), 0))
    warmer = replace(recording, temperature=recording.temperature + WARMED)
    grown = (predict_probe(machine, warmer) - predict_probe(machine, recording)).T / WARMED
    moved = grown[:, :, None] * ways()
    variance = np.mean(np.square(moved / probe_std[:, None, None]), axis=(0, 1))
    order = np.argsort(-variance)
    left_out = np.cumsum(variance[order[::-1]])[::-1]
    return np.asarray(moved[:, :, order[left_out > NOTHING]], np.float64)
