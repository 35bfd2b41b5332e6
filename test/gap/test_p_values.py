"""Logarithms of chances against scipy's distributions, and against closed forms where those underflow."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.special import log_ndtr
from scipy.stats import chi2, f, norm

from rotary_error_monitor.gap.p_values import (
    chi_square_median,
    chi_square_quantile,
    log_chi_square_tail,
    log_f_tail,
    log_normal_tail,
)


@pytest.mark.parametrize("dof", [1, 2, 3, 33, 500])
@pytest.mark.parametrize("times", [0.2, 1.0, 2.5])
def test_near_the_middle_they_are_those_of_scipy(dof, times):
    value = times * dof
    assert log_chi_square_tail(value, dof) == pytest.approx(float(chi2.logsf(value, dof)), abs=1e-12)
    assert chi_square_quantile(0.01, dof) == pytest.approx(float(chi2.isf(0.01, dof)), rel=1e-9)
    assert chi_square_median(dof) == pytest.approx(float(chi2.median(dof)), rel=1e-9)


@pytest.mark.parametrize("value", [1400.0, 3e4, 1e7])
def test_far_out_they_follow_the_closed_forms(value):
    two_sided_normal = math.log(2) + float(log_ndtr(-math.sqrt(value)))
    assert log_chi_square_tail(value, 1) == pytest.approx(two_sided_normal, abs=1e-3)
    assert log_chi_square_tail(value, 2) == pytest.approx(-value / 2, abs=1e-9)
    assert log_chi_square_tail(value, 4) == pytest.approx(-value / 2 + math.log1p(value / 2), abs=1e-6)


@pytest.mark.parametrize("dof", [1, 7, 400, 5000])
def test_there_is_no_step_where_the_tail_underflows(dof):
    # The slope of the logarithm far out is close to -1/2, a little less steep for much dof.
    start = next(x for x in range(1000, 40_000) if chi2.sf(x, dof) < 1e-289)
    tails = [log_chi_square_tail(start + step, dof) for step in range(-20, 20)]
    slopes = [b - a for a, b in itertools.pairwise(tails)]
    assert max(slopes) - min(slopes) < 2e-3
    assert min(slopes) > -0.501 and max(slopes) < 0


@pytest.mark.parametrize("below", [5.0, 300.0, 4000.0])
@pytest.mark.parametrize("value", [0.7, 1.3, 2.0])
def test_a_ratio_of_variances(value, below):
    expected = float(f.logsf(value, 720, below))
    assert log_f_tail(value, 720, below) == pytest.approx(expected, rel=1e-3, abs=1e-10)
    assert log_f_tail(value, 720, np.inf) == log_chi_square_tail(720 * value, 720)


def test_a_ratio_of_variances_far_out():
    """Of two degrees of freedom above the tail is a power."""
    for value in (1e3, 1e6, 1e12):
        assert log_f_tail(value, 2, 300) == pytest.approx(-150 * math.log1p(2 * value / 300), rel=1e-6)
    assert log_f_tail(0.0, 2, 300) == 0.0


def test_normal_tail():
    assert log_normal_tail(2.0) == pytest.approx(float(norm.logsf(2.0)), abs=1e-12)
    assert log_normal_tail(60.0) == pytest.approx(float(norm.logsf(60.0)), rel=1e-9)


def test_nothing_is_certain_below_zero():
    assert log_chi_square_tail(0.0, 3) == 0.0
