"""Departures of runs from their mean: within what the repeatability says, at the ends of scans as well."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.calibration.measurements import Placement
from rotary_error_monitor.calibration.straightness_runs import ReadingSettings, place_runs
from rotary_error_monitor.metrology.repeated_runs import Run

NOISE = 35e-9


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("stops", [False, True])
def test_no_departure_is_larger_than_the_repeatability_says(seed: int, stops: bool) -> None:
    """Five runs each way over a steep curve, samples 1 mm apart that begin anywhere, or shared by all runs.

    With shared stops the picture takes the mean height of each run off, which moves it by that of 440 readings' noise.
    """
    rng = np.random.default_rng(seed)
    runs = []
    for number in range(10):
        way = -1 if number % 2 else 1
        first = 0.0 if stops else rng.uniform(0, 1e-3)
        x = (first + np.arange(-0.8, -0.36, 1e-3))[::way]
        readings = 5e-6 * np.sin(9 * x) + 3e-6 * x / 0.4 + NOISE * rng.normal(size=x.size)
        runs.append(Run(x, readings, way))
    placed = place_runs(Placement(tuple(runs)), ReadingSettings(NOISE))
    assert placed.combined.stops == stops
    departures = placed.departures()
    assert all(len(each) == len(run.positions) for each, run in zip(departures, runs, strict=True))
    largest = np.max(np.abs(np.concatenate(departures)))
    assert largest == pytest.approx(placed.combined.largest_deviation, abs=0.2 * NOISE)
