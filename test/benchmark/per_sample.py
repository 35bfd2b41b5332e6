"""One message per sample, as a user would send readings without sample blocks: a publisher and a subscriber process.

python per_sample.py subscribe DURATION      prints received, lost, CPU seconds
python per_sample.py publish RATE DURATION   one JointState per reading, paced by the clock
"""

from __future__ import annotations

import sys
import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

TOPIC = "/benchmark/reading"
QOS = QoSProfile(depth=1000)


def publish(rate: float, duration: float) -> None:
    """Send numbered readings at `rate` for `duration` s, once somebody listens."""
    node = rclpy.create_node("publisher")
    publisher = node.create_publisher(JointState, TOPIC, QOS)
    while publisher.get_subscription_count() == 0:
        time.sleep(0.01)
    message = JointState(name=["head_a"], position=[0.0], velocity=[0.0], effort=[0.0])
    begin, sent = time.perf_counter(), 0
    while (elapsed := time.perf_counter() - begin) < duration:
        while sent < elapsed * rate:
            message.position[0] = float(sent)
            publisher.publish(message)
            sent += 1
        time.sleep(0.0005)
    message.position[0] = -1.0
    publisher.publish(message)
    time.sleep(1.0)
    print(f"sent {sent} cpu {time.process_time():.2f}")


def subscribe(deadline: float) -> None:
    """Count readings until the last one, or until nothing comes any more."""
    node = rclpy.create_node("subscriber")
    seen = {"count": 0, "last": -1.0, "end": 0.0}

    def receive(message: JointState) -> None:
        if message.position[0] < 0:
            seen["end"] = 1.0
            return
        seen["count"] += 1
        seen["last"] = message.position[0]

    node.create_subscription(JointState, TOPIC, receive, QOS)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    begin = time.monotonic()
    while not seen["end"] and time.monotonic() - begin < deadline:
        executor.spin_once(timeout_sec=0.1)
    print(f"received {seen['count']:.0f} cpu {time.process_time():.2f}")


if __name__ == "__main__":
    rclpy.init()
    if sys.argv[1] == "publish":
        publish(float(sys.argv[2]), float(sys.argv[3]))
    else:
        subscribe(float(sys.argv[2]))
    rclpy.shutdown()
