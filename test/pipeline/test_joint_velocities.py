"""Positions held against the velocities of the same joint states: what contradicts them is told, what lags does not."""

from __future__ import annotations

import math

import numpy as np
import pytest
from draws import seeds

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.pipeline.joint_checks import JointChecks
from rotary_error_monitor.pipeline.joint_velocities import CONTRADICTED, UNCONFIRMED

MACHINE = load_machine("xyzac_trt")
AXES = MACHINE.axes
LETTERS = MACHINE.letters
MONITORED = LETTERS.index(MACHINE.monitored)
PAUSE = (2.0, 2.7)


def course(draw, times):
    """(n, axes) positions and velocities of axes that swing within their limits; the monitored one turns on."""
    rows, speeds = np.empty((2, len(times), len(AXES)))
    for i, axis in enumerate(AXES):
        size = min(0.4 * (axis.travel[1] - axis.travel[0]), 5.0) * draw.uniform(0.2, 1.0)
        angular = draw.uniform(0.3, 0.7) * min(axis.fastest / size, math.sqrt(axis.quickest / size), 6.0)
        phase = angular * times + draw.uniform(0.0, 2.0 * np.pi)
        rows[:, i], speeds[:, i] = size * np.sin(phase), size * angular * np.cos(phase)
    rows[:, MONITORED], speeds[:, MONITORED] = 2.0 * times, 2.0
    return rows, speeds


def drawn(seed, rate, duration=5.0):
    """Stamps, s, with a pause, a generator, positions and velocities."""
    draw = np.random.default_rng([seed, int(rate)])
    times = np.arange(0.0, duration, 1.0 / rate) + draw.uniform(0.0, 1.0 / rate)
    times = times[(times < PAUSE[0]) | (times > PAUSE[1])]
    return times, draw, *course(draw, times)


def judged(times, rows, speeds):
    """Checks, what was said of each joint state, and what was remarked after it."""
    checks, said, remarks = JointChecks(MACHINE), [], []
    for t, row, speed in zip(times.tolist(), rows, speeds.tolist(), strict=True):
        said.append(checks.judge(round(t * 1e9), row, dict(zip(LETTERS, speed, strict=True))))
        remarks.append(checks.velocities.remarks)
    return checks, np.array(said), remarks


def wrong_sign(rows, speeds, axis):
    rows[:, axis] *= -1.0


def wrong_unit(rows, speeds, axis):
    rows[:, axis] *= np.pi / 180.0


def wrong_factor(rows, speeds, axis):
    rows[:, axis] *= 0.5


def wrong_sign_of_velocity(rows, speeds, axis):
    speeds[:, axis] *= -1.0


def wrong_unit_of_velocity(rows, speeds, axis):
    speeds[:, axis] *= 60.0


def stale_but_for_noise(rows, speeds, axis):
    rows[:, axis] = rows[0, axis] + np.random.default_rng(1).normal(0.0, 1e-6, len(rows))


def exchanged(rows, speeds, axis):
    rows[:, [0, 1]] = rows[:, [1, 0]]


FAULTS = [
    wrong_sign,
    wrong_unit,
    wrong_factor,
    wrong_sign_of_velocity,
    wrong_unit_of_velocity,
    stale_but_for_noise,
    exchanged,
]


@pytest.mark.parametrize("begin", [0.0, PAUSE[0]], ids=["from the begin", "after a pause"])
@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("seed", seeds(12))
def test_what_contradicts_its_velocities_is_held_soon_and_until_it_is_over(seed, fault, begin):
    """At 100 Hz. Axes that turn back meanwhile take longer, and two that are exchanged may go alike for a moment."""
    times, draw, rows, speeds = drawn(seed, 100.0)
    axis = int(draw.choice([i for i in range(len(AXES)) if i != MONITORED]))
    wrong = times > begin
    changed = rows[wrong].copy(), speeds[wrong].copy()
    fault(*changed, axis)
    rows[wrong], speeds[wrong] = changed
    _, said, _ = judged(times, rows, speeds)
    assert set(said[~wrong]) <= {""}
    of_fault, passed = said[wrong], times[wrong] - times[wrong][0]
    assert any(CONTRADICTED in each for each in of_fault)
    if fault is not exchanged:
        assert not set(of_fault[passed > 0.6]) & {""}
        assert CONTRADICTED in of_fault[-1]
    if begin:
        assert all(UNCONFIRMED in each or CONTRADICTED in each for each in of_fault[:5])


@pytest.mark.parametrize("seed", seeds(12))
def test_a_fault_that_is_over_is_forgotten_with_the_next_motion(seed):
    times, draw, rows, speeds = drawn(seed, 100.0, 6.0)
    axis = int(draw.choice([i for i in range(len(AXES)) if i != MONITORED]))
    wrong = (times > PAUSE[0]) & (times < PAUSE[1] + 0.8)
    rows[wrong, axis] *= -1.0
    _, said, _ = judged(times, rows, speeds)
    assert any(CONTRADICTED in each for each in said[wrong])
    assert set(said[times > PAUSE[1] + 0.8 + 1.5]) == {""}


def filtered(times, speeds, lag):
    """Velocities through a filter of first order, of a time constant in s."""
    out = speeds.copy()
    for i, passed in enumerate(np.diff(times), 1):
        out[i] = out[i - 1] + (speeds[i] - out[i - 1]) * (1.0 - math.exp(-passed / lag))
    return out


def point_to_point(draw, times):
    """Positions and velocities of axes that go at full acceleration from place to place and stand there for a while."""
    rows, speeds = np.empty((2, len(times), len(AXES)))
    fine = np.arange(0.0, times[-1] + 0.01, 1e-3)
    for i, axis in enumerate(AXES):
        speed, goal, place, dwell = np.zeros(len(fine)), 0.0, 0.0, 0.0
        for k in range(1, len(fine)):
            if abs(goal - place) < 1e-4 and fine[k] > dwell:
                goal, dwell = (
                    0.3 * draw.uniform(-1, 1) * (axis.travel[1] - axis.travel[0]),
                    fine[k] + draw.exponential(0.3),
                )
            wanted = math.copysign(min(math.sqrt(1.6 * axis.quickest * abs(goal - place)), axis.fastest), goal - place)
            wanted = 0.0 if abs(goal - place) < 1e-4 or fine[k] <= dwell else wanted
            change = 0.9 * axis.quickest * 1e-3
            speed[k] = speed[k - 1] + np.clip(wanted - speed[k - 1], -change, change)
            place += 0.5e-3 * (speed[k] + speed[k - 1])
        way = np.concatenate([[0.0], np.cumsum(0.5e-3 * (speed[1:] + speed[:-1]))])
        rows[:, i], speeds[:, i] = np.interp(times, fine, way), np.interp(times, fine, speed)
    return rows, speeds


@pytest.mark.parametrize("seed", seeds(48))
def test_a_sound_machine_is_never_doubted(seed):
    """With noise, rounding, filtered or late velocities, stamps that jitter, pauses, and angles modulo a turn."""
    draw = np.random.default_rng([seed, 7])
    rate = draw.choice([10.0, 20.0, 50.0, 100.0, 250.0])
    times, _, rows, speeds = drawn(seed, rate)
    if seed % 2:
        rows, speeds = point_to_point(draw, times)
    lag = draw.uniform(0.002, 0.02)
    late = np.transpose([np.interp(times - lag, times, speeds[:, i]) for i in range(len(AXES))])
    speeds = [speeds, filtered(times, speeds, lag), late][draw.integers(3)]
    speeds = speeds + draw.normal(0.0, 2e-4, speeds.shape) * (speeds != 0.0)
    rounded = draw.choice([1e-7, 1e-6, 1e-5])
    rows = np.round((rows + draw.normal(0.0, 2e-7, rows.shape)) / rounded) * rounded
    if draw.integers(2):
        rows[:, 3:] = np.mod(rows[:, 3:] + np.pi, 2 * np.pi) - np.pi
    times = times + draw.uniform(-1.0, 1.0, len(times)) * min(2.5e-3, 0.4 / rate)
    _, said, remarks = judged(times, rows, speeds)
    assert {each for each in said if UNCONFIRMED not in each} <= {""}
    unconfirmed = times[[UNCONFIRMED in each for each in said]]
    assert not len(unconfirmed) or np.ptp(unconfirmed) < 0.4 + 4.0 / rate
    assert not any(remarks)


@pytest.mark.parametrize("which", ["one axis", "all"])
@pytest.mark.parametrize("seed", seeds(8))
def test_velocities_that_a_driver_does_not_fill_in_are_remarked_and_not_used(seed, which):
    times, draw, rows, speeds = drawn(seed, 100.0)
    axis = int(draw.integers(len(AXES)))
    speeds[:, axis if which == "one axis" else slice(None)] = 0.0
    _, said, remarks = judged(times, rows, speeds)
    assert {each for each in said if UNCONFIRMED not in each} == {""}
    assert remarks[-1] and all("always 0 while it moves" in each for each in remarks[-1])
    assert LETTERS[axis] in remarks[-1][0].split(" are ")[0]


@pytest.mark.parametrize("change", [-1.0, 60.0, 0.0])
@pytest.mark.parametrize("seed", seeds(8))
def test_a_velocity_that_steps_while_positions_go_on_is_remarked_and_not_used(seed, change):
    times, draw, rows, speeds = drawn(seed, 100.0)
    times, rows, speeds = times[times > PAUSE[1]], rows[times > PAUSE[1]], speeds[times > PAUSE[1]]
    axis = int(draw.choice([i for i in range(len(AXES)) if i != MONITORED]))
    begin = times[np.argmax(np.where((times > 3.5) & (times < 4.5), np.abs(speeds[:, axis]), 0.0))]
    speeds[times >= begin, axis] *= change
    _, said, remarks = judged(times, rows, speeds)
    assert set(said) == {""}
    soon = np.searchsorted(times, begin + 0.2)
    assert all(f"velocities of axis {LETTERS[axis]} are not used" in each[0] for each in remarks[soon : soon + 10])
    assert not any(remarks[: np.searchsorted(times, begin)])


def test_the_encoder_bears_the_monitored_axis_out():
    """Velocities of another unit are those of a driver, and the position is right."""
    times, _, rows, speeds = drawn(1, 100.0)
    speeds[:, MONITORED] *= 60.0 / (2.0 * np.pi)
    _, said, remarks = judged(times, rows, speeds)
    assert {each for each in said if UNCONFIRMED not in each} == {""}
    assert "velocities of axis C are not used: its positions do not go as they say" in remarks[-1]
