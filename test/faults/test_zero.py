"""The zero from which heads count, after a time in which none of them was heard."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from world import random_stage

from faults.judging import TURN_OF_THE_NODE, record, stream_of
from rotary_error_monitor.description.stage import stage_from_mapping
from rotary_error_monitor.pipeline.belief import DOUBTS
from rotary_error_monitor.pipeline.estimation import Estimator

UNVERIFIED = 1 << DOUBTS.index("unverified")
SILENT = (7.0, 8.0)
"""From when to when no head is heard, s."""

SETTLED = 500_000_000
"""From when on the estimate is judged after it, ns: heads are used 0.1 s after their first whole block."""


@dataclass(frozen=True)
class Doubted:
    """Part of the ticks at which the description counts as unverified: before the silence, and after it."""

    before: float
    after: float


def unverified(seed, *, turned=0.0, command=True):
    """The same of a random stage whose heads come back turned by an angle."""
    section = random_stage(seed)
    recording = record(seed, section, 12.0)
    begin, end = (recording.start_ns + round(each * 1e9) for each in SILENT)
    estimator, blocks, awake = Estimator(stage_from_mapping(section)), [], 0
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
            blocks += estimator.advance()
            awake = arrival
        estimator.accept(stream, block, arrival)
    blocks += estimator.advance() + estimator.finish()
    times = np.concatenate([block.times_ns for block in blocks])
    doubtful = np.concatenate([block.column("doubts").astype(int) & UNVERIFIED for block in blocks]) > 0
    before = doubtful[(times > begin - 300_000_000) & (times < begin)]
    after = doubtful[(times > end + SETTLED) & (times < end + SETTLED + 200_000_000)]
    assert len(before) > 50
    assert len(after) > 100
    return Doubted(float(before.mean()), float(after.mean()))


@pytest.fixture(scope="module")
def verified_stages():
    """Random stages that have made the turn that verifies them before the silence."""
    seeds = [seed for seed in range(24) if unverified(seed).before == 0.0]
    assert len(seeds) >= 5
    return seeds


def test_heads_that_come_back_where_the_command_is_are_believed_at_once(verified_stages):
    assert [unverified(seed).after for seed in verified_stages] == [0.0] * len(verified_stages)


def test_heads_that_come_back_apart_from_the_command_must_show_a_turn_again(verified_stages):
    chance = np.random.default_rng(1)
    turned = {seed: float(chance.uniform(0.5, 5.5)) for seed in verified_stages}
    assert [unverified(seed, turned=by).after for seed, by in turned.items()] == [1.0] * len(turned)


def test_without_a_command_nothing_tells_that_the_zero_is_the_same(verified_stages):
    assert [unverified(seed, command=False).after for seed in verified_stages] == [1.0] * len(verified_stages)
