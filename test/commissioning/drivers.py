"""Drivers of a newly built stage, as a process: they publish all the time, and turn the stage when they are told to.

    python -m commissioning.drivers '{"seed": 3, "build": {"count": 4}, "degrees": ["head_b"], "namespace": "/left"}'

Each line on standard input is a word: `turn` plays the recording of the stage, `home` puts it back where that begins.
What is played is said with the time (ns) by which its stamps are later than those of the recording. Third-party drivers
publish joint states and vectors, one sample a message, on names of their own; with `blocks` what is published is what
the package's own source nodes would make of it.
"""

from __future__ import annotations

import json
import math
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np
import rclpy
from described_stages import stage_of
from geometry_msgs.msg import Vector3Stamped
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
from world.newly_built import NewlyBuilt, build
from world.recording import AUTOCOLLIMATOR, COMMAND, head_topic, samples

from rotary_error_monitor.description.wire import Topic, wire_of
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.qos import profile
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock

AHEAD_NS = 2_000_000
LETTERS = "abcdef"
DEGREES = 180.0 / math.pi
JITTER = 1e-6  # s, of single stamps, as of hardware
TURNING = {
    "duration": 45.0,
    "peak_speed": 1.2,
    "noise": 1.0,
    "odd_rates": False,
    "lost_blocks": 0.0,
    "stamp_jitter": JITTER,
    "rates": {**{head_topic(letter): 250.0 for letter in LETTERS}, COMMAND: 100.0, AUTOCOLLIMATOR: 100.0},
}
"""Of all stages that are turned live: slow, with as many messages as few cores take; lost is what ROS loses."""

Publish = Callable[[int, np.ndarray], None]


def built_stage(seed: int, options: dict[str, Any]) -> NewlyBuilt:
    """The stage that a process with these arguments has."""
    built = build(seed, **{**TURNING, **options})
    # what the drive lags, whoever sets it up knows; latencies of heads are up to 1 ms
    for section in (built.nominal, built.true):
        section["limits"]["latency"] = 1.5e-3
    if "spindle.tilt" in built.nominal.get("uncertainty", {}):  # as well as a certificate knows it
        built.nominal["uncertainty"] |= {"spindle.tilt": 1e-7, "mirror.flatness": 1e-7}
    return built


@dataclass
class Channel:
    """One stream: what is recorded of it, how it is published, its noise at rest, whether it tells a speed as well."""

    times_ns: np.ndarray
    values: np.ndarray
    publish: Publish
    noise: float
    speed: bool
    due_ns: int = 0

    def __post_init__(self) -> None:
        self.period_ns = int(np.median(np.diff(self.times_ns)))


class Drivers:
    """All drivers of one stage."""

    def __init__(self, node: Node, built: NewlyBuilt, degrees: list[str], namespace: str, blocks: bool) -> None:
        self._rng = np.random.default_rng(1)
        self._start_ns = built.recording.start_ns
        self._channels = []
        wire = wire_of(stage_of(built.nominal)).within(namespace)
        for topic, recorded in built.recording.blocks.items():
            times, values = samples(recorded)
            name = topic.split("/")[2]
            values = values * (DEGREES if name in degrees else 1.0)
            publish = _block(node, wire.of_stream(name)) if blocks else _message(node, topic, namespace)
            size = 1e-7 * (DEGREES if name in degrees else 1.0)
            self._channels.append(Channel(times, values, publish, size, topic == COMMAND))
        self._rows = sorted(
            (int(when), k, i) for k, each in enumerate(self._channels) for i, when in enumerate(each.times_ns)
        )
        self._at = 0

    def stand(self) -> None:
        """Publish once what is due while the stage stands."""
        now = time.time_ns()
        for channel in self._channels:
            channel.due_ns = max(channel.due_ns, now - NANOSECONDS)  # as at the beginning
            while channel.due_ns <= now:
                value = channel.values[self._at].copy()
                value += channel.noise * self._rng.standard_normal(len(value))
                value[1:] *= not channel.speed
                scatter = round(JITTER * NANOSECONDS * self._rng.standard_normal())
                channel.publish(channel.due_ns + scatter, value)
                channel.due_ns += channel.period_ns

    def turn(self) -> int:
        """Play the recording; gives by how much later its stamps are, ns."""
        shift = time.time_ns() + AHEAD_NS - self._start_ns
        print(f"playing {shift}", flush=True)
        for when, k, i in self._rows:
            stamp = when + shift
            wait = (stamp - time.time_ns()) * 1e-9
            if wait > 0:
                time.sleep(wait)
            self._channels[k].publish(stamp, self._channels[k].values[i])
        for channel in self._channels:
            channel.due_ns = int(channel.times_ns[-1]) + shift + channel.period_ns
        self._at = -1
        print("stands", flush=True)
        return shift

    def home(self) -> None:
        """Stand where the recording begins."""
        self._at = 0
        print("home", flush=True)


def _message(node: Node, topic: str, namespace: str) -> Publish:
    """As a third-party driver: of a head, an autocollimator or a controller."""
    if topic == AUTOCOLLIMATOR:
        vectors = node.create_publisher(Vector3Stamped, f"{namespace}/collimator/angles", qos_profile_sensor_data)

        def publish_tilt(stamp_ns: int, value: np.ndarray) -> None:
            message = Vector3Stamped(header=messages.header(stamp_ns, "collimator"))
            message.vector.x, message.vector.y = float(value[0]), float(value[1])
            vectors.publish(message)

        return publish_tilt
    name = "plc/axes" if topic == COMMAND else f"{topic.split('/')[2].replace('head_', 'reader_')}/position"
    joints = ["X", "C"] if topic == COMMAND else ["disc"]
    states = node.create_publisher(JointState, f"{namespace}/{name}", 100)

    def publish_angle(stamp_ns: int, value: np.ndarray) -> None:
        positions = [0.1, float(value[0])] if topic == COMMAND else [float(value[0])]
        states.publish(JointState(header=messages.header(stamp_ns, "driver"), name=joints, position=positions))

    return publish_angle


def _block(node: Node, topic: Topic) -> Publish:
    """As a source node of the package, one sample a block."""
    blocks = node.create_publisher(messages.message_class(topic.type), topic.name, profile(topic))
    names = ("t", *topic.columns)

    def publish(stamp_ns: int, value: np.ndarray) -> None:
        row = np.concatenate([[0.0], value])[None]
        blocks.publish(messages.block_bytes(SampleBlock(stamp_ns, names, row), topic.frame))

    return publish


def _listen(words: SimpleQueue[str]) -> None:
    for line in sys.stdin:
        words.put(line.strip())
    words.put("end")


def main(arguments: dict[str, Any]) -> None:
    """Publish until standard input ends."""
    built = built_stage(arguments["seed"], arguments["build"])
    rclpy.init()
    node = Node(f"drivers_{arguments['seed']}")
    namespace = arguments.get("namespace", "")
    drivers = Drivers(node, built, arguments.get("degrees", []), namespace, arguments.get("blocks", False))
    words: SimpleQueue[str] = SimpleQueue()
    threading.Thread(target=_listen, args=(words,), daemon=True).start()
    print("ready", flush=True)
    while True:
        try:
            word = words.get_nowait()
        except Empty:
            drivers.stand()
            time.sleep(0.002)
            continue
        if word == "end":
            break
        getattr(drivers, word)()
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
