"""Noise of instruments that is louder the faster the rotor turns, as of readings whose instants jitter."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.twin.recording import SignalStream


@dataclass(frozen=True)
class NoiseBySpeed:
    """How many times as loud noise is at each speed as where the rotor stands or is slow.

    Attributes:
        speed: (k,) of the rotor, rad/s, ascending and not negative; beyond them it is as at the nearest.
        level: (k,) from 1 on, nowhere falling.
    """

    speed: Array
    level: Array

    def at(self, speed: Array) -> Array:
        """(n,) at speeds (n,) of either sign, rad/s."""
        return np.interp(np.abs(speed), self.speed, self.level)


class SpeedDependence:
    """How the noise of each instrument of a recording depends on the rotor's speed.

    Args:
        command: of the rotation.
    """

    def __init__(self, command: SignalStream) -> None:
        self._command = command
        self._noises: dict[str, NoiseBySpeed] = {}

    def take(self, instrument: str, noise: NoiseBySpeed | None) -> None:
        """Take the noise of an instrument for louder the faster the rotor turns; None for as loud at all speeds."""
        self._noises.pop(instrument, None)
        if noise is not None:
            self._noises[instrument] = noise

    def __contains__(self, instrument: str) -> bool:
        return instrument in self._noises

    def __iter__(self) -> Iterator[tuple[str, NoiseBySpeed]]:
        return iter(self._noises.items())

    def speed(self, time: Array) -> Array:
        """(m,) commanded speed at times (m,) in s; rad/s, not negative."""
        return np.abs(np.interp(time, self._command.time, self._command.values[:, 1]))

    def louder(self, instrument: str, time: Array) -> Array:
        """(m,) how many times as loud as where the rotor stands an instrument's noise is at times (m,), s."""
        noise = self._noises.get(instrument)
        return np.ones(len(time)) if noise is None else noise.at(self.speed(time))

    def mean_square(self, instrument: str, time: Array) -> float:
        """Mean of its square."""
        return float(np.mean(np.square(self.louder(instrument, time)))) if instrument in self else 1.0
