"""C libraries that rooms keep in a folder `compiled`: which of them were built, and whether they may compute.

`setup.py` builds each with the package, by the C compiler that is there. A library computes what a readable form in
Python computes as well; where there is none, or the environment asks for it, that form does.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import sysconfig
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.errors import InputError

Kernel = TypeVar("Kernel")

VARIABLE = "ROTARY_ERROR_MONITOR_KERNEL"
"""Environment variable by which `numpy` is asked for, or `compiled` without anything to stand in for it."""

NAME = f"_kernel{sysconfig.get_config_var('EXT_SUFFIX')}"
"""Name of the file of a room's library, beside its folder of sources."""

_addressof = ctypes.addressof
_from_buffer: Callable[[NDArray[Any]], ctypes.c_char] = ctypes.c_char.from_buffer  # type: ignore[assignment]

REALS, INTEGERS = np.dtype(np.float64), np.dtype(np.int64)


def load_library(library: Path, sources: Path) -> tuple[ctypes.CDLL | None, str]:
    """The library that computes, None for Python and numpy, and in that case why.

    Args:
        library: its file.
        sources: folder of what it has to be built of; where that is not installed, any is right.

    Raises:
        InputError: the environment asks for what is not there.
    """
    asked = os.environ.get(VARIABLE, "")
    if asked not in ("", "numpy", "compiled"):
        raise InputError(f"{VARIABLE}={asked}; expected numpy or compiled, or nothing for what is there")
    if asked == "numpy":
        return None, f"{VARIABLE}=numpy"
    reason = ""
    try:
        loaded = ctypes.CDLL(str(library))
        loaded.rem_source.restype = ctypes.c_char_p
        built_of = loaded.rem_source().decode()
    except (OSError, AttributeError):
        reason = f"{library.name} was not built: install the package where there is a C compiler (gcc or clang)"
    else:
        if source_digest(sources) in ("", built_of):
            return loaded, ""
        reason = f"{library.name} was built of other sources: install the package anew"
    if asked == "compiled":
        raise InputError(f"{VARIABLE}=compiled, but {reason}")
    return None, reason


@functools.cache
def room_library(room: Path) -> tuple[ctypes.CDLL | None, str]:
    """The same for a room, by its folder.

    Raises:
        InputError: the environment asks for what is not there.
    """
    return load_library(room / NAME, room / "compiled")


def kernel_of(room: Path, kernel: Callable[[ctypes.CDLL], Kernel]) -> Kernel | None:
    """The library of a room as its kernel; None where numpy computes.

    Raises:
        InputError: the environment asks for what is not there.
    """
    library = room_library(room)[0]
    return None if library is None else kernel(library)


def source_digest(folder: Path) -> str:
    """What tells the sources of a library from others; empty where they are not installed.

    setup.py does the same before there is a package.
    """
    files = sorted(folder.glob("*.[ch]"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest() if files else ""


def address(array: NDArray[Any]) -> int:
    """Where the elements of an array begin. A library takes them as they lie: see `is_plain`."""
    try:
        return _addressof(_from_buffer(array))  # in a third of the time of the other way
    except (TypeError, ValueError):  # it may not be written to, has gaps, or no element at all
        return int(array.__array_interface__["data"][0])


def is_plain(array: NDArray[Any], kind: np.dtype[Any]) -> bool:
    """Whether an array lies in one piece and has elements of a kind as this computer has them."""
    return array.dtype is kind and array.flags.c_contiguous
