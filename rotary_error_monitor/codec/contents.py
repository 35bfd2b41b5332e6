"""What messages hold, as frozen dataclasses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.signals.blocks import SampleBlock


@dataclass(frozen=True)
class JointState:
    """Axes by name; `position` (n,) in m or rad, `velocity` and `effort` (n,) per s, each empty where not given."""

    stamp_ns: int
    names: tuple[str, ...]
    position: Array
    velocity: Array
    effort: Array
    frame: str = ""


@dataclass(frozen=True)
class PointStamped:
    """A point (3,) in m."""

    stamp_ns: int
    point: Array
    frame: str = ""


@dataclass(frozen=True)
class Temperature:
    """Temperature in °C and its variance in K^2, 0 where unknown."""

    stamp_ns: int
    temperature: float
    variance: float = 0.0
    frame: str = ""


@dataclass(frozen=True)
class PoseWithCovariance:
    """Position (3,) in m, orientation as quaternion x y z w (4,), covariance (6, 6) of position and rotation."""

    stamp_ns: int
    position: Array
    orientation: Array
    covariance: Array
    frame: str = ""


Content = SampleBlock | JointState | PointStamped | Temperature | PoseWithCovariance

TYPES: Mapping[type, str] = {
    SampleBlock: "sensor_msgs/msg/PointCloud2",
    JointState: "sensor_msgs/msg/JointState",
    PointStamped: "geometry_msgs/msg/PointStamped",
    Temperature: "sensor_msgs/msg/Temperature",
    PoseWithCovariance: "geometry_msgs/msg/PoseWithCovarianceStamped",
}
SAMPLE_BLOCK = TYPES[SampleBlock]


def complete_ns(content: Content) -> int:
    """When all of it was measured, timestamp (ns): of a block its last sample."""
    return content.newest_ns if isinstance(content, SampleBlock) else content.stamp_ns
