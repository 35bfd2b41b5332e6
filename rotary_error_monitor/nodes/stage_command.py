"""The command of the stage as its controller tells it.

ros2 run rotary_error_monitor stage_command --ros-args -p source:=joint_state -p joint_state.topic:=/joint_states \
    -p joint_state.joint:=spindle
"""

from __future__ import annotations

from rotary_error_monitor.nodes.messages import STAGE_JOINT
from rotary_error_monitor.nodes.process import program
from rotary_error_monitor.nodes.sensor import SensorNode

NAME = "stage_command"


class StageCommand(SensorNode):
    """Publishes the commanded rotation and speed as sample blocks, and as a joint state for people."""

    kind = NAME
    own_topics = ("command_samples", "command_joint_states")
    joint = STAGE_JOINT


main = program(StageCommand, NAME)

if __name__ == "__main__":
    raise SystemExit(main())
