"""What a replay gives, and how it is collected."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.analysis.signals import radial_at
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.bags.window import Window
from rotary_error_monitor.codec.contents import Content, JointState, Temperature
from rotary_error_monitor.errors import InputError, without_numbers
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.compensation import Compensator
from rotary_error_monitor.pipeline.corrections import Correction
from rotary_error_monitor.pipeline.estimation import Estimator, EstimatorStatus
from rotary_error_monitor.pipeline.joints import joint_motion_of
from rotary_error_monitor.signals.admission import ArrivalCheck
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.signals.coverage import MessageSpans, coverage_remarks

BEFORE_NS = 500_000_000
"""How long before the first estimates of a replay those published live may rest on samples of before it, ns."""

AFTER_NS = 50_000_000
"""How long after the last estimates before a pause others may rest on samples that came in it, ns."""


@dataclass(frozen=True)
class Replay:
    """What estimator and compensation make of a recording, at n ticks.

    With a machine that has no monitored axis the ticks are those of the joint states, and no error motion is measured.

    Attributes:
        motion: as the estimator gave it.
        tool_offset: (n, 6) x y z a b c in m and rad, NaN where the compensation held; None without a machine.
        corrections: at the correction period; empty without a machine.
        status: counts of the estimator.
        damage: what of the bag could not be read, or lies outside of its recording; None for a whole one.
        repeated: whether the bag holds the live run's own decisions, which were repeated.
        unrepeated: (n,) where they could not be: the bag lacks samples that the live run used, and what is given
            follows from those that it has.
        lost_ns: timestamps (ns) of estimates that were published live and are not given at all.
        remarks: what a reader should know: what of the bag could not be read, what its streams lack, what could not be
            repeated.
    """

    motion: ErrorMotion
    tool_offset: NDArray[np.float64] | None
    corrections: tuple[Correction, ...]
    status: EstimatorStatus
    damage: str | None
    repeated: bool
    unrepeated: NDArray[np.bool_]
    lost_ns: NDArray[np.int64]
    remarks: tuple[str, ...]

    @property
    def stamp_ns(self) -> NDArray[np.int64]:
        """(n,) timestamp (ns) of each estimate."""
        return self.motion.times_ns

    @property
    def theta(self) -> NDArray[np.float64]:
        """(n,) rotation, rad."""
        return self.motion.theta

    @cached_property
    def error_motion(self) -> NDArray[np.float64]:
        """(n, 6) exc eyc ezc eac ebc ecc in m and rad, NaN where not observable."""
        return np.where(self.motion.observable, self.motion.components, np.nan)

    @cached_property
    def covariance(self) -> NDArray[np.float64]:
        """(n, 6, 6) of it, NaN in rows and columns that are not observable."""
        observable = self.motion.observable
        return np.where(observable[:, :, None] & observable[:, None, :], self.motion.covariance, np.nan)

    def save(self, path: Path | str, heights: Sequence[float] = ()) -> None:
        """Write the arrays to an .npz file; `tool_offset`, `correction_stamp_ns`, `corrections` only with a machine.

        Args:
            path: of the file.
            heights: above the ring, m, at which radial error motion is given as well: `heights` (h,), `radial`
                (n, h, 2) and `radial_covariance` (n, h, 2, 2), NaN where not observable.

        Raises:
            InputError: the file cannot be written.
        """
        arrays = {
            "stamp_ns": self.stamp_ns,
            "theta": self.theta,
            "error_motion": self.error_motion,
            "covariance": self.covariance,
            "streams": self.motion.streams,
            "doubts": self.motion.doubts,
            "unrepeated": self.unrepeated,
            "lost_stamp_ns": self.lost_ns,
        }
        if heights:
            at = [radial_at(self.error_motion, self.covariance, height) for height in heights]
            told = [np.asarray(np.isfinite(radial).all(axis=1))[:, None, None] for radial, _ in at]
            arrays["heights"] = np.array(heights)
            arrays["radial"] = np.stack([radial for radial, _ in at], axis=1)
            spreads = (np.where(seen, spread, np.nan) for seen, (_, spread) in zip(told, at, strict=True))
            arrays["radial_covariance"] = np.stack(list(spreads), axis=1)
        if self.tool_offset is not None:
            arrays["tool_offset"] = self.tool_offset
            arrays["correction_stamp_ns"] = np.array([each.stamp_ns for each in self.corrections], np.int64)
            arrays["corrections"] = np.array([each.values for each in self.corrections])
            reports = [(each.stamp_ns, each.report.remaining) for each in self.corrections if each.report is not None]
            arrays["remaining_stamp_ns"] = np.array([stamp for stamp, _ in reports], np.int64)
            arrays["remaining_offset"] = np.array([remaining for _, remaining in reports])
        try:
            with Path(path).open("wb") as file:
                np.savez(file, **arrays)  # type: ignore[arg-type]  # numpy's stub takes **kwds for allow_pickle
        except OSError as error:
            raise InputError(
                f"{path}: cannot be written ({error.strerror}); give a file in a folder that exists"
            ) from error


class Collected:
    """Error motion and corrections as they come."""

    def __init__(self) -> None:
        self.motion: list[ErrorMotion] = []
        self.offsets: list[SampleBlock] = []
        self.corrections: list[Correction] = []
        self.spans: dict[str, MessageSpans] = {}
        self.refused: dict[tuple[str, str], tuple[int, str]] = {}
        self.samples_refused: dict[str, dict[str, int]] = {}
        self.doubted: dict[str, str] = {}
        self.holds: dict[str, str] = {}
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
        self.motion += parts
        if compensator is not None:
            for part in parts:
                compensator.accept_error_motion(part)
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
        for name, stream in estimator.status.streams.items():
            if stream.admission.refused:
                self.samples_refused[name] = dict(stream.admission.refused)

    def belief_remarks(self) -> Iterator[str]:
        """What was not used, and why."""
        for (topic, what), (count, first) in self.refused.items():
            yield f"{topic}: {count} messages {what}, the first: {first}"
        for name, reasons in self.samples_refused.items():
            yield f"{name}: samples refused: " + ", ".join(f"{count} {why}" for why, count in reasons.items() if count)
        for what, why in self.doubted.items():
            yield f"{what}: not believed at some time: {why}"
        for why in self.holds.values():
            yield f"tool offsets were held at some time: {why}"

    def offsets_at(self, stamps: NDArray[np.int64]) -> NDArray[np.float64]:
        """(n, 6) offsets at all ticks, NaN where the compensation held."""
        offset = np.full((len(stamps), 6), np.nan)
        for block in self.offsets:
            offset[np.searchsorted(stamps, block.times_ns)] = block.rows[:, 1:7]
        return offset

    def add_compensation(self, compensator: Compensator, *, last: bool = False) -> None:
        """Take offsets and corrections of what was accepted, and why they are held once they have begun."""
        found = compensator.finish() if last else compensator.advance()
        self.offsets += found.offsets
        self.corrections += found.corrections
        if compensator.hold and self.offsets:
            self.holds.setdefault(without_numbers(compensator.hold), compensator.hold)

    def result(
        self,
        status: EstimatorStatus,
        reader: BagReader,
        window: Window | None,
        with_machine: bool,
        live_ns: NDArray[np.int64],
        lacking: Mapping[str, NDArray[np.int64]],
        absent: tuple[str, ...],
    ) -> Replay:
        """All of it; `live_ns` are the ticks (ns) published live, `lacking` those that lack something, by what."""
        motion = ErrorMotion.joined([ErrorMotion.unknown(0), *self.motion])
        stamps = motion.times_ns
        unrepeated = np.unique(np.concatenate([*lacking.values(), np.empty(0, np.int64)]))
        lost = lost_ticks(live_ns, stamps)
        return Replay(
            motion,
            self.offsets_at(stamps) if with_machine else None,
            tuple(self.corrections),
            status,
            damage_of(reader, window),
            len(live_ns) > 0,
            np.isin(stamps, unrepeated),
            lost,
            (
                *remarks_of(reader, window),
                *absent,
                *self.belief_remarks(),
                *self.coverage_remarks(),
                *_unrepeated_remarks(lacking, stamps),
                *_lost_remarks(lost, stamps),
            ),
        )


def _unrepeated_remarks(lacking: Mapping[str, NDArray[np.int64]], stamps: NDArray[np.int64]) -> Iterator[str]:
    """Which ticks are not those of the live run, and why."""
    for what, ticks in lacking.items():
        begin = int(min(ticks.min(), stamps[0])) if len(stamps) else int(ticks.min())
        since, until = (int(ticks.min()) - begin) * 1e-9, (int(ticks.max()) - begin) * 1e-9
        yield (
            f"{len(ticks)} ticks from {since:.3f} to {until:.3f} s cannot be repeated: the live run used {what}; "
            "they follow from what it has"
        )


def lost_ticks(live_ns: NDArray[np.int64], given_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Ticks (ns, sorted) that were published live and are not given again, but for those close to others that are.

    The first ticks of a recording, or after a pause in it, rest on samples from before it; the last ones before a pause
    on samples after their own time.
    """
    lost = np.setdiff1d(live_ns, given_ns)
    place = np.searchsorted(given_ns, lost)
    before = np.append(np.int64(-1 << 62), given_ns)[place]
    after = np.append(given_ns, np.int64(1 << 62))[place]
    return lost[(after - lost > BEFORE_NS) & (lost - before > AFTER_NS)]


def _lost_remarks(lost: NDArray[np.int64], stamps: NDArray[np.int64]) -> Iterator[str]:
    """Which ticks of the live run are not given."""
    if len(lost):
        begin = int(min(lost[0], stamps[0])) if len(stamps) else int(lost[0])
        yield (
            f"{len(lost)} estimates that were published live, from {(int(lost[0]) - begin) * 1e-9:.3f} to "
            f"{(int(lost[-1]) - begin) * 1e-9:.3f} s, are not given: the bag lacks the samples that they rest on"
        )


def damage_of(reader: BagReader, window: Window | None) -> str | None:
    """What of the bag could not be read, or lies outside of its recording; None for a whole one."""
    remarks = (reader.damage, window.remark if window is not None else None)
    return "; ".join(remark for remark in remarks if remark) or None


def remarks_of(reader: BagReader, window: Window | None) -> tuple[str, ...]:
    """What a reader of the bag should know."""
    outside = window.remark if window is not None else None
    return (*reader.remarks, outside) if outside else reader.remarks
