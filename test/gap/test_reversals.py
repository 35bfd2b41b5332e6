"""The probability of a slip, summed over moments, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import logsumexp

from rotary_error_monitor.gap.reversals import MOMENTS, log_odds_over_moments


def peak(moment, width, height):
    """Logarithm of a likelihood that falls off on either side of a moment, as noise with a memory makes it."""
    return lambda moments: height - np.abs(moments - moment) / width


@pytest.mark.parametrize("seed", range(40))
def test_however_sharp_the_likelihood_is_its_mean_is_found(seed):
    """Of a slip at any moment, from one that noise hides for a second to one that is known to a microsecond."""
    draw = np.random.default_rng(seed)
    duration = 10 ** draw.uniform(1.0, 3.5)
    width, moment = 10 ** draw.uniform(-6.0, 0.0), draw.uniform(0.1, 0.9) * duration
    turning = np.sort(draw.uniform(0.0, duration, draw.integers(1, 5)))
    height = draw.uniform(0.0, 50.0) + duration / width / MOMENTS
    shown = peak(moment, width, height)
    others = height + np.log(width / duration * (2 - np.exp(-moment / width) - np.exp((moment - duration) / width)))
    expected = np.logaddexp(others, logsumexp(shown(turning)) - np.log(len(turning))) - np.log(2)
    assert log_odds_over_moments(turning, duration, shown) == pytest.approx(expected, abs=0.5)


def test_where_the_moment_does_not_matter_no_finer_ones_are_asked_for():
    asked = []

    def shown(moments):
        asked.append(len(moments))
        return np.full(len(moments), -3.0)

    assert log_odds_over_moments(np.array([2.5]), 20.0, shown) == pytest.approx(-3.0, abs=0.1)
    assert len(asked) == 2


def test_what_cannot_be_weighed_ends():
    assert not log_odds_over_moments(np.array([2.5]), 20.0, lambda moments: np.full(len(moments), -np.inf)) > 0
