"""A probe goes wrong where no other sensor sees what it does: what may be its own is within what is stated.

Two radial probes at right angles beside the one head that is left, and alone on a stage that has none.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from functools import cache

import numpy as np
import pytest
from draws import seeds
from world import PROBE_FAULTS, Options, Recording, make_recording, random_stage, with_probes, with_probes_alone
from world.recording import probe_topic

from faults.judging import TURNING, Judgement, judge
from faults.recordings import MOST_WRONG
from faults.test_heads_left import without
from rotary_error_monitor.signals.blocks import SampleBlock

STAGES = seeds(12)
DURATION, SILENT, BEGIN = 12.0, 5.0, 6.0
"""Length of a recording, when all heads but one fall silent, and when the probe goes wrong, s."""


def with_two(seed: int) -> dict[str, object]:
    """A stage without heads of whose three probes two are left."""
    section = deepcopy(with_probes_alone(random_stage(1000 * seed), seed))
    del section["sensors"]["three"]
    return section


def with_heads(seed: int) -> dict[str, object]:
    drawn = (random_stage(number) for number in range(1000 * seed, 1000 * seed + 1000))
    return with_probes(deepcopy(next(each for each in drawn if len(each["encoder"]["heads"]) >= 4)), seed)


@cache
def recorded(seed: int, *, heads: bool) -> Recording:
    options = Options(motion=TURNING[seed % 4], odd_rates=False, peak_speed=4.0, lost_blocks=0.0)
    section = with_heads(seed) if heads else with_two(seed)
    whole = make_recording(seed, duration=DURATION, stage=section, options=options)
    return without(whole, {min(section["encoder"]["heads"])}, SILENT, np.inf) if heads else whole


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


def judged(seed: int, fault: str, *, heads: bool) -> Judgement:
    recording = recorded(seed, heads=heads)
    name = ("low", "high") if heads else ("one", "two")
    topic = probe_topic(name[seed % 2], recording.stage["sensors"][name[seed % 2]])
    return judge(FAULTS[fault](recording, topic, seed), recording.stage)


@pytest.mark.parametrize("heads", [True, False], ids=["beside a head", "alone"])
@pytest.mark.parametrize("fault", FAULTS)
def test_what_may_be_its_own_is_within_what_is_stated(fault: str, heads: bool) -> None:
    found = {seed: judged(seed, fault, heads=heads) for seed in STAGES}
    wrong = {seed: (dict(each.wrong), each.doubted) for seed, each in found.items() if each.worst > MOST_WRONG}
    assert not wrong
    assert min(each.available["exc"] for each in found.values()) > 0.4


@pytest.mark.parametrize("heads", [True, False], ids=["beside a head", "alone"])
def test_of_sound_probes_nothing_counts_but_what_the_rotor_does_not_repeat(heads: bool) -> None:
    """Beside what turns with the rotor that is little in these stages, and the median is what is stated."""
    for seed in STAGES:
        recording = recorded(seed, heads=heads)
        found = judge(recording, recording.stage)
        assert found.worst <= MOST_WRONG and not found.doubted.keys() & {"heads", "command"}, (seed, found.wrong)
        assert found.available["exc"] > 0.9, seed
