"""The compensation: error motion and the machine's axes in, tool-to-workpiece offset and axis corrections out.

ros2 run rotary_error_monitor compensation --ros-args -p machine:=xyzac_trt
ros2 run rotary_error_monitor compensation --ros-args -p machine:=grinder_zhou2023  # no monitored axis: joint states do
ros2 service call /compensation/reset std_srvs/srv/Trigger
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
from sensor_msgs.msg import JointState, Temperature
from std_srvs.srv import Trigger

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.limits import Level as Limit
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.diagnostics import Condition, Level, StreamWatch
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.parameters import Setting, cell_settings
from rotary_error_monitor.nodes.process import run
from rotary_error_monitor.pipeline.compensation import Compensator, CompensatorSettings
from rotary_error_monitor.pipeline.corrections import Correction
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock

NAME = "compensation"
_WATCH_PERIOD = 0.05
_DEFAULTS = CompensatorSettings()


def _limit_settings(kind: str, unit: str, defaults: tuple[float, float, float]) -> tuple[Setting, ...]:
    meanings = (
        ("warning", f"correction of a {kind} axis beyond which a warning is given, {unit}"),
        ("error", f"correction of a {kind} axis beyond which corrections are held until a reset, {unit}"),
        ("rate", f"how fast the correction of a {kind} axis may change, {unit}/s"),
    )
    return tuple(
        Setting(f"{kind}.{name}", value, meaning, (1e-9, 1.0))
        for (name, meaning), value in zip(meanings, defaults, strict=True)
    )


class Compensation(ManagedNode):
    """Passes error motion and joint states to the pipeline's compensator and publishes what may be applied.

    Where nothing may be applied it publishes no correction at all, so that whoever applies them holds the last one; the
    diagnostics and the log say why. That is so while inputs are missing, old or contradict one another, and from the
    moment that a correction passes its error limit until the service `~/reset` is called.
    """

    settings = (
        *cell_settings("machine"),
        Setting("age_limit", 0.2, "oldest offset and correction that are published, s", (0.001, 10.0)),
        Setting(
            "joint_age_limit",
            _DEFAULTS.age_limit_ns / NANOSECONDS,
            "oldest joint state that an offset is computed from, s",
            (0.01, 10.0),
        ),
        Setting(
            "joint_lag",
            _DEFAULTS.joint_lag_ns / NANOSECONDS,
            "age at which a joint state counts, s: longer than it takes to arrive",
            (0.0, 1.0),
        ),
        Setting(
            "correction_period",
            _DEFAULTS.correction_period_ns / NANOSECONDS,
            "distance of two corrections, s",
            (0.0005, 1.0),
        ),
        Setting(
            "position_tolerance",
            _DEFAULTS.position_tolerance,
            "largest difference of the monitored axis between its encoder and the joint states, rad",
            (1e-6, 3.15),
        ),
        Setting(
            "ring_height",
            _DEFAULTS.ring_height,
            "height of the monitored body's origin above the ring, m",
            (-10.0, 10.0),
        ),
        Setting(
            "ring_azimuth", _DEFAULTS.ring_azimuth, "angle from the machine's x to the stage's x, rad", (-6.3, 6.3)
        ),
        *_limit_settings("linear", "m", _DEFAULTS.linear_limits),
        *_limit_settings("rotary", "rad", _DEFAULTS.rotary_limits),
    )

    def open(self) -> None:
        """Build the compensator and listen to its inputs."""
        name = self.setting("machine")
        if not name:
            raise InputError(
                f"{self.get_fully_qualified_name()}: parameter 'machine' is empty; name a machine to correct"
            )
        self.hardware = name
        machine = load_machine(name)
        self._compensator = Compensator(machine, self._compensator_settings())
        self._has_rotary = any(axis.kind == "rotary" for axis in machine.axes)
        self._age_limit_ns = round(self.setting("age_limit") * NANOSECONDS)
        self._hold = ""
        self._latest: Correction | None = None
        self._stale, self._worst_age, self._reported_stale = 0, 0.0, 0
        self._open_outputs()
        now_ns = self.now_ns()
        self._watches: dict[str, StreamWatch] = {}
        if machine.monitored is not None:
            motion, limit = self.wire.topic("error_motion_samples"), self.setting("age_limit")
            self._watches["error motion"] = self._motion = StreamWatch(motion.name, limit, 2 * limit, now_ns)
            self.listen_to_blocks(motion, self._receive_motion)
        joints, limit = self.wire.topic("machine_joint_states"), self.setting("joint_age_limit")
        self._watches["joint states"] = self._joints = StreamWatch(joints.name, limit, limit, now_ns)
        self.listen_to(joints, self._receive_joints)
        self.listen_to(self.wire.topic("machine_temperature"), self._receive_temperature)
        self.after_messages(self._compensate)
        self.serve(Trigger, "~/reset", self._reset)
        self.every(_WATCH_PERIOD, self._watch)

    def conditions(self, now_ns: int) -> list[Condition]:
        """The streams that come in, and what becomes of the correction."""
        return [*(watch.report(now_ns) for watch in self._watches.values()), self._correction_condition(now_ns)]

    def _compensator_settings(self) -> CompensatorSettings:
        return CompensatorSettings(
            joint_lag_ns=round(self.setting("joint_lag") * NANOSECONDS),
            age_limit_ns=round(self.setting("joint_age_limit") * NANOSECONDS),
            correction_period_ns=round(self.setting("correction_period") * NANOSECONDS),
            position_tolerance=self.setting("position_tolerance"),
            ring_height=self.setting("ring_height"),
            ring_azimuth=self.setting("ring_azimuth"),
            linear_limits=self._limits("linear"),
            rotary_limits=self._limits("rotary"),
        )

    def _limits(self, kind: str) -> tuple[float, float, float]:
        return self.setting(f"{kind}.warning"), self.setting(f"{kind}.error"), self.setting(f"{kind}.rate")

    def _open_outputs(self) -> None:
        keys = ("tool_offset_samples", "tool_offset_pose", "corrected_offset_pose", "axis_corrections")
        self._topics = {key: self.wire.topic(key) for key in keys}
        self._outputs = {key: self.publish_on(topic) for key, topic in self._topics.items()}

    def _receive_motion(self, block: SampleBlock) -> None:
        now_ns = self.now_ns()
        self._motion.observe(block, now_ns)
        if now_ns - int(block.times_ns[-1]) > self._age_limit_ns:
            self._stale += len(block.rows)  # nothing of it could be published: no time is lost on it
            return
        self._compensator.accept_error_motion(block)

    def _receive_joints(self, message: JointState) -> None:
        stamp_ns = messages.measured_ns(message.header)
        positions, velocities = messages.joint_motion(message)
        self._joints.observe_stamp(stamp_ns, self.now_ns())
        self._compensator.accept_joint_state(stamp_ns, positions, velocities)

    def _receive_temperature(self, message: Temperature) -> None:
        self._compensator.push_temperature(message.temperature)

    def _compensate(self) -> None:
        """Send what is fresh of what came together; what waited too long for its other half is dropped."""
        computed = self._compensator.advance()
        oldest_ns = self.now_ns() - self._age_limit_ns
        for block in computed.offsets:
            self._publish_offsets(block, oldest_ns)
        for correction in computed.corrections:
            if correction.stamp_ns >= oldest_ns:
                self._publish_correction(correction)

    def _publish_offsets(self, block: SampleBlock, oldest_ns: int) -> None:
        stale = int(np.searchsorted(block.times_ns, oldest_ns))
        self._stale += stale
        if stale == len(block.rows):
            return
        fresh = SampleBlock(block.stamp_ns, block.names, block.rows[stale:])
        topic = self._topics["tool_offset_samples"]
        self._outputs["tool_offset_samples"].publish(messages.block_bytes(fresh, topic.frame))
        self._worst_age = max(self._worst_age, (self.now_ns() - int(fresh.times_ns[-1])) / NANOSECONDS)

    def _publish_correction(self, correction: Correction) -> None:
        self._latest = correction
        self._outputs["axis_corrections"].publish(
            messages.joint_state_message(
                correction.stamp_ns,
                self._topics["axis_corrections"].frame,
                correction.axes,
                correction.values,
                correction.rates,
            )
        )
        report = correction.report
        if report is None:
            return
        observable = np.isfinite(np.diag(report.covariance))
        for key, offset in (("tool_offset_pose", report.offset), ("corrected_offset_pose", report.remaining)):
            self._outputs[key].publish(
                messages.pose_message(
                    correction.stamp_ns, self._topics[key].frame, offset, report.covariance, observable
                )
            )

    def _reason_to_hold(self, now_ns: int) -> str:
        """Why no correction is published now; empty while they flow."""
        state = self._compensator.state
        if state.latched:
            return f"error limit latched until ~/reset is called: {state.reason}"
        for what, watch in self._watches.items():
            if watch.last_ns is None:
                return f"no {what} yet"
            if watch.is_stale(now_ns):
                return f"no {what} for {(now_ns - watch.last_ns) / NANOSECONDS:.1f} s"
        if self._compensator.hold:
            return self._compensator.hold
        if self._latest is None or now_ns - self._latest.stamp_ns > 2 * self._age_limit_ns:
            return f"offsets come later than the age limit of {self._age_limit_ns / NANOSECONDS} s"
        return ""

    def _watch(self) -> None:
        """Say at once when corrections begin or end to be held."""
        with self.busy:
            if not self.active:
                return
            hold = self._reason_to_hold(self.now_ns())
            if bool(hold) != bool(self._hold):
                if hold:
                    self.get_logger().warning(f"corrections are held: {hold}")
                else:
                    self.get_logger().info("corrections flow")
            self._hold = hold

    def _correction_condition(self, now_ns: int) -> Condition:
        compensator, latest = self._compensator, self._latest
        stale, self._reported_stale = self._stale - self._reported_stale, self._stale
        figures = {
            "worst_age_ms": self._worst_age * 1e3,
            "held_offsets": compensator.held,
            "stale_offsets": self._stale,
            "latched": compensator.state.latched,
        }
        self._worst_age = 0.0
        hold = self._reason_to_hold(now_ns)
        if hold or latest is None:
            return Condition("correction", Level.ERROR, f"held: {hold}", figures)
        reasons = []
        if latest.level is Limit.WARNING:
            reasons.append("beyond the warning limit")
        if latest.level is Limit.RATE_LIMITED:
            reasons.append("slowed by the rate limit")
        if self._has_rotary and not latest.direction_spanned:
            reasons.append("the axes cannot correct the tool's direction here")
        if stale:
            reasons.append(f"{stale} offsets dropped: older than the age limit")
        return Condition("correction", Level.WARN if reasons else Level.OK, "; ".join(reasons) or "correcting", figures)

    def _reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        state = self._compensator.state
        self._compensator.reset()
        response.success = True
        response.message = f"released: {state.reason}" if state.latched else "nothing was latched"
        self.get_logger().info(f"reset: {response.message}")
        return response


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until a signal; the exit code is 0 then, 2 after wrong input."""
    return run(lambda: Compensation(NAME), args)


if __name__ == "__main__":
    sys.exit(main())
