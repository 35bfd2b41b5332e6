"""The autocollimator that looks at the mirror on the rotor.

ros2 run rotary_error_monitor autocollimator --ros-args -p source:=mock
ros2 run rotary_error_monitor autocollimator --ros-args -p source:=vector3 -p vector3.topic:=/my_collimator/angles
ros2 run rotary_error_monitor autocollimator --ros-args -p source:=iio -p iio.sensitivity:=0.0004
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from rotary_error_monitor.description.wire import Topic
from rotary_error_monitor.nodes.process import run
from rotary_error_monitor.nodes.sensor import SensorNode

NAME = "autocollimator"


class Autocollimator(SensorNode):
    """Publishes the tilt of the mirror as sample blocks, and as a vector for people."""

    kind = NAME

    def topics(self) -> tuple[Topic, Topic]:
        """Those of the one that a stage has."""
        return self.wire.topic("autocollimator_samples"), self.wire.topic("autocollimator_tilt")


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until a signal; the exit code is 0 then, 2 after wrong input."""
    return run(lambda: Autocollimator(NAME), args)


if __name__ == "__main__":
    sys.exit(main())
