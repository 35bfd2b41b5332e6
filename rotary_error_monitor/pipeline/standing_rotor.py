"""Whether a rotor that is told by its command alone stands with it: what turns with it says so."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import AUTOCOLLIMATOR
from rotary_error_monitor.metrology.agreement import LEAST_RATIO, ODDS
from rotary_error_monitor.metrology.error_motion import COMPONENTS, described_error_motion, remove_mirror
from rotary_error_monitor.pipeline.evidence import LONG, SHORT
from rotary_error_monitor.sensors.library import listed_fields, listed_kind, listed_sensitivity
from rotary_error_monitor.signals.resampling import Resampled

LAGS = (1, SHORT)
"""Windows over which changes are looked at: a fast rotor shows over one, of a slow one that would be noise."""

MIXED = 2
"""Changes from window to window of which a part may be from after the moment at which the command stopped."""


class RotorReadings:
    """What the instruments of a stage read, side by side, and the motion in it for a rotation.

    Attributes:
        count: P of their fields.
    """

    def __init__(self, stage: StageDescription) -> None:
        """Autocollimator and listed sensors of `stage`."""
        self._mirror, self._sensors = stage.mirror, dict(stage.sensors)
        self._tilt = 0 if stage.autocollimator is None else 2
        instrument = stage.autocollimator
        noise = (
            [] if instrument is None else [math.hypot(instrument.noise, instrument.resolution / math.sqrt(12.0))] * 2
        )
        for field in listed_fields(stage):
            own = math.hypot(field.sensor.noise, field.sensor.resolution / math.sqrt(12.0))
            noise.append(own / abs(field.sensor.gain))
        self._noise = np.array(noise)
        tilt = np.eye(len(COMPONENTS))[3 : 3 + self._tilt]
        self._sees = np.vstack([tilt, listed_sensitivity(listed_fields(stage))])
        self._spindle = stage.spindle
        self.count = len(noise)

    def read(self, sampled: Mapping[str, Resampled], there: tuple[str, ...], count: int) -> Array:
        """(m, P) readings at `count` ticks, NaN of what is not `there`."""
        read, begin = np.full((count, self.count), np.nan), self._tilt
        if self._tilt and AUTOCOLLIMATOR in there:
            read[:, :2] = sampled[AUTOCOLLIMATOR].values
        for name, sensor in self._sensors.items():
            end = begin + len(listed_kind(sensor).fields)
            if name in there:
                read[:, begin:end] = sampled[name].values
            begin = end
        return read

    def motion(self, readings: Array, theta: Array) -> Array:
        """(n, P) readings less all that the description has of them at `theta` (n,), in standard deviations."""
        parts, begin = [], self._tilt
        if self._tilt:
            parts.append(remove_mirror(readings[:, :2], theta, self._mirror))
        for sensor in self._sensors.values():
            kind = listed_kind(sensor)
            end = begin + len(kind.fields)
            parts.append(kind.displacement(sensor, readings[:, begin:end], theta))
            begin = end
        described = described_error_motion(self._spindle, theta) @ self._sees.T
        return np.asarray((np.hstack(parts) - described) / self._noise, np.float64)


class StandingRotor:
    """Holds what the instruments read, while the command stands, against a rotor that goes on as fast as before.

    Forms of targets, the tilt of the mirror and described error motion go with the rotation. Where the rotor stands,
    they stand; where the command is stuck, they go on, and what is left of the readings runs more smoothly with them
    taken off at the angle at which the rotor would be than at the command. By how much it must is as for heads
    (`metrology.agreement`).
    """

    def __init__(self, stage: StageDescription) -> None:
        """Judge of a stage."""
        self._readings = RotorReadings(stage)
        self.reset()

    def reset(self) -> None:
        """Nothing was seen."""
        self._rows: deque[tuple[float, Array]] = deque(maxlen=LONG)
        self._speeds: deque[float] = deque(maxlen=MIXED + 1)

    def move(self, speed: float) -> None:
        """The command moves, at `speed` (rad/s) from the mean of the last window to that of this one."""
        self._rows.clear()
        self._speeds.append(speed)

    def goes_on(self, since: float, theta: float, readings: Array) -> bool:
        """Whether the rotor goes on, by another window in which the command stands.

        Args:
            since: time since the command was seen to move, s.
            theta: command, rad.
            readings: (P,) means over the window.
        """
        self._rows.append((since, readings))
        if len(self._speeds) <= MIXED:
            return False
        elapsed, rows = np.array([each for each, _ in self._rows]), np.array([row for _, row in self._rows])
        there = np.isfinite(rows).all(axis=0)
        rows = np.where(there, rows, 0.0)
        standing = self._readings.motion(rows, np.full(len(rows), theta))[:, there]
        going = self._readings.motion(rows, theta + self._speeds[0] * elapsed)[:, there]
        return any(_is_smoother(going, standing, lag) for lag in LAGS)


def _is_smoother(motion: Array, other: Array, lag: int) -> bool:
    """Whether a motion (n, p) runs more smoothly than another, by more than what is smooth by chance."""
    steps = len(motion) - lag
    if steps < 1 or motion.shape[1] == 0:
        return False
    rough, other_rough = (float(np.mean((each[lag:] - each[:-lag]) ** 2)) for each in (motion, other))
    ratio = other_rough / max(rough, np.finfo(np.float64).tiny)
    return ratio >= LEAST_RATIO and 0.5 * steps / lag * math.log(ratio) >= ODDS
