"""Standard ROS messages as CDR bytes, from and to the dataclasses of this package."""

from __future__ import annotations

import functools
import struct
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore
from rosbags.typesys.stores import ros2_jazzy as ros

from rotary_error_monitor.bags.cdr_blocks import encode_block
from rotary_error_monitor.bags.contents import (
    TYPES,
    Array,
    Content,
    JointState,
    PointStamped,
    PoseWithCovariance,
    Temperature,
)
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock


@functools.cache
def typestore() -> Typestore:
    """Definitions of the standard messages of ROS 2 Jazzy."""
    return get_typestore(Stores.ROS2_JAZZY)


def content_from_cdr(data: bytes, msgtype: str) -> Content:
    """Content of one message of a type that is no sample block.

    Raises:
        InputError: the bytes are no such message.
    """
    try:
        message = typestore().deserialize_cdr(data, msgtype)
    except (SerdeError, AssertionError, IndexError, ValueError, struct.error) as error:
        raise InputError(f"{len(data)} bytes are no {msgtype}: {error or type(error).__name__}") from error
    return _FROM_MESSAGE[msgtype](message)


def cdr_from_content(content: Content, frame: str) -> bytes:
    """Bytes of one message; `frame` is the frame_id of a sample block, which knows none of its own."""
    if isinstance(content, SampleBlock):
        return encode_block(content, frame)
    message = _TO_MESSAGE[type(content)](content, getattr(content, "frame", frame))
    return bytes(typestore().serialize_cdr(message, TYPES[type(content)]))


def _time(stamp_ns: int) -> ros.builtin_interfaces__msg__Time:
    return ros.builtin_interfaces__msg__Time(*divmod(stamp_ns, NANOSECONDS))


def _nanoseconds(time: ros.builtin_interfaces__msg__Time) -> int:
    return time.sec * NANOSECONDS + time.nanosec


def _header(stamp_ns: int, frame: str) -> ros.std_msgs__msg__Header:
    return ros.std_msgs__msg__Header(_time(stamp_ns), frame)


def _array(values: ArrayLike) -> Array:
    return np.array(values, dtype=np.float64)


def _joint_state(state: JointState, frame: str) -> ros.sensor_msgs__msg__JointState:
    values = map(_array, (state.position, state.velocity, state.effort))
    return ros.sensor_msgs__msg__JointState(_header(state.stamp_ns, frame), list(state.names), *values)


def _joint_state_content(message: ros.sensor_msgs__msg__JointState) -> JointState:
    return JointState(
        stamp_ns=_nanoseconds(message.header.stamp),
        names=tuple(message.name),
        position=_array(message.position),
        velocity=_array(message.velocity),
        effort=_array(message.effort),
        frame=message.header.frame_id,
    )


def _point(point: PointStamped, frame: str) -> ros.geometry_msgs__msg__PointStamped:
    xyz = ros.geometry_msgs__msg__Point(*map(float, point.point))
    return ros.geometry_msgs__msg__PointStamped(_header(point.stamp_ns, frame), xyz)


def _point_content(message: ros.geometry_msgs__msg__PointStamped) -> PointStamped:
    xyz = _array([message.point.x, message.point.y, message.point.z])
    return PointStamped(_nanoseconds(message.header.stamp), xyz, message.header.frame_id)


def _temperature(temperature: Temperature, frame: str) -> ros.sensor_msgs__msg__Temperature:
    header = _header(temperature.stamp_ns, frame)
    return ros.sensor_msgs__msg__Temperature(header, float(temperature.temperature), float(temperature.variance))


def _temperature_content(message: ros.sensor_msgs__msg__Temperature) -> Temperature:
    stamp = _nanoseconds(message.header.stamp)
    return Temperature(stamp, message.temperature, message.variance, message.header.frame_id)


def _pose(pose: PoseWithCovariance, frame: str) -> ros.geometry_msgs__msg__PoseWithCovarianceStamped:
    position = ros.geometry_msgs__msg__Point(*map(float, pose.position))
    orientation = ros.geometry_msgs__msg__Quaternion(*map(float, pose.orientation))
    plain = ros.geometry_msgs__msg__Pose(position, orientation)
    uncertain = ros.geometry_msgs__msg__PoseWithCovariance(plain, _array(pose.covariance).ravel())
    return ros.geometry_msgs__msg__PoseWithCovarianceStamped(_header(pose.stamp_ns, frame), uncertain)


def _pose_content(message: ros.geometry_msgs__msg__PoseWithCovarianceStamped) -> PoseWithCovariance:
    p, q = message.pose.pose.position, message.pose.pose.orientation
    return PoseWithCovariance(
        stamp_ns=_nanoseconds(message.header.stamp),
        position=_array([p.x, p.y, p.z]),
        orientation=_array([q.x, q.y, q.z, q.w]),
        covariance=_array(message.pose.covariance).reshape(6, 6),
        frame=message.header.frame_id,
    )


# Each function takes the one type that stands beside it.
_TO_MESSAGE: Mapping[type, Callable[[Any, str], object]] = {
    JointState: _joint_state,
    PointStamped: _point,
    Temperature: _temperature,
    PoseWithCovariance: _pose,
}
_FROM_MESSAGE: Mapping[str, Callable[[Any], Content]] = {
    TYPES[JointState]: _joint_state_content,
    TYPES[PointStamped]: _point_content,
    TYPES[Temperature]: _temperature_content,
    TYPES[PoseWithCovariance]: _pose_content,
}
