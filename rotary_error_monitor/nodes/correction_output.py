"""What the compensation publishes, and who else speaks of corrections: the controller, and a second compensation."""

from __future__ import annotations

from collections import deque

import numpy as np
from sensor_msgs.msg import JointState

from rotary_error_monitor.codec.messages import stamp_of
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.pace import Pace
from rotary_error_monitor.nodes.publishers import name_of
from rotary_error_monitor.pipeline.compensation import Compensator
from rotary_error_monitor.pipeline.corrections import OFFSET, CompensationOutput, Correction
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock

_FOREIGN_FOR_NS = 2 * NANOSECONDS
"""How long a second compensation must have been silent before this one goes on, ns."""

_SILENT_FOR_NS = NANOSECONDS
"""How long after its last correction this compensation goes on from what the controller then says is in effect, ns."""

_FIGURES_PERIOD = 20_000_000  # ns, between two messages for plotting

_LATE_FOR_NS = NANOSECONDS
"""How long after an offset that was too old lateness counts as the reason for the lack of corrections, ns."""


class CorrectionOutput:
    """Publishes offsets and corrections, which go on from those that the controller has in effect.

    Attributes:
        latest: last correction that was published.
        stale: offsets that were too old to be published.
    """

    def __init__(self, node: ManagedNode, compensator: Compensator, age_limit_ns: int) -> None:
        """Publish for `node`; nothing that is older than `age_limit_ns`."""
        self._node, self._compensator, self._age_limit_ns = node, compensator, age_limit_ns
        offsets = ("tool_offset_samples", "tool_offset_figures", "tool_offset_pose", "corrected_offset_pose")
        self._topics = {key: node.wire.topic(key) for key in (*offsets, "axis_corrections")}
        self._outputs = {key: node.publish_on(topic) for key, topic in self._topics.items()}
        self._figures_pace = Pace(_FIGURES_PERIOD)
        self._own: deque[int] = deque(maxlen=1024)
        self._foreign_ns: int | None = None
        self._feedback = node.wire.topic("applied_corrections")
        self._began_ns: int | None = None
        self._started = False
        self._unfed = self._doubt = ""
        self._accepts_any = False
        self._worst_age, self._told_stale = 0.0, 0
        self.latest: Correction | None = None
        self.stale = 0
        self._late_ns: int | None = None
        node.listen_to(self._feedback, self._receive_feedback)
        node.listen_to_bytes(self._topics["axis_corrections"], self._receive_correction)

    def send(self, computed: CompensationOutput) -> None:
        """Publish what is fresh; where a correction came too late, the next ones go on from the last published."""
        oldest_ns = self._node.now_ns() - self._age_limit_ns
        for block in computed.offsets:
            self._publish_offsets(block, oldest_ns)
        for correction in computed.corrections:
            if correction.stamp_ns >= oldest_ns:
                self._publish_correction(correction)
        if self.latest is not None and computed.corrections and computed.corrections[-1] is not self.latest:
            self._compensator.start_from(dict(zip(self.latest.axes, self.latest.values.tolist(), strict=True)))

    def forbidden(self, now_ns: int) -> str:
        """Why no correction may go out; empty where they may."""
        if reason := self._second_compensation(now_ns):
            return reason
        if self._started:
            return ""
        self._began_ns = now_ns if self._began_ns is None else self._began_ns
        topic = self._feedback.name
        if self._doubt:
            return f"{self._doubt}; ~/reset accepts it, and it goes back at the rate limit"
        waited = (now_ns - self._began_ns) / NANOSECONDS
        if self._node.count_publishers(topic) == 0 and waited >= self._node.setting("feedback_patience"):
            self._started = True
            self._unfed = f"nobody says on {topic} which corrections are in effect: none were assumed"
            return ""
        return f"waiting for the controller to say on {topic} which corrections it has in effect"

    def remarks(self, now_ns: int) -> list[str]:
        """What is not as it should be with the controller's side, and beside this node."""
        return [remark for remark in (self._unfed, self._doubt, self._silent_publisher()) if remark]

    def reset(self) -> None:
        """Believe what the controller says next of the corrections in effect."""
        self._accepts_any = True

    def take_worst_age(self) -> float:
        """Largest age of an offset at its publication since the last call, s."""
        worst, self._worst_age = self._worst_age, 0.0
        return worst

    def drop(self, offsets: int, now_ns: int) -> None:
        """Take note of offsets that are too old to be published at `now_ns`."""
        if offsets:
            self.stale += offsets
            self._late_ns = now_ns

    def is_late(self, now_ns: int) -> bool:
        """Whether offsets were too old of late."""
        return self._late_ns is not None and 0 <= now_ns - self._late_ns <= _LATE_FOR_NS

    def take_stale(self) -> int:
        """Offsets that were too old since the last call."""
        new, self._told_stale = self.stale - self._told_stale, self.stale
        return new

    def _second_compensation(self, now_ns: int) -> str:
        if self._foreign_ns is None:
            return ""
        topic = self._topics["axis_corrections"].name
        if now_ns - self._foreign_ns > _FOREIGN_FOR_NS and self._node.count_publishers(topic) < 2:
            self._foreign_ns = None
            return ""
        return self._node.listening.publishers_of(topic)

    def _silent_publisher(self) -> str:
        """That another compensation is there, which holds since it has heard this one; empty where there is none.

        The list keeps one that was killed for some 20 s, so it is no reason to hold: one that is started again bears
        the same name.
        """
        topic = self._topics["axis_corrections"].name
        listed = {name_of(publisher) for publisher in self._node.get_publishers_info_by_topic(topic)}
        others = sorted(listed - {self._node.get_fully_qualified_name()})
        return f"{', '.join(others)} may publish {topic} too; only one of both may speak" if others else ""

    def _receive_correction(self, data: bytes, received_ns: int) -> None:
        """Somebody else's correction: two compensations would both move the axes.

        Each of one's own is heard once. Of the same inputs another compensation makes corrections of the same stamps:
        then one of a stamp comes twice.
        """
        stamp_ns = stamp_of(data)
        if stamp_ns in self._own:
            self._own.remove(stamp_ns)
        else:
            self._foreign_ns = received_ns

    def _receive_feedback(self, message: JointState) -> None:
        positions, _ = messages.joint_motion(message)
        found = "" if self._accepts_any else self._compensator.implausible(positions)
        self._doubt = f"the controller says on {self._feedback.name} what cannot be in effect: {found}" if found else ""
        if found:
            return
        self._accepts_any = False
        # While corrections go out, what is in effect is on its way to them; while none do, it may go elsewhere.
        if self.latest is None or self._node.now_ns() - self.latest.stamp_ns > _SILENT_FOR_NS:
            self._compensator.start_from(positions)
        self._started = True
        self._unfed = ""

    def _publish_offsets(self, block: SampleBlock, oldest_ns: int) -> None:
        stale = 0 if block.times_ns[0] >= oldest_ns else int(np.searchsorted(block.times_ns, oldest_ns))
        self.drop(stale, self._node.now_ns())
        if stale == len(block.rows):
            return
        fresh = block if stale == 0 else SampleBlock(block.stamp_ns, block.names, block.rows[stale:])
        topic = self._topics["tool_offset_samples"]
        self._outputs["tool_offset_samples"].publish(messages.block_bytes(fresh, topic.frame))
        newest_ns = int(fresh.times_ns[-1])
        if self._figures_pace.is_due(newest_ns):
            frame = self._topics["tool_offset_figures"].frame
            offset = fresh.columns(OFFSET)[-1]
            self._outputs["tool_offset_figures"].publish(messages.figures_message(newest_ns, frame, offset))
        self._worst_age = max(self._worst_age, (self._node.now_ns() - newest_ns) / NANOSECONDS)

    def _publish_correction(self, correction: Correction) -> None:
        self.latest = correction
        self._own.append(correction.stamp_ns)
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
        covariance = report.covariance
        if not np.isfinite(covariance).all():
            covariance = messages.UNOBSERVABLE_VARIANCE * np.eye(6)
        for key, offset in (("tool_offset_pose", report.offset), ("corrected_offset_pose", report.remaining)):
            self._outputs[key].publish(
                messages.pose_message(correction.stamp_ns, self._topics[key].frame, offset, covariance)
            )
