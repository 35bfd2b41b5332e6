"""What the tests of bags share: contents of every kind, and how other libraries read a bag."""

from __future__ import annotations

import struct
from collections import defaultdict
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from rotary_error_monitor.codec.contents import Content, JointState, PointStamped, PoseWithCovariance, Temperature
from rotary_error_monitor.signals.blocks import block_from_samples

START = 1_763_700_000_000_000_000


@pytest.fixture
def contents() -> dict[str, list[Content]]:
    """Some messages of every kind on topics of the wire contract, 10 ms apart."""
    random = np.random.default_rng(7)
    rows: dict[str, list[Content]] = defaultdict(list)
    for i in range(12):
        stamp = START + i * 10_000_000
        times = stamp + np.arange(20) * 500_000
        rows["/stage/head_a/samples"].append(block_from_samples(times, ["angle"], random.normal(size=(20, 1))))
        rows["/stage/autocollimator/samples"].append(
            block_from_samples(times + 77, ["tilt_x", "tilt_y"], random.normal(size=(20, 2)))
        )
        names = ("X", "Y", "Z", "C", "A")
        rows["/machine/joint_states"].append(JointState(stamp, names, *random.normal(size=(3, 5))))
        rows["/machine/tool_probe"].append(PointStamped(stamp, random.normal(size=3), "workpiece"))
        rows["/machine/temperature"].append(Temperature(stamp, 20.0 + i, 1e-4, "machine"))
        rows["/stage/error_motion/pose"].append(
            PoseWithCovariance(stamp, random.normal(size=3), random.normal(size=4), random.normal(size=(6, 6)), "stage")
        )
    return dict(rows)


def assert_same(one: Content, other: Content) -> None:
    """Equal to the last bit."""
    assert type(one) is type(other)
    for name in (each.name for each in fields(one)):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def read_by_rosbags(folder: Path) -> list[tuple[str, int, bytes]]:
    """Topic, time of recording (ns) and bytes of each message."""
    with AnyReader([folder]) as reader:
        rows = [(connection.topic, stamp, bytes(data)) for connection, stamp, data in reader.messages()]
        assert len(rows) == reader.message_count
    return sorted(rows)


def halted() -> float:
    """Clock of a writer whose chunks are those that are flushed by hand: none is written because a test had to wait."""
    return 0.0


def read_by_mcap(folder: Path) -> list[tuple[str, int, bytes]]:
    """The same by the mcap library, from the one file of the bag."""
    (file,) = folder.glob("*.mcap")
    with file.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        rows = [(channel.topic, message.log_time, message.data) for _, channel, message in reader.iter_messages()]
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None
        assert summary.statistics.message_count == len(rows)
    return sorted(rows)


def records(content: bytes) -> list[tuple[int, int, int]]:
    """Opcode, start and end of each record outside of chunks."""
    found, position = [], 8
    while position < len(content) - 8:
        opcode, length = struct.unpack_from("<BQ", content, position)
        found.append((opcode, position, position + 9 + length))
        position += 9 + length
    return found
