"""The streams of a bag one by one: their health, and what acted on the stage."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.analysis.course import Samples
from rotary_error_monitor.analysis.health import StreamHealth
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.codec.contents import Content
from rotary_error_monitor.description.listed_sensors import name_of
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import FORCE, OWN_REFERENCE, TEMPERATURE
from rotary_error_monitor.description.wire import Topic, Wire
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.responses import correct_block
from rotary_error_monitor.recordings.kept_samples import Distances, KeptCourse, KeptSamples, largest_of, mean_of
from rotary_error_monitor.recordings.progress import Passed, Progress, silent
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.signals.coverage import MessageSpans
from rotary_error_monitor.signals.rows import Keep
from rotary_error_monitor.twin.recording import measured

_AT_ONCE = 4_096
"""Samples from which they are looked at together."""


@dataclass
class RecordedStreams:
    """Streams of a bag by name, such as `head_a` or `force`.

    Attributes:
        health: of each.
        rates: samples a second, Hz.
        courses: forces and temperatures over time, of long recordings with fewer points than samples.
        kept: all samples of the streams that were asked for, where there are any.
    """

    health: list[StreamHealth] = field(default_factory=list)
    rates: dict[str, float] = field(default_factory=dict)
    courses: dict[str, Samples] = field(default_factory=dict)
    kept: dict[str, KeptSamples] = field(default_factory=dict)

    def most_force(self, stage: StageDescription) -> float:
        """Largest force on the shaft, N, by whichever load cell of it shows most."""
        there = [self.courses[name] for name in (FORCE, *stage.shaft_forces) if name in self.courses]
        return max((float(each.values.max()) for each in there), default=0.0)

    def acting(self, stage: StageDescription) -> Mapping[str, Samples]:
        """Forces and temperatures, by name and unit."""
        names = {FORCE: "force, N", TEMPERATURE: f"{TEMPERATURE}, °C"}
        names |= {stream: f"{name_of(stream, each)}, {each.unit}" for stream, each in stage.inputs.items()}
        return {words: self.courses[stream] for stream, words in names.items() if stream in self.courses}


def contents_within(
    reader: BagReader, names: Sequence[str], refuse: Callable[[str, InputError], None]
) -> Iterator[tuple[str, Content, int]]:
    """Contents of topics within the time of the recording, and when they were recorded; broken ones are refused.

    Raises:
        InputError: as `BagReader.replay_arrivals`.
    """
    for name, content, arrival_ns in reader.replay_arrivals(names, reader.window(names), refuse):
        if not isinstance(content, SampleBlock) or len(content.rows):
            yield name, content, arrival_ns


def read_streams(
    reader: BagReader,
    wire: Wire,
    stage: StageDescription,
    keep: Keep,
    progress: Progress = silent,
    kept: Collection[str] = (OWN_REFERENCE,),
) -> RecordedStreams:
    """All streams of samples that instruments, controller and surroundings published.

    Messages that cannot be read are left out; a replay of the same bag says them.

    Args:
        reader: of the bag.
        wire: topics of the stage.
        stage: as described.
        keep: where samples are kept that are needed one by one.
        progress: is told how far it is.
        kept: streams of which all samples are needed.
    """
    there = [
        topic for topic in wire if topic.is_raw and topic.name in reader.topics and reader.topics[topic.name].count
    ]
    streams = {topic.frame: _StreamReader(topic, stage, keep if topic.frame in kept else None) for topic in there}
    topics = {topic.name: topic.frame for topic in there}
    with progress("streams") as step:
        passed = Passed(reader.window(list(topics)), step)
        for topic, content, arrival_ns in contents_within(reader, list(topics), lambda topic, error: None):
            passed.note(content)
            if isinstance(content, SampleBlock):
                streams[topics[topic]].add(content, arrival_ns)
    found = RecordedStreams()
    for name, stream in streams.items():
        stream.take()
        if stream.samples > 1:
            health = stream.health
            found.health.append(health)
            found.rates[name] = health.rate
            if stream.course is not None:
                found.courses[name] = stream.course.samples
            if stream.kept is not None:
                found.kept[name] = stream.kept
    return found


class _StreamReader:
    """One stream, block after block.

    Attributes:
        topic: that it is of.
        samples: that are in order and finite, as far as all blocks could be read.
        course: of what acts on the stage; None of other streams.
        kept: all samples; None of streams of which they are not needed.
    """

    def __init__(self, topic: Topic, stage: StageDescription, keep: Keep | None) -> None:
        self.topic = topic
        self.samples = self._disordered = 0
        self._response = stage.responses.get(topic.frame)
        self._newest = np.iinfo(np.int64).min
        self._last: int | None = None  # that was in order and finite
        self._spans, self._late, self._distances = MessageSpans(), array("d"), Distances()
        self.course: KeptCourse | None = None
        self._input = stage.inputs.get(topic.frame)
        if topic.frame in (FORCE, *stage.forces.values()):
            self.course = KeptCourse(largest_of)
        elif topic.frame == TEMPERATURE or self._input is not None:
            self.course = KeptCourse(mean_of)
        self.kept = None if keep is None else KeptSamples(keep, len(topic.columns))
        self._is_readable = True
        self._waiting: list[tuple[NDArray[np.int64], NDArray[np.float64]]] = []
        self._count = 0

    def add(self, block: SampleBlock, arrival_ns: int) -> None:
        """Take a block that was recorded at `arrival_ns`, timestamp (ns)."""
        self._spans.add_block(block)
        self._late.append((arrival_ns - block.newest_ns) * 1e-9)
        try:
            corrected = correct_block(block, self.topic.columns, self._response)
            times, values = corrected.times_ns, corrected.columns(self.topic.columns)
        except InputError:
            self._is_readable, self.samples, self._waiting = False, 0, []
        if not self._is_readable:
            return
        self._waiting.append((times, values))
        self._count += len(times)
        if self._count >= _AT_ONCE:
            self.take()

    def take(self) -> None:
        """Take what waits: many blocks at once cost little more than one."""
        if not self._waiting:
            return
        times, values = (np.concatenate(each) for each in zip(*self._waiting, strict=True))
        self._waiting, self._count = [], 0
        before = np.maximum.accumulate(np.concatenate([[self._newest], times]))
        good = (times > before[:-1]) & np.isfinite(values).all(axis=1)
        self._disordered += int((~good).sum())
        times, values, last = times[good], values[good], self._last
        self._newest = int(before[-1])
        if len(times):
            self._distances.add(np.diff(times if last is None else np.concatenate([[last], times])))
            self._last = int(times[-1])
            self.samples += len(times)
        if self.course is not None:
            acting = values if self._input is None else measured(self.topic.frame, self._input, values)
            self.course.add(times, np.linalg.norm(acting, axis=1) if acting.shape[1] > 1 else acting[:, 0])
        if self.kept is not None:
            self.kept.add(times, values)

    @property
    def health(self) -> StreamHealth:
        """What it was like."""
        coverage = self._spans.coverage()
        assert coverage is not None
        gaps = np.diff(coverage.silences, axis=1)
        latency, slow = np.quantile(np.frombuffer(self._late), (0.5, 0.99))
        rate, jitter = self._distances.rate_and_jitter()
        return StreamHealth(
            self.topic.name,
            self.samples,
            rate,
            jitter,
            coverage.lost,
            float(gaps.max(initial=0)) * 1e-9,
            self._disordered,
            float(latency),
            float(slow),
        )
