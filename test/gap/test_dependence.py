"""What a signal goes with is told by the part of its power that it explains."""

import numpy as np
import pytest

from rotary_error_monitor.gap.dependence import explained_by, explained_by_constant, name_dependences


def test_power_is_that_of_the_fitted_columns_beside_a_constant(rng):
    count = 400
    columns = rng.normal(size=(count, 2)) + 5.0
    signal = 3.0 + 2.0 * columns[:, 0] - columns[:, 1]
    spread = float(np.sum(np.square(signal - signal.mean())))
    assert explained_by(columns, signal) == pytest.approx(spread)
    assert explained_by_constant(signal) == pytest.approx(float(np.sum(np.square(signal))) - spread)
    assert explained_by(columns, np.ones(count)) == pytest.approx(0.0, abs=1e-9)


def test_a_column_that_does_not_vary_explains_nothing():
    """An axis that was come to from one side alone says nothing of its direction."""
    assert explained_by(np.ones((50, 1)), np.full(50, 2.0)) == 0.0


def test_the_largest_are_named_and_none_beyond_four():
    parts = [(0.3, "time"), (1.2, "speed"), (0.05, "force"), (0.2, "place"), (0.4, "angle"), (0.25, "direction")]
    assert name_dependences(parts, 0.1) == "speed (100%); angle (40%); time (30%); direction (25%)"
    assert name_dependences(parts, 2.0) == "no simple dependence"
