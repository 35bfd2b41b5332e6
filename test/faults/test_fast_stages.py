"""Healthy stages that turn fast: by a large part of a turn between two readings of a slow autocollimator."""

from __future__ import annotations

from functools import cache

import numpy as np
from draws import seeds
from world import random_stage

from faults.judging import Judgement, judge, record
from faults.recordings import MOST_WRONG

STAGES = seeds(15)
DURATION = 8.0
SPEEDS = 25.0, 60.0
"""Highest speeds that are drawn, rad/s: two to twenty readings of a slow autocollimator in a turn."""

STATED = 0.01
"""Part of the ticks of one stage at which a tilt may be off by more than is stated all the same: an order that goes
round nearly a whole number of times between two readings looks as if it stood still."""


@cache
def found(number: int) -> Judgement:
    """What the estimator makes of a healthy stage whose highest speed is drawn as well."""
    stage = random_stage(300 + number)
    return judge(record(300 + number, stage, DURATION, peak_speed=speed(number)), stage)


def speed(number: int) -> float:
    """Highest speed of a stage, rad/s."""
    return float(np.random.default_rng([number, 60]).uniform(*SPEEDS))


def test_what_is_published_of_a_fast_stage_is_as_sure_as_is_stated():
    """Of orders that pass between two readings the scatter from one reading to the next tells as much as there is."""
    wrong = {number: found(number).wrong for number in STAGES}
    assert np.mean([max(each.values()) for each in wrong.values()]) <= MOST_WRONG, wrong
    assert max(max(each.values()) for each in wrong.values()) <= STATED, wrong


def test_a_fast_stage_is_not_doubted():
    """Stamps of heads that are apart show as a displacement in proportion to the speed, within what they may be."""
    doubted = {number: dict(found(number).doubted) for number in STAGES}
    assert not any({"ring", "command", "heads"} & set(each) for each in doubted.values()), doubted
