"""LinuxCNC as the machine's controller: joint states and the stage's command out, corrections in as external offsets.

ros2 run rotary_error_monitor linuxcnc_bridge --ros-args -p machine:=xyzac_trt
ros2 run rotary_error_monitor linuxcnc_bridge --ros-args -p machine:=xyzac_trt \
    -p enter:="nsenter --target 4711 --ipc --pid"
"""

from __future__ import annotations

import math
import os
import shlex
import time
from collections.abc import Hashable, Iterator

from std_srvs.srv import Trigger

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.errors import InputError, without_numbers
from rotary_error_monitor.linuxcnc_controller.clock import NANOSECONDS
from rotary_error_monitor.linuxcnc_controller.connection import Connection
from rotary_error_monitor.linuxcnc_controller.gate import GateLimits
from rotary_error_monitor.linuxcnc_controller.intake import PRESENT
from rotary_error_monitor.linuxcnc_controller.kinematics import ROTARY
from rotary_error_monitor.linuxcnc_controller.modules import SYSTEM_PYTHON
from rotary_error_monitor.linuxcnc_controller.protocol import (
    LINK_SILENCE,
    Absent,
    ClearRequest,
    CorrectionRequest,
    End,
    HaltRequest,
    Hello,
    LinkSettings,
    Record,
    State,
)
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.applied_corrections import AppliedCorrections
from rotary_error_monitor.nodes.controller_command import ControllerCommand
from rotary_error_monitor.nodes.correction_listener import ControllerReport, CorrectionListener
from rotary_error_monitor.nodes.diagnostics import Condition, Level, RateMeter
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.parameters import cell_settings
from rotary_error_monitor.nodes.process import program

_RETRY_PERIOD = 0.5
"""Time after which a link that has ended is started again, s: a start takes a tenth of a second of a core."""

_LAG = 1e-6
"""An offset is behind from here on, m or rad: far above its counts of 1e-10, and a tenth of usual corrections."""

_LONGEST_LAG = 1.0
"""One that is behind for so long, s, does not come: the controller's own limits bring one about within hundredths."""

CONTROLLER_AWAY = "the controller is out of reach"
LINK_SILENT = "the link to the controller is silent"
_DEFAULTS = LinkSettings()


class LinuxcncBridge(ManagedNode):
    """Publishes where the program has the machine's joints, and moves them by the corrections that come back.

    The positions leave the corrections out: they say where the machine should be, and what has to be corrected there.
    The command of the stage that is the machine's monitored axis is what its drive is told, stamped with the servo
    period that told it.
    Corrections are believed as whole messages of one publisher or not at all, and followed within limits of the
    bridge's own. While none comes that is believed, the last one is held. Nothing is published while the machine is
    off, not homed, or out of reach.
    """

    settings = (
        *cell_settings("machine", "block_period"),
        Setting(
            "stage_command",
            True,
            "publish the command of the machine's monitored axis as that of the stage; false where another node does",
        ),
        Setting("rate", 250.0, "joint states, commands and offset updates per second, 1/s", (100.0, 1000.0)),
        Setting("count", _DEFAULTS.count, "size of one external offset count, m and rad", (1e-11, 1e-9)),
        Setting("max_age", GateLimits.max_age, "oldest correction that is believed, s", (0.01, 10.0)),
        Setting(
            "clock_tolerance",
            GateLimits.clock_tolerance,
            "how far a correction's stamp may lie in the future, s",
            (0.0, 1.0),
        ),
        Setting("corrected", "", "letters of the axes that each correction names; empty for all of the controller's"),
        Setting("largest_linear", _DEFAULTS.largest_linear, "largest correction of a linear axis, m", (0.0, 5e-3)),
        Setting("largest_rotary", _DEFAULTS.largest_rotary, "largest correction of a rotary axis, rad", (0.0, 0.05)),
        Setting(
            "speed_linear",
            _DEFAULTS.speed_linear,
            "how fast the correction of a linear axis may change, m/s",
            (1e-6, 0.1),
        ),
        Setting(
            "speed_rotary",
            _DEFAULTS.speed_rotary,
            "how fast the correction of a rotary axis may change, rad/s",
            (1e-5, 1.0),
        ),
        Setting(
            "acceleration_linear",
            _DEFAULTS.acceleration_linear,
            "acceleration of the correction of a linear axis, m/s^2",
            (1e-4, 10.0),
        ),
        Setting(
            "acceleration_rotary",
            _DEFAULTS.acceleration_rotary,
            "acceleration of the correction of a rotary axis, rad/s^2",
            (1e-3, 100.0),
        ),
        Setting(
            "enter",
            "",
            "command that runs what follows it where LinuxCNC runs; empty where that is here",
            at_start=True,
        ),
        Setting("home", "", "home folder of the user that runs LinuxCNC; empty for the same user", at_start=True),
        Setting("python", SYSTEM_PYTHON, "interpreter for which LinuxCNC's modules are installed", at_start=True),
    )
    hardware = "linuxcnc"

    def open(self) -> None:
        """Begin to look for LinuxCNC.

        Raises:
            InputError: simulated time is asked for.
        """
        if self._simulated:
            raise InputError(
                f"{self.get_fully_qualified_name()}: parameter 'use_sim_time' is true; expected false, for a real "
                "controller keeps the system's time"
            )
        self._topic = self.wire.topic("machine_joint_states")
        self._joint_states = self.publish_on(self._topic)
        self._applied = AppliedCorrections(self)
        self._command = self._open_command()
        self._listener = CorrectionListener(
            self,
            controller=self._controller,
            follow=lambda correction: self._send(CorrectionRequest(correction.positions)),
            halt=lambda: self._send(HaltRequest()),
        )
        self.serve(Trigger, "~/clear_offsets", self._clear)
        self._link = LinkSettings(
            period=1.0 / self.setting("rate"),
            **{
                name: self.setting(name)
                for name in (
                    "count", "largest_linear", "largest_rotary", "speed_linear", "speed_rotary", "acceleration_linear",
                    "acceleration_rotary",
                )
            },
        )  # fmt: skip
        try:
            self._enter = shlex.split(self.setting("enter"))
        except ValueError as error:
            raise InputError(
                f"{self.get_fully_qualified_name()}: parameter 'enter' is {self.setting('enter')!r} ({error}); "
                "expected a command as a shell reads it"
            ) from error
        self._connection: Connection | None = None
        self._names: tuple[str, ...] = ()
        self._state: State | None = None
        self._loss, self._absence = "", "not reached yet"
        self._published = RateMeter(time.monotonic_ns())
        self._lost = False
        self._misfit = ""
        self._heard = self._caught_up = time.monotonic()
        self._slowed = self._taken_over = -math.inf
        self._connect()
        self.every(_RETRY_PERIOD, self._retry)

    def release(self) -> None:
        """Let go of LinuxCNC; the external offsets stay as they are."""
        connection = getattr(self, "_connection", None)
        if connection is not None:
            self._closing = True
            connection.close()
            self._connection = None

    def conditions(self, now_ns: int) -> list[Condition]:
        """The controller, the machine, and what becomes of the corrections."""
        rate = self._published.rate(time.monotonic_ns())
        figures = {"rate_hz": rate, "age_ms": "none" if self._state is None else self._silence() * 1e3}
        if self._state is not None:
            figures["axes"] = " ".join(self._names)
        absence = self._away()
        if self._state is None or absence:
            controller = Condition("controller", Level.ERROR, absence, figures)
            machine = Condition("machine", Level.STALE, "not known: the controller is out of reach")
        else:
            controller = Condition("controller", Level.OK, "connected", figures)
            machine = self._machine(self._state)
        return [controller, machine, self._listener.condition(), *self._conditions_of_command(now_ns, absence)]

    def news(self, now_ns: int) -> Hashable:
        """Whether the controller is within reach, its machine on and homed; of corrections their listener says so."""
        return without_numbers(self._away()), None if self._state is None else without_numbers(self._state.trouble)

    def _open_command(self) -> ControllerCommand | None:
        """The command of the stage, where it is one of the machine's axes and nobody else publishes that."""
        if not (self.setting("stage_command") and self.setting("machine")):
            return None
        monitored = load_machine(self.setting("machine")).monitored
        return None if monitored is None else ControllerCommand(self, monitored, self.setting("block_period"))

    def _conditions_of_command(self, now_ns: int, absence: str) -> Iterator[Condition]:
        if self._command is not None:
            state = self._state
            trouble = absence or ("" if state is None or state.valid else state.trouble or "the machine is not homed")
            yield self._command.condition(now_ns, self._names, trouble)
        elif self.setting("stage_command") and not self.setting("machine"):
            text = (
                "not published: parameter 'machine' is empty; name the machine whose monitored axis the stage is, or "
                "set 'stage_command' to false"
            )
            yield Condition(self.wire.topic("command_samples").name, Level.WARN, text)

    def _connect(self) -> None:
        self._closing = False
        environment = {**os.environ, "HOME": self.setting("home")} if self.setting("home") else None
        self._connection = Connection(
            self._link,
            self._receive,
            enter=self._enter,
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
            self._heard = time.monotonic()
            if isinstance(record, State):
                self._take(record)
            elif isinstance(record, Hello):
                self._greet(record)
            elif isinstance(record, Absent):
                self._miss(record.reason)
            elif isinstance(record, End):
                self._miss(record.reason or "the link has ended")
                self._lost = True

    def _greet(self, hello: Hello) -> None:
        self._names = hello.names
        self._loss, self._absence = "", "the link has told of no machine yet"
        corrected = tuple("".join(self.setting("corrected").split())) or hello.names
        course = self._link.course_limits(name in ROTARY for name in hello.names)
        age, tolerance = self.setting("max_age"), self.setting("clock_tolerance")
        try:
            self._listener.believe(
                GateLimits(hello.names, course.largest, corrected, age, tolerance, speed=course.speed)
            )
        except InputError as error:
            self._listener.believe(None)
            self._misfit = f"parameter 'corrected': {error}"
            self.get_logger().error(self._misfit)
        else:
            self._misfit = ""
        self.get_logger().info(f"connected to LinuxCNC with the axes {' '.join(hello.names)}")

    def _take(self, state: State) -> None:
        before, self._state = self._state, state
        if state.lag <= _LAG or before is None:
            self._caught_up = self._heard
        if state.slowed:
            self._slowed = self._heard
        if before is not None and state.takeovers > before.takeovers:
            self._taken_over = self._heard
        if not (state.valid and self.active):
            return
        self._joint_states.publish(
            messages.joint_state_message(
                state.stamp_ns, self._topic.frame, self._names, state.positions, state.velocities
            )
        )
        self._published.add()
        if self.now_ns() - state.stamp_ns < LINK_SILENCE * NANOSECONDS:  # not one that waited while the node stood
            self._listener.note_axes(state.positions)
        self._applied.publish(state.stamp_ns, self._names, state.effect)
        if self._command is not None and state.is_exact:
            self._command.note(state.stamp_ns, self._names, state.commands, state.speeds)

    def _miss(self, reason: str) -> None:
        if reason != self._absence and not self._closing:
            self.get_logger().error(f"{reason}; no joint states until LinuxCNC is back")
        if self._state is not None:
            self._loss = reason  # what is met in looking for it anew says less
        self._absence, self._state = reason, None

    def _silence(self) -> float:
        """Time since the link said something, s."""
        return time.monotonic() - self._heard

    def _away(self) -> str:
        """Why the controller is out of reach; empty where it is not."""
        if self._state is None:
            return self._absence if self._loss in ("", self._absence) else f"{self._loss}; now: {self._absence}"
        return f"the link has been silent for {self._silence():.2g} s" if self._silence() > LINK_SILENCE else ""

    def _send(self, record: Record) -> None:
        if self._connection is not None:
            self._connection.send(record)

    def _clear(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        away = self._away()  # what waits for a link that is silent would be done whenever that goes on
        response.success = self._connection is not None and not away
        response.message = "the external offsets go back to zero" if response.success else away
        if response.success:
            self._send(ClearRequest())
        self.get_logger().info(f"clear_offsets: {response.message}")
        return response

    def _machine(self, state: State) -> Condition:
        if not state.valid:
            return Condition("machine", Level.WARN, f"{state.trouble}; no joint states are published")
        return Condition("machine", Level.OK, "on and homed")

    def _controller(self) -> ControllerReport:
        """How LinuxCNC fares, for whoever says what becomes of the corrections."""
        state, away = self._state, self._away()
        if state is None or away:
            return ControllerReport(CONTROLLER_AWAY if state is None else LINK_SILENT)
        figures: dict[str, object] = {
            "lag_nm": state.lag * 1e9,
            "changed_by_others": state.takeovers,
            "dropped": self._connection.dropped if self._connection is not None else 0,
        }
        figures |= {f"offset_{name.lower()}": offset for name, offset in zip(self._names, state.offsets, strict=True)}
        for what, values in (("effect", state.effect), ("to_go", state.to_go)):
            figures |= {f"{what}_{name.lower()}": value for name, value in zip(self._names, values, strict=False)}
        return ControllerReport(self._misfit or state.trouble, tuple(self._remarks(state)), figures)

    def _remarks(self, state: State) -> Iterator[str]:
        now = time.monotonic()
        if state.limited:
            yield "soft limits of the controller clip the offsets"
        elif now - self._caught_up > _LONGEST_LAG:
            yield (
                f"an offset has been {state.lag * 1e6:.3g} um (or urad) behind for {now - self._caught_up:.1f} s: "
                "the controller does not follow (OFFSET_AV_RATIO of its axes?)"
            )
        if now - self._slowed <= PRESENT:
            yield "slowed by the bridge's limits"
        if now - self._taken_over <= PRESENT:
            yield "another hand has changed the offsets"


main = program(LinuxcncBridge, "linuxcnc_bridge")

if __name__ == "__main__":
    raise SystemExit(main())
