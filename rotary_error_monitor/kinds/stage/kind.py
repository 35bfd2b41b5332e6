"""Rotary stages as a kind of thing to be diagnosed: bags of their sensors' streams."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.description.stage import StageDescription, load_stage, stage_mapping
from rotary_error_monitor.description.topics import samples_topic
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.kind import Kind, TwinFile, check_signal, opened_bag
from rotary_error_monitor.sensors.library import absent_kinds
from rotary_error_monitor.twin.recording import record_stage, streams_with, without_section

if TYPE_CHECKING:
    from rotary_error_monitor.kinds.stage.problem import StageProblem


class StageKind(Kind[StageDescription, StageEffect, "StageProblem"]):
    """Rotary stages."""

    effect = StageEffect
    rank = 1  # a machine beside it in one file is that which carries the stage

    def describe(self, path: Path) -> StageDescription:
        """Section `stage`."""
        return load_stage(path)

    def problem(self, recording: Path, twin: TwinFile[StageDescription, StageEffect], most_rate: float) -> StageProblem:
        """A bag of heads, autocollimator and command, with whatever else the stage has where that is recorded.

        A bag whose end or one of whose files is missing gives what is readable, and the problem's remarks say how much
        that is and what its streams lack.
        """
        # The libraries of a stage's signals take a second to load, which who only looks at a twin need not wait for.
        from rotary_error_monitor.kinds.stage.stretches import stage_problem

        with opened_bag(recording, twin.naming) as reader:
            letters, without = sorted(twin.description.azimuths), absent_kinds(twin.description)
            listed = tuple(twin.description.listed)
            needed, optional = streams_with(letters, without, listed)
            _check_streams(reader, needed)
            topics = {name: samples_topic(name) for name in (*needed, *optional)}
            there = [name for name in topics if name in needed or _is_recorded(reader, topics[name])]
            names = [topics[name] for name in there]
            window = reader.window(names)
            read = reader.read_blocks(names, window)
            blocks = {name: read[topics[name]] for name in there}
            elsewhere = [topics[name] for name in needed if not blocks[name]]
            if elsewhere and window is not None:
                lost = f"{', '.join(elsewhere)} and the others do not overlap in time: {window.remark}"
                raise InputError(f"{reader.path}: {lost}")
            recorded = record_stage(blocks, letters, most_rate, without, listed, twin.description.responses)
            overlap = (window.remark,) if window is not None and window.remark else ()
            recorded = replace(recorded, remarks=(*reader.remarks, *overlap, *recorded.remarks))
            return stage_problem(twin.description, recorded, twin.effects, twin.known)

    def attempt(self, problem: StageProblem, cause: Cause) -> None:
        """Every signal of the recording with the effect keeps its shape and is finite."""
        for name, signal in problem.twin.predict((cause,)).items():
            check_signal(name, signal, problem.recording.streams[name].values.shape)

    def amended(self, description: StageDescription, cause: Cause) -> StageDescription:
        """The description with what an effect changes of it."""
        assert isinstance(cause.effect, StageEffect)
        return cause.effect.amend(description, cause.values, cause.location)

    def mapping(self, description: StageDescription) -> dict[str, Any]:
        """Content of section `stage`."""
        return stage_mapping(description)


def _is_recorded(reader: BagReader, topic: str) -> bool:
    return topic in reader.topics and reader.topics[topic].count > 0


def _check_streams(reader: BagReader, needed: Sequence[str]) -> None:
    """Hold a bag against the streams without which there is no recording of the stage.

    Raises:
        InputError: some are missing; the message says what to do where the stage need not have their sensor.
    """
    try:
        reader.check_topics(map(samples_topic, needed))
    except InputError as error:
        missing = [name for name in needed if not _is_recorded(reader, samples_topic(name))]
        raise InputError(f"{error}{without_section(missing)}") from error
