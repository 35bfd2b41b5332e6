"""Bags of third-party drivers, one message a sample: converted, they say what the package's own recording says."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.cli import main
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.wire import wire_of
from rotary_error_monitor.plant import StagePlant
from rotary_error_monitor.recordings.replay import replay_bag

EPOCH = 1_763_700_000_000_000_000
STAGE, DURATION = load_stage(), 2.0
STORE = get_typestore(Stores.ROS2_JAZZY)
JOINT, VECTOR, WRENCH, WARM = (
    "sensor_msgs/msg/JointState",
    "geometry_msgs/msg/Vector3Stamped",
    "geometry_msgs/msg/WrenchStamped",
    "sensor_msgs/msg/Temperature",
)
CELL = """\
/**/encoder_head_a:
  ros__parameters: {source: joint_state, joint_state: {topic: enc/a, joint: turntable, unit: deg}}
/**/encoder_head_b:
  ros__parameters: {source: joint_state, joint_state: {topic: /cell/enc/b}}
/**/encoder_head_c:
  ros__parameters: {source: joint_state, head: c, joint_state: {topic: enc/c}}
/**/encoder_head_d:
  ros__parameters: {source: joint_state, joint_state: {topic: enc/d}}
/**/autocollimator:
  ros__parameters: {source: vector3, vector3: {topic: tilt, unit: arcsec}}
/**/stage_command:
  ros__parameters: {source: joint_state, joint_state: {topic: controller, joint: C}}
/**/stage_force:
  ros__parameters: {source: wrench, wrench: {topic: load}}
/**/stage_temperature:
  ros__parameters: {source: temperature, temperature: {topic: warm}}
/**/error_estimator:
  ros__parameters: {period: 0.001}
"""


def header(time_ns):
    time = STORE.types["builtin_interfaces/msg/Time"](*divmod(int(time_ns), 1_000_000_000))
    return STORE.types["std_msgs/msg/Header"](time, "")


def joint_state(time_ns, names, position, velocity=()):
    values = (np.array(each, float) for each in (position, velocity, ()))
    return STORE.types[JOINT](header(time_ns), names, *values)


def vector(x, y, z=0.0):
    return STORE.types["geometry_msgs/msg/Vector3"](x, y, z)


def said(stream, time_ns, row):
    """A driver's topic, type and message of a sample; angles wrap at a turn, as drivers have it."""
    if stream == "head_a":
        names, position = ["lift", "turntable"], [0.3, math.degrees(row[0]) % 360.0]
        return "/enc/a", JOINT, joint_state(time_ns, names, position)
    if stream.startswith("head_"):
        topic = "/cell/enc/b" if stream == "head_b" else f"/enc/{stream[-1]}"
        return topic, JOINT, joint_state(time_ns, ["axis"], [row[0] % (2 * math.pi)])
    if stream == "command":
        return "/controller", JOINT, joint_state(time_ns, ["A", "C"], [0.0, row[0]], [0.0, row[1]])
    if stream == "autocollimator":
        x, y = (math.degrees(each) * 3600.0 for each in row)
        return "/tilt", VECTOR, STORE.types[VECTOR](header(time_ns), vector(x, y))
    if stream == "force":
        wrench = STORE.types["geometry_msgs/msg/Wrench"](vector(*row), vector(0.0, 0.0))
        return "/load", WRENCH, STORE.types[WRENCH](header(time_ns), wrench)
    return "/warm", WARM, STORE.types[WARM](header(time_ns), row[0], 0.0)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Folder with `own`, the cell's recording, and `drivers` of the same samples, in both storages."""
    folder, plant = tmp_path_factory.mktemp("recorded"), StagePlant(STAGE, 11, EPOCH)
    streams = [name for name in plant.streams if name != "lvdt"]
    blocks = {name: plant.samples(name, 0, plant.index_at(name, EPOCH + round(DURATION * 1e9))) for name in streams}
    wire = wire_of(STAGE)
    write_messages(folder / "own", {wire.of_stream(name).name: [block] for name, block in blocks.items()}, wire)
    rows = [
        (int(time), name, row)
        for name, block in blocks.items()
        for time, row in zip(block.times_ns, block.rows[:, 1:].tolist(), strict=True)
    ]
    for storage in StoragePlugin:
        with Writer(folder / storage.name.lower(), version=9, storage_plugin=storage) as writer:
            known = {}
            for time, name, row in sorted(rows):
                topic, kind, message = said(name, time, row)
                if topic not in known:
                    known[topic] = writer.add_connection(topic, kind, typestore=STORE)
                writer.write(known[topic], time + 300_000, STORE.serialize_cdr(message, kind))
    (folder / "cell.yaml").write_text(CELL, encoding="utf-8")
    return folder


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_it_gives_the_estimate_of_the_cells_own_recording(storage, recorded, tmp_path, capsys):
    wanted = BagReader(recorded / "own").read_blocks()["/stage/head_a/samples"][0].rows
    words = ["convert", str(recorded / storage), "--cell-file", str(recorded / "cell.yaml")]
    assert main([*words, "-o", str(tmp_path / "converted")]) == 0
    assert f"/enc/a: {len(wanted)} samples on /stage/head_a/samples" in capsys.readouterr().out
    own, converted = (replay_bag(path, STAGE) for path in (recorded / "own", tmp_path / "converted"))
    assert len(own.stamp_ns) > 1900 and np.array_equal(own.stamp_ns, converted.stamp_ns)
    turn = np.rint((converted.theta - own.theta) / (2 * np.pi))
    np.testing.assert_allclose(converted.theta - 2 * np.pi * turn, own.theta, atol=1e-11)
    np.testing.assert_allclose(converted.error_motion, own.error_motion, atol=1e-11)
    blocks = BagReader(tmp_path / "converted").read_blocks()
    assert {*blocks} == {*BagReader(recorded / "own").read_blocks()}


def test_stamps_of_the_recording_where_drivers_have_none(recorded, tmp_path):
    words = ["convert", str(recorded / "mcap"), "--cell-file", str(recorded / "cell.yaml"), "--stamps", "log"]
    assert main([*words, "-o", str(tmp_path / "out")]) == 0
    read = [BagReader(path).read_blocks()["/stage/head_b/samples"] for path in (recorded / "own", tmp_path / "out")]
    own, late = (np.concatenate([block.times_ns for block in blocks]) for blocks in read)
    assert np.array_equal(late - own, np.full(len(own), 300_000))


def test_what_is_refused_is_counted_by_reason_and_the_rest_goes_on(recorded, tmp_path, capsys):
    with Writer(tmp_path / "bag", version=9) as writer:
        connection = writer.add_connection("/enc/a", JOINT, typestore=STORE)
        for k, position in enumerate([10.0, math.nan, 20.0, 30.0]):
            message = joint_state(EPOCH + k * 1_000_000, ["turntable"], [position])
            writer.write(connection, EPOCH + k * 1_000_000, STORE.serialize_cdr(message, JOINT))
        late = joint_state(EPOCH, ["turntable"], [40.0])
        writer.write(connection, EPOCH + 5_000_000, STORE.serialize_cdr(late, JOINT))
        other = joint_state(EPOCH + 6_000_000, ["lift"], [40.0])
        writer.write(connection, EPOCH + 6_000_000, STORE.serialize_cdr(other, JOINT))
        writer.write(connection, EPOCH + 7_000_000, b"\0\1\0\0cut")
    words = ["convert", str(tmp_path / "bag"), "--cell-file", str(recorded / "cell.yaml")]
    assert main([*words, "-o", str(tmp_path / "out")]) == 10
    told = capsys.readouterr()
    assert "/enc/a: 3 samples on /stage/head_a/samples" in told.out and "/enc/d: 0 samples" in told.out
    for reason in ("a position is nan", "not after the one before", "joints ['lift']", "bytes are no sensor_msgs"):
        assert "/enc/a: 1 refused, such as: " in told.err and reason in told.err
    (block,) = BagReader(tmp_path / "out").read_blocks()["/stage/head_a/samples"]
    np.testing.assert_allclose(block.column("angle"), np.radians([10.0, 20.0, 30.0]))


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("unit: deg", "unit: degree", "encoder_head_a: parameter 'joint_state.unit' is 'degree'; expected: .*rad, deg"),
        (
            "head: c,",
            "head: x,",
            "encoder_head_c is of the head 'x', of which the stage has none; .*head_a, head_b",
        ),
        ("source: vector3, vector3: {topic: tilt", "source: vector3, vector3: {topic: enc/d", "expected geometry_msgs"),
        ("/**/encoder_head_b:", "/**/encoder:", "no executable serves a node 'encoder'"),
    ],
)
def test_a_wrong_cell_is_refused_before_anything_is_written(old, new, told, recorded, tmp_path, capsys):
    assert old in CELL
    (tmp_path / "cell.yaml").write_text(CELL.replace(old, new), encoding="utf-8")
    words = ["convert", str(recorded / "mcap"), "--cell-file", str(tmp_path / "cell.yaml")]
    assert main([*words, "-o", str(tmp_path / "out")]) == 2
    assert re.search(told, capsys.readouterr().err)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["nowhere", "a" * 300, "a\0b"])
def test_a_bag_that_is_not_there_is_refused(name, recorded, tmp_path, capsys):
    words = ["convert", name, "--cell-file", str(recorded / "cell.yaml"), "-o", str(tmp_path / "out")]
    assert main(words) == 2
    assert "no such bag" in capsys.readouterr().err


def test_a_bag_of_no_driver_is_refused(recorded, tmp_path, capsys):
    words = ["convert", str(recorded / "own"), "--cell-file", str(recorded / "cell.yaml")]
    assert main([*words, "-o", str(tmp_path / "out")]) == 2
    assert "no message of a driver that" in capsys.readouterr().err


def test_a_bag_whose_drivers_said_nothing_is_refused(recorded, tmp_path, capsys):
    """`ros2 bag record` notes a topic as soon as somebody offers it."""
    with Writer(tmp_path / "silent", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic in ("/enc/a", "/cell/enc/b"):
            writer.add_connection(topic, JOINT, typestore=STORE)
    words = ["convert", str(tmp_path / "silent"), "--cell-file", str(recorded / "cell.yaml")]
    assert main([*words, "-o", str(tmp_path / "out")]) == 2
    assert "the bag has messages on no topic" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
