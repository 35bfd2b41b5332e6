"""The zero from which heads count, after a time in which none of them was heard."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from described_stages import stage_of
from world import random_stage

from faults.judging import TURN_OF_THE_NODE, record, stream_of
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.pipeline.estimator_settings import EstimatorSettings
from rotary_error_monitor.pipeline.verdict import DOUBTS

UNVERIFIED = 1 << DOUBTS.index("unverified")
SILENT = (7.0, 8.0)
"""From when to when no head is heard, s."""

PART = 0.1
"""Part of a turn that verifies a description here: slow stages make no whole one in so short a recording."""


@dataclass(frozen=True)
class Doubted:
    """Part of the ticks at which the description counts as unverified: before the silence, at the first ten
    ticks after it (fast stages make that part of a turn in 30 ms), and from a tenth of a second after it; all
    where nothing is published."""

    before: float
    first: float
    then: float


def unverified(seed, *, turned=0.0, command=True):
    """The same of a random stage whose heads come back turned by an angle."""
    section = random_stage(seed)
    recording = record(seed, section, 12.0)
    begin, end = (recording.start_ns + round(each * 1e9) for each in SILENT)
    estimator, parts, awake = Estimator(stage_of(section), EstimatorSettings(check_turns=PART)), [], 0
    for arrival, topic, block in recording.timeline():
        stream = stream_of(topic)
        head = stream is not None and stream.startswith("head_")
        if stream is None or (head and begin <= block.times_ns[-1] and block.times_ns[0] < end):
            continue
        if stream == "command" and not command:
            continue
        if head and block.times_ns[0] >= end:
            block.rows[:, block.names.index("angle")] += turned
        if abs(arrival - awake) > TURN_OF_THE_NODE:
            parts += estimator.advance()
            awake = arrival
        estimator.accept(stream, block, arrival)
    motion = ErrorMotion.joined(parts + estimator.advance() + estimator.finish())
    times, doubtful = motion.times_ns, motion.doubts & UNVERIFIED > 0
    first = times[times >= end][0]

    def part(since, until):
        chosen = doubtful[(times >= since) & (times < until)]
        return float(chosen.mean()) if len(chosen) else 1.0

    return Doubted(
        part(begin - 300_000_000, begin),
        float(doubtful[times >= end][:10].mean()),
        part(first + 100_000_000, first + 300_000_000),
    )


@pytest.fixture(scope="module")
def verified_stages():
    """What random stages are that have shown as much before the silence, by their seed."""
    found = {seed: unverified(seed) for seed in range(6)}
    verified = {seed: doubted for seed, doubted in found.items() if doubted.before == 0.0}
    assert len(verified) >= 3
    return verified


def test_heads_that_come_back_where_the_command_is_are_believed_at_once(verified_stages):
    assert [doubted.then for doubted in verified_stages.values()] == [0.0] * len(verified_stages)


def test_heads_that_come_back_apart_from_the_command_must_show_a_turn_again(verified_stages):
    chance = np.random.default_rng(1)
    turned = {seed: float(chance.uniform(0.5, 5.5)) for seed in verified_stages}
    assert [unverified(seed, turned=by).first for seed, by in turned.items()] == [1.0] * len(turned)


def test_without_a_command_nothing_tells_that_the_zero_is_the_same(verified_stages):
    assert [unverified(seed, command=False).first for seed in verified_stages] == [1.0] * len(verified_stages)
