"""The files of a bag, and how much of them can be read."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rotary_error_monitor.bags.listing import bag_files, distinct, own_files
from rotary_error_monitor.bags.lock import holder, writer_of
from rotary_error_monitor.bags.marks import METADATA, SUFFIXES
from rotary_error_monitor.bags.metadata import BagMetadata, read_metadata
from rotary_error_monitor.bags.recorded_files import FileContent, RawMessage, open_file
from rotary_error_monitor.bags.unpacking import DamageError, unpack
from rotary_error_monitor.errors import InputError, excerpt, one_line

ENCODING = "cdr"
"""Encoding of messages that is read: that of ROS 2."""


@dataclass(frozen=True)
class TopicContent:
    """Type of a topic, how many messages the bag holds of it, and the type's definition where the bag has it."""

    type: str
    count: int
    definition: str = ""
    encoding: str = ENCODING


class BagFiles:
    """The files of a bag, one after another.

    Attributes:
        topics: type and number of messages by topic.
        sizes: bytes of messages by topic.
        damage: what cannot be read; None where all can.
        metadata: what `metadata.yaml` says.
        remarks: what is odd about the files and costs nothing.
    """

    def __init__(self, path: Path) -> None:
        remarks: list[str] = []
        paths, self.metadata = _files_of(path, remarks)
        paths, again = distinct(paths)
        self.remarks = (f"{path}: {_named_again(again)}; each file was read once",) if again else ()
        self._files = [open_file(each) for each in paths]
        contents = [file.survey() for file in self._files]
        for found in contents:
            _check_whole(path, found)
        self.topics: dict[str, TopicContent] = {}
        self.sizes: Counter[str] = Counter()
        for found in contents:
            self.sizes += found.sizes
            for name, msgtype in found.types.items():
                before = self.topics.get(
                    name, TopicContent(msgtype, 0, found.definitions[msgtype], found.encodings[name])
                )
                self.topics[name] = replace(before, count=before.count + found.counts[name])
        self.damage: str | None = "; ".join([*_torn(path, contents), *remarks]) or None

    def messages(self, names: Collection[str]) -> Iterator[RawMessage]:
        """Messages of these topics, in the order of their recording."""
        for file in self._files:
            if not self.metadata.packing:
                yield from file.messages(names)
                continue
            for message in file.messages(names):
                try:
                    yield message._replace(data=bytes(unpack(message.data, self.metadata.packing)))
                except DamageError as error:
                    raise InputError(
                        f"{file.path}: {one_line(message.topic)}, recorded at {message.log_time_ns} ns: {error}"
                    ) from error


def _files_of(path: Path, remarks: list[str]) -> tuple[list[Path], BagMetadata]:
    """The files of a bag in order, and what its metadata says; what is odd goes to the remarks."""
    if not path.is_dir():
        return [path], BagMetadata()
    there = bag_files(path, SUFFIXES) or sorted(path.glob("*.mcap"))  # a folder of that name is told where it is read
    try:
        metadata = read_metadata(path)
    except InputError as error:
        if not there:
            raise InputError(f"{path}: no readable bag: {error}") from error
        if (path / METADATA).exists():
            remarks.append(f"{error}; read without it were {excerpt(', '.join(file.name for file in there))}")
        return there, BagMetadata()
    missing = dict.fromkeys(metadata.missing(path))
    files = [path / name for name in metadata.files if name not in missing]
    # a recorder that was killed may have begun a file of which its metadata does not know yet
    files += [file for file in own_files(path, metadata, SUFFIXES) if file.name not in metadata.files]
    files = files or there
    if not files:
        raise InputError(
            f"{path}: no readable bag: none of its files is there: {excerpt(', '.join(missing)) or 'no name'}"
        )
    if missing:
        remarks.append(
            f"{path}: {METADATA} tells of {excerpt(', '.join(missing))}, which "
            f"{'is' if len(missing) == 1 else 'are'} not there"
        )
    return files, metadata


def _named_again(names: Sequence[str]) -> str:
    are = "is" if len(names) == 1 else "are"
    return f"{excerpt(', '.join(names))} {are} named more than once, or other names of the same file"


def _check_whole(path: Path, found: FileContent) -> None:
    """A file that has its end and lost something before it is to be recovered first: nobody expects a hole in it."""
    if found.complete and found.indexed and found.damaged:
        raise InputError(
            f"{path}: damaged: {excerpt(found.path.name)}: {excerpt(found.problem)}; recover the bag and read it "
            f"again; {_readable([found])}"
        )


def _readable(contents: Sequence[FileContent]) -> str:
    """How much of some files can be read."""
    counts = sum((found.counts for found in contents), Counter[str]())
    readable, size = sum(found.readable for found in contents), sum(found.size for found in contents)
    topics = {name for found in contents for name in found.types}
    return f"readable are {counts.total()} messages on {len(topics)} topics, {readable} of {size} bytes"


def _torn(path: Path, contents: Sequence[FileContent]) -> Iterator[str]:
    """What is said of files that have no end, and of those whose index is damaged."""
    if not all(found.complete for found in contents):
        torn = [found for found in contents if not found.complete]
        damaged = sum(found.damaged for found in torn)
        recorder = holder(path if path.is_dir() else path.parent) or writer_of(found.path for found in torn)
        state = f"{recorder} is recording it" if recorder else "the recording was not closed"
        problem = next((found.problem for found in torn if found.problem), "")
        yield (
            f"{path}: {state}; {_readable(contents)}"
            + (f", without {damaged} damaged record{'s' * (damaged != 1)} in between" if damaged else "")
            + (f" ({problem})" if problem else "")
        )
    for found in contents:
        if not found.indexed:
            yield f"{path}: {found.path.name}: {found.problem}; all messages were read without it; recover the bag"
