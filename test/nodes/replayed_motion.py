"""Error motion that a cell published, held against a replay of its recording."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from received_blocks import block_of

from rotary_error_monitor.codec.error_motion_blocks import error_motion_from_block
from rotary_error_monitor.pipeline.estimator_settings import EstimatorSettings
from rotary_error_monitor.recordings.replayed import Replay

PATIENCE = 1.0
"""Time, s, that the estimator waits for a block that is late, as it is where many processes share few cores."""

ESTIMATOR = {"period": 0.005, "check_turns": 0.0, "patience": PATIENCE}
"""Parameters of the estimator of a cell whose recording is replayed."""

REPLAY = EstimatorSettings(period_ns=5_000_000, check_turns=0.0, patience_ns=round(PATIENCE * 1e9))
"""The same for the replay."""

REPEATED = 0.9
"""Least share of the estimates that a replay repeats with the same streams.

A head that the estimator discovered later than the recorder did, or whose block was late, is in the recording alone.
"""


def assert_repeated(published: Sequence[Any], replayed: Replay) -> None:
    """Every estimate that a replay makes from the same streams is the published one to the last bit."""
    again = {
        int(stamp): (int(mask), row)
        for stamp, mask, row in zip(
            replayed.stamp_ns, replayed.motion.streams, np.nan_to_num(replayed.error_motion), strict=True
        )
    }
    recorded_until = max(again)  # the recorder ends before the estimator does
    rows = 0
    same = 0
    for message in published:
        block = block_of(message)
        components = error_motion_from_block(block).components
        for stamp, mask, row in zip(block.times_ns, block.column("streams"), components, strict=True):
            rows += int(stamp) <= recorded_until
            if int(stamp) in again and again[int(stamp)][0] == int(mask):
                same += 1
                np.testing.assert_array_equal(again[int(stamp)][1], row)
    assert same > REPEATED * rows, f"{same} of {rows} are repeated"
