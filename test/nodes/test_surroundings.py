"""Command, force and temperature of a stage: from the mock, and from what third-party drivers publish."""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import WrenchStamped
from nodes.mock_cells import mock_parameters
from nodes.plant_samples import assert_sample, assert_samples
from received_blocks import block_of
from sensor_msgs.msg import JointState, Temperature

from rotary_error_monitor.codec.error_motion_blocks import error_motion_from_block
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.encoder_head import EncoderHead
from rotary_error_monitor.nodes.error_estimator import ErrorEstimator
from rotary_error_monitor.nodes.stage_command import StageCommand
from rotary_error_monitor.nodes.stage_force import StageForce
from rotary_error_monitor.nodes.stage_temperature import StageTemperature
from rotary_error_monitor.resources import config
from rotary_error_monitor.sources.mock import mock_stage
from rotary_error_monitor.testing import Cell

SIGMAS = 6.0


@pytest.mark.parametrize(
    ("node_class", "stream", "people", "told"),
    [
        (StageCommand, "command", "command_joint_states", lambda m: [*m.position, *m.velocity]),
        (StageForce, "force", "force_wrench", lambda m: [m.wrench.force.x, m.wrench.force.y]),
        (StageTemperature, "temperature", "stage_temperature", lambda m: [m.temperature]),
    ],
)
def test_mock_of_what_acts_on_the_stage(cell, plant, node_class, stream, people, told):
    topic = cell.wire.topic(f"{stream}_samples")
    blocks, messages_for_people = cell.collect(topic), cell.collect(cell.wire.topic(people))
    cell.run(node_class, f"stage_{stream}", source="mock")
    cell.wait_until(lambda: len(blocks) > 1 and len(messages_for_people) > 0, "blocks and messages")
    block = block_of(blocks[1])
    assert_samples(block, plant, stream)
    assert block.names[1:] == topic.columns
    seen = messages_for_people[0]
    assert_sample(seen.header.stamp, told(seen), plant, stream)
    assert getattr(seen, "name", ["stage"]) == ["stage"]


def joint_state(stamp_ns, angle, names=("other", "spindle")):
    message = JointState(header=messages.header(stamp_ns, ""), name=list(names))
    message.position = [9.0] * (len(names) - 1) + [angle]
    return message


def wrench(stamp_ns, size):
    message = WrenchStamped(header=messages.header(stamp_ns, ""))
    message.wrench.force.x, message.wrench.force.y = size, -2.0 * size
    return message


def warmth(stamp_ns, degrees):
    return Temperature(header=messages.header(stamp_ns, ""), temperature=degrees)


@pytest.mark.parametrize(
    ("node_class", "stream", "source", "more", "make", "rows"),
    [
        (
            StageCommand,
            "command",
            "joint_state",
            {"joint_state__joint": "spindle"},
            joint_state,
            [[0.2, 10.0], [0.3, 10.0], [0.4, 10.0]],
        ),
        (StageForce, "force", "wrench", {}, wrench, [[0.1 * k, -0.2 * k] for k in range(5)]),
        (StageTemperature, "temperature", "temperature", {}, warmth, [[0.1 * k] for k in range(5)]),
    ],
)
def test_messages_of_a_third_party_driver(cell, node_class, stream, source, more, make, rows):
    """Five messages, 10 ms apart; joint states without velocities give the speed from the third one on."""
    blocks = cell.collect(cell.wire.topic(f"{stream}_samples"))
    begin = time.time_ns() - 50_000_000
    driver = cell.node.create_publisher(type(make(begin, 0.0)), "/driver", 10)
    cell.run(node_class, f"stage_{stream}", source=source, **{f"{source}__topic": "/driver"}, **more)
    cell.wait_until(lambda: driver.get_subscription_count() > 0, "the node to listen")
    begin = time.time_ns() - 50_000_000
    for k in range(5):
        driver.publish(make(begin + 10_000_000 * k, 0.1 * k))
    cell.wait_until(lambda: sum(block.width for block in blocks) == len(rows), "all samples")
    made = [block_of(block) for block in blocks]
    assert np.concatenate([block.times_ns for block in made])[-1] == begin + 40_000_000
    np.testing.assert_allclose(np.concatenate([block.rows[:, 1:] for block in made]), rows, atol=1e-9)


def test_a_thermometer_may_take_its_time(cell):
    """One that speaks once in some seconds is no silent one; a load cell that does so is."""
    warm = cell.node.create_publisher(Temperature, "/thermometer", 10)
    force = cell.node.create_publisher(WrenchStamped, "/load", 10)
    cell.run(StageTemperature, "stage_temperature", source="temperature", temperature__topic="/thermometer")
    cell.run(StageForce, "stage_force", source="wrench", wrench__topic="/load")
    cell.wait_until(lambda: warm.get_subscription_count() > 0 < force.get_subscription_count(), "nodes to listen")
    warm.publish(warmth(time.time_ns(), 21.0))
    force.publish(wrench(time.time_ns(), 1.0))
    cell.wait_for_status("stage_temperature: /thermometer", "alive")
    cell.wait_for_status("stage_force: /load", "stale")
    for topic in ("/thermometer", "/stage/temperature/samples"):
        assert cell.has_status(f"stage_temperature: {topic}", "alive")


@pytest.fixture
def stage_file(tmp_path):
    """A stage whose controller counts the other way, from a zero of its own, and stamps 4 ms late."""
    content = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))
    content["stage"]["command"] = {"zero": 1.3, "sign": -1, "latency": 0.004}
    path = tmp_path / "stage.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


def test_positioning_error_motion_beside_a_controller_that_tells_positions_alone(settings, stage_file):
    """Joint states at 100 Hz without velocities, whose angles wrap, are all that the controller gives."""
    stage = load_stage(stage_file)
    plant = mock_stage(stage, replace(settings, speeds=(1.5, 3.0)))
    parameters = mock_parameters(replace(settings, speeds=(1.5, 3.0)), stage=stage_file)
    draw = np.random.default_rng(settings.seed)
    with Cell(parameters=parameters) as cell:
        estimates = cell.collect(cell.wire.topic("error_motion_samples"))
        controller = cell.node.create_publisher(JointState, "/joint_states", 10)
        for head in "abcd":
            cell.run(EncoderHead, f"encoder_head_{head}", source="mock")
        driven = {"source": "joint_state", "joint_state__topic": "/joint_states", "joint_state__joint": "spindle"}
        cell.run(StageCommand, "stage_command", **driven)
        cell.run(ErrorEstimator, "error_estimator", period=0.005, check_turns=0.0)
        due = iter(range(time.time_ns(), time.time_ns() + 10**12, 10_000_000))
        next_ns = next(due)

        def tell():
            """Publish what is due, late on a busy computer; its stamps scatter by 2 ms."""
            nonlocal next_ns
            while next_ns < time.time_ns():
                stamp_ns = next_ns - int(draw.integers(0, 2_000_000))
                command = plant.signal("command", np.array([(stamp_ns - plant.epoch_ns) * 1e-9]))
                controller.publish(joint_state(stamp_ns, math.remainder(float(command[0, 0]), 2 * math.pi)))
                next_ns = next(due)
            return observed(estimates) > 100

        cell.wait_until(tell, "positioning error motion")
    bounds = []
    for message in estimates:
        block = block_of(message)
        motion = error_motion_from_block(block)
        truth = plant.scene((block.times_ns - plant.epoch_ns) * 1e-9).error_motion
        bound = SIGMAS * np.sqrt(motion.covariance[:, 5, 5])
        seen = motion.observable[:, 5]
        assert (np.abs(motion.components[:, 5] - truth[:, 5]) <= bound)[seen].all()
        bounds += bound[seen].tolist()
    assert len(bounds) > 100
    assert np.median(bounds) < 1e-3, "an uncertainty that bounds something"


def observed(estimates):
    return sum(int(error_motion_from_block(block_of(m)).observable[:, 5].sum()) for m in estimates)
