"""The compensation: error motion and the machine's axes in, tool-to-workpiece offset and axis corrections out.

ros2 run rotary_error_monitor compensation --ros-args -p machine:=xyzac_trt
ros2 run rotary_error_monitor compensation --ros-args -p machine:=grinder_zhou2023  # no monitored axis: joint states do
ros2 service call /compensation/reset std_srvs/srv/Trigger
"""

from __future__ import annotations

import math
from collections.abc import Hashable

import numpy as np
from sensor_msgs.msg import JointState, Temperature
from std_srvs.srv import Trigger

from rotary_error_monitor.codec.error_motion_blocks import error_motion_from_block
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.streams import TEMPERATURE
from rotary_error_monitor.errors import InputError, without_numbers
from rotary_error_monitor.machine.kernel import describe_kernel
from rotary_error_monitor.machine.limits import CorrectionOutcome
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.compensation_settings import SETTINGS, compensation_settings, limit_figures
from rotary_error_monitor.nodes.correction_output import CorrectionOutput
from rotary_error_monitor.nodes.diagnostics import Condition, Level, StreamWatch
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.process import program
from rotary_error_monitor.pipeline.compensation import Compensator
from rotary_error_monitor.signals.arrival import ArrivalCheck
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock

NAME = "compensation"


class Compensation(ManagedNode):
    """Passes error motion and joint states to the pipeline's compensator and publishes what may be applied.

    Where nothing may be applied it publishes no correction at all, so that whoever applies them holds the last one; the
    diagnostics and the log say why. That is so until all inputs are there and the controller has said what it has in
    effect, while inputs are missing, old, doubted or contradict one another, and from the moment that a correction
    passes its error limit until the service `~/reset` is called. A hold that lasts longer than `hold_limit` while the
    joint states are sound goes on, at the rate limit, to what the machine's description says alone.
    """

    settings = SETTINGS
    look_period = 0.05

    def open(self) -> None:
        """Build the compensator and listen to its inputs."""
        name = self.setting("machine")
        if not name:
            raise InputError(
                f"{self.get_fully_qualified_name()}: parameter 'machine' is empty; name a machine to correct"
            )
        self.hardware = name
        machine = load_machine(name)
        if slower := describe_kernel():
            self.get_logger().info(slower)
        self._compensator = Compensator(machine, compensation_settings(self), limits=self.stage.limits)
        self._has_rotary = any(axis.kind == "rotary" for axis in machine.axes)
        self._has_three = sum(axis.kind == "linear" for axis in machine.axes) >= 3
        self._age_limit_ns = round(self.setting("age_limit") * NANOSECONDS)
        self._hold: str | None = ""
        self._released_ns: int | None = None
        self._output = CorrectionOutput(self, self._compensator, self._age_limit_ns)
        now_ns = self.now_ns()
        self._watches: dict[str, StreamWatch] = {}
        limit = self.setting("age_limit")
        if machine.monitored is not None:
            motion = self.wire.topic("error_motion_samples")
            self._watches["error motion"] = self._motion = StreamWatch(motion.name, limit, 2 * limit, now_ns)
            self.listen_to_blocks(motion, self._receive_motion)
        joints, limit = self.wire.topic("machine_joint_states"), self.setting("joint_age_limit")
        self._watches["joint states"] = self._joints = StreamWatch(joints.name, limit, limit, now_ns)
        streams = [TEMPERATURE, *(watch.what for watch in self._watches.values())]
        self._arrivals = {what: ArrivalCheck(round(60 * NANOSECONDS)) for what in streams}
        self.listen_to(joints, self._receive_joints)
        temperature = self.wire.topic("machine_temperature")
        self._temperature = temperature.name
        self.listen_to(temperature, self._receive_temperature)
        self.after_messages(self._compensate)
        self.serve(Trigger, "~/reset", self._reset)

    def conditions(self, now_ns: int) -> list[Condition]:
        """The streams that come in, and what becomes of the correction."""
        return [*(watch.report(now_ns) for watch in self._watches.values()), self._correction_condition(now_ns)]

    def _receive_motion(self, block: SampleBlock) -> None:
        now_ns = self.now_ns()
        self._check_arrival(self._motion, block.newest_ns, now_ns)  # one sample ahead, and all that follow were late
        self._motion.observe(block, now_ns)
        if now_ns - block.newest_ns > self._age_limit_ns:
            self._output.drop(len(block.rows), now_ns)  # nothing of it could be published: no time is lost on it
            return
        self._compensator.accept_error_motion(error_motion_from_block(block))

    def _receive_joints(self, message: JointState) -> None:
        stamp_ns = messages.measured_ns(message.header)
        positions, velocities = messages.joint_motion(message)
        now_ns = self.now_ns()
        self._check_arrival(self._joints, stamp_ns, now_ns)
        self._joints.observe_stamp(stamp_ns, now_ns)
        if why := self._compensator.accept_joint_state(stamp_ns, positions, velocities):
            self._joints.refuse(why)

    def _receive_temperature(self, message: Temperature) -> None:
        if self.listening.is_shared(self._temperature):
            self._compensator.thermometer.reset()  # nothing tells whose was the last one that was believed
            raise InputError(self.listening.publishers_of(self._temperature))
        stamp_ns, now_ns = messages.ns_from_stamp(message.header.stamp), self.now_ns()
        if self._arrivals[TEMPERATURE].was_set_back(self._compensator.thermometer.last_ns, now_ns):
            self._begin_anew()
        self._compensator.push_temperature(message.temperature, min(stamp_ns or now_ns, now_ns))

    def _check_arrival(self, watch: StreamWatch, stamp_ns: int, now_ns: int) -> None:
        """Refuse what is stamped in the future; where the clock was set back, begin anew.

        Raises:
            InputError: the message is refused.
        """
        check = self._arrivals[watch.what]
        if refusal := check.judge(stamp_ns, now_ns):
            watch.refuse(refusal)
            raise InputError(refusal)
        if check.was_set_back(watch.last_ns, now_ns):
            self._begin_anew()

    def _begin_anew(self) -> None:
        self.get_logger().warning("the clock was set back: all that was stamped later is forgotten")
        self._compensator.forget_time()
        self._released_ns = None
        for each in self._watches.values():
            each.last_ns = None

    def _compensate(self) -> None:
        """Send what is fresh of what came together; what waited too long for its other half is dropped."""
        compensator = self._compensator
        latched = compensator.state.latched
        compensator.forbidden = self._forbidden()
        self._output.send(compensator.advance())
        if compensator.state.latched and not latched:  # it may be reset and latch again between two looks
            self._say_hold()

    def _forbidden(self) -> str:
        """Why no correction may go out, whatever the inputs say."""
        heard = [watch.what for watch in self._watches.values()]
        if self._compensator.thermometer.needed:
            heard.append(self._temperature)
        for topic in heard:
            if self.listening.is_shared(topic):
                return self.listening.publishers_of(topic)
        return self._output.forbidden(self.now_ns())

    def _reason_to_hold(self, now_ns: int) -> str:
        """Why no correction is published now; empty while they flow."""
        compensator, latest = self._compensator, self._output.latest
        if compensator.state.latched:
            return f"error limit latched until ~/reset is called: {compensator.state.reason}"
        for what, watch in self._watches.items():
            if watch.last_ns is None:
                return f"no {what} yet on {watch.what}"
            if watch.is_stale(now_ns):
                return f"no {what} for {(now_ns - watch.last_ns) / NANOSECONDS:.1f} s on {watch.what}"
        if compensator.forbidden:
            return compensator.forbidden
        if compensator.joints.doubt:
            return f"joint states are not believed: {compensator.joints.doubt}"
        if compensator.hold:
            return compensator.hold
        if latest is None or now_ns - latest.stamp_ns > 2 * self._age_limit_ns:
            return self._why_nothing_came(now_ns)
        return ""

    def _why_nothing_came(self, now_ns: int) -> str:
        """Why inputs that are there and believed gave no correction of late."""
        latest, released_ns = self._output.latest, self._released_ns
        if self._output.is_late(now_ns):
            return f"offsets come later than the age limit of {self._age_limit_ns / NANOSECONDS} s"
        if released_ns is not None and (latest is None or latest.stamp_ns <= released_ns):
            return "no correction has come of the inputs since the reset"
        if latest is None:
            return "no correction has come of the inputs yet"
        return f"no correction has come of the inputs for {(now_ns - latest.stamp_ns) / NANOSECONDS:.1f} s"

    def news(self, now_ns: int) -> Hashable:
        """Why corrections are held, which is logged as well, and what is not as it should be while they flow."""
        return self._say_hold(), tuple(without_numbers(remark) for remark in self._compensator.remarks)

    def _say_hold(self) -> str:
        """Log why corrections are held, or that they flow, where it is not what was said last; give it in short."""
        hold = self._reason_to_hold(self.now_ns())
        short = without_numbers(hold)
        if short != self._hold:
            if hold:
                self.get_logger().warning(f"corrections are held: {hold}")
            else:
                self.get_logger().info("corrections flow")
        self._hold = short
        return short

    def _correction_condition(self, now_ns: int) -> Condition:
        latest, stale = self._output.latest, self._output.take_stale()
        figures = self._figures(now_ns)
        hold = self._reason_to_hold(now_ns)
        fresh = latest is not None and now_ns - latest.stamp_ns <= 2 * self._age_limit_ns
        if latest is not None and hold and latest.described and fresh and not self._compensator.state.latched:
            message = f"from the description alone, for the live correction is held: {hold}"
            return Condition("correction", Level.ERROR, message, figures)
        if hold or latest is None:
            return Condition("correction", Level.ERROR, f"held: {hold}{self._how_far()}", figures)
        reasons = [*self._compensator.remarks, *self._output.remarks(now_ns)]
        if latest.outcome is CorrectionOutcome.WARNING:
            reasons.append("beyond the warning limit")
        if latest.outcome is CorrectionOutcome.RATE_LIMITED:
            reasons.append("slowed by the rate limit")
        if self._has_three and not latest.position_spanned:
            reasons.append("the axes cannot correct the tool's position here")
        if self._has_rotary and not latest.direction_spanned:
            reasons.append("the axes cannot correct the tool's direction here")
        if stale:
            reasons.append(f"{stale} offsets dropped: older than the age limit")
        message = "; ".join(reasons) or "correcting"
        if math.isnan(self._compensator.deviation):
            message += "; how uncertain the machine's description is, its file does not state"
        return Condition("correction", Level.WARN if reasons else Level.OK, message, figures)

    def _figures(self, now_ns: int) -> dict[str, object]:
        compensator = self._compensator
        since = compensator.holding.since_ns
        return {
            "worst_age_ms": self._output.take_worst_age() * 1e3,
            "held_offsets": compensator.held,
            "held_for_s": 0.0 if since is None else max(0.0, (now_ns - since) / NANOSECONDS),
            "stale_offsets": self._output.stale,
            "latched": compensator.state.latched,
            "standard_uncertainty_um": "none" if math.isnan(compensator.deviation) else compensator.deviation * 1e6,
            "refused_error_motion": compensator.refused_motion.total(),
            "refused_joint_states": compensator.joints.checks.refused.total(),
            "refused_temperatures": compensator.thermometer.refused.total(),
            **limit_figures(self),
        }

    def _how_far(self) -> str:
        """How far off the held correction may be by now, in words."""
        away = self._compensator.distance() if np.any(self._compensator.state.applied) else math.nan
        return f"; the description would move the tool by {away * 1e6:.3g} µm" if math.isfinite(away) else ""

    def _reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        state = self._compensator.state
        self._compensator.reset()
        self._output.reset()
        response.success = True
        response.message = f"released: {state.reason}" if state.latched else "nothing was latched"
        self.get_logger().info(f"reset: {response.message}")
        self._released_ns = self.now_ns()
        if state.latched:
            self._hold = None  # what latches again is said again
        return response


main = program(Compensation, NAME)

if __name__ == "__main__":
    raise SystemExit(main())
