"""What is taken off the times of a cell is what others took, and no more."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from faults.live.other_programs import MOST_LOST, Lost, check, family, lost_time, stated

SPIN = "import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))}); print(flush=True)\nwhile True: pass"


@pytest.mark.parametrize("count", [1, 3])
def test_waiting_for_a_core_is_seen(count):
    with ExitStack() as stack:
        spinning = [stack.enter_context(_process(SPIN)) for _ in range(count)]
        before = processor_time(spinning[0].pid)
        with lost_time(lambda: [spinning[0].pid]) as lost:
            begin = time.monotonic()
            time.sleep(4.0)
            found, passed = lost(), time.monotonic() - begin
            used = processor_time(spinning[0].pid) - before
        for process in spinning:
            process.kill()
    assert found.ran == pytest.approx(used, abs=0.2), "as the kernel bills it"
    assert count == 1 or found.waited > 0.5
    # A process that spins does nothing else; a wait is billed whole once it ends, also what was before the first look.
    assert found.ran + found.waited == pytest.approx(passed, abs=1.0)


def test_waiting_excuses_no_more_than_its_bound():
    check("said", 10**9 * 2, 1.0, Lost(waited=1.5, ran=9.0))
    with pytest.raises(AssertionError, match=r"said after 4\.500 s, stated 1 s"):
        check("said", round(10**9 * (1.5 + MOST_LOST)), 1.0, Lost(waited=100.0, ran=9.0))


def test_what_a_process_waited_for_before_it_ended_counts_too():
    with ExitStack() as stack:
        first, second, third = (stack.enter_context(_process(SPIN)) for _ in range(3))
        with lost_time(lambda: [first.pid]) as lost:
            time.sleep(2.0)
            first.kill()
            first.wait()
            found = lost()
        second.kill()
        third.kill()
    assert found.waited > 0.5


def test_a_stated_time_is_held_where_nothing_was_lost():
    with stated("a moment", 0.5):
        pass
    with pytest.raises(AssertionError, match=r"a nap after \d+\.\d+ s, stated 0\.1 s"), stated("a nap", 0.1):
        time.sleep(1.0)  # more than waiting for a core excuses


def test_all_descendants_are_of_the_family():
    code = (
        "import subprocess, sys; child = subprocess.Popen(['sleep', '60']); print(child.pid, flush=True); child.wait()"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        grandchild = int(process.stdout.readline())
        found = family()
        os.kill(grandchild, signal.SIGKILL)
    assert {os.getpid(), process.pid, grandchild} <= {*found}


def processor_time(pid: int) -> float:
    """What a process has used of processors by its bill, which counts in steps of 10 ms, s."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")  # utime and stime, proc_pid_stat(5)


def _process(code: str) -> subprocess.Popen[str]:
    """A process that has begun what it does."""
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, env=_ENVIRONMENT)
    assert process.stdout
    process.stdout.readline()
    return process


_ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
