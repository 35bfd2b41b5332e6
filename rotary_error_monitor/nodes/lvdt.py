"""The reference LVDT that touches an artefact above the ring: to compare with, never an input of the estimate.

ros2 run rotary_error_monitor lvdt --ros-args -p source:=mock
ros2 run rotary_error_monitor lvdt --ros-args -p source:=vector3 -p vector3.topic:=/my_lvdt/displacement
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from rotary_error_monitor.description.wire import Topic
from rotary_error_monitor.nodes.process import run
from rotary_error_monitor.nodes.sensor import SensorNode

NAME = "lvdt"


class Lvdt(SensorNode):
    """Publishes the displacement of the artefact as sample blocks, and as a vector for people."""

    kind = NAME

    def topics(self) -> tuple[Topic, Topic]:
        """Those of the one that a stage has."""
        return self.wire.topic("lvdt_samples"), self.wire.topic("lvdt_radial")


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until a signal; the exit code is 0 then, 2 after wrong input."""
    return run(lambda: Lvdt(NAME), args)


if __name__ == "__main__":
    sys.exit(main())
