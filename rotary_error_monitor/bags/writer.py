"""Writing a rosbag2 bag (mcap, version 9) that outlives its recorder: killed, or out of disk space."""

from __future__ import annotations

import contextlib
import errno
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn, Self

from mcap.writer import CompressionType

from rotary_error_monitor.bags.kept_files import KeptFile, KeptFiles, check_kept
from rotary_error_monitor.bags.lock import BagLock, holder
from rotary_error_monitor.bags.metadata import TopicEntry, qos_profiles, type_definition, write_metadata
from rotary_error_monitor.bags.part import BagPart, Recordable
from rotary_error_monitor.bags.storage import RecordFile, Reserve
from rotary_error_monitor.codec.contents import TYPES, Content, complete_ns
from rotary_error_monitor.codec.messages import encode
from rotary_error_monitor.description.wire import Wire
from rotary_error_monitor.description.wire_section import Qos
from rotary_error_monitor.errors import InputError

RESERVE = ".reserve"
REMOVED = "files removed for what shall be kept at most"
"""What the bag calls the files that went."""
DEFAULT_QOS = Qos("reliable", "volatile", "keep_last", 10)
_SEQUENCES = 1 << 32  # mcap has 32 bits for the number of a message


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

    The writer has the bag for itself until it is closed or its process ends: neither another writer nor a recovery
    takes it meanwhile. Where somebody renames the folder, recording goes on in it; where somebody removes it, or the
    file at hand, recording stops.

    Attributes:
        folder: the bag.
        stopped: why recording ended by itself, None while it goes on.
        notes: what `metadata.yaml` shall say of the recording beside what rosbag2 expects, texts by name.
        locked: False where the file system knows no locks, so that nobody is kept away.
    """

    def __init__(
        self,
        folder: Path | str,
        topics: Iterable[Recordable],
        *,
        flush_period: float = 0.2,
        sync_period: float = 1.0,
        max_file_size: int = 0,
        max_file_duration: float = 0.0,
        keep_size: int = 0,
        keep_duration: float = 0.0,
        compression: str = "none",
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Create the bag with its `metadata.yaml`.

        Args:
            folder: new folder of the bag; its parents are made.
            topics: every topic that will be written; their types are standard messages.
            flush_period: longest time (s) that a message stays in the process.
            sync_period: time (s) between requests to the disk to store what was written.
            max_file_size: bytes from which the next file is begun; 0 for one file. The index of a file is kept in
                memory until its end, so that recordings without an end want one of these bounds.
            max_file_duration: time (s) from the first message of a file after which the next is begun; 0 for one file.
            keep_size: bytes that all files together may take: when a file ends, the oldest go until the next one has
                room; 0 for all.
            keep_duration: time (s) after which a file goes, at the end of another; 0 for never.
            compression: of the chunks, zstd, lz4 or none.
            clock: monotonic time (s).

        Raises:
            InputError: the folder exists, a type is not known, or what shall be kept is less than two files.
            OSError: the folder cannot be written, or the disk has no room for a recording.
        """
        self.folder = Path(folder)
        self.stopped: str | None = None
        self.notes: dict[str, str] = {}
        self._topics = {topic.name: topic for topic in topics}
        self._definitions = {topic.type: _definition(topic) for topic in self._topics.values()}
        check_kept(keep_size, keep_duration, max_file_size, max_file_duration)
        self._limits, self._periods = (max_file_size, max_file_duration), (flush_period, sync_period)
        self._compression = CompressionType[compression.upper()]
        self._clock = clock
        self._flushed = self._synced = clock()
        self._closed = False
        self._name = self.folder.resolve().name
        self._kept = KeptFiles(keep_size, keep_duration)
        self._counts_before: Counter[str] = Counter()
        self._ending: list[RecordFile] = []
        self._begin()

    def _begin(self) -> None:
        """Make the folder and begin its first file; where that fails, leave nothing locked or reserved."""
        self._lock = _new_folder(self.folder)
        self._home, self.locked = self._lock.path, self._lock.held
        with ExitStack() as undo:
            undo.callback(self._lock.release)
            self._reserve = Reserve(self._lock.place / RESERVE)
            undo.callback(self._reserve.release)
            self._part = self._new_part()
            undo.callback(self._abandon)
            self._write_metadata()
            undo.pop_all()
        self._keep_reserve()

    @property
    def moved(self) -> Path | None:
        """Where the folder is now, if somebody has renamed it."""
        path = None if self._closed else self._lock.path
        return path if path != self._home else None

    @property
    def counts(self) -> Counter[str]:
        """Messages written, by topic, those in files that went included."""
        return self._counts_before + self._part.counts

    @property
    def size(self) -> int:
        """Bytes in all files that are there."""
        return self._kept.size + self._part.file.tell()

    def write(
        self, topic: str, data: bytes, log_time_ns: int, publish_time_ns: int | None = None, sequence: int = 0
    ) -> None:
        """Append a message.

        Args:
            topic: name of one of the bag's topics.
            data: CDR bytes of the message.
            log_time_ns: timestamp (ns) at which it was received.
            publish_time_ns: timestamp (ns) at which it was published, by default the same.
            sequence: its number among those of its publisher, 0 where that is not known.

        Raises:
            InputError: the bag has no such topic.
            RecordingStoppedError: the disk is full or broken; what was written before is kept and the bag is closed.
        """
        if self._closed:
            self._check_open()
        if topic not in self._topics:
            raise InputError(f"{self.folder}: topic {topic} is not recorded; recorded are {', '.join(self._topics)}")
        publish_time_ns = log_time_ns if publish_time_ns is None else publish_time_ns
        part = self._part
        if log_time_ns >= part.full_from_ns or part.file.size >= part.full_at:
            self._split(log_time_ns)
        try:
            self._part.add(topic, data, log_time_ns, publish_time_ns, sequence % _SEQUENCES)
        except OSError as error:
            self._stop(error, whole=False)
        if self._clock() - self._flushed >= self._periods[0]:
            self.flush()
        elif self._ending or self._part.file.trouble is not None:
            self._check_trouble()

    def flush(self) -> None:
        """Hand everything over to the operating system, and to the disk when that is due.

        Raises:
            RecordingStoppedError: the disk is full or broken, or the bag was removed; what was written before is kept
                where it was not removed, and the bag is closed.
        """
        self._check_open()
        now = self._flushed = self._clock()
        try:
            self._part.flush()
            self._close_ended()
        except OSError as error:
            self._stop(error, whole=False)
        self._check_there()
        if now - self._synced >= self._periods[1]:
            self._synced = now
            self._part.file.sync()
        self._keep_reserve()

    def write_notes(self) -> None:
        """Bring `notes` to `metadata.yaml` now; where that cannot be written, they come with the next one."""
        self._check_open()
        with contextlib.suppress(OSError):
            self._write_metadata()

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

    def __exit__(self, *_: object) -> None:
        self.close()

    def _new_part(self) -> BagPart:
        """The next file; none is left where it cannot be begun."""
        name = f"{self._name}_{self._kept.begun}.mcap"
        topics = tuple(self._topics.values())
        try:
            part = BagPart(
                self._lock.place, name, topics, self._definitions, self._reserve, self._compression, self._limits
            )
        except OSError:
            with contextlib.suppress(OSError):
                (self._lock.place / name).unlink(missing_ok=True)
            raise
        self._kept.begun += 1
        return part

    def _split(self, now_ns: int) -> None:
        """Go on in a new file; where that cannot be made, the old one is ended all the same."""
        full = self._part
        try:
            self._part = self._new_part()
        except OSError as error:
            self._stop(error, whole=True)
        self._counts_before += full.counts
        self._ending.append(full.file)  # not its index, which is written now
        try:
            full.finish()
            self._kept.add(KeptFile(full.entry, full.file.tell(), full.counts))
            if self._kept.remove_old(self._lock.place, self._limits[0] or full.file.tell(), now_ns):
                self.notes[REMOVED] = self._kept.told()
            self._write_metadata()
        except OSError as error:
            self._stop(error, whole=False)
        self._check_trouble()

    def _close_ended(self) -> None:
        """Let go of the files that the disk has stored meanwhile, and hear whether it could."""
        while self._ending and self._ending[0].ended:
            self._ending.pop(0).close()

    def _check_trouble(self) -> None:
        """A disk that took the last message out of the reserve takes no other."""
        for file in (*self._ending, self._part.file):
            if file.trouble is not None:
                self._stop(file.trouble, whole=True)

    def _check_there(self) -> None:
        """What somebody removed can be written to for ever, and is nowhere."""
        if self._lock.path is None:
            self._stop(OSError(errno.ENOENT, "the folder was removed"), kept="what was recorded is gone with it")
        if self._part.file.removed:
            count = self._part.counts.total()
            self._stop(
                OSError(errno.ENOENT, f"{self._part.name} was removed"),
                kept=f"its {count} messages are gone with it",
            )

    def _keep_reserve(self) -> None:
        """Room for the index of all chunks, and for the chunk at hand."""
        self._part.file.reserve(self._part.index_size)
        self._check_trouble()

    def _check_open(self) -> None:
        if self.stopped is not None:
            raise RecordingStoppedError(self.stopped)
        if self._closed:
            raise InputError(f"{self.folder}: the bag is closed; nothing more can be written to it")

    def _finish(self) -> None:
        self._part.finish()
        for file in (*self._ending, self._part.file):
            file.close()
        self._write_metadata()
        self._let_go()

    def _let_go(self) -> None:
        """The bag is everybody's again."""
        self._closed = True
        self._reserve.release()
        self._lock.release()

    def _abandon(self) -> None:
        """Close all files as they are, on a disk that already failed."""
        for file in (*self._ending, self._part.file):
            with contextlib.suppress(OSError):
                file.close()
        self._let_go()

    def _stop(self, error: OSError, *, whole: bool = False, kept: str = "") -> NoReturn:
        """End the recording with what is written.

        Args:
            error: why.
            whole: whether every message at hand got into the files.
            kept: what became of the recording, where that is something else than the usual.
        """
        if whole:
            try:
                self._finish()
            except OSError:
                whole = False
        if not self._closed:
            self._abandon()
        self.stopped = f"{self.folder}: recording stopped: {error.strerror or error}; " + (
            kept
            or (
                f"the bag is complete up to here with {self.counts.total()} messages"
                if whole
                else "what was written is kept, but the bag has no index: make room and recover it"
            )
        )
        raise RecordingStoppedError(self.stopped) from error

    def _write_metadata(self) -> None:
        counts = self.counts - self._kept.removed
        topics = [TopicEntry(t.name, t.type, qos_profiles(t.qos), counts[t.name]) for t in self._topics.values()]
        write_metadata(self._lock.place, topics, [*self._kept, self._part.entry], self.notes)


def _new_folder(folder: Path) -> BagLock:
    """The lock of a folder that was not there before."""
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        by = holder(folder)
        raise InputError(
            f"{folder}: exists already{f' and {by} has it' if by else ''}; give the path of a new bag"
        ) from None
    return BagLock(folder)


def write_messages(
    folder: Path | str,
    contents: Mapping[str, Sequence[Content]],
    wire: Wire | None = None,
    notes: Mapping[str, str] | None = None,
) -> None:
    """Write a whole bag, every message recorded when it was complete: a block with its last sample.

    Args:
        folder: new folder of the bag.
        contents: what goes on each topic; a topic without contents is one of the wire contract.
        wire: gives topics their quality of service and blocks their frame; other topics are written too.
        notes: what else the bag says of itself, texts by name.

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
        ((complete_ns(value), name, value) for name, values in contents.items() for value in values),
        key=lambda row: row[:2],
    )
    with BagWriter(folder, topics) as writer:
        writer.notes |= notes or {}
        for time_ns, name, value in rows:
            writer.write(name, encode(value, known[name].frame if name in known else ""), time_ns)


def _definition(topic: Recordable) -> str:
    definition = type_definition(topic.type)
    if not definition:
        raise InputError(
            f"topic {topic.name}: {topic.type} is no standard message of ROS 2; its definition is not known"
        )
    return definition
