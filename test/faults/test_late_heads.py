"""Two neighbouring heads that are late alike, as two channels of one card: no third head contradicts both."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from described_stages import stage_of
from world import Options, Recording, make_recording, random_stage
from world.fault import shifted
from world.recording import head_topic

from faults.documenting import Row, shows
from faults.judging import Judgement, judge
from faults.recordings import MOST_WRONG

SEEDS = range(6)
DURATION = 12.0
MOTIONS = ("both_directions", "indexing", "oscillation")
UNCERTAINTY = {"encoder.eccentricity": 1e-8, "mirror.tilt": 1e-7}
UNSEEN = 0.2
"""Part of the recordings, some seconds, in which the speed must have changed for what goes with it to be seen."""


@cache
def recorded(seed: int) -> Recording:
    """A random stage with four heads."""
    drawn = (random_stage(number) for number in range(1000 * seed, 1000 * seed + 1000))
    stage = next(each for each in drawn if len(each["encoder"]["heads"]) == 4)
    options = Options(motion=MOTIONS[seed % len(MOTIONS)], odd_rates=False, peak_speed=2.0)
    return make_recording(seed, duration=DURATION, stage=stage, options=options)


@cache
def judged(seed: int, delay: float) -> Judgement:
    """Two neighbours' stamps are off by a delay (s); the description is calibrated, so that nothing else is unsure."""
    recording = recorded(seed)
    places = {name: head["azimuth"] for name, head in recording.stage["encoder"]["heads"].items()}
    pair = [head_topic(name) for name in sorted(places, key=lambda name: float(np.mod(places[name], 2 * np.pi)))[:2]]
    shift = -round(delay * 1e9)
    late = recording.with_topics({each: shifted(recording, each, recording.start_ns, shift) for each in pair})
    return judge(late if shift else recording, dict(recording.stage) | {"uncertainty": UNCERTAINTY})


@shows(
    Row(
        "heads",
        "Two neighbouring heads are stamped 0.1 ms off alike, so that no other head contradicts them",
        "`error_estimator: estimate` says by how many ms, once the speed has changed for some seconds: the ring is "
        "displaced in proportion to it",
        "what goes with the speed counts as uncertainty of the radial motion and of the rotation",
        "everything; before that, and after a single start as long as the speed stays as it is, a radial motion and a "
        "positioning that are off by half of the delay times the speed",
        "when a change of speed shows no delay",
    )
)
@pytest.mark.parametrize("delay", [-1e-4, 1e-4])
def test_heads_that_are_late_alike_are_uncertain(delay):
    for seed in SEEDS:
        found = judged(seed, delay)
        assert max(found.wrong["exc"], found.wrong["eyc"]) <= MOST_WRONG, (seed, found.wrong)
        assert found.wrong["ecc"] <= UNSEEN, (seed, found.wrong)


def test_heads_in_time_are_as_certain_as_ever():
    for seed in SEEDS:
        belief = judged(seed, 0.0).estimator.belief
        limits = stage_of(recorded(seed).stage).limits
        assert belief.ring.apart < 0.03 * limits.latency, seed


def test_how_far_apart_they_are_is_told():
    """As a share of the delay that follows from where the two heads sit: half of it, turned by the layout's angle."""
    beliefs = [judged(seed, 1e-4).estimator.belief for seed in SEEDS]
    told = [belief.ring.apart for belief in beliefs if not belief.ring.doubt]
    assert len(told) >= len(SEEDS) // 2
    assert all(0.4e-4 < apart < 1.5e-4 for apart in told), told
