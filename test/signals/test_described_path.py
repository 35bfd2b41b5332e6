"""What a cubic misses of a described curve, against closed forms of a wave."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BarycentricInterpolator

from rotary_error_monitor.signals.described_path import MOST, PLACES, DescribedPath
from rotary_error_monitor.units import TURN

THETA = np.linspace(0.0, TURN, PLACES, endpoint=False)


def wave(order: int, size: float) -> np.ndarray:
    """(n, 2) vector that goes round so many times in a turn."""
    return size * np.stack([np.cos(order * THETA), np.sin(order * THETA)], axis=1)


def missed_of(order: int, turned: float) -> float:
    """Largest that the polynomial through four readings of a wave misses anywhere between the middle two."""
    at, between = turned * np.arange(-1, 3), turned * np.linspace(0.0, 1.0, 101)
    cubic = BarycentricInterpolator(at, np.exp(1j * order * at))(between)
    return float(np.abs(np.exp(1j * order * between) - cubic).max())


@pytest.mark.parametrize("order", [1, -2, 5, 9])
@pytest.mark.parametrize("readings", [400.0, 30.0, 9.0, 6.5])
def test_what_a_cubic_misses_of_a_wave_is_bounded(order, readings):
    """At this speed, and by no more than at any speed up to the next place of a turn."""
    turned = TURN / readings
    bound = DescribedPath(wave(order, 3e-6)).missed(turned)
    slower = np.linspace(0.01 * turned, turned + TURN / PLACES, 300)
    assert 3e-6 * missed_of(order, turned) <= 1.001 * bound + 1e-15
    assert bound <= 3e-6 * 1.001 * max(missed_of(order, each) for each in slower) + 1e-15


def test_of_all_orders_what_is_missed_adds_up():
    both = DescribedPath(wave(1, 5e-6) + wave(7, 1e-6) + 1.0)
    apart = sum(DescribedPath(wave(order, size)).missed(0.8) for order, size in ((1, 5e-6), (7, 1e-6)))
    np.testing.assert_allclose(both.missed(0.8), apart, rtol=1e-6)
    np.testing.assert_allclose(both.missed(-0.8), apart, rtol=1e-6)


def test_at_rest_nothing_is_missed_and_beyond_a_turn_all():
    path = DescribedPath(wave(2, 1e-6))
    assert path.missed(0.0) == 0.0
    np.testing.assert_allclose(path.missed(10.0), MOST * 1e-6)
    assert DescribedPath(np.zeros((PLACES, 2))).missed(1.0) == 0.0
