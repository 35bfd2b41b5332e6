"""The estimator as a node: right values, and what happens when streams fail."""

from __future__ import annotations

import signal

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2

from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.autocollimator import Autocollimator
from rotary_error_monitor.nodes.encoder_head import EncoderHead
from rotary_error_monitor.nodes.error_estimator import ErrorEstimator
from rotary_error_monitor.nodes.mock_controller import MockController
from rotary_error_monitor.signals.blocks import SampleBlock, block_from_samples

COMPONENTS = ("exc", "eyc", "ezc", "eac", "ebc", "ecc")
PERIOD = 0.005
SIGMAS = 6.0
PERIOD_NS = 5_000_000


@pytest.fixture
def estimates(cell):
    return cell.collect(cell.wire.topic("error_motion_samples"))


@pytest.fixture
def sensors(cell):
    nodes = {f"head_{head}": cell.run(EncoderHead, f"encoder_head_{head}") for head in "abcd"}
    nodes["autocollimator"] = cell.run(Autocollimator, "autocollimator")
    nodes["command"] = cell.run(MockController, "mock_controller")
    return nodes


def check_against_truth(received, plant):
    """Every component that is claimed to be observable is right, the others are zero."""
    bounds: dict[str, list[float]] = {}
    for message in received:
        block = messages.block_from_message(message)
        truth = plant.scene((block.times_ns - plant.epoch_ns) * 1e-9).error_motion
        bits = block.column("observable").astype(int)
        for index, name in enumerate(COMPONENTS):
            claimed = bits >> index & 1 == 1
            found = block.column(name)
            assert (found[~claimed] == 0.0).all()
            if claimed.any():
                bound = SIGMAS * np.sqrt(block.column(f"var_{name}"))
                assert (np.abs(found - truth[:, index]) <= bound)[claimed].all(), name
                bounds.setdefault(name, []).extend(bound[claimed].tolist())
    for name, each in bounds.items():
        assert np.median(each) < 1e-5, f"an uncertainty of {name} that bounds something"
    return set(bounds)


def newest_mask(received):
    return int(messages.block_from_message(received[-1]).column("streams")[-1])


def test_all_streams_give_all_components_but_the_axial_one(cell, estimates, sensors, plant):
    poses = cell.collect(cell.wire.topic("error_motion_pose"))
    cell.run(ErrorEstimator, "error_estimator", period=PERIOD)
    cell.wait_until(lambda: len(estimates) > 10 and len(poses) > 2, "estimates", 30)
    assert check_against_truth(estimates[2:], plant) == {"exc", "eyc", "eac", "ebc", "ecc"}
    covariance = np.reshape(poses[-1].pose.covariance, (6, 6))
    assert covariance[2, 2] == -1.0
    assert (np.diag(covariance)[[0, 1, 3, 4, 5]] > 0).all()
    cell.forget_status("error_estimator: estimate")
    cell.wait_for_status("error_estimator: estimate", "complete")
    assert float(cell.figures("error_estimator: estimate")["rate_hz"]) > 50
    cell.wait_for_status("error_estimator: /stage/head_a/samples", "alive")


def test_heads_die_one_after_another(cell, estimates, sensors, plant):
    cell.run(ErrorEstimator, "error_estimator", period=PERIOD)
    cell.wait_until(lambda: len(estimates) > 5, "estimates", 30)

    cell.remove(sensors["head_a"])
    cell.wait_for_status("error_estimator: estimate", "without head_a")
    cell.wait_for_status("error_estimator: /stage/head_a/samples", "stale")
    cell.wait_until(lambda: newest_mask(estimates) & 0b1111 == 0b1110, "estimates from three heads")
    assert int(messages.block_from_message(estimates[-1]).column("observable")[-1]) & 0b11 == 0b11

    cell.remove(sensors["head_b"])
    cell.wait_for_status("error_estimator: estimate", "not observable: eyc")
    cell.wait_until(lambda: newest_mask(estimates) & 0b1111 == 0b1100, "estimates from two heads")
    check_against_truth(estimates[2:], plant)

    cell.remove(sensors["head_c"])
    cell.wait_for_status("error_estimator: estimate", "too few heads")
    before = len(estimates)
    cell.spin_for(0.5)
    assert len(estimates) <= before + 1

    cell.run(EncoderHead, "encoder_head_c")
    cell.wait_until(lambda: len(estimates) > before + 5, "estimates with the head that came back")
    check_against_truth(estimates[2:], plant)


def test_autocollimator_and_command_go_stale(cell, estimates, sensors, plant):
    cell.run(ErrorEstimator, "error_estimator", period=PERIOD)
    cell.wait_for_status("error_estimator: estimate", "complete", 30)
    sensors["autocollimator"].trigger_deactivate()
    name = "error_estimator: estimate"
    cell.wait_until(
        lambda: cell.has_status(name, "not observable: eac, ebc") and cell.status(name).level == b"\x01",
        "a warning, not an error, that the tilt is missing",
    )
    sensors["command"].trigger_deactivate()
    cell.wait_for_status("error_estimator: estimate", "not observable: eac, ebc, ecc")
    sensors["autocollimator"].trigger_activate()
    sensors["command"].trigger_activate()
    cell.wait_for_status("error_estimator: estimate", "complete")
    assert check_against_truth(estimates[2:], plant) == {"exc", "eyc", "eac", "ebc", "ecc"}


def test_the_estimator_is_killed_and_comes_back(cell, estimates, sensors, plant):
    process = cell.start("error_estimator", period=PERIOD)
    cell.wait_until(lambda: len(estimates) > 5, "estimates", 60)
    process.send(signal.SIGKILL)
    cell.wait_until(lambda: process.exit_code is not None, "end of the process")
    cell.spin_for(0.3)
    before = len(estimates)
    cell.start("error_estimator", period=PERIOD)
    cell.wait_until(lambda: len(estimates) > before + 5, "estimates of its successor", 60)
    stamps = [message.header.stamp.sec * 10**9 + message.header.stamp.nanosec for message in estimates]
    assert stamps == sorted(stamps)
    check_against_truth(estimates[2:before] + estimates[before + 2 :], plant)


def test_what_is_old_or_no_block_is_refused(cell, estimates):
    topic = cell.wire.topic("head_samples", "a")
    cell.run(ErrorEstimator, "error_estimator", period=PERIOD)
    send_block, send = cell.publish_blocks(topic), cell.publish_on(topic)
    old = cell.node.get_clock().now().nanoseconds - 5_000_000_000
    times = old + np.arange(10) * PERIOD_NS
    send_block(block_from_samples(times, ("angle",), np.zeros((10, 1))))
    cell.wait_for_status(f"error_estimator: {topic.name}", "are the clocks of all computers alike")
    good = messages.block_bytes(SampleBlock(old, ("t", "angle"), np.zeros((1, 2))), topic.frame)
    wrong = deserialize_message(good, PointCloud2)
    wrong.height = 3
    send(wrong)
    cell.wait_for_status(f"error_estimator: refused {topic.name}", "height 3")
    cell.spin_for(0.2)
    assert estimates == []


def test_heads_that_contradict_one_another(cell, estimates, plant):
    """One head jumps by ten lines: four heads show that something is wrong, not what; nothing is published."""
    cell.run(ErrorEstimator, "error_estimator", period=PERIOD)
    send = {head: cell.publish_blocks(cell.wire.topic("head_samples", head)) for head in "abcd"}
    jump_ns = cell.node.get_clock().now().nanoseconds
    sent_ns = jump_ns
    while sent_ns < jump_ns + 400_000_000:
        for head, publish in send.items():
            stream = f"head_{head}"
            first = plant.index_at(stream, sent_ns)
            block = plant.samples(stream, first, plant.index_at(stream, sent_ns + 50_000_000) - first)
            jumped = block.rows.copy()
            jumped[:, 1] += 2e-3 if head == "a" and sent_ns >= jump_ns + 200_000_000 else 0.0
            publish(SampleBlock(block.stamp_ns, block.names, jumped))
        sent_ns += 50_000_000
        cell.wait_until(lambda until=sent_ns: cell.node.get_clock().now().nanoseconds > until, "time to pass")
    status = cell.wait_for_status("error_estimator: estimate", "the heads contradict one another")
    assert status.level == b"\x02"
    newest = messages.block_from_message(estimates[-1])
    assert int(newest.times_ns[-1]) < jump_ns + 210_000_000
    # Between the samples before and after the jump, a small part of it may pass for noise.
    before = [each for each in estimates if messages.ns_from_stamp(each.header.stamp) < jump_ns + 140_000_000]
    assert check_against_truth(before, plant) == {"exc", "eyc"}
