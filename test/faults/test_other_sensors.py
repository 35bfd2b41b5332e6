"""Stages with other sensors than the paper's, by their description alone, on recordings of the independent world.

Random stages have two to six heads; here the autocollimator is missing as well.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from described_stages import stage_of
from pushed_inputs import push_block
from world import Options, Recording, make_recording, random_stage

from faults.judging import Judgement, judge
from faults.recordings import MOST_WRONG
from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.pipeline.estimation import Estimator

SEEDS = range(12)
DURATION = 6.0


@cache
def recorded(seed: int) -> Recording:
    """A stage with three heads or more, which makes some turns."""
    drawn = (random_stage(number) for number in range(1000 * seed, 1000 * seed + 1000))
    section = next(each for each in drawn if len(each["encoder"]["heads"]) > 2)
    motion = ("both_directions", "s_curves", "steady")[seed % 3]
    options = Options(motion=motion, odd_rates=False, peak_speed=4.0)
    return make_recording(seed, duration=DURATION, stage=section, options=options)


@cache
def judged(seed: int, *, tilt: bool) -> Judgement:
    """By the stage's own description, with or without its autocollimator."""
    section = {name: part for name, part in recorded(seed).stage.items() if tilt or name != "autocollimator"}
    return judge(recorded(seed), section)


@pytest.mark.few(4)
@pytest.mark.parametrize("seed", SEEDS)
def test_without_autocollimator_the_rest_is_as_right_as_with_it(seed):
    found, beside = judged(seed, tilt=False), judged(seed, tilt=True)
    assert found.worst <= MOST_WRONG
    assert found.available["eac"] == found.available["ebc"] == 0.0
    for name in ("exc", "eyc", "ecc"):
        assert found.available[name] >= beside.available[name] - 0.01
        assert found.largest[name] <= 1.05 * beside.largest[name]
    assert "autocollimator" not in found.doubted
    assert not found.estimator.status.absent


def test_heads_alone_are_rarely_published_less():
    """Over all stages: most have error motion for most of the time after their first turn."""
    available = [judged(seed, tilt=False).available["exc"] for seed in SEEDS]
    assert np.median(available) > 0.9


def test_streams_have_the_bits_of_the_contract_whatever_the_stage_has():
    section = dict(recorded(0).stage)
    del section["autocollimator"]
    estimator = Estimator(stage_of(section))
    heads = tuple(section["encoder"]["heads"])
    field = load_wire(heads).topic("error_motion_samples").field("streams")
    assert estimator.inputs == (*(f"head_{head}" for head in heads), "command")
    masks = []
    for _, topic, block in recorded(0).timeline():
        name = topic.split("/")[2]
        if name in estimator.inputs and len(block.rows):
            masks += [made.streams for made in push_block(estimator, name, block)]
    assert np.bitwise_or.reduce(np.concatenate(masks)) == field.mask(estimator.inputs)
