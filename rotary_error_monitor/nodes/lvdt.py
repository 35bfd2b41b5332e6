"""The reference LVDT that touches an artefact above the ring: to compare with, never an input of the estimate.

ros2 run rotary_error_monitor lvdt --ros-args -p source:=mock
ros2 run rotary_error_monitor lvdt --ros-args -p source:=vector3 -p vector3.topic:=/my_lvdt/displacement
"""

from __future__ import annotations

from rotary_error_monitor.nodes.process import program
from rotary_error_monitor.nodes.sensor import SensorNode

NAME = "lvdt"


class LvdtNode(SensorNode):
    """Publishes the displacement of the artefact as sample blocks, and as a vector for people."""

    kind = NAME
    own_topics = ("lvdt_samples", "lvdt_radial")


main = program(LvdtNode, NAME)

if __name__ == "__main__":
    raise SystemExit(main())
