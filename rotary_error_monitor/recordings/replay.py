"""Estimator and compensation over a recorded bag: the numbers that were published live, bit for bit, without ROS."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from rotary_error_monitor.bags.naming import THE_ONLY_CELL, Naming
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.codec.contents import JointState, Temperature
from rotary_error_monitor.codec.error_motion_blocks import error_motion_from_block
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.wire import Wire, wire_of
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.compensation import CompensationSettings, Compensator, InputsUsed
from rotary_error_monitor.pipeline.estimation import (
    AUTOCOLLIMATOR,
    COMMAND,
    Estimator,
    EstimatorSettings,
    EstimatorStatus,
)
from rotary_error_monitor.pipeline.observability import rotation_is_lacking
from rotary_error_monitor.pipeline.publication import Decision, Decisions, decisions_of
from rotary_error_monitor.recordings.replayed import Collected, Replay, damage_of, remarks_of
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.signals.coverage import absence_remarks

SHORTEST_PERIOD_NS, LONGEST_PERIOD_NS = 10_000, 1_000_000_000
"""Distances of two estimates, ns, as the node `error_estimator` allows them."""

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


def check_estimated(replay: Replay, bag: Path | str, stage: StageDescription, least: int = 1) -> None:
    """Refuse a replay that gives hardly anything.

    Raises:
        InputError: it has fewer estimates; the message names what the bag lacks.
    """
    if len(replay.stamp_ns) < least:
        raise InputError(f"{bag}: no estimate: {rotation_is_lacking(stage)}")


def replay_bag(
    bag: Path | str,
    stage: StageDescription,
    machine: MachineDescription | None = None,
    settings: EstimatorSettings | None = None,
    compensation_settings: CompensationSettings | None = None,
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
    reader = BagReader(bag, naming)
    wire = wire_of(stage)
    if machine is not None and machine.monitored is None:
        return _replay_described(reader, wire, machine, compensation_settings)
    inputs = input_topics(reader, wire, stage)
    decisions = _published_decisions(reader, wire) if repeat else {}
    settings = settings or EstimatorSettings()
    if decisions:
        settings = replace(settings, period_ns=_period(decisions, settings.period_ns, reader.path))
    estimator = Estimator(stage, settings, decisions or None)
    compensator, of_machine = None, tuple[str, ...]()
    if machine is not None:
        of_machine = _machine_topics(reader, wire)
        published = dict(_published_inputs(reader, wire)) or None
        compensator = Compensator(machine, compensation_settings, published, stage.limits)
    names = [name for name in (*inputs, *of_machine) if name in reader.topics]
    collected = Collected()
    window = reader.window(names)
    recorded = reader.replay_arrivals(names, window, collected.refuse)
    for count, (topic, content, arrival_ns) in enumerate(recorded, start=1):
        collected.note(topic, content)
        if isinstance(content, SampleBlock):
            collected.accept_samples(topic, content, inputs[topic], estimator, arrival_ns)
        if count % BATCH == 0 or isinstance(content, Temperature):
            collected.add_motion(estimator.advance(), compensator)
            collected.note_doubts(estimator)
        if compensator is not None and not isinstance(content, SampleBlock):
            collected.accept_machine(topic, content, compensator, arrival_ns)
    collected.add_motion(estimator.finish(), compensator)
    collected.note_doubts(estimator)
    if compensator is not None:
        collected.add_compensation(compensator, last=True)
    lacking = {}
    for name, ticks in estimator.unrepeated.items():
        why = "that the bag lacks" if name in estimator.inputs else "which this stage's description does not have"
        lacking[f"samples of {name} {why}"] = np.concatenate(ticks)
    if compensator is not None and compensator.unrepeated:
        lacking["joint states that the bag lacks"] = np.concatenate(compensator.unrepeated)
    return collected.result(
        estimator.status,
        reader,
        window,
        compensator is not None,
        np.sort(np.fromiter(decisions, np.int64, len(decisions))),
        lacking,
        absence_remarks([*inputs, *of_machine[:1]], collected.spans),
    )


def _replay_described(
    reader: BagReader, wire: Wire, machine: MachineDescription, settings: CompensationSettings | None
) -> Replay:
    """Compensation of a machine without monitored axis: joint states alone."""
    names = [name for name in _machine_topics(reader, wire) if name in reader.topics]
    decisions = dict(_published_inputs(reader, wire))
    compensator = Compensator(machine, settings, decisions or None)
    collected = Collected()
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
        collected.offsets_at(ticks),
        tuple(collected.corrections),
        EstimatorStatus(),
        damage_of(reader, window),
        bool(decisions),
        np.zeros(len(ticks), np.bool_),
        np.empty(0, np.int64),
        (*remarks_of(reader, window), *collected.belief_remarks(), *collected.coverage_remarks()),
    )


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


def _published_decisions(reader: BagReader, wire: Wire) -> dict[int, Decision]:
    found: dict[int, Decision] = {}
    for block in _blocks(reader, wire.topic("error_motion_samples").name):
        said = decisions_of(error_motion_from_block(block))
        if "doubts" not in block.names:  # a run of an earlier version
            said = {time: Decision(each.streams) for time, each in said.items()}
        found |= said
    return found


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


def _period(decisions: Decisions, default_ns: int, origin: Path) -> int:
    """Period of the grid on which the live run published: its most frequent step.

    Raises:
        InputError: it is none that an estimator has.
    """
    if len(decisions) < 2:
        return default_ns
    steps, counts = np.unique(np.diff(np.sort(np.fromiter(decisions, np.int64, len(decisions)))), return_counts=True)
    period = int(steps[np.argmax(counts)])
    if not SHORTEST_PERIOD_NS <= period <= LONGEST_PERIOD_NS:
        raise InputError(
            f"{origin}: the estimates that it holds are {period} ns apart; an estimator publishes each "
            f"{SHORTEST_PERIOD_NS} to {LONGEST_PERIOD_NS} ns: record without them"
        )
    return period
