"""Joining readings as ROS documents it: one message a sample, an approximate-time synchroniser, a callback.

python synchroniser.py QUEUE SLOP RADIUS     hears what `drivers.py messages` sends, prints what was joined, as JSON

The algorithm is that of `ApproximateTimeSynchronizer` in Python of the package message_filters (ros2/message_filters,
src/message_filters/__init__.py, BSD), written anew, with `queue_size` and `slop`; there is no wheel of the package.
Stamps are whole numbers here and not objects of rclpy, which costs less: what it takes is a lower bound. Where
message_filters is installed, that is taken.
"""

from __future__ import annotations

import itertools
import json
import math
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import rclpy
from geometry_msgs.msg import Vector3Stamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

from rotary_error_monitor.nodes.transport import steady_transport

sys.path.insert(0, str(Path(__file__).parent))
from drivers import driver_topic
from even_stage import HEADS, STREAMS

SILENCE = 3.0
"""Time without a message after which the drivers have ended, s."""

WAIT = 60.0
"""Longest wait for the first message, s."""


class ApproximateTime:
    """Joins messages of several topics whose stamps are less than `slop_ns` apart, nearest to the newcomer first."""

    def __init__(self, count: int, queue_size: int, slop_ns: int, joined: Callable[[Sequence[Any]], None]) -> None:
        """Of `count` topics, with `queue_size` messages kept of each; `joined` is called with each set."""
        self._queues: list[dict[int, Any]] = [{} for _ in range(count)]
        self._queue_size = queue_size
        self._slop_ns = slop_ns
        self._joined = joined

    def add(self, topic: int, stamp_ns: int, message: object) -> None:
        """Take a message, stamped (ns), of one topic by its place; join it if that can be done."""
        own = self._queues[topic]
        own[stamp_ns] = message
        while len(own) > self._queue_size:
            del own[min(own)]
        near = []
        for place, queue in enumerate(self._queues):
            if place == topic:
                near.append([stamp_ns])
                continue
            found = sorted((abs(other - stamp_ns), other) for other in queue if abs(other - stamp_ns) <= self._slop_ns)
            if not found:
                return
            near.append([other for _, other in found])
        if stamp_ns not in own:
            return
        for stamps in itertools.product(*near):
            if max(stamps) - min(stamps) < self._slop_ns:
                self._joined([queue.pop(stamp) for queue, stamp in zip(self._queues, stamps, strict=True)])
                return


class Joiner:
    """What a user would write first: Equation 3 of Lou et al. 2019 in the callback of a synchroniser."""

    def __init__(self, node: Node, queue_size: int, slop: float, radius: float) -> None:
        """Listen to the drivers; `radius` is that of the disc, m."""
        self.messages = dict.fromkeys(STREAMS, 0)
        self.sets = self.of_one_instant = 0
        self.worst = 0.0
        self.heard = 0.0
        self._radius = radius
        types = {stream: JointState if stream in HEADS else Vector3Stamped for stream in STREAMS}
        qos = QoSProfile(depth=1000)
        try:
            import message_filters

            self.how = "message_filters"
            filters = [
                message_filters.Subscriber(node, types[stream], driver_topic(stream), qos_profile=qos)
                for stream in STREAMS
            ]
            for stream, each in zip(STREAMS, filters, strict=True):
                each.registerCallback(lambda _, stream=stream: self._count(stream))
            self._synchroniser = message_filters.ApproximateTimeSynchronizer(filters, queue_size, slop)
            self._synchroniser.registerCallback(lambda *joined: self._join(joined))
        except ModuleNotFoundError:
            self.how = "the documented algorithm"
            synchroniser = ApproximateTime(len(STREAMS), queue_size, round(slop * 1e9), self._join)
            for place, stream in enumerate(STREAMS):
                node.create_subscription(types[stream], driver_topic(stream), self._hearing(place, synchroniser), qos)

    def _hearing(self, place: int, synchroniser: ApproximateTime) -> Callable[[Any], None]:
        def hear(message: Any) -> None:
            self._count(STREAMS[place])
            synchroniser.add(place, stamp_of(message), message)

        return hear

    def _count(self, stream: str) -> None:
        self.messages[stream] += 1
        self.heard = time.monotonic()

    def _join(self, joined: Sequence[Any]) -> None:
        self.sets += 1
        a, b, c, d = (message.position[0] for message in joined[:4])
        radial = math.hypot(self._radius * math.tan((d - c) / 2), self._radius * math.tan((a - b) / 2))
        self.worst = max(self.worst, radial)
        self.of_one_instant += len({stamp_of(message) for message in joined}) == 1


def stamp_of(message: Any) -> int:
    """Stamp of a message, timestamp (ns)."""
    return int(message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec)


def run(queue_size: int, slop: float, radius: float) -> dict[str, object]:
    """Listen until the drivers have ended; what was joined."""
    node = rclpy.create_node("synchroniser")
    joiner = Joiner(node, queue_size, slop, radius)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    end = time.monotonic() + WAIT
    while not joiner.heard and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.1)
    begin, began = time.process_time(), time.monotonic()
    while time.monotonic() - joiner.heard < SILENCE:
        executor.spin_once(timeout_sec=0.1)
    return {
        "how": joiner.how,
        "messages": joiner.messages,
        "sets": joiner.sets,
        "of_one_instant": joiner.of_one_instant,
        "worst": joiner.worst,
        "processor": (time.process_time() - begin) / (joiner.heard - began),
    }


if __name__ == "__main__":
    with steady_transport():
        rclpy.init()
        print(json.dumps(run(int(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3]))), flush=True)
    rclpy.shutdown()
