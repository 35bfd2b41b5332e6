"""Tasks for worker processes: what they do is known, and so is what it does to the process."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.recordings.replay import replay_bag


def square(number):
    return number * number


def number_and_process(number):
    return number, os.getpid()


def count_estimates(bag):
    """Read and estimate a bag of the embedded stage."""
    return len(replay_bag(bag, load_stage()).stamp_ns)


def wait_long(number):
    time.sleep(600)


def end_once(place):
    """Ends its process where the file is not there yet, which it makes."""
    path = Path(place)
    if path.exists():
        return path.name
    path.touch()
    os.kill(os.getpid(), signal.SIGKILL)
    return "not reached"


def end_always(place):
    os.kill(os.getpid(), signal.SIGKILL)


def fail(number):
    raise ValueError(f"task {number} is wrong")
