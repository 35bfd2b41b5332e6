"""How often the 95 % bounds of positioning figures hold the truth: a short look; the sweep has 500 of each axis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from metrology.simulated_positioning import (
    AXES,
    OTHER_AXES,
    Axis,
    interval,
    linear,
    missed,
    rotary,
    widths_of_one_target,
)
from scipy.stats import t as student_t

from rotary_error_monitor.metrology.positioning import PositioningRuns, estimate_positioning
from rotary_error_monitor.metrology.positioning_bounds import BidirectionalBounds, bound_positioning


@pytest.mark.parametrize("kind", ["scatter grows along the travel", "5 targets", "targets alike at the extremes"])
def test_bounds_hold_the_truth(kind: str) -> None:
    """Of 40 draws at 95 %, 31 or fewer come by chance less often than once in a thousand; the sweep has the rate."""
    found = missed(kind, 40)
    assert len(found) == 10
    assert all(sum(each) <= 8 / 40 for each in found.values()), found


@pytest.mark.parametrize("seed", range(3))
def test_bounds_have_the_unit_of_the_readings(seed: int) -> None:
    rng = np.random.default_rng(seed)
    runs = linear(rng, reversal=2.0).measured(rng)
    small, large = bound_positioning(runs), bound_positioning(_scaled(runs, 1000.0))
    for name in ("forward.repeatability", "bidirectional.reversal_error", "bidirectional.accuracy"):
        np.testing.assert_allclose(interval(large, name), np.multiply(1000, interval(small, name)), rtol=1e-6)
    assert bound_positioning(runs) == small


def test_sixteen_times_the_runs_quarter_the_intervals() -> None:
    """By the square root of the number of runs, as each figure's estimate scatters; 50 and 800 runs of eight axes."""
    widths = {
        runs: np.mean([widths_of(replace(_worn(seed), runs=runs), seed) for seed in range(8)], axis=0)
        for runs in (50, 800)
    }
    ratios = widths[50] / widths[800]
    # a width of one test scatters by a third or so where few targets are extremes: the mean of eight by an eighth
    assert np.all((ratios > 3) & (ratios < 5.3)), ratios


def _worn(seed: int) -> Axis:
    return linear(np.random.default_rng(seed), reversal=3.0, wear=1.0)


def widths_of(axis: Axis, seed: int) -> list[float]:
    bounds = bound_positioning(axis.measured(np.random.default_rng([seed, axis.runs])), axis.instrument)
    return [float(np.ptp(interval(bounds, name))) for name in widths_of_one_target(axis)]


@pytest.mark.parametrize("kind", ["small reversal", "rotary", "5 targets", "scatter unequal", "screw, one target high"])
def test_bounds_are_no_wider_than_one_target_alone_would_make_them(kind: str) -> None:
    """Bounds that hold the truth more often than 95 % are not wide for it: all targets together tell the scatter.

    Beside what the target that scatters most tells by itself (chi-square and t) intervals of R and A are some half and
    a third as wide, those of means up to as wide; the mean of ten intervals scatters by a tenth.
    """
    own, alone = [], []
    for seed in range(10):
        axis = (AXES | OTHER_AXES)[kind](np.random.default_rng([seed, 5]))
        own.append(widths_of(axis, seed))
        alone.append(list(widths_of_one_target(axis).values()))
    ratios = dict(zip(widths_of_one_target(axis), np.mean(own, axis=0) / np.mean(alone, axis=0), strict=True))
    for name, ratio in ratios.items():
        assert 0.2 < ratio < (0.9 if name.endswith(("repeatability", "accuracy")) else 1.25), ratios


def test_readings_that_never_differ_leave_no_doubt() -> None:
    targets = np.linspace(0, 1, 6)
    deviations = np.repeat(1e-6 * np.array([[0.0], [1.0], [3.0], [2.0], [5.0], [4.0]]), 5, axis=1)
    runs = PositioningRuns(targets, deviations, deviations - 2e-6)
    both, bounds = estimate_positioning(runs).bidirectional, bound_positioning(runs).bidirectional
    assert both is not None
    assert bounds is not None
    for name in BidirectionalBounds.__dataclass_fields__:
        np.testing.assert_allclose(getattr(bounds, name), getattr(both, name), rtol=1e-9, atol=1e-15)


def test_the_mean_reversal_error_has_the_interval_of_welch() -> None:
    """By the Welch-Satterthwaite formula written out for two targets of five readings there and back."""
    rng = np.random.default_rng(3)
    there, back = 1e-6 * rng.normal(2, 1, size=(2, 5)), 1e-6 * rng.normal(0, 3, size=(2, 5))
    runs = PositioningRuns(np.array([0.0, 1.0]), there, back)
    bounds = bound_positioning(runs).bidirectional
    assert bounds is not None
    parts = np.concatenate([each.var(axis=1, ddof=1) for each in (there, back)]) / 5 / 4
    freedom = parts.sum() ** 2 / np.square(parts).sum() * 4
    expected = student_t.interval(0.95, freedom, (there - back).mean(), np.sqrt(parts.sum()))
    np.testing.assert_allclose(bounds.mean_reversal_error, expected, rtol=1e-9)


def test_the_largest_reversal_error_is_no_smaller_than_the_mean_one_where_all_are_alike() -> None:
    """In 2 of 100 that is refuted; of 30 at 3 %, 6 or more are by chance less often than once in a thousand."""
    refuted = 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        bounds = bound_positioning(linear(rng, reversal=8.0).measured(rng)).bidirectional
        assert bounds is not None
        assert bounds.mean_reversal_error[0] < bounds.reversal_error[1]
        refuted += bounds.reversal_error[0] != bounds.mean_reversal_error[0]
    assert refuted <= 5


def test_one_direction_has_bounds_of_its_own() -> None:
    rng = np.random.default_rng(5)
    runs = linear(rng).measured(rng)
    bounds = bound_positioning(PositioningRuns(runs.targets, runs.forward, None))
    assert bounds.backward is None
    assert bounds.bidirectional is None
    assert 0 < bounds.forward.repeatability[0] < bounds.forward.repeatability[1]


@pytest.mark.parametrize("make", [linear, rotary])
def test_missing_readings_widen_the_bounds(make: object) -> None:
    """Two or three readings of five at each target: intervals of R grow by what their degrees of freedom say."""
    widths = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        runs = make(rng).measured(rng)  # type: ignore[operator]
        forward, backward = runs.forward.copy(), runs.backward.copy()
        forward[:, 3:], backward[:, 2:] = np.nan, np.nan
        fewer = PositioningRuns(runs.targets, forward, backward, runs.rotary)
        pair = [np.ptp(bound_positioning(each).forward.repeatability) for each in (runs, fewer)]
        widths.append(pair[1] / pair[0])
    assert np.mean(widths) > 1.2


@pytest.mark.parametrize("targets", [2, 3, 4, 6, 40])
def test_any_number_of_targets(targets: int) -> None:
    rng = np.random.default_rng(targets)
    readings = 1e-6 * rng.normal(size=(2, targets, 2))
    bounds = bound_positioning(PositioningRuns(np.linspace(0, 6, targets), readings[0], readings[1], targets > 3))
    low, high = interval(bounds, "bidirectional.accuracy")
    assert 0 <= low < high < 1e-2


def test_an_instrument_moves_ranges_and_no_repeatability() -> None:
    """By 1.96 times its uncertainty where that is most of it (ISO 230-2:2014, Annex A: not of B and R)."""
    rng = np.random.default_rng(2)
    runs = linear(rng, span=60.0).measured(rng)
    without, with_it = bound_positioning(runs), bound_positioning(runs, 20e-6)
    for name in ("forward.repeatability", "bidirectional.reversal_error", "bidirectional.repeatability"):
        assert interval(with_it, name) == interval(without, name)
    low, high = interval(with_it, "bidirectional.mean_deviation_range")
    assert high - low == pytest.approx(2 * 1.96 * 20e-6, rel=0.1)


def test_every_axis_of_the_sweep_can_be_measured() -> None:
    for make in (*AXES.values(), *OTHER_AXES.values()):
        rng = np.random.default_rng(0)
        assert np.isfinite(make(rng).measured(rng).forward).all()


def _scaled(runs: PositioningRuns, factor: float) -> PositioningRuns:
    assert runs.backward is not None
    return replace(runs, forward=factor * runs.forward, backward=factor * runs.backward)
