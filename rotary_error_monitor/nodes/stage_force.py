"""The force on the shaft of the stage, by a load cell.

ros2 run rotary_error_monitor stage_force --ros-args -p source:=wrench -p wrench.topic:=/load_cell
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from rotary_error_monitor.description.wire import Topic
from rotary_error_monitor.nodes.process import run
from rotary_error_monitor.nodes.sensor import SensorNode

NAME = "stage_force"


class StageForce(SensorNode):
    """Publishes the force on the shaft as sample blocks, and as a wrench for people."""

    kind = NAME

    def topics(self) -> tuple[Topic, Topic]:
        """Those of the one that a stage has."""
        return self.wire.topic("force_samples"), self.wire.topic("force_wrench")


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until a signal; the exit code is 0 then, 2 after wrong input."""
    return run(lambda: StageForce(NAME), args)


if __name__ == "__main__":
    sys.exit(main())
