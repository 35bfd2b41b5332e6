"""Conversions between dataclasses and messages."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rclpy.serialization import deserialize_message, serialize_message
from received_blocks import block_of
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState, PointCloud2, PointField
from std_msgs.msg import Header

from rotary_error_monitor.codec.cdr_blocks import BlockDecoder
from rotary_error_monitor.codec.encoding import typestore
from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.signals.blocks import SampleBlock, block_from_samples

STAMP = 1_700_000_000_123_456_789
FINITE = st.floats(allow_nan=False, allow_infinity=False, width=32)


@given(
    arrays(np.float64, st.tuples(st.integers(1, 20), st.just(3)), elements=FINITE), st.integers(0, 2**31 * 10**9 - 1)
)
def test_a_block_survives_the_wire(rows, stamp_ns):
    rows[:, 0] = np.clip(rows[:, 0], -(2.0**30), 2.0**30)  # a time 68 years from the stamp of its block is none
    block = SampleBlock(stamp_ns, ("t", "tilt_x", "tilt_y"), rows)
    data = messages.block_bytes(block, "autocollimator")
    message = deserialize_message(data, PointCloud2)
    for back in (block_of(message), BlockDecoder().decode(data)):
        assert (back.stamp_ns, back.names) == (block.stamp_ns, block.names)
        np.testing.assert_array_equal(back.rows, rows)
    assert message.header.frame_id == "autocollimator"
    assert (message.height, message.width, message.row_step, message.is_dense) == (1, len(rows), 24 * len(rows), True)


@pytest.mark.parametrize("frame", ["", "ring", "stator_of_c"])
def test_a_block_is_serialised_as_rosbags_does(frame):
    block = SampleBlock(STAMP, ("t", "angle"), np.arange(6.0).reshape(3, 2))
    data, kind = messages.block_bytes(block, frame), "sensor_msgs/msg/PointCloud2"
    assert data == bytes(typestore().serialize_cdr(typestore().deserialize_cdr(data, kind), kind))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_nothing_non_finite_is_sent(bad):
    rows = np.zeros((3, 2))
    rows[1, 1] = bad
    with pytest.raises(InputError, match=r"sample 1 of 'angle' is (nan|inf|-inf)"):
        messages.block_bytes(SampleBlock(STAMP, ("t", "angle"), rows), "")
    with pytest.raises(InputError, match="not finite"):
        messages.pose_message(STAMP, "", np.array([bad, 0, 0, 0, 0, 0]), np.eye(6))


def block_message():
    data = messages.block_bytes(SampleBlock(STAMP, ("t", "angle"), np.ones((2, 2))), "")
    return deserialize_message(data, PointCloud2)


def _tall(message):
    message.height = 2


def _bigendian(message):
    message.is_bigendian = True


def _float32(message):
    message.fields = [PointField(name="t", offset=0, datatype=PointField.FLOAT32, count=1), message.fields[1]]


def _short(message):
    message.data = message.data[:-1]


def _empty(message):
    message.width = 0


@pytest.mark.parametrize("spoil", [_tall, _bigendian, _float32, _short, _empty])
def test_what_is_no_sample_block_is_refused(spoil):
    message = block_message()
    spoil(message)
    with pytest.raises(InputError, match="no sample block"):
        block_of(message)


def test_joint_state_fills_velocity_and_effort():
    message = messages.joint_state_message(STAMP, "base", ["X", "C"], np.array([0.1, 2.0]))
    assert list(message.velocity) == [0.0, 0.0]
    assert list(message.effort) == [0.0, 0.0]
    back = typestore().deserialize_cdr(serialize_message(message), "sensor_msgs/msg/JointState")
    assert list(back.position) == [0.1, 2.0]


WIRE = load_wire()
SAMPLES = block_from_samples(
    np.array([STAMP, STAMP + 500_000_000]), ["first", "second"], np.array([[1.0, -3.0], [2.0, -4.0]])
)


@pytest.mark.parametrize(
    ("key", "head", "shown"),
    [
        ("head_joint_states", "b", lambda m: (list(m.name), list(m.position), list(m.velocity))),
        ("autocollimator_tilt", None, lambda m: (m.vector.x, m.vector.y, m.vector.z)),
        ("force_wrench", None, lambda m: (m.wrench.force.x, m.wrench.force.y, m.wrench.torque.z)),
        ("stage_temperature", None, lambda m: m.temperature),
    ],
)
def test_people_see_the_latest_sample(key, head, shown):
    topic = WIRE.topic(key, head)
    message = messages.latest_message(topic, SAMPLES)
    assert messages.ns_from_stamp(message.header.stamp) == STAMP + 500_000_000
    assert message.header.frame_id == topic.frame
    expected = {
        "head_joint_states": (["head_b"], [2.0], [-4.0]),
        "stage_temperature": 2.0,
    }
    assert shown(message) == expected.get(key, (2.0, -4.0, 0.0))
    assert message.__class__ is messages.message_class(topic.type)


def test_speed_that_no_field_holds_is_the_mean_over_the_block():
    topic = WIRE.topic("head_joint_states", "a")
    one = block_from_samples(SAMPLES.times_ns, ["angle"], SAMPLES.rows[:, 1:2])
    assert list(messages.latest_message(topic, one).velocity) == [2.0]
    alone = block_from_samples(SAMPLES.times_ns[:1], ["angle"], SAMPLES.rows[:1, 1:2])
    assert list(messages.latest_message(topic, alone).velocity) == [0.0]
    assert list(messages.latest_message(topic, alone, "stage").name) == ["stage"]


def test_no_sample_goes_into_what_is_no_message_of_an_instrument():
    with pytest.raises(InputError, match=r"/diagnostics: no sample goes into a diagnostic_msgs/msg/DiagnosticArray"):
        messages.latest_message(WIRE.topic("diagnostics"), SAMPLES)


def test_joint_motion():
    message = messages.joint_state_message(STAMP, "", ["X", "C"], [0.1, 2.0], [0.0, -1.0])
    assert messages.joint_motion(message) == ({"X": 0.1, "C": 2.0}, {"X": 0.0, "C": -1.0})
    assert messages.joint_motion(JointState(name=["X"], position=[0.5])) == ({"X": 0.5}, {})


@pytest.mark.parametrize(
    ("message", "problem"),
    [
        (JointState(name=["X"], position=[]), "1 names, 0 positions"),
        (JointState(name=["X"], position=[1.0], velocity=[1.0, 2.0]), "2 velocities"),
        (JointState(name=["X"], position=[np.nan]), "all must be finite"),
        (JointState(name=["X", "X"], position=[0.1, 0.2]), "names X, X; each may stand once"),
    ],
)
def test_joint_states_that_cannot_be_used(message, problem):
    with pytest.raises(InputError, match=problem):
        messages.joint_motion(message)


def test_a_driver_must_stamp():
    assert messages.measured_ns(messages.header(STAMP, "")) == STAMP
    with pytest.raises(InputError, match=r"must fill header\.stamp"):
        messages.measured_ns(Header())


def test_unobservable_components_are_marked():
    observable = np.array([True, True, False, True, True, False])
    message = messages.pose_message(STAMP, "stage", np.full(6, 1e-6), np.full((6, 6), 1e-12), observable)
    covariance = np.array(message.pose.covariance).reshape(6, 6)
    assert message.pose.pose.position.z == 0.0
    assert covariance[2, 2] == covariance[5, 5] == -1.0
    assert covariance[2, 0] == covariance[0, 5] == 0.0
    assert covariance[0, 1] == 1e-12
    np.testing.assert_allclose(
        messages.rotation_vector(message.pose.pose.orientation), [1e-6, 1e-6, 0.0], rtol=1e-12, atol=1e-20
    )


@given(arrays(np.float64, 3, elements=st.floats(-1.8, 1.8)))
def test_quaternion_is_that_of_an_independent_library(vector):
    quaternion = messages.quaternion(vector)
    expected = Rotation.from_rotvec(vector).as_quat()
    np.testing.assert_allclose([quaternion.x, quaternion.y, quaternion.z, quaternion.w], expected, atol=1e-15)
    np.testing.assert_allclose(
        messages.rotation_vector(quaternion), Rotation.from_quat(expected).as_rotvec(), atol=1e-14, rtol=0
    )


def test_plain_messages_hold_what_they_are_given():
    vector = messages.vector_message(STAMP, "lvdt", 1.0, 2.0)
    assert (vector.vector.x, vector.vector.y, vector.vector.z) == (1.0, 2.0, 0.0)
    wrench = messages.wrench_message(STAMP, "shaft", (4.0, 5.0))
    assert (wrench.wrench.force.x, wrench.wrench.force.y) == (4.0, 5.0)
    warmth = messages.temperature_message(STAMP, "room", 21.5)
    assert warmth.temperature == 21.5
    for message in (vector, wrench, warmth):
        assert messages.ns_from_stamp(message.header.stamp) == STAMP


def test_message_classes_are_found_by_name():
    assert messages.message_class("sensor_msgs/msg/JointState") is JointState
    for name in ("sensor_msgs/msg/Nonsense", "no_such_package/msg/JointState", "nonsense"):
        with pytest.raises(InputError, match="not installed"):
            messages.message_class(name)
