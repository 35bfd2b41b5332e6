"""The file below a recorder: whole records or none, and space kept back for closing the bag on a full disk."""

from __future__ import annotations

import contextlib
import errno
import os
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from mcap.opcode import Opcode

_STEP = 1 << 18  # the reserve grows in steps of 256 KiB
_CHUNK = bytes([Opcode.CHUNK])
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class Reserve:
    """A file that holds disk space until it is needed.

    When the disk fills up, giving this space free leaves room for the records at hand and for the index of the bag.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._size = 0
        self._file = path.open("xb", buffering=0)

    @property
    def held(self) -> bool:
        """Whether the space is still kept back."""
        return not self._file.closed

    def grow_to(self, size: int) -> None:
        """Keep back at least `size` bytes.

        Raises:
            OSError: the disk does not have them.
        """
        if size > self._size and self.held:
            wanted = -(-size // _STEP) * _STEP
            os.posix_fallocate(self._file.fileno(), 0, wanted)
            self._size = wanted

    def release(self) -> None:
        """Give the space free; where the disk does not even let go, there is nothing to gain."""
        self._file.close()
        with contextlib.suppress(OSError):
            self._path.unlink(missing_ok=True)


class RecordFile:
    """Output of an mcap writer. Each write appends the whole of its bytes or nothing of them.

    The first write that meets a full disk releases the reserve and is tried again.

    Attributes:
        trouble: why recording must end although nothing is lost yet, such as a full disk; None while all is well.
        chunks: mcap chunks written.
        size: bytes written.
    """

    def __init__(self, path: Path, reserve: Reserve) -> None:
        self._reserve = reserve
        self._file = path.open("xb", buffering=0)
        self.size = 0
        self._syncing: Future[None] | None = None
        self._ending: Future[None] | None = None
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="bag_sync")
        self.trouble: OSError | None = None
        self.chunks = 0

    def write(self, data: bytes) -> int:
        """Append `data`.

        Raises:
            OSError: there is no room for it, even with the reserve released; the file is as before.
        """
        try:
            self._append(data)
        except OSError as error:
            if not self._reserve.held:
                raise
            self.trouble = error
            self._reserve.release()
            self._append(data)
        self.chunks += data[:1] == _CHUNK
        return len(data)

    def tell(self) -> int:
        """The same, as a stream tells it."""
        return self.size

    def flush(self) -> None:
        """Nothing is kept in memory: what was written survives the end of the process."""

    def reserve(self, size: int) -> None:
        """Keep `size` bytes back on the disk; where it does not have them, that is trouble."""
        try:
            self._reserve.grow_to(size)
        except OSError as error:
            self._reserve.release()
            if error.errno in _FULL:  # else the file system cannot keep space back, and recording goes on without
                self.trouble = error

    def sync(self) -> None:
        """Have the disk store what was written, so that it survives a loss of power; does not wait for it."""
        if self._syncing is not None:
            if not self._syncing.done():
                return  # a slow disk is not asked twice
            failure = self._syncing.exception()
            if isinstance(failure, OSError):
                self.trouble = failure
        self._syncing = self._worker.submit(os.fsync, self._file.fileno())

    @property
    def removed(self) -> bool:
        """Whether the file has no name any more: what is written to it is gone once it is closed."""
        return os.fstat(self._file.fileno()).st_nlink == 0

    def end(self) -> None:
        """Begin to store everything and to close the file, without waiting for the disk: `close` does that."""
        if self._ending is None:
            self._ending = self._worker.submit(self._store_and_close)

    @property
    def ended(self) -> bool:
        """Whether what `end` began is done."""
        return self._ending is not None and self._ending.done()

    def close(self) -> None:
        """Store everything and close the file.

        Raises:
            OSError: the disk could not store it; the file is closed nevertheless.
        """
        self.end()
        self._worker.shutdown()
        assert self._ending is not None
        self._ending.result()

    def _store_and_close(self) -> None:
        with self._file:
            os.fsync(self._file.fileno())

    def _append(self, data: bytes) -> None:
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
        except OSError:
            # The beginning of a record would hide all that could still be written behind it.
            self._file.truncate(self.size)
            self._file.seek(self.size)
            raise
        self.size += len(data)
