"""What goes out of the corrections that were computed, where some of them come too late."""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.nodes.correction_output import CorrectionOutput
from rotary_error_monitor.pipeline.compensation import Compensator

GRINDER = load_machine("grinder_zhou2023")
START = 1_763_700_000_000_000_000
PERIOD = 10_000_000
AGE_LIMIT = 200_000_000
FEED = 0.4
Y = GRINDER.letters.index("Y")


class Publisher:
    def __init__(self, sent):
        self.publish = sent.append


class Node:
    """Of a node, what the output uses: its clock and its publishers, by topic."""

    def __init__(self):
        self.wire = load_wire(("a", "b", "c", "d"))
        self.time_ns = START
        self.sent = []

    def now_ns(self):
        return self.time_ns

    def publish_on(self, topic):
        return Publisher(self.sent if topic.key == "axis_corrections" else [])

    def listen_to(self, topic, callback):
        """Nobody speaks."""

    listen_to_bytes = listen_to


def test_what_follows_late_corrections_goes_on_from_what_was_published():
    """Joint states of two seconds come at once, as after a cut: the stale part is dropped, the fresh one goes out."""
    node, compensator = Node(), Compensator(GRINDER)
    output = CorrectionOutput(node, compensator, AGE_LIMIT)

    def joint_state(step):
        positions = {"X": -1.35 + FEED * step * PERIOD * 1e-9, "Z": -0.4, "Y": 0.1}
        compensator.accept_joint_state(START + step * PERIOD, positions, {"X": FEED, "Z": 0.0, "Y": 0.0})

    def send(step):
        node.time_ns = START + step * PERIOD
        output.send(compensator.advance())

    for step in range(100):
        joint_state(step)
        send(step)
    for step in range(100, 300):
        joint_state(step)
    send(299)
    for step in range(300, 320):
        joint_state(step)
        send(step)
    stamps = [
        (message.header.stamp.sec * 10**9 + message.header.stamp.nanosec - START) // PERIOD for message in node.sent
    ]
    assert stamps[-41:] == list(range(279, 320)), "the stale ones stay out"
    values = np.array([message.position[Y] for message in node.sent])
    assert abs(values[98] - values[-41]) > 2e-6, "what was asked for has changed meanwhile"
    assert np.abs(np.diff(values[-41:])).max() < 5e-7, "from one to the next it changes by little"
