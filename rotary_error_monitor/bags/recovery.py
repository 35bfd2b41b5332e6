"""Making the bag of a killed recorder readable for every reader again."""

from __future__ import annotations

import itertools
import os
import shutil
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from mcap.records import Channel, Message, Schema
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import Reader

from rotary_error_monitor.bags.coverage import BagCoverage
from rotary_error_monitor.bags.listing import bag_files, count_remarks, distinct, own_files, read_listing
from rotary_error_monitor.bags.lock import BagLock, writer_of
from rotary_error_monitor.bags.marks import METADATA
from rotary_error_monitor.bags.metadata import (
    FileEntry,
    TopicEntry,
    channel_profiles,
    read_metadata,
    write_metadata,
)
from rotary_error_monitor.bags.part import LIBRARY
from rotary_error_monitor.bags.records import MAGIC
from rotary_error_monitor.bags.torn import PROFILE, Extent, TornFile
from rotary_error_monitor.bags.writer import RESERVE
from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.files import exists

CHUNK_SIZE = 1 << 18
_BEGINNING = 1 << 16
"""Bytes of a file in which a recording that was stopped at once may have no whole message."""

_RECOVERING = ".recovering"
KEPT = ".damaged"
_MISSING = "files missing when the bag was recovered"
_LEFT_OUT = "damaged when the bag was recovered"


@dataclass(frozen=True)
class RecoveryReport:
    """What a recovery did.

    Attributes:
        path: the bag, or the file that was recovered alone.
        counts: messages that can be read, by topic.
        rewritten: names of the files that had no end or were damaged; none where the bag was whole.
        lost: bytes at the end of files that held no whole message.
        left_out: bytes before that could not be read.
        damaged: places where something could not be read and was left out, or contradicted the index.
        kept: names under which damaged files lie beside what was recovered from them.
        missing: files that `metadata.yaml` told of and that are not there.
        remarks: what a recovery cannot mend: files that are missing, counts that did not fit, what the recorder noted.
        whole: whether no more is gone than the torn end of a recording that was not closed.
    """

    path: Path
    counts: Counter[str]
    rewritten: tuple[str, ...]
    lost: int
    damaged: int
    left_out: int = 0
    kept: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    whole: bool = True

    def __str__(self) -> str:
        if self.missing and not self.rewritten:
            return f"{self.path}: {self.counts.total()} messages; the files that are there are whole"
        if not self.rewritten:
            return (
                f"{self.path}: the {'file' if self.path.is_file() else 'bag'} is whole, {self.counts.total()} messages"
            )
        return (
            f"{self.path}: recovered {self.counts.total()} messages on {len(self.counts)} topics; without "
            f"{self.lost} bytes at the end"
            + (
                f" and {self.damaged} damaged record{'s' * (self.damaged != 1)} ({self.left_out} bytes before the end)"
                if self.damaged
                else ""
            )
            + (f"; kept as it was: {', '.join(self.kept)}" if self.kept else "")
        )


def recover(bag: Path | str) -> RecoveryReport:
    """Make a bag readable by rosbag2, rosbags and mcap, whatever moment its recorder was killed at.

    Each mcap file without an end is written anew beside the old one, stored on the disk, and takes its place in one
    step: at every moment the bag holds either the old file or the new. Where more is left out than the end of a
    recording that was not closed, the old one is kept beside it as well. A bag that is whole is left as it is, but for
    a `metadata.yaml` that is missing or does not say what the files hold.

    Args:
        bag: folder of the bag, or an mcap file. A file that is all of the bag in its folder means the bag; any other is
            recovered alone, and nothing else in its folder is touched.

    Raises:
        InputError: there is no bag of mcap files, or the file is one of several of a bag; somebody is recording or
            recovering it; what is left holds no whole message (all stays as it is then), or the disk has no room for a
            copy of a file.
        OSError: the folder cannot be written.
    """
    path = Path(bag)
    if path.is_file():
        if path.suffix != ".mcap":
            raise InputError(f"{path}: no mcap file to recover; its name does not end with .mcap")
        with BagLock(path.parent):
            return _recover_alone(path)
    if not path.is_dir() or not bag_files(path):
        there = "no mcap file to recover" if exists(path) else "no such bag"
        raise InputError(f"{excerpt(path)}: {there}; give the folder of a rosbag2 bag, or an mcap file")
    with BagLock(path):
        return _recover(path)


def _recover_alone(path: Path) -> RecoveryReport:
    """Recover one file; with its bag, where it is all of it."""
    folder = path.parent
    listing = read_listing(folder)
    own = own_files(folder, listing) if listing.files else []
    if path.name in [file.name for file in own]:
        if len(own) == 1:
            return _recover(folder)
        raise InputError(
            f"{path}: one of {len(own)} files of the bag {folder}; its {METADATA} counts them together, so recover the "
            "folder"
        )
    _check_unused(path, [path])
    coverage = BagCoverage()
    (content,) = _recover_files(path, [path], coverage)
    remarks = [f"{path}: {_LEFT_OUT}: {content.damage()}"] if content.kept else []
    if exists(folder / METADATA) and not listing.files:
        remarks.append(
            f"{folder / METADATA} cannot be read and was left as it was; recover the folder if it is the bag's"
        )
    return _report(path, [content], (*remarks, *coverage.remarks()))


def _check_unused(path: Path, files: list[Path]) -> None:
    recorder = writer_of(files)
    if recorder:  # one that takes no lock, such as rosbag2's own
        raise InputError(f"{path}: {recorder} has its files open to write; let it end first")


def _recover(folder: Path) -> RecoveryReport:
    listing = read_listing(folder)
    files, _ = distinct(own_files(folder, listing) or bag_files(folder))
    _check_unused(folder, files)
    missing = listing.missing(folder)
    coverage = BagCoverage()
    contents = _recover_files(folder, files, coverage)
    (folder / RESERVE).unlink(missing_ok=True)
    counts = sum((content.counts() for content in contents), Counter[str]())
    rewritten = tuple(content.path.name for content in contents if content.torn)
    notes = dict(listing.notes)
    damages = [content.damage() for content in contents if content.kept]
    if damages:
        notes[_LEFT_OUT] = "; ".join([*filter(None, [notes.get(_LEFT_OUT, "")]), *damages])
    if missing:
        notes[_MISSING] = ", ".join(sorted({*missing, *filter(None, notes.get(_MISSING, "").split(", "))}))
    remarks = [f"{folder}: {name}: {text}" for name, text in notes.items()]
    remarks += coverage.remarks()
    if listing.counts and not rewritten and not missing:
        remarks += [f"{folder}: {remark}; it was put right" for remark in count_remarks(listing, counts)]
    listed = listing.files == tuple(file.name for file in files)
    if rewritten or notes != listing.notes or not listed or not _metadata_fits(folder, counts):
        write_metadata(folder, _topics(contents), [content.entry() for content in contents], notes)
    return _report(folder, contents, remarks, missing)


def _report(
    path: Path, contents: list[_FileContent], remarks: Iterable[str], missing: tuple[str, ...] = ()
) -> RecoveryReport:
    return RecoveryReport(
        path=path,
        counts=sum((content.counts() for content in contents), Counter[str]()),
        rewritten=tuple(content.path.name for content in contents if content.torn),
        lost=sum(content.extent.at_end for content in contents),
        damaged=sum(content.extent.damaged for content in contents),
        left_out=sum(content.extent.left_out for content in contents),
        kept=tuple(content.kept for content in contents if content.kept),
        missing=missing,
        remarks=tuple(remarks),
        whole=all(content.whole for content in contents),
    )


@dataclass
class _FileContent:
    """What one mcap file holds."""

    path: Path
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    channel_counts: Counter[int] = field(default_factory=Counter)
    start_ns: int = 0
    end_ns: int = 0
    extent: Extent = field(default_factory=Extent)
    torn: bool = False
    strays: int = 0
    whole: bool = True
    kept: str = ""

    def add(self, record: Schema | Channel | Message) -> bool:
        """Count a record; False for one that was already there, or that belongs to a channel that is lost."""
        if isinstance(record, Schema):
            return self.schemas.setdefault(record.id, record) is record
        if isinstance(record, Channel):
            return self.channels.setdefault(record.id, record) is record
        if record.channel_id not in self.channels:
            self.strays += 1
            return False
        first = not self.channel_counts
        self.start_ns = record.log_time if first else min(self.start_ns, record.log_time)
        self.end_ns = record.log_time if first else max(self.end_ns, record.log_time)
        self.channel_counts[record.channel_id] += 1
        return True

    def topic_of(self, message: Message) -> tuple[str, str]:
        """Topic and type of a message that was added."""
        channel = self.channels[message.channel_id]
        schema = self.schemas.get(channel.schema_id)
        return channel.topic, schema.name if schema else ""

    def counts(self) -> Counter[str]:
        """Messages by topic."""
        counts: Counter[str] = Counter()
        for channel, count in self.channel_counts.items():
            counts[self.channels[channel].topic] += count
        return counts

    def damage(self) -> str:
        """What of the file was left out, in words."""
        count, extent = self.channel_counts.total(), self.extent
        of = "" if extent.messages_said is None else f" of {extent.messages_said}"
        return (
            f"{self.path.name}: {extent.problem or 'its end is lost'}; recovered were {count}{of} messages, without "
            f"{extent.left_out + extent.at_end} bytes; the file as it was is {self.kept}"
        )

    def lack(self) -> str:
        """Name and size of a file without a whole message, and what is wrong with it where that is known."""
        problem = f" ({self.extent.problem})" if self.extent.problem else ""
        return f"{self.path.name} of {self.extent.size} bytes{problem}"

    def entry(self) -> FileEntry:
        return FileEntry(self.path.name, self.channel_counts.total(), self.start_ns, self.end_ns)


def _recover_files(bag: Path, files: list[Path], coverage: BagCoverage) -> list[_FileContent]:
    """Content of the files of a bag, which afterwards have their ends; what they cover is noted."""
    contents = [_read_file(file, coverage) for file in files]
    if any(content.torn for content in contents) and not any(content.channel_counts for content in contents):
        found = "; ".join(content.lack() for content in contents)
        raise InputError(f"{bag}: nothing to recover, all stays as it is: no whole message in {found}")
    for content in contents:
        if content.torn:
            _rewrite(content)
    return contents


def _read_file(path: Path, coverage: BagCoverage) -> _FileContent:
    """Content of a file as it is; what it covers is noted."""
    torn = TornFile(path)
    content = _FileContent(path)
    for record in torn.records():
        if content.add(record) and isinstance(record, Message):
            coverage.note(*content.topic_of(record), record.data)
    extent = content.extent = torn.extent
    content.torn = not extent.complete or extent.damaged > 0 or content.strays > 0 or extent.profile != PROFILE
    if content.torn:
        nothing = not content.channel_counts and extent.at_end > len(MAGIC)
        everything = extent.complete and (not extent.indexed or not extent.damaged) and not content.strays
        content.whole = everything or (extent.torn and not content.strays and not (nothing and _is_large(extent)))
    if content.strays:
        extent.damaged += 1
        extent.problem = extent.problem or f"{content.strays} messages of topics that the file does not name"
    return content


def _is_large(extent: Extent) -> bool:
    """Whether most of a file is its torn end, which is more than the beginning of a recording."""
    return extent.at_end > max(extent.readable, _BEGINNING)


def _rewrite(content: _FileContent) -> None:
    """Put what could be read in the place of a file; one of which more is gone than its torn end is kept beside it."""
    path = content.path
    room, size = shutil.disk_usage(path.parent).free, path.stat().st_size
    if room < size:
        raise InputError(f"{path}: recovery writes a copy of {size} bytes, but the disk has {room} free; make room")
    temporary = path.with_name(path.name + _RECOVERING)
    try:
        with temporary.open("wb") as file:
            _copy(TornFile(path), Writer(file, CHUNK_SIZE, CompressionType.NONE))
            file.flush()
            os.fsync(file.fileno())
        if not content.whole:
            content.kept = _keep(path)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def _keep(path: Path) -> str:
    """Give a file a second name, which is returned; on a disk where a file has but one, this is its only one."""
    for number in itertools.count(1):
        kept = path.with_name(path.name + KEPT + (f".{number}" if number > 1 else ""))
        try:
            os.link(path, kept, follow_symlinks=True)
        except FileExistsError:
            continue
        except OSError:
            if exists(kept):
                continue
            path.rename(kept)
        return kept.name
    raise AssertionError("unreachable")


def _copy(torn: TornFile, writer: Writer) -> None:
    writer.start(profile=PROFILE, library=LIBRARY)
    seen = _FileContent(torn.path)
    schemas: dict[int, int] = {0: 0}  # in mcap schema 0 is none
    channels: dict[int, int] = {}
    for record in torn.records():
        if not seen.add(record):
            continue
        if isinstance(record, Schema):
            schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel):
            channels[record.id] = writer.register_channel(
                record.topic, record.message_encoding, schemas.get(record.schema_id, 0), record.metadata
            )
        else:
            writer.add_message(
                channels[record.channel_id], record.log_time, record.data, record.publish_time, record.sequence
            )
    writer.finish()  # type: ignore[no-untyped-call]


def _topics(contents: list[_FileContent]) -> list[TopicEntry]:
    counts = sum((content.counts() for content in contents), Counter[str]())
    topics = {}
    for content in contents:
        for channel in content.channels.values():
            schema = content.schemas.get(channel.schema_id)
            topics[channel.topic] = TopicEntry(
                channel.topic, schema.name if schema else "", channel_profiles(channel), counts[channel.topic]
            )
    return list(topics.values())


def _metadata_fits(folder: Path, counts: Counter[str]) -> bool:
    """Whether `metadata.yaml` is there and counts what the files hold."""
    if not (folder / METADATA).is_file():
        return False
    try:
        read_metadata(folder)  # which has limits on what it costs
        with Reader(folder) as reader:
            said = Counter({connection.topic: connection.msgcount for connection in reader.connections})
    # Whatever the parser trips over, metadata that cannot be read is written anew.
    except Exception:
        return False
    return +said == +counts
