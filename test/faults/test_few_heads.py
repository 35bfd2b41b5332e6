"""Three heads, which no other contradicts: what stamps make of a sound stage is no step, over drawn stages."""

from __future__ import annotations

import pytest
from draws import seeds
from world import Options, Recording, make_recording, random_stage

from faults.judging import Judgement, judge
from faults.recordings import MOST_WRONG

MOTIONS = ("both_directions", "s_curves", "steady", "indexing")
STAGES = seeds(16)


def recorded(seed: int, jitter: float) -> Recording:
    """A stage with three heads, whose stamps scatter by so much (s), at 1 or 4 rad/s at most."""
    drawn = (random_stage(number) for number in range(1000 * seed, 1000 * seed + 1000))
    section = next(each for each in drawn if len(each["encoder"]["heads"]) == 3)
    speed = (1.0, 4.0)[seed // 4 % 2]
    options = Options(motion=MOTIONS[seed % 4], peak_speed=speed, stamp_jitter=jitter, lost_blocks=0.0)
    return make_recording(seed, duration=5.0, stage=section, options=options)


@pytest.fixture(scope="module", params=[1e-6, 4e-6])
def judged(request: pytest.FixtureRequest) -> list[Judgement]:
    recordings = (recorded(seed, request.param) for seed in STAGES)
    return [judge(each, each.stage) for each in recordings]


def test_sound_instruments_are_believed(judged):
    """Heads that were not would wait for a reset."""
    assert not [found.doubted for found in judged if found.doubted]


def test_their_error_motion_is_published(judged):
    available = [found.available["exc"] for found in judged]  # slow streams begin and end late
    assert min(available) > 0.9 and sum(available) > 0.98 * len(available)
    assert max(found.worst for found in judged) <= MOST_WRONG
