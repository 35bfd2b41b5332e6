"""Limits of corrections: size, rate and latch, the same numbers in blocks of any size."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.limits import (
    CorrectionLimits,
    CorrectionOutcome,
    CorrectionState,
    axis_limits,
    initial_state,
    limit_corrections,
)

Array = NDArray[np.float64]
LIMITS = CorrectionLimits(("X", "C"), np.array([1e-4, 2e-4]), np.array([3e-4, 6e-4]), np.array([1e-3, 2e-3]))
MS = 1_000_000


def times(count: int, start: int = 0, step: int = MS) -> NDArray[np.int64]:
    return start + step * np.arange(count, dtype=np.int64)


def test_slow_corrections_are_followed_exactly() -> None:
    wanted = np.outer(np.arange(50), [0.9e-6, -1.9e-6])
    limited = limit_corrections(LIMITS, initial_state(2), times(50), wanted)
    np.testing.assert_array_equal(limited.corrections, wanted)
    np.testing.assert_array_equal(limited.outcomes, CorrectionOutcome.FOLLOWED)
    assert limited.state == CorrectionState(tuple(wanted[-1].tolist()), 49 * MS)


def test_first_pose_holds_zero_and_the_rate_brings_it_up_on_a_straight_way() -> None:
    wanted = np.tile([1e-5, 4e-6], (30, 1))
    limited = limit_corrections(LIMITS, initial_state(2), times(30), wanted)
    np.testing.assert_array_equal(limited.corrections[0], 0.0)
    steps = np.abs(np.diff(limited.corrections, axis=0))
    assert np.all(steps <= LIMITS.rate * 1e-3 * (1 + 1e-9))
    np.testing.assert_allclose(limited.corrections[:11, 0], np.arange(11) * 1e-6, atol=1e-18)
    np.testing.assert_allclose(limited.corrections[:, 1], 0.4 * limited.corrections[:, 0], atol=1e-18)
    np.testing.assert_array_equal(limited.corrections[-1], wanted[-1])
    assert limited.outcomes[5] == CorrectionOutcome.RATE_LIMITED
    assert limited.outcomes[-1] == CorrectionOutcome.FOLLOWED


def test_a_pause_allows_no_jump() -> None:
    state = CorrectionState((0.0, 0.0), time_ns=0)
    limited = limit_corrections(LIMITS, state, np.array([3600 * 10**9]), np.array([[2e-4, 0.0]]))
    np.testing.assert_allclose(limited.corrections, [[1e-4, 0.0]])


def test_warning_is_followed_and_said() -> None:
    state = CorrectionState((1.5e-4, 0.0), time_ns=0)
    limited = limit_corrections(LIMITS, state, np.array([MS]), np.array([[1.501e-4, 0.0]]))
    np.testing.assert_array_equal(limited.corrections, [[1.501e-4, 0.0]])
    assert limited.outcomes.tolist() == [CorrectionOutcome.WARNING]
    assert not limited.state.latched


def test_error_latches_until_reset() -> None:
    state = CorrectionState((1e-5, 2e-5), time_ns=0)
    wanted = np.array([[1e-5, 2e-5], [1e-5, 7e-4], [1e-5, 2e-5]])
    limited = limit_corrections(LIMITS, state, times(3, MS), wanted)
    np.testing.assert_array_equal(limited.corrections, np.tile([1e-5, 2e-5], (3, 1)))
    assert limited.outcomes.tolist() == [
        CorrectionOutcome.FOLLOWED,
        CorrectionOutcome.LATCHED,
        CorrectionOutcome.LATCHED,
    ]
    assert limited.state.reason == f"correction 7.000e-04 of axis C at {2 * MS} ns is beyond the error limit 6.000e-04"

    held = limit_corrections(LIMITS, limited.state, times(2, 5 * MS), np.tile([1.1e-5, 2e-5], (2, 1)))
    np.testing.assert_array_equal(held.corrections, np.tile([1e-5, 2e-5], (2, 1)))
    assert held.state.reason == limited.state.reason

    released = limit_corrections(LIMITS, held.state.reset(), times(2, 8 * MS), np.tile([1.1e-5, 2e-5], (2, 1)))
    np.testing.assert_array_equal(released.corrections[-1], [1.1e-5, 2e-5])
    assert (released.state.latched, released.state.reason) == (False, "")


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_correction_that_is_no_number_holds_for_its_own_pose(bad: float) -> None:
    state = CorrectionState((1e-5, 0.0), time_ns=0)
    wanted = np.array([[1.09e-5, 0.0], [bad, 0.0], [1.18e-5, 0.0]])
    limited = limit_corrections(LIMITS, state, times(3, MS), wanted)
    np.testing.assert_array_equal(limited.corrections[:, 0], [1.09e-5, 1.09e-5, 1.18e-5])
    assert limited.outcomes.tolist() == [CorrectionOutcome.FOLLOWED, CorrectionOutcome.HELD, CorrectionOutcome.FOLLOWED]


def test_an_unusable_correction_neither_moves_nor_latches() -> None:
    state = CorrectionState((1e-5, 0.0), time_ns=0)
    limited = limit_corrections(LIMITS, state, times(1, MS), np.array([[1.0, 1.0]]), usable=np.array([False]))
    np.testing.assert_array_equal(limited.corrections, [[1e-5, 0.0]])
    assert limited.outcomes.tolist() == [CorrectionOutcome.HELD]
    assert not limited.state.latched


def test_no_poses_change_nothing() -> None:
    state = CorrectionState((1e-5, 0.0), time_ns=7)
    limited = limit_corrections(LIMITS, state, times(0), np.zeros((0, 2)))
    assert limited.corrections.shape == (0, 2)
    assert limited.state == state


@given(
    cuts=st.lists(st.integers(1, 39), max_size=6, unique=True),
    size=st.sampled_from([1e-7, 1e-6, 1e-5, 2e-4]),
    seed=st.integers(0, 1000),
)
@settings(max_examples=80, deadline=None)
def test_numbers_do_not_depend_on_the_blocks(cuts: list[int], size: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    wanted = np.cumsum(rng.normal(size=(40, 2)) * size, axis=0)
    wanted[rng.random(40) < 0.1] = np.nan
    stamps = times(40)
    whole = limit_corrections(LIMITS, initial_state(2), stamps, wanted)
    state, corrections, outcomes = initial_state(2), [], []
    for block in np.split(np.arange(40), sorted(cuts)):
        part = limit_corrections(LIMITS, state, stamps[block], wanted[block])
        state = part.state
        corrections.append(part.corrections)
        outcomes.append(part.outcomes)
    np.testing.assert_array_equal(np.concatenate(corrections), whole.corrections)
    np.testing.assert_array_equal(np.concatenate(outcomes), whole.outcomes)
    assert state == whole.state
    assert np.isfinite(whole.corrections).all()
    assert np.all(np.abs(whole.corrections) <= LIMITS.error)
    assert np.all(np.abs(np.diff(whole.corrections, axis=0)) <= LIMITS.rate * 1e-3 * (1 + 1e-9))


@given(
    start=st.tuples(st.floats(-2e-3, 2e-3), st.floats(-2e-3, 2e-3)),
    size=st.floats(0.0, 0.95),
    seed=st.integers(0, 2**32 - 1),
)
def test_what_is_in_effect_beyond_a_lowered_limit_goes_back_at_the_rate_limit(
    start: tuple[float, float], size: float, seed: int
) -> None:
    wanted = size * LIMITS.error * np.random.default_rng(seed).uniform(-1.0, 1.0, (3000, 2))
    limited = limit_corrections(LIMITS, CorrectionState(start, time_ns=0), times(3000, MS), wanted)
    steps = np.diff(limited.corrections, axis=0, prepend=np.array([start]))
    assert np.all(np.abs(steps) <= LIMITS.rate * 1e-3 * (1 + 1e-9))
    growth = np.diff(np.abs(limited.corrections), axis=0, prepend=np.abs([start]))
    beyond = np.abs(limited.corrections) > LIMITS.error
    assert np.all(growth[beyond] <= 0.0)
    assert not beyond[-1].any()


def test_limits_by_kind_of_axis() -> None:
    limits = axis_limits(load_machine("xyzac_trt"), linear=(1e-4, 2e-4, 1e-3), rotary=(3e-4, 4e-4, 2e-3))
    assert limits.letters == ("X", "Y", "Z", "A", "C")
    np.testing.assert_array_equal(limits.warning, [1e-4, 1e-4, 1e-4, 3e-4, 3e-4])
    np.testing.assert_array_equal(limits.error, [2e-4, 2e-4, 2e-4, 4e-4, 4e-4])
    np.testing.assert_array_equal(limits.rate, [1e-3, 1e-3, 1e-3, 2e-3, 2e-3])


@pytest.mark.parametrize(
    ("linear", "message"),
    [
        ((2e-4, 1e-4, 1e-3), "expected 0 < warning <= error"),
        ((1e-4, 2e-4, 0.0), "0 < rate"),
        ((1e-4, np.nan, 1e-3), "expected finite numbers"),
        ((1e-4, 2e-4), "expected warning, error and rate"),
    ],
)
def test_wrong_limits_are_refused(linear: tuple[float, ...], message: str) -> None:
    rotary = (3e-4, 4e-4, 2e-3)[: len(linear)]
    with pytest.raises(InputError, match=message):
        axis_limits(load_machine("xyzac_trt"), linear=linear, rotary=rotary)


def test_limits_of_unequal_shape_are_refused() -> None:
    with pytest.raises(InputError, match="expected one of each for X, C"):
        CorrectionLimits(("X", "C"), np.ones(2), np.ones(3), np.ones(2))


def test_wrong_poses_are_refused() -> None:
    with pytest.raises(InputError, match=r"expected \(3, 2\)"):
        limit_corrections(LIMITS, initial_state(2), times(3), np.zeros((3, 3)))
    with pytest.raises(InputError, match=r"pose 1 is 0.001000000 s before the one before it"):
        limit_corrections(LIMITS, initial_state(2), times(2, step=-MS), np.zeros((2, 2)))
