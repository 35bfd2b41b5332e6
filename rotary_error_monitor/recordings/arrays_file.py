"""Arrays into an .npz file, part by part: of arrays larger than memory no more than a part is in it."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.files import write_all
from rotary_error_monitor.signals.rows import Rows, parts_of

_MOST_AT_ONCE = 1 << 22
"""Bytes that are written at once, about."""


@dataclass(frozen=True)
class InParts:
    """An array that is given part after part.

    Attributes:
        dtype: of its numbers.
        shape: of the whole.
        parts: gives its parts along the first axis, one after another.
    """

    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    parts: Callable[[], Iterable[NDArray[Any]]]

    @staticmethod
    def of_array(array: NDArray[Any]) -> InParts:
        """An array as it is, one that is a view of few numbers too."""
        step = max(1, _MOST_AT_ONCE * max(len(array), 1) // max(array.nbytes, 1))
        return InParts(array.dtype, array.shape, lambda: (array[a:b] for a, b in parts_of(0, len(array), step)))

    @staticmethod
    def of_rows(rows: Rows) -> InParts:
        """Rows that are kept."""
        one = rows.read(0, 0)
        return InParts(
            one.dtype, (len(rows), *one.shape[1:]), lambda: (rows.read(a, b) for a, b in parts_of(0, len(rows)))
        )


def save_arrays(path: Path | str, arrays: Mapping[str, InParts]) -> None:
    """Write arrays to an .npz file, whole or not at all: what stood there stays until the new file is on the disk.

    Raises:
        InputError: it cannot be written.
    """

    def write(file: IO[bytes]) -> None:
        with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED, allowZip64=True) as archive:
            for name, array in arrays.items():
                with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                    head = {"descr": array.dtype.str, "fortran_order": False, "shape": array.shape}
                    np.lib.format.write_array_header_1_0(entry, head)
                    for part in array.parts():
                        entry.write(np.ascontiguousarray(part, array.dtype).data)

    write_all({Path(path): write})
