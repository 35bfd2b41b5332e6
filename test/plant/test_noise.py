"""Noise by index: the same wherever it is asked for, and as random as it should be."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from rotary_error_monitor.plant.noise import Noise, TurbulenceCourse


@given(st.integers(-(10**6), 10**12), st.integers(0, 60), st.integers(0, 60))
def test_pieces_make_the_whole(first: int, head: int, tail: int) -> None:
    noise = Noise(3, "x")
    whole = noise.uniform(first, head + tail)
    np.testing.assert_array_equal(
        whole, np.concatenate([noise.uniform(first, head), noise.uniform(first + head, tail)])
    )


def test_another_process_draws_the_same() -> None:
    code = "from rotary_error_monitor.plant.noise import Noise; print(*Noise(3, 'x').normal(5, 4).tolist())"
    told = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split()
    np.testing.assert_array_equal([float(number) for number in told], Noise(3, "x").normal(5, 4))


def test_numbers_are_uniform_normal_and_independent() -> None:
    numbers = Noise(3, "x").uniform(0, 20_000)
    assert stats.kstest(numbers, "uniform").pvalue > 0.001
    normal = Noise(3, "y").normal(0, 20_000)
    assert stats.kstest(normal, "norm").pvalue > 0.001
    assert abs(np.corrcoef(normal[1:], normal[:-1])[0, 1]) < 0.03
    for other in (Noise(4, "y"), Noise(3, "z")):
        assert abs(np.corrcoef(normal, other.normal(0, 20_000))[0, 1]) < 0.03


def test_turbulence_is_a_function_of_time() -> None:
    air = TurbulenceCourse(Noise(1, "air"), 0.3)
    time = np.linspace(-2, 30, 5000)
    whole = air.at(time)
    np.testing.assert_array_equal(np.concatenate([air.at(time[:1]), air.at(time[1:77]), air.at(time[77:])]), whole)
    expected = np.sqrt(2 * (1 - np.exp(-(time[1] - time[0]) / 0.3)))  # of the Ornstein-Uhlenbeck process
    assert np.diff(whole).std() == pytest.approx(expected, rel=0.1)
