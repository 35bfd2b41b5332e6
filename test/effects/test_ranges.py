"""Effects whose values lie in several ranges: lost counts are whole ones, asynchronous orders are not whole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from probed_stage import STAGE

from rotary_error_monitor.effects.library import effect_named, load_effects
from rotary_error_monitor.effects.rotor import StageEffect

EFFECTS = load_effects(StageEffect)
LOST, BEARING = (effect_named(name, EFFECTS) for name in ("head_missed_counts", "bearing_asynchronous"))


def test_lost_counts_are_one_or_more_of_the_stage():
    stage = replace(STAGE, encoder=replace(STAGE.encoder, lines_per_revolution=9000, counts_per_line=60))
    count = 2 * np.pi / (9000 * 60)
    lost = LOST.seen_in(stage, 0.0)
    for step, held in ((0.3, 1), (-0.2, -1), (1.7, 1.7), (-5.2, -5.2), (0.0, 0.0)):
        np.testing.assert_allclose(lost.held(np.array([3.0, step * count])), [3.0, held * count], rtol=1e-12)
    low, high = lost.bounds(np.array([3.0, -2 * count]))
    assert low[1] == -1.0 and high[1] == pytest.approx(-count)
    assert LOST.count == 0.0, "the one that all stages share is as it was"


def test_a_derivative_at_no_step_is_that_of_one_count():
    lost = LOST.seen_in(STAGE, 0.0)
    count = 2 * np.pi / (STAGE.encoder.lines_per_revolution * STAGE.encoder.counts_per_line)
    assert lost.inward(np.array([3.0, 0.0]), 1, 1e-9) == pytest.approx(count)
    assert lost.inward(np.array([3.0, 4 * count]), 1, 1e-9) == 1e-9
    assert lost.inward(np.array([3.0, -count]), 1, 1e-9) == -1e-9


def test_a_count_larger_than_any_step_leaves_the_largest():
    one = replace(STAGE, encoder=replace(STAGE.encoder, lines_per_revolution=1, counts_per_line=1))
    low, high = LOST.seen_in(one, 0.0).bounds(np.array([0.0, 0.5]))
    assert low[1] == high[1] == 1.0


@pytest.mark.parametrize("order", [0.01, 0.97, 1.0, 1.0025, 2.99, 7.5])
def test_asynchronous_orders_keep_their_distance_from_whole_ones(order):
    bearing = BEARING.seen_in(STAGE, 0.03)
    held = bearing.held(np.array([order, 1e-7, 0.0, 0.0]))[0]
    assert abs(held - round(held)) >= 0.03 - 1e-12 and abs(held - order) <= 0.03 + 1e-12
    low, high = bearing.bounds(np.array([held, 1e-7, 0.0, 0.0]))
    assert low[0] <= held <= high[0] and high[0] - low[0] < 1


def test_where_no_order_is_told_from_a_whole_one_all_are_left():
    bearing = BEARING.seen_in(STAGE, 0.6)
    assert bearing.held(np.array([1.001, 0.0, 0.0, 0.0]))[0] == 1.001
