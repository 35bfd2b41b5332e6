"""Who works on a bag: a lock on its folder that is gone with the process that held it, however that ended."""

from __future__ import annotations

import contextlib
import fcntl
import os
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Self

from rotary_error_monitor.errors import InputError

_LOCKS = Path("/proc/locks")


class BagLock:
    """The right to change a bag, for one process at a time, from its making to `release` or the end of the process.

    The lock lies on the folder itself (`flock(2)`): nothing is left behind that could be mistaken for it, and whoever
    renames the folder takes it along. Readers need none.

    Attributes:
        held: False where the file system knows no locks, so that nobody is kept away.
        place: path by which the locked folder is found whatever it is called meanwhile.
    """

    def __init__(self, folder: Path) -> None:
        """Take the lock of a folder that is there.

        Raises:
            InputError: another process has it; the message says which.
            OSError: the folder cannot be opened.
        """
        self._descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        self.place = Path(f"/proc/self/fd/{self._descriptor}")
        self.held = True
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self.release()
            raise InputError(
                f"{folder}: {holder(folder) or 'another process'} is recording or recovering it; let it end first"
            ) from None
        except OSError:
            self.held = False

    @property
    def path(self) -> Path | None:
        """Where the folder is now; None once it was removed."""
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

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()


def holder(folder: Path) -> str:
    """The process that has the lock of a folder, such as `process 4711`; empty where none is known to have it."""
    try:
        status = folder.stat()
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
    wanted = {(status.st_dev, status.st_ino) for status in (file.stat() for file in files)}
    for descriptor in Path("/proc").glob("[0-9]*/fd/*"):
        with contextlib.suppress(OSError):  # it may be closed, or its process gone, or somebody else's
            status = descriptor.stat()
            if (status.st_dev, status.st_ino) in wanted and _is_writing(descriptor):
                return f"process {descriptor.parts[2]}"
    return ""


def _is_writing(descriptor: Path) -> bool:
    about = (descriptor.parents[1] / "fdinfo" / descriptor.name).read_text(encoding="ascii")
    flags = next(int(line.split()[1], 8) for line in about.splitlines() if line.startswith("flags:"))
    return flags & os.O_ACCMODE != os.O_RDONLY
