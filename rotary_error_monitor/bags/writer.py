"""Writing a rosbag2 bag (mcap, version 9) that outlives its recorder: killed, or out of disk space."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from mcap.writer import CompressionType, Writer

from rotary_error_monitor.bags.contents import TYPES, Content
from rotary_error_monitor.bags.messages import encode
from rotary_error_monitor.bags.metadata import (
    FileEntry,
    TopicEntry,
    channel_metadata,
    qos_profiles,
    type_definition,
    write_metadata,
)
from rotary_error_monitor.bags.storage import RecordFile, Reserve
from rotary_error_monitor.description.wire import Qos, Wire
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.signals.blocks import SampleBlock

CHUNK_SIZE = 1 << 16  # what a kill may cost is bounded by time, not by this; larger chunks read faster
LIBRARY = "rotary_error_monitor"
RESERVE = ".reserve"
DEFAULT_QOS = Qos("reliable", "volatile", 10)
_INDEX_PER_CHUNK = 73  # bytes of a chunk index in mcap, and for each channel in the chunk
_INDEX_PER_CHANNEL = 10
_MARGIN = 4  # the reserve takes this many chunks beside the index


class Recordable(Protocol):
    """A topic to record, such as those of the wire contract."""

    @property
    def name(self) -> str:
        """Name of the topic."""

    @property
    def type(self) -> str:
        """Type of its messages, such as `sensor_msgs/msg/JointState`."""

    @property
    def qos(self) -> Qos:
        """Quality of service that its publishers offer."""


@dataclass(frozen=True)
class BagTopic:
    """A topic to record that is not in the wire contract."""

    name: str
    type: str
    qos: Qos = DEFAULT_QOS


class RecordingStoppedError(OSError):
    """Recording ended before it was told to; the message says why, and what the bag holds."""


class BagWriter:
    """Writes messages as CDR bytes, as a raw subscription delivers them.

    What was handed over is out of the process at the latest `flush_period` later, so that it survives `kill -9`, and on
    the disk some `sync_period` later, so that it survives a loss of power. Both happen within `write` and `flush`: who
    records slow topics calls `flush` from a timer.

    Attributes:
        folder: the bag.
        counts: messages written, by topic.
        stopped: why recording ended by itself, None while it goes on.
    """

    def __init__(
        self,
        folder: Path | str,
        topics: Iterable[Recordable],
        *,
        flush_period: float = 0.2,
        sync_period: float = 1.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Create the bag with its `metadata.yaml`.

        Args:
            folder: new folder of the bag; its parents are made.
            topics: every topic that will be written; their types are standard messages.
            flush_period: longest time (s) that a message stays in the process.
            sync_period: time (s) between requests to the disk to store what was written.
            clock: monotonic time (s).

        Raises:
            InputError: the folder exists, or a type is not known.
            OSError: the folder cannot be written, or the disk has no room for a recording.
        """
        self.folder = Path(folder)
        self.counts: Counter[str] = Counter()
        self.stopped: str | None = None
        self._topics = list(topics)
        definitions = {topic.type: _definition(topic) for topic in self._topics}
        try:
            self.folder.mkdir(parents=True)
        except FileExistsError:
            raise InputError(f"{self.folder}: exists already; give the path of a new bag") from None
        self._times: tuple[int, int] | None = None
        self._periods = flush_period, sync_period
        self._clock = clock
        self._flushed = self._synced = clock()
        self._closed = False
        self._name = f"{self.folder.resolve().name}_0.mcap"
        self._file = RecordFile(self.folder / self._name, Reserve(self.folder / RESERVE))
        # A file with the methods of a stream is all that the writer needs, whatever its annotation asks for.
        self._writer = Writer(self._file, CHUNK_SIZE, CompressionType.NONE)  # type: ignore[arg-type]
        try:
            self._writer.start(profile="ros2", library=LIBRARY)
            self._channels = self._register(definitions)
            self._write_metadata()
        except OSError:
            self._closed = True
            self._file.abandon()
            raise
        self._keep_reserve()

    def write(self, topic: str, data: bytes, log_time_ns: int, publish_time_ns: int | None = None) -> None:
        """Append a message.

        Args:
            topic: name of one of the bag's topics.
            data: CDR bytes of the message.
            log_time_ns: timestamp (ns) at which it was received.
            publish_time_ns: timestamp (ns) at which it was published, by default the same.

        Raises:
            InputError: the bag has no such topic.
            RecordingStoppedError: the disk is full or broken; what was written before is kept and the bag is closed.
        """
        self._check_open()
        if topic not in self._channels:
            raise InputError(f"{self.folder}: topic {topic} is not recorded; recorded are {', '.join(self._channels)}")
        publish_time_ns = log_time_ns if publish_time_ns is None else publish_time_ns
        try:
            self._writer.add_message(self._channels[topic], log_time_ns, data, publish_time_ns)
        except OSError as error:
            self._stop(error, whole=False)
        self.counts[topic] += 1
        first, last = self._times or (log_time_ns, log_time_ns)
        self._times = min(first, log_time_ns), max(last, log_time_ns)
        if self._clock() - self._flushed >= self._periods[0]:
            self.flush()
        elif self._file.trouble is not None:
            self._stop(self._file.trouble, whole=True)

    def flush(self) -> None:
        """Hand everything over to the operating system, and to the disk when that is due.

        Raises:
            RecordingStoppedError: the disk is full or broken; what was written before is kept and the bag is closed.
        """
        self._check_open()
        now = self._flushed = self._clock()
        try:
            self._writer.flush()  # type: ignore[no-untyped-call]
        except OSError as error:
            self._stop(error, whole=False)
        if now - self._synced >= self._periods[1]:
            self._synced = now
            self._file.sync()
        self._keep_reserve()

    def close(self) -> None:
        """Write the index and the final `metadata.yaml`; closing a closed bag does nothing.

        Raises:
            RecordingStoppedError: the disk is full or broken; what was written before is kept.
        """
        if self._closed:
            return
        try:
            self._finish()
        except OSError as error:
            self._stop(error, whole=False)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _register(self, definitions: Mapping[str, str]) -> dict[str, int]:
        schemas = {
            msgtype: self._writer.register_schema(msgtype, "ros2msg", definition.encode())
            for msgtype, definition in definitions.items()
        }
        return {
            topic.name: self._writer.register_channel(
                topic.name, "cdr", schemas[topic.type], channel_metadata(qos_profiles(topic.qos))
            )
            for topic in self._topics
        }

    def _keep_reserve(self) -> None:
        """Room for the index of all chunks, and for the chunk at hand."""
        per_chunk = _INDEX_PER_CHUNK + _INDEX_PER_CHANNEL * len(self._channels)
        self._file.reserve(_MARGIN * CHUNK_SIZE + self._file.chunks * per_chunk)
        if self._file.trouble is not None:
            self._stop(self._file.trouble, whole=True)

    def _check_open(self) -> None:
        if self.stopped is not None:
            raise RecordingStoppedError(self.stopped)
        if self._closed:
            raise InputError(f"{self.folder}: the bag is closed; nothing more can be written to it")

    def _finish(self) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._closed = True
        self._file.close()
        self._write_metadata()

    def _stop(self, error: OSError, *, whole: bool) -> None:
        """End the recording with what is written; `whole` is whether every message at hand got into the file."""
        if whole:
            try:
                self._finish()
            except OSError:
                whole = False
        if not self._closed:
            self._closed = True
            self._file.abandon()
        self.stopped = f"{self.folder}: recording stopped: {error.strerror or error}; " + (
            f"the bag is complete up to here with {self.counts.total()} messages"
            if whole
            else "what was written is kept, but the bag has no index: make room and recover it"
        )
        raise RecordingStoppedError(self.stopped) from error

    def _write_metadata(self) -> None:
        start, end = self._times or (0, 0)
        topics = [TopicEntry(t.name, t.type, qos_profiles(t.qos), self.counts[t.name]) for t in self._topics]
        write_metadata(self.folder, topics, [FileEntry(self._name, self.counts.total(), start, end)])


def write_messages(folder: Path | str, contents: Mapping[str, Sequence[Content]], wire: Wire | None = None) -> None:
    """Write a whole bag, every message recorded when it was complete: a block with its last sample.

    Args:
        folder: new folder of the bag.
        contents: what goes on each topic; a topic without contents is one of the wire contract.
        wire: gives topics their quality of service and blocks their frame; other topics are written too.

    Raises:
        InputError: the folder exists, a topic holds contents of several kinds, or none and is not in the contract.
        RecordingStoppedError: the disk is full or broken.
    """
    known = {topic.name: topic for topic in wire or ()}
    topics: list[Recordable] = []
    for name, values in contents.items():
        kinds = {TYPES[type(value)] for value in values} or {known[name].type if name in known else ""}
        if len(kinds) != 1 or "" in kinds:
            raise InputError(f"topic {name} holds {sorted(kinds)}; give it contents of one kind")
        (kind,) = kinds
        qos = known[name].qos if name in known else DEFAULT_QOS
        topics.append(BagTopic(name, kind, qos))
    rows = sorted(
        ((_complete_ns(value), name, value) for name, values in contents.items() for value in values),
        key=lambda row: row[:2],
    )
    with BagWriter(folder, topics) as writer:
        for time_ns, name, value in rows:
            writer.write(name, encode(value, known[name].frame if name in known else ""), time_ns)


def _complete_ns(content: Content) -> int:
    return int(content.times_ns[-1]) if isinstance(content, SampleBlock) else content.stamp_ns


def _definition(topic: Recordable) -> str:
    definition = type_definition(topic.type)
    if not definition:
        raise InputError(
            f"topic {topic.name}: {topic.type} is no standard message of ROS 2; its definition is not known"
        )
    return definition
