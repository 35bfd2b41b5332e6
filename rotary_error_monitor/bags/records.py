"""Single records of an mcap file: whether bytes are one, and whether a chunk is whole by its sizes and checksum."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from io import BytesIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Header, Schema, Statistics

from rotary_error_monitor.bags.unpacking import MOST_AT_ONCE, Budget, DamageError, check_size, unpack

MAGIC = b"\x89MCAP0\r\n"
"""First and last bytes of an mcap file (its specification, version 0). The library has them where it writes: what only
reads need not load that."""

PREFIX = struct.Struct("<BQ")  # opcode, length
MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
OPCODES = frozenset(int(opcode) for opcode in Opcode)
IN_CHUNKS = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
UNREADABLE = (McapError, struct.error, UnicodeDecodeError, ValueError, EOFError)

_CHUNK = struct.Struct("<QQQII")  # start time, end time, size unpacked, checksum, length of the packing's name
_LENGTH = struct.Struct("<Q")
_MESSAGE_INDEX = struct.Struct("<HI")  # channel, bytes of entries of 16 bytes each
_SIZES: Mapping[int, int] = {Opcode.DATA_END: 4, Opcode.FOOTER: 20, Opcode.SUMMARY_OFFSET: 17}
_READERS: Mapping[int, Callable[[ReadDataStream], object]] = {
    Opcode.HEADER: Header.read,
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.STATISTICS: Statistics.read,
    Opcode.CHUNK_INDEX: ChunkIndex.read,
}
_RARE = (Opcode.ATTACHMENT, Opcode.ATTACHMENT_INDEX, Opcode.METADATA, Opcode.METADATA_INDEX)
_PACKINGS = (b"", b"lz4", b"zstd")
CHUNK_HEAD = re.compile(rb"\x06(?=.{24}.{5}\0{3}.{4}(?:\0{4}|\x03\0{3}lz4|\x04\0{3}zstd).{5}\0{3})", re.DOTALL)
"""Where a chunk may begin: an opcode, a head with a packing that is known, sizes below a terabyte."""


def fits(opcode: int, payload: memoryview) -> bool:
    """Whether a record, no chunk and no message, is as long as its content says."""
    if opcode in _SIZES:
        return len(payload) == _SIZES[opcode]
    if opcode == Opcode.MESSAGE_INDEX:
        if len(payload) < _MESSAGE_INDEX.size:
            return False
        _, size = _MESSAGE_INDEX.unpack_from(payload)
        return bool(size == len(payload) - _MESSAGE_INDEX.size and size % 16 == 0)
    if opcode in _RARE:
        return True
    if opcode not in _READERS or len(payload) > MOST_AT_ONCE:
        return False
    stream = ReadDataStream(BytesIO(payload))
    try:
        _READERS[opcode](stream)
    except UNREADABLE:
        return False
    return int(stream.count) == len(payload)


@dataclass(frozen=True)
class ChunkHead:
    """What the head of a chunk says: packing, size unpacked, checksum (0: none), and where its data lie."""

    packing: str
    size: int
    checksum: int
    start: int
    end: int


def chunk_head(content: memoryview, position: int) -> ChunkHead | None:
    """Head of the chunk whose record begins at `position`; None where there is none of a packing that is known."""
    at = position + PREFIX.size
    if at + _CHUNK.size > len(content):
        return None
    _, _, size, checksum, length = _CHUNK.unpack_from(content, at)
    at += _CHUNK.size
    if length > 4 or at + length + _LENGTH.size > len(content):
        return None
    name = bytes(content[at : at + length])
    if name not in _PACKINGS:
        return None
    (count,) = _LENGTH.unpack_from(content, at + length)
    start = at + length + _LENGTH.size
    return ChunkHead(name.decode(), size, checksum, start, start + count)


def unpacked(head: ChunkHead, data: memoryview, budget: Budget) -> memoryview:
    """Content of a chunk's data, held against its checksum where it has one.

    Raises:
        DamageError: it cannot be unpacked, or does not fit.
        InputError: the file is larger, unpacked, than any recording of its size.
    """
    if head.packing:
        check_size(head.size)
        budget.take(head.size)
    content = memoryview(unpack(data, head.packing, head.size))
    if head.checksum and zlib.crc32(content) != head.checksum:
        raise DamageError("its checksum does not fit its content")
    return content


def inner_records(content: memoryview, *, careful: bool = True) -> Iterator[tuple[int, memoryview, int]]:
    """Opcode, payload and end of each record of a chunk.

    With `careful` only as far as each is followed by another, or by the end: of a chunk without a checksum, or one that
    is cut off, nothing else tells that a record ends where it says.
    """
    position, size = 0, len(content)
    while position + PREFIX.size <= size:
        opcode, length = PREFIX.unpack_from(content, position)
        end = position + PREFIX.size + length
        if opcode not in IN_CHUNKS or end > size or (opcode == Opcode.MESSAGE and length < MESSAGE.size):
            return
        if careful and end < size and content[end] not in IN_CHUNKS:
            return
        if careful and end + PREFIX.size <= size and PREFIX.unpack_from(content, end)[1] > MOST_AT_ONCE:
            return
        yield opcode, content[position + PREFIX.size : end], end
        position = end


def is_tiled(content: memoryview) -> bool:
    """Whether the content of a chunk is records from its beginning to its end."""
    return max((end for _, _, end in inner_records(content)), default=0) == len(content)
