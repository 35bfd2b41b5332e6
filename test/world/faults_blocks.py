"""Faults of the transport: blocks that are late, lost, repeated, out of order, overlapping or empty."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.signals.blocks import SampleBlock

from .fault import Change, Draw, Fault, Size, blocks_from, kept, last_ns, some_of


def _late(draw: Draw) -> Change:
    """Blocks arrive later from a time on; their stamps are right."""
    topic, begin = draw.topics("stream")[0], draw.begin_ns("either")
    delay = draw.sized(Size(0.1, 5.0))
    blocks, arrivals = draw.recording.blocks[topic], draw.recording.arrivals[topic].copy()
    arrivals[blocks_from(blocks, begin) :] += round(delay * 1e9)
    return Change({topic: (blocks, arrivals)}, begin, delay, "s")


def _some_from(draw: Draw, topic: str, begin_ns: int, share: float) -> NDArray[np.int64]:
    """Indices of a share of the blocks of a topic from a time on."""
    blocks = draw.recording.blocks[topic]
    return some_of(draw, np.arange(blocks_from(blocks, begin_ns), len(blocks)), share)


def _lost(draw: Draw) -> Change:
    """A share of the blocks is lost from a time on."""
    topic, begin = draw.topics("stream")[0], draw.begin_ns("either")
    share = draw.sized(Size(0.05, 0.95))
    keep = np.ones(len(draw.recording.blocks[topic]), bool)
    keep[_some_from(draw, topic, begin, share)] = False
    return Change({topic: kept(draw.recording, topic, keep)}, begin, share, "share of blocks")


def _duplicated(draw: Draw) -> Change:
    """A share of the blocks comes twice, the second time at once or up to three blocks later."""
    topic, begin = draw.topics("stream")[0], draw.begin_ns("either")
    share = draw.sized(Size(0.01, 1.0))
    n = len(draw.recording.blocks[topic])
    twice = _some_from(draw, topic, begin, share)
    places = np.concatenate([np.arange(n) + 0.0, np.minimum(twice + draw.rng.integers(0, 4, len(twice)), n - 1) + 0.5])
    order = np.argsort(places, kind="stable")
    chosen = np.concatenate([np.arange(n), twice])[order]
    blocks = [draw.recording.blocks[topic][i] for i in chosen]
    arrivals = draw.recording.arrivals[topic][np.floor(places[order]).astype(int)]
    return Change({topic: (blocks, arrivals)}, begin, share, "share of blocks")


def _out_of_order(draw: Draw) -> Change:
    """Neighbouring blocks come in another order; the times of arrival stay."""
    topic, begin = draw.topics("stream")[0], draw.begin_ns("either")
    share = draw.sized(Size(0.01, 0.5))
    blocks = list(draw.recording.blocks[topic])
    free = 0
    for i in some_of(draw, np.arange(blocks_from(blocks, begin), len(blocks) - 1), share):
        if i >= free:
            free = min(i + int(draw.rng.integers(2, 6)), len(blocks))
            order = draw.rng.permutation(free - i)
            order = order[::-1] if np.all(np.diff(order) > 0) else order
            blocks[i:free] = [blocks[i + j] for j in order]
    return Change({topic: (blocks, draw.recording.arrivals[topic])}, begin, share, "share of blocks")


def _overlapping(draw: Draw) -> Change:
    """Blocks begin with the last samples of the block before."""
    topic, begin = draw.topics("stream")[0], draw.begin_ns("either")
    share = draw.sized(Size(0.05, 1.0))
    blocks = draw.recording.blocks[topic]
    made = list(blocks)
    for i in some_of(draw, np.arange(blocks_from(blocks, begin) + 1, len(blocks)), share):
        before, block = blocks[i - 1], blocks[i]
        repeated = before.rows[-int(draw.rng.integers(1, max(2, len(before.rows) + 1))) :].copy()
        if len(repeated):
            stamp = before.stamp_ns + round(float(repeated[0, 0]) * 1e9)
            repeated[:, 0] += (before.stamp_ns - stamp) * 1e-9
            own = block.rows.copy()
            own[:, 0] += (block.stamp_ns - stamp) * 1e-9
            made[i] = SampleBlock(stamp, block.names, np.concatenate([repeated, own]))
    return Change({topic: (made, draw.recording.arrivals[topic])}, begin, share, "share of blocks")


def _empty(draw: Draw) -> Change:
    """A share of the blocks holds no sample."""
    topic, begin = draw.topics("stream")[0], draw.begin_ns("either")
    share = draw.sized(Size(0.01, 1.0))
    blocks = list(draw.recording.blocks[topic])
    for i in _some_from(draw, topic, begin, share):
        blocks[i] = SampleBlock(blocks[i].stamp_ns, blocks[i].names, blocks[i].rows[:0])
    return Change({topic: (blocks, draw.recording.arrivals[topic])}, begin, share, "share of blocks")


def _paused(draw: Draw) -> Change:
    """No block of any stream for some time."""
    begin = draw.begin_ns("later")
    longest = max(0.3 * draw.recording.duration, 0.1)
    pause = draw.sized(Size(min(0.5, 0.5 * longest), longest))
    end = min(begin + round(pause * 1e9), last_ns(draw.recording))
    changed = {}
    for topic, blocks in draw.recording.blocks.items():
        keep = np.ones(len(blocks), bool)
        keep[blocks_from(blocks, begin) : blocks_from(blocks, end)] = False
        changed[topic] = kept(draw.recording, topic, keep)
    return Change(changed, begin, pause, "s", end)


BLOCK_FAULTS: list[Fault] = [
    Fault("blocks_late", "The blocks of one stream arrive late, with right stamps.", "stream", _late),
    Fault("blocks_lost", "Blocks of one stream are lost.", "stream", _lost),
    Fault("blocks_duplicated", "Blocks of one stream come twice.", "stream", _duplicated),
    Fault("blocks_out_of_order", "Blocks of one stream come out of order.", "stream", _out_of_order),
    Fault("blocks_overlapping", "Blocks of one stream repeat the end of the block before.", "stream", _overlapping),
    Fault("blocks_empty", "Blocks of one stream hold no samples.", "stream", _empty),
    Fault("recording_paused", "Nothing is recorded of any stream for some time.", "all", _paused),
]
