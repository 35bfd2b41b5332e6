"""Heads of 60 to 250 Hz on stages whose acceleration jumps: what lies between their samples is no fault of a head."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from draws import seeds
from world import FAULTS, Options, Recording, make_recording, random_stage
from world.fault import stepped
from world.options import RAMPS
from world.recording import AUTOCOLLIMATOR, COMMAND, head_topic

from faults.judging import judge
from faults.recordings import MOST_WRONG
from faults.test_sampled_commands import jumping

RATES = (60.0, 100.0, 250.0)


@cache
def recorded(seed: int) -> Recording:
    """A recording of heads with hardly any noise, or as usual."""
    generator, section = np.random.default_rng([seed, 3]), random_stage(seed)
    if seed % 4 < 2:
        section["encoder"] |= {"noise": 1e-9, "counts_per_line": 1_000_000}
    heads = dict.fromkeys(map(head_topic, section["encoder"]["heads"]), RATES[seed % len(RATES)])
    rates = {COMMAND: 1000.0, AUTOCOLLIMATOR: 200.0, **heads}
    habits = jumping(seed, Options.textbook(noise=1.0), generator, ramps=RAMPS[1 + seed % 2], rates=rates)
    return make_recording(seed, duration=3.0, stage=section, options=habits)


def test_what_lies_between_two_samples_of_a_head_is_no_fault():
    """At 60 Hz a ramp that is shorter than two samples may still leave more than a single jump of acceleration does."""
    found = {seed: judge(recorded(seed), recorded(seed).stage) for seed in seeds(36)}
    doubted = {seed: dict(each.doubted) for seed, each in found.items() if each.doubted}
    assert len(doubted) <= 0.1 * len(found), doubted
    assert not any("heads" in each or "command" in each for each in doubted.values()), doubted
    assert np.mean([each.worst for each in found.values()]) <= MOST_WRONG


def test_nor_is_it_where_no_command_is_heard():
    """What interpolation misses of the heads was none there: the ring was beyond its limits on 2 stages of 18."""
    for seed in seeds(18):
        silent = recorded(seed).with_topics({COMMAND: ([], np.zeros(0, np.int64))})
        assert not judge(silent, silent.stage).doubted


@cache
def among_fast(seed: int, rate: float) -> Recording:
    """One head of a low rate beside others of 1 kHz, all of them with noise as usual or hardly any."""
    generator, section = np.random.default_rng([seed, 3]), stage_with_redundancy(seed)
    if seed % 4 < 2:
        section["encoder"] |= {"noise": 1e-9, "counts_per_line": 1_000_000}
    heads = list(map(head_topic, section["encoder"]["heads"]))
    rates = {COMMAND: 1000.0, AUTOCOLLIMATOR: 200.0, **dict.fromkeys(heads, 1000.0), slow_of(heads, seed): rate}
    habits = jumping(seed, Options.textbook(noise=1.0), generator, ramps=RAMPS[1 + seed % 2], rates=rates)
    return make_recording(seed, duration=3.0, stage=section, options=habits)


def stage_with_redundancy(seed: int) -> dict[str, Any]:
    """A random stage with four heads or more."""
    drawn = (random_stage(100 * seed + number) for number in range(100))
    return next(each for each in drawn if len(each["encoder"]["heads"]) >= 4)


def slow_of(heads: list[str], seed: int) -> str:
    """The head of the low rate."""
    return heads[seed % len(heads)]


def test_a_slow_head_beside_fast_ones_is_no_fault():
    """Fast heads follow each ramp that it misses: of these stages 15 were doubted, the ring or the head."""
    found = {seed: judge(among_fast(seed, rate), among_fast(seed, rate).stage) for seed, rate in slow_heads(24)}
    doubted = {seed: dict(each.doubted) for seed, each in found.items() if each.doubted}
    assert len(doubted) <= 0.25 * len(found), doubted
    assert np.mean([each.worst for each in found.values()]) <= MOST_WRONG


def slow_heads(most: int) -> list[tuple[int, float]]:
    """Seeds and rates: 25 ms is the longest distance of samples that are joined."""
    return [(seed, (40.0, 50.0)[seed % 2]) for seed in seeds(most)]


def test_a_slow_head_that_is_off_is_told_beside_fast_ones():
    told, wrong = [], []
    for seed, rate in slow_heads(16):
        sound = among_fast(seed, rate)
        slow = slow_of(sound.head_topics, seed)
        off = sound.with_topics({slow: stepped(sound, slow, 3e-4 * (-1) ** seed, 1.5)})
        found = judge(off, sound.stage)
        told.append("heads" in found.doubted or slow.split("/")[2] in found.doubted)
        wrong.append(found.worst)
    assert np.mean(told) > 0.8, told
    assert np.mean(wrong) <= MOST_WRONG, wrong


@pytest.mark.parametrize("fault", ["head_jumps_line", "head_late"])
def test_a_head_that_is_off_is_told_all_the_same(fault):
    told, wrong = [], []
    for seed in seeds(24):
        changed = FAULTS[fault](recorded(seed), np.random.default_rng(seed))
        found = judge(changed.recording, recorded(seed).stage)
        told.append(any(name.startswith("head") for name in found.doubted))
        wrong.append(found.worst)
    assert np.mean(told) > 0.8, told
    assert np.mean(wrong) <= MOST_WRONG, wrong


@pytest.mark.parametrize("which", ["heads", "command"])
def test_a_step_of_all_heads_or_of_the_command_is_told_wherever_it_falls(which):
    """Also between two samples, and while the stage is accelerated."""
    told, wrong = [], []
    for seed in seeds(18):
        recording, draw = recorded(seed), np.random.default_rng([seed, 77])
        off, begin = float(draw.choice([3e-4, -3e-4, 4e-4, -5e-4])), float(draw.uniform(1.0, 2.5))
        topics = recording.head_topics if which == "heads" else [COMMAND]
        changed = {topic: stepped(recording, topic, off, begin) for topic in topics}
        found = judge(recording.with_topics(changed), recording.stage)
        told.append("command" in found.doubted or "heads" in found.doubted)
        wrong.append(found.worst)
    assert np.mean(told) > 0.8, told
    assert max(wrong) <= 0.1 / 3.0, wrong
    assert np.mean(wrong) <= 2.0 * MOST_WRONG, "it is told within some of their samples"
