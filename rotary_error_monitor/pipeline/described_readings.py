"""What of an autocollimator's readings is described, at the rotation of each reading, for ticks between them.

Where a rotor turns far from one reading to the next, no interpolation follows what turns with it, but what of that is
described is known. So it is taken off each reading at its own rotation; what is left goes slowly, and is interpolated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array, Mask
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import AUTOCOLLIMATOR, COMMAND
from rotary_error_monitor.metrology.encoder_heads import HeadLayout
from rotary_error_monitor.pipeline.distance_reach import ACCELERATION
from rotary_error_monitor.pipeline.estimator_settings import LONGEST_GAP_NS
from rotary_error_monitor.pipeline.mixed_rotation import described_lead
from rotary_error_monitor.pipeline.stream_limits import described_tilt, described_tilts
from rotary_error_monitor.signals.blocks import NANOSECONDS
from rotary_error_monitor.signals.resampling import Resampled, resample, resample_all
from rotary_error_monitor.signals.streams import SampleStream
from rotary_error_monitor.units import TURN

PART = 0.1
"""Part of the noise of a reading that interpolation may miss of what is described: of its variance a hundredth."""

FITTED = 0.6
"""Part of a cell that the samples of a fit cover at least."""

_LAST = 3
"""Place of the last of the readings that a value between them rests on."""


class DescribedReadings:
    """Describes the readings of one autocollimator at their own rotations, where interpolation would miss too much.

    Whether it would follows at each tick from what the tick rests on anyway, so that it is the same live and in replay.
    """

    def __init__(
        self,
        stage: StageDescription,
        streams: Mapping[str, SampleStream],
        bits: Mapping[str, int],
        layout: Callable[[tuple[str, ...]], HeadLayout | None],
        period_ns: int,
    ) -> None:
        """For a stage.

        Args:
            stage: its description.
            streams: by their names.
            bits: bit of each stream in a mask, by its name.
            layout: gives that of some heads by their names; None of none.
            period_ns: distance of two ticks, ns.
        """
        self._stage, self._streams, self._layout, self._period_ns = stage, streams, layout, period_ns
        self._fastest = stage.limits.speed
        heads = tuple(f"head_{name}" for name in stage.azimuths)
        self._sources = heads or (COMMAND,)
        self._bits = {name: bits[name] for name in self._sources}
        self._mask, self._bit = sum(self._bits.values()), bits[AUTOCOLLIMATOR]
        self._followed, instrument = np.inf, stage.autocollimator
        if instrument is not None:
            path = streams[AUTOCOLLIMATOR].admission.limits.path or described_tilts(stage)
            self._followed = path.followed(PART * float(np.hypot(instrument.noise, instrument.resolution)))
        self._near_ns = self._followed_for(self._fastest) * NANOSECONDS
        self._are_near = True

    def look(self) -> None:
        """See whether all readings in memory follow so soon that no rotor of the stage turns too far between them."""
        if self._near_ns < np.inf:
            times = self._streams[AUTOCOLLIMATOR].times_ns
            self._are_near = bool((times[1:] - times[:-1]).max(initial=0) < self._near_ns)

    def count_known(
        self, ticks: NDArray[np.int64], sampled: Mapping[str, Resampled], decided: Mapping[str, int]
    ) -> int:
        """How many of the first ticks (m,) need not wait for the rotation of a reading.

        Args:
            ticks: timestamps (ns).
            sampled: the streams at the ticks, by name.
            decided: tick before which the values of a stream are known, by name, of those that are waited for.
        """
        sources = [name for name in self._sources if name in decided]
        if self._are_near or not sources:
            return len(ticks)
        apart = self._apart(ticks)
        waits = self._is_far(self._fastest, apart)
        if not waits.any():
            return len(ticks)
        waits &= sampled[AUTOCOLLIMATOR].valid
        until_ns = (min(decided[name] for name in sources) - 1) * self._period_ns + self._period_ns // 2
        times = self._streams[AUTOCOLLIMATOR].times_ns
        waits &= times[_first_of(times, ticks) + _LAST] > until_ns
        far = np.zeros(len(ticks), np.bool_)
        for name in sources if waits.any() else ():
            far |= sampled[name].valid & self._is_far(self._speed(name, ticks, sampled[name]), apart)
        waits &= far
        return int(waits.argmax()) if waits.any() else len(ticks)

    def needed_from_ns(self, tick: int) -> int:
        """Timestamp (ns) from which on the ticks from `tick` on need the samples that tell the rotation."""
        begin_ns = tick * self._period_ns
        if self._are_near:
            return begin_ns
        times = self._streams[AUTOCOLLIMATOR].times_ns
        first = int(np.searchsorted(times, begin_ns)) - _LAST
        if not 0 <= first < len(times) - 1:
            return begin_ns
        apart_ns = (times[first + 1 :] - times[first:-1]).max()
        return int(times[first]) - 2 * self._period_ns if apart_ns > self._near_ns else begin_ns

    def at(
        self, ticks: NDArray[np.int64], sampled: Mapping[str, Resampled], used: NDArray[np.int64], max_gap_ns: int
    ) -> tuple[Resampled | None, NDArray[np.int64] | None]:
        """What is described of the readings, interpolated to ticks (m,) as they are, by the streams that are `used`.

        Args:
            ticks: (m,) timestamps (ns).
            sampled: the streams at the ticks, by name.
            used: (m,) masks of the streams that tell something.
            max_gap_ns: samples that tell the rotation and are further apart than this are not joined, ns.

        Returns:
            What is described, valid where it is to be taken off what is read, None where interpolation follows it at
            all ticks; and (m,) the autocollimator's bit where it is not known though interpolation misses too much,
            None where that is nowhere.
        """
        if self._are_near:
            return None, None
        found, lacking = None, np.zeros(len(ticks), np.int64)
        apart = self._apart(ticks)
        far = (used & self._bit != 0) & self._is_far(self._fastest, apart)
        for mask in np.unique(used[far] & self._mask).tolist():
            names = tuple(name for name, bit in self._bits.items() if mask & bit)
            weights = self._weights(names)
            if weights is None:
                continue
            chosen = far & (used & self._mask == mask)
            chosen &= self._is_far(self._speed(names[0], ticks, sampled[names[0]]), apart)
            if chosen.any():
                found = found or Resampled.nothing(len(ticks), 2)
                found = found.replaced(chosen, self._described(ticks[chosen], names, weights, max_gap_ns))
                lacking[chosen & ~found.valid] = self._bit
        return found, lacking

    def _followed_for(self, speed: float) -> float:
        """Time, s, between readings up to which a rotor of a speed, rad/s, does not turn too far."""
        root = math.sqrt(speed**2 + 8.0 * ACCELERATION * self._followed) if self._followed < np.inf else np.inf
        return (root - speed) / (4.0 * ACCELERATION)

    def _is_far(self, speed: float | Array, apart: float | Array) -> Mask:
        """Whether a rotor turns too far in times, s, about one at which it has a speed, rad/s: it may accelerate."""
        return np.asarray((speed + 2.0 * ACCELERATION * apart) * apart > self._followed)

    def _apart(self, ticks: NDArray[np.int64]) -> Array:
        """(m,) largest distance of the readings that ticks rest on, s; 0 where there are too few."""
        times = self._streams[AUTOCOLLIMATOR].times_ns
        if len(times) <= _LAST:
            return np.zeros(len(ticks))
        first = _first_of(times, ticks)
        distances = [times[first + i + 1] - times[first + i] for i in range(_LAST)]
        return np.asarray(np.maximum(np.maximum(*distances[:2]), distances[2]) * 1e-9)

    def _speed(self, name: str, ticks: NDArray[np.int64], sampled: Resampled) -> Array:
        """(m,) speed of the rotor by one stream, rad/s, no more than it can be."""
        times = self._streams[name].times_ns
        if len(times) <= _LAST:
            return np.full(len(ticks), self._fastest)
        first = _first_of(times, ticks)
        passed = np.asarray(times[first + _LAST] - times[first], np.float64)
        passed = np.where(sampled.bend[:, 0] == 0.0, FITTED * self._period_ns, passed)  # of a fit
        return np.asarray(np.minimum(sampled.travel[:, 0] / (passed * 1e-9), self._fastest))

    def _weights(self, names: tuple[str, ...]) -> Array | None:
        """Weights of streams for the rotation; None where they do not tell it."""
        if names == (COMMAND,):
            return np.ones(1)
        layout = self._layout(names)
        return None if layout is None else layout.weights[0]

    def _described(
        self, ticks: NDArray[np.int64], names: tuple[str, ...], weights: Array, max_gap_ns: int
    ) -> Resampled:
        """What is described of the readings, interpolated to ticks (m,), valid where all it rests on is known."""
        times, cell = self._streams[AUTOCOLLIMATOR].times_ns, self._period_ns
        begin, end = np.searchsorted(times, [int(ticks[0]) - cell, int(ticks[-1]) + cell]).tolist()
        times = times[max(begin - _LAST, 0) : end + _LAST]
        theta, known = self._rotation(times, names, weights, max_gap_ns)
        described = described_tilt(self._stage, theta)
        described[~known] = np.nan  # and so is all that rests on it
        found = resample(times, described, ticks, cell, LONGEST_GAP_NS)
        return replace(found, valid=found.valid & np.isfinite(found.values).all(axis=1))

    def _rotation(
        self, times: NDArray[np.int64], names: tuple[str, ...], weights: Array, max_gap_ns: int
    ) -> tuple[Array, Mask]:
        """(n,) rotation at timestamps (ns), but for whole turns, and whether it is known."""
        streams = [self._streams[name] for name in names]
        signals = [(stream.times_ns, stream.values) for stream in streams]
        found = resample_all(signals, times, self._period_ns, max_gap_ns)
        theta, known = np.zeros(len(times)), np.ones(len(times), np.bool_)
        for weight, each, stream in zip(weights, found, streams, strict=True):
            turns = np.rint((each.values[:, 0] - found[0].values[:, 0]) / TURN)  # each counts from a zero of its own
            theta += weight * (each.values[:, 0] - TURN * turns)
            known &= each.valid
            if stream.has_gaps:
                known &= stream.is_whole(times, self._period_ns, after_patience=False)
        layout = self._layout(names) if names != (COMMAND,) else None
        if layout is not None and not layout.tells_rotation:  # what the place of the ring adds, as far as described
            azimuths = tuple(self._stage.azimuths[name.removeprefix("head_")] for name in names)
            alike = np.repeat(theta[:, None], len(names), axis=1)
            theta -= described_lead(self._stage, azimuths, alike).mean(axis=1)
        return np.where(known, theta, 0.0), known


def _first_of(times: NDArray[np.int64], ticks: NDArray[np.int64]) -> NDArray[np.intp]:
    """(m,) place of the first of the four of at least as many samples around each tick."""
    return np.clip(np.searchsorted(times, ticks, side="right") - 2, 0, len(times) - 1 - _LAST)
