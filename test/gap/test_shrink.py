"""How far a gap shrinks is a number between -1 and 1, whatever it is measured against."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.gap.departures import Departures
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


@pytest.mark.parametrize("size", [0.0, 1.0, 4.0])
def test_what_textbook_forms_leave_is_what_departures_do(linear, rng, size):
    """Against the closed form: what of the departure lies beside the cause's own column."""
    cause = linear.effects["first"]
    own, beside = cause.column["x"], rng.normal(size=cause.column["x"].shape)
    noise = {channel: rng.normal(size=rows.shape) for channel, rows in linear.data.items()}
    linear.data = {"x": 5.0 * own + size * beside + noise["x"], "y": noise["y"]}
    departures = Departures(0, ("time",), (str,), np.array([0.1]), {"x": beside})
    fit = fit_causes(linear, [Cause(cause, "", np.array([5.0]))], departures=[departures])
    gap = measure_gap(fit, linear.conditions)
    apart = beside - own * float(np.sum(own * beside) / np.sum(own * own))
    count = sum(rows.size for rows in noise.values())
    expected = np.sqrt((sum(np.sum(rows**2) for rows in noise.values()) + size**2 * np.sum(apart**2)) / count)
    assert gap.textbook == pytest.approx(expected, rel=0.06)
    assert gap.after == pytest.approx(1.0, rel=0.06)
    assert gap.noise_floor == pytest.approx(1.0, rel=0.06)
    whole = sum(np.sum(np.square(rows)) for rows in linear.data.values())
    assert gap.before == pytest.approx(np.sqrt(whole / count), rel=1e-6), "departures are in the data once"
    assert gap.textbook_shrink <= gap.shrink + 0.01
    assert (gap.textbook_shrink < 0.9 * gap.shrink) == (size == 4.0)


def test_without_departures_there_is_one_shrink(linear):
    fit = fit_causes(linear, [Cause(linear.effects["first"], "", np.array([0.5]))])
    gap = measure_gap(fit, linear.conditions)
    assert gap.textbook is None and gap.textbook_shrink is None
