"""Estimator and compensation over a recorded bag: the numbers that were published live, bit for bit, without ROS."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import astuple, replace
from pathlib import Path

import numpy as np

from rotary_error_monitor.bags.naming import THE_ONLY_CELL, Naming
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.bags.window import Window
from rotary_error_monitor.codec.contents import JointState, Temperature
from rotary_error_monitor.codec.error_motion_blocks import error_motion_from_block, tells_doubts
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import AUTOCOLLIMATOR, COMMAND
from rotary_error_monitor.description.wire import Wire, wire_of
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.compensation import Compensator, InputsUsed
from rotary_error_monitor.pipeline.corrections import OFFSET, Correction
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.pipeline.estimator_settings import EstimatorSettings, EstimatorStatus
from rotary_error_monitor.pipeline.observability import rotation_is_lacking
from rotary_error_monitor.pipeline.publication import Decision, decision_rows
from rotary_error_monitor.recordings.collected import Collected
from rotary_error_monitor.recordings.motion_rows import ByTick
from rotary_error_monitor.recordings.progress import Passed, Progress, silent
from rotary_error_monitor.recordings.replayed import LongReplay, Replay, damage_of, offsets_at, remarks_of
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.signals.coverage import absence_remarks
from rotary_error_monitor.signals.rows import Keep, RowsInMemory

SHORTEST_PERIOD_NS, LONGEST_PERIOD_NS = 10_000, 1_000_000_000
"""Distances of two estimates, ns, as the node `error_estimator` allows them."""

_MOTION = "error_motion_samples"
"""Key of the estimates in the wire contract."""

BATCH = 256
"""Messages that are reckoned with at once: the bits depend on stamps alone, and few calls are faster than many."""


def period_of(period: float, nanoseconds: int, told: str) -> int:
    """Distance of two estimates, ns, of one in a unit of so many nanoseconds; `told` as in `--period-ms is 0`.

    Raises:
        InputError: an estimator has none so short or so long.
    """
    shortest, longest = SHORTEST_PERIOD_NS / nanoseconds, LONGEST_PERIOD_NS / nanoseconds
    if not shortest <= period <= longest:
        raise InputError(f"{told}; it must be from {shortest:g} to {longest:g}")
    return round(period * nanoseconds)


def check_estimated(replay: Replay | LongReplay, bag: Path | str, stage: StageDescription, least: int = 1) -> None:
    """Refuse a replay that gives hardly anything.

    Raises:
        InputError: it has fewer estimates; the message names what the bag lacks.
    """
    if len(replay) < least:
        raise InputError(f"{bag}: no estimate: {rotation_is_lacking(stage)}")


def replay_bag(
    bag: Path | str,
    stage: StageDescription,
    machine: MachineDescription | None = None,
    settings: EstimatorSettings | None = None,
    naming: Naming = THE_ONLY_CELL,
    repeat: bool = True,
) -> Replay:
    """Run estimator and, with a machine, compensation over a bag.

    Where the bag holds what was published live, the ticks and the choice of inputs are those of the live run; else, or
    if they are not to be repeated, they follow from `settings` and the stamps alone.

    Raises:
        InputError: there is no such bag, it lacks what `input_topics` needs (or joint states, with a machine;
            nothing but these, where it has no monitored axis). Messages that are broken are left out, and said.
    """
    if machine is not None and machine.monitored is None:
        return replay_described(bag, stage, machine, naming)
    corrections: list[Correction] = []
    run = _Run(BagReader(bag, naming), stage, machine, RowsInMemory, corrections)
    found = run.through(settings, repeat)
    return found.part(0, len(found), tuple(corrections))


def replay_long(
    bag: Path | str,
    stage: StageDescription,
    machine: MachineDescription | None = None,
    settings: EstimatorSettings | None = None,
    naming: Naming = THE_ONLY_CELL,
    keep: Keep = RowsInMemory,
    progress: Progress = silent,
) -> LongReplay:
    """The same numbers of a recording of any length: they are kept where `keep` says, and read part by part.

    Args:
        bag: that is read.
        stage: as described.
        machine: one with a monitored axis, or none.
        settings: as of `replay_bag`.
        naming: which cell of the bag it is, and how the bag calls its topics.
        keep: where what is larger than memory is kept.
        progress: is told how far it is.

    Raises:
        InputError: as `replay_bag`.
    """
    return _Run(BagReader(bag, naming), stage, machine, keep, None, progress).through(settings, repeat=True)


class _Run:
    """One bag on its way through estimator and compensation."""

    def __init__(
        self,
        reader: BagReader,
        stage: StageDescription,
        machine: MachineDescription | None,
        keep: Keep,
        corrections: list[Correction] | None,
        progress: Progress = silent,
    ) -> None:
        self._reader, self._stage, self._machine = reader, stage, machine
        self._keep, self._progress = keep, progress
        self._wire = wire_of(stage)
        self._inputs = input_topics(reader, self._wire, stage)
        self._collected = Collected(keep, _columns(self._wire), corrections)
        self._of_machine: tuple[str, ...] = ()

    def through(self, settings: EstimatorSettings | None, repeat: bool) -> LongReplay:
        """Replay it, with the decisions that the bag holds, if they are to be repeated."""
        reader, stage, collected = self._reader, self._stage, self._collected
        decisions = _published_decisions(reader, self._wire, self._keep, repeat)
        settings = settings or EstimatorSettings()
        if decisions:
            settings = replace(settings, period_ns=_period(decisions, settings.period_ns, reader.path))
        estimator = Estimator(stage, settings, decisions or None)
        compensator = None
        if self._machine is not None:
            self._of_machine = _machine_topics(reader, self._wire)
            published = _published_inputs(reader, self._wire, self._keep) or None
            compensator = Compensator(self._machine, None, published, stage.limits)
        names = [name for name in (*self._inputs, *self._of_machine) if name in reader.topics]
        window = reader.window(names)
        self._feed(names, window, estimator, compensator)
        lacking = {}
        for name, ticks in estimator.unrepeated.items():
            why = "that the bag lacks" if name in estimator.inputs else "which this stage's description does not have"
            lacking[f"samples of {name} {why}"] = np.concatenate(ticks)
        if compensator is not None and compensator.unrepeated:
            lacking["joint states that the bag lacks"] = np.concatenate(compensator.unrepeated)
        absent = absence_remarks([*self._inputs, *self._of_machine[:1]], collected.spans)
        absent += gap_remarks(estimator.status, settings)
        return collected.result(estimator.status, reader, window, compensator is not None, decisions, lacking, absent)

    def _feed(
        self, names: list[str], window: Window | None, estimator: Estimator, compensator: Compensator | None
    ) -> None:
        """Hand all messages on, one after another by their stamps."""
        collected = self._collected
        recorded = self._reader.replay_arrivals(names, window, collected.refuse)
        with self._progress("estimates") as step:
            passed = Passed(window, step)
            for count, (topic, content, arrival_ns) in enumerate(recorded, start=1):
                collected.note(topic, content)
                passed.note(content)
                if isinstance(content, SampleBlock):
                    collected.accept_samples(topic, content, self._inputs[topic], estimator, arrival_ns)
                if count % BATCH == 0 or isinstance(content, Temperature):
                    collected.add_motion(estimator.advance(), compensator)
                    collected.note_doubts(estimator)
                if compensator is not None and not isinstance(content, SampleBlock):
                    collected.accept_machine(topic, content, compensator, arrival_ns)
        collected.add_motion(estimator.finish(), compensator)
        collected.note_doubts(estimator)
        if compensator is not None:
            collected.add_compensation(compensator, last=True)


def replay_described(
    bag: Path | str,
    stage: StageDescription,
    machine: MachineDescription,
    naming: Naming = THE_ONLY_CELL,
) -> Replay:
    """Compensation of a machine without monitored axis: joint states alone.

    Raises:
        InputError: as `replay_bag`.
    """
    reader, wire = BagReader(bag, naming), wire_of(stage)
    names = [name for name in _machine_topics(reader, wire) if name in reader.topics]
    decisions = _published_inputs(reader, wire, RowsInMemory)
    compensator = Compensator(machine, None, decisions or None)
    corrections: list[Correction] = []
    collected = Collected(RowsInMemory, _columns(wire), corrections)
    stamps: list[int] = []
    window = reader.window(names)
    for topic, content, arrival_ns in reader.replay_arrivals(names, window, collected.refuse):
        if isinstance(content, JointState):
            stamps.append(content.stamp_ns)
        collected.note(topic, content)
        collected.accept_machine(topic, content, compensator, arrival_ns)
        collected.add_compensation(compensator)
    ticks = np.unique(np.array(stamps, np.int64))
    return Replay(
        replace(ErrorMotion.unknown(len(ticks)), times_ns=ticks, theta=np.full(len(ticks), np.nan)),
        offsets_at(collected.offsets, ticks),
        tuple(corrections),
        EstimatorStatus(),
        damage_of(reader, window),
        bool(decisions),
        np.zeros(len(ticks), np.bool_),
        np.empty(0, np.int64),
        (*remarks_of(reader, window), *collected.belief_remarks(), *collected.coverage_remarks()),
    )


def gap_remarks(status: EstimatorStatus, settings: EstimatorSettings) -> tuple[str, ...]:
    """That samples of some streams are too far apart to be joined, and what joins them."""
    if not status.sparse:
        return ()
    return (f"{status.too_far_apart(status.sparse, settings.max_gap_ns)}; --max-gap-ms joins more",)


def input_topics(reader: BagReader, wire: Wire, stage: StageDescription) -> dict[str, str]:
    """Stream of the estimator by topic; the bag has two heads at least, or of a stage without heads its command and
    something that measures.

    Raises:
        InputError: it has less.
    """
    heads = {wire.topic("head_samples", name).name: f"head_{name}" for name in stage.azimuths}
    present = [name for name in heads if name in reader.topics and reader.topics[name].count]
    if heads and len(present) < 2:
        reader.check_topics([name for name in heads if name not in present])
    tilt = () if stage.autocollimator is None else (AUTOCOLLIMATOR,)
    others = {wire.of_stream(stream).name: stream for stream in (*tilt, COMMAND, *stage.sensors)}
    if not heads:
        command = wire.of_stream(COMMAND).name
        measuring = [name for name in others if name != command]
        reader.check_topics([command])
        if not any(name in reader.topics and reader.topics[name].count for name in measuring):
            reader.check_topics(measuring)
    return heads | others


def _machine_topics(reader: BagReader, wire: Wire) -> tuple[str, str]:
    joints, temperature = wire.topic("machine_joint_states").name, wire.topic("machine_temperature").name
    reader.check_topics([joints])
    return joints, temperature


def _columns(wire: Wire) -> tuple[str, ...]:
    return wire.topic(_MOTION).columns


def _published_decisions(reader: BagReader, wire: Wire, keep: Keep, repeat: bool) -> ByTick[Decision]:
    """What the bag says that the live run decided; nothing where it is not to be repeated."""
    found = ByTick(keep, 9, _decision)
    for block in _blocks(reader, wire.topic(_MOTION).name) if repeat else ():
        rows = decision_rows(error_motion_from_block(block))
        if not tells_doubts(block):
            unsaid = Decision(0)
            rows[:, 1:] = [np.nan if number is None else number for number in astuple(unsaid)[1:]]
        found.add(block.times_ns, rows)
    return found


def _decision(_: int, said: Sequence[float]) -> Decision:
    return Decision(int(said[0]), None if math.isnan(said[1]) else int(said[1]), *said[2:])


def _published_inputs(reader: BagReader, wire: Wire, keep: Keep) -> ByTick[InputsUsed]:
    found = ByTick(keep, 3, _inputs_used)
    offsets = wire.topic("tool_offset_samples")
    for block in _blocks(reader, offsets.name):
        age, *other = block.columns(offsets.columns[len(OFFSET) :]).T
        found.add(block.times_ns, np.column_stack([np.rint(age * 1e9), *other]))
    return found


def _inputs_used(tick: int, said: Sequence[float]) -> InputsUsed:
    return InputsUsed(tick - int(said[0]), said[1], said[2])


def _blocks(reader: BagReader, topic: str) -> Iterator[SampleBlock]:
    if topic in reader.topics:
        for _, content in reader.replay([topic]):
            if isinstance(content, SampleBlock):
                yield content


def _period(decisions: ByTick[Decision], default_ns: int, origin: Path) -> int:
    """Period of the grid on which the live run published: its most frequent step.

    Raises:
        InputError: it is none that an estimator has.
    """
    if len(decisions) < 2:
        return default_ns
    counts: Counter[int] = Counter()
    before = np.empty(0, np.int64)
    for part in decisions.sorted_parts():
        steps, often = np.unique(np.diff(np.concatenate([before, part])), return_counts=True)
        counts.update(dict(zip(steps.tolist(), often.tolist(), strict=True)))
        before = part[-1:]
    period = max(counts, key=lambda step: (counts[step], -step))
    if not SHORTEST_PERIOD_NS <= period <= LONGEST_PERIOD_NS:
        raise InputError(
            f"{origin}: the estimates that it holds are {period} ns apart; an estimator publishes each "
            f"{SHORTEST_PERIOD_NS} to {LONGEST_PERIOD_NS} ns: record without them"
        )
    return period
