"""The temperature of the stage, by a thermometer.

ros2 run rotary_error_monitor stage_temperature --ros-args -p source:=temperature -p temperature.topic:=/thermometer
"""

from __future__ import annotations

from rotary_error_monitor.nodes.process import program
from rotary_error_monitor.nodes.sensor import THERMOMETER, SensorNode

NAME = "stage_temperature"


class StageTemperature(SensorNode):
    """Publishes the temperature of the stage as sample blocks, and as a temperature for people."""

    kind = NAME
    own_topics = ("temperature_samples", "stage_temperature")

    def slowest(self, stream: str) -> float:
        """That of thermometers, s."""
        return THERMOMETER


main = program(StageTemperature, NAME)

if __name__ == "__main__":
    raise SystemExit(main())
