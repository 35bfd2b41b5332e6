"""Reference lines against closed forms and brute force; repeated runs of guideways of known form."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.repeated_runs import Run, combine_runs
from rotary_error_monitor.metrology.straightness import LineMethod, estimate_straightness, fit_line
from rotary_error_monitor.metrology.unresolved import find_unresolved

METHODS: tuple[LineMethod, ...] = ("least_squares", "end_point", "minimum_zone")


def test_parabola_in_closed_form() -> None:
    x = np.linspace(-1.0, 1.0, 2001)
    profile = 3e-6 * x**2 + 2e-6 * x + 1e-6
    for method in METHODS:
        result = estimate_straightness(x, profile, method)
        assert result.line.slope == pytest.approx(2e-6, rel=1e-6)
        assert result.error == pytest.approx(3e-6, rel=1e-6)
    assert fit_line(x, profile, "end_point").heights(np.array([0.0]))[0] == pytest.approx(4e-6)
    assert fit_line(x, profile, "minimum_zone").heights(np.array([0.0]))[0] == pytest.approx(2.5e-6)
    assert fit_line(x, profile, "least_squares").heights(np.array([0.0]))[0] == pytest.approx(2e-6, rel=1e-3)


def narrowest_zone(x: np.ndarray, y: np.ndarray) -> float:
    """The narrowest zone touches two points on one side: try every pair."""
    widths = []
    for i, j in itertools.combinations(range(len(x)), 2):
        if x[i] != x[j]:
            widths.append(float(np.ptp(y - (y[j] - y[i]) / (x[j] - x[i]) * x)))
    return min(widths)


@settings(max_examples=100, deadline=None)
@given(st.integers(3, 12), st.integers(0, 2**32 - 1))
def test_minimum_zone_against_all_pairs(count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1.4, 0.0, count)
    y = 5e-6 * rng.normal(size=count)
    error = estimate_straightness(x, y, "minimum_zone").error
    assert error == pytest.approx(narrowest_zone(x, y), rel=1e-6)
    assert error <= estimate_straightness(x, y, "least_squares").error * (1 + 1e-9)
    assert error <= estimate_straightness(x, y, "end_point").error * (1 + 1e-9)


def test_least_squares_against_polyfit() -> None:
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, 1, 50), rng.normal(size=50)
    line = fit_line(x, y)
    slope, offset = np.polyfit(x, y, 1)
    np.testing.assert_allclose(line.heights(x), offset + slope * x)


@pytest.mark.parametrize("method", METHODS)
def test_a_straight_line_is_straight(method: LineMethod) -> None:
    x = np.array([0.0, 0.3, 0.31, 1.0])
    assert estimate_straightness(x, 1e-3 + 2e-3 * x, method).error < 1e-12
    assert estimate_straightness(x, np.zeros(4), method).error == 0.0


def scans(reversal: float, spread: float, seed: int) -> list[Run]:
    rng = np.random.default_rng(seed)
    made = []
    for number in range(10):
        direction = 1 if number % 2 == 0 else -1
        x = np.sort(rng.uniform(-0.8, -0.36, 440))[::direction]
        shape = 3e-6 * np.sin(8 * x) + 0.5 * direction * reversal * np.cos(20 * x)
        made.append(Run(x, shape + spread * rng.normal(size=x.size) + 1e-5 * rng.normal(), direction))
    return made


def test_scans_at_positions_of_their_own_show_reversal_and_repeatability() -> None:
    for seed in range(5):
        made = scans(reversal=0.4e-6, spread=60e-9, seed=seed)
        result = combine_runs(made, spacing=10e-3)
        assert not result.stops
        assert result.positions[0] == min(run.positions.min() for run in made)
        assert result.positions[-1] == max(run.positions.max() for run in made)
        assert result.uncertainty is not None
        expected = 3e-6 * np.sin(8 * result.positions)
        error = result.mean - expected
        # A hundred samples between two nodes; the height of all is free.
        np.testing.assert_array_less(np.abs(error - error.mean()), 5 * result.uncertainty)
        assert result.uncertainty.max() < 30e-9
        assert result.reversal is not None
        wave = 0.4e-6 * np.cos(20 * result.positions)
        np.testing.assert_array_less(
            np.abs(result.reversal - wave - np.mean(result.reversal - wave)), 10 * result.uncertainty
        )
        assert result.spread.mean() == pytest.approx(60e-9, rel=0.05)


def by_repetition(result) -> float:
    """Standard uncertainty of the mean, root mean square over the positions, m; 0 where no run was repeated."""
    return 0.0 if result.uncertainty is None else float(np.sqrt(np.mean(result.uncertainty**2)))


def test_repeatability_is_that_of_the_runs() -> None:
    rng = np.random.default_rng(2)
    x = np.linspace(0, 1, 201)
    made = [Run(x, 100e-9 * rng.normal(size=x.size), 1) for _ in range(20)]
    result = combine_runs(made)
    assert np.sqrt((result.spread**2).mean()) == pytest.approx(100e-9, rel=0.05)
    assert by_repetition(result) == pytest.approx(100e-9 / math.sqrt(20), rel=0.05)
    assert result.reversal is None
    assert result.largest_deviation > 300e-9


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_repeated_coarse_runs_are_one_run(count: int) -> None:
    """A bow of 35 µm at 21 stops over 5 m without noise: however often it is measured, nothing is cut or smoothed."""
    x = np.linspace(-2.5, 2.5, 21)
    made = [Run(x[::way], 35e-6 * (x[::way] / 2.5) ** 2, way) for way in [1, -1, 1, 1, -1][:count]]
    result = combine_runs(made)
    np.testing.assert_allclose(result.positions, x, rtol=0, atol=1e-15)
    assert np.ptp(result.mean) == pytest.approx(35e-6, rel=1e-12)
    assert by_repetition(result) < 1e-15
    assert result.outliers == ()
    assert estimate_straightness(result.positions, result.mean).error == pytest.approx(35e-6, rel=1e-12)


class Guide:
    """A guideway of random form, measured at stops or by scans, with the departures that a draw gives it."""

    def __init__(self, rng: np.random.Generator, kind: str, length: float) -> None:
        self.rng, self.length = rng, length
        if kind == "bow":
            self.rows = [(3e-5 * rng.normal(), 0.0, 0)]
        elif kind == "waves":
            self.rows = [(5e-6 * rng.normal() / k, rng.uniform(0, 2 * np.pi), k) for k in range(1, 6)]
        else:
            self.rows = []
        self.grid = np.linspace(-0.51 * length, 0.51 * length, 4001)
        self.walk = np.cumsum(rng.normal(size=4001)) * 1.5e-7 if kind == "rough" else np.zeros(4001)
        self.corner = rng.uniform(-0.25, 0.25) * length if kind == "corner" else None

    def truth(self, x: np.ndarray) -> np.ndarray:
        total = np.interp(x, self.grid, self.walk)
        for size, phase, k in self.rows:
            u = 2 * x / self.length
            total = total + (size * u**2 if k == 0 else size * np.cos(np.pi * k * u / 2 + phase))
        return total if self.corner is None else total + 2e-5 * np.abs(x - self.corner) / self.length

    def runs(self, stops: int, count: int, noise: float, jitter: float, missing: float, both: bool) -> list[Run]:
        grid, made = np.linspace(-self.length / 2, self.length / 2, stops), []
        slope = 1e-4 * self.rng.normal()
        for number in range(count):
            way = -1 if both and number % 2 else 1
            kept = self.rng.uniform(size=stops) >= missing
            kept[[0, -1]] = True
            x = grid[kept] + jitter * self.rng.normal(size=kept.sum())
            y = self.truth(x) + slope * x + 0.5e-6 * way * both * np.cos(3 * x) + 1e-5 * self.rng.normal()
            made.append(Run(x[::way], (y + noise * self.rng.normal(size=x.size))[::way], way))
        return made


def level(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return y - np.polyval(np.polyfit(x, y, 1), x)


@pytest.mark.parametrize("kind", ["bow", "waves", "rough", "corner"])
@pytest.mark.parametrize(
    ("stops", "count", "jitter", "missing", "both"),
    [
        (21, 3, 0.0, 0.0, False),
        (21, 4, 0.0, 0.15, True),
        (11, 6, 1e-3, 0.0, True),
        (41, 5, 1e-3, 0.1, False),
        (9, 2, 0, 0, False),
    ],
)
def test_the_mean_at_the_stops_is_right_within_its_uncertainty(
    kind: str, stops: int, count: int, jitter: float, missing: float, both: bool
) -> None:
    """Random forms, tilts, numbers of stops and runs, either direction, stops left out, stops that are a little off."""
    errors, flagged = [], 0
    for seed in range(60):
        guide = Guide(np.random.default_rng(seed), kind, 5.0)
        runs = guide.runs(stops, count, 1e-7, jitter, missing, both)
        result = combine_runs(runs)
        visited = {round(float(x) * (stops - 1) / 5.0 + (stops - 1) / 2) for run in runs for x in run.positions}
        assert result.stops
        assert len(result.positions) == len(visited)
        assert result.uncertainty is not None
        errors += list(level(result.positions, result.mean - guide.truth(result.positions)) / result.uncertainty)
        flagged += bool(result.outliers)
    # 60 recordings of about 20 stops; a rough guide between stops that are off is no normal noise
    assert np.mean(np.abs(errors) < 1.96) >= 0.92
    assert 0.6 < np.sqrt(np.mean(np.square(errors))) < 1.2
    # a false alarm of 0.1 %: more than three in 60 have a probability of 1e-6
    assert flagged <= (6 if kind == "rough" and jitter else 3)


@settings(max_examples=200, deadline=None)
@given(st.integers(3, 30), st.integers(2, 6), st.booleans(), st.integers(0, 2**32 - 1))
def test_complete_runs_give_the_arithmetic_mean(stops: int, count: int, both: bool, seed: int) -> None:
    """Closed form: each run less its mean, averaged by direction, the two averaged."""
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.uniform(0.02, 0.2, stops))
    y = 1e-6 * rng.normal(size=(count, stops))
    ways = [-1 if both and k % 2 else 1 for k in range(count)]
    result = combine_runs([Run(x[::way], row[::way], way) for row, way in zip(y, ways, strict=True)])
    flat = y - y.mean(axis=1, keepdims=True)
    means = [flat[np.array(ways) == way].mean(axis=0) for way in sorted(set(ways))]
    expected = np.mean(means, axis=0)
    np.testing.assert_allclose(result.mean - result.mean.mean(), expected, rtol=0, atol=1e-18)
    freedom = (count - len(means)) * (stops - 1)
    square = sum(
        ((flat[np.array(ways) == way] - mean) ** 2).sum() for way, mean in zip(sorted(set(ways)), means, strict=True)
    )
    share = sum(1 / ways.count(way) for way in set(ways)) / len(means) ** 2
    if freedom == 0:
        assert result.uncertainty is None
    else:
        assert by_repetition(result) == pytest.approx(math.sqrt(share * square / freedom), rel=1e-9)


def test_a_reading_that_stands_off_is_found_and_can_be_left_out() -> None:
    found = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        guide = Guide(rng, "waves", 5.0)
        runs = guide.runs(21, 3, 1e-7, 0.0, 0.1, False)
        run = int(rng.integers(3))
        at = int(rng.integers(1, len(runs[run].positions) - 2))
        where = runs[run].positions[at]
        if sum(where in other.positions for other in runs) < 3:
            continue
        runs[run].readings[at] += 3e-6 * rng.choice([-1, 1])
        result = combine_runs(runs)
        first = result.outliers[0]
        assert (result.positions[first.target], first.cycle, first.direction) == (where, run, 1)
        assert abs(first.excess) == pytest.approx(3e-6, abs=0.7e-6)
        without = combine_runs(runs, drop_outliers=True)
        assert without.uncertainty is not None
        error = level(without.positions, without.mean - guide.truth(without.positions))
        assert np.abs(error).max() < 5 * without.uncertainty.max() < 8e-7
        found += 1
    assert found > 20


def test_no_reading_is_an_outlier_for_half_of_the_stated_noise() -> None:
    x = np.linspace(0, 1, 11)
    readings = np.zeros((4, 11))
    readings[2, 5] = 1e-7
    made = [Run(x, row, 1) for row in readings]
    assert len(combine_runs(made).outliers) == 1
    assert combine_runs(made, noise=1e-7).outliers == ()


def test_stated_noise_of_the_positions_tells_which_stops_are_the_same() -> None:
    rng = np.random.default_rng(0)
    grid = np.linspace(0, 2, 21)
    made = [Run(np.sort(grid + 8e-3 * rng.normal(size=21)), np.zeros(21), 1) for _ in range(4)]
    assert not combine_runs(made).stops
    assert combine_runs(made, position_noise=8e-3).stops
    # stops of two runs half a spacing apart are different ones, whatever the noise
    apart = [Run(grid, np.zeros(21), 1), Run(grid + 0.05, np.zeros(21), 1)]
    assert not combine_runs(apart, position_noise=0.05).stops


def test_bad_runs_are_refused() -> None:
    x = np.linspace(0, 1, 11)
    good = Run(x, np.zeros(11), 1)
    with pytest.raises(InputError, match="no run; give at least one"):
        combine_runs([])
    with pytest.raises(InputError, match=r"directions \[1, 2\]"):
        combine_runs([good, Run(x, np.zeros(11), 2)])
    with pytest.raises(InputError, match=r"no run of a direction has a sample from 1\d\d\d(\.\d+)? mm to"):
        combine_runs([good, Run(x + 2.03, np.zeros(11), 1)])
    with pytest.raises(InputError, match="position 3 is not finite"):
        combine_runs([good, Run(np.where(x == x[3], np.nan, x), np.zeros(11), 1)])


@pytest.mark.parametrize(
    ("kind", "stops"),
    [(kind, stops) for kind in ("bow", "waves", "rough", "corner") for stops in (21, 41)],
)
def test_what_lies_between_the_stops_is_allowed_for(kind: str, stops: int) -> None:
    """A cubic spline through the stops errs between them by no more than is stated."""
    shares = []
    for seed in range(60):
        guide = Guide(np.random.default_rng(seed), kind, 5.0)
        result = combine_runs(guide.runs(stops, 3, 1e-7, 0.0, 0.0, False))
        assert result.uncertainty is not None
        found = find_unresolved(result.positions, result.mean, result.uncertainty**2)
        stated = max(math.sqrt(max(0.0, found.square) / max(1, found.count)), found.largest)
        x = np.linspace(-2.4, 2.4, 997)
        spline = np.asarray(CubicSpline(result.positions, result.mean)(x))
        error = level(x, spline - guide.truth(x))
        shares.append(np.mean(np.abs(error) < 2 * math.hypot(stated, by_repetition(result))))
    assert np.mean(shares) >= 0.93


def test_too_few_stops_show_nothing_between_them() -> None:
    assert find_unresolved(np.array([0.0, 1.0]), np.zeros(2), np.zeros(2)).count == 0
    found = find_unresolved(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1e-6, 0.0]), np.zeros(3))
    assert (found.square, found.count, found.largest) == (1e-12, 1, 0.0)


@pytest.mark.parametrize(
    ("x", "y", "message"),
    [
        ([0.0], [1.0], "make no profile"),
        ([0.0, 0.0], [1.0, 2.0], "make no profile"),
        ([0.0, 1.0], [1.0], "do not fit"),
        ([0.0, 1.0], [1.0, math.nan], "profile 1 is not finite"),
        ([math.inf, 1.0], [1.0, 1.0], "position 0 is not finite"),
    ],
)
def test_bad_profiles_are_refused(x: list[float], y: list[float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        fit_line(np.array(x), np.array(y))
