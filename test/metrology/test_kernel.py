"""The compiled form of what heads show against numpy's, to the last bit, on drawn layouts and readings."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np
import pytest
from kernels import computing_by, is_built

from rotary_error_monitor.metrology.encoder_heads import HeadLayout, RingPose, estimate_ring_pose
from rotary_error_monitor.metrology.error_motion import reading_variance

pytestmark = pytest.mark.skipif(not is_built(), reason="the library was not compiled")


def drawn_layout(rng: np.random.Generator) -> HeadLayout:
    """Two to eight heads anywhere, or two to four where they mostly stand."""
    if rng.random() < 0.5:
        return HeadLayout(tuple(rng.choice([0.0, 0.5, 1.0, 1.5], rng.integers(2, 5), replace=False) * np.pi))
    return HeadLayout(tuple(rng.uniform(0.0, 2 * np.pi, rng.integers(2, 9)).tolist()))


@pytest.mark.parametrize("seed", range(60))
def test_the_pose_of_the_ring_has_the_bits_of_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    layout, count = drawn_layout(rng), int(rng.choice([0, 1, 2, 5, 33]))
    shape = (count, len(layout.azimuths))
    theta = rng.choice([0.0, 10.0, 1e5]) * rng.normal(size=(count, 1))
    readings = theta + 1e-4 * rng.normal(size=shape) + 2 * np.pi * rng.integers(-2, 3, shape)
    readings[rng.random(shape) < 0.1] = 0.0
    readings[rng.random(shape) < rng.choice([0.0, 0.05])] = np.nan
    variances = rng.uniform(1e-14, 1e-12, shape)
    found: list[RingPose] = []
    for form in ("compiled", "numpy"):
        with computing_by(form):
            found.append(estimate_ring_pose(layout, 0.1, readings, variances))
    for one, other in zip(*map(astuple, found), strict=True):
        assert one.shape == other.shape
        np.testing.assert_array_equal(one, other)  # NaN for NaN
        np.testing.assert_array_equal(np.signbit(one[~np.isnan(one)]), np.signbit(other[~np.isnan(other)]))


@pytest.mark.parametrize("seed", range(20))
def test_the_variance_of_readings_has_the_bits_of_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape = (int(rng.choice([0, 1, 5, 40])), int(rng.integers(1, 5)))
    gain = rng.uniform(0.0, 1.5, shape if rng.random() < 0.5 else (shape[0], 1))
    travel = rng.choice([0.0, 1e-9, 1e-3]) * np.abs(rng.normal(size=shape))
    noise, resolution = 1e-7 * rng.uniform(0.0, 1.0), rng.choice([0.0, 1e-8, 1e-6])
    found = []
    for form in ("compiled", "numpy"):
        with computing_by(form):
            found.append(reading_variance(noise, resolution, gain, travel))
    assert found[0].shape == found[1].shape
    assert found[0].tobytes() == found[1].tobytes()
