"""Dataclasses of this package as CDR bytes of standard ROS messages."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore
from rosbags.typesys.stores import ros2_jazzy as ros

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.codec.cdr_blocks import encode_block
from rotary_error_monitor.codec.contents import (
    TYPES,
    Content,
    JointState,
    PointStamped,
    PoseWithCovariance,
    Temperature,
)
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock


@functools.cache
def typestore() -> Typestore:
    """Definitions of the standard messages of ROS 2 Jazzy."""
    return get_typestore(Stores.ROS2_JAZZY)


def cdr_from_content(content: Content, frame: str) -> bytes:
    """Bytes of one message; `frame` is the frame_id of a sample block, which knows none of its own."""
    if isinstance(content, SampleBlock):
        return encode_block(content, frame)
    message = _TO_MESSAGE[type(content)](content, getattr(content, "frame", frame))
    return bytes(typestore().serialize_cdr(message, TYPES[type(content)]))


def _header(stamp_ns: int, frame: str) -> ros.std_msgs__msg__Header:
    return ros.std_msgs__msg__Header(ros.builtin_interfaces__msg__Time(*divmod(stamp_ns, NANOSECONDS)), frame)


def _array(values: ArrayLike) -> Array:
    return np.array(values, dtype=np.float64)


def _joint_state(state: JointState, frame: str) -> ros.sensor_msgs__msg__JointState:
    values = map(_array, (state.position, state.velocity, state.effort))
    return ros.sensor_msgs__msg__JointState(_header(state.stamp_ns, frame), list(state.names), *values)


def _point(point: PointStamped, frame: str) -> ros.geometry_msgs__msg__PointStamped:
    xyz = ros.geometry_msgs__msg__Point(*map(float, point.point))
    return ros.geometry_msgs__msg__PointStamped(_header(point.stamp_ns, frame), xyz)


def _temperature(temperature: Temperature, frame: str) -> ros.sensor_msgs__msg__Temperature:
    header = _header(temperature.stamp_ns, frame)
    return ros.sensor_msgs__msg__Temperature(header, float(temperature.temperature), float(temperature.variance))


def _pose(pose: PoseWithCovariance, frame: str) -> ros.geometry_msgs__msg__PoseWithCovarianceStamped:
    position = ros.geometry_msgs__msg__Point(*map(float, pose.position))
    orientation = ros.geometry_msgs__msg__Quaternion(*map(float, pose.orientation))
    plain = ros.geometry_msgs__msg__Pose(position, orientation)
    uncertain = ros.geometry_msgs__msg__PoseWithCovariance(plain, _array(pose.covariance).ravel())
    return ros.geometry_msgs__msg__PoseWithCovarianceStamped(_header(pose.stamp_ns, frame), uncertain)


# Each function takes the one type that stands beside it.
_TO_MESSAGE: Mapping[type, Callable[[Any, str], object]] = {
    JointState: _joint_state,
    PointStamped: _point,
    Temperature: _temperature,
    PoseWithCovariance: _pose,
}
