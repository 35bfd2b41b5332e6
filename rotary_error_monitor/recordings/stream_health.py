"""The streams of a bag one by one: their health, and what acted on the stage."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rotary_error_monitor.analysis.course import Samples
from rotary_error_monitor.analysis.health import StreamHealth
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.codec.contents import Content
from rotary_error_monitor.commissioning.streams import Stream, describe_stream, join_blocks
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.wire import Topic, Wire
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.responses import correct_block
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.signals.coverage import MessageSpans

ANGLES = ("angle",)
FORCE, TEMPERATURE, LVDT = "force", "temperature", "lvdt"


@dataclass
class RecordedStreams:
    """Streams of a bag by name, such as `head_a` or `force`.

    Attributes:
        health: of each.
        rates: samples a second, Hz.
        streams: their samples, as the description corrects them.
    """

    health: list[StreamHealth] = field(default_factory=list)
    rates: dict[str, float] = field(default_factory=dict)
    streams: dict[str, Stream] = field(default_factory=dict)

    def acting(self, stage: StageDescription) -> Mapping[str, Samples]:
        """Force and temperatures, by name and unit."""
        found = {}
        if FORCE in self.streams:
            stream = self.streams[FORCE]
            found["force, N"] = Samples(stream.times_ns, np.hypot(stream.values[:, 0], stream.values[:, 1]))
        names = {TEMPERATURE: TEMPERATURE, **{stream: name for name, stream in stage.thermometers.items()}}
        for stream_name, name in names.items():
            if stream_name in self.streams:
                stream = self.streams[stream_name]
                found[f"{name}, °C"] = Samples(stream.times_ns, stream.values[:, 0])
        return found


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


def read_streams(reader: BagReader, wire: Wire, stage: StageDescription) -> RecordedStreams:
    """All streams of samples that instruments, controller and surroundings published.

    Messages that cannot be read are left out; a replay of the same bag says them.
    """
    topics = {topic.name: topic for topic in wire if topic.is_raw}
    there = [name for name in topics if name in reader.topics and reader.topics[name].count]
    blocks: dict[str, list[SampleBlock]] = {name: [] for name in there}
    late: dict[str, list[float]] = {name: [] for name in there}
    for name, content, arrival_ns in contents_within(reader, there, lambda topic, error: None):
        if isinstance(content, SampleBlock):
            blocks[name].append(content)
            late[name].append((arrival_ns - content.newest_ns) * 1e-9)
    found = RecordedStreams()
    for name in there:
        topic = topics[name]
        try:
            response = stage.responses.get(topic.frame)
            corrected = [correct_block(block, topic.columns, response) for block in blocks[name]]
            stream = join_blocks(corrected, topic.columns)
        except InputError:
            continue
        if len(stream.times_ns) > 1:
            found.streams[topic.frame] = stream
            found.health.append(_health(topic, stream, blocks[name], late[name]))
            found.rates[topic.frame] = found.health[-1].rate
    return found


def _health(topic: Topic, stream: Stream, blocks: Sequence[SampleBlock], late: Sequence[float]) -> StreamHealth:
    first = replace(stream, values=stream.values[:, :1])  # of the command only its angle goes on and on
    figures = describe_stream(first, is_angle=topic.columns[:1] == ANGLES)
    spans = MessageSpans()
    for block in blocks:
        spans.add_block(block)
    coverage = spans.coverage()
    gaps = np.diff(coverage.silences, axis=1) if coverage is not None else np.empty(0)
    latency, slow = np.quantile(late, (0.5, 0.99))
    return StreamHealth(
        topic.name,
        figures.samples,
        figures.rate,
        float(figures.jitter),
        figures.lost,
        float(gaps.max(initial=0)) * 1e-9,
        figures.disordered,
        float(latency),
        float(slow),
    )
