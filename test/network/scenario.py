"""A cell on two hosts whose network breaks off for a while, from its start to its end; in a process of its own.

Fast DDS looks once in a process which networks there are, so one that has had a cell elsewhere cannot have one here.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from faults.live.other_programs import family, lost_time

from network.cell import NETWORK, SAYINGS, two_host_cell
from rotary_error_monitor.resources import config
from rotary_error_monitor.signals.blocks import NANOSECONDS
from rotary_error_monitor.sources.mock import MockSettings

CUT = 3.0
"""How long the network is away, s."""

SAID = 1.0
"""Time within which a hold is said, s."""

RECOVERED = 2.0
"""Time after the end of a cut within which everything is as before, s."""

WHOLE = 2.0
"""How long estimates come without a gap and from all streams, s; each lost frame would leave one."""

QUIET = 240.0
"""How long to wait until nothing has been missing for so long, s: on a busy computer each stall leaves a gap."""

STEADY = 1.5
"""How long corrections have flowed on both sides before the cut, s: what is said twice is logged once a second."""

AGAIN = 0.5
"""How long estimates come as before, s, for it to have recovered."""

PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
"""Variable that names Fast DDS its settings."""

_PR_SET_PDEATHSIG = 1  # linux/prctl.h


@dataclass(frozen=True)
class Witness:
    """What was seen of a run; times are timestamps (ns).

    Attributes:
        settings: of the mock stage.
        flowing_ns: from when estimates came without a gap.
        cut_ns, joined_ns: begin and end of the cut.
        quiet_ns: up to when the cut is to be said; later than `SAID` by what other programs took of the time.
        recovered_ns: up to when all is to be as before; later than `RECOVERED` by the same.
        whole_again_ns: from when on after it estimates came without a gap.
        loss: part of the frames that was lost before the cut.
        corrected: whether corrections flowed at the end of the cut.
        status: what the compensation then said of them.
        said: by node, what it has logged, and when.
    """

    settings: MockSettings
    flowing_ns: int
    cut_ns: int
    joined_ns: int
    quiet_ns: int
    recovered_ns: int
    whole_again_ns: int
    loss: float
    corrected: bool
    status: str
    said: dict[str, list[tuple[int, str]]]


def cut_off_and_rejoined(far: tuple[str, ...], bag: Path) -> Witness:
    """Run a cell with these executables on the far host, as `_run` says; raises what went wrong in it."""
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=fresh, initializer=_prepare) as process:
        return process.submit(_run, far, bag).result()


def _run(far: tuple[str, ...], bag: Path) -> Witness:
    """Cut the hosts off from one another once all is well, join them, and let the cell run on."""
    with two_host_cell(far, bag) as running:
        cell, cable, course = running.cell, running.cable, running.course
        cell.wait_until(running.corrects, "corrections")
        # the drive's delay is told by then, as in a cell that has been at work
        cell.wait_until(lambda: {*map(round, running.settings.speeds)} <= course.speeds, "a change of speed")
        cell.wait_until(
            lambda: running.corrects(STEADY) and course.is_whole_for(WHOLE), "estimates without a gap", QUIET
        )
        passed, lost = cable.counts()
        flowing_ns, cut_ns = course.whole_since_ns, time.time_ns()
        with lost_time(family) as lost_then:
            cable.cut()
            cell.spin_for(SAID)
            quiet_ns = cut_ns + round(lost_then().allowed(SAID) * NANOSECONDS)
        cell.spin_for(CUT - SAID)
        corrected, status = running.corrects(), cell.status("compensation: correction").message
        with lost_time(family) as lost_then:
            cable.impair(**NETWORK)
            joined_ns = time.time_ns()
            cell.wait_until(
                lambda: course.whole_since_ns > cut_ns and course.is_whole_for(AGAIN), "estimates as before"
            )
            recovered_ns = joined_ns + round(lost_then().allowed(RECOVERED) * NANOSECONDS)
        whole_again_ns = course.whole_since_ns
        judged_ns = recovered_ns + NANOSECONDS
        cell.wait_until(lambda: course.newest_ns > judged_ns, "enough estimates to judge")
        cell.wait_until(running.corrects, "corrections as before")
        running.stop()
        said = {node: running.said(node) for node in SAYINGS}
    loss = lost / (passed + lost)
    times = flowing_ns, cut_ns, joined_ns, min(quiet_ns, joined_ns), recovered_ns, whole_again_ns
    return Witness(running.settings, *times, loss, corrected, status, said)


def _prepare() -> None:
    """The process ends with its parent; all in it, and all that it starts, ask for lost messages soon."""
    os.environ[PROFILES] = str(config("fastdds.xml"))
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
