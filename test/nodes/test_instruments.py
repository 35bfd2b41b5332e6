"""Autocollimator, LVDT and mock controller: what they send is what the plant or the device says."""

from __future__ import annotations

import re
import socket
import struct
import time
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from faults.documenting import Row, shows
from geometry_msgs.msg import Vector3Stamped
from nodes.node_log import Log
from nodes.plant_samples import assert_sample, assert_samples
from ports import free_port
from received_blocks import block_of
from sensor_msgs.msg import JointState

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.autocollimator import AutocollimatorNode
from rotary_error_monitor.nodes.encoder_head import EncoderHead
from rotary_error_monitor.nodes.lvdt import LvdtNode
from rotary_error_monitor.nodes.mock_controller import MockController
from rotary_error_monitor.resources import config
from rotary_error_monitor.sources.mock_machine import MachineMotion
from rotary_error_monitor.testing.silence import silence


@pytest.mark.parametrize(
    ("node_class", "name", "people"), [(AutocollimatorNode, "autocollimator", "tilt"), (LvdtNode, "lvdt", "radial")]
)
def test_mock_instrument(cell, plant, node_class, name, people):
    blocks = cell.collect(cell.wire.topic(f"{name}_samples"))
    vectors = cell.collect(cell.wire.topic(f"{name}_{people}"))
    cell.run(node_class, name, source="mock")
    cell.wait_until(lambda: len(blocks) > 2 and len(vectors) > 0, "blocks and vectors")
    block = block_of(blocks[1])
    assert_samples(block, plant, name)
    assert block.names[1:] == cell.wire.topic(f"{name}_samples").columns
    assert vectors[0].header.frame_id == name
    assert_sample(vectors[0].header.stamp, [vectors[0].vector.x, vectors[0].vector.y], plant, name)


@pytest.mark.parametrize(("node_class", "name"), [(AutocollimatorNode, "autocollimator"), (LvdtNode, "lvdt")])
def test_vectors_of_a_third_party_driver(cell, node_class, name):
    blocks = cell.collect(cell.wire.topic(f"{name}_samples"))
    driver = cell.node.create_publisher(Vector3Stamped, "/driver", 10)
    cell.run(node_class, name, source="vector3", vector3__topic="/driver")
    cell.wait_until(lambda: driver.get_subscription_count() > 0, "the node to listen")
    start = cell.node.get_clock().now().nanoseconds
    for step in range(3):
        driver.publish(messages.vector_message(start + step, "", 1e-6 * step, -1e-6))
    cell.wait_until(lambda: sum(block.width for block in blocks) == 3, "all samples")
    block = block_of(blocks[0])
    assert block.stamp_ns == start
    np.testing.assert_allclose(block.rows[0, 1:], [0.0, -1e-6])


def reading(kind, step: int, offset: float):
    """Message of a driver, stamped a little before now."""
    stamp_ns = time.time_ns()
    if kind is Vector3Stamped:
        return messages.vector_message(stamp_ns, "", 1e-6 * step + offset, 0.0)
    return messages.joint_state_message(stamp_ns, "", ["spindle"], [1e-3 * step + offset])


HEAD = {"source": "joint_state", "joint_state__topic": "/enc"}
DRIVERS = [
    (
        EncoderHead,
        "encoder_head_a",
        "head_samples",
        JointState,
        {"source": "joint_state", "joint_state__topic": "/enc"},
    ),
    (AutocollimatorNode, "autocollimator", "autocollimator_samples", Vector3Stamped, {"vector3__topic": "/enc"}),
    (LvdtNode, "lvdt", "lvdt_samples", Vector3Stamped, {"vector3__topic": "/enc"}),
]


@shows(
    Row(
        "messages",
        "The topic of a third-party driver is mistyped, or its driver is not there",
        "`/diagnostics` and the log of the instrument's node: nobody publishes on the topic that it listens to",
        "nothing",
        "the other streams",
        "with the first sample of the driver",
    )
)
@pytest.mark.parametrize(("node_class", "name", "key", "kind", "parameters"), DRIVERS, ids=[d[1] for d in DRIVERS])
def test_the_topic_that_is_listened_to_is_named_and_that_nobody_publishes_there(
    cell, monkeypatch, node_class, name, key, kind, parameters
):
    log = Log(monkeypatch, node_class)
    cell.run(node_class, name, **{"source": "vector3", **parameters})
    nobody = "nobody publishes on /enc"
    cell.wait_for_status(f"{name}: /enc", f"nothing has arrived yet: {nobody}")
    own = cell.wire.topic(key, *(["a"] if key == "head_samples" else []))
    cell.wait_for_status(f"{name}: {own.name}", "nothing has been sent yet")
    cell.wait_until(lambda: log.count(nobody) > 0, "the log to say so")
    cell.spin_for(0.5)
    assert log.count(nobody) == 1
    driver, steps = cell.node.create_publisher(kind, "/enc", 10), iter(range(10_000))

    def is_heard():
        driver.publish(reading(kind, next(steps), 0.0))
        return cell.has_status(f"{name}: /enc", "alive")

    cell.wait_until(is_heard, "the driver to be heard")
    cell.wait_until(lambda: log.count("samples come on /enc") > 0, "the log to say so")


@shows(
    Row(
        "messages",
        "Two drivers publish on the topic that an instrument's node listens to",
        "by the order of the messages' numbers, with the third message; the node says who publishes",
        "nothing tells whose sample is whose: none is taken",
        "by the node nothing, and what the other streams give",
        "1 s after the last message of the other",
    )
)
@pytest.mark.parametrize(("node_class", "name", "key", "kind", "parameters"), DRIVERS, ids=[d[1] for d in DRIVERS])
def test_of_two_drivers_on_one_topic_none_is_believed(cell, node_class, name, key, kind, parameters):
    blocks = cell.collect(cell.wire.topic(key, *(["a"] if key == "head_samples" else [])))
    one, other = (cell.node.create_publisher(kind, "/enc", 10) for _ in range(2))
    cell.run(node_class, name, **{"source": "vector3", **parameters})
    cell.wait_until(lambda: one.get_subscription_count() > 0 and other.get_subscription_count() > 0, "it to listen")
    steps = iter(range(10_000))

    def publish(*drivers):
        step = next(steps)
        for driver in drivers:
            driver.publish(reading(kind, step, 0.0 if driver is one else 0.002))
            cell.spin_for(0.005)

    cell.wait_until(lambda: publish(one) or len(blocks) > 2, "samples of one driver")
    cell.wait_until(
        lambda: publish(one, other) or cell.has_status(f"{name}: refused /enc", "several publishers share /enc"),
        "a word of two",
    )
    quiet = silence(blocks)  # what was on its way by then
    cell.wait_until(lambda: publish(one, other) or quiet(), "what was on its way")
    before = len(blocks)
    end = time.monotonic() + 1.0
    cell.wait_until(lambda: publish(one, other) or time.monotonic() > end, "time to pass")
    assert len(blocks) == before, "nothing of a mixture goes out"
    mixed = np.concatenate([block_of(block).rows[:, 1] for block in blocks])
    assert np.count_nonzero(np.abs(np.diff(mixed)) > 0.0015) <= 3, "but of the first two messages"
    cell.wait_until(lambda: publish(one) or len(blocks) > before, "samples of the one that is left")


def test_quadrant_voltages(cell, tmp_path):
    for channel, raw in enumerate((1500, 500, 500, 1500)):
        (tmp_path / f"in_voltage{channel}_raw").write_text(f"{raw}\n")
    (tmp_path / "in_voltage_scale").write_text("1.0\n")
    blocks = cell.collect(cell.wire.topic("autocollimator_samples"))
    cell.run(AutocollimatorNode, "autocollimator", source="iio", iio__device=str(tmp_path), poll_rate=100.0)
    cell.wait_until(lambda: len(blocks) > 1, "blocks")
    np.testing.assert_allclose(block_of(blocks[1]).rows[0, 1:], [0.0, 2.5e-4], atol=1e-15)


def test_the_artefact_at_another_height(cell, plant):
    blocks = cell.collect(cell.wire.topic("lvdt_samples"))
    cell.run(LvdtNode, "lvdt", mock__height=0.06, source="mock")
    cell.wait_until(lambda: len(blocks) > 1, "blocks")
    lvdt = plant.description.lvdt
    assert lvdt is not None
    higher = replace(plant, description=replace(plant.description, lvdt=replace(lvdt, height=0.06)))
    assert_samples(block_of(blocks[1]), higher, "lvdt")


def test_a_stage_without_lvdt(cell, tmp_path):
    lines = config("stage.yaml").read_text(encoding="utf-8").splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("  lvdt:"))
    end = next(i for i in range(start + 1, len(lines)) if not lines[i].startswith("   "))
    path = tmp_path / "stage.yaml"
    path.write_text("\n".join(lines[:start] + lines[end:]), encoding="utf-8")
    with pytest.raises(InputError, match="no section 'lvdt'"):
        cell.run(LvdtNode, "lvdt", stage=str(path), source="mock")


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
        assert_samples(block_of(topics[f"{stream}_samples"][0]), plant, stream)
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


def test_a_device_of_another_package_serves_a_node_and_is_put_away_with_it(cell, install):
    """The example of `doc/devices.md`: its port is free again after a clean-up, for a new start."""
    example = Path(__file__).parents[2] / "doc" / "examples" / "udp_encoder"
    install(example, tomllib.loads((example / "pyproject.toml").read_text(encoding="utf-8"))["project"]["entry-points"])
    port = free_port(socket.SOCK_DGRAM)
    blocks = cell.collect(cell.wire.topic("head_samples", "a"))
    head = cell.run(EncoderHead, "encoder_head_a", source="udp", udp__port=port)
    assert head.describe_parameter("udp.port").description.startswith("port that the box sends to")

    def send():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as box:
            box.sendto(struct.pack("<qd", time.time_ns(), 0.5), ("127.0.0.1", port))
        return len(blocks) > 1

    cell.wait_until(send, "readings")
    assert block_of(blocks[0]).column("angle")[0] == 0.5
    head.trigger_deactivate()
    head.trigger_cleanup()
    del blocks[:]
    head.trigger_configure()
    head.trigger_activate()
    cell.wait_until(send, "readings after a new start")


FAILING = """
from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.sources.device import POLL_RATE, Device
from rotary_error_monitor.sources.source import Polled


class Failing(Device):
    name = "failing"
    serves = ("encoder_head",)
    settings = (POLL_RATE, Setting("failing.where", "", "what fails", choices=("open", "read", "take", "close")))

    def open(self, instrument):
        where = instrument.setting("failing.where")
        if where == "open":
            raise ValueError("it is off")
        return Reading(instrument.fields, where)


class Reading(Polled):
    def __init__(self, fields, where):
        super().__init__(fields, self)
        self.where, self.count = where, 0

    def read(self):
        self.count += 1
        if self.where == "read" and self.count < 200:
            raise OSError(5, "unplugged")
        return (0.001 * self.count,)

    def take(self, since_ns, until_ns):
        if self.where == "take" and self.count < 200:
            raise KeyError("buffer")
        return super().take(since_ns, until_ns)

    def close(self):
        if self.where == "close":
            raise RuntimeError("it hangs")
"""


@pytest.fixture
def failing(install, tmp_path):
    package = tmp_path / "failing_device"
    package.mkdir()
    (package / "__init__.py").write_text(FAILING.replace('choices=("', 'choices=("", "'))
    install(package, {"rotary_error_monitor.devices": {"failing": "failing_device"}})


@pytest.mark.parametrize(("where", "words"), [("read", "OSError: .*unplugged"), ("take", "KeyError: 'buffer'")])
def test_a_device_that_fails_is_told_and_asked_again(cell, failing, where, words):
    blocks = cell.collect(cell.wire.topic("head_samples", "a"))
    cell.run(EncoderHead, "encoder_head_a", source="failing", failing__where=where)
    cell.wait_until(
        lambda: (
            re.search(f"device 'failing': {words}", cell.status("encoder_head_a: refused failing").message)
            if cell.has_status("encoder_head_a: refused failing", "")
            else False
        ),
        "a word of the device",
    )
    cell.wait_until(lambda: len(blocks) > 1, "samples of the device that is well again")


def test_a_device_that_cannot_be_opened_is_told(cell, failing):
    with pytest.raises(InputError, match="device 'failing': ValueError: it is off"):
        cell.run(EncoderHead, "encoder_head_a", source="failing", failing__where="open")


def test_a_device_that_cannot_be_closed_leaves_nothing_behind(cell, failing, capfd):
    head = cell.run(EncoderHead, "encoder_head_a", source="failing", failing__where="close")
    topic = cell.wire.topic("head_samples", "a")
    head.trigger_deactivate()
    head.trigger_cleanup()
    assert "not closed: device 'failing': RuntimeError: it hangs" in capfd.readouterr().err
    head.trigger_configure()
    head.trigger_activate()
    blocks = cell.collect(topic)
    cell.wait_until(lambda: len(blocks) > 1, "samples")
    assert len(cell.node.get_publishers_info_by_topic(topic.name)) == 1
