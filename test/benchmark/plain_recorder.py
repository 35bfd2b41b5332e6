"""What one would write first to record a cell in Python: raw subscriptions, an executor, the writer of a library.

python plain_recorder.py WRITER FOLDER TOPIC...     WRITER is a way of `writers.py`, such as `rosbags`

Every topic carries sample blocks. Says `listening` on standard output, ends at SIGINT, and then says how many messages
it has written.
"""

from __future__ import annotations

import signal
import sys
import threading
import time
from pathlib import Path

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from sensor_msgs.msg import PointCloud2

sys.path.insert(0, str(Path(__file__).parent))
from writers import WAYS, Message, Write

from rotary_error_monitor.nodes.transport import steady_transport

_DEPTH = 5000
"""Messages of a topic that may wait: as of the package's recorder."""


def record(write: Write, topics: list[str], ended: threading.Event) -> int:
    """Write what comes until it is ended; the number of messages."""
    with steady_transport():
        rclpy.init(signal_handler_options=rclpy.SignalHandlerOptions.NO)
        node = rclpy.create_node("plain_recorder")
    count = 0

    def receive(topic: str, data: bytes) -> None:
        nonlocal count
        write(Message(topic, data, time.time_ns()))
        count += 1

    for topic in topics:
        node.create_subscription(
            PointCloud2, topic, lambda data, t=topic: receive(t, data), QoSProfile(depth=_DEPTH), raw=True
        )
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    print("listening", flush=True)
    while not ended.is_set():
        executor.spin_once(timeout_sec=0.1)
    node.destroy_node()
    rclpy.shutdown()
    return count


if __name__ == "__main__":
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    way, place, *names = sys.argv[1:]
    with WAYS[way](Path(place), names) as into:
        written = record(into, names, stop)
    print(written, flush=True)
