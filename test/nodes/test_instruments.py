"""Autocollimator, LVDT and mock controller: what they send is what the plant or the device says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from geometry_msgs.msg import Vector3Stamped

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.autocollimator import Autocollimator
from rotary_error_monitor.nodes.lvdt import Lvdt
from rotary_error_monitor.nodes.mock_controller import MockController
from rotary_error_monitor.resources import config
from rotary_error_monitor.sources.mock_machine import MachineMotion


def check_against_plant(block, plant, stream):
    same = plant.samples(stream, plant.index_at(stream, block.stamp_ns), len(block.rows))
    np.testing.assert_array_equal(block.times_ns, same.times_ns)
    np.testing.assert_array_equal(block.rows[:, 1:], same.rows[:, 1:])


@pytest.mark.parametrize(
    ("node_class", "name", "people"), [(Autocollimator, "autocollimator", "tilt"), (Lvdt, "lvdt", "radial")]
)
def test_mock_instrument(cell, plant, node_class, name, people):
    blocks = cell.collect(cell.wire.topic(f"{name}_samples"))
    vectors = cell.collect(cell.wire.topic(f"{name}_{people}"))
    cell.run(node_class, name)
    cell.wait_until(lambda: len(blocks) > 2 and len(vectors) > 0, "blocks and vectors")
    block = messages.block_from_message(blocks[1])
    check_against_plant(block, plant, name)
    assert block.names[1:] == cell.wire.topic(f"{name}_samples").columns
    assert vectors[0].header.frame_id == name
    assert abs(vectors[0].vector.x) > 0.0


@pytest.mark.parametrize(("node_class", "name"), [(Autocollimator, "autocollimator"), (Lvdt, "lvdt")])
def test_vectors_of_a_third_party_driver(cell, node_class, name):
    blocks = cell.collect(cell.wire.topic(f"{name}_samples"))
    driver = cell.node.create_publisher(Vector3Stamped, "/driver", 10)
    cell.run(node_class, name, source="vector3", vector3__topic="/driver")
    cell.wait_until(lambda: driver.get_subscription_count() > 0, "the node to listen")
    start = cell.node.get_clock().now().nanoseconds
    for step in range(3):
        driver.publish(messages.vector_message(start + step, "", 1e-6 * step, -1e-6))
    cell.wait_until(lambda: sum(block.width for block in blocks) == 3, "all samples")
    block = messages.block_from_message(blocks[0])
    assert block.stamp_ns == start
    np.testing.assert_allclose(block.rows[0, 1:], [0.0, -1e-6])


def test_quadrant_voltages(cell, tmp_path):
    for channel, raw in enumerate((1500, 500, 500, 1500)):
        (tmp_path / f"in_voltage{channel}_raw").write_text(f"{raw}\n")
    (tmp_path / "in_voltage_scale").write_text("1.0\n")
    blocks = cell.collect(cell.wire.topic("autocollimator_samples"))
    cell.run(Autocollimator, "autocollimator", source="iio", iio__device=str(tmp_path), poll_rate=100.0)
    cell.wait_until(lambda: len(blocks) > 1, "blocks")
    np.testing.assert_allclose(messages.block_from_message(blocks[1]).rows[0, 1:], [0.0, 2.5e-4], atol=1e-15)


def test_the_artefact_at_another_height(cell, plant):
    blocks = cell.collect(cell.wire.topic("lvdt_samples"))
    cell.run(Lvdt, "lvdt", mock__height=0.06)
    cell.wait_until(lambda: len(blocks) > 1, "blocks")
    lvdt = plant.description.lvdt
    assert lvdt is not None
    higher = replace(plant, description=replace(plant.description, lvdt=replace(lvdt, height=0.06)))
    check_against_plant(messages.block_from_message(blocks[1]), higher, "lvdt")


def test_a_stage_without_lvdt(cell, tmp_path):
    lines = config("stage.yaml").read_text(encoding="utf-8").splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("  lvdt:"))
    end = next(i for i in range(start + 1, len(lines)) if not lines[i].startswith("   "))
    path = tmp_path / "stage.yaml"
    path.write_text("\n".join(lines[:start] + lines[end:]), encoding="utf-8")
    with pytest.raises(InputError, match="no section 'lvdt'"):
        cell.run(Lvdt, "lvdt", stage=str(path))


def test_the_controller_tells_command_force_temperature_and_axes(cell, plant):
    topics = {
        key: cell.collect(cell.wire.topic(key))
        for key in (
            "command_samples",
            "force_samples",
            "temperature_samples",
            "command_joint_states",
            "force_wrench",
            "stage_temperature",
            "machine_joint_states",
            "machine_temperature",
        )
    }
    cell.run(MockController, "mock_controller", machine="xyzac_trt")
    cell.wait_until(lambda: all(len(received) > 0 for received in topics.values()), "every topic")
    for stream in ("command", "force", "temperature"):
        check_against_plant(messages.block_from_message(topics[f"{stream}_samples"][0]), plant, stream)
    state = topics["machine_joint_states"][0]
    motion = MachineMotion(load_machine("xyzac_trt"), plant)
    expected = motion.at(messages.ns_from_stamp(state.header.stamp))
    assert list(state.name) == [axis.letter for axis in expected]
    np.testing.assert_array_equal(state.position, [axis.position for axis in expected])
    np.testing.assert_array_equal(state.velocity, [axis.velocity for axis in expected])
    assert 15.0 < topics["machine_temperature"][0].temperature < 30.0
    assert list(topics["command_joint_states"][0].name) == ["stage"]


def test_a_controller_without_machine_tells_no_axes(cell):
    states = cell.collect(cell.wire.topic("machine_joint_states"))
    command = cell.collect(cell.wire.topic("command_samples"))
    cell.run(MockController, "mock_controller")
    cell.wait_until(lambda: len(command) > 3, "commands")
    assert states == []
