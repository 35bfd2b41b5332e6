"""How far a stage that is being commissioned has turned, while it turns."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.commissioning.heads import in_radians, motion_of
from rotary_error_monitor.commissioning.streams import RawStream
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import COMMAND
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock
from rotary_error_monitor.units import TURN

ENOUGH = TURN + math.radians(10.0)
"""Rotation each way that is asked for, rad: a whole turn, and what a hand or a ramp loses at both ends of it."""

REST = 3.0
"""Time, s, in which a stage that has turned enough stands before that is taken for the end: hands take a new hold."""

STILL = math.radians(0.5)
"""Angle, rad, within which a stage that stands may move: at the slowest speed of use, a turn in five minutes, it is
left behind in half a second."""

LONG = 2.0
"""Times what is enough after which a stage need not stand: a controller may go on for ever."""

MOST = 4096
"""Samples of a stream that are kept: where there are more, every other one goes."""

SPACING_NS = NANOSECONDS // 50
"""Least time between two samples that are kept, ns: that between the values of which speeds are made."""


@dataclass(frozen=True)
class TurnedTravel:
    """How far a stage has turned, as far as its heads tell, rad: `forth` and `back`, and whether it stands."""

    forth: float = 0.0
    back: float = 0.0
    stands: bool = True

    @property
    def is_enough(self) -> bool:
        """Whether that does: each way a turn and a bit, after which the stage stands, or goes on for long.

        The stage shall stand because nothing is known of units yet: degrees that pass for radians look like many turns,
        but who was asked for one turn stops after one.
        """
        least = min(self.forth, self.back)
        return least >= (ENOUGH if self.stands else LONG * ENOUGH)


class TravelWatch:
    """Keeps some of the samples of heads and command as they come, and says how far the stage has turned.

    Blocks may come on one thread while another one asks.
    """

    def __init__(self, stage: StageDescription) -> None:
        """Watch a stage with these heads."""
        self._stage = stage
        self._lock = threading.Lock()
        self._kept = {name: _Kept() for name in (*(f"head_{letter}" for letter in stage.azimuths), COMMAND)}

    def note(self, stream: str, block: SampleBlock) -> None:
        """Take note of a block of a stream; of others than heads and command nothing is kept."""
        if stream in self._kept:
            with self._lock:
                self._kept[stream].add(block)

    def travel(self) -> TurnedTravel:
        """How far the stage has turned each way; not at all where its heads do not tell that it moves."""
        streams = dict(self._streams())
        if not streams or not all(f"head_{letter}" in streams for letter in self._stage.azimuths):
            return TurnedTravel()
        try:
            angles = in_radians(self._stage, streams)
        except InputError:  # what is wrong is said of the whole recording, when it is one
            return TurnedTravel()
        times, values = next(iter(angles.streams.values()))
        motion = motion_of(times, values)
        last = values[times > times[-1] - round(REST * NANOSECONDS)]
        stands = bool(times[-1] - times[0] > REST * NANOSECONDS and np.ptp(last) < STILL)
        return TurnedTravel(motion.forth, motion.back, stands)

    def _streams(self) -> Iterator[tuple[str, RawStream]]:
        with self._lock:
            kept = {name: each.copy() for name, each in self._kept.items()}
        for name, (times, values) in kept.items():
            if len(times) > 1:
                yield name, RawStream(np.array(times, np.int64), np.array(values, np.float64))


class _Kept:
    """Some samples of one stream: the first in each slot of time that has one."""

    def __init__(self) -> None:
        self._times: list[int] = []
        self._values: list[NDArray[np.float64]] = []
        self._spacing_ns = SPACING_NS

    def add(self, block: SampleBlock) -> None:
        times = block.times_ns
        before = self._times[-1] // self._spacing_ns if self._times else -1
        # slots go up: what comes out of order, or is not finite, makes no new one
        for i in np.flatnonzero(np.diff(np.maximum.accumulate(times // self._spacing_ns), prepend=before) > 0):
            value = block.rows[i, 1:]
            if np.isfinite(value).all() and (not self._times or times[i] > self._times[-1]):
                self._times.append(int(times[i]))
                self._values.append(value.copy())
        if len(self._times) > MOST:
            self._spacing_ns *= 2
            self._times, self._values = self._times[::2], self._values[::2]

    def copy(self) -> tuple[list[int], list[NDArray[np.float64]]]:
        return self._times[:], self._values[:]
