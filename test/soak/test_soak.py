"""A short soak: right to the count wherever the stage has turned to, and no memory kept."""

from __future__ import annotations

import numpy as np
import pytest
from motion_numbers import numbers_of

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.pipeline.compensation import Compensator
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.testing import Cell

from .endurance import COUNTS, FIRST, SAMPLES, TURN, WARMTH, Stage, check_flat, endure, live

GROUPS = 900
"""Of six blocks each."""


@pytest.mark.few(1)
@pytest.mark.parametrize("counts", [10**9, 10_000 * TURN, -(10**9), 10**12])
def test_no_count_is_lost_however_far_the_stage_has_turned(counts):
    found = endure(GROUPS, counts)
    assert found.blocks == 6 * GROUPS
    assert found.estimates >= SAMPLES * GROUPS - 5, "all but the last, which wait for what comes next"
    assert found.worst < 0.5, "counts that a rotation is off; the four heads are rounded by as much"
    assert found.offsets > SAMPLES * GROUPS - 1000, "all but those of the turn against which the description is held"
    check_flat(found.memory)


@pytest.mark.long
def test_ten_thousand_turns_are_counted_to_the_count():
    """A hundred turns at a time go by unseen; between them, each count of the rotation is right."""
    stage, skip, seen = Stage(), 100 * TURN // (SAMPLES * COUNTS), 40
    estimator = Estimator(stage.description)
    counts, newest = 0, 0
    for burst in range(101):
        for group in range(burst * skip, burst * skip + seen):
            for name, block in stage.blocks(group).items():
                estimator.accept(name, block)
            for found in estimator.advance():
                off = np.abs(stage.off(found))
                assert (off < 0.5).all(), f"{off.max()} counts off after {group * SAMPLES * COUNTS} counts"
                counts, newest = counts + len(off), int(np.rint(found.theta[-1] / stage.step))
    assert newest > 10_000 * TURN > 10**9
    assert counts > 100 * 80, "estimates, of 200 at a time; a stream that was away counts again after 0.1 s"


@pytest.mark.long
def test_error_motion_and_offset_do_not_hang_on_the_turns():
    """The same stage 10,000 turns later: what differs is the rounding of the angle, far below a nanometre."""

    def run(counts):
        stage, machine = Stage(counts=counts), load_machine("xyzac_trt")
        estimator, compensator = Estimator(stage.description), Compensator(machine)
        compensator.push_temperature(WARMTH, FIRST)
        motion, offsets = [], []
        for group in range(400):
            if group % 2 == 0:
                compensator.accept_joint_state(*stage.joint_state(group, machine))
            for name, block in stage.blocks(group).items():
                estimator.accept(name, block)
            for made in estimator.advance():
                motion.append(numbers_of(made)[:, 1:])  # but for the rotation itself
                compensator.accept_error_motion(made)
            offsets += [block.rows[:, 1:7] for block in compensator.advance().offsets]
        return np.concatenate(motion), np.concatenate(offsets)

    motion, offsets = run(0)
    later, offsets_later = run(10_000 * TURN)
    assert len(motion) > 1990 and len(offsets) > 1000
    np.testing.assert_allclose(later, motion, rtol=1e-6, atol=1e-10)  # m and rad; columns of variances with it
    np.testing.assert_allclose(offsets_later, offsets, rtol=0, atol=1e-10)


@pytest.mark.long
def test_nodes_on_simulated_time():
    with Cell() as cell:
        found = live(cell, 2000, 10_000 * TURN)
    assert found.estimates >= SAMPLES * 1900
    assert found.worst < 0.5
    for memory in found.memory.values():
        check_flat(memory, since=0.4)
