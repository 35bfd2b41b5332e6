"""Two heads of four, or all of them, that share a clock of a wrong rate, as two channels of one card or one gateway."""

from __future__ import annotations

import numpy as np
import pytest
from world import Recording, random_stage
from world.recording import head_topic

from faults.behaviours import command_bound
from faults.documenting import Row, shows
from faults.judging import judge, record
from faults.recordings import MOST_WRONG
from rotary_error_monitor.signals.blocks import SampleBlock

DURATION = 6.0
SHARED = {"two neighbours": slice(0, 2), "two opposed": slice(0, None, 2), "all": slice(None)}
"""Heads in the order of their places."""


def running(recording: Recording, topics: list[str], rate: float) -> Recording:
    """The stamps of some topics go with a clock that is off by a part of the time, from the begin on."""

    def stamped(block: SampleBlock) -> SampleBlock:
        rows = block.rows.copy()
        rows[:, 0] *= 1.0 + rate
        gone = round((block.stamp_ns - recording.start_ns) * rate)
        return SampleBlock(block.stamp_ns + gone, block.names, rows)

    blocks = {topic: list(map(stamped, recording.blocks[topic])) for topic in topics}
    return recording.with_topics({topic: (each, recording.arrivals[topic]) for topic, each in blocks.items()})


def stage_of_four(seed: int) -> tuple[dict[str, object], list[str]]:
    """A random stage with four heads, and their topics in the order of their places."""
    drawn = (random_stage(100 * seed + number) for number in range(100))
    stage = next(each for each in drawn if len(each["encoder"]["heads"]) == 4)
    places = {name: float(np.mod(head["azimuth"], 2 * np.pi)) for name, head in stage["encoder"]["heads"].items()}
    return stage, [head_topic(name) for name in sorted(places, key=lambda name: places[name])]


@shows(
    Row(
        "messages",
        "The clock of two heads, or of all, runs off by 200 ppm to 1000 ppm",
        "`error_estimator: estimate`: of two opposed heads the contradiction at once; of two neighbours or all, "
        "rotation and command apart, heads behind or ahead of the command, or a ring that does not fit, once it is "
        "beyond `following_error`, `latency` or `limits.radial`. At 200 ppm a slow stage takes longer than 8 s for "
        "that: of 12 drawn stages two neighbours were not told on three, all heads on five",
        "as of a command or a ring that does not fit: what is contradicted is not used",
        "what is not contradicted; a positioning that is off by no more than `following_error`, and `latency` at its "
        "speed. Stamps are not held against the rate at which messages arrive: a node that is busy, or simulated time, "
        "would make as much of sound clocks",
        "when the clocks are set, as of a step of the stamps",
    )
)
@pytest.mark.parametrize("shared", SHARED)
@pytest.mark.parametrize(("seed", "rate"), [(0, -2e-4), (1, 1e-3), (2, -1e-3)])
def test_a_clock_that_runs_off_is_told_or_within_what_is_stated(seed, rate, shared):
    stage, heads = stage_of_four(seed)
    found = judge(running(record(seed, stage, DURATION), heads[SHARED[shared]], rate), stage, bound=command_bound)
    assert found.worst <= MOST_WRONG, found.wrong
    assert found.doubted or (abs(rate) < 1e-3 and shared != "two opposed"), shared
