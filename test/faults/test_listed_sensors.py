"""Stages that list displacement probes, on recordings of the independent world: right, doubted where one is wrong."""

from __future__ import annotations

from functools import cache
from zlib import crc32

import numpy as np
import pytest
from world import PROBE_FAULTS, Options, Recording, make_recording, random_stage, with_probes

from faults.documenting import Row, shows
from faults.judging import Judgement, judge
from faults.recordings import MOST_WRONG

SEEDS = range(8)
DURATION, BEGIN = 6.0, 4.0
PLAIN = ("probe_stuck", "probe_gain_double")
"""Faults that no size drawn for them hides."""


@cache
def recorded(seed: int) -> Recording:
    """A stage with three heads or more and four probes, which makes some turns."""
    drawn = (random_stage(number) for number in range(1000 * seed, 1000 * seed + 1000))
    section = with_probes(next(each for each in drawn if len(each["encoder"]["heads"]) > 2), seed)
    motion = ("both_directions", "s_curves", "steady")[seed % 3]
    options = Options(motion=motion, odd_rates=False, peak_speed=4.0)
    return make_recording(seed, duration=DURATION, stage=section, options=options)


@cache
def judged(seed: int, *, tilt: bool = True, probes: bool = True) -> Judgement:
    left_out = {name for name, there in (("autocollimator", tilt), ("sensors", probes)) if not there}
    return judge(recorded(seed), {name: part for name, part in recorded(seed).stage.items() if name not in left_out})


@pytest.mark.parametrize("tilt", [True, False])
@pytest.mark.parametrize("seed", SEEDS)
def test_what_is_published_is_right(seed, tilt):
    found = judged(seed, tilt=tilt)
    assert found.worst <= MOST_WRONG
    assert not found.doubted.keys() & set(found.estimator.inputs[-4:])


def test_axial_error_motion_is_there_and_tilt_goes_on_without_autocollimator():
    for tilt in (True, False):
        found = [judged(seed, tilt=tilt) for seed in SEEDS]
        for name in ("ezc", "eac", "ebc"):
            assert np.median([each.available[name] for each in found]) > 0.9, (tilt, name)
    assert not any(judged(seed, tilt=False, probes=False).available["eac"] for seed in SEEDS)


def test_the_axial_error_motion_is_as_near_as_a_probe_on_the_axis_states():
    """Its largest error in standard deviations of form, zero, noise and step, which real noise exceeds now and then."""
    largest = []
    for seed in SEEDS:
        own = recorded(seed).stage["sensors"]["face"]
        stated = np.sqrt(own["uncertainty"] ** 2 + own["noise"] ** 2 + own["resolution"] ** 2 / 12)
        largest.append(judged(seed).largest["ezc"] / stated)
    assert np.median(largest) <= 6 and max(largest) <= 12


@shows(
    Row(
        "sensors",
        "A probe repeats a value, steps, drifts, is noisy, at the end of its range, twice as sensitive, stamped late, "
        "or falls silent",
        "`error_estimator: estimate` names it: stuck, a step that no bearing makes, so far from what other sensors say "
        "or from where it was a turn ago; samples at the end of a range and a silent stream are counted; noise and a "
        "drift slower than a bearing moves are not named",
        "the probe is left out; noise, and what other sensors did not see a turn ago, count as uncertainty",
        "what heads and autocollimator show as without probes; what the other probes determine",
        "after 0.5 s without contradiction, where it was before",
    )
)
@pytest.mark.parametrize("fault", sorted(PROBE_FAULTS))
def test_a_probe_that_fails_makes_nothing_wrong(fault):
    told = []
    for seed in range(4):
        rng = np.random.default_rng(crc32(f"{fault} {seed}".encode()))
        injected = PROBE_FAULTS[fault](recorded(seed), rng, begin=BEGIN, size=None, topic=None)
        found = judge(injected.recording, recorded(seed).stage)
        assert found.worst <= MOST_WRONG, (seed, injected.topics, injected.size)
        who = {topic.split("/")[2] for topic in injected.topics}
        listed = set(found.estimator.inputs[-4:])
        assert found.doubted.keys() & listed <= who
        told.append(bool(found.doubted.keys() & who))
        for name in ("exc", "eyc", "ecc"):  # as the heads have it, whatever a probe does
            assert found.available[name] >= judged(seed, probes=False).available[name]
    assert all(told) or fault not in PLAIN
