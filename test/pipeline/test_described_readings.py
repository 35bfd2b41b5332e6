"""What is described of an autocollimator's readings, taken off at the rotation of each: right, and repeated to the bit.

The stages are those of the independent world that turn by up to a sixth of a turn from one reading to the next, and
tilt by an order of 5 to 9.
"""

from __future__ import annotations

import pytest
from described_stages import stage_of
from faults.judging import stream_of
from faults.test_slow_autocollimators import of_high_order
from motion_numbers import assert_same_bits, decisions_of
from pushed_inputs import push_block
from world import Recording

from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.estimation import Estimator

SEEDS = (0, 4)


def arrived(recording: Recording) -> list[tuple[str, object]]:
    rows = ((stream_of(topic), block) for _, topic, block in recording.timeline())
    return [(name, block) for name, block in rows if name is not None and len(block.rows)]


def run(stage, blocks, finish=True, **options) -> ErrorMotion:
    estimator = Estimator(stage, **options)
    parts = [each for name, block in blocks for each in push_block(estimator, name, block)]
    return ErrorMotion.joined(parts + (estimator.finish() if finish else []))


@pytest.mark.parametrize("seed", SEEDS)
def test_a_replay_repeats_a_live_run(seed):
    """To the last bit, though a tick waits for the rotation of readings behind it, and a replay for nothing."""
    recording = of_high_order(seed)
    stage, blocks = stage_of(recording.stage), arrived(recording)
    live = run(stage, blocks, finish=False)
    again = run(stage, blocks, decisions=decisions_of(live))
    assert_same_bits(again, live)
