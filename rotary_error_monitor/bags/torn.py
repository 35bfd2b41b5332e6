"""Records of an mcap file that may end anywhere and hold anything: recorder killed, disk full, bytes turned over."""

from __future__ import annotations

import mmap
import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Header, Message, Schema

from rotary_error_monitor.bags.outline import DAMAGED, TORN, Outline, Part
from rotary_error_monitor.bags.records import IN_CHUNKS, MESSAGE, PREFIX, UNREADABLE, chunk_head, inner_records
from rotary_error_monitor.bags.unpacking import MOST_AT_ONCE, Budget
from rotary_error_monitor.errors import InputError

Record = Schema | Channel | Message

PROFILE = "ros2"
"""What a bag of ROS 2 says in its header; without it some readers refuse it."""

_LENGTH = struct.Struct("<Q")
_CHUNK_INDEX = struct.Struct("<QQQ")  # start time, end time, where the chunk lies
_LARGEST_END = 1 << 20
"""Bytes of a message that was begun last: more of them may hide others, behind a length that is damaged."""


_MOST_HELD = 1 << 25
"""Bytes of a file that stay in memory behind what is read: else a file takes as much of it as it is long."""


@dataclass
class Extent:
    """How much of a file can be read; its bytes are those that are readable, left out, or at its end.

    Attributes:
        size: bytes of the file.
        readable: bytes of whole records and messages.
        left_out: bytes before the end that could not be read.
        at_end: bytes at the end that hold no whole record or message.
        complete: whether the file has its end.
        damaged: places where something could not be read, is not as long as it says, or contradicts the index.
        indexed: whether the damage is one of the index, or of what lies around the messages: all these were read.
        problem: what is wrong at the first of the damaged places.
        torn: whether what is lacking is the end of a recording that was not closed, and no more.
        messages_said: how many messages there were when the file was closed; None where that is not known.
        profile: what the file says that its messages are.
    """

    size: int = 0
    readable: int = 0
    left_out: int = 0
    at_end: int = 0
    complete: bool = False
    damaged: int = 0
    indexed: bool = True
    problem: str = ""
    torn: bool = True
    messages_said: int | None = None
    profile: str = PROFILE


@dataclass
class _Index:
    """What the index of a file says, beside what there is.

    `of_data` is whether something is damaged before the end of the data, `chunk_lost` whether what begins like a chunk
    is; `footer` whether there is a footer.
    """

    chunks: list[int] = field(default_factory=list)
    messages: int = 0
    chunks_said: list[int] = field(default_factory=list)
    messages_said: int | None = None
    data_ended: bool = False
    of_data: bool = False
    chunk_lost: bool = False
    footer: bool = False

    def note(self, part: Part) -> None:
        """Take down what a record says of others."""
        if part.opcode == Opcode.CHUNK_INDEX:
            self.chunks_said.append(_CHUNK_INDEX.unpack_from(part.payload)[2])
        elif part.opcode == Opcode.STATISTICS:
            (self.messages_said,) = _LENGTH.unpack_from(part.payload)
        self.data_ended |= part.opcode == Opcode.DATA_END
        self.footer |= part.opcode == Opcode.FOOTER

    def problem(self) -> str:
        """What does not fit; empty where all does."""
        if self.chunks_said and sorted(self.chunks_said) != self.chunks:
            return "the index does not name the chunks that are there"
        if self.messages_said is not None and self.messages_said != self.messages:
            return f"the index says {self.messages_said} messages where there are {self.messages}"
        return ""


@dataclass
class TornFile:
    """One mcap file, read from its start as far as it goes; `extent` is right once all records have been taken.

    Where `end` is given, only so many bytes are read: what a recorder appends meanwhile is left alone.
    """

    path: Path
    end: int | None = None
    extent: Extent = field(default_factory=Extent)

    def records(self) -> Iterator[Record]:
        """Schemas, channels and messages in the order of the file; whole messages of a chunk that is cut off count too.

        Raises:
            InputError: the file is no mcap file, or unpacked more than a recording of its size becomes.
        """
        for opcode, payload in self.entries():
            try:
                record = parse_record(opcode, payload)
            except UNREADABLE as error:
                self._note(str(error))
            else:
                yield record

    def entries(self) -> Iterator[tuple[int, memoryview]]:
        """The same as opcode and bytes.

        Where something is damaged, the schemas and channels of the index come first: the others may be gone.

        Raises:
            InputError: as `records`.
        """
        content = _content(self.path, self.end)
        size = len(content)
        extent = self.extent = Extent(size=size)
        if size == 0:
            return
        outline, index = Outline(content, Budget(self.path, size)), _Index()
        passed = 0
        for part in outline.parts():
            if part.start - passed >= _MOST_HELD:
                _forget(content, passed, part.start)
                passed = part.start
            if part.opcode == DAMAGED and part.start == 0 and part.end >= outline.limit:
                raise InputError(f"{self.path}: no mcap file; it starts with {bytes(content[:8])!r}")
            if part.problem and not extent.damaged:
                yield from _named_in_index(content, outline)
            if part.problem:
                self._note(part.problem)
                index.of_data |= not index.data_ended
            if part.opcode == Opcode.CHUNK:
                yield from self._chunk(part, index)
            elif part.opcode == TORN:
                yield from self._end(part, index)
            elif part.opcode == DAMAGED:
                extent.left_out += part.end - part.start
                extent.torn &= index.data_ended
                index.chunk_lost |= part.payload[0] == Opcode.CHUNK
            elif part.opcode in IN_CHUNKS:
                index.messages += part.opcode == Opcode.MESSAGE
                yield part.opcode, part.payload
            else:
                index.note(part)
                if part.opcode == Opcode.HEADER:
                    extent.profile = _profile(part.payload)
        extent.complete = outline.closed and index.footer
        extent.readable = size - extent.left_out - extent.at_end
        if extent.complete:
            self._judge(index, outline)
        _forget(content, 0, size)

    def _chunk(self, part: Part, index: _Index) -> Iterator[tuple[int, memoryview]]:
        """What is in a chunk; of one without a checksum up to where its records do not follow one another."""
        index.chunks.append(part.start)
        last = 0
        for opcode, payload, end in inner_records(part.payload, careful=not part.checked):
            index.messages += opcode == Opcode.MESSAGE
            last = end
            yield opcode, payload
        rest = len(part.payload) - last
        if rest:
            self._note(f"chunk at byte {part.start + PREFIX.size}: its last {rest} bytes are no record")
            index.of_data = True
        if rest and not part.checked:
            self.extent.left_out += min(rest, part.end - part.start)
            self.extent.torn = False

    def _end(self, part: Part, index: _Index) -> Iterator[tuple[int, memoryview]]:
        """What is in a chunk that is cut off; one that is packed cannot be unpacked then."""
        content, last = part.payload, 0
        head = chunk_head(content, 0) if content[0] == Opcode.CHUNK else None
        if head is not None and not head.packing:
            for opcode, payload, end in inner_records(content[head.start :]):
                index.messages += opcode == Opcode.MESSAGE
                last = head.start + end
                yield opcode, payload
            last_whole = max(last, head.start)
            if not _is_cut(content[last_whole:]):
                self._note(f"no record at byte {part.start + last_whole}")
                self.extent.torn = False
        self.extent.at_end = len(content) - last

    def _judge(self, index: _Index, outline: Outline) -> None:
        """Hold the content of a file that has its end against what its index says."""
        extent = self.extent
        extent.messages_said = index.messages_said if outline.index else None
        if extent.damaged:
            everything = extent.messages_said == index.messages and not index.chunk_lost
            extent.indexed = index.of_data and not everything
            return
        problem = index.problem() if outline.index or not outline.checksum else "the checksum of the index does not fit"
        if problem:
            extent.indexed = False
            self._note(problem)

    def _note(self, problem: str) -> None:
        self.extent.damaged += 1
        self.extent.problem = self.extent.problem or problem


def _forget(content: memoryview, first: int, last: int) -> None:
    """Let go of the memory that holds bytes of a file that were read; who reads them again gets them from the file."""
    if isinstance(content.obj, mmap.mmap):
        first -= first % mmap.PAGESIZE
        content.obj.madvise(mmap.MADV_DONTNEED, first, last - first)


def parse_record(opcode: int, payload: memoryview) -> Record:
    """The record of an entry.

    Raises:
        McapError, ValueError, EOFError, struct.error: the bytes are no such record.
    """
    if opcode == Opcode.MESSAGE:
        channel, sequence, log_time, publish_time = MESSAGE.unpack_from(payload)
        return Message(
            channel_id=channel,
            sequence=sequence,
            log_time=log_time,
            publish_time=publish_time,
            data=bytes(payload[MESSAGE.size :]),
        )
    stream = ReadDataStream(BytesIO(payload))
    record: Record = Schema.read(stream) if opcode == Opcode.SCHEMA else Channel.read(stream)
    return record


def _content(path: Path, end: int | None) -> memoryview:
    """The file's bytes up to some end, as the disk gives them."""
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"{path}: no mcap file; it is a folder or a device")
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            end = size if end is None else end
            if size < end:
                raise InputError(f"{path}: it became shorter while it was read ({size} of {end} bytes); read it again")
            return memoryview(mmap.mmap(file.fileno(), end, access=mmap.ACCESS_READ) if end else b"")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}); give a bag that can be read") from error


def _named_in_index(content: memoryview, outline: Outline) -> Iterator[tuple[int, memoryview]]:
    """Schemas and channels that the index repeats."""
    position, end = outline.index or (0, 0)
    while position < end:
        opcode, length = PREFIX.unpack_from(content, position)
        position += PREFIX.size + length
        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            yield opcode, content[position - length : position]


def _profile(header: memoryview) -> str:
    try:
        return str(Header.read(ReadDataStream(BytesIO(header))).profile)
    except UNREADABLE:
        return ""


def _is_cut(rest: memoryview) -> bool:
    """Whether what is left of a chunk is the beginning of a record, or blocks that never reached the disk (zeros)."""
    if len(rest) < PREFIX.size:
        return True
    opcode, length = PREFIX.unpack_from(rest)
    end = PREFIX.size + length
    if opcode in IN_CHUNKS and end > len(rest):
        return len(rest) <= _LARGEST_END and bool(length <= MOST_AT_ONCE)
    after = rest[end:] if opcode in IN_CHUNKS else rest
    return bytes(after).count(0) == len(after)
