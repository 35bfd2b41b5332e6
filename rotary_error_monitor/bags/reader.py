"""Reading a rosbag2 bag: whole ones, and what is readable of those whose recorder was killed."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from mcap.records import Channel, Schema
from rosbags.interfaces import MessageDefinitionFormat
from rosbags.rosbag2 import Reader, ReaderError

from rotary_error_monitor.bags.contents import SAMPLE_BLOCK, TYPES, Content
from rotary_error_monitor.bags.messages import Decoder, stamp_of
from rotary_error_monitor.bags.torn import TornFile
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.signals.blocks import SampleBlock


class RawMessage(NamedTuple):
    """A message as it lies in the bag; `log_time_ns` is the timestamp (ns) at which it was recorded."""

    topic: str
    type: str
    log_time_ns: int
    data: bytes


@dataclass(frozen=True)
class TopicContent:
    """Type of a topic, how many messages the bag holds of it, and the type's definition where the bag has it."""

    type: str
    count: int
    definition: str = ""


class _Source(Protocol):
    topics: Mapping[str, TopicContent]
    damage: str | None

    def messages(self, names: Collection[str]) -> Iterator[RawMessage]:
        """Messages of these topics, in the order of their recording."""
        ...


class BagReader:
    """One bag: a folder with `metadata.yaml` and mcap (or sqlite3) files, the same without its end, or one mcap file.

    Attributes:
        path: the bag.
        topics: type and number of messages by topic.
        damage: None for a bag that is whole, else what is wrong with it and how much of it can be read.

    Raises:
        InputError: there is no bag, or nothing in it can be read.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        if not self.path.exists():
            raise InputError(f"{self.path}: no such bag; give the folder of a rosbag2 bag, or an mcap file")
        self._source = _open(self.path)
        self.topics = self._source.topics
        self.damage = self._source.damage

    def check_topics(self, names: Iterable[str]) -> None:
        """Hold the bag against the topics that somebody needs.

        Raises:
            InputError: some are missing or without a message; the message names them and what the bag has.
        """
        missing = [name for name in names if name not in self.topics or not self.topics[name].count]
        if missing:
            have = ", ".join(name for name, topic in self.topics.items() if topic.count) or "no message at all"
            raise InputError(f"{self.path}: no message on {', '.join(missing)}; the bag has {have}")

    def messages(self, names: Collection[str] | None = None) -> Iterator[RawMessage]:
        """Messages of some topics, by default all, as bytes in the order of their recording.

        Raises:
            InputError: the bag is damaged in its middle.
        """
        chosen = self.topics.keys() if names is None else names
        try:
            yield from self._source.messages(chosen)
        except ReaderError as error:
            raise InputError(f"{self.path}: damaged: {error}; recover the bag and read it again") from error

    def replay(self, names: Collection[str] | None = None) -> Iterator[tuple[str, Content]]:
        """Contents in the order of their stamps, whatever the order in which they arrived.

        The bag is gone through twice, first for the stamps; in memory is only what waits for its turn, so that bags of
        any size can be replayed. Equal stamps come in the order of the topics' names, then of their recording.

        Args:
            names: topics, by default all whose type can be read.

        Raises:
            InputError: a topic or its type cannot be read, or a message is broken; the message says topic and stamp.
        """
        chosen = self._chosen(names)
        decoders = {name: self._decoder(name) for name in chosen}
        ranks = self._ranks(chosen)
        waiting: list[tuple[int, RawMessage]] = []
        turn = 0
        for rank, message in zip(ranks, self.messages(chosen), strict=True):
            heapq.heappush(waiting, (rank, message))
            while waiting and waiting[0][0] == turn:
                _, ready = heapq.heappop(waiting)
                yield ready.topic, self._decode(decoders[ready.topic], ready)
                turn += 1

    def read(self, names: Collection[str] | None = None) -> dict[str, list[Content]]:
        """All contents by topic, each topic in the order of its stamps; what is asked for and empty is an empty list.

        Args and errors as in `replay`.
        """
        chosen = self._chosen(names)
        decoders = {name: self._decoder(name) for name in chosen}
        contents: dict[str, list[Content]] = {name: [] for name in chosen}
        for message in self.messages(chosen):
            contents[message.topic].append(self._decode(decoders[message.topic], message))
        for found in contents.values():
            found.sort(key=lambda content: content.stamp_ns)
        return contents

    def read_blocks(self, names: Collection[str] | None = None) -> dict[str, list[SampleBlock]]:
        """Sample blocks by topic in the order of their stamps, by default of every topic that carries blocks.

        Raises:
            InputError: a topic is missing or carries something else, or a block is broken or not finite; the message
                says topic and stamp.
        """
        if names is None:
            names = [name for name, topic in self.topics.items() if topic.type == SAMPLE_BLOCK]
        for name in self._chosen(names):
            if self.topics[name].type != SAMPLE_BLOCK:
                raise InputError(f"{self.path}: {name} is a {self.topics[name].type}; sample blocks are {SAMPLE_BLOCK}")
        return {
            name: [content for content in contents if isinstance(content, SampleBlock)]
            for name, contents in self.read(names).items()
        }

    def _decoder(self, name: str) -> Decoder:
        topic = self.topics[name]
        return Decoder(topic.type, topic.definition)

    def _chosen(self, names: Collection[str] | None) -> list[str]:
        if names is None:
            return [name for name, topic in self.topics.items() if topic.type in TYPES.values()]
        missing = [name for name in names if name not in self.topics]
        if missing:
            raise InputError(
                f"{self.path}: no topic {', '.join(missing)}; the bag has {', '.join(self.topics) or 'none'}"
            )
        return list(names)

    def _ranks(self, names: Collection[str]) -> list[int]:
        """Place of each message, in the order of recording, among all by stamp."""
        order = {name: place for place, name in enumerate(sorted(names))}
        keys = [(self._stamp(message), order[message.topic]) for message in self.messages(names)]
        stamps, topics = np.array(keys, dtype=np.int64).reshape(-1, 2).T
        ranks = np.empty(len(keys), dtype=np.int64)
        ranks[np.lexsort((topics, stamps))] = np.arange(len(keys))
        return [int(rank) for rank in ranks]

    def _stamp(self, message: RawMessage) -> int:
        try:
            return stamp_of(message.data)
        except InputError as error:
            raise InputError(f"{self.path}: {message.topic}, recorded at {message.log_time_ns} ns: {error}") from error

    def _decode(self, decoder: Decoder, message: RawMessage) -> Content:
        try:
            return decoder.decode(message.data)
        except InputError as error:
            stamp = self._stamp(message)
            raise InputError(f"{self.path}: {message.topic}, message with stamp {stamp} ns: {error}") from error


def _open(path: Path) -> _Source:
    """The bag as rosbags reads it, or where that fails what can be read of its mcap files."""
    if path.is_file():
        return _TornBag(path, [path])
    try:
        whole = _WholeBag(path)
    # Which error comes depends on the byte where the file ends: rosbags' own, or one of the parsing below it.
    except Exception as error:
        files = sorted(path.glob("*.mcap"))
        if not files:
            raise InputError(f"{path}: no readable bag: {error}") from error
        return _TornBag(path, files)
    if any(topic.count for topic in whole.topics.values()):
        return whole
    # A recorder that was killed while it closed the bag leaves counts of zero in metadata.yaml.
    files = sorted(path.glob("*.mcap"))
    return _TornBag(path, files) if files else whole


class _WholeBag:
    """A bag with metadata and index, read by rosbags."""

    damage: str | None = None

    def __init__(self, path: Path) -> None:
        self._path = path
        counts: Counter[str] = Counter()
        types = {}
        with Reader(path) as reader:
            for connection in reader.connections:
                definition = connection.msgdef
                readable = definition.data if definition.format == MessageDefinitionFormat.MSG else ""
                types[connection.topic] = connection.msgtype, readable
                counts[connection.topic] += connection.msgcount
        self.topics: Mapping[str, TopicContent] = {
            name: TopicContent(msgtype, counts[name], definition) for name, (msgtype, definition) in types.items()
        }

    def messages(self, names: Collection[str]) -> Iterator[RawMessage]:
        with Reader(self._path) as reader:
            connections = [connection for connection in reader.connections if connection.topic in names]
            if not connections:
                return  # rosbags takes an empty choice for all
            for connection, log_time_ns, data in reader.messages(connections):
                yield RawMessage(connection.topic, connection.msgtype, log_time_ns, data)


class _TornBag:
    """The mcap files of a bag, each read as far as it goes; those that are whole are read to their end."""

    def __init__(self, path: Path, files: list[Path]) -> None:
        self._files = [TornFile(file) for file in files]
        counts: Counter[str] = Counter()
        types: dict[str, str] = {}
        for message in self._scan(types):
            counts[message.topic] += 1
        self.topics: Mapping[str, TopicContent] = {
            name: TopicContent(msgtype, counts[name]) for name, msgtype in types.items()
        }
        self.damage: str | None = self._describe(path, counts)

    def messages(self, names: Collection[str]) -> Iterator[RawMessage]:
        return (message for message in self._scan({}) if message.topic in names)

    def _scan(self, types: dict[str, str]) -> Iterator[RawMessage]:
        for file in self._files:
            schemas: dict[int, str] = {}
            channels: dict[int, tuple[str, str]] = {}
            for record in file.records():
                if isinstance(record, Schema):
                    schemas[record.id] = record.name
                elif isinstance(record, Channel):
                    channels[record.id] = record.topic, schemas.get(record.schema_id, "")
                    types[record.topic] = channels[record.id][1]
                elif record.channel_id in channels:
                    yield RawMessage(*channels[record.channel_id], record.log_time, record.data)

    def _describe(self, path: Path, counts: Counter[str]) -> str | None:
        extents = [file.extent for file in self._files]
        if all(extent.complete and not extent.damaged for extent in extents):
            return None
        readable, size = sum(e.readable for e in extents), sum(e.size for e in extents)
        damaged = sum(e.damaged for e in extents)
        return (
            f"{path}: the recording was not closed; readable are {counts.total()} messages on {len(counts)} topics, "
            f"{readable} of {size} bytes" + (f", without {damaged} damaged records in between" if damaged else "")
        )
