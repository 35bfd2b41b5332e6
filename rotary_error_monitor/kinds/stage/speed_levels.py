"""How noise of an instrument grows with the rotor's speed, told from neighbouring rows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.rotor import HEAD
from rotary_error_monitor.gap.noise_level import LOUDEST_IN_MOTION, NOISIER
from rotary_error_monitor.gap.structure import Track
from rotary_error_monitor.noise.noise_by_speed import NoiseBySpeed
from rotary_error_monitor.noise.stage_noise import StageNoise
from rotary_error_monitor.sensors.library import instrument_of

CLASSES = 8
"""Ranges of speed between whose middles levels are interpolated."""

PARTS = 10
"""Parts of the rows of a range, by time: what happens in a few of them is not noise."""

FEWEST = 10 * PARTS
"""Rows from which a range tells a level, to 15 %."""

INDEPENDENT = 400 / 924
"""Of squares of third differences of white noise: (sum c^2)^2 over the sum of squares of its autocorrelation."""


def noise_by_speed(tracks: Sequence[Track], noise: StageNoise) -> NoiseBySpeed | None:
    """How many times as loud as stated an instrument's noise is at each speed; None where one level holds for all.

    Levels are maximum-likelihood under the condition that none falls with speed (Barlow et al., Statistical Inference
    under Order Restrictions, 1972), and are no less than stated: rounding and filters make noise quieter at rest, and
    are accounted for elsewhere. That they grow has to be likelier than one level by the Bayesian information criterion
    (Schwarz 1978). Third differences leave nothing of what is smooth over four samples.

    Args:
        tracks: white rows of all channels of the instrument.
        noise: with which they are white.
    """
    instrument = instrument_of(tracks[0].channel)
    squares, speeds = [], []
    for track in tracks:
        speed = noise.by_speed.speed(track.time)
        louder = noise.levels[instrument] * noise.by_speed.louder(instrument, track.time)
        squares.append(np.square(np.diff(track.rows * louder, 3)) / 20)
        speeds.append(0.5 * (speed[1:-2] + speed[2:-1]))
    every = np.concatenate(speeds)
    edges = np.linspace(float(every.min()), float(every.max()), CLASSES + 1)[1:-1]
    ranges = [np.searchsorted(edges, own) for own in speeds]
    told = [number for number in range(CLASSES) if min(np.count_nonzero(own == number) for own in ranges) >= FEWEST]
    if len(told) < 2:
        return None
    found = np.array([_usual([own[in_it == k] for own, in_it in zip(squares, ranges, strict=True)]) for k in told])
    independent = 1 - 1 / len(tracks) if instrument == HEAD and len(tracks) > 1 else 1.0
    every_range = np.concatenate(ranges)
    dof = INDEPENDENT * independent * np.array([np.count_nonzero(every_range == k) for k in told])
    variance, constant = np.maximum(_rising(found, dof), 1.0), max(1.0, float(np.average(found, weights=dof)))
    gain = 0.5 * float(np.sum(dof * (np.log(constant / variance) + found / constant - found / variance)))
    level = np.sqrt(variance)
    grows = gain > 0.5 * (len(np.unique(level)) - 1) * np.log(np.sum(dof)) and level[-1] > (1 + NOISIER) * level[0]
    if not grows or level[-1] > LOUDEST_IN_MOTION:
        return None
    return NoiseBySpeed(np.array([float(np.mean(every[every_range == k])) for k in told]), level / level[0])


def _usual(squares: Sequence[Array]) -> float:
    """Mean of squares (n,) in time of each channel, but no more than that of the part in the middle."""
    parts = np.mean([[float(np.mean(part)) for part in np.array_split(own, PARTS)] for own in squares], axis=0)
    return float(min(np.mean(parts), np.median(parts)))


def _rising(values: Array, weight: Array) -> Array:
    """(k,) the nearest to values (k,) by weighted least squares that nowhere fall: their max-min formula."""
    places = range(len(values))
    mean = {(a, b): float(np.average(values[a : b + 1], weights=weight[a : b + 1])) for a in places for b in places[a:]}
    return np.array([max(min(mean[a, b] for b in places[i:]) for a in places[: i + 1]) for i in places])
