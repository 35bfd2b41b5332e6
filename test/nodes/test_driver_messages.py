"""Messages of drivers read from their bytes, against the middleware's own reader."""

from __future__ import annotations

import struct

import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Vector3, Vector3Stamped
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from rotary_error_monitor.codec.driver_messages import DriverReader

JOINT_STATE, VECTOR = "sensor_msgs/msg/JointState", "geometry_msgs/msg/Vector3Stamped"
NUMBERS = st.floats(allow_nan=False)
TEXTS = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\x00"), max_size=12)
STAMPS = st.builds(Time, sec=st.integers(0, 2**31 - 1), nanosec=st.integers(0, 999_999_999))


@st.composite
def joint_states(draw):
    """Joint states as drivers may send them: with as many numbers as joints, without some, or with too many."""
    given_names = draw(st.lists(TEXTS, min_size=1, max_size=4))
    lists = [draw(st.lists(NUMBERS, min_size=n, max_size=n)) for n in (len(given_names), *draw(counts(given_names)))]
    return JointState(
        header=Header(stamp=draw(STAMPS), frame_id=draw(TEXTS)),
        name=given_names,
        **dict(zip(("position", "velocity", "effort"), lists, strict=True)),
    )


def counts(names):
    return st.tuples(*[st.sampled_from([0, len(names), 3])] * 2)


def same(found, message):
    """Whether what was read is the message."""
    assert (found.header.stamp.sec, found.header.stamp.nanosec) == (
        message.header.stamp.sec,
        message.header.stamp.nanosec,
    )
    assert found.header.frame_id == message.header.frame_id
    if isinstance(message, Vector3Stamped):
        assert (found.vector.x, found.vector.y, found.vector.z) == (
            message.vector.x,
            message.vector.y,
            message.vector.z,
        )
    else:
        assert list(found.name) == list(message.name)
        for name in ("position", "velocity", "effort"):
            assert list(getattr(found, name)) == list(getattr(message, name))


@given(st.lists(joint_states(), min_size=1, max_size=4))
def test_joint_states_in_turn(messages):
    """One after another through one reader, so that what is known of the one is no rule for the next."""
    reader = DriverReader(JOINT_STATE)
    for message in messages:
        data = serialize_message(message)
        same(reader.read(data), deserialize_message(data, JointState))


@given(st.lists(st.builds(Header, stamp=STAMPS, frame_id=TEXTS), min_size=1, max_size=3), NUMBERS, NUMBERS, NUMBERS)
def test_vectors_in_turn(headers, x, y, z):
    reader = DriverReader(VECTOR)
    for header in headers:
        message = Vector3Stamped(header=header, vector=Vector3(x=x, y=y, z=z))
        same(reader.read(serialize_message(message)), message)


@given(joint_states(), st.integers(0, 200), st.binary(max_size=8))
def test_bytes_that_are_cut_or_changed_raise_nothing(message, cut, instead):
    """What is no message is left to the full reader."""
    data = serialize_message(message)
    reader = DriverReader(JOINT_STATE)
    reader.read(data)
    reader.read(data[:cut])
    reader.read(data[:cut] + instead + data[cut + len(instead) :])


def test_other_types_encodings_and_joint_states_without_joints_are_left_to_the_full_reader():
    data = serialize_message(JointState(name=["a"], position=[1.0], velocity=[0.0], effort=[0.0]))
    assert DriverReader("sensor_msgs/msg/Temperature").read(data) is None
    assert DriverReader(JOINT_STATE).read(b"\x00\x00" + data[2:]) is None
    assert DriverReader(JOINT_STATE).read(serialize_message(JointState())) is None
    assert DriverReader(JOINT_STATE).read(data[:12] + struct.pack("<I", 2**31) + data[16:]) is None


@pytest.mark.parametrize("name", ["a", "spindle"])
def test_what_other_middleware_writes_between_the_fields_does_not_matter(name):
    """rosbags writes zeros where rmw leaves what was there."""
    store = get_typestore(Stores.ROS2_JAZZY)
    message = JointState(name=[name], position=[1.5], velocity=[2.5], effort=[3.5])
    data = serialize_message(message)
    reader = DriverReader(JOINT_STATE)
    for each in (data, bytes(store.serialize_cdr(store.deserialize_cdr(data, JOINT_STATE), JOINT_STATE))):
        same(reader.read(each), message)
