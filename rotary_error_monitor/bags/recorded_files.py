"""The files of a bag, mcap or sqlite3, packed or not: what each says that it holds, and its messages."""

from __future__ import annotations

import itertools
import sqlite3
import tempfile
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, NamedTuple, Protocol
from urllib.parse import quote

import zstandard
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from rotary_error_monitor.bags.records import MESSAGE
from rotary_error_monitor.bags.torn import TornFile, parse_record
from rotary_error_monitor.bags.unpacking import MOST_AT_ONCE, Budget
from rotary_error_monitor.errors import InputError, excerpt

_SQLITE, _ZSTD = b"SQLite format 3\x00", b"\x28\xb5\x2f\xfd"
_MSG = "ros2msg"
_PART = 1 << 20
MOST_TOPICS = 10_000
"""Topics of a bag: a large robot has hundreds."""

_STEPS, _STEPS_AT_ONCE = 20, 10_000
"""Steps of the database's machine for each byte of the file, and how often they are counted: a row of the least size
has about as many bytes as reading it takes steps. Pages that name one another in circles take more."""


class RawMessage(NamedTuple):
    """A message as it lies in the bag; `log_time_ns` is the timestamp (ns) at which it was recorded."""

    topic: str
    type: str
    log_time_ns: int
    data: bytes


@dataclass
class FileContent:
    """What one file of a bag holds.

    Attributes:
        path: the file.
        types: message type of each topic, as its first channel says.
        encodings: how the messages of each topic are encoded, by ROS 2 always `cdr`.
        definitions: of the types, where the file has them.
        counts, sizes: messages and their bytes by topic.
        size, readable: bytes of the file, and how many of them can be read.
        complete: whether the file has its end.
        damaged: parts in the middle that cannot be read, an index that does not fit among them.
        indexed: whether the index fits; where it does not, all messages were read nevertheless.
        problem: what is wrong with the first of them.
    """

    path: Path
    types: dict[str, str] = field(default_factory=dict)
    encodings: dict[str, str] = field(default_factory=dict)
    definitions: dict[str, str] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)
    sizes: Counter[str] = field(default_factory=Counter)
    size: int = 0
    readable: int = 0
    complete: bool = True
    damaged: int = 0
    indexed: bool = True
    problem: str = ""

    def add_topic(self, name: str, msgtype: str, encoding: str, definition: str = "") -> None:
        """Take down a channel."""
        self.types.setdefault(name, msgtype)
        self.encodings.setdefault(name, encoding)
        self.definitions.setdefault(self.types[name], definition)
        if len(self.types) > MOST_TOPICS:
            raise InputError(f"{self.path}: more than {MOST_TOPICS} topics; no bag has as many")


class RecordedFile(Protocol):
    """One file of a bag."""

    path: Path

    def survey(self) -> FileContent:
        """Go through the file once.

        Raises:
            InputError: it cannot be read, or costs more than a recording of its size.
        """

    def messages(self, names: Collection[str]) -> Iterator[RawMessage]:
        """Messages of these topics in the order of the file; what is damaged is left out.

        Raises:
            InputError: as `survey`.
        """


def open_file(path: Path) -> RecordedFile:
    """The file as its first bytes say; one that is packed as a whole is unpacked into a file without a name.

    Raises:
        InputError: it cannot be read, or is larger unpacked than any recording of its size.
    """
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"{path}: no file of a bag; it is a folder or a device")
        with path.open("rb") as file:
            head = file.read(len(_SQLITE))
            if head.startswith(_ZSTD):
                return _Unpacked(path, file)
        return SqliteFile(path) if head == _SQLITE else McapFile(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}); give a bag that can be read") from error


class McapFile:
    """An mcap file, whole or torn; what is appended to it later is none of it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file = TornFile(path, path.stat().st_size)

    def survey(self) -> FileContent:
        """As `RecordedFile.survey`."""
        found, channels, strays = FileContent(self.path), _Channels(), 0
        for opcode, payload in self._file.entries():
            if opcode != Opcode.MESSAGE:
                channels.add(opcode, payload, found)
                continue
            channel = channels.known.get(int.from_bytes(payload[:2], "little"))
            if channel is None:
                strays += 1
            else:
                found.counts[channel[0]] += 1
                found.sizes[channel[0]] += len(payload) - MESSAGE.size
        extent = self._file.extent
        found.size, found.readable, found.complete = extent.size, extent.readable, extent.complete
        found.damaged, found.indexed, found.problem = extent.damaged, extent.indexed, extent.problem
        found.damaged += strays + channels.unreadable
        found.indexed |= strays + channels.unreadable > 0
        if strays and not found.problem:
            found.problem = f"{strays} messages of topics that the file does not name"
        return found

    def messages(self, names: Collection[str]) -> Iterator[RawMessage]:
        """As `RecordedFile.messages`."""
        channels, content = _Channels(), FileContent(self.path)
        for opcode, payload in self._file.entries():
            if opcode != Opcode.MESSAGE:
                channels.add(opcode, payload, content)
                continue
            number, _, log_time, _ = MESSAGE.unpack_from(payload)
            channel = channels.known.get(number)
            if channel is not None and channel[0] in names:
                yield RawMessage(*channel, log_time, bytes(payload[MESSAGE.size :]))


class _Channels:
    """Topic and type of each channel, as the file goes on."""

    def __init__(self) -> None:
        self.known: dict[int, tuple[str, str]] = {}
        self.unreadable = 0
        self._schemas: dict[int, Schema] = {}

    def add(self, opcode: int, payload: memoryview, content: FileContent) -> None:
        try:
            record = parse_record(opcode, payload)
        # Whatever the bytes of a name, a number or a length are, the parser's error is one of many.
        except Exception as error:
            self.unreadable += 1
            content.problem = content.problem or f"{Opcode(opcode).name.lower()}: {excerpt(error)}"
            return
        if isinstance(record, Schema):
            self._schemas.setdefault(record.id, record)
        elif isinstance(record, Channel) and record.id not in self.known:
            schema = self._schemas.get(record.schema_id)
            definition = schema.data.decode(errors="replace") if schema and schema.encoding == _MSG else ""
            self.known[record.id] = record.topic, schema.name if schema else ""
            content.add_topic(*self.known[record.id], record.message_encoding, definition)


class SqliteFile:
    """A sqlite3 file, opened so that nothing can be written to it; tables that are computed are refused."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._count = (
            0  # of messages there were: those that a recorder appends later are none of the bag that was opened
        )

    def survey(self) -> FileContent:
        """As `RecordedFile.survey`."""
        size = self.path.stat().st_size
        found = FileContent(self.path, size=size, readable=size)
        with self._opened() as database:
            topics = self._topics(database, found)
            for topic, count, total in database.execute(
                "SELECT topic_id, count(*), sum(length(data)) FROM messages NOT INDEXED GROUP BY topic_id"
            ):
                if topic not in topics:
                    raise self._damaged(f"{count} messages of topics that it does not name")
                found.counts[topics[topic][0]] += count
                found.sizes[topics[topic][0]] += int(total or 0)
        self._count = found.counts.total()
        if found.sizes.total() > size:
            raise self._damaged(f"{found.sizes.total()} bytes of messages in a file of {size}")
        for rest in ("-wal", "-journal"):
            beside = self.path.with_name(self.path.name + rest)
            found.complete &= not (beside.is_file() and beside.stat().st_size)
        return found

    def messages(self, names: Collection[str]) -> Iterator[RawMessage]:
        """As `RecordedFile.messages`."""
        left = self.path.stat().st_size
        with self._opened() as database:
            topics = self._topics(database, FileContent(self.path))
            for number, log_time, data in database.execute(
                "SELECT topic_id, timestamp, data FROM messages NOT INDEXED LIMIT ?", (self._count,)
            ):
                if not isinstance(log_time, int) or not isinstance(data, bytes) or number not in topics:
                    raise self._damaged(f"a message of topic {excerpt(number)} recorded at {excerpt(log_time)}")
                left -= len(data)
                if left < 0:
                    raise self._damaged("more bytes of messages than it has")
                if topics[number][0] in names:
                    yield RawMessage(*topics[number], log_time, data)

    def _topics(self, database: sqlite3.Connection, content: FileContent) -> dict[int, tuple[str, str]]:
        """Name and type of each topic by its number."""
        tables = {
            name: sql
            for name, sql in database.execute("SELECT name, sql FROM sqlite_master WHERE type = 'table' LIMIT 1000")
            if name in ("topics", "messages", "message_definitions")
        }
        for name in ("topics", "messages"):
            if name not in tables:
                raise InputError(f"{self.path}: no bag of ROS 2: it has no table '{name}'")
        for name, sql in tables.items():
            hidden = [row[6] for row in database.execute(f"PRAGMA table_xinfo({name})")]
            if any(hidden) or not str(sql).upper().startswith("CREATE TABLE"):
                raise InputError(f"{self.path}: table '{name}' computes what it holds; no recorder writes such a file")
        definitions = {}
        if "message_definitions" in tables:
            rows = database.execute("SELECT topic_type, encoding, encoded_message_definition FROM message_definitions")
            definitions = {name: text for name, encoding, text in rows if encoding == _MSG and isinstance(text, str)}
        topics: dict[int, tuple[str, str]] = {}
        for row in database.execute("SELECT id, name, type, serialization_format FROM topics"):
            number, *texts = row
            if not isinstance(number, int) or number in topics or not all(isinstance(text, str) for text in texts):
                raise self._damaged(f"topic {excerpt(row)}")
            name, msgtype, encoding = texts
            topics[number] = name, msgtype
            content.add_topic(name, msgtype, encoding, definitions.get(msgtype, ""))
        return topics

    @contextmanager
    def _opened(self) -> Iterator[sqlite3.Connection]:
        size = self.path.stat().st_size
        steps = itertools.count()
        most = (1_000_000 + _STEPS * size) // _STEPS_AT_ONCE
        try:
            database = sqlite3.connect(f"file:{quote(str(self.path.resolve()))}?mode=ro&immutable=1", uri=True)
        except sqlite3.Error as error:
            raise InputError(f"{self.path}: cannot be read ({error}); give a bag that can be read") from error
        try:
            database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MOST_AT_ONCE)
            database.set_progress_handler(lambda: next(steps) > most, _STEPS_AT_ONCE)
            database.execute("PRAGMA trusted_schema = OFF")
            database.execute("PRAGMA cell_size_check = ON")
            yield database
        except (sqlite3.Error, sqlite3.Warning, OverflowError, UnicodeDecodeError) as error:
            raise self._damaged(str(error)) from error
        finally:
            database.close()

    def _damaged(self, problem: str) -> InputError:
        return InputError(f"{self.path}: damaged: {excerpt(problem)}")


class _Unpacked:
    """A file that was packed as a whole: unpacked into a temporary file, which goes with this object."""

    def __init__(self, path: Path, packed: IO[bytes]) -> None:
        self.path = path
        self._place = tempfile.NamedTemporaryFile(prefix="unpacked_")  # noqa: SIM115 (it lives as long as this object)
        budget = Budget(path, path.stat().st_size)
        packed.seek(0)
        try:
            with zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True) as content:
                while part := content.read(_PART):
                    budget.take(len(part))
                    self._place.write(part)
            self._place.flush()
        except zstandard.ZstdError as error:
            raise InputError(f"{path}: damaged: it cannot be unpacked: {error}") from error
        inner = Path(self._place.name)
        with inner.open("rb") as file:
            self._file = SqliteFile(inner) if file.read(len(_SQLITE)) == _SQLITE else McapFile(inner)

    def survey(self) -> FileContent:
        """As `RecordedFile.survey`."""
        with self._named():
            return self._file.survey()

    def messages(self, names: Collection[str]) -> Iterator[RawMessage]:
        """As `RecordedFile.messages`."""
        with self._named():
            yield from self._file.messages(names)

    @contextmanager
    def _named(self) -> Iterator[None]:
        try:
            yield
        except InputError as error:
            raise InputError(str(error).replace(str(self._file.path), str(self.path))) from error
