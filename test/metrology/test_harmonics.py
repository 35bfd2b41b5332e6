"""Sums of harmonics: a rotation has the same bits in a batch of any size, and its value is that of the definition."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotary_error_monitor.description.harmonics import PlanarHarmonic
from rotary_error_monitor.metrology.harmonics import planar_sum


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("count", [0, 1, 4, 9, 40])
def test_a_rotation_has_the_same_bits_in_any_batch(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    rows = tuple(
        PlanarHarmonic(int(rng.integers(1, 60)), tuple(rng.normal(size=2)), tuple(rng.normal(size=2)))
        for _ in range(count)
    )
    theta = rng.uniform(-1e4, 1e4, 3000)
    whole = planar_sum(rows, theta)
    for size in (1, 5, 7, 64, 500):
        parts = [planar_sum(rows, theta[begin : begin + size]) for begin in range(0, len(theta), size)]
        np.testing.assert_array_equal(np.concatenate(parts), whole)
    for angle, found in zip(theta[:50].tolist(), whole[:50], strict=True):
        expected = [
            math.fsum(
                part[0] * math.cos(row.order * angle) + part[1] * math.sin(row.order * angle)
                for row, part in ((row, getattr(row, axis)) for row in rows)
            )
            for axis in ("x", "y")
        ]
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-13 * max(count, 1))
