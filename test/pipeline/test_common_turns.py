"""Heads that began to count some turns apart, one of which is missing for a moment: the rotation is the same."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from described_stages import stage_of
from draws import seeds
from faults.judging import Judgement, estimated, judge
from world import Options, Recording, make_recording, random_stage
from world.recording import COMMAND, head_topic

from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.common_turns import CommonTurns
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.signals.resampling import Resampled

TURN = 2 * np.pi
COUNT = 400
BITS = {"a": 1, "b": 2, "c": 4, "d": 8}
EVERYONE = sum(BITS.values())


def counted(readings: np.ndarray, there: np.ndarray, sizes: list[int]) -> np.ndarray:
    """(h, m) readings of heads by a common count, handed over so many ticks at once."""
    turns, parts, begin = CommonTurns(BITS), [], 0
    for size in sizes:
        chosen, none = slice(begin, begin + size), np.zeros((size, 1))
        sampled = {
            name: Resampled(row[chosen, None].copy(), none[:, 0], none, none, none[:, 0] == 0.0)
            for name, row in zip(BITS, readings, strict=True)
        }
        turns.take_out(sampled, there[chosen])
        parts.append(np.array([each.values[:, 0] for each in sampled.values()]))
        begin += size
    return np.concatenate(parts, axis=1)


@pytest.mark.parametrize("seed", range(40))
def test_whichever_heads_are_there_the_rotation_is_counted_alike(seed: int) -> None:
    """One head counts anew at a time, while it is there or while it is missing; one is heard later than the others."""
    rng = np.random.default_rng(seed)
    theta = rng.uniform(-50, 50) + np.cumsum(rng.uniform(-0.02, 0.05, COUNT))
    missing = np.zeros((4, COUNT), np.bool_)
    missing[rng.integers(4), : rng.integers(1, 50)] = True
    apart = np.repeat(rng.integers(-3, 4, 4)[:, None], COUNT, axis=1).astype(float)
    for begin in range(60, COUNT, 60):
        head = rng.integers(4)
        missing[head, begin : begin + rng.integers(1, 40)] = True
        if rng.random() < 0.5:
            apart[head, begin + rng.integers(20) :] += rng.integers(-2, 3)
    there = sum(BITS.values()) - missing.T @ np.array(list(BITS.values()))
    readings = theta + TURN * apart + 1e-5 * rng.normal(size=(4, COUNT))
    found = counted(readings, there, [COUNT])
    assert len({*np.rint((found - theta) / TURN)[~missing].tolist()}) == 1
    cuts = np.sort(rng.choice(np.arange(1, COUNT), 30, replace=False)).tolist()
    in_parts = counted(readings, there, np.diff([0, *cuts, COUNT]).tolist())
    assert np.array_equal(in_parts[~missing], found[~missing])


@pytest.mark.parametrize("seed", range(10))
def test_heads_about_half_a_turn_apart_do_not_change_their_count_with_the_noise(seed: int) -> None:
    rng = np.random.default_rng(seed)
    theta = np.linspace(0.0, rng.uniform(-30, 30), COUNT)
    off = np.array([0.0, 0.5, 0.0, -0.5])[:, None] * TURN
    found = counted(theta + off + 1e-3 * rng.normal(size=(4, COUNT)), np.full(COUNT, 15), [COUNT])
    turns = np.rint((found - theta - off) / TURN)
    assert np.array_equal(turns, np.repeat(turns[:, :1], COUNT, axis=1))


DURATION = 10.0


@cache
def recorded(seed: int) -> Recording:
    """A random stage of four heads that makes whole turns, the drive of which follows its command later."""
    drawn = (random_stage(number) for number in range(1000 * seed, 1000 * seed + 1000))
    stage = next(each for each in drawn if len(each["encoder"]["heads"]) == 4)
    options = Options(
        motion="both_directions", odd_rates=False, peak_speed=3.0, drive_lag=1.5e-4, block_period=0.01, lost_blocks=0.0
    )
    return make_recording(seed, duration=DURATION, stage=stage, options=options)


def silent(recording: Recording, topic: str, begin: float, end: float) -> Recording:
    """No block of a topic from a time to another, s."""
    begin_ns, end_ns = (recording.start_ns + round(each * 1e9) for each in (begin, end))
    kept = [
        place
        for place, block in enumerate(recording.blocks[topic])
        if block.times_ns[-1] < begin_ns or block.times_ns[0] >= end_ns
    ]
    blocks = [recording.blocks[topic][place] for place in kept]
    return recording.with_topics({topic: (blocks, recording.arrivals[topic][kept])})


def turned(recording: Recording, head: str, turns: int, since: float = 0.0) -> Recording:
    """A head that counts so many turns more from a time (s) on."""
    topic, since_ns = head_topic(head), recording.start_ns + round(since * 1e9)
    blocks = [
        SampleBlock(block.stamp_ns, block.names, block.rows + [0.0, TURN * turns * bool(block.times_ns[0] >= since_ns)])
        for block in recording.blocks[topic]
    ]
    return recording.with_topics({topic: (blocks, recording.arrivals[topic])})


def motion_of(recording: Recording) -> ErrorMotion:
    return ErrorMotion.joined(estimated(recording, Estimator(stage_of(recording.stage)), lambda _: None))


def assert_alike(found: Judgement, before: Judgement) -> None:
    assert dict(found.doubted) == dict(before.doubted)
    assert dict(found.wrong) == dict(before.wrong)
    assert dict(found.available) == dict(before.available)


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", seeds(9))
def test_a_head_that_counts_other_turns_and_is_missing_for_a_moment_changes_nothing(seed: int) -> None:
    """What was seen as it was missing is held against the command once that comes back from a silence."""
    rng, recording = np.random.default_rng(seed), recorded(seed)
    heads = [*recording.stage["encoder"]["heads"]]
    begin = rng.uniform(5.0, 7.0)
    gap = rng.uniform(0.02, 0.06)
    for head in (heads[0], *rng.choice(heads[1:], 1).tolist()):
        recording = silent(recording, head_topic(head), begin, begin + gap)
        begin += 0.2
    begin -= 0.2 - gap + rng.uniform(0.0, 0.05)
    recording = silent(recording, COMMAND, begin + 0.1, begin + 0.16)
    other = recording
    for head, turns in zip(heads, rng.permutation([-1, 0, 1, 2]).tolist(), strict=True):
        other = turned(other, head, turns)
    assert_alike(judge(other, other.stage), judge(recording, recording.stage))
    one, two = motion_of(recording), motion_of(other)
    assert np.array_equal(one.times_ns, two.times_ns)
    np.testing.assert_allclose(two.components, one.components, rtol=0.0, atol=1e-12)


@pytest.mark.few(2)
@pytest.mark.parametrize("seed", seeds(9))
@pytest.mark.parametrize("turned_in", ["before", "silence"])
def test_heads_that_count_other_turns_than_the_command_show_the_same_delay(seed: int, turned_in: str) -> None:
    """Where turns are taken out the rotor has not moved: no speed, and no slope over it, comes of that."""
    rng, recording = np.random.default_rng([seed, 1]), recorded(seed)
    heads = [*recording.stage["encoder"]["heads"]]
    begin = rng.uniform(4.0, 6.0)
    for head in heads:
        recording = silent(recording, head_topic(head), begin, begin + 0.3)
    turns, other = int(rng.choice([-2, -1, 1, 2])), recording
    for head in heads:
        other = turned(other, head, turns, 0.0 if turned_in == "before" else begin + 0.15)
    found, before = judge(other, other.stage), judge(recording, recording.stage)
    assert found.estimator.status.turns == before.estimator.status.turns + turns
    assert not before.doubted
    assert_alike(found, before)
    delay = before.estimator.belief.command.delay
    assert delay > 1e-4
    assert found.estimator.belief.command.delay == pytest.approx(delay, abs=1e-6)
