"""The autocollimator that looks at the mirror on the rotor.

ros2 run rotary_error_monitor autocollimator
ros2 run rotary_error_monitor autocollimator --ros-args -p source:=vector3 -p vector3.topic:=/my_collimator/angles
ros2 run rotary_error_monitor autocollimator --ros-args -p source:=iio -p iio.sensitivity:=0.0004
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, ClassVar

from geometry_msgs.msg import Vector3Stamped

from rotary_error_monitor.description.wire import Topic
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.parameters import Setting
from rotary_error_monitor.nodes.process import run
from rotary_error_monitor.nodes.sensor import MOCK, MOCK_SETTINGS, POLL_RATE, RATE, SensorNode, source_setting
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.sources.iio import QuadrantDetector
from rotary_error_monitor.sources.source import Gathered, Polled, Source

NAME = "autocollimator"
FIELDS = ("tilt_x", "tilt_y")


class Autocollimator(SensorNode):
    """Publishes the tilt of the mirror as sample blocks, and as a vector for people."""

    settings = (
        source_setting(MOCK, "vector3", "iio"),
        *MOCK_SETTINGS,
        RATE,
        POLL_RATE,
        Setting("vector3.topic", "autocollimator/tilt", "topic of a third-party driver: rotation vector in rad"),
        Setting(
            "iio.device", "/sys/bus/iio/devices/iio:device0", "folder of the quadrant detector's converter in sysfs"
        ),
        Setting(
            "iio.channels", [0, 1, 2, 3], "voltage channels of the quadrants (+x, +y), (-x, +y), (-x, -y), (+x, -y)"
        ),
        Setting("iio.dark", [0.0, 0.0, 0.0, 0.0], "voltages of the quadrants without light, V"),
        Setting("iio.sensitivity", 0.0005, "tilt per normalised difference of the voltages, rad", (1e-9, 1.0)),
    )

    def topics(self) -> tuple[Topic, Topic]:
        """Topics of the instrument."""
        return self.wire.topic("autocollimator_samples"), self.wire.topic("autocollimator_tilt")

    def human_message(self, block: SampleBlock) -> Vector3Stamped:
        """The latest tilt."""
        frame = self.wire.topic("autocollimator_tilt").frame
        return messages.vector_message(int(block.times_ns[-1]), frame, *block.columns(FIELDS)[-1])

    def _mock(self) -> Source:
        return self.mock(NAME)

    def _iio(self) -> Source:
        detector = QuadrantDetector(
            Path(self.setting("iio.device")),
            self.setting("iio.channels"),
            self.setting("iio.sensitivity"),
            self.setting("iio.dark"),
        )
        return Polled(FIELDS, detector)

    def _vector3(self) -> Source:
        return self.hear(
            self.setting("vector3.topic"),
            Vector3Stamped,
            Gathered(FIELDS),
            lambda message: (message.vector.x, message.vector.y),
        )

    sources: ClassVar[dict[str, Callable[[Any], Source]]] = {MOCK: _mock, "vector3": _vector3, "iio": _iio}


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until a signal; the exit code is 0 then, 2 after wrong input."""
    return run(lambda: Autocollimator(NAME), args)


if __name__ == "__main__":
    sys.exit(main())
