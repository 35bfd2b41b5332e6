"""Stages with a second autocollimator, on recordings of the independent world: right, doubted where it is wrong."""

from __future__ import annotations

from functools import cache
from zlib import crc32

import numpy as np
import pytest
from described_stages import stage_of
from world import TILT_FAULTS, Options, Recording, make_recording, random_stage, with_probes, with_tilt_sensor

from faults.documenting import Row, shows
from faults.judging import Judgement, judge
from faults.recordings import MOST_WRONG

SEEDS = range(8)
DURATION, BEGIN = 6.0, 4.0
SECOND = "tilt_sensor_second"
PLAIN = ("tilt_sensor_stuck", "tilt_sensor_gain_double", "tilt_sensor_axes_swapped", "tilt_sensor_unlit")
"""Faults that no size drawn for them hides where the autocollimator sees the same."""

ALONE = tuple(f"tilt_sensor_{fault}" for fault in ("stuck", "noisy", "saturated", "unlit", "dead_later"))
"""Faults that a sensor shows by itself: a step or a drift may be the bearing's where nothing else shows the tilt."""


@cache
def recorded(seed: int, *, probes: bool = False) -> Recording:
    """A stage with three heads or more and a second autocollimator, which makes some turns."""
    drawn = (random_stage(number) for number in range(1000 * seed, 1000 * seed + 1000))
    section = next(each for each in drawn if len(each["encoder"]["heads"]) > 2)
    section = with_tilt_sensor(with_probes(section, seed) if probes else section, seed)
    motion = ("both_directions", "s_curves", "steady")[seed % 3]
    options = Options(motion=motion, odd_rates=False, peak_speed=4.0)
    return make_recording(seed, duration=DURATION, stage=section, options=options)


def described(seed: int, *, tilt: bool, second: bool = True, probes: bool = False) -> dict[str, object]:
    """Section of the recorded stage with its autocollimator or without, likewise the second one."""
    left_out = {name for name, there in (("autocollimator", tilt), ("sensors", second)) if not there}
    return {name: part for name, part in recorded(seed, probes=probes).stage.items() if name not in left_out}


@cache
def judged(seed: int, *, tilt: bool = True, second: bool = True, probes: bool = False) -> Judgement:
    return judge(recorded(seed, probes=probes), described(seed, tilt=tilt, second=second, probes=probes))


@pytest.mark.parametrize("probes", [False, True])
@pytest.mark.parametrize("tilt", [True, False])
@pytest.mark.parametrize("seed", SEEDS)
def test_what_is_published_is_right(seed, tilt, probes):
    found = judged(seed, tilt=tilt, probes=probes)
    assert found.worst <= MOST_WRONG
    listed = stage_of(recorded(seed, probes=probes).stage).sensors
    assert SECOND in listed and not found.doubted.keys() & set(listed)


def test_tilt_goes_on_without_autocollimator_and_is_checked_with_both():
    found = [judged(seed, tilt=False) for seed in SEEDS]
    for name in ("eac", "ebc"):
        assert np.median([each.available[name] for each in found]) > 0.9, name
    assert not any(judged(seed, tilt=False, second=False).available["eac"] for seed in SEEDS)


@shows(
    Row(
        "sensors",
        "A listed tilt sensor repeats a value, steps, drifts, is noisy, at the end of its range, twice as sensitive, "
        "unlit, stamped late, has its axes exchanged, or falls silent",
        "as a probe's; the message says which of its fields shows it",
        "the tilt sensor is left out as a whole; without autocollimator tilt is not published while it is doubted, and "
        "what a bearing could do, or old stamps, is not told",
        "what heads and autocollimator show as without it",
        "after 0.5 s without contradiction, where it was before",
    )
)
@pytest.mark.parametrize("fault", sorted(TILT_FAULTS))
def test_a_tilt_sensor_that_fails_makes_nothing_wrong(fault):
    told = []
    for seed in range(4):
        found = with_fault(fault, seed, tilt=True)
        assert found.worst <= MOST_WRONG, seed
        assert set(found.doubted) <= {SECOND}
        told.append(SECOND in found.doubted)
        for name in ("exc", "eyc", "eac", "ebc", "ecc"):  # as heads and autocollimator have it, whatever it does
            assert found.available[name] >= judged(seed, second=False).available[name]
    assert all(told) or fault not in PLAIN


@pytest.mark.parametrize("fault", ALONE)
def test_a_tilt_sensor_that_fails_alone_makes_next_to_nothing_wrong(fault):
    """Over all stages: it is told by windows, of which the first one of a fault is over before it is judged."""
    found = [with_fault(fault, seed, tilt=False) for seed in range(6)]
    assert np.mean([each.worst for each in found]) <= MOST_WRONG
    assert all(set(each.doubted) <= {SECOND} for each in found)


def with_fault(fault: str, seed: int, *, tilt: bool) -> Judgement:
    rng = np.random.default_rng(crc32(f"{fault} {seed}".encode()))
    injected = TILT_FAULTS[fault](recorded(seed), rng, begin=BEGIN, size=None, topic=None)
    return judge(injected.recording, described(seed, tilt=tilt))
