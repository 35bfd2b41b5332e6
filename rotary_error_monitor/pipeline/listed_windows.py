"""What the fields of listed sensors say over a window of ticks."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.streams import AUTOCOLLIMATOR
from rotary_error_monitor.pipeline.evidence import WindowGrid
from rotary_error_monitor.pipeline.listed_belief import SensorWindow
from rotary_error_monitor.pipeline.listed_readings import ListedTicks


def sensor_windows(
    number: int,
    grid: WindowGrid,
    period: float,
    shown: ListedTicks,
    streams: Sequence[str],
    rates: Mapping[str, float],
) -> Iterator[tuple[int, SensorWindow]]:
    """What the fields say over a window, by their places; nothing of those that were not there all the time.

    Args:
        number: of the window.
        grid: of windows.
        period: distance of two ticks, s.
        shown: the ticks of the window.
        streams: (p,) that the fields are of.
        rates: samples per s of each stream.
    """
    ticks = grid.ticks
    for place, stream in enumerate(streams):
        if not shown.there[:, place].all():
            continue
        samples = ticks * min(1.0, rates[stream] * period)
        surplus = shown.surplus[:, place]
        # of the autocollimator less than one sample a window where it is slow: the next windows hold the same
        slower = ticks * min(1.0, rates.get(AUTOCOLLIMATOR, math.inf) * period)
        yield (
            place,
            SensorWindow(
                number,
                grid.duration,
                ticks,
                samples,
                float(shown.theta.sum() / ticks),
                float(shown.raw[:, place].sum() / ticks),
                float(surplus.sum() / ticks),
                float(shown.undescribed[:, place].sum() / ticks),
                _scatter(surplus),
                _scatter(shown.undescribed[:, place]),
                float(shown.noise[:, place].sum() / ticks),
                float(shown.variance[:, place].sum() / ticks),
                float(shown.systematic[:, place].max()),
                float(shown.others[:, place].max()),
                float(shown.stamps[:, place].max()),
                float(shown.unknown[:, place].max()),
                float(shown.rate[:, place].max()),
                _shared(float(shown.tilt[:, place].sum() / ticks), slower, samples),
            ),
        )


def _shared(variance: float, slower: float, samples: float) -> float:
    """What noise with fewer independent values in a window adds to the variance of a mean over `samples` of them."""
    return variance * max(0.0, 1.0 / slower - 1.0 / max(1.0, samples)) if slower > 0.0 else 0.0


def _scatter(values: Array) -> float:
    """Variance of values about a straight line; 0 where they are too few to tell."""
    count = len(values)
    if count < 3:
        return 0.0
    off = values - values.sum() / count
    course = np.arange(count) - 0.5 * (count - 1)
    off = off - course * (float((off * course).sum()) / float((course**2).sum()))
    return float((off**2).sum()) / (count - 2)
