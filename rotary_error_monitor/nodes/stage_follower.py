"""A mock stage on a machine: its rotor follows the machine's monitored axis, and all its instruments speak.

It stands for read heads and autocollimator where the axis is turned by a controller, as LinuxCNC's table is.

python -m rotary_error_monitor.nodes.stage_follower --ros-args -p machine:=xyzac_trt
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial

from sensor_msgs.msg import JointState

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.diagnostics import Condition, Level, StreamWatch
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.parameters import cell_settings
from rotary_error_monitor.nodes.process import run
from rotary_error_monitor.nodes.sensor import BlockSender
from rotary_error_monitor.signals.blocks import NANOSECONDS
from rotary_error_monitor.sources.follower import FollowedSource, FollowedStage
from rotary_error_monitor.sources.mock import MOCK, RATE, mock_settings

NAME = "stage_follower"
_STALE_AFTER = 0.5


class StageFollower(ManagedNode):
    """Publishes what the instruments of a stage see that turns with an axis of the machine."""

    settings = (*cell_settings("machine", "block_period", "mock."), RATE)
    hardware = MOCK
    simulates = True

    def open(self) -> None:
        """Listen to the axis; the instruments speak from its first joint state on."""
        if not self.setting("machine"):
            raise InputError(f"{self.get_fully_qualified_name()}: parameter 'machine' is empty; name the machine")
        machine = load_machine(self.setting("machine"))
        if machine.monitored is None:
            raise InputError(f"machine {machine.name} has no monitored axis for the stage to follow")
        self._axis = machine.monitored
        self._stage = FollowedStage(self.stage, mock_settings(self.setting, self.now_ns(), self.setting(RATE.name)))
        period_ns = round(self.setting("block_period") * NANOSECONDS)
        wire = self.wire.topic
        self._senders = []
        instruments = [(wire("head_samples", h), wire("head_joint_states", h), "") for h in self.stage.azimuths]
        if self.stage.autocollimator is not None:
            instruments.append((wire("autocollimator_samples"), wire("autocollimator_tilt"), ""))
        if not instruments:
            raise InputError("the stage has no section 'encoder' or 'autocollimator'; this node stands for these alone")
        instruments.append((wire("command_samples"), wire("command_joint_states"), messages.STAGE_JOINT))
        for topic, people, joint in instruments:
            told = people, partial(messages.latest_message, people, joint=joint)
            source = FollowedSource(self._stage, topic.frame)
            self._senders.append(BlockSender(self, topic, source, period_ns, told))
        self._joints = wire("machine_joint_states")
        self._watch = StreamWatch(self._joints.name, _STALE_AFTER, _STALE_AFTER, self.now_ns())
        self.listen_to(self._joints, self._follow)

    def conditions(self, now_ns: int) -> list[Condition]:
        """The axis that is followed, and the streams that go out."""
        topic, last_ns = self._joints.name, self._watch.last_ns
        if last_ns is None:
            return [Condition("axis", Level.WARN, f"waiting for a joint state of axis {self._axis} on {topic}")]
        age = (now_ns - last_ns) / NANOSECONDS
        level, words = Level.OK, f"following {self._axis}"
        if self._watch.is_stale(now_ns):
            level, words = Level.ERROR, f"no joint state of axis {self._axis} for {age:.1f} s on {topic}"
        axis = Condition("axis", level, words, {"age_ms": age * 1e3})
        return [axis, *(sender.watch.report(now_ns) for sender in self._senders)]

    def _follow(self, message: JointState) -> None:
        if self.is_shared(self._joints.name):
            raise InputError(self.publishers_of(self._joints.name))
        stamp_ns = messages.measured_ns(message.header)
        positions, velocities = messages.joint_motion(message)
        if self._axis not in positions:
            raise InputError(f"joint state of {', '.join(positions)} lacks axis {self._axis}")
        self._stage.command(stamp_ns, positions[self._axis], velocities.get(self._axis, 0.0))
        self._watch.observe_stamp(stamp_ns, self.now_ns())


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until a signal; the exit code is 0 then, 2 after wrong input."""
    return run(lambda: StageFollower(NAME), args)


if __name__ == "__main__":
    sys.exit(main())
