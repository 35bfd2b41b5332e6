"""One mcap file of a bag while it is written; a bag has several where it is split."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

from mcap.writer import CompressionType, Writer

from rotary_error_monitor.bags.metadata import FileEntry, channel_metadata, qos_profiles
from rotary_error_monitor.bags.storage import RecordFile, Reserve
from rotary_error_monitor.description.wire import Qos
from rotary_error_monitor.signals.blocks import NANOSECONDS

CHUNK_SIZE = 1 << 20
"""Messages are gathered to chunks of this many bytes, 1 MiB as in other writers, or of one flush period.

The index of a file holds a kilobyte of memory for each chunk, and what a kill may cost is bounded by time."""

LIBRARY = "rotary_error_monitor"
_INDEX_PER_CHUNK = 73
"""Bytes of a chunk index by mcap's specification: opcode, eight numbers of 64 bits, two lengths of 32."""

_INDEX_PER_CHANNEL = 10
"""Bytes that each channel of the chunk adds to it: a 16-bit identifier and a 64-bit offset."""

_MARGIN = 2  # the reserve takes this many chunks beside the index: the one at hand, and what lies over


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


class BagPart:
    """One file. Everything that writes raises OSError where the disk is full or broken.

    Attributes:
        file: below the writer.
        counts: messages written, by topic.
    """

    def __init__(
        self,
        folder: Path,
        name: str,
        topics: Sequence[Recordable],
        definitions: Mapping[str, str],
        reserve: Reserve,
        compression: CompressionType = CompressionType.NONE,
    ) -> None:
        """Create the file `name` in `folder`; `definitions` are those of the topics' types."""
        self.name = name
        self.counts: Counter[str] = Counter()
        self._compression = compression
        self.file = RecordFile(folder / name, reserve)
        self._times: tuple[int, int] | None = None
        try:
            self._begin(topics, definitions)
        except OSError:
            with contextlib.suppress(OSError):
                self.file.close()
            raise

    @property
    def entry(self) -> FileEntry:
        """What `metadata.yaml` says of the file."""
        return FileEntry(self.name, self.counts.total(), *(self._times or (0, 0)))

    @property
    def index_size(self) -> int:
        """Bytes that must be free so that the chunk at hand and the index of all chunks can be written."""
        per_chunk = _INDEX_PER_CHUNK + _INDEX_PER_CHANNEL * len(self._channels)
        return _MARGIN * CHUNK_SIZE + self.file.chunks * per_chunk

    def is_full(self, log_time_ns: int, size: int, duration: float) -> bool:
        """Whether a message of `log_time_ns` belongs to the next file: `size` bytes or `duration` s are reached."""
        if self._times is None:
            return False
        return 0 < size <= self.file.tell() or 0 < duration * NANOSECONDS <= log_time_ns - self._times[0]

    def add(self, topic: str, data: bytes, log_time_ns: int, publish_time_ns: int, sequence: int) -> None:
        """Append a message; times are timestamps (ns)."""
        self._writer.add_message(self._channels[topic], log_time_ns, data, publish_time_ns, sequence)
        self.counts[topic] += 1
        first, last = self._times or (log_time_ns, log_time_ns)
        self._times = min(first, log_time_ns), max(last, log_time_ns)

    def _begin(self, topics: Sequence[Recordable], definitions: Mapping[str, str]) -> None:
        # A file with the methods of a stream is all that the writer needs, whatever its annotation asks for.
        self._writer = Writer(self.file, CHUNK_SIZE, self._compression)  # type: ignore[arg-type]
        self._writer.start(profile="ros2", library=LIBRARY)
        schemas = {
            msgtype: self._writer.register_schema(msgtype, "ros2msg", definition.encode())
            for msgtype, definition in definitions.items()
        }
        self._channels = {
            topic.name: self._writer.register_channel(
                topic.name, "cdr", schemas[topic.type], channel_metadata(qos_profiles(topic.qos))
            )
            for topic in topics
        }

    def flush(self) -> None:
        """Hand the chunk at hand over to the operating system."""
        self._writer.flush()  # type: ignore[no-untyped-call]

    def finish(self) -> None:
        """Write the index and begin to close the file."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self.file.end()
