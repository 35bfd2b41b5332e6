"""One mcap file of a bag while it is written; a bag has several where it is split."""

from __future__ import annotations

import contextlib
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

from mcap.writer import CompressionType, Writer

from rotary_error_monitor.bags.metadata import FileEntry, channel_metadata, qos_profiles
from rotary_error_monitor.bags.storage import RecordFile, Reserve
from rotary_error_monitor.description.wire_section import Qos
from rotary_error_monitor.signals.blocks import NANOSECONDS

CHUNK_SIZE = 1 << 20
"""Messages are gathered to chunks of this many bytes, 1 MiB as in other writers, or of one flush period.

The index of a file holds a kilobyte of memory for each chunk, and what a kill may cost is bounded by time."""

LIBRARY = "rotary_error_monitor"
_INDEX_PER_CHUNK = 73
"""Bytes of a chunk index by mcap's specification: opcode, eight numbers of 64 bits, two lengths of 32."""

_INDEX_PER_CHANNEL = 10
"""Bytes that each channel of the chunk adds to it: a 16-bit identifier and a 64-bit offset."""

_EARLIER = 1 << 63
"""Timestamp (ns) that every message is before: those of ROS 2 are signed 64 bits."""

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
        full_at: size in bytes from which what follows belongs to the next file.
        full_from_ns: timestamp (ns) from which it does; both infinite for never, and before the first message.
    """

    def __init__(
        self,
        folder: Path,
        name: str,
        topics: Sequence[Recordable],
        definitions: Mapping[str, str],
        reserve: Reserve,
        compression: CompressionType = CompressionType.NONE,
        limits: tuple[int, float] = (0, 0.0),
    ) -> None:
        """Create the file `name` in `folder`; `definitions` are those of the topics' types.

        Full is what has as many bytes as `limits` say, or lasts as long (s); 0 for either has no limit.
        """
        self.name = name
        self.full_at = self.full_from_ns = math.inf
        self._largest, self._longest_ns = limits[0] or math.inf, round(limits[1] * NANOSECONDS) or math.inf
        self.counts: Counter[str] = Counter()
        self._compression = compression
        self.file = RecordFile(folder / name, reserve)
        self._first_ns, self._last_ns = _EARLIER, -_EARLIER
        try:
            self._begin(topics, definitions)
        except OSError:
            with contextlib.suppress(OSError):
                self.file.close()
            raise

    @property
    def entry(self) -> FileEntry:
        """What `metadata.yaml` says of the file."""
        times = (self._first_ns, self._last_ns) if self.counts else (0, 0)
        return FileEntry(self.name, self.counts.total(), *times)

    @property
    def index_size(self) -> int:
        """Bytes that must be free so that the chunk at hand and the index of all chunks can be written."""
        per_chunk = _INDEX_PER_CHUNK + _INDEX_PER_CHANNEL * len(self._channels)
        return _MARGIN * CHUNK_SIZE + self.file.chunks * per_chunk

    def add(self, topic: str, data: bytes, log_time_ns: int, publish_time_ns: int, sequence: int) -> None:
        """Append a message; times are timestamps (ns)."""
        self._writer.add_message(self._channels[topic], log_time_ns, data, publish_time_ns, sequence)
        self.counts[topic] += 1
        if log_time_ns > self._last_ns:  # as nearly always
            self._last_ns = log_time_ns
        if log_time_ns < self._first_ns:
            self._first_ns, self.full_from_ns = log_time_ns, log_time_ns + self._longest_ns
            self.full_at = self._largest

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
