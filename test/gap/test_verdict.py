"""Which causes stand although something is left."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.gap.selection import select_causes
from rotary_error_monitor.gap.verdict import is_series, trusted_causes


@pytest.fixture
def shapes(rng):
    return rng.normal(size=(3, 800, 1))


@pytest.mark.parametrize(
    ("names", "series"),
    [
        (("ripple@order_1", "ripple@order_2", "other"), True),
        (("ripple@order_1", "twist@order_2", "other"), False),
        (("ripple@order_1", "twist@order_2", "ripple@order_2"), True),
        (("ripple@order_1", "twist@order_2", "twist@order_3"), False),
    ],
)
def test_one_effect_after_another_is_a_series_whatever_stands_for_it(linear, rng, shapes, names, series):
    """The third effect predicts what the second does; which of the two is chosen must not matter."""
    first, second, other = shapes
    alike = other if names[2] == "other" else second
    linear.offer(dict(zip(names, ({"x": first}, {"x": second}, {"x": alike}), strict=True)))
    linear.data = {"x": 3 * first + 2 * second + rng.normal(size=first.shape), "y": rng.normal(size=first.shape)}
    chosen = select_causes(linear).chosen
    assert len(chosen.fit.causes) == 2
    assert is_series(chosen) == series
    assert trusted_causes(linear, chosen) != series


def test_one_cause_is_no_series(linear, rng, shapes):
    first, second, _ = shapes
    linear.offer({"ripple@order_1": {"x": first}, "ripple@order_2": {"x": second}})
    linear.data = {"x": 3 * first + rng.normal(size=first.shape), "y": rng.normal(size=first.shape)}
    chosen = select_causes(linear).chosen
    assert len(chosen.fit.causes) == 1 and not is_series(chosen)
    assert np.isfinite(chosen.fit.squares) and trusted_causes(linear, chosen)
