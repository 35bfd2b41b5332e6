"""Windows that are taken in together are what they would be one by one, to the last bit, with faults and without."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from described_stages import stage_of
from faults.judging import record, stream_of
from world import FAULTS, random_stage

from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.belief import Belief
from rotary_error_monitor.pipeline.estimation import Estimator

TOGETHER_NS = (1_000_000_000, 80_000_000)
"""What arrives within this time is estimated together: windows up to the next measurement and beyond, and some."""

KINDS = (None, "head_jumps_10", "head_dead_later", "autocollimator_stuck", "command_stuck", "recording_paused")

ENDING = ("autocollimator_stuck", "command_stuck", "recording_paused")
"""Those that leave half of a recording, or the part before them, to be calm in."""


def estimates(timeline, section, together_ns):
    """Every number that is published."""
    estimator, parts, awake = Estimator(stage_of(section)), [], 0
    for arrival, stream, block in timeline:
        if arrival - awake >= together_ns:
            parts += estimator.advance()
            awake = arrival
        estimator.accept(stream, block)
    motion = ErrorMotion.joined(parts + estimator.advance() + estimator.finish())
    return [np.asarray(getattr(motion, each.name)).tobytes() for each in fields(motion)]


def timeline_of(seed, fault):
    section = random_stage(seed)
    recording = record(seed, section, 8.0 if fault in ENDING else 5.0)
    if fault is not None:
        recording = FAULTS[fault](recording, np.random.default_rng(seed)).recording
    heard = [(arrival, stream_of(topic), block) for arrival, topic, block in recording.timeline()]
    return section, [(arrival, stream, block) for arrival, stream, block in heard if stream and len(block.rows)]


@pytest.mark.few(6)
@pytest.mark.parametrize("seed", [4, 7, 8, 10])
@pytest.mark.parametrize("fault", KINDS)
def test_taken_in_together_or_judged_one_by_one(fault, seed, monkeypatch):
    section, timeline = timeline_of(seed, fault)
    taken, take_in = [], Belief._take_in

    def counted(belief, windows):
        taken.append(len(windows))
        return take_in(belief, windows)

    monkeypatch.setattr(Belief, "_take_in", counted)
    together = [estimates(timeline, section, each) for each in TOGETHER_NS]
    monkeypatch.setattr(Belief, "_are_calm", lambda *_: False)
    count = sum(taken)
    one_by_one = [estimates(timeline, section, each) for each in TOGETHER_NS]
    assert sum(taken) == count, "with no windows taken in"
    assert count > 100, "these stages have heads to spare and an autocollimator that sees light"
    assert together == one_by_one
