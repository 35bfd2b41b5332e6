"""Arguments of commands that read many bags: how many at once, where, and how far they are."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from rotary_error_monitor.errors import InputError

Answer = TypeVar("Answer")

MOST_JOBS = 1024
"""Processes that nobody has processors for."""


def add_work(parser: argparse.ArgumentParser) -> None:
    """Describe the arguments that say who reads the bags, and which stages they are of."""
    parser.add_argument(
        "--by-folder",
        action="store_true",
        help="the folder that a bag lies in names its stage (default: what the bag says, or the twin's file)",
    )
    parser.add_argument(
        "--jobs", type=int, metavar="N", help="bags that are read at once (default: one for each processor)"
    )
    parser.add_argument(
        "--scheduler",
        metavar="tcp://HOST:PORT",
        help="Dask scheduler whose workers read the bags; they need the same folder at the same path",
    )


def check_work(arguments: argparse.Namespace) -> None:
    """Refuse a number of processes that is none.

    Raises:
        InputError: it is out of range, or given beside a scheduler.
    """
    if arguments.jobs is not None and not 1 <= arguments.jobs <= MOST_JOBS:
        raise InputError(f"--jobs is {arguments.jobs}; it must be from 1 to {MOST_JOBS}")
    if arguments.jobs is not None and arguments.scheduler is not None:
        raise InputError("--jobs and --scheduler: a scheduler has its own workers; give one of the two")


def bar_of(name: str) -> Callable[[Iterable[Answer], int], Iterable[Answer]]:
    """Function that passes answers on, and shows rate and time left where somebody watches."""

    def watched(answers: Iterable[Answer], total: int) -> Iterator[Answer]:
        from tqdm import tqdm  # loaded where there is something to show

        with tqdm(answers, total=total, desc=name, unit="bag", leave=False, file=sys.stderr) as bar:
            yield from bar

    return watched if sys.stderr.isatty() else lambda answers, total: answers
