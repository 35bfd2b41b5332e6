"""Publishers that a node does not hear: it says who and why, though nothing of them ever arrives."""

from __future__ import annotations

import random
from types import SimpleNamespace

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Imu, JointState, PointCloud2

from rotary_error_monitor.nodes.compensation import Compensation
from rotary_error_monitor.nodes.diagnostics import status_name
from rotary_error_monitor.nodes.error_estimator import ErrorEstimator
from rotary_error_monitor.nodes.publishers import NAMELESS, Names, SoleSource


@pytest.fixture
def stranger(cell):
    """A node of a participant of its own, as any other program has: one participant has one type on a topic."""
    context = Context()
    rclpy.init(context=context, domain_id=cell.node.context.get_domain_id(), args=[])
    node = Node("stranger", context=context)
    yield node
    node.destroy_node()
    context.try_shutdown()


def test_a_publisher_that_goes_on_keeps_its_name_though_the_graph_forgets_it():
    """As where another node of its name and process has ended."""

    def told(number, name):
        return SimpleNamespace(endpoint_gid=[number, 0], node_namespace="/", node_name=name)

    names, forgotten = Names(), "_NODE_NAME_UNKNOWN_"
    assert names.of([told(1, "compensation"), told(2, forgotten)]) == ["/compensation", NAMELESS]
    assert names.of([told(2, "rogue"), told(1, forgotten)]) == ["/rogue", "/compensation"]
    assert names.of([told(1, "other")]) == ["/other"]
    assert names.of([]) == []
    assert names.of([told(1, forgotten)]) == [NAMELESS], "one that ended has no name to give"


BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


@pytest.mark.parametrize(
    ("key", "kind", "qos", "words"),
    [
        ("command_samples", PointCloud2, BEST_EFFORT, "not heard: ERROR: Best effort publisher"),
        ("command_samples", Imu, QoSProfile(depth=1), "of type sensor_msgs/msg/Imu, which is not heard"),
        ("machine_joint_states", JointState, BEST_EFFORT, "not heard: ERROR: Best effort publisher"),
    ],
)
def test_a_publisher_that_is_not_heard_is_named_with_the_reason(cell, stranger, key, kind, qos, words):
    topic = cell.wire.topic(key).name
    publisher = stranger.create_publisher(kind, topic, qos)
    name = "error_estimator" if key == "command_samples" else "compensation"
    if name == "compensation":
        cell.run(Compensation, name, machine="xyzac_trt")
    else:
        cell.run(ErrorEstimator, name)
    cell.wait_for_status(f"{name}: publishers of {topic}", words)
    status = cell.wait_for_status(f"{name}: publishers of {topic}", "/stranger")  # its name comes after its publisher
    assert status.level == b"\x02"
    stranger.destroy_publisher(publisher)

    def is_forgotten():
        """A whole report without a word of it."""
        cell.forget_status(f"{name}: publishers of {topic}")
        cell.forget_status(f"{name}: state")
        cell.wait_for_status(f"{name}: state", "active")
        return status_name(f"{name}: publishers of {topic}") not in cell.statuses

    cell.wait_until(is_forgotten, "an end of the complaint")


def test_a_subscription_of_best_effort_hears_both(cell):
    topic = cell.wire.topic("head_samples", "a").name
    publisher = cell.node.create_publisher(PointCloud2, topic, BEST_EFFORT)
    override = f"qos_overrides.{topic}.subscription.reliability"
    cell.run(ErrorEstimator, "error_estimator", **{override: "best_effort"})
    cell.wait_until(lambda: publisher.get_subscription_count() > 0, "the estimator to listen")
    cell.wait_for_status("error_estimator: state", "active")
    cell.forget_status("error_estimator: state")
    cell.wait_for_status("error_estimator: state", "active")
    assert status_name(f"error_estimator: publishers of {topic}") not in cell.statuses


def shared_after(numbers):
    source = SoleSource()
    for step, number in enumerate(numbers):
        source.note(number, 0.01 * step)
    return source.is_shared(0.01 * len(numbers))


@pytest.mark.parametrize("own", [1, 57, 100_000])
@pytest.mark.parametrize("other", [1, 57, 58, 5000])
@pytest.mark.parametrize("share", [1, 2, 7, 60])
def test_two_publishers_are_told_however_seldom_one_of_them_speaks(own, other, share):
    """One message of the other after each `share` of one's own."""
    numbers = []
    for step in range(4):
        numbers += [own + step * share + i for i in range(share)] + [other + step]
    assert shared_after(numbers)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("what", ["loses some", "begins anew"])
def test_one_publisher_is_one_whatever_is_lost_and_however_often_it_begins_anew(seed, what):
    chance = random.Random(seed)
    numbers, number = [], 0
    for _ in range(500):
        if what == "loses some":
            number += 1 + (chance.randrange(50) if chance.random() < 0.1 else 0)
        else:
            number = 1 if chance.random() < 0.05 else number + 1
        numbers.append(number)
    assert not shared_after(numbers)


def test_a_second_publisher_is_forgotten_a_second_after_its_last_word():
    source = SoleSource()
    for step, number in enumerate([10, 11, 1, 12, 2, 13]):
        source.note(number, 0.01 * step)
    assert source.is_shared(0.5)
    assert not source.is_shared(1.2)
