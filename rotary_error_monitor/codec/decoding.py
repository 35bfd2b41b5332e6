"""CDR bytes of standard ROS messages as dataclasses of this package."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.codec.contents import (
    TYPES,
    Content,
    JointState,
    PointStamped,
    PoseWithCovariance,
    Temperature,
)
from rotary_error_monitor.codec.definitions import known_typestore
from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.signals.blocks import NANOSECONDS

MOST_BYTES = 1 << 20
"""Bytes of a message that is no sample block: of it Python makes ten times as many. 10,000 axes take half of them."""

if TYPE_CHECKING:
    from rosbags.typesys.stores import ros2_jazzy as ros


def content_from_cdr(data: bytes, msgtype: str, definition: str = "") -> Content:
    """Content of one message of a type that is no sample block.

    Args:
        data: the bytes.
        msgtype: type of the message.
        definition: of that type and those that it needs, as the bag holds it; none: that of ROS 2 Jazzy.

    Raises:
        InputError: the bytes are no such message, or the definition is none that is read.
    """
    if len(data) > MOST_BYTES:
        raise InputError(f"a {msgtype} of {len(data)} bytes; at most {MOST_BYTES} are read")
    store = known_typestore(msgtype, definition)
    try:
        message = store.deserialize_cdr(data, msgtype)
    # The code that reads a message is made of the bag's own definition, which may be any: so may be its errors.
    except Exception as error:
        raise InputError(f"{len(data)} bytes are no {msgtype}: {excerpt(error) or type(error).__name__}") from error
    try:
        return _FROM_MESSAGE[msgtype](message)
    except AttributeError as error:
        raise InputError(
            f"{msgtype} as the bag defines it is not that of ROS 2 Jazzy: it has no {error.name}"
        ) from error
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{msgtype} as the bag defines it is not that of ROS 2 Jazzy: {excerpt(error)}") from error


def _nanoseconds(time: ros.builtin_interfaces__msg__Time) -> int:
    return int(time.sec) * NANOSECONDS + int(time.nanosec)


def _array(values: ArrayLike) -> Array:
    return np.array(values, dtype=np.float64)


def _joint_state_content(message: ros.sensor_msgs__msg__JointState) -> JointState:
    names, position = tuple(message.name), _array(message.position)
    velocity, effort = _array(message.velocity), _array(message.effort)
    if len(position) != len(names) or not {len(velocity), len(effort)} <= {0, len(names)}:
        raise InputError(
            f"a joint state of {len(names)} names, {len(position)} positions, {len(velocity)} velocities, "
            f"{len(effort)} efforts; expected a position for each name, and all velocities and efforts or none"
        )
    return JointState(_nanoseconds(message.header.stamp), names, position, velocity, effort, message.header.frame_id)


def _point_content(message: ros.geometry_msgs__msg__PointStamped) -> PointStamped:
    xyz = _array([message.point.x, message.point.y, message.point.z])
    return PointStamped(_nanoseconds(message.header.stamp), xyz, message.header.frame_id)


def _temperature_content(message: ros.sensor_msgs__msg__Temperature) -> Temperature:
    stamp = _nanoseconds(message.header.stamp)
    return Temperature(stamp, message.temperature, message.variance, message.header.frame_id)


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
_FROM_MESSAGE: Mapping[str, Callable[[Any], Content]] = {
    TYPES[JointState]: _joint_state_content,
    TYPES[PointStamped]: _point_content,
    TYPES[Temperature]: _temperature_content,
    TYPES[PoseWithCovariance]: _pose_content,
}
