"""Signals that unwind what a command does: processes and files that it has begun are put away on the way out."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_NUMBERS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

_AGAIN = 0.001
"""Time (s) between the strikes of a signal whose exception was lost: longer than most destructors take."""


@contextmanager
def unwinding() -> Iterator[None]:
    """Let signals unwind what runs inside: KeyboardInterrupt for SIGINT, SystemExit with 128 + number for the others.

    Before and after, they end the process at once; a signal that somebody else has decided about stays as it is.

    Python throws an exception away that comes while it runs a destructor, a weak reference's callback or the like, of
    which each import has some, and goes on. Such a signal strikes again until its exception comes through.
    """
    ours = threading.current_thread() is threading.main_thread()
    numbers = [each for each in _NUMBERS if ours and signal.getsignal(each) is signal.SIG_DFL]
    deliveries = _Deliveries()
    told = sys.unraisablehook

    def thrown_away(lost: sys.UnraisableHookArgs) -> None:
        if isinstance(lost.exc_value, _Interrupted | _Terminated):
            deliveries.repeat(lost.exc_value.number)
        else:
            told(lost)

    for number in numbers:
        signal.signal(number, deliveries.unwind)
    sys.unraisablehook = thrown_away
    try:
        yield
    finally:
        sys.unraisablehook = told
        deliveries.taken.set()
        for number in numbers:
            signal.signal(number, signal.SIG_DFL)


class _Interrupted(KeyboardInterrupt):
    number = signal.SIGINT


class _Terminated(SystemExit):
    def __init__(self, number: int) -> None:
        super().__init__(128 + number)
        self.number = number


class _Deliveries:
    def __init__(self) -> None:
        self.taken = threading.Event()

    def unwind(self, number: int, frame: FrameType | None) -> None:
        """Raise what unwinds, but not inside `repeat`, where it would be thrown away once more."""
        while frame is not None:
            if frame.f_code is _Deliveries.repeat.__code__:
                return
            frame = frame.f_back
        self.taken.set()
        if number == signal.SIGINT:
            raise _Interrupted  # who presses Ctrl-C again does not want to wait for what is put away
        signal.signal(number, signal.SIG_IGN)  # once is enough
        raise _Terminated(number)

    def repeat(self, number: int) -> None:
        """Have the signal strike again, from another thread, until the main one raises."""
        signal.signal(number, self.unwind)
        self.taken.clear()
        threading.Thread(target=self._strike, args=(number,), daemon=True).start()

    def _strike(self, number: int) -> None:
        while not self.taken.wait(_AGAIN):
            os.kill(os.getpid(), number)
