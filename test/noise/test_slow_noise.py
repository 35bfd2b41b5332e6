"""Rows with slow noise are made white, and given back."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.noise.slow_noise import SlowNoise, cells_of

ROWS, CELLS = 400, 40


@pytest.fixture
def noise():
    draw = np.random.default_rng(1)
    weight = np.where(draw.random(ROWS) < 0.1, 0.0, draw.uniform(0.2, 1.0, ROWS))
    weight[:30] = 0.0  # whole cells are lost
    return SlowNoise(cells_of(weight, CELLS), draw.normal(size=(CELLS, 5)))


def test_what_has_the_stated_covariance_becomes_white(noise):
    """Against the dense matrix: M (I + U U') M' is the identity."""
    slow = noise.cells.spread(noise.courses)
    covariance = np.eye(ROWS) + slow @ slow.T
    half = noise.whiten(covariance)
    np.testing.assert_allclose(noise.whiten(half.T), np.eye(ROWS), atol=1e-9)


def test_rows_that_were_lost_stay_zero(noise):
    rows = np.where(noise.cells.weight > 0, np.random.default_rng(2).normal(size=ROWS), 0.0)[:, None]
    assert np.all(noise.whiten(rows)[noise.cells.weight == 0] == 0)


def test_plain_rows_come_back(noise):
    rows = np.random.default_rng(3).normal(size=(ROWS, 3))
    white = noise.whiten(rows)
    np.testing.assert_allclose(noise.plain(white), rows, atol=1e-9)
    np.testing.assert_allclose(noise.plain_sums(white), noise.cells.sums(rows), atol=1e-9)


def test_no_courses_change_nothing(noise):
    rows = np.random.default_rng(4).normal(size=(ROWS, 2))
    np.testing.assert_array_equal(SlowNoise(noise.cells, np.zeros((CELLS, 0))).whiten(rows), rows)
