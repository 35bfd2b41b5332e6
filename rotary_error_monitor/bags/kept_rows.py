"""Rows kept on the disk, in files without a name: what ends the process in whatever way, they go with it."""

from __future__ import annotations

import math
import os
import tempfile
import weakref
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.signals.rows import Keep

_MOST_WAITING = 1 << 20
"""Bytes that wait to be written together."""


class RowsOnDisk:
    """Rows in a file of their own; of many rows memory holds but those that are read, and a megabyte to be written.

    A file is begun with the first megabyte, so that what is short never reaches the disk.
    """

    def __init__(self, shape: tuple[int, ...] = (), dtype: DTypeLike = np.float64, folder: Path | None = None) -> None:
        """Place for rows of a shape and kind.

        Args:
            shape: of a row.
            dtype: of its numbers.
            folder: in which the file is; None for where the system has its temporary files (`TMPDIR`).
        """
        self._shape, self._dtype, self._folder = shape, np.dtype(dtype), folder
        self._size = self._dtype.itemsize * math.prod(shape)
        self._waiting: list[NDArray[Any]] = []
        self._written = self._count = 0
        self._file: Any = None

    def __len__(self) -> int:
        return self._count

    def append(self, rows: NDArray[Any]) -> None:
        """As `Rows.append`.

        Raises:
            InputError: the disk is full, or there can be no file in the folder.
        """
        self._waiting.append(np.array(rows, self._dtype, order="C"))
        self._count += len(rows)
        if (self._count - self._written) * self._size >= _MOST_WAITING:
            self._write()

    def read(self, first: int, last: int) -> NDArray[Any]:
        """As `Rows.read`.

        Raises:
            InputError: as `append`.
        """
        first, last = min(first, self._count), min(last, self._count)
        if first >= self._written and self._waiting:
            self._waiting = [np.concatenate(self._waiting)]
            return self._waiting[0][first - self._written : last - self._written]
        if last > self._written:
            self._write()
        found = np.empty((max(last - first, 0), *self._shape), self._dtype)
        rest = _bytes_of(found)
        at = first * self._size
        while rest:
            count = os.preadv(self._file.fileno(), [rest], at)
            if not count:
                raise InputError(f"{self._place}: a temporary file became shorter while it was used; run it again")
            rest, at = rest[count:], at + count
        return found

    @property
    def _place(self) -> str:
        return str(self._folder or tempfile.gettempdir())

    def _write(self) -> None:
        try:
            if self._file is None:
                self._file = tempfile.TemporaryFile(dir=self._folder, buffering=0)  # noqa: SIM115 (as long as the rows)
                weakref.finalize(self, self._file.close)
            for rows in self._waiting:
                rest = _bytes_of(rows)
                while rest:
                    rest = rest[self._file.write(rest) :]
        except OSError as error:
            raise InputError(
                f"{self._place}: what is kept beside memory while a long recording is read cannot be written "
                f"({error.strerror}): up to five times the recording's own size is needed; give a folder with room for "
                "it in the variable TMPDIR"
            ) from error
        self._waiting, self._written = [], self._count


def _bytes_of(rows: NDArray[Any]) -> memoryview:
    """Bytes of an array that lies in memory as it is, of one without any too."""
    return rows.reshape(-1).view(np.uint8).data


def kept_in(folder: Path | None = None) -> Keep:
    """Where rows are kept that may be too many for memory: files without a name in a folder, as for `RowsOnDisk`."""
    return partial(RowsOnDisk, folder=folder)


def kept_beside(output: Path) -> Keep:
    """The same in the folder of a file that will be written; the system's own where that takes no files."""
    folder = output.parent
    return kept_in(folder if output.is_file() or (not output.exists() and os.access(folder, os.W_OK)) else None)
