"""Drivers of an evenly turning stage, in one process: one message a sample, or sample blocks, on time or late.

python drivers.py messages RATE DURATION LATE APART     a message a sample and instrument on /drivers/<stream>
python drivers.py blocks RATE DURATION LATE APART       the same samples in blocks of 5 ms, on the contract's topics

RATE is of each of the five instruments, 1/s. A message, or a block, leaves up to LATE periods of its own after its
time, drawn anew for each, in the order of each stream. The instruments sample one after another, the last one APART
periods after the first: 0 where one trigger serves all, below 1 where each has its own. Prints what was sent, as JSON.

Messages are serialised once, and stamp and values written into the bytes: the drivers shall not be what is measured.
"""

from __future__ import annotations

import json
import struct
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rclpy
from geometry_msgs.msg import Vector3Stamped
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState, PointCloud2

sys.path.insert(0, str(Path(__file__).parent))
from even_stage import HEADS, STREAMS, values_at

from rotary_error_monitor.codec.cdr_blocks import encode_block
from rotary_error_monitor.description.topics import samples_topic
from rotary_error_monitor.nodes.transport import steady_transport
from rotary_error_monitor.signals.blocks import NANOSECONDS, block_from_samples

BLOCK_NS = 5_000_000
"""Time in a block, ns: the default of the nodes."""

STAMP_AT = 4
"""Bytes before the stamp of a message that begins with a header: the encapsulation of CDR."""

NAP = 0.0005
"""Time between two looks what is due, s: at most ten samples a stream at the highest rates of single messages."""

CHUNK = 2.0
"""Time for which what goes out is prepared at once, s: numbers and delays, so that the loop only sends."""


def driver_topic(stream: str) -> str:
    """Topic of a stream's driver."""
    return f"/drivers/{stream}"


class Template:
    """A serialised message in which stamp and values are written anew each time."""

    def __init__(self, message: JointState | Vector3Stamped, first: float) -> None:
        """Of a message in which `first` stands where the values begin, and nowhere else."""
        self._data = bytearray(serialize_message(message))
        self._values_at = self._data.index(struct.pack("<d", first))

    def filled(self, stamp_ns: int, values: NDArray[np.float64]) -> bytes:
        """Bytes of the message with a timestamp (ns) and values (k,)."""
        struct.pack_into("<iI", self._data, STAMP_AT, *divmod(stamp_ns, NANOSECONDS))
        struct.pack_into(f"<{len(values)}d", self._data, self._values_at, *values)
        return bytes(self._data)


def template_of(stream: str) -> Template:
    """Message of a stream's driver, as drivers publish it: a joint state with its velocity, or a vector."""
    sentinel = 0.123456789
    if stream in HEADS:
        return Template(JointState(name=[stream], position=[sentinel], velocity=[0.0], effort=[0.0]), sentinel)
    message = Vector3Stamped()
    message.vector.x = sentinel
    return Template(message, sentinel)


@dataclass
class Outgoing:
    """What one stream sends: its publisher, what is due when, and how many messages and samples went out."""

    stream: str
    publisher: Publisher
    messages: Iterator[tuple[int, bytes]]
    waiting: tuple[int, bytes] | None = None
    sent: int = 0

    def send_due(self, now_ns: int) -> bool:
        """Send all that is due at `now_ns` (ns); whether anything is left."""
        while True:
            if self.waiting is None:
                self.waiting = next(self.messages, None)
                if self.waiting is None:
                    return False
            if self.waiting[0] > now_ns:
                return True
            self.publisher.publish(self.waiting[1])
            self.sent += 1
            self.waiting = None


def due_times(ready_ns: NDArray[np.int64], period_ns: int, late: float, rng: np.random.Generator) -> NDArray[np.int64]:
    """When messages that are ready at timestamps (ns) leave: up to `late` periods later, none before the one before."""
    delays = rng.uniform(0.0, late * period_ns, len(ready_ns)).astype(np.int64)
    return np.maximum.accumulate(ready_ns + delays)


def single_messages(
    stream: str, epoch_ns: int, rate: float, count: int, late: float, seed: int, shift_ns: int
) -> Iterator[tuple[int, bytes]]:
    """Due time (ns) and bytes of each sample's message."""
    template, rng = template_of(stream), np.random.default_rng(seed)
    chunk = max(round(CHUNK * rate), 1)
    last_ns = 0
    for first in range(0, count, chunk):
        numbers = np.arange(first, min(first + chunk, count))
        times = epoch_ns + shift_ns + np.rint(numbers * (NANOSECONDS / rate)).astype(np.int64)
        due = np.maximum(due_times(times, round(NANOSECONDS / rate), late, rng), last_ns)
        last_ns = int(due[-1])
        values = values_at(stream, times, epoch_ns)
        for due_ns, time_ns, row in zip(due.tolist(), times.tolist(), values.tolist(), strict=True):
            yield due_ns, template.filled(time_ns, row)


def blocks(
    stream: str, epoch_ns: int, rate: float, count: int, late: float, seed: int, shift_ns: int
) -> Iterator[tuple[int, bytes]]:
    """Due time (ns) and bytes of each block."""
    rng = np.random.default_rng(seed)
    names = ["angle"] if stream in HEADS else ["tilt_x", "tilt_y"]
    each = round(rate * BLOCK_NS / NANOSECONDS)
    last_ns = 0
    for first in range(0, count, each):
        numbers = np.arange(first, first + each)
        times = epoch_ns + shift_ns + np.rint(numbers * (NANOSECONDS / rate)).astype(np.int64)
        ready_ns = np.array([times[0] + BLOCK_NS])
        last_ns = max(last_ns, int(due_times(ready_ns, BLOCK_NS, late, rng)[0]))
        yield last_ns, encode_block(block_from_samples(times, names, values_at(stream, times, epoch_ns)), stream)


def run(node: Node, kind: str, rate: float, duration: float, late: float, apart: float) -> dict[str, object]:
    """Send for `duration` s, once somebody listens to each stream; what was sent."""
    single = kind == "messages"
    types = {stream: JointState if stream in HEADS else Vector3Stamped for stream in STREAMS}
    qos = QoSProfile(depth=1000)
    publishers = {
        stream: node.create_publisher(
            types[stream] if single else PointCloud2, driver_topic(stream) if single else samples_topic(stream), qos
        )
        for stream in STREAMS
    }
    while any(publisher.get_subscription_count() == 0 for publisher in publishers.values()):
        time.sleep(0.01)
    epoch_ns = (time.time_ns() // NANOSECONDS + 1) * NANOSECONDS
    count = round(rate * duration)
    make = single_messages if single else blocks
    shift_ns = apart * NANOSECONDS / rate / (len(STREAMS) - 1)
    streams = [
        Outgoing(stream, publisher, make(stream, epoch_ns, rate, count, late, place + 1, round(place * shift_ns)))
        for place, (stream, publisher) in enumerate(publishers.items())
    ]
    begin = time.process_time()
    behind_ns = 0
    while sum(stream.send_due(time.time_ns()) for stream in streams):
        now_ns = time.time_ns()
        behind_ns = max(behind_ns, *(now_ns - stream.waiting[0] for stream in streams if stream.waiting), 0)
        time.sleep(NAP)
    used = time.process_time() - begin
    time.sleep(1.0)  # reliable: what is still asked for again is sent again
    return {
        "sent": {stream.stream: stream.sent for stream in streams},
        "samples": count,
        "epoch_ns": epoch_ns,
        "processor": used,
        "behind_ms": behind_ns * 1e-6,
    }


if __name__ == "__main__":
    with steady_transport():
        rclpy.init()
        driver = rclpy.create_node("drivers")
    print(json.dumps(run(driver, sys.argv[1], *map(float, sys.argv[2:6]))))
    rclpy.shutdown()
