"""The parts of an mcap file that may end anywhere and be damaged anywhere: its records, and what lies between them.

Where a record is not as long as it says, the next place is looked for from which on the file can be read: a chunk whose
checksum fits (or, without one, whose records fill it), the end of the data, or the index. The index of the chunks is
not needed for that, and would mislead where bytes were lost or came in before them.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from mcap.opcode import Opcode

from rotary_error_monitor.bags.records import (
    CHUNK_HEAD,
    IN_CHUNKS,
    MAGIC,
    MESSAGE,
    OPCODES,
    PREFIX,
    ChunkHead,
    chunk_head,
    fits,
    is_tiled,
    unpacked,
)
from rotary_error_monitor.bags.unpacking import MOST_AT_ONCE, Budget, DamageError

DAMAGED = 0
"""Opcode of a part that is no record."""

TORN = -1
"""Opcode of what is left at the end of a file without its end."""

_MAGIC = len(MAGIC)
_FOOTER = struct.Struct("<QQI")  # where the index begins, where its offsets do, checksum of the index
_DATA_END = re.compile(rb"\x0f\x04\0{7}.{4}(?=[\x02\x03\x04\x08\x0a\x0b\x0d\x0e])", re.DOTALL)
_LOOSE_MESSAGE = re.compile(rb"\x05(?=.{5}\0{3})", re.DOTALL)
_CHAIN = 3  # records in a row that show a message outside of chunks, which no checksum does
_LARGEST_CUT = 1 << 16
"""Bytes of a record, no chunk, that a recorder may have begun: more of them are no torn end, but damage."""


MOST_PLACES = 10_000
"""Damaged places after which a file is not read on: each of them is looked at for a way out."""

_TRIAL = 100  # what a place costs at which a record could begin, as bytes that are looked at


@dataclass(frozen=True)
class Part:
    """Bytes from `start` to `end` of a file.

    Attributes:
        opcode: of a record; `DAMAGED` or `TORN`.
        payload: of a record; the content of a chunk is unpacked.
        checked: of a chunk, whether its checksum fits.
        problem: why it is damaged, or was read although something is wrong with it.
    """

    opcode: int
    start: int
    end: int
    payload: memoryview
    checked: bool = False
    problem: str = ""


class Outline:
    """Goes through a file.

    Attributes:
        closed: whether the file has its end.
        limit: where the end begins.
    """

    def __init__(self, content: memoryview, budget: Budget) -> None:
        self._content, self._budget, self._size = content, budget, len(content)
        tail = self._size - _MAGIC
        footer = tail - PREFIX.size - _FOOTER.size
        self.closed = (
            footer >= _MAGIC
            and content[tail:] == MAGIC
            and PREFIX.unpack_from(content, footer) == (Opcode.FOOTER, _FOOTER.size)
        )
        self.limit = tail if self.closed else self._size
        self._footer = footer
        self._loose = False
        self._trials = MOST_AT_ONCE + 2 * self._size
        self._data_end: tuple[int, int | None] = (0, -1)

    def parts(self) -> Iterator[Part]:
        """All bytes of the file behind its magic (if it has one), before that of its end."""
        position = 0
        if self._content[:_MAGIC] == MAGIC[: self._size]:
            position = min(_MAGIC, self._size)
        elif self._size > _MAGIC and self._content[_MAGIC] == Opcode.HEADER and self._plausible(_MAGIC):
            yield self._damage(0, _MAGIC, "its first bytes are damaged")
            position = _MAGIC
        places = 0
        while position < self.limit:
            part = self._record(position)
            places += part.opcode == DAMAGED
            if places > MOST_PLACES:
                part = self._damage(position, self.limit, f"more than {MOST_PLACES} places are damaged")
            self._loose |= part.opcode in IN_CHUNKS
            yield part
            position = part.end

    @cached_property
    def chunked(self) -> bool:
        """Whether there is a whole chunk; then nothing outside of chunks is a message."""
        return self._next_chunk(0, self.limit) is not None

    @property
    def checksum(self) -> int:
        """Checksum of the index of a closed file; 0 where its writer made none."""
        return int(_FOOTER.unpack_from(self._content, self._footer + PREFIX.size)[2])

    @cached_property
    def index(self) -> tuple[int, int] | None:
        """Where the index begins and ends, wherever that is by now; None without a whole one."""
        if not self.closed:
            return None
        said, _, checksum = _FOOTER.unpack_from(self._content, self._footer + PREFIX.size)
        if _MAGIC < said <= self._footer and self._is_index(said, checksum):
            return said, self._footer
        # what was written is looked through only where the footer is wrong: that takes the whole file into memory
        starts = [found.end() for found in _DATA_END.finditer(self._content)][-8:] if checksum else []
        for start in starts:
            if self._is_index(start, checksum):
                return start, self._footer
        return None

    def _is_index(self, start: int, checksum: int) -> bool:
        if checksum:  # it covers the footer up to itself
            return zlib.crc32(self._content[start : self._footer + PREFIX.size + _FOOTER.size - 4]) == checksum
        while start < self._footer:
            opcode, length = PREFIX.unpack_from(self._content, start)
            end = start + PREFIX.size + length
            if end > self._footer or not fits(opcode, self._content[start + PREFIX.size : end]):
                return False
            start = end
        return start == self._footer

    def _record(self, position: int) -> Part:
        """The record at a place, or what is to be left out there."""
        problem = f"no record at byte {position}"
        if position + PREFIX.size <= self._size:
            opcode, length = PREFIX.unpack_from(self._content, position)
            end = position + PREFIX.size + length
            if opcode == Opcode.CHUNK:
                try:
                    found = self._chunk(position, end)
                except DamageError as error:
                    problem, found = f"chunk at byte {position + PREFIX.size}: {error}", None
                    skipped = self._skipped(position, end)
                    if skipped is not None:
                        return self._damage(position, skipped, problem)
                if found is not None:
                    return found
            elif opcode in OPCODES and end <= self.limit and self._is_record(opcode, position, end):
                return Part(opcode, position, end, self._content[position + PREFIX.size : end])
            elif opcode in OPCODES:
                problem = f"{Opcode(opcode).name.lower()} at byte {position + PREFIX.size}: its length is damaged"
        return self._resumed(position, problem)

    def _is_record(self, opcode: int, position: int, end: int) -> bool:
        if opcode == Opcode.MESSAGE:
            size = end - position - PREFIX.size
            return MESSAGE.size <= size <= MOST_AT_ONCE and self._plausible(end) and not self.chunked
        if self._plausible(end):
            return True
        if not fits(opcode, self._content[position + PREFIX.size : end]):
            return False
        following = self._next(position + 1)  # where bytes were lost, its own length leads into the next record
        return following is None or following >= end

    def _chunk(self, position: int, outer: int) -> Part | None:
        """The chunk at a place, by its own length or by that of its data; None where it is cut off.

        Raises:
            DamageError: it is there, and damaged.
        """
        head = chunk_head(self._content, position)
        if head is None:
            if outer <= self.limit or self.closed:
                raise DamageError("its head is damaged")
            return None
        problem: DamageError | None = None
        for end in dict.fromkeys((head.end, outer)):
            if not head.start <= end <= self.limit:
                continue
            try:
                content = unpacked(head, self._content[head.start : end], self._budget)
            except DamageError as error:
                problem = problem or error
                continue
            if head.checksum:
                wrong = "" if head.end == outer else f"chunk at byte {position + PREFIX.size}: its length is damaged"
                return Part(Opcode.CHUNK, position, end, content, True, wrong)
            if head.end == outer:
                return Part(Opcode.CHUNK, position, end, content)
            problem = problem or DamageError("its length is damaged")
        if problem is None and self.closed:
            raise DamageError("its length is damaged")
        if problem is not None:
            raise problem
        return None

    def _skipped(self, position: int, outer: int) -> int | None:
        """Where a damaged chunk ends, if one of its lengths leads to a record."""
        head = chunk_head(self._content, position)
        for end in (outer, head.end if head else outer):
            if position < end <= self.limit and self._plausible(end):
                return end
        return None

    def _resumed(self, position: int, problem: str) -> Part:
        """What is to be left out from a place on, up to the next that can be read."""
        following = self._next(position + 1)
        if following is None and self.closed:
            following = self._footer if position < self._footer else self.limit
        if following is not None:
            return self._damage(position, following, problem)
        rest = self._content[position : self._size]
        if self._is_torn(rest):
            return Part(TORN, position, self._size, rest)
        return self._damage(position, self._size, problem)

    def _is_torn(self, rest: memoryview) -> bool:
        """Whether it is the beginning of a record, or blocks that never reached the disk, which read as zeros."""
        if len(rest) < PREFIX.size:
            return rest == MAGIC[: len(rest)] or rest[0] in OPCODES or not any(rest)
        opcode, length = PREFIX.unpack_from(rest)
        if opcode == Opcode.CHUNK:
            head = chunk_head(rest, 0)
            return bool(length > len(rest) - PREFIX.size) and (head is None or head.end > len(rest))
        if opcode in OPCODES:
            return len(rest) <= _LARGEST_CUT and len(rest) - PREFIX.size < length <= MOST_AT_ONCE
        return bytes(rest).count(0) == len(rest)

    def _plausible(self, position: int) -> bool:
        """Whether a record begins there, or the file ends."""
        if position == self.limit or position == self._size:
            return True
        if position + PREFIX.size > self._size:
            return position < self._size and not self.closed and self._content[position] in OPCODES
        opcode, length = PREFIX.unpack_from(self._content, position)
        end = position + PREFIX.size + length
        if opcode == Opcode.CHUNK:
            head = chunk_head(self._content, position)
            return head is not None and head.end == end and (end <= self.limit or not self.closed)
        if opcode not in OPCODES or length > MOST_AT_ONCE:
            return False
        if end > self.limit:
            return not self.closed
        if opcode == Opcode.MESSAGE:
            return bool(length >= MESSAGE.size)
        return fits(opcode, self._content[position + PREFIX.size : end])

    def _next(self, start: int) -> int | None:
        """The next place from `start` on that can be read."""
        places = [place for place in (self._next_data_end(start), self.index and self.index[0]) if place is not None]
        ahead = [place for place in places if place >= start]
        limit = min(ahead, default=self.limit)
        found = self._next_chunk(start, limit)
        if found is None and self._loose and not self.chunked:
            found = self._next_loose(start, limit)
        return found if found is not None else min(ahead, default=None)

    def _next_data_end(self, start: int) -> int | None:
        since, place = self._data_end
        if place is None or (since <= start <= place):
            return place
        place = None
        for found in _DATA_END.finditer(self._content, start, self.limit):
            if self._plausible(found.end()):
                place = found.start()
                break
        self._data_end = start, place
        return place

    def _next_chunk(self, start: int, limit: int) -> int | None:
        for found in CHUNK_HEAD.finditer(self._content, start, limit):
            head = chunk_head(self._content, found.start())
            if head is not None and self._is_chunk(found.start(), head):
                return found.start()
            self._trials -= _TRIAL
            if self._trials < 0:
                return None
        return None

    def _is_chunk(self, position: int, head: ChunkHead) -> bool:
        """Whether a whole chunk begins there; what has been tried in vain is limited."""
        outer = position + PREFIX.size + int(PREFIX.unpack_from(self._content, position)[1])
        for end in dict.fromkeys((head.end, outer)):
            data = self._content[head.start : end]
            if not head.start <= end <= self.limit or not (head.packing or len(data) == head.size):
                continue
            if not head.packing and data and data[0] not in IN_CHUNKS:
                continue
            self._trials -= len(data) + (head.size if head.packing else 0)
            try:
                content = unpacked(head, data, self._budget)
            except DamageError:
                continue
            if head.checksum or (head.end == outer and len(content) and is_tiled(content)):
                self._trials += len(data) + (head.size if head.packing else 0)
                return True
        return False

    def _next_loose(self, start: int, limit: int) -> int | None:
        for found in _LOOSE_MESSAGE.finditer(self._content, start, limit):
            position = found.start()
            self._trials -= _TRIAL
            if self._trials < 0:
                return None
            for _ in range(_CHAIN):
                if position == self.limit:
                    break
                if not self._plausible(position) or position + PREFIX.size > self._size:
                    break
                position += PREFIX.size + int(PREFIX.unpack_from(self._content, position)[1])
            else:
                return found.start()
            if position == self.limit:
                return found.start()
        return None

    def _damage(self, start: int, end: int, problem: str) -> Part:
        return Part(DAMAGED, start, end, self._content[start:end], problem=problem)
