"""The controller of a mock cell: command, force and temperature of the stage, and the axes of a moving machine.

ros2 run rotary_error_monitor mock_controller --ros-args -p machine:=xyzac_trt
"""

from __future__ import annotations

from collections.abc import Hashable
from functools import partial

from rotary_error_monitor.description.machine import MachineDescription, load_machine
from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.description.streams import TEMPERATURE
from rotary_error_monitor.description.topics import samples_columns
from rotary_error_monitor.linuxcnc_controller.gate import GateLimits
from rotary_error_monitor.linuxcnc_controller.protocol import LinkSettings
from rotary_error_monitor.linuxcnc_controller.shaping import ShapedCourse
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.applied_corrections import AppliedCorrections
from rotary_error_monitor.nodes.correction_listener import ControllerReport, CorrectionListener
from rotary_error_monitor.nodes.diagnostics import Condition
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.parameters import cell_settings
from rotary_error_monitor.nodes.process import program
from rotary_error_monitor.nodes.sensor import BlockSender
from rotary_error_monitor.signals.blocks import NANOSECONDS
from rotary_error_monitor.sources.mock import MOCK, RATE, MockSource, mock_settings, mock_stage
from rotary_error_monitor.sources.mock_machine import MachineMotion

_FORCE_PERIOD = 50_000_000
_JOINT_STATE_PERIOD = 10_000_000
_TEMPERATURE_PERIOD = NANOSECONDS
_LONGEST_DELAY = NANOSECONDS
"""How long a wake-up may come late, ns; more, or less than nothing, is a clock that was set."""


class MockController(ManagedNode):
    """Publishes what a controller and the sensors around a stage would; with a machine also where its axes are.

    Its corrections are believed and followed as `linuxcnc_bridge` does by default, without moving anything; they may
    stand while its axes move.
    """

    hardware = MOCK
    simulates = True
    settings = (
        *cell_settings("machine", "block_period", "mock."),
        RATE,
        Setting("max_age", GateLimits.max_age, "oldest correction that is believed, s", (0.01, 10.0)),
    )

    def open(self) -> None:
        """Begin to send."""
        self._plant = mock_stage(self.stage, mock_settings(self.setting, self.now_ns(), self.setting(RATE.name)))
        block_ns = round(self.setting("block_period") * NANOSECONDS)
        wire = self.wire.topic
        self._senders = []
        for samples, people, period_ns, joint in (
            (wire("command_samples"), wire("command_joint_states"), block_ns, messages.STAGE_JOINT),
            (wire("force_samples"), wire("force_wrench"), _FORCE_PERIOD, ""),
            (wire("temperature_samples"), wire("stage_temperature"), _TEMPERATURE_PERIOD, ""),
        ):
            told = people, partial(messages.latest_message, people, joint=joint)
            source = MockSource(self._plant, samples.frame)
            self._senders.append(BlockSender(self, samples, source, period_ns, told))
        self._listener: CorrectionListener | None = None
        if self.setting("machine"):
            self._open_machine()

    def conditions(self, now_ns: int) -> list[Condition]:
        """The streams that go out, and with a machine what becomes of the corrections."""
        streams = [sender.watch.report(now_ns) for sender in self._senders]
        return streams if self._listener is None else [*streams, self._listener.condition()]

    def news(self, now_ns: int) -> Hashable:
        """Whether the streams go out; of corrections their listener says so."""
        return tuple(sender.watch.state(now_ns) for sender in self._senders)

    def _open_machine(self) -> None:
        machine = load_machine(self.setting("machine"))
        motion = MachineMotion(machine, self._plant)
        self._listener = self._follow_corrections(machine)
        joints, warmth = self.wire.topic("machine_joint_states"), self.wire.topic("machine_temperature")
        joint_publisher, warmth_publisher = self.publish_on(joints), self.publish_on(warmth)

        def send_joints(due_ns: int) -> None:
            states = motion.at(due_ns)
            joint_publisher.publish(
                messages.joint_state_message(
                    due_ns,
                    joints.frame,
                    [state.letter for state in states],
                    [state.position for state in states],
                    [state.velocity for state in states],
                )
            )

        def send_temperature(due_ns: int) -> None:
            block = MockSource(self._plant, TEMPERATURE).take(due_ns - _TEMPERATURE_PERIOD, due_ns)
            if block is not None:
                temperature = block.columns(samples_columns(TEMPERATURE))[-1, 0]
                warmth_publisher.publish(messages.temperature_message(due_ns, warmth.frame, temperature))

        self.at_each(_JOINT_STATE_PERIOD, send_joints)
        self.at_each(_TEMPERATURE_PERIOD, send_temperature)

    def _follow_corrections(self, machine: MachineDescription) -> CorrectionListener:
        """Bring corrections about as a controller would, and say what is in effect."""
        letters = machine.letters
        limits = LinkSettings().course_limits(axis.kind == "rotary" for axis in machine.axes)
        course = ShapedCourse(limits, (0.0,) * len(letters))
        applied = AppliedCorrections(self)
        last_ns = 0

        def advance(due_ns: int) -> None:
            nonlocal last_ns
            # A wake-up that comes late is for all that became due, but not for a clock that was set.
            if not 0 < due_ns - last_ns <= _LONGEST_DELAY:
                last_ns = due_ns - _JOINT_STATE_PERIOD
            for time_ns in range(last_ns + _JOINT_STATE_PERIOD, due_ns + 1, _JOINT_STATE_PERIOD):
                course.advance(time_ns)
            last_ns = due_ns
            applied.publish(due_ns, letters, course.positions)

        def fare() -> ControllerReport:
            return ControllerReport("", ("slowed by the controller's limits",) if course.slowed else ())

        listener = CorrectionListener(
            self,
            controller=fare,
            follow=lambda correction: course.aim(correction.positions),
            halt=course.halt,
        )
        listener.believe(GateLimits(letters, limits.largest, letters, self.setting("max_age"), speed=limits.speed))
        self.at_each(_JOINT_STATE_PERIOD, advance)
        return listener


main = program(MockController, "mock_controller")

if __name__ == "__main__":
    raise SystemExit(main())
