"""All conversions between the core's dataclasses and ROS messages.

Sample blocks travel as `sensor_msgs/PointCloud2` with packed little-endian FLOAT64 fields. They are serialised and read
without building a message: at hundreds of blocks a second that is what a node spends its time on.
"""

from __future__ import annotations

import importlib
import math
from array import array
from collections.abc import Iterable, Sequence
from typing import Any, TypeAlias

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import (
    PoseWithCovarianceStamped,
    Quaternion,
    TwistStamped,
    Vector3Stamped,
    WrenchStamped,
)
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import Header

from rotary_error_monitor.arrays import Array, Mask
from rotary_error_monitor.codec.cdr_blocks import encode_block
from rotary_error_monitor.description.wire import Topic
from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.pipeline.joint_motion import joint_motion_of
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock

Message: TypeAlias = Any
"""Any ROS message; their classes carry no types."""

STAGE_JOINT = "stage"
"""Joint of the commanded rotation."""

_DOUBLE = 8
UNOBSERVABLE_VARIANCE = -1.0
_SMALL_ANGLE = 1e-6


def message_class(name: str) -> type[Any]:
    """Class of a message type such as `sensor_msgs/msg/JointState`.

    Raises:
        InputError: no such message type is installed.
    """
    package, _, kind = name.partition("/msg/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), kind)
    except (ImportError, AttributeError, ValueError):
        raise InputError(
            f"message type '{name}' is not installed; a ROS package '{package}' should define it"
        ) from None


def type_name(kind: Any) -> str:  # noqa: ANN401 (rclpy's own name for it is a protocol)
    """Name of a message class, such as `sensor_msgs/msg/JointState`."""
    return f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"


def message_from_bytes(data: bytes, kind: type[Any]) -> Message:
    """Message of a class from its serialised bytes.

    Raises:
        InputError: the bytes are none.
    """
    try:
        return deserialize_message(data, kind)
    except Exception as error:  # of the middleware's own kinds
        raise InputError(f"{len(data)} bytes are no {type_name(kind)}: {error}") from error


def stamp_from_ns(stamp_ns: int) -> Time:
    """ROS time from a timestamp (ns)."""
    seconds, nanoseconds = divmod(stamp_ns, NANOSECONDS)
    return Time(sec=seconds, nanosec=nanoseconds)


def ns_from_stamp(stamp: Time) -> int:
    """Timestamp (ns) from a ROS time."""
    return int(stamp.sec * NANOSECONDS + stamp.nanosec)


def header(stamp_ns: int, frame: str) -> Header:
    """Header of a message that was measured at `stamp_ns` in `frame`."""
    return Header(stamp=stamp_from_ns(stamp_ns), frame_id=frame)


def block_bytes(block: SampleBlock, frame: str) -> bytes:
    """Sample block as a serialised point cloud of height 1, ready to be published: no message is built.

    Raises:
        InputError: a sample is not finite; nothing non-finite goes out.
    """
    _check_finite(block)
    return encode_block(block, frame)


def _check_finite(block: SampleBlock) -> None:
    # One sum is cheaper than a mask, and any NaN or infinity survives it.
    if math.isfinite(float(block.rows.sum())):
        return
    for row, column in np.argwhere(~np.isfinite(block.rows)):
        name, value = excerpt(block.names[column]), block.rows[row, column]
        raise InputError(f"sample {row} of '{name}' is {value}; nothing non-finite is published")


def joint_state_message(
    stamp_ns: int,
    frame: str,
    names: Sequence[str],
    positions: Iterable[float],
    velocities: Iterable[float] | None = None,
    efforts: Iterable[float] | None = None,
) -> JointState:
    """Joint state in m and rad, or as its topic says; velocity and effort are always filled, zeros where unknown.

    An empty sequence at the end of the message is serialised with stray bytes behind it, which other readers refuse.
    """
    return JointState(
        header=header(stamp_ns, frame),
        name=list(names),
        position=array("d", positions),
        velocity=array("d", np.zeros(len(names)) if velocities is None else velocities),
        effort=array("d", bytes(_DOUBLE * len(names)) if efforts is None else efforts),
    )


def joint_motion(message: JointState) -> tuple[dict[str, float], dict[str, float]]:
    """Positions (m, rad) and velocities (m/s, rad/s) by joint; without velocities the second is empty.

    Raises:
        InputError: there is not one position for each name, a name stands twice, or a number is not finite.
    """
    return joint_motion_of(message.name, message.position, message.velocity)


def measured_ns(stamped: Header) -> int:
    """When a driver measured, timestamp (ns).

    Raises:
        InputError: the driver left the stamp empty; guessing it from the arrival would be wrong by the transport.
    """
    stamp_ns = ns_from_stamp(stamped.stamp)
    if stamp_ns <= 0:
        raise InputError("a message of the driver has no stamp; the driver must fill header.stamp")
    return stamp_ns


def vector_message(stamp_ns: int, frame: str, x: float, y: float = 0.0, z: float = 0.0) -> Vector3Stamped:
    """Vector with a stamp, in m or rad; 0 in the directions that an instrument does not see."""
    message = Vector3Stamped(header=header(stamp_ns, frame))
    message.vector.x, message.vector.y, message.vector.z = float(x), float(y), float(z)
    return message


def latest_message(topic: Topic, block: SampleBlock, joint: str = "") -> Message:
    """What people see of a block: its latest sample as a message of the topic's type.

    Args:
        topic: for people; its message holds the fields of a sample in their order.
        block: the samples.
        joint: name of the joint where the message holds one; empty for that of the frame. Its speed is the second field
            of a sample, or the mean over the block.

    Raises:
        InputError: no sample of an instrument goes into a message of that type.
    """
    stamp_ns, values = int(block.times_ns[-1]), block.rows[-1, 1:]
    match topic.type:
        case "sensor_msgs/msg/JointState":
            speed = float(values[1]) if len(values) > 1 else _mean_speed(block)
            return joint_state_message(stamp_ns, topic.frame, [joint or topic.frame], [values[0]], [speed])
        case "geometry_msgs/msg/Vector3Stamped":
            return vector_message(stamp_ns, topic.frame, *values[:3])
        case "geometry_msgs/msg/WrenchStamped":
            return wrench_message(stamp_ns, topic.frame, [float(values[0]), float(values[1])])
        case "sensor_msgs/msg/Temperature":
            return temperature_message(stamp_ns, topic.frame, values[0])
    raise InputError(f"{topic.name}: no sample goes into a {topic.type}; expected a joint state, vector, wrench, …")


def _mean_speed(block: SampleBlock) -> float:
    times, values = block.rows[:, 0], block.rows[:, 1]
    return float((values[-1] - values[0]) / (times[-1] - times[0])) if len(times) > 1 else 0.0


def wrench_message(stamp_ns: int, frame: str, force: Sequence[float]) -> WrenchStamped:
    """Force (x, y) on the shaft, N."""
    message = WrenchStamped(header=header(stamp_ns, frame))
    message.wrench.force.x, message.wrench.force.y = float(force[0]), float(force[1])
    return message


def temperature_message(stamp_ns: int, frame: str, temperature: float) -> Temperature:
    """Temperature, °C."""
    return Temperature(header=header(stamp_ns, frame), temperature=float(temperature))


def pose_message(
    stamp_ns: int, frame: str, offset: Array, covariance: Array, observable: Mask | None = None
) -> PoseWithCovarianceStamped:
    """Six-component offset (x y z in m, rotation vector in rad) with its covariance (6, 6).

    A component that is not observable is 0 with variance -1 on the diagonal and no covariance with others.
    """
    values, matrix = np.array(offset, dtype=float), np.array(covariance, dtype=float)
    if observable is not None:
        hidden = ~np.asarray(observable)
        values[hidden] = 0.0
        matrix[hidden, :] = 0.0
        matrix[:, hidden] = 0.0
        matrix[hidden, hidden] = UNOBSERVABLE_VARIANCE
    if not (np.isfinite(values).all() and np.isfinite(matrix).all()):
        raise InputError(
            f"an offset of {values} with variances {np.diag(matrix)} cannot be published: it is not finite"
        )
    message = PoseWithCovarianceStamped(header=header(stamp_ns, frame))
    position = message.pose.pose.position
    position.x, position.y, position.z = (float(value) for value in values[:3])
    message.pose.pose.orientation = quaternion(values[3:])
    message.pose.covariance = matrix.ravel()
    return message


def figures_message(stamp_ns: int, frame: str, components: Array) -> TwistStamped:
    """Six components (m, then rad) in µm and µrad, as people read them; NaN leaves a gap in a plot."""
    message = TwistStamped(header=header(stamp_ns, frame))
    vectors = (message.twist.linear, message.twist.angular)
    for vector, values in zip(vectors, np.reshape(components * 1e6, (2, 3)).tolist(), strict=True):
        vector.x, vector.y, vector.z = values
    return message


def quaternion(rotation: Array) -> Quaternion:
    """Unit quaternion of a rotation vector (3,), rad."""
    angle = math.sqrt(float(rotation @ rotation))
    # sin(angle/2)/angle loses all digits at zero, where its series 1/2 - angle²/48 is exact to rounding.
    scale = 0.5 - angle * angle / 48 if angle < _SMALL_ANGLE else math.sin(angle / 2) / angle
    x, y, z = (float(scale * component) for component in rotation)
    return Quaternion(x=x, y=y, z=z, w=math.cos(angle / 2))


def rotation_vector(orientation: Quaternion) -> Array:
    """Rotation vector (3,) in rad of a unit quaternion, at most half a turn long."""
    sign = math.copysign(1.0, orientation.w)
    vector = sign * np.array([orientation.x, orientation.y, orientation.z])
    length = math.sqrt(float(vector @ vector))
    angle = 2 * math.atan2(length, sign * orientation.w)
    scale = 2.0 + length * length / 3 if length < _SMALL_ANGLE else angle / length
    return vector * scale
