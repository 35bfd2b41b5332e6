"""Records of an mcap file that may end anywhere and hold anything: recorder killed, disk full, bytes turned over."""

from __future__ import annotations

import mmap
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Message, Schema
from mcap.writer import MCAP0_MAGIC

from rotary_error_monitor.bags.unpacking import MOST_AT_ONCE, Budget, DamageError, check_size, unpack
from rotary_error_monitor.errors import InputError

Record = Schema | Channel | Message

PREFIX = struct.Struct("<BQ")  # opcode, length
MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_CHUNK = struct.Struct("<QQQII")  # start time, end time, size unpacked, checksum, length of the packing's name
_LENGTH = struct.Struct("<Q")
_CHUNK_INDEX = struct.Struct("<QQQ")  # start time, end time, where the chunk lies
_FOOTER = struct.Struct("<QQI")  # where the index begins, where its offsets do, checksum of the index
_OPCODES = frozenset(int(opcode) for opcode in Opcode)
_IN_CHUNKS = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
_UNREADABLE = (McapError, struct.error, UnicodeDecodeError, ValueError, EOFError)


@dataclass
class Extent:
    """How far a file can be read.

    Attributes:
        size: bytes of the file.
        readable: bytes up to the end of the last whole record or message, the whole file where it is complete.
        complete: whether the file has its end.
        damaged: records in the middle that could not be read and were left out, and an index that does not fit.
        indexed: whether the index at the end of a complete file fits its content; messages are read without it.
        problem: why the first of the damaged records could not be read.
    """

    size: int = 0
    readable: int = 0
    complete: bool = False
    damaged: int = 0
    indexed: bool = True
    problem: str = ""


@dataclass
class _Index:
    """What the index of a file says, beside what there is."""

    chunks: list[int] = field(default_factory=list)
    messages: int = 0
    chunks_said: list[int] = field(default_factory=list)
    messages_said: int | None = None
    checksum_fits: bool = True

    def problem(self) -> str:
        """What does not fit; empty where all does."""
        if not self.checksum_fits:
            return "the checksum of the index does not fit"
        if self.chunks_said and sorted(self.chunks_said) != self.chunks:
            return "the index does not name the chunks that are there"
        if self.messages_said is not None and self.messages_said != self.messages:
            return f"the index says {self.messages_said} messages where there are {self.messages}"
        return ""


@dataclass
class TornFile:
    """One mcap file, read from its start as far as it goes; `extent` is right once all records have been taken."""

    path: Path
    extent: Extent = field(default_factory=Extent)

    def records(self) -> Iterator[Record]:
        """Schemas, channels and messages in the order of the file; whole messages of a chunk that is cut off count too.

        Raises:
            InputError: the file is no mcap file, or unpacked more than a recording of its size becomes.
        """
        for opcode, payload in self.entries():
            try:
                record = parse_record(opcode, payload)
            except _UNREADABLE as error:
                self._note(str(error))
            else:
                yield record

    def entries(self, *, verify: bool = True) -> Iterator[tuple[int, memoryview]]:
        """The same as opcode and bytes; `verify` is whether checksums and index are held against the content.

        Raises:
            InputError: as `records`.
        """
        content = _content(self.path)
        size = len(content)
        self.extent = Extent(size=size)
        if size == 0:
            return
        if content[: len(MCAP0_MAGIC)] != MCAP0_MAGIC[:size]:
            raise InputError(f"{self.path}: no mcap file; it starts with {bytes(content[:8])!r}")
        budget, index, footer = Budget(self.path, size), _Index(), False
        for opcode, payload, end in _walk(content, len(MCAP0_MAGIC)):
            whole = end <= size
            try:
                if opcode == Opcode.CHUNK:
                    index.chunks += [end - len(payload) - PREFIX.size] if whole else []
                    entries = _chunk(payload, budget, verify) if whole else self._cut_chunk(payload)
                    for inner, part in entries:
                        index.messages += inner == Opcode.MESSAGE
                        yield inner, part
                elif whole and opcode in _IN_CHUNKS:
                    _check_length(opcode, payload)
                    index.messages += opcode == Opcode.MESSAGE
                    yield opcode, payload
                elif whole and verify:
                    _note_index(opcode, payload, content, end, index)
            except InputError:
                raise
            except _UNREADABLE as error:
                if whole:  # a record that is cut off is no damage of its own
                    self._note(f"{Opcode(opcode).name.lower()} at byte {end - len(payload)}: {error}")
            footer |= opcode == Opcode.FOOTER
            if whole:
                self.extent.readable = end
        if footer and content[self.extent.readable :] == MCAP0_MAGIC:
            self.extent.readable, self.extent.complete = size, True
            if verify and not self.extent.damaged and index.problem():
                self.extent.indexed = False
                self._note(index.problem())

    def _note(self, problem: str) -> None:
        self.extent.damaged += 1
        self.extent.problem = self.extent.problem or problem

    def _cut_chunk(self, payload: memoryview) -> Iterator[tuple[int, memoryview]]:
        packing, _, _, content = _opened(payload)
        if packing:
            return  # cut off in its middle it cannot be unpacked
        for opcode, inner, end in _walk(content, 0):
            if end <= len(content):
                if opcode in _IN_CHUNKS:
                    _check_length(opcode, inner)
                    yield opcode, inner
                self.extent.readable = self.extent.size - len(content) + end


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


def _content(path: Path) -> memoryview:
    """The file's bytes, as the disk gives them."""
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"{path}: no mcap file; it is a folder or a device")
        with path.open("rb") as file:
            empty = not path.stat().st_size
            return memoryview(b"" if empty else mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}); give a bag that can be read") from error


def _walk(content: memoryview, position: int) -> Iterator[tuple[int, memoryview, int]]:
    """Opcode, payload and end of each record; the last may end behind the content, its payload is then cut."""
    while position + PREFIX.size <= len(content):
        opcode, length = PREFIX.unpack_from(content, position)
        if opcode not in _OPCODES:
            return  # blocks that never reached the disk read as zeros
        position += PREFIX.size
        yield opcode, content[position : position + length], position + length
        position += length


def _chunk(payload: memoryview, budget: Budget, verify: bool) -> Iterator[tuple[int, memoryview]]:
    """Entries of a whole chunk."""
    packing, size, checksum, data = _opened(payload)
    if packing:
        check_size(size)
        budget.take(size)
    content = memoryview(unpack(data, packing, size))
    if verify and checksum and zlib.crc32(content) != checksum:
        raise DamageError("its checksum does not fit its content")
    position = 0
    for opcode, inner, end in _walk(content, 0):
        if end > len(content):
            break
        if opcode in _IN_CHUNKS:
            _check_length(opcode, inner)
            yield opcode, inner
        position = end
    if position != len(content):
        raise DamageError(f"its last {len(content) - position} bytes are no record")


def _opened(payload: memoryview) -> tuple[str, int, int, memoryview]:
    """Packing of a chunk, its size unpacked, its checksum, and its data."""
    _, _, size, checksum, length = _CHUNK.unpack_from(payload)
    start = _CHUNK.size + length
    packing = bytes(payload[_CHUNK.size : start]).decode()
    (count,) = _LENGTH.unpack_from(payload, start)
    return packing, size, checksum, payload[start + _LENGTH.size : start + _LENGTH.size + count]


def _check_length(opcode: int, payload: memoryview) -> None:
    if opcode == Opcode.MESSAGE and len(payload) < MESSAGE.size:
        raise DamageError(f"a message of {len(payload)} bytes; expected at least {MESSAGE.size}")
    if len(payload) > MOST_AT_ONCE:
        raise DamageError(f"{len(payload)} bytes; at most {MOST_AT_ONCE} are read at once")


def _note_index(opcode: int, payload: memoryview, content: memoryview, end: int, index: _Index) -> None:
    """Take down what a record says of others."""
    if opcode == Opcode.CHUNK_INDEX:
        index.chunks_said.append(_CHUNK_INDEX.unpack_from(payload)[2])
    elif opcode == Opcode.STATISTICS:
        (index.messages_said,) = _LENGTH.unpack_from(payload)
    elif opcode == Opcode.FOOTER:
        start, _, checksum = _FOOTER.unpack_from(payload)
        last = end - len(payload) + _FOOTER.size - 4  # it covers the footer up to itself
        index.checksum_fits = not checksum or zlib.crc32(content[start:last]) == checksum
