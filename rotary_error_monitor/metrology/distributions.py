"""Tails and quantiles of the chi-square and F distributions, the same bits as those of scipy.stats.

That library takes longer to load than most commands take for their work; the functions beneath it do not.
"""

from __future__ import annotations

import math

from scipy.special import chdtr, chdtrc, chdtri, fdtrc, fdtri


def chi_square_tail(value: float, freedom: float) -> float:
    """Probability that chi-square with these degrees of freedom exceeds a value; not a number without any."""
    return float(chdtrc(freedom, max(value, 0.0))) if freedom > 0 else math.nan


def chi_square_up_to(value: float, freedom: float) -> float:
    """Probability that chi-square with these degrees of freedom does not exceed a value; not a number without any."""
    return float(chdtr(freedom, max(value, 0.0))) if freedom > 0 else math.nan


def chi_square_limit(probability: float, freedom: float) -> float:
    """The value that chi-square with these degrees of freedom exceeds with a probability."""
    return float(chdtri(freedom, probability)) if freedom > 0 else math.nan


def f_tail(value: float, numerator: float, denominator: float) -> float:
    """Probability that F with these degrees of freedom exceeds a value; not a number without any."""
    return float(fdtrc(numerator, denominator, max(value, 0.0))) if min(numerator, denominator) > 0 else math.nan


def f_limit(probability: float, numerator: float, denominator: float) -> float:
    """The value that F with these degrees of freedom exceeds with a probability."""
    return float(fdtri(numerator, denominator, 1.0 - probability)) if min(numerator, denominator) > 0 else math.nan
