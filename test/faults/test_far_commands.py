"""A command that is off by an angle from the first sample on, as of a drive that was set up anew."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from described_stages import stage_of
from draws import seeds
from world import Options, Recording, make_recording, random_stage
from world.fault import stepped
from world.recording import COMMAND

from faults.judging import Judgement, judge
from faults.recordings import MOST_WRONG

PEAK_SPEED = 4.0
DURATION = 4.0


@cache
def recorded(seed: int) -> Recording:
    """A stage that begins at rest, and changes its speed."""
    motion = ("both_directions", "s_curves", "indexing")[seed % 3]
    options = Options(motion=motion, odd_rates=False, peak_speed=PEAK_SPEED, lvdt=False)
    return make_recording(seed, duration=DURATION, stage=random_stage(seed), options=options)


def judged(seed: int, end: float = np.inf, back: float = 1.0) -> Judgement:
    """Its command is off by more than a following error, and no more than latency makes of its speed besides; up to
    an `end` (s), at which it goes `back` by some part of that."""
    recording, draw = recorded(seed), np.random.default_rng([seed, 9])
    limits = stage_of(recording.stage).limits
    most = limits.following_error + limits.latency * PEAK_SPEED
    off = draw.choice([-1.0, 1.0]) * draw.uniform(1.2 * limits.following_error, max(most, 2 * limits.following_error))
    changed = stepped(recording, COMMAND, off, -1.0)
    if np.isfinite(end):
        changed = stepped(recording.with_topics({COMMAND: changed}), COMMAND, -back * off, end)
    return judge(recording.with_topics({COMMAND: changed}), recording.stage)


def test_what_is_told_at_rest_is_no_latency_while_it_turns():
    """Of the shipped stage 1 mrad were believed at 3 rad/s, and the tool was wrong by 120 µm in place of 10."""
    found = {seed: judged(seed) for seed in seeds(24)}
    assert np.mean([each.worst for each in found.values()]) <= MOST_WRONG, {s: f.wrong for s, f in found.items()}
    assert np.mean(["command" in each.doubted for each in found.values()]) > 0.9
    assert not any("head" in name for each in found.values() for name in each.doubted)


@pytest.mark.parametrize("end", [1.1, 2.2])
def test_it_is_believed_within_a_second_of_being_right(end):
    """Whatever the speed: the step back tells it, where a latency would hide the rest."""
    found = [judged(seed, end) for seed in seeds(12, first=12 * round(end))]
    assert np.mean([each.worst for each in found]) <= MOST_WRONG
    least = (DURATION - end - 1.0) / DURATION
    assert np.mean([each.available["ecc"] > least for each in found]) > 0.95


@pytest.mark.parametrize("back", [-1.0, 0.1, 2.2, 4.0])
def test_a_step_that_leaves_it_wrong_is_no_return(back):
    """Away, by too little, or beyond: what is left is more than a following error."""
    found = {seed: judged(seed, 1.5, back) for seed in seeds(16, first=40)}
    assert np.mean([each.worst for each in found.values()]) <= MOST_WRONG, {s: f.wrong for s, f in found.items()}
