"""What goes out of the corrections that were computed, where some of them come too late."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.nodes import messages
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
        self.heard = {}

    def now_ns(self):
        return self.time_ns

    def publish_on(self, topic):
        return Publisher(self.sent if topic.key == "axis_corrections" else [])

    def listen_to(self, topic, callback):
        self.heard[topic.key] = callback

    listen_to_bytes = listen_to

    def count_publishers(self, name):
        return 1

    def setting(self, name):
        return 2.0


def in_effect(node, machine, **values):
    """The controller says which corrections it has in effect."""
    names = [*machine.letters]
    positions = [values.get(name, 0.0) for name in names]
    message = messages.joint_state_message(node.time_ns, "base", names, np.array(positions), np.zeros(len(names)))
    node.heard["applied_corrections"](message)


@pytest.fixture
def begun():
    """A node before its first correction, what it computes by, and what it publishes by."""
    node, compensator = Node(), Compensator(GRINDER)
    return node, compensator, CorrectionOutput(node, compensator, AGE_LIMIT)


@pytest.mark.parametrize("said", [5.3e-3, -0.1, 5.3])
def test_what_cannot_be_in_effect_is_no_begin(said, begun):
    """In mm: corrections began 5 mm off, where at most half a millimetre may be, and went back at the rate limit."""
    node, compensator, output = begun
    assert "waiting" in output.forbidden(START)
    in_effect(node, GRINDER, Y=said)
    assert f"{said:.4g} of axis Y is beyond the error limit" in output.forbidden(START)
    assert compensator.state.applied == (0.0,) * len(GRINDER.letters)
    in_effect(node, GRINDER, Y=5.3e-6)
    assert output.forbidden(START) == ""
    assert compensator.state.applied[Y] == 5.3e-6


def test_a_reset_accepts_what_the_controller_says_is_in_effect(begun):
    node, compensator, output = begun
    in_effect(node, GRINDER, Y=2e-3)
    assert "~/reset accepts it" in output.forbidden(START)
    output.reset()
    in_effect(node, GRINDER, Y=2e-3)
    assert output.forbidden(START) == ""
    assert compensator.state.applied[Y] == 2e-3


def test_what_follows_late_corrections_goes_on_from_what_was_published(begun):
    """Joint states of two seconds come at once, as after a cut: the stale part is dropped, the fresh one goes out."""
    node, compensator, output = begun

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
