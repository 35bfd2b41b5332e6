"""One read head of the rotary encoder.

ros2 run rotary_error_monitor encoder_head --ros-args -r __node:=encoder_head_b
ros2 run rotary_error_monitor encoder_head --ros-args -p head:=a -p source:=joint_state
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from sensor_msgs.msg import JointState

from rotary_error_monitor.description.wire import Topic
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.parameters import Setting
from rotary_error_monitor.nodes.process import run
from rotary_error_monitor.nodes.sensor import MOCK, MOCK_SETTINGS, POLL_RATE, RATE, SensorNode, source_setting
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.sources.counter import Counter
from rotary_error_monitor.sources.source import Gathered, Polled, Source
from rotary_error_monitor.sources.unwrapping import unwrap_angle

NAME = "encoder_head"
_FIELDS = ("angle",)


class EncoderHead(SensorNode):
    """Publishes the readings of one head as sample blocks, and as a joint state for people."""

    settings = (
        source_setting(MOCK, "joint_state", "counter"),
        Setting(
            "head",
            "",
            "letter of the head in the stage description; empty takes it from the node's name, encoder_head_a",
        ),
        *MOCK_SETTINGS,
        RATE,
        POLL_RATE,
        Setting("joint_state.topic", "joint_states", "topic of the third-party driver"),
        Setting("joint_state.joint", "", "name of the joint in its messages; empty for their only one"),
        Setting("counter.device", "/sys/bus/counter/devices/counter0/count0", "folder of the count in sysfs"),
        Setting("counter.reverse", False, "whether the counter counts against the positive rotation"),
    )

    def topics(self) -> tuple[Topic, Topic]:
        """Topics of this head."""
        head = self._head()
        return self.wire.topic("head_samples", head), self.wire.topic("head_joint_states", head)

    def human_message(self, block: SampleBlock) -> JointState:
        """The latest reading, and the mean speed over the block."""
        topic = self.wire.topic("head_joint_states", self._head())
        times, angle = block.column("t"), block.column("angle")
        speed = (angle[-1] - angle[0]) / (times[-1] - times[0]) if len(times) > 1 else 0.0
        stamp_ns = int(block.times_ns[-1])
        return messages.joint_state_message(stamp_ns, topic.frame, [topic.frame], [angle[-1]], [float(speed)])

    def _head(self) -> str:
        head = self.setting("head") or self.get_name().removeprefix(f"{NAME}_")
        if head not in self.stage.encoder.azimuths:
            raise InputError(
                f"{self.get_fully_qualified_name()}: parameter 'head' is {head!r}; the stage has the heads "
                f"{', '.join(self.stage.encoder.azimuths)} (or name the node {NAME}_<head>)"
            )
        return head

    def _mock(self) -> Source:
        return self.mock(f"head_{self._head()}")

    def _counter(self) -> Source:
        encoder = self.stage.encoder
        counts = encoder.lines_per_revolution * encoder.counts_per_line
        folder = Path(self.setting("counter.device"))
        return Polled(_FIELDS, Counter(folder, counts, reverse=self.setting("counter.reverse")))

    def _joint_state(self) -> Source:
        joint = self.setting("joint_state.joint")
        return self.hear(
            self.setting("joint_state.topic"),
            JointState,
            ContinuousAngle(_FIELDS),
            lambda message: (messages.joint_position(message, joint),),
        )

    sources: ClassVar[dict[str, Callable[[Any], Source]]] = {
        MOCK: _mock,
        "joint_state": _joint_state,
        "counter": _counter,
    }


class ContinuousAngle(Gathered):
    """Angles of a third-party driver; those that wrap are made continuous."""

    _last: float | None = None

    def add(self, time_ns: int, values: Sequence[float], arrival_ns: int | None = None) -> None:
        """Keep one angle, as `Gathered.add`.

        Raises:
            InputError: as there; an angle that is refused leaves no trace in those after it.
        """
        (angle,) = values
        if not np.isfinite(angle):
            raise InputError(f"a position is {angle}; expected a finite angle in rad")
        continuous = angle if self._last is None else unwrap_angle(angle, self._last)
        super().add(time_ns, (continuous,), arrival_ns)
        self._last = continuous


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until a signal; the exit code is 0 then, 2 after wrong input."""
    return run(lambda: EncoderHead(NAME), args)


if __name__ == "__main__":
    sys.exit(main())
