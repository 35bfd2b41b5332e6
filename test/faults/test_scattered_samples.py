"""Streams whose samples scatter about as far apart as is joined: what cannot be judged is not published."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from draws import seeds
from numpy.typing import NDArray
from world import Options, Recording, make_recording, random_stage
from world.fault import stepped
from world.recording import AUTOCOLLIMATOR, COMMAND, head_topic

from faults.documenting import Row, shows
from faults.judging import TURNING, judge
from faults.recordings import MOST_WRONG
from faults.test_sampled_commands import quickest
from rotary_error_monitor.pipeline.distance_reach import ACCELERATION
from rotary_error_monitor.pipeline.estimator_settings import MAX_GAP
from rotary_error_monitor.pipeline.stream_belief import BROKEN
from rotary_error_monitor.signals.blocks import SampleBlock

DURATION = 3.0
STEPS = {"command": 4e-4, "autocollimator": 1e-4, "heads": 4e-4}
"""Steps of each stream, rad."""

SHOWN_BY = {"command": "ecc", "autocollimator": "eac", "heads": "eyc"}


@cache
def recorded(seed: int) -> Recording:
    """A recording with a sample of each stream in each millisecond, of a drive that reaches its accelerations."""
    generator, section = np.random.default_rng([seed, 21]), random_stage(seed)
    topics = (COMMAND, AUTOCOLLIMATOR, *map(head_topic, section["encoder"]["heads"]))
    habits = Options(motion=TURNING[seed % len(TURNING)], odd_rates=False, block_period=0.02, lost_blocks=0.0)
    habits = replace(habits, rates=dict.fromkeys(topics, 1000.0), peak_speed=float(generator.uniform(0.3, 6.0)))
    while quickest(seed, habits) > ACCELERATION:
        habits = replace(habits, peak_speed=0.8 * habits.peak_speed)
    return make_recording(seed, duration=DURATION, stage=section, options=habits)


@cache
def available(seed: int) -> Mapping[str, float]:
    """What is published of each component where no stream is slow."""
    return judge(recorded(seed), recorded(seed).stage).available


def topics_of(recording: Recording, which: str) -> list[str]:
    return {"command": [COMMAND], "autocollimator": [AUTOCOLLIMATOR]}.get(which) or list(recording.head_topics)


def thinned(
    recording: Recording, topic: str, spacing: float, scatter: float, generator: np.random.Generator
) -> tuple[list[SampleBlock], NDArray[np.int64]]:
    """Of a stream only samples that are about `spacing` (s) apart, each off by up to `scatter` (s)."""
    times = np.concatenate([block.times_ns for block in recording.blocks[topic]])
    wanted = np.arange(times[0], times[-1], spacing * 1e9)
    wanted = wanted + 1e9 * generator.uniform(-scatter, scatter, len(wanted))
    kept = np.unique(np.searchsorted(times, wanted).clip(0, len(times) - 1))
    blocks, begin = [], 0
    for block in recording.blocks[topic]:
        own = kept[(kept >= begin) & (kept < begin + len(block.rows))] - begin
        blocks.append(SampleBlock(block.stamp_ns, block.names, block.rows[own]))
        begin += len(block.rows)
    return blocks, recording.arrivals[topic]


def slow(seed: int, which: str, nominal: float, begin: float | None = None) -> Recording:
    """A stream that gives a sample in about each `nominal` (s), with a step from a time (s) on."""
    generator, recording = np.random.default_rng([seed, 22]), recorded(seed)
    spacing, scatter = nominal * generator.uniform(0.85, 1.15), nominal * generator.uniform(0.0, 0.15)
    size = STEPS[which] * float(generator.choice([-1.0, 1.0]))
    for topic in topics_of(recording, which):
        if begin is not None:
            recording = recording.with_topics({topic: stepped(recording, topic, size, begin)})
        recording = recording.with_topics({topic: thinned(recording, topic, spacing, scatter, generator)})
    return recording


@pytest.mark.parametrize("which", STEPS)
def test_an_instrument_of_50_hz_is_used_however_its_stamps_scatter(which):
    found = [judge(slow(seed, which, 0.02), recorded(seed).stage) for seed in seeds(24)]
    doubted = [each.doubted[name] for each in found for name in ("command", "autocollimator") if name in each.doubted]
    assert len(doubted) <= 0.06 * len(found), doubted
    assert np.mean([each.worst for each in found]) <= MOST_WRONG
    whole = [available(seed)[SHOWN_BY[which]] for seed in seeds(24)]
    assert np.mean([each.available[SHOWN_BY[which]] for each in found]) > 0.85 * np.mean(whole)


@shows(
    Row(
        "messages",
        "Samples of a stream scatter about as far apart as `max_gap` (25 ms), or are lost all the time, so that values "
        "are missing in each hundredth of a second",
        "the stream is doubted: samples are missing or too far apart",
        "nothing can be told of what comes in pieces: after 0.1 s of them the stream is left out",
        "everything that the other streams show",
        "0.5 s after its samples are near enough",
    )
)
@pytest.mark.parametrize("nominal", [0.02, MAX_GAP])
@pytest.mark.parametrize("which", STEPS)
def test_a_step_between_samples_that_are_hardly_joined_does_not_go_out(which, nominal):
    """Of commands at exactly 50 Hz what was published behind a step was wrong in 30 of 36 stages."""
    told, wrong = [], []
    for seed in seeds(24):
        begin = float(np.random.default_rng([seed, 23]).uniform(1.0, 2.0))
        found = judge(slow(seed, which, nominal, begin), recorded(seed).stage)
        told.append(bool(found.doubted))
        wrong.append(found.worst)
    # about as far apart as is joined there is mostly nothing in which a step could be seen, nor is much published
    assert np.mean(told) > (0.8 if nominal < MAX_GAP else 0.3), told
    assert max(wrong) <= 0.1 / DURATION, wrong
    assert np.mean(wrong) <= MOST_WRONG * 2.0, wrong


@pytest.mark.parametrize("which", STEPS)
def test_what_comes_in_pieces_is_left_out(which):
    """Of samples that are lost again and again no hundredth of a second is whole."""
    for seed in seeds(6):
        recording = recorded(seed)
        for topic in topics_of(recording, which):
            blocks = [
                SampleBlock(block.stamp_ns, block.names, block.rows[block.times_ns // 1_000_000 % 10 < 5])
                for block in recording.blocks[topic]
            ]
            recording = recording.with_topics({topic: (blocks, recording.arrivals[topic])})
        found = judge(recording, recording.stage)
        names = [topic.split("/")[2] for topic in topics_of(recording, which)]
        assert {found.doubted[name] for name in names} == {BROKEN}
        assert found.available[SHOWN_BY[which]] < 0.1
