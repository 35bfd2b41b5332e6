"""Error motion that stands to the last bit while the rotor turns is not believed; what may stand, is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from faults.documenting import Row, shows
from pipeline.test_compensation import MACHINE, START, joined, motion_block, run

from rotary_error_monitor.pipeline.compensation import Compensator
from rotary_error_monitor.pipeline.motion_checks import STANDS
from rotary_error_monitor.pipeline.motion_stands import LASTS_NS, MotionStands

BEGIN, END, UNTIL = 300, 2300, 3000
"""When it stands, and how long the run is, ms."""


def standing(values, seen=0b111011):
    """Blocks of error motion whose components stand for a while, theta being as commanded and these components say."""

    def block(ms):
        motion = motion_block(ms, observable=seen)
        own = (ms + np.arange(5) >= BEGIN) & (ms + np.arange(5) < END)
        components = np.where(own[:, None] & motion.observable, values, motion.components)
        theta = motion.theta - motion.components[:, 5] + components[:, 5]
        return replace(motion, components=components, theta=theta)

    return block


@shows(
    Row(
        "messages",
        "Error motion stands to the last bit while the rotor turns on, or a block of it comes again and again",
        "`compensation: correction`: held, error motion is the same to the last bit while the rotor turns",
        "not believed where all components, two at least, are those of so many ticks before for 0.5 s and 0.05 rad",
        "for up to 0.5 s corrections from what stands, then none",
        "with the first tick that differs",
    )
)
@pytest.mark.parametrize("values", [0.0, np.array([1e-6, -2e-6, 0.0, 5e-6, 4e-6, 3e-6])], ids=["zero", "as it was"])
def test_what_stands_is_held_and_said_within_a_second(values):
    compensator, reasons = Compensator(MACHINE), {}
    blocks = standing(values)

    def block(ms):
        reasons.setdefault(compensator.hold, ms)
        return blocks(ms)

    stamps = (joined(run(compensator, UNTIL, blocks=block)[0])[0] - START) * 1e-6
    (said,) = (ms for reason, ms in reasons.items() if STANDS in reason)
    assert BEGIN < said <= BEGIN + LASTS_NS * 1e-6 + 100
    assert not ((stamps > BEGIN + LASTS_NS * 1e-6 + 5) & (stamps < END)).any()
    assert (stamps > END).any() and (stamps < BEGIN + LASTS_NS * 1e-6).any()
    assert compensator.refused_motion.keys() == {STANDS}


def test_one_component_alone_may_stand():
    """One axial probe of coarse resolution: its reading may be the same for turns."""
    compensator = Compensator(MACHINE)
    offsets, _ = run(compensator, UNTIL, blocks=standing(1e-6, seen=0b000001))
    assert not compensator.refused_motion and len(joined(offsets)[0]) > UNTIL - 200


def stuck(components, theta, seen=0b111011, block=5):
    """How many of some ticks, 1 ms apart, stand for too long."""
    motion = motion_block(0, len(theta), observable=seen)
    motion = replace(motion, theta=theta, components=components * motion.observable)
    checks = MotionStands()
    found = [checks.judge(motion.at(slice(first, first + block))) for first in range(0, len(theta), block)]
    return sum(int(each.sum()) for each in found if each is not None)


@pytest.mark.parametrize("block", [1, 5, 7, 512])
@pytest.mark.parametrize("repeated", [2, 5, 25, 64])
def test_a_block_that_comes_again_and_again_stands_as_well(repeated, block):
    """A program that sends its last block anew, with the rotation of now."""
    moving = 1e-6 * np.random.default_rng(repeated).normal(size=(5000, 6))
    moving[1000:3000] = np.resize(moving[1000 : 1000 + repeated], (2000, 6))
    assert stuck(moving, 1.5e-3 * np.arange(5000), block=block) == pytest.approx(1500, abs=repeated + 1)


@pytest.mark.parametrize("seed", range(5))
def test_readings_of_coarse_instruments_come_back_by_chance(seed):
    """Each between two steps, so that any four of them come again within some ticks."""
    coarse = 1e-7 * np.random.default_rng(seed).integers(0, 2, (20_000, 6)).astype(float)
    assert stuck(coarse, 1.5e-3 * np.arange(20_000), seen=0b000011) == 0
    assert stuck(coarse, 1.5e-3 * np.arange(20_000)) == 0


@pytest.mark.few(3)
@pytest.mark.parametrize("block", [1, 5, 512])
@pytest.mark.parametrize("seed", range(5))
def test_at_rest_by_coarse_instruments_and_what_is_handed_on_twice_stands_by_right(seed, block):
    rng = np.random.default_rng(seed)
    t = 1e-3 * np.arange(5000)
    coarse = np.broadcast_to(1e-6 * rng.normal(size=6), (5000, 6))
    resting = 2.0 + 1e-6 * np.rint(rng.normal(size=5000))  # counts of heads
    assert stuck(coarse, resting, block=block) == 0
    moving = 1e-6 * rng.normal(size=(5000, 6))
    assert stuck(moving, 1.5 * t, block=block) == 0
    held = np.repeat(moving[::100], 100, axis=0)  # every tenth of a second a new one
    assert stuck(held, np.repeat(1.5 * t[::100], 100), block=block) == 0
    assert stuck(held, 1.5 * t, block=block) == 0
    assert stuck(coarse, 1.5 * t, block=block) == 4500


@pytest.mark.parametrize("block", [1, 7, 512])
def test_it_counts_while_the_rotor_comes_back_to_where_it_was(block):
    t = 1e-3 * np.arange(5000)
    assert stuck(np.full((5000, 6), 1e-6), 0.1 * np.sin(3.0 * t), block=block) == 4500
    assert stuck(np.full((5000, 6), 1e-6), 0.02 * np.sin(3.0 * t), block=block) == 0
