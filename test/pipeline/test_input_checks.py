"""What command and joint states say of the monitored axis: what was told at rest holds while it turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pushed_inputs import push_error_motion

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.compensation import Compensator

MACHINE = load_machine("xyzac_trt")
START = 1_763_700_000_000_000_000
MS = 1_000_000
SPEED = 3.0
TURNS_AT, RESTS_AT, END = 1.0, 6.0, 9.0
"""When the axis begins to turn, with a ramp of half a second, and when it rests again, s."""


def angle(t):
    """Of the axis, rad."""
    ramp = 0.5
    up = np.clip(t - TURNS_AT, 0.0, ramp), np.clip(t - TURNS_AT - ramp, 0.0, None)
    down = np.clip(t - RESTS_AT, 0.0, ramp), np.clip(t - RESTS_AT - ramp, 0.0, None)
    turned = [0.5 * SPEED / ramp * part[0] ** 2 + SPEED * part[1] for part in (up, down)]
    return turned[0] - turned[1]


def run(off, end, jitter=0.0, block=5):
    """Times (s) at which positioning went into the offset, of a command that is `off` (rad) up to an `end` (s).

    Joint states are stamped late by up to `jitter` s, by chance.
    """
    compensator, draw, used = Compensator(MACHINE), np.random.default_rng(3), {}
    for before in (1000 * MS, 0):
        compensator.push_temperature(20.0, START - before)
    for ms in range(0, round(END * 1e3), block):
        for own in range(ms, ms + block):
            if own % 10 == 0:
                t = own * 1e-3
                late = float(draw.uniform(0.0, jitter))
                positions = {"X": 0.05 + 0.01 * t, "Y": 0.01 * t, "Z": 0.1 - 0.01 * t, "A": 0.1 * t}
                positions["C"] = float(angle(t - late))
                compensator.accept_joint_state(START + own * MS, positions, dict.fromkeys(positions, 0.0))
        times = START + (ms + np.arange(block)) * MS + MS // 2
        t = (times - START) * 1e-9
        wrong = np.where(t < end, off, 0.0)
        motion = replace(ErrorMotion.unknown(block), theta=angle(t), times_ns=times)
        motion.components[:, 0], motion.components[:, 5] = 1e-12 * np.sin(50.0 * t), -wrong
        for place in (0, 1, 3, 4, 5):
            motion.observable[:, place] = True
            motion.covariance[:, place, place] = 1e-14
        push_error_motion(compensator, motion)
        used[ms * 1e-3] = not any("joint states are" in remark for remark in compensator.remarks)
    return used


@pytest.mark.parametrize("jitter", [0.0, 1.5e-3])
@pytest.mark.parametrize("off", [3e-4, -1e-3, 4e-3])
def test_what_is_told_at_rest_holds_while_it_turns(off, jitter):
    used = run(off, np.inf, jitter)
    assert not any(believed for t, believed in used.items() if t > 0.2)


def test_a_difference_that_ends_at_rest_is_over():
    used = run(1e-3, 8.0)
    assert not any(believed for t, believed in used.items() if 0.2 < t < 7.9)
    assert all(believed for t, believed in used.items() if t > 8.2)


def test_what_lasts_for_no_tenth_of_a_second_is_over_when_it_fits():
    used = run(1e-3, 0.08)
    assert all(believed for t, believed in used.items() if t > 0.2)


@pytest.mark.parametrize("jitter", [0.0, 1.5e-3])
def test_what_fits_is_believed(jitter):
    assert all(run(1e-4, np.inf, jitter).values())


def test_it_does_not_matter_how_many_come_at_once():
    """It ended while the axis turned, and is over as that slows down: at the same time however many come."""
    first = [min(t for t, believed in run(1e-3, 3.0, 1e-3, block).items() if believed and t > 0.2) for block in (5, 10)]
    assert RESTS_AT < first[0] < RESTS_AT + 1.0
    assert abs(first[0] - first[1]) < 0.011


@pytest.mark.parametrize("unit", [180.0 / np.pi, 400.0 / (2 * np.pi), 1.5])
def test_a_rotation_in_another_unit_is_not_used_where_it_comes_near(unit):
    """Modulo a turn it is where the joint states are again and again: a tenth of the offsets were of it."""
    compensator, begin, end = Compensator(MACHINE), 2.0, 5.0
    for before in (1000 * MS, 0):
        compensator.push_temperature(20.0, START - before)
    used = []
    for ms in range(0, round(END * 1e3), 5):
        t = ms * 1e-3
        if ms % 10 == 0:
            positions = {"X": 0.05, "Y": 0.01, "Z": 0.1, "A": 0.1, "C": float(angle(t))}
            compensator.accept_joint_state(START + ms * MS, positions, dict.fromkeys(positions, 0.0))
        times = START + (ms + np.arange(5)) * MS + MS // 2
        seen = angle((times - START) * 1e-9)
        motion = replace(ErrorMotion.unknown(5), theta=seen * unit if begin <= t < end else seen, times_ns=times)
        motion.components[:, 0] = 1e-12 * np.sin(50e-9 * (times - START))
        for place in (0, 1, 3, 4, 5):
            motion.observable[:, place] = True
            motion.covariance[:, place, place] = 1e-14
        found = push_error_motion(compensator, motion)
        used += [(time - START) * 1e-9 for block in found.offsets for time in block.times_ns.tolist()]
    used = np.array(used)
    assert not np.any((used > begin + 0.1) & (used < end))
    assert np.sum(used > end + 1.0) >= 0.95 * (END - end - 1.0) * 1e3
