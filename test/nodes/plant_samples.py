"""What the nodes of mock instruments send, held against the samples of the plant."""

from __future__ import annotations

from typing import Any

import numpy as np

from rotary_error_monitor.plant.stage import StagePlant
from rotary_error_monitor.signals.blocks import SampleBlock


def assert_samples(block: SampleBlock, plant: StagePlant, stream: str) -> None:
    """The block's samples are the plant's to the last bit."""
    same = plant.samples(stream, plant.index_at(stream, block.stamp_ns), len(block.rows))
    np.testing.assert_array_equal(block.times_ns, same.times_ns)
    np.testing.assert_array_equal(block.rows[:, 1:], same.rows[:, 1:])


def assert_sample(stamp: Any, shown: list[float], plant: StagePlant, stream: str) -> None:
    """What people are shown at a stamp is the plant's sample of that instant to the last bit; it may well be zero."""
    stamp_ns = stamp.sec * 10**9 + stamp.nanosec
    same = plant.samples(stream, plant.index_at(stream, stamp_ns), 1)
    assert int(same.times_ns[0]) == stamp_ns
    assert shown == list(same.rows[0, 1:])
