"""The two clocks of the room: the system's, by which messages are stamped, and one that never steps."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

NANOSECONDS = 1_000_000_000


class Moment(NamedTuple):
    """A time by two clocks.

    Attributes:
        stamp_ns: the system's, which may be set, timestamp (ns).
        steady_ns: one that never steps (ns).
    """

    stamp_ns: int
    steady_ns: int


Clock: TypeAlias = Callable[[], Moment]
"""Gives the present time."""


def present() -> Moment:
    """Now."""
    return Moment(time.time_ns(), time.monotonic_ns())
