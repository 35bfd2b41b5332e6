"""Who works on a bag or file: a lock on it that is gone with the process that held it, however that ended."""

from __future__ import annotations

import contextlib
import fcntl
import os
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Self

from rotary_error_monitor.errors import InputError

_LOCKS = Path("/proc/locks")

PATIENCE = 30.0
"""How long a file is waited for, s. What changes one takes two seconds, but for long identifications; where it had a
tenth of a busy processor, more than ten were seen."""

PAUSE = 0.05
"""From one look at the lock to the next, s: too short for a person to notice, and next to no load."""


class LockedError(InputError):
    """Another process has the lock."""


class PathLock:
    """The right to change what is at a path, for one process at a time, to `release` or the end of the process.

    The lock lies on the file or folder itself (`flock(2)`): nothing is left behind that could be mistaken for it, and
    whoever renames it takes the lock along. Readers need none.

    Attributes:
        held: False where the file system knows no locks, so that nobody is kept away.
        place: path by which what is locked is found whatever it is called meanwhile.
    """

    def __init__(self, path: Path, doing: str, flags: int = 0) -> None:
        """Take the lock of what is there.

        Args:
            path: of the file or folder.
            doing: what who has the lock does with it, for the message.
            flags: to open it with.

        Raises:
            InputError: another process has it; the message says which.
            OSError: it cannot be opened.
        """
        self._descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | flags)
        self.place = Path(f"/proc/self/fd/{self._descriptor}")
        self.held = True
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self.release()
            raise LockedError(f"{path}: {holder(path) or 'another process'} {doing}; let it end first") from None
        except OSError:
            self.held = False

    @property
    def path(self) -> Path | None:
        """Where it is now; None once it was removed."""
        with contextlib.suppress(OSError):
            if os.fstat(self._descriptor).st_nlink:
                return self.place.readlink()
        return None

    def release(self) -> None:
        """Let others have it; a lock that was released stays so."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()


class BagLock(PathLock):
    """The right to change a bag: the lock of its folder."""

    def __init__(self, folder: Path) -> None:
        """Take the lock of a folder that is there.

        Raises:
            InputError: another process has it; the message says which.
            OSError: the folder cannot be opened.
        """
        super().__init__(folder, "is recording or recovering it", os.O_DIRECTORY)


class FileLock(PathLock):
    """The right to change a file, from before it is read until another has taken its place."""

    @classmethod
    def wait(cls, path: Path, patience: float = PATIENCE) -> Self:
        """The lock of the file that is there when whoever has it now, or who replaces it, is through.

        Raises:
            InputError: another process still has it after `patience` in s; the message says which.
            OSError: the file cannot be opened.
        """
        end = time.monotonic() + patience
        while True:
            try:
                lock = cls(path, "is changing it")
            except LockedError:
                if time.monotonic() > end:
                    raise
                time.sleep(PAUSE)
                continue
            if lock.is_of(path):
                return lock
            lock.release()

    def is_of(self, path: Path) -> bool:
        """Whether what is locked is still what is at the path."""
        with contextlib.suppress(FileNotFoundError):
            return os.path.samestat(os.fstat(self._descriptor), path.stat())
        return False


def holder(path: Path) -> str:
    """The process that has the lock of what is there, such as `process 4711`; empty where none is known to have it."""
    try:
        status = path.stat()
        lines = _LOCKS.read_text(encoding="ascii").splitlines()
    except OSError:
        return ""
    file = f"{os.major(status.st_dev):02x}:{os.minor(status.st_dev):02x}:{status.st_ino}"
    for line in lines:  # 1: FLOCK  ADVISORY  WRITE 4711 08:01:131090 0 EOF
        parts = line.split()
        if parts[1] == "FLOCK" and parts[3] == "WRITE" and parts[5] == file:
            return f"process {parts[4]}"
    return ""


def writer_of(files: Iterable[Path]) -> str:
    """A process that has one of the files open to write, such as `process 4711`, as far as the system lets one see."""
    wanted = {(status.st_dev, status.st_ino) for status in (file.stat() for file in files if file.exists())}
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):  # the process may be gone, or somebody else's
            for descriptor in (process / "fd").iterdir():
                if _is_writing(descriptor, wanted):
                    return f"process {process.name}"
    return ""


def _is_writing(descriptor: Path, wanted: set[tuple[int, int]]) -> bool:
    """Whether it is one of the wanted files (device and inode), open to write."""
    with contextlib.suppress(OSError):  # it may be closed
        status = descriptor.stat()
        if (status.st_dev, status.st_ino) in wanted:
            about = (descriptor.parents[1] / "fdinfo" / descriptor.name).read_text(encoding="ascii")
            flags = next(int(line.split()[1], 8) for line in about.splitlines() if line.startswith("flags:"))
            return flags & os.O_ACCMODE != os.O_RDONLY
    return False
