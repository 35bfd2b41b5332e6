"""Error motion that cannot be as it says is not believed: by its covariance, whatever its components are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from faults.documenting import Row, shows
from pipeline.test_compensation import MACHINE, joined, motion_block, run
from pipeline.test_motion_limits import BEGIN, END, within

from rotary_error_monitor.metrology.error_motion import COMPONENTS
from rotary_error_monitor.pipeline.compensation import Compensator
from rotary_error_monitor.pipeline.motion_checks import COVARIANCE, impossible


def stating(covariance, first=BEGIN, last=END):
    """Blocks of error motion that for a while state another covariance (row, column to value)."""

    def block(ms):
        motion = motion_block(ms)
        own = (ms + np.arange(5) >= first) & (ms + np.arange(5) < last)
        matrix = motion.covariance.copy()
        for (row, column), value in covariance.items():
            matrix[own, row, column] = matrix[own, column, row] = value
        return replace(motion, covariance=matrix)

    return block


IMPOSSIBLE = {
    "exc varies by less than nothing": {(0, 0): -1.0},
    "by a little less than nothing": {(0, 0): -1e-30},
    "eac too": {(3, 3): -1e-12},
    "exc and eyc more together than alone": {(0, 1): 1e-12},
    "exactly known, and it varies with another": {(0, 0): 0.0, (0, 1): 1e-16},
    "three of which each two could be": {(0, 1): 1.2e-14, (0, 5): 2.7e-14, (1, 5): -3.8e-14},
    "far beyond all numbers": {(0, 1): 1e300, (0, 0): 1e-300},
}


@shows(
    Row(
        "messages",
        "Error motion with a covariance that cannot be: a variance below zero, two components that vary more together "
        "than each alone",
        "`compensation: correction`: held, the components and what is said of them; `refused_error_motion` counts",
        "a tick is believed only if its covariance has no eigenvalue below zero, beside rounding",
        "no offset and no correction of such ticks; others as before",
        "with the next tick that can be",
    )
)
@pytest.mark.parametrize("covariance", IMPOSSIBLE.values(), ids=IMPOSSIBLE)
def test_nothing_comes_of_a_covariance_that_cannot_be(covariance):
    compensator, reasons = Compensator(MACHINE), set()
    wrong = stating(covariance)

    def block(ms):
        reasons.add(compensator.hold)
        return wrong(ms)

    offsets, corrections = run(compensator, blocks=block)
    stamps = joined(offsets)[0]
    assert not within(stamps).any() and (stamps % 1_000_000_000 >= END * 1_000_000).any()
    assert not within([each.stamp_ns for each in corrections]).any()
    place = next(iter(covariance))[0]
    assert any(COMPONENTS[place] in reason and "variance" in reason for reason in reasons)
    assert compensator.refused_motion == {COVARIANCE: END - BEGIN}
    assert compensator.hold == ""


def test_one_such_tick_does_not_take_the_others_along():
    compensator = Compensator(MACHINE)
    stamps = joined(run(compensator, blocks=stating({(0, 0): -1.0}, BEGIN + 2, BEGIN + 3))[0])[0]
    assert within(stamps, BEGIN, BEGIN + 5).sum() == 4 and not within(stamps, BEGIN + 2, BEGIN + 3).any()
    assert compensator.refused_motion[COVARIANCE] == 1


def test_what_is_not_observable_says_nothing_and_is_allowed():
    offsets, _ = run(Compensator(MACHINE), blocks=lambda ms: motion_block(ms, observable=0b000011))
    assert within(joined(offsets)[0]).sum() == END - BEGIN


@pytest.mark.parametrize("seed", range(20))
def test_any_covariance_that_is_one_is_believed_however_few_sensors_it_rests_on(seed):
    """Of one to six independent readings, with deviations that differ by ten orders, rounded as on the wire."""
    rng = np.random.default_rng(seed)
    motion = motion_block(0, 2000)
    rank = rng.integers(1, 7)
    deviations = 10.0 ** rng.uniform(-12, -2, (2000, 6)) * motion.observable
    readings = rng.normal(size=(2000, 6, rank)) * deviations[:, :, None]
    covariance = readings @ readings.swapaxes(1, 2)
    assert impossible(replace(motion, covariance=covariance)) is None
    exact = rng.integers(0, 6)  # a component that is known exactly
    covariance[:, exact] = covariance[:, :, exact] = 0.0
    assert impossible(replace(motion, covariance=covariance)) is None
