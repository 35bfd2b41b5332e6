"""A recording of a rotary stage as continuous streams on one time axis."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.description.response import Response
from rotary_error_monitor.description.streams import COMMAND, FORCE, TEMPERATURE
from rotary_error_monitor.description.topics import samples_columns, samples_topic
from rotary_error_monitor.effects.rotor import HEAD
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.responses import correct_block
from rotary_error_monitor.sensors.library import input_of, kind_of, sensor_kinds, without_class
from rotary_error_monitor.sensors.listed import ListedKind
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.signals.coverage import MessageSpans, coverage_remarks
from rotary_error_monitor.twin.rates import MOST_RATE

_INPUTS = (COMMAND, FORCE, TEMPERATURE)
"""Streams of what drives the stage and acts on it."""

_CLOCK_ACCURACY = 0.01
"""An instrument whose clock is this part too fast is no faster than it should be."""

FEWEST_SAMPLES = 200
"""Samples of a stream below which nothing can be said about it."""


@dataclass(frozen=True)
class SignalStream:
    """Samples of one signal: `time` (n,) s since the recording's start, increasing, and `values` (n, k)."""

    time: Array
    values: Array

    @property
    def period(self) -> float:
        """Usual time between samples, s."""
        return float(np.median(np.diff(self.time)))


@dataclass(frozen=True)
class StageRecording:
    """What was measured on a stage.

    Attributes:
        start_ns: stamp of the earliest sample, timestamp (ns); time 0 of all streams.
        streams: `head_a` …, `autocollimator`, `command`, `force`, `temperature`, and listed sensors such as
            `axial_probe_top` or `thermometer_bearing`, as far as recorded.
        remarks: what a reader should know, such as samples that had to be left out.
    """

    start_ns: int
    streams: Mapping[str, SignalStream]
    remarks: tuple[str, ...] = ()

    @property
    def sensors(self) -> tuple[str, ...]:
        """Streams that a twin predicts."""
        return tuple(name for name in sorted(self.streams) if kind_of(name) in sensor_kinds())

    @property
    def heads(self) -> tuple[str, ...]:
        """Streams of the read heads."""
        return tuple(name for name in self.sensors if name.startswith("head_"))

    @property
    def duration(self) -> float:
        """Time between the first and the last sample, s."""
        return max(float(stream.time[-1]) for stream in self.streams.values())


def fields_of(stream: str) -> tuple[str, ...]:
    """Fields of a stream's samples, those of what drives the stage included.

    Raises:
        InputError: the stream is of no kind of sensor that has a class.
    """
    sensor = sensor_kinds().get(kind_of(stream)) or input_of(stream)
    if sensor is None and stream not in _INPUTS:
        raise InputError(f"{stream}: {without_class()}")
    return samples_columns(stream) if sensor is None else sensor.fields


def measured(stream: str, sensor: ListedSensor, readings: Array) -> Array:
    """(n, k) what acts on the stage by readings (n, fields) of a listed sensor that is an input."""
    kind = input_of(stream)
    assert kind is not None  # only such sensors are among a stage's inputs
    return kind.measured(sensor, readings).reshape(len(readings), -1)


def streams_with(
    heads: Sequence[str], without: Collection[str] = (), listed: Sequence[str] = ()
) -> tuple[list[str], list[str]]:
    """Names of the streams without which there is no recording of a stage with these heads, and of those that help.

    `without` names kinds of sensor that the stage does not have, `listed` the streams of those that it lists.
    """
    kinds = [sensor for sensor in sensor_kinds().values() if not isinstance(sensor, ListedKind)]
    others = [sensor for sensor in kinds if sensor.kind not in (HEAD, *without)]
    needed = [*(f"{HEAD}_{letter}" for letter in heads), *(each.kind for each in others if each.is_needed), COMMAND]
    helpful = [each.kind for each in others if not each.is_needed]
    return needed, [*helpful, *listed, *(name for name in _INPUTS if name != COMMAND)]


def record_stage(
    blocks: Mapping[str, Sequence[SampleBlock]],
    heads: Sequence[str],
    most_rate: float = MOST_RATE,
    without: Collection[str] = (),
    listed: Sequence[str] = (),
    responses: Mapping[str, Response] | None = None,
) -> StageRecording:
    """Recording from the sample blocks of each stream.

    Samples that are not finite are left out, and said so, as long as they are few; what the streams lack is said too.
    A listed sensor that is missing or of no use is left out as a whole, and said so: the others are worth a recording.

    Args:
        blocks: of each stream, such as `head_a`.
        heads: letters of the heads that the twin has.
        most_rate: samples a second (Hz) of one sensor that are used; of one that is faster every so-manieth is.
        without: kinds of sensor that the stage does not have.
        listed: streams of the sensors that the stage lists.
        responses: of the instruments by stream, by which the samples are corrected.

    Raises:
        InputError: streams are missing (all are named), too short, not finite, or their clocks do not overlap.
    """
    needed, optional = streams_with(heads, without, listed)
    missing = [name for name in needed if not blocks.get(name)]
    if missing:
        raise InputError(
            f"the recording lacks {_topics(missing)}; it has {_topics(sorted(blocks)) or 'no topic at all'}"
            f"{without_section(missing)}"
        )
    present = [name for name in (*needed, *optional) if blocks.get(name)]
    if responses:
        blocks = _corrected(blocks, present, responses)
    start = min(int(block.times_ns[0]) for name in present for block in blocks[name][:1])
    remarks = list(_coverage_remarks({name: blocks[name] for name in present}, start))
    absent = [name for name in listed if name not in present]
    remarks += [f"{_topics(absent)}: described, but not recorded; left out"] if absent else []
    streams = {name: _stream(name, blocks[name], start, remarks) for name in present if name not in listed}
    _check_overlap(streams)
    for name in (name for name in present if name in listed):
        try:
            found = _stream(name, blocks[name], start, remarks)
            _check_overlap({COMMAND: streams[COMMAND], name: found})
        except InputError as error:
            remarks.append(f"{error}; left out")
        else:
            streams[name] = found
    _check_sensors(streams, [name for name in (*needed, *optional) if name not in _INPUTS])
    return thinned(StageRecording(start, streams, tuple(remarks)), most_rate)


def _corrected(
    blocks: Mapping[str, Sequence[SampleBlock]], streams: Sequence[str], responses: Mapping[str, Response]
) -> dict[str, Sequence[SampleBlock]]:
    """Blocks of the streams as the package means them."""
    found = dict(blocks)
    for name in streams:
        response = responses.get(name)
        if response is not None:
            found[name] = [correct_block(block, fields_of(name), response) for block in blocks[name]]
    return found


def without_section(missing: Collection[str]) -> str:
    """What to do about missing streams if one is of a sensor that a stage need not have; else nothing."""
    kinds = [sensor for sensor in sensor_kinds().values() if sensor.is_needed and sensor.kind != HEAD]
    lacking = [sensor.section for sensor in kinds if sensor.kind in missing]
    said = [f"; a stage without {name} is described without the section '{name}'" for name in lacking]
    heads = [stream for stream in sorted(missing) if kind_of(stream) == HEAD]
    if heads:
        letters = ", ".join(stream.removeprefix(f"{HEAD}_") for stream in heads)
        said.append(f"; a stage without head {letters} is described without {letters} in 'encoder.heads'")
    return "".join(said)


def _topics(streams: Iterable[str]) -> str:
    """Streams as who recorded them knows them: by their topics."""
    return ", ".join(map(samples_topic, streams))


def _coverage_remarks(blocks: Mapping[str, Sequence[SampleBlock]], start_ns: int) -> tuple[str, ...]:
    found = {}
    for stream, each in blocks.items():
        spans = MessageSpans()
        for block in each:
            spans.add_block(block)
        coverage = spans.coverage()
        if coverage is not None:
            found[samples_topic(stream)] = coverage
    return coverage_remarks(found, start_ns)


def thinned(recording: StageRecording, most_rate: float) -> StageRecording:
    """Every so-manieth sample of sensors that sample more than `most_rate` times a second, and a remark that says so.

    Samples are chosen, not averaged: what the twin says of one holds, and the noise stays as it was. Heads keep those
    that were taken together.
    """
    streams, steps = dict(recording.streams), dict[int, list[str]]()
    for kind in sensor_kinds():
        names = [name for name in recording.sensors if kind_of(name) == kind]
        period = float(np.median([streams[name].period for name in names] or [np.inf]))
        step = int(np.ceil(1 / (period * most_rate) - _CLOCK_ACCURACY))
        if step <= 1:
            continue
        steps.setdefault(step, []).extend(names)
        for name in names:
            slot = np.floor(streams[name].time / (step * period))
            first = np.flatnonzero(np.diff(slot, prepend=-np.inf) > 0)
            streams[name] = SignalStream(streams[name].time[first], streams[name].values[first])
    remarks = [f"one sample in {step} is used of {', '.join(names)}" for step, names in steps.items()]
    return StageRecording(recording.start_ns, streams, (*recording.remarks, *remarks))


def _stream(name: str, blocks: Sequence[SampleBlock], start_ns: int, remarks: list[str]) -> SignalStream:
    fields = fields_of(name)
    for block in blocks:
        block.check_fields(name, fields)
    time = np.concatenate([(block.times_ns - start_ns) * 1e-9 for block in blocks])
    values = np.concatenate([block.columns(fields) for block in blocks])
    order = np.argsort(time, kind="stable")
    time, values = time[order], values[order]
    finite = np.isfinite(values).all(axis=1)
    if finite.mean() < 0.9:
        raise InputError(
            f"{samples_topic(name)}: {np.count_nonzero(~finite)} of {len(time)} samples are not finite "
            "(NaN or infinite); expected numbers"
        )
    if not finite.all():
        remarks.append(f"{samples_topic(name)}: {np.count_nonzero(~finite)} samples are not finite and were left out")
    distinct = np.concatenate([[True], np.diff(time) > 0])
    kept = finite & distinct
    fewest = FEWEST_SAMPLES if kind_of(name) in (*sensor_kinds(), COMMAND) else 2
    if np.count_nonzero(kept) < fewest:
        raise InputError(f"{samples_topic(name)}: only {np.count_nonzero(kept)} samples; {fewest} are needed")
    return SignalStream(time[kept], values[kept])


def _check_sensors(streams: Mapping[str, SignalStream], described: Sequence[str]) -> None:
    """Refuse a recording of a stage without heads in which nothing measures."""
    if not any(name in streams for name in described):
        raise InputError(
            f"the recording holds samples of no sensor; expected those of one or more of {_topics(described)}"
        )


def _check_overlap(streams: Mapping[str, SignalStream]) -> None:
    command = streams[COMMAND]
    for name, stream in streams.items():
        shared = min(stream.time[-1], command.time[-1]) - max(stream.time[0], command.time[0])
        if shared < 0.5 * min(np.ptp(stream.time), np.ptp(command.time)):
            raise InputError(
                f"the clocks of {samples_topic(name)} ({stream.time[0]:.3f} to {stream.time[-1]:.3f} s) and "
                f"{samples_topic('command')} ({command.time[0]:.3f} to {command.time[-1]:.3f} s) do not overlap; "
                "stamp all streams by one clock"
            )
