"""Commands of 50 Hz to 1 kHz whose acceleration jumps: what lies between two samples of one is no fault of a stamp."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from described_stages import stage_of
from draws import seeds
from world import Options, Recording, make_recording, random_stage
from world.fault import blocks_from, shifted, stepped
from world.motion import make_motion
from world.options import RAMPS, Seeds
from world.recording import AUTOCOLLIMATOR, COMMAND, head_topic

from faults.judging import estimated, judge
from faults.recordings import MOST_WRONG
from rotary_error_monitor.pipeline.distance_reach import ACCELERATION
from rotary_error_monitor.pipeline.estimation import Estimator

RATES = (50.0, 100.0, 250.0, 1000.0)
DELAY = 2e-3
DURATION = 1.5


def quickest(seed: int, options: Options) -> float:
    """Largest angular acceleration, rad/s²."""
    times = np.arange(0.0, DURATION, 1e-3)
    return float(np.abs(np.diff(make_motion(Seeds(seed), DURATION, options)[1].velocity(times))).max()) * 1e3


def jumping(seed: int, habits: Options, generator: np.random.Generator, **others: Any) -> Options:
    """Habits of a stage whose acceleration jumps, without what distracts, at a speed that its drive can reach."""
    habits = replace(
        habits,
        motion=("both_directions", "indexing", "s_curves")[seed // 6 % 3],
        odd_rates=False,
        block_period=0.02,
        lost_blocks=0.0,
        force=False,
        temperature=False,
        lvdt=False,
        peak_speed=float(generator.uniform(1.0, 6.0)),
        **others,
    )
    while quickest(seed, habits) > ACCELERATION:
        habits = replace(habits, peak_speed=0.8 * habits.peak_speed)
    return habits


@cache
def recorded(seed: int, rate: float) -> Recording:
    """A recording that begins in the first ramp, or just before it, of heads with hardly any noise, or as usual."""
    generator = np.random.default_rng(seed)
    section = random_stage(seed)
    habits = Options(quantise=False, noise_shape=False)
    if seed % 2:
        section["encoder"] |= {"noise": 1e-9, "counts_per_line": 1_000_000}
        habits = Options.textbook(noise=1.0)
    rates = {COMMAND: rate, AUTOCOLLIMATOR: 20.0}
    habits = jumping(seed, habits, generator, ramps=RAMPS[seed % len(RAMPS)], rates=rates)
    whole = make_recording(seed, duration=DURATION, stage=section, options=habits)
    times = np.arange(0.0, DURATION, 1e-3)
    speed = whole.truth.motion.velocity(times)
    moving = int(np.flatnonzero(speed)[0])
    ramped = moving + int(np.flatnonzero(np.diff(speed[moving:]) == 0.0)[0])
    begin = whole.start_ns + round(1e9 * generator.uniform(times[moving] - 0.05, times[ramped]))
    topics = {}
    for topic, blocks in whole.blocks.items():
        first = blocks_from(blocks, begin)
        topics[topic] = blocks[first:], whole.arrivals[topic][first:]
    return whole.with_topics(topics)


def doubts(seed: int, rate: float, delay: float = 0.0) -> tuple[str, float]:
    """Why the command is doubted first, and after how many seconds; of late heads it is stamped early."""
    recording = recorded(seed, rate)
    if delay:
        recording = recording.with_topics(
            {COMMAND: shifted(recording, COMMAND, recording.start_ns, -round(delay * 1e9))}
        )
    estimator = Estimator(stage_of(recording.stage))
    found: list[tuple[str, float]] = []

    def look(arrival: int) -> None:
        if estimator.belief.command.doubt and not found:
            found.append((estimator.belief.command.doubt, (arrival - recording.start_ns) * 1e-9))

    estimated(recording, estimator, look)
    return found[0] if found else ("", DURATION)


def cases(most: int, rates: tuple[float, ...] = RATES) -> Iterator[tuple[int, float]]:
    return ((seed, rates[(seed // 6 + seed) % len(rates)]) for seed in seeds(most))


def test_what_lies_between_two_samples_of_a_command_is_no_fault():
    """Of one at 50 or 100 Hz a jump of acceleration is interpolated wrong by up to some hundred microradians."""
    found = {(seed, rate): doubts(seed, rate)[0] for seed, rate in cases(90)}
    assert not any(found.values()), {case: why for case, why in found.items() if why}


@pytest.mark.parametrize("delay", [DELAY, -DELAY])
def test_a_command_whose_stamps_are_off_is_doubted_before_the_move_is_over(delay):
    """At rates whose interpolation misses less than such a delay makes."""
    found = {(seed, rate): doubts(seed, rate, delay)[0] for seed, rate in cases(24, RATES[1:])}
    assert np.mean([bool(why) for why in found.values()]) > 0.8, found


@pytest.mark.parametrize("rate", [40.0, 50.0])
def test_a_step_of_a_slow_command_is_told_or_counts_as_uncertainty(rate):
    """Also in a ramp, in which interpolation misses more than that for longer than a step takes."""
    told, wrong = [], []
    for seed in seeds(36):
        section, generator = random_stage(seed), np.random.default_rng([seed, 5])
        if seed % 4 < 2:
            section["encoder"] |= {"noise": 1e-9, "counts_per_line": 1_000_000}
        rates = {COMMAND: rate, AUTOCOLLIMATOR: 200.0}
        rates |= dict.fromkeys(map(head_topic, section["encoder"]["heads"]), 1000.0)
        habits = jumping(seed, Options.textbook(noise=1.0), generator, ramps=RAMPS[1 + seed % 2], rates=rates)
        whole = make_recording(seed, duration=2 * DURATION, stage=section, options=habits)
        size, begin = float(generator.choice([3e-4, -3e-4, 4e-4, -5e-4])), float(generator.uniform(1.0, 2.5))
        found = judge(whole.with_topics({COMMAND: stepped(whole, COMMAND, size, begin)}), section)
        told.append("command" in found.doubted)
        wrong.append(found.worst)
    assert np.mean(told) > (0.8 if rate >= 50.0 else 0.6), told
    assert max(wrong) <= 0.1 / (2 * DURATION), wrong
    assert np.mean(wrong) <= 2 * MOST_WRONG, wrong
