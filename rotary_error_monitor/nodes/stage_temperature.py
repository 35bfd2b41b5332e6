"""The temperature of the stage, by a thermometer.

ros2 run rotary_error_monitor stage_temperature --ros-args -p source:=temperature -p temperature.topic:=/thermometer
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from rotary_error_monitor.description.wire import Topic
from rotary_error_monitor.nodes.process import run
from rotary_error_monitor.nodes.sensor import THERMOMETER, SensorNode

NAME = "stage_temperature"


class StageTemperature(SensorNode):
    """Publishes the temperature of the stage as sample blocks, and as a temperature for people."""

    kind = NAME

    def slowest(self, stream: str) -> float:
        """That of thermometers, s."""
        return THERMOMETER

    def topics(self) -> tuple[Topic, Topic]:
        """Those of the one that a stage has."""
        return self.wire.topic("temperature_samples"), self.wire.topic("stage_temperature")


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until a signal; the exit code is 0 then, 2 after wrong input."""
    return run(lambda: StageTemperature(NAME), args)


if __name__ == "__main__":
    sys.exit(main())
