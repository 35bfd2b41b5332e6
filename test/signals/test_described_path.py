"""What a cubic misses of a described curve, against closed forms of a wave."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.interpolate import BarycentricInterpolator

from rotary_error_monitor.signals.described_path import PLACES, DescribedPath
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
@pytest.mark.parametrize("part", [1e-6, 1e-3, 0.1, 1.0, 1.9])
def test_a_cubic_follows_a_wave_up_to_an_angle(order, part):
    """Up to it no more is missed, and before the next place of a turn more is."""
    angle, step = DescribedPath(wave(order, 3e-6)).followed(3e-6 * part), TURN / PLACES
    assert max(missed_of(order, each) for each in np.linspace(0.1 * angle, angle, 100)) <= 1.001 * part
    assert max(missed_of(order, each) for each in np.linspace(angle, angle + step, 20)) >= 0.999 * part


def test_of_all_orders_what_is_missed_adds_up():
    angle = DescribedPath(wave(1, 5e-6) + wave(7, 1e-6) + 1.0).followed(3e-7)
    missed = [5e-6 * missed_of(1, each) + 1e-6 * missed_of(7, each) for each in (angle, angle + TURN / PLACES)]
    assert missed[0] <= 1.001 * 3e-7 <= 1.002 * missed[1]


@pytest.mark.parametrize("order", [1, 4, 293])
def test_an_instrument_without_noise_is_followed_nowhere(order):
    assert DescribedPath(wave(order, 3e-3)).followed(0.0) == 0.0


def test_what_is_small_enough_is_followed_at_any_speed():
    """A cubic misses twice the amplitude of a wave that goes round once from one reading to the next."""
    assert DescribedPath(wave(2, 1e-6)).followed(2.01e-6) == math.inf
    assert DescribedPath(wave(2, 1e-6)).followed(1.99e-6) < TURN
    assert DescribedPath(np.zeros((PLACES, 2))).followed(1e-9) == math.inf
