"""Estimator and compensation over a recorded bag: the numbers that were published live, bit for bit, without ROS."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.bags.contents import JointState, Temperature
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.wire import Wire, load_wire
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.compensation import Compensator, CompensatorSettings, InputsUsed
from rotary_error_monitor.pipeline.corrections import Compensation, Correction
from rotary_error_monitor.pipeline.estimation import (
    AUTOCOLLIMATOR,
    COMMAND,
    Estimator,
    EstimatorSettings,
    EstimatorStatus,
    error_motion_from_block,
)
from rotary_error_monitor.signals.blocks import SampleBlock

BATCH = 256
"""Messages that are reckoned with at once: the bits depend on stamps alone, and few calls are faster than many."""


@dataclass(frozen=True)
class Replay:
    """What estimator and compensation make of a recording, at n ticks.

    With a machine that has no monitored axis the ticks are those of the joint states, and no error motion is measured.

    Attributes:
        stamp_ns: (n,) timestamp (ns) of each estimate.
        theta: (n,) rotation, rad.
        error_motion: (n, 6) exc eyc ezc eac ebc ecc in m and rad, NaN where not observable.
        covariance: (n, 6, 6) of it, NaN in rows and columns that are not observable.
        streams: (n,) bit mask of the input streams that were used.
        tool_offset: (n, 6) x y z a b c in m and rad, NaN where the compensation held; None without a machine.
        corrections: at the correction period; empty without a machine.
        status: counts of the estimator.
        damage: what of the bag could not be read; None for a whole one.
        repeated: whether the bag holds the live run's own decisions, which were repeated.
    """

    stamp_ns: NDArray[np.int64]
    theta: NDArray[np.float64]
    error_motion: NDArray[np.float64]
    covariance: NDArray[np.float64]
    streams: NDArray[np.int64]
    tool_offset: NDArray[np.float64] | None
    corrections: tuple[Correction, ...]
    status: EstimatorStatus
    damage: str | None
    repeated: bool

    @property
    def motion(self) -> ErrorMotion:
        """The same as the core's dataclass, with zeros where not observable."""
        observable = np.isfinite(self.error_motion)
        return ErrorMotion(
            self.theta,
            np.where(observable, self.error_motion, 0.0),
            observable,
            np.where(np.isfinite(self.covariance), self.covariance, 0.0),
        )

    def save(self, path: Path | str) -> None:
        """Write the arrays to an .npz file; `tool_offset`, `correction_stamp_ns`, `corrections` only with a machine.

        Raises:
            InputError: the file cannot be written.
        """
        arrays = {
            "stamp_ns": self.stamp_ns,
            "theta": self.theta,
            "error_motion": self.error_motion,
            "covariance": self.covariance,
            "streams": self.streams,
        }
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


def replay_bag(
    bag: Path | str,
    stage: StageDescription,
    machine: MachineDescription | None = None,
    settings: EstimatorSettings | None = None,
    compensator_settings: CompensatorSettings | None = None,
) -> Replay:
    """Run estimator and, with a machine, compensation over a bag.

    Where the bag holds what was published live, the ticks and the choice of inputs are those of the live run; else they
    follow from `settings` and the stamps alone.

    Raises:
        InputError: there is no such bag, it lacks the topics of at least two heads (or joint states, with a machine;
            nothing but these, where it has no monitored axis), or one of its messages is broken.
    """
    reader = BagReader(bag)
    wire = load_wire(tuple(stage.encoder.azimuths))
    if machine is not None and machine.monitored is None:
        return _replay_described(reader, wire, machine, compensator_settings)
    inputs = _input_topics(reader, wire, stage)
    masks = dict(_published_masks(reader, wire))
    settings = settings or EstimatorSettings()
    if masks:
        settings = replace(settings, period_ns=_period(masks, settings.period_ns))
    estimator = Estimator(stage, settings, masks or None)
    compensator, of_machine = None, tuple[str, ...]()
    if machine is not None:
        of_machine = _machine_topics(reader, wire)
        compensator = Compensator(machine, compensator_settings, dict(_published_inputs(reader, wire)) or None)
    names = [name for name in (*inputs, *of_machine) if name in reader.topics]
    collected = _Collected()
    for count, (topic, content) in enumerate(reader.replay(names), start=1):
        if isinstance(content, SampleBlock):
            estimator.accept(inputs[topic], content)
        if count % BATCH == 0 or isinstance(content, Temperature):
            collected.add_motion(estimator.advance(), compensator)
        if compensator is not None and not isinstance(content, SampleBlock):
            collected.accept_machine(content, compensator)
    collected.add_motion(estimator.finish(), compensator)
    if compensator is not None:
        collected.offsets += compensator.finish().offsets
    return collected.result(estimator.status, reader.damage, bool(masks), compensator is not None)


def _replay_described(
    reader: BagReader, wire: Wire, machine: MachineDescription, settings: CompensatorSettings | None
) -> Replay:
    """Compensation of a machine without monitored axis: joint states alone."""
    names = [name for name in _machine_topics(reader, wire) if name in reader.topics]
    decisions = dict(_published_inputs(reader, wire))
    compensator = Compensator(machine, settings, decisions or None)
    collected = _Collected()
    stamps: list[int] = []
    for _, content in reader.replay(names):
        if isinstance(content, JointState):
            stamps.append(content.stamp_ns)
        collected.accept_machine(content, compensator)
        collected.add_compensation(compensator.advance())
    ticks = np.unique(np.array(stamps, np.int64))
    nothing = np.full((len(ticks), 6, 6), np.nan)
    return Replay(
        ticks,
        nothing[:, 0, 0],
        nothing[:, 0],
        nothing,
        np.zeros(len(ticks), np.int64),
        collected.offsets_at(ticks),
        tuple(collected.corrections),
        EstimatorStatus(),
        reader.damage,
        bool(decisions),
    )


class _Collected:
    """Blocks and corrections as they come."""

    def __init__(self) -> None:
        self.motion: list[SampleBlock] = []
        self.offsets: list[SampleBlock] = []
        self.corrections: list[Correction] = []

    def add_motion(self, blocks: list[SampleBlock], compensator: Compensator | None) -> None:
        for block in blocks:
            self.motion.append(block)
            if compensator is not None:
                compensator.accept_error_motion(block)
        if compensator is not None:
            self.add_compensation(compensator.advance())

    @staticmethod
    def accept_machine(content: object, compensator: Compensator) -> None:
        if isinstance(content, JointState):
            velocity = content.velocity if len(content.velocity) else np.zeros(len(content.names))
            compensator.accept_joint_state(
                content.stamp_ns,
                dict(zip(content.names, content.position.tolist(), strict=True)),
                dict(zip(content.names, velocity.tolist(), strict=True)),
            )
        elif isinstance(content, Temperature):
            compensator.push_temperature(content.temperature)

    def offsets_at(self, stamps: NDArray[np.int64]) -> NDArray[np.float64]:
        """(n, 6) offsets at all ticks, NaN where the compensation held."""
        offset = np.full((len(stamps), 6), np.nan)
        for block in self.offsets:
            offset[np.searchsorted(stamps, block.times_ns)] = block.rows[:, 1:7]
        return offset

    def add_compensation(self, found: Compensation) -> None:
        self.offsets += found.offsets
        self.corrections += found.corrections

    def result(self, status: EstimatorStatus, damage: str | None, repeated: bool, with_machine: bool) -> Replay:
        stamps = _joined([block.times_ns for block in self.motion], np.empty(0, np.int64))
        found = [error_motion_from_block(block) for block in self.motion]
        observable = _joined([each.observable for each in found], np.empty((0, 6), np.bool_))
        components = _joined([each.components for each in found], np.empty((0, 6)))
        covariance = _joined([each.covariance for each in found], np.empty((0, 6, 6)))
        both = observable[:, :, None] & observable[:, None, :]
        return Replay(
            stamps,
            _joined([each.theta for each in found], np.empty(0)),
            np.where(observable, components, np.nan),
            np.where(both, covariance, np.nan),
            _joined([block.column("streams").astype(np.int64) for block in self.motion], np.empty(0, np.int64)),
            self.offsets_at(stamps) if with_machine else None,
            tuple(self.corrections),
            status,
            damage,
            repeated,
        )


def _input_topics(reader: BagReader, wire: Wire, stage: StageDescription) -> dict[str, str]:
    """Stream of the estimator by topic, for the topics that the bag has."""
    heads = {wire.topic("head_samples", name).name: f"head_{name}" for name in stage.encoder.azimuths}
    present = [name for name in heads if name in reader.topics and reader.topics[name].count]
    if len(present) < 2:
        reader.check_topics([name for name in heads if name not in present])
    others = {
        wire.topic("autocollimator_samples").name: AUTOCOLLIMATOR,
        wire.topic("command_samples").name: COMMAND,
    }
    return {name: stream for name, stream in (heads | others).items() if name in reader.topics}


def _machine_topics(reader: BagReader, wire: Wire) -> tuple[str, str]:
    joints, temperature = wire.topic("machine_joint_states").name, wire.topic("machine_temperature").name
    reader.check_topics([joints])
    return joints, temperature


def _published_masks(reader: BagReader, wire: Wire) -> Iterator[tuple[int, int]]:
    for block in _blocks(reader, wire.topic("error_motion_samples").name):
        yield from zip(block.times_ns.tolist(), block.column("streams").astype(int).tolist(), strict=True)


def _published_inputs(reader: BagReader, wire: Wire) -> Iterator[tuple[int, InputsUsed]]:
    for block in _blocks(reader, wire.topic("tool_offset_samples").name):
        times = block.times_ns
        stamps = times - np.rint(block.column("joint_age") * 1e9).astype(np.int64)
        rows = zip(
            times.tolist(),
            stamps.tolist(),
            block.column("directions").tolist(),
            block.column("temperature").tolist(),
            strict=True,
        )
        for tick, stamp, directions, temperature in rows:
            yield tick, InputsUsed(stamp, directions, temperature)


def _blocks(reader: BagReader, topic: str) -> Iterator[SampleBlock]:
    if topic in reader.topics:
        for _, content in reader.replay([topic]):
            if isinstance(content, SampleBlock):
                yield content


def _period(masks: dict[int, int], default_ns: int) -> int:
    """Period of the grid on which the live run published."""
    ticks = np.sort(np.fromiter(masks, np.int64, len(masks)))
    return int(np.diff(ticks).min()) if len(ticks) > 1 else default_ns


def _joined(parts: list[NDArray[Any]], empty: NDArray[Any]) -> NDArray[Any]:
    return np.concatenate(parts) if parts else empty
