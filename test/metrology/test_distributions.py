"""Tails and quantiles, held against scipy.stats to the last bit, and where there are no degrees of freedom."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from rotary_error_monitor.metrology.distributions import (
    chi_square_limit,
    chi_square_tail,
    chi_square_up_to,
    f_limit,
    f_tail,
)


@pytest.mark.parametrize("seed", range(3))
def test_they_are_those_of_scipy_stats(seed):
    rng = np.random.default_rng(seed)
    for _ in range(100):
        value, part = float(10 ** rng.uniform(-8, 4)), float(10 ** rng.uniform(-12, 0))
        first, second = int(rng.integers(1, 10)), float(10 ** rng.uniform(0, 4))
        assert chi_square_tail(value, second) == stats.chi2.sf(value, second)
        assert chi_square_up_to(value, second) == stats.chi2.cdf(value, second)
        assert chi_square_limit(part, second) == stats.chi2.isf(part, second)
        assert f_tail(value, first, second) == stats.f.sf(value, first, second)
        assert f_limit(part, first, second) == stats.f.isf(part, first, second)


@pytest.mark.parametrize("value", [-1.0, -math.inf, 0.0, math.inf, math.nan])
def test_what_is_no_sum_of_squares_is_as_in_scipy_stats(value):
    np.testing.assert_equal(chi_square_tail(value, 3), stats.chi2.sf(value, 3))
    np.testing.assert_equal(chi_square_up_to(value, 3), stats.chi2.cdf(value, 3))
    np.testing.assert_equal(f_tail(value, 2, 3), stats.f.sf(value, 2, 3))


def test_without_degrees_of_freedom_there_is_none():
    assert math.isnan(chi_square_tail(1.0, 0)) and math.isnan(chi_square_up_to(1.0, 0))
    assert math.isnan(chi_square_limit(0.1, 0)) and math.isnan(f_tail(1.0, 2, 0)) and math.isnan(f_limit(0.1, 0, 2))
