"""LinuxCNC as the machine's controller: joint states out, axis corrections in as external offsets.

ros2 run rotary_error_monitor linuxcnc_bridge
ros2 run rotary_error_monitor linuxcnc_bridge --ros-args -p enter:="nsenter --target 4711 --ipc --pid"
"""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Sequence

from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from rotary_error_monitor.controller.connection import Connection
from rotary_error_monitor.controller.modules import SYSTEM_PYTHON
from rotary_error_monitor.controller.protocol import (
    ClearRequest,
    CorrectionRequest,
    End,
    Hello,
    LinkSettings,
    Record,
    State,
)
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.diagnostics import Condition, Level
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.parameters import Setting
from rotary_error_monitor.nodes.process import run
from rotary_error_monitor.signals.blocks import NANOSECONDS

NAME = "linuxcnc_bridge"
SILENCE = 0.3
"""After this long without a word, s, the link counts as hung."""

_RETRY_PERIOD = 1.0
_DEFAULTS = LinkSettings()


class LinuxcncBridge(ManagedNode):
    """Publishes where the program has the machine's joints, and moves them by the corrections that come back.

    The positions leave the corrections out: they say where the machine should be, and what has to be corrected there.
    Corrections that grow old are held, and nothing is published while the machine is off, not homed, or out of reach.
    """

    settings = (
        Setting("rate", 250.0, "joint states and offset updates per second, 1/s", (100.0, 1000.0)),
        Setting("count", _DEFAULTS.count, "size of one external offset count, m and rad", (1e-11, 1e-9)),
        Setting("max_age", _DEFAULTS.max_age, "age at which corrections are held, s", (0.01, 10.0)),
        Setting("largest_linear", _DEFAULTS.largest_linear, "largest correction of a linear axis, m", (0.0, 5e-3)),
        Setting("largest_rotary", _DEFAULTS.largest_rotary, "largest correction of a rotary axis, rad", (0.0, 0.05)),
        Setting("enter", "", "command that runs what follows it where LinuxCNC runs; empty where that is here"),
        Setting("home", "", "home folder of the user that runs LinuxCNC; empty for the same user"),
        Setting("python", SYSTEM_PYTHON, "interpreter for which LinuxCNC's modules are installed"),
    )
    hardware = "linuxcnc"

    def open(self) -> None:
        """Begin to look for LinuxCNC."""
        self._topic = self.wire.topic("machine_joint_states")
        self._joint_states = self.publish_on(self._topic)
        self.listen_to(self.wire.topic("axis_corrections"), self._follow)
        self.serve(Trigger, "~/clear_offsets", self._clear)
        self._link = LinkSettings(
            period=1.0 / self.setting("rate"),
            count=self.setting("count"),
            largest_linear=self.setting("largest_linear"),
            largest_rotary=self.setting("largest_rotary"),
            max_age=self.setting("max_age"),
        )
        self._connection: Connection | None = None
        self._names: tuple[str, ...] = ()
        self._state: State | None = None
        self._absence = "not reached yet"
        self._published = 0
        self._reported_ns = self.now_ns()
        self._lost = False
        self._connect()
        self.every(_RETRY_PERIOD, self._retry)

    def release(self) -> None:
        """Let go of LinuxCNC; the external offsets stay as they are."""
        connection = getattr(self, "_connection", None)
        if connection is not None:
            connection.close()
            self._connection = None

    def conditions(self, now_ns: int) -> list[Condition]:
        """The controller, the machine, and what becomes of the corrections."""
        rate = self._published * NANOSECONDS / max(now_ns - self._reported_ns, 1)
        self._published, self._reported_ns = 0, now_ns
        state = self._state
        if state is None:
            return [Condition("controller", Level.ERROR, self._absence, {"rate_hz": rate})]
        age = (now_ns - state.stamp_ns) / NANOSECONDS
        figures = {"axes": " ".join(self._names), "rate_hz": rate, "age_ms": age * 1e3}
        if age > SILENCE:
            return [Condition("controller", Level.ERROR, f"the link has been silent for {age:.2g} s", figures)]
        controller = Condition("controller", Level.OK, "connected", figures)
        return [controller, self._machine(state), self._corrections(state)]

    def _connect(self) -> None:
        environment = {**os.environ, "HOME": self.setting("home")} if self.setting("home") else None
        self._connection = Connection(
            self._link,
            self._receive,
            enter=shlex.split(self.setting("enter")),
            environment=environment,
            python=self.setting("python"),
        )

    def _retry(self) -> None:
        """Start a new link where the last one has ended."""
        with self.busy:
            if self._lost:
                self.release()
                self._lost = False
                self._connect()

    def _receive(self, record: Record) -> None:
        """Take a record over, on the connection's thread: publishing needs no executor, which would cost more."""
        with self.busy:
            if isinstance(record, State):
                self._state = record
                self._publish(record)
            elif isinstance(record, Hello):
                self._names = record.names
                self.get_logger().info(f"connected to LinuxCNC with the axes {' '.join(record.names)}")
            elif isinstance(record, End):
                self._lose(record.reason)

    def _publish(self, state: State) -> None:
        if not (state.valid and self.active):
            return
        self._joint_states.publish(
            messages.joint_state_message(
                state.stamp_ns, self._topic.frame, self._names, state.positions, state.velocities
            )
        )
        self._published += 1

    def _lose(self, reason: str) -> None:
        if reason != self._absence:
            self.get_logger().error(f"{reason}; no joint states until LinuxCNC is back")
        self._absence, self._state, self._lost = reason, None, True

    def _follow(self, message: JointState) -> None:
        stamp_ns = messages.measured_ns(message.header)
        corrections, _ = messages.joint_motion(message)
        if self._connection is not None:
            self._connection.send(CorrectionRequest(stamp_ns, corrections))

    def _clear(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._connection is not None and self._state is not None
        response.message = "the external offsets go back to zero" if response.success else self._absence
        if self._connection is not None and response.success:
            self._connection.send(ClearRequest())
        return response

    def _machine(self, state: State) -> Condition:
        if not state.valid:
            return Condition("machine", Level.WARN, f"{state.trouble}; no joint states are published")
        return Condition("machine", Level.OK, "on and homed")

    def _corrections(self, state: State) -> Condition:
        figures: dict[str, object] = {
            "age_ms": "none" if state.correction_age < 0 else state.correction_age * 1e3,
            "lag_nm": state.lag * 1e9,
            "changed_by_others": state.takeovers,
            "dropped": self._connection.dropped if self._connection is not None else 0,
        }
        figures |= {f"offset_{name.lower()}": offset for name, offset in zip(self._names, state.offsets, strict=True)}
        if state.refused:
            return Condition("corrections", Level.ERROR, f"refused: {state.refused}; the last one is held", figures)
        if state.trouble:
            return Condition("corrections", Level.WARN, state.trouble, figures)
        if state.limited:
            return Condition("corrections", Level.WARN, "soft limits of the controller clip the offsets", figures)
        return Condition("corrections", Level.OK, "applied", figures)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until a signal; the exit code is 0 then, 2 after wrong input."""
    return run(lambda: LinuxcncBridge(NAME), args)


if __name__ == "__main__":
    sys.exit(main())
