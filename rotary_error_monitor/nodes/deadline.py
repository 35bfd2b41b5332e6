"""An end that comes: a process that has put its things away shall not hang in what its libraries do at exit.

Seen with Fast DDS 2.14 where a participant was left to the destructor of a static object: that takes the listener away
and spins there (`DomainParticipant::set_listener`), while a discovery callback waits for a lock, presumably the one
that it takes and releases without a pause. Cells whose processes end together ran into that once in a few hundred ends,
for each is then told of the others. Python is gone by then, and its signal handlers and threads with it. Nodes let
their participant go before (`process.run`), and it was not seen since. Seen too, in one of some hundred ends of a cell
on a busy computer: rcl does not come back from destroying a node while the others of its cell leave. What libraries do
stays theirs, and this their bound.
"""

from __future__ import annotations

import ctypes
import faulthandler
import os
from typing import ClassVar

from rotary_error_monitor.signals.blocks import NANOSECONDS

_HANGS = 0.8
"""Part of the time allowed after which where a process is counts as where it hangs."""

_CLOCK_MONOTONIC = 1
_SIGEV_THREAD = 2


class _Event(ctypes.Structure):
    """`struct sigevent` of Linux with glibc (sigevent(3type)), 64 bytes."""

    _fields_: ClassVar = [
        ("value", ctypes.c_int64),
        ("signo", ctypes.c_int),
        ("notify", ctypes.c_int),
        ("function", ctypes.c_void_p),
        ("attributes", ctypes.c_void_p),
        ("_padding", ctypes.c_byte * 32),
    ]


class _Times(ctypes.Structure):
    """`struct itimerspec`: interval and first expiry, each in s and ns."""

    _fields_: ClassVar = [(name, ctypes.c_long) for name in ("interval_s", "interval_ns", "value_s", "value_ns")]


def end_within(duration: float, code: int) -> None:
    """End this process with `code` after `duration` s at the latest, whatever it does then.

    A timer of the C library does it, on a thread of its own, without Python. Shortly before, standard error is told
    where each thread of Python is, as long as there is Python.

    Raises:
        OSError: the system has no timer left.
    """
    faulthandler.dump_traceback_later(_HANGS * duration)
    library = ctypes.CDLL(None, use_errno=True)
    end = ctypes.cast(library._exit, ctypes.c_void_p).value
    event = _Event(value=code, notify=_SIGEV_THREAD, function=end)
    timer = ctypes.c_void_p()
    seconds, nanoseconds = divmod(round(duration * NANOSECONDS), NANOSECONDS)
    times = _Times(value_s=seconds, value_ns=nanoseconds)
    if library.timer_create(_CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer)) != 0 or (
        library.timer_settime(timer, 0, ctypes.byref(times), None) != 0
    ):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
