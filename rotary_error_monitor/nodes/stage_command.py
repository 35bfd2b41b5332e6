"""The command of the stage as its controller tells it.

ros2 run rotary_error_monitor stage_command --ros-args -p source:=joint_state -p joint_state.topic:=/joint_states \
    -p joint_state.joint:=spindle
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from rotary_error_monitor.description.wire import Topic
from rotary_error_monitor.nodes.messages import STAGE_JOINT
from rotary_error_monitor.nodes.process import run
from rotary_error_monitor.nodes.sensor import SensorNode

NAME = "stage_command"


class StageCommand(SensorNode):
    """Publishes the commanded rotation and speed as sample blocks, and as a joint state for people."""

    kind = NAME
    joint = STAGE_JOINT

    def topics(self) -> tuple[Topic, Topic]:
        """Those of the one that a stage has."""
        return self.wire.topic("command_samples"), self.wire.topic("command_joint_states")


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until a signal; the exit code is 0 then, 2 after wrong input."""
    return run(lambda: StageCommand(NAME), args)


if __name__ == "__main__":
    sys.exit(main())
