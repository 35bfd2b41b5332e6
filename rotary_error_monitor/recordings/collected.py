"""Collecting what a replay gives, and what is to be said of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.bags.window import Window
from rotary_error_monitor.codec.contents import Content, JointState, Temperature
from rotary_error_monitor.errors import InputError, without_numbers
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.compensation import Compensator
from rotary_error_monitor.pipeline.corrections import Correction
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.pipeline.estimator_settings import EstimatorStatus
from rotary_error_monitor.pipeline.joint_motion import joint_motion_of
from rotary_error_monitor.pipeline.publication import Decision
from rotary_error_monitor.recordings.motion_rows import BlockRows, ByTick, CorrectionRows, MotionRows
from rotary_error_monitor.recordings.replayed import (
    LongReplay,
    damage_of,
    lost_remarks,
    lost_ticks,
    remarks_of,
    unrepeated_remarks,
)
from rotary_error_monitor.signals.arrival import ArrivalCheck
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.signals.coverage import MessageSpans, coverage_remarks
from rotary_error_monitor.signals.rows import Keep


class Collected:
    """Error motion and corrections as they come."""

    def __init__(self, keep: Keep, columns: Sequence[str], corrections: list[Correction] | None = None) -> None:
        """Nothing yet.

        Args:
            keep: where ticks are kept.
            columns: of error motion, as the wire contract names them.
            corrections: takes the corrections as they are, beside their arrays.
        """
        self.motion = MotionRows(keep, columns)
        self.offsets = BlockRows(keep)
        self.corrections = CorrectionRows(keep)
        self._whole_corrections = corrections
        self.spans: dict[str, MessageSpans] = {}
        self.refused: dict[tuple[str, str], tuple[int, str]] = {}
        self.samples_refused: dict[str, dict[str, int]] = {}
        self.saturated: dict[str, int] = {}
        self.doubted: dict[str, str] = {}
        self.holds: dict[str, str] = {}
        self.motion_refused: dict[str, int] = {}
        self.unwarmed = 0
        self._hold = ""
        self._joints_arrival = ArrivalCheck()

    def note(self, topic: str, content: Content) -> None:
        """Take note of when there are samples."""
        spans = self.spans.setdefault(topic, MessageSpans())
        if isinstance(content, SampleBlock):
            spans.add_block(content)
        else:
            spans.add_stamp(content.stamp_ns)

    def coverage_remarks(self) -> tuple[str, ...]:
        """What the streams lack."""
        found = {topic: spans.coverage() for topic, spans in self.spans.items()}
        return coverage_remarks({topic: each for topic, each in found.items() if each is not None})

    def add_motion(self, parts: list[ErrorMotion], compensator: Compensator | None) -> None:
        """Take error motion, and with a compensator what it makes of it."""
        for part in parts:
            self.motion.append(part)
            if compensator is not None:
                compensator.accept_error_motion(part)
        if compensator is not None:
            self.add_compensation(compensator)

    def refuse(self, topic: str, error: InputError) -> None:
        """Take note of a message that cannot be used, as a node does: counted by topic, with the first reason."""
        self._count(topic, "refused", str(error))

    def _count(self, topic: str, what: str, why: str) -> None:
        count, first = self.refused.get((topic, what), (0, why))
        self.refused[topic, what] = count + 1, first

    def accept_machine(self, topic: str, content: object, compensator: Compensator, arrival_ns: int) -> None:
        """Hand a joint state or a temperature on that was recorded at `arrival_ns`, timestamp (ns)."""
        try:
            if isinstance(content, JointState):
                if refusal := self._joints_arrival.judge_ahead(content.stamp_ns, arrival_ns):
                    raise InputError(refusal)
                positions, velocities = joint_motion_of(
                    content.names, content.position.tolist(), content.velocity.tolist()
                )
                compensator.accept_joint_state(content.stamp_ns, positions, velocities)
                if doubt := compensator.joints.doubt:
                    self._count(topic, "not believed", doubt)
            elif isinstance(content, Temperature):
                stamp_ns = min(content.stamp_ns or arrival_ns, arrival_ns)
                if not compensator.push_temperature(content.temperature, stamp_ns):
                    self._count(topic, "not believed", compensator.thermometer.doubt)
        except InputError as error:
            self.refuse(topic, error)

    def accept_samples(
        self, topic: str, block: SampleBlock, stream: str, estimator: Estimator, arrival_ns: int
    ) -> None:
        """Hand samples on that were recorded at `arrival_ns`, timestamp (ns)."""
        try:
            estimator.accept(stream, block, arrival_ns, recorded=True)
        except InputError as error:
            self.refuse(topic, error)

    def note_doubts(self, estimator: Estimator) -> None:
        """Take note of what the estimator does not believe, with the first reason for each, and of samples refused."""
        for what, why in estimator.reasons:
            self.doubted.setdefault(what, why)
        self.saturated = dict(estimator.status.saturated)
        for name, stream in estimator.status.streams.items():
            if stream.admission.refused:
                self.samples_refused[name] = dict(stream.admission.refused)

    def belief_remarks(self) -> Iterator[str]:
        """What was not used, and why."""
        for (topic, what), (count, first) in self.refused.items():
            yield f"{topic}: {count} messages {what}, the first: {first}"
        for name, reasons in self.samples_refused.items():
            yield f"{name}: samples refused: " + ", ".join(f"{count} {why}" for why, count in reasons.items() if count)
        for name, count in self.saturated.items():
            yield f"{name}: {count} samples at or beyond the end of its range were not used; is its unit right?"
        for what, why in self.doubted.items():
            yield f"{what}: not believed at some time: {why}"
        for why, count in self.motion_refused.items():
            yield f"error motion: {count} ticks without a tool offset: {why}"
        if self.unwarmed:
            yield f"{self.unwarmed} tool offsets without a temperature that is believed: that of reference stands in"
        for why in self.holds.values():
            yield f"tool offsets were held at some time: {why}"
        if self._hold and not len(self.offsets):
            yield f"no tool offset: {self._hold}"

    def add_compensation(self, compensator: Compensator, *, last: bool = False) -> None:
        """Take offsets and corrections of what was accepted, and why they are held once they have begun."""
        found = compensator.finish() if last else compensator.advance()
        for block in found.offsets:
            self.offsets.append(block)
            self.unwarmed += len(block.rows) if compensator.lacks_temperature else 0
        self._hold = compensator.joints.doubt or compensator.hold or self._hold  # as a node has it, which says the last
        self.corrections.extend(found.corrections)
        if self._whole_corrections is not None:
            self._whole_corrections += found.corrections
        if compensator.hold and len(self.offsets):
            self.holds.setdefault(without_numbers(compensator.hold), compensator.hold)
        self.motion_refused = dict(compensator.refused_motion)

    def result(
        self,
        status: EstimatorStatus,
        reader: BagReader,
        window: Window | None,
        with_machine: bool,
        live: ByTick[Decision],
        lacking: Mapping[str, NDArray[np.int64]],
        absent: tuple[str, ...],
    ) -> LongReplay:
        """All of it; `live` is what was published live, `lacking` the ticks (ns) that lack something, by what."""
        times = self.motion.times
        first_ns = int(times.read(0, 1)[0]) if len(times) else None
        lost = lost_ticks(live.sorted_parts(), times)
        return LongReplay(
            self.motion,
            self.offsets if with_machine else None,
            self.corrections,
            status,
            damage_of(reader, window),
            len(live) > 0,
            np.unique(np.concatenate([*lacking.values(), np.empty(0, np.int64)])),
            lost,
            (
                *remarks_of(reader, window),
                *absent,
                *self.belief_remarks(),
                *self.coverage_remarks(),
                *unrepeated_remarks(lacking, first_ns),
                *lost_remarks(lost, first_ns),
            ),
        )
