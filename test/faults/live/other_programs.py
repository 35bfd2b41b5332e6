"""What a computer did meanwhile: times are judged without what other programs, or its host, took of them."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

MOST_LOST = 3.0
"""Waiting for a core counts up to this many times what is stated; a computer that is busier than that shows nothing."""

STANDSTILL = 1.0
"""A thread that only sleeps is woken within this time, s, whatever the cell does: eight processes in a real-time class
have two cores in turns of 0.1 s. Where it is not, the whole computer stood still, as one does that is being copied."""


@dataclass(frozen=True)
class Lost:
    """Of a time that passed, s: what the cell's processes waited for a core and ran, in sum; what nothing ran."""

    waited: float
    ran: float
    stood_still: float

    def allowed(self, within: float) -> float:
        """Time, s, that something may have taken which is stated to come within so much."""
        return within + self.stood_still + min(self.waited, MOST_LOST * within)


def check(what: str, duration_ns: int, within: float, lost: Lost) -> None:
    """Hold a time against what is stated, s, beside what was lost of it."""
    duration = duration_ns * 1e-9
    told = f"{what} after {duration:.3f} s, stated {within:g} s; {lost}"
    print(told)
    assert duration < lost.allowed(within), told


@contextmanager
def lost_time(pids: Callable[[], Sequence[int]]) -> Iterator[Callable[[], Lost]]:
    """Function that tells what was lost since the `with`.

    A process has waited as long as the thread of it that waited longest; all of them count, for what one does waits for
    what the other does.
    """
    before = {pid: _times(pid) for pid in pids()}
    with _standstills() as standstills:

        def tell() -> Lost:
            ran = waited = 0.0
            for pid in pids():
                then = before.get(pid, {})
                spent = [at - then.get(thread, np.zeros(2)) for thread, at in _times(pid).items()]
                ran += sum(float(each[0]) for each in spent)
                waited += max((float(each[1]) for each in spent), default=0.0)
            return Lost(waited, ran, sum(standstills))

        yield tell


def _times(pid: int) -> dict[str, NDArray[np.float64]]:
    """(2,) time that each thread of a process ran and waited for a core, s; nothing where the process has ended."""
    found = {}
    with suppress(OSError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            with suppress(OSError, IndexError):
                found[task.name] = 1e-9 * np.array((task / "schedstat").read_text().split()[:2], np.float64)
    return found


@contextmanager
def _standstills() -> Iterator[list[float]]:
    """Times, s, for which a thread was not woken that wanted to sleep for a moment."""
    found: list[float] = []
    over = threading.Event()

    def watch() -> None:
        while not over.is_set():
            begin = time.monotonic()
            time.sleep(0.05)
            late = time.monotonic() - begin - 0.05
            if late > STANDSTILL:
                found.append(late)

    thread = threading.Thread(target=watch)
    thread.start()
    try:
        yield found
    finally:
        over.set()
        thread.join()
