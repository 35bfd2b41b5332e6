"""The read head node: mock, third-party driver, hardware counter."""

from __future__ import annotations

import math

import numpy as np
import pytest
from nodes.plant_samples import assert_samples
from received_blocks import block_of
from sensor_msgs.msg import JointState

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.encoder_head import EncoderHead

BLOCK_NS = 50_000_000


def test_blocks_are_those_of_the_plant_and_end_together(cell, plant):
    topic = cell.wire.topic("head_samples", "b")
    blocks = cell.collect(topic)
    cell.run(EncoderHead, "encoder_head_b", rate=10_000.0, source="mock")
    cell.wait_until(lambda: len(blocks) >= 5, "blocks")
    found = [block_of(message) for message in blocks]
    for block in found:
        assert block.stamp_ns // BLOCK_NS == int(block.times_ns[-1]) // BLOCK_NS
        assert len(block.rows) == 500
    clocks = plant.clocks["head_b"]
    assert clocks.rate == 250.0, "the plant of this test has its usual rate; values are compared by angle"
    times = np.concatenate([block.times_ns for block in found])
    angle = np.concatenate([block.column("angle") for block in found])
    expected = plant.signal("head_b", (times - plant.epoch_ns) * 1e-9)[:, 0]
    assert np.abs(angle - expected).max() < 5e-6
    assert blocks[0].header.frame_id == topic.frame


def test_two_processes_see_the_same_rotor(cell, plant):
    blocks = [cell.collect(cell.wire.topic("head_samples", head)) for head in "ab"]
    for head in "ab":
        cell.start("encoder_head", f"encoder_head_{head}", source="mock")
    cell.wait_until(lambda: all(len(each) > 2 for each in blocks), "blocks of both")
    for head, received in zip("ab", blocks, strict=True):
        block = block_of(received[-1])
        assert_samples(block, plant, f"head_{head}")


def test_people_see_a_joint_state(cell):
    states = cell.collect(cell.wire.topic("head_joint_states", "a"))
    cell.run(EncoderHead, "any_name", head="a", source="mock")
    cell.wait_until(lambda: len(states) >= 2, "joint states")
    assert list(states[0].name) == ["head_a"]
    assert len(states[0].velocity) == len(states[0].effort) == 1
    moved = states[1].position[0] - states[0].position[0]
    elapsed = messages.ns_from_stamp(states[1].header.stamp) - messages.ns_from_stamp(states[0].header.stamp)
    assert states[1].velocity[0] == pytest.approx(moved / elapsed * 1e9, abs=2.0)


def test_a_head_that_the_stage_does_not_have(cell):
    with pytest.raises(InputError, match=r"parameter 'head' is 'encoder_head'; the stage has the heads a, b, c, d"):
        cell.run(EncoderHead, "encoder_head", source="mock")


def test_joint_states_of_a_third_party_driver(cell):
    blocks = cell.collect(cell.wire.topic("head_samples", "a"))
    driver = cell.node.create_publisher(JointState, "/joint_states", 10)
    cell.run(EncoderHead, "encoder_head_a", source="joint_state", joint_state__joint="spindle")
    cell.wait_until(lambda: driver.get_subscription_count() > 0, "the head to listen")
    start = cell.node.get_clock().now().nanoseconds
    turns = 2 * math.pi
    for step in range(8):  # wraps after half a turn
        angle = math.remainder(2.5 + 0.3 * step, turns)
        stamp = messages.stamp_from_ns(start + step * 1_000_000)
        message = JointState(name=["other", "spindle"], position=[0.0, angle])
        message.header.stamp = stamp
        driver.publish(message)
    cell.wait_until(lambda: sum(block.width for block in blocks) == 8, "all samples")
    found = [block_of(block) for block in blocks]
    angles = np.concatenate([block.column("angle") for block in found])
    np.testing.assert_allclose(angles, 2.5 + 0.3 * np.arange(8), atol=1e-12)
    assert found[0].stamp_ns == start


def test_a_driver_without_stamps_or_with_nonsense_is_named(cell):
    driver = cell.node.create_publisher(JointState, "/joint_states", 10)
    cell.run(EncoderHead, "encoder_head_a", source="joint_state")
    cell.wait_until(lambda: driver.get_subscription_count() > 0, "the head to listen")
    driver.publish(JointState(name=["spindle"], position=[0.0]))
    cell.wait_for_status("encoder_head_a: refused /joint_states", "must fill header.stamp")
    message = JointState(name=["spindle"], position=[math.nan])
    message.header.stamp = cell.node.get_clock().now().to_msg()
    driver.publish(message)
    cell.wait_for_status("encoder_head_a: refused /joint_states", "expected a finite angle")


def test_bytes_that_are_no_message_of_the_driver_are_refused_and_the_next_is_taken(cell):
    driver = cell.node.create_publisher(JointState, "/joint_states", 10)
    blocks = cell.collect(cell.wire.topic("head_samples", "a"))
    cell.run(EncoderHead, "encoder_head_a", source="joint_state")
    cell.wait_until(lambda: driver.get_subscription_count() > 0, "the head to listen")
    driver.publish(bytes.fromhex("00010000 01000000 02000000 ffffff7f"))
    cell.wait_for_status("encoder_head_a: refused /joint_states", "16 bytes are no sensor_msgs/msg/JointState")
    message = JointState(name=["spindle"], position=[0.25])
    message.header.stamp = cell.node.get_clock().now().to_msg()
    driver.publish(message)
    cell.wait_until(lambda: bool(blocks), "the sample")
    assert block_of(blocks[0]).column("angle").tolist() == [0.25]


def test_a_counter_in_sysfs(cell, tmp_path):
    (tmp_path / "count").write_text("787200\n")
    blocks = cell.collect(cell.wire.topic("head_samples", "a"))
    cell.run(EncoderHead, "encoder_head_a", source="counter", counter__device=str(tmp_path), poll_rate=200.0)
    cell.wait_until(lambda: any(block.width > 1 for block in blocks), "a block of several samples")
    for message in blocks:
        np.testing.assert_allclose(block_of(message).column("angle"), math.pi / 2)
    (tmp_path / "count").unlink()
    status = cell.wait_for_status("encoder_head_a: refused counter", "no count can be read")
    assert status.level == b"\x02"
    cell.wait_for_status("encoder_head_a: /stage/head_a/samples", "stale")
    (tmp_path / "count").write_text("787300\n")
    cell.wait_for_status("encoder_head_a: /stage/head_a/samples", "samples lost")
