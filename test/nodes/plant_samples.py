"""What nodes send, held against the samples that it shows: the plant's, or those of their own blocks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from received_blocks import block_of

from rotary_error_monitor.nodes import messages
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


def assert_figures(figures: Sequence[Any], blocks: Sequence[Any], names: Sequence[str], hidden: str = "") -> None:
    """What is sent for plotting, in µm and µrad, is the last sample of a published block; a gap where nothing is seen.

    The one that is hidden is never seen, and in one of them all others are.
    """
    sent = {}
    for message in blocks:
        block = block_of(message)
        shown = block.columns(names)[-1].copy()
        if hidden:
            seen = int(block.column("observable")[-1])
            assert not seen >> names.index(hidden) & 1
            shown[[not seen >> index & 1 for index in range(len(names))]] = np.nan
        sent[int(block.times_ns[-1])] = shown
    found = whole = 0
    for message in figures:
        stamp_ns = messages.ns_from_stamp(message.header.stamp)
        if stamp_ns not in sent:
            continue  # its block was published before anybody listened
        found += 1
        vectors = (message.twist.linear, message.twist.angular)
        shown = np.array([getattr(vector, axis) for vector in vectors for axis in "xyz"])
        np.testing.assert_array_equal(shown, 1e6 * sent[stamp_ns])
        whole += np.count_nonzero(np.isnan(shown)) == bool(hidden)
    assert found > 2 and whole > 0
