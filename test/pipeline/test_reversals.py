"""Axes that turn back between two joint states: what is said of the tool's position holds for either direction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from faults.documenting import Row, shows
from pushed_inputs import push_error_motion, push_joint_state

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.compensation import CompensationSettings, Compensator
from rotary_error_monitor.plant.machine import MachinePlant, make_poses

MACHINE = load_machine("xyzac_trt")
START = 1_763_700_000_000_000_000
MS = 1_000_000
PERIOD, BLOCK = 10, 5
"""Of joint states and of blocks of error motion, ms."""


class BackAndForth:
    """One axis on trapezoids of speed between two places; the others stand."""

    def __init__(self, seed):
        draw = np.random.default_rng(seed)
        self.axis = draw.choice(list("XYZA"))
        described = next(axis for axis in MACHINE.axes if axis.letter == self.axis)
        self.quickest = described.quickest * draw.uniform(0.2, 1.0)
        self.feed = described.fastest * np.exp(draw.uniform(np.log(2e-3), np.log(0.5)))
        self.cruise = draw.uniform(0.2, 1.0)
        self.ramp = self.feed / self.quickest
        half = self.cruise + 2 * self.ramp
        corners = np.cumsum([0, self.ramp, self.cruise, 2 * self.ramp, self.cruise, self.ramp])
        self.corners, self.speeds = corners, self.feed * np.array([0, 1, 1, -1, -1, 0])
        self.period = 2 * half
        self.begin = draw.uniform(0, self.period)
        self.age_ms = int(draw.integers(1, 8))
        self.times = np.union1d(np.linspace(0, self.period, 4001), self.corners)
        speed = np.interp(self.times, self.corners, self.speeds)
        self.path = np.concatenate([[0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(self.times))])

    def at(self, t):
        """Positions and speeds, (n, axes)."""
        phase = np.mod(np.asarray(t, float) + self.begin, self.period)
        letters = MACHINE.letters
        q, v = np.zeros((len(phase), len(letters))), np.zeros((len(phase), len(letters)))
        q[:, letters.index(self.axis)] = np.interp(phase, self.times, self.path) - 0.5 * self.path.max()
        v[:, letters.index(self.axis)] = np.interp(phase, self.corners, self.speeds)
        return q, v


def motion_block(first_ms):
    """A rotor that stands, without error motion."""
    times = START + (first_ms + np.arange(BLOCK)) * MS + MS // 2
    motion = replace(ErrorMotion.unknown(BLOCK), times_ns=times)
    seen = [0, 1, 3, 4, 5]
    motion.observable[:, seen] = True
    motion.covariance[:, seen, seen] = np.array([5e-9, 5e-9, 5e-8, 5e-8, 5e-8]) ** 2
    return motion


def reports(motion, duration_ms=3000, machine=MACHINE):
    compensator, found = Compensator(machine), []
    compensator.push_temperature(MACHINE.reference_temperature, START)
    for ms in range(0, duration_ms, BLOCK):
        found += push_error_motion(compensator, motion_block(ms)).corrections
        stamp = ms - motion.age_ms
        stamp -= stamp % PERIOD
        if ms % PERIOD == 0 and stamp >= 0:
            (q,), (v,) = motion.at([stamp * 1e-3])
            state = [dict(zip(MACHINE.letters, each.tolist(), strict=True)) for each in (q, v)]
            found += push_joint_state(compensator, START + stamp * MS, *state).corrections
    return [(each.stamp_ns, each.report) for each in found if each.report is not None]


@shows(
    Row(
        "joints",
        "An axis turns back after its last joint state",
        "the report's covariance holds the reversal error wherever the axis' acceleration allows it",
        "the next joint state tells the direction; corrections go to it at the rate limit",
        "corrections for the direction before; what they leave is uncertain by the reversal error",
        "with the next joint state that is used (`joint_lag`, 30 ms)",
    ),
)
def test_a_reversal_is_within_what_is_said():
    plant, count, wrong, large = MachinePlant(MACHINE), 0, [], 0
    for seed in range(12):
        motion = BackAndForth(seed)
        found = [each for each in reports(motion) if each[0] > START + 100 * MS]
        stamps = np.array([stamp for stamp, _ in found])
        q, v = motion.at((stamps - START) * 1e-9)
        live = np.tile([0.0, 0.0, np.nan, 0.0, 0.0, 0.0], (len(stamps), 1))
        poses = make_poses(MACHINE, q, np.sign(v), np.full(len(q), MACHINE.reference_temperature))
        true = plant.tool_offset(poses, None, live)
        offset = np.array([report.offset for _, report in found])
        deviation = np.sqrt([np.diag(report.covariance) for _, report in found])
        off = np.abs(offset - true)[:, :3].max(axis=1)
        ratio = (np.abs(offset - true) / deviation)[:, :3].max(axis=1)
        count += len(found)
        large += int((off > 0.3e-6).sum())
        wrong += [(seed, motion.axis, motion.feed, each) for each in ratio[ratio > 6.0]]
    assert large >= 10, "reversals between two joint states are there"
    assert len(wrong) <= 0.002 * count, (count, wrong)


@pytest.mark.parametrize(("feed", "may_have_turned"), [(0.4, False), (0.03, True)])
def test_how_uncertain_the_direction_is(feed, may_have_turned):
    """An axis that needs longer to stop than its joint state is old has its direction; a slow one may have turned."""
    motion = BackAndForth(1)
    motion.age_ms = 1
    motion.at = lambda t: (
        np.outer(feed * np.asarray(t, float) - 0.1, [1.0, 0, 0, 0, 0]),
        np.outer(np.full(len(t), feed), [1.0, 0, 0, 0, 0]),
    )
    axes = tuple(replace(axis, reversal=0.0) for axis in MACHINE.axes)
    found = [reports(motion, 600, machine)[-1] for machine in (MACHINE, replace(MACHINE, axes=axes))]
    assert found[0][0] == found[1][0]
    variance = [report.covariance[0, 0] for _, report in found]
    x = MACHINE.axes[0]
    since = CompensationSettings().joint_lag_ns * 1e-9 + np.array([0.0, 1e-3 * PERIOD]) + 0.5e-3 * PERIOD
    part = 0.5 * (1.0 - feed / (x.quickest * since))
    low, high = np.maximum(part, 0.0) * x.reversal**2
    more, rounding = variance[0] - variance[1], 1e-20
    assert (more > rounding) == may_have_turned
    assert low - rounding <= more <= high + rounding
