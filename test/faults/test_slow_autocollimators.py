"""Autocollimators that are slow: they are believed, and displacement probes at 1 kHz beside them, over drawn stages."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from draws import seeds
from world import FAULTS, Options, Recording, make_recording, random_stage, with_probes
from world.recording import AUTOCOLLIMATOR

from faults.judging import judge
from faults.recordings import MOST_WRONG

RATES = (55.0, 60.0, 70.0, 85.0, 100.0)
"""Samples per s; slower ones are further apart than values are joined."""

STAGES = 60


def recorded(seed: int) -> Recording:
    """A stage with three heads or more and four probes, which makes some turns."""
    drawn = (random_stage(number) for number in range(1000 * seed, 1000 * seed + 1000))
    section = with_probes(next(each for each in drawn if len(each["encoder"]["heads"]) > 2), seed)
    motion = ("both_directions", "s_curves", "steady")[seed % 3]
    rates = {"/stage/autocollimator/samples": RATES[seed % len(RATES)]}
    options = Options(motion=motion, odd_rates=False, peak_speed=4.0, rates=rates)
    return make_recording(seed, duration=6.0, stage=section, options=options)


def test_sound_probes_are_rarely_doubted():
    """In no more than one stage of sixty: that with an axial probe whose readings scatter three times as described."""
    doubted = {}
    for seed in range(STAGES):
        found = judge(recorded(seed), recorded(seed).stage)
        assert found.worst <= MOST_WRONG, seed
        if reasons := [why for name, why in found.doubted.items() if "probe" in name]:
            doubted[seed] = reasons
    assert len(doubted) <= 1, doubted
    assert not [seed for seed in doubted if seed < 32], "none of those that were first looked at"


@cache
def of_high_order(seed: int) -> Recording:
    """A stage that tilts by an order of 5 to 9, and turns by up to a ninth to a sixth of a turn from one reading on."""
    generator, section = np.random.default_rng([seed, 5]), random_stage(seed)
    order, size = int(generator.integers(5, 10)), generator.uniform(1e-6, 2e-5)
    x, y = ((size * np.array([np.cos(at), np.sin(at)])).tolist() for at in generator.uniform(0.0, 2 * np.pi, 2))
    others = [row for row in section["spindle"]["tilt"] if row["order"] != order]
    section["spindle"]["tilt"] = [*others, {"order": order, "x": x, "y": y}]
    section["limits"] = {"speed": 150.0}
    rate = float(generator.uniform(56.0, 110.0))
    options = Options(
        motion=("both_directions", "s_curves", "indexing")[seed % 3],
        odd_rates=False,
        peak_speed=2 * np.pi * rate / float(generator.uniform(6.0, 9.0)),
        rates={AUTOCOLLIMATOR: rate},
        lvdt=False,
    )
    return make_recording(seed, duration=4.0, stage=section, options=options)


def test_high_orders_are_no_step_while_the_speed_rises():
    """What is described goes round by half a turn or more from one reading to the next: no interpolation tells it."""
    found = {seed: judge(of_high_order(seed), of_high_order(seed).stage) for seed in seeds(40)}
    steps = {seed: each.doubted.get("autocollimator", "") for seed, each in found.items()}
    assert not any("step" in why for why in steps.values()), steps
    assert np.mean([each.worst for each in found.values()]) <= MOST_WRONG
    assert np.mean([each.available["eac"] for each in found.values()]) > 0.85
    # the described orders are as large as 20 µrad, those that are not described some of it
    assert np.median([each.largest["eac"] for each in found.values()]) < 1e-5


@pytest.mark.parametrize(("size", "least"), [(3e-5, 0.6), (2e-4, 0.8)])
def test_a_step_of_such_an_autocollimator_is_told(size, least):
    """One of 0.2 mrad, or its tilt is not published; also one about as large as what is described of high orders."""
    wrong, told = [], []
    for seed in seeds(24):
        recording = of_high_order(seed)
        stepped = FAULTS["autocollimator_stepped"](recording, np.random.default_rng(seed), size=size)
        found = judge(stepped.recording, recording.stage)
        told.append("autocollimator" in found.doubted)
        wrong.append(found.worst)
    assert np.mean(told) > least, told
    assert size < 2e-4 or np.mean(wrong) <= MOST_WRONG, wrong
