"""Small bags to damage, and bags that were written to do harm."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
import zstandard
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore

from rotary_error_monitor.bags.metadata import type_definition
from rotary_error_monitor.bags.writer import BagTopic, BagWriter
from rotary_error_monitor.codec.contents import SAMPLE_BLOCK, TYPES, Content, JointState, PointStamped, Temperature
from rotary_error_monitor.codec.messages import encode
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.signals.blocks import NANOSECONDS
from rotary_error_monitor.sources.mock import MockSettings, MockSource, mock_stage

START = 1_763_700_000 * NANOSECONDS
RATE = 500.0
STREAMS = ("head_a", "head_b", "head_c", "head_d", "autocollimator", "command")


def stage_contents(blocks: int = 20, duration: float = 0.1) -> dict[str, list[Content]]:
    """The stage of `config/stage.yaml` as it turns, in blocks of some `duration` (s), and joint states beside."""
    settings = MockSettings(seed=5, epoch_ns=START, speeds=(6.0,), forces=False, rate=RATE)
    plant, step = mock_stage(load_stage(), settings), round(duration * NANOSECONDS)
    found: dict[str, list[Content]] = {}
    for stream in STREAMS:
        source = MockSource(plant, stream)
        taken = [source.take(START + i * step, START + (i + 1) * step) for i in range(blocks)]
        found[f"/stage/{stream}/samples"] = [block for block in taken if block is not None]
    letters = ("X", "Y", "Z", "A", "C")
    found["/machine/joint_states"] = [
        JointState(START + i * NANOSECONDS // 50, letters, np.full(5, 0.01), np.zeros(5), np.zeros(0))
        for i in range(round(blocks * duration * 50))
    ]
    found["/machine/temperature"] = [Temperature(START, 20.5)]
    return found


def pose_contents(poses: int = 14) -> dict[str, list[Content]]:
    """Probed poses of the machine `pan2013`."""
    random = np.random.default_rng(6)
    found: dict[str, list[Content]] = {
        "/machine/joint_states": [],
        "/machine/tool_probe": [],
        "/machine/temperature": [],
    }
    for i in range(poses):
        stamp = START + 20 * i * NANOSECONDS
        at = random.uniform(-0.5, 0.5, size=5)
        state = JointState(stamp, ("X", "Y", "Z", "C", "A"), at, np.ones(5), np.zeros(0))
        found["/machine/joint_states"].append(state)
        found["/machine/tool_probe"].append(PointStamped(stamp, random.normal(scale=1e-5, size=3)))
        found["/machine/temperature"].append(Temperature(stamp, 20.0 + 0.1 * i))
    return found


def write_defined(path: Path, definition: bytes) -> Path:
    """Probed poses in a file that defines joint states in its own way."""
    contents = sorted(((value.stamp_ns, name, value) for name, values in pose_contents().items() for value in values),
                      key=lambda row: row[:2])  # fmt: skip
    messages = [(name, TYPES[type(value)], encode(value)) for _, name, value in contents]
    return write_mcap(path, messages, definitions={TYPES[JointState]: definition})


def write_bag(folder: Path, contents: Mapping[str, Sequence[Content]]) -> Path:
    """The bag as our own recorder writes it; what its stamps are does not matter to it."""
    topics = [BagTopic(topic, TYPES[type(values[0])]) for topic, values in contents.items()]
    rows = sorted(((value.stamp_ns, name, i) for name, values in contents.items() for i, value in enumerate(values)))
    with BagWriter(folder, topics, clock=lambda: 0.0) as writer:
        for k, (_, name, i) in enumerate(rows):
            writer.write(name, encode(contents[name][i]), START + k)
    return folder


def write_with_rosbags(
    folder: Path,
    contents: Mapping[str, Sequence[Content]],
    storage: StoragePlugin,
    mode: CompressionMode = CompressionMode.NONE,
) -> Path:
    """The bag as another program writes it."""
    store = get_typestore(Stores.ROS2_JAZZY)
    writer = RosbagsWriter(folder, version=9, storage_plugin=storage)
    if mode != CompressionMode.NONE:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        for name, values in contents.items():
            connection = writer.add_connection(name, TYPES[type(values[0])], typestore=store)
            for value in values:
                writer.write(connection, value.stamp_ns, encode(value))
    return folder


def write_mcap(
    path: Path,
    messages: Sequence[tuple[str, str, bytes]],
    compression: CompressionType = CompressionType.NONE,
    definitions: Mapping[str, bytes] = MappingProxyType({}),
) -> Path:
    """A file of messages (topic, type, bytes), and of definitions of some types that are not their own."""
    writer = Writer(str(path), compression=compression, chunk_size=1 << 14)
    writer.start("ros2")
    channels: dict[str, int] = {}
    for k, (topic, msgtype, data) in enumerate(messages):
        if topic not in channels:
            definition = definitions.get(msgtype, type_definition(msgtype).encode())
            schema = writer.register_schema(msgtype, "ros2msg", definition)
            channels[topic] = writer.register_channel(topic, "cdr", schema)
        writer.add_message(channels[topic], START + k, data, START + k)
    writer.finish()  # type: ignore[no-untyped-call]
    return path


def zstd_of_nothing(path: Path, count: int, chunks: int, said: int | None = None) -> Path:
    """An mcap file whose chunks unpack to `count` zero bytes each and say so, or say another count."""
    write_mcap(path, [("/stage/head_a/samples", SAMPLE_BLOCK, encode(stage_contents(1)["/stage/head_a/samples"][0]))])
    content = path.read_bytes()
    packed = zstandard.ZstdCompressor().compress(bytes(count))
    said = count if said is None else said
    body = struct.pack("<QQQII", START, START, said, 0, 4) + b"zstd" + struct.pack("<Q", len(packed)) + packed
    first = content.index(b"\x0f\x04\x00\x00\x00\x00\x00\x00\x00")  # the end of the data
    chunk = struct.pack("<BQ", 6, len(body)) + body
    path.write_bytes(content[:first] + chunk * chunks + content[first:])
    return path


def changed(
    contents: dict[str, list[Content]], topic: str, number: int, change: Callable[[Content], Content]
) -> dict[str, list[Content]]:
    """The same with one message changed."""
    values = list(contents[topic])
    values[number] = change(values[number])
    return contents | {topic: values}
