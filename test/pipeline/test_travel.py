"""The direction of travel, held against the play of a drive: it turns once half of the play is taken up."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.pipeline.joints import JointTrack
from rotary_error_monitor.pipeline.travel import TravelDirections

MACHINE = load_machine("xyzac_trt")
HALF = [0.5 * axis.reversal for axis in MACHINE.axes]
MS = 1_000_000


def side_of_the_slot(path, first):
    """Side of a slot of width 1 that a pin touched last on its path from 0: the play operator of hysteresis."""
    slot, side, sides = (-1.0 if first > 0 else 0.0), first, []
    for here in path:
        if here > slot + 1.0 + 1e-9:
            slot, side = here - 1.0, 1.0
        elif here < slot - 1e-9:
            slot, side = here, -1.0
        sides.append(side)
    return np.array(sides)


@given(st.lists(st.floats(-3.0, 3.0).filter(lambda step: abs(step) > 1e-2), min_size=2, max_size=40))
def test_an_axis_has_turned_once_half_of_its_play_is_taken_up(steps):
    """Steps in multiples of that half; the first puts the pin to its side."""
    travel, still = TravelDirections(MACHINE), np.zeros(len(HALF))
    found = [travel.move(np.array(HALF) * step, still).copy() for step in steps]
    expected = side_of_the_slot(np.cumsum(steps), np.sign(steps[0]))
    np.testing.assert_array_equal(np.array(found), np.outer(expected, np.ones(len(HALF))))


@pytest.mark.parametrize("speed", [0.0, 3e-7, -3e-7])
def test_a_joint_that_dithers_keeps_its_direction(speed):
    """By a count to and fro, with the speeds that a controller makes of it, after it came from one side."""
    generator = np.random.default_rng(3)
    track = JointTrack(MACHINE, 0, 100 * MS)
    for k in range(100):
        x = 1e-5 * min(k, 20) + 2e-7 * generator.choice([-1, 1])
        position = dict.fromkeys(MACHINE.letters, 0.0) | {"X": x}
        assert track.push(k * 4 * MS, position, {"X": speed * generator.choice([-1, 1])})
    ticks = np.arange(10, 99) * 4 * MS
    assert (track.at(ticks).directions[:, 0] == 1.0).all()


def test_an_axis_that_goes_back_in_small_steps_has_turned():
    track = JointTrack(MACHINE, 0, 100 * MS)
    for k in range(200):
        x = 1e-5 * k if k < 20 else 1.9e-4 - 1e-7 * (k - 20)
        track.push(k * 4 * MS, dict.fromkeys(MACHINE.letters, 0.0) | {"X": x}, {})
    directions = track.at(np.arange(1, 199) * 4 * MS).directions[:, 0]
    turned = int(np.flatnonzero(directions < 0)[0]) + 1
    assert 20 + 6 <= turned <= 20 + 8, "half its reversal of 1.2 µm is 6 steps wide"
    assert (directions[turned:] < 0).all()
