"""How far a gap shrinks is a number between -1 and 1, whatever it is measured against."""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.gap.fitting import fit_causes
from rotary_error_monitor.gap.shrink import measure_gap


def test_a_shrink_is_no_quotient_of_next_to_nothing(linear, rng):
    """Whatever the floor: between -1 and 1."""
    noise = {channel: rng.normal(size=rows.shape) for channel, rows in linear.data.items()}
    linear.data = noise
    first = next(iter(linear.effects.values()))
    fit = fit_causes(linear, [Cause(first, "", np.zeros(1))])
    before = measure_gap(fit, linear.conditions).before
    for floor in (None, before, before * (1 - 1e-9), before * (1 + 1e-9), 0.5 * before):
        gap = measure_gap(fit, linear.conditions, floor)
        assert -1 <= gap.interval[0] <= gap.interval[1] <= 1 and -1 <= gap.shrink <= 1
