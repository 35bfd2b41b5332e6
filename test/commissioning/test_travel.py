"""How far a stage has turned, as it is shown while it turns: held against the motion that the stage made."""

from __future__ import annotations

import numpy as np
import pytest
from described_stages import stage_of
from draws import seeds
from world.newly_built import COMMAND, build, head_topic, in_unit, wrapped
from world.recording import Recording

from rotary_error_monitor.commissioning.travel import ENOUGH, TravelWatch, TurnedTravel
from rotary_error_monitor.signals.blocks import SampleBlock

DEGREES = 180 / np.pi
REST = 4.0
"""s, for which the stage stands at the end."""


def watched(built, recording: Recording, until: float = np.inf, rest: bool = True) -> TurnedTravel:
    watch = TravelWatch(stage_of(built.nominal))
    end = recording.start_ns + min(until, recording.duration) * 1e9
    for topic, blocks in recording.blocks.items():
        stream = topic.split("/")[2]
        for block in blocks:
            if block.stamp_ns < end:
                watch.note(stream, block)
                last = block
        for k in range(round(REST * 50) if rest else 0):
            row = last.rows[-1:] * np.append([0.0], np.ones(last.rows.shape[1] - 1))
            watch.note(stream, SampleBlock(last.newest_ns + (k + 1) * 20_000_000, last.names, row))
    return watch.travel()


@pytest.mark.few(3)
@pytest.mark.parametrize("seed", seeds(6))
@pytest.mark.parametrize("how", ["as it is", "a head in degrees", "all in degrees", "a wrapped head"])
def test_it_is_as_far_as_the_stage_turned(seed: int, how: str) -> None:
    built = build(seed, count=4 + seed % 2, even=False, duration=24.0)
    every = [*built.recording.head_topics, COMMAND]
    changes = {
        "as it is": lambda recording: recording,
        "a head in degrees": lambda recording: in_unit(recording, [head_topic("b")], DEGREES),
        "all in degrees": lambda recording: in_unit(recording, every, DEGREES),
        "a wrapped head": lambda recording: wrapped(recording, [head_topic("b")]),
    }
    recording = changes[how](built.recording)
    found = watched(built, recording)
    stamps = recording.start_ns + np.arange(0.0, recording.duration, 0.01) * 1e9
    steps = np.diff(recording.truth(stamps.astype(np.int64)).theta)
    true = sorted([steps[steps > 0].sum(), -steps[steps < 0].sum()])
    assert sorted([found.forth, found.back]) == pytest.approx(true, rel=0.05)
    assert found.stands and found.is_enough == (min(true) > ENOUGH)
    assert not watched(built, recording, rest=False).stands or min(true) < ENOUGH


@pytest.mark.parametrize("seed", seeds(3))
def test_one_way_alone_and_a_stage_that_stands_are_never_enough(seed: int) -> None:
    built = build(seed, count=4, even=False, duration=24.0, motion="steady")
    found = watched(built, built.recording)
    assert max(found.forth, found.back) > ENOUGH and not found.is_enough
    built = build(seed, count=4, even=False, duration=10.0, motion="standstill")
    assert max(watched(built, built.recording).forth, watched(built, built.recording).back) < np.radians(1.0)
