"""What a computer did meanwhile: times are judged without what other programs took of them."""

from __future__ import annotations

import os
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

_LOOK_PERIOD = 0.1
"""Time between two looks at processes, which may end at any time, s."""


@dataclass(frozen=True)
class Lost:
    """How long the cell's processes waited for a core and how long they ran, in sum, s."""

    waited: float
    ran: float

    def allowed(self, within: float) -> float:
        """Time, s, that something may have taken which is stated to come within so much."""
        return within + min(self.waited, MOST_LOST * within)


def check(what: str, duration_ns: int, within: float, lost: Lost) -> None:
    """Hold a time against what is stated, s, beside what was lost of it."""
    duration = duration_ns * 1e-9
    told = f"{what} after {duration:.3f} s, stated {within:g} s; {lost}"
    print(told)
    assert duration < lost.allowed(within), told


@contextmanager
def stated(what: str, within: float) -> Iterator[None]:
    """Hold the time that the block takes against what is stated, s, beside what was lost of it.

    All processes count that this one started, and what they started, such as those of a browser, and this one.
    """
    with lost_time(family) as lost:
        begin = time.monotonic_ns()
        yield
        check(what, time.monotonic_ns() - begin, within, lost())


def family() -> list[int]:
    """This process and all that descend from it."""
    found = [os.getpid()]
    for pid in found:
        with suppress(OSError):
            for task in Path(f"/proc/{pid}/task").iterdir():
                with suppress(OSError):
                    found += map(int, (task / "children").read_text().split())
    return found


@contextmanager
def lost_time(pids: Callable[[], Sequence[int]]) -> Iterator[Callable[[], Lost]]:
    """Function that tells what was lost since the `with`.

    A process has waited as long as the thread of it that waited longest; all of them count, for what one does waits for
    what the other does. Of a process that has ended counts what was seen of it before.
    """
    before = {pid: _times(pid) for pid in pids()}
    latest, over, lock = dict(before), threading.Event(), threading.Lock()

    def look() -> None:
        with lock:
            for pid in pids():
                latest[pid] = latest.get(pid, {}) | _times(pid)

    def look_regularly() -> None:
        while not over.wait(_LOOK_PERIOD):
            look()

    def tell() -> Lost:
        look()
        ran = waited = 0.0
        for pid, times in latest.items():
            then = before.get(pid, {})
            spent = [at - then.get(thread, np.zeros(2)) for thread, at in times.items()]
            ran += sum(float(each[0]) for each in spent)
            waited += max((float(each[1]) for each in spent), default=0.0)
        return Lost(waited, ran)

    looking = threading.Thread(target=look_regularly, name="lost time")
    looking.start()
    try:
        yield tell
    finally:
        over.set()
        looking.join()


def _times(pid: int) -> dict[str, NDArray[np.float64]]:
    """(2,) time that each thread of a process ran and waited for a core, s; nothing where the process has ended."""
    found = {}
    with suppress(OSError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            with suppress(OSError, IndexError):
                found[task.name] = 1e-9 * np.array((task / "schedstat").read_text().split()[:2], np.float64)
    return found
