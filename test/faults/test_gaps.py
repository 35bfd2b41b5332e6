"""A head that comes back after a gap, where no other would contradict it: it may have lost counts meanwhile."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from described_stages import stage_of
from draws import seeds
from motion_numbers import assert_same_bits, decisions_of
from pushed_inputs import push_block
from world import Options, Recording, make_recording, random_stage
from world.recording import head_topic

from faults.documenting import Row, shows
from faults.judging import Judgement, judge, stream_of
from faults.recordings import MOST_WRONG
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.pipeline.publication import Decisions
from rotary_error_monitor.signals.blocks import SampleBlock

DURATION, BEGIN = 8.0, 5.5
"""Of a recording and of the gap in it, s: whole turns were seen before."""

SEEDS = seeds(6)
LAYOUTS = ("three heads", "four heads, one dead", "two heads")
"""None of them has a head to spare. Where the one opposed to the missing head is silent, two are left, which tell the
rotation."""


@cache
def recorded(seed: int, layout: str) -> tuple[Recording, str]:
    """A random stage that makes whole turns, and its head that will be silent for a time."""
    drawn = (random_stage(number) for number in range(1000 * seed, 1000 * seed + 1000))
    stage = next(each for each in drawn if len(each["encoder"]["heads"]) == 4)
    places = {name: head["azimuth"] for name, head in stage["encoder"]["heads"].items()}
    (opposed,) = (name for name, place in places.items() if abs(np.cos(place - places["a"]) + 1.0) < 1e-6)
    kept = {"three heads": set(places) - {"a"}, "two heads": {"a", opposed}}.get(layout, set(places))
    stage["encoder"]["heads"] = {name: {"azimuth": place} for name, place in places.items() if name in kept}
    motion = ("both_directions", "s_curves", "steady")[seed % 3]
    options = Options(motion=motion, odd_rates=False, peak_speed=4.0, block_period=0.01, lost_blocks=0.0)
    recording = make_recording(seed, duration=DURATION, stage=stage, options=options)
    return (silent(recording, "a", 4.0, DURATION + 1.0, 0.0) if "dead" in layout else recording), opposed


def silent(recording: Recording, head: str, begin: float, end: float, off: float) -> Recording:
    """No block of the head for a time, and readings that are off by an angle (rad) after it."""
    topic = head_topic(head)
    begin_ns, end_ns = (recording.start_ns + round(each * 1e9) for each in (begin, end))
    blocks, arrivals = [], []
    for block, arrival in zip(recording.blocks[topic], recording.arrivals[topic], strict=True):
        if block.times_ns[-1] < begin_ns:
            blocks.append(block)
        elif block.times_ns[0] >= end_ns:
            blocks.append(SampleBlock(block.stamp_ns, block.names, block.rows + [0.0, off]))
        else:
            continue
        arrivals.append(arrival)
    return recording.with_topics({topic: (blocks, np.array(arrivals))})


@cache
def judged(seed: int, layout: str, gap: float, size: float) -> Judgement:
    """The head falls silent for a time (s), and is off by so much after it, in what the stage can move at most."""
    recording, head = recorded(seed, layout)
    off = size * stage_of(recording.stage).limits.radial / recording.stage["encoder"]["disc_radius"]
    if gap > 0.0:
        recording = silent(recording, head, BEGIN, BEGIN + gap, off)
    return judge(recording, recording.stage)


def healthy(layout: str) -> list[int]:
    """Stages that are not doubted without a gap: a fault of too few heads is taken for more than it is."""
    return [seed for seed in SEEDS if not judged(seed, layout, 0.0, 0.0).doubted]


@pytest.mark.few(1)
@shows(
    Row(
        "heads",
        "One head is silent for 0.04 s to 0.3 s and has lost counts after it, where no other head would contradict it",
        "`error_estimator: estimate` says that it may have lost counts, or names a step that no bearing makes",
        "the ring is held against where it was before the gap, at last or at this angle",
        "as uncertain as before a turn has verified the description; nothing after a step that no bearing makes",
        "when the ring is where it was at this angle before, or on a reset",
    )
)
@pytest.mark.parametrize("gap", [0.04, 0.3])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_head_that_lost_counts_in_a_gap_is_not_believed(layout, gap):
    wrong = {}
    for seed in healthy(layout):
        generator = np.random.default_rng(seed)
        size = float(generator.choice([-1.0, 1.0]) * generator.uniform(0.3, 1.0))
        found = judged(seed, layout, gap, size)
        if found.worst > MOST_WRONG:
            wrong[seed] = (size, dict(found.wrong), found.doubted)
    assert not wrong


def estimates(recording: Recording, decisions: Decisions | None = None) -> ErrorMotion:
    """What an estimator publishes, or what it repeats."""
    estimator, parts = Estimator(stage_of(recording.stage), decisions=decisions), []
    for arrival, topic, block in recording.timeline():
        stream = stream_of(topic)
        if stream is not None and len(block.rows):
            parts += push_block(estimator, stream, block, arrival)
    return ErrorMotion.joined(parts + estimator.finish())


@pytest.mark.few(2)
@pytest.mark.parametrize("gap", [0.04, 0.3])
@pytest.mark.parametrize("seed", [0, SEEDS[-1]])
def test_a_replay_of_a_gap_is_what_went_out(seed, gap):
    recording, head = recorded(seed, "three heads")
    off = 0.5 * stage_of(recording.stage).limits.radial / recording.stage["encoder"]["disc_radius"]
    changed = silent(recording, head, BEGIN, BEGIN + gap, off)
    live = estimates(changed)
    assert_same_bits(estimates(changed, decisions_of(live)), live)


@pytest.mark.few(1)
@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_head_that_comes_back_as_it_was_counts_at_once(layout):
    """The ring is where it was before, or at this angle a turn ago."""
    told = [seed for seed in healthy(layout) if judged(seed, layout, 0.0, 0.0).available["eyc"] > 0.9]
    for seed in told:
        before, found = (judged(seed, layout, gap, 0.0) for gap in (0.0, 0.04))
        assert found.worst <= MOST_WRONG
        assert not found.doubted
        # where one head's stream ends before the others', it may have lost counts at the end
        assert found.estimator.belief.heads.unsettled is before.estimator.belief.heads.unsettled
        assert found.available["eyc"] > before.available["eyc"] - 0.04
    assert len(told) >= len(SEEDS) / 3
