"""Frames on `/tf`, where tf2 is installed: it has no wheel, so that a cell without apt-installed ROS does without."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from functools import partial
from typing import Any

from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from rclpy.node import Node

from rotary_error_monitor.machine.frames import Frame
from rotary_error_monitor.nodes import messages


class FrameBroadcaster:
    """Publishes frames by tf2's own broadcaster; says once where there is none, and is silent then."""

    def __init__(self, node: Node) -> None:
        """Look for tf2."""
        self._broadcaster: Any = None
        try:
            tf2 = importlib.import_module("tf2_ros")
        except ImportError:
            node.get_logger().info("no frames on /tf: tf2_ros is not installed (apt install ros-jazzy-tf2-ros-py)")
            return
        self._broadcaster = tf2.TransformBroadcaster(node)
        self._destroy = partial(node.destroy_publisher, self._broadcaster.pub_tf)

    def send(self, stamp_ns: int, frames: Sequence[Frame]) -> None:
        """Frames as they stood at a timestamp (ns)."""
        if self._broadcaster is not None and frames:
            self._broadcaster.sendTransform([_message(stamp_ns, frame) for frame in frames])

    def close(self) -> None:
        """Put away what tf2 publishes with."""
        if self._broadcaster is not None:
            self._destroy()
            self._broadcaster = None


def _message(stamp_ns: int, frame: Frame) -> TransformStamped:
    (x, y, z), (i, j, k, w) = frame.shift.tolist(), frame.orientation.tolist()
    return TransformStamped(
        header=messages.header(stamp_ns, frame.parent),
        child_frame_id=frame.name,
        transform=Transform(translation=Vector3(x=x, y=y, z=z), rotation=Quaternion(x=i, y=j, z=k, w=w)),
    )
