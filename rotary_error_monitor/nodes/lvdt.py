"""The reference LVDT that touches an artefact above the ring: to compare with, never an input of the estimate.

ros2 run rotary_error_monitor lvdt
ros2 run rotary_error_monitor lvdt --ros-args -p source:=vector3 -p vector3.topic:=/my_lvdt/displacement
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, ClassVar

from geometry_msgs.msg import Vector3Stamped

from rotary_error_monitor.description.wire import Topic
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.parameters import Setting
from rotary_error_monitor.nodes.process import run
from rotary_error_monitor.nodes.sensor import MOCK, MOCK_SETTINGS, SensorNode, mock_settings, source_setting
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.sources.mock import MockSource, mock_stage
from rotary_error_monitor.sources.source import Gathered, Source

NAME = "lvdt"
FIELDS = ("radial_x", "radial_y")


class Lvdt(SensorNode):
    """Publishes the displacement of the artefact as sample blocks, and as a vector for people."""

    settings = (
        source_setting(MOCK, "vector3"),
        *MOCK_SETTINGS,
        Setting("vector3.topic", "lvdt/displacement", "topic of a third-party driver: displacement in m"),
        Setting(
            "mock.height",
            0.0,
            "height of the mock artefact above the ring, m; 0.0 for that of the stage",
            (-10.0, 10.0),
        ),
    )

    def topics(self) -> tuple[Topic, Topic]:
        """Topics of the instrument."""
        return self.wire.topic("lvdt_samples"), self.wire.topic("lvdt_radial")

    def human_message(self, block: SampleBlock) -> Vector3Stamped:
        """The latest displacement."""
        frame = self.wire.topic("lvdt_radial").frame
        return messages.vector_message(int(block.times_ns[-1]), frame, *block.columns(FIELDS)[-1])

    def _mock(self) -> Source:
        lvdt, height = self.stage.lvdt, self.setting("mock.height")
        if lvdt is None:
            raise InputError(f"{self.setting('stage') or 'stage.yaml'}: the stage has no section 'lvdt'")
        stage = replace(self.stage, lvdt=replace(lvdt, height=height or lvdt.height))
        return MockSource(mock_stage(stage, mock_settings(self)), NAME)

    def _vector3(self) -> Source:
        return self.hear(
            self.setting("vector3.topic"),
            Vector3Stamped,
            Gathered(FIELDS),
            lambda message: (message.vector.x, message.vector.y),
        )

    sources: ClassVar[dict[str, Callable[[Any], Source]]] = {MOCK: _mock, "vector3": _vector3}


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until a signal; the exit code is 0 then, 2 after wrong input."""
    return run(lambda: Lvdt(NAME), args)


if __name__ == "__main__":
    sys.exit(main())
