"""A mock stage on a machine: its rotor follows the machine's monitored axis, and all its instruments speak.

It stands for read heads and autocollimator where the axis is turned by a controller, as LinuxCNC's table is.

python -m rotary_error_monitor.nodes.stage_follower --ros-args -p machine:=xyzac_trt
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence

from geometry_msgs.msg import Vector3Stamped
from sensor_msgs.msg import JointState

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.diagnostics import Condition, Level, StreamWatch
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.parameters import cell_settings
from rotary_error_monitor.nodes.process import run
from rotary_error_monitor.nodes.sensor import MOCK_SETTINGS, RATE, BlockSender, mock_settings
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock
from rotary_error_monitor.sources.follower import FollowedSource, FollowedStage

NAME = "stage_follower"
_STALE_AFTER = 0.5


class StageFollower(ManagedNode):
    """Publishes what the instruments of a stage see that turns with an axis of the machine."""

    settings = (*cell_settings("machine"), *MOCK_SETTINGS, RATE)
    hardware = "mock"

    def open(self) -> None:
        """Listen to the axis; the instruments speak from its first joint state on."""
        machine = load_machine(self.setting("machine"))
        if machine.monitored is None:
            raise InputError(f"machine {machine.name} has no monitored axis for the stage to follow")
        self._axis = machine.monitored
        self._stage = FollowedStage(self.stage, mock_settings(self))
        period_ns = round(self.setting("block_period") * NANOSECONDS)
        wire = self.wire.topic
        self._senders = []
        for head in self.stage.encoder.azimuths:
            topic = wire("head_samples", head)
            people = wire("head_joint_states", head)
            source = FollowedSource(self._stage, f"head_{head}")
            self._senders.append(BlockSender(self, topic, source, period_ns, (people, self._angle(people.frame))))
        for stream, people, told in (
            ("autocollimator", wire("autocollimator_tilt"), self._tilt),
            ("command", wire("command_joint_states"), self._angle(wire("command_joint_states").frame)),
        ):
            topic, source = wire(f"{stream}_samples"), FollowedSource(self._stage, stream)
            self._senders.append(BlockSender(self, topic, source, period_ns, (people, told)))
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

    @staticmethod
    def _angle(frame: str) -> Callable[[SampleBlock], JointState]:
        def message(block: SampleBlock) -> JointState:
            return messages.joint_state_message(int(block.times_ns[-1]), frame, [frame], [block.rows[-1, 1]])

        return message

    def _tilt(self, block: SampleBlock) -> Vector3Stamped:
        frame = self.wire.topic("autocollimator_tilt").frame
        return messages.vector_message(int(block.times_ns[-1]), frame, *block.rows[-1, 1:3])


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until a signal; the exit code is 0 then, 2 after wrong input."""
    return run(lambda: StageFollower(NAME), args)


if __name__ == "__main__":
    sys.exit(main())
