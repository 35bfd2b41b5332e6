"""Signals of one sensor that is no head as white rows."""

from __future__ import annotations

from dataclasses import dataclass

from rotary_error_monitor.arrays import Array, Mask
from rotary_error_monitor.noise.channels import channels_of
from rotary_error_monitor.noise.lost_samples import bridge
from rotary_error_monitor.noise.whitening import Whitener, runs_of
from rotary_error_monitor.twin.recording import SignalStream


@dataclass(frozen=True)
class SensorRows:
    """What of a sensor's samples becomes rows.

    Attributes:
        name: of the stream.
        stream: its samples.
        kept: (n,) those that take part.
        spikes: (n, fields) those that are spikes.
        weights: (n, fields) of samples whose rounding errors repeat; None for one each.
    """

    name: str
    stream: SignalStream
    kept: Mask
    spikes: Mask
    weights: Array | None

    def white(self, values: Array, std: float, whitener: Whitener | None) -> dict[str, Array]:
        """White rows (n, p) by channel of signals (n, fields, p).

        Args:
            values: signals.
            std: standard deviation of the white noise of a sample.
            whitener: of noise that has a slow part, this white part in it; None where it has none.
        """
        rows = {}
        for i, channel in enumerate(channels_of(self.name)):
            spikes = self.spikes[:, i]
            if whitener is not None:
                white = whitener.apply(bridge(values[:, i], spikes), runs_of(self.stream, self.kept))
            else:
                white = values[:, i] / std
                white *= self.kept[:, None]
            if spikes.any():
                white[spikes] = 0.0
            if self.weights is not None:
                white *= self.weights[:, i, None]
            rows[channel] = white
        return rows
