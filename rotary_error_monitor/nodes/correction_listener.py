"""The way of corrections into a controller's node: believed or refused, from one publisher, each hold said at once."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from rclpy.serialization import deserialize_message
from rclpy.topic_endpoint_info import TopicEndpointInfo
from sensor_msgs.msg import JointState

from rotary_error_monitor.linuxcnc_controller.gate import (
    AcceptedCorrection,
    CorrectionMessage,
    GateLimits,
    RefusalError,
    RefusalReason,
)
from rotary_error_monitor.linuxcnc_controller.intake import CorrectionIntake, Hold
from rotary_error_monitor.linuxcnc_controller.offsets import WAITING
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.diagnostics import Condition, Level
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.publishers import Names, deafness
from rotary_error_monitor.nodes.qos import profile
from rotary_error_monitor.signals.blocks import NANOSECONDS

APPLIED = "applied"
_WATCH_PERIOD = 0.05
"""Time between two looks whether corrections are held, s: a twentieth of the time within which it is to be said."""

_ROLL_CALL = 5
"""Every so many watches the publishers are listed, in 0.2 ms; also when a message does not continue the last one."""

_LOG_PERIOD_NS = NANOSECONDS
_SAY_PERIOD_NS = NANOSECONDS // 5
"""The same is logged again after the first, and a change told by the second at the earliest: what comes and goes many
times a second shall not fill logs."""

AXES_UNKNOWN = "the controller's axes are not known"


@dataclass(frozen=True)
class ControllerReport:
    """What the listener is told of the controller behind it.

    Attributes:
        trouble: why it follows no corrections; empty while it does. The same trouble is said in the same words.
        remarks: what else is worth a warning.
        figures: for the diagnostics.
    """

    trouble: str
    remarks: tuple[str, ...] = ()
    figures: Mapping[str, object] | None = None


class CorrectionListener:
    """Listens to the contract's corrections for a node, hands on what is believed, and says what becomes of them."""

    def __init__(
        self,
        node: ManagedNode,
        *,
        controller: Callable[[], ControllerReport],
        follow: Callable[[AcceptedCorrection], None],
        halt: Callable[[], None],
    ) -> None:
        """Listen while the node is configured.

        Args:
            node: that opens.
            controller: how the controller fares.
            follow: takes a correction that is believed.
            halt: brings corrections to rest, since it is not known any more whose the last one was.
        """
        self._node = node
        self._controller = controller
        self._follow = follow
        self._halt = halt
        self._is_halted = False
        self._topic = node.wire.topic("axis_corrections")
        self._limits: GateLimits | None = None
        self._intake: CorrectionIntake | None = None
        self._publishers: tuple[str, ...] = ()
        self._names = Names()
        self._watches = 0
        self._said: tuple[object, ...] = ()
        self._said_ns = 0
        self._logged: tuple[object, ...] = ()
        self._logged_ns: dict[object, int] = {}
        diagnostics = node.wire.topic("diagnostics")
        self._diagnostics = node.publish_on(diagnostics)
        node.listen_to_numbered(self._topic, self._receive)
        node.every(_WATCH_PERIOD, self._watch)

    def believe(self, limits: GateLimits | None) -> None:
        """Believe what keeps within `limits` from now on, or nothing; the same limits change nothing."""
        limits = None if limits is None else replace(limits, frame=self._topic.frame)
        if limits != self._limits:
            self._limits, self._intake = limits, None if limits is None else CorrectionIntake(limits)

    def note_axes(self, positions: Sequence[float]) -> None:
        """Take note of where the program has the controller's axes, in their order, m or rad."""
        if self._intake is not None:
            self._intake.note_axes(positions, time.monotonic_ns())

    def condition(self) -> Condition:
        """What becomes of the corrections."""
        steady_ns, controller, intake = time.monotonic_ns(), self._controller(), self._intake
        hold = None if intake is None else intake.hold(steady_ns)
        trouble = controller.trouble or ("" if intake is not None else AXES_UNKNOWN)
        remarks = [*controller.remarks]
        figures: dict[str, object] = {
            "topic": self._topic.name,
            "publishers": ", ".join(self._publishers) or "none",
            "held_s": "none" if hold is None or hold.duration is None else hold.duration,
        }
        figures |= {f"refused_{doubt.value}": 0 if intake is None else intake.refused[doubt] for doubt in RefusalReason}
        figures |= controller.figures or {}
        if intake is not None and intake.remark(steady_ns) and (hold is None or hold.doubt is None):
            remarks.append(intake.remark(steady_ns))
        if hold is None and not trouble:
            level = Level.WARN if remarks else Level.OK
            return Condition("corrections", level, "; ".join([APPLIED, *remarks]), figures)
        level = Level.ERROR if intake is None or (hold is not None and hold.doubt) else Level.WARN
        return Condition("corrections", level, "; ".join([self._held(trouble, hold), *remarks]), figures)

    def _held(self, trouble: str, hold: Hold | None) -> str:
        reason = "" if hold is None else str(hold)
        if hold is not None and hold.doubt is None:
            reason += f" on {self._topic.name}"
        if not trouble or (trouble == WAITING and hold is not None):
            return reason
        # What comes is nothing while the controller takes nothing: only what is wrong with it is worth a word.
        return f"held: {trouble}" + (f"; {hold.reason}" if hold is not None and hold.doubt else "")

    def _receive(self, data: bytes, _: int, number: int | None) -> None:
        intake, steady_ns = self._intake, time.monotonic_ns()
        if intake is None:
            return
        message = deserialize_message(data, JointState)
        if number is not None and not intake.sources.continues(number):
            self._enlist(intake, steady_ns)
        stamp_ns = messages.ns_from_stamp(message.header.stamp)
        names, frame = list(message.name), message.header.frame_id
        what = CorrectionMessage(stamp_ns, names, message.position, message.velocity, frame)
        try:
            correction = intake.take(what, number, self._node.now_ns(), steady_ns)
        except RefusalError as error:
            self._note(error, steady_ns)
            self._halt_if_several(error.doubt)
            return
        self._is_halted = False
        self._follow(correction)

    def _halt_if_several(self, doubt: RefusalReason | None) -> None:
        """Where another may have had a word, its correction shall not be what is held."""
        if doubt is RefusalReason.PUBLISHERS and not self._is_halted:
            self._is_halted = True
            self._halt()

    def _note(self, error: RefusalError, steady_ns: int) -> None:
        """Log a refusal, at most once a second for each doubt."""
        if self._is_log_due(error.doubt, steady_ns):
            self._node.get_logger().error(f"{self._topic.name}: refused: {error}")

    def _is_log_due(self, what: object, steady_ns: int) -> bool:
        last_ns = self._logged_ns.get(what)
        is_due = last_ns is None or steady_ns - last_ns >= _LOG_PERIOD_NS
        if is_due:
            self._logged_ns[what] = steady_ns
        return is_due

    def _enlist(self, intake: CorrectionIntake, steady_ns: int) -> None:
        there = self._node.get_publishers_info_by_topic(self._topic.name)
        self._publishers = tuple(map(self._describe, there, self._names.of(there)))
        intake.sources.enlist(self._publishers, steady_ns)

    def _describe(self, publisher: TopicEndpointInfo, name: str) -> str:
        reason = deafness(publisher, self._topic.type, profile(self._topic))
        return f"{name} ({reason})" if reason else name

    def _watch(self) -> None:
        """Say at once when corrections begin or end to be held, or are held for another reason."""
        node, intake, steady_ns = self._node, self._intake, time.monotonic_ns()
        if not node.active:
            return
        self._watches += 1
        if intake is not None and self._watches % _ROLL_CALL == 0:
            self._enlist(intake, steady_ns)
        hold = None if intake is None else intake.hold(steady_ns)
        if hold is not None:
            self._halt_if_several(hold.doubt)
        trouble = self._controller().trouble
        now = (hold is not None, None if hold is None else hold.doubt, trouble)
        if now != self._said and steady_ns - self._said_ns >= _SAY_PERIOD_NS:
            self._said, self._said_ns = now, steady_ns
            self._diagnostics.publish(node.report(node.now_ns(), [self.condition()]))
        # What came too soon after the same to be logged is logged later, if it is still so: a log ends with what is.
        if self._said != self._logged and self._said == now and self._is_log_due(now, steady_ns):
            self._logged, said = now, f"corrections: {self.condition().message}"
            if hold is None and not trouble:
                node.get_logger().info(said)
            else:
                node.get_logger().warning(said)
