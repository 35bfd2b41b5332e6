"""Sample blocks of messages that a test's subscription received."""

from __future__ import annotations

from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2

from rotary_error_monitor.codec.cdr_blocks import BlockDecoder
from rotary_error_monitor.signals.blocks import SampleBlock


def block_of(message: PointCloud2) -> SampleBlock:
    """The block as nodes read it, of the message's bytes."""
    return BlockDecoder(finite=False).decode(serialize_message(message))
