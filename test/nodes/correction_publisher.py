"""Publishes corrections of X Y Z A C 100 times a second until it is killed; a program for the tests beside it."""

import sys
import time

import rclpy
from rclpy.node import Node

from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.qos import profile

NAMES = "XYZAC"

rclpy.init()
topic = load_wire(()).topic("axis_corrections")
node = Node(sys.argv[1])
publisher = node.create_publisher(messages.message_class(topic.type), topic.name, profile(topic))
while True:
    values = [float(sys.argv[2])] + [0.0] * 4
    publisher.publish(messages.joint_state_message(time.time_ns(), topic.frame, NAMES, values))
    time.sleep(0.01)
