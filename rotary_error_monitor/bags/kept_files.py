"""The files that a recording without an end has behind it: the oldest go where it may take no more space or time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from rotary_error_monitor.bags.metadata import FileEntry
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.signals.blocks import NANOSECONDS


@dataclass(frozen=True)
class KeptFile:
    """A file that was ended: what `metadata.yaml` says of it, its size in bytes, its messages by topic."""

    entry: FileEntry
    size: int
    counts: Counter[str]


class KeptFiles:
    """Ended files of one bag, the oldest first.

    Attributes:
        begun: files that the recording has begun, with those that were removed and the one at hand.
        removed: messages by topic that went with files that were removed.
    """

    def __init__(self, most_bytes: int, longest: float) -> None:
        """Keep at most `most_bytes` with the file at hand, and `longest` s; 0 for all."""
        self._most_bytes, self._longest_ns = most_bytes, round(longest * NANOSECONDS)
        self._files: list[KeptFile] = []
        self._gone = 0
        self._gone_until_ns = 0
        self.begun = 0
        self.removed: Counter[str] = Counter()

    def __iter__(self) -> Iterator[FileEntry]:
        return (file.entry for file in self._files)

    def add(self, file: KeptFile) -> None:
        """Take in the file that was ended last."""
        self._files.append(file)

    @property
    def size(self) -> int:
        """Bytes of those that are there."""
        return sum(file.size for file in self._files)

    def remove_old(self, folder: Path, next_size: int, now_ns: int) -> bool:
        """Remove the oldest files until the next one, of `next_size` bytes, has its place; whether any went.

        A file that the system does not let go stays listed and is tried again.

        Args:
            folder: of the bag.
            next_size: bytes that the file at hand will have.
            now_ns: timestamp (ns) of the message with which that begins.
        """
        before = self._gone
        while self._files and self._is_too_much(next_size, now_ns):
            oldest = self._files[0]
            try:
                (folder / oldest.entry.name).unlink(missing_ok=True)
            except OSError:
                break
            del self._files[0]
            self.removed += oldest.counts
            self._gone += 1
            self._gone_until_ns = max(self._gone_until_ns, oldest.entry.end_ns)
        return self._gone > before

    def told(self) -> str:
        """What was removed, in words; empty where nothing was."""
        if not self._gone:
            return ""
        until = datetime.fromtimestamp(self._gone_until_ns / NANOSECONDS, UTC).isoformat(timespec="seconds")
        return f"{self._gone} files with {self.removed.total()} messages, up to {until}"

    def _is_too_much(self, next_size: int, now_ns: int) -> bool:
        if 0 < self._most_bytes < next_size + self.size:
            return True
        return 0 < self._longest_ns < now_ns - self._files[0].entry.end_ns


def check_kept(keep_size: int, keep_duration: float, max_file_size: int, max_file_duration: float) -> None:
    """Hold that what shall be kept (bytes, s) fits the files (bytes, s): whole ones go, and the one at hand stays.

    Raises:
        InputError: files have no end, or what shall be kept is less than two of them.
    """
    if (keep_size or keep_duration) and not (max_file_size or max_file_duration):
        raise InputError("keep_size or keep_duration without files that end: give max_file_size or max_file_duration")
    if 0 < keep_size < 2 * max_file_size:
        raise InputError(
            f"keep_size of {keep_size} bytes: expected at least two files of {max_file_size}, or 0 for all"
        )
    if 0.0 < keep_duration < max_file_duration:
        raise InputError(f"keep_duration of {keep_duration} s: expected a file of {max_file_duration} s or more, or 0")
