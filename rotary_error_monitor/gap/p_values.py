"""Chances under noise as logarithms, far out in the tails too, where the chance itself is below the smallest number.

Loading all distributions of scipy.stats takes longer than diagnosing a machine; the functions beneath them do not.
"""

from __future__ import annotations

import numpy as np
from scipy.special import betainc, betaln, chdtri, gammaincc, gammaincinv, gammaln, log_ndtr

LEAST_LOG_P_VALUE = -1e6
"""Logarithms of p-values below this are taken for it: 1400 standard deviations, beyond which no prior makes a
difference, and a number that JSON can hold, which has no infinity."""

NORMAL_QUARTILE = 0.6744897501960817
"""Median of the magnitude of a standard normal number."""

_SMALLEST = 1e-290
"""Tails below this are computed as logarithms from the start."""

_TERMS = 200
"""Terms of the series of a tail that is below the smallest number: what is missing then is below a part in 10^3."""


def log_chi_square_tail(value: float, dof: float) -> float:
    """Natural logarithm of the chance that chi-square with this dof exceeds a value.

    Far out it is Legendre's continued fraction of the incomplete gamma function, cut after two terms: the error is
    below one part in 10^3 of the chance for any dof (Abramowitz and Stegun 6.5.31).
    """
    if value <= 0:
        return 0.0
    half, x = 0.5 * dof, 0.5 * value
    tail = float(gammaincc(half, x))
    if tail > _SMALLEST:
        return float(np.log(tail))
    fraction = x + 1 - half - (1 - half) / (x + 3 - half - 2 * (2 - half) / (x + 5 - half))
    return float(half * np.log(x) - x - gammaln(half) - np.log(fraction))


def log_f_tail(value: float, dof: float, dof_below: float) -> float:
    """Natural logarithm of the chance that the ratio of two estimates of one variance exceeds a value.

    Far out it is the hypergeometric series of the incomplete beta function (Abramowitz and Stegun 26.5.4).

    Args:
        value: the ratio.
        dof: degrees of freedom of the estimate above.
        dof_below: of that below; infinite where the variance is known.
    """
    if np.isinf(dof_below):
        return log_chi_square_tail(dof * value, dof)
    if value <= 0:
        return 0.0
    a, b = 0.5 * dof_below, 0.5 * dof
    x = dof_below / (dof_below + dof * value)
    tail = float(betainc(a, b, x))
    if tail > _SMALLEST:
        return float(np.log(tail))
    steps = np.arange(_TERMS)
    series = 1 + float(np.sum(np.cumprod((a + b + steps) / (a + 1 + steps) * x)))
    return float(a * np.log(x) + b * np.log1p(-x) - np.log(a) - betaln(a, b) + np.log(series))


def log_normal_tail(value: float) -> float:
    """Natural logarithm of the chance that a standard normal number exceeds a value."""
    return float(log_ndtr(-value))


def chi_square_quantile(chance: float, dof: float) -> float:
    """The value that chi-square with this dof exceeds with that chance."""
    return float(chdtri(dof, chance))


def chi_square_median(dof: float) -> float:
    """The value that chi-square with this dof exceeds every other time."""
    return float(2 * gammaincinv(0.5 * dof, 0.5))
