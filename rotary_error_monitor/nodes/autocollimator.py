"""The autocollimator that looks at the mirror on the rotor.

ros2 run rotary_error_monitor autocollimator --ros-args -p source:=mock
ros2 run rotary_error_monitor autocollimator --ros-args -p source:=vector3 -p vector3.topic:=/my_collimator/angles
ros2 run rotary_error_monitor autocollimator --ros-args -p source:=iio -p iio.sensitivity:=0.0004
"""

from __future__ import annotations

from rotary_error_monitor.nodes.process import program
from rotary_error_monitor.nodes.sensor import SensorNode

NAME = "autocollimator"


class AutocollimatorNode(SensorNode):
    """Publishes the tilt of the mirror as sample blocks, and as a vector for people."""

    kind = NAME
    own_topics = ("autocollimator_samples", "autocollimator_tilt")


main = program(AutocollimatorNode, NAME)

if __name__ == "__main__":
    raise SystemExit(main())
