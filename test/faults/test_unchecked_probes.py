"""A probe goes wrong once no other sensor sees what it does any more: what may be its own is within what is stated.

Two radial probes at right angles are beside the one head that is left of more.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from draws import seeds
from world import PROBE_FAULTS, Options, Recording, make_recording
from world.recording import probe_topic

from faults.judging import TURNING, Judgement, judge
from faults.recordings import MOST_WRONG
from faults.test_heads_left import described, without
from rotary_error_monitor.signals.blocks import SampleBlock

STAGES = seeds(12)
DURATION, SILENT, BEGIN = 12.0, 5.0, 6.0
"""Length of a recording, when all heads but one fall silent, and when the probe goes wrong, s."""


@cache
def recorded(seed: int) -> Recording:
    options = Options(motion=TURNING[seed % 4], odd_rates=False, peak_speed=4.0, lost_blocks=0.0)
    section = described(seed, probes=True)
    whole = make_recording(seed, duration=DURATION, stage=section, options=options)
    return without(whole, {min(section["encoder"]["heads"])}, SILENT, np.inf)


def mirrored(recording: Recording, topic: str) -> Recording:
    """A probe that shows displacements of the other sign from a time on, about its zero."""
    zero = recording.probes[topic].get("zero", 0.0)
    blocks = []
    for block in recording.blocks[topic]:
        later = (block.times_ns - recording.start_ns) * 1e-9 >= BEGIN
        rows = block.rows.copy()
        rows[later, 1] = 2.0 * zero - rows[later, 1]
        blocks.append(SampleBlock(block.stamp_ns, block.names, rows))
    return recording.with_topics({topic: (blocks, recording.arrivals[topic])})


def failing(name: str) -> Callable[[Recording, str, int], Recording]:
    def injected(recording: Recording, topic: str, seed: int) -> Recording:
        rng = np.random.default_rng([seed, len(name)])
        return PROBE_FAULTS[name](recording, rng, begin=BEGIN, size=None, topic=topic).recording

    return injected


FAULTS: dict[str, Callable[[Recording, str, int], Recording]] = {
    "steps": failing("probe_stepped"),
    "drifts": failing("probe_drifts"),
    "the other sign": lambda recording, topic, seed: mirrored(recording, topic),
}


def judged(seed: int, fault: str) -> Judgement:
    recording, name = recorded(seed), ("low", "high")[seed % 2]
    topic = probe_topic(name, recording.stage["sensors"][name])
    return judge(FAULTS[fault](recording, topic, seed), recording.stage)


@pytest.mark.parametrize("fault", FAULTS)
def test_what_may_be_its_own_is_within_what_is_stated(fault: str) -> None:
    found = {seed: judged(seed, fault) for seed in STAGES}
    wrong = {seed: (dict(each.wrong), each.doubted) for seed, each in found.items() if each.worst > MOST_WRONG}
    assert not wrong
    assert min(each.available["exc"] for each in found.values()) > 0.4


def test_sound_probes_are_believed_and_right() -> None:
    for seed in STAGES:
        found = judge(recorded(seed), recorded(seed).stage)
        assert found.worst <= MOST_WRONG and not found.doubted.keys() & {"heads", "command"}, (seed, found.wrong)
        assert found.available["exc"] > 0.9, seed
