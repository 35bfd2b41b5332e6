"""Samples of a stage's sensors that are off by more than noise and motion explain, and take no part."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.ndimage import median_filter

from rotary_error_monitor.arrays import Array, Mask
from rotary_error_monitor.noise.head_grid import HeadGrid
from rotary_error_monitor.signals.gross_readings import gross_readings, recurring
from rotary_error_monitor.signals.reading_noise import spread_of
from rotary_error_monitor.twin.recording import SignalStream

SPIKE = 6.0
"""A sample further than this many standard deviations from its neighbours' median is a spike: one in 10^9 by chance."""


def find_spikes(residual: Array, std: float, stream: SignalStream, command: SignalStream) -> Mask:
    """(n, k) samples of a sensor, in each of its fields, that are spikes.

    Args:
        residual: (n, k) measured minus predicted.
        std: standard deviation of the noise of a sample.
        stream: the samples.
        command: of the rotation.
    """
    # The median of neighbours follows every effect that is slower than a few samples, however large.
    apart = residual - median_filter(residual, (7, 1), mode="mirror")
    spread = spread_of(apart)
    found = np.abs(apart) > SPIKE * np.maximum(spread, std)
    found |= gross_readings(residual, std, stream.period)
    angle = np.interp(stream.time, command.time, command.values[:, 0])
    for spikes in found.T:
        spikes &= ~recurring(spikes, angle)
    return np.asarray(found, bool)


def find_head_spikes(
    grid: HeadGrid, residual: Mapping[str, Array], std: float, azimuths: Mapping[str, float], command: SignalStream
) -> dict[str, Mask]:
    """(n, 1) samples of each head that are spikes; what all heads show at once is motion.

    Args:
        grid: the heads side by side.
        residual: (n, 1) measured minus predicted of each.
        std: standard deviation of the noise of a sample.
        azimuths: rad, of each head, by the names of the streams.
        command: of the rotation.
    """
    every, rotation = np.arange(len(grid.time)), np.interp(grid.time, command.time, command.values[:, 0])
    table = np.empty(grid.present.shape)
    for i, name in enumerate(grid.heads):
        read = np.zeros(len(every))
        read[grid.rows[name]] = residual[name][:, 0]
        table[:, i] = np.interp(every, every[grid.present[:, i]], read[grid.present[:, i]])
    # Of two heads nobody knows which one is off.
    gross = gross_readings(table, std, grid.period, together=len(grid.heads) > 2) & grid.present
    # A mark on the ring passes one head after the other.
    passed = np.concatenate([azimuths[name] - rotation for name in grid.heads])
    marks = recurring(gross.T.ravel(), passed).reshape(len(grid.heads), -1)
    alone = gross & ~marks.T
    return {name: alone[grid.rows[name], i][:, None] for i, name in enumerate(grid.heads)}
