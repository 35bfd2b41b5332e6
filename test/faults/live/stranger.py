"""A second publisher on a topic of the cell: what it sends is no message that the cell can use."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2, PointField

from rotary_error_monitor.codec.cdr_blocks import encode_block
from rotary_error_monitor.description.wire import Topic
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.qos import profile
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.testing import Cell

NAME = "stranger"
MILLION = 1_000_000


@contextmanager
def stranger(cell: Cell) -> Iterator[Node]:
    """A node of a participant of its own, as that of another program is."""
    context = Context()
    rclpy.init(context=context, domain_id=cell.node.context.get_domain_id(), args=[])
    node = Node(NAME, context=context)
    try:
        yield node
    finally:
        node.destroy_node()
        context.try_shutdown()


class Speaker:
    """Publishes one more of what `make` makes of a topic, with a fresh stamp, each time it is called."""

    def __init__(
        self, node: Node, topic: Topic, make: Callable[[Topic], object], qos: QoSProfile | None = None
    ) -> None:
        first = make(topic)
        kind = messages.message_class(topic.type) if isinstance(first, bytes) else type(first)
        self.publisher = node.create_publisher(kind, topic.name, qos or profile(topic))
        self._make = lambda: make(topic)

    def __call__(self) -> None:
        self.publisher.publish(self._make())


def _block(topic: Topic, count: int = 1) -> SampleBlock:
    rows = np.zeros((count, 1 + len(topic.columns)))
    rows[:, 0] = np.linspace(-0.01, 0.0, count)
    return SampleBlock(time.time_ns(), ("t", *topic.columns), rows)


def _message(topic: Topic) -> PointCloud2:
    return deserialize_message(encode_block(_block(topic), topic.frame), PointCloud2)


def plausible(topic: Topic) -> bytes:
    """A block as it should be, of a stage that stands still somewhere else."""
    return encode_block(_block(topic), topic.frame)


def wrong_fields(topic: Topic) -> bytes:
    """A block of other columns."""
    block = _block(topic)
    names = ("t", *(f"{name}x" for name in topic.columns))
    return encode_block(SampleBlock(block.stamp_ns, names, block.rows), topic.frame)


def wrong_types(topic: Topic) -> object:
    """Columns of 32 bits."""
    message = _message(topic)
    for number, each in enumerate(message.fields):
        each.datatype, each.offset = PointField.FLOAT32, 4 * number
    return message


def big_endian(topic: Topic) -> object:
    """Samples in the other byte order, as the message says."""
    message = _message(topic)
    message.is_bigendian = True
    return message


def empty(topic: Topic) -> object:
    """A block without samples."""
    message = _message(topic)
    message.width, message.row_step, message.data = 0, 0, b""
    return message


def a_million(topic: Topic) -> bytes:
    """A block of a million points."""
    return encode_block(_block(topic, MILLION), topic.frame)
