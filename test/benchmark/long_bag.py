"""A bag as long as somebody asks for, made on the spot by the mock stage: no stretch of it repeats another's noise."""

from __future__ import annotations

import argparse
import itertools
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from rotary_error_monitor.bags.writer import BagTopic, BagWriter
from rotary_error_monitor.codec.contents import TYPES
from rotary_error_monitor.codec.messages import encode
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.wire import wire_of
from rotary_error_monitor.plant.motion import Motion, MotionSegment
from rotary_error_monitor.plant.stage import StagePlant
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock
from rotary_error_monitor.sources.mock import MockSettings, mock_stage

EPOCH_NS = 1_763_700_000_000_000_000
STREAMS = (*(f"head_{head}" for head in "abcd"), "autocollimator", "command", "lvdt", "force", "temperature")


AT_ONCE = 50
"""Blocks of a stream that are computed together."""

SPEED = 4.0
CYCLE = Motion(
    (MotionSegment(1.875, 0.0), MotionSegment(9.25, SPEED), MotionSegment(9.375, -SPEED), MotionSegment(1.5, 0.0))
)
CYCLE_NS = 22 * NANOSECONDS
"""Both ways at one speed, rad/s, so that the stage is back where it was: backward longer by what its ramp takes."""


def blocks_of(seed: int, rate: float, block_ns: int) -> Iterator[tuple[str, SampleBlock]]:
    """Blocks of all streams of the mock stage, one period after another, for as long as somebody takes them."""
    plant = replace(mock_stage(load_stage(), MockSettings(seed, EPOCH_NS, (SPEED,), rate=rate)), motion=CYCLE)
    for begin in itertools.count(EPOCH_NS, AT_ONCE * block_ns):
        edges = [begin + k * block_ns for k in range(AT_ONCE + 1)]
        streams = {name: list(_cut(plant, name, edges)) for name in STREAMS}
        for period in range(AT_ONCE):
            yield from ((name, blocks[period]) for name, blocks in streams.items() if len(blocks[period].rows))


def repeated_blocks(seed: int, rate: float, block_ns: int) -> Iterator[tuple[str, SampleBlock]]:
    """The first cycle again and again, each sample with more noise of its own: a fraction of the time of `blocks_of`.

    Noise that is added is as large as what the first cycle shows from one sample to the next; its own comes again.
    """
    first = [
        row
        for row in itertools.takewhile(
            lambda row: row[1].stamp_ns < EPOCH_NS + CYCLE_NS, blocks_of(seed, rate, block_ns)
        )
        if row[1].newest_ns < EPOCH_NS + CYCLE_NS
    ]
    joined = {name: np.concatenate([block.rows for each, block in first if each == name]) for name in STREAMS}
    noise = {name: np.diff(rows[:, 1:], 3, axis=0).std(axis=0) / math.sqrt(20) for name, rows in joined.items()}
    rng = np.random.default_rng(seed)
    for shift_ns in itertools.count(0, CYCLE_NS):
        for name, block in first:
            rows = block.rows.copy()
            rows[:, 1:] += noise[name] * rng.standard_normal((len(rows), rows.shape[1] - 1))
            yield name, SampleBlock(block.stamp_ns + shift_ns, block.names, rows)


def _cut(plant: StagePlant, stream: str, edges: list[int]) -> Iterator[SampleBlock]:
    """Blocks of a stream between edges (ns); of one without a sample in it there are no rows."""
    places = [plant.index_at(stream, edge) for edge in edges]
    first, last = places[0], max(places[-1], places[0] + 1)
    whole = plant.samples(stream, first, last - first)
    for begin, end in itertools.pairwise(places):
        rows = whole.rows[begin - first : end - first].copy()
        stamp_ns = int(whole.times_ns[begin - first]) if len(rows) else 0
        rows[:, 0] = (whole.times_ns[begin - first : end - first] - stamp_ns) * 1e-9
        yield SampleBlock(stamp_ns, whole.names, rows)


def write_long_bag(
    folder: Path,
    size: float = math.inf,
    *,
    seconds: float = math.inf,
    seed: int = 1,
    rate: float = 2_000.0,
    block_ns: int = NANOSECONDS // 10,
    repeated: bool = False,
) -> float:
    """Write a bag whose messages have `size` bytes, or that is so many seconds long; give how long it is, s.

    Args:
        folder: of the bag.
        size: bytes of the messages.
        seconds: that it lasts at most; one of the two is finite.
        seed: of all that is random.
        rate: samples a second of heads, autocollimator and LVDT.
        block_ns: time in a block, ns.
        repeated: whether the first cycle of the stage comes again and again, as in `repeated_blocks`.
    """
    wire = wire_of(load_stage())
    topics = {stream: wire.of_stream(stream) for stream in STREAMS}
    given = [BagTopic(topic.name, TYPES[SampleBlock], topic.qos) for topic in topics.values()]
    written = end_ns = 0
    with BagWriter(folder, given) as writer:
        make = repeated_blocks if repeated else blocks_of
        for stream, block in make(seed, rate, block_ns):
            data = encode(block, topics[stream].frame)
            end_ns = max(end_ns, block.newest_ns)
            writer.write(topics[stream].name, data, block.newest_ns)
            written += len(data)
            if written >= size or end_ns - EPOCH_NS >= seconds * NANOSECONDS:
                break
    return (end_ns - EPOCH_NS) / NANOSECONDS


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--gigabytes", type=float, default=5.0)
    parser.add_argument("--rate", type=float, default=2_000.0, help="samples a second of an instrument")
    parser.add_argument("--block-ms", type=int, default=100, help="time in a block")
    parser.add_argument("--repeated", action="store_true", help="one cycle again and again, with more noise each time")
    given = parser.parse_args()
    block_ns = given.block_ms * NANOSECONDS // 1000
    size = given.gigabytes * 1e9
    seconds = write_long_bag(given.folder, size, rate=given.rate, block_ns=block_ns, repeated=given.repeated)
    print(f"{seconds:.0f} s of samples in {given.folder}")
