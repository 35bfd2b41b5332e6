"""What nobody knows of how the instruments of a stage round, as nuisances.

They may read half a step less, or half a step to zero, and steps coarser than the noise leave a sawtooth, whose edges
lie between the steps or on them.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.metrology.reading_steps import repeated_errors, rounding_errors, sawtooth, step_of
from rotary_error_monitor.sensors.library import instrument_of, sensor_of
from rotary_error_monitor.twin.recording import StageRecording
from rotary_error_monitor.twin.stage import Signals, StageTwin

WAYS = 2
"""Columns of each reading, those of `rounding_errors`: an instrument that cuts its readings off has one of them."""

SAWTEETH = 2
"""Columns more of readings whose steps noise does not break up: an instrument has one of them."""

SMEARED = 0.5
"""Part of a step from which on noise leaves less than a hundredth of the sawtooth, `exp(-2 (pi noise / step)²)`."""


def steps_of(stage: StageDescription, recording: StageRecording) -> dict[str, float]:
    """Step of a reading of each sensor's stream, in its unit: as stated, else as the readings show it; 0 for none."""
    found = {}
    for name in recording.sensors:
        sensor, response = sensor_of(name), stage.response(name)
        if name in sensor.streams(stage):
            stated = sensor.resolution(stage, name) * abs(response.gain)
            readings = response.readings(recording.streams[name].values)
            found[name] = stated or max(step_of(field) for field in readings.T)
    return found


def noise_before_steps(stage: StageDescription, stream: str) -> float:
    """Standard deviation of a reading before it is rounded, as stated, in its unit."""
    sensor = sensor_of(stream)
    squares = sensor.noise(stage, stream) ** 2 - sensor.resolution(stage, stream) ** 2 / 12
    return float(np.sqrt(max(squares, 0.0))) * abs(stage.response(stream).gain)


def repeated_squares(twin: StageTwin, stream: str, step: float) -> Array:
    """(n, fields) squares of the noise of the readings of a stream, over those stated.

    They are more where their rounding errors repeat, and where the readings show steps that are not stated.
    """
    stage, response = twin.stage, twin.stage.response(stream)
    before, stated = noise_before_steps(stage, stream), sensor_of(stream).noise(stage, stream) * abs(response.gain)
    paths = response.readings(twin.predict((), [stream])[stream])
    repeated = np.stack([repeated_errors(path, before, step) for path in paths.T], axis=1)
    if response.roll:  # what is shown along an axis is read along both
        repeated[:] = repeated.max(axis=1, keepdims=True)
    return np.asarray((before**2 + (1 + repeated) * step**2 / 12) / stated**2, np.float64)


class Rounding:
    """By how much readings err in the mean where an instrument cuts them off; data sheets seldom say whether it does.

    The heads of a ring are read by electronics of one kind, and err alike; of other sensors each field has its own way.

    Args:
        stage: whose instruments they are.
        steps: of a reading of each stream, in its unit, as `steps_of`.
    """

    def __init__(self, stage: StageDescription, steps: Mapping[str, float]) -> None:
        self._stage, self._steps = stage, steps
        self._sawteeth = {instrument_of(n) for n, s in steps.items() if noise_before_steps(stage, n) < SMEARED * s}
        self._columns: dict[str, int] = {}
        for name, step in steps.items():
            if step > 0.0:
                self._columns[instrument_of(name)] = len(sensor_of(name).fields) * self._ways(name)

    def has_sawteeth(self, instrument: str) -> bool:
        """Whether the steps of an instrument are coarser than its noise."""
        return instrument in self._sawteeth

    @property
    def count(self) -> int:
        """Number of columns."""
        return sum(self._columns.values())

    def acting(self, instrument: str) -> NDArray[np.intp]:
        """(k,) which of the columns are of an instrument."""
        before = 0
        for name, columns in self._columns.items():
            if name == instrument:
                return np.arange(before, before + columns)
            before += columns
        return np.zeros(0, np.intp)

    def errors(self, predicted: Signals) -> Signals:
        """(n, fields, k) what each column of an instrument does to its streams that show (n, fields)."""
        return {
            name: self._of_stream(name, values)
            for name, values in predicted.items()
            if self._steps.get(name, 0.0) > 0.0
        }

    def _of_stream(self, name: str, values: Array) -> Array:
        stage, step = self._stage, self._steps[name]
        response = stage.response(name)
        readings = response.readings(values)
        noise, ways = noise_before_steps(stage, name), self._ways(name)
        columns = np.zeros((*values.shape, ways * values.shape[1]))
        for field, path in enumerate(readings.T):
            errors = [*rounding_errors(path, noise, step).T]
            if ways > WAYS:
                errors += [sawtooth(path, noise, step), sawtooth(path - step / 2, noise, step)]
            for way, error in enumerate(errors):
                moved = readings.copy()
                moved[:, field] += error
                columns[:, :, ways * field + way] = response.corrected(moved) - values
        return columns

    def _ways(self, stream: str) -> int:
        """Columns of each field of a stream."""
        return WAYS + SAWTEETH * (instrument_of(stream) in self._sawteeth)
