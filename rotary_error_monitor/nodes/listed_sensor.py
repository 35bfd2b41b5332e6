"""One of the sensors that the stage's description lists by name, such as a displacement probe.

ros2 run rotary_error_monitor listed_sensor --ros-args -r __node:=listed_sensor_top -p source:=mock
ros2 run rotary_error_monitor listed_sensor --ros-args -p sensor:=top -p source:=vector3 -p vector3.topic:=/my_probe
"""

from __future__ import annotations

from rotary_error_monitor.description.listed_sensors import name_of
from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.description.wire import Topic
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes.process import program
from rotary_error_monitor.nodes.sensor import THERMOMETER, SensorNode

NAME = "listed_sensor"
_SLOW_PERIOD = 1.0
"""Time between blocks of a thermometer, s: a stage warms in minutes, and diagnostics tell its age as often."""

_INPUT_PERIOD = 0.05
"""Time between blocks of a faster input such as a force, s, which no estimate waits for."""


class ListedSensorNode(SensorNode):
    """Publishes what one listed sensor sees as sample blocks, and its latest sample for people."""

    kind = NAME
    settings = (
        Setting(
            "sensor",
            "",
            "sensor of the stage description by its name there (top) or that of its stream (axial_probe_top); "
            "empty takes it from the node's name, listed_sensor_top",
        ),
    )

    def topics(self) -> tuple[Topic, Topic]:
        """Those of this sensor, by its kind and its name."""
        stream = self.sensor()
        (people,) = (topic for topic in self.wire if topic.frame == stream and not topic.is_sample_block)
        return self.wire.of_stream(stream), people

    def block_period(self, stream: str) -> float:
        """The parameter; of inputs what is enough for them where that is longer."""
        usual, sensor = super().block_period(stream), self.stage.inputs.get(stream)
        return usual if sensor is None else max(_SLOW_PERIOD if sensor.is_slow else _INPUT_PERIOD, usual)

    def slowest(self, stream: str) -> float:
        """Of slow inputs that of thermometers, s."""
        return THERMOMETER if self.stage.listed[stream].is_slow else super().slowest(stream)

    def sensor(self) -> str:
        """Stream of this sensor, by the parameter or by the name of the node.

        Raises:
            InputError: the stage lists no such sensor, or several of different kinds by that name.
        """
        asked = str(self.setting("sensor") or self.get_name().removeprefix(f"{NAME}_"))
        listed = self.stage.listed
        found = [s for s in listed if s == asked] or [s for s in listed if name_of(s, listed[s]) == asked]
        if len(found) != 1:
            lists = f"lists the sensors {', '.join(listed)}" if listed else "lists no sensors"
            raise InputError(
                f"{self.get_fully_qualified_name()}: parameter 'sensor' is {asked!r}, which is "
                f"{'several' if found else 'none'} of the stage's; it {lists} (or name the node {NAME}_<sensor>)"
            )
        return found[0]


main = program(ListedSensorNode, NAME)

if __name__ == "__main__":
    raise SystemExit(main())
