"""The force on the shaft of the stage, by a load cell.

ros2 run rotary_error_monitor stage_force --ros-args -p source:=wrench -p wrench.topic:=/load_cell
"""

from __future__ import annotations

from rotary_error_monitor.nodes.process import program
from rotary_error_monitor.nodes.sensor import SensorNode

NAME = "stage_force"


class StageForce(SensorNode):
    """Publishes the force on the shaft as sample blocks, and as a wrench for people."""

    kind = NAME
    own_topics = ("force_samples", "force_wrench")


main = program(StageForce, NAME)

if __name__ == "__main__":
    raise SystemExit(main())
