"""All channels of one instrument, as sums over cells of the recording: what is slow shows in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import helmert

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.rotor import HEAD
from rotary_error_monitor.gap.problem import Columns, LateRows, Rows, SparseRows
from rotary_error_monitor.noise.stage_noise import StageNoise
from rotary_error_monitor.sensors.library import instrument_of


class InstrumentSums:
    """Sums of white rows over cells, for components that are independent of one another.

    Args:
        name: of the instrument: see `sensors.library.instrument_of`.
        channels: of the recording; those of other instruments are left out.
        noise: of the recording.
        times: (m,) s of its rows.

    Attributes:
        name: of the instrument.
        time: (k,) s, mean of each cell.
        passed: (k,) part of the recording that has passed by then.
        weight: (c, k) what a course of one adds to each sum of a component, over the usual one.
        usual: that of the usual cell.
    """

    def __init__(self, name: str, channels: Sequence[str], noise: StageNoise, times: Array) -> None:
        self.name, self._noise = name, noise
        self._channels = [channel for channel in channels if instrument_of(channel) == name]
        count = len(self._channels)
        # What each head shows beyond their mean sums to zero: contrasts do not.
        self._components = helmert(count) if name == HEAD else np.eye(count)
        cells = [noise.cells(channel) for channel in self._channels]
        self.time = np.add.reduceat(times, cells[0].starts) / np.diff(np.append(cells[0].starts, len(times)))
        self.passed = (self.time - times[0]) / (times[-1] - times[0])
        size = np.sqrt(np.square(self._components) @ np.square(np.stack([own.size for own in cells])))
        self.usual = float(np.sqrt(np.mean(np.square(size))))
        self.weight = size / self.usual

    def sums(self, columns: Rows | SparseRows) -> Array:
        """(c, k, p) of white columns, as they would be without slow noise."""
        rows = columns.rows if isinstance(columns, SparseRows) else columns
        found = next((own.shape[1] for own in rows.values()), 0)
        width = columns.width if isinstance(columns, SparseRows) else found
        sums = np.zeros((len(self._channels), len(self.time), width))
        for part, channel in zip(sums, self._channels, strict=True):
            if channel in rows:
                acting = columns.acting[channel] if isinstance(columns, SparseRows) else slice(None)
                part[:, acting] = self._noise.plain_sums(channel, rows[channel])
        return np.tensordot(self._components, sums, 1)

    def stacked(self, columns: Columns) -> Array:
        """(c k, p) the same, components one after the other."""
        if isinstance(columns, LateRows):
            raise TypeError("rows of a stretch are kept")
        sums = self.sums(columns)
        return sums.reshape(sums.shape[0] * sums.shape[1], sums.shape[2])
