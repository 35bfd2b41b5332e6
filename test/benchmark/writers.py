"""Writes the messages of a mock cell in one of several ways, in a process of its own; prints what it took, as JSON.

python writers.py WAY FOLDER RATE SECONDS TIMES

The samples of SECONDS at RATE (1/s, of heads, autocollimator and LVDT), in blocks of 5 ms, are encoded first, then
written TIMES one after another with later stamps, so that what is timed is writing alone. Every way hands its file to
the disk at the end.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore

sys.path.insert(0, str(Path(__file__).parents[1]))
from benchmark.long_bag import EPOCH_NS, STREAMS, blocks_of

from rotary_error_monitor.bags.metadata import type_definition
from rotary_error_monitor.bags.writer import BagTopic, BagWriter
from rotary_error_monitor.codec.contents import TYPES
from rotary_error_monitor.codec.messages import encode
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.wire import wire_of
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock

BLOCK_NS = 5_000_000
"""Time in a block, ns: the default of the nodes."""

TYPE = TYPES[SampleBlock]


class Message(NamedTuple):
    """What is written: topic, CDR bytes, and timestamp (ns)."""

    topic: str
    data: bytes
    time_ns: int


Write = Callable[[Message], None]


def messages_of(rate: float, seconds: float) -> tuple[list[str], list[Message]]:
    """Names of the topics, and all messages of so many seconds."""
    wire = wire_of(load_stage())
    topics = {stream: wire.of_stream(stream) for stream in STREAMS}
    found = []
    for stream, block in blocks_of(1, rate, BLOCK_NS):
        if block.newest_ns - EPOCH_NS > seconds * NANOSECONDS:
            break
        found.append(Message(topics[stream].name, encode(block, topics[stream].frame), block.newest_ns))
    return [topic.name for topic in topics.values()], found


@contextmanager
def by_disk(folder: Path, topics: list[str]) -> Iterator[Write]:
    """The bytes of the messages one after another in a file: what the disk takes."""
    folder.mkdir()
    with (folder / "bytes").open("xb") as file:
        yield lambda message: void(file.write(message.data))


@contextmanager
def by_rosbags(folder: Path, topics: list[str], mode: CompressionMode = CompressionMode.NONE) -> Iterator[Write]:
    """The writer of rosbags, mcap."""
    store = get_typestore(Stores.ROS2_JAZZY)
    writer = RosbagsWriter(folder, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections = {name: writer.add_connection(name, TYPE, typestore=store) for name in topics}
        yield lambda message: writer.write(connections[message.topic], message.time_ns, message.data)


@contextmanager
def by_mcap(folder: Path, topics: list[str], compression: CompressionType) -> Iterator[Write]:
    """The writer of the mcap library."""
    folder.mkdir()
    with (folder / "bag.mcap").open("xb") as file:
        writer = McapWriter(file, compression=compression)
        writer.start(profile="ros2")
        schema = writer.register_schema(TYPE, "ros2msg", type_definition(TYPE).encode())
        channels = {name: writer.register_channel(name, "cdr", schema) for name in topics}
        yield lambda message: writer.add_message(
            channels[message.topic], message.time_ns, message.data, message.time_ns
        )
        writer.finish()


@contextmanager
def by_package(folder: Path, topics: list[str], compression: str) -> Iterator[Write]:
    """The writer below the node `recorder`, with the node's own limits of a file."""
    given = [BagTopic(name, TYPE) for name in topics]
    with BagWriter(folder, given, max_file_size=1 << 30, max_file_duration=900.0, compression=compression) as writer:
        yield lambda message: writer.write(message.topic, message.data, message.time_ns)


WAYS = {
    "bytes alone": by_disk,
    "rosbags": by_rosbags,
    "mcap": lambda folder, topics: by_mcap(folder, topics, CompressionType.NONE),
    "this package": lambda folder, topics: by_package(folder, topics, "none"),
    "rosbags, zstd": lambda folder, topics: by_rosbags(folder, topics, CompressionMode.STORAGE),
    "mcap, zstd": lambda folder, topics: by_mcap(folder, topics, CompressionType.ZSTD),
    "this package, zstd": lambda folder, topics: by_package(folder, topics, "zstd"),
    "this package, lz4": lambda folder, topics: by_package(folder, topics, "lz4"),
}


def void(_: object) -> None:
    """Nothing, of something."""


def resident_mb() -> float:
    """Memory that this process holds now, MB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def written(way: str, folder: Path, rate: float, seconds: float, times: int) -> dict[str, float]:
    """Write, and say what it took: s of processor and on the wall, MB held after the first time and at the end."""
    topics, given = messages_of(rate, seconds)
    span_ns = round(seconds * NANOSECONDS)
    held = []
    wall, processor = time.perf_counter(), time.process_time()
    with ExitStack() as stack:
        write = stack.enter_context(WAYS[way](folder, topics))
        for turn in range(times):
            for message in given:
                write(message._replace(time_ns=message.time_ns + turn * span_ns))
            held.append(resident_mb())
    for path in folder.iterdir():
        with path.open("rb") as file:
            os.fsync(file.fileno())
    return {
        "processor": time.process_time() - processor,
        "wall": time.perf_counter() - wall,
        "messages": times * len(given),
        "bytes": times * sum(len(message.data) for message in given),
        "size": sum(path.stat().st_size for path in folder.iterdir()),
        "first_mb": held[0],
        "last_mb": held[-1],
    }


if __name__ == "__main__":
    name, place, hz, duration, often = sys.argv[1:6]
    print(json.dumps(written(name, Path(place), float(hz), float(duration), int(often))))
