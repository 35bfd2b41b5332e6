"""Error motion that no such stage has makes no offset and no correction, whoever publishes it and in whatever unit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from faults.documenting import Row, shows
from hypothesis import given, settings
from hypothesis import strategies as st
from pipeline.test_compensation import MACHINE, joined, motion_block, run

from rotary_error_monitor.description.stage_limits import StageLimits
from rotary_error_monitor.metrology.error_motion import COMPONENTS
from rotary_error_monitor.pipeline.compensation import Compensator
from rotary_error_monitor.pipeline.motion_limits import LIMIT

LIMITS = StageLimits()
SEEN = (0, 1, 3, 4, 5)
MOST = LIMIT * np.array(LIMITS.components) + np.array([0, 0, 0, 0, 0, LIMITS.latency * LIMITS.speed])
BEGIN, END = 200, 300
"""When it is wrong, ms."""


def changed(place, value, first=BEGIN, last=END):
    """Blocks of error motion of which one component has another value for a while."""

    def block(ms):
        motion = motion_block(ms)
        own = (ms + np.arange(5) >= first) & (ms + np.arange(5) < last)
        components = motion.components.copy()
        components[own, place] = value
        # the command stays what it is: it is the rotation less the positioning
        theta = motion.theta + np.where(own & (place == 5), value - motion.components[:, 5], 0.0)
        return replace(motion, components=components, theta=theta)

    return block


def within(times, first=BEGIN, last=END):
    ms = (np.asarray(times) % 1_000_000_000) // 1_000_000
    return (ms >= first) & (ms < last)


@shows(
    Row(
        "messages",
        "Error motion that no such stage has: another stage's, in another unit, of a program that is broken",
        "`compensation: correction`: held, the component, its size and what the stage's limits allow",
        "a component beyond three times its limit in the stage's file and six of its deviations is not believed",
        "no offset and no correction of such ticks; others as before",
        "with the next tick that can be",
    )
)
@settings(max_examples=15, deadline=None)
@given(st.sampled_from(SEEN), st.floats(1.05, 1e6), st.sampled_from([-1.0, 1.0]))
def test_nothing_comes_of_what_the_stage_cannot_do(place, times, sign):
    compensator, reasons = Compensator(MACHINE), set()
    wrong = changed(place, sign * times * MOST[place])

    def block(ms):
        reasons.add(compensator.hold)
        return wrong(ms)

    offsets, corrections = run(compensator, blocks=block)
    stamps = joined(offsets)[0]
    assert not within(stamps).any() and (stamps % 1_000_000_000 >= END * 1_000_000).any()
    made = [each.stamp_ns for each in corrections]
    assert not within(made).any() and max(made) % 1_000_000_000 >= END * 1_000_000
    assert any(COMPONENTS[place] in reason and "another unit" in reason for reason in reasons)
    assert compensator.hold == ""


@pytest.mark.parametrize("place", SEEN)
def test_what_it_can_do_is_used(place):
    offsets, _ = run(Compensator(MACHINE), blocks=changed(place, 0.95 * MOST[place]))
    assert within(joined(offsets)[0]).sum() == END - BEGIN


def test_one_such_tick_does_not_take_the_others_along():
    offsets, _ = run(Compensator(MACHINE), blocks=changed(0, -1.0, BEGIN + 2, BEGIN + 3))
    stamps = joined(offsets)[0]
    assert within(stamps, BEGIN, BEGIN + 5).sum() == 4 and not within(stamps, BEGIN + 2, BEGIN + 3).any()


def test_the_limits_of_the_stage_count():
    wide = replace(LIMITS, tilt=1e-2)
    tilt = changed(3, 1e-2)
    assert not within(joined(run(Compensator(MACHINE), blocks=tilt)[0])[0]).any()
    assert within(joined(run(Compensator(MACHINE, limits=wide), blocks=tilt)[0])[0]).sum() == END - BEGIN
