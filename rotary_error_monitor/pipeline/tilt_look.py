"""What a window shows of the tilt, and what chance makes of many of them."""

from __future__ import annotations

from typing import NamedTuple

from rotary_error_monitor.description.two_axis_section import Autocollimator
from rotary_error_monitor.metrology.repeated_readings import run_by_chance
from rotary_error_monitor.pipeline.evidence import SHORT, SIGMAS


class Look(NamedTuple):
    """What a window shows of the tilt.

    Attributes:
        number: of the window.
        theta: mean rotation, rad.
        reading, surplus: what is read, and what of it is not described, rad.
        samples: independent ones in the window; of one reading in some windows a part of one.
        apart: windows from one that shows a reading of its own to the next.
        stated: standard deviation of a mean by the stated noise, rad.
        variance: of a tick, rad²; infinite where none is stated.
        ring: where the ring is beyond its description, m.
    """

    number: int
    theta: float
    reading: tuple[float, float]
    surplus: tuple[float, float]
    samples: float
    apart: int
    stated: float
    variance: float
    ring: tuple[float, float] = (0.0, 0.0)


class StillParts:
    """Whether one of two readings repeats, whatever the other does, as where one axis of a position sensor is dead."""

    def __init__(self, instrument: Autocollimator) -> None:
        """Of an instrument with noise and resolution as stated."""
        self._equal_run = run_by_chance(instrument.noise, instrument.resolution)
        self._floor = instrument.resolution + SIGMAS * instrument.noise
        self.clear()

    def clear(self) -> None:
        """Forget what was read."""
        self._last: Look | None = None
        self._still: list[Look] = []

    def moved(self, here: Look) -> None:
        """Take in a window in which both readings are others than before."""
        self._last, self._still = here, [here, here]

    def judge(self, here: Look, duration: float) -> str:
        """Take in a window of a duration (s): which reading repeats for longer than chance allows, if one does.

        Or has done so for some windows in which what is described must have moved it by more than noise and a step.
        """
        last, self._last, found = self._last, here, ""
        if last is None:
            self._still = [here, here]
            return ""
        for axis, name in enumerate("xy"):
            still = self._still[axis]
            if here.reading[axis] != last.reading[axis]:
                self._still[axis] = here
                continue
            run = here.number - still.number + 1
            gone = abs(here.surplus[axis] - still.surplus[axis])
            if run * here.samples > self._equal_run or (run >= SHORT and gone > self._floor):
                found = f"stuck: the same reading of {name} for {run * duration * 1e3:.0f} ms"
        return found


def mean_of(pairs: list[tuple[float, float]]) -> tuple[float, float]:
    """Mean of pairs."""
    return sum(x for x, _ in pairs) / len(pairs), sum(y for _, y in pairs) / len(pairs)
