"""ROS nodes: convert, call the core, publish. The only room that imports rclpy beside `testing`."""

import sys

from rotary_error_monitor.start import end_at_once

if sys.argv[:1] == ["-m"]:  # so it is while Python looks for the module that `python -m` names: this process is a node
    end_at_once()
