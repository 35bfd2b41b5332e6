"""Causes sized beside uncertain parameters that do nearly the same."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.gap.fitting import fit_causes


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("off", [-3.0, -0.05, 0.0, 0.05, 3.0])
def test_what_is_left_does_not_depend_on_where_the_fit_starts(linear, seed, off):
    """A start off by a part of the standard deviation that an uncertain parameter gives is off by many without it."""
    draw = np.random.default_rng(seed)
    shape, alike = (draw.normal(size=(800, 1)) for _ in range(2))
    linear.offer({"shape": {"x": 40.0 * shape}})
    linear.nuisances = {"x": 40.0 * shape + 0.01 * alike}
    linear.data = {"x": 200.0 * shape + draw.normal(size=(800, 1))}
    white = np.vstack([np.column_stack([40.0 * shape, linear.nuisances["x"]]), [[0.0, 1.0]]])
    wanted = np.append(linear.data["x"][:, 0], 0.0)
    best, (squares,), *_ = np.linalg.lstsq(white, wanted, rcond=None)
    start = Cause(linear.effects["shape"], "", np.array([best[0] + off]))
    assert fit_causes(linear, [start]).squares == pytest.approx(squares, abs=0.02)
