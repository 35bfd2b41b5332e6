"""How far off a held correction may be by now, as the compensation says it while the axes move on."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pushed_inputs import push_error_motion

from faults.machine_run import MACHINE, MS, START, Machine
from rotary_error_monitor.pipeline.compensation import CompensationSettings, Compensator
from rotary_error_monitor.plant.machine import MachinePlant, make_poses

LETTERS = [axis.letter for axis in MACHINE.axes]
STOPS_MS = 4000
"""When error motion ends: a turn of the slowest rotor is over."""


def left(machine: Machine, ms: int, applied: np.ndarray) -> float:
    """Distance, m, of the tool from where the machine as described wants it, with that correction, by the plant."""
    states = [machine.axis(letter, ms * 1e-3) for letter in LETTERS]
    positions, directions = np.array([[q for q, _ in states]]), np.sign([[v for _, v in states]])
    # as the compensation knows it: the last temperature that came
    poses = make_poses(MACHINE, positions, directions, np.array([machine.temperature((ms // 500) * 0.5)]))
    return float(np.linalg.norm(MachinePlant(MACHINE).tool_offset(poses, applied[None])[0, :3]))


@pytest.mark.parametrize("seed", range(31, 35))
def test_how_far_a_held_correction_is_off_is_said(seed):
    machine = Machine(seed)
    compensator = Compensator(MACHINE, CompensationSettings(hold_limit_ns=60_000 * MS))
    said, true = [], []
    for ms in range(0, STOPS_MS + 1500, 5):
        if ms % 500 == 0:
            compensator.push_temperature(machine.temperature(ms * 1e-3), START + ms * MS)
        if ms % 10 == 0:
            compensator.accept_joint_state(START + ms * MS, *machine.joint_state(ms * 1e-3))
        if ms < STOPS_MS:
            push_error_motion(compensator, machine.error_motion(ms))
        elif ms % 100 == 0:
            said.append(compensator.distance())
            true.append(left(machine, ms, np.asarray(compensator.state.applied)))
    assert np.allclose(said, true, rtol=0.02, atol=2e-8)
    assert max(true) > 1e-6, "the axes have moved on"


@pytest.mark.parametrize("named", [True, False])
def test_the_description_stands_in_only_where_the_monitored_axis_is_told(named):
    """By error motion, or by joint states: its position was taken for 0, and corrections were wrong by 3 µm."""
    machine, stood_in = Machine(11), []
    compensator = Compensator(MACHINE)
    for ms in range(0, STOPS_MS + 4000, 5):
        if ms % 500 == 0:
            compensator.push_temperature(machine.temperature(ms * 1e-3), START + ms * MS)
        if ms % 10 == 0:
            told = [{k: v for k, v in each.items() if named or k != "C"} for each in machine.joint_state(ms * 1e-3)]
            compensator.accept_joint_state(START + ms * MS, *told)
        if ms < STOPS_MS:
            push_error_motion(compensator, machine.error_motion(ms))
        else:
            stood_in += compensator.advance().corrections
    assert bool(stood_in) is named
    assert all(each.described for each in stood_in)
    assert math.isnan(compensator.distance()) is not named
