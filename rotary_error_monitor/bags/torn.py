"""Records of an mcap file that may end anywhere: recorder killed, disk full, power lost."""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import CRCValidationError, get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

from rotary_error_monitor.errors import InputError

Record = Schema | Channel | Message

_PREFIX = struct.Struct("<BQ")  # opcode, length
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_OPCODES = frozenset(int(opcode) for opcode in Opcode)
_UNREADABLE = (McapError, CRCValidationError, struct.error, UnicodeDecodeError, ValueError, EOFError, RuntimeError)


@dataclass
class Extent:
    """How far a file can be read.

    Attributes:
        size: bytes of the file.
        readable: bytes up to the end of the last whole record or message, the whole file where it is complete.
        complete: whether the file has its end.
        damaged: records in the middle that could not be read and were left out.
    """

    size: int = 0
    readable: int = 0
    complete: bool = False
    damaged: int = 0


@dataclass
class TornFile:
    """One mcap file, read from its start as far as it goes; `extent` is right once all records have been taken."""

    path: Path
    extent: Extent = field(default_factory=Extent)

    def records(self) -> Iterator[Record]:
        """Schemas, channels and messages in the order of the file; whole messages of a chunk that is cut off count too.

        Raises:
            InputError: the file is no mcap file.
        """
        size = self.path.stat().st_size
        self.extent = Extent(size=size)
        if size == 0:
            return
        with self.path.open("rb") as file:
            content = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
        if content[: len(MCAP0_MAGIC)] != MCAP0_MAGIC[:size]:
            raise InputError(f"{self.path}: no mcap file; it starts with {bytes(content[:8])!r}")
        footer = False
        for opcode, payload, end in _walk(content, len(MCAP0_MAGIC)):
            footer |= opcode == Opcode.FOOTER
            yield from self._read(opcode, payload, whole=end <= size)
            if end <= size:
                self.extent.readable = end
        if footer and content[self.extent.readable :] == MCAP0_MAGIC:
            self.extent.readable, self.extent.complete = size, True

    def _read(self, opcode: int, payload: memoryview, *, whole: bool) -> Iterator[Record]:
        try:
            if opcode == Opcode.CHUNK:
                yield from _chunk_records(payload) if whole else self._cut_chunk_records(payload)
            elif whole:
                yield from _record(opcode, payload)
        except _UNREADABLE:
            self.extent.damaged += whole  # a record that is cut off is no damage of its own

    def _cut_chunk_records(self, payload: memoryview) -> Iterator[Record]:
        chunk = Chunk.read(ReadDataStream(BytesIO(payload)))
        if chunk.compression:
            return  # cut off in its middle it cannot be unpacked
        content = memoryview(chunk.data)
        for opcode, inner, end in _walk(content, 0):
            if end <= len(content):
                yield from _record(opcode, inner)
                self.extent.readable = self.extent.size - len(content) + end


def _walk(content: memoryview, position: int) -> Iterator[tuple[int, memoryview, int]]:
    """Opcode, payload and end of each record; the last may end behind the content, its payload is then cut."""
    while position + _PREFIX.size <= len(content):
        opcode, length = _PREFIX.unpack_from(content, position)
        if opcode not in _OPCODES:
            return  # blocks that never reached the disk read as zeros
        position += _PREFIX.size
        yield opcode, content[position : position + length], position + length
        position += length


def _chunk_records(payload: memoryview) -> Iterator[Record]:
    stream, length = get_chunk_data_stream(Chunk.read(ReadDataStream(BytesIO(payload))), validate_crc=True)
    content = memoryview(stream.read(length))
    for opcode, inner, end in _walk(content, 0):
        if end <= len(content):
            yield from _record(opcode, inner)


def _record(opcode: int, payload: memoryview) -> Iterator[Record]:
    if opcode == Opcode.MESSAGE:
        channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(payload)
        yield Message(
            channel_id=channel,
            sequence=sequence,
            log_time=log_time,
            publish_time=publish_time,
            data=bytes(payload[_MESSAGE.size :]),
        )
    elif opcode == Opcode.SCHEMA:
        yield Schema.read(ReadDataStream(BytesIO(payload)))
    elif opcode == Opcode.CHANNEL:
        yield Channel.read(ReadDataStream(BytesIO(payload)))
